//! Where the robot was, as it is known now.
//!
//! A pose is corrected when a wall is seen again, and what was placed before it stays where it was
//! put: after ten minutes a room's far side is off by what the robot has learnt since. So some
//! poses of the way are kept in the filter's state as they were, and corrected with all else
//! (stochastic cloning: Roumeliotis and Burdick, *Stochastic cloning*, 2002). Between two of them
//! what was placed moves as they did, in the proportion of the times.
//!
//! # What it comes to
//!
//! Points within 5 cm of a wall, as placed and as moved, exploring with the usual errors of gyro
//! and wheels, 20 runs each, before robots spun to find out the gyro's scale: `arena` 80 and 84 %,
//! `rooms` 77 and 82, a passage 81 and 83, slanted blocks 78 and 82, pillars 73 and 78. Since they
//! do, nothing changes (`ONBRICK_LONG=1 cargo test --test it figures_of_explore -- --nocapture`):
//! keyframes are for robots that do not explore, or could not hear what the gyro counts.
//!
//! # What was tried and gave little
//!
//! - More poses between those of the filter, each as odometry says from the two around it: 0.2
//!   points more within 5 cm of a wall, exploring (100 runs), and 1 in half an hour's `map`.
//!
//! # Not here
//!
//! How keyframes are corrected (`filter`). The grid that a running mission drives by, which stays
//! as it was drawn; that of the whole run is drawn once more at its end (`map`).

use arrayvec::ArrayVec;
use serde::{Deserialize, Serialize};

use super::filter::KEYFRAMES;
use super::pose::Correction;
use super::{MapPoint, Pose};
use crate::clock::{SECOND_NS, seconds};

/// The shortest time between two, while there are few.
const APART_NS: i64 = 20 * SECOND_NS;

/// A pose of the robot's way.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Keyframe {
    /// When the robot was there, nanoseconds of the run's clock.
    pub time_ns: i64,
    /// Its pose as it was estimated then: what was placed then was placed from here.
    pub placed: Pose,
    /// The same pose as it is estimated now.
    pub now: Pose,
}

impl Keyframe {
    fn correction(&self) -> Correction {
        Correction { from: self.placed, to: self.now }
    }
}

/// Where a pose or a place is as it is known now.
///
/// - `keyframes`: by time, see [`super::Estimator::keyframes`]; with none, nothing moves.
/// - `time_ns`: when it was placed. What is older than all keyframes moves as the first, what is
///   newer as the last.
#[must_use]
pub fn where_now(keyframes: &[Keyframe], time_ns: i64, placed: &Pose) -> Pose {
    let as_known_by = |keyframe: &Keyframe| {
        let mut pose = *placed;
        keyframe.correction().apply(&mut pose.x_m, &mut pose.y_m, &mut pose.heading_rad);
        pose
    };
    let next = keyframes.partition_point(|keyframe| keyframe.time_ns <= time_ns);
    match (keyframes.get(next.wrapping_sub(1)), keyframes.get(next)) {
        (None, None) => *placed,
        (Some(only), None) | (None, Some(only)) => as_known_by(only),
        (Some(before), Some(after)) => {
            let from_before = |ns: i64| seconds(ns.saturating_sub(before.time_ns));
            let share = from_before(time_ns) / from_before(after.time_ns);
            as_known_by(before).toward(&as_known_by(after), share)
        }
    }
}

/// Points where they are as it is known now; see [`where_now`].
#[must_use]
pub fn points_now(keyframes: &[Keyframe], points: &[MapPoint]) -> Vec<MapPoint> {
    points.iter().map(|point| point_now(keyframes, point)).collect()
}

/// A point where it is as it is known now.
pub(super) fn point_now(keyframes: &[Keyframe], point: &MapPoint) -> MapPoint {
    let placed = Pose { x_m: point.x_m, y_m: point.y_m, heading_rad: 0.0 };
    let Pose { x_m, y_m, .. } = where_now(keyframes, point.time_ns, &placed);
    MapPoint { x_m, y_m, ..*point }
}

/// The keyframes of a run, by time; the last is the newest pose, which has not moved.
pub type KeyframeList = ArrayVec<Keyframe, { KEYFRAMES + 1 }>;

/// Which poses are kept, by their slots in the filter: when each was, and what it was then.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Keyframes {
    kept: ArrayVec<(i64, Pose), KEYFRAMES>,
}

impl Keyframes {
    /// The slot for the pose of now; `None` where it is too early for one.
    ///
    /// When all are taken, the one goes that is missed least: whose neighbours are nearest to each
    /// other in time. The first stays, since the map hangs on it.
    pub(super) fn slot(&mut self, time_ns: i64, pose: Pose) -> Option<usize> {
        let newest_ns = self.kept.iter().map(|(time_ns, _)| *time_ns).max();
        if newest_ns.is_some_and(|newest_ns| time_ns.saturating_sub(newest_ns) < APART_NS) {
            return None;
        }
        if self.kept.is_full() {
            let slot = self.least(time_ns)?;
            *self.kept.get_mut(slot)? = (time_ns, pose);
            return Some(slot);
        }
        self.kept.push((time_ns, pose));
        Some(self.kept.len() - 1)
    }

    fn least(&self, now_ns: i64) -> Option<usize> {
        let by_time = self.by_time();
        let time_ns =
            |place: usize| by_time.get(place).map_or(now_ns, |(_, (time_ns, _))| *time_ns);
        (1..by_time.len())
            .min_by_key(|place| time_ns(place + 1).saturating_sub(time_ns(place - 1)))
            .and_then(|place| by_time.get(place).map(|(slot, _)| *slot))
    }

    /// Slots with their times and poses, by time.
    pub(super) fn by_time(&self) -> ArrayVec<(usize, (i64, Pose)), KEYFRAMES> {
        let mut by_time: ArrayVec<_, KEYFRAMES> = self.kept.iter().copied().enumerate().collect();
        by_time.sort_by_key(|(_, (time_ns, _))| *time_ns);
        by_time
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::radians;

    fn keyframe(second: i64, placed: Pose, now: Pose) -> Keyframe {
        Keyframe { time_ns: second * SECOND_NS, placed, now }
    }

    #[test]
    fn what_was_placed_moves_as_the_keyframes_around_it_did() {
        let here = Pose { x_m: 1.0, y_m: 0.0, heading_rad: 0.0 };
        let turned = Pose { heading_rad: radians(90.0), ..here };
        let frames = [
            keyframe(0, Pose::default(), Pose::default()),
            keyframe(10, here, turned),
            keyframe(30, here, here),
        ];
        let ahead = Pose { x_m: 2.0, ..here };
        let at = |second: i64| where_now(&frames, second * SECOND_NS, &ahead);
        assert_eq!(at(-1), ahead, "before the first");
        assert_eq!(at(30), ahead);
        assert_eq!(at(99), ahead, "after the last");
        let there = at(10);
        assert!((there.x_m - 1.0).abs() < 1e-12 && (there.y_m - 1.0).abs() < 1e-12, "{there:?}");
        assert!((there.heading_rad - turned.heading_rad).abs() < 1e-12, "{there:?}");
        let half = at(20);
        assert!((half.x_m - 1.5).abs() < 1e-12 && (half.y_m - 0.5).abs() < 1e-12, "{half:?}");
        let point = MapPoint { time_ns: 20 * SECOND_NS, x_m: 2.0, y_m: 0.0 };
        let moved = points_now(&frames, &[point]);
        assert_eq!(
            (moved[0].x_m, moved[0].y_m, moved[0].time_ns),
            (half.x_m, half.y_m, point.time_ns)
        );
        assert_eq!(points_now(&[], &[point]), [point], "without keyframes nothing moves");
    }

    #[test]
    fn the_first_stays_and_the_others_are_spread_over_the_run() {
        let mut frames = Keyframes::default();
        let mut taken = 0;
        for second in 0..1800 {
            let x_m = second as f64;
            let pose = Pose { x_m, ..Pose::default() };
            if let Some(slot) = frames.slot(second * SECOND_NS, pose) {
                assert_eq!(frames.kept[slot], (second * SECOND_NS, pose));
                taken += 1;
            }
        }
        assert_eq!(taken, 90);
        let seconds: Vec<i64> =
            frames.by_time().iter().map(|(_, (time_ns, _))| time_ns / SECOND_NS).collect();
        assert_eq!(seconds[0], 0);
        let widest = seconds.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap();
        assert!(widest <= 900 && *seconds.last().unwrap() >= 1780, "{seconds:?}");
    }
}
