//! The simulated brick: ev3dev's drivers over simulated motors and sensors.
//!
//! A [`Simulation`] owns a world ([`Physics`]) and, for each robot in it, the state of its drivers.
//! A [`SimBrick`] is one robot's files for programs in this process; it is a
//! [`Tree`](crate::ev3dev::Tree) like the file system of a real brick.
//!
//! `driver` says what a device answers, `brick` which devices there are, `simulation` when time
//! passes, `files` how a program of this process gets in, `mount` how one gets in that knows
//! nothing of us, `fault` what goes wrong on purpose, `view` what a person sees.
//!
//! # Not here
//!
//! NXT and I²C sensors, `raw` ports, the screen's grey levels, sampled sound. A sensor's values are
//! integers of whole frames; nothing is known of the electrical side of a port.

mod board;
mod body;
mod brick;
mod chance;
mod driver;
mod echo;
mod fault;
mod files;
mod motor;
mod mount;
mod physics;
mod ports;
mod sensors;
mod simulation;
mod view;
mod world;
mod world_physics;

pub use crate::ev3dev::Button;
pub use driver::input::EventLayout;
pub use driver::lcd::{BadGeometry, LcdGeometry};
pub use driver::sensor::GyroMake;
pub use driver::{Entry, EntryKind};
pub use echo::EchoModel;
pub use fault::{
    Act, ControlError, DeviceFault, FaultError, FaultRecord, Order, OrderError, Scenario,
};
pub use files::SimBrick;
pub use motor::{Motor, MotorConstants};
pub use mount::{Found, Mount, MountError, Remedy, Unfit};
pub use physics::{Bridge, Fault, MotorKind, Physics, Plug, STEP_NS, SensorKind};
pub use ports::Port;
pub use simulation::{MOST_BEHIND_NS, Options, Plugged, Simulation, Written};
#[cfg(feature = "host")]
pub(crate) use view::web_colour;
pub use view::{Beam, DeviceView, Mark, MarkKind, Paint, RobotView, Room, View, still};
pub use world::{Errors, OwnEcho, RobotModel, StartPose, World, covered};
pub use world_physics::{NoStartPose, Observer, Truth, WorldPhysics};
