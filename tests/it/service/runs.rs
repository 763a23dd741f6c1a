//! Starting, following, stopping, fetching.

use std::time::{Duration, Instant};

use onbrick::protocol::{
    Chosen, Done, Fetch, Kind, LocalOnly, Missions, Request, Settings, SettingsChange, Start,
    State, Stopped,
};
use onbrick::recording::Run;
use onbrick::runtime::StopReason;

use super::{STRAIGHT, Served, id, refused_as, start};

#[test]
fn a_run_is_started_followed_stopped_in_motion_and_fetched() {
    let mut served = Served::simulated("name = \"benny\"");
    let status = served.status();
    assert_eq!((status.brick.as_str(), status.state, &status.last), ("benny", State::Ready, &None));
    let run = served.drive("straight");
    assert!(served.start(run.as_str(), "straight").repeated, "a repeat does nothing");
    let token = served.status().token;
    let other = Request::Start(Start { token: Some(token), ..start("other", "short") });
    refused_as(&served.refused(&other), Kind::Busy, run.as_str());
    refused_as(&served.refused(&Request::Live), Kind::Busy, run.as_str());
    refused_as(
        &served.own_refused(&LocalOnly::Delete { run: run.clone() }),
        Kind::Busy,
        "going on",
    );
    // A part of it, while it grows.
    let early = Fetch::part(&run, 0, 8);
    let (early, bytes) = served.client.fetch(&early, Duration::from_secs(5)).unwrap();
    assert!(
        !early.complete && early.sha256.is_none() && bytes == b"\x89MCAP0\r\n",
        "{early:?} {bytes:?}"
    );

    let asked = Instant::now();
    let stopped = served.stop();
    let took = asked.elapsed();
    println!("stop in motion was answered after {took:?}");
    assert_eq!(stopped, Stopped { run: Some(run.clone()), stopped: true, other: None });
    assert!(took < Duration::from_secs(2), "the motors are told at the next tick: {took:?}");
    let status = served.await_state(State::Stopped);
    let last = status.last.unwrap();
    assert_eq!(
        (last.stop.reason, last.is_wanted(), last.run.as_ref()),
        (StopReason::Here, true, Some(&run))
    );
    assert!(last.to_string().ends_with("(here)"), "it says who: {last}");

    let (bytes, hash) = served.fetch_all(&run);
    let file = served.path("runs").join(run.as_str()).join("run.mcap");
    assert!(bytes == std::fs::read(&file).unwrap(), "byte for byte the brick's file");
    let sum = std::process::Command::new("sha256sum").arg(&file).output().unwrap();
    assert!(
        String::from_utf8_lossy(&sum.stdout).starts_with(&hash),
        "the hash is the one that others compute"
    );
    let recorded = Run::open(&file).unwrap();
    assert_eq!(recorded.ending.unwrap().stop.to_string(), "stopped on the brick");
    let info = served.runs().into_iter().find(|info| info.run == run).unwrap();
    assert!(info.fetched && !info.going_on && info.bytes == bytes.len() as u64, "{info:?}");
    assert_eq!(served.stop(), Stopped { run: None, stopped: true, other: None }, "nothing runs");
}

#[test]
fn a_mission_finishes_by_itself_within_the_time_limit_that_was_set_and_its_identifier_is_remembered()
 {
    let mut served = Served::simulated("");
    let limit = SettingsChange { time_limit_s: Some(1.0), ..SettingsChange::default() };
    assert_eq!(served.own::<Settings>(&LocalOnly::SetSettings(limit)).time_limit_s, Some(1.0));
    assert_eq!(served.start("limited", "straight").limited_s, Some(1.0));
    let last = served.await_state(State::Stopped).last.unwrap();
    assert_eq!((last.stop.reason.word().as_str(), last.is_wanted()), ("time limit", true));
    let none = SettingsChange { time_limit_s: Some(0.0), ..SettingsChange::default() };
    served.own::<Settings>(&LocalOnly::SetSettings(none));

    // The text of a mission; a pose; a number of its own.
    let text = super::short()
        .replace("time_s > 1.5", "time_s > long")
        .replace("[machine.drive]", "[numbers]\nlong = 50\n[machine.drive]");
    let carried = Start {
        mission: Chosen::Text(text),
        pose: Some([-0.5, 0.0, 0.0]),
        set: vec![("long".to_owned(), 0.5)],
        ..start("carried", "")
    };
    served.own::<serde_json::Value>(&LocalOnly::StartHere(carried));
    let last = served.await_state(State::Stopped).last.unwrap();
    assert_eq!(
        (last.stop.reason.word().as_str(), last.mission.as_str(), last.run),
        ("finished", "short", Some(id("carried")))
    );
    let run = served.runs().remove(0);
    assert_eq!((run.run, run.number > 1, run.points.is_some()), (id("carried"), true, true));

    served.own::<Done>(&LocalOnly::Delete { run: id("carried") });
    assert!(!served.path("runs/carried").exists());
    assert!(
        served.start("carried", "straight").repeated,
        "a late start of a deleted run does nothing"
    );
    assert_eq!(served.status().state, State::Stopped);
}

#[test]
fn what_is_not_in_order_is_refused_with_its_kind_and_nothing_starts() {
    let mut served = Served::simulated("");
    let missions: Missions = served.ask(&Request::Missions);
    let names: Vec<&str> = missions.missions.iter().map(|mission| mission.name.as_str()).collect();
    assert_eq!(names, ["broken", "short", "straight"]);
    assert!(
        missions.missions[0].findings.as_ref().unwrap().contains("broken.toml"),
        "{missions:?}"
    );

    let token = || Some(String::new());
    let stale = Request::Start(Start { token: token(), ..start("a", "short") });
    refused_as(&served.refused(&stale), Kind::StaleToken, "not this brick's");
    refused_as(&served.refused(&Request::Start(start("a", "short"))), Kind::StaleToken, "token");
    // What was asked for before a stop is not done after it.
    let overtaken = Start { token: Some(served.status().token), ..start("overtaken", "short") };
    served.stop();
    let overtaken = served.refused(&Request::Start(overtaken));
    refused_as(&overtaken, Kind::Stopped, "a stop has come since");
    let text = |text: String| Start { mission: Chosen::Text(text), ..start("a", "") };
    let mut here = |start: Start, kind, part: &str| {
        refused_as(&served.own_refused(&LocalOnly::StartHere(start)), kind, part);
    };
    here(start("a", "shrot"), Kind::UnknownMission, "shrot");
    here(start("a", "../missions/short"), Kind::UnknownMission, "../missions/short");
    here(start("a", "broken"), Kind::BrokenMission, "broken.toml:1");
    here(text("[[".to_owned()), Kind::BrokenMission, "mission.toml:1");
    here(text("#".repeat(70_000)), Kind::BrokenMission, "bytes");
    here(
        text(STRAIGHT.replace("time_s > 50", "remote == both_up")),
        Kind::BrokenMission,
        "mission.toml",
    );
    let set =
        |name: &str, value| Start { set: vec![(name.to_owned(), value)], ..start("a", "short") };
    here(set("nothing", 1.0), Kind::BadRequest, "nothing");
    here(set("time_limit_s", -1.0), Kind::BadRequest, "time_limit_s");
    here(Start { pose: Some([1e9, 0.0, 0.0]), ..start("a", "short") }, Kind::BadRequest, "pose");

    let unknown = served.refused(&Request::Stop { run: Some(id("a")) });
    refused_as(&unknown, Kind::UnknownRun, "`a`");
    assert!(unknown.hint.is_some_and(|hint| hint.contains("onbrick runs")));
    let fetch = Request::Fetch(Fetch::part(&id("a"), 0, 1));
    refused_as(&served.refused(&fetch), Kind::UnknownRun, "`a`");
    refused_as(&served.own_refused(&LocalOnly::Delete { run: id("a") }), Kind::UnknownRun, "`a`");
    let status = served.status();
    assert_eq!((status.state, status.run, served.runs().len()), (State::Ready, None, 0));
    // The robot's file is read each time: a mistake in it is a fault until it is corrected.
    std::fs::write(served.path("robot.toml"), b"name = 5\n").unwrap();
    let refusal = served.own_refused(&LocalOnly::StartHere(start("a", "short")));
    refused_as(&refusal, Kind::NotReady, "robot.toml:1");
    crate::support::turning_brick::await_that("the fault is seen", || {
        served.status().state == State::Fault
    });
    let status = served.status();
    assert!(status.robot.unwrap().contains("robot.toml:1"));
    assert_eq!(status.last.unwrap().stop.reason.word(), "robot");
    std::fs::remove_file(served.path("robot.toml")).unwrap();
    crate::support::turning_brick::await_that("it is over", || {
        served.status().state == State::Ready
    });
}

#[test]
fn the_run_ends_with_the_menu_where_the_configuration_says_so() {
    for (config, stops) in [("", true), ("when_menu_closes = \"go on\"", false)] {
        let mut served = Served::simulated(config);
        let run = served.drive("straight");
        let mut menu = onbrick::service::client::Client::of_menu_at(served.path("socket"));
        let _: serde_json::Value = menu.ask(&Request::Status, Duration::from_secs(5)).unwrap();
        drop(menu);
        if stops {
            let last = served.await_state(State::Stopped).last.unwrap();
            assert_eq!(
                (last.stop.reason.word().as_str(), last.is_wanted(), last.run),
                ("menu closed", true, Some(run))
            );
        } else {
            let before = served.status().run.unwrap().progress.map_or(0, |progress| progress.tick);
            crate::support::turning_brick::await_that("it drives on", || {
                let status = served.status();
                assert_eq!(status.state, State::Running, "{status:?}");
                status.run.unwrap().progress.is_some_and(|progress| progress.tick > before + 10)
            });
        }
    }
}
