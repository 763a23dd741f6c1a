//! One virtual time for several runs in this process, which take turns: the same seeds give the
//! same runs, whichever thread the machine lets go first.

use std::cell::Cell;
use std::collections::BTreeSet;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use onbrick::clock::Clock;

thread_local! {
    static SEAT: Cell<usize> = const { Cell::new(0) };
}

/// A clock for several sleepers, of which one is awake at a time.
#[derive(Debug)]
pub struct Turns {
    state: Mutex<State>,
    passed: Condvar,
}

#[derive(Debug)]
struct State {
    now_ns: i64,
    /// Who is still playing.
    seats: usize,
    /// Who sleeps, and until when.
    asleep: BTreeSet<(i64, usize)>,
    awake: Option<usize>,
}

impl Turns {
    pub fn new(seats: usize) -> Self {
        let state = State { now_ns: 0, seats, asleep: BTreeSet::new(), awake: None };
        Self { state: Mutex::new(state), passed: Condvar::new() }
    }

    /// Does what a thread has to do, from when all are there.
    pub fn play<T>(&self, seat: usize, what: impl FnOnce() -> T) -> T {
        SEAT.set(seat);
        self.sleep(self.state(), 0);
        let _leaves = Leaves(self);
        what()
    }

    fn sleep(&self, mut state: MutexGuard<'_, State>, deadline_ns: i64) {
        let seat = SEAT.get();
        state.asleep.insert((deadline_ns, seat));
        self.pass(&mut state);
        drop(self.passed.wait_while(state, |state| state.awake != Some(seat)));
    }

    /// Wakes the one that is due first, when all are asleep.
    fn pass(&self, state: &mut State) {
        state.awake = None;
        if state.asleep.len() == state.seats
            && let Some((deadline_ns, seat)) = state.asleep.pop_first()
        {
            state.now_ns = state.now_ns.max(deadline_ns);
            state.awake = Some(seat);
        }
        self.passed.notify_all();
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The others go on without it, also if it has panicked.
struct Leaves<'t>(&'t Turns);

impl Drop for Leaves<'_> {
    fn drop(&mut self) {
        let mut state = self.0.state();
        state.seats -= 1;
        self.0.pass(&mut state);
    }
}

impl Clock for Turns {
    fn now_ns(&self) -> i64 {
        self.state().now_ns
    }

    fn sleep_until_ns(&self, deadline_ns: i64) {
        let state = self.state();
        if state.now_ns < deadline_ns {
            self.sleep(state, deadline_ns);
        }
    }
}
