//! The guard: starts the process that drives, and stops the motors when it is gone or hung.
//!
//! It passes events and orders on, both ways, and never waits for a reader that lags. It holds the
//! hardware's lock from before control starts until the motors are still, so that no other run
//! comes between; control shares the lock by inheritance, so that it is not free either while a
//! guard is gone and control is still stopping.
//!
//! When control is gone or hung: SIGKILL first, then the motors at once; and the motors again once
//! it is gone, because what it was in the middle of may have been a command. Signals that end or
//! suspend a program are orders to stop the run. The guard beats, too: when it is killed or hangs,
//! control stops the run. A starter that is gone, or has not answered an event for five seconds, is
//! taken to have abandoned its run.

use std::io::{self, BufReader, Read, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::os::unix::process::ExitStatusExt as _;
use std::process::{Child, ChildStdin, ChildStdout, ExitStatus};
use std::sync::Arc;

use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::wait::{Id, WaitPidFlag, WaitStatus, waitid};
use nix::unistd::Pid;

use super::{BEAT_NS, ProcessError, fatal, urgency};
use crate::clock::{Clock, MILLISECOND_NS, MonotonicClock, SECOND_NS};
use crate::ev3dev::Tree;
use crate::printable::json_line;
use crate::robot::{brake_all, still};
use crate::runtime::child::spawn_process;
use crate::runtime::{
    Brick, Event, HardwareLock, Job, Lines, Lock, Refused, STOP_SIGNALS, StopBy, Watch,
    WhenAbandoned, never_wait, read_job,
};

/// How much is kept for a reader that lags, bytes: beyond, statuses are left out.
const MOST_KEPT: usize = 64 << 10;

/// How long the last words wait for a reader that lags, nanoseconds.
const PATIENCE_NS: i64 = 2 * SECOND_NS;

/// How long the starter has to answer an event, nanoseconds: it has no real-time priority, and on a
/// brick its memory and its log may have to wait for a slow card.
const HUNG_NS: i64 = 5 * SECOND_NS;

/// How long a killed process is waited for, nanoseconds: one that sits in a system call is gone
/// when that ends.
const DYING_NS: i64 = 5 * SECOND_NS;

/// How often its motors are braked meanwhile, nanoseconds.
const BRAKE_NS: i64 = 100 * MILLISECOND_NS;

/// How often a guard off a brick wakes up, to see whether this machine lets it, nanoseconds.
const LOOK_NS: i64 = 20 * MILLISECOND_NS;

/// Guards the run whose job comes over standard input, to its end.
///
/// # Errors
///
/// [`ProcessError`]. Once there is a starter to talk to, what goes wrong is an [`Event`].
pub fn guard() -> Result<(), ProcessError> {
    fatal::ends_at_once().map_err(|errno| ProcessError::Signals(errno.into()))?;
    let signals = signals().map_err(ProcessError::Signals)?;
    let mut input = BufReader::new(io::stdin());
    let job = read_job(&mut input).map_err(ProcessError::NoJob)?;
    let Brick::Local(tree) = &job.brick else { return Err(ProcessError::Simulated) };
    let mut starter = Starter::new(input).map_err(|errno| ProcessError::Starter(errno.into()))?;
    let mut lock = match HardwareLock::take(tree.root(), "a run that is being prepared") {
        Ok(lock) => lock,
        Err(error) => {
            starter.tell(&Event::of_refused(&Refused::from(error), &job.brick));
            starter.finish();
            return Ok(());
        }
    };
    let guard = lock.share().and_then(|()| Guard::start(&job, starter, signals));
    let mut guard = guard.map_err(ProcessError::Control)?;
    urgency::as_guard();
    let tree: Arc<dyn Tree> = Arc::new(tree.clone());
    let stopped = guard.follow(&tree);
    if stopped && let Err(error) = lock.nothing_turns() {
        log::warn!("cannot write into the hardware's lock: {error}");
    }
    drop(lock);
    Ok(())
}

/// Each of these signals becomes a byte that can be waited for.
fn signals() -> io::Result<UnixStream> {
    let (heard, raised) = UnixStream::pair()?;
    for signal in STOP_SIGNALS {
        signal_hook::low_level::pipe::register(signal, raised.try_clone()?)?;
    }
    heard.set_nonblocking(true)?;
    Ok(heard)
}

/// The pipes to the starter.
struct Starter {
    orders: Lines,
    /// What is still to be written.
    kept: Vec<u8>,
    /// Since when an event that it was told has no answer.
    unanswered_ns: Option<i64>,
    /// It gives no more orders, or reads no more.
    gone: bool,
    /// It reads no more.
    deaf: bool,
}

impl Starter {
    /// `input` has given the job, and may have read on into the orders.
    fn new(input: BufReader<io::Stdin>) -> nix::Result<Self> {
        let mut orders = Lines::default();
        orders.push(input.buffer());
        never_wait(io::stdout().as_fd())?;
        never_wait(io::stdin().as_fd())?;
        Ok(Self { orders, kept: Vec::new(), unanswered_ns: None, gone: false, deaf: false })
    }

    /// Passes an event on: at once, later, or, a status that is followed by others anyway, not at
    /// all.
    fn tell(&mut self, event: &Event) {
        if matches!(event, Event::Status(_)) && self.kept.len() > MOST_KEPT {
            return;
        }
        self.kept.extend(json_line(event).into_iter().flatten());
        self.unanswered_ns.get_or_insert(MonotonicClock.now_ns());
        self.write();
    }

    fn write(&mut self) {
        while !self.kept.is_empty() && !self.deaf {
            match nix::unistd::write(io::stdout().as_fd(), &self.kept) {
                Ok(written) => drop(self.kept.drain(..written)),
                Err(Errno::EINTR) => {}
                Err(Errno::EAGAIN) => return,
                Err(_) => (self.gone, self.deaf) = (true, true),
            }
        }
    }

    /// Waits until everything is written, but not for ever.
    fn finish(&mut self) {
        let deadline_ns = MonotonicClock.now_ns() + PATIENCE_NS;
        self.write();
        while !self.kept.is_empty() && !self.deaf && MonotonicClock.now_ns() < deadline_ns {
            let stdout = io::stdout();
            let mut waited = [PollFd::new(stdout.as_fd(), PollFlags::POLLOUT)];
            if poll(&mut waited, timeout(Some(deadline_ns)))
                .is_err_and(|errno| errno != Errno::EINTR)
            {
                return;
            }
            self.write();
        }
    }

    /// Reads what has come; the pipe is at its end when the starter is gone.
    fn read(&mut self) {
        self.gone |= take_in(io::stdin().as_fd(), &mut self.orders);
    }

    /// Whatever it says is an answer.
    fn next_line(&mut self) -> Option<Vec<u8>> {
        let line = self.orders.next_line()?;
        self.unanswered_ns = None;
        Some(line)
    }

    /// It is gone, or hangs.
    fn has_abandoned(&self, now_ns: i64) -> bool {
        self.gone || self.unanswered_ns.is_some_and(|since_ns| now_ns - since_ns >= HUNG_NS)
    }
}

/// The process that drives, and what is known of it.
struct Guard {
    control: Child,
    orders: ChildStdin,
    said: ChildStdout,
    lines: Lines,
    watch: Watch,
    starter: Starter,
    /// What control is still to be told should the starter go.
    abandoned: Option<StopBy>,
    signals: UnixStream,
    /// When control last heard a beat.
    beaten_ns: i64,
    /// The brick is this machine: nothing excuses a silence.
    on_brick: bool,
}

impl Guard {
    fn start(job: &Job, starter: Starter, signals: UnixStream) -> io::Result<Self> {
        let (control, mut orders, said) = spawn_process(&std::env::current_exe()?, "control")?;
        // Whatever the starter wants to become of its run, control ends it when the guard is gone.
        let own = Job { when_abandoned: WhenAbandoned::Stop, lock: Lock::Inherited, ..job.clone() };
        // One that does not take its job is gone, and is seen to be below.
        let _ = orders.write_all(&json_line(&own)?);
        never_wait(orders.as_fd())?;
        never_wait(said.as_fd())?;
        Ok(Self {
            control,
            orders,
            said,
            lines: Lines::default(),
            watch: Watch::new(job),
            starter,
            abandoned: (job.when_abandoned == WhenAbandoned::Stop).then_some(StopBy::Abandoned),
            signals,
            beaten_ns: MonotonicClock.now_ns(),
            on_brick: matches!(&job.brick, Brick::Local(tree) if tree.is_machine()),
        })
    }

    /// Follows the run to its end, and leaves no motor of it turning; true if it had to stop them
    /// itself, and did.
    fn follow(&mut self, tree: &Arc<dyn Tree>) -> bool {
        self.pass_orders_on();
        let hung = loop {
            self.wait();
            if self.hear(tree) {
                break false;
            }
            let now_ns = MonotonicClock.now_ns();
            if self.watch.deadline_ns().is_some_and(|deadline_ns| now_ns >= deadline_ns) {
                break true;
            }
        };
        let mut stopped = false;
        if !self.watch.is_over() {
            stopped = self.take_over(tree, hung);
        } else if hung {
            log::warn!("the process that drove has ended its run, but not itself");
        }
        let _ = self.control.kill();
        self.starter.finish();
        // Nothing of it may outlive us: with it the lock would. The kernel spins while it reaps a
        // process whose folder in `/proc` others are looking at; at real-time priority they might
        // never get a processor to let go of it.
        urgency::as_others();
        let _ = self.control.wait();
        stopped
    }

    /// Waits for a message from either side, or until control's time is over.
    fn wait(&mut self) {
        let deadline_ns = self.watch.deadline_ns();
        let look_ns = MonotonicClock.now_ns() + LOOK_NS;
        let wake_ns =
            if self.on_brick { deadline_ns } else { deadline_ns.map(|ns| ns.min(look_ns)) };
        self.poll(wake_ns);
        if let Some(wake_ns) = wake_ns.filter(|_| !self.on_brick) {
            let now_ns = MonotonicClock.now_ns();
            self.watch.excuse(now_ns - wake_ns, now_ns);
        }
    }

    fn poll(&self, wake_ns: Option<i64>) {
        let (stdin, stdout) = (io::stdin(), io::stdout());
        let mut waited = vec![
            PollFd::new(self.said.as_fd(), PollFlags::POLLIN),
            PollFd::new(self.signals.as_fd(), PollFlags::POLLIN),
        ];
        if !self.starter.gone {
            waited.push(PollFd::new(stdin.as_fd(), PollFlags::POLLIN));
        }
        if !self.starter.deaf && !self.starter.kept.is_empty() {
            waited.push(PollFd::new(stdout.as_fd(), PollFlags::POLLOUT));
        }
        // Interrupted or failed: then we look, and wait again.
        let _ = poll(&mut waited, timeout(wake_ns));
    }

    /// Takes in all new messages; true if control will say nothing more.
    fn hear(&mut self, tree: &Arc<dyn Tree>) -> bool {
        let silent = take_in(self.said.as_fd(), &mut self.lines);
        let now_ns = MonotonicClock.now_ns();
        while let Some(line) = self.lines.next_line() {
            if let Some(event) = self.watch.hear(&line, now_ns) {
                self.starter.tell(&event);
                if matches!(event, Event::Stopped { stopped: false, .. }) {
                    // It drives no more, so it renews nothing that is stopped here.
                    self.stop_motors(tree);
                }
            }
        }
        if self.signals.read(&mut [0; 16]).is_ok_and(|count| count > 0) {
            self.order(StopBy::Terminal);
        }
        if !self.starter.gone {
            self.starter.read();
            self.pass_orders_on();
        }
        self.starter.write();
        if self.starter.has_abandoned(now_ns)
            && let Some(by) = self.abandoned.take()
        {
            self.order(by);
        }
        if now_ns - self.beaten_ns >= BEAT_NS {
            self.beaten_ns = now_ns;
            // A pipe that is full of beats needs no other.
            let _ = self.orders.write(b"\n");
        }
        silent
    }

    fn pass_orders_on(&mut self) {
        while let Some(line) = self.starter.next_line() {
            if let Ok(by) = serde_json::from_slice(&line) {
                self.order(by);
            }
        }
    }

    fn order(&mut self, by: StopBy) {
        if let Ok(line) = json_line(&by) {
            // A process that does not empty this pipe hears no order; one that drives is then hung,
            // and is found to be.
            let _ = self.orders.write_all(&line);
        }
    }

    /// Control is gone or hung: makes sure that it is gone, stops the motors, and says so in its
    /// place; true if they are still.
    fn take_over(&mut self, tree: &Arc<dyn Tree>, hung: bool) -> bool {
        let _ = self.control.kill();
        let status = self.await_death(tree);
        let stopped = self.stop_motors(tree);
        let how = match (hung, status) {
            (false, Some(status)) => format!("ended without a word ({status})"),
            _ => "gave no sign of life, and was killed".to_owned(),
        };
        let last_word = self.watch.last_word(&how, stopped, MonotonicClock.now_ns());
        self.starter.tell(&last_word);
        stopped
    }

    /// Waits for a process that was killed, and brakes its motors meanwhile: it may take its time,
    /// until its devices are closed. How it ended; it stays to be reaped ([`Guard::follow`]).
    fn await_death(&mut self, tree: &Arc<dyn Tree>) -> Option<ExitStatus> {
        let start_ns = MonotonicClock.now_ns();
        let mut brake_ns = start_ns;
        while MonotonicClock.now_ns() < start_ns + DYING_NS {
            if let Some(status) = self.ended() {
                return Some(status);
            }
            if MonotonicClock.now_ns() >= brake_ns {
                brake_ns += BRAKE_NS;
                if let Err(error) = brake_all(tree, self.watch.motors()) {
                    log::warn!("cannot stop the motors at once: {error}");
                }
            }
            MonotonicClock.sleep_ns(MILLISECOND_NS);
        }
        None
    }

    /// How control ended, without reaping it.
    fn ended(&self) -> Option<ExitStatus> {
        // The kernel's numbers of processes fit.
        let control = Id::Pid(Pid::from_raw(i32::try_from(self.control.id()).unwrap_or(0)));
        let look = WaitPidFlag::WEXITED | WaitPidFlag::WNOHANG | WaitPidFlag::WNOWAIT;
        match waitid(control, look) {
            Ok(WaitStatus::Exited(_, code)) => Some(ExitStatus::from_raw(code << 8)),
            Ok(WaitStatus::Signaled(_, signal, _)) => Some(ExitStatus::from_raw(signal as i32)),
            _ => None,
        }
    }

    /// True if every motor of the run is still.
    fn stop_motors(&self, tree: &Arc<dyn Tree>) -> bool {
        match still(tree, self.watch.motors(), &MonotonicClock) {
            Ok(()) => true,
            Err(error) => {
                log::error!("cannot stop the motors: {error}; unplug their cables");
                false
            }
        }
    }
}

/// Reads all that is there; true if the pipe is at its end.
fn take_in(pipe: BorrowedFd<'_>, lines: &mut Lines) -> bool {
    let mut bytes = [0; 4096];
    loop {
        match nix::unistd::read(pipe, &mut bytes) {
            Ok(0) => return true,
            Ok(count) => lines.push(bytes.get(..count).unwrap_or_default()),
            Err(Errno::EINTR) => {}
            Err(Errno::EAGAIN) => return false,
            Err(_) => return true,
        }
    }
}

/// How long `poll` waits for a deadline: rounded up, so that it is over then.
fn timeout(deadline_ns: Option<i64>) -> PollTimeout {
    let Some(deadline_ns) = deadline_ns else { return PollTimeout::NONE };
    let wait_ns = (deadline_ns - MonotonicClock.now_ns()).max(0);
    let wait_ms =
        i32::try_from((wait_ns + MILLISECOND_NS - 1) / MILLISECOND_NS).unwrap_or(i32::MAX);
    PollTimeout::try_from(wait_ms).unwrap_or(PollTimeout::MAX)
}
