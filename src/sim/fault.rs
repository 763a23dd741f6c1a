//! What is done to a simulated robot on purpose: loose plugs, broken sensors, flat batteries,
//! foreign hands, pressed buttons.
//!
//! A [`DeviceFault`] is put on a port ([`Simulation::inject`](super::Simulation::inject)) and stays
//! there, whatever is plugged in, until its end or until it is cleared. It has one text form, which
//! stands in control commands ([`Order::parse`]), in scenario files ([`Scenario`]) and in the
//! record of what was done ([`FaultRecord`]).
//!
//! Faults lie where they lie on a robot:
//!
//! - between a device and its driver (`stuck`, `wrong`, `jump`, `slow`, `delayed`, `off`, `block`):
//!   the driver believes what it gets, so the speed and the regulation of a motor with a stuck
//!   encoder go wrong as they would on the brick;
//! - between the driver and programs (`enxio`, `eio`, `intermittent`, `garbage` of a motor,
//!   `garbage text`, `denied`);
//! - at the plug (`unplug`, `plug`, `resync`);
//! - in another program's hands (`write`, `reset`).
//!
//! `kind` says what faults there are, `text` reads them, `scenario` orders them by time, `port`
//! does them, `schedule` keeps time and record.
//!
//! # Not here
//!
//! Errors of files on a disk, and processes that die. A world's own imperfections:
//! [`Errors`](super::Errors).
//!
//! # What we count on
//!
//! The same seed, scenario and calls give the same bytes: chance is drawn by simulated time, never
//! by how often a file is read.

mod kind;
mod port;
mod scenario;
mod schedule;
mod text;

pub use self::kind::DeviceFault;
pub(crate) use self::port::{PortFaults, Reading};
pub use self::scenario::Scenario;
pub use self::schedule::FaultRecord;
pub(crate) use self::schedule::Faults;
pub use self::text::{Act, Order, OrderError};
use super::ports::Port;
use crate::ev3dev::Button;
use nix::errno::Errno;

/// Why a fault could not be done. Nothing has changed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FaultError {
    /// Name another robot.
    #[error("there is no robot {}; there are {robots}", robot + 1)]
    NoRobot {
        /// Which was named, from 0.
        robot: usize,
        /// How many there are.
        robots: usize,
    },
    /// Put it elsewhere.
    #[error("the robot has no room at x {x_m} m, y {y_m} m: something is there, or the floor ends")]
    NoRoom {
        /// World frame, metres.
        x_m: f64,
        /// World frame, metres.
        y_m: f64,
    },
    /// Only some boards have buttons.
    #[error("the board has no buttons")]
    NoButtons,
    /// Move what stands there, another robot.
    #[error("something stands where the robot started")]
    Taken,
    /// Choose another fault or another port.
    #[error("`{fault}` does not fit {port}: {why}")]
    Unfit {
        /// Where.
        port: Port,
        /// What.
        fault: DeviceFault,
        /// Why not.
        why: &'static str,
    },
    /// The device did not take it: it is not there, or its driver refused.
    #[error("`{fault}` on {port} was refused")]
    Refused {
        /// Where.
        port: Port,
        /// What.
        fault: DeviceFault,
        /// The driver's answer.
        source: Errno,
    },
}

/// A control text that was not followed, none of it or not from some line on.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ControlError {
    /// The text is not understood; nothing was done.
    #[error(transparent)]
    Order(#[from] OrderError),
    /// An order could not be followed; those before it were.
    #[error(transparent)]
    Fault(#[from] FaultError),
}
