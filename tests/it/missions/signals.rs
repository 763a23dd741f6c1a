//! Signals beyond those of the shipped missions: each decides how a mission continues, on the
//! simulated brick's own drivers.

use onbrick::behavior::{Capabilities, Mission};
use onbrick::clock::SECOND_NS;
use onbrick::robot::{BindError, Robot, RobotConfig};
use onbrick::runtime::{Source, StopReason};
use onbrick::senses::Channel;

use super::{Played, ROBOT, job, play, robot};
use crate::support::stage::Play;

/// A room without anything, but for what is added.
fn room(more: &str) -> String {
    format!(
        "name = \"room\"\n[[wall]]\npoints = [[-2, -2], [2, -2], [2, 2], [-2, 2]]\nclosed = true\n\
         [[start]]\nat = [0.0, 0.0]\n{more}"
    )
}

fn play_mission(mission: &str, robot: &str, world: &str) -> Played {
    play(|file| {
        let mut job = job("square", robot, ("room", world), 3, file);
        mission.clone_into(&mut job.mission.text);
        job
    })
}

/// A mission of one machine that goes through states on conditions.
fn steps(steps: &[(&str, &str)]) -> String {
    let mut text =
        "name = \"steps\"\ntime_limit_s = 20\n[machine.m]\nstart = \"s0\"\nfinal = \"end\"\n"
            .to_owned();
    for (at, (doing, when)) in steps.iter().enumerate() {
        let go = if at + 1 == steps.len() { "end".to_owned() } else { format!("s{}", at + 1) };
        text.push_str(&format!(
            "[machine.m.state.s{at}]\ndo = {{ {doing} }}\n\
             next = [{{ when = \"{when}\", go = \"{go}\" }}]\n"
        ));
    }
    text + "[machine.m.state.end]\n"
}

const STILL: &str = "stop = \"brake\"";

#[test]
fn the_gyros_rate_says_how_fast_the_robot_turns_and_leaves_the_heading_as_good() {
    let mission = steps(&[
        (STILL, "gyro_dps > -3 and gyro_dps < 3 and state_s > 0.5"),
        ("turn_dps = 60", "gyro_dps > 50 and gyro_dps < 70 and state_turn_deg > 120"),
        ("turn_dps = -60", "gyro_dps < -50 and gyro_dps > -70 and state_turn_deg < -120"),
    ]);
    let played = play_mission(&mission, ROBOT, &room(""));
    assert_eq!(played.ended.stop.reason, StopReason::Finished, "{}", played.ended);
    let run = played.run();
    let pose = run.poses.last().unwrap().pose;
    let truth = played.truths.last().unwrap();
    assert!((pose.heading_rad - truth.heading_rad).abs() < 0.06, "{pose:?}, truly {truth:?}");
    assert!(run.senses.iter().all(|senses| senses.get(Channel::GyroRate).is_some()));
}

#[test]
fn red_green_blue_and_the_light_around_tell_floors_apart() {
    let patch = "[floor]\ncolour = \"white\"\n[[patch]]\npoints = [[0.3, -0.5], [1, -0.5], [1, \
                 0.5], [0.3, 0.5]]\n\
                 colour = \"red\"\n";
    let drive = "forward_mps = 0.1";
    let mission = steps(&[
        (drive, "red_pct > 25 and green_pct > 25 and blue_pct > 25"),
        (drive, "red_pct > 2 * green_pct and red_pct > 2 * blue_pct"),
    ]);
    let played = play_mission(&mission, &robot(), &room(patch));
    assert_eq!(played.ended.stop.reason, StopReason::Finished, "{}", played.ended);
    let at_m = played.truths.last().unwrap().x_m + 0.07;
    assert!((0.28..0.36).contains(&at_m), "red begins at 0.3 m, and was seen at {at_m}");

    let mission = steps(&[(STILL, "ambient_pct > 2 and ambient_pct < 20 and state_s > 0.2")]);
    let played = play_mission(&mission, &robot(), &room(patch));
    assert_eq!(played.ended.stop.reason, StopReason::Finished, "{}", played.ended);
}

#[test]
fn a_beacon_is_turned_to_and_driven_to_and_none_is_infinitely_far() {
    let infrared = "[robot]\nhead = \"none\"\n[robot.ports]\nin1 = \"infrared\"\n";
    let (wheels, _) = ROBOT.split_once("[head]").unwrap();
    let robot = format!("{wheels}\n[remote]\nport = \"in1\"\n");
    // To the left is positive, as everywhere.
    let mission = steps(&[
        (STILL, "beacon_heading > 5"),
        ("turn_dps = 30", "beacon_heading < 1 and beacon_heading > -1"),
        ("forward_mps = 0.1, turn_dps = \"beacon_heading\"", "beacon_pct < 20"),
    ]);
    let played = play_mission(
        &mission,
        &robot,
        &room(&format!("[beacon]\nat = [1.2, 0.8]\nchannel = 1\n{infrared}")),
    );
    assert_eq!(played.ended.stop.reason, StopReason::Finished, "{}", played.ended);
    let end = played.truths.last().unwrap();
    let left_m = libm::hypot(1.2 - end.x_m, 0.8 - end.y_m);
    assert!((0.3..0.6).contains(&left_m), "{left_m} m away");

    let mission =
        steps(&[(STILL, "beacon_pct > 1000 and not (beacon_heading > 0) and state_s > 0.5")]);
    let played = play_mission(&mission, &robot, &room(infrared));
    assert_eq!(
        played.ended.stop.reason,
        StopReason::TimeLimit,
        "an unknown heading leaves a condition unknown"
    );
    let mission = steps(&[(STILL, "beacon_pct > 1000 and state_s > 0.5")]);
    let played = play_mission(&mission, &robot, &room(infrared));
    assert_eq!(played.ended.stop.reason, StopReason::Finished, "{}", played.ended);
}

#[test]
fn the_bricks_buttons_steer_a_mission() {
    let mut mission = steps(&[
        (STILL, "button_up"),
        ("turn_dps = 30", "button_left and not button_right"),
        (STILL, "not button_left and button_down"),
    ]);
    mission = mission.replace("time_limit_s = 20", "time_limit_s = 12");
    let press = |at_s: f64, button: &str| {
        format!("[[press]]\nat_s = {at_s}\nbutton = \"{button}\"\nfor_s = 0.3\n")
    };
    let scenario = [press(2.0, "up"), press(4.0, "left"), press(6.0, "down")].concat();
    let mut play = Play::of("square", "open", 1).scenario(&scenario);
    play.mission_toml = mission;
    let played = play.play().unwrap();
    assert_eq!(played.reason, StopReason::Finished);
    assert!((5.9..6.4).contains(&played.drove_s), "{} s", played.drove_s);
    let turned_rad = played.truth.heading_rad;
    assert!(
        (0.9..1.2).contains(&turned_rad),
        "30 degrees a second for 2 s, and turned {turned_rad}"
    );
}

#[test]
fn one_sensor_is_not_given_two_roles() {
    let (wheels, _) = ROBOT.split_once("[head]").unwrap();
    let robot = format!("{wheels}\n[range]\n[remote]\n");
    let (config, _) = RobotConfig::load("robot.toml", robot.as_bytes()).unwrap();
    let world =
        room("[robot]\nhead = \"none\"\n[robot.ports]\nin1 = \"none\"\nin4 = \"infrared\"\n");
    let (world, _) = onbrick::sim::World::parse("room", world.as_bytes()).unwrap();
    let physics = onbrick::sim::WorldPhysics::new(world, 1, 1).unwrap();
    let clock = std::sync::Arc::new(onbrick::clock::VirtualClock::default());
    let simulation = onbrick::sim::Simulation::new(clock, Box::new(physics), 1);
    let tree: std::sync::Arc<dyn onbrick::ev3dev::Tree> = simulation.brick(0);
    let refused = Robot::bind(&tree, &config, &[]).unwrap_err();
    assert!(matches!(refused, BindError::Shared { .. }), "{refused}");
    assert_eq!(
        refused.to_string(),
        "remote and range are both the lego-ev3-ir on in4: name another port for one of them"
    );
}

#[test]
fn a_simulated_robot_has_its_sensors_where_its_file_says() {
    let (wheels, _) = ROBOT.split_once("[head]").unwrap();
    let robot = format!(
        "{wheels}\n[touch]\nport = \"in3\"\n[sensor.rear]\nport = \"in2\"\nmeasures = \"touch\"\n\
         facing_deg = 180\n[sensor.side]\nport = \"in1\"\nmeasures = \"range_m\"\n\
         at_m = [0.0, 0.05]\nfacing_deg = 90\n"
    );
    let (config, _) = RobotConfig::load("robot.toml", robot.as_bytes()).unwrap();
    let world = Source { name: "room".to_owned(), text: room("") };
    let world = onbrick::simulated::furnished(world, &config).text;
    let beside = "sensor.side > 1.85 and sensor.side < 2.05";
    let mission = steps(&[
        ("forward_mps = 0.18", &format!("touch and not sensor.rear and {beside}")),
        ("forward_mps = -0.18", "sensor.rear and not touch"),
        ("drive_m = 0.3", "done"),
        ("turn_deg = -90", "done"),
        // Too far for an echo, which is infinite.
        (STILL, "sensor.side > 3"),
    ]);
    let mission = mission.replace("time_limit_s = 20", "time_limit_s = 60");
    let played = play_mission(&mission, &robot, &world);
    assert_eq!(played.ended.stop.reason, StopReason::Finished, "{}", played.ended);
}

#[test]
fn a_world_presses_the_bricks_buttons_and_pulls_its_plugs() {
    let world = room(
        "[[press]]\nat_s = 9\nbutton = \"up\"\n[[fault]]\nat_s = 12\nport = \"in1\"\n\
         kind = \"unplug\"\n",
    );
    let mission = steps(&[(STILL, "button_up"), (STILL, "time_s > 15 and range_m > 0")]);
    let played = play_mission(&mission, ROBOT, &world);
    assert_eq!(played.ended.stop.reason, StopReason::Lost(Channel::Range), "{}", played.ended);
    let run = played.run();
    let pressed = run.transitions.first().expect("a button was pressed");
    let since_ns = pressed.time_ns - run.info.as_ref().unwrap().start_ns;
    assert!((SECOND_NS..5 * SECOND_NS).contains(&since_ns), "{pressed:?}");
}

#[test]
fn two_sensors_of_a_kind_are_told_apart_by_their_names() {
    // A black patch that only the left eye comes over, and a bumper that nothing presses.
    let world = room(
        "[floor]\ncolour = \"white\"\n[[patch]]\npoints = [[0.3, 0], [1, 0], [1, 0.5], \
         [0.3, 0.5]]\ncolour = \"black\"\n[robot.ports]\nin1 = \"touch\"\nin2 = \"colour\"\n\
         [robot]\nhead = \"none\"\n[robot.sensors]\nin2.at_m = [0.07, 0.03]\nin3.at_m = [0.07, \
         -0.03]\n",
    );
    let (wheels, _) = ROBOT.split_once("[head]").unwrap();
    let robot = format!(
        "{wheels}\n[sensor.left_eye]\nport = \"in2\"\nmeasures = \"reflect_pct\"\n\
         [sensor.right_eye]\nport = \"in3\"\nmeasures = \"reflect_pct\"\n\
         [sensor.rear]\nmeasures = \"touch\"\n"
    );
    let mission = steps(&[(
        "forward_mps = 0.1",
        "sensor.left_eye < 30 and sensor.right_eye > 50 and not sensor.rear",
    )]);
    let played = play_mission(&mission, &robot, &world);
    assert_eq!(played.ended.stop.reason, StopReason::Finished, "{}", played.ended);
    let at_m = played.truths.last().unwrap().x_m + 0.07;
    assert!((0.28..0.36).contains(&at_m), "the patch begins at 0.3 m, and was seen at {at_m}");
    let run = played.run();
    let last = run.senses.last().unwrap();
    let value = |channel| last.get(channel).unwrap().value;
    assert!(value(Channel::Sensor0) < 30.0 && value(Channel::Sensor1) > 50.0, "{last:?}");
    assert_eq!(value(Channel::Sensor2), 0.0);
    // A sensor whose name the robot does not have, and one that is taken for another kind.
    for (condition, message) in [
        ("sensor.left_ey < 30", "the robot has no sensor named `left_ey`"),
        ("sensor.rear < 30", "takes a number"),
        ("sensor.left_eye", "compare it with something"),
    ] {
        let (config, _) = RobotConfig::load("robot.toml", robot.as_bytes()).unwrap();
        let text = steps(&[(STILL, condition)]);
        let read = Mission::parse("m.toml", text.as_bytes(), &config.capabilities());
        let error = read.unwrap_err().to_string();
        assert!(error.contains(message), "{condition}: {error}");
    }
    // Of a robot that is not known they are what the mission takes them for.
    let text = steps(&[(STILL, "sensor.rear and sensor.eye < 30")]);
    assert!(Mission::parse("m.toml", text.as_bytes(), &Capabilities::all()).is_ok());
}
