//! From roles to devices.

use std::sync::Arc;

use crate::behavior::Role;
use crate::ev3dev::{
    BUTTONS_PATH, Battery, Buttons, ColourMode, ColourSensor, DeviceError, FindError, GyroMode, GyroSensor,
    InfraredMode, InfraredSensor, PortAddress, SOUND_PATH, SensorMode, Sound, StatusLights, TachoMotor,
    TouchMode, TouchSensor, Tree, TypedSensor, UltrasonicMode,
};

use super::mend::Mender;
use super::{Aspect, Channel, LeasedMotor, MotorRole, RangeSensor, Robot, RobotConfig, SensorRole};

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
        let recipe = Recipe {
            tree: Arc::clone(tree),
            config: config.clone(),
            colour: if roles.contains(&Role::Reflect) { Channel::Reflect } else { Channel::Colour },
        };
        let mut settle_ns = 0;
        let mut settle = |ns: i64| settle_ns = settle_ns.max(ns);
        // What is not a role of the mission may be missing: a test bench has no battery, a simulated brick no loudspeaker.
        let battery = Battery::open(tree).ok();
        let mut known = config.clone();
        // Cells that cannot be asked are taken for the usual ones.
        known.battery.cells =
            battery.as_ref().and_then(|battery| battery.technology().ok()).unwrap_or_default();
        let motors =
            Channel::MOTORS.into_iter().take(config.motors.len()).map(|channel| recipe.motor(channel));
        let mut robot = Self {
            config: known,
            left: recipe.motor(Channel::Left)?,
            right: recipe.motor(Channel::Right)?,
            head: config.head.as_ref().map(|_| recipe.motor(Channel::Head)).transpose()?,
            motors: motors.collect::<Result<_, _>>()?,
            range: config.range.as_ref().map(|_| recipe.range(&mut settle)).transpose()?,
            gyro: config.gyro.as_ref().map(|_| recipe.gyro(&mut settle)).transpose()?,
            touch: config.touch.as_ref().map(|_| recipe.touch(&mut settle)).transpose()?,
            colour: config.colour.as_ref().map(|_| recipe.colour(&mut settle)).transpose()?,
            remote: config.remote.as_ref().map(|_| recipe.remote(&mut settle)).transpose()?,
            battery,
            battery_due_ns: 0,
            buttons: Buttons::open(tree, BUTTONS_PATH),
            lights: StatusLights::open(tree).ok(),
            sound: Sound::open(tree, SOUND_PATH).ok(),
            led: None,
            tone_hz: None,
            head_rad: None,
            gyro_zero_rad: Some(0.0),
            trouble: None,
            refused: None,
            settle_ns: 0,
            mender: Mender::new(recipe),
            looks: Vec::new(),
            look: 0,
            outside: None,
        };
        for aspect in Aspect::OF_COMMANDS {
            let motors = Channel::ALL.into_iter().filter(|channel| robot.motor_mut(*channel).is_some());
            let motors: Vec<_> = motors.map(|channel| (channel, aspect)).collect();
            robot.looks.extend(motors);
        }
        robot.settle_ns = settle_ns;
        for channel in robot.channels().collect::<Vec<_>>() {
            if let Some(name) = robot.device_name(channel) {
                robot.mender.knows(channel, name);
            }
        }
        Ok(robot)
    }
}

/// How the device of each role is bound: at the start, and anew when it was plugged in again.
#[derive(Debug, Clone)]
pub(super) struct Recipe {
    tree: Arc<dyn Tree>,
    config: RobotConfig,
    /// What the colour sensor measures.
    colour: Channel,
}

/// A device that was bound.
#[derive(Debug)]
pub(super) enum Bound {
    Motor(LeasedMotor),
    Range(RangeSensor),
    Gyro(GyroSensor),
    Touch(TouchSensor),
    Colour(ColourSensor),
    Remote(InfraredSensor),
}

impl Bound {
    /// The kernel's name of it, which is another one after each plugging in.
    pub(super) fn name(&self) -> &str {
        let identity = match self {
            Self::Motor(motor) => motor.motor().identity(),
            Self::Range(sensor) => sensor.identity(),
            Self::Gyro(sensor) => sensor.identity(),
            Self::Touch(sensor) => sensor.identity(),
            Self::Colour(sensor) => sensor.identity(),
            Self::Remote(sensor) => sensor.identity(),
        };
        &identity.name
    }
}

impl Recipe {
    /// Binds the device behind a channel anew, and says for how long its values may be stale, nanoseconds. `None` where there is
    /// nothing to bind: the robot has no such role, or it is a motor that was never away, which is not to be reset.
    pub(super) fn again(
        &self,
        channel: Channel,
        known: Option<&str>,
    ) -> Result<Option<(Bound, i64)>, BindError> {
        let mut settle_ns = 0;
        let mut settle = |ns: i64| settle_ns = ns;
        let bound = match channel {
            Channel::Range if self.config.range.is_some() => Bound::Range(self.range(&mut settle)?),
            Channel::Gyro if self.config.gyro.is_some() => Bound::Gyro(self.gyro(&mut settle)?),
            Channel::Touch if self.config.touch.is_some() => Bound::Touch(self.touch(&mut settle)?),
            Channel::Colour | Channel::Reflect if self.config.colour.is_some() => {
                Bound::Colour(self.colour(&mut settle)?.0)
            }
            Channel::Remote if self.config.remote.is_some() => Bound::Remote(self.remote(&mut settle)?),
            _ => {
                let Some(wanted) = self.wanted(channel) else { return Ok(None) };
                let motor = find_motor(&self.tree, &wanted)?;
                if known == Some(motor.identity().name.as_str()) {
                    return Ok(None);
                }
                Bound::Motor(take_motor(motor, &wanted)?)
            }
        };
        Ok(Some((bound, settle_ns)))
    }

    fn motor(&self, channel: Channel) -> Result<LeasedMotor, BindError> {
        // Only asked for what the file has.
        let wanted = self.wanted(channel).unwrap_or_else(|| self.left());
        take_motor(find_motor(&self.tree, &wanted)?, &wanted)
    }

    fn left(&self) -> WantedMotor<'_> {
        let config = &self.config;
        WantedMotor { role: "drive.left".to_owned(), motor: &config.left, max_rad_s: config.max_wheel_rad_s }
    }

    fn wanted(&self, channel: Channel) -> Option<WantedMotor<'_>> {
        let config = &self.config;
        let wanted = |role: &str, motor, max_rad_s| WantedMotor { role: role.to_owned(), motor, max_rad_s };
        match channel {
            Channel::Left => Some(self.left()),
            Channel::Right => Some(wanted("drive.right", &config.right, config.max_wheel_rad_s)),
            Channel::Head => config.head.as_ref().map(|head| wanted("head", &head.motor, head.speed_rad_s)),
            _ => {
                let place = Channel::MOTORS.into_iter().position(|motor| motor == channel)?;
                let named = config.motors.get(place)?;
                Some(wanted(&format!("motor.{}", named.name), &named.motor, named.max_rad_s))
            }
        }
    }

    /// The ultrasonic sensor, or where there is none the infrared one.
    fn range(&self, settle: &mut impl FnMut(i64)) -> Result<RangeSensor, BindError> {
        let role = self.config.range.as_ref();
        let port = role.and_then(|role| role.port.as_ref());
        let none = match sensor(&self.tree, "range", port, UltrasonicMode::DistCm, settle) {
            Ok(sensor) => return Ok(RangeSensor::Ultrasonic(sensor)),
            Err(error) => error,
        };
        match (role, sensor(&self.tree, "range", port, InfraredMode::Proximity, settle)) {
            (Some(role), Ok(sensor)) => {
                Ok(RangeSensor::Infrared { sensor, m_per_pct: role.infrared_m_per_pct })
            }
            // Most people mean the ultrasonic sensor.
            _ => Err(none),
        }
    }

    fn gyro(&self, settle: &mut impl FnMut(i64)) -> Result<GyroSensor, BindError> {
        self.sensor("gyro", self.config.gyro.as_ref(), GyroMode::Angle, settle)
    }

    fn touch(&self, settle: &mut impl FnMut(i64)) -> Result<TouchSensor, BindError> {
        self.sensor("touch", self.config.touch.as_ref(), TouchMode::Touch, settle)
    }

    fn colour(&self, settle: &mut impl FnMut(i64)) -> Result<(ColourSensor, Channel), BindError> {
        let mode = if self.colour == Channel::Reflect { ColourMode::Reflect } else { ColourMode::Colour };
        Ok((self.sensor("colour", self.config.colour.as_ref(), mode, settle)?, self.colour))
    }

    fn remote(&self, settle: &mut impl FnMut(i64)) -> Result<InfraredSensor, BindError> {
        self.sensor("remote", self.config.remote.as_ref(), InfraredMode::Remote, settle)
    }

    fn sensor<M: SensorMode>(
        &self,
        name: &str,
        role: Option<&SensorRole>,
        mode: M,
        settle: &mut impl FnMut(i64),
    ) -> Result<TypedSensor<M>, BindError> {
        sensor(&self.tree, name, role.and_then(|role| role.port.as_ref()), mode, settle)
    }
}

/// A motor as a role wants it.
struct WantedMotor<'c> {
    role: String,
    motor: &'c MotorRole,
    max_rad_s: f64,
}

fn find_motor(tree: &Arc<dyn Tree>, wanted: &WantedMotor<'_>) -> Result<TachoMotor, BindError> {
    TachoMotor::find(tree, wanted.motor.port.as_ref(), None)
        .map_err(|source| find_error(&wanted.role, source))
}

fn take_motor(motor: TachoMotor, wanted: &WantedMotor<'_>) -> Result<LeasedMotor, BindError> {
    LeasedMotor::take(motor, wanted.motor.ratio, wanted.max_rad_s)
        .map_err(|source| device_error(&wanted.role, source))
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

fn find_error(role: &str, source: FindError) -> BindError {
    BindError::Find { role: role.to_owned(), source }
}

fn device_error(role: &str, source: DeviceError) -> BindError {
    BindError::Device { role: role.to_owned(), source }
}
