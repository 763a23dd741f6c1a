//! Missions: machines described in a TOML file, checked as a whole, run on the [`super::engine`].
//!
//! ```toml
//! name = "map"
//! rate_hz = 50            # ticks a second, 10 to 100; 50 if left out
//! time_limit_s = 120      # the run ends here; a name for conditions too; 120 if left out
//! finish = "all"          # or "any": which machines must be final for the mission to end
//! on_lost = "stop"        # a device is gone or stale: "stop", or "pause" until it is back
//! on_stall = "stop"       # or the state that the wheels' machine enters when they are blocked
//!
//! [numbers]               # names for expressions; `--set close_m=0.3` gives one another value
//! close_m = 0.25
//!
//! [variables]             # names for values that change, each with its first value
//! walls = 0
//! home_x = "x_m"          # or an expression: worked out at the first tick, from the top down
//!
//! [machine.drive]
//! start = "forward"       # the state that stands first if left out
//! final = "halt"          # optional: a machine without it is finished when the time is over
//! always = [{ when = "walls == 10", go = "halt" }]   # looked at before each state's own
//!
//! [machine.drive.state.forward]
//! do = { left_dps = 60, right_dps = 60 }
//! on_entry = { led = "green", say = "{walls} walls" }
//! next = [{ when = "range_m < close_m", set = { walls = "walls + 1" }, go = "turn" }]
//!
//! [machine.drive.state.turn]
//! do = { turn_deg = 120 }
//! next = [{ when = "done", go = "forward" }]
//! ```
//!
//! A reading that cannot be true - it stands still although what it measures moves, or leaps about
//! - ends the run whatever `on_lost` says: waiting shows nothing new.
//!
//! | key of `do` | meaning |
//! |---|---|
//! | `left_dps` and `right_dps` | speeds of the wheels at their axles, degrees per second |
//! | `forward_mps`, `turn_dps` | speed of the robot's centre, metres per second, and turning, degrees per second, anticlockwise positive; one left out is 0 |
//! | `stop` | both wheels stop: `"brake"`, `"coast"` or `"hold"` |
//! | `drive_m` | straight on, metres; backwards where negative; `speed_mps` may say how fast |
//! | `turn_deg` | on the spot, degrees to the left; `speed_dps` may say how fast |
//! | `arc = { radius_m, turn_deg }` | along a circle; backwards where the radius is negative; `speed_mps` |
//! | `goto = [x, y]` | turns to a place of the world, metres, and drives there; `face_deg` is the heading at the end; `speed_mps`, `speed_dps`; with `keep_m` it finds its way over the map and stays so far from what that shows |
//! | `explore_m` | drives where the map is not known, no further than this from the start, metres, and looks round, until nothing is left that can be reached; `keep_m` (0.15 if left out), `speed_mps`, `speed_dps`; takes a range sensor, and moves the head, too |
//! | `head_deg` | where the head points, degrees anticlockwise from straight ahead |
//! | `motor.NAME` | speed of a named motor, degrees per second |
//! | `motor_deg.NAME` | the angle that a named motor turns to, degrees from where it stood at the run's start; at the speed of `motor.NAME`, whatever its sign, or else at its `max_dps` |
//! | `led` | `"off"`, `"green"`, `"red"`, `"orange"`, `"yellow"` |
//! | `tone_hz` | a tone: for `tone_s` seconds, or as long as the state |
//! | `tune` | notes (see [`super::tune`]), `tempo_bpm` quarter notes a minute |
//! | `beep` | a sound by its name: `"beep"`, `"ok"`, `"error"`, `"alarm"`, `"hello"` |
//! | `say` | a text of up to four lines with values in braces, as in `"found {found} at {x_m:.2} m"` |
//!
//! Numbers may be expressions in quotes (see [`super::expression`]). Those of a motion that ends
//! are taken once, when its state is entered. The condition `done` holds when all that ends has
//! ended: the motion, the head's way and those of motors, a tone with a length, a tune.
//!
//! `on_entry` and `on_exit` know lights, sounds and `say`; a tone without a length lasts 0.2 s
//! there. A sound continues when its state is left, until it is over or the machine begins another
//! one, and a mission does not end before its last sounds have; nothing moves meanwhile. Wheels,
//! head and each named motor belong to one machine; for lights, sounds and screen the last machine
//! in the file wins. A number in `do` that comes to NaN or an infinity, or that depends on a lost
//! signal, stops its actuator for that tick: wheels brake, head and motor stand still.
//!
//! `set` gives variables other values, in a transition when it is taken and in `on_entry`. All of
//! its values are worked out before the first is given; one that is not known or not finite leaves
//! its variable as it was, and one that was to begin with it at 0. All machines see all variables.
//! Machines take their steps in the order of the file, and what one has set the next one sees in
//! the same tick.
//!
//! # Sub-machines
//!
//! ```toml
//! [machine.drive.state.left_side]
//! use = "zigzag"          # a machine in place of `do`
//! with = { way_m = 0.5 }  # what its variables begin with, where not with their own number
//! next = [{ when = "done", go = "right_side" }]      # it is in its final state
//!
//! [submachine.zigzag]       # start, final, always and states as in a machine
//! final = "end"
//! on_stall = "end"        # as the mission's, while the sub-machine is used
//! [submachine.zigzag.variables]
//! way_m = 0.3             # its own, at each use
//! [submachine.zigzag.state.out]
//! do = { drive_m = "way_m" }
//! next = [{ when = "done", go = "end" }]
//! [submachine.zigzag.state.end]
//! ```
//!
//! While a state uses a sub-machine, the state and one of the states inside it are active: `drive`
//! is in `left_side` and in `left_side.out`. Each has its own `state_s`, `state_m`,
//! `state_turn_deg` and `done`. The outer state's transitions are looked at first; entering it
//! begins the sub-machine from its start, with its variables as at the start. Names are looked for
//! from the inside outwards: the sub-machine's variables, those of what uses it, the mission's.
//! From outside they are `left_side.way_m`, from another machine `drive.left_side.way_m`. When the
//! wheels are blocked, the innermost sub-machine in use that has an `on_stall` goes to that state;
//! where none has, the mission's own `on_stall` counts. Motions over the map, `explore_m` and a
//! `goto` with `keep_m`, back off by themselves instead, against the way that they drove last; when
//! that has not helped six times in one place, they are done.
//!
//! A sub-machine that the file does not define is taken from `NAME.toml` beside it, which has
//! sub-machines and nothing else, or from those that come with the program
//! ([`super::submachines`], [`super::shipped`]). Sub-machines may use others, on at most
//! [`super::engine::LEVELS`] levels, and not themselves.
//!
//! # What is checked
//!
//! A mission is refused for: unknown keys, names, states and motors; signals and actuators that the
//! robot does not have; expressions that do not parse or mix numbers with truths; colours and the
//! remote's buttons compared by size; values out of range; states that cannot be reached or cannot
//! be left, but for a machine's only one; transitions that can never fire, by themselves or because
//! an earlier one of the same state holds whenever they do; `done` where nothing ends; two machines
//! that move the same actuator; two modes asked of one sensor; an `on_stall` state that the machine
//! or sub-machine lacks; a sub-machine that is missing, or uses itself. It is warned of, and runs,
//! with: a condition that always holds (unless it is the word `true`); a state from which the final
//! state cannot be reached; a state whose motion ends, and whose transitions ask only of what is
//! sensed; exploring without a gyro; a final state that moves something or has a `next` where the
//! mission ends with it; a sub-machine that no state uses.
//!
//! Whether a transition can fire is judged from comparisons of a multiple of one signal with a
//! constant, joined by `and`, `or` and `not`, with the numbers that the file gives. What is said is
//! certain; not everything is found.
//!
//! # Not here
//!
//! No limits of speed: those are the robot's.
//!
//! # What we count on
//!
//! - A mission has at most [`super::MAX_MACHINES`] machines and [`Mission::MAX_STATES`] states,
//!   those of sub-machines counted at each use, a state at most [`Mission::MAX_TRANSITIONS`]
//!   transitions: a file of ten thousand states is read in well under a second.

use std::collections::BTreeMap;
use std::fmt;

use super::Taken;
use super::engine::{EngineError, Finish};
use super::expression::Expression;
use super::signals::Capabilities;
use super::tune::Tune;
use crate::document::{Document, Findings, nearest_or_all};
use crate::senses::Channel;

mod checks;
mod load;
mod outputs;
mod plan;
mod program;

pub(super) use load::can_be_name;
use plan::{Assignment, DrivePlan, GoalPlan, MotionPlan, MotorPlan, Outputs, SoundPlan};
pub use plan::{MachinePlan, RegionPlan, StatePlan, TransitionPlan};
pub use program::{Program, ProgramState};

/// A mission, read and checked.
#[derive(Debug, Clone)]
pub struct Mission {
    name: String,
    rate_hz: u32,
    time_limit_s: f64,
    finish: Finish,
    on_lost: OnLost,
    numbers: BTreeMap<String, f64>,
    variables: Vec<(String, f64)>,
    /// What variables begin with that do not begin with a number, in the order of the file.
    firsts: Vec<Assignment>,
    /// The parts that its numbers can bring out of their limits.
    bounded: Vec<Bounded>,
    machines: Vec<MachinePlan>,
    tunes: Vec<Tune>,
    motors: Vec<String>,
    sensors: Vec<String>,
    senses: Vec<Channel>,
}

/// What happens when a device is gone or a reading is stale.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OnLost {
    /// The run ends.
    Stop,
    /// The robot stands still until the device is back.
    Pause,
}

/// A transition that was taken, by its names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NamedTransition<'m> {
    /// The machine.
    pub machine: &'m str,
    /// The state left.
    pub from: &'m str,
    /// The state entered.
    pub to: &'m str,
    /// The condition that held; `None` where the wheels were blocked.
    pub when: Option<&'m str>,
}

impl fmt::Display for NamedTransition<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let when = self.when.unwrap_or("wheels blocked");
        write!(f, "{}: {} → {} ({when})", self.machine, self.from, self.to)
    }
}

/// A number that cannot be set as asked.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SetError {
    /// The mission has no number of this name.
    #[error("the mission has no number `{name}`; {hint}")]
    Unknown {
        /// The name.
        name: String,
        /// The nearest name, or those that there are.
        hint: String,
    },
    /// It is no number: it changes during the run.
    #[error("`{0}` is a variable, which the mission itself changes; [numbers] can be set")]
    Variable(String),
    /// The value is NaN, infinite or beyond what the number may be.
    #[error("`{name}` cannot be {value}; it can be {low} to {high}")]
    OutOfRange {
        /// The name.
        name: String,
        /// The value.
        value: f64,
        /// The least it can be.
        low: f64,
        /// The most it can be.
        high: f64,
    },
    /// A part of the mission that is made of its numbers is beyond what that part may be.
    #[error("`{path}` comes to {value}; it can be {low} to {high}")]
    Beyond {
        /// Where it is in the file.
        path: String,
        /// The value.
        value: f64,
        /// The least it can be.
        low: f64,
        /// The most it can be.
        high: f64,
    },
}

/// A part of the mission that is made of its own numbers.
#[derive(Debug, Clone, PartialEq)]
struct Bounded {
    path: String,
    expression: Expression,
    low: f64,
    high: f64,
}

impl Bounded {
    /// Whether it is beyond its limits with the numbers as they are now.
    fn beyond(&self) -> Option<SetError> {
        let (low, high) = (self.low, self.high);
        let value = self.expression.in_a_run().filter(|value| !(low..=high).contains(value))?;
        Some(SetError::Beyond { path: self.path.clone(), value, low, high })
    }
}

impl Mission {
    /// The most states of all machines together.
    pub const MAX_STATES: usize = 10_000;

    /// The most transitions of one state.
    pub const MAX_TRANSITIONS: usize = 32;

    /// The name of the time limit in conditions.
    pub const TIME_LIMIT: &str = "time_limit_s";

    /// Longest and shortest time that a mission may be given, seconds; ten hours outlast the
    /// batteries.
    pub const TIME_LIMITS_S: (f64, f64) = (1.0, 36_000.0);

    /// What a mission's own number may be.
    const NUMBERS: (f64, f64) = (-1e9, 1e9);

    /// Reads a mission for a robot, with what is worth a warning.
    ///
    /// - `file`: what findings call it.
    ///
    /// # Errors
    ///
    /// Everything that is wrong with it; a mission with an error does not run.
    pub fn parse(
        file: &str,
        text: &[u8],
        capabilities: &Capabilities,
    ) -> Result<(Self, Findings), Findings> {
        load::load(&Document::new(file, text)?, capabilities)
    }

    /// Makes the mission ready to run from its start states.
    ///
    /// # Errors
    ///
    /// [`EngineError`] where names do not fit together; loading has seen to it that they do.
    pub fn start(&self) -> Result<Program, EngineError> {
        Program::new(self)
    }

    /// Gives one of the mission's numbers, or `time_limit_s`, another value. What was found at
    /// loading was found with the values in the file, and is not looked for again.
    ///
    /// # Errors
    ///
    /// [`SetError`]; nothing has changed then.
    pub fn set(&mut self, name: &str, value: f64) -> Result<(), SetError> {
        let (low, high) =
            if name == Self::TIME_LIMIT { Self::TIME_LIMITS_S } else { Self::NUMBERS };
        if self.variables.iter().any(|(variable, _)| variable == name) {
            return Err(SetError::Variable(name.to_owned()));
        }
        let Some(number) = self.numbers.get_mut(name) else {
            let hint = nearest_or_all(name, "it has", self.numbers.keys().map(String::as_str));
            return Err(SetError::Unknown { name: name.to_owned(), hint });
        };
        if !(low..=high).contains(&value) {
            return Err(SetError::OutOfRange { name: name.to_owned(), value, low, high });
        }
        *number = value;
        if name == Self::TIME_LIMIT {
            self.time_limit_s = value;
        }
        let firsts = self.firsts.iter_mut().map(|first| &mut first.value);
        let machines = self.machines.iter_mut().flat_map(MachinePlan::expressions_mut);
        let bounded = self.bounded.iter_mut().map(|bounded| &mut bounded.expression);
        for expression in firsts.chain(machines).chain(bounded) {
            expression.set(name, value);
        }
        Ok(())
    }

    /// Whether all parts of the mission are within what they may be, with the numbers that were
    /// set.
    ///
    /// # Errors
    ///
    /// [`SetError::Beyond`], the first.
    pub fn within_limits(&self) -> Result<(), SetError> {
        self.bounded.iter().find_map(Bounded::beyond).map_or(Ok(()), Err)
    }

    /// The mission's name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Ticks a second.
    #[must_use]
    pub fn rate_hz(&self) -> u32 {
        self.rate_hz
    }

    /// Where the runtime ends the run, seconds from its start.
    #[must_use]
    pub fn time_limit_s(&self) -> f64 {
        self.time_limit_s
    }

    /// Which machines must be in their final state for the mission to end.
    #[must_use]
    pub fn finish(&self) -> Finish {
        self.finish
    }

    /// What happens when a device is gone or a reading is stale.
    #[must_use]
    pub fn on_lost(&self) -> OnLost {
        self.on_lost
    }

    /// The mission's own numbers and its time limit, by name.
    #[must_use]
    pub fn numbers(&self) -> &BTreeMap<String, f64> {
        &self.numbers
    }

    /// The mission's variables with what they are at the start, in the order of their places.
    #[must_use]
    pub fn variables(&self) -> &[(String, f64)] {
        &self.variables
    }

    /// Whether any state switches the brick's lights.
    #[must_use]
    pub fn switches_lights(&self) -> bool {
        let mut states = self.machines.iter().flat_map(|machine| &machine.states);
        states.any(|state| {
            [&state.doing, &state.on_entry, &state.on_exit]
                .iter()
                .any(|outputs| outputs.led.is_some())
        })
    }

    /// Whether any state finds its way over the map.
    #[must_use]
    pub fn navigates(&self) -> bool {
        let mut states = self.machines.iter().flat_map(|machine| &machine.states);
        states.any(|state| matches!(state.doing.drive, Some(DrivePlan::Navigation { .. })))
    }

    /// The machines, in the order of the file; [`super::Taken`] counts them so.
    #[must_use]
    pub fn machines(&self) -> &[MachinePlan] {
        &self.machines
    }

    /// The names of a transition; `None` where it is not one of this mission's.
    #[must_use]
    pub fn named(&self, taken: Taken) -> Option<NamedTransition<'_>> {
        let machine = self.machines.get(usize::from(taken.machine))?;
        let (from, to) = (machine.state(taken.from)?, machine.state(taken.to)?);
        let when = match taken.transition {
            Some(index) => {
                let mut transitions = machine.transitions(taken.from);
                Some(transitions.nth(usize::from(index))?.when.text())
            }
            None => None,
        };
        Some(NamedTransition { machine: &machine.name, from: &from.name, to: &to.name, when })
    }

    /// The named motors, in the order of [`super::Demands::motors`].
    #[must_use]
    pub fn motors(&self) -> &[String] {
        &self.motors
    }

    /// The named sensors: all that the robot has, and where it is not known, those that are used.
    #[must_use]
    pub fn sensors(&self) -> &[String] {
        &self.sensors
    }

    /// What the mission needs of what the robot senses, head and named motors that it moves among
    /// them; the wheels are always sensed.
    #[must_use]
    pub fn senses(&self) -> &[Channel] {
        &self.senses
    }
}
