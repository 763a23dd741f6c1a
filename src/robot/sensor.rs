//! A sensor that has a role: found, in the mode that gives what is needed, read into channels.
//!
//! # Not here
//!
//! What a mode gives and in which scale is said by the table in [`crate::senses`]. Where the gyro's
//! angle is counted from is for the robot to know.

use std::sync::Arc;

use arrayvec::ArrayVec;

use super::RobotConfig;
use crate::ev3dev::{DeviceError, Driver, FindError, Frame, Identity, Sensor, Tree};
use crate::senses::{Channel, Role, Source};

/// The most quantities that one mode gives.
const MOST: usize = 4;

/// A sensor that has a role.
#[derive(Debug)]
pub struct RoleSensor {
    role: Role,
    sensor: Sensor,
    mode: &'static str,
    gives: Vec<(Channel, Source)>,
}

impl RobotConfig {
    /// What a named sensor measures, and the channel that this goes to.
    fn measured(&self, role: Role) -> Option<(Channel, Channel)> {
        let Role::Sensor(at) = role else { return None };
        let named = self.named_sensors.get(usize::from(at))?;
        Some((named.measures, *Channel::SENSORS.get(usize::from(at))?))
    }

    /// The role whose kinds of sensors a role can have.
    pub(super) fn kind(&self, role: Role) -> Role {
        self.measured(role).map_or(role, |(measured, _)| measured.quantity().role)
    }
}

impl RoleSensor {
    /// Finds the sensor of a role: of the kind that is preferred among those that are there.
    /// Nothing is written to it.
    ///
    /// - `needed`: what it has to give, where there is a choice; other roles' channels are passed
    ///   over.
    ///
    /// # Errors
    ///
    /// [`FindError`] where no sensor that can be the role is there, or several are.
    pub fn find(
        tree: &Arc<dyn Tree>,
        config: &RobotConfig,
        role: Role,
        needed: &[Channel],
    ) -> Result<Self, FindError> {
        let port = config.sensors.get(&role).and_then(Option::as_ref);
        let mut first = None;
        let said = config.drivers.get(&role).copied();
        let drivers = config.kind(role).drivers();
        for driver in drivers.filter(|driver| said.is_none_or(|said| said == *driver)) {
            match Sensor::find_kind(tree, port, driver) {
                Ok(sensor) => return Ok(Self::of(sensor, driver, config, role, needed)),
                // Most people mean the kind that is preferred.
                Err(error) => first = first.or(Some(error)),
            }
        }
        Err(first.unwrap_or_else(|| FindError::Nothing {
            wanted: role.what().to_owned(),
            there: Vec::new(),
        }))
    }

    fn of(
        sensor: Sensor,
        driver: Driver,
        config: &RobotConfig,
        role: Role,
        needed: &[Channel],
    ) -> Self {
        let (kind, named) = (config.kind(role), config.measured(role));
        let measured = named.map(|(measured, _)| measured);
        let needed = measured.as_ref().map_or(needed, std::slice::from_ref);
        // A mission that asks one sensor for two modes was refused when it was read.
        let mode = kind.mode(driver, needed).or_else(|| kind.mode(driver, &[])).unwrap_or_default();
        let sources = kind.quantities().filter_map(|quantity| {
            let mut source = *quantity.channel.source(driver, mode)?;
            if (quantity.channel, driver) == (Channel::Range, Driver::Infrared) {
                source.scale = config.infrared_m_per_pct;
            }
            match named {
                None => Some((quantity.channel, source)),
                Some((measured, channel)) => {
                    source.scale = quantity.unit.in_conditions(source.scale);
                    (quantity.channel == measured).then_some((channel, source))
                }
            }
        });
        Self { role, sensor, mode, gives: sources.take(MOST).collect() }
    }

    /// Its role.
    #[must_use]
    pub fn role(&self) -> Role {
        self.role
    }

    /// What identifies the sensor, as it was found.
    #[must_use]
    pub fn identity(&self) -> &Identity {
        self.sensor.identity()
    }

    /// The mode in which it gives what is needed.
    #[must_use]
    pub fn mode(&self) -> &'static str {
        self.mode
    }

    /// Whether it is in that mode, as far as this program knows.
    #[must_use]
    pub fn is_in_mode(&self) -> bool {
        self.sensor.mode().name.as_str() == self.mode
    }

    /// Puts it into its mode. Returns for how many nanoseconds values may be stale from now on.
    ///
    /// # Errors
    ///
    /// As [`Sensor::set_mode`].
    pub fn set_mode(&mut self) -> Result<i64, DeviceError> {
        self.sensor.set_mode(self.mode)
    }

    /// What it gives in its mode.
    pub fn channels(&self) -> impl Iterator<Item = Channel> + '_ {
        self.gives.iter().map(|(channel, _)| *channel)
    }

    /// The first of them, which stands for the sensor.
    #[must_use]
    pub fn lead(&self) -> Channel {
        self.channels().next().unwrap_or(Channel::Range)
    }

    /// Reads all that it gives with one system call: angles of a gyro as its own count has them.
    ///
    /// # Errors
    ///
    /// [`Cause::Malformed`](crate::ev3dev::Cause::Malformed) for a number that the sensor cannot
    /// mean; what reading gives. Nothing is noted then.
    pub fn read(&self, mut note: impl FnMut(Channel, f64)) -> Result<(), DeviceError> {
        if let [(channel, source)] = self.gives.as_slice()
            && source.is_first_value()
        {
            let (first, last) = source.legal;
            note(*channel, source.value_of(self.sensor.first_value_within(first, last)?));
            return Ok(());
        }
        let frame = self.sensor.frame()?;
        let values: Option<ArrayVec<f64, MOST>> =
            self.gives.iter().map(|(_, source)| in_frame(source, &frame)).collect();
        let values = values.ok_or_else(|| self.sensor.malformed_frame())?;
        for ((channel, _), value) in self.gives.iter().zip(values) {
            note(*channel, value);
        }
        Ok(())
    }
}

/// A source's value in a frame; `None` where the frame does not have it, or beyond what is legal.
fn in_frame(source: &Source, frame: &Frame) -> Option<f64> {
    let number = |at: usize| i32::try_from(frame.whole(at)?).ok();
    if let Some(nothing) = source.nothing
        && number(nothing.value)? == nothing.number
    {
        return Some(nothing.means);
    }
    let (first, last) = source.legal;
    number(source.value)
        .filter(|number| (first..=last).contains(number))
        .map(|number| source.value_of(number))
}
