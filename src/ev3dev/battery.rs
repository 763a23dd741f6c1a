//! The brick's battery: class `power_supply`.

use std::sync::Arc;

use nix::errno::Errno;

use super::error::{Cause, DeviceError};
use super::node::{Attribute, AttributeSpec, Node, attributes};
use super::platform::Platform;
use super::tree::Tree;
use super::value::{Value, Word};
use super::words::Technology;

/// Above this a design voltage can only be the driver's slip, which gives lithium and alkaline
/// cells ten times theirs (84 and 90 V).
const SLIP_UV: i32 = 20_000_000;

/// The brick's battery. Readings are of the moment: they sag while motors work.
#[derive(Debug)]
pub struct Battery {
    node: Node,
    files: BatteryFiles,
}

attributes! {
    /// The class's attributes.
    BatteryFiles of [impl Battery] {
        readable "voltage_now" => voltage_now: i32;
        readable "current_now" => current_now: i32;
        readable "voltage_max_design" => voltage_max_design: i32;
        readable "voltage_min_design" => voltage_min_design: i32;
        readwriteable "technology" => read_technology / write_technology: Technology;
        /// What kind of supply it is: `Battery`.
        pub readable "type" => kind: Word;
        /// What it supplies: `System`.
        pub readable "scope" => scope: Word;
    }
}

impl Battery {
    /// A board's battery or, without one, the battery whose name ends with `-battery`.
    ///
    /// # Errors
    ///
    /// [`Cause::Gone`] where there is none: this machine is no brick.
    pub fn open(tree: &Arc<dyn Tree>, platform: &Platform) -> Result<Self, DeviceError> {
        let usual = platform.battery;
        let names = tree.list("sys/class/power_supply").unwrap_or_default();
        let mut others: Vec<&String> =
            names.iter().filter(|name| name.ends_with("-battery")).collect();
        others.sort();
        let name = if names.iter().any(|name| name == usual) {
            usual
        } else {
            others.first().map_or(usual, |name| name)
        };
        let node = Node::new(tree, &format!("sys/class/power_supply/{name}"), None);
        match tree.list(&node.folder) {
            Ok(_) => Ok(Self { node, files: BatteryFiles::new() }),
            Err(Errno::ENOENT) => Err(node.error("voltage_now", None, Cause::Gone(Errno::ENOENT))),
            Err(errno) => Err(node.error("voltage_now", None, Cause::Other(errno))),
        }
    }

    /// Voltage, volts, in steps of about 10 mV.
    ///
    /// # Errors
    ///
    /// [`Cause::Other`] with ENODATA or EAGAIN while nothing has been measured yet.
    pub fn voltage_v(&self) -> Result<f64, DeviceError> {
        Ok(from_micro(self.voltage_now()?))
    }

    /// Current that is drawn, amperes, in steps of about 6.5 mA; never negative.
    ///
    /// # Errors
    ///
    /// As [`Battery::voltage_v`].
    pub fn current_a(&self) -> Result<f64, DeviceError> {
        Ok(from_micro(self.current_now()?))
    }

    /// What kind of cells there are.
    ///
    /// # Errors
    ///
    /// What reading gives.
    pub fn technology(&self) -> Result<Technology, DeviceError> {
        self.read_technology()
    }

    /// Says that the unknown AA cells are rechargeable ones.
    ///
    /// # Errors
    ///
    /// [`Cause::Refused`] unless they are unknown.
    pub fn set_rechargeable(&self) -> Result<(), DeviceError> {
        self.write_technology(Technology::NiMh)
    }

    /// Voltage when full, volts: the driver's number, a tenth of it where it has slipped.
    ///
    /// # Errors
    ///
    /// What reading gives.
    pub fn full_v(&self) -> Result<f64, DeviceError> {
        Ok(design_v(self.voltage_max_design()?))
    }

    /// Voltage when empty, volts: the driver's number, a tenth of it where it has slipped.
    ///
    /// # Errors
    ///
    /// What reading gives.
    pub fn empty_v(&self) -> Result<f64, DeviceError> {
        Ok(design_v(self.voltage_min_design()?))
    }
}

fn from_micro(number: i32) -> f64 {
    f64::from(number) / 1e6
}

fn design_v(microvolts: i32) -> f64 {
    if microvolts > SLIP_UV { from_micro(microvolts) / 10.0 } else { from_micro(microvolts) }
}
