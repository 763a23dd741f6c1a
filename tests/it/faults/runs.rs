//! Whole missions on a robot that something goes wrong with.

use onbrick::runtime::StopReason;
use onbrick::senses::Channel;

use crate::support::promised::promised;
use crate::support::stage::{Play, Played, fault};

/// Runs the map mission for at most 60 s under a scenario that begins with it.
fn run(scenario: &str) -> Played {
    Play::of("map", "arena", 3).seconds(60.0).scenario(scenario).play().unwrap()
}

#[test]
fn a_run_without_faults_comes_to_its_end() {
    let ended = run("");
    assert_eq!(ended.reason, StopReason::Finished);
    assert!(ended.truth.travelled_m > 1.0, "{} m", ended.truth.travelled_m);
    ended.assert_at_rest("clean");
}

#[test]
fn promise_3_a_run_that_loses_a_device_stops_its_motors_and_says_which() {
    for (port, kind, channel) in [
        ("in4", "unplug", Channel::Gyro),
        ("in4", "eio", Channel::Gyro),
        ("in4", "resync", Channel::Gyro),
        ("in1", "unplug", Channel::Range),
        ("in1", "enxio", Channel::Range),
        ("in1", "garbage text", Channel::Range),
        ("outB", "unplug", Channel::Left),
        ("outD", "unplug", Channel::Right),
        ("outA", "unplug", Channel::Head),
    ] {
        let ended = run(&fault(port, kind));
        promised(&format!("{port} {kind}: {} after {:.2} s", ended.reason, ended.drove_s - 10.0));
        assert_eq!(ended.reason, StopReason::Lost(channel), "{port} {kind}");
        assert!((10.0..11.0).contains(&ended.drove_s), "{port} {kind}: after {} s", ended.drove_s);
        ended.assert_at_rest(kind);
        assert_eq!(ended.faults, [format!("{port} {kind}")]);
    }
}

#[test]
fn promise_4_a_blocked_wheel_is_noticed_within_two_seconds_and_ends_the_run() {
    for port in ["outB", "outD"] {
        let square = Play::of("square", "open", 3).seconds(60.0).scenario(&fault(port, "block"));
        let ended = square.play().unwrap();
        promised(&format!("{port} blocked: noticed after {:.2} s", ended.drove_s - 10.0));
        assert_eq!(ended.reason, StopReason::Stalled);
        assert!((10.0..=12.0).contains(&ended.drove_s), "after {} s", ended.drove_s - 10.0);
        ended.assert_at_rest("block");
        // A mission that backs off has nothing to do it with: the wheel turns neither way.
        let ended = run(&fault(port, "block"));
        promised(&format!(
            "{port} blocked both ways: the run ends after {:.2} s",
            ended.drove_s - 10.0
        ));
        assert_eq!(ended.reason, StopReason::Stalled);
        assert!((10.0..=18.0).contains(&ended.drove_s), "after {} s", ended.drove_s - 10.0);
        ended.assert_at_rest("block");
    }
}

#[test]
fn promise_3_a_loose_plug_of_a_moment_does_not_end_a_run() {
    let text = "[[fault]]\nat_s = 10\nuntil_s = 10.2\nport = \"in4\"\nkind = \"enxio\"\n";
    let ended = run(text);
    assert_eq!(ended.reason, StopReason::Finished, "{:?}", ended.faults);
    ended.assert_at_rest("a moment");
}
