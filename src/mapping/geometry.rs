//! The robot's measures, and which way of estimating it uses.
//!
//! # What we count on
//!
//! A [`Geometry`] has been checked when it exists: every number in it is finite and in a range that
//! a robot of LEGO bricks can have, so that nothing after it divides by zero or overflows.

use std::ops::RangeInclusive;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::OwnEchoes;
use crate::clock::MILLISECOND_NS;

/// Metres per turn of the seed's wheel: 37.2 inches in five turns.
const SEED_WHEEL_CIRCUMFERENCE_M: f64 = 0.188_976;
/// Distance between the seed's wheels: 4.5 inches.
const SEED_TRACK_WIDTH_M: f64 = 0.1143;
/// The seed's sensor ahead of the axle's centre: 2 inches.
const SEED_RANGE_AHEAD_M: f64 = 0.0508;
/// The seed keeps readings below this.
const SEED_RANGE_MAX_M: f64 = 2.0;

/// No wheel turns faster, in rad/s at the axle: a large motor without load at 9 V makes 18.3 (1050
/// °/s), without a gear.
const MAX_WHEEL_RAD_S: f64 = 20.0;

/// How old a distance is when it can first be read: the middle of the 20 to 100 ms that a frame of
/// the sensor takes.
const RANGE_LATENCY_NS: i64 = 50 * MILLISECOND_NS;

/// Half of the ultrasonic's cone: 14° fits the scans of `lego-rotating-sonar`.
const HALF_CONE_RAD: f64 = 14.0 * (std::f64::consts::PI / 180.0);

/// The longest latency that the history of poses can serve (`history` keeps at least 225 ms).
const RANGE_LATENCY_MAX_NS: i64 = 200 * MILLISECOND_NS;

/// How the pose is estimated and which readings become points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Method {
    /// As the seed did it: heading is the gyro's, the step is made along the heading before it, and
    /// each tick with a range below the maximum is a point, seen from the pose of that tick.
    Seed,
    /// Heading from gyro and encoders together, slip noticed, bias removed, each reading seen from
    /// the pose at its instant; nothing that is seen corrects the pose.
    Odometry,
    /// The same, corrected by landmarks.
    #[default]
    Default,
}

impl Method {
    /// Each with its word on the command line and in recordings.
    pub const WORDS: [(&str, Self); 3] =
        [("default", Self::Default), ("odometry", Self::Odometry), ("seed", Self::Seed)];

    /// Its word.
    #[must_use]
    pub fn word(self) -> &'static str {
        let mut words = Self::WORDS.into_iter();
        words.find(|(_, method)| *method == self).map_or("", |(word, _)| word)
    }
}

impl FromStr for Method {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let mut words = Self::WORDS.into_iter();
        let found = words.find(|(word, _)| *word == text);
        found
            .map(|(_, method)| method)
            .ok_or_else(|| "it can be default, odometry or seed".to_owned())
    }
}

/// What an estimator is made from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EstimatorConfig {
    /// The robot's measures.
    pub geometry: Geometry,
    /// The way of estimating.
    pub method: Method,
}

/// Where the range sensor sits and what it can do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeMount {
    /// The sensor (on a head: the head's axis) ahead of the axle's centre, metres; −1 to 1.
    pub ahead_m: f64,
    /// The same to the left, metres; −1 to 1.
    pub left_m: f64,
    /// Readings from here on are no points of the map, metres; 0.1 to 10.
    pub max_m: f64,
    /// How old a distance is when it can first be read, nanoseconds; 0 to 200 ms.
    pub latency_ns: i64,
    /// Half of the cone that it hears in, radians; 0 to 0.5. With 0, a narrow beam, each echo lies
    /// on its axis, and none corrects the pose. The one cone that there is: of bearings, of the
    /// grid, and of what is recorded.
    pub half_cone_rad: f64,
    /// What its readings are too large by, metres; −0.2 to 0.2.
    pub bias_m: f64,
    /// What it says for each metre more, metres; 0.5 to 2.
    pub scale: f64,
    /// Where it hears the robot itself.
    pub own_echoes: OwnEchoes,
    /// Whether it sits on a head that turns. If it does, readings are placed only while the head's
    /// angle is known.
    pub on_head: bool,
}

impl RangeMount {
    /// What [`RangeMount::ahead_m`] can be.
    pub const AHEAD_M: RangeInclusive<f64> = -1.0..=1.0;
    /// What [`RangeMount::max_m`] can be.
    pub const MAX_M: RangeInclusive<f64> = 0.1..=10.0;
    /// What [`RangeMount::half_cone_rad`] can be.
    pub const HALF_CONE_RAD: RangeInclusive<f64> = 0.0..=0.5;
    /// What [`RangeMount::bias_m`] can be.
    pub const BIAS_M: RangeInclusive<f64> = -0.2..=0.2;
    /// What [`RangeMount::scale`] can be.
    pub const SCALE: RangeInclusive<f64> = 0.5..=2.0;

    /// The distance behind a reading, metres; infinite without an echo.
    pub(super) fn distance_m(&self, reading_m: f64) -> f64 {
        ((reading_m - self.bias_m) / self.scale).max(0.0)
    }
}

impl Default for RangeMount {
    fn default() -> Self {
        Self {
            ahead_m: SEED_RANGE_AHEAD_M,
            left_m: 0.0,
            max_m: SEED_RANGE_MAX_M,
            latency_ns: RANGE_LATENCY_NS,
            half_cone_rad: HALF_CONE_RAD,
            bias_m: 0.0,
            scale: 1.0,
            own_echoes: OwnEchoes::default(),
            on_head: true,
        }
    }
}

/// A measure that no robot of ours can have.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("{quantity} is {value}, but must be from {least} to {most}")]
pub struct GeometryError {
    /// The measure's name with its unit.
    pub quantity: &'static str,
    /// What it was to be.
    pub value: f64,
    /// The least that is taken.
    pub least: f64,
    /// The most that is taken.
    pub most: f64,
}

/// The robot's measures, checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geometry {
    wheel_circumference_m: f64,
    track_width_m: f64,
    /// Its inverse: the brick's processor divides slowly.
    per_track_width_m: f64,
    /// Degrees that are turned for one of the gyro's.
    per_gyro_scale: f64,
    max_wheel_rad_s: f64,
    range: RangeMount,
}

impl Geometry {
    /// Metres that a wheel can make in a turn.
    pub const WHEEL_CIRCUMFERENCE_M: RangeInclusive<f64> = 0.01..=2.0;
    /// Metres that there can be between the wheels' contact points.
    pub const TRACK_WIDTH_M: RangeInclusive<f64> = 0.01..=1.0;
    /// What a gyro can say for a degree that is turned, degrees.
    pub const GYRO_SCALE: RangeInclusive<f64> = 0.8..=1.25;
    /// How far the scale of a gyro may be off that was not measured, as a share: a standard
    /// deviation. People find 1 to 4 % (`lego-sensor-tables`).
    pub(super) const GYRO_SCALE_SD: f64 = 0.02;
    /// The same of one that `calibrate` has measured, or a spin (`whole_turn`).
    pub(super) const MEASURED_GYRO_SCALE_SD: f64 = 0.005;

    /// A robot with two driven wheels; its range sensor is mounted as the seed's until
    /// [`Geometry::with_range`] says otherwise.
    ///
    /// # Errors
    ///
    /// [`GeometryError`] where the one is not in [`Geometry::WHEEL_CIRCUMFERENCE_M`] or the other
    /// not in [`Geometry::TRACK_WIDTH_M`].
    pub fn new(wheel_circumference_m: f64, track_width_m: f64) -> Result<Self, GeometryError> {
        within("wheel_circumference_m", wheel_circumference_m, Self::WHEEL_CIRCUMFERENCE_M)?;
        within("track_width_m", track_width_m, Self::TRACK_WIDTH_M)?;
        Ok(Self::of(wheel_circumference_m, track_width_m))
    }

    fn of(wheel_circumference_m: f64, track_width_m: f64) -> Self {
        Self {
            wheel_circumference_m,
            track_width_m,
            per_track_width_m: 1.0 / track_width_m,
            per_gyro_scale: 1.0,
            max_wheel_rad_s: MAX_WHEEL_RAD_S,
            range: RangeMount::default(),
        }
    }

    /// The seed's robot.
    #[must_use]
    pub fn seed() -> Self {
        Self::of(SEED_WHEEL_CIRCUMFERENCE_M, SEED_TRACK_WIDTH_M)
    }

    /// The same robot with its range sensor mounted so.
    ///
    /// # Errors
    ///
    /// [`GeometryError`] with the first measure that is out of the range given at [`RangeMount`].
    pub fn with_range(self, range: RangeMount) -> Result<Self, GeometryError> {
        within("range ahead_m", range.ahead_m, RangeMount::AHEAD_M)?;
        within("range left_m", range.left_m, -1.0..=1.0)?;
        within("range max_m", range.max_m, RangeMount::MAX_M)?;
        within("range half_cone_rad", range.half_cone_rad, RangeMount::HALF_CONE_RAD)?;
        within("range bias_m", range.bias_m, RangeMount::BIAS_M)?;
        within("range scale", range.scale, RangeMount::SCALE)?;
        #[expect(clippy::cast_precision_loss, reason = "only compared and shown")]
        within("range latency_ns", range.latency_ns as f64, 0.0..=RANGE_LATENCY_MAX_NS as f64)?;
        Ok(Self { range, ..self })
    }

    /// The same robot with a gyro that says this for a degree that is turned: sensors count 1 to
    /// 4 % too much or too little.
    ///
    /// # Errors
    ///
    /// [`GeometryError`] where it is not in [`Geometry::GYRO_SCALE`].
    pub fn with_gyro_scale(self, gyro_scale: f64) -> Result<Self, GeometryError> {
        within("gyro scale", gyro_scale, Self::GYRO_SCALE)?;
        Ok(Self { per_gyro_scale: 1.0 / gyro_scale, ..self })
    }

    /// The same robot with wheels that turn no faster than this at the axle: what is faster is a
    /// counter that jumped, not a motion. A gear that makes a wheel faster than 20 rad/s has to say
    /// so here.
    ///
    /// # Errors
    ///
    /// [`GeometryError`] where it is not in 1 to 1000 rad/s.
    pub fn with_max_wheel_rad_s(self, max_wheel_rad_s: f64) -> Result<Self, GeometryError> {
        within("max_wheel_rad_s", max_wheel_rad_s, 1.0..=1000.0)?;
        Ok(Self { max_wheel_rad_s, ..self })
    }

    /// Metres that a wheel makes in a turn.
    #[must_use]
    pub fn wheel_circumference_m(&self) -> f64 {
        self.wheel_circumference_m
    }

    /// Metres between the wheels' contact points.
    #[must_use]
    pub fn track_width_m(&self) -> f64 {
        self.track_width_m
    }

    /// Radians that the robot turns when one wheel gets ahead of the other by a metre.
    pub(super) fn per_track_width_m(&self) -> f64 {
        self.per_track_width_m
    }

    /// Whether the gyro's scale was measured.
    pub(crate) fn knows_gyro_scale(&self) -> bool {
        self.per_gyro_scale.to_bits() != 1.0_f64.to_bits()
    }

    /// How far the gyro's scale may be off, as a share: a standard deviation.
    pub(super) fn gyro_scale_sd(&self) -> f64 {
        if self.knows_gyro_scale() { Self::MEASURED_GYRO_SCALE_SD } else { Self::GYRO_SCALE_SD }
    }

    /// Degrees that the robot turns when the gyro says one more.
    pub(super) fn per_gyro_scale(&self) -> f64 {
        self.per_gyro_scale
    }

    /// The fastest that a wheel can turn, rad/s.
    #[must_use]
    pub fn max_wheel_rad_s(&self) -> f64 {
        self.max_wheel_rad_s
    }

    /// The range sensor's place.
    #[must_use]
    pub fn range(&self) -> &RangeMount {
        &self.range
    }
}

fn within(
    quantity: &'static str,
    value: f64,
    range: RangeInclusive<f64>,
) -> Result<(), GeometryError> {
    if range.contains(&value) {
        return Ok(());
    }
    let (least, most) = range.into_inner();
    Err(GeometryError { quantity, value, least, most })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn measures_that_no_robot_has_are_refused_with_their_name_and_range() {
        for (circumference, track) in
            [(0.0, 0.1), (f64::NAN, 0.1), (0.2, -0.1), (0.2, f64::INFINITY)]
        {
            let error = Geometry::new(circumference, track).expect_err("a measure out of range");
            assert!(error.to_string().contains("_m is "), "{error}");
        }
        let far = RangeMount { latency_ns: i64::MAX, ..RangeMount::default() };
        let error = Geometry::seed().with_range(far).expect_err("a latency of centuries");
        assert_eq!(error.quantity, "range latency_ns");
        let error =
            Geometry::seed().with_max_wheel_rad_s(0.0).expect_err("a wheel that never turns");
        assert_eq!(error.to_string(), "max_wheel_rad_s is 0, but must be from 1 to 1000");
    }

    #[test]
    fn the_seeds_robot_passes_the_checks_of_every_other() {
        let seed = Geometry::seed();
        let made = Geometry::new(seed.wheel_circumference_m(), seed.track_width_m())
            .and_then(|made| made.with_range(*seed.range()))
            .and_then(|made| made.with_max_wheel_rad_s(seed.max_wheel_rad_s()));
        assert_eq!(made, Ok(seed));
    }
}
