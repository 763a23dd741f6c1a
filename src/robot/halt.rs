//! Stopping motors whatever they are doing: every one there is (`onbrick halt`), or those of a run
//! that is gone (the guard).
//!
//! # What we count on
//!
//! - Motors are looked up by their ports each time: a replugged motor has a new name.
//! - An unplugged motor does not turn.

use std::sync::Arc;

use serde::Serialize;

use crate::clock::{Clock, MILLISECOND_NS};
use crate::ev3dev::{
    Class, DcMotor, DeviceError, FindError, MotorState, PortAddress, StopAction, TachoMotor, Tree,
    devices,
};

/// How long a braked motor may roll on, nanoseconds: the large motor's mechanical time constant is
/// 105 ms (`ev3dev-interfaces`, 15.2).
const ROLL_NS: i64 = 300 * MILLISECOND_NS;

/// How often one checks whether motors are still, nanoseconds; the drivers' speed is a mean over 20
/// ms.
const LOOK_NS: i64 = 20 * MILLISECOND_NS;

/// How often everything is tried before [`still`] gives up.
const TRIES: u32 = 20;

/// A motor that was stopped.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Halted {
    /// Its port.
    pub address: String,
    /// Its driver.
    pub driver_name: String,
}

/// Stops every motor there is, ours or not: ramps 0, stop action brake, then `stop`.
///
/// # Errors
///
/// The first motor that does not take it; all others have been told by then.
pub fn halt(tree: &Arc<dyn Tree>) -> Result<Vec<Halted>, HaltError> {
    let mut all = devices(tree, Class::TachoMotor)?;
    all.extend(devices(tree, Class::DcMotor)?);
    let mut halted = Vec::new();
    each(all, |identity| {
        let report = Halted {
            address: identity.address.to_string(),
            driver_name: identity.driver.to_string(),
        };
        if identity.class == Class::DcMotor {
            let motor = DcMotor::bind(tree, identity);
            // The BrickPi's driver can only let it coast.
            match motor.set_stop_action(StopAction::Brake) {
                Err(error) if error.is_gone() => return Err(error),
                _ => motor.stop()?,
            }
        } else {
            brake(&TachoMotor::bind(tree, identity)?)?;
        }
        halted.push(report);
        Ok(())
    })?;
    Ok(halted)
}

/// Why not every motor could be stopped.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HaltError {
    /// The motors cannot even be listed.
    #[error(transparent)]
    Find(#[from] FindError),
    /// A motor did not take the command.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// Motors go on turning although they were reset: something else commands them, or a hand turns
    /// them.
    #[error("still turning: {0}")]
    Turning(String),
}

/// Stops the tacho motors on these ports and returns when all of them are still: ramps 0, stop
/// action brake, `stop`; `reset` for those that still turn afterwards. Other motors are not
/// touched.
///
/// # Errors
///
/// [`HaltError`], after twenty tries; each of them told every motor that could be told.
pub fn still(
    tree: &Arc<dyn Tree>,
    ports: &[PortAddress],
    clock: &dyn Clock,
) -> Result<(), HaltError> {
    let mut last = Ok(());
    for _ in 0..TRIES {
        let start_ns = clock.now_ns();
        last = still_once(tree, ports, clock);
        if last.is_ok() {
            break;
        }
        // A failure that came at once is not tried again at once: a plug that is just being put in
        // needs its time.
        clock.sleep_until_ns(start_ns + ROLL_NS);
    }
    last
}

/// Tells the tacho motors on these ports to brake, and does not wait until they are still.
///
/// # Errors
///
/// [`HaltError`]; every motor that could be told was told.
pub fn brake_all(tree: &Arc<dyn Tree>, ports: &[PortAddress]) -> Result<(), HaltError> {
    tell(tree, ports, |_| ())
}

/// Brakes each of these motors, and hands over those that are there.
fn tell(
    tree: &Arc<dyn Tree>,
    ports: &[PortAddress],
    mut told: impl FnMut(TachoMotor),
) -> Result<(), HaltError> {
    let mut found = devices(tree, Class::TachoMotor)?;
    found.retain(|identity| ports.iter().any(|port| port.fits(&identity.address)));
    Ok(each(found, |identity| {
        let motor = TachoMotor::bind(tree, identity)?;
        let braked = brake(&motor);
        told(motor);
        braked
    })?)
}

fn still_once(
    tree: &Arc<dyn Tree>,
    ports: &[PortAddress],
    clock: &dyn Clock,
) -> Result<(), HaltError> {
    let mut motors = Vec::new();
    let told = tell(tree, ports, |motor| motors.push(motor));
    let deadline_ns = clock.now_ns() + ROLL_NS;
    while clock.now_ns() < deadline_ns && !turning(&motors, clock).is_empty() {
        clock.sleep_ns(LOOK_NS);
    }
    let reset = each(turning(&motors, clock), TachoMotor::reset);
    told?;
    reset?;
    // What was reset coasts from now on.
    let turning = turning(&motors, clock);
    if turning.is_empty() {
        return Ok(());
    }
    let ports: Vec<String> =
        turning.iter().map(|motor| motor.identity().address.to_string()).collect();
    Err(HaltError::Turning(ports.join(", ")))
}

/// Does something to each motor; the first error, after all of them.
fn each<T>(
    motors: Vec<T>,
    mut act: impl FnMut(T) -> Result<(), DeviceError>,
) -> Result<(), DeviceError> {
    let mut failed = Ok(());
    for motor in motors {
        match act(motor) {
            Err(error) if !error.is_gone() => failed = failed.and(Err(error)),
            _ => {}
        }
    }
    failed
}

/// Stops a motor whatever becomes of its settings; a ramp would let it roll on.
fn brake(motor: &TachoMotor) -> Result<(), DeviceError> {
    let settings = [
        motor.set_ramp_down_sp(0),
        motor.set_ramp_up_sp(0),
        motor.set_stop_action(motor.nearest_action(StopAction::Brake)),
        motor.stop(),
    ];
    settings.into_iter().collect()
}

/// The motors that turn; one of which that cannot be read counts as turning, unless it is gone.
fn turning<'m>(motors: &'m [TachoMotor], clock: &dyn Clock) -> Vec<&'m TachoMotor> {
    let turns = |motor: &&TachoMotor| match motor.speed() {
        Ok(speed) => speed != 0 && !is_held(motor),
        // The PiStorms' driver does not know speeds.
        Err(error) if error.is_absent() => moves(motor, clock),
        Err(error) => !error.is_gone(),
    };
    motors.iter().filter(turns).collect()
}

/// A motor that cannot be braked holds its place, and rocks about it for a moment.
fn is_held(motor: &TachoMotor) -> bool {
    motor.state().is_ok_and(MotorState::is_holding)
}

/// Whether a motor moves between two looks; one whose position cannot be read counts as moving.
fn moves(motor: &TachoMotor, clock: &dyn Clock) -> bool {
    let before = motor.position();
    clock.sleep_ns(LOOK_NS);
    before.is_err() || before != motor.position()
}

/// Watches for `watch_ns` and names the motors that turn at the end of it, by port and how far they
/// went, in counts.
///
/// # Errors
///
/// [`HaltError`].
pub fn watch_still(
    tree: &Arc<dyn Tree>,
    clock: &dyn Clock,
    watch_ns: i64,
) -> Result<Vec<String>, HaltError> {
    /// A braked motor may settle between two counts.
    const STILL_COUNTS: i32 = 1;
    clock.sleep_ns(ROLL_NS);
    let mut before = Vec::new();
    for identity in devices(tree, Class::TachoMotor)? {
        let motor = TachoMotor::bind(tree, identity)?;
        let position = motor.position()?;
        before.push((motor, position));
    }
    clock.sleep_ns(watch_ns);
    let mut moving = Vec::new();
    for (motor, position) in &before {
        let moved = motor.position()?.wrapping_sub(*position);
        if moved.abs() > STILL_COUNTS && !is_held(motor) {
            moving.push(format!("{} ({moved} counts)", motor.identity().address));
        }
    }
    Ok(moving)
}

#[cfg(feature = "sim")]
#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::{SECOND_NS, VirtualClock};
    use crate::ev3dev::TachoCommand;
    use crate::sim::{MotorKind, Plugged, Port, Simulation, World, WorldPhysics};

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

        fn pass(&self, ns: i64) {
            self.clock.sleep_ns(ns);
        }

        /// A motor that another program left running for ever.
        fn left_running(&self, port: &str) -> TachoMotor {
            let motor = TachoMotor::at(&self.tree, &port.parse().unwrap()).unwrap();
            motor.set_speed_sp(300).unwrap();
            motor.set_ramp_down_sp(5000).unwrap();
            motor.command(TachoCommand::RunForever).unwrap();
            motor.set_stops_on_drop(false);
            self.pass(SECOND_NS);
            assert!(motor.speed().unwrap() > 200, "{port} turns");
            motor
        }

        fn still(&self, names: &[&str]) -> Result<(), HaltError> {
            let ports: Vec<PortAddress> = names.iter().map(|name| name.parse().unwrap()).collect();
            still(&self.tree, &ports, &*self.clock)
        }
    }

    #[test]
    fn our_motors_are_still_within_half_a_second_and_others_go_on() {
        let bench = Bench::new();
        let left = bench.left_running("outB");
        let right = bench.left_running("outD");
        let others = bench.left_running("outA");
        let start_ns = bench.clock.now_ns();
        bench.still(&["outB", "outD"]).unwrap();
        let took_ns = bench.clock.now_ns() - start_ns;
        assert_eq!((left.speed().unwrap(), right.speed().unwrap()), (0, 0));
        assert!(took_ns <= SECOND_NS / 2, "{took_ns} ns");
        assert!(others.speed().unwrap() > 200, "another program's motor is not touched");
    }

    #[test]
    fn a_motor_that_was_replugged_is_found_by_its_port() {
        let bench = Bench::new();
        bench.left_running("outB");
        bench.simulation.unplug(0, Port::OutB).unwrap();
        bench.pass(SECOND_NS);
        bench.still(&["outB", "outD"]).unwrap();
        bench.simulation.plug(0, Port::OutB, Plugged::Motor(MotorKind::Large)).unwrap();
        bench.pass(SECOND_NS);
        let again = bench.left_running("outB");
        bench.still(&["outB"]).unwrap();
        assert_eq!(again.speed().unwrap(), 0);
    }

    #[test]
    fn a_motor_that_takes_nothing_does_not_keep_the_others_from_stopping_and_is_named() {
        let bench = Bench::new();
        let [left, right] = ["outB", "outD"].map(|port| bench.left_running(port));
        bench.simulation.control(0, "outB eio").unwrap();
        let error = bench.still(&["outB", "outD"]).unwrap_err();
        assert!(error.to_string().contains("outB"), "{error}");
        assert_eq!(right.speed().unwrap(), 0);
        bench.simulation.control(0, "outB clear").unwrap();
        bench.still(&["outB", "outD"]).unwrap();
        assert_eq!(left.speed().unwrap(), 0);
    }

    #[test]
    fn without_motors_there_is_nothing_to_do() {
        let bench = Bench::new();
        bench.still(&["outC"]).unwrap();
        bench.still(&[]).unwrap();
    }
}
