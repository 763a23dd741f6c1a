//! The shipped missions on a robot that does at once what it is told, in rooms that are simple
//! sums: whether they are sound as plans. How they fare with motors, noise and slip is for the
//! simulated brick.

use super::*;

const TICK_S: f64 = 0.02;
const TRACK_WIDTH_M: f64 = 0.1143;
const WHEEL_RADIUS_M: f64 = 0.188976 / std::f64::consts::TAU;
const HEAD_RAD_S: f64 = 0.756;

/// Where the robot is, and what it was told last.
#[derive(Debug, Default)]
struct Robot {
    x_m: f64,
    y_m: f64,
    heading_rad: f64,
    head_rad: f64,
    travelled_m: f64,
    fastest_dps: f64,
}

impl Robot {
    /// A point of the body in the world, ahead and to the left of the axle's centre.
    fn point(&self, ahead_m: f64, left_m: f64) -> (f64, f64) {
        let (sin, cos) = libm::sincos(self.heading_rad);
        (self.x_m + cos * ahead_m - sin * left_m, self.y_m + sin * ahead_m + cos * left_m)
    }

    fn follow(&mut self, demands: &Demands) {
        let (forward_m_s, turn_rad_s) = match demands.drive {
            Some(Drive::Twist { forward_m_s, turn_rad_s }) => (forward_m_s, turn_rad_s),
            Some(Drive::Wheels { left_rad_s, right_rad_s }) => (
                WHEEL_RADIUS_M * (left_rad_s + right_rad_s) / 2.0,
                WHEEL_RADIUS_M * (right_rad_s - left_rad_s) / TRACK_WIDTH_M,
            ),
            Some(Drive::Stop(_)) | None => (0.0, 0.0),
        };
        let wheel_m_s = forward_m_s.abs() + turn_rad_s.abs() * TRACK_WIDTH_M / 2.0;
        self.fastest_dps = self.fastest_dps.max((wheel_m_s / WHEEL_RADIUS_M).to_degrees());
        let (sin, cos) = libm::sincos(self.heading_rad + turn_rad_s * TICK_S / 2.0);
        self.x_m += forward_m_s * TICK_S * cos;
        self.y_m += forward_m_s * TICK_S * sin;
        self.heading_rad += turn_rad_s * TICK_S;
        self.travelled_m += forward_m_s.abs() * TICK_S;
        if let Some(target_rad) = demands.head_rad {
            let step_rad = HEAD_RAD_S * TICK_S;
            self.head_rad += (target_rad - self.head_rad).clamp(-step_rad, step_rad);
        }
    }

    fn signals(&self, tick: i64) -> Signals {
        signals(
            tick * 20,
            &[
                (Signal::X, self.x_m),
                (Signal::Y, self.y_m),
                (Signal::Heading, self.heading_rad),
                (Signal::Sensed(Channel::Head), self.head_rad),
                (Signal::Travelled, self.travelled_m),
            ],
        )
    }

    /// Distance from the range sensor along the head to the wall of a room around the origin.
    fn range_m(&self, half_m: (f64, f64)) -> f64 {
        let (x_m, y_m) = self.point(0.0508, 0.0);
        let (sin, cos) = libm::sincos(self.heading_rad + self.head_rad);
        let along = |at: f64, slope: f64, half: f64| (half * slope.signum() - at) / slope;
        along(x_m, cos, half_m.0).min(along(y_m, sin, half_m.1)).max(0.0)
    }
}

/// Runs a mission to its end; `sense` adds what the sensors read, `watch` looks at each tick.
fn run(
    name: &str,
    robot: &mut Robot,
    sense: impl Fn(&Robot, &mut Signals),
    mut watch: impl FnMut(f64, &Robot, &str),
) {
    let mission = shipped(name);
    let mut program = mission.start().unwrap();
    for tick in 0.. {
        let mut signals = robot.signals(tick);
        sense(robot, &mut signals);
        let (demands, progress) = step(&mut program, &signals);
        watch(tick as f64 * TICK_S, robot, program.states().next().unwrap());
        // A minute more than a mission's own time shows more of a room.
        let is_over = tick as f64 * TICK_S > mission.time_limit_s() + 60.0;
        if progress == Progress::Finished || is_over {
            break;
        }
        robot.follow(&demands);
        assert!(
            robot.fastest_dps <= 360.0,
            "{name} asks for {} degrees per second",
            robot.fastest_dps
        );
    }
}

/// The quarters of the plane in which a robot has been.
fn quarter(robot: &Robot) -> usize {
    usize::from(robot.x_m > 0.0) + 2 * usize::from(robot.y_m > 0.0)
}

#[test]
fn the_wall_follower_goes_round_a_room_at_an_even_distance() {
    let half_m = (1.0, 0.8);
    let (mut quarters, mut nearest_m, mut farthest_m) = ([false; 4], f64::MAX, 0.0_f64);
    let sense = |robot: &Robot, signals: &mut Signals| {
        signals.set(Signal::Sensed(Channel::Range), robot.range_m(half_m));
        signals.set(Signal::Echo, 1.0);
    };
    run("wall", &mut Robot::default(), sense, |time_s, robot, _| {
        let wall_m = (half_m.0 - robot.x_m.abs()).min(half_m.1 - robot.y_m.abs());
        if time_s > 20.0 {
            quarters[quarter(robot)] = true;
            (nearest_m, farthest_m) = (nearest_m.min(wall_m), farthest_m.max(wall_m));
        }
    });
    println!("wall: {nearest_m:.3} to {farthest_m:.3} m from the nearest wall");
    assert_eq!(quarters, [true; 4]);
    assert!(nearest_m > 0.1 && farthest_m < 0.4, "{nearest_m} to {farthest_m} m");
}

#[test]
fn the_bumping_robot_stays_in_its_room_and_gets_about() {
    let mut quarters = [false; 4];
    let outside = |robot: &Robot| robot.x_m.abs() > 0.79 || robot.y_m.abs() > 0.79;
    let touches = |robot: &Robot| {
        [-0.06, 0.0, 0.06].iter().any(|left_m| {
            let (x_m, y_m) = robot.point(0.1, *left_m);
            x_m.abs() > 0.8 || y_m.abs() > 0.8
        })
    };
    let sense = |robot: &Robot, signals: &mut Signals| {
        signals.set(Signal::Sensed(Channel::Touch), f64::from(touches(robot)))
    };
    run("bump", &mut Robot::default(), sense, |time_s, robot, _| {
        assert!(!outside(robot), "at {time_s} s: {robot:?}");
        quarters[quarter(robot)] = true;
    });
    assert_eq!(quarters, [true; 4]);
}

#[test]
fn the_line_follower_stays_on_a_round_line() {
    // A line 2 cm wide, its middle a circle of 40 cm; the sensor sees a spot that blurs its edges
    // over 1 cm.
    let radius_m = |robot: &Robot| {
        let (x_m, y_m) = robot.point(0.06, 0.0);
        libm::hypot(x_m, y_m)
    };
    let sense = |robot: &Robot, signals: &mut Signals| {
        let from_edge_m = (radius_m(robot) - 0.4).abs() - 0.01;
        signals.set(
            Signal::Sensed(Channel::Reflect),
            8.0 + 54.0 * (0.5 + from_edge_m / 0.01).clamp(0.0, 1.0),
        );
    };
    // Clockwise, so that the line's left edge is its outer one.
    let mut robot = Robot { y_m: 0.41, x_m: -0.06, ..Robot::default() };
    let mut worst_m = 0.0_f64;
    run("line", &mut robot, sense, |time_s, robot, _| {
        if time_s > 5.0 {
            worst_m = worst_m.max((radius_m(robot) - 0.41).abs());
        }
    });
    println!(
        "line: at most {worst_m:.4} m from the edge after {:.1} degrees",
        robot.heading_rad.to_degrees()
    );
    assert!(worst_m < 0.015, "{worst_m} m");
    assert!(robot.heading_rad < -std::f64::consts::TAU, "once round: {} rad", robot.heading_rad);
}

#[test]
fn the_table_rover_keeps_its_wheels_on_the_table() {
    let on_table = |(x_m, y_m): (f64, f64)| x_m.abs() < 0.4 && y_m.abs() < 0.3;
    let sense = |robot: &Robot, signals: &mut Signals| {
        signals.set(
            Signal::Sensed(Channel::Reflect),
            if on_table(robot.point(0.09, 0.0)) { 45.0 } else { 1.0 },
        );
    };
    let mut edges = 0;
    run("edge", &mut Robot::default(), sense, |time_s, robot, state| {
        for left_m in [-TRACK_WIDTH_M / 2.0, TRACK_WIDTH_M / 2.0] {
            assert!(on_table(robot.point(0.0, left_m)), "at {time_s} s: {robot:?}");
        }
        edges += usize::from(state == "back");
    });
    assert!(edges > 100, "it met the edge: {edges}");
}

#[test]
fn the_remote_moves_each_wheel_by_its_own_buttons() {
    #[rustfmt::skip]
    let transcript = [
        // code  ahead  turns left
        (0.0,   0.0,   0.0),
        (5.0,   1.0,   0.0),   // both up
        (8.0,  -1.0,   0.0),   // both down
        (1.0,   1.0,  -1.0),   // left up
        (3.0,   1.0,   1.0),   // right up
        (2.0,  -1.0,   1.0),   // left down
        (4.0,  -1.0,  -1.0),   // right down
        (6.0,   0.0,  -1.0),   // left up, right down
        (7.0,   0.0,   1.0),   // left down, right up
        (9.0,   0.0,   0.0),   // the beacon: the end
    ];
    let mut program = shipped("remote").start().unwrap();
    let mut robot = Robot::default();
    for (second, (code, ahead, left)) in (0..).zip(transcript) {
        let (before_m, before_rad) = (robot.travelled_m, robot.heading_rad);
        let mut forwards_m = 0.0;
        let mut last = Progress::Running;
        for tick in 0..50 {
            let mut signals = robot.signals(second * 50 + tick);
            signals.set(Signal::Sensed(Channel::Remote), code);
            let (demands, progress) = step(&mut program, &signals);
            let (x_m, y_m, heading) = (robot.x_m, robot.y_m, robot.heading_rad);
            robot.follow(&demands);
            forwards_m +=
                (robot.x_m - x_m) * libm::cos(heading) + (robot.y_m - y_m) * libm::sin(heading);
            last = progress;
        }
        let sign = |value: f64| if value.abs() < 0.01 { 0.0 } else { value.signum() };
        let moved = (sign(forwards_m), sign(robot.heading_rad - before_rad));
        assert_eq!(moved, (ahead, left), "code {code}, {} m", robot.travelled_m - before_m);
        assert_eq!(last == Progress::Finished, code == 9.0, "code {code}");
    }
}
