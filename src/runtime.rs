//! A run: one execution of a mission, from the checks before anything moves to the recording that
//! is left.
//!
//! [`execute()`] does a [`Job`]: it loads robot and mission, takes the hardware, binds the roles,
//! opens the recording, makes sure that the robot stands still and is in order (`prepare`), ticks
//! (`control`), and leaves every motor stopped whichever way the run ends. The tick's thinking is
//! the [`Pilot`]'s, which [`replay()`] drives with recorded senses.
//!
//! ```text
//! prepare ─▶ control: robot ─▶ pilot ─▶ robot        every tick
//!                        └───────┴─▶ recorder ─▶ run.mcap
//!            replay:  run.mcap ─▶ pilot ─▶ compared with run.mcap
//! ```
//!
//! # Not here
//!
//! No network: what runs on the tick's path knows no sockets. No pictures: they are made of
//! finished runs (`report`).

use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::behavior::{Capabilities, Mission, submachines};
use crate::clock::SECOND_NS;
use crate::document::{Document, Findings, read_bounded};
use crate::ev3dev::{LocalTree, Tree as _};
use crate::mapping::{Method, Pose};
use crate::recording;
use crate::robot::RobotConfig;
#[cfg(feature = "sim")]
use crate::sim::World;
use crate::units::counted;

mod battery;
mod child;
mod control;
mod environment;
mod evict;
mod execute;
pub(crate) mod groups;
mod guard;
mod lock;
mod open_files;
mod pilot;
mod plausibility;
mod prepare;
#[cfg(feature = "cli")]
mod process;
mod replay;
mod stall;
mod stop_request;

pub use crate::recording::{STALL_NS, Stop, StopReason};
pub use battery::{Charge, HOLD_NS, SLOW_SHARE};
pub use child::{RunError, RunProcess, StartError, StopBy, Stopper, never_wait, obey, read_job};
pub use control::{Control, STOP_SIGNALS, StopFlags, Tally};
pub use environment::{CreateSink, Environment, SeeTruth, Truth};
pub use evict::{OrphansError, PATIENCE_NS, end_by_force, evict, stop_orphans};
pub use execute::{Refused, execute};
pub use guard::{Lines, MISSED_NS, Pulse, Watch};
pub use lock::{HardwareLock, LockError, Owner, halt_command};
pub use pilot::{ChangedVariables, Pilot, PilotError, PilotState, Step};
pub use prepare::{GYRO_STILL_RAD, NotReady, prepare};
#[cfg(feature = "cli")]
pub use process::{ProcessError, control, guard};
#[cfg(feature = "host")]
pub(crate) use replay::Again;
pub use replay::{
    Cast, Difference, Remade, ReplayError, Replayed, joint_map, replay, replay_with, whole_map,
};
pub use stop_request::StopRequest;

/// A file as it was read, with the name that findings use.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Source {
    /// What findings call it.
    pub name: String,
    /// Its text.
    pub text: String,
}

impl Source {
    /// A file's text; what is wrong with it if it has none, or too much.
    pub(crate) fn of(name: &str, bytes: &[u8]) -> Result<Self, Findings> {
        let document = Document::new(name, bytes)?;
        Ok(Self { name: name.to_owned(), text: document.text().to_owned() })
    }

    /// A mission with the sub-machines that it uses: those of files beside it, each called like its
    /// sub-machine, else those that come with the program.
    ///
    /// - `folder`: where such files are; `None` where no file is to be looked for.
    #[must_use]
    pub fn with_submachines(self, folder: Option<&Path>) -> Self {
        let find = |name: &str| {
            let path = folder?.join(format!("{name}.toml"));
            match read_bounded(&path).map(String::from_utf8) {
                Ok(Ok(text)) => Some(text),
                Ok(Err(_)) => {
                    log::warn!("{} is not text (not UTF-8)", path.display());
                    None
                }
                Err(error) if error.kind() == io::ErrorKind::NotFound => None,
                Err(error) => {
                    log::warn!("cannot read {}: {error}", path.display());
                    None
                }
            }
        };
        Self { text: submachines::joined(&self.text, find), ..self }
    }

    /// Reads it as a mission, with what is worth a warning.
    pub(crate) fn mission(
        &self,
        capabilities: &Capabilities,
    ) -> Result<(Mission, Findings), Findings> {
        Mission::parse(&self.name, self.text.as_bytes(), capabilities)
    }

    /// Reads it as a robot, with what is worth a warning.
    pub(crate) fn robot(&self) -> Result<(RobotConfig, Findings), Findings> {
        RobotConfig::load(&self.name, self.text.as_bytes())
    }

    /// Reads it as a world, with what is worth a warning.
    #[cfg(feature = "sim")]
    pub(crate) fn world(&self) -> Result<(World, Findings), Findings> {
        World::parse(&self.name, self.text.as_bytes())
    }
}

/// All that a run needs to know.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Job {
    /// The mission, with its sub-machines ([`Source::with_submachines`]).
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
    /// How often the recording is brought to the disk, nanoseconds: at most what came since is lost
    /// in a power cut.
    pub sync_ns: i64,
    /// What the stamps of a run in simulated time count from, nanoseconds since 1970: 0 where the
    /// same run has to give the same bytes. In real time it is the wall clock's time at the start.
    #[serde(default)]
    pub stamps_ns: i64,
    /// The run's identifier, if its starter chose one; it goes into the recording.
    pub run: Option<String>,
    /// What the brick is called, where its starter knows: robots of a class have one file, and one
    /// name in it.
    #[serde(default)]
    pub name: Option<String>,
    /// It may be run where no button beside the robot stops it.
    #[serde(default)]
    pub no_button: bool,
    /// How poses are estimated and points placed.
    #[serde(default)]
    pub method: Method,
    /// What becomes of the run when its starter is gone.
    pub when_abandoned: WhenAbandoned,
    /// Who holds the hardware's lock.
    pub lock: Lock,
}

impl Job {
    /// A job in which nothing else is said: a run from the origin that nothing is set for, synced
    /// once a second, which ends with its starter.
    #[must_use]
    pub fn new(mission: Source, robot: Source, brick: Brick, file: PathBuf) -> Self {
        Self {
            mission,
            robot,
            brick,
            start: Pose::default(),
            set: Vec::new(),
            file,
            sync_ns: SECOND_NS,
            stamps_ns: 0,
            run: None,
            name: None,
            no_button: false,
            method: Method::default(),
            when_abandoned: WhenAbandoned::default(),
            lock: Lock::default(),
        }
    }
}

/// Who holds the hardware's lock for a run on a brick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Lock {
    /// Not chosen yet: the runner of the job takes it.
    #[default]
    Take,
    /// The guard that started this process, which shares the lock by inheritance.
    Inherited,
}

/// What becomes of a run when its starter is gone or hangs: when the pipe of its orders closes, or
/// events stay without an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WhenAbandoned {
    /// It stops.
    #[default]
    Stop,
    /// It continues to its own end.
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

impl Brick {
    /// Where it is in this machine's files; a simulated one is nowhere.
    #[must_use]
    pub fn root(&self) -> Option<&Path> {
        match self {
            Self::Local(tree) => Some(tree.root()),
            Self::Simulated { .. } => None,
        }
    }
}

/// How a run is going, for its starter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
#[non_exhaustive]
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
        /// Why it ended.
        #[serde(flatten)]
        stop: Stop,
        /// Every motor took the command to stop.
        stopped: bool,
    },
    /// The run did not start.
    Refused {
        /// Why.
        #[serde(flatten)]
        stop: Stop,
        /// What to do, where the reason does not say it.
        hint: Option<String>,
    },
    /// The run is over.
    Ended(Ended),
}

/// How a run went.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ended {
    /// Why it ended.
    #[serde(flatten)]
    pub stop: Stop,
    /// Every motor took the command to stop, or none can be commanded any more
    /// ([`StopReason::Unmounted`]).
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
            "{}, after {:.1} s: {:.2} m driven, {}, {} ({}, the latest {:.1} ms late)",
            self.stop,
            self.time_s,
            self.travelled_m,
            counted(self.points, "point"),
            counted(self.ticks, "tick"),
            counted(self.overruns, "overrun"),
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
pub trait Heartbeat: Send {
    /// The tick of this time, nanoseconds of the run's clock, is done. Must not wait.
    fn beat(&mut self, now_ns: i64);
}

/// No listener: for tests and for simulations that run in virtual time.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoHeartbeat;

impl Heartbeat for NoHeartbeat {
    fn beat(&mut self, _now_ns: i64) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_runs_end_counts_one_thing_as_one() {
        let of = |count| {
            Ended {
                stop: StopReason::Finished.into(),
                stopped: true,
                ticks: count,
                time_s: 0.02,
                travelled_m: 0.0,
                points: count,
                overruns: count,
                latest_s: 0.0,
                file: "run.mcap".into(),
                recording: None,
            }
            .to_string()
        };
        let end = "after 0.0 s: 0.00 m driven, 1 point, 1 tick (1 overrun, the latest 0.0 ms late)";
        assert!(of(1).ends_with(end), "{}", of(1));
        assert!(of(2).contains(" 2 points, 2 ticks (2 overruns, "), "{}", of(2));
    }
}
