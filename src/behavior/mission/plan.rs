//! What a mission's file says of its machines, read and checked.

use std::ops::Range;

use arrayvec::ArrayVec;

use crate::behavior::engine::LEVELS;
use crate::behavior::expression::Expression;
use crate::behavior::telling::Telling;
use crate::ev3dev::{LightColour, StopAction};
use crate::senses::Role;

/// A machine of a mission.
#[derive(Debug, Clone)]
pub struct MachinePlan {
    /// Its name.
    pub name: String,
    /// Start and final state, and the transitions of all states.
    pub region: RegionPlan,
    /// In the order of the file, those of a sub-machine behind the state that uses it.
    pub states: Vec<StatePlan>,
}

/// What holds for all states of a machine, or of a sub-machine.
#[derive(Debug, Clone, Default)]
pub struct RegionPlan {
    /// Index of the start state.
    pub start: u16,
    /// Index of the final state, if there is one.
    pub end: Option<u16>,
    /// Where it goes when the wheels are blocked.
    pub on_stall: Option<u16>,
    /// The transitions that are looked at in all states before a state's own, but for the final
    /// state and the one they lead to.
    pub always: Vec<TransitionPlan>,
}

/// A state of a machine.
#[derive(Debug, Clone)]
pub struct StatePlan {
    /// Its name; of a state of a sub-machine, behind that of the state that uses it: `look.left`.
    pub name: String,
    /// Where its name stands in the file.
    pub(super) place: Range<usize>,
    /// The state that it is inside.
    pub(super) parent: Option<u16>,
    /// The last state inside it, or itself.
    pub(super) last: u16,
    /// What holds for the states inside it, where it uses a sub-machine.
    pub inner: Option<RegionPlan>,
    pub(super) doing: Outputs,
    pub(super) on_entry: Outputs,
    pub(super) set: Vec<Assignment>,
    pub(super) on_exit: Outputs,
    /// Its own transitions, in the order in which they are checked.
    pub next: Vec<TransitionPlan>,
}

/// A transition of a state.
#[derive(Debug, Clone)]
pub struct TransitionPlan {
    /// The condition.
    pub when: Expression,
    /// Where it stands in the file.
    pub(super) place: Range<usize>,
    pub(super) set: Vec<Assignment>,
    /// Index of the destination.
    pub go: u16,
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
    pub(super) motors: Vec<MotorPlan>,
    pub(super) led: Option<LightColour>,
    pub(super) sound: Option<SoundPlan>,
    pub(super) say: Option<Telling>,
}

/// What a named motor does.
#[derive(Debug, Clone)]
pub(super) struct MotorPlan {
    /// Which one, by its place in the capabilities.
    pub(super) place: u8,
    /// How fast: on and on, or as far as `to_deg`; as fast as the robot's file allows without it.
    pub(super) dps: Option<Expression>,
    /// Where its way ends.
    pub(super) to_deg: Option<Expression>,
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
    Wheels {
        left_dps: Expression,
        right_dps: Expression,
    },
    Twist {
        forward_mps: Expression,
        turn_dps: Expression,
    },
    Stop(StopAction),
    Motion(Box<MotionPlan>),
    /// A motion that finds its way over the map.
    Navigation {
        plan: Box<MotionPlan>,
        /// The robot has a head, which the motion moves.
        moves_head: bool,
    },
}

/// A motion that ends.
#[derive(Debug, Clone)]
pub(super) struct MotionPlan {
    pub(super) goal: GoalPlan,
    pub(super) keep_m: Option<Expression>,
    pub(super) speed_mps: Option<Expression>,
    pub(super) speed_dps: Option<Expression>,
}

#[derive(Debug, Clone)]
pub(super) enum GoalPlan {
    Ahead { way_m: Expression },
    Turn { turn_deg: Expression },
    Arc { radius_m: Expression, turn_deg: Expression },
    Place { x_m: Expression, y_m: Expression, face_deg: Option<Expression> },
    Explore { within_m: Expression },
}

impl MachinePlan {
    /// Index of the state that is active first: the start state, or the start state inside it.
    #[must_use]
    pub fn first(&self) -> u16 {
        let mut first = self.region.start;
        while let Some(inner) = self.state(first).and_then(|state| state.inner.as_ref()) {
            first = inner.start;
        }
        first
    }

    /// The state of this index.
    #[must_use]
    pub fn state(&self, index: u16) -> Option<&StatePlan> {
        self.states.get(usize::from(index))
    }

    /// All of its transitions.
    pub(super) fn all_transitions(&self) -> impl Iterator<Item = &TransitionPlan> {
        let regions = self.states.iter().filter_map(|state| state.inner.as_ref());
        let always = regions.chain([&self.region]).flat_map(|region| &region.always);
        always.chain(self.states.iter().flat_map(|state| &state.next))
    }

    /// Whether one of its states moves this part of the robot.
    #[must_use]
    pub fn moves(&self, role: Role) -> bool {
        self.states.iter().any(|state| state.doing.roles().any(|moved| moved == role))
    }

    /// The states of the machine, or those that are directly inside a state, with their indices.
    pub fn inside(&self, parent: Option<u16>) -> impl Iterator<Item = (u16, &StatePlan)> {
        let last = parent.and_then(|parent| self.state(parent)).map(|state| state.last);
        let mut next = parent.map_or(0, |parent| parent.saturating_add(1));
        std::iter::from_fn(move || {
            let at = (next <= last.unwrap_or(u16::MAX)).then_some(next)?;
            let state = self.state(at)?;
            next = state.last.checked_add(1)?;
            Some((at, state))
        })
    }

    /// A state and those it is inside, from the outermost, each with its place.
    pub(super) fn chain(&self, state: u16) -> impl Iterator<Item = (u16, &StatePlan)> {
        let mut chain: ArrayVec<(u16, &StatePlan), LEVELS> = ArrayVec::new();
        let placed = |at: u16| Some((at, self.state(at)?));
        let mut at = placed(state);
        while let Some(one) = at
            && chain.try_push(one).is_ok()
        {
            at = one.1.parent.and_then(placed);
        }
        chain.into_iter().rev()
    }

    /// What holds for the states beside one.
    pub(super) fn around(&self, state: &StatePlan) -> Option<&RegionPlan> {
        match state.parent {
            Some(parent) => self.state(parent)?.inner.as_ref(),
            None => Some(&self.region),
        }
    }

    /// Where each state leads when the wheels are blocked: to the state that the innermost of the
    /// sub-machines in use names, else to the machine's.
    pub(super) fn stalls(&self) -> Vec<Option<u16>> {
        let named = |state: &StatePlan| self.around(state)?.on_stall;
        (0..)
            .zip(&self.states)
            .map(|(at, _)| self.chain(at).filter_map(|(_, state)| named(state)).last())
            .collect()
    }

    /// The transitions from a state, as
    /// [`Taken::transition`](crate::behavior::Taken::transition) counts them: from the outermost
    /// state that it is inside, each time those of all states first.
    pub fn transitions(&self, from: u16) -> impl Iterator<Item = &TransitionPlan> {
        self.chain(from).flat_map(|(_, state)| {
            let always = self.around(state).map(|region| region.always.iter());
            always.into_iter().flatten().chain(&state.next)
        })
    }

    /// Every expression in it.
    pub(super) fn expressions_mut(&mut self) -> impl Iterator<Item = &mut Expression> {
        let states = self.states.iter_mut().flat_map(|state| {
            let outputs = [&mut state.doing, &mut state.on_entry, &mut state.on_exit];
            let set = state.set.iter_mut().map(|assignment| &mut assignment.value);
            let always = state.inner.iter_mut().flat_map(|inner| &mut inner.always);
            let next = always.chain(&mut state.next).flat_map(TransitionPlan::expressions_mut);
            outputs.into_iter().flat_map(Outputs::expressions_mut).chain(set).chain(next)
        });
        self.region.always.iter_mut().flat_map(TransitionPlan::expressions_mut).chain(states)
    }

    /// Index of one of the machine's own states.
    pub(super) fn position(&self, state: &str) -> Option<u16> {
        self.inside(None).find(|(_, plan)| plan.name == state).map(|(index, _)| index)
    }
}

impl StatePlan {
    /// Whether it comes to an end, so that `done` can be asked for.
    pub(super) fn ends(&self) -> bool {
        self.doing.ends() || self.inner.as_ref().is_some_and(|inner| inner.end.is_some())
    }
}

impl TransitionPlan {
    pub(super) fn expressions_mut(&mut self) -> impl Iterator<Item = &mut Expression> {
        let set = self.set.iter_mut().map(|assignment| &mut assignment.value);
        std::iter::once(&mut self.when).chain(set)
    }
}
