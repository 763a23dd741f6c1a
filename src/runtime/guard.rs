//! What the guard does when control is gone or hung: stop the motors that were control's, and see that they are still.
//!
//! The leases stop the motors by themselves 0.3 s after the last renewal; the guard does not wait for that, and does not trust it. It has
//! made sure before that control is dead (SIGKILL, and waited for), so that nobody can renew a lease behind its back.
//!
//! # Not here
//!
//! No processes and no pipes: the command `guard` has them.
//!
//! # What we count on
//!
//! - Motors are found again by their ports: a replugged motor has a new name.
//! - A motor that is not there any more does not turn.

use std::sync::Arc;

use crate::clock::{Clock, MILLISECOND_NS};
use crate::ev3dev::{
    Class, DeviceError, FindError, Identity, PortAddress, StopAction, TachoMotor, Tree, devices,
};

/// How long after the last heartbeat control counts as hung, nanoseconds.
pub const MISSED_NS: i64 = 200 * MILLISECOND_NS;

/// How long a braked motor may roll on before it is reset, nanoseconds: the large motor's mechanical time constant is 105 ms
/// (`ev3dev-interfaces`, 15.2).
const ROLL_NS: i64 = 300 * MILLISECOND_NS;

/// How often the guard looks whether the motors are still, nanoseconds; the drivers' speed is a mean over 20 ms.
const LOOK_NS: i64 = 20 * MILLISECOND_NS;

/// How often everything is tried before the guard gives up.
const TRIES: u32 = 20;

/// Why the guard could not see every motor still.
#[derive(Debug, thiserror::Error)]
pub enum GuardError {
    /// The motors cannot even be listed.
    #[error("cannot look for the motors")]
    Find(#[from] FindError),
    /// A motor does not do what it is told.
    #[error("cannot stop a motor")]
    Device(#[from] DeviceError),
    /// Motors went on turning although they were reset.
    #[error("still turning: {0}")]
    Turning(String),
}

/// Stops the motors on these ports and returns when all of them are still: ramps 0, stop action brake, `stop`; `reset` for those that
/// still turn afterwards.
///
/// # Errors
///
/// [`GuardError`], after twenty tries.
pub fn stop_motors(tree: &Arc<dyn Tree>, ports: &[PortAddress], clock: &dyn Clock) -> Result<(), GuardError> {
    let mut last = None;
    for _ in 0..TRIES {
        match stop_once(tree, ports, clock) {
            Ok(still) if still.is_empty() => return Ok(()),
            Ok(turning) => last = Some(GuardError::Turning(turning)),
            Err(error) => last = Some(error),
        }
    }
    last.map_or(Ok(()), Err)
}

/// One try: the ports whose motors turn at its end, separated by commas.
fn stop_once(tree: &Arc<dyn Tree>, ports: &[PortAddress], clock: &dyn Clock) -> Result<String, GuardError> {
    let mut motors = Vec::new();
    for identity in ours(tree, ports)? {
        match brake(tree, identity) {
            Ok(motor) => motors.push(motor),
            Err(error) if error.is_gone() => {}
            Err(error) => return Err(error.into()),
        }
    }
    let deadline_ns = clock.now_ns() + ROLL_NS;
    while !turning(&motors)?.is_empty() && clock.now_ns() < deadline_ns {
        clock.sleep_until_ns(clock.now_ns() + LOOK_NS);
    }
    for motor in &motors {
        if speed(motor)? != 0 {
            motor.reset()?;
        }
    }
    turning(&motors)
}

fn ours(tree: &Arc<dyn Tree>, ports: &[PortAddress]) -> Result<Vec<Identity>, FindError> {
    let mut found = devices(tree, Class::TachoMotor)?;
    found.retain(|identity| ports.iter().any(|port| port.fits(&identity.address)));
    Ok(found)
}

fn brake(tree: &Arc<dyn Tree>, identity: Identity) -> Result<TachoMotor, DeviceError> {
    let motor = TachoMotor::bind(tree, identity)?;
    motor.set_ramp_up_sp(0)?;
    motor.set_ramp_down_sp(0)?;
    motor.set_stop_action(StopAction::Brake)?;
    motor.stop()?;
    Ok(motor)
}

fn turning(motors: &[TachoMotor]) -> Result<String, GuardError> {
    let mut turning = Vec::new();
    for motor in motors {
        if speed(motor)? != 0 {
            turning.push(motor.identity().address.to_string());
        }
    }
    Ok(turning.join(", "))
}

/// A motor that was unplugged meanwhile stands still.
fn speed(motor: &TachoMotor) -> Result<i32, DeviceError> {
    match motor.speed() {
        Err(error) if error.is_gone() => Ok(0),
        speed => speed,
    }
}

#[cfg(all(test, feature = "sim"))]
mod tests {
    use super::*;
    use crate::clock::{SECOND_NS, VirtualClock};
    use crate::ev3dev::TachoCommand;
    use crate::sim::{Plugged, Port, Simulation, World, WorldPhysics};

    struct Bench {
        clock: Arc<dyn Clock>,
        simulation: Simulation,
        tree: Arc<dyn Tree>,
    }

    impl Bench {
        fn new() -> Self {
            let clock: Arc<dyn Clock> = Arc::new(VirtualClock::default());
            let physics = WorldPhysics::new(World::named("open").unwrap(), 1, 1).unwrap();
            let simulation = Simulation::new(Arc::clone(&clock), Box::new(physics), 1);
            let tree: Arc<dyn Tree> = simulation.brick(0);
            Self { clock, simulation, tree }
        }

        /// A motor that somebody left running for ever.
        fn left_running(&self, port: &str) -> TachoMotor {
            let motor = TachoMotor::at(&self.tree, &port.parse().unwrap()).unwrap();
            motor.set_speed_sp(300).unwrap();
            motor.set_ramp_down_sp(5000).unwrap();
            motor.command(TachoCommand::RunForever).unwrap();
            motor.set_stops_on_drop(false);
            self.clock.sleep_until_ns(self.clock.now_ns() + SECOND_NS);
            assert!(motor.speed().unwrap() > 200, "{port} turns");
            motor
        }
    }

    fn ports(names: &[&str]) -> Vec<PortAddress> {
        names.iter().map(|name| name.parse().unwrap()).collect()
    }

    #[test]
    fn our_motors_are_still_within_half_a_second_and_others_go_on() {
        let bench = Bench::new();
        let left = bench.left_running("outB");
        let right = bench.left_running("outD");
        let others = bench.left_running("outA");
        let start_ns = bench.clock.now_ns();
        stop_motors(&bench.tree, &ports(&["outB", "outD"]), &*bench.clock).unwrap();
        let took_ns = bench.clock.now_ns() - start_ns;
        assert_eq!((left.speed().unwrap(), right.speed().unwrap()), (0, 0));
        assert!(took_ns <= SECOND_NS / 2, "{took_ns} ns");
        assert!(others.speed().unwrap() > 200, "somebody else's motor is not touched");
    }

    #[test]
    fn a_motor_that_was_replugged_is_found_by_its_port() {
        let bench = Bench::new();
        bench.left_running("outB");
        bench.simulation.unplug(0, Port::OutB).unwrap();
        bench.clock.sleep_until_ns(bench.clock.now_ns() + SECOND_NS);
        stop_motors(&bench.tree, &ports(&["outB", "outD"]), &*bench.clock).unwrap();
        bench.simulation.plug(0, Port::OutB, Plugged::Motor(crate::sim::MotorKind::Large)).unwrap();
        bench.clock.sleep_until_ns(bench.clock.now_ns() + SECOND_NS);
        let again = bench.left_running("outB");
        stop_motors(&bench.tree, &ports(&["outB"]), &*bench.clock).unwrap();
        assert_eq!(again.speed().unwrap(), 0);
    }

    #[test]
    fn without_motors_there_is_nothing_to_do() {
        let bench = Bench::new();
        stop_motors(&bench.tree, &ports(&["outC"]), &*bench.clock).unwrap();
        stop_motors(&bench.tree, &[], &*bench.clock).unwrap();
    }
}
