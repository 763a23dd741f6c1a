//! Promise 1: how long wheels roll on when their lease has run out, by how fast they turned. The
//! lease and the kernel's timer end the command; the rest is the robot's own inertia against a
//! motor whose windings are shorted, which nothing of ours can make shorter.

use std::sync::Arc;

use onbrick::clock::{Clock, MILLISECOND_NS, SECOND_NS, VirtualClock};
use onbrick::ev3dev::{TachoMotor, Tree};
use onbrick::robot::{LEASE_MS, LeasedMotor};
use onbrick::sim::{Simulation, World, WorldPhysics};
use onbrick::units::radians;

use super::kills::{COMMANDS_NS, REST_NS};
use super::witness::Witness;
use crate::support::promised::promised;

/// Up to here the lease alone has the wheels at rest in time, degrees per second.
const IN_TIME_DPS: f64 = 150.0;

/// When the command ended and when the wheels stood, after the last renewal, nanoseconds: both
/// wheels ahead.
fn after_the_last_renewal(dps: f64) -> (i64, i64) {
    let (world, seen) =
        Witness::new(WorldPhysics::new(World::named("open").unwrap(), 1, 1).unwrap());
    let clock = Arc::new(VirtualClock::default());
    let simulation = Simulation::new(clock.clone(), Box::new(world), 1);
    let tree: Arc<dyn Tree> = simulation.brick(0);
    let mut wheels = ["outB", "outD"].map(|port| {
        let motor = TachoMotor::at(&tree, &port.parse().unwrap()).unwrap();
        LeasedMotor::take(motor, 1.0, radians(1000.0)).unwrap()
    });
    while clock.now_ns() < 2 * SECOND_NS {
        for wheel in &mut wheels {
            wheel.turn(radians(dps), clock.now_ns()).unwrap();
        }
        clock.sleep_ns(20 * MILLISECOND_NS);
    }
    // The last thing that is done before a death.
    for wheel in &mut wheels {
        wheel.turn(radians(dps + 1.0), clock.now_ns()).unwrap();
    }
    let renewed_ns = clock.now_ns();
    clock.sleep_until_ns(renewed_ns + SECOND_NS);
    simulation.catch_up();
    let seen = *seen.lock().unwrap();
    (seen.driven_ns - renewed_ns, seen.turned_ns - renewed_ns)
}

#[test]
fn promise_1_how_long_wheels_roll_on_after_the_last_lease_is_known() {
    for dps in [60.0, 100.0, IN_TIME_DPS, 240.0, 360.0] {
        let (commands_ns, rest_ns) = after_the_last_renewal(dps);
        let ms = |ns: i64| ns / MILLISECOND_NS;
        promised(&format!(
            "lease alone, wheels at {dps} deg/s: last command ended after {} ms, at rest after {} \
             ms, of which {} ms roll-out",
            ms(commands_ns),
            ms(rest_ns),
            ms(rest_ns - commands_ns)
        ));
        assert!(
            (i64::from(LEASE_MS)..=ms(COMMANDS_NS)).contains(&ms(commands_ns)),
            "{dps}: {commands_ns} ns"
        );
        if dps <= IN_TIME_DPS {
            assert!(rest_ns <= REST_NS, "{dps} deg/s: {rest_ns} ns");
        }
        // Behind a guard, which acts within 0.2 s, a little for stopping, and the same roll-out.
        assert!(rest_ns - commands_ns <= REST_NS - COMMANDS_NS / 2, "{dps} deg/s: {rest_ns} ns");
    }
}
