//! Wheels that are told to turn and do not.
//!
//! The kernel's own `stalled` flag is advisory and speaks only of a rotor that stands quite still; a wheel that shakes against a wall is
//! not stalled to it. Here a wheel counts as blocked when over a while it has turned much less than it was told to.

use serde::{Deserialize, Serialize};

/// How long the watch looks back, nanoseconds. With the drivers' 0.3 s leases and a speed regulator that takes a few tenths of a second
/// to give all it has, a second tells a slow start from a wall, and leaves a second until the two that a blocked wheel may last.
const WINDOW_NS: i64 = 1_000_000_000;

/// A wheel that has turned less than this share of what it was told to is blocked.
const SHARE: f64 = 0.2;

/// Slower demands than this are not judged, radians per second: friction alone may stop them.
const SLOWEST_RAD_S: f64 = 0.17;

/// Watches one wheel: what it was told to turn and what it turned since the window began.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
struct WheelWatch {
    since_ns: i64,
    demanded_rad_s: f64,
    from_rad: f64,
    watching: bool,
}

impl WheelWatch {
    /// One tick: true if the wheel is blocked.
    ///
    /// - `demanded_rad_s`: what the wheel was told at the tick before, so what it should have been doing until now.
    /// - `angle_rad`: where it is; `None` while it is lost.
    fn step(&mut self, time_ns: i64, demanded_rad_s: f64, angle_rad: Option<f64>) -> bool {
        let Some(angle_rad) = angle_rad else {
            self.watching = false;
            return false;
        };
        let same_way = demanded_rad_s * self.demanded_rad_s > 0.0;
        if demanded_rad_s.abs() < SLOWEST_RAD_S || !same_way || !self.watching {
            *self = Self { since_ns: time_ns, demanded_rad_s, from_rad: angle_rad, watching: true };
            return false;
        }
        // The slowest demand of the window is what the wheel is measured by: a ramp is not held against it.
        if demanded_rad_s.abs() < self.demanded_rad_s.abs() {
            self.demanded_rad_s = demanded_rad_s;
        }
        let watched_ns = time_ns.saturating_sub(self.since_ns);
        if watched_ns < WINDOW_NS {
            return false;
        }
        let expected_rad = self.demanded_rad_s * crate::clock::seconds(watched_ns);
        let blocked = (angle_rad - self.from_rad) / expected_rad < SHARE;
        *self = Self { since_ns: time_ns, demanded_rad_s, from_rad: angle_rad, watching: true };
        blocked
    }
}

/// Watches both wheels.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct StallWatch {
    left: WheelWatch,
    right: WheelWatch,
}

impl StallWatch {
    /// One tick: true if a wheel is blocked. Demands in radians per second, angles in radians, left before right.
    pub(super) fn step(
        &mut self,
        time_ns: i64,
        demanded_rad_s: [f64; 2],
        angle_rad: [Option<f64>; 2],
    ) -> bool {
        let left = self.left.step(time_ns, demanded_rad_s[0], angle_rad[0]);
        let right = self.right.step(time_ns, demanded_rad_s[1], angle_rad[1]);
        left || right
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::MILLISECOND_NS;

    /// When a wheel that is told `demanded` and turns at `turns` (both as functions of time in s) is first called blocked, in s.
    fn blocked_at(demanded: impl Fn(f64) -> f64, turns: impl Fn(f64) -> f64) -> Option<f64> {
        let mut watch = StallWatch::default();
        let mut angle = 0.0;
        (0..500).map(|tick| f64::from(tick) * 0.02).find(|&time_s| {
            angle += turns(time_s) * 0.02;
            let time_ns = crate::clock::nanoseconds(time_s);
            watch.step(time_ns, [demanded(time_s), 0.0], [Some(angle), Some(0.0)])
        })
    }

    #[test]
    fn a_wheel_that_follows_is_not_blocked() {
        assert_eq!(blocked_at(|_| 1.0, |_| 1.0), None);
        assert_eq!(
            blocked_at(|_| -3.0, |time_s| if time_s < 0.4 { 0.0 } else { -3.0 }),
            None,
            "a slow start"
        );
    }

    #[test]
    fn a_wheel_against_a_wall_is_blocked_within_two_seconds() {
        let at = blocked_at(|_| 1.0, |time_s| if time_s < 2.5 { 1.0 } else { 0.0 }).unwrap();
        assert!((2.5..=4.5).contains(&at), "noticed at {at} s");
        let shaking =
            blocked_at(|_| 1.0, |time_s| if (time_s * 10.0) % 2.0 < 1.0 { 0.3 } else { -0.25 }).unwrap();
        assert!(shaking <= 2.0, "noticed at {shaking} s");
    }

    #[test]
    fn standing_still_on_purpose_is_not_blocked() {
        assert_eq!(blocked_at(|_| 0.0, |_| 0.0), None);
        assert_eq!(blocked_at(|_| 0.1, |_| 0.0), None, "too slow to judge");
    }

    #[test]
    fn a_change_of_direction_begins_anew() {
        let to_and_fro = |time_s: f64| if (time_s % 1.6) < 0.8 { 2.0 } else { -2.0 };
        assert_eq!(blocked_at(to_and_fro, |_| 0.0), None, "never told one way for a whole second");
    }

    #[test]
    fn a_lost_wheel_is_not_judged() {
        let mut watch = StallWatch::default();
        for tick in 0..200 {
            assert!(!watch.step(tick * 20 * MILLISECOND_NS, [1.0, 1.0], [None, None]));
        }
    }
}
