//! What the range sensor's number means: an echo, no echo, or something nearer than it can measure.
//!
//! The sensor says 255 cm both when nothing is in range and when something is nearer than about 4
//! cm. So where an echo was near, its place is remembered, and a missing echo means *too near*
//! while that place is still near and in the beam's way. Driving back ends it, and so does looking
//! or turning elsewhere; an echo from further off in that direction shows that nothing is there any
//! more.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

/// What the range sensor says, told apart.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub enum Range {
    /// Something reflects at this distance from the sensor, in metres.
    Echo(f64),
    /// Nothing within range.
    #[default]
    NoEcho,
    /// Something is nearer than the sensor can measure.
    TooNear,
}

/// An echo from less is near, metres: the 4 cm that the sensor cannot see, and what a robot at 0.3
/// m/s drives in two of its periods.
const NEAR_M: f64 = 0.10;
/// What is further from the sensor than this has been backed off from, metres: near, and 5 cm that
/// odometry may be wrong by.
const BACKED_OFF_M: f64 = 0.15;
/// The square of the cosine of 45°: what lies further from the beam's axis is not what the beam
/// misses.
const BESIDE_COS2: f64 = 0.5;

/// Where the sensor is and looks, world frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Beam {
    /// Metres.
    pub x_m: f64,
    /// Metres.
    pub y_m: f64,
    /// Cosine of its direction.
    pub cos: f64,
    /// Sine of its direction.
    pub sin: f64,
}

/// What is carried from tick to tick.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct RangeFilter {
    near: Option<NearPlace>,
}

/// Where something was near, in metres, and the direction in which it was seen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct NearPlace {
    x_m: f64,
    y_m: f64,
    cos: f64,
    sin: f64,
}

impl RangeFilter {
    /// Understands one reading in metres, infinite without an echo. The beam is worked out only
    /// where it matters.
    pub(super) fn understood(&mut self, value_m: f64, beam: impl FnOnce() -> Beam) -> Range {
        let echo = value_m.is_finite();
        let near_echo = echo && value_m < NEAR_M;
        if self.near.is_none() && !near_echo {
            return if echo { Range::Echo(value_m) } else { Range::NoEcho };
        }
        let beam = beam();
        if near_echo {
            self.near = Some(NearPlace::seen(&beam, value_m));
            return Range::Echo(value_m);
        }
        let in_the_way = self.near.is_some_and(|place| place.is_met_by(&beam));
        if echo && in_the_way || self.near.is_some_and(|place| place.is_backed_off_from(&beam)) {
            self.near = None;
        }
        match (echo, in_the_way && self.near.is_some()) {
            (true, _) => Range::Echo(value_m),
            (false, true) => Range::TooNear,
            (false, false) => Range::NoEcho,
        }
    }
}

impl NearPlace {
    fn seen(beam: &Beam, range_m: f64) -> Self {
        let &Beam { x_m, y_m, cos, sin } = beam;
        Self { x_m: x_m + cos * range_m, y_m: y_m + sin * range_m, cos, sin }
    }

    /// Whether the sensor is well before the place again, or beside it. Wheels that spin against a
    /// wall make odometry believe that it was driven through: beyond the place is not backed off.
    fn is_backed_off_from(&self, beam: &Beam) -> bool {
        let to = Vector2::new(self.x_m - beam.x_m, self.y_m - beam.y_m);
        let before_m = to.x * self.cos + to.y * self.sin;
        let beside_m = to.y * self.cos - to.x * self.sin;
        before_m >= BACKED_OFF_M || beside_m.abs() >= BACKED_OFF_M
    }

    /// Whether the beam points within 45° to the place, or as when the place was seen.
    fn is_met_by(&self, beam: &Beam) -> bool {
        let to = Vector2::new(self.x_m - beam.x_m, self.y_m - beam.y_m);
        let along_m = to.x * beam.cos + to.y * beam.sin;
        let same_way = self.cos * beam.cos + self.sin * beam.sin;
        (along_m > 0.0 && along_m * along_m >= BESIDE_COS2 * to.norm_squared())
            || (same_way > 0.0 && same_way * same_way >= BESIDE_COS2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn looking(x_m: f64, degrees: f64) -> impl FnOnce() -> Beam {
        let rad = crate::units::radians(degrees);
        move || Beam { x_m, y_m: 0.0, cos: libm::cos(rad), sin: libm::sin(rad) }
    }

    const NONE: f64 = f64::INFINITY;

    #[test]
    fn a_wall_that_vanishes_at_the_sensors_nose_is_too_near_until_the_robot_backs_off() {
        let mut filter = RangeFilter::default();
        #[rustfmt::skip]
        let drive = [
            // x, m   reading, m   meaning; the wall is at 1 m
            (0.80,    0.20,        Range::Echo(0.20)),
            (0.92,    0.08,        Range::Echo(0.08)),
            (0.97,    NONE,        Range::TooNear),
            (1.05,    NONE,        Range::TooNear),  // the wheels spin against the wall
            (0.90,    NONE,        Range::TooNear),  // 10 cm: back where it was near
            (0.84,    NONE,        Range::NoEcho),   // backed off, so there is really no echo
            (0.97,    NONE,        Range::NoEcho),
        ];
        for (x_m, value_m, meaning) in drive {
            assert_eq!(filter.understood(value_m, looking(x_m, 0.0)), meaning, "at {x_m} m");
        }
    }

    #[test]
    fn looking_elsewhere_is_no_echo_and_looking_back_is_too_near() {
        let mut filter = RangeFilter::default();
        filter.understood(0.06, looking(0.0, 0.0));
        assert_eq!(filter.understood(NONE, looking(0.0, 30.0)), Range::TooNear);
        assert_eq!(filter.understood(NONE, looking(0.0, 80.0)), Range::NoEcho);
        assert_eq!(filter.understood(0.7, looking(0.0, 80.0)), Range::Echo(0.7));
        assert_eq!(filter.understood(NONE, looking(0.0, 0.0)), Range::TooNear);
    }

    #[test]
    fn an_echo_from_behind_the_near_place_shows_that_it_is_free() {
        let mut filter = RangeFilter::default();
        filter.understood(0.06, looking(0.0, 0.0));
        assert_eq!(filter.understood(0.5, looking(0.0, 0.0)), Range::Echo(0.5));
        assert_eq!(filter.understood(NONE, looking(0.0, 0.0)), Range::NoEcho);
    }

    #[test]
    fn without_anything_near_no_echo_is_no_echo() {
        let mut filter = RangeFilter::default();
        assert_eq!(filter.understood(NONE, looking(0.0, 0.0)), Range::NoEcho);
        assert_eq!(filter.understood(0.0, looking(0.0, 0.0)), Range::Echo(0.0));
        assert_eq!(filter.understood(NONE, looking(0.0, 0.0)), Range::TooNear);
    }
}
