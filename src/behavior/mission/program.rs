//! A mission that runs: its machines on the engine, one step a tick.

use std::cell::Cell;

use arrayvec::ArrayVec;
use serde::{Deserialize, Serialize};

use super::{Assignment, MachinePlan, Mission, Outputs, RegionPlan, StatePlan, TransitionPlan};
use crate::behavior::blackboard::{
    Blackboard, MAX_PIDS, MAX_VARIABLES, MachineState, PidState, Scope,
};
use crate::behavior::demands::Demands;
use crate::behavior::engine::{Engine, EngineError, LEVELS, Machine, Progress, State};
use crate::behavior::motion::{MotionLimits, MotionState};
use crate::behavior::navigation::NavigationState;
use crate::behavior::signals::Signals;
use crate::behavior::tune::{Playing, Sound, Tune};
use crate::behavior::{MAX_MACHINES, MAX_MOTORS, Taken};
use crate::clock::seconds;
use crate::planning::{Clearance, Plan, Request};
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
    /// How many variables there are.
    variables: usize,
    /// The machine that drives the wheels, and where each of its states leads when they are
    /// blocked.
    on_stall: Option<(usize, Vec<Option<u16>>)>,
    /// What variables begin with that is worked out at the first step.
    firsts: Vec<Assignment>,
    /// Whether that is taken.
    begun: bool,
}

/// The inputs of one step, as the engine hands them to checks and actions.
#[derive(Debug, Default)]
struct Turn {
    board: Blackboard,
    ongoing: Ongoing,
    demands: Demands,
}

/// What is under way, and takes more than one tick.
#[derive(Debug, Default)]
pub(super) struct Ongoing {
    /// Of the one machine that moves the wheels.
    pub(super) motion: MotionState,
    pub(super) navigation: NavigationState,
    pub(super) limits: MotionLimits,
    /// Where the ways of the named motors end, radians.
    pub(super) motors_to_rad: [Option<f64>; MAX_MOTORS],
    /// The motion of this step waits for a number that is not known, or infinite.
    pub(super) lacks_number: bool,
    /// The mission's tunes.
    tunes: Vec<Tune>,
    /// What each machine has begun to play.
    playing: [Option<Playing>; MAX_MACHINES],
}

impl Ongoing {
    /// A state is entered that moves a part of the robot.
    fn begin(&mut self, role: Role) {
        match role {
            Role::Wheels => {
                self.motion = MotionState::default();
                self.navigation.reset();
            }
            Role::Motor(place) => self.motors_to_rad[usize::from(place)] = None,
            _ => {}
        }
    }

    /// Whether what a machine has begun to play is not over.
    pub(super) fn is_playing(&self, machine: usize) -> bool {
        self.playing.get(machine).is_some_and(Option::is_some)
    }

    /// The tone of this moment, of what the machines play: the last machine's; `None` where none
    /// of them plays. What is over is forgotten.
    fn tone_hz(&mut self, now_ns: i64) -> Option<Option<f64>> {
        let mut heard = None;
        for playing in &mut self.playing {
            let tone_hz = playing.and_then(|begun| {
                begun.tone_hz(&self.tunes, seconds(now_ns.saturating_sub(begun.began_ns)))
            });
            if tone_hz.is_none() {
                *playing = None;
            }
            heard = tone_hz.or(heard);
        }
        heard
    }
}

/// What a mission carries from tick to tick: enough to go on from.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ProgramState {
    /// Where each machine is.
    pub machines: ArrayVec<MachineState, MAX_MACHINES>,
    /// The variables.
    pub variables: ArrayVec<f64, MAX_VARIABLES>,
    /// What each machine's `pid`s remember.
    pids: ArrayVec<[PidState; MAX_PIDS], MAX_MACHINES>,
    motion: MotionState,
    #[serde(default)]
    navigation: NavigationState,
    #[serde(default)]
    motors_to_rad: [Option<f64>; MAX_MOTORS],
    /// What each machine plays.
    playing: ArrayVec<Option<Playing>, MAX_MACHINES>,
}

impl Program {
    pub(super) fn new(mission: &Mission) -> Result<Self, EngineError> {
        let plans = || mission.machines.iter().enumerate();
        let machines = plans()
            .map(|(machine, plan)| region(Place { machine, level: 0 }, plan, &plan.region, None));
        let engine = Engine::new(mission.finish, machines)?;
        let driving = plans().find(|(_, plan)| plan.moves(Role::Wheels));
        let on_stall = driving.map(|(machine, plan)| (machine, plan.stalls()));
        let states = mission.machines.iter().map(|plan| plan.states.len()).collect();
        let mut turn = Turn::default();
        for (machine, plan) in turn.board.machines.iter_mut().zip(&mission.machines) {
            machine.state = plan.first();
        }
        turn.ongoing.tunes.clone_from(&mission.tunes);
        for (variable, (_, first)) in turn.board.variables.iter_mut().zip(&mission.variables) {
            *variable = *first;
        }
        let (variables, firsts) = (mission.variables.len(), mission.firsts.clone());
        Ok(Self { engine, turn, states, variables, on_stall, firsts, begun: false })
    }

    /// The same program, whose `random` draws from a seed; without one it is 0.
    #[must_use]
    pub fn with_seed(mut self, seed: u64) -> Self {
        self.turn.board.seed = seed;
        self
    }

    /// The same program, whose motions keep to a robot's limits.
    #[must_use]
    pub fn with_limits(mut self, limits: MotionLimits) -> Self {
        self.turn.ongoing.limits = limits;
        self
    }

    /// Takes one step: checks, transitions, actions. `demands` becomes what the machines want in
    /// this tick, and `on_taken` hears of each transition.
    pub fn step(
        &mut self,
        signals: &Signals,
        demands: &mut Demands,
        on_taken: impl FnMut(Taken),
    ) -> Progress {
        self.turn.board.signals = *signals;
        self.turn.demands = Demands::default();
        self.turn.ongoing.lacks_number = false;
        if !self.begun {
            self.begun = true;
            // Each one knows those above it.
            for first in &self.firsts {
                self.turn.set(Place { machine: 0, level: 0 }, std::slice::from_ref(first));
            }
        }
        // What was over by now is done in this step already.
        let now_ns = signals.time_ns();
        self.turn.ongoing.tone_hz(now_ns);
        let progress = self.engine.step_traced(now_ns, &mut self.turn, on_taken);
        *demands = self.turn.demands;
        if progress == Progress::Finished {
            // Whatever another machine wants: nothing moves while the last sounds are heard.
            let Demands { led, tone_hz, say, .. } = *demands;
            *demands = Demands { led, tone_hz, say, ..Demands::still() };
        }
        match self.turn.ongoing.tone_hz(now_ns) {
            Some(tone_hz) => {
                demands.tone_hz = tone_hz;
                Progress::Running
            }
            None => progress,
        }
    }

    /// The wheels are blocked. A motion over the map backs off by itself. Else the machine that
    /// drives the wheels goes to the state of `on_stall` at the next step, whatever its conditions
    /// say: to that of the innermost sub-machine in use which names one, else to the mission's. One
    /// that is there already stays, and the state's time and way go on: its own conditions lead it
    /// out. False where there is none: the mission asks to be stopped.
    pub fn stall(&mut self) -> bool {
        if self.turn.ongoing.navigation.stall() {
            return true;
        }
        let Some((machine, stalls)) = &self.on_stall else { return false };
        let at = self.engine.position(*machine).map(|(at, _)| usize::from(at));
        let Some(state) = at.and_then(|at| *stalls.get(at)?) else { return false };
        self.engine.is_in(*machine, state) || self.engine.force(*machine, state)
    }

    /// The request for a plan that the machines wait for.
    #[must_use]
    pub fn request(&self) -> Option<&Request> {
        self.turn.ongoing.navigation.request()
    }

    /// The plan to the request; the machines follow it from the next step on.
    pub fn answer(&mut self, plan: &Plan) {
        self.turn.ongoing.navigation.answer(plan);
    }

    /// The points of the map that are near to the robot; the machines go by them in the next step.
    pub fn keep_clear(&mut self, clearance: Clearance) {
        self.turn.ongoing.navigation.keep_clear(clearance);
    }

    /// Whether nothing is left but the end of the mission's time: each machine is in its final
    /// state or has none.
    #[must_use]
    pub fn waits_for_time(&self) -> bool {
        self.engine.waits()
    }

    /// Whether the motion of the last step waits for a number that is not known, or infinite.
    #[must_use]
    pub fn lacks_number(&self) -> bool {
        self.turn.ongoing.lacks_number
    }

    /// The names of the active states, in the order of the machines.
    pub fn states(&self) -> impl Iterator<Item = &str> {
        (0..self.states.len()).filter_map(|machine| self.engine.active(machine))
    }

    /// The variables, in the order of the mission.
    #[must_use]
    pub fn variables(&self) -> &[f64] {
        self.turn.board.variables.get(..self.variables).unwrap_or_default()
    }

    /// What is carried to the next tick, once the first step was taken: enough to go on from.
    #[must_use]
    pub fn state(&self) -> ProgramState {
        let board = &self.turn.board;
        let pids = board.pids.iter().map(|pids| pids.each_ref().map(Cell::get));
        ProgramState {
            machines: board.machines.iter().take(self.states.len()).cloned().collect(),
            variables: self.variables().iter().copied().collect(),
            pids: pids.take(self.states.len()).collect(),
            motion: self.turn.ongoing.motion,
            navigation: self.turn.ongoing.navigation.clone(),
            motors_to_rad: self.turn.ongoing.motors_to_rad,
            playing: self.turn.ongoing.playing.iter().take(self.states.len()).copied().collect(),
        }
    }

    /// Continues from a state of the same mission. Returns false, and changes nothing, if the state
    /// does not fit the mission.
    pub fn restore(&mut self, state: &ProgramState) -> bool {
        let lengths = [state.machines.len(), state.pids.len(), state.playing.len()];
        let has_state = |(at, states): (&MachineState, &usize)| usize::from(at.state) < *states;
        if lengths != [self.states.len(); 3]
            || state.variables.len() != self.variables
            || !state.machines.iter().zip(&self.states).all(has_state)
        {
            return false;
        }
        let Turn { board, ongoing, .. } = &mut self.turn;
        ongoing.motion = state.motion;
        ongoing.navigation.clone_from(&state.navigation);
        ongoing.motors_to_rad = state.motors_to_rad;
        ongoing.playing[..state.playing.len()].copy_from_slice(&state.playing);
        for (index, (at, pids)) in state.machines.iter().zip(&state.pids).enumerate() {
            let entered_ns: ArrayVec<i64, LEVELS> =
                at.since.iter().map(|since| since.entered_ns).collect();
            self.engine.restore(index, at.state, &entered_ns);
            board.machines[index].clone_from(at);
            board.pids[index] = pids.map(Cell::new);
        }
        board.variables[..state.variables.len()].copy_from_slice(&state.variables);
        self.begun = true;
        true
    }
}

impl Turn {
    /// Begins a sound in place of what the machine played.
    fn play(&mut self, machine: usize, sound: Option<Sound>) {
        let began_ns = self.board.signals.time_ns();
        if let (Some(sound), Some(playing)) = (sound, self.ongoing.playing.get_mut(machine)) {
            *playing = Some(Playing { sound, began_ns });
        }
    }

    fn apply(&mut self, place: Place, outputs: &Outputs) -> bool {
        outputs.apply(place.sees(&self.board), &mut self.ongoing, &mut self.demands)
    }

    /// Gives variables their values, all of them worked out before the first is given.
    ///
    /// What is not known or not finite leaves its variable as it is.
    fn set(&mut self, place: Place, assignments: &[Assignment]) {
        let scope = place.sees(&self.board);
        let values: ArrayVec<(u8, f64), MAX_VARIABLES> = assignments
            .iter()
            .filter_map(|assignment| Some((assignment.variable, assignment.value.evaluate(scope)?)))
            .filter(|(_, value)| value.is_finite())
            .take(MAX_VARIABLES)
            .collect();
        for (variable, value) in values {
            self.board.variables[usize::from(variable)] = value;
        }
    }
}

/// A machine's state, or what holds for all states beside it, seen from inside.
#[derive(Clone, Copy)]
struct Place {
    machine: usize,
    level: usize,
}

impl Place {
    fn sees(self, board: &Blackboard) -> Scope<'_> {
        board.seen_by(self.machine, self.level)
    }
}

/// A machine of a mission, or the sub-machine inside a state, as the engine takes it.
fn region(
    place: Place,
    plan: &MachinePlan,
    region_plan: &RegionPlan,
    parent: Option<u16>,
) -> Machine<Turn> {
    let name = |at: u16| plan.state(at).map(|state| state.name.clone()).unwrap_or_default();
    let transition = |state: State<Turn>, transition: &TransitionPlan| {
        let (when, set) = (transition.when.clone(), transition.set.clone());
        let state =
            state.when(move |turn, _| when.holds(place.sees(&turn.board)), name(transition.go));
        if set.is_empty() { state } else { state.taking(move |turn, _| turn.set(place, &set)) }
    };
    let mut machine = Machine::new(plan.name.clone(), name(region_plan.start))
        .always(|always| region_plan.always.iter().fold(always, transition));
    for (at, state_plan) in plan.inside(parent) {
        machine = machine.state(state_plan.name.clone(), |state| {
            let is_end = region_plan.end == Some(at);
            let state = actions(state, place, at, state_plan, is_end);
            let state = state_plan.next.iter().fold(state, transition);
            match &state_plan.inner {
                Some(inner) => {
                    let level = place.level + 1;
                    state.containing(region(Place { level, ..place }, plan, inner, Some(at)))
                }
                None => state,
            }
        });
    }
    match region_plan.end {
        Some(end) => machine.ending_in(name(end)),
        None => machine,
    }
}

fn actions(
    state: State<Turn>,
    place: Place,
    at: u16,
    plan: &StatePlan,
    is_end: bool,
) -> State<Turn> {
    let Place { machine, level } = place;
    let (entry, doing, exit) = (plan.on_entry.clone(), plan.doing.clone(), plan.on_exit.clone());
    let set = plan.set.clone();
    // Its sound begins when the state is entered.
    let at_entry = doing.clone();
    let roles: Vec<Role> = doing.roles().collect();
    let state = state
        .entering(move |turn, _| {
            turn.board.enter(machine, at, level);
            if let Some(outer) = level.checked_sub(1) {
                turn.board.set_done(machine, outer, is_end);
            }
            turn.set(place, &set);
            for role in &roles {
                turn.ongoing.begin(*role);
            }
            turn.apply(place, &entry);
            let scope = place.sees(&turn.board);
            turn.play(machine, entry.sound(scope).or_else(|| at_entry.sound(scope)));
        })
        .leaving(move |turn, _| {
            turn.apply(place, &exit);
            turn.play(machine, exit.sound(place.sees(&turn.board)));
        });
    if plan.inner.is_some() {
        return state;
    }
    state.doing(move |turn, _| {
        let done = turn.apply(place, &doing);
        turn.board.set_done(machine, level, done);
    })
}
