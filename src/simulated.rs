//! Runs on a simulated brick: the environment that [`execute`] drives one in.
//!
//! # Not here
//!
//! No simulation (`sim`) and no run (`runtime`): only what joins them.

use std::sync::Arc;

use crate::clock::{Clock, MonotonicClock, VirtualClock};
use crate::mapping::Pose;
use crate::recording::{Pace, STALL_NS};
use crate::runtime::{
    Brick, Ended, Environment, Heartbeat, Job, Refused, Source, StopFlags, Truth, execute,
};
use crate::sim::{Observer, Simulation, World, WorldPhysics};

/// A simulated brick at the beginning of its time, and what sees how things truly are.
///
/// - `near`: of a world's start poses the robot stands on the nearest to this one, so that each
///   robot of a team has its own.
/// - `clock`: a virtual one makes two minutes of the world two seconds.
///
/// # Errors
///
/// The world is not in order, or has no place for a robot.
pub fn simulation(
    world: &Source,
    seed: u64,
    near: Pose,
    clock: Arc<dyn Clock>,
) -> Result<(Simulation, Observer), Refused> {
    let (parsed, _) = World::parse(&world.name, world.text.as_bytes())?;
    let physics = WorldPhysics::new(parsed.with_start_near(near.x_m, near.y_m), 1, seed)
        .map_err(|error| Refused::World(error.into()))?;
    let observer = physics.observer();
    Ok((Simulation::new(clock, Box::new(physics), seed), observer))
}

/// Where a job on a simulated brick is done.
#[derive(Debug)]
pub struct Simulated {
    /// What [`execute`] is handed.
    pub environment: Environment,
    /// The brick and its world.
    pub simulation: Simulation,
    /// Sees how things truly are.
    pub observer: Observer,
}

/// Where a job is done whose brick is a simulated one.
///
/// # Errors
///
/// As [`simulation`]; [`Refused::NoSimulation`] where the job's brick is none.
pub fn simulated(job: &Job) -> Result<Simulated, Refused> {
    let Brick::Simulated { world, seed, realtime } = &job.brick else {
        return Err(Refused::NoSimulation);
    };
    let clock: Arc<dyn Clock> =
        if *realtime { Arc::new(MonotonicClock) } else { Arc::new(VirtualClock::default()) };
    let (simulation, observer) = simulation(world, *seed, job.start, Arc::clone(&clock))?;
    if *realtime {
        // A tick that is so late ends the run.
        simulation.give_up_behind_ns(STALL_NS);
    }
    let seen = observer.clone();
    let environment = Environment {
        pace: if *realtime { Pace::Real } else { Pace::Virtual },
        // With the same stamps two runs in virtual time give the same bytes.
        wall_offset_ns: (!realtime).then_some(job.stamps_ns),
        seed: Some(*seed),
        world_toml: Some(world.text.clone()),
        truth: Some(Arc::new(move || truth(&seen))),
        ..Environment::new(simulation.brick(0), clock)
    };
    Ok(Simulated { environment, simulation, observer })
}

/// Where the robot really is.
fn truth(observer: &Observer) -> Option<Truth> {
    let truth = observer.truth(0)?;
    let pose = Pose { x_m: truth.x_m, y_m: truth.y_m, heading_rad: truth.heading_rad };
    Some(Truth { pose, fallen: truth.fallen })
}

/// Does a job on a simulated brick, and shows how things truly are after each tick: for tests and
/// for judging missions.
///
/// # Errors
///
/// As [`execute`] and [`simulated`].
pub fn execute_observed(
    job: &Job,
    flags: &StopFlags,
    see: impl FnMut(&crate::sim::Truth) + Send,
) -> Result<Ended, Refused> {
    let Simulated { environment, observer, .. } = simulated(job)?;
    execute(job, environment, flags, &mut Witness { observer, see }, |_| {})
}

/// Looks at the truth with each beat.
struct Witness<F> {
    observer: Observer,
    see: F,
}

impl<F> std::fmt::Debug for Witness<F> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Witness").field("observer", &self.observer).finish_non_exhaustive()
    }
}

impl<F: FnMut(&crate::sim::Truth) + Send> Heartbeat for Witness<F> {
    fn beat(&mut self, _now_ns: i64) {
        if let Some(truth) = self.observer.truth(0) {
            (self.see)(&truth);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::{MILLISECOND_NS, SECOND_NS};
    use crate::runtime::{Lock, WhenAbandoned};

    /// The time that a simulated brick has given up for lost, `pause_ns` after it was made.
    fn lost_ns(realtime: bool, pause_ns: i64) -> i64 {
        let source =
            |name: &str, text: &str| Source { name: name.to_owned(), text: text.to_owned() };
        let world = source("arena", World::text("arena").unwrap());
        let job = Job {
            mission: source("mission.toml", ""),
            robot: source("robot.toml", ""),
            brick: Brick::Simulated { world, seed: 1, realtime },
            start: Pose::default(),
            set: Vec::new(),
            file: "run.mcap".into(),
            sync_ns: SECOND_NS,
            stamps_ns: 0,
            run: None,
            name: None,
            when_abandoned: WhenAbandoned::Stop,
            lock: Lock::Take,
        };
        let Simulated { environment, simulation, .. } = simulated(&job).unwrap();
        environment.clock.sleep_until_ns(environment.clock.now_ns() + pause_ns);
        simulation.catch_up();
        simulation.lost_ns()
    }

    #[test]
    fn a_simulation_in_real_time_gives_up_what_it_is_far_behind_and_one_in_virtual_time_nothing() {
        assert_eq!(lost_ns(false, 10 * SECOND_NS), 0);
        assert!(lost_ns(true, STALL_NS + 100 * MILLISECOND_NS) >= 100 * MILLISECOND_NS);
    }
}
