//! The simulated world as a person would draw it, and properties that hold in any world.
//!
//! Bridges are driven directly, with a small proportional regulator where a speed must be held.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "duties and counts of steps, all small and positive"
)]

use onbrick::sim::{Bridge, Errors, Fault, Physics, RobotModel, StartPose, World, WorldPhysics};
use proptest::prelude::*;

const LEFT: usize = 1;
const RIGHT: usize = 3;
const HEAD: usize = 0;
const STEPS_PER_S: usize = 500;

fn world(text: &str) -> World {
    World::parse("test.toml", text.as_bytes()).unwrap_or_else(|findings| panic!("{findings}")).0
}

fn ideal(text: &str) -> WorldPhysics {
    WorldPhysics::new(world(text).without_errors(), 1, 1).unwrap()
}

/// A proportional regulator with the back-EMF fed forward, for wheels at `left` and `right` degrees
/// a second.
struct Regulator {
    before: [i64; 4],
}

impl Regulator {
    fn new() -> Self {
        Self { before: [0; 4] }
    }

    fn step(
        &mut self,
        physics: &mut WorldPhysics,
        robot: usize,
        targets: &[(usize, f64)],
    ) -> [Bridge; 4] {
        let mut bridges = [Bridge::Brake; 4];
        for (out, dps) in targets {
            let edges = physics.edges(robot, *out);
            let speed = (edges - self.before[*out]) as f64 * 0.5 * STEPS_PER_S as f64;
            self.before[*out] = edges;
            let duty = dps / 8.5 + 0.02 * (dps - speed) + 5.0 * dps.signum();
            bridges[*out] = Bridge::Duty(duty.clamp(-100.0, 100.0) as i32);
        }
        bridges
    }
}

fn drive(physics: &mut WorldPhysics, seconds: f64, targets: &[(usize, f64)]) {
    let mut regulator = Regulator::new();
    for out in 0..4 {
        regulator.before[out] = physics.edges(0, out);
    }
    for _ in 0..(seconds * STEPS_PER_S as f64) as usize {
        let bridges = regulator.step(physics, 0, targets);
        physics.step(&[bridges]);
    }
}

#[test]
fn a_robot_drives_a_metre_straight_ahead() {
    let mut physics = ideal("name = \"t\"\n");
    let edges = (720.0 / 0.188976) as i64;
    let mut steps = 0;
    while physics.edges(0, LEFT) < edges {
        let duty = Bridge::Duty(40);
        physics.step(&[[Bridge::Coast, duty, Bridge::Coast, duty]]);
        steps += 1;
        assert!(steps < 20 * STEPS_PER_S, "not there after 20 s");
    }
    let truth = physics.truth(0).unwrap();
    assert!((truth.x_m - 1.0).abs() < 0.002, "{truth:?}");
    assert!(truth.y_m.abs() < 1e-6 && truth.heading_rad.abs() < 1e-6, "{truth:?}");
    assert!((truth.travelled_m - truth.x_m).abs() < 1e-6, "{truth:?}");
}

#[test]
fn a_robot_spins_on_the_spot_and_the_gyro_counts_clockwise() {
    let mut physics = ideal("name = \"t\"\n");
    drive(&mut physics, 3.0, &[(LEFT, -100.0), (RIGHT, 100.0)]);
    let truth = physics.truth(0).unwrap();
    let [left, right] = truth.wheels_rad;
    let expected = (right - left) * 0.188976 / std::f64::consts::TAU / 0.1143;
    assert!(truth.heading_rad > 2.0, "anticlockwise: {truth:?}");
    assert!((truth.heading_rad - expected).abs() < 0.01, "{truth:?}, expected {expected}");
    assert!(libm::hypot(truth.x_m, truth.y_m) < 0.002, "{truth:?}");
    let gyro = physics.measure(0, 3, "GYRO-ANG")[0];
    assert!(
        (f64::from(gyro) + truth.heading_rad.to_degrees()).abs() <= 1.0,
        "gyro {gyro}, {truth:?}"
    );
}

#[test]
fn the_head_turns_the_other_way_and_a_third_as_far() {
    let mut physics = ideal("name = \"t\"\n");
    while physics.edges(0, HEAD) < 480 {
        physics.step(&[[Bridge::Duty(40), Bridge::Brake, Bridge::Brake, Bridge::Brake]]);
    }
    let head_deg = physics.truth(0).unwrap().head_rad.to_degrees();
    assert!((head_deg + 80.0).abs() < 1.0, "{head_deg}");
}

const WALL_AHEAD: &str = "name = \"t\"\n[[wall]]\npoints = [[0.5508, -2.0], [0.5508, 2.0]]\n";

#[test]
fn half_a_metre_before_a_wall_the_ultrasonic_reads_half_a_metre() {
    let mut physics = ideal(WALL_AHEAD);
    assert_eq!(physics.measure(0, 0, "US-DIST-CM")[0], 500);
    assert_eq!(physics.measure(0, 0, "US-DIST-IN")[0], 197);
    for (echo, mean_mm, most_mm, lost_of_2000) in
        [("lobe", 486, 8, 1..=9), ("cone", 502, 15, 5..=45)]
    {
        let text = format!("{WALL_AHEAD}[robot]\necho = \"{echo}\"\n");
        let mut noisy = WorldPhysics::new(world(&text), 1, 3).unwrap();
        let readings: Vec<i32> = (0..2000).map(|_| noisy.measure(0, 0, "US-DIST-CM")[0]).collect();
        let near = readings.iter().filter(|mm| (**mm - mean_mm).abs() <= most_mm).count();
        let lost = readings.iter().filter(|mm| **mm == 2550).count();
        assert!(
            near + lost >= 1985 && lost_of_2000.contains(&lost),
            "{echo}: {near} near, {lost} lost of 2000"
        );
    }
}

#[test]
fn a_wall_too_near_or_too_far_or_too_oblique_gives_no_echo_in_a_cone() {
    let wall_at = |x: f64| {
        format!(
            "name = \"t\"\n[[wall]]\npoints = [[{x}, -9.0], [{x}, 9.0]]\n[robot]\necho = \"cone\"\n"
        )
    };
    assert_eq!(ideal(&wall_at(0.12)).measure(0, 0, "US-DIST-CM")[0], 69);
    let close = wall_at(0.0808) + "front_m = 0.06\n";
    assert_eq!(ideal(&close).measure(0, 0, "US-DIST-CM")[0], 2550, "3 cm");
    assert_eq!(ideal(&wall_at(2.59)).measure(0, 0, "US-DIST-CM")[0], 2539);
    assert_eq!(ideal(&wall_at(2.7)).measure(0, 0, "US-DIST-CM")[0], 2550);
    // Met at 40 degrees the ray at the cone's edge is near enough to the normal; at 50 degrees none
    // is.
    let oblique = |deg: f64| {
        let mut physics = ideal(&wall_at(0.6));
        physics.carry(0, StartPose { x_m: 0.0, y_m: 0.0, heading_rad: deg.to_radians() });
        physics.measure(0, 0, "US-DIST-CM")[0]
    };
    assert!(oblique(40.0) < 750, "{}", oblique(40.0));
    assert_eq!(oblique(50.0), 2550);
}

#[test]
fn wheels_stall_at_a_wall_and_the_bumper_closes() {
    let mut physics = ideal("name = \"t\"\n[[wall]]\npoints = [[0.3, -1.0], [0.3, 1.0]]\n");
    assert_eq!(physics.measure(0, 1, "TOUCH")[0], 0);
    let push = [Bridge::Coast, Bridge::Duty(100), Bridge::Coast, Bridge::Duty(100)];
    for _ in 0..2 * STEPS_PER_S {
        physics.step(&[push]);
    }
    let truth = physics.truth(0).unwrap();
    assert!(truth.touching && (truth.x_m - 0.21).abs() < 0.001, "{truth:?}");
    assert_eq!(physics.measure(0, 1, "TOUCH")[0], 1);
    let before = physics.edges(0, LEFT);
    for _ in 0..STEPS_PER_S {
        physics.step(&[push]);
    }
    let moved = physics.edges(0, LEFT) - before;
    assert!(moved.abs() <= 2, "stalled wheels moved {moved} edges");
    let (volts, amperes) = physics.battery(0);
    assert!(amperes > 2.0 && volts < 7.3, "stalled motors draw {amperes} A at {volts} V");
}

#[test]
fn on_a_slippery_floor_the_wheels_spin_at_a_wall() {
    let text =
        "name = \"t\"\n[robot]\ngrip_n = 3.0\n[[wall]]\npoints = [[0.3, -1.0], [0.3, 1.0]]\n";
    let mut physics = ideal(text);
    drive(&mut physics, 3.0, &[(LEFT, 300.0), (RIGHT, 300.0)]);
    let truth = physics.truth(0).unwrap();
    assert!((truth.x_m - 0.21).abs() < 0.001 && truth.wheels_rad[0] > 10.0, "{truth:?}");
}

#[test]
fn a_blocked_motor_stands_and_the_robot_turns_round_it() {
    let mut physics = ideal("name = \"t\"\n");
    physics.fail(0, Fault::BlockedMotor(LEFT));
    drive(&mut physics, 1.0, &[(LEFT, 200.0), (RIGHT, 200.0)]);
    let truth = physics.truth(0).unwrap();
    assert!(truth.wheels_rad[0].abs() < 0.01 && truth.heading_rad > 0.5, "{truth:?}");
    physics.fail(0, Fault::FreedMotor(LEFT));
    drive(&mut physics, 1.0, &[(LEFT, 200.0), (RIGHT, 200.0)]);
    assert!(physics.truth(0).unwrap().wheels_rad[0] > 1.0);
}

#[test]
fn a_coasting_robot_rolls_out_and_never_gains_speed() {
    let mut physics = ideal("name = \"t\"\n");
    drive(&mut physics, 1.0, &[(LEFT, 300.0), (RIGHT, 300.0)]);
    let mut speed = physics.truth(0).unwrap().speed_mps;
    assert!(speed > 0.1, "{speed}");
    for _ in 0..5 * STEPS_PER_S {
        physics.step(&[[Bridge::Coast; 4]]);
        let next = physics.truth(0).unwrap().speed_mps;
        assert!(next <= speed + 1e-9, "{speed} became {next}");
        speed = next;
    }
    assert!(speed.abs() < 1e-6, "{speed}");
}

#[test]
fn the_colour_sensor_sees_the_line_blend_at_its_edge_and_the_table_end() {
    let text = "name = \"t\"\n[floor]\ncolour = \"white\"\ntable = [[-1, -1], [1, -1], [1, 1], \
                [-1, 1]]\n\
                [[line]]\npoints = [[0.17, -0.5], [0.17, 0.5]]\nwidth_m = 0.04\n\
                colour = \"black\"\n";
    let mut physics = ideal(text);
    let mut look = |x_m: f64| {
        physics.carry(0, StartPose { x_m, y_m: 0.0, heading_rad: 0.0 });
        (physics.measure(0, 2, "COL-REFLECT")[0], physics.measure(0, 2, "COL-COLOR")[0])
    };
    assert_eq!(look(0.0), (75, 6));
    assert_eq!(look(0.10), (7, 1));
    let (edge, _) = look(0.08);
    assert!((25..60).contains(&edge), "half on the line: {edge}");
    assert_eq!(look(0.95), (0, 0), "beyond the table");
}

#[test]
fn the_infrared_sensor_has_its_own_scale_a_remote_and_a_beacon() {
    let text = "name = \"t\"\n[robot.ports]\nin1 = \"infrared\"\n[beacon]\nat = [0.4, 0.4]\n\
                channel = 2\n\
                [[remote]]\nat_s = 1.0\nfor_s = 1.0\nchannel = 3\ncode = 5\n\
                [[wall]]\npoints = [[0.5, -2.0], [0.5, 2.0]]\n";
    let mut physics = ideal(text);
    let near = physics.measure(0, 0, "IR-PROX")[0];
    assert!((65..80).contains(&near), "0.45 m reads {near}");
    assert_eq!(physics.measure(0, 0, "IR-REMOTE")[..4], [0, 0, 0, 0]);
    for _ in 0..STEPS_PER_S + STEPS_PER_S / 2 {
        physics.step(&[[Bridge::Brake; 4]]);
    }
    assert_eq!(physics.measure(0, 0, "IR-REMOTE")[..4], [0, 0, 5, 0]);
    let seek = physics.measure(0, 0, "IR-SEEK");
    assert!(
        seek[2] < 0 && (20..32).contains(&seek[3]),
        "to the left, about half a metre: {seek:?}"
    );
    assert_eq!((seek[0], seek[1]), (0, -128));
}

#[test]
fn two_robots_see_and_stop_each_other() {
    let text =
        "name = \"t\"\n[[start]]\nat = [0.0, 0.0]\n[[start]]\nat = [0.8, 0.0]\nheading_deg = 180\n";
    let mut physics = WorldPhysics::new(world(text).without_errors(), 2, 1).unwrap();
    let seen = physics.measure(0, 0, "US-DIST-CM")[0];
    assert!((seen - 659).abs() <= 1, "0.8 - 0.0508 - 0.09 m, {seen}");
    assert_eq!(physics.measure(1, 0, "US-LISTEN")[0], 1);
    let push = [Bridge::Coast, Bridge::Duty(60), Bridge::Coast, Bridge::Duty(60)];
    for _ in 0..4 * STEPS_PER_S {
        physics.step(&[push, push]);
    }
    let (a, b) = (physics.truth(0).unwrap(), physics.truth(1).unwrap());
    assert!(((b.x_m - a.x_m) - 0.18).abs() < 0.002 && a.touching && b.touching, "{a:?} {b:?}");
    assert!(
        WorldPhysics::new(world(text), 3, 1)
            .unwrap_err()
            .to_string()
            .contains("2 start poses, not 3")
    );
}

#[test]
fn mistakes_in_a_world_have_their_places() {
    let cases: &[(&str, &str)] = &[
        ("", "`name` is missing"),
        ("name = 3\n", "`name` must be text"),
        ("name = \"t\"\nwals = 1\n", "did you mean `wall`?"),
        ("name = \"t\"\nwall = 3\n", "must be a list"),
        ("name = \"t\"\n[[wall]]\npoints = [[0, 0]]\n", "it takes 2 to"),
        ("name = \"t\"\n[[wall]]\npoints = [[0, nan], [1, 1]]\n", "NaN"),
        ("name = \"t\"\n[[wall]]\npoints = [[0, inf], [1, 1]]\n", "inf"),
        ("name = \"t\"\n[[wall]]\npoints = [[0], [1, 1]]\n", "it takes 2"),
        ("name = \"t\"\n[[block]]\nat = [1, 1]\nsize_m = [-0.4, 0.2]\n", "is -0.4"),
        ("name = \"t\"\n[[circle]]\nat = [1, 1]\nradius_m = 0\n", "is 0"),
        ("name = \"t\"\n[[block]]\nat = [0, 0]\nsize_m = [2, 2]\n", "starts inside a wall"),
        ("name = \"t\"\n[[circle]]\nat = [0, 0]\nradius_m = 3.0\n", "starts inside a wall"),
        ("name = \"t\"\n[[wall]]\npoints = [[0.05, -1], [0.05, 1]]\n", "starts inside a wall"),
        ("name = \"t\"\n[[wall]]\npoints = [[-5, 0], [1, 0]]\n", "starts inside a wall"),
        ("name = \"t\"\n[[wall]]\npoints = [[-0.01, 0], [0.01, 0]]\n", "starts inside a wall"),
        ("name = \"t\"\n[[start]]\nat = [0, 0]\n[[start]]\nat = [0.1, 0]\n", "same place"),
        ("name = \"t\"\n[floor]\ntable = [[1, 1], [2, 1], [2, 2]]\n", "beyond the floor's edge"),
        (
            "name = \"t\"\n[[line]]\npoints = [[0, 0], [1, 1]]\ncolour = \"blak\"\n",
            "did you mean `black`?",
        ),
        ("name = \"t\"\n[robot]\nmass_kg = 0\n", "is 0"),
        ("name = \"t\"\n[robot]\nleft = \"outD\"\n", "share an output port"),
        ("name = \"t\"\n[robot]\ncorner_m = 0.5\n", "rounder than the robot"),
        ("name = \"t\"\n[robot]\nhead_gear = [0, 36]\n", "counts teeth: each number is at least 1"),
        ("name = \"t\"\n[robot.ports]\nin1 = \"sonar\"\n", "it can be"),
        ("name = \"t\"\n[robot.errors]\ngyro_drift = 1\n", "did you mean"),
        ("name = \"t\"\n[[remote]]\nat_s = 1\ncode = 99\n", "is 99"),
    ];
    for (text, expected) in cases {
        let error = World::parse("world.toml", text.as_bytes()).expect_err(text).to_string();
        assert!(error.contains(expected) && error.contains("world.toml:"), "{text}\ngave: {error}");
    }
    let many = format!("name = \"t\"\n{}", "[[circle]]\nat = [9, 9]\nradius_m = 1\n".repeat(2001));
    assert!(World::parse("w", many.as_bytes()).unwrap_err().to_string().contains("at most 2000"));
}

#[test]
fn a_robot_that_starts_outside_the_room_is_warned_of() {
    const ROOM: &str = "name = \"t\"\n[[wall]]\nclosed = true\n\
                        points = [[-1, -1], [1, -1], [1, 1], [-1, 1]]\n";
    let warned = |more: &str| {
        let text = format!("{ROOM}{more}");
        World::parse("world.toml", text.as_bytes()).unwrap().1.to_string()
    };
    for inside in ["", "[[start]]\nat = [0.5, 0]\n"] {
        assert_eq!(warned(inside), "");
    }
    let found = warned("[[start]]\nat = [0, 0]\n[[start]]\nat = [3, 0]\n");
    assert!(
        found.starts_with("warning: the robot at (3, 0) starts outside each closed wall")
            && found.contains("world.toml:7:"),
        "{found}"
    );
}

fn drive_and_measure(
    world: &World,
    robots: usize,
    seed: u64,
    duties: &[(i32, i32, i32)],
) -> Vec<i64> {
    let mut physics = WorldPhysics::new(world.clone(), robots, seed).unwrap();
    let mut bytes = Vec::new();
    for (head, left, right) in duties {
        for step in 0..100 {
            let row =
                [Bridge::Duty(*head), Bridge::Duty(*left), Bridge::Coast, Bridge::Duty(*right)];
            physics.step(&vec![row; robots]);
            for robot in 0..robots {
                let truth = physics.truth(robot).unwrap();
                let clearance = physics.clearance(robot).unwrap();
                assert!(clearance > -0.001, "robot {robot} is {clearance} m in a wall: {truth:?}");
                let sum =
                    truth.x_m + truth.y_m + truth.heading_rad + truth.speed_mps + truth.head_rad;
                assert!(sum.is_finite(), "{truth:?}");
                bytes.push(truth.x_m.to_bits().cast_signed());
                if step % 50 == 0 {
                    for (input, mode) in
                        [(0, "US-DIST-CM"), (1, "TOUCH"), (2, "COL-REFLECT"), (3, "GYRO-G&A")]
                    {
                        bytes.extend(physics.measure(robot, input, mode).map(i64::from));
                    }
                    bytes.extend([physics.edges(robot, HEAD), physics.edges(robot, LEFT)]);
                }
            }
        }
    }
    bytes
}

fn random_world() -> impl Strategy<Value = World> {
    let block = (-1.2..1.2, -1.2..1.2, 0.05..0.5, 0.05..0.3, -90.0..90.0);
    let circle = (-1.2..1.2, -1.2..1.2, 0.02..0.2);
    (prop::collection::vec(block, 0..6), prop::collection::vec(circle, 0..4)).prop_map(
        |(blocks, circles)| {
            let mut text =
            "name = \"t\"\n[[wall]]\npoints = [[-1, -1], [1, -1], [1, 1], [-1, 1]]\nclosed = true\n"
                .to_owned();
            for (x, y, w, h, turn) in blocks
                .into_iter()
                .filter(|b: &(f64, f64, f64, f64, f64)| libm::hypot(b.0, b.1) > 0.45)
            {
                text += &format!(
                    "[[block]]\nat = [{x}, {y}]\nsize_m = [{w}, {h}]\nturn_deg = {turn}\n"
                );
            }
            for (x, y, r) in
                circles.into_iter().filter(|c: &(f64, f64, f64)| libm::hypot(c.0, c.1) > 0.4)
            {
                text += &format!("[[circle]]\nat = [{x}, {y}]\nradius_m = {r}\n");
            }
            world(&text)
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn no_body_gets_into_a_wall_and_no_number_is_lost(
        world in random_world(),
        seed in 0_u64..1000,
        duties in prop::collection::vec((-100..=100, -100..=100, -100..=100), 1..24),
    ) {
        drive_and_measure(&world, 1, seed, &duties);
    }

    #[test]
    fn an_echo_is_never_nearer_than_the_nearest_surface(
        world in random_world(),
        heading in -3.2..3.2,
    ) {
        let mut physics = WorldPhysics::new(world.without_errors(), 1, 0).unwrap();
        physics.carry(0, StartPose { x_m: 0.0, y_m: 0.0, heading_rad: heading });
        let (x, y) = (0.0508 * libm::cos(heading), 0.0508 * libm::sin(heading));
        let nearest = physics.world().distance_to_nearest_surface(x, y);
        if let Some(echo) = physics.echo(0) {
            prop_assert!(echo >= nearest - 1e-9, "echo {echo}, nearest {nearest}");
        }
    }

    #[test]
    fn any_bytes_are_a_world_or_findings(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let _ = World::parse("w", &bytes);
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_does_not() {
    let world = World::named("two-arenas").unwrap();
    let duties = [(30, 50, 50), (-30, 60, -20), (0, 100, 100), (20, -40, 70), (0, 100, 95)];
    let first = drive_and_measure(&world, 2, 5, &duties);
    assert_eq!(first, drive_and_measure(&world, 2, 5, &duties));
    assert_ne!(first, drive_and_measure(&world, 2, 6, &duties));
}

#[test]
fn the_arena_closes_all_round_and_the_line_starts_under_the_sensor() {
    for name in ["arena", "rooms", "cylinders", "corridor"] {
        let mut physics =
            WorldPhysics::new(World::named(name).unwrap().without_errors(), 1, 1).unwrap();
        let echoes = (0..72).filter(|step| {
            let heading_rad = f64::from(*step) * std::f64::consts::TAU / 72.0;
            physics.carry(0, StartPose { x_m: 0.0, y_m: 0.0, heading_rad });
            physics.measure(0, 0, "US-DIST-CM")[0] < 2550
        });
        let count = echoes.count();
        assert!(count > 36, "{name}: {count} of 72 directions echo");
    }
    let mut line = WorldPhysics::new(World::named("line").unwrap().without_errors(), 1, 1).unwrap();
    assert_eq!(line.measure(0, 2, "COL-COLOR")[0], 1);
    let mut lost = WorldPhysics::new(World::named("open").unwrap(), 1, 1).unwrap();
    assert_eq!(lost.measure(0, 0, "US-DIST-CM")[0], 2550);
}

#[test]
fn a_robot_that_drives_over_the_edge_has_fallen() {
    let mut physics =
        WorldPhysics::new(World::named("table").unwrap().without_errors(), 1, 1).unwrap();
    drive(&mut physics, 1.0, &[(LEFT, 300.0), (RIGHT, 300.0)]);
    assert!(!physics.truth(0).unwrap().fallen);
    drive(&mut physics, 8.0, &[(LEFT, 300.0), (RIGHT, 300.0)]);
    assert!(physics.truth(0).unwrap().fallen);
}

#[test]
#[cfg_attr(target_arch = "arm", ignore = "how fast it is, without floats, says nothing")]
fn two_minutes_of_one_robot_pass_in_a_moment() {
    let mut physics = WorldPhysics::new(World::named("arena").unwrap(), 1, 1).unwrap();
    let clock = onbrick::clock::MonotonicClock;
    let start_ns = onbrick::clock::Clock::now_ns(&clock);
    for step in 0..120 * STEPS_PER_S {
        physics.step(&[[Bridge::Duty(20), Bridge::Duty(15), Bridge::Coast, Bridge::Duty(15)]]);
        if step % 50 == 0 {
            physics.measure(0, 0, "US-DIST-CM");
        }
    }
    let took_s = onbrick::clock::seconds(onbrick::clock::Clock::now_ns(&clock) - start_ns);
    println!("120 s of the arena took {took_s:.2} s, {:?}", physics.truth(0).unwrap());
    assert!(took_s < 60.0, "faster than life at least: {took_s} s");
}

#[test]
fn every_built_in_world_lets_its_robots_drive_about() {
    for name in World::names() {
        let world = World::named(name).unwrap_or_else(|| panic!("no world {name}"));
        let robots = world.starts().len();
        drive_and_measure(&world, robots, 1, &[(40, 80, 80); 10]);
        assert_eq!(world.robot(), &RobotModel::default(), "{name}");
    }
    assert_eq!(World::named("two-arenas").unwrap().starts()[1].x_m, 3.0);
    assert!(World::named("nowhere").is_none());
    assert_ne!(Errors::default(), Errors::NONE);
}
