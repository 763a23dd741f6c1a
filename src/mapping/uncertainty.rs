//! The pose's covariance: how errors of wheels and gyro grow into errors of the pose.
//!
//! First order, P' = F P Fᵀ + Q, with F the derivative of one step by the pose before it (Thrun,
//! Burgard and Fox, *Probabilistic Robotics*, section 5.4). Each wheel's error has a variance that
//! grows with its way (Chong and Kleeman, *Accurate odometry and error modelling*, ICRA 1997); the
//! error that a wrong circumference or track width makes grows with the way itself and is what
//! `calibrate` is for (Borenstein and Feng's UMBmark).

use serde::{Deserialize, Serialize};

use super::gyro::DEGREE_RAD;

/// Variance of a wheel's way, m² a metre: 1 cm after a metre.
const WHEEL_M2_M: f64 = 1e-4;
/// Variance of the gyro's heading, rad² a radian of turn: LEGO's ±3° in a quarter turn.
const GYRO_RAD2_RAD: f64 = 9.0 * DEGREE_RAD * DEGREE_RAD / std::f64::consts::FRAC_PI_2;
/// Variance of the gyro's heading, rad² a second: what the removal of the bias leaves, 1° in a
/// minute.
const GYRO_RAD2_S: f64 = DEGREE_RAD * DEGREE_RAD / 60.0;
/// Variance of a heading in whole degrees: that of an even spread over a step.
const STEP_RAD2: f64 = DEGREE_RAD * DEGREE_RAD / 12.0;
/// No variance grows beyond this, so that all stay finite in a run of any length.
const LIMIT: f64 = 1e6;

/// Variances and covariances of x, y, heading: xx, xy, xh, yy, yh, hh in m², m·rad and rad².
pub(super) type Covariance = [f64; 6];

/// How far to trust one step.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Step {
    /// Cosine and sine of the heading along which the step is made.
    pub direction: [f64; 2],
    pub forward_m: f64,
    /// Ways of both wheels together, each taken positive.
    pub wheels_m: f64,
    pub turn_rad: f64,
    pub passed_s: f64,
    /// The inverse of the track width, 1/m.
    pub per_track_width_m: f64,
    /// Whether the heading is the gyro's.
    pub by_gyro: bool,
    /// What a slip may have falsified the step by, metres; 0 without.
    pub slip_m: f64,
}

/// The covariance before anything moved: the heading's half step.
pub(super) fn at_start() -> Covariance {
    [0.0, 0.0, 0.0, 0.0, 0.0, STEP_RAD2]
}

/// The covariance after a step.
pub(super) fn propagated(before: Covariance, step: &Step) -> Covariance {
    let [cos, sin] = step.direction;
    let wheels_m2 = WHEEL_M2_M * step.wheels_m;
    let slip_m2 = step.slip_m * step.slip_m;
    let turn_rad2 = if step.by_gyro {
        GYRO_RAD2_RAD * step.turn_rad.abs() + GYRO_RAD2_S * step.passed_s
    } else {
        wheels_m2 * (step.per_track_width_m * step.per_track_width_m)
    };
    let way_m = [step.forward_m * cos, step.forward_m * sin];
    let mut after = moved(before, way_m, step.direction, wheels_m2 / 4.0);
    after[0] += slip_m2;
    after[3] += slip_m2;
    after[5] += turn_rad2;
    // A covariance is never greater than its two variances.
    let [xx, _, _, yy, _, hh] = after;
    if xx <= LIMIT && yy <= LIMIT && hh <= LIMIT { after } else { before }
}

/// The covariance once the place has moved: an error of the heading has moved it aside, and the way
/// has a variance of its own along its direction.
pub(super) fn moved(
    [xx, xy, xh, yy, yh, hh]: Covariance,
    [x_m, y_m]: [f64; 2],
    [cos, sin]: [f64; 2],
    way_m2: f64,
) -> Covariance {
    // The covariances with the heading come first: the others are made of both theirs, from before
    // and after.
    let (xh_after, yh_after) = (xh - y_m * hh, yh + x_m * hh);
    let (way_x, way_y) = (cos * way_m2, sin * way_m2);
    [
        xx - y_m * (xh + xh_after) + cos * way_x,
        xy - y_m * yh + x_m * xh_after + cos * way_y,
        xh_after,
        yy + x_m * (yh + yh_after) + sin * way_y,
        yh_after,
        hh,
    ]
}

/// The way of a wheel in the degree that its encoder counts by, metres: LEGO's wheel of 56 mm.
const WHEEL_STEP_M: f64 = 0.056 * std::f64::consts::PI / 360.0;

/// Variances of the speeds, m²/s² and rad²/s²: what the errors above come to within `memory_s`,
/// over which speeds are smoothed, and at its two ends the steps in which wheels and gyro count.
/// The heading is taken for the gyro's; by wheels alone its error is of the same order.
pub(super) fn of_speeds(forward_m_s: f64, turn_rad_s: f64, memory_s: f64) -> [f64; 2] {
    let per_s2 = 1.0 / (memory_s * memory_s);
    // Of two wheels each, whose mean is the way.
    let way_m2 =
        WHEEL_M2_M * forward_m_s.abs() * memory_s / 2.0 + WHEEL_STEP_M * WHEEL_STEP_M / 12.0;
    let turn_rad2 =
        GYRO_RAD2_RAD * turn_rad_s.abs() * memory_s + GYRO_RAD2_S * memory_s + 2.0 * STEP_RAD2;
    [way_m2 * per_s2, turn_rad2 * per_s2]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn metre_ahead() -> Step {
        Step {
            direction: [1.0, 0.0],
            forward_m: 1.0,
            wheels_m: 2.0,
            turn_rad: 0.0,
            passed_s: 10.0,
            per_track_width_m: 1.0 / 0.1143,
            by_gyro: true,
            slip_m: 0.0,
        }
    }

    #[test]
    fn a_metre_ahead_is_uncertain_along_by_the_wheels_and_across_by_the_heading() {
        let [xx, xy, _, yy, yh, hh] = propagated(at_start(), &metre_ahead());
        assert!((libm::sqrt(xx) - 0.007).abs() < 0.001, "along: {} m", libm::sqrt(xx));
        assert!((libm::sqrt(yy) - 0.005).abs() < 0.001, "across: {} m", libm::sqrt(yy));
        assert!(xy.abs() < 1e-12, "{xy} m²");
        assert!(yh > 0.0 && hh > STEP_RAD2, "{yh} {hh}");
    }

    #[test]
    fn a_speed_is_uncertain_by_a_millimetre_a_second_standing_and_a_centimetre_driving() {
        let sd = |forward, turn| of_speeds(forward, turn, 0.1).map(libm::sqrt);
        let [forward, turn] = sd(0.0, 0.0);
        assert!((forward - 0.0014).abs() < 1e-4 && (turn - 0.071).abs() < 1e-3, "{forward} {turn}");
        let [forward, turn] = sd(-0.2, 1.0);
        assert!((forward - 0.010).abs() < 1e-3 && (turn - 0.152).abs() < 1e-2, "{forward} {turn}");
    }

    #[test]
    fn in_a_run_of_any_length_it_stays_finite() {
        let lost = Step { by_gyro: false, slip_m: 1.0, ..metre_ahead() };
        let covariance =
            (0..3_000_000).fold(at_start(), |covariance, _| propagated(covariance, &lost));
        assert!(covariance.iter().all(|value| value.abs() <= LIMIT), "{covariance:?}");
        assert!(covariance[0] > 0.9 * LIMIT || covariance[3] > 0.9 * LIMIT, "{covariance:?}");
    }

    #[test]
    fn slip_and_missing_gyro_make_it_worse() {
        let good = propagated(at_start(), &metre_ahead());
        let slipped = propagated(at_start(), &Step { slip_m: 0.05, ..metre_ahead() });
        let blind = propagated(at_start(), &Step { by_gyro: false, ..metre_ahead() });
        assert!(slipped[0] > good[0] && slipped[3] > good[3], "{slipped:?} {good:?}");
        assert!(blind[5] > good[5], "{blind:?} {good:?}");
    }
}
