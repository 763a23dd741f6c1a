//! Starting a run and stopping it.

use std::io;
use std::path::PathBuf;
use std::time::Duration;

use nix::sys::signal::kill;
use nix::unistd::Pid;

use super::core::{Service, named};
use super::hardware::taken;
use super::machine::Happening;
use super::store::{Record, StoreError};
use super::{missions, signs};
use crate::behavior::Mission;
use crate::clock::{Clock, MILLISECOND_NS, MonotonicClock, SECOND_NS};
use crate::ev3dev::Tree as _;
use crate::mapping::Pose;
use crate::printable::{line, with_causes};
use crate::protocol::{
    Caller, Done, Kind, LastStop, Refusal, RunId, RunStatus, Start, Started, Stopped, whose,
};
use crate::recording;
use crate::runtime::{
    HardwareLock, Job, LockError, PATIENCE_NS, RunProcess, StopBy, StopReason, StopRequest,
    Stopper, end_by_force, halt_command,
};
use crate::threads::{lock, spawn};
use crate::units::radians;

/// How long a stop waits for the motors to be told, nanoseconds. A run that drives tells them
/// within a tick.
const STOP_PATIENCE_NS: i64 = 2 * SECOND_NS;

/// Poses farther away than this are slips of the pen, metres and degrees.
const FARTHEST: f64 = 1e6;

/// What stops a run.
#[derive(Debug)]
pub(super) enum Stop {
    /// We started it.
    Ours(Stopper),
    /// An earlier service did; this is the process that drives.
    Found {
        /// The recording, which tells whether it is still that process.
        file: PathBuf,
        /// The brick that it drives, where that is not a simulated one inside the process.
        root: Option<PathBuf>,
    },
}

impl Stop {
    fn ask(&self, by: StopBy) {
        let asked = match self {
            Self::Ours(stopper) => stopper.stop(by),
            Self::Found { file, root } => match recording::writer(file) {
                Ok(Some(pid)) => root
                    .clone()
                    .map_or(Ok(()), |root| force_later(root, pid))
                    .and_then(|()| kill(Pid::from_raw(pid), by.signal()).map_err(Into::into)),
                // Over already.
                Ok(None) => Ok(()),
                Err(error) => Err(error),
            },
        };
        if let Err(error) = asked {
            log::warn!("the run could not be asked to stop, so it is about to be gone: {error}");
        }
    }
}

/// Ends the run that this process drives by force, should it not stop when it is asked to.
fn force_later(root: PathBuf, control: i32) -> io::Result<()> {
    spawn("patience", move || {
        if let Err(error) = end_by_force(&root, PATIENCE_NS, |owner| owner.pid == control) {
            log::error!("the run did not stop when it was asked to: {}", with_causes(&error));
        }
    })?;
    Ok(())
}

impl Service {
    /// Starts a run; a repeat does nothing.
    pub(super) fn start(
        &self,
        start: &Start,
        caller: &Caller,
        needs_token: bool,
    ) -> Result<Started, Refusal> {
        let inner = &self.inner;
        let mut asked_ns = MonotonicClock.now_ns();
        let _one_at_a_time = lock(&inner.starting);
        if inner.store.knows(&start.run) {
            return Ok(Started { run: start.run.clone(), repeated: true, limited_s: None });
        }
        if needs_token || start.token.is_some() {
            let token = start.token.as_deref().unwrap_or_default();
            asked_ns = inner.tokens.check(token, MonotonicClock.now_ns()).map_err(|error| {
                Refusal::new(Kind::StaleToken, error.to_string())
                    .hint("ask for the status again: it brings a new one")
            })?;
        }
        self.may_start()?;
        let (mission, mut job, limited_s) = self.prepared(start)?;
        inner.hardware.let_go();
        self.is_free()?;
        let by = named(caller);
        let run = RunStatus::new(start.run.clone(), mission.name(), mission.time_limit_s(), &by);
        let record = Record::new(start.run.clone(), &run.mission, run.time_limit_s, &by);
        job.file = inner.store.begin(record)?;
        log::info!("run {}: mission {}, started {}", run.run, run.mission, whose(&by));
        self.enter(&run, &mission, asked_ns).inspect_err(|_| inner.store.take_back(&start.run))?;
        inner.changed.notify_all();
        if let Err(why) = self.launch(&job, &run) {
            let refused = StopReason::Refused.with(why.clone());
            let last = LastStop::new(Some(start.run.clone()), &run.mission, refused);
            lock(&inner.now).stop = None;
            inner.happen(Happening::Ended(last));
            inner.store.take_back(&start.run);
            return Err(Refusal::failed(why));
        }
        Ok(Started { run: start.run.clone(), repeated: false, limited_s })
    }

    /// The state takes the run, unless a stop has come since it was asked for.
    fn enter(&self, run: &RunStatus, mission: &Mission, asked_ns: i64) -> Result<(), Refusal> {
        let mut now = lock(&self.inner.now);
        if now.stop_ns.is_some_and(|stop_ns| stop_ns >= asked_ns) {
            let message = "a stop has come since the start was asked for";
            return Err(Refusal::new(Kind::Stopped, message)
                .hint("start it again, if it is still to drive"));
        }
        let begun = now.machine.start(MonotonicClock.now_ns(), run.clone());
        begun.map_err(|other| busy(&other))?;
        now.stopped_by = None;
        now.missions_lights = mission.switches_lights();
        Ok(())
    }

    /// Starts the run's processes; why that was not to be done.
    fn launch(&self, job: &Job, run: &RunStatus) -> Result<(), String> {
        let process =
            RunProcess::start(&self.inner.program, job).map_err(|error| with_causes(&error))?;
        let mut now = lock(&self.inner.now);
        let stop = Stop::Ours(process.stopper());
        if let Some((by, _)) = now.stopped_by {
            // A stop came before the process was there.
            stop.ask(by);
        }
        now.stop = Some(stop);
        drop(now);
        self.follow(process, run).map_err(|error| with_causes(&error))
    }

    /// Stops a run, and waits until the motors have been told. One that stops whatever runs is also
    /// for a start that is under way, and for those that wait behind it.
    pub(super) fn stop(
        &self,
        run: Option<&RunId>,
        by: StopBy,
        asker: &str,
    ) -> Result<Stopped, Refusal> {
        let inner = &self.inner;
        let mut now = lock(&inner.now);
        if run.is_none() {
            now.stop_ns = Some(MonotonicClock.now_ns());
        }
        let running = now.machine.run().map(|running| running.run.clone());
        let Some(running) = running.filter(|running| run.is_none_or(|run| run == running)) else {
            drop(now);
            return match run {
                Some(run) if !inner.store.knows(run) => {
                    Err(StoreError::Unknown(run.clone()).into())
                }
                Some(run) => Ok(Stopped { run: Some(run.clone()), stopped: true, other: None }),
                None => self.stop_other(by),
            };
        };
        if now.stopped_by.is_none() {
            log::info!("run {running}: asked to stop {}", whose(asker));
            now.stopped_by = Some((by, asker.to_owned()));
        }
        now.machine.happen(MonotonicClock.now_ns(), Happening::StopAsked);
        if let Some(stop) = &now.stop {
            stop.ask(by);
        }
        let deadline_ns = MonotonicClock.now_ns() + STOP_PATIENCE_NS;
        loop {
            let is_over = now.machine.run().is_none_or(|now| now.run != running);
            // One that ended before it drove never told a motor to turn.
            if let Some(stopped) = now.machine.motors_told().or(is_over.then_some(true)) {
                return Ok(Stopped { run: Some(running), stopped, other: None });
            }
            let left_ns = deadline_ns.saturating_sub(MonotonicClock.now_ns());
            let Ok(left_ns @ 1..) = u64::try_from(left_ns) else {
                let message =
                    "the run was asked to stop and has not said that the motors were told";
                return Err(
                    Refusal::failed(message).hint("onbrick halt, to be sure that they are still")
                );
            };
            // It may begin to drive only now and not have had the order when it was asked.
            now = match inner.changed.wait_timeout(now, Duration::from_nanos(left_ns)) {
                Ok((now, _)) => now,
                Err(poisoned) => poisoned.into_inner().0,
            };
        }
    }

    /// Ends what else drives where a PC asks for it: a calibration, or a run of a shell's. Who asks
    /// on the brick has its buttons at hand.
    fn stop_other(&self, by: StopBy) -> Result<Stopped, Refusal> {
        let hardware = &self.inner.hardware;
        hardware.let_go();
        let none = Stopped { run: None, stopped: true, other: None };
        let (Some(tree), StopBy::Remote) = (hardware.machine(), by) else { return Ok(none) };
        let Some(owner) = hardware.other_owner() else { return Ok(none) };
        let other = format!("{} (process {})", owner.doing, owner.pid);
        log::info!("asked to stop {other}");
        let failed = |why: String| {
            Refusal::failed(format!("{other} cannot be stopped{why}"))
                .hint(format!("{} on the brick, as root", halt_command(tree.root())))
        };
        let _request = StopRequest::make(tree.root(), by);
        match end_by_force(tree.root(), STOP_PATIENCE_NS, |found| found.pid == owner.pid) {
            Ok(true) => Ok(Stopped { other: Some(other), ..none }),
            Ok(false) => Err(failed(String::new())),
            Err(error) => Err(failed(format!(": {}", with_causes(&error)))),
        }
    }

    /// Ends the service: nothing starts any more, and a run that is going on is stopped and waited
    /// for, as long as its recording takes.
    pub fn close(&self) {
        let inner = &self.inner;
        lock(&inner.now).closing = true;
        inner.hardware.let_go();
        if let Err(error) = self.stop(None, StopBy::Terminal, "the service's own end") {
            log::warn!("{error}");
        }
        let is_idle = || lock(&inner.now).machine.run().is_none();
        MonotonicClock.wait_for(20 * SECOND_NS, 20 * MILLISECOND_NS, &is_idle);
        inner.store.save();
    }

    /// Beeps and blinks, in a thread of its own.
    pub(super) fn identify(&self) -> Done {
        let inner = &self.inner;
        log::info!("asked which brick this is: {}", inner.name);
        let idle = lock(&inner.now).machine.run().is_none();
        if inner.hardware.machine().is_some()
            && let Some(tree) = inner.hardware.tree(MonotonicClock.now_ns())
        {
            let started = spawn("identify", move || signs::identify(&tree, idle));
            if let Err(error) = started {
                log::warn!("no thread to beep: {error}");
            }
        }
        Done {}
    }

    fn may_start(&self) -> Result<(), Refusal> {
        if lock(&self.inner.now).closing {
            return Err(Refusal::new(Kind::NotReady, "the service is about to end"));
        }
        self.between_runs()
    }

    /// Whether another program has the hardware. The run itself takes it; asking first makes a
    /// better answer.
    fn is_free(&self) -> Result<(), Refusal> {
        let Some(tree) = self.inner.hardware.machine() else { return Ok(()) };
        match HardwareLock::owner(tree.root()) {
            Ok(Some(owner)) => Err(taken(LockError::Taken(owner), tree.root())),
            Ok(None) => Ok(()),
            Err(error) => Err(taken(error, tree.root())),
        }
    }

    /// The mission of a start that is in order, what its run is to do, and the time limit of the
    /// brick's settings where that is the shorter one.
    fn prepared(&self, start: &Start) -> Result<(Mission, Job, Option<f64>), Refusal> {
        let inner = &self.inner;
        let (robot_source, robot) = missions::robot(&inner.config.robot)
            .map_err(|why| Refusal::new(Kind::NotReady, why))?;
        let source = missions::choose(&inner.config.missions, &start.mission)?;
        let mut mission = missions::load(&source, &robot.capabilities())?;
        let mut set = start.set.clone();
        for (name, value) in &set {
            mission.set(name, *value).map_err(|error| {
                Refusal::bad_request(format!("--set {}={value}: {error}", line(name)))
            })?;
        }
        mission
            .within_limits()
            .map_err(|error| Refusal::new(Kind::BadRequest, format!("--set: {error}")))?;
        let kept_s = lock(&inner.now).kept.time_limit_s;
        let limited_s = kept_s.filter(|limit_s| *limit_s < mission.time_limit_s());
        if let Some(limit_s) = limited_s {
            set.push((Mission::TIME_LIMIT.to_owned(), limit_s));
            mission
                .set(Mission::TIME_LIMIT, limit_s)
                .map_err(|error| Refusal::failed(error.to_string()))?;
        }
        let pose = match start.pose {
            Some(pose) if !pose.iter().all(|number| number.abs() <= FARTHEST) => {
                return Err(Refusal::bad_request("a pose's numbers are small and finite"));
            }
            Some([x_m, y_m, deg]) => Pose { x_m, y_m, heading_rad: radians(deg) },
            None => inner.place.start,
        };
        // The store makes the file's place when the run begins.
        let (brick, file) = (inner.place.brick.clone(), PathBuf::new());
        let job = Job {
            start: pose,
            set,
            sync_ns: inner.config.sync_ns,
            run: Some(start.run.to_string()),
            name: Some(inner.name.to_string()),
            no_button: start.no_button,
            when_abandoned: inner.config.when_service_dies,
            ..Job::new(source, robot_source, brick, file)
        };
        Ok((mission, job, limited_s))
    }
}

pub(super) fn busy(run: &RunId) -> Refusal {
    Refusal::new(Kind::Busy, format!("the run `{run}` is going on"))
        .hint("stop it first, or wait until it is over")
}
