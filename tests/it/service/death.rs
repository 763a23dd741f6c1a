//! The service's end, asked for or not: what becomes of the run, and what the next service finds.

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use onbrick::protocol::{State, Stopped};
use onbrick::recording::{Run, Status, writer};

use super::{Served, id, start};
use crate::support::real_time::patiently;
use crate::support::turning_brick::await_that;

#[test]
fn a_service_that_is_told_to_end_stops_the_run_first() {
    let mut served = Served::simulated("");
    let run = served.drive("straight");
    assert_eq!(served.end(), Some(0));
    let recorded = Run::open(&served.path("runs").join(run.as_str()).join("run.mcap")).unwrap();
    assert_eq!(
        recorded.ending.expect("its recording is whole").stop.to_string(),
        "stopped by a signal"
    );
    assert!(!served.path("socket").exists(), "the door is closed");
}

#[test]
fn a_killed_services_run_stops_and_the_next_service_knows_how() {
    let mut served = Served::simulated("");
    let run = served.drive("straight");
    served.killed_and_started_anew();
    // It may have come while the run was still ending.
    await_that("the run is over", || served.status().run.is_none());
    let last = served.status().last.unwrap();
    assert_eq!(
        (last.stop.reason.word().as_str(), last.is_wanted(), last.run.as_ref()),
        ("abandoned", false, Some(&run))
    );
    let info = served.runs().into_iter().find(|info| info.run == run).unwrap();
    assert_eq!(info.end.unwrap().stop.reason.word(), "abandoned");
    assert!(served.start(run.as_str(), "straight").repeated, "its identifier is remembered");
}

#[test]
fn where_configured_a_killed_services_run_goes_on_and_the_next_service_finds_it_and_stops_it() {
    patiently("a run that continues without its service", a_run_that_goes_on);
}

fn a_run_that_goes_on() {
    let mut served = Served::simulated("when_service_dies = \"go on\"");
    let run = served.drive("straight");
    let file = served.path("runs").join(run.as_str()).join("run.mcap");
    let driver = writer(&file).unwrap().expect("the process that drives holds its recording");
    served.killed_and_started_anew();
    assert_eq!(writer(&file).unwrap(), Some(driver), "the same process drives on");
    let status = served.status();
    assert_eq!((status.state, status.run.unwrap().run), (State::Running, run.clone()));
    // How it goes is read from its recording, second by second.
    let mut seen = Vec::new();
    await_that("it tells how it goes, twice", || {
        let progress = served.status().run.and_then(|run| run.progress);
        seen.extend(
            progress.filter(|now| seen.last().is_none_or(|last: &Status| last.tick < now.tick)),
        );
        seen.len() >= 2
    });
    let now = seen.last().unwrap();
    assert!(
        now.elapsed_ns > 0 && now.travelled_m > seen[0].travelled_m && now.battery_v.is_some(),
        "{now:?}"
    );
    assert!(
        now.states.iter().any(|(machine, state)| machine == "drive" && !state.is_empty()),
        "{now:?}"
    );
    let other = served.own_refused(&onbrick::protocol::LocalOnly::StartHere(start("b", "short")));
    super::refused_as(&other, onbrick::protocol::Kind::Busy, run.as_str());
    assert_eq!(served.stop(), Stopped { run: Some(run.clone()), stopped: true, other: None });
    assert_eq!(writer(&file).unwrap(), None);
    await_that("its end is noted", || served.status().run.is_none());
    let last = served.status().last.unwrap();
    assert_eq!(
        (last.stop.reason.word().as_str(), last.is_wanted(), last.run.as_ref()),
        ("here", true, Some(&run))
    );
    assert!(served.runs()[0].end.is_some());
    assert_eq!(Run::open(&file).unwrap().ending.unwrap().stop.to_string(), "stopped on the brick");
}

#[test]
fn a_run_that_is_killed_is_a_fault_and_after_a_crash_of_everything_it_is_listed_as_cut() {
    let mut served = Served::simulated("");
    let run = served.drive("straight");
    let file = |run: &str| served.path("runs").join(run).join("run.mcap");
    let driver = writer(&file(run.as_str())).unwrap().unwrap();
    let files = [file("cut"), file(run.as_str())];
    kill(Pid::from_raw(driver), Signal::SIGKILL).unwrap();
    await_that("the fault is seen", || served.status().state == State::Fault);
    let last = served.status().last.unwrap();
    assert!(!last.is_wanted() && last.run == Some(run.clone()), "{last:?}");
    served.own::<serde_json::Value>(&onbrick::protocol::LocalOnly::Acknowledge);
    assert_eq!(served.status().state, State::Ready);

    // As a power cut leaves it: a record without an end, a recording without one.
    std::fs::create_dir(files[0].parent().unwrap()).unwrap();
    let record = std::fs::read_to_string(files[1].with_file_name("run.json")).unwrap();
    let mut record: serde_json::Value = serde_json::from_str(&record).unwrap();
    record["run"] = "cut".into();
    record["number"] = 77.into();
    record["end"] = serde_json::Value::Null;
    std::fs::write(files[0].with_file_name("run.json"), record.to_string()).unwrap();
    std::fs::copy(&files[1], &files[0]).unwrap();
    served.killed_and_started_anew();
    let cut = served.runs().remove(0);
    assert_eq!((cut.run.clone(), cut.going_on, cut.end), (id("cut"), false, None));
    assert_eq!(served.status().state, State::Ready, "nothing moves by itself");
    let (bytes, _) = served.fetch_all(&id("cut"));
    assert!(!bytes.is_empty() && bytes == std::fs::read(&files[0]).unwrap());
}
