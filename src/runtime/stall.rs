//! Wheels that are told to turn and do not.
//!
//! The kernel's own `stalled` flag is advisory and speaks only of a rotor that stands quite still;
//! a wheel that shakes against a wall is not stalled to it. Here a wheel counts as blocked when
//! over a while it has turned much less than it was told to.
//!
//! A wheel without a single count though it was told to turn both ways is [`Stall::Dead`]. So is
//! one with few counts for long, and one that oscillates much faster than it was told to turn: no
//! mission can back off from that. Its encoder may stand still or lie; then its regulator gives
//! full power, and the robot does not know where it drives.

use serde::{Deserialize, Serialize};

/// How long the watch looks back, nanoseconds. With the drivers' 0.3 s leases and a speed regulator
/// that takes a few tenths of a second to give all it has, a second tells a slow start from a wall,
/// and leaves a second until the two that a blocked wheel may last.
const WINDOW_NS: i64 = 1_000_000_000;

/// A wheel that has turned less than this share of what it was told to is blocked.
const SHARE: f64 = 0.2;

/// Slower demands than this are not judged, radians per second: friction alone may stop them.
const SLOWEST_RAD_S: f64 = 0.17;

/// A wheel that oscillates over more than this many times the way that it was told to turn at most
/// does not obey.
const WILD_TIMES: f64 = 3.0;

/// This number of wild windows one after the other is no accident, as a single leap of an encoder
/// is, which may lie in two.
const WILD_WINDOWS: u8 = 3;

/// A wheel that is blocked both ways and stays within this meanwhile is dead, radians (two counts):
/// what is jammed gives a little when it is turned round.
const STILL_RAD: f64 = 0.035;

/// This number of blocked windows, of both ways, is no jam that a mission backs off from, but a
/// motor without power.
const DEAD_WINDOWS: u8 = 12;

/// What keeps a wheel from turning.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Stall {
    /// Something is in its way, on one side at least.
    Blocked,
    /// It turns neither way, or does not say so.
    Dead,
}

/// Watches one wheel: what it was told to turn and what it turned since the window began.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
struct WheelWatch {
    since_ns: i64,
    /// The slowest and the fastest demand of the window.
    demanded_rad_s: f64,
    #[serde(default)]
    fastest_rad_s: f64,
    from_rad: f64,
    #[serde(default)]
    last_rad: f64,
    /// What it turned, in both directions.
    #[serde(default)]
    way_rad: f64,
    watching: bool,
    /// Backwards and ahead: the windows in which it was blocked, since it last turned as it was
    /// told.
    #[serde(default)]
    blocked: [u8; 2],
    /// Where it was when that began, and how far it has been from there.
    #[serde(default)]
    blocked_at_rad: f64,
    #[serde(default)]
    given_rad: f64,
    /// Wild windows, one after the other.
    #[serde(default)]
    wild: u8,
}

impl WheelWatch {
    /// One tick.
    ///
    /// - `demanded_rad_s`: what the wheel was told at the tick before, so what it should have been
    ///   doing until now.
    /// - `angle_rad`: where it is; `None` while it is lost.
    fn step(&mut self, time_ns: i64, demanded_rad_s: f64, angle_rad: Option<f64>) -> Option<Stall> {
        let Some(angle_rad) = angle_rad else {
            self.watching = false;
            return None;
        };
        let same_way = demanded_rad_s * self.demanded_rad_s > 0.0;
        if demanded_rad_s.abs() < SLOWEST_RAD_S || !same_way || !self.watching {
            self.begin(time_ns, demanded_rad_s, angle_rad);
            return None;
        }
        // A ramp is not held against the wheel.
        if demanded_rad_s.abs() < self.demanded_rad_s.abs() {
            self.demanded_rad_s = demanded_rad_s;
        }
        if demanded_rad_s.abs() > self.fastest_rad_s.abs() {
            self.fastest_rad_s = demanded_rad_s;
        }
        self.way_rad += (angle_rad - self.last_rad).abs();
        self.last_rad = angle_rad;
        let watched_ns = time_ns.saturating_sub(self.since_ns);
        if watched_ns < WINDOW_NS {
            return None;
        }
        let verdict = self.judge(crate::clock::seconds(watched_ns));
        self.begin(time_ns, demanded_rad_s, angle_rad);
        verdict
    }

    /// What a whole window says.
    fn judge(&mut self, watched_s: f64) -> Option<Stall> {
        if self.way_rad > WILD_TIMES * self.fastest_rad_s.abs() * watched_s {
            self.wild = self.wild.saturating_add(1);
            return (self.wild >= WILD_WINDOWS).then_some(Stall::Dead);
        }
        self.wild = 0;
        if (self.last_rad - self.from_rad) / (self.demanded_rad_s * watched_s) >= SHARE {
            self.blocked = [0; 2];
            return None;
        }
        if self.blocked == [0; 2] {
            (self.blocked_at_rad, self.given_rad) = (self.from_rad, 0.0);
        }
        self.given_rad =
            self.given_rad.max((self.last_rad - self.blocked_at_rad).abs()).max(self.way_rad);
        let [back, ahead] = &mut self.blocked;
        let way = if self.demanded_rad_s < 0.0 { &mut *back } else { &mut *ahead };
        *way = way.saturating_add(1);
        let both_ways = *back > 0 && *ahead > 0;
        let for_long = back.saturating_add(*ahead) >= DEAD_WINDOWS;
        let dead = both_ways && (for_long || self.given_rad < STILL_RAD);
        Some(if dead { Stall::Dead } else { Stall::Blocked })
    }

    fn begin(&mut self, since_ns: i64, demanded_rad_s: f64, angle_rad: f64) {
        *self = Self {
            since_ns,
            demanded_rad_s,
            fastest_rad_s: demanded_rad_s,
            from_rad: angle_rad,
            last_rad: angle_rad,
            way_rad: 0.0,
            watching: true,
            ..*self
        };
    }
}

/// Watches both wheels.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct StallWatch {
    left: WheelWatch,
    right: WheelWatch,
}

impl StallWatch {
    /// One tick: the worse of what keeps the two wheels from turning. Demands in radians per
    /// second, angles in radians, left before right.
    pub(super) fn step(
        &mut self,
        time_ns: i64,
        demanded_rad_s: [f64; 2],
        angle_rad: [Option<f64>; 2],
    ) -> Option<Stall> {
        let left = self.left.step(time_ns, demanded_rad_s[0], angle_rad[0]);
        let right = self.right.step(time_ns, demanded_rad_s[1], angle_rad[1]);
        left.max(right)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::MILLISECOND_NS;

    /// When a wheel that is told `demanded` and turns at `turns` (both as functions of time in s)
    /// is first called blocked, in s.
    fn blocked_at(demanded: impl Fn(f64) -> f64, turns: impl Fn(f64) -> f64) -> Option<f64> {
        let mut watch = StallWatch::default();
        let mut angle = 0.0;
        (0..500).map(|tick| f64::from(tick) * 0.02).find(|&time_s| {
            angle += turns(time_s) * 0.02;
            let time_ns = crate::clock::nanoseconds(time_s);
            watch.step(time_ns, [demanded(time_s), 0.0], [Some(angle), Some(0.0)]).is_some()
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
            blocked_at(|_| 1.0, |time_s| if (time_s * 10.0) % 2.0 < 1.0 { 0.3 } else { -0.25 })
                .unwrap();
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
    fn a_wheel_that_turns_neither_way_is_dead_and_one_that_backs_off_is_not() {
        // Ahead for two seconds, back for two, and so on: what it turns, as a share of what it is
        // told, each way.
        let verdicts = |ahead: f64, back: f64| {
            let mut watch = StallWatch::default();
            let mut angle = 0.0;
            let mut verdicts: Vec<Stall> = (0..3000)
                .filter_map(|tick| {
                    let demanded = if tick % 200 < 100 { 1.0 } else { -1.0 };
                    angle += demanded * if demanded > 0.0 { ahead } else { back } * 0.02;
                    watch.step(
                        tick * 20 * MILLISECOND_NS,
                        [0.0, demanded],
                        [Some(0.0), Some(angle)],
                    )
                })
                .collect();
            verdicts.dedup();
            verdicts
        };
        assert_eq!(verdicts(1.0, 1.0), []);
        assert_eq!(verdicts(0.0, 1.0), [Stall::Blocked], "a wall ahead");
        assert_eq!(
            verdicts(0.1, 0.05),
            [Stall::Blocked, Stall::Dead],
            "it gives a little, but for long"
        );
        assert_eq!(
            verdicts(0.0, 0.0),
            [Stall::Blocked, Stall::Dead],
            "an encoder that stands still"
        );
        assert_eq!(verdicts(5.0, 5.0), [Stall::Dead], "much more than it is told");
    }

    #[test]
    fn a_lost_wheel_is_not_judged() {
        let mut watch = StallWatch::default();
        for tick in 0..200 {
            assert_eq!(watch.step(tick * 20 * MILLISECOND_NS, [1.0, 1.0], [None, None]), None);
        }
    }
}
