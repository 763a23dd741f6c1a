//! One job from its checks to its recording.

use std::borrow::Cow;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use nix::errno::Errno;

use crate::behavior::{Mission, SetError};
use crate::clock::{SECOND_NS, seconds, wall_ns};
use crate::document::Findings;
use crate::ev3dev::{DeviceError, StopAction, Tree};
use crate::mapping::Pose;
use crate::printable::with_causes;
use crate::robot::{Aspect, BindError, LeasedMotor, Robot, equip};
use crate::threads::Background;

use super::control::{Control, Tally};
use super::environment::{Environment, Floor};
use super::pilot::PilotError;
use super::{
    Brick, Ended, Event, HardwareLock, Heartbeat, Job, Lock, LockError, NotReady, Owner, Pilot,
    PilotState, Pulse, Stop, StopFlags, StopReason, halt_command, open_files, prepare,
};
use crate::recording::{self, End, Info, Options, Pace, RecordError, Recorder, Start};

/// What a loop that is late means where no real device can hold it up.
const TOO_BUSY: &str =
    "this machine was too busy; close other programs, or simulate without the clock on the wall";

/// Why a run did not start. Nothing has moved.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Refused {
    /// A file is not in order.
    #[error(transparent)]
    Findings(#[from] Findings),
    /// A number that the mission does not have, or not so.
    #[error("--set")]
    Setting(#[from] SetError),
    /// Another run drives.
    #[error("the robot is taken")]
    Lock(#[from] LockError),
    /// A role has no device.
    #[error("the robot is not as its file says")]
    Bind(#[from] BindError),
    /// A person beside the robot could not stop it.
    #[error("the brick's buttons cannot be read, so a person beside the robot could not stop it")]
    Buttons(#[source] DeviceError),
    /// The board has no buttons, and neither the file nor the command line says what stops a run.
    #[error("a {0} has no buttons, so a person beside the robot could not stop it")]
    NoButton(&'static str),
    /// There is no room for a thread: of what is unplugged, or of who asks to stop.
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
    #[error("the world")]
    World(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// This program was built without the simulated brick.
    #[error("this onbrick was built without the simulated brick")]
    NoSimulation,
}

impl Refused {
    /// The error and all its causes, as they travel.
    #[must_use]
    pub fn stop(&self) -> Stop {
        match self {
            Self::NotReady(NotReady::Stopped(reason)) => {
                reason.with("before it started".to_owned())
            }
            refused => StopReason::Refused.with(with_causes(refused)),
        }
    }

    /// What to do, where the message does not say it.
    ///
    /// - `root`: where the brick is in this machine's files.
    #[must_use]
    pub fn way_out(&self, root: Option<&Path>) -> Option<Cow<'static, str>> {
        let way_out = match self {
            Self::Lock(LockError::Taken(_)) => {
                let halt = halt_command(root.unwrap_or(Path::new("/")));
                return Some(format!("wait until it is over, or {halt}").into());
            }
            Self::Lock(LockError::Io { .. }) => Some(
                "look at the permissions of the lock file and its folder; no other program needs \
                 the file, so it can be deleted",
            ),
            Self::Bind(error) => error.way_out(),
            Self::Buttons(_) => Some(
                "a user of the group input, or root; [stop_button] in robot.toml, where they have \
                 another name",
            ),
            Self::NoButton(_) => Some(
                "[stop_button] in robot.toml, a touch sensor (port) or a button on a GPIO \
                 (device); or --no-button, each time, with a hand near the plug",
            ),
            Self::Record { .. } => {
                Some("--out with a folder that can be written to, on a disk with room")
            }
            Self::NoSimulation => Some("a program that was built with the feature `sim`"),
            _ => None,
        };
        way_out.map(Cow::Borrowed)
    }
}

impl Event {
    /// The event of a run that is refused on this brick.
    #[must_use]
    pub fn of_refused(refused: &Refused, brick: &Brick) -> Self {
        let hint = refused.way_out(brick.root()).map(Cow::into_owned);
        Self::Refused { stop: refused.stop(), hint }
    }
}

/// Does a job in its environment. `report` hears how it is going, at most five times a second, from
/// more than one thread.
///
/// # Errors
///
/// [`Refused`], before anything has moved. What happens afterwards is in [`Ended`].
pub fn execute(
    job: &Job,
    environment: Environment,
    flags: &StopFlags,
    heartbeat: &mut dyn Heartbeat,
    report: impl Fn(&Event) + Send + Sync + 'static,
) -> Result<Ended, Refused> {
    let report: Arc<Report> = Arc::new(report);
    // Of this run alone; the other flags are shared.
    let flags = &StopFlags { fallen: Arc::default(), ..flags.clone() };
    let heartbeat = &mut Floor {
        truth: environment.truth.clone(),
        fallen: Arc::clone(&flags.fallen),
        next: heartbeat,
    };
    let Ready { _held, mission, mut robot, mut pilot, seed } =
        ready(job, &environment, flags, &*report)?;
    let (recorder, mut tick_side) =
        record(job, &robot, &mission, &environment, seed, Arc::clone(&report))?;
    let motors = robot.motor_ports();
    write_owner(job, &Owner { motors: motors.clone(), ..owner(job, mission.name()) });
    report(&Event::Driving { file: job.file.clone(), motors });

    let mut control = Control {
        robot: &mut robot,
        pilot: &mut pilot,
        recorder: &mut tick_side,
        clock: &*environment.clock,
        flags,
        heartbeat,
        guard: (job.lock == Lock::Inherited).then(|| Pulse::new(Arc::clone(&flags.guard_beats))),
        period_ns: period_ns(&mission),
        truth: environment.truth.as_deref(),
        tally: Tally::default(),
    };
    // Whatever goes wrong inside a tick, the motors are stopped here and the recording is finished.
    let driven = catch_unwind(AssertUnwindSafe(|| control.drive()));
    let reason = match driven.unwrap_or(StopReason::Panicked) {
        StopReason::Lost(_) if is_gone(&environment.tree) => StopReason::Unmounted,
        reason => reason,
    };
    control.note(reason);
    let mut tally = control.tally;
    // Where no file is left to stop a motor by, the guard has none, either: its lease ends.
    let is_unmounted = reason == StopReason::Unmounted;
    let stopped = robot.stop(StopAction::Brake) || is_unmounted;
    let mut stop = reason.with(detail(reason, job, &mut robot, &environment.tree));
    if reason.has_a_place() {
        stop.add(&place(&mission, &pilot, &tally.pose));
    }
    // The lock has its name from the brick's files; the guard clears it without them.
    if stopped && !is_unmounted {
        write_owner(job, &Owner { stopped: true, ..owner(job, mission.name()) });
    }
    report(&Event::Stopped { stop: stop.clone(), stopped });
    let points = pilot.finish();
    tick_side.keyframes(tally.time_ns, pilot.keyframes());
    tally.points += points.len() as u64;
    let end = End {
        stop: stop.clone(),
        time_ns: tally.time_ns,
        truth: environment.truth().map(|truth| truth.pose),
        points,
        map: Some(recording::Grid::from(pilot.map().grid())),
    };
    let recording = recorder.finish(tick_side, end).err().map(|error| with_causes(&error));
    Ok(Ended {
        stop,
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

/// A robot that stands still, and what it is to do.
struct Ready {
    /// Dropped last: until then no other run has the motors.
    _held: Option<Held>,
    mission: Mission,
    robot: Robot,
    pilot: Pilot,
    seed: u64,
}

/// Takes the hardware, and waits until the robot stands still and is in order.
fn ready(
    job: &Job,
    environment: &Environment,
    flags: &StopFlags,
    report: &Report,
) -> Result<Ready, Refused> {
    let (config, _) = job.robot.robot()?;
    let (mut mission, _) = job.mission.mission(&config.capabilities())?;
    for (name, value) in &job.set {
        mission.set(name, *value)?;
    }
    mission.within_limits()?;
    let _held = hold(job, mission.name(), flags)?;
    equip(&environment.tree, &config, &*environment.clock)?;
    let mut robot = Robot::bind(&environment.tree, &config, mission.senses())?;
    stoppable(job, &robot)?;
    if environment.pace == Pace::Real {
        robot.mend_in_background().map_err(Refused::Helper)?;
    }
    log::debug!("the robot is bound");
    prepare(&mut robot, &*environment.clock, flags, environment.announce, |why| {
        report(&Event::Preparing { what: why.to_owned() });
    })?;
    log::debug!("the robot stands still, and has announced itself");
    // On a brick the moment decides; it is in the recording, so that a replay draws the same.
    let seed = environment.seed.unwrap_or_else(|| wall_ns().cast_unsigned());
    // As the robot was bound: with the cells that the brick runs on.
    let pilot = Pilot::new(robot.config(), &mission, job.method, job.start)?.with_seed(seed);
    Ok(Ready { _held, mission, robot, pilot, seed })
}

/// Whether there is no brick any more: its folder is empty, or what served it is dead.
fn is_gone(tree: &Arc<dyn Tree>) -> bool {
    matches!(tree.list("sys"), Err(Errno::ENOENT | Errno::ENOTCONN))
}

/// What else is known of why a run ended.
fn detail(
    reason: StopReason,
    job: &Job,
    robot: &mut Robot,
    tree: &Arc<dyn Tree>,
) -> Option<String> {
    match reason {
        StopReason::Lost(channel) => robot.trouble_with(channel).map(ToString::to_string),
        StopReason::Button => robot.stop_trouble().map(ToString::to_string),
        StopReason::Outside(channel) => robot.motor(channel).map(|motor| hand_on(motor, tree)),
        StopReason::Late if matches!(job.brick, Brick::Simulated { .. }) => {
            Some(TOO_BUSY.to_owned())
        }
        _ => None,
    }
}

/// What the mission did at the end, and where: `drive in ahead, at x 0.83 m, y -0.20 m`.
fn place(mission: &Mission, pilot: &Pilot, pose: &Pose) -> String {
    let states = mission.machines().iter().zip(pilot.program().states());
    let states = states.map(|(machine, state)| format!("{} in {state}, ", machine.name));
    format!("{}at x {:.2} m, y {:.2} m", states.collect::<String>(), pose.x_m, pose.y_m)
}

fn period_ns(mission: &Mission) -> i64 {
    SECOND_NS / i64::from(mission.rate_hz().max(1))
}

/// Something beside the robot must stop a run: the board's buttons, else the robot's stop button,
/// unless the person who starts it does without. A brick with buttons below another root is a test
/// bench, with a person at the keyboard.
fn stoppable(job: &Job, robot: &Robot) -> Result<(), Refused> {
    match (&job.brick, robot.stop_button()) {
        (_, Ok(())) => Ok(()),
        (_, Err(_)) if job.no_button => {
            log::warn!("no button stops this run, as --no-button says");
            Ok(())
        }
        (_, Err(_)) if robot.platform().buttons.is_none() => {
            Err(Refused::NoButton(robot.platform().what))
        }
        (Brick::Local(tree), Err(error)) if tree.is_machine() => {
            Err(Refused::Buttons(error.clone()))
        }
        (Brick::Local(tree), Err(error)) => {
            // The file itself: `--buttons` may have named another one.
            let file = robot.platform().buttons.and_then(|file| tree.local_path(file));
            let file = file.unwrap_or_else(|| tree.root().to_owned());
            log::warn!("no stop button at {}: {}", file.display(), error.cause);
            Ok(())
        }
        (Brick::Simulated { .. }, Err(_)) => Ok(()),
    }
}

/// What is known of another program's hand on a motor: what showed it, whether the motor turns, and
/// who has its files open.
fn hand_on(motor: &LeasedMotor, tree: &Arc<dyn Tree>) -> String {
    let identity = motor.motor().identity();
    let shown = motor.taken_at().map(Aspect::file).unwrap_or_default();
    let turns = match motor.motor().state() {
        Ok(state) if state.is_running() => {
            format!("which turns; {} stops it", halt_command(tree.root()))
        }
        _ => "which stands still".to_owned(),
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

/// Writes into the hardware's lock what others need to know of this run, should its processes be
/// killed or hang.
fn write_owner(job: &Job, owner: &Owner) {
    if let Brick::Local(tree) = &job.brick
        && let Err(error) = HardwareLock::name_owner(tree.root(), owner)
    {
        log::warn!("{}", with_causes(&error));
    }
}

/// The hardware of a run, where it is not a simulation's.
struct Held {
    _requests: Background,
    /// Nothing where the guard has it already.
    _lock: Option<HardwareLock>,
}

/// Takes the hardware, and listens to who asks its owner to stop.
fn hold(job: &Job, mission: &str, flags: &StopFlags) -> Result<Option<Held>, Refused> {
    let Brick::Local(tree) = &job.brick else { return Ok(None) };
    let root = tree.root();
    let _lock = match job.lock {
        Lock::Take => Some(HardwareLock::take(root, &doing(mission))?),
        Lock::Inherited => {
            HardwareLock::name_owner(root, &owner(job, mission))?;
            None
        }
    };
    let _requests = flags.watch_requests(root).map_err(Refused::Helper)?;
    Ok(Some(Held { _requests, _lock }))
}

/// Begins the recording.
fn record(
    job: &Job,
    robot: &Robot,
    mission: &Mission,
    environment: &Environment,
    seed: u64,
    report: Arc<Report>,
) -> Result<(Recorder, recording::TickSide<PilotState>), Refused> {
    let failed = |source| Refused::Record { file: job.file.clone(), source };
    let config = robot.config();
    let sink = (environment.create)(&job.file)
        .map_err(|source| failed(RecordError { doing: "create the file", source }))?;
    let info = Info {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        run: job.run.clone(),
        brick: job.name.clone().unwrap_or_else(|| config.name.clone()),
        mission: mission.name().to_owned(),
        start_pose: job.start,
        start_ns: 0,
        // The run's clock begins now; see `start_ns`.
        wall_offset_ns: environment.wall_offset_ns.unwrap_or_else(wall_ns),
        period_ns: period_ns(mission),
        pace: environment.pace,
        seed,
        cells: config.battery.cells,
        board: robot.platform(),
        settings: job.set.clone(),
        method: job.method,
    };
    let robot = (config, job.robot.text.as_str());
    let mission = (mission, job.mission.text.as_str());
    let start = Start::of(info, robot, mission, environment.world_toml.clone());
    let options = Options { sync_period_ns: job.sync_ns, ..Options::default() };
    let on_status =
        Box::new(move |status: &recording::Status| report(&Event::Status(status.clone())));
    Recorder::start(sink, start, options, on_status).map_err(failed)
}
