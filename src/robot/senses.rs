//! One tick's readings, in SI units, each with its two ages.

use std::fmt;

use serde::{Deserialize, Serialize};

/// A quantity that the robot senses. Its discriminant is its place in [`Senses`] and in a recording, so it never changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum Channel {
    /// Angle of the left wheel at its axle, radians, forwards positive.
    Left = 0,
    /// Angle of the right wheel at its axle, radians, forwards positive.
    Right = 1,
    /// Angle of the head, radians, anticlockwise from straight ahead.
    Head = 2,
    /// Distance to what reflects, metres from the sensor; infinite where there is no echo.
    Range = 3,
    /// Heading of the gyro sensor, radians, anticlockwise, with an arbitrary zero.
    Gyro = 4,
    /// 1 while the touch sensor is pressed, else 0.
    Touch = 5,
    /// Colour number 0 to 7 of the colour sensor.
    Colour = 6,
    /// Reflected light, percent.
    Reflect = 7,
    /// Code of the infrared remote's buttons, 0 to 11.
    Remote = 8,
    /// Battery, volts.
    Battery = 9,
    /// Angle of the first named motor, radians at its axle; the others follow.
    Motor0 = 10,
    /// Angle of the second named motor.
    Motor1 = 11,
    /// Angle of the third named motor.
    Motor2 = 12,
    /// Angle of the fourth named motor.
    Motor3 = 13,
}

impl Channel {
    /// Every channel, in the order of their places.
    pub const ALL: [Self; 14] = [
        Self::Left,
        Self::Right,
        Self::Head,
        Self::Range,
        Self::Gyro,
        Self::Touch,
        Self::Colour,
        Self::Reflect,
        Self::Remote,
        Self::Battery,
        Self::Motor0,
        Self::Motor1,
        Self::Motor2,
        Self::Motor3,
    ];

    /// The named motors' channels.
    pub const MOTORS: [Self; 4] = [Self::Motor0, Self::Motor1, Self::Motor2, Self::Motor3];
}

impl fmt::Display for Channel {
    /// What people call it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Left => "left wheel",
            Self::Right => "right wheel",
            Self::Head => "head",
            Self::Range => "range sensor",
            Self::Gyro => "gyro",
            Self::Touch => "touch sensor",
            Self::Colour | Self::Reflect => "colour sensor",
            Self::Remote => "remote",
            Self::Battery => "battery",
            Self::Motor0 => "first named motor",
            Self::Motor1 => "second named motor",
            Self::Motor2 => "third named motor",
            Self::Motor3 => "fourth named motor",
        })
    }
}

/// A value that was read, with what is known of its age: a sensor has no sequence number, so a value that did not change may be
/// new or old.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// The value, in its channel's unit.
    pub value: f64,
    /// When it was last read, nanoseconds of the run's clock.
    pub read_ns: i64,
    /// When it was first read with this value.
    pub changed_ns: i64,
}

/// One tick's readings. A channel that the robot does not have, or that was never read, is `None`; one that cannot be read any
/// more keeps its last reading, whose `read_ns` then stands still.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Senses {
    /// The tick's number, from 0.
    pub tick: u64,
    /// The tick's time, nanoseconds of the run's clock.
    pub time_ns: i64,
    /// By [`Channel`].
    pub readings: [Option<Reading>; Channel::ALL.len()],
}

impl Senses {
    /// A channel's last reading, however old.
    #[must_use]
    pub fn get(&self, channel: Channel) -> Option<Reading> {
        self.readings[channel as usize]
    }

    /// A channel's value if it was read within the last `max_age_ns`.
    #[must_use]
    pub fn fresh(&self, channel: Channel, max_age_ns: i64) -> Option<f64> {
        self.get(channel)
            .filter(|reading| self.time_ns - reading.read_ns <= max_age_ns)
            .map(|reading| reading.value)
    }

    /// Notes a value read at this tick's time.
    pub fn set(&mut self, channel: Channel, value: f64) {
        let place = &mut self.readings[channel as usize];
        let changed_ns = match place {
            Some(last) if last.value.to_bits() == value.to_bits() => last.changed_ns,
            _ => self.time_ns,
        };
        *place = Some(Reading { value, read_ns: self.time_ns, changed_ns });
    }
}
