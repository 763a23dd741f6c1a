//! From two wheel angles to a step ahead and a turn.
//!
//! With d the way of a wheel (its change of angle / 2π × circumference): step = (d_right + d_left)
//! / 2, turn = (d_right − d_left) / track width (Borenstein, Everett and Feng, *Where am I?*,
//! section 1.1).
//!
//! # What we count on
//!
//! Angles are absolute counts: ticks in which a wheel was not read lose nothing, as the next
//! reading makes up for them.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use super::{Events, Geometry};
use crate::clock::{MILLISECOND_NS, SECOND_NS, seconds_nearly};

/// What a change may exceed the fastest motion by, radians: the two wheels are not read at one
/// instant.
const JUMP_SLACK_RAD: f64 = 0.35;
/// Ticks without a reading excuse a change only up to this long.
const UNREAD_MAX_NS: i64 = 10 * SECOND_NS;
/// A wheel that stays within this, radians, stands still: a brake lets it rock by a count or two.
const STILL_RAD: f64 = 0.03;
/// Standing still for this long counts.
const STILL_AFTER_NS: i64 = 300 * MILLISECOND_NS;

/// What is carried from tick to tick.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct WheelsState {
    /// The last time both were read: time, left, right.
    last: Option<(i64, f64, f64)>,
    /// Where they began to stand still: time, left, right.
    still: Option<(i64, f64, f64)>,
}

/// What one update came to.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct WheelStep {
    pub left_m: f64,
    pub right_m: f64,
    /// Step of the axle's centre, metres.
    pub forward_m: f64,
    /// Turn by the encoders, radians.
    pub turn_rad: f64,
    /// Whether both wheels were read.
    pub read: bool,
    pub still: bool,
    pub events: Events,
}

impl WheelsState {
    /// Takes one tick's angles.
    pub(super) fn update(
        &mut self,
        geometry: &Geometry,
        now_ns: i64,
        left_rad: Option<f64>,
        right_rad: Option<f64>,
    ) -> WheelStep {
        let (Some(left_rad), Some(right_rad)) = (left_rad, right_rad) else {
            self.still = None;
            return WheelStep {
                events: Events::WHEELS_LOST.when(self.last.is_some()),
                ..WheelStep::default()
            };
        };
        let still = self.watch_standstill(now_ns, left_rad, right_rad);
        let standing = WheelStep {
            read: true,
            still,
            events: Events::STILL.when(still),
            ..WheelStep::default()
        };
        let Some((last_ns, last_left_rad, last_right_rad)) =
            self.last.replace((now_ns, left_rad, right_rad))
        else {
            return standing;
        };
        let passed_s = seconds_nearly(now_ns.saturating_sub(last_ns).clamp(0, UNREAD_MAX_NS));
        let most_rad = geometry.max_wheel_rad_s() * passed_s + JUMP_SLACK_RAD;
        let (left_rad, right_rad) = (left_rad - last_left_rad, right_rad - last_right_rad);
        if left_rad.abs() > most_rad || right_rad.abs() > most_rad {
            return WheelStep { events: standing.events | Events::WHEEL_JUMP, ..standing };
        }
        let metres_per_rad = geometry.wheel_circumference_m() * (1.0 / TAU);
        let (left_m, right_m) = (left_rad * metres_per_rad, right_rad * metres_per_rad);
        WheelStep {
            left_m,
            right_m,
            forward_m: (left_m + right_m) / 2.0,
            turn_rad: (right_m - left_m) * geometry.per_track_width_m(),
            ..standing
        }
    }

    fn watch_standstill(&mut self, now_ns: i64, left_rad: f64, right_rad: f64) -> bool {
        if let Some((since_ns, at_left_rad, at_right_rad)) = self.still
            && (left_rad - at_left_rad).abs() < STILL_RAD
            && (right_rad - at_right_rad).abs() < STILL_RAD
        {
            return now_ns.saturating_sub(since_ns) >= STILL_AFTER_NS;
        }
        self.still = Some((now_ns, left_rad, right_rad));
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_of_both_wheels_is_a_circumference_ahead() {
        let geometry = Geometry::seed();
        let mut wheels = WheelsState::default();
        let first = wheels.update(&geometry, 0, Some(5.0), Some(7.0));
        assert_eq!(
            (first.forward_m, first.turn_rad),
            (0.0, 0.0),
            "the first angles are only the reference"
        );
        let step = wheels.update(&geometry, SECOND_NS, Some(5.0 + TAU), Some(7.0 + TAU));
        assert!((step.forward_m - 0.188_976).abs() < 1e-12, "{step:?}");
        assert!(step.turn_rad.abs() < 1e-12, "{step:?}");
    }

    #[test]
    fn ways_in_ticks_that_were_not_read_are_made_up_for() {
        let geometry = Geometry::seed();
        let mut wheels = WheelsState::default();
        wheels.update(&geometry, 0, Some(0.0), Some(0.0));
        let lost = wheels.update(&geometry, SECOND_NS, None, Some(1.0));
        assert!(lost.events.contains(Events::WHEELS_LOST) && !lost.read, "{lost:?}");
        let step = wheels.update(&geometry, 2 * SECOND_NS, Some(2.0), Some(2.0));
        assert!((step.forward_m - 2.0 * 0.188_976 / TAU).abs() < 1e-12, "{step:?}");
    }

    #[test]
    fn a_counter_that_jumps_is_noticed_and_not_driven() {
        let geometry = Geometry::seed();
        let mut wheels = WheelsState::default();
        wheels.update(&geometry, 0, Some(100.0), Some(0.0));
        let jump = wheels.update(&geometry, 10 * MILLISECOND_NS, Some(0.0), Some(0.1));
        assert!(jump.events.contains(Events::WHEEL_JUMP), "{jump:?}");
        assert!(jump.forward_m.abs() < 1e-12, "{jump:?}");
        let next = wheels.update(&geometry, 20 * MILLISECOND_NS, Some(0.1), Some(0.2));
        assert!(next.forward_m > 0.0 && next.events.is_empty(), "{next:?}");
    }

    #[test]
    fn standing_still_takes_a_while_and_survives_a_rocking_count() {
        let geometry = Geometry::seed();
        let mut wheels = WheelsState::default();
        let mut at = |ms: i64, left| {
            wheels.update(&geometry, ms * MILLISECOND_NS, Some(left), Some(0.0)).still
        };
        assert!(!at(0, 0.0));
        assert!(!at(290, 0.017));
        assert!(at(310, 0.0));
        assert!(!at(320, 0.1));
        assert!(!at(600, 0.1));
        assert!(at(621, 0.1));
    }
}
