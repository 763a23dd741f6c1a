//! The simulated drivers against what the real ones answered, and against the reference's tables.

use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

use nix::errno::Errno;
use nix::time::{ClockId, clock_gettime};
use onbrick::clock::{Clock, MILLISECOND_NS, VirtualClock};
use onbrick::ev3dev::{Access, Tree};
use onbrick::sim::{
    Bridge, Button, EntryKind, Options, Physics, Plug, Port, SensorKind, SerialLine, Simulation, Written,
};
use proptest::prelude::*;

use crate::drivers_bench::{Bench, InProcess, Rig};
use crate::transcript::{self, Tolerances};

#[test]
fn every_operation_of_the_kernel_transcript_gets_the_kernels_answer() {
    let bench = InProcess::new(Bench::as_recorded(), Options::default());
    let tolerances = Tolerances { speed: 8, position: 10, duty: 8, moment_ms: 100 };
    let outcome = transcript::play(bench.brick.as_ref(), bench.clock.as_ref(), &bench, tolerances);
    println!(
        "kernel transcript: {} operations with the same bytes, {} within {tolerances:?}, {} excepted, {} actions, {} entries of folders; \
         largest differences {:?}",
        outcome.exact, outcome.near, outcome.excepted, outcome.actions, outcome.entries, outcome.largest
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
        assert_eq!(found, Err(*expected), "{device} {attribute} {:?}", value.map(String::from_utf8_lossy));
    }
    assert_eq!(rig.number("outB", "speed_sp"), 700, "a refused value leaves the old one");
    assert_eq!(rig.try_write("outB", "speed_sp", ""), Ok(0), "an empty write does not reach the driver");
    rig.drive("run-forever position=5");
    assert_eq!(rig.read_path("sys/class/nothing/x/y"), Err(Errno::ENOENT));
    assert_eq!(rig.tree.list("sys/class/nothing"), Err(Errno::ENOENT));
}

#[test]
fn a_mode_write_waits_for_the_first_frame_on_a_serial_line_only() {
    let rig = Rig::recorded();
    let passed_ms = |device: &str, mode: &str| {
        let before_ns = rig.bench.clock.now_ns();
        rig.write(device, "mode", mode);
        assert_eq!(rig.read(device, "mode"), mode);
        (rig.bench.clock.now_ns() - before_ns) / MILLISECOND_NS
    };
    for mode in ["COL-COLOR", "COL-COLOR", "COL-REFLECT"] {
        let waited_ms = passed_ms("in3", mode);
        assert!((10..=54).contains(&waited_ms), "{mode}: the writer waited {waited_ms} ms");
    }
    assert_eq!(passed_ms("in2", "TOUCH"), 0);
}

/// The driver keeps the data of each mode apart (`mode_info[mode].raw_data`), and a sensor's first
/// message after a change of mode is what that mode measured when it was last used: ev3dev's issue
/// 1401.
#[test]
fn each_mode_of_a_sensor_has_a_frame_of_its_own() {
    let rig = Rig::recorded();
    let measures = |input: usize, value: i32| rig.world(|bench| bench.readings[input] = [value; 8]);
    // Sensor, a mode, its value; another, its value; how long its old values stay.
    for (device, input, (first, one), (second, two), stale_ms) in [
        ("in3", 2, ("COL-REFLECT", 35), ("COL-COLOR", 6), 20),
        ("in1", 0, ("US-DIST-CM", 318), ("US-LISTEN", 1), 1000),
        ("in1", 0, ("US-DIST-CM", 318), ("US-DIST-IN", 125), 100),
    ] {
        rig.write(device, "mode", first);
        measures(input, one);
        rig.pass_ms(1300);
        assert_eq!(rig.number(device, "value0"), i64::from(one), "{device} {first}");
        rig.write(device, "mode", second);
        measures(input, two);
        assert_eq!(rig.number(device, "value0"), 0, "{device} {second}: before its first data");
        let mut frame = [0xAA; 32];
        assert_eq!(rig.keep(device, "bin_data", Access::Read).read(&mut frame), Ok(32));
        assert_eq!(frame, [0; 32], "{device} {second}");
        rig.pass_ms(stale_ms + 104);
        assert_eq!(rig.number(device, "value0"), i64::from(two), "{device} {second}");
        rig.write(device, "mode", first);
        measures(input, 7);
        assert_eq!(rig.number(device, "value0"), i64::from(one), "{device} {first}: as it was left");
        rig.pass_ms(stale_ms + 104);
        assert_eq!(rig.number(device, "value0"), 7, "{device} {first}");
    }
}

#[test]
fn a_sensor_that_describes_itself_again_has_forgotten_its_frames() {
    let rig = Rig::recorded();
    rig.world(|bench| bench.readings[2][0] = 42);
    rig.pass_ms(10);
    rig.write("in3", "mode", "COL-COLOR");
    rig.pass_ms(30);
    let set_line = |line| rig.bench.simulation.set_line(0, Port::In3, line).unwrap();
    set_line(SerialLine::Resynchronising);
    set_line(SerialLine::Sound);
    rig.write("in3", "mode", "COL-REFLECT");
    assert_eq!(rig.number("in3", "value0"), 0);
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
fn a_second_mode_write_is_busy_while_the_first_one_waits() {
    let clock = Arc::new(HandClock::default());
    let simulation = Simulation::new(clock.clone(), Box::new(Bench::as_recorded()), 1);
    simulation.record_writes(true);
    let path = "sys/class/lego-sensor/sensor2/mode";
    let first = simulation.brick(0).open(path, Access::Write).unwrap();
    let second = simulation.brick(0).open(path, Access::ReadWrite).unwrap();
    std::thread::scope(|scope| {
        let writer = scope.spawn(move || first.write(b"RGB-RAW"));
        while simulation.take_writes().is_empty() {
            std::thread::yield_now();
        }
        assert_eq!(second.write(b"COL-COLOR"), Err(Errno::EBUSY));
        let mut buffer = [0; 16];
        assert_eq!((second.read(&mut buffer), &buffer[..12]), (Ok(12), b"COL-REFLECT\n".as_slice()));
        clock.move_to_ns(60 * MILLISECOND_NS);
        assert_eq!(writer.join().unwrap(), Ok(7));
        assert_eq!((second.read(&mut buffer), &buffer[..8]), (Ok(8), b"RGB-RAW\n".as_slice()));
    });
}

#[test]
fn a_sensor_that_does_not_answer_times_out_and_one_that_resynchronises_is_not_there() {
    let rig = Rig::recorded();
    rig.world(|bench| bench.readings[2][0] = 42);
    rig.pass_ms(10);
    let set_line = |line| rig.bench.simulation.set_line(0, Port::In3, line).unwrap();
    set_line(SerialLine::Silent);
    rig.world(|bench| bench.readings[2][0] = 43);
    let before_ns = rig.bench.clock.now_ns();
    assert_eq!(rig.try_write("in3", "mode", "COL-COLOR"), Err(Errno::ETIMEDOUT));
    let waited_ms = (rig.bench.clock.now_ns() - before_ns) / MILLISECOND_NS;
    assert!((500..510).contains(&waited_ms), "{waited_ms} ms");
    assert_eq!((rig.read("in3", "mode").as_str(), rig.number("in3", "value0")), ("COL-REFLECT", 42));
    set_line(SerialLine::Resynchronising);
    assert_eq!(rig.try_write("in3", "mode", "COL-COLOR"), Err(Errno::ENODEV));
    assert_eq!(rig.try_read("in3", "value0"), Err(Errno::ENXIO));
    assert!(rig.folder("in3").is_some(), "it stays registered");
    set_line(SerialLine::Sound);
    rig.pass_ms(10);
    assert_eq!(rig.number("in3", "value0"), 43);
}

#[test]
fn a_motor_port_in_another_mode_makes_what_the_mode_says() {
    let rig = Rig::recorded();
    let class = |name: &str| rig.tree.list(&format!("sys/class/{name}")).unwrap();
    rig.write("port:outC", "mode", "tacho-motor");
    assert_eq!(rig.read("outC", "driver_name"), "lego-ev3-l-motor");
    rig.write("port:outC", "set_device", "act-l12-ev3-50");
    assert_eq!(rig.folder("outC").unwrap(), "sys/class/tacho-motor/linear4");
    assert_eq!(rig.number("outC", "full_travel_count"), 100);
    assert_eq!(rig.number("outC", "max_speed"), 24);
    rig.write("port:outC", "set_device", "lego-nxt-motor");
    assert_eq!(
        (rig.read("outC", "driver_name").as_str(), rig.number("outC", "max_speed")),
        ("lego-nxt-motor", 1020)
    );
    assert_eq!(rig.try_write("port:outC", "set_device", "lego-ev3-us"), Err(Errno::EINVAL));
    rig.write("port:outC", "set_device", "act-l12-ev3-100");
    assert_eq!(rig.folder("outC").unwrap(), "sys/class/tacho-motor/linear6");
    assert_eq!((rig.number("outC", "full_travel_count"), rig.number("outC", "count_per_m")), (200, 2000));
    assert_eq!(rig.try_read("outC", "count_per_rot"), Err(Errno::ENOENT));
    assert_eq!(rig.read("port:outC", "status"), "tacho-motor");
    rig.write("port:outC", "mode", "led");
    assert_eq!(
        rig.read_path("sys/class/leds/ev3-ports:outC::brick-status/max_brightness"),
        Ok("100\n".to_owned())
    );
    rig.write("port:outC", "mode", "raw");
    assert_eq!(class("leds").len(), 4);
    // The driver unregisters and registers before the write returns: a file that was open is dead.
    let open = rig.keep("outB", "position", Access::Read);
    rig.write("port:outB", "mode", "dc-motor");
    assert_eq!(open.read(&mut [0; 8]), Err(Errno::ENODEV));
    assert_eq!((rig.folder("outB"), class("dc-motor").len()), (None, 1));
    let open = rig.keep("in2", "value0", Access::Read);
    rig.write("port:in2", "mode", "ev3-analog");
    assert_eq!(open.read(&mut [0; 8]), Err(Errno::ENODEV));
    assert_eq!(rig.folder("in2").unwrap(), "sys/class/lego-sensor/sensor4");
    // What is detected takes its time, but the old device is gone at once.
    rig.write("port:in2", "mode", "auto");
    assert_eq!(rig.folder("in2"), None);
}

#[test]
fn several_values_of_an_infrared_sensor_are_one_frame() {
    let mut physics = Bench::as_recorded();
    physics.plug.sensors = [Some(SensorKind::Infrared), None, None, None];
    physics.readings[0] = [-25, 40, 0, -128, 3, 4, 5, 6];
    let rig = Rig::new(physics);
    rig.write("in1", "mode", "IR-SEEK");
    rig.pass_ms(200);
    let values: Vec<i64> = (0..8).map(|index| rig.number("in1", &format!("value{index}"))).collect();
    assert_eq!(values, [-25, 40, 0, -128, 3, 4, 5, 6]);
    let mut frame = [0xAA; 64];
    assert_eq!(rig.keep("in1", "bin_data", Access::Read).read(&mut frame), Ok(32));
    assert_eq!(frame[..8].iter().map(|byte| i64::from(byte.cast_signed())).collect::<Vec<_>>(), values);
    assert_eq!(rig.read("in1", "bin_data_format"), "s8");
}

#[test]
fn a_touch_wakes_those_who_poll_it() {
    let rig = Rig::recorded();
    rig.pass_ms(20);
    let file = rig.keep("in2", "value0", Access::Read);
    assert_eq!(file.wait_changed(Duration::ZERO), Ok(true), "never read");
    let mut buffer = [0; 8];
    assert_eq!(file.read(&mut buffer), Ok(2));
    assert_eq!(file.wait_changed(Duration::from_millis(50)), Ok(false));
    rig.world(|bench| bench.readings[1][0] = 1);
    assert_eq!(file.wait_changed(Duration::from_millis(50)), Ok(true));
    assert_eq!((file.read(&mut buffer), &buffer[..2]), (Ok(2), b"1\n".as_slice()));
    let other = rig.keep("outB", "position", Access::Read);
    other.read(&mut buffer).unwrap();
    assert_eq!(other.wait_changed(Duration::from_millis(50)), Ok(false), "positions wake nobody");
}

#[test]
fn a_dc_motor_latches_duty_and_polarity_and_ramps_by_signed_difference() {
    let rig = Rig::recorded();
    rig.write("port:outB", "mode", "dc-motor");
    assert_eq!(rig.read("dc:outB", "driver_name"), "rcx-motor");
    assert_eq!(rig.folder("dc:outB").unwrap(), "sys/class/dc-motor/motor0");
    assert_eq!(rig.read("dc:outB", "commands"), "run-forever run-timed run-direct stop");
    assert_eq!(rig.read("dc:outB", "stop_actions"), "coast brake");
    assert_eq!(rig.try_read("dc:outB", "stop_action"), Err(Errno::EACCES));
    assert_eq!(rig.try_write("dc:outB", "command", "reset"), Err(Errno::EINVAL));
    assert_eq!(rig.try_write("dc:outB", "time_sp", "60001"), Err(Errno::EINVAL));
    assert_eq!(rig.try_write("dc:outB", "ramp_up_sp", " 500abc"), Ok(7), "scanned, not parsed");
    assert_eq!(rig.try_write("dc:outB", "ramp_up_sp", "10001"), Err(Errno::EINVAL));
    rig.write("dc:outB", "duty_cycle_sp", "60");
    rig.write("dc:outB", "command", "run-forever");
    rig.pass_ms(150);
    let duty = rig.number("dc:outB", "duty_cycle");
    assert!((15..=30).contains(&duty), "{duty} % after 150 of 300 ms, in steps of 100 ms");
    assert_eq!(rig.read("dc:outB", "state"), "running ramping");
    rig.pass_ms(500);
    assert_eq!(
        (rig.number("dc:outB", "duty_cycle"), rig.read("dc:outB", "state")),
        (60, "running".to_owned())
    );
    rig.write("dc:outB", "duty_cycle_sp", "80");
    rig.write("dc:outB", "polarity", "inversed");
    rig.pass_ms(200);
    assert_eq!(rig.number("dc:outB", "duty_cycle"), 60, "latched");
    assert!(rig.world(|bench| bench.motors[1].speed) > 500.0);
    rig.write("dc:outB", "command", "run-direct");
    rig.pass_ms(1000);
    assert_eq!(rig.number("dc:outB", "duty_cycle"), 80);
    assert!(rig.world(|bench| bench.motors[1].speed) < -500.0, "polarity counts at the command");
    rig.write("dc:outB", "stop_action", "brake");
    rig.write("dc:outB", "command", "stop");
    rig.pass_ms(1000);
    assert_eq!((rig.read("dc:outB", "state"), rig.number("dc:outB", "duty_cycle")), (String::new(), 0));
    rig.write("dc:outB", "time_sp", "200");
    rig.write("dc:outB", "command", "run-timed");
    rig.pass_ms(190);
    assert!(rig.read("dc:outB", "state").starts_with("running"));
    rig.pass_ms(1200);
    assert_eq!(rig.read("dc:outB", "state"), "");
}

/// `schedule_delayed_work` leaves work alone that is pending: a command within 100 ms of the last
/// step of the ramp is put to the bridge when that work is due.
#[test]
fn a_dc_motors_command_waits_for_the_work_that_is_pending() {
    let rig = Rig::recorded();
    rig.write("port:outB", "mode", "dc-motor");
    let command = |duty: &str, command: &str| {
        rig.write("dc:outB", "duty_cycle_sp", duty);
        rig.write("dc:outB", "command", command);
    };
    let shows = || (rig.number("dc:outB", "duty_cycle"), rig.read("dc:outB", "state"));
    command("60", "run-forever");
    assert_eq!(shows(), (60, "running ramping".into()), "without pending work at once");
    rig.pass_ms(30);
    command("-20", "run-forever");
    assert_eq!(shows(), (60, "running ramping".into()));
    rig.pass_ms(60);
    assert_eq!(shows(), (60, "running ramping".into()));
    rig.pass_ms(24);
    assert_eq!(shows(), (-20, "running ramping".into()));
    // The next step is 100 ms and a tick after the command that waited, not after its own one.
    rig.write("dc:outB", "command", "stop");
    rig.pass_ms(20);
    assert_eq!(shows(), (-20, "running ramping".into()), "a stop waits as well");
    rig.pass_ms(8);
    assert_eq!(shows(), (0, String::new()));
    command("40", "run-direct");
    assert_eq!(shows(), (40, "running ramping".into()));
    rig.pass_ms(150);
    assert_eq!(shows(), (40, "running".into()));
    rig.write("dc:outB", "duty_cycle_sp", "50");
    assert_eq!(shows(), (50, "running ramping".into()));
}

/// The first step of a ramp is done with the command, at its very beginning; the others every 100
/// ms and a tick.
#[test]
fn a_dc_motors_ramp_has_its_steps_where_the_driver_has_them() {
    let rig = Rig::recorded();
    rig.write("port:outB", "mode", "dc-motor");
    rig.write("dc:outB", "ramp_up_sp", "1000");
    rig.write("dc:outB", "duty_cycle_sp", "100");
    rig.write("dc:outB", "command", "run-forever");
    assert_eq!(rig.read("dc:outB", "state"), "running ramping");
    let mut steps = vec![(0, rig.number("dc:outB", "duty_cycle"))];
    for ms in (2..1400).step_by(2) {
        rig.pass_ms(2);
        let duty = rig.number("dc:outB", "duty_cycle");
        if steps.last().is_some_and(|(_, last)| *last != duty) {
            steps.push((ms, duty));
        }
    }
    let expected: Vec<(i64, i64)> =
        (0..=9).map(|step| (110 * step, 11 * step)).chain([(1100, 100)]).collect();
    assert_eq!(steps, expected);
    assert_eq!(rig.read("dc:outB", "state"), "running");
}

#[test]
fn a_servo_exists_when_a_controller_is_added() {
    let rig = Rig::recorded();
    let name = rig.bench.simulation.add_servo(0, "ev3-ports:in1:i2c88:sv1", false).unwrap();
    let path = |attribute: &str| format!("sys/class/servo-motor/{name}/{attribute}");
    let pulse_us = || rig.bench.simulation.servo_pulse_us(0, &name);
    assert_eq!((name.as_str(), pulse_us()), ("motor0", None));
    assert_eq!(rig.read_path(&path("mid_pulse_sp")), Ok("1500\n".to_owned()));
    assert_eq!(rig.read_path(&path("rate_sp")), Err(Errno::EOPNOTSUPP));
    assert_eq!(rig.write_path(&path("position_sp"), b"101"), Err(Errno::EINVAL));
    assert_eq!(rig.write_path(&path("min_pulse_sp"), b"1001"), Err(Errno::EINVAL));
    assert_eq!(rig.write_path(&path("command"), b"run"), Ok(3));
    assert_eq!(rig.write_path(&path("position_sp"), b"50"), Ok(2));
    assert_eq!((rig.read_path(&path("state")), pulse_us()), (Ok("running\n".to_owned()), Some(2000)));
    assert_eq!(rig.write_path(&path("polarity"), b"inversed"), Ok(8));
    assert_eq!(pulse_us(), Some(1000), "polarity acts at once");
    assert_eq!(rig.write_path(&path("command"), b"float"), Ok(5));
    assert_eq!((rig.read_path(&path("state")), pulse_us()), (Ok("\n".to_owned()), None));
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
    let number =
        |attribute: &str| -> i64 { rig.read_path(&path(attribute)).unwrap().trim_end().parse().unwrap() };
    assert!((number("voltage_now") - 7_400_000).abs() <= 4_888, "{} µV", number("voltage_now"));
    assert_eq!(number("voltage_now") % 9_775, 0);
    assert!((number("current_now") - 180_000).abs() <= 3_250, "{} µA", number("current_now"));
    assert_eq!((number("voltage_max_design"), number("voltage_min_design")), (90_000_000, 48_000_000));
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
    let buttons = rig.tree.open("dev/input/by-path/platform-gpio_keys-event", Access::Read).unwrap();
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

/// What stands in section 2 of the reference and is not in the transcript.
#[test]
fn a_lease_of_300_ms_ends_by_itself_within_a_kernel_tick() {
    for phase_ms in 0..10 {
        let rig = Rig::recorded();
        rig.pass_ms(phase_ms);
        rig.drive("speed_sp=300 time_sp=300 stop_action=brake run-timed");
        rig.pass_ms(296);
        assert_eq!(rig.read("outB", "state"), "running", "phase {phase_ms} ms");
        rig.pass_ms(18);
        assert_eq!(rig.read("outB", "state"), "", "phase {phase_ms} ms");
        assert_eq!(rig.number("outB", "duty_cycle"), 0);
    }
}

#[test]
fn a_move_that_arrives_before_its_ramp_is_through_leaves_ramping_set() {
    let rig = Rig::recorded();
    rig.drive("ramp_up_sp=10000 speed_sp=1000 position_sp=60 stop_action=brake run-to-rel-pos");
    rig.pass_ms(4000);
    assert_eq!(rig.read("outB", "state"), "ramping");
    rig.drive("ramp_up_sp=100 speed_sp=100 run-forever");
    rig.pass_ms(1000);
    assert_eq!(rig.read("outB", "state"), "running", "a later ramp that completes clears it");
}

#[test]
fn a_ramp_after_one_that_stuck_starts_from_standstill() {
    let rig = Rig::recorded();
    rig.drive("ramp_up_sp=1000 speed_sp=1000 position_sp=150 stop_action=brake run-to-rel-pos");
    rig.pass_ms(2000);
    assert_eq!(rig.read("outB", "state"), "ramping");
    rig.drive("ramp_up_sp=60000 run-forever");
    rig.pass_ms(600);
    let speed = rig.number("outB", "speed");
    assert!(speed < 50, "{speed} counts/s after 0.6 of 57 s");
}

#[test]
fn a_ramp_counts_from_50_ms_before_its_command() {
    let rig = Rig::recorded();
    rig.pass_ms(10);
    rig.drive("ramp_up_sp=1000 speed_sp=1050 run-forever");
    rig.pass_ms(2);
    // 50 ms of 1000 are a set point of 52 counts/s: 5 % of duty from the proportional gain.
    assert_eq!(rig.number("outB", "duty_cycle"), 5);
}

#[test]
fn a_finished_move_holds_its_target_and_a_stop_holds_where_it_is() {
    for target in 300..310 {
        let rig = Rig::recorded();
        rig.drive("speed_sp=1050 stop_action=hold");
        rig.drive(&format!("position_sp={target} run-to-abs-pos"));
        rig.pass_ms(3000);
        assert_eq!(
            (rig.number("outB", "position"), rig.read("outB", "state")),
            (target, "holding".to_owned())
        );
        rig.drive("speed_sp=400 run-forever");
        rig.pass_ms(500);
        rig.drive("stop");
        let here = rig.number("outB", "position");
        rig.pass_ms(1000);
        assert!(
            (rig.number("outB", "position") - here).abs() <= 1,
            "{} near {here}",
            rig.number("outB", "position")
        );
    }
}

#[test]
fn a_hold_leaves_the_bridge_as_it_was_until_it_has_something_to_say() {
    let rig = Rig::recorded();
    let bridge = || rig.world(|bench| bench.bridges[1]);
    rig.drive("stop_action=hold stop");
    rig.pass_ms(100);
    assert_eq!(bridge(), Bridge::Coast);
    rig.drive("stop_action=brake stop stop_action=hold stop");
    rig.pass_ms(100);
    assert_eq!(bridge(), Bridge::Brake);
    rig.world(|bench| bench.motors[1].edges += 8.0);
    rig.pass_ms(4);
    assert_eq!((bridge(), rig.read("outB", "state")), (Bridge::Duty(-32), "holding".to_owned()));
}

#[test]
fn a_move_with_ramp_down_slows_down_before_its_target() {
    let rig = Rig::recorded();
    rig.drive("ramp_down_sp=1000 speed_sp=500 position_sp=1000 stop_action=brake run-to-abs-pos");
    let mut ramped = 0;
    let mut speeds = Vec::new();
    for _ in 0..500 {
        rig.pass_ms(10);
        let state = rig.read("outB", "state");
        if !state.contains("running") {
            break;
        }
        let slows = rig.number("outB", "position") > 700 && state.contains("ramping");
        ramped += i64::from(slows);
        speeds.push(rig.number("outB", "speed"));
    }
    assert!(ramped > 10, "ramping down for {ramped} times 10 ms");
    assert!(speeds.iter().max() > Some(&480) && speeds.last() < Some(&150), "{speeds:?}");
    rig.pass_ms(300);
    let position = rig.number("outB", "position");
    assert!((1000..=1010).contains(&position), "stopped at {position}");
}

#[test]
fn a_relative_move_of_0_is_a_stop_that_is_remembered_as_a_move() {
    let rig = Rig::recorded();
    rig.drive("speed_sp=400 position_sp=360 stop_action=hold run-to-rel-pos position_sp=0 run-to-rel-pos");
    assert_eq!(rig.read("outB", "state"), "holding");
    rig.drive("position_sp=100 run-to-rel-pos");
    rig.pass_ms(3000);
    assert_eq!(rig.read("outB", "state"), "holding");
    let position = rig.number("outB", "position");
    assert!((455..=465).contains(&position), "360 + 0 + 100, not {position}");
}

#[test]
fn a_hold_far_from_its_set_point_turns_round_by_overflow() {
    for (shift, toward) in [(26_000, 1), (30_000, -1)] {
        let rig = Rig::recorded();
        rig.drive("stop_action=hold stop");
        rig.write("outB", "position", &(-shift).to_string());
        rig.pass_ms(4);
        assert_eq!(rig.number("outB", "duty_cycle"), 100 * toward, "{shift} counts below the set point");
        assert_eq!(rig.read("outB", "state"), "holding overloaded");
    }
}

#[test]
fn the_one_speed_that_slips_through_the_check_does_no_harm() {
    let rig = Rig::recorded();
    for command in ["run-forever", "run-to-abs-pos", "run-to-rel-pos", "run-timed", "stop"] {
        for ramp in ["0", "60000"] {
            rig.write("outB", "ramp_up_sp", ramp);
            rig.write("outB", "ramp_down_sp", ramp);
            rig.drive("speed_sp=-2147483648 position_sp=2147483647 polarity=inversed time_sp=2147483647");
            rig.write("outB", "command", command);
            rig.pass_ms(500);
            assert!(rig.number("outB", "duty_cycle").abs() <= 100, "{command} with ramp {ramp}");
            rig.drive("reset");
        }
    }
}

#[test]
fn a_regulated_0_on_a_coasting_motor_leaves_it_coasting_and_a_direct_0_after_driving_brakes() {
    let rig = Rig::recorded();
    let speed = |rig: &Rig| rig.world(|bench| bench.motors[1].speed);
    rig.drive("speed_sp=800 run-forever");
    rig.pass_ms(1000);
    rig.drive("stop speed_sp=0 run-forever");
    rig.pass_ms(100);
    assert!(speed(&rig) > 400.0, "coasts at {}", speed(&rig));
    rig.drive("duty_cycle_sp=100 run-direct");
    rig.pass_ms(1000);
    rig.drive("duty_cycle_sp=0");
    rig.pass_ms(100);
    assert!(speed(&rig) < 200.0, "brakes to {}", speed(&rig));
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
            let is_device =
                entry.kind == EntryKind::Link && !matches!(entry.name.as_str(), "device" | "subsystem");
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
    let words: Vec<&str> = "run-forever run-to-abs-pos run-to-rel-pos run-timed run-direct stop reset hold brake \
        coast inversed normal timer none auto raw led dc-motor tacho-motor GYRO-RATE US-LISTEN COL-COLOR run float"
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
        writes in proptest::collection::vec((any::<proptest::sample::Index>(), anything(), 0_i64..300), 1..25),
    ) {
        let rig = Rig::recorded();
        rig.bench.simulation.add_servo(0, "ev3-ports:in1:i2c88:sv1", true).unwrap();
        for (index, value, ms) in writes {
            let paths = writable(&rig);
            let path = &paths[index.index(paths.len())];
            match rig.write_path(path, &value) {
                Ok(taken) => prop_assert_eq!(taken, value.len().min(4096), "{}", path),
                Err(error) => prop_assert!(
                    [Errno::EINVAL, Errno::ERANGE, Errno::EOPNOTSUPP, Errno::ENODEV, Errno::EIO].contains(&error),
                    "{path}: {error}"
                ),
            }
            rig.pass_ms(ms);
        }
        for name in rig.tree.list("sys/class/tacho-motor").unwrap() {
            let read = |attribute: &str| rig.read_path(&format!("sys/class/tacho-motor/{name}/{attribute}")).unwrap();
            let number = |attribute: &str| -> i64 { read(attribute).trim_end().parse().unwrap() };
            prop_assert!((-100..=100).contains(&number("duty_cycle")));
            prop_assert!((-100..=100).contains(&number("duty_cycle_sp")));
            prop_assert!(number("time_sp") >= 0 && (0..=60_000).contains(&number("ramp_up_sp")));
            let speed = number("speed_sp");
            prop_assert!(speed.abs() <= number("max_speed") || speed == i64::from(i32::MIN), "{speed}");
            let state = read("state");
            let words: Vec<&str> = state.split_whitespace().collect();
            let order = ["running", "ramping", "holding", "overloaded", "stalled"];
            let places: Vec<usize> = words.iter().map(|word| order.iter().position(|known| known == word).unwrap()).collect();
            prop_assert!(places.is_sorted(), "{state}");
            prop_assert!(!(state.contains("running") && state.contains("holding")), "{state}");
        }
        let bridges_are_legal = rig.world(|bench| bench.motors.iter().all(|motor| motor.speed.abs() <= 1100.0));
        prop_assert!(bridges_are_legal);
    }
}

#[test]
fn what_a_simulated_second_costs_is_printed() {
    let rig = Rig::recorded();
    rig.drive("speed_sp=400 run-forever");
    let cpu = || Duration::from(clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID).unwrap());
    let begun = cpu();
    let seconds = 120;
    rig.pass_ms(seconds * 1000);
    let per_second = (cpu() - begun) / u32::try_from(seconds).unwrap();
    println!(
        "drivers, with a model of four motors under them: {per_second:?} of processor time a simulated second and robot"
    );
    assert_eq!(rig.read("outB", "state"), "running");
}
