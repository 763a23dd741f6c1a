//! One job from its checks to its recording.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;

use crate::behavior::{Mission, SetError};
use crate::clock::{Clock, MonotonicClock, SECOND_NS, seconds, wall_ns};
use crate::document::Findings;
use crate::ev3dev::{DeviceError, StopAction, Tree};
use crate::mapping::{Method, Pose};
use crate::robot::{Aspect, BindError, LeasedMotor, Robot, RobotConfig};

use super::control::{Control, Tally};
use super::pilot::PilotError;
use super::recording::{self, End, Options, Pace, RecordError, Recorder, Start};
use super::{
    Brick, Ended, Event, HardwareLock, Heartbeat, Job, Lock, LockError, NotReady, Owner, Pilot, Pulse,
    StopFlags, StopReason, names, open_files, prepare,
};

/// What a loop that is late means where no real device can hold it up.
const TOO_BUSY: &str =
    "this machine was too busy; close other programs, or simulate without the clock on the wall";

/// Why a run did not start. Nothing has moved.
#[derive(Debug, thiserror::Error)]
pub enum Refused {
    /// A file is not in order.
    #[error("{0}")]
    Findings(Findings),
    /// A number that the mission does not have, or not so.
    #[error("--set")]
    Setting(#[from] SetError),
    /// Somebody else drives.
    #[error("the robot is taken")]
    Lock(#[from] LockError),
    /// A role has no device.
    #[error("the robot is not as its file says")]
    Bind(#[from] BindError),
    /// Nobody beside the robot could stop it.
    #[error("the brick's buttons cannot be read, so nobody beside the robot could stop it")]
    Buttons(#[source] DeviceError),
    /// There is no room for the thread that looks for devices that were unplugged.
    #[error("cannot start a thread")]
    Helper(#[source] std::io::Error),
    /// The robot is not ready.
    #[error("not ready")]
    NotReady(#[from] NotReady),
    /// Files that each make sense do not together.
    #[error("robot and mission")]
    Pilot(#[from] PilotError),
    /// The recording cannot be begun.
    #[error("cannot record to {}", file.display())]
    Record {
        /// The recording.
        file: PathBuf,
        /// What went wrong.
        source: RecordError,
    },
    /// The world has no place for a robot.
    #[cfg(feature = "sim")]
    #[error("the world")]
    World(#[from] crate::sim::NoStartPose),
    /// This program was built without the simulated brick.
    #[error("this onbrick was built without the simulated brick")]
    NoSimulation,
}

impl From<Findings> for Refused {
    fn from(findings: Findings) -> Self {
        Self::Findings(findings)
    }
}

impl Refused {
    /// The error and all its causes, as a person reads it.
    #[must_use]
    pub fn to_text(&self) -> String {
        with_causes(self)
    }

    /// What to do, where the message does not say it.
    #[must_use]
    pub fn way_out(&self) -> Option<&'static str> {
        match self {
            Self::Lock(LockError::Taken(_)) => Some("wait until it is over, or onbrick halt"),
            Self::Lock(LockError::Io { .. }) => Some(
                "look at the permissions of the lock file and its folder; nobody else needs the file, so it can be deleted",
            ),
            Self::Bind(_) => {
                Some("onbrick devices shows what is plugged in; plug it in there, or change the robot's file")
            }
            Self::Buttons(_) => Some("a user of the group input, or root"),
            Self::Record { .. } => Some("--out with a folder that can be written to, on a disk with room"),
            Self::NoSimulation => Some("a program that was built with the feature `sim`"),
            _ => None,
        }
    }
}

/// Does a job. `report` hears how it is going, at most five times a second, from more than one thread.
///
/// # Errors
///
/// [`Refused`], before anything has moved. What happens afterwards is in [`Ended`].
pub fn execute(
    job: &Job,
    flags: &StopFlags,
    heartbeat: &mut dyn Heartbeat,
    report: impl Fn(&Event) + Send + Sync + 'static,
) -> Result<Ended, Refused> {
    Stage::set(job)?.play(job, flags, heartbeat, Arc::new(report))
}

/// Does a job on a simulated brick, and shows how things truly are after each tick: for tests and for judging missions.
///
/// `see` gets nothing where the job's brick is not a simulated one.
///
/// # Errors
///
/// As [`execute`].
#[cfg(feature = "sim")]
pub fn execute_observed(
    job: &Job,
    flags: &StopFlags,
    see: impl FnMut(&crate::sim::Truth) + Send,
) -> Result<Ended, Refused> {
    let stage = Stage::set(job)?;
    let mut witness = Witness { observer: stage.place.observer.clone(), see };
    stage.play(job, flags, &mut witness, Arc::new(|_: &Event| {}))
}

/// Looks at the truth with each beat.
#[cfg(feature = "sim")]
struct Witness<F> {
    observer: Option<crate::sim::Observer>,
    see: F,
}

#[cfg(feature = "sim")]
impl<F> std::fmt::Debug for Witness<F> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Witness").field("observer", &self.observer).finish_non_exhaustive()
    }
}

#[cfg(feature = "sim")]
impl<F: FnMut(&crate::sim::Truth) + Send> Heartbeat for Witness<F> {
    fn beat(&mut self) {
        if let Some(truth) = self.observer.as_ref().and_then(|observer| observer.truth(0)) {
            (self.see)(&truth);
        }
    }
}

/// Looks with each beat whether a simulated robot is still on the floor. A real one that falls has
/// ended its run.
#[cfg(feature = "sim")]
#[derive(Debug)]
struct Floor<'h> {
    observer: Option<crate::sim::Observer>,
    fallen: Arc<std::sync::atomic::AtomicBool>,
    next: &'h mut dyn Heartbeat,
}

#[cfg(feature = "sim")]
impl Heartbeat for Floor<'_> {
    fn beat(&mut self) {
        if self.observer.as_ref().and_then(|observer| observer.truth(0)).is_some_and(|truth| truth.fallen) {
            self.fallen.store(true, std::sync::atomic::Ordering::Relaxed);
        }
        self.next.beat();
    }
}

/// What a job is done with: its files, read and found in order, and the place it is done in.
struct Stage {
    config: RobotConfig,
    mission: Mission,
    place: Place,
}

impl Stage {
    fn set(job: &Job) -> Result<Self, Refused> {
        let (config, _) = RobotConfig::load(&job.robot.name, job.robot.text.as_bytes())?;
        let (mut mission, _) =
            Mission::parse(&job.mission.name, job.mission.text.as_bytes(), &config.capabilities())?;
        for (name, value) in &job.set {
            mission.set(name, *value)?;
        }
        let place = Place::open(job, mission.name())?;
        Ok(Self { config, mission, place })
    }

    fn play(
        self,
        job: &Job,
        flags: &StopFlags,
        heartbeat: &mut dyn Heartbeat,
        report: Arc<Report>,
    ) -> Result<Ended, Refused> {
        let Self { config, mission, place } = self;
        // Of this run alone; the other flags are shared.
        let flags = &StopFlags { fallen: Arc::default(), ..flags.clone() };
        #[cfg(feature = "sim")]
        let heartbeat: &mut dyn Heartbeat = &mut Floor {
            observer: place.observer.clone(),
            fallen: Arc::clone(&flags.fallen),
            next: heartbeat,
        };
        let mut robot = Robot::bind(&place.tree, &config, mission.roles())?;
        // As it was bound: with the cells that the brick runs on.
        let config = robot.config().clone();
        stoppable(job, &robot)?;
        if place.pace == Pace::Real {
            robot.mend_in_background().map_err(Refused::Helper)?;
        }
        log::debug!("the robot is bound");
        prepare(&mut robot, &*place.clock, flags, place.announce, |why| {
            report(&Event::Preparing { what: why.to_owned() });
        })?;
        log::debug!("the robot stands still, and has announced itself");
        let mut pilot = Pilot::new(&config, &mission, Method::Default, job.start)?;
        let (recorder, mut tick_side) = record(job, &config, &mission, &place, Arc::clone(&report))?;
        let motors = robot.motor_ports();
        write_owner(job, &Owner { motors: motors.clone(), ..owner(job, mission.name()) });
        report(&Event::Driving { file: job.file.clone(), motors });

        let mut control = Control {
            robot: &mut robot,
            pilot: &mut pilot,
            recorder: &mut tick_side,
            clock: &*place.clock,
            flags,
            heartbeat,
            guard: (job.lock == Lock::Inherited).then(|| Pulse::new(Arc::clone(&flags.guard_beats))),
            period_ns: period_ns(&mission),
            tally: Tally::default(),
        };
        // Whatever goes wrong inside a tick, the motors are stopped here and the recording is finished.
        let driven = catch_unwind(AssertUnwindSafe(|| control.drive()));
        let tally = control.tally;
        let stopped = robot.stop(StopAction::Brake);
        let word = driven.unwrap_or(StopReason::Panicked);
        let details = match word {
            StopReason::Lost(_) => robot.trouble().map(|trouble| trouble.to_string()),
            StopReason::Outside(channel) => robot.motor(channel).map(|motor| hand_on(motor, &place.tree)),
            StopReason::Late if matches!(job.brick, Brick::Simulated { .. }) => Some(TOO_BUSY.to_owned()),
            _ => None,
        };
        let reason = details.map_or_else(|| word.to_string(), |details| format!("{word}: {details}"));
        if stopped {
            write_owner(job, &Owner { stopped: true, ..owner(job, mission.name()) });
        }
        report(&Event::Stopped { word: word.word().to_owned(), reason: reason.clone(), stopped });
        let end = End {
            reason: reason.clone(),
            time_ns: tally.time_ns,
            truth: place.truth(),
            map: Some(recording::Grid::from(pilot.map().grid())),
        };
        let recording = recorder.finish(tick_side, end).err().map(|error| with_causes(&error));
        Ok(Ended {
            word: word.word().to_owned(),
            reason,
            wanted: word.is_wanted(),
            stopped,
            ticks: tally.ticks,
            time_s: seconds(tally.time_ns),
            travelled_m: tally.travelled_m,
            points: tally.points,
            overruns: tally.overruns,
            latest_s: seconds(tally.latest_ns),
            file: job.file.clone(),
            recording,
        })
    }
}

fn period_ns(mission: &Mission) -> i64 {
    SECOND_NS / i64::from(mission.rate_hz().max(1))
}

/// The error and all its causes, as a person reads it.
pub(crate) fn with_causes(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text = format!("{text}: {error}");
        cause = error.source();
    }
    text
}

/// On a brick, Enter and Back must stop a run. A brick below another root is a bench, with somebody at the keyboard.
fn stoppable(job: &Job, robot: &Robot) -> Result<(), Refused> {
    match (&job.brick, robot.stop_button()) {
        (_, Ok(())) => Ok(()),
        (Brick::Local(tree), Err(error)) if tree.is_machine() => Err(Refused::Buttons(error.clone())),
        (Brick::Local(tree), Err(error)) => {
            log::warn!("no stop button below {}: {error}", tree.root().display());
            Ok(())
        }
        (Brick::Simulated { .. }, Err(_)) => Ok(()),
    }
}

/// What is known of another program's hand on a motor: what showed it, whether the motor turns, and who has its files open.
fn hand_on(motor: &LeasedMotor, tree: &Arc<dyn Tree>) -> String {
    let identity = motor.motor().identity();
    let shown = motor.taken_at().map(Aspect::file).unwrap_or_default();
    let turns = match motor.motor().state() {
        Ok(state) if state.is_running() => "which turns; onbrick halt stops it",
        _ => "which stands still",
    };
    let folder = tree.root().join(identity.folder());
    let users = match &open_files::users_of(&folder)[..] {
        [] => "no program has its files open now".to_owned(),
        users => format!("its files are open in {}", users.join(", ")),
    };
    format!("{} ({shown}), {turns}; {users}", identity.address)
}

type Report = dyn Fn(&Event) + Send + Sync;

/// What the hardware's lock says of a run.
fn doing(mission: &str) -> String {
    format!("mission {mission}")
}

/// This process as the hardware's owner, before it has taken over any motor.
fn owner(job: &Job, mission: &str) -> Owner {
    let guard = (job.lock == Lock::Inherited).then(|| nix::unistd::getppid().as_raw());
    Owner { guard, ..Owner::here(&doing(mission)) }
}

/// Writes into the hardware's lock what others need to know of this run, should its processes be killed or hang.
fn write_owner(job: &Job, owner: &Owner) {
    if let Brick::Local(tree) = &job.brick
        && let Err(error) = HardwareLock::name_owner(tree.root(), owner)
    {
        log::warn!("{}", with_causes(&error));
    }
}

/// Where the robot is: its files, its time, and who else may have it.
struct Place {
    tree: Arc<dyn Tree>,
    clock: Arc<dyn Clock>,
    pace: Pace,
    seed: Option<u64>,
    world_toml: Option<String>,
    /// Beep and light before driving off: people are near.
    announce: bool,
    #[cfg(feature = "sim")]
    simulation: Option<crate::sim::Simulation>,
    #[cfg(feature = "sim")]
    observer: Option<crate::sim::Observer>,
    _lock: Option<HardwareLock>,
}

impl Place {
    fn open(job: &Job, mission: &str) -> Result<Self, Refused> {
        match &job.brick {
            Brick::Local(tree) => {
                let lock = match job.lock {
                    Lock::Take => Some(HardwareLock::take(tree.root(), &doing(mission))?),
                    Lock::Inherited => {
                        HardwareLock::name_owner(tree.root(), &owner(job, mission))?;
                        None
                    }
                };
                Ok(Self {
                    tree: Arc::new(tree.clone()),
                    clock: Arc::new(MonotonicClock),
                    pace: Pace::Real,
                    seed: None,
                    world_toml: None,
                    announce: true,
                    #[cfg(feature = "sim")]
                    simulation: None,
                    #[cfg(feature = "sim")]
                    observer: None,
                    _lock: lock,
                })
            }
            #[cfg(feature = "sim")]
            Brick::Simulated { world, seed, realtime } => Self::simulated(job.start, world, *seed, *realtime),
            #[cfg(not(feature = "sim"))]
            Brick::Simulated { .. } => Err(Refused::NoSimulation),
        }
    }
}

#[cfg(feature = "sim")]
impl Place {
    /// The simulation stands at the beginning of its time; a virtual clock makes its two minutes two seconds. Of a world's start poses the robot
    /// stands on the one that is nearest to where it is told to be: so each robot of a team has its own.
    fn simulated(start: Pose, world: &super::Source, seed: u64, realtime: bool) -> Result<Self, Refused> {
        use crate::clock::VirtualClock;
        use crate::runtime::STALL_NS;
        use crate::sim::{Simulation, World, WorldPhysics};
        let (parsed, _) = World::parse(&world.name, world.text.as_bytes())?;
        let clock: Arc<dyn Clock> =
            if realtime { Arc::new(MonotonicClock) } else { Arc::new(VirtualClock::default()) };
        let physics = WorldPhysics::new(parsed.with_start_near(start.x_m, start.y_m), 1, seed)?;
        let observer = physics.observer();
        let simulation = Simulation::new(Arc::clone(&clock), Box::new(physics), seed);
        if realtime {
            // A tick that is so late ends the run.
            simulation.give_up_behind_ns(STALL_NS);
        }
        Ok(Self {
            tree: simulation.brick(0),
            clock,
            pace: if realtime { Pace::Real } else { Pace::Virtual },
            seed: Some(seed),
            world_toml: Some(world.text.clone()),
            announce: false,
            simulation: Some(simulation),
            observer: Some(observer),
            _lock: None,
        })
    }

    /// Where the robot really is.
    fn truth(&self) -> Option<Pose> {
        let truth =
            self.simulation.as_ref()?.inspect(|world: &mut crate::sim::WorldPhysics| world.truth(0))??;
        Some(Pose { x_m: truth.x_m, y_m: truth.y_m, heading_rad: truth.heading_rad })
    }
}

#[cfg(not(feature = "sim"))]
impl Place {
    fn truth(&self) -> Option<Pose> {
        None
    }
}

/// Begins the recording.
fn record(
    job: &Job,
    config: &RobotConfig,
    mission: &Mission,
    place: &Place,
    report: Arc<Report>,
) -> Result<(Recorder, recording::TickSide), Refused> {
    let failed = |source| Refused::Record { file: job.file.clone(), source };
    let sink = recording::create(&job.file)
        .map_err(|source| failed(RecordError { doing: "create the file", source }))?;
    let start = Start {
        run: job.run.clone(),
        brick: config.name.clone(),
        mission: mission.name().to_owned(),
        robot_toml: job.robot.text.clone(),
        mission_toml: job.mission.text.clone(),
        world_toml: place.world_toml.clone(),
        start_pose: job.start,
        start_ns: 0,
        // The run's clock begins now; see `start_ns`.
        wall_offset_ns: if place.pace == Pace::Real { wall_ns() } else { 0 },
        period_ns: period_ns(mission),
        pace: place.pace,
        seed: place.seed,
        cells: config.battery.cells,
        settings: job.set.clone(),
        range: names::range_sensor(config),
        machines: names::machines(mission),
    };
    let options = Options { sync_period_ns: job.sync_ns, ..Options::default() };
    let on_status = Box::new(move |status: &recording::Status| report(&Event::Status(status.clone())));
    Recorder::start(Box::new(sink), start, options, on_status).map_err(failed)
}

#[cfg(feature = "sim")]
#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::MILLISECOND_NS;
    use crate::runtime::{STALL_NS, Source};
    use crate::sim::World;

    /// The time that a simulated brick has given up for lost, `pause_ns` after it was made.
    fn lost_ns(realtime: bool, pause_ns: i64) -> i64 {
        let world = Source { name: "arena".to_owned(), text: World::text("arena").unwrap().to_owned() };
        let place = Place::simulated(Pose::default(), &world, 1, realtime).unwrap();
        place.clock.sleep_until_ns(place.clock.now_ns() + pause_ns);
        let simulation = place.simulation.unwrap();
        simulation.catch_up();
        simulation.lost_ns()
    }

    #[test]
    fn a_simulation_in_real_time_gives_up_what_it_is_far_behind_and_one_in_virtual_time_nothing() {
        assert_eq!(lost_ns(false, 10 * SECOND_NS), 0);
        assert!(lost_ns(true, STALL_NS + 100 * MILLISECOND_NS) >= 100 * MILLISECOND_NS);
    }
}
