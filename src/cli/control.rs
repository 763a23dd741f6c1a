//! `onbrick control`: the process that drives. Hidden: `run` starts it, and a person never does.
//!
//! It is a process of its own so that whatever happens to its starter, this one holds nothing but the robot and the recording, and can
//! be killed and waited for. Between the two there are two pipes:
//!
//! - standard input: the [`Job`] as one line of JSON. The pipe then stays open and silent; when it closes, the starter is
//!   gone, and the run ends.
//! - standard output: an empty line for each tick (the heartbeat) and [`Event`]s, one line of JSON each. It never blocks: what does
//!   not fit into the pipe is left out, except for the last event, which is written after the motors have stopped.

use std::io::{self, BufRead, Read};
use std::os::fd::AsFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use nix::errno::Errno;
use nix::fcntl::{FcntlArg, OFlag, fcntl};

use super::{Exit, Failure, Output};
use crate::runtime::{Event, Heartbeat, Job, StopFlags, execute};

/// Drive: started by `onbrick run`, never by hand.
#[derive(Debug, clap::Args)]
pub(super) struct Arguments {}

/// No job is longer: two files of the largest size, and JSON's escapes.
const LONGEST_JOB: u64 = 64 << 20;

pub(super) fn run(_arguments: &Arguments, _output: &mut Output) -> Result<(), Failure> {
    let flags = StopFlags::on_signals()
        .map_err(|error| Failure::from_error(Exit::Failed, "cannot listen to signals", &error))?;
    let job = read_job()?;
    watch_starter(Arc::clone(&flags.abandoned));
    let pipe = Pipe { closed: Arc::clone(&flags.abandoned) };
    pipe.set_blocking(false);
    let mut heartbeat = pipe.clone();
    let reporter = pipe.clone();
    let ended = execute(&job, &flags, &mut heartbeat, move |event| reporter.send(event));
    pipe.set_blocking(true);
    match ended {
        Ok(ended) => pipe.send(&Event::Ended(ended)),
        Err(refused) => pipe
            .send(&Event::Refused { message: refused.to_text(), hint: refused.way_out().map(str::to_owned) }),
    }
    Ok(())
}

fn read_job() -> Result<Job, Failure> {
    let mut line = String::new();
    let failed = |error: &dyn std::error::Error| {
        Failure::from_error(Exit::Usage, "standard input has no job", error)
            .hint("onbrick run, which starts this process and gives it its job")
    };
    io::stdin().lock().take(LONGEST_JOB).read_line(&mut line).map_err(|error| failed(&error))?;
    serde_json::from_str(&line).map_err(|error| failed(&error))
}

/// Raises the flag when standard input closes. The thread ends with the process.
fn watch_starter(abandoned: Arc<AtomicBool>) {
    std::thread::spawn(move || {
        let mut rest = [0; 64];
        while io::stdin().lock().read(&mut rest).is_ok_and(|count| count > 0) {}
        abandoned.store(true, Ordering::Relaxed);
    });
}

/// Standard output as a pipe that never makes the tick wait.
#[derive(Debug, Clone)]
struct Pipe {
    closed: Arc<AtomicBool>,
}

impl Pipe {
    /// One write a line: a line shorter than `PIPE_BUF` goes whole or not at all.
    fn send(&self, event: &Event) {
        if let Ok(mut line) = serde_json::to_vec(event) {
            line.push(b'\n');
            self.write(&line);
        }
    }

    fn write(&self, bytes: &[u8]) {
        // A reader that lags misses a line (EAGAIN); the next one is no worse.
        if nix::unistd::write(io::stdout().as_fd(), bytes) == Err(Errno::EPIPE) {
            self.closed.store(true, Ordering::Relaxed);
        }
    }

    fn set_blocking(&self, blocking: bool) {
        let flags = if blocking { OFlag::empty() } else { OFlag::O_NONBLOCK };
        // Should the kernel refuse, writes wait for a reader that hardly ever lags.
        let _ = fcntl(io::stdout().as_fd(), FcntlArg::F_SETFL(flags));
    }
}

impl Heartbeat for Pipe {
    fn beat(&mut self) {
        self.write(b"\n");
    }
}
