//! The engine: machines of states over any input type, stepped with the time as an argument.
//!
//! A machine is a set of states, one of them active. A state has an action, perhaps an entry and an
//! exit action, and an ordered list of transitions: a check and a destination. In one step
//!
//! 1. the first transition whose check holds is taken, at most one: exit action, the transition's
//!    own action, then the new state's entry action;
//! 2. the action of the state that is now active runs, with the same inputs.
//!
//! A state may have a machine of its own inside it, a sub-machine: entering the state enters the
//! inner start state as well, leaving it leaves both. The transitions of the outer state are looked
//! at before those of the inner one, entry actions run from the outside inwards, exit actions from
//! the inside outwards. States are counted with those inside them behind each; the active state is
//! the innermost one.
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

use std::fmt;

use arrayvec::ArrayVec;

use super::Taken;
use crate::clock::seconds;

mod description;

use description::{Action, Node, Region, Transition, index, resolve};
pub use description::{Machine, State};

/// The most levels of states within states.
pub const LEVELS: usize = 3;

/// The present step's time, and when the state was entered whose check or action it is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Moment {
    /// The step's time, nanoseconds.
    pub now_ns: i64,
    /// When the machine entered the state, nanoseconds of the same clock.
    pub entered_ns: i64,
}

impl Moment {
    /// Seconds since the state was entered.
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
#[non_exhaustive]
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
    /// States are within states within states, more than [`LEVELS`] deep.
    #[error("machine `{machine}` has more than {LEVELS} levels of states")]
    TooDeep {
        /// The machine.
        machine: String,
    },
    /// There are more machines, states of one machine or transitions of one state than a `u16`
    /// counts.
    #[error("`{what}` has more parts than 65535")]
    TooMany {
        /// What has too many parts.
        what: String,
    },
}

/// Machines side by side on inputs of type `I`.
pub struct Engine<I> {
    finish: Finish,
    machines: Vec<Running<I>>,
}

/// A machine with its names resolved.
struct Running<I> {
    name: String,
    region: Region<I>,
    states: Vec<Node<I>>,
    /// The innermost active state.
    active: u16,
    /// When the active state of each level was entered.
    entered_ns: [i64; LEVELS],
    /// False until the start state has been entered.
    started: bool,
    /// A state to go to at the next step whatever the checks say.
    forced: Option<u16>,
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
        let machines = machines.into_iter().map(Running::new).collect::<Result<Vec<_>, _>>()?;
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
        let mut ends = self.machines.iter().map(|machine| machine.is_at_end() == Some(true));
        let finished = match self.finish {
            Finish::All => ends.all(|is_end| is_end),
            Finish::Any => ends.any(|is_end| is_end) || self.machines.is_empty(),
        };
        if finished { Progress::Finished } else { Progress::Running }
    }

    /// Whether each machine is in its final state or has none.
    #[must_use]
    pub fn waits(&self) -> bool {
        self.machines.iter().all(|machine| machine.is_at_end().unwrap_or(true))
    }

    /// The name of a machine's active state.
    #[must_use]
    pub fn active(&self, machine: usize) -> Option<&str> {
        let running = self.machines.get(machine)?;
        running.node(running.active).map(|state| state.name.as_str())
    }

    /// Index of a machine's active state, and when it was entered.
    #[must_use]
    pub fn position(&self, machine: usize) -> Option<(u16, i64)> {
        let running = self.machines.get(machine)?;
        let level = running.node(running.active).map_or(0, |state| state.level);
        Some((running.active, running.moment(level, 0).entered_ns))
    }

    /// Whether a machine's active state is this one or inside it.
    #[must_use]
    pub fn is_in(&self, machine: usize, state: u16) -> bool {
        self.machines.get(machine).is_some_and(|running| {
            running.node(state).is_some_and(|node| (state..=node.last).contains(&running.active))
        })
    }

    /// Makes a machine's next transition lead to `state`, whatever its checks say; it is taken at
    /// the next step. Returns false, and does nothing, where there is no such machine or state.
    pub fn force(&mut self, machine: usize, state: u16) -> bool {
        let running = self.having(machine, state);
        running.map(|running| running.forced = Some(state)).is_some()
    }

    /// Puts a machine into a state it was in, without any action: to go on from a record. Returns
    /// false, and does nothing, where there is no such machine or state.
    ///
    /// - `entered_ns`: when the state was entered, after those that it is inside, from the
    ///   outermost.
    pub fn restore(&mut self, machine: usize, state: u16, entered_ns: &[i64]) -> bool {
        let Some(running) = self.having(machine, state) else { return false };
        running.active = state;
        for (place, entered_ns) in running.entered_ns.iter_mut().zip(entered_ns) {
            *place = *entered_ns;
        }
        (running.started, running.forced) = (true, None);
        true
    }

    fn having(&mut self, machine: usize, state: u16) -> Option<&mut Running<I>> {
        let running = self.machines.get_mut(machine)?;
        (usize::from(state) < running.states.len()).then_some(running)
    }
}

/// Where to go, and by which transition; none where it is forced.
struct Choice {
    to: u16,
    by: Option<Chosen>,
}

/// A transition whose check holds.
#[derive(Clone, Copy)]
struct Chosen {
    /// As [`Taken::transition`] counts.
    index: u16,
    /// The state that it is looked at for.
    state: u16,
    /// Its place among those of that state.
    place: usize,
}

impl<I> Running<I> {
    fn new(machine: Machine<I>) -> Result<Self, EngineError> {
        let (name, region, states) = resolve(machine)?;
        let mut running = Self {
            name,
            active: region.start,
            region,
            states,
            entered_ns: [0; LEVELS],
            started: false,
            forced: None,
        };
        while let Some(inner) = running.inner(running.active) {
            running.active = inner.start;
        }
        Ok(running)
    }

    /// One step; the transition taken as (from, to, its index).
    fn step(&mut self, now_ns: i64, inputs: &mut I) -> Option<(u16, u16, Option<u16>)> {
        if !self.started {
            self.started = true;
            self.enter(self.region.start, now_ns, inputs);
        }
        let from = self.active;
        let taken = self.choose(now_ns, inputs).map(|Choice { to, by }| {
            let level = self.node(to).map_or(0, |node| node.level);
            self.leave(level, now_ns, inputs);
            let at = self.moment(level, now_ns);
            let transition = by.and_then(|chosen| self.transition(chosen));
            run(transition.and_then(|transition| transition.taking.as_mut()), inputs, at);
            self.enter(to, now_ns, inputs);
            (from, self.active, by.map(|chosen| chosen.index))
        });
        for state in self.chain(self.active) {
            let at = self.moment_of(state, now_ns);
            run(self.actions(state).and_then(|actions| actions.doing.as_mut()), inputs, at);
        }
        taken
    }

    /// Where to go, by force or by the first check that holds, looked for from the outside inwards.
    fn choose(&mut self, now_ns: i64, inputs: &I) -> Option<Choice> {
        if let Some(forced) = self.forced.take() {
            return Some(Choice { to: forced, by: None });
        }
        let mut index = 0_u16;
        for state in self.chain(self.active) {
            let at = self.moment_of(state, now_ns);
            let (region, node) = self.around(state)?;
            let is_end = region.end == Some(state);
            let always = region.always.iter_mut().map(|next| (!is_end && next.to != state, next));
            let own = node.next.iter_mut().map(|next| (true, next));
            for (place, (is_looked_at, next)) in always.chain(own).enumerate() {
                let Transition { check, to, .. } = next;
                if is_looked_at && check(inputs, at) {
                    return Some(Choice { to: *to, by: Some(Chosen { index, state, place }) });
                }
                index = index.saturating_add(1);
            }
        }
        None
    }

    fn transition(&mut self, chosen: Chosen) -> Option<&mut Transition<I, u16>> {
        let (region, node) = self.around(chosen.state)?;
        region.always.iter_mut().chain(&mut node.next).nth(chosen.place)
    }

    /// Leaves the active states of a level and of those inside it.
    fn leave(&mut self, level: usize, now_ns: i64, inputs: &mut I) {
        for state in self.chain(self.active).into_iter().skip(level).rev() {
            let at = self.moment_of(state, now_ns);
            run(self.actions(state).and_then(|actions| actions.leaving.as_mut()), inputs, at);
        }
    }

    /// Enters a state and the start states inside it.
    fn enter(&mut self, state: u16, now_ns: i64, inputs: &mut I) {
        let mut next = Some(state);
        while let Some(state) = next {
            self.active = state;
            let level = self.node(state).map_or(0, |node| node.level);
            if let Some(entered_ns) = self.entered_ns.get_mut(level) {
                *entered_ns = now_ns;
            }
            let at = self.moment(level, now_ns);
            run(self.actions(state).and_then(|actions| actions.entering.as_mut()), inputs, at);
            next = self.inner(state).map(|inner| inner.start);
        }
    }

    /// A state and those it is inside, from the outermost.
    fn chain(&self, state: u16) -> ArrayVec<u16, LEVELS> {
        let mut chain = ArrayVec::new();
        let mut at = Some(state);
        while let Some(state) = at
            && chain.try_push(state).is_ok()
        {
            at = self.node(state).and_then(|node| node.parent);
        }
        chain.reverse();
        chain
    }

    /// Whether it is in its final state; `None` where it has none.
    fn is_at_end(&self) -> Option<bool> {
        let end = self.region.end?;
        Some(self.chain(self.active).first() == Some(&end))
    }

    /// A state, and what holds for all states beside it.
    fn around(&mut self, state: u16) -> Option<(&mut Region<I>, &mut Node<I>)> {
        match self.node(state)?.parent {
            None => Some((&mut self.region, self.states.get_mut(usize::from(state))?)),
            Some(parent) => {
                // The states inside another one follow it.
                let (before, rest) = self.states.split_at_mut_checked(usize::from(state))?;
                let region = before.get_mut(usize::from(parent))?.inner.as_mut()?;
                Some((region, rest.first_mut()?))
            }
        }
    }

    fn node(&self, state: u16) -> Option<&Node<I>> {
        self.states.get(usize::from(state))
    }

    fn inner(&self, state: u16) -> Option<&Region<I>> {
        self.node(state)?.inner.as_ref()
    }

    fn actions(&mut self, state: u16) -> Option<&mut description::Actions<I>> {
        self.states.get_mut(usize::from(state)).map(|node| &mut node.actions)
    }

    fn moment_of(&self, state: u16, now_ns: i64) -> Moment {
        self.moment(self.node(state).map_or(0, |node| node.level), now_ns)
    }

    fn moment(&self, level: usize, now_ns: i64) -> Moment {
        Moment { now_ns, entered_ns: self.entered_ns.get(level).copied().unwrap_or_default() }
    }
}

fn run<I>(action: Option<&mut Action<I>>, inputs: &mut I, at: Moment) {
    if let Some(action) = action {
        action(inputs, at);
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
    use std::time::Duration;

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
        assert!(engine.restore(0, 1, &[500_000_000]));
        let mut diary = Diary::default();
        engine.step(1_000_000_000, &mut diary);
        assert_eq!(diary.lines, ["do b 0.5"]);
        assert!(!engine.restore(0, 2, &[0]), "there is no state 2");
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

    /// `look` contains `left` and `right`, and ends in `right`.
    fn nested() -> Machine<Diary> {
        let noting = |me: &'static str| {
            move |state: State<Diary>| {
                state
                    .entering(move |diary, _| diary.lines.push(format!("enter {me}")))
                    .doing(move |diary, at| diary.lines.push(format!("do {me} {}", at.state_s())))
                    .leaving(move |diary, _| diary.lines.push(format!("leave {me}")))
            }
        };
        let inner = Machine::<Diary>::new("look", "left")
            .always(|all| all.when(|diary, _| diary.go == "always", "right"))
            .state("left", move |state| noting("left")(state).when(|d, _| d.go == "on", "right"))
            .state("right", move |state| noting("right")(state).when(|d, _| d.go == "on", "left"))
            .ending_in("right");
        Machine::<Diary>::new("m", "look")
            .state("look", move |state| {
                let state = noting("look")(state).when(|diary, _| diary.go == "out", "end");
                state.when(|diary, _| diary.go == "again", "look").containing(inner)
            })
            .state("end", noting("end"))
            .ending_in("end")
    }

    #[test]
    fn a_state_with_a_machine_inside_enters_and_leaves_both_and_keeps_its_own_time() {
        let mut engine = Engine::new(Finish::All, [nested()]).unwrap();
        let mut diary = Diary::default();
        assert_eq!(engine.active(0), Some("left"), "before the first step");
        let mut taken = Vec::new();
        for (second, go, expected) in [
            (0, "", vec!["enter look", "enter left", "do look 0", "do left 0"]),
            (1, "on", vec!["leave left", "enter right", "do look 1", "do right 0"]),
            // In its final state nothing leads out but the outer state's own transitions.
            (2, "always", vec!["do look 2", "do right 1"]),
            (
                3,
                "again",
                vec![
                    "leave right",
                    "leave look",
                    "enter look",
                    "enter left",
                    "do look 0",
                    "do left 0",
                ],
            ),
            (4, "always", vec!["leave left", "enter right", "do look 1", "do right 0"]),
            (5, "out", vec!["leave right", "leave look", "enter end", "do end 0"]),
        ] {
            diary.go = go;
            let progress =
                engine.step_traced(second * 1_000_000_000, &mut diary, |next| taken.push(next));
            assert_eq!(std::mem::take(&mut diary.lines), expected, "at {second} s");
            let expected = if go == "out" { Progress::Finished } else { Progress::Running };
            assert_eq!(progress, expected, "at {second} s");
        }
        let taken: Vec<_> =
            taken.iter().map(|next| (next.from, next.to, next.transition.unwrap())).collect();
        // The outer state's two are counted first, then the inner machine's.
        assert_eq!(taken, [(1, 2, 3), (2, 1, 1), (1, 2, 2), (2, 3, 0)]);
    }

    #[test]
    fn a_machine_is_in_a_state_and_in_the_one_around_it_and_is_restored_into_both() {
        let mut engine = Engine::new(Finish::All, [nested()]).unwrap();
        assert!(engine.restore(0, 2, &[1_000_000_000, 3_000_000_000]));
        assert_eq!(
            [0, 1, 2, 3, 9].map(|state| engine.is_in(0, state)),
            [true, false, true, false, false]
        );
        let mut diary = Diary::default();
        engine.step(4_000_000_000, &mut diary);
        assert_eq!(diary.lines, ["do look 3", "do right 1"]);
        assert!(engine.force(0, 0));
        engine.step(5_000_000_000, &mut diary);
        assert_eq!(engine.position(0), Some((1, 5_000_000_000)), "forced into the start inside");
    }

    #[test]
    fn what_holds_in_all_states_comes_first_and_does_what_it_is_given_to_do() {
        let machine = Machine::<Vec<&str>>::new("m", "a")
            .always(|all| all.when(|_, _| true, "b").taking(|lines, _| lines.push("always")))
            .state("a", |state| state.when(|_, _| true, "c").taking(|lines, _| lines.push("own")))
            .state("b", |state| state.when(|_, _| true, "c").taking(|lines, _| lines.push("b")))
            .state("c", |state| state)
            .ending_in("c");
        let mut engine = Engine::new(Finish::All, [machine]).unwrap();
        let (mut lines, mut taken) = (Vec::new(), Vec::new());
        for ns in 0..3 {
            engine.step_traced(ns, &mut lines, |next| taken.push((next.to, next.transition)));
        }
        assert_eq!(lines, ["always", "b"]);
        assert_eq!(taken, [(1, Some(0)), (2, Some(1))], "and not from the final state");
    }

    #[test]
    fn states_within_states_have_a_bound() {
        let mut machine = Machine::<()>::new("m", "s").state("s", |state| state);
        for _ in 0..LEVELS {
            let inner = machine;
            machine = Machine::new("m", "s").state("s", |state| state.containing(inner));
        }
        let error = Engine::new(Finish::All, [machine]).unwrap_err().to_string();
        assert_eq!(error, "machine `m` has more than 3 levels of states");
    }
}
