//! Control: the process that drives.
//!
//! It is a process of its own so that whatever happens to its starter, this one holds nothing but
//! the robot and the recording, and can be killed and waited for. What is said over its two pipes
//! is in [`RunProcess`](crate::runtime::RunProcess). Its output never blocks a tick: what does not
//! fit into the pipe is left out. Only what is said after the motors have stopped is waited with,
//! and not for ever.

use std::io::{self, BufReader};
use std::os::fd::AsFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use nix::errno::Errno;
use nix::sys::signal::{Signal, kill};
use nix::unistd::{Pid, getppid};
use signal_hook::consts::SIGXFSZ;

use super::{BEAT_NS, ProcessError, fatal, urgency};
use crate::clock::{Clock, MILLISECOND_NS, MonotonicClock, SECOND_NS};
use crate::printable::json_line;
use crate::runtime::{
    Brick, Environment, Event, Heartbeat, Job, Lock, Refused, StopFlags, execute, never_wait, obey,
    read_job,
};

/// How long a last word waits for a reader that lags, nanoseconds.
const PATIENCE_NS: i64 = 2 * SECOND_NS;

/// How long the guard has for a beat after the last word, nanoseconds: it beats at least as often
/// as it hears something.
const HUNG_NS: i64 = SECOND_NS / 2;

/// Does the job that comes over standard input, in the place that `environment` makes for it.
///
/// # Errors
///
/// [`ProcessError`]. Once the run begins, what goes wrong is an [`Event`].
pub fn control(
    environment: impl FnOnce(&Job) -> Result<Environment, Refused>,
) -> Result<(), ProcessError> {
    fatal::ends_at_once().map_err(|errno| ProcessError::Signals(errno.into()))?;
    let flags = StopFlags::on_signals().map_err(ProcessError::Signals)?;
    flags.on_panic();
    // A file that may not grow is then an error of its write (EFBIG) and not the end of the process
    // that drives.
    signal_hook::flag::register(SIGXFSZ, Arc::default()).map_err(ProcessError::Signals)?;
    let mut orders = BufReader::new(io::stdin());
    let job = read_job(&mut orders).map_err(ProcessError::NoJob)?;
    let guard = getppid();
    let gone = flags.when_pipe_closes(&job);
    let is_real = matches!(job.brick, Brick::Local(_));
    // A beat that is not heard in time ends the run: hearing it is as urgent as the tick.
    let begin = move || {
        if is_real {
            urgency::as_control()
        }
    };
    obey(orders, &flags, &gone, begin).map_err(ProcessError::Starter)?;
    let pipe = Pipe { gone };
    // Should the kernel refuse, writes wait for a reader that hardly ever lags.
    let _ = never_wait(io::stdout().as_fd());
    let mut heartbeat = Beats { pipe: pipe.clone(), due_ns: 0 };
    let reporter = pipe.clone();
    let report = move |event: &Event| {
        match event {
            // Said by the thread that ticks, after all others have been started at their usual
            // priority.
            Event::Driving { .. } if is_real => urgency::as_control(),
            Event::Stopped { .. } if is_real => urgency::may_compute(),
            _ => {}
        }
        reporter.send(event);
    };
    let ended = environment(&job)
        .and_then(|environment| execute(&job, environment, &flags, &mut heartbeat, report));
    let refused = |refused| Event::of_refused(&refused, &job.brick);
    pipe.send(&ended.map_or_else(refused, Event::Ended));
    if job.lock == Lock::Inherited {
        end_hung_guard(&flags, guard);
    }
    Ok(())
}

/// A guard that hangs would keep the hardware's lock, and its starter waiting. One that beats has
/// read the last word.
fn end_hung_guard(flags: &StopFlags, guard: Pid) {
    let beats = || flags.guard_beats.load(Ordering::Relaxed);
    let before = beats();
    let lives_or_is_gone = || beats() != before || getppid() != guard;
    if !MonotonicClock.wait_for(HUNG_NS, MILLISECOND_NS, &lives_or_is_gone) {
        log::error!("the guard gives no sign of life, and is killed");
        let _ = kill(guard, Signal::SIGKILL);
    }
}

/// Standard output as a pipe that never makes the tick wait.
#[derive(Debug, Clone)]
struct Pipe {
    /// Raised when the reader has gone.
    gone: Arc<AtomicBool>,
}

impl Pipe {
    fn send(&self, event: &Event) {
        let Ok(line) = json_line(event) else { return };
        if matches!(event, Event::Stopped { .. } | Event::Ended(_) | Event::Refused { .. }) {
            self.write_whole(&line);
        } else {
            // A line shorter than `PIPE_BUF` goes whole, or not at all where the reader lags; the
            // next one is no worse.
            let _ = self.write(&line);
        }
    }

    /// How much was written.
    fn write(&self, bytes: &[u8]) -> nix::Result<usize> {
        let written = nix::unistd::write(io::stdout().as_fd(), bytes);
        if written == Err(Errno::EPIPE) {
            self.gone.store(true, Ordering::Relaxed);
        }
        written
    }

    /// Waits for a reader that lags, but not for ever.
    fn write_whole(&self, mut bytes: &[u8]) {
        let deadline_ns = MonotonicClock.now_ns() + PATIENCE_NS;
        loop {
            match self.write(bytes) {
                Ok(written) => bytes = bytes.get(written..).unwrap_or_default(),
                Err(Errno::EAGAIN | Errno::EINTR) => {}
                Err(_) => return,
            }
            if bytes.is_empty() || MonotonicClock.now_ns() >= deadline_ns {
                return;
            }
            MonotonicClock.sleep_ns(MILLISECOND_NS);
        }
    }
}

/// Tells the guard that the tick is alive: at the tick's rate, but no more than each [`BEAT_NS`].
#[derive(Debug)]
struct Beats {
    pipe: Pipe,
    due_ns: i64,
}

impl Heartbeat for Beats {
    fn beat(&mut self, now_ns: i64) {
        // A little early is better than a whole tick late.
        if now_ns + BEAT_NS / 4 >= self.due_ns {
            // A tick that was late does not make the next beat late.
            self.due_ns = (self.due_ns + BEAT_NS).max(now_ns);
            // A beat that does not fit does not matter: the pipe is full of them.
            let _ = self.pipe.write(b"\n");
        }
    }
}
