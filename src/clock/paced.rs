//! Virtual time that a person watches: it passes as time on the wall does, or faster, or as fast as
//! the machine allows, and which of them may change at any moment.
//!
//! # What we count on
//!
//! What a run decides depends on virtual time alone, so the pace changes when something happens on
//! the wall, and nothing of what happens.

use std::sync::Mutex;

use super::{Clock, MILLISECOND_NS, MonotonicClock, SECOND_NS, nanoseconds, seconds};
use crate::threads::lock;

/// A sleeper looks this often whether the pace has changed, and readers see time pass in such
/// steps, nanoseconds.
const LOOK_NS: i64 = 10 * MILLISECOND_NS;

/// What the machine is further behind is not made up for: a person would see a leap, nanoseconds.
const MOST_BEHIND_NS: i64 = SECOND_NS / 4;

/// A [`VirtualClock`](super::VirtualClock) with a pace. It is for one sleeper as well.
#[derive(Debug)]
pub struct PacedClock {
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    now_ns: i64,
    /// How many times faster than on the wall; `None` as fast as the machine allows.
    pace: Option<f64>,
    /// A time on the wall and this clock's time then; the pace has not changed since.
    since: (i64, i64),
}

impl PacedClock {
    /// A clock at 0. `pace` is how many times faster than on the wall time passes; `None` is as
    /// fast as the machine allows.
    #[must_use]
    pub fn new(pace: Option<f64>) -> Self {
        let since = (MonotonicClock.now_ns(), 0);
        Self { state: Mutex::new(State { now_ns: 0, pace, since }) }
    }

    /// Another pace from now on. One that is not positive is as slow as can be.
    pub fn set_pace(&self, pace: Option<f64>) {
        let mut state = lock(&self.state);
        state.pace = pace;
        state.since = (MonotonicClock.now_ns(), state.now_ns);
    }

    /// The pace now.
    #[must_use]
    pub fn pace(&self) -> Option<f64> {
        lock(&self.state).pace
    }
}

impl State {
    /// Goes as far towards the deadline as time on the wall allows.
    fn advance(&mut self, deadline_ns: i64, wall_ns: i64) {
        let (from_wall_ns, from_ns) = self.since;
        let reached_ns = self.pace.map_or(i64::MAX, |pace| {
            let passed_s = seconds(wall_ns.saturating_sub(from_wall_ns)) * pace.max(1e-3);
            from_ns.saturating_add(nanoseconds(passed_s))
        });
        self.now_ns = reached_ns.min(deadline_ns).max(self.now_ns);
        if reached_ns.saturating_sub(deadline_ns) > MOST_BEHIND_NS {
            self.since = (wall_ns, self.now_ns);
        }
    }
}

impl Clock for PacedClock {
    fn now_ns(&self) -> i64 {
        lock(&self.state).now_ns
    }

    fn sleep_until_ns(&self, deadline_ns: i64) {
        loop {
            let wall_ns = MonotonicClock.now_ns();
            let left_ns = {
                let mut state = lock(&self.state);
                state.advance(deadline_ns, wall_ns);
                if state.now_ns >= deadline_ns {
                    return;
                }
                let left_s = seconds(deadline_ns - state.now_ns);
                state.pace.map_or(0, |pace| nanoseconds(left_s / pace.max(1e-3)))
            };
            MonotonicClock.sleep_until_ns(wall_ns + left_ns.clamp(1, LOOK_NS));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How long a sleep at a pace takes on the wall. The clock counts from when the pace is set, so
    /// this does as well: a thread may be held up right after it.
    fn slept_ns(clock: &PacedClock, pace: Option<f64>, for_ns: i64) -> i64 {
        let before_ns = MonotonicClock.now_ns();
        clock.set_pace(pace);
        let deadline_ns = clock.now_ns() + for_ns;
        clock.sleep_until_ns(deadline_ns);
        assert_eq!(clock.now_ns(), deadline_ns, "never further than it was asked to");
        MonotonicClock.now_ns() - before_ns
    }

    #[test]
    fn time_passes_at_its_pace_and_never_further_than_the_sleeper_wants() {
        let clock = PacedClock::new(None);
        assert!(slept_ns(&clock, Some(1.0), 30 * MILLISECOND_NS) >= 29 * MILLISECOND_NS);
        assert!(slept_ns(&clock, Some(4.0), 80 * MILLISECOND_NS) >= 19 * MILLISECOND_NS);
        assert!(slept_ns(&clock, None, 1000 * SECOND_NS) < 10 * SECOND_NS);
        let now_ns = clock.now_ns();
        clock.sleep_until_ns(now_ns - SECOND_NS);
        assert_eq!(clock.now_ns(), now_ns, "time does not go back");
    }

    #[test]
    fn what_a_slow_machine_has_lost_is_not_made_up_for() {
        let mut state = State { now_ns: 0, pace: Some(1.0), since: (0, 0) };
        // A tick that took three seconds on the wall.
        state.advance(20 * MILLISECOND_NS, 3 * SECOND_NS);
        assert_eq!(state.now_ns, 20 * MILLISECOND_NS);
        state.advance(40 * MILLISECOND_NS, 3 * SECOND_NS + 5 * MILLISECOND_NS);
        assert_eq!(state.now_ns, 25 * MILLISECOND_NS, "not the two seconds at once");
    }

    #[test]
    fn a_pace_that_changes_is_heard_by_a_sleeper() {
        let clock = PacedClock::new(Some(0.01));
        std::thread::scope(|scope| {
            let sleeper = scope.spawn(|| clock.sleep_until_ns(3600 * SECOND_NS));
            clock.set_pace(None);
            sleeper.join().unwrap();
        });
        assert_eq!(clock.now_ns(), 3600 * SECOND_NS);
    }
}
