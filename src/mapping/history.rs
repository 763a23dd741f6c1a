//! Where the robot was in the last quarter of a second: a reading is older than the tick that gets
//! it.
//!
//! Sixteen poses at least 15 ms apart: 225 ms or more, whatever the rate of the ticks, and 320 ms
//! at 50 or 100 Hz. Between them everything is taken as a straight line, which at 60 °/s over 20 ms
//! is right to 0.2 mm at 2 m.

use serde::{Deserialize, Serialize};

use super::Pose;
use super::pose::Correction;
use crate::clock::MILLISECOND_NS;

/// Kept poses.
const KEPT: usize = 16;
/// The least time between two of them.
const SPACING_NS: i64 = 15 * MILLISECOND_NS;

/// Body and head at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Placement {
    pub time_ns: i64,
    pub pose: Pose,
    pub head_rad: Option<f64>,
}

/// A ring of placements, the newest always the last update's.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct History {
    ring: [Placement; KEPT],
    /// Where the next one goes.
    next: u8,
    /// How many there are.
    held: u8,
    newest: Placement,
}

impl History {
    /// Notes where the robot is now.
    pub(super) fn note(&mut self, now: Placement) {
        let due =
            self.back(0).is_none_or(|kept| now.time_ns.saturating_sub(kept.time_ns) >= SPACING_NS);
        self.newest = now;
        if due && let Some(place) = self.ring.get_mut(usize::from(self.next)) {
            *place = now;
            self.next = (self.next + 1) % KEPT_U8;
            self.held = self.held.saturating_add(1).min(KEPT_U8);
        }
    }

    /// Moves all poses with the map.
    pub(super) fn correct(&mut self, correction: &Correction) {
        for placement in self.ring.iter_mut().chain([&mut self.newest]) {
            let pose = &mut placement.pose;
            correction.apply(&mut pose.x_m, &mut pose.y_m, &mut pose.heading_rad);
        }
    }

    /// Where the robot was: between the two placements around the time, at the newest if it is
    /// later, at the oldest if it is earlier than all.
    pub(super) fn at(&self, time_ns: i64) -> Placement {
        let mut later = self.newest;
        if time_ns >= later.time_ns {
            return later;
        }
        for steps in 0..self.held {
            let Some(earlier) = self.back(steps) else { break };
            if earlier.time_ns <= time_ns {
                return between(&earlier, &later, time_ns);
            }
            later = earlier;
        }
        later
    }

    /// The kept placement that many places before the last one kept.
    fn back(&self, steps: u8) -> Option<Placement> {
        let place = (usize::from(self.next) + KEPT - 1 - usize::from(steps) % KEPT) % KEPT;
        (steps < self.held).then(|| self.ring.get(place).copied()).flatten()
    }
}

/// [`KEPT`] as the ring counts it.
#[expect(clippy::cast_possible_truncation, reason = "sixteen")]
const KEPT_U8: u8 = KEPT as u8;

#[expect(clippy::cast_precision_loss, reason = "times within a second are exact")]
fn between(earlier: &Placement, later: &Placement, time_ns: i64) -> Placement {
    let whole_ns = later.time_ns.saturating_sub(earlier.time_ns);
    if whole_ns <= 0 {
        return *later;
    }
    let share = time_ns.saturating_sub(earlier.time_ns) as f64 / whole_ns as f64;
    let head_rad = match (earlier.head_rad, later.head_rad) {
        (Some(from_rad), Some(to_rad)) => Some(from_rad + (to_rad - from_rad) * share),
        (known, None) | (None, known) => known,
    };
    Placement { time_ns, pose: earlier.pose.toward(&later.pose, share), head_rad }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::seconds;

    fn driving(ticks: i64, period_ns: i64) -> History {
        let mut history = History::default();
        for tick in 0..ticks {
            let time_ns = tick * period_ns;
            let pose = Pose { x_m: seconds(time_ns), ..Pose::default() };
            history.note(Placement { time_ns, pose, head_rad: Some(2.0 * seconds(time_ns)) });
        }
        history
    }

    #[test]
    fn a_quarter_of_a_second_back_is_known_at_any_rate() {
        for period_ms in [1, 2, 5, 10, 13, 20, 33, 50] {
            let period_ns = period_ms * MILLISECOND_NS;
            let history = driving(2_000 / period_ms, period_ns);
            let now_ns = history.newest.time_ns;
            for back_ns in [0, 3 * MILLISECOND_NS, 100 * MILLISECOND_NS, 225 * MILLISECOND_NS] {
                let then = history.at(now_ns - back_ns);
                let error_m = then.pose.x_m - seconds(now_ns - back_ns);
                assert!(error_m.abs() < 1e-9, "{back_ns} ns back at {period_ms} ms: {error_m} m");
                let head_rad = then.head_rad.expect("the head is known");
                assert!((head_rad - 2.0 * then.pose.x_m).abs() < 1e-9, "head at {head_rad} rad");
            }
        }
    }

    #[test]
    fn beyond_both_ends_the_nearest_counts() {
        let history = driving(3, 20 * MILLISECOND_NS);
        assert!((history.at(i64::MAX).pose.x_m - 0.04).abs() < 1e-12);
        assert!(history.at(i64::MIN).pose.x_m.abs() < 1e-12);
        assert_eq!(History::default().at(5), Placement::default());
    }
}
