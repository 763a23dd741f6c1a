//! Drivers that answer garbage, or an error, or late: binding and preparing refuse with the
//! attribute's name, and nothing turns.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use nix::errno::Errno;
use onbrick::behavior::{Demands, Drive};
use onbrick::clock::{Clock, MILLISECOND_NS, VirtualClock};
use onbrick::ev3dev::{Access, AttributeFile, Battery, StopAction, Tree};
use onbrick::robot::{DEFAULT_ROBOT, Robot, RobotConfig};
use onbrick::runtime::{NotReady, StopFlags, prepare};
use onbrick::senses::{Channel, Senses};

use crate::support::brick::{
    BATTERY, FakeTree, MOTORS, SENSORS, rotary_tables, sensor_tables, shipped_brick,
};

pub fn shipped() -> RobotConfig {
    RobotConfig::load("robot.toml", DEFAULT_ROBOT.as_bytes()).unwrap().0
}

/// Binds the shipped robot and prepares it, in virtual time; the whole message where it is refused.
pub fn ready(tree: &Arc<dyn Tree>, config: &RobotConfig) -> Result<Robot, String> {
    let mut robot = Robot::bind(tree, config, &[Channel::Head, Channel::Range])
        .map_err(|error| causes(&error))?;
    let clock = VirtualClock::default();
    prepare(&mut robot, &clock, &StopFlags::default(), false, |_| {})
        .map_err(|error| causes(&error))?;
    Ok(robot)
}

pub fn causes(error: &dyn std::error::Error) -> String {
    std::iter::successors(Some(error), |error| error.source())
        .map(ToString::to_string)
        .collect::<Vec<_>>()
        .join(": ")
}

/// Every attribute of the robot's devices: folder and name.
fn attributes() -> Vec<(&'static str, &'static str)> {
    let names = |tables: &[&'static [onbrick::ev3dev::AttributeSpec]]| {
        tables.iter().flat_map(|table| table.iter().map(|spec| spec.name)).collect::<Vec<_>>()
    };
    let motor = names(&rotary_tables());
    let sensor = names(&sensor_tables());
    let mut all = Vec::new();
    all.extend(MOTORS.iter().flat_map(|&folder| motor.iter().map(move |&name| (folder, name))));
    all.extend(SENSORS.iter().flat_map(|&folder| sensor.iter().map(move |&name| (folder, name))));
    all.extend(names(&[Battery::ATTRIBUTES]).into_iter().map(|name| (BATTERY, name)));
    all
}

/// Whatever was taken as good enough must not upset what drives.
fn drive_a_little(robot: &mut Robot) {
    for tick in 0..20 {
        let mut senses = Senses { time_ns: tick * 20 * MILLISECOND_NS, ..Senses::default() };
        robot.sense(&mut senses);
        let readings = senses.readings.iter().flatten();
        assert!(readings.into_iter().all(|reading| !reading.value.is_nan()), "{senses:?}");
        let speed = f64::from(u8::try_from(tick).unwrap());
        let drive = Some(Drive::Wheels { left_rad_s: speed, right_rad_s: -speed });
        robot.act(&Demands { drive, head_rad: Some(1.0), ..Demands::default() }, senses.time_ns);
    }
}

fn assert_nothing_turned(fake: &FakeTree, case: &str) {
    for folder in MOTORS {
        let commands = fake.written(folder, "command");
        assert!(
            commands.iter().all(|command| !command.starts_with("run")),
            "{case}: {commands:?} to {folder}"
        );
    }
}

/// A refusal names the device or its port, and what of it.
fn assert_told(message: &str, folder: &str, name: &str, case: &str) {
    let device = folder.rsplit('/').next().unwrap();
    let told =
        message.contains(folder) || message.contains(device) || message.contains("; there is");
    assert!(told, "{case}: which device? {message}");
    assert!(
        message.contains(name) || message.contains("; there is"),
        "{case}: which attribute? {message}"
    );
    assert!(message.len() < 500, "{case}: {message}");
}

#[test]
fn the_robot_as_it_should_be_is_ready() {
    let fake = shipped_brick();
    ready(&fake.tree(), &shipped()).unwrap();
    assert_nothing_turned(&fake, "at rest");
}

#[test]
fn garbage_in_any_attribute_is_refused_or_does_not_matter() {
    let garbage: [&[u8]; 9] = [
        b"",
        b"\n",
        b"fly\n",
        b"\xff\xfe\x00\x01\n",
        b"99999999999999999999\n",
        b"-2147483648\n",
        b"nan\n",
        b"1.5\n",
        &[b'7'; 5000],
    ];
    let mut refused = 0;
    for (folder, name) in attributes() {
        for text in garbage {
            let case = format!(
                "{folder}/{name} = {}",
                String::from_utf8_lossy(&text[..text.len().min(20)])
            );
            let fake = shipped_brick();
            fake.put(folder, name, text);
            let ready = ready(&fake.tree(), &shipped());
            assert_nothing_turned(&fake, &case);
            if let Err(message) = ready.map(|mut robot| drive_a_little(&mut robot)) {
                refused += 1;
                // What something else is plugged in as is told by what was looked for.
                if !["address", "driver_name", "voltage_now"].contains(&name) {
                    assert_told(&message, folder, name, &case);
                }
            }
        }
    }
    assert!(refused > 100, "{refused} were refused");
    println!("{refused} of {} answers were refused", attributes().len() * garbage.len());
}

#[test]
fn an_error_from_any_attribute_is_refused_or_does_not_matter() {
    let mut refused = 0;
    for (folder, name) in attributes() {
        for errno in [
            Errno::ENODEV,
            Errno::EIO,
            Errno::EACCES,
            Errno::EINVAL,
            Errno::ETIMEDOUT,
            Errno::EAGAIN,
        ] {
            for (read, write) in [(Some(errno), None), (None, Some(errno))] {
                let case = format!("{folder}/{name}: {errno} (read: {})", read.is_some());
                let fake = shipped_brick();
                fake.fail(folder, name, read, write);
                if let Err(message) = ready(&fake.tree(), &shipped()) {
                    refused += 1;
                    if !(name == "address" || name == "driver_name") {
                        assert_told(&message, folder, name, &case);
                    }
                    assert!(
                        errno == Errno::ENODEV || message.contains(&errno.to_string()),
                        "{case}: {message}"
                    );
                }
                assert_nothing_turned(&fake, &case);
            }
        }
    }
    assert!(refused > 50, "{refused} were refused");
}

#[test]
fn a_missing_attribute_is_refused_or_does_not_matter() {
    for (folder, name) in attributes() {
        let fake = shipped_brick();
        fake.remove(folder, name);
        if let Err(message) = ready(&fake.tree(), &shipped()) {
            assert!(!message.is_empty() && message.len() < 500, "{folder}/{name}: {message}");
        }
        assert_nothing_turned(&fake, name);
    }
}

#[test]
fn what_turns_bad_while_driving_is_never_taken_for_a_reading() {
    let drive = Demands {
        drive: Some(Drive::Wheels { left_rad_s: 1.0, right_rad_s: 1.0 }),
        ..Demands::default()
    };
    for (folder, name, channel) in [
        (MOTORS[1], "position", Channel::Left),
        (MOTORS[2], "position", Channel::Right),
        (MOTORS[0], "position", Channel::Head),
        (SENSORS[0], "value0", Channel::Range),
        (SENSORS[1], "value0", Channel::Gyro),
    ] {
        for text in [&b""[..], b"fly\n", b"99999999999\n", b"\xff\n"] {
            let fake = shipped_brick();
            // Nothing updates the state here, and a motor that stands still would contradict each
            // command.
            MOTORS.iter().for_each(|motor| fake.put(motor, "state", b"unknown\n"));
            let mut robot = ready(&fake.tree(), &shipped()).unwrap();
            let mut senses = Senses { time_ns: 1_000_000_000, ..Senses::default() };
            robot.sense(&mut senses);
            robot.act(&drive, senses.time_ns);
            let good = senses.get(channel).unwrap();
            fake.put(folder, name, text);
            for tick in 1..50 {
                senses.time_ns = 1_000_000_000 + tick * 20 * MILLISECOND_NS;
                robot.sense(&mut senses);
                robot.act(&drive, senses.time_ns);
            }
            assert_eq!(
                senses.get(channel),
                Some(good),
                "{folder}/{name}: the last good reading, with its age"
            );
            assert_eq!(senses.fresh(channel, 300 * MILLISECOND_NS), None);
            let trouble = robot.trouble_with(channel).unwrap().to_string();
            assert!(trouble.contains(name), "{trouble}");
            assert!(robot.stop(StopAction::Brake), "the motors are told all the same");
            assert_eq!(fake.written(MOTORS[1], "command").last().unwrap().trim(), "stop");
        }
    }
}

#[test]
fn a_devices_trouble_is_its_own_and_is_over_with_the_next_reading() {
    let fake = shipped_brick();
    let mut robot = ready(&fake.tree(), &shipped()).unwrap();
    let troubled = |robot: &Robot| {
        let all = [Channel::Left, Channel::Right, Channel::Head, Channel::Range, Channel::Gyro];
        all.into_iter().filter(|&of| robot.trouble_with(of).is_some()).collect::<Vec<_>>()
    };
    let mut senses = Senses { time_ns: 1_000_000_000, ..Senses::default() };
    robot.sense(&mut senses);
    assert_eq!(troubled(&robot), []);
    // Two at once: each has its own, whichever was read last.
    fake.fail(SENSORS[0], "value0", Some(Errno::EIO), None);
    fake.fail(MOTORS[1], "position", Some(Errno::ENODEV), None);
    robot.sense(&mut senses);
    assert_eq!(troubled(&robot), [Channel::Left, Channel::Range]);
    for (channel, folder) in [(Channel::Left, MOTORS[1]), (Channel::Range, SENSORS[0])] {
        let said = robot.trouble_with(channel).unwrap().to_string();
        assert!(said.contains(folder), "{channel}: {said}");
    }
    fake.fail(SENSORS[0], "value0", None, None);
    robot.sense(&mut senses);
    assert_eq!(troubled(&robot), [Channel::Left]);
}

#[test]
fn a_motor_that_refuses_to_stop_is_told_again_and_reported() {
    let fake = shipped_brick();
    let mut robot = ready(&fake.tree(), &shipped()).unwrap();
    let drive = Demands {
        drive: Some(Drive::Wheels { left_rad_s: 1.0, right_rad_s: 1.0 }),
        ..Demands::default()
    };
    robot.act(&drive, 0);
    fake.fail(MOTORS[1], "command", None, Some(Errno::EIO));
    assert!(!robot.stop(StopAction::Brake), "one of them did not take it");
    assert_eq!(fake.written(MOTORS[2], "command").last().unwrap().trim(), "stop", "the other did");
    let trouble = robot.trouble_with(Channel::Left).unwrap().to_string();
    assert!(trouble.contains("command"), "{trouble}");
    fake.fail(MOTORS[1], "command", None, None);
    drop(robot);
    assert_eq!(
        fake.written(MOTORS[1], "command").last().unwrap().trim(),
        "stop",
        "told again on the way out"
    );
}

/// A tree whose every read takes a while.
#[derive(Debug)]
struct SlowTree(Arc<dyn Tree>, Arc<VirtualClock>);

#[derive(Debug)]
struct SlowFile(Box<dyn AttributeFile>, Arc<VirtualClock>);

impl Tree for SlowTree {
    fn list(&self, folder: &str) -> Result<Vec<String>, Errno> {
        self.0.list(folder)
    }
    fn open(&self, path: &str, access: Access) -> Result<Box<dyn AttributeFile>, Errno> {
        Ok(Box::new(SlowFile(self.0.open(path, access)?, Arc::clone(&self.1))))
    }
    fn root(&self) -> &Path {
        self.0.root()
    }
}

impl AttributeFile for SlowFile {
    fn read(&self, buffer: &mut [u8]) -> Result<usize, Errno> {
        self.1.sleep_ns(400 * MILLISECOND_NS);
        self.0.read(buffer)
    }
    fn write(&self, value: &[u8]) -> Result<usize, Errno> {
        self.0.write(value)
    }
    fn wait_changed(&self, timeout: Duration) -> Result<bool, Errno> {
        self.0.wait_changed(timeout)
    }
}

#[test]
fn a_slow_driver_delays_the_start_and_a_silent_one_ends_the_patience() {
    for (silent, expected) in [(false, None), (true, Some("no reading from the range sensor"))] {
        let fake = shipped_brick();
        let clock = Arc::new(VirtualClock::default());
        let tree: Arc<dyn Tree> = Arc::new(SlowTree(fake.tree(), Arc::clone(&clock)));
        let mut robot = Robot::bind(&tree, &shipped(), &[Channel::Range]).unwrap();
        if silent {
            fake.fail(SENSORS[0], "value0", Some(Errno::ETIMEDOUT), None);
        }
        let mut said = Vec::new();
        let ready = prepare(&mut robot, &*clock, &StopFlags::default(), false, |what| {
            said.push(what.to_owned())
        });
        match expected {
            None => assert!(ready.is_ok() && said.is_empty(), "{ready:?} {said:?}"),
            Some(expected) => {
                assert!(
                    matches!(ready, Err(NotReady::NoReading(Channel::Range, Some(_)))),
                    "{ready:?}"
                );
                assert_eq!(said.len(), 1, "said once: {said:?}");
                assert!(said[0].contains(expected), "{said:?}");
            }
        }
    }
}

#[test]
fn a_robot_that_is_moved_is_waited_for_and_a_drifting_gyro_is_not() {
    /// A clock that lets something happen while it sleeps.
    struct Turning<F: Fn(i64)>(VirtualClock, F);
    impl<F: Fn(i64)> std::fmt::Debug for Turning<F> {
        fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            self.0.fmt(f)
        }
    }
    impl<F: Fn(i64) + Send + Sync> Clock for Turning<F> {
        fn now_ns(&self) -> i64 {
            self.0.now_ns()
        }
        fn sleep_until_ns(&self, deadline_ns: i64) {
            self.0.sleep_until_ns(deadline_ns);
            (self.1)(deadline_ns / MILLISECOND_NS);
        }
    }
    type Happens<'h> = &'h (dyn Fn(&FakeTree, i64) + Sync);
    let outcome_of = |config: &RobotConfig, happens: Happens<'_>| {
        let fake = shipped_brick();
        let mut robot = Robot::bind(&fake.tree(), config, &[]).unwrap();
        let clock = Turning(VirtualClock::default(), |now_ms| happens(&fake, now_ms));
        let mut said = Vec::new();
        let ready = prepare(&mut robot, &clock, &StopFlags::default(), false, |what| {
            said.push(what.to_owned())
        });
        (ready, said, clock.now_ns() / MILLISECOND_NS)
    };
    let outcome = |happens: Happens<'_>| outcome_of(&shipped(), happens);
    let put = |fake: &FakeTree, folder: &str, name: &str, value: i64| {
        fake.put(folder, name, format!("{value}\n").as_bytes())
    };

    let (ready, said, at_ms) =
        outcome(&|fake, now_ms| put(fake, MOTORS[1], "position", now_ms.min(3000) / 10));
    assert!(
        ready.is_ok() && (8200..8400).contains(&at_ms),
        "its gyro's time after it stands: {at_ms} ms, {ready:?}"
    );
    assert_eq!(said.len(), 1, "{said:?}");
    assert!(said[0].contains("left wheel") && said[0].contains("hands off"), "{said:?}");

    let (ready, ..) = outcome(&|fake, now_ms| put(fake, MOTORS[1], "position", now_ms / 10));
    assert_eq!(ready, Err(NotReady::Moving(Channel::Left)), "ten seconds of patience");

    // A fifth of a degree a second, whatever part of a degree it begins with.
    for begin_ms in [0, 1000, 2500, 4990] {
        let (ready, _, at_ms) =
            outcome(&|fake, now_ms| put(fake, SENSORS[1], "value0", (now_ms + begin_ms) / 5000));
        let Err(NotReady::GyroDrifts(dps)) = ready else { panic!("{ready:?} after {at_ms} ms") };
        assert!(
            (0.15..0.5).contains(&dps) && at_ms <= 11_000,
            "{dps} degrees a second, after {at_ms} ms"
        );
    }
    // A twentieth: seen by those who wait for it.
    let watched = RobotConfig { gyro_watch_ns: 21_000 * MILLISECOND_NS, ..shipped() };
    for begin_ms in [0, 1000, 10_000, 19_990] {
        let creeps = |fake: &FakeTree, now_ms: i64| {
            put(fake, SENSORS[1], "value0", (now_ms + begin_ms) / 20_000)
        };
        let (ready, _, at_ms) = outcome_of(&watched, &creeps);
        let Err(NotReady::GyroDrifts(dps)) = ready else { panic!("{ready:?} after {at_ms} ms") };
        assert!((0.04..0.13).contains(&dps) && at_ms <= 42_000, "{dps} after {at_ms} ms");
        assert!(outcome(&creeps).0.is_ok(), "5.2 s do not show it");
    }
    let (ready, said, _) =
        outcome(&|fake, now_ms| put(fake, SENSORS[1], "value0", i64::from(now_ms % 700 < 300)));
    assert!(
        ready.is_ok() && said.is_empty(),
        "one that flickers does not drift: {ready:?} {said:?}"
    );

    let (ready, said, at_ms) =
        outcome(&|fake, now_ms| put(fake, SENSORS[1], "value0", now_ms / 300));
    assert!(
        matches!(ready, Err(NotReady::GyroDrifts(_))) && at_ms < 5000,
        "{ready:?} at {at_ms} ms"
    );
    assert!(said[0].contains("keep the robot still"), "{said:?}");
    assert!(
        ready.unwrap_err().to_string().contains("unplug it, hold the robot still"),
        "then the gyro is blamed"
    );
}
