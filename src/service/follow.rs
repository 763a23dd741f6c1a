//! Following a run to its end: one that was started here, or one that an earlier service left.

use std::io;
use std::path::PathBuf;

use super::core::Service;
use super::machine::Happening;
use super::protocol::{LastStop, RunId, RunStatus};
use super::start::Stop;
use super::store::Record;
use crate::clock::{Clock, MILLISECOND_NS, MonotonicClock};
use crate::ev3dev::Tree as _;
use crate::robot::Channel;
use crate::runtime::with_causes;
use crate::runtime::{Ended, Event, NotReady, RunError, RunProcess, StopBy, StopReason, recording};

/// How often a run that was found is looked at, nanoseconds: nothing tells us when it ends.
const LOOK_NS: i64 = 100 * MILLISECOND_NS;

/// The word of a run whose recording has no end.
const CUT: &str = "cut";

impl Service {
    /// Follows a run in a thread of its own.
    pub(super) fn follow(&self, mut process: RunProcess, run: &RunStatus) -> io::Result<()> {
        let service = self.clone();
        let (run, mission) = (run.run.clone(), run.mission.clone());
        let thread = std::thread::Builder::new().name("run".to_owned());
        thread.spawn(move || {
            while let Some(event) = process.next_event() {
                if let Some(happening) = happening(event) {
                    service.inner.happen(happening);
                }
            }
            service.note_end(&run, &mission, process.wait());
        })?;
        Ok(())
    }

    /// Looks at the runs that earlier services left without an end: they go on, have ended meanwhile, or were cut.
    pub(super) fn find_runs(&self) -> io::Result<()> {
        let mut found = None;
        for record in self.inner.store.open_ended() {
            let file = self.inner.store.recording(&record.run);
            match recording::writer(&file) {
                Ok(Some(pid)) if self.inner.now().machine.run().is_none() => {
                    log::info!("run {} goes on in process {pid} since an earlier service", record.run);
                    self.take_over(&record, file)?;
                }
                _ => found = Some(self.note_found_end(&record, &file)),
            }
        }
        // The newest run, where it is over and where it was cut.
        if let Some(last) = self.inner.store.last_end().or(found) {
            self.inner.now().machine.recall(last);
        }
        Ok(())
    }

    fn take_over(&self, record: &Record, file: PathBuf) -> io::Result<()> {
        let inner = &self.inner;
        inner.store.goes_on(&record.run);
        let run = RunStatus {
            run: record.run.clone(),
            mission: record.mission.clone(),
            time_limit_s: record.time_limit_s,
            by: record.by.clone(),
            waits: None,
            progress: None,
        };
        {
            let mut now = inner.now();
            // Nothing else runs: that was looked at before.
            let _ = now.machine.start(MonotonicClock.now_ns(), run);
            now.stop = Some(Stop::Found {
                file: file.clone(),
                root: inner.bench.machine().map(|tree| tree.root().to_owned()),
            });
            // It may; then its lights are its own.
            now.missions_lights = true;
        }
        inner.happen(Happening::Driving);
        let (service, record) = (self.clone(), record.clone());
        let thread = std::thread::Builder::new().name("found run".to_owned());
        thread.spawn(move || {
            let mut progress = recording::Progress::of(&file).ok();
            while matches!(recording::writer(&file), Ok(Some(_))) {
                if let Some(Ok(Some(status))) = progress.as_mut().map(recording::Progress::look) {
                    service.inner.happen(Happening::Progress(status));
                }
                MonotonicClock.sleep_until_ns(MonotonicClock.now_ns() + LOOK_NS);
            }
            let end = service.note_found_end(&record, &file);
            service.inner.now().stop = None;
            service.inner.happen(Happening::MotorsTold { stopped: end.wanted });
            service.inner.happen(Happening::Ended(end));
        })?;
        Ok(())
    }

    /// Notes how a run ended that nobody followed; one that was cut is left without an end.
    fn note_found_end(&self, record: &Record, file: &std::path::Path) -> LastStop {
        let (word, wanted, reason) = match recording::ending_of(file) {
            Ok(Some(ending)) => {
                let (word, wanted) = word_of(&ending.reason);
                (word, wanted, ending.reason)
            }
            _ => (CUT, false, "its recording was cut: the power, the disk or the program failed".to_owned()),
        };
        let end = self.ended(&record.run, &record.mission, word, reason, wanted);
        log::info!("run {}: {}", record.run, end.reason);
        let told = (word != CUT).then(|| end.clone());
        self.inner.store.end(&record.run, told, None, None);
        end
    }

    fn note_end(&self, run: &RunId, mission: &str, ended: Result<Ended, RunError>) {
        let inner = &self.inner;
        let last = match &ended {
            Ok(ended) => {
                let reason = match &ended.recording {
                    Some(trouble) => format!("{}; the recording is not complete: {trouble}", ended.reason),
                    None => ended.reason.clone(),
                };
                self.ended(run, mission, &ended.word, reason, ended.wanted)
            }
            Err(RunError::Refused { message, hint }) => self.refused(run, mission, message, hint.as_deref()),
            Err(error) => {
                let then = match error {
                    RunError::Silent { stopped: true, .. } => "its motors were stopped",
                    _ => "onbrick halt, to be sure that the motors are still",
                };
                self.ended(run, mission, "died", format!("{}; {then}", with_causes(error)), false)
            }
        };
        match &last.wanted {
            true => log::info!("run {run}: {}", last.reason),
            false => log::warn!("run {run}: {}", last.reason),
        }
        match &ended {
            Ok(ended) => {
                inner.happen(Happening::MotorsTold { stopped: ended.stopped });
                inner.store.end(run, Some(last.clone()), Some(ended.travelled_m), Some(ended.points));
            }
            // Nothing was recorded.
            Err(RunError::Refused { .. }) => inner.store.take_back(run),
            Err(error) => {
                let stopped = matches!(error, RunError::Silent { stopped: true, .. });
                inner.happen(Happening::MotorsTold { stopped });
                inner.store.end(run, Some(last.clone()), None, None);
            }
        }
        inner.now().stop = None;
        inner.happen(Happening::Ended(last));
    }

    /// A run that did not start: because somebody stopped it, or because something was not in order.
    fn refused(&self, run: &RunId, mission: &str, message: &str, hint: Option<&str>) -> LastStop {
        let asked = self.inner.now().stopped_by.as_ref().map(|(by, _)| *by);
        let was_stopped = message.ends_with(&NotReady::Stopped.to_string());
        let (word, wanted) = match asked.filter(|_| was_stopped) {
            Some(StopBy::Remote) => (StopReason::Remote.word(), true),
            Some(StopBy::Here) => (StopReason::Here.word(), true),
            Some(StopBy::MenuClosed) => (StopReason::MenuClosed.word(), true),
            Some(StopBy::Terminal) => (StopReason::Signal.word(), true),
            Some(StopBy::Abandoned) => (StopReason::Abandoned.word(), false),
            None if was_stopped => (StopReason::Button.word(), true),
            None => ("refused", false),
        };
        let reason = hint.map_or_else(|| message.to_owned(), |hint| format!("{message}; {hint}"));
        self.ended(run, mission, word, reason, wanted)
    }

    fn ended(&self, run: &RunId, mission: &str, word: &str, reason: String, wanted: bool) -> LastStop {
        let asker = self.inner.now().stopped_by.clone();
        let reason = match asker {
            Some((_, asker))
                if [StopReason::Remote, StopReason::Here].map(StopReason::word).contains(&word) =>
            {
                format!("{reason} ({asker})")
            }
            _ => reason,
        };
        LastStop {
            run: Some(run.clone()),
            mission: mission.to_owned(),
            word: word.to_owned(),
            reason,
            wanted,
        }
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

/// A recording keeps the reason as people read it; this is its word, and whether it is a wanted end.
fn word_of(reason: &str) -> (&'static str, bool) {
    use StopReason as Reason;
    let plain = [
        Reason::Finished,
        Reason::TimeLimit,
        Reason::Button,
        Reason::Remote,
        Reason::Here,
        Reason::MenuClosed,
        Reason::Signal,
        Reason::Abandoned,
        Reason::Stalled,
        Reason::Battery,
        Reason::Late,
        Reason::Recording,
        Reason::Battery,
        Reason::Guard,
        Reason::Unguarded,
        Reason::Outside(Channel::Left),
        Reason::Lost(Channel::Left),
        Reason::Implausible(Channel::Gyro),
        Reason::Fallen,
        Reason::Panicked,
    ];
    // Some name a device after a colon.
    let says =
        |plain: &&Reason| plain.to_string().split(':').next().is_some_and(|head| reason.starts_with(head));
    plain.iter().find(says).map_or(("unknown", false), |known| (known.word(), known.is_wanted()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recorded_reason_gives_its_word_back() {
        assert_eq!(word_of("stopped by a button on the brick"), ("button", true));
        assert_eq!(word_of("whoever started the run is gone"), ("abandoned", false));
        assert_eq!(word_of(&StopReason::Battery.to_string()), ("battery", false));
        assert_eq!(word_of(&format!("{}: ENODEV", StopReason::Lost(Channel::Gyro))), ("lost", false));
        assert_eq!(word_of(&StopReason::Implausible(Channel::Head).to_string()), ("implausible", false));
        assert_eq!(word_of(&StopReason::Outside(Channel::Right).to_string()), ("outside", false));
        assert_eq!(word_of(&StopReason::Guard.to_string()), ("guard", false));
        assert_eq!(word_of(&StopReason::Fallen.to_string()), ("fallen", false));
        assert_eq!(word_of("made up"), ("unknown", false));
    }
}
