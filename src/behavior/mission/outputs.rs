//! What a state asks of the actuators: evaluated in a tick, put among the demands.

use arrayvec::ArrayVec;

use super::program::Ongoing;
use super::{DrivePlan, GoalPlan, MotionPlan, Outputs, SoundPlan};
use crate::behavior::blackboard::Scope;
use crate::behavior::demands::{Demands, Drive, towards};
use crate::behavior::expression::Expression;
use crate::behavior::motion::{Goal, Order};
use crate::behavior::navigation;
use crate::behavior::signals::Signal;
use crate::behavior::telling::Telling;
use crate::behavior::tune::Sound;
use crate::senses::{Channel, Role};
use crate::units::radians;

/// So near to where it should be the head has arrived, radians; it stops at half of that.
const HEAD_NEAR_RAD: f64 = 0.0175;

/// The same for a named motor: two degrees, as one that is geared up has coarse steps.
const MOTOR_NEAR_RAD: f64 = 0.035;

impl Outputs {
    /// Adds what is asked for to the demands of a tick. True where something ends, and has ended.
    pub(super) fn apply(
        &self,
        scope: Scope<'_>,
        ongoing: &mut Ongoing,
        demands: &mut Demands,
    ) -> bool {
        let finite =
            |number: &Expression| number.evaluate(scope).filter(|number| number.is_finite());
        let signals = &scope.board.signals;
        let mut has_ended = self.ends();
        match &self.drive {
            Some(DrivePlan::Motion(plan)) => {
                let Ongoing { motion, limits, .. } = ongoing;
                demands.drive = Some(motion.step(|| plan.order(finite), signals, limits));
                has_ended &= motion.is_done();
                ongoing.lacks_number = motion.order.is_none();
            }
            Some(DrivePlan::Navigation { plan, moves_head }) => {
                let Ongoing { motion, navigation, limits, .. } = ongoing;
                let (drive, head) =
                    navigation.step(|| plan.navigation(finite), motion, signals, limits);
                demands.drive = Some(drive);
                if let Some(head) = head.filter(|_| *moves_head) {
                    (demands.head_rad, demands.head_rad_s) = (Some(head.to_rad), head.max_rad_s);
                }
                has_ended &= navigation.is_done();
                ongoing.lacks_number = navigation.order.is_none();
            }
            Some(plan) => {
                demands.drive = Some(plan.drive(finite).unwrap_or(Drive::STILL));
            }
            None => {}
        }
        if let Some(head_deg) = &self.head_deg {
            demands.head_rad = finite(head_deg).map(radians);
            demands.head_rad_s = None;
            let most_rad = ongoing.limits.head_rad;
            let target_rad = demands.head_rad.map(|rad| rad.clamp(-most_rad, most_rad));
            let head_rad = signals.get(Signal::Sensed(Channel::Head));
            has_ended &= target_rad.zip(head_rad).is_some_and(|(target_rad, head_rad)| {
                (target_rad - head_rad).abs() < HEAD_NEAR_RAD
            });
        }
        for motor in &self.motors {
            let dps = motor.dps.as_ref().map_or(Some(f64::INFINITY), finite);
            let rad_s = dps.map_or(0.0, radians);
            let at = usize::from(motor.place);
            let rad_s = match &motor.to_deg {
                None => rad_s,
                Some(to_deg) => {
                    let to_rad = &mut ongoing.motors_to_rad[at];
                    *to_rad = to_rad.or_else(|| finite(to_deg).map(radians));
                    let now_rad = signals.get(Signal::Sensed(Channel::MOTORS[at]));
                    let missing_rad = to_rad.zip(now_rad).map(|(to_rad, now_rad)| to_rad - now_rad);
                    has_ended &= missing_rad.is_some_and(|missing| missing.abs() < MOTOR_NEAR_RAD);
                    missing_rad.map_or(0.0, |missing_rad| {
                        towards(missing_rad, MOTOR_NEAR_RAD / 2.0, rad_s.abs())
                    })
                }
            };
            demands.motors[at] = Some(rad_s);
        }
        demands.led = self.led.or(demands.led);
        match &self.sound {
            Some(SoundPlan::Lasting { hz }) => demands.tone_hz = finite(hz).or(demands.tone_hz),
            // What was begun on entry; another machine's may be heard instead.
            Some(_) => has_ended &= !ongoing.is_playing(scope.machine),
            None => {}
        }
        if let Some(say) = &self.say {
            demands.say = Some(say.text(scope));
        }
        has_ended
    }

    /// The sound that begins when the state is entered, or left.
    pub(super) fn sound(&self, scope: Scope<'_>) -> Option<Sound> {
        match self.sound.as_ref()? {
            SoundPlan::Lasting { .. } => None,
            SoundPlan::Tone { hz, length_s } => {
                let hz = hz.evaluate(scope).filter(|hz| hz.is_finite())?;
                Some(Sound::Tone { hz, length_s: *length_s })
            }
            SoundPlan::Tune(place) => Some(Sound::Tune(*place)),
        }
    }

    /// Whether it has something that comes to an end, so that `done` can be asked for.
    pub(super) fn ends(&self) -> bool {
        matches!(self.drive, Some(DrivePlan::Motion(_) | DrivePlan::Navigation { .. }))
            || self.head_deg.is_some()
            || self.motors.iter().any(|motor| motor.to_deg.is_some())
            || matches!(self.sound, Some(SoundPlan::Tone { .. } | SoundPlan::Tune(_)))
    }

    /// The parts of the robot that are moved.
    pub(super) fn roles(&self) -> impl Iterator<Item = Role> {
        let wheels = self.drive.as_ref().map(|_| Role::Wheels);
        let moves_head = self.head_deg.is_some()
            || matches!(self.drive, Some(DrivePlan::Navigation { moves_head: true, .. }));
        let head = moves_head.then_some(Role::Head);
        let motors = self.motors.iter().map(|motor| Role::Motor(motor.place));
        wheels.into_iter().chain(head).chain(motors)
    }

    /// Every number in it that is an expression.
    pub(super) fn expressions_mut(&mut self) -> impl Iterator<Item = &mut Expression> {
        let drive = self.drive.as_mut().map(DrivePlan::expressions_mut).unwrap_or_default();
        let motors = self.motors.iter_mut();
        let motors = motors.flat_map(|motor| motor.dps.iter_mut().chain(&mut motor.to_deg));
        let tone_hz = self.sound.iter_mut().filter_map(|sound| match sound {
            SoundPlan::Lasting { hz } | SoundPlan::Tone { hz, .. } => Some(hz),
            SoundPlan::Tune(_) => None,
        });
        let said = self.say.iter_mut().flat_map(Telling::expressions_mut);
        drive.into_iter().chain(&mut self.head_deg).chain(tone_hz).chain(motors).chain(said)
    }
}

impl DrivePlan {
    /// The drive; `None` where a number is not known or not finite.
    fn drive(&self, finite: impl Fn(&Expression) -> Option<f64>) -> Option<Drive> {
        match self {
            Self::Wheels { left_dps, right_dps } => Some(Drive::Wheels {
                left_rad_s: radians(finite(left_dps)?),
                right_rad_s: radians(finite(right_dps)?),
            }),
            Self::Twist { forward_mps, turn_dps } => Some(Drive::Twist {
                forward_m_s: finite(forward_mps)?,
                turn_rad_s: radians(finite(turn_dps)?),
            }),
            Self::Stop(action) => Some(Drive::Stop(*action)),
            // It is decided by what is under way.
            Self::Motion(_) | Self::Navigation { .. } => None,
        }
    }

    fn expressions_mut(&mut self) -> ArrayVec<&mut Expression, 6> {
        let mut found = ArrayVec::new();
        match self {
            Self::Wheels { left_dps: a, right_dps: b }
            | Self::Twist { forward_mps: a, turn_dps: b } => found.extend([a, b]),
            Self::Stop(_) => {}
            Self::Motion(plan) | Self::Navigation { plan, .. } => {
                found.extend(plan.speed_mps.iter_mut().chain(&mut plan.speed_dps));
                found.extend(&mut plan.keep_m);
                match &mut plan.goal {
                    GoalPlan::Ahead { way_m: a }
                    | GoalPlan::Turn { turn_deg: a }
                    | GoalPlan::Explore { within_m: a } => found.push(a),
                    GoalPlan::Arc { radius_m: a, turn_deg: b } => found.extend([a, b]),
                    GoalPlan::Place { x_m, y_m, face_deg } => {
                        found.extend([x_m, y_m].into_iter().chain(face_deg));
                    }
                }
            }
        }
        found
    }
}

impl MotionPlan {
    /// The motion, with its numbers as they are now; `None` where one is not known or not finite.
    fn order(&self, finite: impl Fn(&Expression) -> Option<f64>) -> Option<Order> {
        let goal = match &self.goal {
            GoalPlan::Ahead { way_m } => Goal::Ahead { way_m: finite(way_m)? },
            GoalPlan::Turn { turn_deg } => Goal::Turn { turn_rad: radians(finite(turn_deg)?) },
            GoalPlan::Arc { radius_m, turn_deg } => {
                Goal::Arc { radius_m: finite(radius_m)?, turn_rad: radians(finite(turn_deg)?) }
            }
            GoalPlan::Place { x_m, y_m, face_deg } => Goal::Place {
                x_m: finite(x_m)?,
                y_m: finite(y_m)?,
                face_rad: optional(face_deg, &finite)?.map(radians),
            },
            GoalPlan::Explore { .. } => return None,
        };
        let speed_m_s = optional(&self.speed_mps, &finite)?;
        let turn_rad_s = optional(&self.speed_dps, &finite)?.map(radians);
        Some(Order { goal, speed_m_s, turn_rad_s })
    }

    /// The same for a motion over the map.
    fn navigation(&self, finite: impl Fn(&Expression) -> Option<f64>) -> Option<navigation::Order> {
        let goal = match &self.goal {
            GoalPlan::Explore { within_m } => {
                navigation::Goal::Explore { within_m: finite(within_m)? }
            }
            GoalPlan::Place { x_m, y_m, face_deg } => navigation::Goal::Place {
                x_m: finite(x_m)?,
                y_m: finite(y_m)?,
                face_rad: optional(face_deg, &finite)?.map(radians),
            },
            _ => return None,
        };
        Some(navigation::Order {
            goal,
            keep_m: optional(&self.keep_m, &finite)?.unwrap_or(navigation::KEEP_M),
            speed_m_s: optional(&self.speed_mps, &finite)?,
            turn_rad_s: optional(&self.speed_dps, &finite)?.map(radians),
        })
    }
}

/// A number that may be left out: absent is well, and not known is not.
#[expect(clippy::option_option, reason = "absent and not known are different")]
fn optional(
    number: &Option<Expression>,
    finite: impl Fn(&Expression) -> Option<f64>,
) -> Option<Option<f64>> {
    match number {
        Some(number) => finite(number).map(Some),
        None => Some(None),
    }
}
