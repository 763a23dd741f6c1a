//! A run in a process of its own, as the service and other starters use it: [`RunProcess`].

use std::path::Path;

use nix::sys::signal::kill;
use nix::unistd::Pid;
use onbrick::clock::SECOND_NS;
use onbrick::recording::{Run, writer};
use onbrick::runtime::StopReason;
use onbrick::runtime::{Event, Job, RunError, RunProcess, StopBy, WhenAbandoned};

use crate::missions::{job, robot};
use crate::support::real_time::patiently;
use crate::support::tested_program;
use crate::support::turning_brick::await_that;

/// The map mission in a simulated arena, in real time so that it is there to be stopped.
fn arena(folder: &Path) -> Job {
    let world = ("arena", onbrick::sim::World::text("arena").unwrap());
    let mut job = job("map", &robot(), world, 1, folder.join("run.mcap"));
    let onbrick::runtime::Brick::Simulated { realtime, .. } = &mut job.brick else {
        unreachable!()
    };
    *realtime = true;
    job.run = Some("7f3a".to_owned());
    job
}

fn start(job: &Job) -> RunProcess {
    let mut run = RunProcess::start(Path::new(tested_program()), job).unwrap();
    while !matches!(run.next_event(), Some(Event::Driving { .. })) {}
    run
}

#[test]
fn a_run_is_stopped_on_somebodys_behalf_and_says_so_before_its_recording_is_finished() {
    patiently(
        "a_run_is_stopped_on_somebodys_behalf_and_says_so_before_its_recording_is_finished",
        || {
            for (by, word) in [
                (StopBy::Remote, "remote"),
                (StopBy::Page, "page"),
                (StopBy::MenuClosed, "menu closed"),
                (StopBy::Terminal, "signal"),
            ] {
                let folder = tempfile::tempdir().unwrap();
                let mut run = start(&arena(folder.path()));
                let stopper = run.stopper();
                std::thread::spawn(move || stopper.stop(by).unwrap()).join().unwrap();
                let last = std::iter::from_fn(|| run.next_event())
                    .filter(|event| !matches!(event, Event::Status(_)))
                    .collect::<Vec<_>>();
                let [Event::Stopped { stop, stopped }, Event::Ended(_)] = &last[..] else {
                    panic!("{last:?}")
                };
                assert_eq!((stop.reason.word().as_str(), *stopped), (word, true));
                let stopper = run.stopper();
                let ended = run.wait().unwrap();
                assert_eq!(
                    (
                        ended.stop.reason.word().as_str(),
                        ended.stop.reason.is_wanted(),
                        ended.stopped
                    ),
                    (word, true, true)
                );
                stopper.stop(by).expect("a run that is over needs no asking");
                let recorded = Run::open(&ended.file).unwrap();
                assert_eq!(recorded.info.unwrap().run.as_deref(), Some("7f3a"));
                assert_eq!(recorded.ending.unwrap().stop, ended.stop);
            }
        },
    );
}

#[test]
fn a_signal_says_on_whose_behalf_a_run_is_stopped_that_a_service_has_found() {
    patiently("a signal says on whose behalf", || {
        for (by, word) in [
            (StopBy::Remote, "remote"),
            (StopBy::Here, "here"),
            (StopBy::MenuClosed, "menu closed"),
            (StopBy::Terminal, "signal"),
        ] {
            let folder = tempfile::tempdir().unwrap();
            let job = arena(folder.path());
            let run = start(&job);
            let driver =
                writer(&job.file).unwrap().expect("the process that drives holds its recording");
            kill(Pid::from_raw(driver), by.signal()).unwrap();
            let ended = run.wait().unwrap();
            assert_eq!(
                (ended.stop.reason.word().as_str(), ended.stop.reason.is_wanted(), ended.stopped),
                (word, true, true)
            );
            assert_eq!(Run::open(&job.file).unwrap().ending.unwrap().stop, ended.stop);
        }
    });
}

#[test]
fn a_run_whose_starter_leaves_it_stops_or_goes_on_as_its_job_says() {
    patiently("a_run_whose_starter_leaves_it_stops_or_goes_on_as_its_job_says", || {
        let how = |when_abandoned| {
            let folder = tempfile::tempdir().unwrap();
            let job = Job {
                when_abandoned,
                set: vec![("time_limit_s".to_owned(), 2.0)],
                ..arena(folder.path())
            };
            let run = start(&job);
            let stopper = run.stopper();
            drop(run);
            stopper.stop(StopBy::Remote).expect("no answer is waited for");
            let mut reason = None;
            await_that("the recording is finished", || {
                let ending = Run::open(&job.file).ok().and_then(|run| run.ending);
                reason = ending.map(|ending| (ending.stop.reason, ending.time_ns));
                reason.is_some()
            });
            reason.unwrap()
        };
        assert_eq!(how(WhenAbandoned::Stop).0, StopReason::Abandoned);
        let (reason, time_ns) = how(WhenAbandoned::GoOn);
        assert_eq!(reason, StopReason::Finished);
        assert!(time_ns >= 2 * SECOND_NS, "{time_ns} ns");
    });
}

#[test]
fn a_job_that_cannot_be_done_is_refused_with_a_hint_and_a_program_that_is_none_is_said_to_be() {
    let folder = tempfile::tempdir().unwrap();
    let mut broken = arena(folder.path());
    broken.mission.text = "name = 5".to_owned();
    let refused =
        RunProcess::start(Path::new(tested_program()), &broken).unwrap().wait().unwrap_err();
    assert!(matches!(&refused, RunError::Refused { .. }), "{refused}");
    assert!(refused.to_string().contains("map.toml"), "{refused}");
    if let Ok(nothing) = RunProcess::start(Path::new("/nowhere/onbrick"), &broken) {
        // QEMU's user mode reports a missing program only by the end of the process that should
        // have run it.
        assert!(cfg!(target_arch = "arm") && nothing.wait().is_err());
    }
    let silent = RunProcess::start(Path::new("/bin/false"), &broken).map(RunProcess::wait);
    if let Ok(waited) = silent {
        assert!(matches!(waited, Err(RunError::Silent { .. })), "{waited:?}");
    }
}
