//! What a brick answers: the contents of a reply's `ok`.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::RunId;
use crate::recording;
use crate::runtime::Stop;

/// What a reply's `ok` holds where there is nothing to say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Done {}

/// The one state of a brick.
///
/// ```text
///  ready ──start──▶ preparing ──▶ running ──▶ stopping ──▶ stopped ──▶ (start again)
///    ▲                  │                                     │
///    └── acknowledge ── fault ◀── a run that ended unwanted ──┘
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum State {
    /// Waits for a start; no run since the service began.
    Ready,
    /// A run waits for the robot to stand still, beeps, and so on.
    Preparing,
    /// A run drives.
    Running,
    /// The motors were told to stop; the recording is being finished.
    Stopping,
    /// The last run ended as the mission or a person wanted it. A start is taken, as in `ready`.
    Stopped,
    /// The last run did not end as wanted, or something keeps any run from starting. A start is
    /// taken where the brick is able to; a person can acknowledge the fault on the brick.
    Fault,
}

impl fmt::Display for State {
    /// The word that it is serialized by.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// How a brick is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// The brick's name.
    pub brick: String,
    /// The version of onbrick.
    pub version: String,
    /// The protocol's version.
    pub protocol: u32,
    /// The state.
    pub state: State,
    /// How long it has been in this state, seconds of the brick's clock.
    pub state_s: f64,
    /// The run that is going on.
    pub run: Option<RunStatus>,
    /// How the last run ended, or what else keeps the brick from being ready.
    pub last: Option<LastStop>,
    /// Volts, where they can be read.
    pub battery_v: Option<f64>,
    /// The robot is a simulated one: it has a battery while it drives. Older bricks do not tell.
    #[serde(default)]
    pub simulated: bool,
    /// A battery with which no run begins: what the run would say; otherwise nothing. Older bricks
    /// do not tell.
    #[serde(default)]
    pub battery: Option<String>,
    /// Another program has the motors, such as a calibration: which; otherwise nothing. Older
    /// bricks do not tell.
    #[serde(default)]
    pub taken: Option<String>,
    /// For a `start`, within [`TOKEN_LIFE_NS`](super::TOKEN_LIFE_NS).
    pub token: String,
    /// How the link is: `ready`, or what it waits for.
    pub link: String,
    /// Bytes of runs on disk, and how many there may be.
    pub disk: Disk,
    /// A robot that has a finding in its file: the finding; otherwise nothing.
    pub robot: Option<String>,
    /// A wall clock that stands wrong: what it says, and what to do; otherwise nothing. Older
    /// bricks do not tell.
    #[serde(default)]
    pub clock: Option<String>,
}

/// Room for runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Disk {
    /// Bytes of runs.
    pub used: u64,
    /// The upper limit.
    pub quota: u64,
    /// Free on the file system.
    pub free: u64,
}

/// Who asked for something, after a verb: "by anna", "on the brick" for what came from its own
/// shell or menu.
#[must_use]
pub fn whose(by: &str) -> String {
    match by {
        "here" => "on the brick".to_owned(),
        "menu" => "in the brick's menu".to_owned(),
        by => format!("by {by}"),
    }
}

/// A run that is going on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunStatus {
    /// Which.
    pub run: RunId,
    /// Its mission's name.
    pub mission: String,
    /// The mission's time limit, seconds.
    pub time_limit_s: f64,
    /// Who started it: a key's name, `menu`, `here`; [`whose`] says it.
    pub by: String,
    /// What it waits for, while it prepares.
    pub waits: Option<String>,
    /// How it is going, once it drives.
    pub progress: Option<recording::Status>,
}

impl RunStatus {
    /// One that has just begun.
    #[must_use]
    pub fn new(run: RunId, mission: &str, time_limit_s: f64, by: &str) -> Self {
        let (mission, by) = (mission.to_owned(), by.to_owned());
        Self { run, mission, time_limit_s, by, waits: None, progress: None }
    }
}

/// How the last run ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LastStop {
    /// Which run, where it was one.
    pub run: Option<RunId>,
    /// Its mission's name.
    pub mission: String,
    /// Why: `word` (`finished`, `time limit`, `button`, …:
    /// [`StopReason`](crate::runtime::StopReason)), the `channel` where a device is meant, and a
    /// `detail`.
    #[serde(flatten)]
    pub stop: Stop,
    /// Who asked for it: a key's name, `menu`, `here`.
    pub by: Option<String>,
    /// What the recording lacks.
    pub recording: Option<String>,
}

impl LastStop {
    /// A run's end, or, without a run, what keeps every run from starting.
    #[must_use]
    pub fn new(run: Option<RunId>, mission: &str, stop: Stop) -> Self {
        Self { run, mission: mission.to_owned(), stop, by: None, recording: None }
    }

    /// True where the run ended as the mission or a person wanted it.
    #[must_use]
    pub fn is_wanted(&self) -> bool {
        self.stop.reason.is_wanted()
    }
}

impl fmt::Display for LastStop {
    /// The reason, for people.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.stop)?;
        if let Some(by) = &self.by {
            write!(f, " ({by})")?;
        }
        if let Some(trouble) = &self.recording {
            write!(f, "; the recording is not complete: {trouble}")?;
        }
        Ok(())
    }
}

/// The missions of a brick.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Missions {
    /// By name.
    pub missions: Vec<MissionInfo>,
}

/// A mission that a brick has.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MissionInfo {
    /// By this name it is started.
    pub name: String,
    /// SHA-256 of its file, in hexadecimal: the same mission on two bricks has the same.
    pub sha256: String,
    /// Its time limit, seconds; nothing where it cannot be read.
    pub time_limit_s: Option<f64>,
    /// What `check` says against it, where it cannot be started.
    pub findings: Option<String>,
}

/// A run was started, or had been already.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Started {
    /// Which.
    pub run: RunId,
    /// A run with this identifier was there before: this start did nothing.
    pub repeated: bool,
    /// The time limit of the brick's settings, seconds, where it is shorter than the mission's own.
    /// Older bricks do not tell.
    #[serde(default)]
    pub limited_s: Option<f64>,
}

/// The motors have been told, or nothing was running.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stopped {
    /// The run that was stopped.
    pub run: Option<RunId>,
    /// Every motor took the command.
    pub stopped: bool,
    /// What else had the motors, such as a calibration, and has ended. Older bricks leave it alone.
    #[serde(default)]
    pub other: Option<String>,
}

/// The runs on a brick's disk.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Runs {
    /// The newest first.
    pub runs: Vec<RunInfo>,
}

/// A run on a brick's disk.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunInfo {
    /// Which.
    pub run: RunId,
    /// Its mission's name.
    pub mission: String,
    /// Counts up on this brick, whatever its calendar says.
    pub number: u64,
    /// Bytes of its recording.
    pub bytes: u64,
    /// It is still being written.
    pub going_on: bool,
    /// All of it lies on another machine's disk, which has named its hash.
    pub fetched: bool,
    /// How it ended; nothing where it is going on or was cut.
    pub end: Option<LastStop>,
    /// Metres driven and points, as far as they are known.
    pub travelled_m: Option<f64>,
    /// Points of its map.
    pub points: Option<u64>,
}

/// A part of a recording; its bytes come beside it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fetched {
    /// Which run.
    pub run: RunId,
    /// Where the part begins.
    pub offset: u64,
    /// How long it is.
    pub length: u32,
    /// How long the recording is by now.
    pub total: u64,
    /// The recording is complete: `total` does not grow.
    pub complete: bool,
    /// SHA-256 of the whole, in hexadecimal, once it is complete and this part reaches its end. It
    /// is computed in the background: a part that reaches the end of a complete recording and has
    /// none came too early; asking again from there, for no bytes, brings it.
    pub sha256: Option<String>,
}

/// What is plugged in and what it reads.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Live {
    /// By port.
    pub devices: Vec<LiveDevice>,
}

/// A device that is plugged in.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LiveDevice {
    /// Short, such as `outB`, `in1`.
    pub port: String,
    /// Such as `lego-ev3-l-motor`.
    pub driver: String,
    /// What the robot's file uses it for, where it does.
    pub role: Option<String>,
    /// What it reads, with its unit.
    pub reading: String,
    /// It can be jogged.
    pub motor: bool,
}

/// The pairing window.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "pairing", rename_all = "snake_case")]
pub enum Pairing {
    /// Pairing is closed.
    Closed,
    /// It waits for a PC.
    Open {
        /// For how long yet, seconds.
        seconds: u32,
    },
    /// A PC shows a code: is it this one?
    Compare {
        /// The short code.
        code: String,
        /// What the PC calls itself.
        name: String,
    },
    /// Done: the PC is known.
    Paired {
        /// What the PC calls itself.
        name: String,
    },
    /// Not done.
    Failed {
        /// Why.
        why: String,
    },
    /// This onbrick, or this moment, has no link.
    NoLink {
        /// Why.
        why: String,
    },
}

/// What a person can set on the brick.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// The brick's name.
    pub brick: String,
    /// The version of onbrick.
    pub version: String,
    /// Where the brick's link is reached on the network.
    pub addresses: Vec<String>,
    /// The fingerprint of the brick's key, where it has one.
    pub fingerprint: Option<String>,
    /// Lights follow the state.
    pub lights: bool,
    /// Sounds are made.
    pub sounds: bool,
    /// Each run ends at this time at the latest, those that PCs start as well, seconds.
    pub time_limit_s: Option<f64>,
}

/// Settings to be changed; those that are left out stay.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SettingsChange {
    /// Lights follow the state.
    #[serde(default)]
    pub lights: Option<bool>,
    /// Sounds are made.
    #[serde(default)]
    pub sounds: Option<bool>,
    /// Each run ends at this time at the latest, seconds; 0 takes the limit away.
    #[serde(default)]
    pub time_limit_s: Option<f64>,
}
