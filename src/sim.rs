//! The simulated brick.

mod physics;

pub use physics::{Bridge, MotorKind, Physics, Plug, STEP_NS, SensorKind};
