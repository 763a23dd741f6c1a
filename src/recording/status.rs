//! How a run is going, for progress bars and status queries.

use serde::{Deserialize, Serialize};

use super::about::{MachineNames, Start};
use super::tick::TickRecord;
use crate::mapping::{Pose, Range};
use crate::senses::Channel;

/// What the log line begins with of what a mission tells people.
pub(super) const SAYS: &str = "says: ";

/// How a run is going, as the recorder saw it last.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Status {
    /// The last tick.
    pub tick: u64,
    /// Its time, nanoseconds of the run's clock.
    pub time_ns: i64,
    /// Time since the run's start, nanoseconds.
    pub elapsed_ns: i64,
    /// Where the robot is.
    pub pose: Pose,
    /// Metres driven.
    pub travelled_m: f64,
    /// What the range sensor said last, where there is one.
    #[serde(default)]
    pub range: Option<Range>,
    /// How many points the map has.
    pub points: u64,
    /// The state that each machine is in, by the machine's place in the mission: names.
    pub states: Vec<(String, String)>,
    /// What the mission tells people, line by line.
    #[serde(default)]
    pub said: Vec<String>,
    /// The mission's variables and what they are now, in the mission's order.
    #[serde(default)]
    pub variables: Vec<(String, f64)>,
    /// Battery, volts; `None` where it is not sensed.
    pub battery_v: Option<f64>,
    /// Ticks that came a whole period late or later.
    pub overruns: u64,
    /// The latest tick, nanoseconds after its deadline.
    pub latest_ns: i64,
    /// The last log line that is a warning or worse.
    #[serde(default)]
    pub warning: Option<String>,
    /// Entries that the recorder could not take.
    pub dropped: u32,
}

impl Status {
    pub(super) fn at_start(start: &Start) -> Self {
        let states = start.machines.iter().map(Self::begins).collect();
        Self {
            time_ns: start.info.start_ns,
            pose: start.info.start_pose,
            states,
            ..Self::default()
        }
    }

    /// A machine, and the state that it begins in.
    pub(super) fn begins(machine: &MachineNames) -> (String, String) {
        let state = machine.states.get(usize::from(machine.start));
        (machine.name.clone(), state.map_or_else(String::new, |state| state.name.clone()))
    }

    pub(super) fn note(&mut self, record: &TickRecord, start: &Start) {
        self.tick = record.senses.tick;
        self.time_ns = record.senses.time_ns;
        self.elapsed_ns = self.time_ns.saturating_sub(start.info.start_ns);
        self.pose = record.estimate.pose;
        self.travelled_m = record.estimate.travelled_m;
        self.overruns += u64::from(record.lateness_ns >= start.info.period_ns);
        self.latest_ns = self.latest_ns.max(record.lateness_ns);
        self.range = record.estimate.range;
        self.points += record.placed.len() as u64;
        self.battery_v = record.senses.get(Channel::Battery).map(|battery| battery.value);
    }

    pub(super) fn enter(&mut self, machine: u16, state: &str) {
        if let Some(place) = self.states.get_mut(usize::from(machine)) {
            state.clone_into(&mut place.1);
        }
    }
}
