//! Motors without a position: class `dc-motor`. One appears when an output port is put into the
//! mode `dc-motor`.

use std::sync::Arc;

use crate::ev3dev::address::PortAddress;
use crate::ev3dev::error::{DeviceError, FindError};
use crate::ev3dev::find::{Class, Identity, find};
use crate::ev3dev::node::{Attribute, AttributeSpec, Node, attributes};
use crate::ev3dev::tree::Tree;
use crate::ev3dev::value::{Legal, Value, Word, Words};
use crate::ev3dev::words::{DcCommand, Polarity, StopAction};
use crate::units::Duty;

use super::commanded::Commanded;
use super::state::MotorState;

/// The longest ramp that the driver takes, ms (`dc_motor_class.c`).
const MAX_RAMP_MS: i64 = 10_000;

/// The longest timed run that the driver takes, ms.
const MAX_TIME_MS: i64 = 60_000;

/// A motor that has a duty cycle and no position.
#[derive(Debug)]
pub struct DcMotor {
    node: Node,
    files: DcFiles,
    identity: Identity,
    commanded: Commanded,
}

attributes! {
    /// The class's attributes.
    DcFiles of [impl DcMotor] {
        /// Where the motor is plugged in, as the kernel says now.
        pub readable "address" => address: PortAddress;
        /// What the motor is.
        pub readable "driver_name" => driver_name: Word;
        /// The commands that the driver takes.
        pub readable "commands" => commands: Words;
        writeable "command" => write_command: DcCommand;
        /// Duty cycle at the bridge now.
        pub readable "duty_cycle" => duty_cycle: Duty;
        /// Duty cycle for the next command; acts at once under `run-direct`.
        pub readwriteable "duty_cycle_sp" => duty_cycle_sp / set_duty_cycle_sp: Duty;
        /// Which way counts as positive, from the next command on.
        pub readwriteable "polarity" => polarity / set_polarity: Polarity;
        /// Time from 0 to 100 %, ms.
        pub readwriteable "ramp_up_sp" => ramp_up_sp / set_ramp_up_sp: i32,
            Legal::Range(0, MAX_RAMP_MS);
        /// Time from 100 % to 0, ms.
        pub readwriteable "ramp_down_sp" => ramp_down_sp / set_ramp_down_sp: i32,
            Legal::Range(0, MAX_RAMP_MS);
        /// What the motor is doing: running, ramping or nothing. This class never wakes a sleeper.
        pub readable "state" => state: MotorState;
        /// What happens at the end of a command, or at `stop`: coast or brake. It cannot be read
        /// back.
        pub writeable "stop_action" => set_stop_action: StopAction,
            Legal::Words(&["coast", "brake"]);
        /// The stop actions that the driver takes.
        pub readable "stop_actions" => stop_actions: Words;
        /// How long `run-timed` runs, ms.
        pub readwriteable "time_sp" => time_sp / set_time_sp: i32, Legal::Range(0, MAX_TIME_MS);
    }
}

impl DcMotor {
    /// The motor at a port.
    ///
    /// # Errors
    ///
    /// [`FindError`], which names what is there instead.
    pub fn at(tree: &Arc<dyn Tree>, port: &PortAddress) -> Result<Self, FindError> {
        Self::find(tree, Some(port), None)
    }

    /// The one motor at `port`, if given, with the driver `driver`, if given.
    ///
    /// # Errors
    ///
    /// [`FindError`], which says what there is instead.
    pub fn find(
        tree: &Arc<dyn Tree>,
        port: Option<&PortAddress>,
        driver: Option<&str>,
    ) -> Result<Self, FindError> {
        Ok(Self::bind(tree, find(tree, Class::DcMotor, port, driver)?))
    }

    /// The motor that was found as `identity`. Nothing is read from it or written to it.
    #[must_use]
    pub fn bind(tree: &Arc<dyn Tree>, identity: Identity) -> Self {
        let node = identity.node(tree);
        Self { node, files: DcFiles::new(), identity, commanded: Commanded::new() }
    }

    /// What identifies the motor, as it was found.
    #[must_use]
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// Gives a command: from now on the set points that were written before are in force.
    ///
    /// # Errors
    ///
    /// Any [`Cause`](crate::ev3dev::Cause) but `Malformed`.
    pub fn command(&self, command: DcCommand) -> Result<(), DeviceError> {
        self.commanded.give(command.drives(), || self.write_command(command))
    }

    /// The stop action that was set, now.
    ///
    /// # Errors
    ///
    /// As [`DcMotor::command`].
    pub fn stop(&self) -> Result<(), DeviceError> {
        self.command(DcCommand::Stop)
    }

    /// Whether dropping this motor stops it if a command of ours may be running; it does unless
    /// told otherwise.
    pub fn set_stops_on_drop(&self, stops: bool) {
        self.commanded.set_ends_on_drop(stops);
    }

    /// Lets the motor go on as it is: dropping it changes nothing.
    pub fn release(self) {
        self.set_stops_on_drop(false);
    }
}

impl Drop for DcMotor {
    fn drop(&mut self) {
        self.commanded.end(&self.node, &self.files.write_command, &DcCommand::Stop);
    }
}
