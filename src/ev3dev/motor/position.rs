//! Motors with a position: class `tacho-motor`.
//!
//! # What we count on
//!
//! - Every command copies all set points; set points written later wait for the next command, but
//!   for `duty_cycle_sp` under `run-direct`.
//! - Polarity is the kernel's business: it turns set points and readings round.
//! - After plug-in `position` need not be 0, and set points are whatever a former program left:
//!   write `reset` on start.

use std::fmt::Debug;
use std::sync::Arc;
use std::time::Duration;

use crate::ev3dev::address::PortAddress;
use crate::ev3dev::error::{DeviceError, FindError};
use crate::ev3dev::find::{Class, Identity, find_where};
use crate::ev3dev::node::{Attribute, AttributeSpec, Node, attributes};
use crate::ev3dev::tree::Tree;
use crate::ev3dev::value::{Legal, Value, Word, Words};
use crate::ev3dev::words::{Polarity, StopAction, TachoCommand};
use crate::units::Duty;

use super::commanded::Commanded;
use super::state::MotorState;

/// The longest ramp that the driver takes, ms (`tacho_motor_class.c`).
const MAX_RAMP_MS: i64 = 60_000;

/// A motor whose position is measured in counts; `K` is what its counts mean.
///
/// Speeds are in counts per second; of the LEGO motors a count is a degree.
#[derive(Debug)]
pub struct PositionMotor<K: MotorKind> {
    node: Node,
    files: TachoFiles,
    identity: Identity,
    kind: K,
    max_speed: i32,
    commanded: Commanded,
}

/// A motor that turns.
pub type TachoMotor = PositionMotor<Rotary>;

/// A motor that pushes and pulls.
pub type LinearActuator = PositionMotor<Linear>;

/// What a motor's counts mean: [`Rotary`] or [`Linear`]. No other crate can add one.
pub trait MotorKind: kind::Sealed + Debug {
    /// What a device of this kind is called in messages.
    const WHAT: &'static str;

    /// The table's rows that only this kind has.
    const OWN_ATTRIBUTES: &'static [AttributeSpec];
}

mod kind {
    use std::sync::Arc;

    use super::{DeviceError, Identity, Tree};

    /// How a kind is told from the other, and bound.
    pub trait Sealed: Sized {
        fn fits(identity: &Identity) -> bool;
        fn bind(tree: &Arc<dyn Tree>, identity: &Identity) -> Result<Self, DeviceError>;
    }
}

attributes! {
    /// What every motor with a position has.
    TachoFiles of [impl<K: MotorKind> PositionMotor<K>] {
        /// Where the motor is plugged in, as the kernel says now.
        pub readable "address" => address: PortAddress;
        /// What the motor is.
        pub readable "driver_name" => driver_name: Word;
        /// The commands that the driver takes.
        pub readable "commands" => commands: Words;
        writeable "command" => write_command: TachoCommand;
        /// The highest `speed_sp`, counts per second, read each time.
        pub readable "max_speed" => read_max_speed: i32;
        /// Position, counts. Writing moves the zero, not the motor; while it holds, the motor jumps
        /// by the difference.
        pub readwriteable "position" => position / set_position: i32;
        /// Where `run-to-*` go, counts.
        pub readwriteable "position_sp" => position_sp / set_position_sp: i32;
        /// Speed, counts per second, the mean over about 20 ms.
        pub readable "speed" => speed: i32;
        /// Speed for the next command, counts per second, within ±`max_speed`.
        pub readwriteable "speed_sp" => speed_sp / set_speed_sp: i32;
        /// Duty cycle at the bridge now.
        pub readable "duty_cycle" => duty_cycle: Duty;
        /// Duty cycle for `run-direct`; acts at once while that command runs.
        pub readwriteable "duty_cycle_sp" => duty_cycle_sp / set_duty_cycle_sp: Duty;
        /// How long `run-timed` runs, ms from its command.
        pub readwriteable "time_sp" => time_sp / set_time_sp: i32, Legal::NOT_NEGATIVE;
        /// Time from rest to `max_speed`, ms.
        pub readwriteable "ramp_up_sp" => ramp_up_sp / set_ramp_up_sp: i32,
            Legal::Range(0, MAX_RAMP_MS);
        /// Time from `max_speed` to rest, ms.
        pub readwriteable "ramp_down_sp" => ramp_down_sp / set_ramp_down_sp: i32,
            Legal::Range(0, MAX_RAMP_MS);
        /// Which way counts as positive. Set it before the set points.
        pub readwriteable "polarity" => polarity / set_polarity: Polarity;
        /// The stop actions that the driver takes.
        pub readable "stop_actions" => stop_actions: Words;
        /// What happens at the end of a command, or at `stop`.
        pub readwriteable "stop_action" => stop_action / set_stop_action: StopAction;
        /// What the motor is doing, not older than 2 ms.
        pub readable "state" => state: MotorState;
        /// Proportional gain of the speed regulator; acts at once.
        pub readwriteable "speed_pid/Kp" => speed_kp / set_speed_kp: i32, Legal::NOT_NEGATIVE;
        /// Integral gain of the speed regulator; acts at once.
        pub readwriteable "speed_pid/Ki" => speed_ki / set_speed_ki: i32, Legal::NOT_NEGATIVE;
        /// Derivative gain of the speed regulator; acts at once.
        pub readwriteable "speed_pid/Kd" => speed_kd / set_speed_kd: i32, Legal::NOT_NEGATIVE;
        /// Proportional gain of the hold regulator; acts at once.
        pub readwriteable "hold_pid/Kp" => hold_kp / set_hold_kp: i32, Legal::NOT_NEGATIVE;
        /// Integral gain of the hold regulator; acts at once.
        pub readwriteable "hold_pid/Ki" => hold_ki / set_hold_ki: i32, Legal::NOT_NEGATIVE;
        /// Derivative gain of the hold regulator; acts at once.
        pub readwriteable "hold_pid/Kd" => hold_kd / set_hold_kd: i32, Legal::NOT_NEGATIVE;
    }
}

impl<K: MotorKind> PositionMotor<K> {
    /// The motor of this kind at a port.
    ///
    /// # Errors
    ///
    /// [`FindError`], which names what is there instead.
    pub fn at(tree: &Arc<dyn Tree>, port: &PortAddress) -> Result<Self, FindError> {
        Self::find(tree, Some(port), None)
    }

    /// The one motor of this kind at `port`, if given, with the driver `driver`, if given.
    ///
    /// # Errors
    ///
    /// [`FindError`], which says what there is instead.
    pub fn find(
        tree: &Arc<dyn Tree>,
        port: Option<&PortAddress>,
        driver: Option<&str>,
    ) -> Result<Self, FindError> {
        let fits = |identity: &Identity| {
            K::fits(identity) && driver.is_none_or(|driver| identity.driver.as_str() == driver)
        };
        let identity = find_where(tree, Class::TachoMotor, port, driver.unwrap_or(K::WHAT), fits)?;
        Ok(Self::bind(tree, identity)?)
    }

    /// The motor that was found as `identity`. Nothing is written to it.
    ///
    /// # Errors
    ///
    /// Whatever comes of reading its scale and its highest speed.
    pub fn bind(tree: &Arc<dyn Tree>, identity: Identity) -> Result<Self, DeviceError> {
        let node = identity.node(tree);
        let files = TachoFiles::new();
        let max_speed = scale(&files.read_max_speed, &node)?;
        files.speed_sp.limit(-i64::from(max_speed), i64::from(max_speed));
        let kind = K::bind(tree, &identity)?;
        Ok(Self { node, files, identity, kind, max_speed, commanded: Commanded::new() })
    }

    /// What identifies the motor, as it was found.
    #[must_use]
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// The highest `speed_sp`, counts per second: a constant of the driver's, not of the battery.
    #[must_use]
    pub fn max_speed(&self) -> i32 {
        self.max_speed
    }

    /// Gives a command: from now on the set points that were written before are in force.
    ///
    /// # Errors
    ///
    /// [`Cause::Refused`](crate::ev3dev::Cause::Refused) for a command that this driver does not
    /// have; any other but `Malformed`.
    pub fn command(&self, command: TachoCommand) -> Result<(), DeviceError> {
        self.commanded.give(command.drives(), || self.write_command(command))
    }

    /// The stop action that was set, now.
    ///
    /// # Errors
    ///
    /// As [`PositionMotor::command`].
    pub fn stop(&self) -> Result<(), DeviceError> {
        self.command(TachoCommand::Stop)
    }

    /// What comes nearest to a stop action among those that the driver has: where it cannot brake,
    /// as on a BrickPi, the motor holds its position. A driver that does not say what it has gets
    /// the action itself.
    #[must_use]
    pub fn nearest_action(&self, wanted: StopAction) -> StopAction {
        let has = |action: StopAction| {
            self.stop_actions().map_or(true, |actions| actions.contains(action.as_str()))
        };
        let others = [StopAction::Hold, StopAction::Coast];
        if has(wanted) { wanted } else { others.into_iter().find(|it| has(*it)).unwrap_or(wanted) }
    }

    /// Whether a command could be written; nothing is.
    ///
    /// # Errors
    ///
    /// [`Cause::Other`](crate::ev3dev::Cause::Other) with EACCES for a user who is not in the group
    /// `ev3dev`.
    pub fn check_writable(&self) -> Result<(), DeviceError> {
        self.files.write_command.open_for_writing(&self.node)
    }

    /// Coasts and puts everything back to its default, the position to 0.
    ///
    /// # Errors
    ///
    /// As [`PositionMotor::command`].
    pub fn reset(&self) -> Result<(), DeviceError> {
        self.command(TachoCommand::Reset)
    }

    /// Waits until `state` may have changed since it was last read, or until `timeout`; true if it
    /// may have. The driver looks every 50 ms, and never wakes a sleeper whose cable is pulled, so
    /// keep the timeout below 100 ms and read the state anyway.
    ///
    /// # Errors
    ///
    /// What `poll` answers.
    pub fn wait_state_changed(&self, timeout: Duration) -> Result<bool, DeviceError> {
        self.files.state.wait_changed(&self.node, timeout)
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

impl<K: MotorKind> Drop for PositionMotor<K> {
    fn drop(&mut self) {
        self.commanded.end(&self.node, &self.files.write_command, &TachoCommand::Stop);
    }
}

/// Counts of a shaft.
#[derive(Debug)]
pub struct Rotary {
    count_per_rot: i32,
}

/// Counts of a rod.
#[derive(Debug)]
pub struct Linear {
    count_per_m: i32,
    full_travel_count: i32,
}

const COUNT_PER_ROT: AttributeSpec = AttributeSpec::readable("count_per_rot", Legal::Number);
const COUNT_PER_M: AttributeSpec = AttributeSpec::readable("count_per_m", Legal::Number);
const FULL_TRAVEL_COUNT: AttributeSpec =
    AttributeSpec::readable("full_travel_count", Legal::Number);

/// What everything else is measured by, so at least 1: nothing can be made of a driver that says
/// otherwise.
fn scale(attribute: &Attribute<i32>, node: &Node) -> Result<i32, DeviceError> {
    const LEGAL: Legal = Legal::Range(1, i32::MAX as i64);
    let value = attribute.read(node)?;
    if value >= 1 { Ok(value) } else { Err(attribute.malformed(node, &value.to_string(), LEGAL)) }
}

impl MotorKind for Rotary {
    const WHAT: &'static str = "motor";
    const OWN_ATTRIBUTES: &'static [AttributeSpec] = &[COUNT_PER_ROT];
}

impl MotorKind for Linear {
    const WHAT: &'static str = "linear actuator";
    const OWN_ATTRIBUTES: &'static [AttributeSpec] = &[COUNT_PER_M, FULL_TRAVEL_COUNT];
}

impl kind::Sealed for Rotary {
    fn fits(identity: &Identity) -> bool {
        !Linear::fits(identity)
    }

    fn bind(tree: &Arc<dyn Tree>, identity: &Identity) -> Result<Self, DeviceError> {
        Ok(Self { count_per_rot: scale(&Attribute::new(COUNT_PER_ROT), &identity.node(tree))? })
    }
}

impl kind::Sealed for Linear {
    fn fits(identity: &Identity) -> bool {
        identity.is_linear()
    }

    fn bind(tree: &Arc<dyn Tree>, identity: &Identity) -> Result<Self, DeviceError> {
        let node = &identity.node(tree);
        Ok(Self {
            count_per_m: scale(&Attribute::new(COUNT_PER_M), node)?,
            full_travel_count: Attribute::new(FULL_TRAVEL_COUNT).read(node)?,
        })
    }
}

impl TachoMotor {
    /// Counts in one turn of the shaft; fixed by the driver, 360 for LEGO's motors.
    #[must_use]
    pub fn count_per_rot(&self) -> i32 {
        self.kind.count_per_rot
    }
}

impl LinearActuator {
    /// Counts in one metre of travel; fixed by the driver.
    #[must_use]
    pub fn count_per_m(&self) -> i32 {
        self.kind.count_per_m
    }

    /// Counts from one end to the other; fixed by the driver.
    #[must_use]
    pub fn full_travel_count(&self) -> i32 {
        self.kind.full_travel_count
    }
}
