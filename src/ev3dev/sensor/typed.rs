//! Sensors whose values are known: a sensor and the enum of its usable modes.

use std::fmt::Debug;
use std::sync::Arc;

use crate::ev3dev::address::PortAddress;
use crate::ev3dev::error::{DeviceError, FindError};
use crate::ev3dev::find::Identity;
use crate::ev3dev::tree::Tree;
use crate::ev3dev::value::Legal;
use crate::ev3dev::words::Driver;

use super::{Frame, Sensor};

/// The modes of one kind of sensor.
pub trait SensorMode: Debug + Copy + Eq + 'static {
    /// The driver.
    const DRIVER: Driver;

    /// Every usable mode, in the sensor's order.
    const MODES: &'static [Self];

    /// The same as the kernel writes them.
    const WORDS: &'static [&'static str];

    /// The mode as the kernel writes it.
    fn word(self) -> &'static str;
}

/// A sensor whose values are known.
#[derive(Debug)]
pub struct TypedSensor<M: SensorMode> {
    sensor: Sensor,
    mode: Option<M>,
}

impl<M: SensorMode> TypedSensor<M> {
    /// The sensor of this kind at a port.
    ///
    /// # Errors
    ///
    /// [`FindError`], which names what is there instead.
    pub fn at(tree: &Arc<dyn Tree>, port: &PortAddress) -> Result<Self, FindError> {
        Self::find(tree, Some(port))
    }

    /// The one sensor of this kind, at `port`, if given.
    ///
    /// # Errors
    ///
    /// [`FindError`], which says what there is instead.
    pub fn find(tree: &Arc<dyn Tree>, port: Option<&PortAddress>) -> Result<Self, FindError> {
        let sensor = Sensor::find_kind(tree, port, M::DRIVER)?;
        let mode = known(&sensor);
        Ok(Self { sensor, mode })
    }

    /// The mode in force; `None` for one that is not usable.
    #[must_use]
    pub fn mode(&self) -> Option<M> {
        self.mode
    }

    /// Puts the sensor into a mode, if it is not in it. Returns for how many nanoseconds values are
    /// to be discarded from now on.
    ///
    /// # Errors
    ///
    /// As [`Sensor::set_mode`].
    pub fn set_mode(&mut self, mode: M) -> Result<i64, DeviceError> {
        let settle_ns = self.sensor.set_mode(mode.word());
        self.mode = known(&self.sensor);
        settle_ns
    }

    /// What identifies the sensor, as it was found.
    #[must_use]
    pub fn identity(&self) -> &Identity {
        self.sensor.identity()
    }

    /// The sensor without its types.
    #[must_use]
    pub fn sensor(&self) -> &Sensor {
        &self.sensor
    }

    /// The sensor without its types.
    #[must_use]
    pub fn into_sensor(self) -> Sensor {
        self.sensor
    }

    /// Whether the sensor says that it has a mode: TILT modes are only on newer gyros.
    #[must_use]
    pub fn has(&self, mode: M) -> bool {
        self.sensor.modes().contains(mode.word())
    }

    /// Another mode is in force than one of those: a value means nothing without its mode.
    pub(super) fn wrong_mode(&self, words: &'static [&'static str]) -> DeviceError {
        self.sensor.node.refusal("mode", &self.sensor.mode().name, Legal::Words(words))
    }

    /// This mode must be in force.
    pub(super) fn in_mode(&self, mode: M) -> Result<(), DeviceError> {
        if self.mode == Some(mode) {
            return Ok(());
        }
        let at = M::MODES.iter().position(|known| *known == mode).unwrap_or_default();
        Err(self.wrong_mode(M::WORDS.get(at..=at).unwrap_or_default()))
    }

    pub(super) fn sensor_mut(&mut self) -> &mut Sensor {
        &mut self.sensor
    }

    /// The first value of a mode, which must be in force; the value must be legal.
    pub(super) fn first_in(&self, mode: M, first: i32, last: i32) -> Result<i32, DeviceError> {
        self.in_mode(mode)?;
        self.sensor.first_value_within(first, last)
    }

    /// One frame of a mode, which must be in force; `meaning` makes a value of it.
    pub(super) fn frame_in<T>(
        &self,
        mode: M,
        meaning: impl FnOnce(&Frame) -> Option<T>,
    ) -> Result<T, DeviceError> {
        self.in_mode(mode)?;
        let frame = self.sensor.frame()?;
        meaning(&frame).ok_or_else(|| self.sensor.malformed_frame())
    }
}

fn known<M: SensorMode>(sensor: &Sensor) -> Option<M> {
    M::MODES.iter().copied().find(|mode| mode.word() == sensor.mode().name.as_str())
}

/// Ties an enum of modes to its driver.
macro_rules! sensor_modes {
    ($modes:ident, $driver:ident) => {
        impl $crate::ev3dev::sensor::SensorMode for $modes {
            const DRIVER: $crate::ev3dev::Driver = $crate::ev3dev::Driver::$driver;
            const MODES: &'static [Self] = Self::ALL;
            const WORDS: &'static [&'static str] = Self::WORDS;

            fn word(self) -> &'static str {
                self.as_str()
            }
        }
    };
}

pub(super) use sensor_modes;
