//! A mission that runs: its machines on the engine, one step a tick.

use super::{MachinePlan, Mission, OnStall, StatePlan};
use crate::behavior::demands::Demands;
use crate::behavior::engine::{Engine, EngineError, Machine, Progress, State};
use crate::behavior::signals::Signals;
use crate::behavior::{MAX_MACHINES, MachineState, Taken};
use crate::senses::Role;

/// A mission under way.
///
/// A step allocates nothing.
#[derive(Debug)]
pub struct Program {
    engine: Engine<Turn>,
    turn: Turn,
    /// How many states each machine has.
    states: Vec<usize>,
    /// Which machine goes to which state when the wheels are blocked.
    on_stall: Vec<(usize, u16)>,
}

/// The inputs of one step, as the engine hands them to checks and actions.
#[derive(Debug, Default)]
struct Turn {
    signals: Signals,
    demands: Demands,
    since: [MachineState; MAX_MACHINES],
}

impl Program {
    pub(super) fn new(mission: &Mission) -> Result<Self, EngineError> {
        let machines =
            mission.machines.iter().enumerate().map(|(index, plan)| machine(index, plan));
        let engine = Engine::new(mission.finish, machines)?;
        let on_stall = match &mission.on_stall {
            OnStall::Stop => Vec::new(),
            OnStall::Enter(state) => mission
                .machines
                .iter()
                .enumerate()
                .filter(|(_, plan)| plan.moves(Role::Wheels))
                .filter_map(|(index, plan)| Some((index, plan.position(state)?)))
                .collect(),
        };
        let states = mission.machines.iter().map(|plan| plan.states.len()).collect();
        let mut turn = Turn::default();
        for (since, plan) in turn.since.iter_mut().zip(&mission.machines) {
            since.state = plan.start;
        }
        Ok(Self { engine, turn, states, on_stall })
    }

    /// Takes one step: checks, transitions, actions. `demands` becomes what the machines want in
    /// this tick, and `on_taken` hears of each transition.
    pub fn step(
        &mut self,
        signals: &Signals,
        demands: &mut Demands,
        on_taken: impl FnMut(Taken),
    ) -> Progress {
        self.turn.signals = *signals;
        self.turn.demands = Demands::default();
        let progress = self.engine.step_traced(signals.time_ns(), &mut self.turn, on_taken);
        *demands = self.turn.demands;
        progress
    }

    /// The wheels are blocked: the machine that drives them goes to the state of `on_stall` at the
    /// next step, whatever its conditions say. One that is there already stays, and the state's
    /// time and way go on: its own conditions lead it out. False where the mission asks to be
    /// stopped instead.
    pub fn stall(&mut self) -> bool {
        for &(machine, state) in &self.on_stall {
            if self.engine.position(machine).is_none_or(|(active, _)| active != state) {
                self.engine.force(machine, state);
            }
        }
        !self.on_stall.is_empty()
    }

    /// The names of the active states, in the order of the machines.
    pub fn states(&self) -> impl Iterator<Item = &str> {
        (0..self.states.len()).filter_map(|machine| self.engine.active(machine))
    }

    /// Where each machine is, once the first step was taken: enough to go on from.
    #[must_use]
    pub fn checkpoint(&self) -> &[MachineState] {
        self.turn.since.get(..self.states.len()).unwrap_or_default()
    }

    /// Continues from a checkpoint of the same mission. Returns false, and changes nothing, if the
    /// checkpoint does not fit the mission.
    pub fn restore(&mut self, checkpoint: &[MachineState]) -> bool {
        let fits = checkpoint.len() == self.states.len()
            && checkpoint
                .iter()
                .zip(&self.states)
                .all(|(at, states)| usize::from(at.state) < *states);
        if fits {
            for (index, at) in checkpoint.iter().enumerate() {
                self.engine.restore(index, at.state, at.entered_ns);
                if let Some(since) = self.turn.since.get_mut(index) {
                    *since = *at;
                }
            }
        }
        fits
    }
}

impl Turn {
    fn since(&self, machine: usize) -> MachineState {
        self.since.get(machine).copied().unwrap_or_default()
    }
}

/// A machine of a mission, as the engine takes it.
fn machine(index: usize, plan: &MachinePlan) -> Machine<Turn> {
    let name = |at: u16| plan.state(at).map(|state| state.name.clone()).unwrap_or_default();
    let mut machine = Machine::new(plan.name.clone(), name(plan.start));
    for (at, state_plan) in (0_u16..).zip(&plan.states) {
        machine = machine.state(state_plan.name.clone(), |state| {
            let described = actions(state, index, at, state_plan);
            state_plan.next.iter().fold(described, |state, transition| {
                let when = transition.when.clone();
                state.when(
                    move |turn, _| when.holds(&turn.signals, &turn.since(index)),
                    name(transition.go),
                )
            })
        });
    }
    match plan.end {
        Some(end) => machine.ending_in(name(end)),
        None => machine,
    }
}

fn actions(state: State<Turn>, index: usize, at: u16, plan: &StatePlan) -> State<Turn> {
    let (entry, doing, exit) = (plan.on_entry.clone(), plan.doing.clone(), plan.on_exit.clone());
    state
        .entering(move |turn, _| {
            if let Some(since) = turn.since.get_mut(index) {
                *since = turn.signals.entering(at);
            }
            entry.apply(&turn.signals, &turn.since(index), &mut turn.demands);
        })
        .doing(move |turn, _| doing.apply(&turn.signals, &turn.since(index), &mut turn.demands))
        .leaving(move |turn, _| exit.apply(&turn.signals, &turn.since(index), &mut turn.demands))
}
