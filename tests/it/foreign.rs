//! Programs on third-party libraries, over a mounted brick: PyPI's `python-ev3dev2` and crates.io's
//! `ev3dev-lang-rust`, both unmodified.
//!
//! Each runs in a private view of the brick (`onbrick sim exec`), so that it takes this machine for
//! an EV3. What it says it did is compared with where the robot truly is. `demos` are programs as
//! people write them.

pub(crate) mod bench;
mod demos;
mod exec;

use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;
use std::process::Stdio;
use std::sync::Arc;

use nix::errno::Errno;
use onbrick::clock::{Clock, MILLISECOND_NS, MonotonicClock, VirtualClock};
use onbrick::ev3dev::{Access, Tree};
use onbrick::recording::Run;
use onbrick::sim::{Button, EventLayout, Mount, Options, Simulation, World, WorldPhysics};
use serde_json::{Value, json};

use self::bench::{Foreign, Simulator, Truth, example, no_namespaces, no_python, script};
use crate::drivers_bench::{Bench, InProcess};
use crate::mount::bench::{no_fuse, real_time};
use crate::support::real_time::{Pace, in_real_time};
use crate::support::tested_program;

/// Rolled by one turn of a wheel of the worlds' robot.
const WHEEL_M: f64 = 0.188_976;
const TRACK_M: f64 = 0.1143;

#[test]
fn programs_on_python_ev3dev2_drive_and_sense_as_their_documentation_says() {
    if no_namespaces() || no_python() {
        return;
    }
    let _alone = real_time();
    let programs = [
        ("ev3dev2_tank", "foreign-yard", check_tank as fn(&Pace, &Value, &Truth)),
        ("ev3dev2_differential", "foreign-yard", check_differential),
        ("ev3dev2_motors", "foreign-yard", check_motors),
        ("ev3dev2_sensors", "foreign-yard", check_sensors),
        ("ev3dev2_sonar", "foreign-yard", check_sonar),
        ("ev3dev2_infrared", "foreign-infrared", check_infrared),
    ];
    // All at once: each waits for its own robot most of the time.
    std::thread::scope(|scope| {
        for (name, world, check) in programs {
            scope.spawn(move || {
                in_real_time(name, |pace| {
                    let simulator = Simulator::start(pace, world);
                    let program =
                        Foreign::start(pace, name, &simulator.root(), &["python3", &script(name)]);
                    let Some(said) = program.json(pace) else { return };
                    let truth = simulator.truth();
                    println!("{truth:?}");
                    pace.ensure(!truth.fallen, || format!("{truth:?}"));
                    check(pace, &said, &truth);
                });
            });
        }
    });
}

/// Two turns of the wheels ahead, a quarter to the right, two turns more.
fn check_tank(pace: &Pace, said: &Value, truth: &Truth) {
    assert_eq!(said["start"], json!([0, 0]));
    let quarter_deg = 90.0 * TRACK_M / WHEEL_M * std::f64::consts::PI;
    let ahead = 720.0;
    for (step, left, right, within) in [
        ("ahead", ahead, ahead, 3.0),
        ("turned", ahead + quarter_deg, ahead - quarter_deg, 4.0),
        ("timed", ahead + quarter_deg + 360.0, ahead - quarter_deg + 360.0, 20.0),
        ("end", ahead + quarter_deg + 720.0, ahead - quarter_deg + 720.0, 24.0),
    ] {
        pace.near(&format!("left at {step}"), float(&said[step][0]), left, within);
        pace.near(&format!("right at {step}"), float(&said[step][1]), right, within);
    }
    pace.same("holding", &said["holding"], &json!([true, true]));
    pace.same("state of what coasts", &said["state"], &json!([[], []]));
    // What the motors say is what the wheels did.
    pace.near("left wheel", truth.left_deg, float(&said["end"][0]), 4.0);
    pace.near("right wheel", truth.right_deg, float(&said["end"][1]), 4.0);
    pace.near("heading", truth.heading_deg, -90.0, 5.0);
    pace.near("x", truth.x_m, 2.0 * WHEEL_M, 0.04);
    pace.near("y", truth.y_m, -2.0 * WHEEL_M, 0.04);
}

/// The odometry of the library against the truth, in its millimetres; and both roughly against the
/// plan, since a motor that holds is still being pulled back when the next motion begins.
fn check_differential(pace: &Pace, said: &Value, truth: &Truth) {
    let arc_m = 0.25;
    let plan = [
        ("ahead", [0.3, 0.0, 0.0]),
        ("left", [0.3, 0.0, 90.0]),
        ("arc", [0.3 + arc_m, arc_m, 0.0]),
        ("right", [0.3 + arc_m, arc_m, -90.0]),
        ("there", [0.2, 0.0, libm::atan2(-0.25, -0.35).to_degrees()]),
        ("end", [0.2, 0.0, 0.0]),
    ];
    for (step, [x_m, y_m, heading_deg]) in plan {
        pace.near(&format!("x of {step}"), float(&said[step][0]) / 1e3, x_m, 0.035);
        pace.near(&format!("y of {step}"), float(&said[step][1]) / 1e3, y_m, 0.035);
        pace.near(&format!("heading of {step}"), float(&said[step][2]), heading_deg, 8.0);
    }
    pace.near("true x", truth.x_m, float(&said["end"][0]) / 1e3, 0.02);
    pace.near("true y", truth.y_m, float(&said["end"][1]) / 1e3, 0.02);
    pace.near("true heading", truth.heading_deg, float(&said["end"][2]), 5.0);
    let way_m = 0.3 + FRAC_PI_2 * arc_m + libm::hypot(0.35, 0.25);
    pace.near("way", truth.travelled_m, way_m, 0.05);
}

fn check_motors(pace: &Pace, said: &Value, truth: &Truth) {
    let motors = json!([
        ["ev3-ports:outA", "lego-ev3-m-motor"],
        ["ev3-ports:outB", "lego-ev3-l-motor"],
        ["ev3-ports:outD", "lego-ev3-l-motor"]
    ]);
    assert_eq!(said["motors"], motors);
    assert_eq!(said["nothing_in_c"], "LargeMotor(ev3-ports:outC) is not connected.");
    let commands = [
        "run-forever",
        "run-to-abs-pos",
        "run-to-rel-pos",
        "run-timed",
        "run-direct",
        "stop",
        "reset",
    ];
    let stops = ["coast", "brake", "hold"];
    assert_eq!(said["found"], json!(["ev3-ports:outA", 360, 1560, commands, stops, "normal"]));
    // Position afterwards, and how long it took; at most a few degrees beyond, which hold pulls
    // back.
    let step = |name: &str, position: f64, within: f64, seconds: f64, within_s: f64| {
        pace.near(&format!("position after {name}"), float(&said[name][0]), position, within);
        pace.near(&format!("duration of {name}"), float(&said[name][1]), seconds, within_s);
    };
    step("degrees", 90.0, 12.0, 0.3, 0.25);
    step("rotations_back", -90.0, 12.0, 1.1, 0.3);
    step("seconds", 90.0, 12.0, 1.05, 0.2);
    step("to_position", 0.0, 12.0, 0.6, 0.3);
    pace.same("state", &said["holding"], &json!(["holding"]));
    pace.same("it was seen to run", &said["wait_running"], &true);
    step("wait_end", 97.0, 15.0, 0.5, 0.2);
    pace.same("it ended", &said["wait_end"][2], &true);
    pace.near("300 ms", float(&said["wait_too_long"][1]), 0.35, 0.15);
    pace.same("it had ended", &said["wait_too_long"][2], &false);
    pace.near("a fifth of the speed", float(&said["speed"]), 312.0, 40.0);
    pace.same("off", &(&said["wait_off"][2], &said["off"]), &(&json!(true), &json!([])));
    assert_eq!(said["duty"], -40);
    pace.same("it ramps", &said["ramping"][0], &true);
    let ramped = float(&said["ramping"][1]);
    pace.near("speed 0.3 s into a ramp that takes 0.77 s to 800", ramped, 350.0, 250.0);
    assert_eq!(
        said["too_fast"],
        "The given speed value b'1561' was out of range. Max speed: +/-1560"
    );
    pace.near("45 degrees, inversed", float(&said["inversed"]), 45.0, 14.0);
    assert_eq!([&said["reset"][0], &said["reset"][2]], [&json!("normal"), &json!([])]);
    // It coasts from then on: what is left of its last motion may turn it by a count or two.
    let rolled = float(&said["reset"][1]);
    assert!(rolled.abs() <= 3.0, "{rolled} counts after a reset");
    pace.near("nothing drove", truth.travelled_m, 0.0, 1e-9);
}

fn check_sensors(pace: &Pace, said: &Value, truth: &Truth) {
    let sensors = json!([
        ["ev3-ports:in1", "lego-ev3-us"],
        ["ev3-ports:in2", "lego-ev3-touch"],
        ["ev3-ports:in3", "lego-ev3-color"],
        ["ev3-ports:in4", "lego-ev3-gyro"]
    ]);
    assert_eq!(said["sensors"], sensors);
    let modes = &said["modes"];
    let touch = &modes["lego-ev3-touch"];
    assert_eq!(
        touch,
        &json!({ "TOUCH": [[0], "", 0, "s32", [0, 0, 0, 0]] }),
        "it touches nothing yet"
    );
    let eye = &modes["lego-ev3-color"];
    for (mode, values, units, format) in [
        ("COL-REFLECT", 1, "pct", "s8"),
        ("COL-AMBIENT", 1, "pct", "s8"),
        ("COL-COLOR", 1, "col", "s8"),
        ("REF-RAW", 2, "", "s16"),
        ("RGB-RAW", 3, "", "s16"),
        ("COL-CAL", 3, "", "u16"),
    ] {
        let [found, found_units, decimals, found_format, _] =
            [0, 1, 2, 3, 4].map(|part| &eye[mode][part]);
        assert_eq!(found.as_array().unwrap().len(), values, "{mode}");
        assert_eq!(
            (found_units, decimals, found_format),
            (&json!(units), &json!(0), &json!(format))
        );
    }
    pace.same("white", &eye["COL-COLOR"][0], &json!([6]));
    pace.near("white reflects", float(&said["reflected"]), 75.0, 4.0);
    pace.same("colour", &said["colour"], &"White");
    pace.ensure((0..3).all(|part| float(&said["rgb"][part]) > 300.0), || said["rgb"].to_string());
    pace.near("saturation after the white balance", float(&said["hsv"][1]), 0.0, 0.05);
    let gyro = &modes["lego-ev3-gyro"];
    for (mode, values, units) in [
        ("GYRO-ANG", 1, "deg"),
        ("GYRO-RATE", 1, "d/s"),
        ("GYRO-FAS", 1, ""),
        ("GYRO-G&A", 2, ""),
        ("GYRO-CAL", 4, ""),
        ("TILT-RATE", 1, "d/s"),
        ("TILT-ANG", 1, "deg"),
    ] {
        pace.same(
            &format!("{mode} of a robot that stands"),
            &gyro[mode][0],
            &json!(vec![0; values]),
        );
        assert_eq!(gyro[mode][1], units, "{mode}");
    }
    pace.same("angle and rate", &said["angle_and_rate"], &json!([0, 0]));
    assert_eq!(said["pressed"], 0);
    // White, then the red strip, then it stopped at the black one, whose edge is at 0.7 m; the
    // sensor is 0.07 m ahead.
    pace.same("colours on the way", &said["colours_on_the_way"], &json!([6, 5]));
    pace.near("x at the black strip", truth.x_m, 0.665, 0.045);
    // Clockwise counts up on the gyro.
    pace.same("angle after a reset", &said["reset_angle"], &0);
    pace.near("angle", float(&said["angle"]), 90.0, 5.0);
    pace.near("true heading", truth.heading_deg, -90.0, 5.0);
    pace.near("gyro against the truth", float(&said["angle"]), -truth.heading_deg, 4.0);
    // The wall is at −1.2 m, the robot's front 0.09 m ahead of its axle.
    pace.same("bumped", &(&said["bumped"], &said["pressed_at_wall"]), &(&json!(true), &json!(1)));
    pace.near("y at the wall", truth.y_m, -1.2 + 0.09, 0.02);
    pace.ensure(truth.touching || truth.speed_mps.abs() < 0.1, || format!("{truth:?}"));
}

fn check_sonar(pace: &Pace, said: &Value, truth: &Truth) {
    let true_cm = truth.echo_m.unwrap() * 100.0;
    // One in a hundred readings has no echo; of five, most have.
    let first: Vec<f64> = said["first_cm"].as_array().unwrap().iter().map(float).collect();
    let fits = |cm: &f64| (cm - true_cm).abs() < 5.0 || (cm - 255.0).abs() < 0.01;
    pace.ensure(first.iter().all(fits), || format!("{first:?}"));
    for (mode, units, decimals, expected) in [
        ("US-DIST-CM", "cm", 1, true_cm),
        ("US-DIST-IN", "in", 1, true_cm / 2.54),
        ("US-SI-CM", "cm", 1, true_cm),
        ("US-SI-IN", "in", 1, true_cm / 2.54),
        ("US-DC-CM", "cm", 1, true_cm),
        ("US-DC-IN", "in", 1, true_cm / 2.54),
    ] {
        let found = &said["modes"][mode];
        assert_eq!((&found[1], &found[2]), (&json!(units), &json!(decimals)), "{mode}");
        range(pace, mode, float(&found[0][0]) / 10.0, expected, units);
    }
    pace.same("US-LISTEN", &said["modes"]["US-LISTEN"], &json!([[0], "", 0]));
    range(pace, "distance_centimeters", float(&said["cm"]), true_cm, "cm");
    range(pace, "distance_inches", float(&said["inches"]), true_cm / 2.54, "in");
    range(pace, "distance_centimeters_ping", float(&said["ping_cm"]), true_cm, "cm");
    pace.same("hears another", &said["hears_another"], &false);
}

/// A measured range is near the true one, or the value that stands for no echo, which one in a
/// hundred is.
fn range(pace: &Pace, what: &str, found: f64, expected: f64, units: &str) {
    let (none, within) = if units == "cm" { (255.0, 5.0) } else { (100.4, 2.0) };
    let fits = (found - expected).abs() < within || (found - none).abs() < 0.1;
    pace.ensure(fits, || format!("{what}: {found}, not {expected} {units}"));
}

/// A wall 1.2 m ahead of the axle, the beacon at (0.6, 0.3) m on channel 2, code 5 (both up) on
/// channel 1.
fn check_infrared(pace: &Pace, said: &Value, _truth: &Truth) {
    assert_eq!(said["address"], "ev3-ports:in1");
    let modes = &said["modes"];
    assert_eq!((&modes["IR-PROX"][1], &modes["IR-SEEK"][1]), (&json!("pct"), &json!("pct")));
    pace.same("IR-REMOTE", &modes["IR-REMOTE"][0], &json!([5, 0, 0, 0]));
    pace.same("IR-REM-A with red up and blue up", &modes["IR-REM-A"], &json!([[0x150], "", "s16"]));
    pace.same("proximity of nothing within 0.7 m", &said["proximity"], &100);
    let (ahead_m, left_m): (f64, f64) = (0.6 - 0.0508, 0.3);
    let bearing_rad = libm::atan2(left_m, ahead_m);
    pace.near("heading", float(&said["heading"]), -25.0 * bearing_rad / 1.6, 1.0);
    pace.near("distance", float(&said["distance"]), libm::hypot(ahead_m, left_m) * 50.0, 1.0);
    pace.same("no beacon", &said["no_beacon"], &json!([0, null]));
    pace.same("buttons", &said["buttons"], &json!(["top_left", "top_right"]));
    pace.same(
        "two buttons",
        &(&said["top_left"], &said["bottom_left"]),
        &(&json!(true), &json!(false)),
    );
    pace.same("other channel", &said["other_channel"], &json!([]));
}

#[test]
fn a_program_on_python_ev3dev2_sees_lights_battery_and_buttons() {
    if no_namespaces() || no_python() {
        return;
    }
    let _alone = real_time();
    in_real_time("board", press_and_look);
}

/// In this process, which can press buttons.
fn press_and_look(pace: &Pace) {
    let physics = WorldPhysics::new(World::named("arena").unwrap(), 1, 1).unwrap();
    let options = Options { udev: true, ..Options::default() };
    let simulation =
        Simulation::with_options(Arc::new(MonotonicClock), Box::new(physics), 1, options);
    let folder = tempfile::tempdir().unwrap();
    let (mount, _) = Mount::new(&simulation, folder.path(), EventLayout::NATIVE).unwrap();
    let mut program =
        Foreign::start(pace, "board", &mount.root(0), &["python3", &script("ev3dev2_board")]);
    assert_eq!(program.line(), "ready");
    let pause = || MonotonicClock.sleep_ns(200 * MILLISECOND_NS);
    for button in [Button::Enter, Button::Left] {
        pause();
        simulation.press(0, button).unwrap();
        pause();
        simulation.release(0, button).unwrap();
    }
    let Some(said) = program.json(pace) else { return };
    assert_eq!(said["platform"], "ev3");
    let battery = &said["battery"];
    pace.near("volts", float(&battery[0]), 7.55, 0.15);
    pace.near("amperes", float(&battery[1]), 0.18, 0.03);
    assert_eq!(
        [2, 3, 4, 5].map(|part| battery[part].clone()),
        [json!(90_000_000), json!(48_000_000), json!("Unknown"), json!("Battery")]
    );
    let lights = |red_left: i64, green_left: i64, red_right: i64, green_right: i64| {
        json!({
            "red_left": red_left, "green_left": green_left,
            "red_right": red_right, "green_right": green_right,
        })
    };
    assert_eq!(said["lights_at_first"], lights(0, 255, 0, 255));
    assert_eq!(said["RED"], lights(255, 0, 0, 255));
    assert_eq!(said["AMBER"], lights(255, 255, 0, 255));
    assert_eq!(said["ORANGE"], lights(255, 127, 0, 255));
    assert_eq!(said["half"], lights(255, 127, 127, 127));
    assert_eq!(said["timer"], json!([200, 100, true]));
    assert_eq!(said["all_off"], lights(0, 0, 0, 0));
    assert_eq!(said["reset"], lights(0, 255, 0, 255));
    assert_eq!(said["port"][0], "ev3-ports:outC");
    assert_eq!(said["pressed_at_first"], json!([]));
    let pressed = json!([["enter", true], ["enter", false], ["left", true], ["left", false]]);
    pace.same("buttons", &said["buttons"], &pressed);
}

#[test]
fn a_program_on_ev3dev_lang_rust_drives_and_senses() {
    if no_namespaces() {
        return;
    }
    let Some(program) = example("ev3dev-lang-rust") else { return };
    let _alone = real_time();
    in_real_time("ev3dev-lang-rust", |pace| check_lang_rust(pace, program.to_str().unwrap()));
}

fn check_lang_rust(pace: &Pace, program: &str) {
    let simulator = Simulator::start(pace, "foreign-yard");
    let program = Foreign::start(pace, "ev3dev-lang-rust", &simulator.root(), &[program]);
    let Some(said) = program.end(pace) else { return };
    let truth = simulator.truth();
    println!("{truth:?}");
    let said: BTreeMap<&str, &str> = said.lines().filter_map(|line| line.split_once(' ')).collect();
    let floats = |key: &str| -> Vec<f64> {
        said[key].split(' ').filter_map(|word| word.parse().ok()).collect()
    };
    assert_eq!(said["motors"], "ev3-ports:outB ev3-ports:outD ev3-ports:outA");
    assert_eq!(said["large"], "2");
    for (key, left, right) in
        [("ahead", 720.0, 720.0), ("turned", 549.0, 891.0), ("end", 909.0, 1251.0)]
    {
        pace.near(&format!("left {key}"), floats(key)[0], left, 3.0);
        pace.near(&format!("right {key}"), floats(key)[1], right, 3.0);
    }
    pace.same("state", &said["state"], &"holding");
    pace.near("x", truth.x_m, 2.0 * WHEEL_M, 0.02);
    pace.near("y", truth.y_m, WHEEL_M, 0.02);
    pace.near("heading", truth.heading_deg, 90.0, 3.0);
    let timed = floats("timed");
    pace.near("half a second at 200 degrees a second", timed[0], 97.0, 12.0);
    pace.ensure(said["timed"].contains("true"), || said["timed"].to_owned());
    pace.near("seconds until it was woken", timed[1], 0.5, 0.15);
    // Turned left, the sonar sees the wall at 1.2 m; its head was turned meanwhile.
    let cm = floats("cm")[0];
    pace.near("centimetres to somewhere", cm, 129.05, 126.05);
    assert_eq!(
        said["modes"],
        "US-DIST-CM,US-DIST-IN,US-LISTEN,US-SI-CM,US-SI-IN,US-DC-CM,US-DC-IN"
    );
    assert_eq!(said["touch"], "false");
    pace.same("colour before the red strip", &said["colour"], &"6");
    pace.near("gyro against the truth", floats("angle")[0], -truth.heading_deg, 3.0);
    pace.near("volts", floats("volts")[0], 7.5, 0.3);
    assert_eq!(said["lights_at_first"], "Some((0, 255))");
    assert_eq!(said["lights"], "Some((255, 128))");
}

/// What the two libraries look at before they open a file: what the group may do.
#[test]
fn the_group_may_write_where_udev_lets_it_and_nobody_writes_the_truth() {
    let physics = || WorldPhysics::new(World::named("arena").unwrap(), 1, 1).unwrap();
    let clock = || Arc::new(VirtualClock::default());
    let options = Options { udev: true, ..Options::default() };
    let simulation = Simulation::with_options(clock(), Box::new(physics()), 1, options);
    let born = Simulation::new(clock(), Box::new(physics()), 1);
    for (path, with_udev, without) in [
        ("sys/class/tacho-motor/motor0/command", 0o220, 0o200),
        ("sys/class/tacho-motor/motor0/hold_pid/Kp", 0o664, 0o644),
        ("sys/class/tacho-motor/motor0/state", 0o444, 0o444),
        ("sys/class/lego-sensor/sensor0/mode", 0o664, 0o644),
        ("sys/class/lego-port/port0/mode", 0o664, 0o644),
        ("sys/class/leds/led0:red:brick-status/brightness", 0o664, 0o644),
        ("sys/class/power_supply/lego-ev3-battery/technology", 0o644, 0o644),
        ("sim/truth", 0o444, 0o444),
    ] {
        let rights = |simulation: &Simulation| simulation.brick(0).entry(path).unwrap().permissions;
        assert_eq!(
            (rights(&simulation), rights(&born)),
            (with_udev, without),
            "{path}: {:o}",
            rights(&simulation)
        );
    }
    let brick = simulation.brick(0);
    let mut text = [0; 1024];
    let length = brick.open("sim/truth", Access::Read).unwrap().read(&mut text).unwrap();
    let line: Value = serde_json::from_slice(&text[..length]).unwrap();
    let expected = physics().truth(0).unwrap();
    assert_eq!((float(&line["x_m"]), float(&line["y_m"])), (expected.x_m, expected.y_m));
    for access in [Access::Write, Access::ReadWrite] {
        assert_eq!(brick.open("sim/truth", access).map(drop).unwrap_err(), Errno::EACCES);
    }
}

/// A bench of bare motors has no world, and so no truth.
#[test]
fn where_there_is_no_world_the_truth_is_not_known() {
    let bench = InProcess::new(Bench::as_recorded(), Options::default());
    let file = bench.brick.open("sim/truth", Access::Read).unwrap();
    assert_eq!(file.read(&mut [0; 64]), Err(Errno::ENODATA));
}

/// Our own program, through the mount and in process, over the same time: the maps are as good,
/// measured by how far their points are from the walls.
#[test]
fn our_mapping_mission_maps_through_the_mount_as_well_as_in_process() {
    if no_fuse() {
        return;
    }
    let _alone = real_time();
    in_real_time("map", map_by_both_doors);
}

fn map_by_both_doors(pace: &Pace) {
    let simulator = Simulator::start(pace, "arena");
    let folder = tempfile::tempdir().unwrap();
    let root = simulator.root();
    // A mounted brick does not say where it stands; a person does.
    let start = simulator.truth();
    let pose = format!("--pose={},{},{}", start.x_m, start.y_m, start.heading_deg);
    let off_m = |door: &str, place: &str| -> Option<f64> {
        let out = folder.path().join(door);
        let run = Pace::command(tested_program())
            .args(["run", "map", "--set", "time_limit_s=30", &pose, door, place, "--out"])
            .arg(&out)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        pace.watch(&run);
        let output = run.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        // The loop rightly ends a run that was kept from the processor for long.
        pace.ensure(output.status.success(), || {
            format!("{said}{}", String::from_utf8_lossy(&output.stderr))
        });
        let run = output.status.success().then(|| Run::open(&out.join("run.mcap")).unwrap())?;
        let median_m = median_off_m(&run);
        println!("{door}: half of the points are within {median_m:?} m of a wall");
        median_m
    };
    let mounted_m = off_m("--brick", root.to_str().unwrap()).unwrap_or(f64::INFINITY);
    let in_process_m = off_m("--sim", "arena").unwrap_or(f64::NEG_INFINITY);
    pace.near("metres off a wall through the mount", mounted_m, 0.0, 0.05);
    let within_m = 1.5 * in_process_m + 0.005;
    pace.ensure(mounted_m < within_m, || {
        format!("through the mount {mounted_m} m, not {within_m} m")
    });
}

/// Half of a map's points are so near to a wall of the arena, metres; nothing if there are hardly
/// any.
pub(crate) fn median_off_m(run: &Run) -> Option<f64> {
    let walls = World::named("arena").unwrap();
    let from_walls =
        run.points.iter().map(|point| walls.distance_to_nearest_surface(point.x_m, point.y_m));
    let mut off_m: Vec<f64> = from_walls.collect();
    off_m.sort_by(f64::total_cmp);
    // Of fewer it says nothing.
    off_m.get(50)?;
    off_m.get(off_m.len() / 2).copied()
}

fn float(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}
