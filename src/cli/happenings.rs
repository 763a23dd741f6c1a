//! A run as a person sees it: what its mission says, below it a bar of its time; or line by line
//! all that happens in it (`-v`).
//!
//! What happens stands in the recording, and is read from there while that grows, so a line comes a
//! sync later at most, and none is lost when a simulation is faster than a terminal.

use std::path::PathBuf;

use super::Output;
use super::common::Progress;
use crate::printable::with_causes;
use crate::recording::Moments;
use crate::runtime::Event;

/// Tells how a run is going.
pub(super) struct Happenings {
    progress: Option<Progress>,
    recording: PathBuf,
    moments: Option<Moments>,
}

impl Happenings {
    /// Of the run that writes this recording, which need not be there yet.
    pub(super) fn of(recording: PathBuf, progress: Option<Progress>) -> Self {
        Self { progress, recording, moments: None }
    }

    /// Tells an event, and what has happened since the last one.
    pub(super) fn hear(&mut self, event: &Event, output: &mut Output) {
        output.value(event);
        if let Some(progress) = &self.progress {
            progress.show(event);
        }
        self.tell(output);
    }

    /// Tells what happened last, and takes the bar away.
    pub(super) fn finish(&mut self, output: &mut Output) {
        self.progress.iter().for_each(Progress::finish);
        self.tell(output);
    }

    /// Tells what has come since the last time; without `-v` what the mission says.
    fn tell(&mut self, output: &mut Output) {
        let all = log::log_enabled!(log::Level::Info);
        if self.moments.is_none() {
            self.moments = Moments::of(&self.recording).ok();
        }
        let Some(moments) = &mut self.moments else { return };
        let progress = self.progress.as_ref();
        let told = moments.look(&mut |moment| {
            if all {
                output.value(moment);
                log::info!("{moment}");
            } else if moment.is_said() {
                let mut line = || output.line(moment.to_string());
                match progress {
                    Some(progress) => progress.above(line),
                    None => line(),
                }
            }
        });
        if let Err(error) = told {
            log::warn!("cannot read {}: {}", self.recording.display(), with_causes(&error));
        }
    }
}
