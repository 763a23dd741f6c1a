//! The tick: sense, estimate, map, decide, act, record, on one thread, from one monotonic time.
//!
//! A tick allocates nothing, waits for no disk, socket or lock, reads each attribute with one
//! system call and the clock once, and writes only what changed and the leases that are due.
//!
//! Deadlines are a whole number of periods after the start, so they do not drift. A tick that comes
//! late is counted; where whole periods were missed they are left out, never caught up with. One
//! that comes later than [`STALL_NS`] ends the run: a loop that was away for that long has not been
//! looking where it drives.

use std::fmt;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use arrayvec::{ArrayString, ArrayVec};
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGTSTP};

use crate::behavior::demands::SAY_BYTES;
use crate::behavior::{Demands, MAX_MACHINES, Taken};
use crate::clock::Clock;
use crate::ev3dev::{LightColour, StopAction};
use crate::mapping::{Estimate, Pose};
use crate::robot::Robot;
use crate::senses::{Channel, Senses};

use super::battery::Charge;
use super::environment::SeeTruth;
use super::pilot::{ChangedVariables, Pilot, PilotState, Step};
use super::{Heartbeat, Job, Lock, Pulse, StopBy, StopReason, WhenAbandoned};
use crate::recording::{Level, MAX_LOG_BYTES, STALL_NS, TickSide};

/// How often the pilot's state goes into the recording, nanoseconds.
const CHECKPOINT_NS: i64 = 1_000_000_000;

/// Signals that stop a run at whichever of its processes they come to. A terminal sends Ctrl-C,
/// Ctrl-\ and Ctrl-Z to all of them: one that was suspended could not stop the motors.
pub const STOP_SIGNALS: [i32; 5] = [SIGINT, SIGQUIT, SIGTSTP, SIGTERM, SIGHUP];

/// What asks a run to stop from outside the tick.
#[derive(Debug, Clone, Default)]
pub struct StopFlags {
    /// One of [`STOP_SIGNALS`] came.
    pub signal: Arc<AtomicBool>,
    /// The starter is gone.
    pub abandoned: Arc<AtomicBool>,
    /// A client on the network asked.
    pub remote: Arc<AtomicBool>,
    /// A stop was asked for on the brick.
    pub here: Arc<AtomicBool>,
    /// A stop was asked for on the run's page.
    pub page: Arc<AtomicBool>,
    /// The menu is gone.
    pub menu_closed: Arc<AtomicBool>,
    /// The guard is gone.
    pub unguarded: Arc<AtomicBool>,
    /// A thread of this process has panicked.
    pub panicked: Arc<AtomicBool>,
    /// The guard's heartbeats, counted.
    pub guard_beats: Arc<AtomicU32>,
    /// The simulated robot has fallen over the edge of the floor.
    pub fallen: Arc<AtomicBool>,
}

impl StopFlags {
    /// Flags that signals raise from now on: [`STOP_SIGNALS`], and those with which a service stops
    /// a run that it has found, and to which it has no pipe ([`StopBy::signal`]).
    ///
    /// # Errors
    ///
    /// The kernel does not take the handlers.
    pub fn on_signals() -> io::Result<Self> {
        let flags = Self::default();
        for signal in STOP_SIGNALS {
            signal_hook::flag::register(signal, Arc::clone(&flags.signal))?;
        }
        for by in [StopBy::Remote, StopBy::Here, StopBy::MenuClosed] {
            signal_hook::flag::register(by.signal() as i32, Arc::clone(flags.flag(by)))?;
        }
        Ok(flags)
    }

    /// From now on a panic in any thread of this process stops the run: a process that has lost a
    /// thread, for example the one that hears orders or looks for plugs, would otherwise continue
    /// unnoticed.
    pub fn on_panic(&self) {
        let panicked = Arc::clone(&self.panicked);
        std::panic::set_hook(Box::new(move |panic| {
            // Before anything is said, which may have to wait. A backtrace is not made: that takes
            // longer than motors may go on.
            panicked.store(true, Ordering::Relaxed);
            let thread = std::thread::current();
            log::error!("the thread {} {panic}", thread.name().unwrap_or("without a name"));
        }));
    }

    /// What is raised when the pipe of orders closes: it is the guard's, or the starter's, whose
    /// end may be none of the run's.
    #[must_use]
    pub fn when_pipe_closes(&self, job: &Job) -> Arc<AtomicBool> {
        match (job.lock, job.when_abandoned) {
            (Lock::Inherited, _) => Arc::clone(&self.unguarded),
            (Lock::Take, WhenAbandoned::Stop) => Arc::clone(&self.abandoned),
            (Lock::Take, WhenAbandoned::GoOn) => Arc::default(),
        }
    }

    /// Asks to stop on behalf of a requester.
    pub fn raise(&self, by: StopBy) {
        self.flag(by).store(true, Ordering::Relaxed);
    }

    fn flag(&self, by: StopBy) -> &Arc<AtomicBool> {
        match by {
            StopBy::Remote => &self.remote,
            StopBy::Here => &self.here,
            StopBy::Page => &self.page,
            StopBy::MenuClosed => &self.menu_closed,
            StopBy::Terminal => &self.signal,
            StopBy::Abandoned => &self.abandoned,
        }
    }

    /// True where anything asks to stop.
    #[must_use]
    pub fn is_raised(&self) -> bool {
        self.reason().is_some()
    }

    pub(super) fn reason(&self) -> Option<StopReason> {
        let raised = [
            (&self.panicked, StopReason::Panicked),
            (&self.fallen, StopReason::Fallen),
            (&self.signal, StopReason::Signal),
            (&self.remote, StopReason::Remote),
            (&self.here, StopReason::Here),
            (&self.page, StopReason::Page),
            (&self.menu_closed, StopReason::MenuClosed),
            (&self.abandoned, StopReason::Abandoned),
            (&self.unguarded, StopReason::Unguarded),
        ];
        raised.into_iter().find(|(flag, _)| flag.load(Ordering::Relaxed)).map(|(_, reason)| reason)
    }
}

/// What the loop counted.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tally {
    /// Ticks.
    pub ticks: u64,
    /// Ticks that came a whole period late or later.
    pub overruns: u64,
    /// The latest tick, nanoseconds after its deadline.
    pub latest_ns: i64,
    /// The last tick's time, nanoseconds of the run's clock.
    pub time_ns: i64,
    /// Points that the map gained.
    pub points: u64,
    /// Metres driven.
    pub travelled_m: f64,
    /// Where the robot believes that it is.
    pub pose: Pose,
}

/// A run in motion.
pub struct Control<'r> {
    /// What senses and acts.
    pub robot: &'r mut Robot,
    /// What decides.
    pub pilot: &'r mut Pilot,
    /// Where it is recorded.
    pub recorder: &'r mut TickSide<PilotState>,
    /// What time it is.
    pub clock: &'r dyn Clock,
    /// Who asks to stop.
    pub flags: &'r StopFlags,
    /// Who is told that the loop is alive.
    pub heartbeat: &'r mut dyn Heartbeat,
    /// The guard, where there is one.
    pub guard: Option<Pulse>,
    /// The tick's period, nanoseconds.
    pub period_ns: i64,
    /// How things truly are, in a simulation.
    pub truth: Option<&'r SeeTruth>,
    /// What was counted so far.
    pub tally: Tally,
}

crate::printable::debug_by!(Control<'_>, tally);

/// How often a mission tells by one means at most, nanoseconds: people need no more.
const TOLD_NS: i64 = 200_000_000;

/// How often it is recorded where a simulated robot truly is, nanoseconds.
const TRUTH_NS: i64 = 100_000_000;

/// What a mission tells people by one means, so that each is told once.
#[derive(Debug)]
struct Told<T> {
    value: Option<T>,
    is_told: bool,
    told_ns: Option<i64>,
}

// Not derived, which would ask for a `Default` of what is told.
impl<T> Default for Told<T> {
    fn default() -> Self {
        Self { value: None, is_told: false, told_ns: None }
    }
}

impl<T: Copy + PartialEq> Told<T> {
    /// What is to be told now; the last is told in any case.
    fn next(&mut self, value: Option<T>, now_ns: i64, is_last: bool) -> Option<T> {
        if value.is_some() && value != self.value {
            self.value = value;
            self.is_told = false;
        }
        let is_due = self.told_ns.is_none_or(|told_ns| now_ns - told_ns >= TOLD_NS);
        if self.is_told || !(is_due || is_last) {
            return None;
        }
        let value = self.value?;
        (self.is_told, self.told_ns) = (true, Some(now_ns));
        Some(value)
    }
}

/// What a mission says, shows and sounds.
#[derive(Debug, Default)]
struct Telling {
    say: Told<ArrayString<SAY_BYTES>>,
    led: Told<LightColour>,
    /// Hertz; silence is none.
    tone: Told<Option<u32>>,
}

/// Said where nothing moves although something is asked for.
const LACKS_NUMBER: &str = "a motion waits: a number of it is not known yet, or infinite, as \
                            `range_m` is without an echo";

/// Transitions of one tick: one a machine, and one more where the runtime moved it.
type TakenInTick = ArrayVec<Taken, { 2 * MAX_MACHINES }>;

impl Control<'_> {
    /// Ticks until there is a reason to stop, then stops every motor. The run's clock starts at 0
    /// with the first tick.
    pub fn drive(&mut self) -> StopReason {
        let reason = self.ticks();
        self.robot.stop(StopAction::Brake);
        reason
    }

    /// Notes in the recording why the run ended.
    pub(super) fn note(&mut self, reason: StopReason) {
        let level = if reason.is_wanted() { Level::Info } else { Level::Error };
        self.log(level, format_args!("{reason}"));
    }

    fn ticks(&mut self) -> StopReason {
        let start_ns = self.clock.now_ns();
        let mut deadline_ns = start_ns;
        let mut senses = Senses::default();
        let mut demands = Demands::default();
        let mut checkpoint_ns = 0;
        let mut paused = None;
        let mut lacks_number = false;
        let mut charge = Charge::Good;
        let mut variables = ChangedVariables::default();
        let mut telling = Telling::default();
        let mut truth_ns = 0;
        loop {
            let now_ns = self.wait(deadline_ns);
            let late_ns = now_ns - deadline_ns;
            if let Some(reason) = self.flags.reason() {
                return reason;
            }
            self.tally.latest_ns = self.tally.latest_ns.max(late_ns);
            if late_ns > STALL_NS {
                return StopReason::Late;
            }
            let period_ns = self.period_ns;
            if self.guard.as_mut().is_some_and(|guard| guard.is_silent(now_ns, period_ns)) {
                return StopReason::Unguarded;
            }
            senses.time_ns = now_ns - start_ns;
            let step = self.tick(&mut senses, &mut demands, late_ns);
            if let Some(values) = variables.next(self.pilot.program().variables()) {
                self.recorder.variables(senses.tick, senses.time_ns, values);
            }
            if senses.time_ns >= checkpoint_ns {
                checkpoint_ns = senses.time_ns + CHECKPOINT_NS;
                self.recorder.checkpoint(senses.tick, senses.time_ns, self.pilot.state());
                self.recorder.keyframes(senses.time_ns, self.pilot.keyframes());
            }
            if step.paused != paused {
                paused = step.paused;
                self.log_pause(paused);
            }
            if self.pilot.program().lacks_number() != lacks_number {
                lacks_number = !lacks_number;
                if lacks_number {
                    self.log(Level::Warn, format_args!("{LACKS_NUMBER}"));
                }
            }
            self.tell(&mut telling, &demands, senses.time_ns, step.end.is_some());
            if let Some(truth) = self.truth
                && senses.time_ns >= truth_ns
                && let Some(truth) = truth()
            {
                truth_ns = senses.time_ns + TRUTH_NS;
                self.recorder.truth(senses.time_ns, truth.pose);
            }
            if let Some(reason) = step.end {
                return reason;
            }
            if step.charge != charge {
                charge = step.charge;
                self.log(Level::Warn, format_args!("{charge}"));
            }
            let missed = late_ns / self.period_ns;
            self.tally.overruns += u64::from(missed > 0);
            senses.tick += 1;
            deadline_ns += self.period_ns * (1 + missed);
        }
    }

    /// Sleeps until the deadline or a request to stop; returns the time it is then.
    fn wait(&mut self, deadline_ns: i64) -> i64 {
        loop {
            self.clock.sleep_until_ns(deadline_ns);
            let now_ns = self.clock.now_ns();
            if now_ns >= deadline_ns || self.flags.is_raised() {
                return now_ns;
            }
        }
    }

    fn tick(&mut self, senses: &mut Senses, demands: &mut Demands, lateness_ns: i64) -> Step {
        let time_ns = senses.time_ns;
        let pressed = self.robot.sense(senses);
        let mut taken = TakenInTick::new();
        let mut step = self.pilot.step(senses, demands, |transition| {
            // There is room for all that can be in one tick.
            let _ = taken.try_push(transition);
        });
        let outside = match step.end {
            // A motor that another program resets or stops looks like a blocked one at first.
            Some(StopReason::Stalled) => self.robot.look_closely(time_ns),
            _ => self.robot.outside(),
        };
        if pressed {
            step.end = Some(StopReason::Button);
        } else if let Some(channel) = outside {
            step.end = Some(StopReason::Outside(channel));
        } else if self.recorder.failed() {
            step.end = Some(StopReason::Recording);
        }
        if step.end.is_none() && senses.tick == 0 && self.guard.is_some() {
            // From here on motors may turn: the guard waits for the first beat longer than for all
            // others.
            self.heartbeat.beat(time_ns);
        }
        match step.end {
            None => self.robot.act(demands, time_ns),
            Some(_) => self.robot.show(demands),
        }
        self.heartbeat.beat(time_ns);
        self.recorder.tick(&step.record(senses, lateness_ns));
        for transition in taken {
            self.recorder.transition(senses.tick, time_ns, transition);
        }
        let points = self.tally.points + step.placed.len() as u64;
        let Estimate { travelled_m, pose, .. } = step.estimate;
        let ticks = senses.tick + 1;
        self.tally = Tally { ticks, time_ns, points, travelled_m, pose, ..self.tally };
        step
    }

    fn tell(&mut self, telling: &mut Telling, demands: &Demands, now_ns: i64, is_last: bool) {
        if let Some(text) = telling.say.next(demands.say, now_ns, is_last) {
            self.recorder.said(now_ns, &text);
        }
        if let Some(led) = telling.led.next(demands.led, now_ns, is_last) {
            self.log(Level::Info, format_args!("lights: {led}"));
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a cast from float saturates"
        )]
        let tone_hz = demands.tone_hz.map(|hz| libm::round(hz) as u32);
        if let Some(Some(hz)) = telling.tone.next(Some(tone_hz), now_ns, is_last) {
            self.log(Level::Info, format_args!("tone: {hz} Hz"));
        }
    }

    fn log_pause(&mut self, paused: Option<Channel>) {
        match paused {
            Some(channel) => {
                self.log(Level::Warn, format_args!("lost: {channel}; waiting until it is back"))
            }
            None => self.log(Level::Info, format_args!("everything is back; going on")),
        }
    }

    /// Into the recording, without allocating; what is too long is cut.
    fn log(&mut self, level: Level, text: fmt::Arguments<'_>) {
        let mut line = ArrayString::<MAX_LOG_BYTES>::new();
        let _ = fmt::write(&mut line, text);
        self.recorder.log(self.tally.time_ns, level, &line);
    }
}
