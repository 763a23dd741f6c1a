//! The thread that lets the simulation's time pass while no program touches a file, and that wakes
//! waiting readers.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::open::Open;
use crate::clock::{Clock, MonotonicClock};
use crate::sim::Simulation;
use crate::sim::files::LOOK_NS;
use crate::threads::Background;

/// A waiting reader is checked for an interrupt once in this many ticks.
const INTERRUPT_TICKS: u32 = 5;

/// Starts it.
pub(super) fn start(simulation: Simulation, open: Arc<Open>) -> io::Result<Background> {
    Background::start("sim-ticker", move |stop| run(&simulation, &open, stop))
}

fn run(simulation: &Simulation, open: &Open, stop: &AtomicBool) {
    let mut due_ns = MonotonicClock.now_ns();
    for tick in (0..INTERRUPT_TICKS).cycle() {
        if stop.load(Ordering::Relaxed) {
            break;
        }
        // Real time even where the simulation's is virtual: those who wait on a file wait really.
        due_ns = (due_ns + LOOK_NS).max(MonotonicClock.now_ns());
        MonotonicClock.sleep_until_ns(due_ns);
        simulation.catch_up();
        open.wake(tick == 0);
    }
    open.release_readers();
}
