//! What a navigation knows in one tick, and what follows from that alone.

use std::f64::consts::{PI, TAU};

use super::Order;
use crate::behavior::motion::{At, MotionLimits};
use crate::behavior::signals::{Signal, Signals};
use crate::senses::Channel;

/// An echo is taken to be so far beside the sensor's axis, towards the way.
const CONE_RAD: f64 = 4.0 * (PI / 180.0);

/// So far ahead the robot looks for what it would come near to, and by so much it may come nearer
/// than it keeps from what the map shows, metres. What is beside it or behind it is no hindrance.
const AHEAD_M: f64 = 0.09;
const SLACK_M: f64 = 0.03;
const BESIDE_M: f64 = 0.04;

/// What is too near for an echo is ahead where the head looks no further aside than this.
const TOO_NEAR_RAD: f64 = 45.0 * (PI / 180.0);

/// Turns that would sum up to more than this are made the other way round.
const WOUND_RAD: f64 = 200.0 * (PI / 180.0);

/// What a tick knows.
pub(super) struct Tick<'t> {
    /// How far the robot stays away from things now, metres.
    pub(super) keep_m: f64,
    /// The heading at the first step of all, not wrapped.
    pub(super) first_rad: f64,
    pub(super) order: Order,
    pub(super) at: At,
    pub(super) signals: &'t Signals,
    pub(super) limits: &'t MotionLimits,
    pub(super) step_s: f64,
}

impl Tick<'_> {
    pub(super) fn head_rad(&self) -> f64 {
        self.signals.get(Signal::Sensed(Channel::Head)).unwrap_or(0.0)
    }

    /// Whether the bumper is pressed.
    pub(super) fn is_pressed(&self) -> bool {
        self.signals.get(Signal::Sensed(Channel::Touch)).is_some_and(|touch| touch > 0.5)
    }

    /// How far to turn to what lies so far beside straight ahead: the other way round where the
    /// turns would sum up, and with them the error of the gyro's scale.
    pub(super) fn turn_rad(&self, bearing_rad: f64) -> f64 {
        let wound_rad = self.at.heading_rad + bearing_rad - self.first_rad;
        if wound_rad.abs() > WOUND_RAD {
            bearing_rad - TAU * wound_rad.signum()
        } else {
            bearing_rad
        }
    }

    /// An echo from something that the robot would come too near to on its next piece of way: where
    /// that is.
    ///
    /// - `way_rad`: how far that piece leads beside straight ahead.
    pub(super) fn is_ahead(&self, way_rad: f64) -> Option<[f64; 2]> {
        let range_m = self.signals.get(Signal::Sensed(Channel::Range))?;
        let head_rad = self.head_rad();
        // What is too near for an echo is on the side to which the head looks.
        if range_m <= 0.0 && head_rad.abs() > TOO_NEAR_RAD {
            return None;
        }
        let beside_rad = head_rad - way_rad;
        let (way_sin, way_cos) = libm::sincos(way_rad);
        let along_m = self.limits.range_ahead_m * way_cos + range_m * libm::cos(beside_rad);
        // Within the cone it may be nearer to the lane.
        let cone_m = range_m * libm::sin((beside_rad.abs() - CONE_RAD).max(0.0));
        let sensor_m = self.limits.range_ahead_m * way_sin * beside_rad.signum();
        let aside_m = (cone_m - sensor_m).max(0.0);
        // On the next piece of the way the middle would come nearer to it than it may.
        let next_m = along_m.clamp(0.0, AHEAD_M);
        let comes_near = libm::hypot(along_m - next_m, aside_m) < self.keep_m - SLACK_M;
        if !range_m.is_finite() || along_m < BESIDE_M || !comes_near {
            return None;
        }
        let (head_sin, head_cos) = libm::sincos(head_rad);
        let ahead_m = self.limits.range_ahead_m + range_m * head_cos;
        let left_m = range_m * head_sin;
        let (sin, cos) = libm::sincos(self.at.heading_rad);
        Some([
            self.at.x_m + ahead_m * cos - left_m * sin,
            self.at.y_m + ahead_m * sin + left_m * cos,
        ])
    }
}

#[cfg(test)]
impl<'t> Tick<'t> {
    /// A robot at the origin that explores.
    pub(super) fn exploring(signals: &'t Signals, limits: &'t MotionLimits) -> Self {
        let goal = super::Goal::Explore { within_m: 9.0 };
        let keep_m = super::KEEP_M;
        Self {
            keep_m,
            first_rad: 0.0,
            order: Order { goal, keep_m, speed_m_s: None, turn_rad_s: None },
            at: At { x_m: 0.0, y_m: 0.0, heading_rad: 0.0 },
            signals,
            limits,
            step_s: 1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::radians;

    #[test]
    fn what_is_too_near_for_an_echo_is_ahead_only_where_the_head_looks_ahead() {
        for (head_deg, is_ahead) in [(0.0, true), (-40.0, true), (50.0, false), (-90.0, false)] {
            let mut signals = Signals::at(0);
            signals.set(Signal::Sensed(Channel::Range), 0.0);
            signals.set(Signal::Sensed(Channel::Head), radians(head_deg));
            let limits = MotionLimits::default();
            let tick = Tick::exploring(&signals, &limits);
            assert_eq!(tick.is_ahead(0.0).is_some(), is_ahead, "{head_deg}°");
        }
    }

    #[test]
    fn what_is_ahead_is_what_lies_on_the_way_though_that_leads_aside() {
        let limits = MotionLimits::default();
        // An echo straight ahead, and one to the left.
        for (head_deg, way_deg, is_ahead) in [
            (0.0, 0.0, true),
            (0.0, 50.0, false),
            (0.0, -50.0, false),
            (60.0, 0.0, false),
            (60.0, 50.0, true),
            (60.0, -50.0, false),
        ] {
            let mut signals = Signals::at(0);
            signals.set(Signal::Sensed(Channel::Range), 0.15);
            signals.set(Signal::Sensed(Channel::Head), radians(head_deg));
            let obstacle = Tick::exploring(&signals, &limits).is_ahead(radians(way_deg));
            assert_eq!(obstacle.is_some(), is_ahead, "head {head_deg}°, way {way_deg}°");
            // Whichever way it is on, that is where it is.
            let far_m =
                obstacle.map_or(0.15, |[x_m, y_m]| libm::hypot(x_m - limits.range_ahead_m, y_m));
            assert!((far_m - 0.15).abs() < 1e-9, "{far_m} m");
        }
    }
}
