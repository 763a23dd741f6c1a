//! onbrick itself, but with trouble on demand, for the tests of what stops the motors then:
//!
//! - SIGVTALRM makes its main thread spin for ever: in the process that drives, the one that ticks.
//! - SIGPROF makes a thread of the process that drives panic, the one that `TROUBLED_THREAD` names:
//!   `tick`, `recorder`, `mender` or `orders`; with `memory` it makes the process want more memory
//!   than there is.
//!
//! For the latter the process that drives is put together here as the command `control` does it, of
//! the library's parts, each of which is called from the thread that is to panic. It has no
//! real-time priority.

use std::io::{self, BufRead, BufReader, Read, Stdin, Write};
use std::os::fd::AsFd;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use onbrick::runtime::{Brick, Environment, Event, Heartbeat, StopFlags, execute, obey, read_job};
use signal_hook::consts::{SIGPROF, SIGVTALRM};

#[allow(
    unsafe_code,
    reason = "only a handler that never returns gets hold of a thread of a program that is not \
              ours to change"
)]
fn main() -> ExitCode {
    // SAFETY: the handler calls nothing: it only spins.
    let registered = unsafe { signal_hook::low_level::register(SIGVTALRM, spin) };
    if registered.is_err() {
        return ExitCode::FAILURE;
    }
    let thread = std::env::var("TROUBLED_THREAD").ok();
    match thread {
        Some(thread) if std::env::args().nth(1).is_some_and(|command| command == "control") => {
            control(&Trouble { thread, asked: Arc::default() })
        }
        _ => onbrick::cli::main(std::env::args_os()),
    }
}

fn spin() {
    loop {
        std::hint::spin_loop();
    }
}

/// What is to happen, and whether it is time.
#[derive(Debug, Clone)]
struct Trouble {
    thread: String,
    asked: Arc<AtomicBool>,
}

impl Trouble {
    /// Panics if this is the thread that should, and it is time.
    fn may_befall(&self, thread: &str) {
        assert!(
            self.thread != thread || !self.asked.load(Ordering::Relaxed),
            "trouble in the thread {thread}, as was asked for"
        );
    }
}

fn control(trouble: &Trouble) -> ExitCode {
    let Ok(flags) = StopFlags::on_signals() else { return ExitCode::FAILURE };
    flags.on_panic();
    if signal_hook::flag::register(SIGPROF, Arc::clone(&trouble.asked)).is_err()
        || log::set_boxed_logger(Box::new(trouble.clone())).is_err()
    {
        return ExitCode::FAILURE;
    }
    log::set_max_level(log::LevelFilter::Debug);
    if trouble.thread == "memory" {
        let asked = Arc::clone(&trouble.asked);
        std::thread::spawn(move || want_memory(&asked));
    }
    let mut orders = BufReader::new(io::stdin());
    let Ok(job) = read_job(&mut orders) else { return ExitCode::FAILURE };
    let gone = flags.when_pipe_closes(&job);
    if obey(Orders { pipe: orders, trouble: trouble.clone() }, &flags, &gone, || {}).is_err() {
        return ExitCode::FAILURE;
    }
    let reporter = trouble.clone();
    let Brick::Local(tree) = &job.brick else { return ExitCode::FAILURE };
    let environment = Environment::local(tree);
    let ended = execute(&job, environment, &flags, &mut trouble.clone(), move |event| {
        // Said by the recorder.
        if matches!(event, Event::Status(_)) {
            reporter.may_befall("recorder");
        }
        say(event);
    });
    match ended {
        Ok(ended) => say(&Event::Ended(ended)),
        Err(refused) => say(&Event::Refused { stop: refused.stop(), hint: None }),
    }
    ExitCode::SUCCESS
}

/// A line on standard output; who reads it there may be gone.
fn say(event: &Event) {
    if let Ok(line) = serde_json::to_string(event) {
        let _ = writeln!(io::stdout(), "{line}");
    }
}

/// Takes memory until the kernel has none, and touches each page of it.
fn want_memory(asked: &AtomicBool) {
    while !asked.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(1));
    }
    let mut taken = Vec::new();
    loop {
        taken.push(vec![1_u8; 1 << 20]);
    }
}

impl Heartbeat for Trouble {
    fn beat(&mut self, _now_ns: i64) {
        self.may_befall("tick");
        let _ = io::stdout().write_all(b"\n").and_then(|()| io::stdout().flush());
    }
}

/// The thread that looks for what was unplugged says that it has not found it.
impl log::Log for Trouble {
    fn enabled(&self, _metadata: &log::Metadata<'_>) -> bool {
        true
    }

    fn log(&self, _record: &log::Record<'_>) {
        // A panic says something, too.
        if std::thread::current().name() == Some("mender") && !std::thread::panicking() {
            self.may_befall("mender");
        }
    }

    fn flush(&self) {}
}

/// The pipe of orders, looked at often.
struct Orders {
    pipe: BufReader<Stdin>,
    trouble: Trouble,
}

impl Orders {
    fn wait(&self) {
        while self.pipe.buffer().is_empty() {
            self.trouble.may_befall("orders");
            let stdin = io::stdin();
            let mut waited = [PollFd::new(stdin.as_fd(), PollFlags::POLLIN)];
            if poll(&mut waited, PollTimeout::from(20_u8)) != Ok(0) {
                return;
            }
        }
    }
}

impl Read for Orders {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.wait();
        self.pipe.read(buffer)
    }
}

impl BufRead for Orders {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        self.wait();
        self.pipe.fill_buf()
    }

    fn consume(&mut self, amount: usize) {
        self.pipe.consume(amount);
    }
}
