//! What the machines of a mission see in one tick: the robot's signals, and what the mission itself
//! keeps from tick to tick.
//!
//! # Not here
//!
//! Who writes what: signals are the runtime's, variables are set by transitions, a machine's place
//! by the engine ([`super::Program`]).

use std::cell::Cell;

use arrayvec::ArrayVec;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::{Deserialize, Serialize};

use super::MAX_MACHINES;
use super::engine::LEVELS;
use super::signals::Signals;
use crate::clock::seconds;

/// The most variables that a mission may have.
pub const MAX_VARIABLES: usize = 64;

/// The most `pid`s that one state may have: a wheel each, the head, a motor.
pub const MAX_PIDS: usize = 4;

/// A pause between two steps of a `pid` counts for no longer than this, seconds: what happened
/// while a mission waited for a device is not to be summed up.
const LONGEST_STEP_S: f64 = 0.1;

/// Where one machine is, and since when: enough to go on from.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct MachineState {
    /// Index of the active state in the machine's list.
    pub state: u16,
    /// Since when it is active, after the states that it is inside, from the outermost.
    pub since: ArrayVec<Since, LEVELS>,
}

/// When and where a machine entered a state, and whether the state is done.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Since {
    /// Whether what the state does has come to its end.
    pub done: bool,
    /// When it was entered, nanoseconds of the run's clock.
    pub entered_ns: i64,
    /// Metres driven by then.
    pub entered_m: f64,
    /// Heading then, radians, not wrapped.
    pub entered_heading_rad: f64,
}

impl Since {
    /// Of a state that was entered when the run began.
    const START: Self =
        Self { done: false, entered_ns: 0, entered_m: 0.0, entered_heading_rad: 0.0 };
}

/// What a `pid` remembers; nothing yet when its state is entered.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct PidState {
    /// The sum of the errors, each times its seconds.
    sum: f64,
    /// The last error, and when that was, nanoseconds.
    last: Option<(f64, i64)>,
}

/// What all machines of a mission see.
#[derive(Debug, Clone)]
pub struct Blackboard {
    /// What the runtime knows of the robot.
    pub signals: Signals,
    /// Where each machine is.
    pub machines: [MachineState; MAX_MACHINES],
    /// The mission's variables, by their places.
    pub variables: [f64; MAX_VARIABLES],
    /// What `random` draws from.
    pub seed: u64,
    /// What each `pid` of each machine's active state remembers. Only `pid` itself changes it.
    pub(super) pids: [[Cell<PidState>; MAX_PIDS]; MAX_MACHINES],
}

impl Default for Blackboard {
    fn default() -> Self {
        Self {
            signals: Signals::default(),
            machines: Default::default(),
            variables: [0.0; MAX_VARIABLES],
            seed: 0,
            pids: Default::default(),
        }
    }
}

impl Blackboard {
    /// A blackboard with these signals, for a machine that entered its state at `since`; the rest
    /// is as at the start.
    #[must_use]
    pub fn of(signals: Signals, since: Since) -> Self {
        let mut board = Self { signals, ..Self::default() };
        board.machines[0].since.push(since);
        board
    }

    /// As one of the machines sees it.
    ///
    /// - `level`: of its active states the one that sees it, 0 for the outermost.
    #[must_use]
    pub fn seen_by(&self, machine: usize, level: usize) -> Scope<'_> {
        let since = self.machines.get(machine).and_then(|at| at.since.get(level));
        Scope { board: self, machine, since: since.unwrap_or(&Since::START) }
    }

    /// Notes that a machine enters a state now.
    pub(super) fn enter(&mut self, machine: usize, state: u16, level: usize) {
        if let Some(place) = self.machines.get_mut(machine) {
            place.state = state;
            place.since.truncate(level);
            // The engine has no more levels.
            let _ = place.since.try_push(self.signals.since());
        }
        for pid in self.pids.get_mut(machine).into_iter().flatten() {
            pid.set(PidState::default());
        }
    }

    /// Notes whether a machine's active state of a level is done.
    pub(super) fn set_done(&mut self, machine: usize, level: usize, done: bool) {
        let place = self.machines.get_mut(machine);
        if let Some(since) = place.and_then(|place| place.since.get_mut(level)) {
            since.done = done;
        }
    }
}

/// The blackboard as one machine sees it.
#[derive(Debug, Clone, Copy)]
pub struct Scope<'b> {
    pub(super) board: &'b Blackboard,
    pub(super) machine: usize,
    /// When and where it entered its state.
    pub(super) since: &'b Since,
}

impl Scope<'_> {
    /// One step of a controller: what it says to an error now.
    ///
    /// The rate is that of the error between two steps, and the sum grows by each step's error
    /// times its seconds; both begin with the state. An error that is infinite, as that of a range
    /// without an echo, has neither, and the rate begins again after it.
    ///
    /// - `most`: the answer is kept within it to either side, and the sum does not grow while it
    ///   holds the answer there (anti-windup by conditional integration; Åström and Hägglund,
    ///   *PID Controllers*, 1995, section 3.5).
    pub(super) fn pid(self, slot: u32, error: f64, gains: [f64; 3], most: f64) -> f64 {
        let slots = self.board.pids.get(self.machine);
        let slot = usize::try_from(slot).ok().and_then(|slot| slots?.get(slot));
        let Some(cell) = slot else { return f64::NAN };
        let now_ns = self.board.signals.time_ns();
        let PidState { mut sum, last } = cell.get();
        let ([kp, ki, kd], most) = (gains, most.abs());
        // A gain of zero takes nothing of an infinite error.
        let part = |gain: f64, of: f64| if gain == 0.0 { 0.0 } else { gain * of };
        let answer = |sum: f64, rate: f64| part(kp, error) + part(ki, sum) + part(kd, rate);
        let mut rate = 0.0;
        if let Some((before, then_ns)) = last
            && now_ns > then_ns
            && error.is_finite()
        {
            let step_s = seconds(now_ns.saturating_sub(then_ns)).min(LONGEST_STEP_S);
            rate = (error - before) / step_s;
            let grown = sum + error * step_s;
            let winds_up =
                answer(grown, rate).abs() > most && ki * error * answer(grown, rate) > 0.0;
            if !winds_up {
                sum = grown;
            }
        }
        cell.set(PidState { sum, last: error.is_finite().then_some((error, now_ns)) });
        let answer = answer(sum, rate);
        if answer.abs() > most { most.copysign(answer) } else { answer }
    }

    /// A number from 0 to below 1. It is drawn when the state is entered: until that is left the
    /// same `random` of a mission gives the same number. It needs no memory, because it is made
    /// from the seed, the machine, the moment of entering and the place in the mission's file.
    pub(super) fn random(self, slot: u32) -> f64 {
        let mut seed = [0; 32];
        let machine = u32::try_from(self.machine).unwrap_or(u32::MAX);
        seed[..8].copy_from_slice(&self.board.seed.to_le_bytes());
        seed[8..16].copy_from_slice(&self.since.entered_ns.to_le_bytes());
        seed[16..20].copy_from_slice(&machine.to_le_bytes());
        seed[20..24].copy_from_slice(&slot.to_le_bytes());
        let drawn = ChaCha8Rng::from_seed(seed).next_u64() >> 11;
        // 53 bits, which is what the number holds.
        #[expect(clippy::cast_precision_loss, reason = "53 bits fit")]
        let fraction = drawn as f64 / (1_u64 << 53) as f64;
        fraction
    }
}
