//! State machines: engine, conditions, missions.

use serde::{Deserialize, Serialize};

/// Where one machine is, and since when: enough to go on from.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct MachineState {
    /// Index of the active state in the machine's list.
    pub state: u16,
    /// When it was entered, nanoseconds of the run's clock.
    pub entered_ns: i64,
    /// Metres driven by then.
    pub entered_m: f64,
    /// Heading then, radians, not wrapped.
    pub entered_heading_rad: f64,
}

/// A transition that a machine took.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Taken {
    /// Index of the machine in the mission.
    pub machine: u16,
    /// Index of the state left.
    pub from: u16,
    /// Index of the state entered.
    pub to: u16,
    /// Index in the left state's list of transitions; `None` where the runtime moved the machine (`on_stall`).
    pub transition: Option<u16>,
}
