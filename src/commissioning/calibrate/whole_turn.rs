//! A whole turn by what the range sensor hears: when a robot spins on the spot, the same echoes
//! come again after 360 degrees, whatever its gyro counts.
//!
//! The period is where the readings over the gyro's angle differ least from those one turn and two
//! turns later (the average magnitude difference function; Ross et al., *Average Magnitude
//! Difference Function Pitch Extractor*, IEEE Transactions on Acoustics, Speech, and Signal
//! Processing 22(5), 1974).
//!
//! # What we count on
//!
//! - Nothing around moves, and something is nearer than [`FAR_M`], but not the same on all sides.
//! - The robot stays in its place to a centimetre or two. Each turns what is a metre away by 0.6
//!   degrees, and what is opposite by as much the other way.

use super::fit::median;
use crate::units::{count, degrees};

/// Readings beyond this, and missing echoes, count as this, metres: a wall that is far away is
/// heard in one turn and not in the next.
const FAR_M: f64 = 1.5;
/// Two readings differ by no more than this, metres: one that is wrong says no more.
const DIFFERENT_M: f64 = 0.3;
/// By how much a gyro may be off, and in which steps that is tried, as a share.
const MOST: f64 = 0.08;
const STEP: f64 = 0.001;
/// More than any spin here has, by the gyro.
const MOST_DEGREES: f64 = 2000.0;
/// So wide is the valley at the period to each side, as a share: 5 degrees.
const VALLEY: f64 = 0.015;
/// It is one where its lowest place has this share of the median.
const DEEP: f64 = 0.6;

/// What the gyro says for a radian that is turned, by a spin of three turns and more; `None` where
/// no period is clear.
///
/// - `heard`: the gyro's angle since the spin began, radians, positive in its direction, and what
///   the sensor said there, metres.
pub(super) fn gyro_scale(heard: &[[f64; 2]]) -> Option<f64> {
    let profile_m = by_degree(heard);
    let tried: Vec<[f64; 2]> = (0..)
        .map(|step| 1.0 - MOST + STEP * f64::from(step))
        .take_while(|scale| *scale < 1.0 + MOST)
        .filter_map(|scale| Some([scale, difference_m(&profile_m, scale)?]))
        .collect();
    let lowest = tried.iter().copied().min_by(|one, other| one[1].total_cmp(&other[1]))?;
    let differences: Vec<f64> = tried.iter().map(|[_, difference_m]| *difference_m).collect();
    let median_m = median(differences)?;
    let is_inside = (lowest[0] - 1.0).abs() < MOST - VALLEY;
    if !is_inside || lowest[1] > DEEP * median_m {
        return None;
    }
    // The valley is as steep on both sides: its middle is the mean of its places, weighed by how
    // much lower than its rim they are.
    let near = tried.iter().filter(|[scale, _]| (scale - lowest[0]).abs() < VALLEY);
    let rim_m = near.clone().map(|[_, difference_m]| *difference_m).fold(0.0, f64::max);
    let (sum, weights) = near.fold((0.0, 0.0), |(sum, weights), [scale, difference_m]| {
        let weight = rim_m - difference_m;
        (sum + weight * scale, weights + weight)
    });
    (weights > 0.0).then(|| sum / weights)
}

/// The reading at each whole degree of the gyro, as far as a spin goes.
fn by_degree(heard: &[[f64; 2]]) -> Vec<f64> {
    let mut profile_m = Vec::new();
    for [turned_rad, range_m] in heard {
        while count(profile_m.len()) <= degrees(*turned_rad).min(MOST_DEGREES) {
            profile_m.push(if *range_m < FAR_M { *range_m } else { FAR_M });
        }
    }
    profile_m
}

/// By how much readings differ from those one turn and two turns later, in the mean, metres.
fn difference_m(profile_m: &[f64], scale: f64) -> Option<f64> {
    let (mut sum_m, mut pairs) = (0.0, 0_usize);
    for turns in [1.0, 2.0] {
        let later = 360.0 * turns * scale;
        let (whole, part) = (libm::floor(later), later - libm::floor(later));
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 800")]
        let later = profile_m.get(whole as usize..)?;
        for (now_m, next_m) in profile_m.iter().zip(later.windows(2)) {
            let then_m = next_m[0] + part * (next_m[1] - next_m[0]);
            sum_m += (now_m - then_m).abs().min(DIFFERENT_M);
            pairs += 1;
        }
    }
    (pairs > 0).then(|| sum_m / count(pairs))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::radians;
    use proptest::prelude::*;

    /// How far the wall of a room of 2.4 by 1.8 m is from a place in it, in a direction.
    fn wall_m([x_m, y_m]: [f64; 2], direction_rad: f64) -> f64 {
        let (sin, cos) = libm::sincos(direction_rad);
        let to = |half_m: f64, at_m: f64, along: f64| (half_m * along.signum() - at_m) / along;
        to(1.2, x_m, cos).min(to(0.9, y_m, sin))
    }

    /// What a spin of three turns hears by a gyro that counts so much for a radian: a reading each
    /// 6 degrees, as ten a second are, of which two in seventeen are missing.
    fn spin(gyro: f64, range_m: impl Fn(f64) -> f64) -> Vec<[f64; 2]> {
        let reading = |at: u32| {
            let turned_rad = radians(6.0 * f64::from(at));
            let range_m = if at * at % 17 == 4 { f64::INFINITY } else { range_m(turned_rad) };
            [radians(libm::floor(degrees(gyro * turned_rad))), range_m]
        };
        (0..=180).map(reading).collect()
    }

    proptest! {
        #[test]
        fn what_a_gyro_counts_for_a_whole_turn_is_heard(
            gyro in 0.95..1.05_f64,
            x_m in -0.5..0.5_f64,
            y_m in -0.4..0.4_f64,
            start_rad in 0.0..6.0_f64,
        ) {
            let heard = spin(gyro, |turned_rad| wall_m([x_m, y_m], start_rad + turned_rad));
            let scale = gyro_scale(&heard);
            prop_assert!(scale.is_some_and(|scale| (scale - gyro).abs() < 0.004), "{scale:?}");
        }

        #[test]
        fn any_readings_are_survived(
            heard in prop::collection::vec(prop::array::uniform2(prop::num::f64::ANY), 0..50),
        ) {
            let scale = gyro_scale(&heard);
            prop_assert!(scale.is_none_or(|scale| (scale - 1.0).abs() < MOST));
        }
    }

    #[test]
    fn where_all_sides_are_alike_or_nothing_is_near_no_turn_is_heard() {
        assert_eq!(gyro_scale(&spin(1.0, |_| 0.8)), None);
        assert_eq!(gyro_scale(&spin(1.0, |_| f64::INFINITY)), None);
        assert_eq!(gyro_scale(&spin(1.0, |turned_rad| 0.6 + 0.05 * turned_rad)), None);
        assert_eq!(gyro_scale(&[]), None);
    }
}
