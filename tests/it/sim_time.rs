//! The simulation's time against the clock: caught up with, or given up for lost where a machine is
//! too slow.

use std::sync::Arc;

use onbrick::clock::{Clock, MILLISECOND_NS, SECOND_NS, VirtualClock};
use onbrick::sim::{Bridge, Physics, Plug, STEP_NS, Simulation};

use crate::drivers_bench::Bench;

#[test]
fn time_that_a_machine_was_too_slow_for_is_lost_and_not_waited_for() {
    let clock = Arc::new(VirtualClock::default());
    let simulation = Simulation::new(clock.clone(), Box::new(Bench::as_recorded()), 1);
    simulation.give_up_behind_ns(50 * MILLISECOND_NS);
    clock.sleep_until_ns(40 * MILLISECOND_NS);
    assert_eq!((simulation.now_ns(), simulation.lost_ns()), (40 * MILLISECOND_NS, 0));
    clock.sleep_until_ns(10 * SECOND_NS);
    assert_eq!(simulation.now_ns(), 90 * MILLISECOND_NS);
    assert_eq!(simulation.lost_ns(), 10 * SECOND_NS - 90 * MILLISECOND_NS);
    clock.sleep_until_ns(10 * SECOND_NS + 20 * MILLISECOND_NS);
    assert_eq!(simulation.now_ns(), 110 * MILLISECOND_NS, "and then it continues");
}

#[test]
fn the_greatest_seed_makes_a_simulation_too() {
    let clock = Arc::new(VirtualClock::default());
    let simulation = Simulation::new(clock, Box::new(Bench::as_recorded()), u64::MAX);
    assert_eq!(simulation.robots(), 1);
}

/// An empty world whose time takes ten times as long to simulate.
#[derive(Debug)]
struct Slow(Arc<VirtualClock>);

impl Physics for Slow {
    fn robots(&self) -> usize {
        0
    }

    fn step(&mut self, _: &[[Bridge; 4]]) {
        self.0.sleep_ns(10 * STEP_NS);
    }

    fn plug(&self, _: usize) -> Plug {
        unreachable!("no robot")
    }

    fn edges(&self, _: usize, _: usize) -> i64 {
        unreachable!("no robot")
    }

    fn measure(&mut self, _: usize, _: usize, _: &str) -> [i32; 8] {
        unreachable!("no robot")
    }

    fn battery(&self, _: usize) -> (f64, f64) {
        unreachable!("no robot")
    }
}

#[test]
fn what_catching_up_took_is_not_caught_up_with_by_the_next_access() {
    let clock = Arc::new(VirtualClock::default());
    let simulation = Simulation::new(clock.clone(), Box::new(Slow(clock.clone())), 1);
    simulation.give_up_behind_ns(50 * MILLISECOND_NS);
    clock.sleep_until_ns(SECOND_NS);
    for _ in 0..3 {
        assert_eq!(simulation.now_ns(), 50 * MILLISECOND_NS);
    }
    assert_eq!(clock.now_ns(), SECOND_NS + 500 * MILLISECOND_NS);
    assert_eq!(simulation.lost_ns(), clock.now_ns() - simulation.now_ns());
}
