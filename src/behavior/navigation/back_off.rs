//! How the robot backs off from what it has come upon: from a pressed bumper and from what it sees
//! backwards, from what blocks its wheels against the way that it drove last, as that need not be
//! ahead.

use serde::{Deserialize, Serialize};

use super::{NavigationState, Phase, SAME_PLACE_M};
use crate::behavior::demands::Drive;
use crate::behavior::motion::{self, At, MotionState};

/// So far, metres.
const BACK_OFF_M: f64 = 0.08;

/// It backs off from what blocks its wheels in one place no more often than this.
const BLOCKS: u8 = 6;

/// Which way it drives.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) enum Way {
    Back,
    Ahead,
}

impl Way {
    /// None where the wheels stand, or turn the robot on the spot.
    pub(super) fn of(drive: Drive) -> Option<Self> {
        match drive {
            Drive::Twist { forward_m_s, .. } if forward_m_s > 0.0 => Some(Self::Ahead),
            Drive::Twist { forward_m_s, .. } if forward_m_s < 0.0 => Some(Self::Back),
            _ => None,
        }
    }
}

impl NavigationState {
    /// The wheels are blocked: it backs off in its next step. False where it is not under way.
    pub(in crate::behavior) fn stall(&mut self) -> bool {
        self.is_blocked = self.order.is_some() && self.phase != Phase::Done;
        self.is_blocked
    }

    /// The wheels are blocked. Where backing off has not helped again and again it gives up.
    pub(super) fn blocked(&mut self, at: At, motion: &mut MotionState) {
        let [x_m, y_m] = self.blocked_m;
        let is_same_place = at.to(x_m, y_m).0 < SAME_PLACE_M;
        self.blocks = if is_same_place { self.blocks.saturating_add(1) } else { 1 };
        self.blocked_m = [at.x_m, at.y_m];
        if self.blocks > BLOCKS {
            self.rest();
            self.phase = Phase::Done;
        } else {
            self.back_off(motion, if self.is_backwards { Way::Ahead } else { Way::Back });
        }
    }

    pub(super) fn back_off(&mut self, motion: &mut MotionState, way: Way) {
        self.rest();
        self.stops = 0;
        (self.pivot_rad, self.gets_out_back) = (None, None);
        let way_m = if way == Way::Ahead { BACK_OFF_M } else { -BACK_OFF_M };
        self.begin(Phase::BackOff, motion, motion::Goal::Ahead { way_m });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::behavior::motion::MotionLimits;
    use crate::behavior::navigation::{Goal, KEEP_M, Order};
    use crate::behavior::signals::{Signal, Signals};
    use crate::clock::MILLISECOND_NS;
    use crate::planning::Clearance;
    use crate::senses::Channel;
    use crate::units::radians;

    /// A robot that backs off from what blocks its wheels: how far it is ahead of where it stood
    /// after some steps of 20 ms, metres.
    fn backed_off_m(state: &mut NavigationState, steps: i64) -> f64 {
        let is_near = !state.is_backwards;
        let (mut motion, mut x_m) = (MotionState::default(), 0.0);
        for step in 0..steps {
            let mut signals = Signals::at(step * 20 * MILLISECOND_NS);
            // What is ahead does not keep it from going back.
            let range = Signal::Sensed(Channel::Range);
            let range_m = if is_near { 0.05 } else { 1.0 };
            for (signal, value) in [(Signal::X, x_m), (range, range_m)] {
                signals.set(signal, value);
            }
            for signal in [Signal::Y, Signal::Heading] {
                signals.set(signal, 0.0);
            }
            let order = || unreachable!("it is under way");
            let (drive, _) = state.step(order, &mut motion, &signals, &MotionLimits::default());
            if let Drive::Twist { forward_m_s, .. } = drive {
                x_m += forward_m_s * 0.02;
            }
        }
        x_m
    }

    fn under_way(is_backwards: bool) -> NavigationState {
        let goal = Goal::Place { x_m: 9.0, y_m: 0.0, face_rad: Some(radians(90.0)) };
        let order = Order { goal, keep_m: KEEP_M, speed_m_s: None, turn_rad_s: None };
        let phase = Phase::Drive;
        NavigationState { order: Some(order), phase, is_backwards, ..NavigationState::default() }
    }

    #[test]
    fn it_backs_off_against_the_way_that_it_drove_last() {
        for (is_backwards, ahead) in [(false, -1.0), (true, 1.0)] {
            let mut state = under_way(is_backwards);
            assert!(state.stall());
            let way_m = backed_off_m(&mut state, 150);
            assert!((way_m - ahead * BACK_OFF_M).abs() < 0.01, "{way_m} m");
            // What blocks it on the way back is on the other side.
            let mut state = under_way(is_backwards);
            assert!(state.stall());
            let first_m = backed_off_m(&mut state, 20);
            assert!(state.stall());
            let second_m = backed_off_m(&mut state, 150);
            assert!(first_m * second_m < 0.0, "{first_m} m, then {second_m} m");
        }
    }

    #[test]
    fn it_backs_off_no_further_than_to_what_the_map_shows_behind_it() {
        for (behind_m, as_far_m) in [([-0.2, 0.0], -BACK_OFF_M), ([-0.11, 0.05], 0.0)] {
            let mut state = under_way(false);
            assert!(state.stall());
            state.keep_clear(Clearance::of(&[behind_m]));
            let way_m = backed_off_m(&mut state, 150);
            assert!((way_m - as_far_m).abs() < 0.01, "{behind_m:?}: {way_m} m");
        }
    }

    #[test]
    fn it_gives_up_where_backing_off_does_not_help_and_does_nothing_where_it_is_not_under_way() {
        let mut state = under_way(false);
        let backs_off = |_: &i32| {
            assert!(state.stall());
            backed_off_m(&mut state, 5);
            state.phase == Phase::BackOff
        };
        assert_eq!((0..20).take_while(backs_off).count(), usize::from(BLOCKS));
        assert_eq!(state.phase, Phase::Done);
        assert!(!state.stall() && !NavigationState::default().stall());
    }
}
