//! The mapper as the runtime uses it: inputs in, estimates, points, path and grid out.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use onbrick::mapping::{
    Cell, Estimate, Estimator, EstimatorConfig, EstimatorState, Events, Geometry, GyroReading,
    Inputs, Map, MapPoint, Method, OwnEcho, OwnEchoes, Pose, Range, RangeMount, RangeReading,
    stats,
};
use onbrick::units::radians;

mod properties;

const TICK_NS: i64 = 10_000_000;
const BOTH: [Method; 2] = [Method::Seed, Method::Default];
const NO_ECHO: f64 = f64::INFINITY;

fn config(method: Method) -> EstimatorConfig {
    EstimatorConfig { geometry: Geometry::seed(), method }
}

/// A robot whose wheels never slip, with a gyro in whole degrees or in none.
#[derive(Debug, Clone)]
struct Robot {
    now_ns: i64,
    left_m: f64,
    right_m: f64,
    gyro: bool,
    head_rad: f64,
    range_m: f64,
    range_changed_ns: i64,
}

impl Robot {
    fn new(gyro: bool) -> Self {
        Self {
            now_ns: 0,
            left_m: 0.0,
            right_m: 0.0,
            gyro,
            head_rad: 0.0,
            range_m: NO_ECHO,
            range_changed_ns: 0,
        }
    }

    /// Moves the axle's centre by a step and a turn.
    fn move_by(&mut self, forward_m: f64, turn_rad: f64) {
        let half_m = turn_rad * Geometry::seed().track_width_m() / 2.0;
        self.left_m += forward_m - half_m;
        self.right_m += forward_m + half_m;
        self.now_ns += TICK_NS;
    }

    fn see(&mut self, range_m: f64) {
        self.range_m = range_m;
        self.range_changed_ns = self.now_ns;
    }

    fn inputs(&self) -> Inputs {
        let metres_per_rad = Geometry::seed().wheel_circumference_m() / TAU;
        let heading_rad = (self.right_m - self.left_m) / Geometry::seed().track_width_m();
        let whole_rad = radians(libm::round(heading_rad * 180.0 / PI));
        Inputs {
            time_ns: self.now_ns,
            left_rad: Some(self.left_m / metres_per_rad),
            right_rad: Some(self.right_m / metres_per_rad),
            gyro: self
                .gyro
                .then_some(GyroReading { value_rad: whole_rad, changed_ns: self.now_ns }),
            head_rad: Some(self.head_rad),
            range: Some(RangeReading { value_m: self.range_m, changed_ns: self.range_changed_ns }),
        }
    }
}

/// Moves in `ticks` equal parts and returns the last estimate.
fn drive(
    robot: &mut Robot,
    estimator: &mut Estimator,
    ticks: u32,
    forward_m: f64,
    turn_rad: f64,
) -> Estimate {
    let mut estimate = estimator.update(&robot.inputs());
    for _ in 0..ticks {
        robot.move_by(forward_m / f64::from(ticks), turn_rad / f64::from(ticks));
        estimate = estimator.update(&robot.inputs());
    }
    estimate
}

fn assert_near(pose: Pose, x_m: f64, y_m: f64, heading_rad: f64, within: f64) {
    let off =
        [(pose.x_m - x_m).abs(), (pose.y_m - y_m).abs(), (pose.heading_rad - heading_rad).abs()];
    assert!(
        off.iter().all(|off| *off <= within),
        "{pose:?} is not ({x_m}, {y_m}, {heading_rad}) within {within}"
    );
}

#[test]
fn a_straight_metre_is_a_metre_ahead() {
    for (method, gyro) in [(Method::Seed, true), (Method::Default, true), (Method::Default, false)]
    {
        let mut estimator = Estimator::new(config(method), Pose::default());
        let estimate = drive(&mut Robot::new(gyro), &mut estimator, 300, 1.0, 0.0);
        assert_near(estimate.pose, 1.0, 0.0, 0.0, 1e-9);
        assert!((estimate.travelled_m - 1.0).abs() < 1e-9, "{} m", estimate.travelled_m);
        assert!((estimate.forward_m_s - 1.0 / 3.0).abs() < 0.01, "{} m/s", estimate.forward_m_s);
        assert!(estimate.events.is_empty(), "{}", estimate.events);
    }
}

#[test]
fn a_quarter_turn_to_the_left_looks_along_y() {
    for (method, gyro, within) in
        [(Method::Seed, true, 0.01), (Method::Default, true, 0.01), (Method::Default, false, 1e-9)]
    {
        let mut estimator = Estimator::new(config(method), Pose::default());
        let estimate = drive(&mut Robot::new(gyro), &mut estimator, 200, 0.0, FRAC_PI_2);
        assert_near(estimate.pose, 0.0, 0.0, FRAC_PI_2, within);
        assert!(
            estimate.turn_rad_s > 0.7 && estimate.turn_rad_s < 0.9,
            "{} rad/s",
            estimate.turn_rad_s
        );
    }
}

#[test]
fn an_echo_at_a_metre_with_the_head_turned_left_lies_a_metre_to_the_left_of_the_sensor() {
    for method in BOTH {
        let mut robot = Robot::new(true);
        robot.head_rad = FRAC_PI_2;
        robot.see(1.0);
        let mut estimator = Estimator::new(config(method), Pose::default());
        let mut map = Map::new(&RangeMount::default(), &Pose::default());
        map.add(&estimator.update(&robot.inputs()));
        let [point] = map.points() else { panic!("{:?}", map.points()) };
        assert!((point.x_m - 0.0508).abs() < 1e-9 && (point.y_m - 1.0).abs() < 1e-9, "{point:?}");
    }
}

#[test]
fn the_seeds_points_come_each_tick_and_only_below_two_metres() {
    let mut robot = Robot::new(true);
    let mut estimator = Estimator::new(config(Method::Seed), Pose::default());
    let mut map = Map::new(&RangeMount::default(), &Pose::default());
    for (range_m, placed) in
        [(1.999, true), (1.999, true), (2.0, false), (NO_ECHO, false), (0.5, true)]
    {
        robot.move_by(0.01, 0.0);
        robot.see(range_m);
        let estimate = estimator.update(&robot.inputs());
        let points = map.add(&estimate);
        assert_eq!(points.len(), usize::from(placed), "at {range_m} m");
        if let Some(point) = points.first() {
            let expected_m = estimate.pose.x_m + 0.0508 + range_m;
            assert!((point.x_m - expected_m).abs() < 1e-9, "{point:?}, expected x {expected_m} m");
        }
    }
    assert_eq!(map.points().len(), 3);
}

#[test]
fn the_seed_steps_along_the_heading_before_the_turn_and_the_default_along_the_chord() {
    let step = |method| {
        let mut robot = Robot::new(true);
        let mut estimator = Estimator::new(config(method), Pose::default());
        estimator.update(&robot.inputs());
        robot.move_by(0.01, radians(4.0));
        estimator.update(&robot.inputs()).pose
    };
    assert_near(step(Method::Seed), 0.01, 0.0, radians(4.0), 1e-9);
    let [cos, sin] = [libm::cos(radians(2.0)), libm::sin(radians(2.0))];
    assert_near(step(Method::Default), 0.01 * cos, 0.01 * sin, radians(4.0), 1e-9);
}

#[test]
fn a_reading_is_placed_from_where_the_robot_was_at_its_instant() {
    let mut robot = Robot::new(false);
    let mut estimator = Estimator::new(config(Method::Default), Pose::default());
    drive(&mut robot, &mut estimator, 50, 0.1, radians(30.0));
    robot.see(1.0);
    // Read 20 ms later, and 50 ms old when it could first be read.
    robot.move_by(0.002, radians(0.6));
    robot.move_by(0.002, radians(0.6));
    let estimate = estimator.update(&robot.inputs());
    let sounding = estimate.sounding.expect("a sounding");
    let expected_ns = robot.range_changed_ns - 50_000_000;
    assert_eq!(sounding.time_ns, expected_ns);
    let then = estimator.pose_at(expected_ns);
    let direction_rad = libm::atan2(sounding.beam[1], sounding.beam[0]);
    assert!((direction_rad - then.heading_rad).abs() < 1e-9, "{direction_rad} rad, pose {then:?}");
    assert!(
        (then.heading_rad - radians(27.0)).abs() < 1e-6,
        "30 degrees less 50 ms at 60 °/s: {then:?}"
    );
}

#[test]
fn a_reading_that_stays_the_same_is_placed_ten_times_a_second() {
    let mut robot = Robot::new(true);
    robot.see(1.0);
    let mut estimator = Estimator::new(config(Method::Default), Pose::default());
    let mut map = Map::new(&RangeMount::default(), &Pose::default());
    for _ in 0..500 {
        robot.move_by(0.0, 0.0);
        map.add(&estimator.update(&robot.inputs()));
    }
    assert_eq!(map.points().len(), 50, "points in five seconds");
}

#[test]
fn a_head_that_is_not_read_places_nothing_and_a_fixed_sensor_needs_none() {
    let mut robot = Robot::new(true);
    robot.see(1.0);
    let inputs = Inputs { head_rad: None, ..robot.inputs() };
    for (on_head, placed) in [(true, false), (false, true)] {
        let mount = RangeMount { on_head, left_m: 0.03, ..RangeMount::default() };
        let geometry = Geometry::seed().with_range(mount).expect("a mount");
        for method in BOTH {
            let mut estimator =
                Estimator::new(EstimatorConfig { geometry, method }, Pose::default());
            let estimate = estimator.update(&inputs);
            assert_eq!(estimate.range, Some(Range::Echo(1.0)));
            assert_eq!(estimate.sounding.is_some(), placed, "on a head: {on_head}");
            if let Some(sounding) = estimate.sounding {
                assert_eq!((sounding.x_m, sounding.y_m), (0.0508, 0.03));
            }
        }
    }
}

#[test]
fn a_wall_that_vanishes_before_the_nose_is_too_near_until_the_robot_backs_off() {
    let mut robot = Robot::new(true);
    let mut estimator = Estimator::new(config(Method::Default), Pose::default());
    let mut map = Map::new(&RangeMount::default(), &Pose::default());
    let mut seen = Vec::new();
    for tick in 0..400 {
        robot.move_by(if tick < 200 { 0.001 } else { -0.002 }, 0.0);
        // A wall 22 cm ahead of the sensor's start; nearer than 4 cm it gives no echo.
        let distance_m = 0.22 - robot.left_m;
        robot.see(if (0.04..0.12).contains(&distance_m) { distance_m } else { NO_ECHO });
        let estimate = estimator.update(&robot.inputs());
        map.add(&estimate);
        let range = estimate.range.expect("a range");
        let kind = match range {
            Range::Echo(_) => "echo",
            Range::NoEcho => "none",
            Range::TooNear => "near",
        };
        if seen.last() != Some(&kind) {
            seen.push(kind);
        }
        assert_eq!(range == Range::TooNear, distance_m < 0.04, "at {distance_m} m");
    }
    assert_eq!(seen, ["none", "echo", "near", "echo", "none"]);
    assert!(map.points().iter().all(|point| point.x_m < 0.32), "no point comes of a missing echo");
}

#[test]
fn wheels_that_spin_while_the_gyro_stands_are_slip_and_make_the_pose_less_certain() {
    let turn = |slips: bool| {
        let mut robot = Robot::new(true);
        let mut estimator = Estimator::new(config(Method::Default), Pose::default());
        let mut events = Events::NONE;
        let mut estimate = estimator.update(&robot.inputs());
        for _ in 0..200 {
            robot.move_by(0.0, radians(1.0));
            let mut inputs = robot.inputs();
            if slips {
                inputs.gyro = Some(GyroReading { value_rad: 0.0, changed_ns: 0 });
            }
            estimate = estimator.update(&inputs);
            events |= estimate.events;
        }
        (events, estimate)
    };
    let (grip_events, grip) = turn(false);
    let (slip_events, slip) = turn(true);
    assert!(!grip_events.contains(Events::SLIP), "{grip_events}");
    assert!(slip_events.contains(Events::SLIP), "{slip_events}");
    assert!(slip.pose.heading_rad.abs() <= radians(0.5) + 1e-9, "{} rad", slip.pose.heading_rad);
    assert!(
        slip.covariance[0] > 2.0 * grip.covariance[0],
        "{:?} {:?}",
        slip.covariance,
        grip.covariance
    );
}

#[test]
fn a_wheel_that_is_replugged_is_noticed_and_moves_nothing() {
    let mut robot = Robot::new(true);
    let mut estimator = Estimator::new(config(Method::Default), Pose::default());
    let before = drive(&mut robot, &mut estimator, 100, 0.3, 0.0);
    robot.move_by(0.0, 0.0);
    let jumped = Inputs { left_rad: Some(0.0), ..robot.inputs() };
    let estimate = estimator.update(&jumped);
    assert!(estimate.events.contains(Events::WHEEL_JUMP), "{}", estimate.events);
    assert_eq!(estimate.pose, before.pose);
}

#[test]
fn the_maps_memory_is_bounded_over_ten_hours_and_keeps_first_and_last() {
    let mut map = Map::new(&RangeMount::default(), &Pose::default());
    let memory = (map.points().as_ptr(), map.path().as_ptr());
    let mut found = 0;
    // Ten soundings a second while the robot drives a circle of 1 m radius at 0.1 m/s.
    for second_tenth in 0..10 * 3600 * 10_i64 {
        let angle_rad = f64::from(u16::try_from(second_tenth % 628).expect("small")) / 100.0;
        let (sin, cos) = libm::sincos(angle_rad);
        let mut estimate = Estimate {
            time_ns: second_tenth * 100_000_000,
            pose: Pose { x_m: sin, y_m: 1.0 - cos, heading_rad: angle_rad },
            ..Estimate::default()
        };
        if second_tenth % 10 == 0 {
            estimate.sounding = Some(onbrick::mapping::Sounding {
                time_ns: estimate.time_ns,
                x_m: sin,
                y_m: 1.0 - cos,
                beam: [sin, -cos],
                echo: [sin, -cos],
                half_cone_rad: 0.2,
                range: Range::Echo(1.0),
                fresh: true,
                waits: false,
            });
        }
        found += map.add(&estimate).len();
    }
    let kept = map.points();
    assert_eq!(found, 36_000);
    assert_eq!((map.points().as_ptr(), map.path().as_ptr()), memory, "nothing was reallocated");
    assert!(kept.len() <= 20_000 && kept.len() >= 10_000, "{} points", kept.len());
    assert_eq!(map.points_stride(), 2);
    assert_eq!(kept[0].time_ns, 0);
    assert!(
        kept[kept.len() - 1].time_ns > 9 * 3600 * 1_000_000_000 + 59 * 60 * 1_000_000_000,
        "the last hour is there"
    );
    assert!(map.path().len() <= 15_000, "{} places", map.path().len());
    assert_eq!((map.grid().columns(), map.grid().rows()), (200, 200));
    assert_eq!(map.grid().at(0.0, -0.5), Cell::Free);
}

#[test]
fn a_circle_comes_back_to_its_start() {
    for (gyro, within) in [(true, 0.03), (false, 1e-4)] {
        let mut estimator = Estimator::new(config(Method::Default), Pose::default());
        let estimate = drive(&mut Robot::new(gyro), &mut estimator, 1000, PI, TAU);
        assert_near(estimate.pose, 0.0, 0.0, TAU, within);
    }
}

/// Half the side of a square room around the origin, metres.
const ROOM_M: f64 = 1.5;

/// A robot on a circle in the room, its head swinging ±80° at 43°/s; each 100 ms a distance, known
/// 50 ms later. Returns the points' distances from the walls.
fn map_of_a_room(method: Method) -> Vec<f64> {
    let mut robot = Robot::new(true);
    // These distances are along the axis alone: a beam without a width.
    let mount = RangeMount { half_cone_rad: 0.0, ..RangeMount::default() };
    let geometry = Geometry::seed().with_range(mount).expect("a mount");
    let start = Pose { x_m: 0.0, y_m: -0.4, heading_rad: 0.0 };
    let mut estimator = Estimator::new(EstimatorConfig { geometry, method }, start);
    let mut map = Map::new(&mount, &Pose::default());
    let mut waiting = None;
    for tick in 0..6000_i32 {
        robot.move_by(0.001, 0.001 / 0.4);
        let swing_deg = (f64::from(tick) * 0.43) % 320.0;
        robot.head_rad =
            radians(if swing_deg < 160.0 { swing_deg - 80.0 } else { 240.0 - swing_deg });
        if tick % 10 == 0 {
            let heading_rad = f64::from(tick + 1) * 0.001 / 0.4;
            let truth = Pose {
                x_m: 0.4 * libm::sin(heading_rad),
                y_m: -0.4 * libm::cos(heading_rad),
                heading_rad,
            };
            waiting = Some(to_room_wall(truth.place(0.0508, 0.0), heading_rad + robot.head_rad));
        }
        if tick % 10 == 5
            && let Some(range_m) = waiting.take()
        {
            robot.see(range_m);
        }
        map.add(&estimator.update(&robot.inputs()));
    }
    let to_wall = |point: &MapPoint| (ROOM_M - point.x_m.abs().max(point.y_m.abs())).abs();
    map.points().iter().map(to_wall).collect()
}

/// From a place in the room to its wall along a direction.
fn to_room_wall([x_m, y_m]: [f64; 2], direction_rad: f64) -> f64 {
    let (sin, cos) = libm::sincos(direction_rad);
    let along = |place_m: f64, step: f64| (ROOM_M * step.signum() - place_m) / step;
    along(x_m, cos).min(along(y_m, sin))
}

#[test]
fn the_default_draws_a_room_several_times_sharper_than_the_seed() {
    let p90 = |method| stats::quantile(&mut map_of_a_room(method), 0.9).expect("there are points");
    let (seed_m, default_m) = (p90(Method::Seed), p90(Method::Default));
    println!(
        "a room without noise, p90 from point to wall: seed {:.1} cm, default {:.1} cm",
        seed_m * 100.0,
        default_m * 100.0
    );
    assert!(default_m < 0.015, "default: {default_m} m");
    assert!(seed_m > 3.0 * default_m, "seed: {seed_m} m, default: {default_m} m");
}

#[test]
fn a_state_survives_as_text() {
    let mut robot = Robot::new(true);
    let mut estimator = Estimator::new(config(Method::Default), Pose::default());
    robot.see(0.08);
    drive(&mut robot, &mut estimator, 200, 0.3, 1.0);
    let text = serde_json::to_string(&estimator.state()).expect("a state is plain data");
    assert!(text.len() < 10_000, "{} bytes", text.len());
    let read: EstimatorState = serde_json::from_str(&text).expect("it can be read again");
    assert_eq!(serde_json::to_string(&read).expect("again"), text);
}

#[test]
fn a_heading_without_a_gyro_grows_less_certain_than_with_one() {
    let heading_variance = |lost: bool| {
        let mut robot = Robot::new(true);
        let mut estimator = Estimator::new(config(Method::Default), Pose::default());
        drive(&mut robot, &mut estimator, 10, 0.01, 0.0);
        robot.gyro = !lost;
        let estimate = drive(&mut robot, &mut estimator, 1000, 2.0, 0.0);
        assert_eq!(estimate.events.contains(Events::GYRO_LOST), lost, "{}", estimate.events);
        assert_near(estimate.pose, 2.01, 0.0, 0.0, 1e-9);
        estimate.covariance[5]
    };
    let (with, without) = (heading_variance(false), heading_variance(true));
    assert!(without > 5.0 * with, "{without} rad² without, {with} rad² with");
}

#[test]
fn a_reading_is_put_right_once_and_the_robots_own_echo_is_no_reading() {
    let own = OwnEcho { from_rad: 0.9, to_rad: 1.1, range_m: 0.2 };
    let mount = RangeMount {
        bias_m: -0.014,
        scale: 1.02,
        own_echoes: OwnEchoes::of([own]),
        latency_ns: 0,
        ..RangeMount::default()
    };
    let geometry = Geometry::seed().with_range(mount).unwrap();
    let config = EstimatorConfig { geometry, method: Method::Default };
    let mut estimator = Estimator::new(config, Pose::default());
    let mut hear = |step: i64, head_rad: f64, value_m: f64| {
        let time_ns = step * 100_000_000;
        let estimate = estimator.update(&Inputs {
            time_ns,
            head_rad: Some(head_rad),
            range: Some(RangeReading { value_m, changed_ns: time_ns }),
            ..Inputs::default()
        });
        (estimate.range, estimate.sounding.map(|sounding| sounding.range))
    };
    let near = |range: Option<Range>, truth_m: f64| {
        assert!(
            matches!(range, Some(Range::Echo(m)) if (m - truth_m).abs() < 1e-12),
            "{range:?} instead of {truth_m}"
        );
    };
    let (range, sounding) = hear(1, 0.0, 1.006);
    near(range, 1.0);
    near(sounding, 1.0);
    assert_eq!(hear(2, 0.5, f64::INFINITY), (Some(Range::NoEcho), Some(Range::NoEcho)));
    // Neither an echo nor a miss.
    assert_eq!(hear(3, 1.0, 0.21), (None, None));
    // In the same direction, but farther or nearer than the robot's part.
    near(hear(4, 1.0, 1.006).0, 1.0);
    near(hear(5, 1.0, 0.088).0, 0.1);
    // At the same distance, elsewhere.
    near(hear(6, 1.5, 0.19).0, 0.2);
    let wrong = Geometry::seed().with_range(RangeMount { scale: 0.0, ..RangeMount::default() });
    assert_eq!(wrong.unwrap_err().quantity, "range scale");
}
