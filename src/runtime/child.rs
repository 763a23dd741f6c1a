//! A run in a process of its own: started, followed, stopped, waited for.
//!
//! ```text
//! run, or the service ──▶ guard ──▶ control
//! ```
//!
//! Control drives; the guard stops the motors when control is gone or hung ([`Watch`](super::Watch)). A simulated brick lives inside
//! control, and needs no guard. Each starter and the process that it started talk over two pipes, in lines of JSON:
//!
//! - its standard input: the [`Job`], then [`Order`]s as they come. When this pipe closes, the starter is gone, and what happens then is
//!   [`Job::when_abandoned`].
//! - its standard output: an empty line for each tick (the heartbeat) and [`Event`]s, of which the last is [`Event::Ended`] or
//!   [`Event::Refused`].
//!
//! The process is this same program under a hidden command, started anew rather than forked: threads and locks of the starter do not exist
//! in it.
//!
//! # Not here
//!
//! The other ends of the pipes are the commands `guard` and `control`.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use log::LevelFilter;
use nix::sys::signal::Signal;
use serde::{Deserialize, Serialize};

use super::{Brick, Ended, Event, Job, StopFlags};

/// No job is longer, bytes: two files of the largest size, and JSON's escapes.
const LONGEST_JOB: u64 = 64 << 20;

/// No order is longer, bytes.
const LONGEST_ORDER: u64 = 4096;

/// What may be asked of a run while it goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Order {
    /// Stop, on somebody's behalf.
    Stop(StopBy),
}

/// On whose behalf a run is stopped: it becomes the reason for the run's end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StopBy {
    /// Somebody on the network: [`StopReason::Remote`](super::StopReason::Remote).
    Remote,
    /// A person in the brick's menu, or a program on the brick:
    /// [`StopReason::Here`](super::StopReason::Here).
    Here,
    /// The menu is gone: [`StopReason::MenuClosed`](super::StopReason::MenuClosed).
    MenuClosed,
    /// Whoever started it was told to stop by a signal: [`StopReason::Signal`](super::StopReason::Signal).
    Terminal,
}

impl StopBy {
    /// The signal that says the same to the process that drives, for who has no pipe to it.
    #[must_use]
    pub fn signal(self) -> Signal {
        match self {
            Self::Remote => Signal::SIGUSR1,
            Self::Here => Signal::SIGUSR2,
            // No process of a run sets an alarm.
            Self::MenuClosed => Signal::SIGALRM,
            Self::Terminal => Signal::SIGTERM,
        }
    }
}

/// Why a run's process could not be started. Nothing has moved.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The program cannot be started: look at its file and at how many processes there are.
    #[error("cannot start the process that drives")]
    Spawn(#[source] io::Error),
    /// The job cannot be written down; a mistake in the program.
    #[error("cannot write the job")]
    Job(#[from] serde_json::Error),
    /// The process ended before it had its job.
    #[error("the process that drives did not take its job")]
    HandOver(#[source] io::Error),
}

/// Why a run's process has no [`Ended`] to tell.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The run did not start, and nothing has moved: do what the hint says.
    #[error("{message}")]
    Refused {
        /// Why.
        message: String,
        /// What to do, where the message does not say it.
        hint: Option<String>,
    },
    /// The process ended without a last word: see that the motors are still.
    #[error("the process that drives ended without a word ({status})")]
    Silent {
        /// How it ended.
        status: ExitStatus,
    },
    /// The process cannot be waited for.
    #[error("cannot wait for the process that drives")]
    Io(#[from] io::Error),
}

/// A run in a process of its own.
///
/// Dropping it closes the pipe of orders: the starter has left the run to itself.
#[derive(Debug)]
pub struct RunProcess {
    child: Child,
    stopper: Stopper,
    events: BufReader<ChildStdout>,
    last_word: Option<Event>,
}

impl RunProcess {
    /// Starts the processes of a run, and hands the job over.
    ///
    /// - `program`: this program's file (`std::env::current_exe`).
    ///
    /// # Errors
    ///
    /// [`StartError`].
    pub fn start(program: &Path, job: &Job) -> Result<Self, StartError> {
        let process = match job.brick {
            Brick::Local(_) => "guard",
            // Nothing real moves, and its process is the brick.
            Brick::Simulated { .. } => "control",
        };
        let mut child = Command::new(program)
            .arg(process)
            .args(verbosity())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(StartError::Spawn)?;
        let lost = || StartError::Spawn(io::ErrorKind::BrokenPipe.into());
        let mut orders = child.stdin.take().ok_or_else(lost)?;
        let events = BufReader::new(child.stdout.take().ok_or_else(lost)?);
        let mut line = serde_json::to_vec(job)?;
        line.push(b'\n');
        if let Err(error) = orders.write_all(&line) {
            // It has closed its end, so it is about to be gone.
            let _ = child.wait();
            return Err(StartError::HandOver(error));
        }
        let stopper = Stopper { orders: Arc::new(Mutex::new(Some(orders))) };
        Ok(Self { child, stopper, events, last_word: None })
    }

    /// Waits for the next event, and skips heartbeats; `None` when the run's processes are gone.
    pub fn next_event(&mut self) -> Option<Event> {
        let mut line = String::new();
        loop {
            line.clear();
            if self.events.read_line(&mut line).ok()? == 0 {
                return None;
            }
            if let Ok(event) = serde_json::from_str::<Event>(&line) {
                if matches!(event, Event::Ended(_) | Event::Refused { .. }) {
                    self.last_word = Some(event.clone());
                }
                return Some(event);
            }
        }
    }

    /// What stops this run, from any thread.
    #[must_use]
    pub fn stopper(&self) -> Stopper {
        self.stopper.clone()
    }

    /// Waits until the run's processes are gone; how the run went.
    ///
    /// # Errors
    ///
    /// [`RunError`].
    pub fn wait(mut self) -> Result<Ended, RunError> {
        while self.next_event().is_some() {}
        let status = self.child.wait()?;
        match self.last_word.take() {
            Some(Event::Ended(ended)) => Ok(ended),
            Some(Event::Refused { message, hint }) => Err(RunError::Refused { message, hint }),
            _ => Err(RunError::Silent { status }),
        }
    }
}

impl Drop for RunProcess {
    fn drop(&mut self) {
        self.stopper.close();
    }
}

/// Stops a run from any thread.
#[derive(Debug, Clone)]
pub struct Stopper {
    /// Nothing once the run has been waited for or left to itself.
    orders: Arc<Mutex<Option<ChildStdin>>>,
}

impl Stopper {
    /// Asks the run to stop; it then ends by itself and says how. A run that is over needs no asking, and that is no error.
    ///
    /// # Errors
    ///
    /// What writing to its pipe gave; its process is then about to be gone.
    pub fn stop(&self, by: StopBy) -> io::Result<()> {
        let mut orders = self.orders.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(pipe) = orders.as_mut() else { return Ok(()) };
        let mut line = serde_json::to_vec(&Order::Stop(by))?;
        line.push(b'\n');
        pipe.write_all(&line)
    }

    fn close(&self) {
        self.orders.lock().unwrap_or_else(PoisonError::into_inner).take();
    }
}

/// Reads the job that the starter hands over first.
///
/// # Errors
///
/// The pipe failed or closed, or what came is no job.
pub fn read_job(orders: &mut impl BufRead) -> io::Result<Job> {
    let mut line = String::new();
    orders.take(LONGEST_JOB).read_line(&mut line)?;
    Ok(serde_json::from_str(&line)?)
}

/// The arguments with which a process of a run says as much as this one does: to be added to its command.
#[must_use]
pub fn verbosity() -> Option<&'static str> {
    match log::max_level() {
        LevelFilter::Off | LevelFilter::Error | LevelFilter::Warn => None,
        LevelFilter::Info => Some("-v"),
        LevelFilter::Debug => Some("-vv"),
        LevelFilter::Trace => Some("-vvv"),
    }
}

/// Does what the starter orders, in a thread of its own that ends with the process.
///
/// - `orders`: the pipe from the starter, behind the job.
/// - `gone`: raised when that pipe closes.
///
/// # Errors
///
/// The kernel has no room for a thread.
pub fn obey(
    mut orders: impl BufRead + Send + 'static,
    flags: &StopFlags,
    gone: &Arc<AtomicBool>,
) -> io::Result<()> {
    let (flags, gone) = (flags.clone(), Arc::clone(gone));
    let thread = std::thread::Builder::new().name("orders".to_owned());
    thread.spawn(move || {
        while let Some(Order::Stop(by)) = next_order(&mut orders) {
            flags.raise(by);
        }
        gone.store(true, Ordering::Relaxed);
    })?;
    Ok(())
}

/// Waits for the starter's next order; `None` when the starter is gone. What is no order is passed over.
fn next_order(orders: &mut impl BufRead) -> Option<Order> {
    let mut line = Vec::new();
    loop {
        line.clear();
        if orders.take(LONGEST_ORDER).read_until(b'\n', &mut line).ok()? == 0 {
            return None;
        }
        if let Ok(order) = serde_json::from_slice(&line) {
            return Some(order);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_are_lines_and_what_is_none_is_passed_over() {
        let mut pipe: &[u8] =
            b"{\"stop\":\"remote\"}\n\nnonsense\n{\"stop\":\"menu_closed\"}\n{\"stop\":\"term";
        assert_eq!(next_order(&mut pipe), Some(Order::Stop(StopBy::Remote)));
        assert_eq!(next_order(&mut pipe), Some(Order::Stop(StopBy::MenuClosed)));
        assert_eq!(next_order(&mut pipe), None, "a starter that died in the middle of a word");
    }

    #[test]
    fn what_is_no_job_is_said_to_be_none() {
        for text in ["", "\n", "{}\n", "{\"mission\""] {
            read_job(&mut text.as_bytes()).unwrap_err();
        }
    }
}
