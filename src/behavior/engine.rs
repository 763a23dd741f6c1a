//! The engine: machines of states over any input type, stepped with the time as an argument.
//!
//! A machine is a set of states, one of them active. A state has an action, perhaps an entry and an
//! exit action, and an ordered list of transitions: a check and a destination. In one step
//!
//! 1. the first transition whose check holds is taken, at most one: exit action, the transition's
//!    own action, then the new state's entry action;
//! 2. the action of the state that is now active runs, with the same inputs.
//!
//! The start state is entered at the first step: its entry action runs then, its own action not
//! before the first check. Machines of one engine run side by side, in the order in which they were
//! added, on the same inputs.
//!
//! ```
//! use std::time::Duration;
//! use onbrick::behavior::engine::{Engine, Finish, Machine, Progress};
//!
//! struct Robot { range_m: f64, speed_m_s: f64 }
//!
//! let drive = Machine::<Robot>::new("drive", "forward")
//!     .state("forward", |state| state
//!         .doing(|robot, _| robot.speed_m_s = 0.1)
//!         .when(|robot, _| robot.range_m < 0.25, "halt")
//!         .after(Duration::from_secs(60), "halt"))
//!     .state("halt", |state| state.doing(|robot, _| robot.speed_m_s = 0.0))
//!     .ending_in("halt");
//! let mut engine = Engine::new(Finish::All, [drive])?;
//!
//! let mut robot = Robot { range_m: 1.0, speed_m_s: 0.0 };
//! assert_eq!(engine.step(0, &mut robot), Progress::Running);
//! robot.range_m = 0.2;
//! assert_eq!(engine.step(20_000_000, &mut robot), Progress::Finished);
//! assert_eq!(engine.active(0), Some("halt"));
//! # Ok::<(), onbrick::behavior::engine::EngineError>(())
//! ```
//!
//! # Not here
//!
//! No clock, no threads, no robot. Whatever a check reads or an action changes is in the input
//! value.
//!
//! # What we count on
//!
//! - A step allocates nothing (unless an action does) and costs one check for each transition of
//!   the active states.
//! - A time that runs backwards makes the time in a state negative, and timeouts wait.

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use super::Taken;
use crate::clock::seconds;

/// The present step's time, and when the active state was entered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Moment {
    /// The step's time, nanoseconds.
    pub now_ns: i64,
    /// When the machine entered its active state, nanoseconds of the same clock.
    pub entered_ns: i64,
}

impl Moment {
    /// Seconds since the active state was entered.
    #[must_use]
    pub fn state_s(self) -> f64 {
        seconds(self.now_ns.saturating_sub(self.entered_ns))
    }
}

/// When an engine is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Finish {
    /// When every machine is in its final state.
    #[default]
    All,
    /// When at least one machine is in its final state.
    Any,
}

/// What a step came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// There is more to do.
    Running,
    /// The final states that [`Finish`] asks for are active.
    Finished,
}

/// Machines that cannot run as they were described: a mistake in the program that described them.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum EngineError {
    /// A start, a final state or a destination names no state.
    #[error("machine `{machine}` has no state `{state}`")]
    UnknownState {
        /// The machine.
        machine: String,
        /// The name that no state has.
        state: String,
    },
    /// Two states have one name.
    #[error("machine `{machine}` has two states `{state}`")]
    DuplicateState {
        /// The machine.
        machine: String,
        /// The name.
        state: String,
    },
    /// There are more machines, states of one machine or transitions of one state than a `u16`
    /// counts.
    #[error("`{what}` has more parts than 65535")]
    TooMany {
        /// What has too many parts.
        what: String,
    },
}

type Check<I> = Box<dyn FnMut(&I, Moment) -> bool + Send>;
type Action<I> = Box<dyn FnMut(&mut I, Moment) + Send>;

/// A state as it is described: see [`Machine::state`].
pub struct State<I> {
    name: String,
    entering: Option<Action<I>>,
    doing: Option<Action<I>>,
    leaving: Option<Action<I>>,
    next: Vec<Transition<I, String>>,
}

/// A check, what is done when it holds, and where it leads: to a state's name, or to its place.
struct Transition<I, S> {
    check: Check<I>,
    taking: Option<Action<I>>,
    to: S,
}

impl<I> State<I> {
    fn named(name: String) -> Self {
        Self { name, entering: None, doing: None, leaving: None, next: Vec::new() }
    }

    /// Runs at every step that ends in this state.
    #[must_use]
    pub fn doing(mut self, action: impl FnMut(&mut I, Moment) + Send + 'static) -> Self {
        self.doing = Some(Box::new(action));
        self
    }

    /// Runs once whenever the state is entered, the start state included.
    #[must_use]
    pub fn entering(mut self, action: impl FnMut(&mut I, Moment) + Send + 'static) -> Self {
        self.entering = Some(Box::new(action));
        self
    }

    /// Runs once whenever the state is left.
    #[must_use]
    pub fn leaving(mut self, action: impl FnMut(&mut I, Moment) + Send + 'static) -> Self {
        self.leaving = Some(Box::new(action));
        self
    }

    /// Adds a transition: to `destination` when `check` holds and no transition before it does.
    #[must_use]
    pub fn when(
        mut self,
        check: impl FnMut(&I, Moment) -> bool + Send + 'static,
        destination: impl Into<String>,
    ) -> Self {
        self.next.push(Transition { check: Box::new(check), taking: None, to: destination.into() });
        self
    }

    /// Gives the transition that was added last an action, which runs when it is taken.
    #[must_use]
    pub fn taking(mut self, action: impl FnMut(&mut I, Moment) + Send + 'static) -> Self {
        if let Some(last) = self.next.last_mut() {
            last.taking = Some(Box::new(action));
        }
        self
    }

    /// Adds a timeout: to `destination` once the state has been active for `time`.
    #[must_use]
    pub fn after(self, time: Duration, destination: impl Into<String>) -> Self {
        let limit_ns = i64::try_from(time.as_nanos()).unwrap_or(i64::MAX);
        self.when(move |_, at| at.now_ns.saturating_sub(at.entered_ns) >= limit_ns, destination)
    }
}

/// A machine as it is described; [`Engine::new`] makes it run.
pub struct Machine<I> {
    name: String,
    start: String,
    end: Option<String>,
    always: Vec<Transition<I, String>>,
    states: Vec<State<I>>,
}

impl<I> Machine<I> {
    /// A machine that starts in the state `start`.
    #[must_use]
    pub fn new(name: impl Into<String>, start: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            start: start.into(),
            end: None,
            always: Vec::new(),
            states: Vec::new(),
        }
    }

    /// Adds a state; `describe` gives it actions and transitions.
    #[must_use]
    pub fn state(
        mut self,
        name: impl Into<String>,
        describe: impl FnOnce(State<I>) -> State<I>,
    ) -> Self {
        self.states.push(describe(State::named(name.into())));
        self
    }

    /// Adds transitions of every state, before its own, but for the final state and the one that
    /// they lead to.
    #[must_use]
    pub fn always(mut self, describe: impl FnOnce(State<I>) -> State<I>) -> Self {
        self.always.extend(describe(State::named(String::new())).next);
        self
    }

    /// Names the final state. A machine without one never finishes.
    #[must_use]
    pub fn ending_in(mut self, state: impl Into<String>) -> Self {
        self.end = Some(state.into());
        self
    }
}

/// Machines side by side on inputs of type `I`.
pub struct Engine<I> {
    finish: Finish,
    machines: Vec<Running<I>>,
}

/// A machine with its names resolved.
struct Running<I> {
    name: String,
    always: Vec<Transition<I, u16>>,
    states: Vec<Resolved<I>>,
    end: Option<u16>,
    active: u16,
    entered_ns: i64,
    /// False until the start state has been entered.
    started: bool,
    /// A state to go to at the next step whatever the checks say.
    forced: Option<u16>,
}

struct Resolved<I> {
    name: String,
    entering: Option<Action<I>>,
    doing: Option<Action<I>>,
    leaving: Option<Action<I>>,
    next: Vec<Transition<I, u16>>,
}

impl<I> Engine<I> {
    /// Makes described machines ready to run; each stands before its start state.
    ///
    /// # Errors
    ///
    /// [`EngineError`] where names do not fit together.
    pub fn new(
        finish: Finish,
        machines: impl IntoIterator<Item = Machine<I>>,
    ) -> Result<Self, EngineError> {
        let machines = machines.into_iter().map(resolve).collect::<Result<Vec<_>, _>>()?;
        index(machines.len(), "the engine")?;
        Ok(Self { finish, machines })
    }

    /// Takes one step of every machine.
    pub fn step(&mut self, now_ns: i64, inputs: &mut I) -> Progress {
        self.step_traced(now_ns, inputs, |_| {})
    }

    /// Takes one step of every machine and tells `on_taken` of each transition.
    pub fn step_traced(
        &mut self,
        now_ns: i64,
        inputs: &mut I,
        mut on_taken: impl FnMut(Taken),
    ) -> Progress {
        for (machine, running) in (0_u16..).zip(&mut self.machines) {
            if let Some((from, to, transition)) = running.step(now_ns, inputs) {
                on_taken(Taken { machine, from, to, transition });
            }
        }
        self.progress()
    }

    /// Whether the final states that [`Finish`] asks for are active. An engine without machines is
    /// finished.
    #[must_use]
    pub fn progress(&self) -> Progress {
        let mut ends = self.machines.iter().map(|machine| machine.end == Some(machine.active));
        let finished = match self.finish {
            Finish::All => ends.all(|is_end| is_end),
            Finish::Any => ends.any(|is_end| is_end) || self.machines.is_empty(),
        };
        if finished { Progress::Finished } else { Progress::Running }
    }

    /// Whether each machine is in its final state or has none.
    #[must_use]
    pub fn waits(&self) -> bool {
        self.machines.iter().all(|machine| machine.end.is_none_or(|end| end == machine.active))
    }

    /// The name of a machine's active state.
    #[must_use]
    pub fn active(&self, machine: usize) -> Option<&str> {
        let running = self.machines.get(machine)?;
        running.states.get(usize::from(running.active)).map(|state| state.name.as_str())
    }

    /// Index of a machine's active state, and when it was entered.
    #[must_use]
    pub fn position(&self, machine: usize) -> Option<(u16, i64)> {
        self.machines.get(machine).map(|running| (running.active, running.entered_ns))
    }

    /// Makes a machine's next transition lead to `state`, whatever its checks say; it is taken at
    /// the next step. Returns false, and does nothing, where there is no such machine or state.
    pub fn force(&mut self, machine: usize, state: u16) -> bool {
        let running = self.having(machine, state);
        running.map(|running| running.forced = Some(state)).is_some()
    }

    /// Puts a machine into a state it was in, entered at `entered_ns`, without any action: to go on
    /// from a record. Returns false, and does nothing, where there is no such machine or state.
    pub fn restore(&mut self, machine: usize, state: u16, entered_ns: i64) -> bool {
        let Some(running) = self.having(machine, state) else { return false };
        (running.active, running.entered_ns) = (state, entered_ns);
        (running.started, running.forced) = (true, None);
        true
    }

    fn having(&mut self, machine: usize, state: u16) -> Option<&mut Running<I>> {
        let running = self.machines.get_mut(machine)?;
        (usize::from(state) < running.states.len()).then_some(running)
    }
}

impl<I> Running<I> {
    /// One step; the transition taken as (from, to, its index).
    fn step(&mut self, now_ns: i64, inputs: &mut I) -> Option<(u16, u16, Option<u16>)> {
        if !self.started {
            self.started = true;
            self.enter(self.active, now_ns, inputs);
        }
        let from = self.active;
        let taken = self.choose(now_ns, inputs).map(|(to, transition)| {
            let at = self.moment(now_ns);
            run(self.state().and_then(|state| state.leaving.as_mut()), inputs, at);
            let taking = transition.and_then(|transition| self.transition(from, transition));
            run(taking.and_then(|transition| transition.taking.as_mut()), inputs, at);
            self.enter(to, now_ns, inputs);
            (from, to, transition)
        });
        let at = self.moment(now_ns);
        run(self.state().and_then(|state| state.doing.as_mut()), inputs, at);
        taken
    }

    /// Where to go, by force or by the first check that holds.
    fn choose(&mut self, now_ns: i64, inputs: &I) -> Option<(u16, Option<u16>)> {
        if let Some(forced) = self.forced.take() {
            return Some((forced, None));
        }
        let at = self.moment(now_ns);
        let active = self.active;
        let is_end = self.end == Some(active);
        let state = self.states.get_mut(usize::from(active))?;
        let always = self.always.iter_mut().map(|next| (!is_end && next.to != active, next));
        let next = always.chain(state.next.iter_mut().map(|next| (true, next)));
        (0_u16..).zip(next).find_map(|(index, (is_looked_at, Transition { check, to, .. }))| {
            (is_looked_at && check(inputs, at)).then_some((*to, Some(index)))
        })
    }

    /// A transition from a state, counted as [`Taken::transition`] counts.
    fn transition(&mut self, from: u16, index: u16) -> Option<&mut Transition<I, u16>> {
        let state = self.states.get_mut(usize::from(from))?;
        self.always.iter_mut().chain(&mut state.next).nth(usize::from(index))
    }

    fn enter(&mut self, state: u16, now_ns: i64, inputs: &mut I) {
        (self.active, self.entered_ns) = (state, now_ns);
        let at = self.moment(now_ns);
        run(self.state().and_then(|state| state.entering.as_mut()), inputs, at);
    }

    fn state(&mut self) -> Option<&mut Resolved<I>> {
        self.states.get_mut(usize::from(self.active))
    }

    fn moment(&self, now_ns: i64) -> Moment {
        Moment { now_ns, entered_ns: self.entered_ns }
    }
}

fn run<I>(action: Option<&mut Action<I>>, inputs: &mut I, at: Moment) {
    if let Some(action) = action {
        action(inputs, at);
    }
}

fn resolve<I>(machine: Machine<I>) -> Result<Running<I>, EngineError> {
    index(machine.states.len(), &machine.name)?;
    let mut places = BTreeMap::new();
    for (place, state) in (0_u16..).zip(&machine.states) {
        if places.insert(state.name.clone(), place).is_some() {
            return Err(EngineError::DuplicateState {
                machine: machine.name,
                state: state.name.clone(),
            });
        }
    }
    let find = |state: &str| {
        places.get(state).copied().ok_or_else(|| EngineError::UnknownState {
            machine: machine.name.clone(),
            state: state.to_owned(),
        })
    };
    let active = find(&machine.start)?;
    let end = machine.end.as_deref().map(find).transpose()?;
    let most = machine.states.iter().map(|state| state.next.len()).max().unwrap_or_default();
    index(machine.always.len() + most, &machine.name)?;
    let find_all = |transitions: Vec<Transition<I, String>>| {
        let found = transitions.into_iter().map(|Transition { check, taking, to }| {
            Ok(Transition { check, taking, to: find(&to)? })
        });
        found.collect::<Result<Vec<_>, EngineError>>()
    };
    let resolve_state = |state: State<I>| {
        Ok(Resolved {
            next: find_all(state.next)?,
            name: state.name,
            entering: state.entering,
            doing: state.doing,
            leaving: state.leaving,
        })
    };
    let always = find_all(machine.always)?;
    let states = machine.states.into_iter().map(resolve_state).collect::<Result<_, _>>()?;
    Ok(Running {
        name: machine.name,
        always,
        states,
        end,
        active,
        entered_ns: 0,
        started: false,
        forced: None,
    })
}

fn index(count: usize, what: &str) -> Result<u16, EngineError> {
    u16::try_from(count).map_err(|_| EngineError::TooMany { what: what.to_owned() })
}

impl<I> fmt::Debug for State<I> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("State").field("name", &self.name).finish_non_exhaustive()
    }
}

impl<I> fmt::Debug for Machine<I> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Machine")
            .field("name", &self.name)
            .field("states", &self.states)
            .finish_non_exhaustive()
    }
}

impl<I> fmt::Debug for Engine<I> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let active =
            self.machines.iter().enumerate().map(|(at, running)| (&running.name, self.active(at)));
        f.debug_struct("Engine")
            .field("finish", &self.finish)
            .field("active", &active.collect::<Vec<_>>())
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Number {
        x: i32,
        i: i32,
    }

    fn climbing_and_falling() -> Machine<Number> {
        Machine::<Number>::new("number", "up")
            .state("up", |state| {
                state
                    .doing(|number, _| number.x += 1)
                    .when(|number, _| number.x >= 10, "down")
                    .when(|number, _| number.i > 20, "final")
            })
            .state("down", |state| {
                state.doing(|number, _| number.x -= 1).when(|number, _| number.x < 1, "up")
            })
            .state("final", |state| state)
            .ending_in("final")
    }

    #[test]
    fn the_seeds_number_climbs_and_falls_and_ends_after_21_steps() {
        let mut engine = Engine::new(Finish::Any, [climbing_and_falling()]).unwrap();
        let mut number = Number { x: 5, i: 0 };
        let mut values = Vec::new();
        loop {
            number.i += 1;
            let progress = engine.step(i64::from(number.i), &mut number);
            values.push(number.x);
            if progress == Progress::Finished {
                break;
            }
        }
        assert_eq!(values, [6, 7, 8, 9, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0, 1, 2, 3, 4, 5, 5]);
    }

    /// Notes what ran, and when; goes where `go` says.
    #[derive(Default)]
    struct Diary {
        go: &'static str,
        lines: Vec<String>,
    }

    fn noting(name: &'static str) -> Machine<Diary> {
        let state = |me: &'static str, other: &'static str| {
            move |state: State<Diary>| {
                state
                    .entering(move |diary, _| diary.lines.push(format!("enter {me}")))
                    .doing(move |diary, at| diary.lines.push(format!("do {me} {}", at.state_s())))
                    .leaving(move |diary, at| {
                        diary.lines.push(format!("leave {me} {}", at.state_s()))
                    })
                    .when(move |diary, _| diary.go == other, other)
            }
        };
        Machine::new(name, "a").state("a", state("a", "b")).state("b", state("b", "a"))
    }

    #[test]
    fn actions_run_in_order_exit_entry_action_and_the_start_state_is_entered_at_the_first_step() {
        let mut engine = Engine::new(Finish::All, [noting("m")]).unwrap();
        let mut diary = Diary::default();
        engine.step(1_000_000_000, &mut diary);
        diary.go = "b";
        let mut taken = Vec::new();
        engine.step_traced(2_000_000_000, &mut diary, |transition| taken.push(transition));
        engine.step(2_500_000_000, &mut diary);
        assert_eq!(
            diary.lines,
            ["enter a", "do a 0", "leave a 1", "enter b", "do b 0", "do b 0.5"]
        );
        assert_eq!(taken, [Taken { machine: 0, from: 0, to: 1, transition: Some(0) }]);
        assert_eq!(engine.position(0), Some((1, 2_000_000_000)));
    }

    #[test]
    fn a_start_state_whose_check_holds_at_once_does_not_act() {
        let mut engine = Engine::new(Finish::All, [noting("m")]).unwrap();
        let mut diary = Diary { go: "b", ..Diary::default() };
        engine.step(0, &mut diary);
        assert_eq!(diary.lines, ["enter a", "leave a 0", "enter b", "do b 0"]);
    }

    #[test]
    fn a_forced_transition_comes_before_the_checks_and_is_the_only_one_of_its_step() {
        let mut engine = Engine::new(Finish::All, [noting("m")]).unwrap();
        let mut diary = Diary { go: "b", ..Diary::default() };
        assert!(engine.force(0, 0));
        assert!(!engine.force(0, 9), "there is no state 9");
        assert!(!engine.force(5, 0), "there is no machine 5");
        let mut taken = Vec::new();
        engine.step_traced(0, &mut diary, |transition| taken.push(transition));
        assert_eq!(taken, [Taken { machine: 0, from: 0, to: 0, transition: None }]);
        assert_eq!(engine.active(0), Some("a"));
    }

    #[test]
    fn a_restored_machine_goes_on_without_entering_again() {
        let mut engine = Engine::new(Finish::All, [noting("m")]).unwrap();
        assert!(engine.restore(0, 1, 500_000_000));
        let mut diary = Diary::default();
        engine.step(1_000_000_000, &mut diary);
        assert_eq!(diary.lines, ["do b 0.5"]);
        assert!(!engine.restore(0, 2, 0), "there is no state 2");
    }

    #[test]
    fn a_timeout_fires_at_its_time_and_a_timeout_too_long_to_count_never_does() {
        let machine = |limit| {
            Machine::<()>::new("m", "wait")
                .state("wait", |s| s.after(limit, "end"))
                .state("end", |s| s)
                .ending_in("end")
        };
        let mut engine = Engine::new(Finish::All, [machine(Duration::from_millis(20))]).unwrap();
        let steps = [5, 24, 25].map(|ms| engine.step(ms * 1_000_000, &mut ()));
        assert_eq!(steps, [Progress::Running, Progress::Running, Progress::Finished]);
        let mut engine = Engine::new(Finish::All, [machine(Duration::MAX)]).unwrap();
        assert_eq!([0, i64::MAX - 1].map(|ns| engine.step(ns, &mut ())), [Progress::Running; 2]);
    }

    #[test]
    fn all_and_any_differ_in_when_they_finish() {
        for (finish, expected) in [
            (Finish::Any, [Progress::Running, Progress::Finished, Progress::Finished]),
            (Finish::All, [Progress::Running, Progress::Running, Progress::Finished]),
        ] {
            let until = |limit: i64| {
                Machine::<i64>::new("m", "wait")
                    .state("wait", |state| state.when(move |now, _| *now >= limit, "end"))
                    .state("end", |state| state)
                    .ending_in("end")
            };
            let mut engine = Engine::new(finish, [until(1), until(2)]).unwrap();
            assert_eq!([0, 1, 2].map(|mut now| engine.step(now, &mut now)), expected, "{finish:?}");
        }
    }

    #[test]
    fn names_that_do_not_fit_together_are_refused() {
        let refuse =
            |machine: Machine<()>| Engine::new(Finish::All, [machine]).unwrap_err().to_string();
        assert_eq!(refuse(Machine::new("m", "a")), "machine `m` has no state `a`");
        let nowhere = Machine::new("m", "a").state("a", |state| state.when(|(), _| true, "b"));
        assert_eq!(refuse(nowhere), "machine `m` has no state `b`");
        let twice = Machine::new("m", "a").state("a", |state| state).state("a", |state| state);
        assert_eq!(refuse(twice), "machine `m` has two states `a`");
        let endless = Machine::new("m", "a").state("a", |state| state).ending_in("end");
        assert_eq!(refuse(endless), "machine `m` has no state `end`");
        let many = (0..70_000)
            .fold(Machine::new("m", "0"), |machine, name| machine.state(name.to_string(), |s| s));
        assert_eq!(refuse(many), "`m` has more parts than 65535");
    }

    #[test]
    fn an_engine_without_machines_is_finished() {
        for finish in [Finish::All, Finish::Any] {
            let mut engine = Engine::<()>::new(finish, []).unwrap();
            assert_eq!(engine.step(0, &mut ()), Progress::Finished, "{finish:?}");
        }
    }
}
