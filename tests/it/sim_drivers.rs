//! The simulated drivers against what the real ones answered, and against the reference's tables.

mod motors;
mod sensors;

use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

use nix::errno::Errno;
use nix::time::{ClockId, clock_gettime};
use onbrick::clock::{Clock, MILLISECOND_NS, VirtualClock};
use onbrick::ev3dev::{Access, Tree};
use onbrick::sim::{Bridge, Button, EntryKind, Options, Physics, Plug, Simulation, Written};
use proptest::prelude::*;

use crate::drivers_bench::{Bench, InProcess, Rig};
use crate::transcript::{self, Tolerances};

#[test]
fn every_operation_of_the_kernel_transcript_gets_the_kernels_answer() {
    let bench = InProcess::new(Bench::as_recorded(), Options::default());
    let tolerances = Tolerances { speed: 8, position: 10, duty: 8, moment_ms: 100 };
    let outcome = transcript::play(bench.brick.as_ref(), bench.clock.as_ref(), &bench, tolerances);
    println!(
        "kernel transcript: {} operations with the same bytes, {} within {tolerances:?}, {} \
         excepted, {} actions, {} entries of folders; \
         largest differences {:?}",
        outcome.exact,
        outcome.near,
        outcome.excepted,
        outcome.actions,
        outcome.entries,
        outcome.largest
    );
    assert!(outcome.differences.is_empty(), "{}", outcome.differences.join("\n"));
    let (operations, entries) = transcript::size();
    assert_eq!((outcome.exact, outcome.near, outcome.excepted, outcome.actions), (550, 231, 8, 12));
    assert_eq!(550 + 231 + 8 + 12, operations, "nothing in the transcript was skipped");
    assert_eq!((outcome.entries, entries), (126, 126));
}

#[test]
fn the_error_matrix_is_as_in_the_reference() {
    check_error_matrix(&Rig::recorded());
}

/// The reference's table of errors: device, attribute, what is written (none for a read), answer.
pub(crate) fn check_error_matrix(rig: &Rig) {
    rig.drive("speed_sp=700");
    let long = [b'0'; 33];
    #[rustfmt::skip]
    let table: &[(&str, &str, Option<&[u8]>, Errno)] = &[
        ("outB", "command", Some(b"fly"), Errno::EINVAL),
        ("outB", "speed_sp", Some(b"1051"), Errno::EINVAL),
        ("outB", "speed_sp", Some(b"12 "), Errno::EINVAL),
        ("outB", "speed_sp", Some(b"1.5"), Errno::EINVAL),
        ("outB", "speed_sp", Some(b"0x10"), Errno::EINVAL),
        ("outB", "speed_sp", Some(b"\n"), Errno::EINVAL),
        ("outB", "speed_sp", Some(b"99999999999"), Errno::ERANGE),
        ("outB", "duty_cycle_sp", Some(b"101"), Errno::EINVAL),
        ("outB", "time_sp", Some(b"-1"), Errno::EINVAL),
        ("outB", "ramp_up_sp", Some(b"60001"), Errno::EINVAL),
        ("outB", "polarity", Some(b"inverted"), Errno::EINVAL),
        ("outB", "stop_action", Some(b"stop"), Errno::EINVAL),
        ("outB", "hold_pid/Kp", Some(b"-1"), Errno::EINVAL),
        ("outB", "command", None, Errno::EACCES),
        ("outB", "state", Some(b"running"), Errno::EACCES),
        ("outB", "nothing", None, Errno::ENOENT),
        ("in1", "poll_ms", None, Errno::EOPNOTSUPP),
        ("in2", "poll_ms", None, Errno::EOPNOTSUPP),
        ("in1", "text_value", None, Errno::EOPNOTSUPP),
        ("in1", "value1", None, Errno::ENXIO),
        ("in1", "mode", Some(b"NOPE"), Errno::EINVAL),
        ("in1", "direct", Some(&long), Errno::EINVAL),
        ("in1", "direct", None, Errno::EOPNOTSUPP),
        ("in2", "direct", Some(b"x"), Errno::EOPNOTSUPP),
        ("port:in1", "set_device", Some(b"lego-nxt-us"), Errno::EOPNOTSUPP),
        ("port:outB", "set_device", Some(b"lego-ev3-m-motor"), Errno::EOPNOTSUPP),
        ("port:in1", "mode", Some(b"tacho-motor"), Errno::EINVAL),
        ("port:outB", "status", Some(b"x"), Errno::EACCES),
        ("out9", "position", None, Errno::ENOENT),
    ];
    for (device, attribute, value, expected) in table {
        let found = match value {
            None => rig.try_read(device, attribute).map(|text| text.len()),
            Some(value) => rig.try_write(device, attribute, value),
        };
        assert_eq!(
            found,
            Err(*expected),
            "{device} {attribute} {:?}",
            value.map(String::from_utf8_lossy)
        );
    }
    assert_eq!(rig.number("outB", "speed_sp"), 700, "a refused value leaves the old one");
    assert_eq!(
        rig.try_write("outB", "speed_sp", ""),
        Ok(0),
        "an empty write does not reach the driver"
    );
    rig.drive("run-forever position=5");
    assert_eq!(rig.read_path("sys/class/nothing/x/y"), Err(Errno::ENOENT));
    assert_eq!(rig.tree.list("sys/class/nothing"), Err(Errno::ENOENT));
}

/// A clock that stands still, also for sleepers, until it is moved.
#[derive(Debug, Default)]
pub(crate) struct HandClock {
    now_ns: Mutex<i64>,
    moved: Condvar,
}

impl HandClock {
    /// Moves it, and wakes those who sleep.
    pub(crate) fn move_to_ns(&self, now_ns: i64) {
        *self.now_ns.lock().unwrap() = now_ns;
        self.moved.notify_all();
    }
}

impl Clock for HandClock {
    fn now_ns(&self) -> i64 {
        *self.now_ns.lock().unwrap()
    }

    fn sleep_until_ns(&self, deadline_ns: i64) {
        let now_ns = self.now_ns.lock().unwrap();
        drop(self.moved.wait_while(now_ns, |now_ns| *now_ns < deadline_ns).unwrap());
    }
}

#[test]
fn status_lights_clamp_and_have_triggers() {
    let rig = Rig::recorded();
    let led = "led0:red:brick-status";
    let path = |attribute: &str| format!("sys/class/leds/{led}/{attribute}");
    assert_eq!(rig.write_path(&path("brightness"), b"1000"), Ok(4));
    assert_eq!(rig.read_path(&path("brightness")), Ok("255\n".to_owned()));
    assert_eq!(rig.write_path(&path("brightness"), b"x"), Err(Errno::EINVAL));
    assert_eq!(rig.read_path(&path("delay_on")), Err(Errno::ENOENT));
    assert_eq!(rig.write_path(&path("trigger"), b"timer\n"), Ok(6));
    assert!(rig.read_path(&path("trigger")).unwrap().contains(" [timer] heartbeat "));
    assert_eq!(rig.read_path(&path("delay_on")), Ok("500\n".to_owned()));
    let kept = rig.tree.open(&path("delay_off"), Access::ReadWrite).unwrap();
    assert_eq!(kept.write(b"100"), Ok(3));
    assert_eq!(rig.write_path(&path("trigger"), b"nothing"), Err(Errno::EINVAL));
    assert_eq!(rig.write_path(&path("brightness"), b"0"), Ok(1));
    assert_eq!(rig.bench.simulation.led(0, led), Some((0, "none")), "0 removes the trigger");
    assert_eq!(kept.write(b"100"), Err(Errno::ENODEV));
}

#[test]
fn battery_and_board_read_as_on_a_brick() {
    let rig = Rig::recorded();
    rig.pass_ms(20);
    let path = |attribute: &str| format!("sys/class/power_supply/lego-ev3-battery/{attribute}");
    let number = |attribute: &str| -> i64 {
        rig.read_path(&path(attribute)).unwrap().trim_end().parse().unwrap()
    };
    assert!((number("voltage_now") - 7_400_000).abs() <= 4_888, "{} µV", number("voltage_now"));
    assert_eq!(number("voltage_now") % 9_775, 0);
    assert!((number("current_now") - 180_000).abs() <= 3_250, "{} µA", number("current_now"));
    assert_eq!(
        (number("voltage_max_design"), number("voltage_min_design")),
        (90_000_000, 48_000_000)
    );
    assert_eq!(rig.read_path(&path("capacity")), Err(Errno::ENOENT));
    assert_eq!(rig.write_path(&path("technology"), b"Li-ion"), Err(Errno::EINVAL));
    assert_eq!(rig.write_path(&path("technology"), b"NiMH"), Ok(4));
    assert_eq!(number("voltage_max_design"), 7_800_000);
    assert_eq!(rig.write_path(&path("technology"), b"NiMH"), Err(Errno::EINVAL));
    let board = rig.read_path("sys/class/board-info/board0/uevent").unwrap();
    assert!(board.contains("BOARD_INFO_MODEL=LEGO MINDSTORMS EV3\n"), "{board}");
    assert!(board.ends_with("BOARD_INFO_TYPE=main\n"), "{board}");
}

#[test]
fn buttons_are_a_stream_of_events_and_tones_are_heard() {
    const LENGTH: usize = size_of::<nix::libc::input_event>();
    let rig = Rig::recorded();
    let buttons =
        rig.tree.open("dev/input/by-path/platform-gpio_keys-event", Access::Read).unwrap();
    let mut buffer = [0; 4 * LENGTH];
    assert_eq!(buttons.read(&mut buffer), Err(Errno::EAGAIN));
    rig.pass_ms(1500);
    rig.bench.simulation.press(0, Button::Enter).unwrap();
    rig.bench.simulation.press(0, Button::Enter).unwrap();
    assert_eq!(rig.bench.simulation.pressed(0), [Button::Enter]);
    rig.bench.simulation.release(0, Button::Enter).unwrap();
    assert_eq!(buttons.wait_changed(Duration::ZERO), Ok(true));
    assert_eq!(buttons.read(&mut buffer), Ok(4 * LENGTH), "press, report, release, report");
    assert_eq!(buffer[LENGTH - 8..LENGTH], [1, 0, 28, 0, 1, 0, 0, 0]);
    assert_eq!(buffer[LENGTH / 2 - 4..][..4], 500_000_u32.to_ne_bytes(), "microseconds");
    assert_eq!(buttons.read(&mut buffer), Err(Errno::EAGAIN));
    for _ in 0..40 {
        rig.bench.simulation.press(0, Button::Up).unwrap();
        rig.bench.simulation.release(0, Button::Up).unwrap();
    }
    assert_eq!(buttons.read(&mut buffer), Ok(LENGTH), "a reader that lags behind is told so");
    assert_eq!(buffer[LENGTH - 8..LENGTH], [0, 0, 3, 0, 0, 0, 0, 0]);

    let speaker = rig.tree.open("dev/input/by-path/platform-sound-event", Access::Write).unwrap();
    let tone = |hz: i32| {
        let mut event = vec![0; LENGTH - 8];
        event.extend([0x12, 0, 2, 0]);
        event.extend(hz.to_ne_bytes());
        event
    };
    assert_eq!(speaker.write(&tone(20_000)), Ok(LENGTH));
    assert_eq!(rig.bench.simulation.tone_hz(0), Some(10_000), "clamped");
    assert_eq!(speaker.write(&tone(0)), Ok(LENGTH));
    let simulation = &rig.bench.simulation;
    assert_eq!((simulation.tone_hz(0), simulation.last_tone_hz(0)), (None, Some(10_000)));
    assert_eq!(speaker.write(b"short"), Err(Errno::EINVAL));
}

#[test]
fn a_new_device_can_refuse_writers_until_udev_has_got_round_to_it() {
    let options = Options { access_delay_ns: 50 * MILLISECOND_NS, ..Options::default() };
    let rig = Rig::with_options(Bench::as_recorded(), options);
    assert_eq!(rig.try_write("outB", "command", "stop"), Err(Errno::EACCES));
    assert_eq!(rig.read("outB", "state"), "");
    rig.pass_ms(50);
    assert_eq!(rig.try_write("outB", "command", "stop"), Ok(4));
}

#[test]
fn the_journal_has_every_write_in_order_with_its_answer() {
    let rig = Rig::recorded();
    rig.drive("speed_sp=100");
    rig.bench.simulation.record_writes(true);
    rig.pass_ms(10);
    rig.drive("speed_sp=200");
    assert_eq!(rig.try_write("outB", "speed_sp", "fast"), Err(Errno::EINVAL));
    let path = "sys/class/tacho-motor/motor1/speed_sp".to_owned();
    let written = |value: &str, answer| Written {
        time_ns: 10 * MILLISECOND_NS,
        robot: 0,
        path: path.clone(),
        value: value.as_bytes().to_vec(),
        answer,
    };
    let expected = [written("200", Ok(3)), written("fast", Err(Errno::EINVAL))];
    assert_eq!(rig.bench.simulation.take_writes(), expected);
    assert_eq!(rig.bench.simulation.take_writes(), []);
}

#[test]
fn the_same_seed_and_the_same_accesses_give_the_same_readings() {
    let run = || {
        let rig = Rig::recorded();
        rig.drive("speed_sp=321 run-forever");
        rig.write("in3", "mode", "COL-COLOR");
        rig.write("in4", "mode", "GYRO-RATE");
        let read = |_| {
            rig.pass_ms(7);
            (rig.bench.clock.now_ns(), rig.read("outB", "position"), rig.read("outB", "speed"))
        };
        (0..100).map(read).collect::<Vec<_>>()
    };
    assert_eq!(run(), run());
}

/// Two benches as two robots.
#[derive(Debug)]
struct Pair([Bench; 2]);

impl Physics for Pair {
    fn robots(&self) -> usize {
        2
    }

    fn plug(&self, robot: usize) -> Plug {
        self.0[robot].plug
    }

    fn step(&mut self, bridges: &[[Bridge; 4]]) {
        for (bench, bridges) in self.0.iter_mut().zip(bridges) {
            bench.step(std::slice::from_ref(bridges));
        }
    }

    fn edges(&self, robot: usize, out: usize) -> i64 {
        self.0[robot].edges(0, out)
    }

    fn measure(&mut self, robot: usize, input: usize, mode: &str) -> [i32; 8] {
        self.0[robot].measure(0, input, mode)
    }

    fn battery(&self, robot: usize) -> (f64, f64) {
        self.0[robot].battery(0)
    }
}

#[test]
fn robots_in_one_world_have_bricks_of_their_own() {
    let clock = Arc::new(VirtualClock::default());
    let world = Pair([Bench::as_recorded(), Bench::as_recorded()]);
    let simulation = Simulation::new(clock.clone(), Box::new(world), 1);
    assert_eq!(simulation.robots(), 2);
    let [one, other] = [0, 1].map(|robot| {
        let (simulation, clock) = (simulation.clone(), clock.clone());
        Rig::over(InProcess { brick: simulation.brick(robot), simulation, clock })
    });
    other.drive("speed_sp=400 run-forever");
    one.pass_ms(1000);
    assert_eq!((one.number("outB", "position"), one.read("outB", "state")), (0, String::new()));
    let (position, speed) = (other.number("outB", "position"), other.number("outB", "speed"));
    assert!((350..400).contains(&position), "{position}");
    assert!((385..=415).contains(&speed), "{speed} with edges spread evenly over a step");
    let serial = |rig: &Rig| rig.read_path("sys/class/board-info/board0/uevent").unwrap();
    assert_ne!(serial(&one), serial(&other));
    assert_eq!(simulation.brick(2).list("sys/class").err(), Some(Errno::ENOENT));
}

/// Every attribute of a brick that can be written, with the devices that have to be asked for.
fn writable(rig: &Rig) -> Vec<String> {
    let mut paths = Vec::new();
    let mut folders = vec!["sys/class".to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in rig.bench.brick.entries(&folder).unwrap() {
            let path = format!("{folder}/{}", entry.name);
            let is_device = entry.kind == EntryKind::Link
                && !matches!(entry.name.as_str(), "device" | "subsystem");
            let is_folder = entry.kind == EntryKind::Folder && !entry.name.contains(':');
            if is_device || is_folder {
                folders.push(path);
            } else if entry.kind == EntryKind::File && entry.permissions & 0o222 != 0 {
                paths.push(path);
            }
        }
    }
    paths.sort();
    paths
}

/// What may be written: text near to what is legal, or anything.
fn anything() -> impl Strategy<Value = Vec<u8>> {
    let words: Vec<&str> = "run-forever run-to-abs-pos run-to-rel-pos run-timed run-direct stop \
        reset hold brake \
        coast inversed normal timer none auto raw led dc-motor tacho-motor GYRO-RATE US-LISTEN \
        COL-COLOR run float"
        .split_whitespace()
        .collect();
    prop_oneof![
        3 => proptest::sample::select(words).prop_map(|word| word.as_bytes().to_vec()),
        3 => any::<i32>().prop_map(|number| number.to_string().into_bytes()),
        3 => (-1100_i32..1100).prop_map(|number| number.to_string().into_bytes()),
        2 => proptest::collection::vec(any::<u8>(), 0..40),
        1 => (0_usize..70_000).prop_map(|length| vec![b'7'; length]),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn whatever_is_written_leaves_every_driver_in_a_legal_state(
        writes in proptest::collection::vec(
            (any::<proptest::sample::Index>(), anything(), 0_i64..300),
            1..25,
        ),
    ) {
        let rig = Rig::recorded();
        rig.bench.simulation.add_servo(0, "ev3-ports:in1:i2c88:sv1", true).unwrap();
        for (index, value, ms) in writes {
            let paths = writable(&rig);
            let path = &paths[index.index(paths.len())];
            match rig.write_path(path, &value) {
                Ok(taken) => prop_assert_eq!(taken, value.len().min(4096), "{}", path),
                Err(error) => prop_assert!(
                    [
                        Errno::EINVAL,
                        Errno::ERANGE,
                        Errno::EOPNOTSUPP,
                        Errno::ENODEV,
                        Errno::EIO,
                    ]
                    .contains(&error),
                    "{path}: {error}"
                ),
            }
            rig.pass_ms(ms);
        }
        for name in rig.tree.list("sys/class/tacho-motor").unwrap() {
            let read = |attribute: &str| {
                rig.read_path(&format!("sys/class/tacho-motor/{name}/{attribute}")).unwrap()
            };
            let number = |attribute: &str| -> i64 { read(attribute).trim_end().parse().unwrap() };
            prop_assert!((-100..=100).contains(&number("duty_cycle")));
            prop_assert!((-100..=100).contains(&number("duty_cycle_sp")));
            prop_assert!(number("time_sp") >= 0 && (0..=60_000).contains(&number("ramp_up_sp")));
            let speed = number("speed_sp");
            prop_assert!(
                speed.abs() <= number("max_speed") || speed == i64::from(i32::MIN),
                "{speed}"
            );
            let state = read("state");
            let words: Vec<&str> = state.split_whitespace().collect();
            let order = ["running", "ramping", "holding", "overloaded", "stalled"];
            let places: Vec<usize> = words
                .iter()
                .map(|word| order.iter().position(|known| known == word).unwrap())
                .collect();
            prop_assert!(places.is_sorted(), "{state}");
            prop_assert!(!(state.contains("running") && state.contains("holding")), "{state}");
        }
        let bridges_are_legal =
            rig.world(|bench| bench.motors.iter().all(|motor| motor.speed.abs() <= 1100.0));
        prop_assert!(bridges_are_legal);
    }
}

#[test]
#[cfg_attr(target_arch = "arm", ignore = "how fast it is, without floats, says nothing")]
fn a_second_of_the_drivers_takes_less_than_a_tenth_to_simulate() {
    let rig = Rig::recorded();
    rig.drive("speed_sp=400 run-forever");
    let cpu = || Duration::from(clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID).unwrap());
    let begun = cpu();
    let seconds = 120;
    rig.pass_ms(seconds * 1000);
    let per_second = (cpu() - begun) / u32::try_from(seconds).unwrap();
    println!("drivers, with a model of four motors under them: {per_second:?} of processor time");
    assert!(per_second < Duration::from_millis(100), "{per_second:?}");
    assert_eq!(rig.read("outB", "state"), "running");
}
