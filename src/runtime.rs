//! A run: one execution of a mission, from the checks before anything moves to the recording that is left.
//!
//! [`execute()`] does a [`Job`]: it loads robot and mission, takes the hardware, binds the roles, opens the recording, makes sure that the
//! robot stands still and is in order (`prepare`), ticks (`control`), and leaves every motor stopped whichever way the run ends. The
//! tick's thinking is the [`Pilot`]'s, which [`replay()`] drives with recorded senses.
//!
//! ```text
//! prepare ─▶ control: robot ─▶ pilot ─▶ robot        every tick
//!                        └───────┴─▶ recorder ─▶ run.mcap
//!            replay:  run.mcap ─▶ pilot ─▶ compared with run.mcap
//! ```
//!
//! Before there is a run, a robot is set up: [`setup`](setup()) writes `robot.toml` by asking, [`calibrate`](calibrate()) measures it by driving,
//! [`examine`] looks whether all is in order. They talk with a person through a [`Dialogue`], on a terminal or on the brick.
//!
//! # Not here
//!
//! No network: what runs on the tick's path knows no sockets. No pictures: they are made of finished runs (`report`).

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::ev3dev::LocalTree;
use crate::mapping::Pose;
use crate::robot::Channel;

mod battery;
mod calibrate;
mod child;
mod control;
mod dialogue;
mod doctor;
mod evict;
mod execute;
pub(crate) mod groups;
mod guard;
mod lock;
mod names;
mod open_files;
mod pilot;
mod plausibility;
mod prepare;
pub mod recording;
mod replay;
pub mod save;
mod setup;
mod stall;

pub use battery::{Charge, HOLD_NS, SLOW_SHARE};
pub use calibrate::{
    ApplyError, CalibrateError, CalibrateOptions, Calibration, Doubt, EditError, Measured, Straight,
    calibrate, set_numbers,
};
pub use child::{
    Order, RunError, RunProcess, StartError, StopBy, Stopper, never_wait, obey, read_job, verbosity,
};
pub use control::{Control, STALL_NS, StopFlags, Tally};
pub use dialogue::{Dialogue, NoAnswer};
pub use doctor::{Checked, Diagnosis, Patient, Verdict, examine};
pub use evict::{OrphansError, PATIENCE_NS, evict, signal, stop_orphans};
#[cfg(feature = "sim")]
pub use execute::execute_observed;
#[cfg(feature = "cli")]
pub(crate) use execute::with_causes;
pub use execute::{Refused, execute};
pub use guard::{Lines, MISSED_NS, Pulse, Watch};
pub use lock::{HardwareLock, LockError, Owner};
pub use pilot::{Pilot, PilotError, PilotState, Step};
pub use prepare::{NotReady, prepare};
pub use replay::{Cast, Difference, Remade, ReplayError, Replayed, replay, replay_with, whole_map};
pub use setup::{Draft, DraftHead, DraftMotor, DraftRange, SetupError, setup};

/// A file as it was read, with the name that findings use.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Source {
    /// What findings call it.
    pub name: String,
    /// Its text.
    pub text: String,
}

/// All that a run needs to know.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Job {
    /// The mission.
    pub mission: Source,
    /// The robot.
    pub robot: Source,
    /// Where the robot's files are.
    pub brick: Brick,
    /// The robot's pose at the start.
    pub start: Pose,
    /// The mission's own numbers that are set otherwise for this run.
    pub set: Vec<(String, f64)>,
    /// Where the recording goes.
    pub file: PathBuf,
    /// How often the recording is brought to the disk, nanoseconds: at most what came since is lost in a power cut.
    pub sync_ns: i64,
    /// The run's identifier, where whoever started it chose one; it goes into the recording.
    pub run: Option<String>,
    /// What becomes of the run when whoever started it is gone.
    pub when_abandoned: WhenAbandoned,
    /// Who holds the hardware's lock.
    pub lock: Lock,
}

/// Who holds the hardware's lock for a run on a brick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Lock {
    /// Nobody yet: whoever does the job takes it.
    #[default]
    Take,
    /// The guard that started this process, which shares the lock by inheritance.
    Inherited,
}

/// What becomes of a run when whoever started it is gone: when the pipe of its orders closes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WhenAbandoned {
    /// It stops.
    #[default]
    Stop,
    /// It goes on to its own end.
    GoOn,
}

/// Where a robot's attribute files are.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum Brick {
    /// In this machine's files: below `/` on the brick, below a mount point elsewhere.
    Local(LocalTree),
    /// A simulated brick inside this process.
    Simulated {
        /// The world's file.
        world: Source,
        /// What all chance comes from.
        seed: u64,
        /// Keeps step with the wall clock; otherwise time passes as fast as the machine allows.
        realtime: bool,
    },
}

/// How a run is going, for whoever started it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// Something is waited for before the run can start.
    Preparing {
        /// What a person should do.
        what: String,
    },
    /// The robot drives.
    Driving {
        /// The recording.
        file: PathBuf,
        /// The ports of the motors that the run has taken over, as the kernel names them.
        motors: Vec<String>,
    },
    /// How it is going.
    Status(recording::Status),
    /// The motors were told to stop; what follows is the recording's end, which may take a while.
    Stopped {
        /// One word: see [`StopReason::word`].
        word: String,
        /// Why it ended, for people.
        reason: String,
        /// Every motor took the command to stop.
        stopped: bool,
    },
    /// The run did not start.
    Refused {
        /// Why.
        message: String,
        /// What to do, where the message does not say it.
        hint: Option<String>,
    },
    /// The run is over.
    Ended(Ended),
}

/// How a run went.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ended {
    /// One word: see [`StopReason::word`].
    pub word: String,
    /// Why it ended, for people.
    pub reason: String,
    /// It ended as the mission or a person wanted it.
    pub wanted: bool,
    /// Every motor took the command to stop.
    pub stopped: bool,
    /// How many ticks there were.
    pub ticks: u64,
    /// The run's length, seconds.
    pub time_s: f64,
    /// Metres driven.
    pub travelled_m: f64,
    /// Points of the map.
    pub points: u64,
    /// Ticks that came later than a whole period.
    pub overruns: u64,
    /// The latest tick, seconds after its deadline.
    pub latest_s: f64,
    /// The recording.
    pub file: PathBuf,
    /// What is wrong with the recording, if anything is.
    pub recording: Option<String>,
}

impl std::fmt::Display for Ended {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{}, after {:.1} s: {:.2} m driven, {} points, {} ticks ({} overruns, the latest {:.1} ms late)",
            self.reason,
            self.time_s,
            self.travelled_m,
            self.points,
            self.ticks,
            self.overruns,
            self.latest_s * 1e3
        )?;
        if let Some(recording) = &self.recording {
            write!(f, "\nthe recording is not complete: {recording}")?;
        }
        if !self.stopped {
            write!(f, "\nnot every motor took the command to stop; their leases end after 0.3 s")?;
        }
        Ok(())
    }
}

/// Who is told, tick by tick, that the loop is alive.
pub trait Heartbeat: std::fmt::Debug + Send {
    /// One tick is done. Must not wait.
    fn beat(&mut self);
}

/// Nobody listens: for tests and for simulations that run in virtual time.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoHeartbeat;

impl Heartbeat for NoHeartbeat {
    fn beat(&mut self) {}
}

/// Why a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopReason {
    /// The mission came to its end.
    Finished,
    /// The mission's time is over.
    TimeLimit,
    /// Somebody pressed Enter or Back on the brick.
    Button,
    /// Somebody asked for it over the network.
    Remote,
    /// A person in the brick's menu, or a program on the brick, asked for it.
    Here,
    /// The menu on the brick is gone, and runs were to end with it.
    MenuClosed,
    /// SIGINT, SIGTERM or SIGHUP, at whichever of the run's processes.
    Signal,
    /// Whoever started the run is gone.
    Abandoned,
    /// Another program has commanded or reset a motor of ours.
    Outside(Channel),
    /// A device is gone, or cannot be read any more.
    Lost(Channel),
    /// A reading cannot be true: it stands still although what it measures moves (a gyro while the wheels turn the robot by 60°, a range while the
    /// robot drives 0.2 m along its beam, a head's angle for a second while it is told to turn), or leaps about.
    Implausible(Channel),
    /// A wheel that was told to turn did not.
    Stalled,
    /// The battery is too low to go on.
    Battery,
    /// The loop was away for longer than [`STALL_NS`].
    Late,
    /// The recording cannot be written.
    Recording,
    /// The process that drives was gone or hung, and the guard stopped the motors.
    Guard,
    /// The guard was gone or hung, and the process that drives stopped the motors.
    Unguarded,
    /// A simulated robot drove over the floor's edge. A real one's program does not learn of it.
    Fallen,
    /// The program itself failed.
    Panicked,
}

impl StopReason {
    /// A word for programs.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Finished => "finished",
            Self::TimeLimit => "time limit",
            Self::Button => "button",
            Self::Remote => "remote",
            Self::Here => "here",
            Self::MenuClosed => "menu closed",
            Self::Signal => "signal",
            Self::Abandoned => "abandoned",
            Self::Outside(_) => "outside",
            Self::Lost(_) => "lost",
            Self::Implausible(_) => "implausible",
            Self::Stalled => "stalled",
            Self::Battery => "battery",
            Self::Late => "late",
            Self::Recording => "recording",
            Self::Guard => "guard",
            Self::Unguarded => "unguarded",
            Self::Fallen => "fallen",
            Self::Panicked => "panicked",
        }
    }

    /// True where the run ended as the mission or a person wanted it.
    #[must_use]
    pub const fn is_wanted(self) -> bool {
        matches!(
            self,
            Self::Finished
                | Self::TimeLimit
                | Self::Button
                | Self::Remote
                | Self::Here
                | Self::MenuClosed
                | Self::Signal
        )
    }
}

impl std::fmt::Display for StopReason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Finished => f.write_str("the mission is finished"),
            Self::TimeLimit => f.write_str("the mission's time limit"),
            Self::Button => f.write_str("stopped by a button on the brick"),
            Self::Remote => f.write_str("stopped over the network"),
            Self::Here => f.write_str("stopped on the brick"),
            Self::MenuClosed => f.write_str("the brick's menu is gone"),
            Self::Signal => f.write_str("stopped by a signal"),
            Self::Abandoned => f.write_str("whoever started the run is gone"),
            Self::Outside(channel) => {
                write!(f, "stopped from outside: another program commands the {channel}")
            }
            Self::Lost(channel) => write!(f, "lost: {channel} (a plug may be loose)"),
            Self::Implausible(channel) => write!(f, "implausible: {channel} ({})", how_implausible(*channel)),
            Self::Stalled => f.write_str("a wheel is blocked"),
            Self::Battery => Charge::Empty.fmt(f),
            Self::Late => write!(f, "the loop stood still for more than {} ms", STALL_NS / 1_000_000),
            Self::Recording => f.write_str("the recording cannot be written"),
            Self::Guard => f.write_str("the guard stopped the motors"),
            Self::Unguarded => f.write_str("the run's guard is gone, or has given no sign of life for 0.2 s"),
            Self::Fallen => f.write_str("the simulated robot fell over the edge of the floor"),
            Self::Panicked => f.write_str("the program failed; please report it"),
        }
    }
}

/// What a person should look at.
fn how_implausible(channel: Channel) -> &'static str {
    match channel {
        Channel::Gyro => {
            "it does not turn with the wheels, or leaps about: a plug may be loose, or the wheels turn in vain"
        }
        Channel::Range => {
            "it says the same while the robot drives: a plug may be loose, or the wheels turn in vain"
        }
        _ => {
            "it does not turn as it is told, or its angle leaps about: a plug may be loose, or something blocks it"
        }
    }
}
