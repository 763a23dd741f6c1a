//! Motors: every attribute there and back, every refusal, every cause, what a reading costs, and
//! what a drop does.

use std::sync::Arc;
use std::time::Duration;

use nix::errno::Errno;
use onbrick::ev3dev::{
    Cause, Class, DcCommand, DcMotor, DeviceError, Identity, Legal, LinearActuator, MotorState,
    Polarity, ServoCommand, ServoMotor, StopAction, TachoCommand, TachoMotor, Tree, Word,
};
use onbrick::units::Duty;

use crate::support::allocations::allocations;
use crate::support::brick::{FakeTree, LINEAR, MOTOR, linear_tables, plug_large_motor};

fn large_motor() -> (FakeTree, TachoMotor) {
    let fake = FakeTree::default();
    plug_large_motor(&fake, MOTOR, "ev3-ports:outB\n");
    let motor = TachoMotor::at(&fake.tree(), &"outB".parse().unwrap()).unwrap();
    (fake, motor)
}

fn identity(class: Class) -> Identity {
    let driver = Word::from("some-driver").unwrap();
    Identity { class, name: "motor0".to_owned(), address: "outA".parse().unwrap(), driver }
}

/// The legal range that a refusal of our own names.
fn refused_range(result: Result<(), DeviceError>) -> (i64, i64) {
    match result.unwrap_err().cause {
        Cause::Refused { errno: None, legal: Legal::Range(first, last) } => (first, last),
        other => panic!("{other}"),
    }
}

/// Writes values, reads each back, and compares.
macro_rules! there_and_back {
    ($device:expr, $($getter:ident / $setter:ident: $($value:expr),+;)+) => {
        $($({
            $device.$setter($value).unwrap();
            assert_eq!($device.$getter().unwrap(), $value, stringify!($setter));
        })+)+
    };
}

fn every_tacho_attribute(motor: &TachoMotor) {
    there_and_back!(motor,
        position / set_position: i32::MIN, -1, 0, i32::MAX;
        position_sp / set_position_sp: i32::MIN, 0, i32::MAX;
        speed_sp / set_speed_sp: -1050, 0, 1050;
        duty_cycle_sp / set_duty_cycle_sp: Duty::MIN, Duty::default(), Duty::MAX;
        time_sp / set_time_sp: i32::MAX, 300, 0;
        ramp_up_sp / set_ramp_up_sp: 60_000, 0;
        ramp_down_sp / set_ramp_down_sp: 60_000, 0;
        polarity / set_polarity: Polarity::Inversed, Polarity::Normal;
        stop_action / set_stop_action: StopAction::Hold, StopAction::Brake, StopAction::Coast;
        speed_kp / set_speed_kp: 1000, 0;
        speed_ki / set_speed_ki: 60, i32::MAX;
        speed_kd / set_speed_kd: 0;
        hold_kp / set_hold_kp: 80_000;
        hold_ki / set_hold_ki: 1;
        hold_kd / set_hold_kd: 2;
    );
}

#[test]
fn every_attribute_of_a_tacho_motor_comes_back_as_it_was_written() {
    let (_, motor) = large_motor();
    every_tacho_attribute(&motor);
}

#[test]
fn plain_files_serve_as_well_as_the_kernels() {
    let folder = tempfile::tempdir().unwrap();
    let tree = large_motor().0.write(folder.path());
    let motor = TachoMotor::at(&tree, &"outB".parse().unwrap()).unwrap();
    every_tacho_attribute(&motor);
    motor.command(TachoCommand::RunTimed).unwrap();
    let written = std::fs::read_to_string(folder.path().join(MOTOR).join("command")).unwrap();
    assert_eq!(written.lines().next(), Some("run-timed"));
}

#[test]
fn what_can_only_be_read_is_read() {
    let (fake, motor) = large_motor();
    fake.put(MOTOR, "speed", b"-398\n");
    fake.put(MOTOR, "duty_cycle", b"-41\n");
    fake.put(MOTOR, "state", b"running overloaded\n");
    fake.put(MOTOR, "commands", b"run-forever run-timed stop\n");
    fake.put(MOTOR, "stop_actions", b"coast brake hold\n");
    assert_eq!(motor.speed().unwrap(), -398);
    assert_eq!(motor.duty_cycle().unwrap(), Duty::new(-41).unwrap());
    let state = motor.state().unwrap();
    assert!(state.is_running() && state.is_overloaded() && !state.is_stalled(), "{state}");
    assert!(motor.commands().unwrap().contains("run-timed"));
    assert_eq!(
        motor.stop_actions().unwrap().iter().collect::<Vec<_>>(),
        ["coast", "brake", "hold"]
    );
    assert_eq!(motor.address().unwrap().as_str(), "ev3-ports:outB");
    assert_eq!(motor.driver_name().unwrap().as_str(), "lego-ev3-l-motor");
    assert_eq!(
        (motor.max_speed(), motor.read_max_speed().unwrap(), motor.count_per_rot()),
        (1050, 1050, 360)
    );
    assert!(motor.wait_state_changed(Duration::from_millis(1)).unwrap());
}

#[test]
fn every_command_is_written_as_one_line() {
    let (fake, motor) = large_motor();
    for command in TachoCommand::ALL {
        motor.command(*command).unwrap();
    }
    let expected: Vec<String> =
        TachoCommand::ALL.iter().map(|command| format!("{command}\n")).collect();
    assert_eq!(fake.written(MOTOR, "command"), expected);
    // The simulator's drivers take the same table: these are the kernel's words once more.
    assert_eq!(
        TachoCommand::WORDS.join(" "),
        "run-forever run-to-abs-pos run-to-rel-pos run-timed run-direct stop reset"
    );
}

#[test]
fn what_is_not_legal_is_refused_before_it_is_written() {
    let (fake, motor) = large_motor();
    assert_eq!(refused_range(motor.set_speed_sp(1051)), (-1050, 1050));
    // The driver takes this one by mistake; we do not.
    assert_eq!(refused_range(motor.set_speed_sp(i32::MIN)), (-1050, 1050));
    assert_eq!(refused_range(motor.set_time_sp(-1)), (0, 2_147_483_647));
    assert_eq!(refused_range(motor.set_ramp_up_sp(60_001)), (0, 60_000));
    assert_eq!(refused_range(motor.set_ramp_up_sp(-1)), (0, 60_000));
    assert_eq!(refused_range(motor.set_ramp_down_sp(60_001)), (0, 60_000));
    for result in [
        motor.set_speed_kp(-1),
        motor.set_speed_ki(-1),
        motor.set_speed_kd(-1),
        motor.set_hold_kp(-1),
        motor.set_hold_ki(-1),
        motor.set_hold_kd(-1),
    ] {
        assert_eq!(refused_range(result), (0, 2_147_483_647));
    }
    assert_eq!(fake.calls().writes, 0);
    let message = motor.set_speed_sp(1051).unwrap_err().to_string();
    assert_eq!(
        message,
        "outB (sys/class/tacho-motor/motor0): speed_sp `1051`: refused, legal is -1050 to 1050"
    );
}

#[test]
fn the_drivers_errors_become_causes_by_what_to_do() {
    let (fake, motor) = large_motor();
    #[rustfmt::skip]
    let cases = [
        // errno              reading                       writing
        (Errno::ENODEV,       "gone",                       "gone"),
        (Errno::ENXIO,        "no such attribute",          "gone"),
        (Errno::EOPNOTSUPP,   "no such attribute",          "refused"),
        (Errno::EINVAL,       "EINVAL",                     "refused"),
        (Errno::ERANGE,       "ERANGE",                     "refused"),
        (Errno::EBUSY,        "EBUSY",                      "refused"),
        (Errno::EACCES,       "join the groups",            "join the groups"),
        (Errno::ETIMEDOUT,    "did not answer",             "did not answer"),
        (Errno::EIO,          "EIO",                        "EIO"),
    ];
    for (errno, reading, writing) in cases {
        fake.fail(MOTOR, "position", Some(errno), Some(errno));
        let read = motor.position().unwrap_err();
        let written = motor.set_position(7).unwrap_err();
        assert!(read.to_string().contains(reading), "{errno}: {read}");
        assert!(written.to_string().contains(writing), "{errno}: {written}");
        assert_eq!((read.errno(), written.errno()), (Some(errno), Some(errno)));
        assert_eq!(written.value.as_deref(), Some("7"));
        assert_eq!(read.port, Some("ev3-ports:outB".parse().unwrap()));
    }
}

#[test]
fn a_pulled_cable_is_gone_not_zero() {
    let (fake, motor) = large_motor();
    assert_eq!(motor.position().unwrap(), 0);
    fake.pull(MOTOR);
    let kept = motor.position().unwrap_err();
    let reopened = motor.speed().unwrap_err();
    assert_eq!(
        (kept.cause, reopened.cause),
        (Cause::Gone(Errno::ENODEV), Cause::Gone(Errno::ENOENT))
    );
}

#[test]
fn a_missing_attribute_is_absent_while_the_device_is_there() {
    let (fake, motor) = large_motor();
    fake.remove(MOTOR, "ramp_up_sp");
    assert!(motor.ramp_up_sp().unwrap_err().is_absent());
    assert!(motor.set_ramp_up_sp(0).unwrap_err().is_absent());
}

#[test]
fn text_that_is_not_understood_is_malformed_and_shown() {
    let (fake, motor) = large_motor();
    let long = "1".repeat(200);
    for text in ["", "\n", "five\n", "1.5\n", " 5\n", "99999999999\n", long.as_str()] {
        fake.put(MOTOR, "position", text.as_bytes());
        let error = motor.position().unwrap_err();
        assert_eq!(error.cause, Cause::Malformed(Legal::Number), "{text:?}: {error}");
        assert!(error.value.is_some_and(|shown| shown.len() <= 32));
    }
    fake.put(MOTOR, "duty_cycle", b"101\n");
    assert_eq!(motor.duty_cycle().unwrap_err().cause, Cause::Malformed(Legal::Range(-100, 100)));
    fake.put(MOTOR, "polarity", b"inverted\n");
    assert!(motor.polarity().unwrap_err().to_string().contains("expected one of normal inversed"));
    fake.put(MOTOR, "state", b"running\xff\n");
    assert!(matches!(motor.state().unwrap_err().cause, Cause::Malformed(Legal::Flags(_))));
}

#[test]
fn only_the_first_line_of_a_file_counts() {
    let (fake, motor) = large_motor();
    fake.put(MOTOR, "position", b"12\n345\n");
    assert_eq!(motor.position().unwrap(), 12);
    fake.put(MOTOR, "position", b"13");
    assert_eq!(motor.position().unwrap(), 13);
}

#[test]
fn a_reading_is_one_call_and_allocates_nothing_after_the_first() {
    let (fake, motor) = large_motor();
    motor.position().unwrap();
    motor.state().unwrap();
    let before = fake.calls();
    let (allocated, ()) = allocations(|| {
        for _ in 0..100 {
            motor.position().unwrap();
            motor.state().unwrap();
        }
    });
    let after = fake.calls();
    assert_eq!((after.opens - before.opens, after.reads - before.reads, allocated), (0, 200, 0));
}

#[test]
fn a_write_is_one_call_and_allocates_nothing_after_the_first() {
    let folder = tempfile::tempdir().unwrap();
    let tree = large_motor().0.write(folder.path());
    let motor = TachoMotor::find(&tree, None, None).unwrap();
    let lease = |speed| {
        motor.set_speed_sp(speed).unwrap();
        motor.command(TachoCommand::RunTimed).unwrap();
        motor.position().unwrap();
    };
    lease(1);
    let (allocated, ()) = allocations(|| (0..100).for_each(lease));
    assert_eq!(allocated, 0);

    let (fake, motor) = large_motor();
    motor.set_speed_sp(0).unwrap();
    let before = fake.calls();
    (0..100).for_each(|speed| motor.set_speed_sp(speed).unwrap());
    assert_eq!(fake.calls().writes - before.writes, 100);
    assert_eq!(fake.calls().opens, before.opens);
}

#[test]
fn an_error_of_a_kept_file_allocates_nothing() {
    let (fake, motor) = large_motor();
    motor.position().unwrap();
    fake.pull(MOTOR);
    let (allocated, error) = allocations(|| motor.position().unwrap_err());
    assert!(error.is_gone());
    assert_eq!(allocated, 0);
}

#[test]
fn dropping_a_motor_stops_it_if_a_command_of_ours_may_be_running() {
    let (fake, motor) = large_motor();
    drop(motor);
    assert_eq!(fake.calls().writes, 0, "a motor that was only looked at is left alone");

    let (fake, motor) = large_motor();
    motor.command(TachoCommand::RunForever).unwrap();
    drop(motor);
    assert_eq!(fake.written(MOTOR, "command"), ["run-forever\n", "stop\n"]);

    let (fake, motor) = large_motor();
    motor.command(TachoCommand::RunForever).unwrap();
    motor.stop().unwrap();
    drop(motor);
    assert_eq!(fake.written(MOTOR, "command"), ["run-forever\n", "stop\n"]);

    let (fake, motor) = large_motor();
    motor.command(TachoCommand::RunForever).unwrap();
    motor.release();
    assert_eq!(fake.written(MOTOR, "command"), ["run-forever\n"]);
}

#[test]
fn a_command_whose_answer_was_an_error_may_be_running_and_is_stopped() {
    let (fake, motor) = large_motor();
    fake.fail(MOTOR, "command", None, Some(Errno::EIO));
    motor.command(TachoCommand::RunForever).unwrap_err();
    fake.fail(MOTOR, "command", None, None);
    drop(motor);
    assert_eq!(fake.written(MOTOR, "command"), ["stop\n"]);
}

#[test]
fn dropping_a_motor_that_is_gone_does_nothing() {
    let (fake, motor) = large_motor();
    motor.command(TachoCommand::RunForever).unwrap();
    fake.pull(MOTOR);
    drop(motor);
    assert_eq!(fake.written(MOTOR, "command"), ["run-forever\n"]);
}

#[test]
fn a_motor_can_move_to_another_thread() {
    let (_, motor) = large_motor();
    let position = std::thread::spawn(move || motor.position().unwrap()).join().unwrap();
    assert_eq!(position, 0);
}

#[test]
fn a_linear_actuator_knows_its_own_scale() {
    let fake = FakeTree::default();
    let texts = [
        ("address", "outC\n"),
        ("driver_name", "act-l12-ev3-100\n"),
        ("max_speed", "24\n"),
        ("count_per_m", "2000\n"),
        ("full_travel_count", "200\n"),
    ];
    fake.plug(LINEAR, &linear_tables(), &texts);
    let actuator = LinearActuator::at(&fake.tree(), &"outC".parse().unwrap()).unwrap();
    assert_eq!(
        (actuator.count_per_m(), actuator.full_travel_count(), actuator.max_speed()),
        (2000, 200, 24)
    );
    assert_eq!(refused_range(actuator.set_speed_sp(25)), (-24, 24));
}

#[test]
fn every_attribute_of_a_dc_motor_works() {
    let fake = FakeTree::default();
    let folder = "sys/class/dc-motor/motor0";
    fake.plug(
        folder,
        &[DcMotor::ATTRIBUTES],
        &[("address", "outA\n"), ("driver_name", "rcx-motor\n")],
    );
    let motor = DcMotor::at(&fake.tree(), &"outA".parse().unwrap()).unwrap();
    there_and_back!(motor,
        duty_cycle_sp / set_duty_cycle_sp: Duty::MIN, Duty::MAX;
        polarity / set_polarity: Polarity::Inversed, Polarity::Normal;
        ramp_up_sp / set_ramp_up_sp: 0, 10_000;
        ramp_down_sp / set_ramp_down_sp: 0, 10_000;
        time_sp / set_time_sp: 0, 60_000;
    );
    motor.set_stop_action(StopAction::Brake).unwrap();
    assert_eq!(fake.written(folder, "stop_action"), ["brake\n"]);
    assert_eq!(motor.state().unwrap(), MotorState::default());
    assert_eq!(motor.duty_cycle().unwrap(), Duty::default());
    assert_eq!(refused_range(motor.set_time_sp(60_001)), (0, 60_000));
    assert_eq!(refused_range(motor.set_ramp_up_sp(10_001)), (0, 10_000));
    assert_eq!(refused_range(motor.set_ramp_down_sp(-1)), (0, 10_000));
    for command in DcCommand::ALL {
        motor.command(*command).unwrap();
    }
    assert_eq!(DcCommand::WORDS, ["run-forever", "run-timed", "run-direct", "stop"]);
    motor.command(DcCommand::RunDirect).unwrap();
    drop(motor);
    assert_eq!(fake.written(folder, "command").last().map(String::as_str), Some("stop\n"));
}

#[test]
fn a_dc_motor_does_not_hold() {
    let fake = FakeTree::default();
    fake.plug("sys/class/dc-motor/motor0", &[DcMotor::ATTRIBUTES], &[]);
    let motor = DcMotor::bind(&fake.tree(), identity(Class::DcMotor));
    let error = motor.set_stop_action(StopAction::Hold).unwrap_err();
    assert!(
        error.to_string().ends_with("stop_action `hold`: refused, legal is one of coast brake"),
        "{error}"
    );
    assert_eq!(fake.calls().writes, 0);
}

#[test]
fn every_attribute_of_a_servo_works() {
    let fake = FakeTree::default();
    let folder = "sys/class/servo-motor/motor0";
    fake.plug(folder, &[ServoMotor::ATTRIBUTES], &[]);
    let tree: Arc<dyn Tree> = fake.tree();
    let servo = ServoMotor::bind(&tree, identity(Class::ServoMotor));
    there_and_back!(servo,
        min_pulse_sp / set_min_pulse_sp: 0, 1000;
        mid_pulse_sp / set_mid_pulse_sp: 1000, 2000;
        max_pulse_sp / set_max_pulse_sp: 2000, 3000;
        polarity / set_polarity: Polarity::Inversed, Polarity::Normal;
        position_sp / set_position_sp: -100, 100;
        rate_sp / set_rate_sp: 0, 1000;
    );
    assert_eq!(refused_range(servo.set_min_pulse_sp(1001)), (0, 1000));
    assert_eq!(refused_range(servo.set_mid_pulse_sp(999)), (1000, 2000));
    assert_eq!(refused_range(servo.set_max_pulse_sp(3001)), (2000, 3000));
    assert_eq!(refused_range(servo.set_position_sp(101)), (-100, 100));
    assert_eq!(refused_range(servo.set_rate_sp(-1)), (0, 2_147_483_647));
    servo.command(ServoCommand::Run).unwrap();
    assert_eq!(servo.state().unwrap(), MotorState::default());
    drop(servo);
    assert_eq!(fake.written(folder, "command"), ["run\n", "float\n"]);
    assert_eq!(fake.written(folder, "polarity"), ["inversed\n", "normal\n"]);
}
