//! What a mission's file says of its machines, read and checked.

use crate::behavior::demands::Led;
use crate::behavior::expression::Expression;
use crate::behavior::telling::Telling;
use crate::ev3dev::StopAction;
use crate::senses::Role;

/// A machine of a mission.
#[derive(Debug, Clone)]
pub struct MachinePlan {
    pub(super) name: String,
    pub(super) start: u16,
    pub(super) end: Option<u16>,
    pub(super) always: Vec<TransitionPlan>,
    pub(super) states: Vec<StatePlan>,
}

/// A state of a machine.
#[derive(Debug, Clone)]
pub struct StatePlan {
    pub(super) name: String,
    pub(super) doing: Outputs,
    pub(super) on_entry: Outputs,
    pub(super) set: Vec<Assignment>,
    pub(super) on_exit: Outputs,
    pub(super) next: Vec<TransitionPlan>,
}

/// A transition of a state.
#[derive(Debug, Clone)]
pub struct TransitionPlan {
    pub(super) when: Expression,
    pub(super) set: Vec<Assignment>,
    pub(super) go: u16,
}

/// A variable gets another value.
#[derive(Debug, Clone)]
pub(super) struct Assignment {
    pub(super) variable: u8,
    pub(super) value: Expression,
}

/// What a state asks of the actuators.
#[derive(Debug, Clone, Default)]
pub(super) struct Outputs {
    pub(super) drive: Option<DrivePlan>,
    pub(super) head_deg: Option<Expression>,
    pub(super) motors_dps: Vec<(u8, Expression)>,
    pub(super) led: Option<Led>,
    pub(super) sound: Option<SoundPlan>,
    pub(super) say: Option<Telling>,
}

#[derive(Debug, Clone)]
pub(super) enum SoundPlan {
    /// A tone for as long as the state is active.
    Lasting { hz: Expression },
    /// A tone that ends.
    Tone { hz: Expression, length_s: f64 },
    /// A tune, by its place in the mission.
    Tune(u16),
}

#[derive(Debug, Clone)]
pub(super) enum DrivePlan {
    Wheels { left_dps: Expression, right_dps: Expression },
    Twist { forward_mps: Expression, turn_dps: Expression },
    Stop(StopAction),
    Motion(Box<MotionPlan>),
}

/// A motion that ends.
#[derive(Debug, Clone)]
pub(super) struct MotionPlan {
    pub(super) goal: GoalPlan,
    pub(super) speed_mps: Option<Expression>,
    pub(super) speed_dps: Option<Expression>,
}

#[derive(Debug, Clone)]
pub(super) enum GoalPlan {
    Ahead { way_m: Expression },
    Turn { turn_deg: Expression },
    Arc { radius_m: Expression, turn_deg: Expression },
    Place { x_m: Expression, y_m: Expression, face_deg: Option<Expression> },
}

impl MachinePlan {
    /// The machine's name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Index of the start state.
    #[must_use]
    pub fn start(&self) -> u16 {
        self.start
    }

    /// Index of the final state, if there is one.
    #[must_use]
    pub fn end(&self) -> Option<u16> {
        self.end
    }

    /// The states, in the order of the file.
    #[must_use]
    pub fn states(&self) -> &[StatePlan] {
        &self.states
    }

    /// The state of this index.
    #[must_use]
    pub fn state(&self, index: u16) -> Option<&StatePlan> {
        self.states.get(usize::from(index))
    }

    /// Whether one of its states moves this part of the robot.
    #[must_use]
    pub fn moves(&self, role: Role) -> bool {
        self.states.iter().any(|state| state.doing.roles().any(|moved| moved == role))
    }

    /// The transitions that are looked at in all states before a state's own, but for the final
    /// state and the one they lead to.
    #[must_use]
    pub fn always(&self) -> &[TransitionPlan] {
        &self.always
    }

    /// A transition from a state, counted as
    /// [`Taken::transition`](crate::behavior::Taken::transition) counts.
    #[must_use]
    pub fn transition(&self, from: u16, index: u16) -> Option<&TransitionPlan> {
        let next = &self.state(from)?.next;
        self.always.iter().chain(next).nth(usize::from(index))
    }

    /// Every expression in it.
    pub(super) fn expressions_mut(&mut self) -> impl Iterator<Item = &mut Expression> {
        let states = self.states.iter_mut().flat_map(|state| {
            let outputs = [&mut state.doing, &mut state.on_entry, &mut state.on_exit];
            let set = state.set.iter_mut().map(|assignment| &mut assignment.value);
            let next = state.next.iter_mut().flat_map(TransitionPlan::expressions_mut);
            outputs.into_iter().flat_map(Outputs::expressions_mut).chain(set).chain(next)
        });
        self.always.iter_mut().flat_map(TransitionPlan::expressions_mut).chain(states)
    }

    pub(super) fn position(&self, state: &str) -> Option<u16> {
        (0_u16..).zip(&self.states).find(|(_, plan)| plan.name == state).map(|(index, _)| index)
    }
}

impl StatePlan {
    /// The state's name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The transitions, in the order in which they are checked.
    #[must_use]
    pub fn transitions(&self) -> &[TransitionPlan] {
        &self.next
    }
}

impl TransitionPlan {
    /// The condition.
    #[must_use]
    pub fn when(&self) -> &Expression {
        &self.when
    }

    /// Index of the destination.
    #[must_use]
    pub fn go(&self) -> u16 {
        self.go
    }

    pub(super) fn expressions_mut(&mut self) -> impl Iterator<Item = &mut Expression> {
        let set = self.set.iter_mut().map(|assignment| &mut assignment.value);
        std::iter::once(&mut self.when).chain(set)
    }
}
