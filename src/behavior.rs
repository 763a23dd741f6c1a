//! State machines: a small engine, conditions as text, missions from TOML, their checks and their
//! graphs.
//!
//! [`missions`] shows by examples how missions are written. [`engine`] runs machines over any input
//! type and knows nothing of robots or files. [`expression`] is the language of conditions and of
//! the numbers in `do`. [`mission`] reads a mission file into machines, checks them as a whole, and
//! runs them on that same engine: each tick [`Signals`] go in and [`Demands`] come out. [`graph`]
//! draws a mission, [`shipped`] carries those that come with the program, [`submachines`] puts
//! those that a mission uses behind its text.
//!
//! # Not here
//!
//! No I/O and no clock: time is an argument, files are read by the caller. No limits of a robot: a
//! demand may be more than its motors can do, and the `robot` layer refuses or clips it.
//!
//! # What we count on
//!
//! - After construction a step allocates nothing.
//! - The same signals in the same order give the same states and demands, bit for bit.

use serde::{Deserialize, Serialize};

pub mod blackboard;
pub mod demands;
pub mod engine;
pub mod expression;
pub mod graph;
pub mod mission;
#[doc = include_str!("behavior/missions.md")]
pub mod missions {}
pub mod motion;
pub mod navigation;
pub mod shipped;
pub mod signals;
pub mod submachines;
mod telling;
pub mod tune;

pub use blackboard::{Blackboard, MAX_VARIABLES, MachineState, Scope, Since};
pub use demands::{Demands, Drive};
pub use engine::{EngineError, Finish, Progress};
pub use expression::Expression;
pub use graph::mermaid;
pub use mission::{
    MachinePlan, Mission, OnLost, Program, ProgramState, RegionPlan, SetError, StatePlan,
    TransitionPlan,
};
pub use motion::MotionLimits;
pub use signals::{Capabilities, Signal, Signals};

/// The most machines a mission may have: what is kept for each of them has a fixed place.
pub const MAX_MACHINES: usize = 8;

/// The most named motors a robot may have: with the wheels and the head, more than the brick has
/// outputs.
pub const MAX_MOTORS: usize = 4;

/// The most named sensors that a robot may have: one for each of the brick's inputs.
pub const MAX_SENSORS: usize = 4;

/// A transition that a machine took.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Taken {
    /// Index of the machine in the mission.
    pub machine: u16,
    /// Index of the state left.
    pub from: u16,
    /// Index of the state entered.
    pub to: u16,
    /// Index among the transitions that may be taken from the left state: those of all states, its
    /// own, and where it is inside others, those of the others before, from the outermost; `None`
    /// where the runtime moved the machine (`on_stall`).
    pub transition: Option<u16>,
}
