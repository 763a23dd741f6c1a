//! A line follower on bindings and leases (feature `tick`): the robot keeps to the left edge of a
//! dark line for as many seconds as the second argument says, else for half a minute.
//!
//! Large motors on outB and outD, a colour sensor on in3 that looks down. Run it on the brick, or
//! give the folder of a simulated one as first argument: `onbrick sim /tmp/brick --world line`,
//! then `cargo run --example line -- /tmp/brick 10`. Should the program die or hang, the motors
//! stop by themselves 0.3 s later: every motion is a lease.

#![allow(clippy::print_stderr, reason = "an example says why it failed")]

use std::sync::Arc;

use onbrick::clock::{Clock, MILLISECOND_NS, MonotonicClock};
use onbrick::ev3dev::{ColourMode, ColourSensor, LocalTree, TachoMotor, Tree};
use onbrick::robot::LeasedMotor;

/// Reflected light half on the line, percent.
const EDGE_PCT: f64 = 35.0;

/// Of the wheels, radians a second: forward, and how much faster one turns than the other for each
/// percent beside the edge.
const FORWARD_RAD_S: f64 = 2.0;
const STEER_RAD_S_PCT: f64 = 0.08;

/// Turns of the loop a second.
const RATE_HZ: i64 = 50;

fn main() {
    follow().unwrap_or_else(|error| {
        eprintln!("error: {error}");
        std::process::exit(1);
    });
}

fn follow() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let brick: Arc<dyn Tree> = Arc::new(LocalTree::new(arguments.next().unwrap_or("/".into())));
    let seconds: i64 = arguments.next().map_or(Ok(30), |text| text.parse())?;
    let mut eye = ColourSensor::at(&brick, &"in3".parse()?)?;
    // What it reads before this time may be of the mode that it was in.
    let settle_ns = eye.set_mode(ColourMode::Reflect)?;
    let motor = |port: &str| -> Result<LeasedMotor, Box<dyn std::error::Error>> {
        Ok(LeasedMotor::take(TachoMotor::at(&brick, &port.parse()?)?, 1.0, 6.0)?)
    };
    let (mut left, mut right) = (motor("outB")?, motor("outD")?);
    let (clock, tick_ns) = (MonotonicClock, 1000 * MILLISECOND_NS / RATE_HZ);
    let start_ns = clock.now_ns() + settle_ns;
    for tick in 0..seconds * RATE_HZ {
        clock.sleep_until_ns(start_ns + tick * tick_ns);
        // Brighter than the edge: the robot is off to the left, and the left wheel turns faster.
        let steer_rad_s = STEER_RAD_S_PCT * (eye.reflected_pct()? - EDGE_PCT);
        let now_ns = clock.now_ns();
        left.turn(FORWARD_RAD_S + steer_rad_s, now_ns)?;
        right.turn(FORWARD_RAD_S - steer_rad_s, now_ns)?;
    }
    // Dropping the motors stops them, on an error too.
    Ok(())
}
