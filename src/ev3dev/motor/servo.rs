//! Servos: class `servo-motor`, from I²C controllers of other makers; no port of the EV3 itself
//! makes one.

use std::sync::Arc;

use crate::ev3dev::address::PortAddress;
use crate::ev3dev::error::{DeviceError, FindError};
use crate::ev3dev::find::{Class, Identity, find};
use crate::ev3dev::node::{Attribute, AttributeSpec, Node, attributes};
use crate::ev3dev::tree::Tree;
use crate::ev3dev::value::{Legal, Value, Word};
use crate::ev3dev::words::{Polarity, ServoCommand};

use super::commanded::Commanded;
use super::state::MotorState;

/// A motor that goes to a place by itself and cannot say whether it is there.
#[derive(Debug)]
pub struct ServoMotor {
    node: Node,
    files: ServoFiles,
    identity: Identity,
    commanded: Commanded,
}

attributes! {
    /// The class's attributes.
    ServoFiles of [impl ServoMotor] {
        /// Where the servo is plugged in, as the kernel says now.
        pub readable "address" => address: PortAddress;
        /// What the servo's controller is.
        pub readable "driver_name" => driver_name: Word;
        writeable "command" => write_command: ServoCommand;
        /// Pulse for `position_sp` −100, µs.
        pub readwriteable "min_pulse_sp" => min_pulse_sp / set_min_pulse_sp: i32,
            Legal::Range(0, 1000);
        /// Pulse for `position_sp` 0, µs.
        pub readwriteable "mid_pulse_sp" => mid_pulse_sp / set_mid_pulse_sp: i32,
            Legal::Range(1000, 2000);
        /// Pulse for `position_sp` 100, µs.
        pub readwriteable "max_pulse_sp" => max_pulse_sp / set_max_pulse_sp: i32,
            Legal::Range(2000, 3000);
        /// Which way counts as positive; acts at once while running.
        pub readwriteable "polarity" => polarity / set_polarity: Polarity;
        /// Where to go, percent of the way from the middle to an end; acts at once while running.
        pub readwriteable "position_sp" => position_sp / set_position_sp: i32,
            Legal::Range(-100, 100);
        /// Time for the whole way, ms. Some controllers have none.
        pub readwriteable "rate_sp" => rate_sp / set_rate_sp: i32, Legal::NOT_NEGATIVE;
        /// Running or nothing.
        pub readable "state" => state: MotorState;
    }
}

impl ServoMotor {
    /// The servo at a port.
    ///
    /// # Errors
    ///
    /// [`FindError`], which names what is there instead.
    pub fn at(tree: &Arc<dyn Tree>, port: &PortAddress) -> Result<Self, FindError> {
        Self::find(tree, Some(port), None)
    }

    /// The one servo at `port`, if given, with the driver `driver`, if given.
    ///
    /// # Errors
    ///
    /// [`FindError`], which says what there is instead.
    pub fn find(
        tree: &Arc<dyn Tree>,
        port: Option<&PortAddress>,
        driver: Option<&str>,
    ) -> Result<Self, FindError> {
        Ok(Self::bind(tree, find(tree, Class::ServoMotor, port, driver)?))
    }

    /// The servo that was found as `identity`. Nothing is read from it or written to it.
    #[must_use]
    pub fn bind(tree: &Arc<dyn Tree>, identity: Identity) -> Self {
        let node = identity.node(tree);
        Self { node, files: ServoFiles::new(), identity, commanded: Commanded::new() }
    }

    /// What identifies the servo, as it was found.
    #[must_use]
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// Gives a command; repeating the present one does nothing.
    ///
    /// # Errors
    ///
    /// Any [`Cause`](crate::ev3dev::Cause) but `Malformed`.
    pub fn command(&self, command: ServoCommand) -> Result<(), DeviceError> {
        self.commanded.give(command == ServoCommand::Run, || self.write_command(command))
    }

    /// Whether dropping this servo lets it float if a command of ours may be running; it does
    /// unless told otherwise.
    pub fn set_floats_on_drop(&self, floats: bool) {
        self.commanded.set_ends_on_drop(floats);
    }

    /// Lets the servo go on as it is: dropping it changes nothing.
    pub fn release(self) {
        self.set_floats_on_drop(false);
    }
}

impl Drop for ServoMotor {
    fn drop(&mut self) {
        self.commanded.end(&self.node, &self.files.write_command, &ServoCommand::Float);
    }
}
