//! Telling ports what is plugged in, on boards that do not find out by themselves.
//!
//! BrickPi3, BrickPi and PiStorms have no sensor until a port's mode and driver are written
//! (`brickpi3_ports_in.c`). `robot.toml` says both: the port, and the driver where a role can have
//! several sensors. Nothing is written to a port that has its sensor already.
//!
//! # Not here
//!
//! Motors: such a board has one on each output port from the start, plugged in or not.

use std::sync::Arc;

use super::bind::BindError;
use super::{RobotConfig, StopButton};
use crate::clock::{Clock, MILLISECOND_NS, SECOND_NS};
use crate::ev3dev::{
    Access, Class, Driver, FindError, Identity, LegoPort, Platform, PortAddress, Tree, devices,
};
use crate::senses::Role;

/// How long a sensor may take to be there, with files that can be written, nanoseconds: udev gives
/// the rights.
const PATIENCE_NS: i64 = 2 * SECOND_NS;

const LOOK_NS: i64 = 20 * MILLISECOND_NS;

/// Tells each port of a robot's sensors, and of its stop button, what is on it. Does nothing on a
/// board whose ports find out.
///
/// # Errors
///
/// [`BindError`] for a role without a port, and for a port that does not take it.
pub fn equip(
    tree: &Arc<dyn Tree>,
    config: &RobotConfig,
    clock: &dyn Clock,
) -> Result<(), BindError> {
    let platform = Platform::of(tree);
    if platform.detects {
        return Ok(());
    }
    for (role, port) in &config.sensors {
        let role_name = config.section(*role);
        let Some(driver) = config.driver_of(*role) else { continue };
        let Some(port) = port else {
            return Err(BindError::NoPort { role: role_name, board: platform.what });
        };
        equip_port(tree, port, driver, clock)
            .map_err(|source| BindError::Find { role: role_name, source })?;
    }
    if let Some(StopButton::Touch(port)) = &config.stop_button {
        equip_port(tree, port, Driver::Touch, clock)
            .map_err(|source| BindError::Find { role: "stop_button".to_owned(), source })?;
    }
    Ok(())
}

/// Tells one port which sensor is on it, and waits until that can be used.
///
/// # Errors
///
/// [`FindError`]: there is no such port, it does not take the sensor, or the sensor does not come.
pub fn equip_port(
    tree: &Arc<dyn Tree>,
    port: &PortAddress,
    driver: Driver,
    clock: &dyn Clock,
) -> Result<(), FindError> {
    if sensor(tree, port, driver)?.is_some() {
        return Ok(());
    }
    let lego = LegoPort::at(tree, port)?;
    if let Some(mode) = driver.port_mode() {
        lego.set_mode(mode)?;
    }
    // A touch sensor comes with the mode, and the PiStorms asks a serial one what it is.
    if sensor(tree, port, driver)?.is_none() {
        lego.set_device(driver.as_str())?;
    }
    let deadline_ns = clock.now_ns() + PATIENCE_NS;
    loop {
        let there = sensor(tree, port, driver)?;
        let mode = there.map(|identity| format!("{}/mode", identity.folder()));
        if mode.is_some_and(|mode| tree.open(&mode, Access::Write).is_ok()) {
            return Ok(());
        }
        if clock.now_ns() >= deadline_ns {
            let wanted = format!("{} on {port}", driver.what());
            return Err(FindError::Nothing { wanted, there: devices(tree, Class::LegoSensor)? });
        }
        clock.sleep_ns(LOOK_NS);
    }
}

fn sensor(
    tree: &Arc<dyn Tree>,
    port: &PortAddress,
    driver: Driver,
) -> Result<Option<Identity>, FindError> {
    let mut sensors = devices(tree, Class::LegoSensor)?.into_iter();
    Ok(sensors.find(|sensor| port.fits(&sensor.address) && sensor.known_driver() == Some(driver)))
}

impl RobotConfig {
    /// The driver of a role's sensor: what the file says, else the kind that is preferred.
    #[must_use]
    pub fn driver_of(&self, role: Role) -> Option<Driver> {
        self.drivers.get(&role).copied().or_else(|| self.kind(role).drivers().next())
    }
}
