//! Motors: with a position (turning and linear), without one, and servos.
//!
//! They are different types, because they have different methods: [`TachoMotor`] and
//! [`LinearActuator`] are both a [`PositionMotor`], and each knows its own scale; [`DcMotor`] has a
//! duty cycle and nothing else; [`ServoMotor`] goes to a place and cannot say whether it is there.
//!
//! Dropping a motor stops it if a command of ours may still be running, unless
//! [`PositionMotor::release`] was said. A drop writes one kept file and neither waits nor panics;
//! it does not run when the process is killed, which is why missions move by leases (`run-timed`).

mod commanded;
mod dc;
mod position;
mod servo;
mod state;

pub use dc::DcMotor;
pub use position::{Linear, LinearActuator, MotorKind, PositionMotor, Rotary, TachoMotor};
pub use servo::ServoMotor;
pub use state::MotorState;
