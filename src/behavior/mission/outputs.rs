//! What a state asks of the actuators: evaluated in a tick, put among the demands.

use super::{DrivePlan, Outputs};
use crate::behavior::MachineState;
use crate::behavior::demands::{Demands, Drive};
use crate::behavior::expression::Expression;
use crate::behavior::signals::Signals;
use crate::ev3dev::StopAction;
use crate::senses::Role;
use crate::units::radians;

impl Outputs {
    /// Adds what is asked for to the demands of a tick.
    pub(super) fn apply(&self, signals: &Signals, since: &MachineState, demands: &mut Demands) {
        let finite = |number: &Expression| {
            number.evaluate(signals, since).filter(|number| number.is_finite())
        };
        if let Some(plan) = &self.drive {
            demands.drive = Some(plan.drive(finite).unwrap_or(Drive::Stop(StopAction::Brake)));
        }
        if let Some(head_deg) = &self.head_deg {
            demands.head_rad = finite(head_deg).map(radians);
        }
        for (place, dps) in &self.motors_dps {
            if let Some(motor) = demands.motors.get_mut(usize::from(*place)) {
                *motor = Some(finite(dps).map_or(0.0, radians));
            }
        }
        demands.led = self.led.or(demands.led);
        demands.tone_hz = self.tone_hz.as_ref().and_then(finite).or(demands.tone_hz);
        demands.say = self.say.or(demands.say);
    }

    /// The parts of the robot that are moved.
    pub(super) fn roles(&self) -> impl Iterator<Item = Role> {
        let wheels = self.drive.as_ref().map(|_| Role::Wheels);
        let head = self.head_deg.as_ref().map(|_| Role::Head);
        let motors = self.motors_dps.iter().map(|(place, _)| Role::Motor(*place));
        wheels.into_iter().chain(head).chain(motors)
    }

    /// Every number in it that is an expression.
    pub(super) fn expressions_mut(&mut self) -> impl Iterator<Item = &mut Expression> {
        let drive = match &mut self.drive {
            Some(
                DrivePlan::Wheels { left_dps: a, right_dps: b }
                | DrivePlan::Twist { forward_mps: a, turn_dps: b },
            ) => [Some(a), Some(b)],
            Some(DrivePlan::Stop(_)) | None => [None, None],
        };
        let motors = self.motors_dps.iter_mut().map(|(_, dps)| dps);
        drive.into_iter().flatten().chain(&mut self.head_deg).chain(&mut self.tone_hz).chain(motors)
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
        }
    }
}
