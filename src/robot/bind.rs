//! From roles to devices.

use std::sync::Arc;

use crate::ev3dev::{
    Battery, Buttons, DeviceError, FindError, Platform, Sound, StatusLights, TachoMotor, Tree,
};
use crate::printable::with_causes;
use crate::senses::{Channel, Role};

use super::mend::Mender;
use super::stop::StopSwitch;
use super::trouble::Troubles;
use super::{Aspect, LeasedMotor, Robot, RobotConfig, RoleSensor, WantedMotor, button};

/// What to do about a device that is not where the file says.
pub const PLUG_IN: &str = "plug it in there and wait three seconds, or let onbrick setup write a \
                           robot.toml with what is plugged in";

/// What is said of a linear actuator.
pub const NOT_TURNED: &str = "missions turn motors by their angle, and leave it alone";

/// What to do about a device that is there and does not answer.
pub const PLUG_AGAIN: &str = "unplug it, plug it in again, and wait three seconds";

/// Why a role could not be bound to a device.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
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
    /// The board does not find out what is plugged in, and the file does not say where.
    #[error(
        "{role}: the ports of a {board} do not find out what is plugged in, so the section has to \
         name one"
    )]
    NoPort {
        /// The role, as `robot.toml` calls it.
        role: String,
        /// The board.
        board: &'static str,
    },
    /// Two roles come to the same sensor, which gives one kind of value at a time.
    #[error(
        "{role} and {other} are both the {driver} on {port}: name another port for one of them"
    )]
    Shared {
        /// A role, as `robot.toml` calls it.
        role: String,
        /// The other one.
        other: String,
        /// The sensor's driver.
        driver: String,
        /// Its port.
        port: String,
    },
    /// Several roles could not be bound, each for a reason of its own.
    #[error("{}", .0.iter().map(|one| with_causes(one)).collect::<Vec<_>>().join("; and "))]
    Several(Vec<BindError>),
}

impl BindError {
    /// What to do, where the message does not say it.
    #[must_use]
    pub fn way_out(&self) -> Option<&'static str> {
        match self {
            Self::Find { source: FindError::Other { found, .. }, .. } if found.is_linear() => {
                Some(NOT_TURNED)
            }
            Self::Find { source: FindError::Nothing { .. } | FindError::Other { .. }, .. } => {
                Some(PLUG_IN)
            }
            Self::Find { source: FindError::Device(error), .. }
            | Self::Device { source: error, .. } => (!error.is_denied()).then_some(PLUG_AGAIN),
            Self::NoPort { .. } => Some("port = \"S1\", as it is printed beside the socket"),
            Self::Find { .. } | Self::Shared { .. } => None,
            Self::Several(all) => all.iter().find_map(Self::way_out),
        }
    }

    /// All that went wrong in one.
    fn of(mut all: Vec<Self>) -> Self {
        match all.pop() {
            Some(only) if all.is_empty() => only,
            last => {
                all.extend(last);
                Self::Several(all)
            }
        }
    }
}

impl Robot {
    /// Finds a device for each role that is needed, and for the others where it is there; puts
    /// sensors into the modes that give what is `needed`, and takes the motors over (`reset`, then
    /// the settings of a lease). Nothing turns.
    ///
    /// Values may be stale for [`Robot::settle_ns`] from now on. Writing a mode waits for the
    /// sensor: up to half a second each.
    ///
    /// - `needed`: what the mission needs ([`crate::behavior::Mission::senses`]).
    ///
    /// # Errors
    ///
    /// [`BindError`] with every role that has no device; it says what is plugged in instead.
    pub fn bind(
        tree: &Arc<dyn Tree>,
        config: &RobotConfig,
        needed: &[Channel],
    ) -> Result<Self, BindError> {
        // The heading takes the gyro's angle, whatever else a mission asks it for.
        let needed = [needed, &[Channel::Gyro]].concat();
        let mut binder = Binder { tree: Arc::clone(tree), config: config.clone(), needed };
        let platform = Platform::of(tree);
        // What is not a role of the mission may be missing: a test bench has no battery, a
        // simulated brick no loudspeaker.
        let battery = Battery::open(tree, platform).ok();
        let mut known = config.clone();
        // Cells that cannot be asked are taken for the usual ones.
        let cells = battery.as_ref().and_then(|battery| battery.technology().ok());
        known.battery = known.battery.on(cells.unwrap_or_default(), platform);
        let mut wrong = Vec::new();
        // None for what the file does not have.
        let mut motor = |channel| {
            let wanted = binder.wanted(channel)?;
            binder.motor(&wanted, None).map_err(|error| wrong.push(error)).ok().flatten()
        };
        let [left, right, head] = [Channel::Left, Channel::Right, Channel::Head].map(&mut motor);
        let motors = Channel::MOTORS.into_iter().filter_map(motor).collect();
        let (sensors, settles_ns) = binder.sensors(&mut wrong);
        // Until the board has read its sensors again.
        let settle_ns = settles_ns.max(if platform.detects { 0 } else { 2 * platform.poll_ns });
        let (Some(left), Some(right), true) = (left, right, wrong.is_empty()) else {
            return Err(BindError::of(wrong));
        };
        let turning: Vec<Channel> = config.motor_roles().map(|wanted| wanted.channel).collect();
        let looks = Aspect::OF_COMMANDS
            .into_iter()
            .flat_map(|aspect| turning.iter().map(move |channel| (*channel, aspect)));
        let mut robot = Self {
            config: known,
            left,
            right,
            head,
            motors,
            sensors,
            buttons_needed: binder
                .needed
                .iter()
                .copied()
                .filter(|channel| button(*channel).is_some())
                .collect(),
            platform,
            battery,
            battery_due_ns: 0,
            buttons: Buttons::open(tree, platform),
            stop_switch: config
                .stop_button
                .as_ref()
                .map(|button| StopSwitch::open(tree, button))
                .transpose()?,
            stop_read_ns: 0,
            stop_trouble: None,
            lights: StatusLights::open(tree, platform).ok(),
            sound: Sound::open(tree, platform).ok(),
            led: None,
            tone_hz: None,
            head_rad: None,
            gyro_zero_rad: Some(0.0),
            troubles: Troubles::none(),
            refusals: Troubles::none(),
            settle_ns,
            mender: Mender::new(binder),
            looks: looks.collect(),
            look: 0,
            outside: None,
        };
        for channel in turning {
            if let Some(motor) = robot.motor_mut(channel) {
                let name = motor.motor().identity().name.clone();
                robot.mender.knows(channel, name);
            }
        }
        for sensor in &robot.sensors {
            robot.mender.knows(sensor.lead(), sensor.identity().name.clone());
        }
        Ok(robot)
    }
}

/// How the device of each role is bound: at the start, and again when it was plugged in again.
#[derive(Debug, Clone)]
pub(super) struct Binder {
    tree: Arc<dyn Tree>,
    config: RobotConfig,
    needed: Vec<Channel>,
}

/// A device that was bound.
#[derive(Debug)]
pub(super) enum Bound {
    Motor(LeasedMotor),
    Sensor(RoleSensor),
}

impl Bound {
    /// The kernel's name of it, which is another one after each plugging in.
    pub(super) fn name(&self) -> &str {
        let identity = match self {
            Self::Motor(motor) => motor.motor().identity(),
            Self::Sensor(sensor) => sensor.identity(),
        };
        &identity.name
    }
}

impl Binder {
    /// Binds the device behind a channel again, and says for how long its values may be stale,
    /// nanoseconds. `None` where there is nothing to bind: the robot has no such role, or it is a
    /// motor that was never away, which is not to be reset.
    pub(super) fn again(
        &self,
        channel: Channel,
        known: Option<&str>,
    ) -> Result<Option<(Bound, i64)>, BindError> {
        let role = channel.quantity().role;
        if self.config.sensors.contains_key(&role) {
            return self
                .sensor(role)
                .map(|(sensor, settle_ns)| Some((Bound::Sensor(sensor), settle_ns)));
        }
        let Some(wanted) = self.wanted(channel) else { return Ok(None) };
        Ok(self.motor(&wanted, known)?.map(|motor| (Bound::Motor(motor), 0)))
    }

    /// Whether a run needs a sensor: the heading takes the gyro and the map the range, whatever the
    /// mission asks for.
    fn needs(&self, role: Role) -> bool {
        matches!(role, Role::Gyro | Role::Range)
            || role.quantities().any(|quantity| self.needed.contains(&quantity.channel))
    }

    /// The sensors of all roles, and for how long their values may be stale, nanoseconds; what went
    /// wrong with one is added to `wrong`.
    fn sensors(&mut self, wrong: &mut Vec<BindError>) -> (Vec<RoleSensor>, i64) {
        let mut longest_ns = 0;
        let mut sensors: Vec<RoleSensor> = Vec::new();
        for role in self.config.sensors.clone().into_keys() {
            let (sensor, settle_ns) = match self.sensor(role) {
                Err(BindError::Find { role: name, .. }) if !self.needs(role) => {
                    log::info!("there is no {name}, and the mission does without it");
                    continue;
                }
                Err(error) => {
                    wrong.push(error);
                    continue;
                }
                Ok(bound) => bound,
            };
            let same = |other: &&RoleSensor| other.identity().name == sensor.identity().name;
            if let Some(other) = sensors.iter().find(same) {
                wrong.push(shared(&self.config, &sensor, other));
                continue;
            }
            longest_ns = longest_ns.max(settle_ns);
            // One that comes loose is looked for where it was: what else could be this role, such
            // as the remote's infrared sensor for the range, may be there for another one.
            self.config.sensors.insert(role, Some(sensor.identity().address.clone()));
            sensors.push(sensor);
        }
        (sensors, longest_ns)
    }

    /// The sensor of a role in its mode, and for how long its values may be stale, nanoseconds.
    fn sensor(&self, role: Role) -> Result<(RoleSensor, i64), BindError> {
        let named = || self.config.section(role);
        let mut sensor = RoleSensor::find(&self.tree, &self.config, role, &self.needed)
            .map_err(|source| BindError::Find { role: named(), source })?;
        let settle_ns =
            sensor.set_mode().map_err(|source| BindError::Device { role: named(), source })?;
        Ok((sensor, settle_ns))
    }

    /// Finds a motor and takes it over, unless it is the one that is known.
    fn motor(
        &self,
        wanted: &WantedMotor<'_>,
        known: Option<&str>,
    ) -> Result<Option<LeasedMotor>, BindError> {
        let role = || wanted.section.clone();
        let motor = TachoMotor::at(&self.tree, &wanted.motor.port)
            .map_err(|source| BindError::Find { role: role(), source })?;
        if known == Some(motor.identity().name.as_str()) {
            return Ok(None);
        }
        LeasedMotor::take(motor, wanted.motor.ratio, wanted.max_rad_s)
            .map(Some)
            .map_err(|source| BindError::Device { role: role(), source })
    }

    fn wanted(&self, channel: Channel) -> Option<WantedMotor<'_>> {
        self.config.motor_roles().find(|wanted| wanted.channel == channel)
    }
}

fn shared(config: &RobotConfig, sensor: &RoleSensor, other: &RoleSensor) -> BindError {
    let identity = sensor.identity();
    BindError::Shared {
        role: config.section(sensor.role()),
        other: config.section(other.role()),
        driver: identity.driver.to_string(),
        port: identity.address.short().to_owned(),
    }
}
