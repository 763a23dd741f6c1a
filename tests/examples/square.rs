//! A square on the bindings alone (no features): two motors go to positions, which the kernel's
//! driver sees to, and the program waits for them.
//!
//! Large motors on outB and outD. Run it on the brick, or give the folder of a simulated one as
//! argument: `onbrick sim /tmp/brick --world open`, then
//! `cargo run --example square -- /tmp/brick`.
//!
//! Should the program die, each motor still goes to the end of its side and holds; a motion that
//! ends sooner is a lease, as in `line.rs`.

#![allow(clippy::print_stderr, reason = "an example says why it failed")]

use std::sync::Arc;
use std::time::Duration;

use onbrick::ev3dev::{DeviceError, LocalTree, StopAction, TachoCommand, TachoMotor, Tree};

/// Metres: once round a wheel, between the wheels, along a side of the square.
const WHEEL_M: f64 = 0.189;
const TRACK_M: f64 = 0.114;
const SIDE_M: f64 = 0.4;

/// How fast the motors turn, degrees a second.
const SPEED_DPS: i32 = 300;

/// How often the motors are looked at.
const LOOK: Duration = Duration::from_millis(50);

fn main() {
    drive().unwrap_or_else(|error| {
        eprintln!("error: {error}");
        std::process::exit(1);
    });
}

fn drive() -> Result<(), Box<dyn std::error::Error>> {
    let root = std::env::args().nth(1).unwrap_or("/".into());
    let brick: Arc<dyn Tree> = Arc::new(LocalTree::new(root));
    let wheels =
        [TachoMotor::at(&brick, &"outB".parse()?)?, TachoMotor::at(&brick, &"outD".parse()?)?];
    for wheel in &wheels {
        wheel.reset()?;
        wheel.set_stop_action(StopAction::Hold)?;
        wheel.set_speed_sp(SPEED_DPS)?;
    }
    // A quarter turn on the spot takes each wheel a quarter of the circle between them.
    let turn_m = std::f64::consts::FRAC_PI_4 * TRACK_M;
    for _ in 0..4 {
        roll(&wheels, [SIDE_M, SIDE_M])?;
        roll(&wheels, [-turn_m, turn_m])?;
    }
    // Dropping the motors stops them.
    Ok(())
}

/// Rolls the wheels on by these ways, left and right, and waits until both have arrived.
fn roll(wheels: &[TachoMotor; 2], ways_m: [f64; 2]) -> Result<(), DeviceError> {
    for (wheel, way_m) in wheels.iter().zip(ways_m) {
        let counts = way_m / WHEEL_M * f64::from(wheel.count_per_rot());
        #[allow(clippy::cast_possible_truncation, reason = "a few hundred counts")]
        wheel.set_position_sp(counts.round() as i32)?;
        wheel.command(TachoCommand::RunToRelPos)?;
    }
    for wheel in wheels {
        while wheel.state()?.is_driven() {
            wheel.wait_state_changed(LOOK)?;
        }
    }
    Ok(())
}
