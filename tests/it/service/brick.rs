//! The service on files of a brick: plain ones with wheels that turn, and the mounted simulated
//! brick.

use std::sync::Arc;
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use onbrick::clock::MonotonicClock;
use onbrick::protocol::{Kind, Live, LocalOnly, Request, State};
use onbrick::recording::Run;
use onbrick::runtime::HardwareLock;
use onbrick::runtime::StopReason;

use super::{STRAIGHT, Served, id, refused_as, short, start};
use crate::commands::onbrick;
use crate::mount::bench::{Mounted, await_or_fail};
use crate::support::turning_brick::{TurningBrick, await_that};

fn on(brick: &TurningBrick, config: &str) -> Served {
    Served::with(&["--brick", brick.root().to_str().unwrap()], config)
}

#[test]
fn a_stop_in_motion_is_answered_when_the_motors_have_been_told() {
    let brick = TurningBrick::new();
    let mut served = on(&brick, "");
    served.drive("straight");
    brick.await_driving();
    let stopped = served.stop();
    // The head was not moved, so its last command is the one of its binding.
    assert_eq!(
        (stopped.stopped, brick.commands()),
        (true, ["reset", "stop", "stop"].map(str::to_owned).to_vec())
    );
    served.await_state(State::Stopped);
    assert_eq!(brick.owner(), None, "between runs others have the motors");
    assert!(served.status().battery_v.is_some_and(|volts| (volts - 7.5).abs() < 0.01));
}

#[test]
fn a_motor_is_jogged_between_runs_only_and_stops_when_nobody_asks_any_more() {
    let brick = TurningBrick::new();
    let mut served = on(&brick, "");
    let jog = |port: &str, percent| LocalOnly::Jog { port: port.to_owned(), percent };
    served.own::<serde_json::Value>(&jog("outB", 50));
    assert_eq!(brick.read("tacho-motor/motor1", "command"), "run-timed", "a lease");
    assert_eq!(brick.read("tacho-motor/motor1", "time_sp"), "300");
    assert_eq!(brick.read("tacho-motor/motor1", "speed_sp"), "525");
    assert_eq!(brick.owner().unwrap().doing, "turning a motor by hand");
    await_that("the motor stops and is let go", || {
        brick.read("tacho-motor/motor1", "command") == "stop" && brick.owner().is_none()
    });
    served.own::<serde_json::Value>(&jog("outA", -100));
    served.own::<serde_json::Value>(&jog("outA", 0));
    assert_eq!(
        (brick.read("tacho-motor/motor0", "command"), brick.owner()),
        ("stop".to_owned(), None)
    );
    refused_as(&served.own_refused(&jog("outC", 10)), Kind::NotReady, "outC");
    refused_as(&served.own_refused(&jog("out B", 10)), Kind::BadRequest, "out B");
    refused_as(&served.own_refused(&jog("outB", 101)), Kind::BadRequest, "101");

    let live: Live = served.ask(&Request::Live);
    let device = |port: &str| live.devices.iter().find(|device| device.port == port).unwrap();
    assert_eq!((device("outB").role.as_deref(), device("outB").motor), (Some("left wheel"), true));
    assert!(device("in1").reading.contains("1000"), "{live:?}");

    // Another program has the hardware: nothing of ours touches it.
    let other = HardwareLock::take(brick.root(), "another program").unwrap();
    refused_as(&served.own_refused(&jog("outB", 50)), Kind::Busy, "another program");
    let refusal = served.own_refused(&LocalOnly::StartHere(start("r", "short")));
    refused_as(&refusal, Kind::Busy, "another program");
    assert!(served.runs().is_empty());
    drop(other);
}

#[test]
fn onbrick_run_goes_through_the_service_and_brings_the_recording() {
    let brick = TurningBrick::new();
    let mut served = on(&brick, "");
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("mine.toml"), short()).unwrap();
    let root = brick.root().to_str().unwrap().to_owned();
    let config = served.folder.path().to_str().unwrap().to_owned();
    let common = ["--brick", &root, "--config", &config];
    let run = |arguments: &[&str]| {
        let arguments: Vec<&str> = arguments.iter().copied().chain(common).collect();
        crate::commands::done(&onbrick(folder.path(), &arguments).output().unwrap())
    };
    let said = run(&["run", "mine.toml", "--out", "o", "--json"]).expect(0);
    let last = said.json().pop().unwrap();
    assert_eq!((&last["event"], &last["word"]), (&"ended".into(), &"finished".into()), "{last}");
    let info = served.runs().remove(0);
    let copy = folder.path().join("o/run.mcap");
    assert_eq!(
        Run::open(&copy).unwrap().ending.unwrap().stop.to_string(),
        "the mission is finished"
    );
    let kept = served.path("runs").join(info.run.as_str()).join("run.mcap");
    assert!(std::fs::read(&copy).unwrap() == std::fs::read(kept).unwrap());
    assert_eq!(info.mission, "short");

    // By name, it is the brick's own mission, though one of that name is shipped.
    std::fs::write(served.path("missions").join("map.toml"), short()).unwrap();
    run(&["run", "map", "--out", "q"]).expect(0);
    let missions: Vec<String> = served.runs().into_iter().map(|run| run.mission).collect();
    assert_eq!(missions, ["short", "short"]);

    let said = run(&["run", "mine.toml", "--robot", "r.toml"]).expect(2);
    assert!(said.err.contains("--robot"), "{}", said.err);
    std::fs::write(folder.path().join("bad.toml"), "name = 3\n").unwrap();
    let said = run(&["run", "bad.toml", "--out", "p"]).expect(3);
    assert!(said.err.contains("mission.toml:1"), "{}", said.err);
    assert!(!folder.path().join("p").exists(), "a run that was refused leaves no folder");
    let status = served.status();
    assert_eq!((status.state, served.runs().len()), (State::Stopped, 2));
}

#[test]
fn a_run_through_the_service_ends_with_the_process_that_asked_for_it() {
    for signal in [Signal::SIGKILL, Signal::SIGTSTP, Signal::SIGQUIT] {
        let brick = TurningBrick::new();
        let mut served = on(&brick, "");
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("far.toml"), STRAIGHT).unwrap();
        let root = brick.root().to_str().unwrap().to_owned();
        let config = served.folder.path().to_str().unwrap().to_owned();
        let arguments = ["run", "far.toml", "--brick", &root, "--config", &config];
        let mut run = onbrick(folder.path(), &arguments).spawn().unwrap();
        brick.await_driving();
        kill(Pid::from_raw(run.id().cast_signed()), signal).unwrap();
        let last = served.await_state(State::Stopped).last.unwrap();
        assert_eq!(last.stop.reason, StopReason::Here, "{signal}");
        assert!(brick.is_still(), "{signal}");
        let code = run.wait().unwrap().code();
        assert_eq!(code, (signal != Signal::SIGKILL).then_some(6), "{signal}");
    }
}

#[test]
fn on_the_mounted_brick_the_lights_follow_the_state_and_a_button_ends_the_run() {
    let clock = Arc::new(MonotonicClock);
    let Some(mounted) = Mounted::in_world("arena", 1, clock) else { return };
    let root = mounted.root();
    let mut served = Served::with(&["--brick", root.to_str().unwrap()], "");
    let led = |colour: &str| {
        let path = root.join(format!("sys/class/leds/led0:{colour}:brick-status/brightness"));
        std::fs::read_to_string(path).unwrap().trim() != "0"
    };
    await_or_fail("green for ready", || led("green") && !led("red"));
    let pose = onbrick::protocol::Start { pose: Some([0.0; 3]), ..start("r", "straight") };
    served.own::<serde_json::Value>(&LocalOnly::StartHere(pose));
    await_or_fail("orange while it prepares", || led("green") && led("red"));
    let mut status = served.status();
    await_that("it drives or has ended", || {
        status = served.status();
        matches!(status.state, State::Running | State::Stopped | State::Fault)
    });
    if status.state == State::Running {
        await_or_fail("a pulse's dark half", || {
            !led("green") || served.status().state != State::Running
        });
    }
    let enter = onbrick::sim::Button::Enter;
    mounted.simulation.press(0, enter).unwrap();
    let mut last = None;
    await_that("it has ended", || {
        last = served.status().last;
        last.is_some()
    });
    mounted.simulation.release(0, enter).unwrap();
    let last = last.unwrap();
    // On a machine under load it may have been late before the button.
    assert!([StopReason::Button, StopReason::Late].contains(&last.stop.reason), "{last:?}");
    if last.stop.reason == StopReason::Button {
        await_or_fail("green for stopped", || led("green") && !led("red"));
    } else {
        await_or_fail("red for a fault", || !led("green") && led("red"));
    }
    let status: onbrick::protocol::Status =
        served.client.ask(&Request::Status, Duration::from_secs(5)).unwrap();
    assert_eq!(status.last.unwrap().run, Some(id("r")));
}
