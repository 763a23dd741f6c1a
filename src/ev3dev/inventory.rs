//! Everything that is plugged in, with what it reads now: for a person who wants to know whether
//! the cables are right.
//!
//! Nothing is changed: no mode is set, no command is given. A device that cannot be read is listed
//! with its problem.

use std::sync::Arc;

use serde::Serialize;

use super::battery::Battery;
use super::error::{DeviceError, FindError};
use super::find::{Class, Identity, devices};
use super::motor::{DcMotor, LinearActuator, MotorKind, PositionMotor, ServoMotor, TachoMotor};
use super::platform::Platform;
use super::port::LegoPort;
use super::sensor::Sensor;
use super::tree::Tree;

/// Everything that is plugged in.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Inventory {
    /// Devices by class, then in the order in which they were plugged in; the ports last.
    pub devices: Vec<Entry>,
    /// The battery; none where the machine is no brick.
    pub battery: Option<Entry>,
}

/// One device.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Entry {
    /// Its class.
    pub class: &'static str,
    /// Its folder in the class.
    pub name: String,
    /// Where it is plugged in; empty for the battery.
    pub address: String,
    /// What it is; empty for the battery.
    pub driver: String,
    /// What it reads.
    pub readings: Vec<LiveValue>,
    /// Why it could not be read, or not to the end.
    pub problem: Option<String>,
}

/// What a device reads.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LiveValue {
    /// What it is: an attribute's name, or the sensor's mode.
    pub name: String,
    /// The value as text.
    pub value: String,
    /// Its unit, as the driver writes it for sensors; may be empty.
    pub unit: String,
}

impl Inventory {
    /// Whether there is nothing of a brick at all. A brick with nothing plugged in has its ports.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.devices.is_empty() && self.battery.is_none()
    }

    /// Looks at everything.
    ///
    /// # Errors
    ///
    /// [`FindError::Unlisted`] and [`FindError::Device`] where a class cannot even be listed.
    pub fn read(tree: &Arc<dyn Tree>) -> Result<Self, FindError> {
        let mut entries = Vec::new();
        for &class in Class::ALL {
            entries.extend(devices(tree, class)?.into_iter().map(|identity| entry(tree, identity)));
        }
        let battery = match Battery::open(tree, Platform::of(tree)) {
            Err(error) if error.is_gone() => None,
            battery => Some(battery_entry(battery)),
        };
        Ok(Self { devices: entries, battery })
    }
}

fn entry(tree: &Arc<dyn Tree>, identity: Identity) -> Entry {
    let mut entry = Entry {
        class: identity.class.as_str(),
        name: identity.name.clone(),
        address: identity.address.as_str().to_owned(),
        driver: identity.driver.to_string(),
        ..Entry::default()
    };
    let readings = &mut entry.readings;
    let outcome = match identity.class {
        Class::TachoMotor if identity.is_linear() => {
            LinearActuator::bind(tree, identity).and_then(|motor| position_motor(&motor, readings))
        }
        Class::TachoMotor => {
            TachoMotor::bind(tree, identity).and_then(|motor| position_motor(&motor, readings))
        }
        Class::DcMotor => dc_motor(&DcMotor::bind(tree, identity), readings),
        Class::ServoMotor => servo_motor(&ServoMotor::bind(tree, identity), readings),
        Class::LegoSensor => {
            Sensor::bind(tree, identity).and_then(|sensor| sensor_values(&sensor, readings))
        }
        Class::LegoPort => {
            LegoPort::bind(tree, identity).and_then(|port| port_status(&port, readings))
        }
    };
    entry.problem = outcome.err().map(|error| error.to_string());
    entry
}

fn position_motor<K: MotorKind>(
    motor: &PositionMotor<K>,
    readings: &mut Vec<LiveValue>,
) -> Result<(), DeviceError> {
    readings.push(live("position", motor.position()?, "counts"));
    readings.extend(known(motor.speed())?.map(|speed| live("speed", speed, "counts/s")));
    let duty = known(motor.duty_cycle())?;
    readings.extend(duty.map(|duty| live("duty_cycle", duty.percent(), "%")));
    readings.push(live("state", motor.state()?, ""));
    Ok(())
}

fn dc_motor(motor: &DcMotor, readings: &mut Vec<LiveValue>) -> Result<(), DeviceError> {
    readings.push(live("duty_cycle", motor.duty_cycle()?.percent(), "%"));
    readings.push(live("state", motor.state()?, ""));
    Ok(())
}

fn servo_motor(motor: &ServoMotor, readings: &mut Vec<LiveValue>) -> Result<(), DeviceError> {
    readings.push(live("position_sp", motor.position_sp()?, "%"));
    readings.push(live("state", motor.state()?, ""));
    Ok(())
}

fn sensor_values(sensor: &Sensor, readings: &mut Vec<LiveValue>) -> Result<(), DeviceError> {
    let mode = sensor.mode();
    // More values than these have no files.
    for index in 0..mode.num_values.min(8) {
        readings.push(live(&mode.name, sensor.value(index)?, &mode.units));
    }
    Ok(())
}

fn port_status(port: &LegoPort, readings: &mut Vec<LiveValue>) -> Result<(), DeviceError> {
    readings.push(live("mode", port.mode()?, ""));
    readings.push(live("status", port.status()?, ""));
    Ok(())
}

fn battery_entry(battery: Result<Battery, DeviceError>) -> Entry {
    let mut readings = Vec::new();
    let outcome = battery.and_then(|battery| {
        readings.push(live("voltage", battery.voltage_v()?, "V"));
        readings.extend(known(battery.current_a())?.map(|amperes| live("current", amperes, "A")));
        readings.extend(known(battery.technology())?.map(|cells| live("technology", cells, "")));
        Ok(())
    });
    let problem = outcome.err().map(|error| error.to_string());
    let name = "battery".to_owned();
    Entry { class: "power_supply", name, readings, problem, ..Entry::default() }
}

/// What a driver may not have: on other boards than the EV3 the PiStorms' motors have no speed, and
/// few batteries a current.
fn known<T>(read: Result<T, DeviceError>) -> Result<Option<T>, DeviceError> {
    match read {
        Err(error) if error.is_absent() => Ok(None),
        read => read.map(Some),
    }
}

fn live(name: &str, value: impl ToString, unit: &str) -> LiveValue {
    LiveValue { name: name.to_owned(), value: value.to_string(), unit: unit.to_owned() }
}
