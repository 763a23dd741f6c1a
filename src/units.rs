//! Quantities: newtypes for numbers with a legal range, angles, and whole numbers of floats.
//!
//! Inside the program a quantity is an `f64` in metres, seconds or radians, and its name says so
//! (`range_m`, `heading_rad`). A newtype stands where a number has a legal range or where two kinds
//! of number would be mixed up: at the border to the kernel's files.

use std::f64::consts::PI;
use std::fmt;

/// A motor's duty cycle, percent: −100 to 100. One beyond cannot exist.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Duty(i8);

/// A duty cycle beyond ±100 %.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a duty cycle of {percent} % is beyond ±100 %")]
pub struct DutyOutOfRange {
    /// The number.
    pub percent: i32,
}

impl Duty {
    /// All there is, forwards.
    pub const MAX: Self = Self(100);

    /// All there is, backwards.
    pub const MIN: Self = Self(-100);

    /// A duty cycle of this many percent.
    ///
    /// # Errors
    ///
    /// [`DutyOutOfRange`] beyond ±100.
    pub fn new(percent: i32) -> Result<Self, DutyOutOfRange> {
        match i8::try_from(percent) {
            Ok(small @ -100..=100) => Ok(Self(small)),
            _ => Err(DutyOutOfRange { percent }),
        }
    }

    /// The number of percent.
    #[must_use]
    pub fn percent(self) -> i32 {
        i32::from(self.0)
    }
}

/// Degrees as radians.
#[must_use]
pub fn radians(degrees: f64) -> f64 {
    degrees * (PI / 180.0)
}

/// Radians as degrees.
#[must_use]
pub fn degrees(radians: f64) -> f64 {
    radians * (180.0 / PI)
}

/// The same angle in −π < angle ≤ π. An angle that is not finite comes back as NaN.
///
/// Computed with remainders only, so that it repeats bit for bit everywhere.
#[must_use]
pub fn wrap_rad(angle_rad: f64) -> f64 {
    let turn = 2.0 * PI;
    let rest = angle_rad % turn;
    if rest > PI {
        rest - turn
    } else if rest <= -PI {
        rest + turn
    } else {
        rest
    }
}

/// A number held between two others, for bounds that come from a file's numbers: `f64::clamp`
/// panics where they are not in order or not numbers. Here the upper one then holds, and one that
/// is not a number does not.
#[must_use]
pub fn within(number: f64, low: f64, high: f64) -> f64 {
    number.max(low).min(high)
}

/// The lower left and the upper right corner of the least rectangle around places; from infinity to
/// minus infinity where there are none.
#[must_use]
pub fn bounds(places: impl IntoIterator<Item = [f64; 2]>) -> [[f64; 2]; 2] {
    let nothing = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
    places.into_iter().fold(nothing, |[low, high], place| {
        let least = [low[0].min(place[0]), low[1].min(place[1])];
        [least, [high[0].max(place[0]), high[1].max(place[1])]]
    })
}

/// The nearest whole number. What is too large for one stays at its end; what is not a number is 0.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "a cast from float saturates")]
pub fn rounded(value: f64) -> i32 {
    libm::round(value) as i32
}

/// The nearest number of parts of one: with 1000 `parts`, three digits behind the point.
#[must_use]
pub fn rounded_to(value: f64, parts: f64) -> f64 {
    libm::round(value * parts) / parts
}

/// The next whole number below, else as [`rounded`].
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "a cast from float saturates")]
pub fn floored(value: f64) -> i32 {
    libm::floor(value) as i32
}

/// How many there are, for reckoning with it.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "exact below 2^53")]
pub fn count(things: usize) -> f64 {
    things as f64
}

/// How many there are, for people: `1 point`, `2 points`.
///
/// - `thing`: one of them, a noun that takes an s.
#[must_use]
pub fn counted<N: fmt::Display + PartialEq + From<u8>>(count: N, thing: &str) -> String {
    let s = if count == N::from(1) { "" } else { "s" };
    format!("{count} {thing}{s}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn one_thing_is_no_things() {
        let texts = [0, 1, 2].map(|count| counted(count, "point"));
        assert_eq!(texts, ["0 points", "1 point", "2 points"]);
        assert_eq!(counted(1_usize, "brick"), "1 brick");
    }

    proptest! {
        #[test]
        fn a_wrapped_angle_lies_in_one_turn_and_points_the_same_way(angle in -1e6..1e6) {
            let wrapped = wrap_rad(angle);
            prop_assert!(wrapped > -PI && wrapped <= PI, "{angle} became {wrapped}");
            prop_assert!((libm::cos(angle) - libm::cos(wrapped)).abs() < 1e-6);
            prop_assert!((libm::sin(angle) - libm::sin(wrapped)).abs() < 1e-6);
        }

        #[test]
        fn degrees_and_radians_are_inverse(angle in -1e6..1e6) {
            prop_assert!((degrees(radians(angle)) - angle).abs() <= 1e-9 * angle.abs());
        }
    }

    #[test]
    fn a_duty_cycle_is_within_a_hundred_percent() {
        for percent in [-100, -1, 0, 100] {
            assert_eq!(Duty::new(percent).map(Duty::percent), Ok(percent));
        }
        for percent in [-101, 101, 156, i32::MIN, i32::MAX] {
            assert_eq!(Duty::new(percent), Err(DutyOutOfRange { percent }));
        }
    }

    #[test]
    fn half_a_turn_is_positive() {
        assert!((wrap_rad(-PI) - PI).abs() < 1e-15);
        assert!((wrap_rad(3.0 * PI) - PI).abs() < 1e-12);
        assert!(wrap_rad(f64::NAN).is_nan());
        assert!(wrap_rad(f64::INFINITY).is_nan());
    }
}
