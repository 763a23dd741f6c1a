//! Thirty lines of robot on the library alone (feature `tick`): a machine, an estimator,
//! and leases.
//!
//! The robot drives straight, turns for a second whenever its left wheel has gone another half
//! metre, and stops after ten seconds. Large motors on outB and outD; run it on the brick, or give
//! the folder of a simulated brick as argument. Should the program die, the motors stop by
//! themselves 0.3 s later: every motion is a lease.

#![allow(clippy::print_stdout, reason = "an example shows what it did")]

use std::sync::Arc;
use std::time::Duration;

use onbrick::behavior::engine::{Engine, Finish, Machine, Progress};
use onbrick::clock::{Clock, MILLISECOND_NS, MonotonicClock};
use onbrick::ev3dev::{LocalTree, TachoMotor, Tree};
use onbrick::mapping::{Estimator, EstimatorConfig, Geometry, Inputs, Method, Pose};
use onbrick::robot::LeasedMotor;

#[derive(Default)]
struct Robot {
    pose: Pose,
    since_turn_m: f64,
    speeds_rad_s: [f64; 2],
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
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
                .after(Duration::from_secs(1), "straight")
        });
    let mut engine = Engine::new(Finish::All, [drive])?;
    let (mut robot, clock) = (Robot::default(), MonotonicClock);
    let start_ns = clock.now_ns();
    for tick in 0..500 {
        clock.sleep_until_ns(start_ns + tick * 20 * MILLISECOND_NS);
        let now_ns = clock.now_ns();
        let inputs = Inputs {
            time_ns: now_ns,
            left_rad: Some(left.angle_rad()?),
            right_rad: Some(right.angle_rad()?),
            ..Inputs::default()
        };
        let estimate = estimator.update(&inputs);
        robot.since_turn_m += estimate.forward_m_s * 0.02;
        robot.pose = estimate.pose;
        if engine.step(now_ns, &mut robot) == Progress::Finished {
            break;
        }
        left.turn(robot.speeds_rad_s[0], now_ns)?;
        right.turn(robot.speeds_rad_s[1], now_ns)?;
    }
    // Dropping the motors stops them.
    println!("{:.3} m, {:.3} m, {:.3} rad", robot.pose.x_m, robot.pose.y_m, robot.pose.heading_rad);
    Ok(())
}
