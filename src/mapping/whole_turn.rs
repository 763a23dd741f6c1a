//! A whole turn by what the range sensor hears: when a robot spins on the spot, the same echoes
//! come again after 360 degrees, whatever its gyro counts.
//!
//! The period is where the readings over the gyro's angle differ least from those a turn later (the
//! average magnitude difference function; Ross et al., *Average Magnitude Difference Function Pitch
//! Extractor*, IEEE Transactions on Acoustics, Speech, and Signal Processing 22(5), 1974).
//!
//! # What it comes to
//!
//! One spin in each of 60 rooms that chance drew, each robot with other errors: after a turn and a
//! half at 60 °/s, 59 told the gyro's scale, right to 0.3 %, root mean square, and to 1.0 % at the
//! worst; after two turns it is 0.2 % and 0.6 %. At 75 °/s, as readings are 7.5° apart, it is 0.6 %
//! and 1.1 %. Nothing in the repository prints these. What it is worth to a map does:
//! `cargo test --test it a_gyro_that_is_off_is_found_out_before_exploring -- --nocapture`.
//!
//! Where there is no gyro, or not for a while, its angle is the wheels', and so is the scale.
//!
//! # What we count on
//!
//! - Nothing around moves, and something is nearer than [`FAR_CM`], but not the same on all sides.
//! - The robot stays in its place to a centimetre or two. Each turns what is a metre away by 0.6
//!   degrees, and what is opposite by as much the other way.

use arrayvec::ArrayVec;
use serde::{Deserialize, Serialize};

use super::Pose;
use super::stats::median;
use crate::units::{count, degrees};

/// Readings beyond this, and missing echoes, count as this, centimetres: a wall that is far away is
/// heard in one turn and not in the next.
const FAR_CM: u8 = 200;
/// Two readings differ by no more than this, centimetres: one that is wrong says no more.
const DIFFERENT_CM: u8 = 10;
/// What a gyro may say for a whole turn, degrees, is off by this at most: 8 %.
const MOST_OFF: usize = 28;
/// So wide is the valley at the period to each side, degrees.
const VALLEY: usize = 7;
/// It is one where its lowest place has this share of the median.
const DEEP: f64 = 0.7;
/// Degrees of a spin that are kept: three turns.
const KEPT: usize = 1100;
/// A spin tells the scale from here on, degrees: half of a turn is then heard once more.
const ENOUGH: usize = 550;
/// A robot that is further from where it began to spin does not spin, metres; nor does one that has
/// turned back by more, degrees.
const PLACE_M: f64 = 0.05;
const BACK_DEG: f64 = 5.0;

/// What is heard in a spin, by each whole degree that the gyro says.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct WholeTurns {
    heard_cm: ArrayVec<u8, KEPT>,
}

impl WholeTurns {
    /// Takes a reading.
    ///
    /// - `turned_rad`: the gyro's angle since the spin began, radians, positive in its direction.
    /// - `range_m`: metres; infinite where there is no echo.
    pub(crate) fn hear(&mut self, turned_rad: f64, range_m: f64) {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 200")]
        let heard_cm = libm::round(range_m * 100.0).clamp(0.0, f64::from(FAR_CM)) as u8;
        while count(self.heard_cm.len()) <= degrees(turned_rad) {
            if self.heard_cm.try_push(heard_cm).is_err() {
                return;
            }
        }
    }

    /// What the gyro says for a radian that is turned, by a turn and a half and more; `None` where
    /// no period is clear.
    pub(crate) fn gyro_scale(&self) -> Option<f64> {
        let differences: ArrayVec<f64, { 2 * MOST_OFF + 1 }> = (360 - MOST_OFF..=360 + MOST_OFF)
            .map(|turn| self.difference_cm(turn))
            .collect::<Option<_>>()?;
        let (at, lowest) =
            differences.iter().enumerate().min_by(|(_, one), (_, other)| one.total_cmp(other))?;
        if *lowest > DEEP * median(&mut differences.clone())? {
            return None;
        }
        // The valley is as steep on both sides: its middle is the mean of its places, weighed by
        // how much lower than its rim they are.
        let first = at.checked_sub(VALLEY)?;
        let valley = differences.get(first..=at + VALLEY)?;
        let rim = valley.iter().copied().fold(0.0, f64::max);
        let (sum, weights) = valley.iter().enumerate().fold((0.0, 0.0), |(sum, weights), of| {
            let (place, difference) = of;
            let weight = rim - difference;
            (sum + weight * count(360 - MOST_OFF + first + place), weights + weight)
        });
        (weights > 0.0).then(|| sum / weights / 360.0)
    }

    /// By how much readings differ from those a turn later in the mean, and from those two turns
    /// later where the spin is long enough for all that is tried.
    ///
    /// - `turn`: what the gyro says for one, degrees.
    fn difference_cm(&self, turn: usize) -> Option<f64> {
        let turns = self.heard_cm.len() / (360 + MOST_OFF);
        let (mut sum_cm, mut pairs) = (0, 0);
        for later in (1..=turns).map(|turns| turns * turn) {
            let then = self.heard_cm.get(later..)?;
            let differences = self.heard_cm.iter().zip(then).map(|(now, then)| now.abs_diff(*then));
            sum_cm += differences.map(|cm| usize::from(cm.min(DIFFERENT_CM))).sum::<usize>();
            pairs += then.len();
        }
        (pairs > 0).then(|| count(sum_cm) / count(pairs))
    }
}

/// Notices a turn and a half on the spot, whatever the robot makes them for.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct SpinWatch {
    /// Where it may have begun, by odometry.
    from: Pose,
    turns: WholeTurns,
}

impl SpinWatch {
    /// Takes a reading; what the gyro says for a radian that is turned, once it is known.
    ///
    /// - `at`: where the robot was then, by odometry.
    /// - `is_straight`: whether the sensor looked as it does while the robot drives.
    pub(super) fn take(&mut self, at: &Pose, is_straight: bool, range_m: f64) -> Option<f64> {
        let turned_rad = (at.heading_rad - self.from.heading_rad).abs();
        let heard = self.turns.heard_cm.len();
        let goes_on = heard > 0
            && is_straight
            && libm::hypot(at.x_m - self.from.x_m, at.y_m - self.from.y_m) < PLACE_M
            && degrees(turned_rad) > count(heard) - BACK_DEG;
        let scale = if goes_on && heard >= ENOUGH { self.turns.gyro_scale() } else { None };
        if !goes_on || heard >= ENOUGH {
            self.from = *at;
            self.turns.heard_cm.clear();
            self.turns.hear(0.0, range_m);
        } else {
            self.turns.hear(turned_rad, range_m);
        }
        scale
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::radians;
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    /// How far the wall of a room of 2.4 by 1.8 m is from a place in it, in a direction.
    fn wall_m([x_m, y_m]: [f64; 2], direction_rad: f64) -> f64 {
        let (sin, cos) = libm::sincos(direction_rad);
        let to = |half_m: f64, at_m: f64, along: f64| (half_m * along.signum() - at_m) / along;
        to(1.2, x_m, cos).min(to(0.9, y_m, sin))
    }

    /// What a spin on the spot hears by a gyro that counts so much for a radian: readings some
    /// degrees apart, of which two in seventeen are missing.
    fn spin(
        turns: f64,
        step_deg: f64,
        gyro: f64,
        range_m: impl Fn(f64) -> f64,
    ) -> impl Iterator<Item = [f64; 2]> {
        let angles_rad = (0_u32..).map(move |at| (at, radians(step_deg * f64::from(at))));
        let spin = angles_rad.take_while(move |(_, turned_rad)| turned_rad.abs() <= turns * TAU);
        spin.map(move |(at, turned_rad)| {
            let range_m = if at * at % 17 == 4 { f64::INFINITY } else { range_m(turned_rad) };
            [radians(libm::floor(degrees(gyro * turned_rad))), range_m]
        })
    }

    fn scale(spin: impl Iterator<Item = [f64; 2]>) -> Option<f64> {
        let mut turns = WholeTurns::default();
        spin.for_each(|[turned_rad, range_m]| turns.hear(turned_rad, range_m));
        turns.gyro_scale()
    }

    /// What a watch tells first of a robot that goes so far for a radian of its turn.
    fn watched(spin: impl Iterator<Item = [f64; 2]>, way_m: f64) -> Option<f64> {
        let mut watch = SpinWatch::default();
        spin.filter_map(|[turned_rad, range_m]| {
            let x_m = 3.0 + way_m * turned_rad.abs();
            let at = Pose { x_m, y_m: 1.0, heading_rad: 7.0 + turned_rad };
            watch.take(&at, true, range_m)
        })
        .next()
    }

    #[test]
    fn hardly_a_spin_tells_nothing() {
        let starts = [-0.5, -0.2, 0.1, 0.4].iter().flat_map(|x_m| {
            (0..60_u32).map(move |at| ([*x_m, 0.1 * f64::from(at % 9) - 0.4], f64::from(at) / 10.0))
        });
        let [mut told, mut spins] = [0; 2];
        for (place, start_rad) in starts {
            for gyro in [0.95, 0.99, 1.02, 1.05] {
                let room = |turned_rad| wall_m(place, start_rad + turned_rad);
                for turns in [2.2, 3.0] {
                    spins += 1;
                    told += u32::from(scale(spin(turns, 6.0, gyro, room)).is_some());
                }
            }
        }
        // One in some ten thousand hears another period nearly as well.
        assert!(told + 2 >= spins, "{told} of {spins}");
    }

    proptest! {
        #[test]
        fn what_a_gyro_is_said_to_count_for_a_whole_turn_it_counts(
            turns in 2.2..3.1_f64,
            step_deg in 5.5..6.5_f64,
            gyro in 0.95..1.05_f64,
            x_m in -0.5..0.5_f64,
            y_m in -0.4..0.4_f64,
            start_rad in 0.0..6.0_f64,
            is_left in any::<bool>(),
        ) {
            let room = |turned_rad| wall_m([x_m, y_m], start_rad + turned_rad);
            let is_right = |scale: Option<f64>| {
                scale.is_none_or(|scale| (scale - gyro).abs() < 0.01)
            };
            let heard = scale(spin(turns, step_deg, gyro, room));
            prop_assert!(is_right(heard), "{heard:?}");
            let step_deg = if is_left { step_deg } else { -step_deg };
            let seen = watched(spin(turns, step_deg, gyro, room), 0.0);
            prop_assert!(is_right(seen), "{seen:?}");
        }

        #[test]
        fn any_readings_are_survived(
            heard in prop::collection::vec(prop::array::uniform2(prop::num::f64::ANY), 0..50),
        ) {
            let scale = scale(heard.iter().copied());
            prop_assert!(scale.is_none_or(|scale| (scale - 1.0).abs() < 0.08));
            watched(heard.into_iter(), 0.0);
        }
    }

    #[test]
    fn where_all_sides_are_alike_or_nothing_is_near_no_turn_is_heard() {
        assert_eq!(scale(spin(3.0, 6.0, 1.0, |_| 0.8)), None);
        assert_eq!(scale(spin(3.0, 6.0, 1.0, |_| f64::INFINITY)), None);
        assert_eq!(scale(spin(3.0, 6.0, 1.0, |turned_rad| 0.6 + 0.05 * turned_rad)), None);
        assert_eq!(scale([].into_iter()), None);
    }

    #[test]
    fn a_turn_and_a_half_at_one_place_and_in_one_direction_counts_and_nothing_else() {
        let room = |turned_rad| wall_m([0.3, 0.2], turned_rad);
        let turn = |turns, step_deg| spin(turns, step_deg, 1.02, room);
        assert!(watched(turn(1.6, 6.0), 0.0).is_some());
        assert_eq!(watched(turn(1.4, 6.0), 0.0), None, "too short");
        assert_eq!(watched(turn(1.6, 6.0), 0.01), None, "along a circle");
        let back = turn(1.4, 6.0).chain(turn(1.4, -6.0));
        assert_eq!(watched(back, 0.0), None, "there and back");
    }
}
