//! The reference's scenarios of how the drivers of stretch behave (section 15.6), each through both
//! doors: in this process, and through the kernel's files of a mounted brick.

use std::time::Duration;

use nix::errno::Errno;
use onbrick::ev3dev::Access;
use onbrick::sim::{GyroMake, MotorKind, Options, Plugged, Port};

use crate::drivers_bench::{Bench, Rig};
use crate::mount::bench::Mounted;

type Scenario = (&'static str, GyroMake, fn(&Rig));

/// In the order of the reference; 19 is two of them, one for each make of gyro.
const SCENARIOS: [Scenario; 21] = [
    ("1: a new speed waits for the next command", GyroMake::Old, a_new_speed_waits),
    ("2: a new duty cycle acts at once in run-direct", GyroMake::Old, a_new_duty_acts),
    ("3: a move ignores the sign of its speed", GyroMake::Old, a_move_ignores_the_sign),
    ("4: a second relative move starts from the first one's target", GyroMake::Old, moves_add_up),
    (
        "5: a relative move after a stop starts from where it is",
        GyroMake::Old,
        a_stop_forgets_the_target,
    ),
    (
        "6: a timed run keeps the stop action of its beginning",
        GyroMake::Old,
        the_stop_action_is_latched,
    ),
    ("7: a stop takes the stop action of the file", GyroMake::Old, a_stop_reads_the_file),
    (
        "8: polarity turns readings round, not the motion",
        GyroMake::Old,
        polarity_turns_readings_round,
    ),
    (
        "9: a hold keeps its set point where the scale is shifted",
        GyroMake::Old,
        a_hold_keeps_its_number,
    ),
    ("10: a new position ends a move", GyroMake::Old, a_new_position_ends_a_move),
    ("11: a move to where it is ends within a tick", GyroMake::Old, a_move_to_here_is_over),
    (
        "12: standing still while running is a stall after 100 ms",
        GyroMake::Old,
        standing_still_is_a_stall,
    ),
    (
        "13: a blocked rotor overloads, and stalls some 300 ms later",
        GyroMake::Old,
        a_blocked_rotor_overloads,
    ),
    ("14: a stop with hold holds", GyroMake::Old, a_stop_can_hold),
    ("15: a ramp up to half speed takes half its time", GyroMake::Old, a_ramp_up_is_a_share),
    ("16: a timed run ramps down after its time", GyroMake::Old, a_timed_run_ramps_down),
    (
        "17: a replugged motor is another one, and old files are dead",
        GyroMake::Old,
        a_replugged_motor_is_another,
    ),
    (
        "18: writing the same port mode registers the device again",
        GyroMake::Old,
        the_same_mode_registers_anew,
    ),
    ("19: an old gyro zeroes by a change of mode", GyroMake::Old, an_old_gyro_zeroes),
    ("19: a new gyro does not", GyroMake::New, a_new_gyro_does_not),
    (
        "20: an ultrasonic sensor has ten new values a second",
        GyroMake::Old,
        an_ultrasonic_sensor_is_slow,
    ),
];

#[test]
fn every_scenario_of_the_reference_goes_as_it_says_in_process() {
    for (name, gyro, play) in SCENARIOS {
        println!("{name}");
        play(&Rig::with_options(Bench::as_recorded(), Options { gyro, ..Options::default() }));
    }
}

#[test]
fn every_scenario_of_the_reference_goes_as_it_says_through_the_mount() {
    for (name, gyro, play) in SCENARIOS {
        let Some(mounted) = Mounted::with_options(Options { gyro, ..Options::default() }) else {
            return;
        };
        println!("{name}");
        play(mounted.rig());
    }
}

fn state(rig: &Rig) -> String {
    rig.read("outB", "state")
}

fn position(rig: &Rig) -> i64 {
    rig.number("outB", "position")
}

fn assert_near(what: &str, found: i64, expected: i64, within: i64) {
    assert!(
        (found - expected).abs() <= within,
        "{what}: {found}, not within {within} of {expected}"
    );
}

fn a_new_speed_waits(rig: &Rig) {
    rig.drive("speed_sp=400 run-forever");
    rig.pass_ms(1000);
    rig.drive("speed_sp=800");
    rig.pass_ms(1000);
    assert_near("speed before the command", rig.number("outB", "speed"), 400, 10);
    rig.drive("run-forever");
    rig.pass_ms(1500);
    assert_near("speed after it", rig.number("outB", "speed"), 800, 20);
}

fn a_new_duty_acts(rig: &Rig) {
    rig.drive("duty_cycle_sp=30 run-direct");
    rig.pass_ms(500);
    assert_eq!(rig.number("outB", "duty_cycle"), 30);
    rig.drive("duty_cycle_sp=60");
    rig.pass_ms(2);
    assert_eq!(rig.number("outB", "duty_cycle"), 60);
}

fn a_move_ignores_the_sign(rig: &Rig) {
    rig.drive("speed_sp=-400 position_sp=360 stop_action=hold run-to-rel-pos");
    rig.pass_ms(3000);
    assert_near("position", position(rig), 360, 1);
}

fn moves_add_up(rig: &Rig) {
    rig.drive("speed_sp=400 position_sp=360 stop_action=coast run-to-rel-pos");
    rig.pass_ms(3000);
    assert!(position(rig) > 361, "it rolled on, to {}", position(rig));
    rig.drive("stop_action=hold run-to-rel-pos");
    rig.pass_ms(3000);
    assert_near("position", position(rig), 720, 1);
}

fn a_stop_forgets_the_target(rig: &Rig) {
    rig.drive("speed_sp=400 position_sp=360 stop_action=brake run-to-rel-pos");
    while position(rig) < 200 {
        rig.pass_ms(2);
    }
    rig.drive("stop");
    rig.pass_ms(500);
    let stopped = position(rig);
    assert!(stopped < 300, "{stopped}");
    rig.drive("stop_action=hold run-to-rel-pos");
    rig.pass_ms(3000);
    assert_near("position", position(rig), stopped + 360, 1);
}

fn the_stop_action_is_latched(rig: &Rig) {
    rig.drive("speed_sp=400 time_sp=1000 stop_action=brake run-timed");
    rig.pass_ms(500);
    rig.drive("stop_action=hold");
    rig.pass_ms(450);
    assert_eq!(state(rig), "running");
    rig.pass_ms(100);
    assert_eq!((state(rig), rig.read("outB", "stop_action")), (String::new(), "hold".to_owned()));
}

fn a_stop_reads_the_file(rig: &Rig) {
    rig.drive("speed_sp=400 stop_action=coast run-forever");
    rig.pass_ms(500);
    rig.drive("stop_action=hold stop");
    rig.pass_ms(20);
    assert_eq!(state(rig), "holding");
}

fn polarity_turns_readings_round(rig: &Rig) {
    rig.drive("speed_sp=400 run-forever");
    rig.pass_ms(1000);
    let before = position(rig);
    rig.drive("polarity=inversed");
    assert_eq!(position(rig), -before);
    rig.pass_ms(500);
    assert_near("speed", rig.number("outB", "speed"), -400, 10);
    assert_near("position", position(rig), -before - 200, 10);
    let true_speed = rig.world(|bench| bench.motors[1].speed);
    assert!((true_speed - 400.0).abs() < 20.0, "{true_speed} counts/s");
}

fn a_hold_keeps_its_number(rig: &Rig) {
    rig.drive("speed_sp=400 position_sp=500 stop_action=hold run-to-abs-pos");
    rig.pass_ms(3000);
    assert_eq!((position(rig), state(rig)), (500, "holding".to_owned()));
    rig.drive("position=0");
    assert_eq!((position(rig), state(rig)), (0, "holding".to_owned()));
    rig.pass_ms(3000);
    assert_near("position in the new scale", position(rig), 500, 1);
    assert!(state(rig).starts_with("holding"), "{}", state(rig));
}

fn a_new_position_ends_a_move(rig: &Rig) {
    rig.drive("speed_sp=400 position_sp=1000 stop_action=brake run-to-abs-pos");
    rig.pass_ms(500);
    assert_eq!(state(rig), "running");
    rig.drive("position=0");
    rig.pass_ms(4);
    assert_eq!(state(rig), "");
    rig.pass_ms(1000);
    assert!((0..40).contains(&position(rig)), "{}", position(rig));
}

fn a_move_to_here_is_over(rig: &Rig) {
    rig.drive("speed_sp=400 position_sp=0 stop_action=brake run-to-abs-pos");
    rig.pass_ms(4);
    assert_eq!((state(rig), position(rig)), (String::new(), 0));
}

fn standing_still_is_a_stall(rig: &Rig) {
    rig.pass_ms(10);
    rig.drive("speed_sp=0 run-forever");
    rig.pass_ms(90);
    assert_eq!(state(rig), "running");
    rig.pass_ms(20);
    assert_eq!(state(rig), "running stalled");
    assert_eq!(rig.read("outB", "duty_cycle"), "0");
}

fn a_blocked_rotor_overloads(rig: &Rig) {
    rig.drive("speed_sp=500 run-forever");
    rig.pass_ms(1000);
    assert_eq!(state(rig), "running");
    rig.world(|bench| bench.blocked[1] = true);
    let mut overloaded_ms = None;
    let mut stalled_ms = None;
    for ms in 0..600 {
        rig.pass_ms(1);
        let state = state(rig);
        overloaded_ms = overloaded_ms.or(state.contains("overloaded").then_some(ms));
        stalled_ms = stalled_ms.or(state.contains("stalled").then_some(ms));
    }
    let (overloaded_ms, stalled_ms) = (overloaded_ms.unwrap(), stalled_ms.unwrap());
    assert!((20..=250).contains(&overloaded_ms), "overloaded after {overloaded_ms} ms");
    assert!((250..=400).contains(&stalled_ms), "stalled after {stalled_ms} ms");
    assert_eq!(state(rig), "running overloaded stalled");
    assert_eq!(rig.read("outB", "duty_cycle"), "100");
}

fn a_stop_can_hold(rig: &Rig) {
    rig.drive("stop_action=hold stop");
    rig.pass_ms(10);
    assert_eq!(state(rig), "holding");
}

fn a_ramp_up_is_a_share(rig: &Rig) {
    rig.drive("ramp_up_sp=1000 speed_sp=525 run-forever");
    rig.pass_ms(10);
    assert_eq!(state(rig), "running ramping");
    let mut ramped_ms = 10;
    let mut halfway = 0;
    while state(rig) == "running ramping" && ramped_ms < 2000 {
        rig.pass_ms(10);
        ramped_ms += 10;
        if ramped_ms == 300 {
            halfway = rig.number("outB", "speed");
        }
    }
    assert!((450..=750).contains(&ramped_ms), "{ramped_ms} ms");
    assert!((100..400).contains(&halfway), "{halfway} counts/s after 300 ms");
    assert_eq!(state(rig), "running");
    rig.pass_ms(500);
    assert_near("speed", rig.number("outB", "speed"), 525, 15);
}

fn a_timed_run_ramps_down(rig: &Rig) {
    rig.drive("ramp_down_sp=1000 speed_sp=525 time_sp=500 stop_action=brake run-timed");
    rig.pass_ms(480);
    assert_eq!(state(rig), "running");
    rig.pass_ms(40);
    let mut ended_ms = 520;
    while state(rig) == "running ramping" && ended_ms < 3000 {
        rig.pass_ms(10);
        ended_ms += 10;
    }
    assert!((900..=1250).contains(&ended_ms), "{ended_ms} ms");
    assert_eq!((state(rig), rig.number("outB", "duty_cycle")), (String::new(), 0));
}

fn a_replugged_motor_is_another(rig: &Rig) {
    let kept = rig.keep("outB", "position", Access::ReadWrite);
    let mut buffer = [0; 16];
    rig.drive("speed_sp=300 stop_action=hold run-forever");
    rig.pass_ms(300);
    assert_eq!(rig.folder("outB").unwrap(), "sys/class/tacho-motor/motor1");
    rig.bench.simulation.unplug(0, Port::OutB).unwrap();
    rig.pass_ms(90);
    assert!(kept.read(&mut buffer).is_ok(), "a pulled plug is believed after 100 ms");
    rig.pass_ms(14);
    assert_eq!(rig.read("port:outB", "status"), "no-motor");
    assert_eq!(kept.read(&mut buffer), Err(Errno::ENODEV));
    assert_eq!(kept.write(b"0"), Err(Errno::ENODEV));
    assert_eq!(kept.wait_changed(Duration::from_secs(1)), Ok(true), "POLLERR at once");
    assert_eq!(rig.read_path("sys/class/tacho-motor/motor1/position"), Err(Errno::ENOENT));
    let coasting = rig.world(|bench| bench.motors[1].speed);
    rig.pass_ms(50);
    assert!(rig.world(|bench| bench.motors[1].speed) < coasting, "the pins float");
    rig.bench.simulation.plug(0, Port::OutB, Plugged::Motor(MotorKind::Medium)).unwrap();
    rig.pass_ms(380);
    assert_eq!(rig.folder("outB"), None, "detection takes 0.39 s");
    rig.pass_ms(20);
    assert_eq!(rig.folder("outB").unwrap(), "sys/class/tacho-motor/motor3");
    assert_eq!(rig.read("outB", "driver_name"), "lego-ev3-m-motor");
    assert_eq!(
        (rig.number("outB", "speed_sp"), rig.read("outB", "stop_action")),
        (0, "coast".to_owned())
    );
    assert!(position(rig) > 50, "the co-processor went on counting for the port");
    assert_eq!(kept.read(&mut buffer), Err(Errno::ENODEV), "the old file stays dead");
}

fn the_same_mode_registers_anew(rig: &Rig) {
    rig.write("port:in4", "mode", "auto");
    rig.pass_ms(2);
    assert_eq!(rig.folder("in4"), None);
    rig.pass_ms(2000);
    assert_eq!(rig.folder("in4").unwrap(), "sys/class/lego-sensor/sensor4");
    assert_eq!(rig.read("port:in4", "status"), "ev3-uart");
}

fn an_old_gyro_zeroes(rig: &Rig) {
    turn_a_gyro(rig, 0);
}

fn a_new_gyro_does_not(rig: &Rig) {
    turn_a_gyro(rig, 90);
}

/// A gyro that was turned by 90 degrees; both makes are zeroed by a byte.
fn turn_a_gyro(rig: &Rig, after_two_changes_of_mode: i64) {
    rig.world(|bench| bench.readings[3][0] = 90);
    rig.pass_ms(10);
    assert_eq!(rig.number("in4", "value0"), 90);
    rig.write("in4", "mode", "GYRO-RATE");
    rig.write("in4", "mode", "GYRO-ANG");
    rig.pass_ms(10);
    assert_eq!(rig.number("in4", "value0"), after_two_changes_of_mode);
    assert_eq!(rig.try_write("in4", "direct", [0x11]), Ok(1));
    rig.pass_ms(40);
    assert_eq!(rig.number("in4", "value0"), 0, "after 0x11");
}

/// Facing open space at first. After a change of mode it first says what that mode measured when
/// it was last used, and 0 where it never was.
fn an_ultrasonic_sensor_is_slow(rig: &Rig) {
    let measured = || rig.world(|bench| bench.measured[0]);
    rig.world(|bench| bench.readings[0][0] = 2550);
    let before = measured();
    rig.pass_ms(1000);
    assert_eq!(measured() - before, 10, "each 100 ms");
    assert_eq!((rig.number("in1", "value0"), rig.number("in1", "decimals")), (2550, 1));
    rig.world(|bench| bench.readings[0][0] = 1003);
    rig.write("in1", "mode", "US-DIST-IN");
    assert_eq!(rig.number("in1", "value0"), 0, "before the mode's first data");
    rig.pass_ms(220);
    assert_eq!(rig.number("in1", "value0"), 1003);
    rig.world(|bench| bench.readings[0][0] = 500);
    rig.write("in1", "mode", "US-DIST-CM");
    assert_eq!(rig.number("in1", "value0"), 2550, "what the mode was left with");
    rig.pass_ms(220);
    assert_eq!(rig.number("in1", "value0"), 500);
    rig.write("in1", "mode", "US-SI-CM");
    rig.pass_ms(1200);
    let single = measured();
    rig.pass_ms(1000);
    assert_eq!(measured(), single, "a single shot is one measurement");
}
