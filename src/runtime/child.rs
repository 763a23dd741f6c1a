//! A run in a process of its own: started, followed, stopped, waited for.
//!
//! ```text
//! run, or the service ──▶ guard ──▶ control
//! ```
//!
//! Control drives; the guard stops the motors when control is gone or hung
//! ([`Watch`](super::Watch)). A simulated brick lives inside control, and needs no guard. Each
//! starter and the process that it started talk over two pipes, in lines of JSON:
//!
//! - its standard input: the [`Job`], then orders to stop ([`StopBy`]), and an empty line for each
//!   event that the starter has dealt with; control's has an empty line each 20 ms or so instead,
//!   the guard's heartbeat ([`Pulse`](super::Pulse)). When this pipe closes, the starter is gone;
//!   when an event stays without an answer, it hangs. What happens then is
//!   [`Job::when_abandoned`].
//! - its standard output: an empty line for each tick (the heartbeat) and [`Event`]s, of which the
//!   last is [`Event::Ended`] or [`Event::Refused`].
//!
//! The process is this same program under a hidden command, executed rather than forked: threads
//! and locks of the starter do not exist in it.
//!
//! A run that does not stop within [`PATIENCE_NS`] when it is asked to is ended by force: its first
//! process is killed. Whenever that is gone without a last word, [`RunProcess::wait`] sees to it
//! that control is gone, too, or has stopped its motors ([`end_by_force`]).
//!
//! # Not here
//!
//! The other ends of the pipes are the commands `guard` and `control`.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};

use log::LevelFilter;
use nix::fcntl::{FcntlArg, OFlag, fcntl};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde::{Deserialize, Serialize};

use super::{Brick, Ended, Event, Job, Owner, PATIENCE_NS, Stop, StopFlags, end_by_force};
use crate::clock::{Clock, MonotonicClock};
use crate::ev3dev::Tree as _;
use crate::printable::{from_json, json_line, with_causes};
use crate::threads::{lock, spawn};

/// No job is longer, bytes: two files of the largest size, and JSON's escapes.
const LONGEST_JOB: u64 = 64 << 20;

/// No order is longer, bytes.
const LONGEST_ORDER: u64 = 4096;

/// On whose behalf a run is stopped, which is all that may be asked of one in progress: it becomes
/// the reason for the run's end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StopBy {
    /// A client on the network: [`StopReason::Remote`](super::StopReason::Remote).
    Remote,
    /// A person in the brick's menu, or a program on the brick:
    /// [`StopReason::Here`](super::StopReason::Here).
    Here,
    /// A person at a run's page: [`StopReason::Page`](super::StopReason::Page).
    Page,
    /// The menu is gone: [`StopReason::MenuClosed`](super::StopReason::MenuClosed).
    MenuClosed,
    /// The starter was told to stop by a signal: [`StopReason::Signal`](super::StopReason::Signal).
    Terminal,
    /// The starter is gone, says the guard:
    /// [`StopReason::Abandoned`](super::StopReason::Abandoned).
    Abandoned,
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
            // A page stops the runs that it started, and has a pipe to them.
            Self::Page | Self::Terminal | Self::Abandoned => Signal::SIGTERM,
        }
    }
}

/// Why a run's process could not be started. Nothing has moved.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
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
#[non_exhaustive]
pub enum RunError {
    /// The run did not start, and nothing has moved: do what the hint says.
    #[error("{stop}")]
    Refused {
        /// Why.
        stop: Stop,
        /// What to do, where the reason does not say it.
        hint: Option<String>,
    },
    /// The run's first process ended without a last word.
    #[error(
        "{process} ended without a word ({status}){}",
        if *.forced { ", killed because the run did not stop when asked to" } else { "" }
    )]
    Silent {
        /// Which: the guard, or, on a simulated brick, the process that drives.
        process: &'static str,
        /// How it ended.
        status: ExitStatus,
        /// We killed it.
        forced: bool,
        /// The motors are still, or were told to stop by the process that drives.
        stopped: bool,
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
    /// The brick, where it is not a simulated one inside the process.
    root: Option<PathBuf>,
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
        let (process, root) = match &job.brick {
            Brick::Local(tree) => ("guard", Some(tree.root().to_owned())),
            // Nothing real moves, and its process is the brick.
            Brick::Simulated { .. } => ("control", None),
        };
        let line = json_line(job)?;
        let (mut child, mut orders, said) =
            spawn_process(program, process).map_err(StartError::Spawn)?;
        if let Err(error) = orders.write_all(&line) {
            // It has closed its end, so it is about to be gone.
            let _ = child.wait();
            return Err(StartError::HandOver(error));
        }
        let stopper = Stopper::new(&child, orders);
        Ok(Self { child, root, stopper, events: BufReader::new(said), last_word: None })
    }

    /// Waits for the next event, and skips heartbeats; `None` when the run's processes are gone.
    ///
    /// To ask for the next one says that the last one is dealt with: a starter that does not ask
    /// for seconds is taken to hang.
    pub fn next_event(&mut self) -> Option<Event> {
        self.stopper.answer();
        let mut line = String::new();
        loop {
            line.clear();
            if !self.events.read_line(&mut line).is_ok_and(|count| count > 0) {
                self.stopper.obeyed();
                return None;
            }
            if let Ok(event) = from_json::<Event>(&line) {
                if matches!(event, Event::Stopped { .. } | Event::Ended(_) | Event::Refused { .. })
                {
                    self.stopper.obeyed();
                }
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

    /// Waits until the run's processes are gone; how the run went. Where the first of them is gone
    /// without a word, makes sure that the other has stopped its motors, or is gone and its motors
    /// are still.
    ///
    /// # Errors
    ///
    /// [`RunError`].
    pub fn wait(mut self) -> Result<Ended, RunError> {
        while self.next_event().is_some() {}
        let status = self.child.wait()?;
        match self.last_word.take() {
            Some(Event::Ended(ended)) => Ok(ended),
            Some(Event::Refused { stop, hint }) => Err(RunError::Refused { stop, hint }),
            _ => Err(RunError::Silent {
                process: if self.root.is_some() {
                    "the run's guard"
                } else {
                    "the process that drives"
                },
                status,
                forced: lock(&self.stopper.inner).forced,
                stopped: self
                    .root
                    .as_ref()
                    .is_none_or(|root| see_to_motors(root, self.stopper.process)),
            }),
        }
    }
}

impl Drop for RunProcess {
    fn drop(&mut self) {
        self.stopper.close();
    }
}

/// The guard is gone: true once control has stopped the motors, or is gone and the motors are
/// still.
fn see_to_motors(root: &Path, guard: Pid) -> bool {
    let of_run = |owner: &Owner| [Some(owner.pid), owner.guard].contains(&Some(guard.as_raw()));
    end_by_force(root, 0, of_run).unwrap_or_else(|error| {
        log::error!("{}", with_causes(&error));
        false
    })
}

/// Stops a run from any thread.
#[derive(Debug, Clone)]
pub struct Stopper {
    inner: Arc<Mutex<Stopping>>,
    /// The run's first process.
    process: Pid,
}

#[derive(Debug)]
struct Stopping {
    /// Nothing once the run has been waited for or left to itself.
    orders: Option<ChildStdin>,
    /// It was asked, and a thread waits for its answer.
    asked: bool,
    /// The motors were told, or the process is gone.
    obeyed: bool,
    /// It was killed because it did not obey.
    forced: bool,
}

impl Stopper {
    fn new(child: &Child, orders: ChildStdin) -> Self {
        // A process that hangs does not empty its pipe; the asker must not hang with it.
        if let Err(errno) = never_wait(orders.as_fd()) {
            log::warn!("orders to the run may have to wait: {errno}");
        }
        let stopping =
            Stopping { orders: Some(orders), asked: false, obeyed: false, forced: false };
        // The kernel's numbers of processes fit.
        let process = Pid::from_raw(i32::try_from(child.id()).unwrap_or(0));
        Self { inner: Arc::new(Mutex::new(stopping)), process }
    }

    /// Asks the run to stop; it then ends by itself and says how. One that has not told its motors
    /// to stop after [`PATIENCE_NS`] is killed. A run that is over needs no asking, and that is no
    /// error.
    ///
    /// # Errors
    ///
    /// What writing to its pipe gave, or the kernel has no room for the thread that waits.
    pub fn stop(&self, by: StopBy) -> io::Result<()> {
        let mut stopping = lock(&self.inner);
        let Some(pipe) = stopping.orders.as_mut() else { return Ok(()) };
        let asked = pipe.write_all(&json_line(&by)?);
        if !std::mem::replace(&mut stopping.asked, true) {
            let stopper = self.clone();
            spawn("patience", move || stopper.force_later())?;
        }
        asked
    }

    fn force_later(&self) {
        MonotonicClock.sleep_ns(PATIENCE_NS);
        let mut stopping = lock(&self.inner);
        // While it has not obeyed, it has not been waited for, and its number is its own.
        if !stopping.obeyed && self.process.as_raw() > 0 {
            log::error!("the run did not stop when it was asked to; it is ended by force");
            stopping.forced = kill(self.process, Signal::SIGKILL).is_ok();
        }
    }

    /// Says that this process lives, and has dealt with what it was told.
    fn answer(&self) {
        if let Some(pipe) = lock(&self.inner).orders.as_mut() {
            // One that is gone needs no answer, and a full pipe has enough of them.
            let _ = pipe.write(b"\n");
        }
    }

    fn obeyed(&self) {
        lock(&self.inner).obeyed = true;
    }

    fn close(&self) {
        lock(&self.inner).orders.take();
    }
}

/// A pipe that answers at once, whether or not there is something in it, or room.
///
/// # Errors
///
/// What the kernel answers.
pub fn never_wait(pipe: BorrowedFd<'_>) -> nix::Result<()> {
    let flags = OFlag::from_bits_retain(fcntl(pipe, FcntlArg::F_GETFL)?);
    fcntl(pipe, FcntlArg::F_SETFL(flags | OFlag::O_NONBLOCK))?;
    Ok(())
}

/// Reads the job that the starter hands over first.
///
/// # Errors
///
/// The pipe failed or closed, or what came is no job.
pub fn read_job(orders: &mut impl BufRead) -> io::Result<Job> {
    let mut line = String::new();
    orders.take(LONGEST_JOB).read_line(&mut line)?;
    Ok(from_json(&line)?)
}

/// Starts a process of a run, which says as much as this one does: with the pipe of its orders, and
/// that of what it says.
pub(super) fn spawn_process(
    program: &Path,
    process: &str,
) -> io::Result<(Child, ChildStdin, ChildStdout)> {
    let piped = Stdio::piped;
    let mut child = Command::new(program)
        .arg(process)
        .args(verbosity())
        .stdin(piped())
        .stdout(piped())
        .spawn()?;
    match (child.stdin.take(), child.stdout.take()) {
        (Some(orders), Some(said)) => Ok((child, orders, said)),
        _ => Err(io::ErrorKind::BrokenPipe.into()),
    }
}

/// The arguments with which a process says as much as this one does.
fn verbosity() -> Option<&'static str> {
    match log::max_level() {
        LevelFilter::Off | LevelFilter::Error | LevelFilter::Warn => None,
        LevelFilter::Info => Some("-v"),
        LevelFilter::Debug => Some("-vv"),
        LevelFilter::Trace => Some("-vvv"),
    }
}

/// Does what the starter orders and counts the guard's beats, in a thread of its own that ends with
/// the process.
///
/// - `orders`: the pipe from the starter, behind the job.
/// - `gone`: raised when that pipe closes.
/// - `begin`: what the thread does first, such as raising its priority.
///
/// # Errors
///
/// The kernel has no room for a thread.
pub fn obey(
    mut orders: impl BufRead + Send + 'static,
    flags: &StopFlags,
    gone: &Arc<AtomicBool>,
    begin: impl FnOnce() + Send + 'static,
) -> io::Result<()> {
    let (flags, gone) = (flags.clone(), Arc::clone(gone));
    spawn("orders", move || {
        begin();
        while let Some(by) = next_order(&mut orders, &flags.guard_beats) {
            flags.raise(by);
        }
        gone.store(true, Ordering::Relaxed);
    })?;
    Ok(())
}

/// Waits for the starter's next order; `None` when the starter is gone. Beats are counted; what
/// else is no order is passed over.
fn next_order(orders: &mut impl BufRead, beats: &AtomicU32) -> Option<StopBy> {
    let mut line = Vec::new();
    loop {
        line.clear();
        if orders.take(LONGEST_ORDER).read_until(b'\n', &mut line).ok()? == 0 {
            return None;
        }
        if line == b"\n" {
            beats.fetch_add(1, Ordering::Relaxed);
        } else if let Ok(order) = serde_json::from_slice(&line) {
            return Some(order);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_are_lines_and_what_is_none_is_passed_over() {
        let mut pipe: &[u8] = b"\"remote\"\n\nnonsense\n\"menu_closed\"\n\"term";
        let beats = AtomicU32::new(0);
        let mut next = || next_order(&mut pipe, &beats);
        assert_eq!(next(), Some(StopBy::Remote));
        assert_eq!(next(), Some(StopBy::MenuClosed));
        assert_eq!(next(), None, "a starter that died in the middle of a word");
        assert_eq!(beats.load(Ordering::Relaxed), 1, "the empty line");
    }

    #[test]
    fn what_is_no_job_is_said_to_be_none() {
        for text in ["", "\n", "{}\n", "{\"mission\""] {
            read_job(&mut text.as_bytes()).unwrap_err();
        }
    }
}
