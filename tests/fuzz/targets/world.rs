//! Any bytes as a world file, or as a scenario of faults: loaded or refused; in what loads a robot
//! can stand for a moment.
#![no_main]

use std::sync::Arc;

use libfuzzer_sys::fuzz_target;
use onbrick::clock::{Clock, VirtualClock};
use onbrick::sim::{Scenario, Simulation, World, WorldPhysics};

fuzz_target!(|bytes: &[u8]| {
    let _ = Scenario::parse("scenario.toml", bytes);
    match World::parse("world.toml", bytes) {
        Ok((world, _)) => {
            let Ok(physics) = WorldPhysics::new(world, 1, 1) else { return };
            let observer = physics.observer();
            let clock = Arc::new(VirtualClock::default());
            let simulation = Simulation::new(clock.clone(), Box::new(physics), 1);
            clock.sleep_until_ns(20_000_000);
            simulation.catch_up();
            let truth = observer.truth(0).expect("the robot is there");
            assert!(truth.x_m.is_finite() && truth.y_m.is_finite(), "{truth:?}");
        }
        Err(findings) => {
            let told = findings.to_string();
            assert!(told.contains("world.toml"), "no place: {told}");
        }
    }
});
