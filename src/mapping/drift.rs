//! A slow drift of the gyro, told from the wheels while the robot drives.
//!
//! A gyro whose start was disturbed a little drifts by less than a degree in the seconds that the
//! robot stands before a run, and by 20° in two minutes. The encoders see it: over a while, what
//! the gyro turned more than they did is
//!
//! ```text
//! drift · time  +  mismatch of the wheels · way  +  error of scale · turn
//!     +  slip  +  rounding of the last reading  -  rounding of the one before
//! ```
//!
//! and a robot that stands, drives and turns both ways tells the three apart. They are estimated
//! together by recursive least squares with what is known of them beforehand (a Kalman filter;
//! Thrun, Burgard and Fox, *Probabilistic Robotics*, 3.2), and with the rounding, which two
//! observations share: over a minute of standing it is one degree, not one for each of them.
//!
//! A drift may begin at any time. So the estimate is of a drift that began when it was last begun
//! again: as long as what was seen since is less than half of [`LEAST_RAD_S`], none has begun
//! (a cumulative sum; Page, *Continuous inspection schemes*, 1954). What the wheels' mismatch and
//! the scale are, without a drift until then, stays known; but the mismatch wanders, or a robot
//! that drives long ways straight would find a drift in it. A drift counts when the estimate is
//! [`CERTAIN`] standard deviations from none, and 20 seconds old: before that a wheel that slips at
//! a wall looks the same. From then on the bias follows the estimate, which may wander. What the
//! drift has done since it began is made up for (`filter`).
//!
//! Landmarks are witnesses: a drift would have turned them by now, and what they say of it counts
//! by its own certainty ([`Drift::with`]).
//!
//! Weighing the estimate by the probability that there is a drift, instead, makes runs without one
//! worse: `map` is off by 4.1° after two minutes for 3.0°.
//!
//! # What it comes to
//!
//! Six explorations of `rooms` with 0.2 °/s from 150 s on: two minutes after it began the heading
//! is off by 2° to 5° at the most, and by 0° to 2.4° at the end. Heading after two minutes of
//! exploring, root mean square of 16 runs in `arena` and `rooms`: drifts of 0.1, -0.15 and 0.19
//! °/s, 12° to 23° in all, left about 2°, and 6.4° at the worst. The mission `map`, which seldom
//! stands and turns one way, keeps all of it, because mismatched wheels explain it as well.
//! `cargo test --test it figures::drift -- --nocapture` prints all this.
//!
//! By hand, the encoders alone over the recordings of 149 explorations of 5 to 10 minutes: with
//! 2.8, 3.2 and 3.5 deviations as certain, 5, 1 and 0 of them were given a drift that they had not,
//! and one of 0.2 °/s was found after 38, 46 and 54 s in the mean. The one whose map was looked at
//! was turned by 7°. Before drifts could begin, those six explorations were off by 3° to 15°, and
//! by 1.5° to 12° at the end. A drift that ends again is followed slowly: there for 150 s, with 2.8
//! deviations, it leaves 11° at the most in the mean of 24 runs.
//!
//! Wheels that are not alike must not look like a drift. By hand, `onbrick demo --world` of 14
//! furnished rooms that chance drew, 300 s, one wheel larger by 2 % or 3 % and the gyro's scale off
//! by 2 %: with a mismatch of 0.3 % for its standard deviation 21 of 28 runs were given a drift
//! that they had not, and lost their place by 10 cm and more; with 1 % one was. With 0.5 % and
//! 0.6 % it was none of those, but one of 24 in a room of slanted blocks whose robot had no errors.
//! Drifts of 0.1 to 0.19 °/s leave as much as before, 2.2° and 2.3°, root mean square of 66 runs of
//! two minutes; the mission `map` paid for it, which kept half of them and keeps all.
//!
//! # Not here
//!
//! Standstills (`gyro`): they tell a drift of 1 °/s within two seconds, and one of 0.2 °/s not at
//! all.

use std::array;

use serde::{Deserialize, Serialize};

use super::gyro::DEGREE_RAD;

/// Numbers that are estimated: drift in rad/s, the wheels' mismatch in radians of turn a metre, the
/// share by which the gyro turns more than the encoders, and by how much the gyro's last reading is
/// above the truth, radians.
const STATES: usize = 4;
const DRIFT: usize = 0;
const MISMATCHED: usize = 1;
const ROUNDED: usize = 3;
/// Standard deviations of the first three before anything was seen: the drift that
/// `runtime::prepare` lets pass; one wheel larger than the other by 1 %, as a share of the track
/// width; the scales of gyro (1 to 4 % in `lego-sensor-tables`) and track width.
const DRIFT_RAD_S: f64 = 0.2 * DEGREE_RAD;
const MISMATCH: f64 = 0.01;
const SCALE: f64 = 0.03;

/// An observation is made of this much time, seconds, so that some are of standing alone and some
/// of driving.
const WINDOW_S: f64 = 1.0;
/// Variance of the rounding to whole degrees, and of what tyres creep in a metre of either wheel
/// (0.7°).
const ROUNDED_RAD2: f64 = DEGREE_RAD * DEGREE_RAD / 12.0;
const CREEP_RAD2_M: f64 = 0.5 * DEGREE_RAD * DEGREE_RAD;
/// An observation further off than this many standard deviations is a hand or a slip, no drift.
const OUTLIER: f64 = 3.5;
/// How fast the drift wanders, variance in (rad/s)² a second: 0.004 °/s in a second.
const WANDER_RAD2_S3: f64 = 1.6e-5 * DEGREE_RAD * DEGREE_RAD;
/// How fast the wheels' mismatch wanders, variance in (rad/m)² a metre of either wheel: 0.3° a
/// metre in one.
const WANDER_RAD2_M3: f64 = 0.1 * DEGREE_RAD * DEGREE_RAD;
/// A drift that is less than half of this has not begun, 0.1 °/s; that can be told after so long,
/// seconds.
const LEAST_RAD_S: f64 = 0.1 * DEGREE_RAD;
const EARLY_S: f64 = 10.0;
/// Standard deviations between an estimate and no drift from which on there is one: one that is
/// older than this, seconds; and one that is as old as the run, which is likelier. From the last
/// one on the bias follows a drift: see the module.
const CERTAIN: f64 = 3.2;
const OLD_S: f64 = 20.0;
const CERTAIN_FROM_START: f64 = 2.5;
const FOLLOWED: f64 = 1.0;

/// What passed since the last observation.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Turned {
    /// Seconds.
    pub passed_s: f64,
    /// The robot's way, backwards negative, and the ways of both wheels, both counting: metres.
    pub forward_m: f64,
    pub wheels_m: f64,
    /// Turn by the encoders and by the gyro, bias and all: radians.
    pub encoder_rad: f64,
    pub gyro_rad: f64,
}

/// See the module.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct DriftWatch {
    since: Turned,
    /// How long ago the drift began, if there is one, seconds; and whether later than the run.
    begun_s: f64,
    began_later: bool,
    estimate: [f64; STATES],
    /// Covariances less what they were at first, so that nothing seen is all zero.
    learnt: [[f64; STATES]; STATES],
}

/// A number as the sum of what said something of it, each by its weight, the inverse of a variance.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Information {
    pub weighted: f64,
    pub weight: f64,
}

impl Information {
    pub(super) fn fade(&mut self, by: f64) {
        self.weighted *= by;
        self.weight *= by;
    }
}

/// What is known of the drift.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Drift {
    rad_s: f64,
    variance: f64,
    /// How long ago it began, if there is one, seconds; and whether that was with the run.
    begun_s: f64,
    from_start: bool,
}

/// What is to be done about a drift.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Verdict {
    /// Nothing: it cannot be told yet, or is what is known.
    Wait,
    /// None has begun.
    NotBegun,
    /// This bias is to be removed, rad/s.
    Remove(f64),
}

impl Drift {
    /// Together with what landmarks say, beyond a bias that is being removed.
    pub(super) fn with(self, seen: Information, bias_rad_s: f64) -> Self {
        let weight = 1.0 / self.variance + seen.weight;
        let weighted = self.rad_s / self.variance + seen.weight * bias_rad_s + seen.weighted;
        Self { rad_s: weighted / weight, variance: 1.0 / weight, ..self }
    }

    /// What to do where a bias is being removed.
    ///
    /// - `is_drift`: whether that one is a drift, too.
    pub(super) fn verdict(self, bias_rad_s: f64, is_drift: bool) -> Verdict {
        let off = self.rad_s - bias_rad_s;
        let is_beyond = |most: f64| off * off > most * most * self.variance;
        // Without what is known beforehand, which pulls the estimate towards none.
        let seen = 1.0 - self.variance / (DRIFT_RAD_S * DRIFT_RAD_S);
        let is_found = match is_drift {
            true => is_beyond(FOLLOWED),
            false if self.from_start => is_beyond(CERTAIN_FROM_START),
            false => self.begun_s > OLD_S && is_beyond(CERTAIN),
        };
        if is_found {
            Verdict::Remove(self.rad_s)
        } else if !is_drift && self.begun_s > EARLY_S && off.abs() < LEAST_RAD_S / 2.0 * seen {
            Verdict::NotBegun
        } else {
            Verdict::Wait
        }
    }
}

impl DriftWatch {
    /// Takes what an update turned; the drift, as often as there is something new to tell of it.
    ///
    /// - `turned`: `None` where gyro or wheels cannot be believed: what has passed since the last
    ///   observation is left out with it.
    pub(super) fn update(
        &mut self,
        turned: Option<Turned>,
        per_track_width_m: f64,
    ) -> Option<Drift> {
        let Some(turned) = turned else {
            self.since = Turned::default();
            self.forget(ROUNDED, 0.0);
            return None;
        };
        let since = &mut self.since;
        since.passed_s += turned.passed_s;
        since.forward_m += turned.forward_m;
        since.wheels_m += turned.wheels_m;
        since.encoder_rad += turned.encoder_rad;
        since.gyro_rad += turned.gyro_rad;
        if since.passed_s < WINDOW_S {
            return None;
        }
        let observed = std::mem::take(since);
        self.observe(&observed, per_track_width_m);
        Some(Drift {
            rad_s: self.estimate[DRIFT],
            variance: self.drift_variance(),
            begun_s: self.begun_s,
            from_start: !self.began_later,
        })
    }

    /// No other drift than this has been there, and one may begin now.
    pub(super) fn begin_again(&mut self, drift_rad_s: f64) {
        let shared: [f64; STATES] = array::from_fn(|row| match row {
            DRIFT => self.drift_variance(),
            _ => self.learnt[row][DRIFT],
        });
        self.learn(drift_rad_s - self.estimate[DRIFT], shared[DRIFT], &shared);
        self.forget(DRIFT, drift_rad_s);
        (self.begun_s, self.began_later) = (0.0, true);
    }

    fn drift_variance(&self) -> f64 {
        DRIFT_RAD_S * DRIFT_RAD_S + self.learnt[DRIFT][DRIFT]
    }

    /// Of one of the numbers no more is known than beforehand.
    fn forget(&mut self, number: usize, estimate: f64) {
        self.estimate[number] = estimate;
        self.learnt[number] = [0.0; STATES];
        self.learnt.iter_mut().for_each(|row| row[number] = 0.0);
    }

    /// The Kalman filter's update.
    ///
    /// - `shared`: the innovation's covariance with the numbers.
    fn learn(&mut self, innovation: f64, variance: f64, shared: &[f64; STATES]) {
        for (row, gain) in shared.iter().map(|shared| shared / variance).enumerate() {
            self.estimate[row] += gain * innovation;
            for (learnt, shared) in self.learnt[row].iter_mut().zip(shared) {
                *learnt -= gain * shared;
            }
        }
    }

    fn observe(&mut self, seen: &Turned, per_track_width_m: f64) {
        let by = [seen.passed_s, seen.forward_m, seen.encoder_rad, -1.0];
        let mismatch_rad_m = MISMATCH * per_track_width_m;
        let first = [
            DRIFT_RAD_S * DRIFT_RAD_S,
            mismatch_rad_m * mismatch_rad_m,
            SCALE * SCALE,
            ROUNDED_RAD2,
        ];
        let wandered = [WANDER_RAD2_S3 * seen.passed_s, WANDER_RAD2_M3 * seen.wheels_m];
        for (number, variance) in [DRIFT, MISMATCHED].into_iter().zip(wandered) {
            // No more uncertain than beforehand.
            self.learnt[number][number] = (self.learnt[number][number] + variance).min(0.0);
        }
        let mut covariance = self.learnt;
        for (at, variance) in first.into_iter().enumerate() {
            covariance[at][at] += variance;
        }
        let mut shared = covariance.map(|row| dot(&row, &by));
        let variance = dot(&by, &shared) + ROUNDED_RAD2 + CREEP_RAD2_M * seen.wheels_m;
        let innovation = seen.gyro_rad - seen.encoder_rad - dot(&by, &self.estimate);
        // Not a number is an outlier, too.
        let is_likely = innovation * innovation <= OUTLIER * OUTLIER * variance;
        // The reading that ends this observation begins the next one.
        self.forget(ROUNDED, 0.0);
        shared[ROUNDED] = ROUNDED_RAD2;
        if is_likely {
            self.begun_s += seen.passed_s;
            self.learn(innovation, variance, &shared);
        }
    }
}

fn dot(one: &[f64; STATES], other: &[f64; STATES]) -> f64 {
    one.iter().zip(other).map(|(one, other)| one * other).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::Geometry;

    /// Seconds of an update, and what a wheel makes in one at the robot's speed.
    const STEP_S: f64 = 0.02;
    const STEP_M: f64 = 0.002;

    /// A drift, degrees a second, and from when on; how much larger one wheel is than the other, as
    /// a share of the track width; when a hand turns the robot by 20°.
    #[derive(Default)]
    struct Driven {
        drift_dps: f64,
        from_s: u32,
        mismatch: f64,
        hand_s: Option<u32>,
    }

    impl Driven {
        /// A robot that drives for four seconds, turns on the spot for two, to and fro, and looks
        /// round for six; the bias at the end, in degrees a second.
        fn bias_dps(&self, seconds: u32) -> f64 {
            let per_track_width_m = Geometry::seed().per_track_width_m();
            let (mut watch, mut bias_rad_s, mut told_rad) = (DriftWatch::default(), 0.0, 0.0);
            let mut true_rad = 0.0;
            for step in 0..seconds * 50 {
                let (second, way) = (step / 50, if step / 600 % 2 == 0 { 1.0 } else { -1.0 });
                let [left_m, right_m] = match second % 12 {
                    0..4 => [STEP_M; 2],
                    4..6 => [-STEP_M * way, STEP_M * way],
                    _ => [0.0; 2],
                };
                let encoder_rad = (right_m - left_m) * per_track_width_m;
                let differ_rad = (right_m + left_m) / 2.0 * self.mismatch * per_track_width_m;
                true_rad += encoder_rad + differ_rad;
                if second >= self.from_s {
                    true_rad += self.drift_dps * DEGREE_RAD * STEP_S;
                }
                if self.hand_s == Some(second) {
                    true_rad += 20.0 * DEGREE_RAD / 50.0;
                }
                let degrees = libm::round(true_rad / DEGREE_RAD);
                let gyro_rad = degrees * DEGREE_RAD - told_rad;
                told_rad = degrees * DEGREE_RAD;
                let turned = Turned {
                    passed_s: STEP_S,
                    forward_m: (left_m + right_m) / 2.0,
                    wheels_m: left_m.abs() + right_m.abs(),
                    encoder_rad,
                    gyro_rad,
                };
                let drift = watch.update(Some(turned), per_track_width_m);
                match drift.map(|drift| drift.verdict(bias_rad_s, bias_rad_s != 0.0)) {
                    Some(Verdict::Remove(rad_s)) => bias_rad_s = rad_s,
                    Some(Verdict::NotBegun) => watch.begin_again(bias_rad_s),
                    Some(Verdict::Wait) | None => {}
                }
            }
            bias_rad_s / DEGREE_RAD
        }
    }

    #[test]
    fn a_slow_drift_is_found_within_a_minute() {
        for drift_dps in [0.19, -0.19] {
            let found_dps = Driven { drift_dps, ..Driven::default() }.bias_dps(60);
            assert!((found_dps - drift_dps).abs() < 0.05, "{found_dps} for {drift_dps}");
        }
        let beside = Driven { drift_dps: 0.12, mismatch: 0.002, ..Driven::default() };
        let found_dps = beside.bias_dps(120);
        assert!((found_dps - 0.12).abs() < 0.05, "{found_dps} beside a mismatch");
    }

    #[test]
    fn a_drift_that_begins_in_mid_run_is_found() {
        let late = Driven { drift_dps: 0.2, from_s: 300, ..Driven::default() };
        assert!(late.bias_dps(300) == 0.0, "it has not begun");
        let found_dps = late.bias_dps(345);
        assert!((found_dps - 0.2).abs() < 0.05, "{found_dps} after three quarters of a minute");
    }

    #[test]
    fn two_minutes_of_standing_are_uncertain_by_one_rounding_alone() {
        let (mut watch, mut told) = (DriftWatch::default(), None);
        for _ in 0..120 {
            told = watch.update(Some(Turned { passed_s: 1.0, ..Turned::default() }), 8.0);
        }
        let drift = told.expect("an observation a second");
        let sd_dps = libm::sqrt(drift.variance) / DEGREE_RAD;
        // What it may have wandered lately is all that is left.
        assert!(drift.rad_s == 0.0 && sd_dps < 0.025, "{sd_dps}");
    }

    #[test]
    fn what_is_certain_and_old_enough_is_a_drift_and_what_is_small_has_not_begun() {
        let sd_rad_s = 0.03 * DEGREE_RAD;
        let of = |deviations: f64, begun_s: f64, from_start: bool| Drift {
            rad_s: deviations * sd_rad_s,
            variance: sd_rad_s * sd_rad_s,
            begun_s,
            from_start,
        };
        let removed = |deviations: f64| Verdict::Remove(deviations * sd_rad_s);
        for (deviations, begun_s, from_start, is_drift, verdict) in [
            (3.3, 21.0, false, false, removed(3.3)),
            (3.3, 19.0, false, false, Verdict::Wait),
            (3.1, 21.0, false, false, Verdict::Wait),
            (2.7, 1.0, true, false, removed(2.7)),
            (1.5, 21.0, false, false, Verdict::NotBegun),
            (1.5, 9.0, false, false, Verdict::Wait),
            (1.5, 21.0, false, true, removed(1.5)),
            (0.5, 21.0, false, true, Verdict::Wait),
        ] {
            let drift = of(deviations, begun_s, from_start);
            assert_eq!(drift.verdict(0.0, is_drift), verdict, "{drift:?}, {is_drift}");
        }
    }

    #[test]
    fn wheels_that_differ_are_no_drift_and_a_hand_is_none() {
        for mismatch in [0.0, 0.004, -0.004] {
            let found_dps = Driven { mismatch, ..Driven::default() }.bias_dps(120);
            assert!(found_dps == 0.0, "{found_dps} degrees a second with {mismatch}");
        }
        let hand = Driven { mismatch: 0.001, hand_s: Some(33), ..Driven::default() };
        assert!(hand.bias_dps(120) == 0.0, "a hand has turned the robot");
    }

    #[test]
    fn what_cannot_be_believed_is_left_out_with_what_was_seen_before_it() {
        let mut watch = DriftWatch::default();
        let turned = Turned { passed_s: 0.9, gyro_rad: 0.1, ..Turned::default() };
        assert_eq!(watch.update(Some(turned), 8.0), None);
        assert_eq!(watch.update(None, 8.0), None);
        assert_eq!(watch, DriftWatch::default());
        let odd = Turned { passed_s: f64::INFINITY, gyro_rad: f64::NAN, ..Turned::default() };
        watch.update(Some(odd), 8.0);
        assert_eq!(watch, DriftWatch::default(), "no number is no observation");
    }
}
