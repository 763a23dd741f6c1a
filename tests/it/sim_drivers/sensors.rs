//! Sensors, input ports and serial lines.

use std::sync::Arc;
use std::time::Duration;

use nix::errno::Errno;
use onbrick::clock::{Clock, MILLISECOND_NS};
use onbrick::ev3dev::{Access, Tree};
use onbrick::sim::{SensorKind, Simulation};

use super::HandClock;
use crate::drivers_bench::{Bench, Rig};

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
        assert_eq!(
            rig.number(device, "value0"),
            i64::from(one),
            "{device} {first}: as it was left"
        );
        rig.pass_ms(stale_ms + 104);
        assert_eq!(rig.number(device, "value0"), 7, "{device} {first}");
    }
}

/// Follows orders; a driver feels a fault from its next step on.
fn follow(rig: &Rig, orders: &str) {
    rig.bench.simulation.control(0, orders).unwrap();
    rig.pass_ms(2);
}

#[test]
fn a_sensor_that_describes_itself_again_has_forgotten_its_frames() {
    let rig = Rig::recorded();
    rig.world(|bench| bench.readings[2][0] = 42);
    rig.pass_ms(10);
    rig.write("in3", "mode", "COL-COLOR");
    rig.pass_ms(30);
    follow(&rig, "in3 resync");
    follow(&rig, "in3 clear");
    rig.write("in3", "mode", "COL-REFLECT");
    assert_eq!(rig.number("in3", "value0"), 0);
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
        assert_eq!(
            (second.read(&mut buffer), &buffer[..12]),
            (Ok(12), b"COL-REFLECT\n".as_slice())
        );
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
    follow(&rig, "in3 off");
    rig.world(|bench| bench.readings[2][0] = 43);
    let before_ns = rig.bench.clock.now_ns();
    assert_eq!(rig.try_write("in3", "mode", "COL-COLOR"), Err(Errno::ETIMEDOUT));
    let waited_ms = (rig.bench.clock.now_ns() - before_ns) / MILLISECOND_NS;
    assert!((500..510).contains(&waited_ms), "{waited_ms} ms");
    assert_eq!(
        (rig.read("in3", "mode").as_str(), rig.number("in3", "value0")),
        ("COL-REFLECT", 42)
    );
    follow(&rig, "in3 clear\nin3 resync");
    assert_eq!(rig.try_write("in3", "mode", "COL-COLOR"), Err(Errno::ENODEV));
    assert_eq!(rig.try_read("in3", "value0"), Err(Errno::ENXIO));
    assert!(rig.folder("in3").is_some(), "it stays registered");
    follow(&rig, "in3 clear");
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
    assert_eq!(
        (rig.number("outC", "full_travel_count"), rig.number("outC", "count_per_m")),
        (200, 2000)
    );
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
    let values: Vec<i64> =
        (0..8).map(|index| rig.number("in1", &format!("value{index}"))).collect();
    assert_eq!(values, [-25, 40, 0, -128, 3, 4, 5, 6]);
    let mut frame = [0xAA; 64];
    assert_eq!(rig.keep("in1", "bin_data", Access::Read).read(&mut frame), Ok(32));
    assert_eq!(
        frame[..8].iter().map(|byte| i64::from(byte.cast_signed())).collect::<Vec<_>>(),
        values
    );
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
    assert_eq!(
        other.wait_changed(Duration::from_millis(50)),
        Ok(false),
        "a position wakes no reader"
    );
}
