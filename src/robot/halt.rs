//! Stopping everything, whatever the robot is: for `onbrick halt`.

use std::sync::Arc;

use serde::Serialize;

use crate::clock::{Clock, MILLISECOND_NS};
use crate::ev3dev::{
    Class, DcMotor, DeviceError, FindError, Identity, StopAction, TachoMotor, Tree, devices,
};

/// A motor that was stopped.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Halted {
    /// Its port.
    pub address: String,
    /// Its driver.
    pub driver_name: String,
}

/// Stops every motor there is, ours or not: stop action brake, then `stop`.
///
/// # Errors
///
/// The first motor that does not take it; all others have been told by then.
pub fn halt(tree: &Arc<dyn Tree>) -> Result<Vec<Halted>, HaltError> {
    let mut halted = Vec::new();
    let mut failed = None;
    for identity in motors(tree)? {
        match stop(tree, &identity) {
            Ok(()) => halted.push(Halted {
                address: identity.address.to_string(),
                driver_name: identity.driver.to_string(),
            }),
            // A motor that was unplugged meanwhile is still.
            Err(error) if error.is_gone() => {}
            Err(error) => failed = failed.or(Some(error)),
        }
    }
    failed.map_or(Ok(halted), |error| Err(error.into()))
}

/// Why not every motor could be stopped.
#[derive(Debug, thiserror::Error)]
pub enum HaltError {
    /// The motors cannot even be listed.
    #[error(transparent)]
    Find(#[from] FindError),
    /// A motor did not take the command.
    #[error(transparent)]
    Device(#[from] DeviceError),
}

/// Watches for `watch_ns` and names the motors that turn at the end of it, by port and how far they went, in counts.
///
/// # Errors
///
/// [`HaltError`].
pub fn watch_still(tree: &Arc<dyn Tree>, clock: &dyn Clock, watch_ns: i64) -> Result<Vec<String>, HaltError> {
    /// A braked motor may settle between two counts.
    const STILL_COUNTS: i32 = 1;
    // What rolls out after `stop` is over by then: 0.2 s on the real motor model.
    clock.sleep_until_ns(clock.now_ns() + 300 * MILLISECOND_NS);
    let mut before = Vec::new();
    for identity in devices(tree, Class::TachoMotor)? {
        let motor = TachoMotor::bind(tree, identity)?;
        let position = motor.position()?;
        before.push((motor, position));
    }
    clock.sleep_until_ns(clock.now_ns() + watch_ns);
    let mut moving = Vec::new();
    for (motor, position) in &before {
        let moved = motor.position()?.wrapping_sub(*position);
        if moved.abs() > STILL_COUNTS {
            moving.push(format!("{} ({moved} counts)", motor.identity().address));
        }
    }
    Ok(moving)
}

fn motors(tree: &Arc<dyn Tree>) -> Result<Vec<Identity>, FindError> {
    let mut all = devices(tree, Class::TachoMotor)?;
    all.extend(devices(tree, Class::DcMotor)?);
    Ok(all)
}

fn stop(tree: &Arc<dyn Tree>, identity: &Identity) -> Result<(), DeviceError> {
    if identity.class == Class::DcMotor {
        let motor = DcMotor::bind(tree, identity.clone());
        motor.set_stop_action(StopAction::Brake)?;
        return motor.stop();
    }
    let motor = TachoMotor::bind(tree, identity.clone())?;
    // A ramp would let it roll on.
    motor.set_ramp_down_sp(0)?;
    motor.set_ramp_up_sp(0)?;
    motor.set_stop_action(StopAction::Brake)?;
    motor.stop()
}
