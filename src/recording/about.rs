//! What is known of a run when it starts and when it ends, and how a recording says it: as records
//! of names and values.

use std::collections::BTreeMap;

use mcap::records::Metadata;
use serde_json::Value;

use super::grid::Grid;
use super::stop::{Stop, StopReason};
use crate::ev3dev::{Platform, Technology};
use crate::mapping::{MapPoint, Method, Pose, RangeMount};
use crate::printable;
use crate::senses::QUANTITIES;

/// What is known of a run when it starts.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// What the run is.
    pub info: Info,
    /// `robot.toml` as it was read.
    pub robot_toml: String,
    /// `mission.toml` as it was read.
    pub mission_toml: String,
    /// `world.toml` as it was read, where the brick is simulated.
    pub world_toml: Option<String>,
    /// How the range sensor sits and measures, where there is one.
    pub range: Option<RangeMount>,
    /// Whether it is an infrared sensor, by `robot.toml`.
    pub infrared: bool,
    /// The mission's machines, in its order.
    pub machines: Vec<MachineNames>,
    /// The names of the mission's variables, in its order.
    pub variables: Vec<String>,
}

/// What a run is.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Info {
    /// The version of onbrick that records it.
    pub version: String,
    /// The run's identifier, if its starter chose one.
    pub run: Option<String>,
    /// The brick's name.
    pub brick: String,
    /// The mission's name.
    pub mission: String,
    /// Where the robot starts.
    pub start_pose: Pose,
    /// The run's start, nanoseconds of the run's clock.
    pub start_ns: i64,
    /// Wall clock minus run clock at the start, nanoseconds; see [the module](super).
    pub wall_offset_ns: i64,
    /// The tick's period, nanoseconds.
    pub period_ns: i64,
    /// Whether the run's time is real.
    pub pace: Pace,
    /// What all chance of the run comes from: the mission's and, where there is one, the
    /// simulation's. Recordings made before this was in them have 0.
    pub seed: u64,
    /// What the brick runs on, which decides about the thresholds of its battery.
    pub cells: Technology,
    /// The board that the robot sits on; recordings made before this was in them have the EV3.
    pub board: &'static Platform,
    /// Named numbers that were set for this run.
    pub settings: Vec<(String, f64)>,
    /// How poses are estimated and points placed; recordings made before this was in them have the
    /// default.
    pub method: Method,
}

/// Whether time is real.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Pace {
    /// It is: what does not fit into the ring is dropped, counted and named.
    #[default]
    Real,
    /// It is simulated and outruns the disk: a full ring is waited for, so nothing is lost, and
    /// only the run's clock decides when syncs are made, so the same run gives the same bytes.
    Virtual,
}

/// What a machine and its states are called.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct MachineNames {
    /// The machine.
    pub name: String,
    /// The place of the state in which it starts.
    pub start: u16,
    /// The conditions of the transitions that hold in all of its states.
    pub always: Vec<String>,
    /// Its states, in the mission's order.
    pub states: Vec<StateNames>,
}

impl MachineNames {
    /// The condition of a transition from a state; `transition` counts as
    /// [`Taken::transition`](crate::behavior::Taken::transition) does.
    #[must_use]
    pub fn condition(&self, from: u16, transition: u16) -> Option<&str> {
        let own = self.states.get(usize::from(from)).map(|state| &state.conditions);
        let mut all = self.always.iter().chain(own.into_iter().flatten());
        all.nth(usize::from(transition)).map(String::as_str)
    }
}

/// What a state is called, and the conditions of the transitions that leave it, as they are
/// written.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct StateNames {
    /// The state.
    pub name: String,
    /// In the mission's order.
    pub conditions: Vec<String>,
}

/// What is known of a run when it ends.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct End {
    /// Why it ended.
    pub stop: Stop,
    /// When, nanoseconds of the run's clock.
    pub time_ns: i64,
    /// Where the robot really was, where it is simulated.
    pub truth: Option<Pose>,
    /// Points that waited for their place when it ended.
    pub points: Vec<MapPoint>,
    /// The map, if the run made one.
    pub map: Option<Grid>,
}

/// How a run ended.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Ending {
    /// Why.
    pub stop: Stop,
    /// When, nanoseconds of the run's clock.
    pub time_ns: i64,
    /// Where the robot really was, where it was simulated.
    pub truth: Option<Pose>,
}

/// The names of a recording's attachments, and of its records of names and values.
pub(super) mod names {
    pub(crate) const ROBOT: &str = "robot.toml";
    pub(crate) const MISSION: &str = "mission.toml";
    pub(crate) const WORLD: &str = "world.toml";
    pub(crate) const ABOUT: &str = "onbrick";
    pub(crate) const ENDING: &str = "onbrick.end";
}

/// Where a pose stands among names and values.
const START_POSE: [&str; 3] = ["start_x_m", "start_y_m", "start_heading_rad"];
const TRUTH: [&str; 3] = ["truth_x_m", "truth_y_m", "truth_heading_rad"];

pub(super) fn of_start(info: &Info) -> Metadata {
    let mut values = BTreeMap::new();
    let mut put = |key: &str, value: String| values.insert(key.to_owned(), value);
    put("version", info.version.clone());
    if let Some(run) = &info.run {
        put("run", run.clone());
    }
    put("brick", info.brick.clone());
    put("mission", info.mission.clone());
    for (key, value) in values_of(START_POSE, &info.start_pose) {
        put(key, value);
    }
    put("start_ns", info.start_ns.to_string());
    put("wall_offset_ns", info.wall_offset_ns.to_string());
    put("period_ns", info.period_ns.to_string());
    put("clock", if info.pace == Pace::Virtual { "virtual" } else { "monotonic" }.to_owned());
    put("seed", info.seed.to_string());
    put("cells", info.cells.to_string());
    put("board", info.board.name.to_owned());
    if info.method != Method::default() {
        put("method", info.method.word().to_owned());
    }
    for (name, value) in &info.settings {
        put(&format!("set.{name}"), value.to_string());
    }
    for quantity in &QUANTITIES {
        let name = serde_json::to_value(quantity.channel).unwrap_or_default();
        let said = format!("{}, {}", name.as_str().unwrap_or_default(), quantity.unit.symbol());
        put(&format!("channel.{}", quantity.channel as u8), said);
    }
    Metadata { name: names::ABOUT.to_owned(), metadata: values }
}

pub(super) fn of_end(end: &End) -> Metadata {
    let mut values = BTreeMap::new();
    let mut put = |key: &str, value: String| values.insert(key.to_owned(), value);
    if let Ok(Value::Object(fields)) = serde_json::to_value(&end.stop) {
        for (key, value) in &fields {
            put(key, value.as_str().unwrap_or_default().to_owned());
        }
    }
    put("time_ns", end.time_ns.to_string());
    if let Some(truth) = end.truth {
        for (key, value) in values_of(TRUTH, &truth) {
            put(key, value);
        }
    }
    Metadata { name: names::ENDING.to_owned(), metadata: values }
}

/// A recording may come from anywhere: its texts are made fit to be shown as they are read.
pub(super) fn fit(text: &str) -> String {
    printable::line(text).into_owned()
}

pub(super) fn info(metadata: &Metadata) -> Info {
    let text = |key: &str| metadata.metadata.get(key).map(|text| fit(text)).unwrap_or_default();
    let whole = |key: &str| text(key).parse().unwrap_or(0);
    let setting = |(key, value): (&String, &String)| {
        Some((fit(key.strip_prefix("set.")?), value.parse().ok()?))
    };
    Info {
        version: text("version"),
        run: metadata.metadata.get("run").map(|run| fit(run)),
        brick: text("brick"),
        mission: text("mission"),
        start_pose: pose_of(metadata, START_POSE).unwrap_or_default(),
        start_ns: whole("start_ns"),
        wall_offset_ns: whole("wall_offset_ns"),
        period_ns: whole("period_ns"),
        pace: if text("clock") == "virtual" { Pace::Virtual } else { Pace::Real },
        seed: text("seed").parse().unwrap_or_default(),
        cells: text("cells").parse().unwrap_or_default(),
        board: Platform::named(&text("board")).unwrap_or_default(),
        settings: metadata.metadata.iter().filter_map(setting).collect(),
        method: text("method").parse().unwrap_or_default(),
    }
}

pub(super) fn ending(metadata: &Metadata) -> Ending {
    let text = |key: &str| metadata.metadata.get(key).map(|text| fit(text)).unwrap_or_default();
    let fields = metadata.metadata.iter().map(|(key, value)| (fit(key), Value::String(fit(value))));
    Ending {
        stop: serde_json::from_value(Value::Object(fields.collect()))
            .unwrap_or_else(|_| StopReason::Unknown.into()),
        time_ns: text("time_ns").parse().unwrap_or(0),
        truth: pose_of(metadata, TRUTH),
    }
}

fn values_of(keys: [&'static str; 3], pose: &Pose) -> impl Iterator<Item = (&'static str, String)> {
    keys.into_iter().zip([pose.x_m, pose.y_m, pose.heading_rad].map(|value| value.to_string()))
}

fn pose_of(metadata: &Metadata, keys: [&str; 3]) -> Option<Pose> {
    let [x_m, y_m, heading_rad] =
        keys.map(|key| metadata.metadata.get(key).and_then(|value| value.parse().ok()));
    Some(Pose { x_m: x_m?, y_m: y_m?, heading_rad: heading_rad? })
}
