//! What the estimator gets each tick: plain data, checked before it counts.
//!
//! # What we count on
//!
//! - Wheels, head and gyro are `None` in every tick in which they were not really read. A stale
//!   angle handed on as if it were new looks like a robot that stands still, and a gyro that stands
//!   while the wheels turn looks like slip. Ways in between are made up for with the next reading,
//!   so nothing is lost.
//! - The range may be older: up to the age at which the robot counts it as lost.
//! - The gyro's sign is already turned round: anticlockwise is positive.

use super::{Events, gyro};

/// No head turns further, radians: a cable would hold it back.
const HEAD_LIMIT_RAD: f64 = 100.0;

/// The gyro's angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GyroReading {
    /// Radians, anticlockwise, in the sensor's own steps of a whole degree and with its arbitrary
    /// zero.
    pub value_rad: f64,
    /// When it was first read with this value, nanoseconds of the run's clock.
    pub changed_ns: i64,
}

/// The range sensor's distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeReading {
    /// Metres from the sensor; infinite where there is no echo.
    pub value_m: f64,
    /// When it was first read with this value, nanoseconds of the run's clock.
    pub changed_ns: i64,
}

/// One tick's readings; `None` where the robot has no such thing or could not read it in this tick.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Inputs {
    /// The tick's time, nanoseconds of the run's clock.
    pub time_ns: i64,
    /// Angle of the left wheel at its axle, radians, forwards positive.
    pub left_rad: Option<f64>,
    /// Angle of the right wheel at its axle, radians, forwards positive.
    pub right_rad: Option<f64>,
    /// The gyro.
    pub gyro: Option<GyroReading>,
    /// Angle of the head, radians, anticlockwise from straight ahead.
    pub head_rad: Option<f64>,
    /// The range sensor.
    pub range: Option<RangeReading>,
}

impl Inputs {
    /// The same inputs without what no sensor can have measured, and whether anything was left out.
    ///
    /// Left out are numbers that are not finite (an infinite range is a reading: no echo), a range
    /// below zero, a gyro angle beyond its 16 bits, and a head angle beyond 100 rad.
    pub(super) fn checked(&self) -> (Self, Events) {
        let checked = Self {
            time_ns: self.time_ns,
            left_rad: self.left_rad.filter(|angle| angle.is_finite()),
            right_rad: self.right_rad.filter(|angle| angle.is_finite()),
            gyro: self.gyro.filter(|gyro| gyro::is_in_range(gyro.value_rad)),
            head_rad: self.head_rad.filter(|angle| angle.abs() <= HEAD_LIMIT_RAD),
            range: self.range.filter(|range| range.value_m >= 0.0),
        };
        let complete = checked.left_rad.is_some() == self.left_rad.is_some()
            && checked.right_rad.is_some() == self.right_rad.is_some()
            && checked.gyro.is_some() == self.gyro.is_some()
            && checked.head_rad.is_some() == self.head_rad.is_some()
            && checked.range.is_some() == self.range.is_some();
        (checked, if complete { Events::NONE } else { Events::INPUT_REFUSED })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_sensor_can_measure_is_left_out_and_noticed() {
        let bad = Inputs {
            left_rad: Some(f64::NAN),
            right_rad: Some(f64::NEG_INFINITY),
            gyro: Some(GyroReading { value_rad: 1e6, changed_ns: 0 }),
            head_rad: Some(f64::INFINITY),
            range: Some(RangeReading { value_m: -0.1, changed_ns: 0 }),
            ..Inputs::default()
        };
        assert_eq!(bad.checked(), (Inputs::default(), Events::INPUT_REFUSED));
    }

    #[test]
    fn no_echo_and_nothing_at_all_are_fine() {
        let open = Inputs {
            range: Some(RangeReading { value_m: f64::INFINITY, changed_ns: 0 }),
            ..Inputs::default()
        };
        assert_eq!(open.checked(), (open, Events::NONE));
        assert_eq!(Inputs::default().checked(), (Inputs::default(), Events::NONE));
    }
}
