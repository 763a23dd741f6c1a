//! How the robot gets out of where it has no room to turn: backwards on the way that it came, or
//! straight on.

use std::f64::consts::PI;

use super::back_off::Way;
use super::tick::Tick;
use super::{HOLD_PER_S, NARROW_M_S, NavigationState, PIVOT_RAD};
use crate::behavior::demands::Drive;
use crate::units::{within, wrap_rad};

/// What is further beside straight ahead than this is driven to backwards.
const BACK_RAD: f64 = 120.0 * (PI / 180.0);

impl NavigationState {
    /// What to do instead of turning to the way, where there is no room.
    ///
    /// - `bearing_rad`: how far the way is beside straight ahead.
    pub(super) fn get_out(&mut self, tick: &Tick<'_>, bearing_rad: f64) -> Option<Drive> {
        let beside_rad = bearing_rad.abs();
        if self.plan.is_cramped() && beside_rad > PIVOT_RAD[0] {
            // Along what it touches, until it has passed that: any turn would press it there. One
            // way, as the place that it steers for may lie square beside it.
            let is_back = *self.gets_out_back.get_or_insert(beside_rad > PI / 2.0);
            if is_back || tick.is_ahead(0.0).is_none() {
                self.pivot_rad = None;
                return Some(self.twist(tick, if is_back { -NARROW_M_S } else { NARROW_M_S }, 0.0));
            }
        }
        self.gets_out_back = None;
        if self.pivot_rad.is_some() || !self.plan.retraces() || beside_rad < BACK_RAD {
            return None;
        }
        let back_rad = wrap_rad(bearing_rad + PI);
        let most_rad_s = NARROW_M_S / tick.limits.half_track_m;
        let away_rad_s = self.away_rad_s(tick, Way::Back);
        let turn_rad_s = within(HOLD_PER_S * back_rad + away_rad_s, -most_rad_s, most_rad_s);
        Some(self.twist(tick, -NARROW_M_S * libm::cos(back_rad), turn_rad_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::behavior::motion::MotionLimits;
    use crate::behavior::signals::Signals;
    use crate::planning::Plan;
    use crate::units::radians;

    #[test]
    fn a_robot_goes_one_way_past_what_it_touches_though_its_way_lies_square_beside_it() {
        // Once it crept to and fro for a minute, by a centimetre.
        let (signals, limits) = (Signals::default(), MotionLimits::default());
        let tick = Tick::exploring(&signals, &limits);
        let mut state = NavigationState { plan: Plan::cramped(), ..NavigationState::default() };
        let ways = [89.0, 91.0, -95.0, 10.0, 91.0, 89.0].map(|bearing_deg| {
            match state.get_out(&tick, radians(bearing_deg)) {
                Some(Drive::Twist { forward_m_s, turn_rad_s: 0.0 }) => Some(forward_m_s > 0.0),
                _ => None,
            }
        });
        let ahead = Some(true);
        assert_eq!(ways, [ahead, ahead, ahead, None, Some(false), Some(false)]);
    }
}
