//! Where the range sensor looks: from side to side on the way, at a place, all around.
//!
//! # Spins
//!
//! Before it explores, a robot whose gyro was not measured spins to the left and to the right. In
//! 60 rooms that chance drew, 600 s each, without spins and with them:
//!
//! | the gyro is off by | wall covered | points within 5 cm | the pose is off at the worst |
//! |---|---|---|---|
//! | 3 % | 96.5, 97.2 % | 89.4, 93.5 % | 12.0, 3.0 cm |
//! | 1 %, a standard deviation | 97.3, 97.5 % | 92.5, 93.6 % | 5.1, 2.6 cm |
//!
//! It looks first, as it stands then: a slow drift shows, and landmarks are found in the directions
//! that they have. With a drift of 0.1 °/s headings are off by 1.6° to 2.1° after two minutes, by
//! 2.8° to 3.1° without spins, and by 5.5° to 6.4° where it spins first.
//!
//! Both ways, as what is left of the scale's error turns the map: after two turns to one side the
//! pose is off by 5 to 7 cm at the worst. Nothing in the repository prints these figures.
//!
//! # Looks
//!
//! Where it stands to look, the head turns at the speed of the way (90 °/s, for 43 as else), and
//! once it has backed off it looks 60° to either side (for 90). Of 400 runs of 300 s in `arena`,
//! with pillars, with slanted blocks and in rooms that chance drew: 1.0 % ± 0.2 more of the wall,
//! 0.2 % ± 0.1 fewer points within 5 cm; at least 95 % of `arena` in 85 % of 80 runs, for 69. With
//! the first look as fast, too, 3 of 80 runs among slanted blocks lost their heading.
//!
//! # What was tried and gave nothing
//!
//! Most collisions are with the end of a wall, met at 30° to 60°, on a side that the head had not
//! seen for half a metre. A narrower swing finds it, but the pose is off by half as much again, as
//! walls beside the way are seen less; on narrow ways alone (45°, and 60°), as many collisions, and
//! 1 % of the points less within 5 cm of a wall. Slowing down where a wall square to an echo would
//! cross the way changes nothing: the end of a wall gives no echo there. Shorter looks at what is
//! not known save no time.

use std::f64::consts::{PI, TAU};

use super::tick::Tick;
use super::{Goal, NavigationState, Phase};
use crate::behavior::motion::{self, MotionState};
use crate::planning::View;

/// How far the head swings to either side on the way, if it may: past the wall beside the way,
/// whose foot is at 90° and counts only if the wall was heard to both sides of it.
const SWING_RAD: f64 = 110.0 * (PI / 180.0);

/// How far to either side of what is looked at the head looks.
const LOOK_RAD: f64 = 50.0 * (PI / 180.0);

/// How far to either side it looks once it has backed off: what it came upon is ahead.
pub(super) const MET_RAD: f64 = 60.0 * (PI / 180.0);

/// The spins that exploring may begin with (`mapping::whole_turn`): how many, how many turns each,
/// and how fast.
const SPINS: u8 = 2;
const SPIN_TURNS: f64 = 1.6;
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
    /// drives little of it before a side is seen again; so, too, where it stands to look. The first
    /// look takes its time: what the gyro does meanwhile is its drift.
    pub(super) fn head(&mut self, tick: &Tick<'_>) -> Option<HeadAim> {
        let to_rad = self.head_rad(tick)?;
        let hurries = match self.phase {
            Phase::Drive => true,
            Phase::Look { .. } => self.serial > 0,
            _ => false,
        };
        Some(HeadAim { to_rad, max_rad_s: hurries.then_some(tick.limits.head_max_rad_s) })
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

    /// Looks so far to either side, as far as the head turns; where the sensor is fixed, all round.
    pub(super) fn look_round(&mut self, tick: &Tick<'_>, motion: &mut MotionState, side_rad: f64) {
        self.rest();
        if tick.limits.head_rad > 0.0 {
            self.look(tick, -side_rad, side_rad);
        } else {
            self.turn_round(tick, motion);
        }
    }

    /// Has looked; what is planned next goes by it. Before that a robot of which it is not known
    /// what its gyro counts for a turn spins both ways, by which the estimator finds that out.
    pub(super) fn looked(&mut self, tick: &Tick<'_>, motion: &mut MotionState, view: View) {
        if self.is_to_spin(tick) {
            self.turn_round(tick, motion);
        } else {
            self.ask(tick, Some(view), None);
        }
    }

    fn is_to_spin(&self, tick: &Tick<'_>) -> bool {
        let explores = matches!(tick.order.goal, Goal::Explore { .. });
        explores && tick.limits.spins_first && self.spins < SPINS
    }

    fn turn_round(&mut self, tick: &Tick<'_>, motion: &mut MotionState) {
        let (mut turns, mut turn_rad_s) = (1.0, tick.order.turn_rad_s);
        if self.is_to_spin(tick) {
            self.spins += 1;
            turns = SPIN_TURNS;
            turn_rad_s = Some(turn_rad_s.map_or(SPIN_RAD_S, |asked| asked.min(SPIN_RAD_S)));
        }
        self.turns_left = !self.turns_left;
        let turn_rad = if self.turns_left { turns * TAU } else { -turns * TAU };
        let goal = motion::Goal::Turn { turn_rad };
        *motion = MotionState::with(motion::Order { goal, speed_m_s: None, turn_rad_s });
        self.phase = Phase::TurnRound;
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
