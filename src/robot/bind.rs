//! From roles to devices.

use std::sync::Arc;

use crate::behavior::Role;
use crate::ev3dev::{
    BUTTONS_PATH, Battery, Buttons, ColourMode, ColourSensor, DeviceError, FindError, GyroMode, InfraredMode,
    PortAddress, SOUND_PATH, SensorMode, Sound, StatusLights, TachoMotor, TouchMode, Tree, TypedSensor,
    UltrasonicMode,
};

use super::{Channel, LeasedMotor, MotorRole, RangeRole, RangeSensor, Robot, RobotConfig};

/// Why a role could not be bound to a device.
#[derive(Debug, thiserror::Error)]
pub enum BindError {
    /// Nothing fits, or too much: plug it in, or change `robot.toml` (`onbrick setup`).
    #[error("{role}")]
    Find {
        /// The role, as `robot.toml` calls it.
        role: String,
        /// What was looked for and what is there.
        source: FindError,
    },
    /// The device is there and does not do what it is told.
    #[error("{role}")]
    Device {
        /// The role, as `robot.toml` calls it.
        role: String,
        /// What it answered.
        source: DeviceError,
    },
}

impl Robot {
    /// Finds a device for each role, puts sensors into the modes that `roles` need, and takes the motors over (`reset`, then the
    /// settings of a lease). Nothing turns.
    ///
    /// Values may be stale for [`Robot::settle_ns`] from now on. Writing a mode waits for the sensor: up to half a second each.
    ///
    /// # Errors
    ///
    /// [`BindError`] with the role; it says what is plugged in instead.
    pub fn bind(tree: &Arc<dyn Tree>, config: &RobotConfig, roles: &[Role]) -> Result<Self, BindError> {
        let mut settle_ns = 0;
        let mut settle = |ns: i64| settle_ns = settle_ns.max(ns);
        let left = motor(tree, "drive.left", &config.left, config.max_wheel_rad_s)?;
        let right = motor(tree, "drive.right", &config.right, config.max_wheel_rad_s)?;
        let head = config.head.as_ref().map(|head| motor(tree, "head", &head.motor, head.speed_rad_s));
        let motors = config
            .motors
            .iter()
            .map(|named| motor(tree, &format!("motor.{}", named.name), &named.motor, named.max_rad_s));
        let range = config.range.as_ref().map(|role| range_sensor(tree, role, &mut settle));
        let gyro = config
            .gyro
            .as_ref()
            .map(|role| sensor(tree, "gyro", role.port.as_ref(), GyroMode::Angle, &mut settle));
        let touch = config
            .touch
            .as_ref()
            .map(|role| sensor(tree, "touch", role.port.as_ref(), TouchMode::Touch, &mut settle));
        let reflect = roles.contains(&Role::Reflect);
        let (mode, channel) = if reflect {
            (ColourMode::Reflect, Channel::Reflect)
        } else {
            (ColourMode::Colour, Channel::Colour)
        };
        let colour = config.colour.as_ref().map(|role| -> Result<(ColourSensor, Channel), BindError> {
            Ok((sensor(tree, "colour", role.port.as_ref(), mode, &mut settle)?, channel))
        });
        let remote = config
            .remote
            .as_ref()
            .map(|role| sensor(tree, "remote", role.port.as_ref(), InfraredMode::Remote, &mut settle));
        // What is not a role of the mission may be missing: a test bench has no battery, a simulated brick no loudspeaker.
        let battery = Battery::open(tree).ok();
        let mut config = config.clone();
        // Cells that cannot be asked are taken for the usual ones.
        config.battery.cells =
            battery.as_ref().and_then(|battery| battery.technology().ok()).unwrap_or_default();
        Ok(Self {
            config,
            left,
            right,
            head: head.transpose()?,
            motors: motors.collect::<Result<_, _>>()?,
            range: range.transpose()?,
            gyro: gyro.transpose()?,
            touch: touch.transpose()?,
            colour: colour.transpose()?,
            remote: remote.transpose()?,
            battery,
            battery_due_ns: 0,
            buttons: Buttons::open(tree, BUTTONS_PATH),
            lights: StatusLights::open(tree).ok(),
            sound: Sound::open(tree, SOUND_PATH).ok(),
            led: None,
            tone_hz: None,
            head_rad: None,
            trouble: None,
            refused: None,
            settle_ns,
        })
    }
}

fn motor(
    tree: &Arc<dyn Tree>,
    role: &str,
    wanted: &MotorRole,
    max_rad_s: f64,
) -> Result<LeasedMotor, BindError> {
    let motor =
        TachoMotor::find(tree, wanted.port.as_ref(), None).map_err(|source| find_error(role, source))?;
    LeasedMotor::take(motor, wanted.ratio, max_rad_s).map_err(|source| device_error(role, source))
}

fn sensor<M: SensorMode>(
    tree: &Arc<dyn Tree>,
    role: &str,
    port: Option<&PortAddress>,
    mode: M,
    settle: &mut impl FnMut(i64),
) -> Result<TypedSensor<M>, BindError> {
    let mut sensor = TypedSensor::find(tree, port).map_err(|source| find_error(role, source))?;
    settle(sensor.set_mode(mode).map_err(|source| device_error(role, source))?);
    Ok(sensor)
}

/// The ultrasonic sensor, or where there is none the infrared one.
fn range_sensor(
    tree: &Arc<dyn Tree>,
    role: &RangeRole,
    settle: &mut impl FnMut(i64),
) -> Result<RangeSensor, BindError> {
    let port = role.port.as_ref();
    let none = match sensor(tree, "range", port, UltrasonicMode::DistCm, settle) {
        Ok(sensor) => return Ok(RangeSensor::Ultrasonic(sensor)),
        Err(error) => error,
    };
    match sensor(tree, "range", port, InfraredMode::Proximity, settle) {
        Ok(sensor) => Ok(RangeSensor::Infrared { sensor, m_per_pct: role.infrared_m_per_pct }),
        // Most people mean the ultrasonic sensor.
        Err(_) => Err(none),
    }
}

fn find_error(role: &str, source: FindError) -> BindError {
    BindError::Find { role: role.to_owned(), source }
}

fn device_error(role: &str, source: DeviceError) -> BindError {
    BindError::Device { role: role.to_owned(), source }
}
