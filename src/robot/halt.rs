//! Stopping everything, whatever the robot is: for `onbrick halt`.

use std::sync::Arc;

use serde::Serialize;

use crate::clock::{Clock, MILLISECOND_NS};
use crate::ev3dev::{
    Class, DcCommand, DcMotor, DeviceError, FindError, Identity, StopAction, TachoCommand, Tree, devices,
};

/// A motor that was stopped.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Halted {
    /// Its port.
    pub address: String,
    /// Its driver.
    pub driver_name: String,
}
