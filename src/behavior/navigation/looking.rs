//! Where the range sensor looks: from side to side on the way, at a place, all around.
//!
//! # What was tried and gave nothing
//!
//! Most collisions are with the end of a wall, met at 30° to 60°, on a side that the head had not
//! seen for half a metre. A narrower swing finds it, but the pose is off by half as much again, as
//! walls beside the way are seen less; on narrow ways alone (45°, and 60°), as many collisions, and
//! 1 % of the points less within 5 cm of a wall. Slowing down where a wall square to an echo would
//! cross the way changes nothing: the end of a wall gives no echo there. Shorter looks save no
//! time.

use std::f64::consts::{PI, TAU};

use super::tick::Tick;
use super::{NavigationState, Phase};
use crate::behavior::motion::{self, MotionState};

/// How far the head swings to either side on the way, if it may: past the wall beside the way,
/// whose foot is at 90° and counts only if the wall was heard to both sides of it.
const SWING_RAD: f64 = 110.0 * (PI / 180.0);

/// How far to either side of what is looked at the head looks.
const LOOK_RAD: f64 = 50.0 * (PI / 180.0);

/// The turns that exploring may begin with, and how fast they are: the gyro's scale comes out right
/// to 0.2 %, at 75 °/s to 0.5 % (`mapping::whole_turn`).
const SPIN_RAD: f64 = 2.1 * TAU;
const SPIN_RAD_S: f64 = PI / 3.0;

/// The head has arrived within this.
pub(super) const HEAD_NEAR_RAD: f64 = 4.0 * (PI / 180.0);

/// Where the head is to point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::behavior) struct HeadAim {
    /// Radians anticlockwise from straight ahead.
    pub(in crate::behavior) to_rad: f64,
    /// How fast it turns there, radians per second, if not as fast as it usually does.
    pub(in crate::behavior) max_rad_s: Option<f64>,
}

impl NavigationState {
    /// Where the head points: from side to side, on the way as fast as it may, so that the robot
    /// drives little of it before a side is seen again.
    pub(super) fn head(&mut self, tick: &Tick<'_>) -> Option<HeadAim> {
        let to_rad = self.head_rad(tick)?;
        let max_rad_s = (self.phase == Phase::Drive).then_some(tick.limits.head_max_rad_s);
        Some(HeadAim { to_rad, max_rad_s })
    }

    fn head_rad(&mut self, tick: &Tick<'_>) -> Option<f64> {
        if tick.limits.head_rad <= 0.0 {
            return None;
        }
        match self.phase {
            Phase::Look { from_rad, to_rad, back } => Some(if back { to_rad } else { from_rad }),
            Phase::TurnRound | Phase::Done | Phase::Arrive | Phase::FaceEnd => Some(0.0),
            _ => {
                let most_rad = SWING_RAD.min(tick.limits.head_rad);
                let target_rad = if self.head_left { most_rad } else { -most_rad };
                if (tick.head_rad() - target_rad) * target_rad.signum() > -HEAD_NEAR_RAD {
                    self.head_left = !self.head_left;
                }
                Some(target_rad)
            }
        }
    }

    /// Looks at a place that lies within the head's reach.
    pub(super) fn look_at(&mut self, tick: &Tick<'_>, [x_m, y_m]: [f64; 2]) {
        let (_, bearing_rad) = tick.at.to(x_m, y_m);
        self.look(tick, bearing_rad - LOOK_RAD, bearing_rad + LOOK_RAD);
    }

    /// Looks to all sides before all else. Where it is not known what the gyro counts for a turn,
    /// the robot makes two and a little more, by which the estimator finds that out.
    pub(super) fn look_first(&mut self, tick: &Tick<'_>, motion: &mut MotionState) {
        if !tick.limits.spins_first || std::mem::replace(&mut self.has_spun, true) {
            self.look_round(tick, motion);
            return;
        }
        let goal = motion::Goal::Turn { turn_rad: SPIN_RAD };
        let turn_rad_s = tick.order.turn_rad_s.map_or(SPIN_RAD_S, |asked| asked.min(SPIN_RAD_S));
        *motion = MotionState::with(motion::Order {
            goal,
            speed_m_s: None,
            turn_rad_s: Some(turn_rad_s),
        });
        self.phase = Phase::TurnRound;
    }

    /// Looks to all sides.
    pub(super) fn look_round(&mut self, tick: &Tick<'_>, motion: &mut MotionState) {
        self.rest();
        let most_rad = tick.limits.head_rad;
        if most_rad > 0.0 {
            self.look(tick, -most_rad, most_rad);
        } else {
            self.turns_left = !self.turns_left;
            let turn_rad = if self.turns_left { TAU } else { -TAU };
            self.begin(Phase::TurnRound, motion, motion::Goal::Turn { turn_rad });
        }
    }

    fn look(&mut self, tick: &Tick<'_>, right_rad: f64, left_rad: f64) {
        self.rest();
        let most_rad = tick.limits.head_rad;
        let [right_rad, left_rad] = [right_rad, left_rad].map(|rad| rad.clamp(-most_rad, most_rad));
        // From the nearer end.
        let head_rad = tick.head_rad();
        let from_left = (left_rad - head_rad).abs() < (right_rad - head_rad).abs();
        let (from_rad, to_rad) =
            if from_left { (left_rad, right_rad) } else { (right_rad, left_rad) };
        self.phase = Phase::Look { from_rad, to_rad, back: false };
    }
}
