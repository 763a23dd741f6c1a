//! The simulated brick.

mod body;
mod chance;
mod motor;
mod physics;
mod sensors;
mod world;
mod world_physics;

pub use motor::{Motor, MotorConstants};
pub use physics::{Bridge, MotorKind, Physics, Plug, STEP_NS, SensorKind};
pub use world::{Colour, Errors, RobotModel, StartPose, World};
pub use world_physics::{Fault, NoStartPose, Observer, Truth, WorldPhysics};
