//! Every message that a person can get, in files to read: `tests/data/*-messages.txt`. A mission's
//! are collected in `behavior`. `ONBRICK_BLESS=1 cargo test` rewrites them; read what changed.
#![cfg(feature = "host")]

use std::fmt::Write as _;

use nix::errno::Errno;
use onbrick::robot::{DEFAULT_ROBOT, RobotConfig};
use onbrick::runtime::{LockError, NotReady, Owner, StopReason};
use onbrick::senses::Role;
use onbrick::sim::World;

use crate::bad_input::drivers::{causes, ready, shipped};
use crate::commands::run;
use crate::support::brick::{BATTERY, FakeTree, MOTORS, SENSORS, shipped_brick};

/// Compares with the file that a person read last.
fn compare(name: &str, now: &str) {
    let path = format!("{}/tests/data/{name}-messages.txt", env!("CARGO_MANIFEST_DIR"));
    if std::env::var_os("ONBRICK_BLESS").is_some() {
        std::fs::write(&path, now).unwrap();
    }
    let read = std::fs::read_to_string(&path).unwrap_or_default();
    for (at, (now, read)) in now.lines().zip(read.lines()).enumerate() {
        assert_eq!(now, read, "line {} of {path}; ONBRICK_BLESS=1 rewrites it", at + 1);
    }
    assert_eq!(now.lines().count(), read.lines().count(), "{path}; ONBRICK_BLESS=1 rewrites it");
}

fn replaced(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "there is no `{from}`");
    text.replacen(from, to, 1)
}

#[test]
fn every_message_about_a_robot_is_as_a_person_read_it_last() {
    let robot = |from: &str, to: &str| replaced(DEFAULT_ROBOT, from, to);
    let more = |text: &str| format!("{DEFAULT_ROBOT}\n{text}\n");
    let motors: String = (0..5).fold(String::new(), |all, at| {
        format!("{all}[motor.m{at}]\nport = \"outC\"\nmax_dps = 5\n")
    });
    let cases: Vec<(&str, String)> = vec![
        ("nothing in it", String::new()),
        ("only a name", "name = \"r\"\n".to_owned()),
        ("not TOML", "name = mapper\n".to_owned()),
        ("a key twice", robot("max_dps = 360", "max_dps = 360\nmax_dps = 180")),
        ("a section twice", more("[gyro]\nport = \"in2\"")),
        ("an unknown key", robot("track_width_m", "track_widht_m")),
        ("an unknown section", more("[gripper]\nport = \"outC\"")),
        ("a key of another section", robot("ahead_m", "speed_dps")),
        ("a missing measure", robot("wheel_circumference_m = 0.188976", "")),
        ("a missing wheel", robot("left  = { port = \"outB\" }", "")),
        ("a wheel that is only a port", robot("{ port = \"outB\" }", "\"outB\"")),
        ("text for a number", robot("max_dps = 360", "max_dps = \"fast\"")),
        ("millimetres for metres", robot("0.188976", "188.976")),
        ("a negative size", robot("0.1143", "-0.1143")),
        ("no number", robot("max_dps = 360", "max_dps = nan")),
        ("an infinite number", robot("max_dps = 360", "max_dps = inf")),
        ("a port that is none", robot("\"in4\"", "\"in 4\"")),
        ("a port that is a number", robot("\"in4\"", "4")),
        ("a port that no board has", robot("\"outB\"", "\"B\"")),
        ("a port of an EV3 that it does not have", robot("\"in4\"", "\"in5\"")),
        ("an empty port", robot("\"in4\"", "\"\"")),
        ("a gear without teeth", robot("[-12, 36]", "[0, 36]")),
        ("a cone wider than a head", robot("half_cone_deg = 14", "half_cone_deg = 90")),
        ("an own echo out of reach", robot("own_echoes = []", "own_echoes = [[80, 100, 20]]")),
        ("an own echo without its range", robot("own_echoes = []", "own_echoes = [[80, 100]]")),
        ("a bias in centimetres", robot("bias_m = 0.0", "bias_m = -1.4")),
        ("a gear of one number", robot("[-12, 36]", "[3]")),
        ("a gear as text", robot("[-12, 36]", "\"12:36\"")),
        ("an empty name", robot("\"mapper\"", "\"\"")),
        ("a name that is a number", robot("\"mapper\"", "5")),
        ("two roles on one port", robot("\"in4\"", "\"in1\"")),
        ("both wheels on one port", robot("\"outD\"", "\"outB\"")),
        (
            "a motor with no name for conditions",
            more("[motor.\"left arm\"]\nport = \"outC\"\nmax_dps = 5"),
        ),
        ("a sensor that measures nothing", more("[sensor.eye]\nport = \"in3\"")),
        ("a sensor that measures what is none", more("[sensor.eye]\nmeasures = \"reflect\"")),
        (
            "five sensors, one without a name for conditions",
            more(&(0..5).fold(String::new(), |all, at| {
                format!("{all}[sensor.s{at}]\nmeasures = \"touch\"\n")
            })),
        ),
        ("a motor without a limit", more("[motor.arm]\nport = \"outC\"")),
        ("five motors", more(&motors)),
        (
            "inverted by a word",
            robot("{ port = \"outB\" }", "{ port = \"outB\", inverted = \"yes\" }"),
        ),
        ("an age of no use", robot("# max_age_s = 0.3", "max_age_s = 0.001")),
    ];
    let mut out = String::new();
    for (title, text) in cases {
        let findings = RobotConfig::load("robot.toml", text.as_bytes()).expect_err(title);
        writeln!(out, "## {title}\n\n{findings}").unwrap();
    }
    compare("robot", &out);
}

#[test]
fn every_message_about_a_world_is_as_a_person_read_it_last() {
    let world = |text: &str| format!("name = \"room\"\n{text}\n");
    let cases: Vec<(&str, String)> = vec![
        ("nothing in it", String::new()),
        ("unknown keys", world("walls = []\n[[block]]\nat = [2, 0]\nsize = [1, 1]")),
        ("one table for a list", world("[wall]\npoints = [[0, 5], [1, 5]]")),
        ("text for a list", world("wall = \"round\"")),
        ("a wall of one point", world("[[wall]]\npoints = [[0, 5]]")),
        ("a point of one number", world("[[wall]]\npoints = [[0, 5], [1]]")),
        ("a point that is none", world("[[wall]]\npoints = [[0, 5], \"here\"]")),
        ("a wall without points", world("[[wall]]\nclosed = true")),
        ("closed by a number", world("[[wall]]\npoints = [[0, 5], [1, 5]]\nclosed = 1")),
        ("far away", world("[[wall]]\npoints = [[0, 500], [1, 500]]")),
        ("no number", world("[[circle]]\nat = [nan, 1]\nradius_m = inf")),
        ("a negative size", world("[[block]]\nat = [2, 0]\nsize_m = [-0.4, 0.2]")),
        ("a missing size", world("[[block]]\nat = [2, 0]\n[[circle]]\nat = [3, 0]")),
        ("a colour that is none", world("[floor]\ncolour = \"pink\"")),
        ("reflected more than fully", world("[floor]\nreflect_pct = 120")),
        ("a table of two points", world("[floor]\ntable = [[0, 0], [1, 1]]")),
        ("a start in a block", world("[[block]]\nat = [0, 0]\nsize_m = [0.4, 0.2]")),
        ("two starts in one place", world("[[start]]\nat = [0, 0]\n[[start]]\nat = [0.05, 0]")),
        ("a start beyond the edge", world("[floor]\ntable = [[1, 1], [2, 1], [2, 2]]")),
        ("a button that the remote lacks", world("[[remote]]\nat_s = 1\ncode = 12\nchannel = 5")),
        ("a beacon nowhere", world("[beacon]\nchannel = 1")),
        ("a robot that is none", world("[robot]\ntrack_width_m = -1\nwheels = 3")),
        ("an ear that is none", world("[robot]\necho = \"conus\"\nown_echoes = [[0, 9, 0]]")),
    ];
    let mut out = String::new();
    for (title, text) in cases {
        let findings = World::parse("world.toml", text.as_bytes()).expect_err(title);
        writeln!(out, "## {title}\n\n{findings}").unwrap();
    }
    compare("world", &out);
}

#[test]
fn every_message_before_a_start_is_as_a_person_read_it_last() {
    type Change = fn(&FakeTree);
    let cases: [(&str, Change); 21] = [
        ("nothing is plugged in", |fake| {
            MOTORS.iter().chain(&SENSORS).for_each(|folder| fake.pull(folder))
        }),
        ("a wheel is plugged in elsewhere", |fake| {
            fake.put(MOTORS[2], "address", b"ev3-ports:outC\n")
        }),
        ("a sensor is missing", |fake| fake.pull(SENSORS[1])),
        ("the sensors are the wrong way round", |fake| {
            fake.put(SENSORS[0], "address", b"ev3-ports:in4\n");
            fake.put(SENSORS[1], "address", b"ev3-ports:in1\n");
        }),
        ("a sensor of another kind", |fake| {
            fake.put(SENSORS[1], "driver_name", b"lego-ev3-touch\n")
        }),
        ("no permission", |fake| fake.fail(MOTORS[1], "command", None, Some(Errno::EACCES))),
        ("a motor that was just pulled", |fake| {
            fake.fail(MOTORS[1], "command", None, Some(Errno::ENODEV))
        }),
        ("a motor that refuses", |fake| {
            fake.fail(MOTORS[1], "stop_action", None, Some(Errno::EINVAL))
        }),
        ("a motor without a scale", |fake| fake.put(MOTORS[1], "count_per_rot", b"0\n")),
        ("a motor that says nonsense", |fake| fake.put(MOTORS[1], "max_speed", b"fast\n")),
        ("a sensor without the mode", |fake| {
            fake.put(SENSORS[0], "modes", b"US-LISTEN\n");
            fake.put(SENSORS[0], "mode", b"US-LISTEN\n");
        }),
        ("a sensor that does not change its mode", |fake| {
            fake.put(SENSORS[0], "mode", b"US-LISTEN\n");
            fake.fail(SENSORS[0], "mode", None, Some(Errno::ETIMEDOUT));
        }),
        ("a sensor that says nonsense", |fake| fake.put(SENSORS[0], "value0", b"fly\n")),
        ("a sensor that says too much", |fake| fake.put(SENSORS[0], "value0", b"99999\n")),
        ("a sensor that fails", |fake| fake.fail(SENSORS[1], "value0", Some(Errno::EIO), None)),
        ("a wheel that gives no angle", |fake| {
            fake.fail(MOTORS[1], "position", Some(Errno::EIO), None)
        }),
        ("a flat battery", |fake| fake.put(BATTERY, "voltage_now", b"4900000\n")),
        ("a battery that cannot be", |fake| fake.put(BATTERY, "voltage_now", b"2000000000\n")),
        ("a battery that is not measured yet", |fake| {
            fake.fail(BATTERY, "voltage_now", Some(Errno::ENODATA), None)
        }),
        ("two motors at one port", |fake| fake.put(MOTORS[2], "address", b"ev3-ports:outB\n")),
        ("a port that is none", |fake| fake.put(MOTORS[2], "address", b"\n")),
    ];
    let mut out = String::new();
    for (title, change) in cases {
        let fake = shipped_brick();
        change(&fake);
        let message = ready(&fake.tree(), &shipped())
            .err()
            .unwrap_or_else(|| panic!("{title}: ready all the same"));
        writeln!(out, "## {title}\n\n{message}\n").unwrap();
    }
    let mut anywhere = shipped();
    anywhere.sensors.insert(Role::Gyro, None);
    let fake = shipped_brick();
    fake.put(SENSORS[0], "driver_name", b"lego-ev3-gyro\n");
    let message = ready(&fake.tree(), &anywhere).unwrap_err();
    writeln!(out, "## a role without a port, and several that fit\n\n{message}\n").unwrap();
    for (title, why) in [
        ("the robot is moved", NotReady::Moving(onbrick::senses::Channel::Left)),
        ("the gyro drifts", NotReady::GyroDrifts(3.4)),
        ("it is asked to stop meanwhile", NotReady::Stopped(StopReason::Here)),
    ] {
        writeln!(out, "## {title}\n\n{}\n", causes(&why)).unwrap();
    }
    let owner = Owner { pid: 4711, ..Owner::here("mission map") };
    writeln!(out, "## another run drives\n\n{}\n", causes(&LockError::Taken(owner))).unwrap();
    writeln!(out, "## why a run ends\n").unwrap();
    for reason in [
        StopReason::Finished,
        StopReason::TimeLimit,
        StopReason::Button,
        StopReason::Remote,
        StopReason::Here,
        StopReason::Page,
        StopReason::MenuClosed,
        StopReason::Signal,
        StopReason::Abandoned,
        StopReason::Outside(onbrick::senses::Channel::Left),
        StopReason::Lost(onbrick::senses::Channel::Gyro),
        StopReason::Unmounted,
        StopReason::Implausible(onbrick::senses::Channel::Gyro),
        StopReason::Implausible(onbrick::senses::Channel::Range),
        StopReason::Implausible(onbrick::senses::Channel::Head),
        StopReason::Stalled,
        StopReason::Battery,
        StopReason::Late,
        StopReason::Recording,
        StopReason::Guard,
        StopReason::Unguarded,
        StopReason::Panicked,
    ] {
        writeln!(out, "{}: {reason}", reason.word()).unwrap();
    }
    compare("ready", &out);
}

#[test]
fn every_message_of_a_command_is_as_a_person_read_it_last() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    write("binary.toml", b"name = \"\xff\xfe\"");
    write("empty.toml", b"");
    write("empty.mcap", b"");
    write("text.mcap", b"x,y\n1,2\n");
    std::fs::create_dir(folder.path().join("there")).unwrap();
    write("there/run.mcap", b"");
    write("there.toml", b"");
    write("mapper.toml", DEFAULT_ROBOT.as_bytes());
    let alone = |name: &str, what: &str| {
        format!("name = \"{name}\"\n[machine.m.state.a]\ndo = {{ {what} }}\n").into_bytes()
    };
    write("arm.toml", &alone("arm", "motor.arm = 30"));
    write("reach.toml", &alone("reach", "left_dps = 720, right_dps = 360, head_deg = 100"));
    std::fs::create_dir_all(folder.path().join("bare/sys/class")).unwrap();
    let mut out = String::new();
    for line in [
        "demo --world areena",
        "demo --world empty.toml",
        "demo --out empty.toml",
        "run mapp",
        "run nothing.toml",
        "run empty",
        "run there",
        "run binary.toml",
        "run map --robot nothing.toml",
        "run map --robot empty.toml",
        "run remote",
        "run map --sim nothing.toml",
        "run map --sim two-arenas --out there",
        "run map --sim arena --out empty.toml",
        "run map --sim arena --set naer_m=1",
        "run map --sim arena --set near_m=wide",
        "run map --sim arena --pose 1,2",
        "run map --brick nowhere",
        "run map --brick bare",
        "check nothing.toml binary.toml",
        "graph mapp",
        "graph empty.toml",
        "new rover",
        "new robot there.toml",
        "new mission no/where.toml",
        "new mission --from mapp",
        "check reach.toml",
        "devices --brick nowhere",
        "setup --brick nowhere",
        "setup --brick bare",
        "calibrate there.toml --brick bare",
        "calibrate mapper.toml --brick bare",
        "halt --brick nowhere",
        "halt --brick bare",
        "explain",
        "push nowhere nothing.toml",
        "sim bricks --robots 2",
        "sim brick --scenario nothing.toml",
        "sim brick --scenario text.mcap",
        "sim fault nowhere in9 stuck",
        "sim fault nowhere in1 stukc",
        "sim fault nowhere in1 stuck for",
        "sim fault nowhere place -0.5 0 90",
        "run arm.toml --sim open",
        "plot nothing.mcap -o map.svg",
        "plot empty.mcap -o map.svg",
        "plot text.mcap -o map.svg",
        "plot text.mcap -o map.bmp",
        "export text.mcap --format csv",
        "export text.mcap --format dxf",
        "repair text.mcap",
        "repair text.mcap text.mcap",
        "replay text.mcap",
        "replay there",
        "replay text.mcap --robot there.toml",
        "control",
    ] {
        let arguments: Vec<&str> = line.split(' ').collect();
        let said = run(folder.path(), &arguments);
        let code = said.code.unwrap();
        let may_be_done = ["explain", "check reach.toml"].contains(&line);
        assert!(code <= 3 && (code > 0 || may_be_done), "{line}: {said:?}");
        let place = folder.path().to_str().unwrap();
        let printed = if said.out.is_empty() {
            String::new()
        } else {
            format!("{}\n", said.out.replace(place, "FOLDER"))
        };
        writeln!(
            out,
            "$ onbrick {line}\n{printed}{}exit code {code}\n",
            said.err.replace(place, "FOLDER")
        )
        .unwrap();
    }
    compare("command", &out);
}
