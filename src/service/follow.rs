//! Following a run to its end: one that was started here, or one that an earlier service left.

use std::io;
use std::path::PathBuf;

use super::core::Service;
use super::machine::Happening;
use super::start::Stop as StopHandle;
use super::store::Record;
use crate::clock::{Clock, MILLISECOND_NS, MonotonicClock};
use crate::ev3dev::Tree as _;
use crate::printable::with_causes;
use crate::protocol::{LastStop, RunId, RunStatus};
use crate::recording;
use crate::runtime::{Ended, Event, RunError, RunProcess, Stop, StopReason};
use crate::threads::{lock, spawn};

/// How often a run that was found is looked at, nanoseconds: nothing tells us when it ends.
const LOOK_NS: i64 = 100 * MILLISECOND_NS;

impl Service {
    /// Follows a run in a thread of its own.
    pub(super) fn follow(&self, mut process: RunProcess, run: &RunStatus) -> io::Result<()> {
        let service = self.clone();
        let (run, mission) = (run.run.clone(), run.mission.clone());
        spawn("run", move || {
            while let Some(event) = process.next_event() {
                if let Some(happening) = happening(event) {
                    service.inner.happen(happening);
                }
            }
            service.note_end(&run, &mission, process.wait());
        })?;
        Ok(())
    }

    /// Looks at the runs that earlier services left without an end: they go on, have ended
    /// meanwhile, or were cut.
    pub(super) fn find_runs(&self) -> io::Result<()> {
        let mut found = None;
        for record in self.inner.store.open_ended() {
            let file = self.inner.store.recording(&record.run);
            match recording::writer(&file) {
                Ok(Some(pid)) if lock(&self.inner.now).machine.run().is_none() => {
                    log::info!(
                        "run {} of an earlier service is still in progress, process {pid}",
                        record.run
                    );
                    self.take_over(&record, file)?;
                }
                _ => found = Some(self.note_found_end(&record, &file)),
            }
        }
        // The newest run, where it is over and where it was cut.
        if let Some(last) = self.inner.store.last_end().or(found) {
            lock(&self.inner.now).machine.recall(last);
        }
        Ok(())
    }

    fn take_over(&self, record: &Record, file: PathBuf) -> io::Result<()> {
        let inner = &self.inner;
        inner.store.goes_on(&record.run);
        let Record { run, mission, time_limit_s, by, .. } = record;
        let run = RunStatus::new(run.clone(), mission, *time_limit_s, by);
        {
            let mut now = lock(&inner.now);
            // Nothing else runs: that was looked at before.
            let _ = now.machine.start(MonotonicClock.now_ns(), run);
            now.stop = Some(StopHandle::Found {
                file: file.clone(),
                root: inner.hardware.machine().map(|tree| tree.root().to_owned()),
            });
            // It may; then its lights are its own.
            now.missions_lights = true;
        }
        inner.happen(Happening::Driving);
        let (service, record) = (self.clone(), record.clone());
        spawn("found run", move || {
            let mut progress = recording::Progress::of(&file).ok();
            while matches!(recording::writer(&file), Ok(Some(_))) {
                if let Some(Ok(Some(status))) = progress.as_mut().map(recording::Progress::look) {
                    service.inner.happen(Happening::Progress(status));
                }
                MonotonicClock.sleep_ns(LOOK_NS);
            }
            let end = service.note_found_end(&record, &file);
            lock(&service.inner.now).stop = None;
            service.inner.happen(Happening::MotorsTold { stopped: end.is_wanted() });
            service.inner.happen(Happening::Ended(end));
        })?;
        Ok(())
    }

    /// Notes how a run ended that no thread followed; one that was cut is left without an end.
    fn note_found_end(&self, record: &Record, file: &std::path::Path) -> LastStop {
        let ending = recording::ending_of(file).ok().flatten();
        let stop = ending.map_or_else(|| StopReason::Cut.into(), |ending| ending.stop);
        let end = self.ended(&record.run, &record.mission, stop);
        log::info!("run {}: {end}", record.run);
        let told = (end.stop.reason != StopReason::Cut).then(|| end.clone());
        self.inner.store.end(&record.run, told, None, None);
        end
    }

    fn note_end(&self, run: &RunId, mission: &str, ended: Result<Ended, RunError>) {
        let inner = &self.inner;
        // Whether the motors were told to stop; nothing was recorded of what was refused.
        let stopped = match &ended {
            Ok(ended) => Some(ended.stopped),
            Err(RunError::Refused { .. }) => None,
            Err(error) => Some(matches!(error, RunError::Silent { stopped: true, .. })),
        };
        let (stop, recording) = match &ended {
            Ok(ended) => (ended.stop.clone(), ended.recording.clone()),
            Err(RunError::Refused { stop, hint }) => {
                let mut stop = stop.clone();
                if let Some(hint) = hint {
                    stop.add(hint);
                }
                (stop, None)
            }
            Err(error) => {
                let then = match stopped {
                    Some(true) => "its motors were stopped",
                    _ => "onbrick halt, to be sure that the motors are still",
                };
                (StopReason::Died.with(format!("{}; {then}", with_causes(error))), None)
            }
        };
        let last = LastStop { recording, ..self.ended(run, mission, stop) };
        match last.is_wanted() {
            true => log::info!("run {run}: {last}"),
            false => log::warn!("run {run}: {last}"),
        }
        match stopped {
            None => inner.store.take_back(run),
            Some(stopped) => {
                inner.happen(Happening::MotorsTold { stopped });
                let went = ended.as_ref().ok().map(|ended| (ended.travelled_m, ended.points));
                let (way_m, points) = went.unzip();
                inner.store.end(run, Some(last.clone()), way_m, points);
            }
        }
        lock(&inner.now).stop = None;
        inner.happen(Happening::Ended(last));
    }

    /// How a run ended, with who asked for it.
    fn ended(&self, run: &RunId, mission: &str, stop: Stop) -> LastStop {
        let asked = matches!(stop.reason, StopReason::Remote | StopReason::Here);
        let by = lock(&self.inner.now)
            .stopped_by
            .as_ref()
            .filter(|_| asked)
            .map(|(_, asker)| asker.clone());
        LastStop { by, ..LastStop::new(Some(run.clone()), mission, stop) }
    }
}

fn happening(event: Event) -> Option<Happening> {
    match event {
        Event::Preparing { what } => Some(Happening::Waits(what)),
        Event::Driving { .. } => Some(Happening::Driving),
        Event::Status(status) => Some(Happening::Progress(status)),
        Event::Stopped { stopped, .. } => Some(Happening::MotorsTold { stopped }),
        // Its end is told when its processes are gone and the hardware is free.
        Event::Refused { .. } | Event::Ended(_) => None,
    }
}
