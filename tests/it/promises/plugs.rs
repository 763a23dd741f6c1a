//! Promises 2, 3, 4 and 9 in virtual time: a loop that stalls, plugs that come loose, another
//! program that commands our motors.

use std::sync::Arc;

use onbrick::clock::{Clock, MILLISECOND_NS, SECOND_NS, VirtualClock, nanoseconds};
use onbrick::recording::Run;
use onbrick::runtime::StopReason;
use onbrick::senses::Channel;
use onbrick::sim::Truth;

use crate::support::promised::promised;
use crate::support::stage::{Play, fault};

/// The robot's devices and what they are to it.
const DEVICES: [(&str, Channel); 5] = [
    ("outB", Channel::Left),
    ("outD", Channel::Right),
    ("outA", Channel::Head),
    ("in1", Channel::Range),
    ("in4", Channel::Gyro),
];

/// The mapping mission, this many seconds of it.
fn mapping(seconds: f64) -> Play {
    Play::of("map", "arena", 3).seconds(seconds)
}

/// The mapping mission that waits for what it has lost.
fn pausing(seconds: f64) -> Play {
    let mut play = mapping(seconds);
    assert!(!play.mission_toml.contains("on_lost"), "it says itself what happens");
    play.mission_toml =
        play.mission_toml.replacen("time_limit_s", "on_lost = \"pause\"\ntime_limit_s", 1);
    play
}

/// The furthest that a believed pose is from the one before, metres.
fn largest_step_m(recorded: &Run) -> f64 {
    let steps = recorded.poses.windows(2).map(|pair| {
        libm::hypot(pair[1].pose.x_m - pair[0].pose.x_m, pair[1].pose.y_m - pair[0].pose.y_m)
    });
    steps.fold(0.0, f64::max)
}

/// How far it had driven at a time since the start, metres.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "times of a run are short and positive"
)]
fn travelled_m(truths: &[Truth], time_s: f64) -> f64 {
    let at = ((time_s * 50.0) as usize).min(truths.len() - 1);
    truths[at].travelled_m
}

#[test]
fn promise_3_a_device_that_comes_back_is_found_and_the_mission_goes_on() {
    let clean = pausing(60.0).play().unwrap();
    promised(&format!(
        "clean: {:.2} m, off by {:.3} m",
        clean.truth.travelled_m,
        clean.pose_error_m()
    ));
    for (port, channel) in DEVICES {
        let text =
            format!("[[fault]]\nat_s = 10\nuntil_s = 14\nport = \"{port}\"\nkind = \"unplug\"\n");
        let ended = pausing(60.0).scenario(&text).play().unwrap();
        let recorded = ended.run();
        let logs: Vec<&str> = recorded.logs.iter().map(|log| log.text.as_str()).collect();
        assert_eq!(ended.reason, StopReason::Finished, "{port}: {logs:?}");
        let at = |what: &str| {
            let found = recorded.logs.iter().find(|log| log.text.contains(what));
            found.unwrap_or_else(|| panic!("{port}: no `{what}` in {logs:?}")).time_ns as f64 / 1e9
        };
        let (lost_s, back_s) = (at(&format!("lost: {channel}")), at("going on"));
        // Devices appear 0.4 s after they are plugged in, a serial sensor 1.9 s.
        assert!((10.0..10.6).contains(&lost_s), "{port}: lost at {lost_s} s");
        assert!((14.0..17.5).contains(&back_s), "{port}: back at {back_s} s");
        let waited_m = travelled_m(&ended.truths, 14.0) - travelled_m(&ended.truths, 11.0);
        let afterwards_m =
            ended.truths.last().unwrap().travelled_m - travelled_m(&ended.truths, back_s);
        let step_m = largest_step_m(&recorded);
        promised(&format!(
            "{port}: lost after {:.2} s, back {:.2} s after it was put in; {afterwards_m:.2} m \
             driven then; largest step {step_m:.4} m; off by \
             {:.3} m at the end",
            lost_s - 10.0,
            back_s - 14.0,
            ended.pose_error_m()
        ));
        assert!(waited_m < 0.002, "{port}: it waits, and has driven {waited_m} m");
        assert!(afterwards_m > 0.3, "{port}: it really continues: {afterwards_m} m");
        assert!(step_m < 0.01, "{port}: no jump: {step_m} m");
        assert!(
            ended.pose_error_m() < clean.pose_error_m() + 0.1,
            "{port}: off by {}",
            ended.pose_error_m()
        );
        ended.assert_at_rest(port);
    }
}

#[test]
fn promise_3_no_other_sensor_takes_the_place_of_one_that_comes_loose() {
    // Without a port the range is the ultrasonic sensor's, since that is preferred; the remote's
    // infrared sensor could be asked for it, too.
    let mut play = pausing(30.0);
    play.world_toml.push_str("[robot.ports]\nin3 = \"infrared\"\n");
    play.robot_toml = play.robot_toml.replacen("[range]\nport = \"in1\"", "[range]", 1);
    play.robot_toml = play.robot_toml.replacen("[colour]\n", "[remote]\n", 1);
    let text = "[[fault]]\nat_s = 10\nuntil_s = 14\nport = \"in1\"\nkind = \"unplug\"\n";
    let ended = play.scenario(text).play().unwrap();
    assert_eq!(ended.reason, StopReason::Finished);
    let waited_m = travelled_m(&ended.truths, 14.0) - travelled_m(&ended.truths, 11.0);
    assert!(waited_m < 0.002, "it waits for its own sensor, and has driven {waited_m} m");
}

#[test]
fn promise_3_a_plug_may_come_loose_again_and_again() {
    let text: String = (0..6)
        .map(|number| {
            let (port, at_s) = (DEVICES[number % 5].0, 5 + 7 * number);
            format!(
                "[[fault]]\nat_s = {at_s}\nuntil_s = {}\nport = \"{port}\"\nkind = \"unplug\"\n",
                at_s + 2
            )
        })
        .collect();
    let ended = pausing(60.0).scenario(&text).play().unwrap();
    assert_eq!(ended.reason, StopReason::Finished, "{:?}", ended.faults);
    assert!(ended.truth.travelled_m > 0.5, "{} m", ended.truth.travelled_m);
    let step_m = largest_step_m(&ended.run());
    assert!(step_m < 0.01, "no jump: {step_m} m");
    ended.assert_at_rest("again and again");
}

#[test]
fn promise_3_a_device_that_stays_away_keeps_the_robot_waiting_until_its_time_is_over() {
    let ended = pausing(20.0).scenario(&fault("in4", "unplug")).play().unwrap();
    assert_eq!(ended.reason, StopReason::TimeLimit);
    let waited_m = travelled_m(&ended.truths, 19.9) - travelled_m(&ended.truths, 11.0);
    assert!(waited_m < 0.002, "{waited_m} m");
    ended.assert_at_rest("away for good");
}

/// A clock on which one sleep takes too long.
#[derive(Debug)]
struct Hiccup {
    clock: Arc<VirtualClock>,
    by_ns: i64,
}

/// When it sleeps too long: ten seconds on, while the robot drives.
const HICCUP_NS: i64 = 10 * SECOND_NS;

impl Clock for Hiccup {
    fn now_ns(&self) -> i64 {
        self.clock.now_ns()
    }

    fn sleep_until_ns(&self, deadline_ns: i64) {
        let crossed = self.clock.now_ns() < HICCUP_NS && deadline_ns >= HICCUP_NS;
        self.clock.sleep_until_ns(deadline_ns + if crossed { self.by_ns } else { 0 });
    }
}

#[test]
fn promise_2_a_loop_that_stalls_stops_and_one_that_is_late_is_counted_and_recorded() {
    let late = Play {
        seen_clock: |clock| Arc::new(Hiccup { clock, by_ns: 150 * MILLISECOND_NS }),
        ..mapping(20.0)
    }
    .play()
    .unwrap();
    assert_eq!(late.reason, StopReason::Finished);
    assert_eq!((late.ended.overruns, nanoseconds(late.ended.latest_s)), (1, 150 * MILLISECOND_NS));
    let recorded: u32 = late.run().statistics.iter().map(|window| window.overruns).sum();
    assert_eq!(recorded, 1, "it is in the recording");

    let stalled = Play {
        seen_clock: |clock| Arc::new(Hiccup { clock, by_ns: 201 * MILLISECOND_NS }),
        ..mapping(20.0)
    }
    .play()
    .unwrap();
    assert_eq!(stalled.reason, StopReason::Late);
    assert_eq!(nanoseconds(stalled.ended.latest_s), 201 * MILLISECOND_NS);
    assert!(stalled.drove_s < 10.5, "{} s", stalled.drove_s);
    stalled.assert_at_rest("stalled");
}

/// Ahead for two seconds, and then nothing.
const STAND: &str = r#"
name = "stand"
time_limit_s = 30
[machine.drive]
start = "ahead"
final = "end"
[machine.drive.state.ahead]
do = { left_dps = 60, right_dps = 60 }
next = [{ when = "state_s > 2", go = "wait" }]
[machine.drive.state.wait]
do = { stop = "brake" }
next = [{ when = "time_s > 25", go = "end" }]
[machine.drive.state.end]
"#;

#[test]
fn promise_9_another_programs_hand_on_a_motor_that_stands_is_noticed_too() {
    for writes in
        [&["command reset"][..], &["speed_sp 77"], &["speed_sp 77", "command run-forever"]]
    {
        let orders: String = writes
            .iter()
            .map(|write| {
                format!("[[fault]]\nat_s = 10\nport = \"outB\"\nkind = \"write {write}\"\n")
            })
            .collect();
        let play = Play { mission_toml: STAND.to_owned(), ..mapping(30.0) };
        let ended = play.scenario(&orders).play().unwrap();
        let took_ms = (ended.drove_s - 10.0) * 1e3;
        promised(&format!("standing, {writes:?}: {} after {took_ms:.0} ms", ended.reason));
        assert_eq!(ended.reason, StopReason::Outside(Channel::Left), "{writes:?}");
        assert!(took_ms <= 220.0, "{writes:?}: {took_ms} ms");
    }
}

#[test]
fn promise_9_a_setting_that_would_change_what_a_lease_does_ends_the_run_and_the_motor_stands() {
    for (port, channel) in &DEVICES[..3] {
        for write in [
            "time_sp 60000",
            "stop_action coast",
            "ramp_up_sp 9000",
            "ramp_down_sp 9000",
            "polarity inversed",
        ] {
            let order =
                format!("[[fault]]\nat_s = 10\nport = \"{port}\"\nkind = \"write {write}\"\n");
            let ended = mapping(60.0).scenario(&order).play().unwrap();
            let took_ms = (ended.drove_s - 10.0) * 1e3;
            promised(&format!("{port} {write}: {} after {took_ms:.0} ms", ended.reason));
            assert_eq!(ended.reason, StopReason::Outside(*channel), "{port} {write}");
            assert!(took_ms <= 120.0, "{port} {write}: {took_ms} ms");
            assert_eq!(ended.states, [""; 3], "{port} {write}");
        }
    }
}

#[test]
fn promise_9_another_programs_hand_on_our_motors_ends_the_run_and_nothing_is_fought_over() {
    let orders = |port: &str, writes: &[&str]| -> String {
        let order = |write: &&str| {
            format!("[[fault]]\nat_s = 10\nport = \"{port}\"\nkind = \"write {write}\"\n")
        };
        writes.iter().map(order).collect()
    };
    for (port, channel) in &DEVICES[..3] {
        for (writes, state) in [
            (&["command reset"][..], ""),
            (&["command stop"], ""),
            (&["speed_sp 77", "command run-forever"], "running"),
            (&["duty_cycle_sp 30", "command run-direct"], "running"),
        ] {
            let scenario = orders(port, writes);
            let ended = mapping(60.0).scenario(&scenario).play().unwrap();
            let took_ms = (ended.drove_s - 10.0) * 1e3;
            promised(&format!("{port} {writes:?}: {} after {took_ms:.0} ms", ended.reason));
            assert_eq!(ended.reason, StopReason::Outside(*channel), "{port} {writes:?}");
            assert!(took_ms <= 120.0, "{port} {writes:?}: {took_ms} ms");
            // A second later the other program's command is still in force, and ours are not.
            let states =
                ["outA", "outB", "outD"].map(|other| if other == *port { state } else { "" });
            let running: Vec<&str> =
                ended.states.iter().map(|state| state.split(' ').next().unwrap_or("")).collect();
            assert_eq!(running, states, "{port} {writes:?}: {:?}", ended.states);
        }
    }
}
