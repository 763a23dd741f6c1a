//! Thirty lines of robot on the library alone (feature `tick`): a machine, an estimator,
//! and leases.
//!
//! The robot drives straight, turns for a second whenever its left wheel has gone another half
//! metre, and stops after ten seconds. Large motors on outB and outD; run it on the brick, or give
//! the folder of a simulated brick as argument. Should the program die, the motors stop by
//! themselves 0.3 s later: every motion is a lease.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "an example shows what it did")]

use std::sync::Arc;

use onbrick::behavior::engine::{Engine, Finish, Machine};
use onbrick::clock::{Clock, MILLISECOND_NS, MonotonicClock};
use onbrick::ev3dev::{LocalTree, TachoMotor, Tree};
use onbrick::mapping::{Estimator, EstimatorConfig, Geometry, Inputs, Method, Pose};
use onbrick::robot::LeasedMotor;

#[derive(Default)]
struct Robot {
    since_turn_m: f64,
    speeds_rad_s: [f64; 2],
}

fn main() {
    wander().unwrap_or_else(|error| {
        eprintln!("error: {error}");
        std::process::exit(1);
    });
}

fn wander() -> Result<(), Box<dyn std::error::Error>> {
    let tree: Arc<dyn Tree> =
        Arc::new(LocalTree::new(std::env::args().nth(1).unwrap_or("/".into())));
    let motor = |port: &str| -> Result<LeasedMotor, Box<dyn std::error::Error>> {
        Ok(LeasedMotor::take(TachoMotor::at(&tree, &port.parse()?)?, 1.0, 6.0)?)
    };
    let (mut left, mut right) = (motor("outB")?, motor("outD")?);
    let config =
        EstimatorConfig { geometry: Geometry::new(0.189, 0.114)?, method: Method::Default };
    let mut estimator = Estimator::new(config, Pose::default());
    let drive = Machine::<Robot>::new("drive", "straight")
        .state("straight", |state| {
            state
                .entering(|robot, _| robot.since_turn_m = 0.0)
                .doing(|robot, _| robot.speeds_rad_s = [3.0, 3.0])
                .when(|robot, _| robot.since_turn_m > 0.5, "turn")
        })
        .state("turn", |state| {
            state
                .doing(|robot, _| robot.speeds_rad_s = [1.5, -1.5])
                .after(std::time::Duration::from_secs(1), "straight")
        });
    let mut engine = Engine::new(Finish::All, [drive])?;
    let (mut robot, clock, start_ns) = (Robot::default(), MonotonicClock, MonotonicClock.now_ns());
    for tick in 0..500 {
        clock.sleep_until_ns(start_ns + tick * 20 * MILLISECOND_NS);
        let now_ns = clock.now_ns();
        let estimate = estimator.update(&Inputs {
            time_ns: now_ns,
            left_rad: Some(left.angle_rad()?),
            right_rad: Some(right.angle_rad()?),
            ..Inputs::default()
        });
        robot.since_turn_m += estimate.forward_m_s * 0.02;
        engine.step(now_ns, &mut robot);
        left.turn(robot.speeds_rad_s[0], now_ns)?;
        right.turn(robot.speeds_rad_s[1], now_ns)?;
    }
    // Dropping the motors stops them.
    let pose = estimator.pose_at(clock.now_ns());
    println!("{:.3} m, {:.3} m, {:.3} rad", pose.x_m, pose.y_m, pose.heading_rad);
    Ok(())
}
