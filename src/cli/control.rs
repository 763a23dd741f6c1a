//! `onbrick control`: the process that drives. Hidden: `run` starts it, and a person never does.
//!
//! It is a process of its own so that whatever happens to its starter, this one holds nothing but the robot and the recording, and can
//! be killed and waited for. What is said over its two pipes is in [`RunProcess`](crate::runtime::RunProcess). Its output never blocks
//! a tick: what does not fit into the pipe is left out. Only what is said after the motors have stopped is waited with, and not for ever.

use std::io::{self, BufReader, Stdin};
use std::os::fd::AsFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use nix::errno::Errno;
use nix::fcntl::{FcntlArg, OFlag, fcntl};
use nix::poll::{PollFd, PollFlags, poll};

use super::{Exit, Failure, Output};
use crate::runtime::{Event, Heartbeat, Order, StopFlags, WhenAbandoned, execute, next_order, read_job};

/// Drive: started by `onbrick run`, never by hand.
#[derive(Debug, clap::Args)]
pub(super) struct Arguments {}

/// How long a last word waits for a reader that lags, milliseconds.
const PATIENCE_MS: u16 = 2000;

pub(super) fn run(_arguments: &Arguments, _output: &mut Output) -> Result<(), Failure> {
    let flags = StopFlags::on_signals()
        .map_err(|error| Failure::from_error(Exit::Failed, "cannot listen to signals", &error))?;
    let mut orders = BufReader::new(io::stdin());
    let job = read_job(&mut orders).map_err(|error| {
        Failure::from_error(Exit::Usage, "standard input has no job", &error)
            .hint("onbrick run, which starts this process and gives it its job")
    })?;
    let gone = match job.when_abandoned {
        WhenAbandoned::Stop => Arc::clone(&flags.abandoned),
        WhenAbandoned::GoOn => Arc::default(),
    };
    obey(orders, flags.clone(), Arc::clone(&gone));
    let pipe = Pipe { gone };
    pipe.never_wait();
    let mut heartbeat = pipe.clone();
    let reporter = pipe.clone();
    let ended = execute(&job, &flags, &mut heartbeat, move |event| reporter.send(event));
    pipe.send(&match ended {
        Ok(ended) => Event::Ended(ended),
        Err(refused) => {
            Event::Refused { message: refused.to_text(), hint: refused.way_out().map(str::to_owned) }
        }
    });
    Ok(())
}

/// Does what the starter asks, and raises `gone` when its pipe closes. The thread ends with the process.
fn obey(mut orders: BufReader<Stdin>, flags: StopFlags, gone: Arc<AtomicBool>) {
    std::thread::spawn(move || {
        while let Some(Order::Stop(by)) = next_order(&mut orders) {
            flags.raise(by);
        }
        gone.store(true, Ordering::Relaxed);
    });
}

/// Standard output as a pipe that never makes the tick wait.
#[derive(Debug, Clone)]
struct Pipe {
    /// Raised when nobody reads any more.
    gone: Arc<AtomicBool>,
}

impl Pipe {
    /// One write a line: a line shorter than `PIPE_BUF` goes whole or not at all.
    fn send(&self, event: &Event) {
        if matches!(event, Event::Stopped { .. } | Event::Ended(_) | Event::Refused { .. }) {
            self.wait_for_room();
        }
        if let Ok(mut line) = serde_json::to_vec(event) {
            line.push(b'\n');
            self.write(&line);
        }
    }

    fn write(&self, bytes: &[u8]) {
        // A reader that lags misses a line (EAGAIN); the next one is no worse.
        if nix::unistd::write(io::stdout().as_fd(), bytes) == Err(Errno::EPIPE) {
            self.gone.store(true, Ordering::Relaxed);
        }
    }

    /// The kernel calls a pipe writable when it has room for `PIPE_BUF`.
    fn wait_for_room(&self) {
        let stdout = io::stdout();
        // Interrupted or refused: the write that follows then misses, as any may.
        let _ = poll(&mut [PollFd::new(stdout.as_fd(), PollFlags::POLLOUT)], PATIENCE_MS);
    }

    fn never_wait(&self) {
        // Should the kernel refuse, writes wait for a reader that hardly ever lags.
        let _ = fcntl(io::stdout().as_fd(), FcntlArg::F_SETFL(OFlag::O_NONBLOCK));
    }
}

impl Heartbeat for Pipe {
    fn beat(&mut self) {
        self.write(b"\n");
    }
}
