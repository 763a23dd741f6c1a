//! Motors and servos: ramps, leases, moves and holds.

use nix::errno::Errno;
use onbrick::sim::Bridge;

use crate::drivers_bench::Rig;

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
    assert_eq!(
        (rig.read("dc:outB", "state"), rig.number("dc:outB", "duty_cycle")),
        (String::new(), 0)
    );
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
    assert_eq!(
        (rig.read_path(&path("state")), pulse_us()),
        (Ok("running\n".to_owned()), Some(2000))
    );
    assert_eq!(rig.write_path(&path("polarity"), b"inversed"), Ok(8));
    assert_eq!(pulse_us(), Some(1000), "polarity acts at once");
    assert_eq!(rig.write_path(&path("command"), b"float"), Ok(5));
    assert_eq!((rig.read_path(&path("state")), pulse_us()), (Ok("\n".to_owned()), None));
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
    rig.drive(
        "speed_sp=400 position_sp=360 stop_action=hold run-to-rel-pos position_sp=0 run-to-rel-pos",
    );
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
        assert_eq!(
            rig.number("outB", "duty_cycle"),
            100 * toward,
            "{shift} counts below the set point"
        );
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
            rig.drive(
                "speed_sp=-2147483648 position_sp=2147483647 polarity=inversed time_sp=2147483647",
            );
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
