//! Every fault on every device of the bench.

use std::sync::Arc;

use nix::errno::Errno;
use onbrick::ev3dev::{
    Access, Cause, ColourSensor, DeviceError, GyroSensor, PortAddress, TachoMotor, TouchSensor,
    Tree, UltrasonicSensor,
};
use onbrick::sim::{Bridge, DeviceFault, FaultError, Port};
use onbrick::units::degrees;

use crate::drivers_bench::Rig;

mod any_order;
mod in_a_room;

/// The bench's devices: port, and for sensors two readings and how long a frame takes, ms.
const SENSORS: [(Port, i32, i32, i64); 4] = [
    (Port::In1, 1000, 700, 100),
    (Port::In2, 0, 1, 10),
    (Port::In3, 40, 60, 4),
    (Port::In4, 100, 160, 4),
];
const MOTORS: [Port; 3] = [Port::OutA, Port::OutB, Port::OutD];

fn devices() -> impl Iterator<Item = Port> {
    SENSORS.iter().map(|(port, ..)| *port).chain(MOTORS)
}

/// A bench whose sensors measure the first of their readings.
fn rig() -> Rig {
    let rig = Rig::recorded();
    for (port, reading, ..) in SENSORS {
        measure(&rig, port, reading);
    }
    rig.pass_ms(1000);
    rig
}

fn measure(rig: &Rig, port: Port, reading: i32) {
    rig.world(|bench| bench.readings[port as usize][0] = reading);
}

/// Turns a motor's shaft by this many counts.
fn turn(rig: &Rig, port: Port, counts: f64) {
    rig.world(|bench| bench.motors[port as usize - Port::OutA as usize].edges += 2.0 * counts);
}

/// What a program reads first of a device.
fn live(port: Port) -> &'static str {
    if port as usize >= Port::OutA as usize { "position" } else { "value0" }
}

fn raw(rig: &Rig, port: Port) -> Result<i64, Errno> {
    rig.try_read(port.as_str(), live(port)).map(|text| text.trim_end().parse().unwrap())
}

fn inject(rig: &Rig, port: Port, fault: &str) {
    rig.bench.simulation.inject(0, port, DeviceFault::parse(fault).unwrap()).unwrap();
}

fn clear(rig: &Rig, port: Port) {
    rig.bench.simulation.clear(0, port).unwrap();
    rig.pass_ms(2500);
}

/// A device through its typed binding.
#[derive(Debug)]
enum Typed {
    Ultrasonic(UltrasonicSensor),
    Touch(TouchSensor),
    Colour(ColourSensor),
    Gyro(GyroSensor),
    Motor(TachoMotor),
}

impl Typed {
    fn at(tree: &Arc<dyn Tree>, port: Port) -> Self {
        let address: PortAddress = port.as_str().parse().unwrap();
        match port {
            Port::In1 => Self::Ultrasonic(UltrasonicSensor::at(tree, &address).unwrap()),
            Port::In2 => Self::Touch(TouchSensor::at(tree, &address).unwrap()),
            Port::In3 => Self::Colour(ColourSensor::at(tree, &address).unwrap()),
            Port::In4 => Self::Gyro(GyroSensor::at(tree, &address).unwrap()),
            _ => Self::Motor(TachoMotor::at(tree, &address).unwrap()),
        }
    }

    /// In the integers of the driver.
    fn read(&self) -> Result<f64, DeviceError> {
        match self {
            Self::Ultrasonic(sensor) => {
                Ok(sensor.distance_m()?.map_or(2550.0, |metres| metres * 1000.0))
            }
            Self::Touch(sensor) => sensor.is_pressed().map(f64::from),
            Self::Colour(sensor) => sensor.reflected_pct(),
            Self::Gyro(sensor) => sensor.angle_rad().map(degrees),
            Self::Motor(motor) => motor.position().map(f64::from),
        }
    }
}

#[test]
fn a_stuck_device_says_what_it_last_said_and_then_the_truth_again() {
    let rig = rig();
    for (port, before, after, _) in SENSORS {
        let typed = Typed::at(&rig.tree, port);
        inject(&rig, port, "stuck");
        measure(&rig, port, after);
        rig.pass_ms(500);
        assert_eq!(raw(&rig, port), Ok(before.into()), "{port}");
        assert_eq!(typed.read().unwrap().round(), f64::from(before), "{port}");
        clear(&rig, port);
        assert_eq!(raw(&rig, port), Ok(after.into()), "{port}");
    }
    for port in MOTORS {
        inject(&rig, port, "stuck");
        rig.pass_ms(2);
        turn(&rig, port, 90.0);
        rig.pass_ms(10);
        assert_eq!(raw(&rig, port), Ok(0), "{port}");
        clear(&rig, port);
        assert_eq!(raw(&rig, port), Ok(90), "{port}");
    }
    // The regulator believes the encoder: it gives all it has, and the driver says that the motor
    // is stalled.
    inject(&rig, Port::OutB, "stuck");
    rig.drive("speed_sp=300 run-forever");
    rig.pass_ms(1000);
    assert_eq!(rig.read("outB", "state"), "running overloaded stalled");
    assert_eq!(rig.world(|bench| bench.bridges[1]), Bridge::Duty(100));
}

#[test]
fn a_wrong_device_is_off_by_its_scale_and_a_jump_by_its_counts() {
    for (fault, expected) in [
        ("wrong 1.25", [1250, 1, 50, 125]),
        ("jump 30", [1030, 1, 70, 130]),
        ("wrong 1 -5", [995, 1, 35, 95]),
    ] {
        let rig = rig();
        for ((port, before, ..), expected) in SENSORS.into_iter().zip(expected) {
            let typed = Typed::at(&rig.tree, port);
            inject(&rig, port, fault);
            rig.pass_ms(200);
            assert_eq!(raw(&rig, port), Ok(expected.into()), "{port} {fault}");
            assert_eq!(typed.read().unwrap().round(), f64::from(expected), "{port} {fault}");
            clear(&rig, port);
            assert_eq!(raw(&rig, port), Ok(before.into()), "{port} after {fault}");
        }
    }
    for (fault, expected) in [("wrong 1.5", 120), ("wrong 1 -5", 75), ("jump 30", 110)] {
        for port in MOTORS {
            let rig = rig();
            inject(&rig, port, fault);
            rig.pass_ms(10);
            turn(&rig, port, 80.0);
            rig.pass_ms(10);
            assert_eq!(raw(&rig, port), Ok(expected), "{port} {fault}");
            assert_eq!(
                Typed::at(&rig.tree, port).read().unwrap(),
                f64::from(i32::try_from(expected).unwrap())
            );
            clear(&rig, port);
            assert_eq!(raw(&rig, port), Ok(80), "{port} after {fault}");
        }
    }
}

#[test]
fn slow_and_delayed_values_come_when_they_are_due() {
    // Whatever moment within a frame the change falls on: the new value is not there before the
    // first time, and there after the second.
    for (fault, early_ms, late_ms) in [("slow 10", 0, 10), ("delayed 300", 290, 0)] {
        let rig = rig();
        for (port, before, after, frame_ms) in SENSORS {
            inject(&rig, port, fault);
            rig.pass_ms(3000);
            let typed = Typed::at(&rig.tree, port);
            measure(&rig, port, after);
            if early_ms > 0 {
                rig.pass_ms(early_ms);
                assert_eq!(raw(&rig, port), Ok(before.into()), "{port} {fault} is too early");
                rig.pass_ms(12 + 2 * frame_ms);
            } else {
                rig.pass_ms(late_ms * frame_ms + frame_ms);
            }
            assert_eq!(raw(&rig, port), Ok(after.into()), "{port} {fault} is too late");
            assert_eq!(typed.read().unwrap().round(), f64::from(after), "{port} {fault}");
        }
        let changes = rig.world(|bench| bench.measured[0]);
        assert!(changes > 30, "the world is measured all the time: {changes}");
    }
    let rig = rig();
    for (fault, wait_ms) in [("slow 50", 100), ("delayed 100", 100)] {
        for port in MOTORS {
            let before = raw(&rig, port).unwrap();
            inject(&rig, port, fault);
            rig.pass_ms(2);
            turn(&rig, port, 45.0);
            rig.pass_ms(wait_ms - 10);
            assert_eq!(raw(&rig, port), Ok(before), "{port} {fault} is too early");
            rig.pass_ms(14);
            assert_eq!(raw(&rig, port), Ok(before + 45), "{port} {fault} is too late");
            clear(&rig, port);
        }
    }
}

#[test]
fn garbage_is_never_the_same_and_never_breaks_a_binding() {
    let rig = rig();
    for port in devices() {
        let typed = Typed::at(&rig.tree, port);
        inject(&rig, port, "garbage");
        let mut seen = std::collections::BTreeSet::new();
        for _ in 0..40 {
            rig.pass_ms(102);
            seen.insert(raw(&rig, port).unwrap());
            // A legal value, or a complaint about the number; nothing else.
            if let Err(error) = typed.read() {
                assert!(matches!(error.cause, Cause::Malformed(_)), "{error}");
            }
        }
        let least = if port == Port::In2 { 2 } else { 20 };
        assert!(seen.len() >= least, "{port}: {seen:?}");
        inject(&rig, port, "garbage text");
        let folder = rig.folder(port.as_str()).unwrap();
        let mut understood = 0;
        for _ in 0..40 {
            rig.pass_ms(2);
            let text = rig.read_path(&format!("{folder}/{}", live(port))).unwrap();
            match typed.read() {
                Ok(_) => understood += 1,
                Err(error) => {
                    assert!(matches!(error.cause, Cause::Malformed(_)), "{error} for {text:?}");
                }
            }
        }
        assert!(understood <= 4, "{port}: {understood} of 40 random texts passed for numbers");
        clear(&rig, port);
        assert!(raw(&rig, port).is_ok() && typed.read().is_ok(), "{port}");
    }
}

#[test]
fn a_device_that_answers_errors_answers_them_to_reads_of_values_and_to_all_writes() {
    let rig = rig();
    for (fault, errno) in [("enxio", Errno::ENXIO), ("eio", Errno::EIO)] {
        for port in devices() {
            let typed = Typed::at(&rig.tree, port);
            inject(&rig, port, fault);
            assert_eq!(raw(&rig, port), Err(errno), "{port}");
            assert_eq!(typed.read().unwrap_err().errno(), Some(errno), "{port}");
            let (attribute, value) =
                if live(port) == "position" { ("command", "stop") } else { ("mode", "TOUCH") };
            assert_eq!(rig.try_write(port.as_str(), attribute, value), Err(errno), "{port}");
            assert!(
                rig.try_read(port.as_str(), "driver_name").is_ok(),
                "{port}: the node is still there"
            );
            clear(&rig, port);
            assert!(raw(&rig, port).is_ok() && typed.read().is_ok(), "{port}");
        }
    }
}

#[test]
fn a_loose_plug_is_there_and_away_again() {
    let rig = rig();
    for port in devices() {
        let typed = Typed::at(&rig.tree, port);
        inject(&rig, port, "intermittent 0.4");
        let (mut there, mut away) = (0, 0);
        for _ in 0..1000 {
            rig.pass_ms(10);
            match typed.read() {
                Ok(_) => there += 1,
                Err(error) => {
                    assert_eq!(error.errno(), Some(Errno::ENXIO), "{port}: {error}");
                    away += 1;
                }
            }
        }
        assert!(
            (200..600).contains(&away) && there + away == 1000,
            "{port}: away {away} of 1000 times"
        );
        clear(&rig, port);
        assert!(typed.read().is_ok(), "{port}");
    }
}

#[test]
fn a_pulled_device_comes_back_with_a_new_number_and_its_defaults() {
    let rig = rig();
    for port in devices() {
        let name = port.as_str();
        let before = rig.folder(name).unwrap();
        let kept = rig.keep(name, live(port), Access::Read);
        if live(port) == "position" {
            rig.write(name, "speed_sp", "77");
        }
        inject(&rig, port, "unplug");
        rig.pass_ms(104);
        assert_eq!(rig.folder(name), None);
        assert_eq!(kept.read(&mut [0; 8]), Err(Errno::ENODEV), "{port}");
        assert_eq!(rig.read_path(&format!("{before}/driver_name")), Err(Errno::ENOENT), "{port}");
        inject(&rig, port, "denied");
        inject(&rig, port, "plug");
        rig.pass_ms(2000);
        let after = rig.folder(name).unwrap();
        assert_ne!(before, after, "{port}");
        let attribute = if live(port) == "position" { "speed_sp" } else { "mode" };
        assert_eq!(
            rig.write_path(&format!("{after}/{attribute}"), b"5"),
            Err(Errno::EACCES),
            "{port}"
        );
        if live(port) == "position" {
            assert_eq!(rig.read(name, "speed_sp"), "0", "{port}");
        }
        clear(&rig, port);
        assert_ne!(
            rig.write_path(&format!("{after}/{attribute}"), b"5"),
            Err(Errno::EACCES),
            "{port}"
        );
        assert_eq!(kept.read(&mut [0; 8]), Err(Errno::ENODEV), "{port}: the old number stays gone");
    }
    // A pull with an end puts the plug back by itself.
    rig.bench.simulation.control(0, "in4 unplug for 1").unwrap();
    rig.pass_ms(500);
    assert_eq!(rig.folder("in4"), None);
    rig.pass_ms(2500);
    assert_eq!(raw(&rig, Port::In4), Ok(100));
}

#[test]
fn without_power_a_motor_coasts_and_a_sensor_is_silent() {
    let rig = rig();
    for (port, before, after, _) in SENSORS.into_iter().filter(|(port, ..)| *port != Port::In2) {
        inject(&rig, port, "off");
        measure(&rig, port, after);
        rig.pass_ms(150);
        assert_eq!(raw(&rig, port), Ok(before.into()), "{port}");
        let mode = rig.read(port.as_str(), "mode");
        assert_eq!(rig.try_write(port.as_str(), "mode", &mode), Err(Errno::ETIMEDOUT), "{port}");
        assert_eq!(raw(&rig, port), Ok(before.into()), "{port}: its driver has not missed it yet");
        rig.pass_ms(60);
        assert_eq!(raw(&rig, port), Err(Errno::ENXIO), "{port}: nothing for 0.7 s");
        assert_eq!(rig.try_write(port.as_str(), "mode", &mode), Err(Errno::ENODEV), "{port}");
        rig.bench.simulation.clear(0, port).unwrap();
        rig.pass_ms(1000);
        assert_eq!(raw(&rig, port), Err(Errno::ENXIO), "{port} describes itself");
        rig.pass_ms(600);
        assert_eq!(raw(&rig, port), Ok(after.into()), "{port}");
        assert_eq!(rig.try_write(port.as_str(), "mode", &mode), Ok(mode.len()), "{port}");
    }
    measure(&rig, Port::In2, 1);
    inject(&rig, Port::In2, "off");
    rig.pass_ms(20);
    assert_eq!(raw(&rig, Port::In2), Ok(0), "an open pin is not pressed");
    for (port, out) in MOTORS.into_iter().zip([0, 1, 3]) {
        rig.write(port.as_str(), "speed_sp", "200");
        rig.write(port.as_str(), "command", "run-forever");
        inject(&rig, port, "off");
        rig.pass_ms(2000);
        assert_eq!(
            rig.world(|bench| (bench.bridges[out], bench.motors[out].speed)),
            (Bridge::Coast, 0.0)
        );
        clear(&rig, port);
        let speed = rig.world(|bench| bench.motors[out].speed);
        assert!((speed - 200.0).abs() < 20.0, "{port} turns again: {speed}");
        rig.write(port.as_str(), "command", "stop");
    }
}

#[test]
fn a_sensor_that_describes_itself_again_has_no_values_and_takes_no_mode() {
    let rig = rig();
    for port in [Port::In1, Port::In3, Port::In4] {
        let typed = Typed::at(&rig.tree, port);
        inject(&rig, port, "resync");
        rig.pass_ms(10);
        assert_eq!(raw(&rig, port), Err(Errno::ENXIO), "{port}");
        assert!(typed.read().unwrap_err().is_gone(), "{port}");
        let mode = rig.read(port.as_str(), "mode");
        assert_eq!(rig.try_write(port.as_str(), "mode", mode), Err(Errno::ENODEV), "{port}");
        clear(&rig, port);
        assert!(typed.read().is_ok(), "{port}");
    }
}

#[test]
fn a_modes_old_values_outlive_the_change_to_it() {
    let rig = rig();
    for (port, mode) in
        [(Port::In1, "US-DIST-IN"), (Port::In3, "COL-AMBIENT"), (Port::In4, "GYRO-RATE")]
    {
        let (first, before) = (rig.read(port.as_str(), "mode"), raw(&rig, port).unwrap());
        inject(&rig, port, "stale 3000");
        for (mode, old, new) in [(mode, 0, 11_i32), (first.as_str(), before, 12), (mode, 11, 13)] {
            rig.write(port.as_str(), "mode", mode);
            measure(&rig, port, new);
            rig.pass_ms(2900);
            assert_eq!(raw(&rig, port), Ok(old), "{port} {mode}");
            rig.pass_ms(300);
            assert_eq!(raw(&rig, port), Ok(new.into()), "{port} {mode}");
        }
    }
}

#[test]
fn a_foreign_hand_writes_what_a_program_could_write() {
    let rig = rig();
    rig.drive("speed_sp=300 stop_action=hold run-forever");
    rig.pass_ms(500);
    inject(&rig, Port::OutB, "reset");
    rig.pass_ms(1000);
    assert_eq!(
        (rig.read("outB", "state"), rig.read("outB", "stop_action")),
        (String::new(), "coast".into())
    );
    inject(&rig, Port::OutB, "write speed_sp 150");
    inject(&rig, Port::OutB, "write command run-forever");
    rig.pass_ms(500);
    assert_eq!(rig.read("outB", "state"), "running");
    for (port, text, errno) in [
        (Port::OutB, "write command fly", Errno::EINVAL),
        (Port::OutB, "write wings 1", Errno::ENOENT),
        (Port::OutB, "write state running", Errno::EACCES),
        (Port::In1, "reset", Errno::EINVAL),
    ] {
        let fault = DeviceFault::parse(text).unwrap();
        let error = rig.bench.simulation.inject(0, port, fault.clone()).unwrap_err();
        assert_eq!(error, FaultError::Refused { port, fault, source: errno }, "{port} {text}");
    }
}

#[test]
fn faults_that_a_port_cannot_have_are_refused_with_the_reason() {
    let rig = rig();
    for (port, text, why) in [
        (Port::In1, "block", "nothing turns there"),
        (Port::In1, "endless", "nothing turns there"),
        (Port::OutA, "resync", "it has no serial line"),
        (Port::In2, "stale 10", "a touch sensor has no serial line"),
        (Port::OutC, "plug", "the port has no device of its own"),
        (Port::OutC, "stuck", "the port has no device of its own"),
        (Port::OutC, "reset", "the port has no device of its own"),
    ] {
        let error =
            rig.bench.simulation.inject(0, port, DeviceFault::parse(text).unwrap()).unwrap_err();
        assert_eq!(error.to_string(), format!("`{text}` does not fit {port}: {why}"));
    }
    let error = rig.bench.simulation.inject(7, Port::In1, DeviceFault::Stuck).unwrap_err();
    assert_eq!(error.to_string(), "there is no robot 8; there are 1");
    assert!(rig.bench.simulation.faults_done().is_empty(), "what was refused was not done");
}
