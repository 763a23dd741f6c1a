//! How the robot keeps clear of the map's points that are near to it, as it drives by a plan made
//! of cells: it steers past them, and gets away from them before it turns on the spot.

use super::back_off::Way;
use super::tick::Tick;
use super::{NARROW_M_S, NavigationState};
use crate::behavior::demands::Drive;
use crate::planning::Clearance;

/// What is nearer than this share of the distance to keep is close: the corners of a usual robot
/// would touch it as it turns.
const CLOSE: f64 = 0.85;

/// It steers away from what is close by this, radians a second for each metre that it is closer.
const AWAY_PER_M_S: f64 = 30.0;

/// How far left or right for each metre ahead: it steers past what lies between the two, and what
/// lies in its lane keeps it from driving straight. Tangents of 10°, 75° and 50°.
const PASSED: [f64; 2] = [0.176, 3.73];
const LANE: f64 = 1.19;

/// So far it gets away from what is close before it turns, metres.
const ROOM_M: f64 = 0.08;

impl NavigationState {
    pub(in crate::behavior) fn keep_clear(&mut self, clearance: Clearance) {
        self.clearance = clearance;
    }

    /// What is close: how far along the way that it drives, to the left of that, and how far away
    /// at all, metres.
    fn close(&self, tick: &Tick<'_>, way: Way) -> impl Iterator<Item = [f64; 3]> {
        let sign = if way == Way::Ahead { 1.0 } else { -1.0 };
        let close_m = CLOSE * tick.order.keep_m;
        let seen = move |[ahead_m, left_m]: [f64; 2]| {
            [sign * ahead_m, sign * left_m, libm::hypot(ahead_m, left_m)]
        };
        self.clearance.points().map(seen).filter(move |[_, _, far_m]| *far_m < close_m)
    }

    /// Whether something keeps it from driving straight on or straight back.
    pub(super) fn is_closed(&self, tick: &Tick<'_>, way: Way) -> bool {
        self.close(tick, way).any(|[along_m, left_m, _]| left_m.abs() < LANE * along_m)
            || way == Way::Ahead && tick.is_ahead(0.0).is_some()
    }

    /// How to turn away from what is close beside the way that it drives, radians a second.
    pub(super) fn away_rad_s(&self, tick: &Tick<'_>, way: Way) -> f64 {
        let [mut left_m, mut right_m] = [0.0_f64; 2];
        for [along_m, beside_m, far_m] in self.close(tick, way) {
            if (PASSED[0] * along_m..PASSED[1] * along_m).contains(&beside_m.abs()) {
                let side_m = if beside_m > 0.0 { &mut left_m } else { &mut right_m };
                *side_m = side_m.max(CLOSE * tick.order.keep_m - far_m);
            }
        }
        AWAY_PER_M_S * (right_m - left_m)
    }

    /// What to do before a turn on the spot where something is too close for it: to get away from
    /// that, straight on or straight back.
    pub(super) fn make_room(&mut self, tick: &Tick<'_>) -> Option<Drive> {
        let nearest = self.close(tick, Way::Ahead).min_by(|one, two| one[2].total_cmp(&two[2]));
        let [ahead_m, ..] = nearest?;
        let away = if ahead_m > 0.0 { Way::Back } else { Way::Ahead };
        let (way, made_m) = self.makes_room.unwrap_or((away, 0.0));
        let made_m = if self.is_closed(tick, way) { ROOM_M } else { made_m };
        self.makes_room = Some((way, made_m + NARROW_M_S * tick.step_s));
        let forward_m_s = if way == Way::Ahead { NARROW_M_S } else { -NARROW_M_S };
        (made_m < ROOM_M).then(|| self.twist(tick, forward_m_s, 0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::behavior::motion::MotionLimits;
    use crate::behavior::signals::{Signal, Signals};
    use crate::senses::Channel;

    /// The corners of a usual robot are 12 cm from its middle; close is 12.75 cm.
    fn near(points: &[[f64; 2]]) -> NavigationState {
        let clearance = Clearance::of(points);
        NavigationState { clearance, ..NavigationState::default() }
    }

    #[test]
    fn before_it_turns_it_gets_away_from_what_is_close_as_far_as_that_helps() {
        let limits = MotionLimits::default();
        for (points, ahead, far_m) in [
            // Beside it and a little ahead or behind: until it could turn.
            (vec![[0.03, 0.11]], -1.0, 0.035),
            (vec![[-0.03, 0.11]], 1.0, 0.035),
            // Beside a wall it does not get away from: no further than that.
            ((-6..=6).map(|at| [f64::from(at) * 0.05, 0.11]).collect(), 0.0, ROOM_M),
            // It has room, or is closed in.
            (vec![[0.0, 0.13]], 0.0, 0.0),
            (vec![[0.01, 0.11], [-0.12, 0.0]], 0.0, 0.0),
        ] {
            let signals = Signals::default();
            let mut tick = Tick::exploring(&signals, &limits);
            tick.step_s = 0.02;
            let (mut state, mut x_m, mut way_m) = (near(&points), 0.0_f64, 0.0_f64);
            for _ in 0..500 {
                let seen: Vec<_> =
                    points.iter().map(|[ahead, left]| [ahead - x_m, *left]).collect();
                let within = |[x_m, y_m]: &&[f64; 2]| libm::hypot(*x_m, *y_m) < 0.15;
                state.keep_clear(
                    near(&seen.iter().filter(within).copied().collect::<Vec<_>>()).clearance,
                );
                let Some(Drive::Twist { forward_m_s, turn_rad_s: 0.0 }) = state.make_room(&tick)
                else {
                    break;
                };
                x_m += forward_m_s * tick.step_s;
                way_m += forward_m_s.abs() * tick.step_s;
            }
            assert!((way_m - far_m).abs() < 0.01, "{points:?}: {way_m} m");
            assert!(ahead * x_m >= 0.0, "{points:?}: to {x_m} m");
        }
    }

    #[test]
    fn it_does_not_drive_on_to_what_is_ahead_to_make_room() {
        let limits = MotionLimits::default();
        let mut signals = Signals::default();
        for (range_m, drives) in [(1.0, true), (0.08, false)] {
            signals.set(Signal::Sensed(Channel::Head), 0.0);
            signals.set(Signal::Sensed(Channel::Range), range_m);
            let made = near(&[[-0.05, 0.1]]).make_room(&Tick::exploring(&signals, &limits));
            assert_eq!(made.is_some(), drives, "{range_m} m");
        }
    }

    #[test]
    fn it_steers_away_from_what_is_close_beside_its_way_and_only_from_that() {
        let (signals, limits) = (Signals::default(), MotionLimits::default());
        let tick = Tick::exploring(&signals, &limits);
        for (points, ahead_rad_s, back_rad_s) in [
            (vec![[0.08, 0.08]], -0.43, 0.0),
            (vec![[0.08, -0.08]], 0.43, 0.0),
            (vec![[0.08, 0.08], [0.08, -0.08]], 0.0, 0.0),
            // Driving back it turns the tail away.
            (vec![[-0.08, 0.08]], 0.0, 0.43),
            // Square beside, straight ahead, and not close.
            (vec![[0.0, 0.1], [0.1, 0.0], [0.1, 0.09]], 0.0, 0.0),
        ] {
            let state = near(&points);
            for (way, rad_s) in [(Way::Ahead, ahead_rad_s), (Way::Back, back_rad_s)] {
                let away_rad_s = state.away_rad_s(&tick, way);
                assert!((away_rad_s - rad_s).abs() < 0.01, "{points:?} {way:?}: {away_rad_s}");
            }
        }
    }
}
