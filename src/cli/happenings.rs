//! What happens in a run, line by line, where a person asks for it (`-v`).
//!
//! All of it stands in the recording, and is read from there while that grows, so a line comes a
//! sync later at most, and none is lost when a simulation is faster than a terminal.

use std::path::PathBuf;

use super::Output;
use crate::printable::with_causes;
use crate::recording::Moments;

/// Tells what happens in a run.
pub(super) struct Happenings {
    recording: PathBuf,
    moments: Option<Moments>,
}

impl Happenings {
    /// Of the run that writes this recording, which need not be there yet.
    pub(super) fn of(recording: PathBuf) -> Self {
        Self { recording, moments: None }
    }

    /// Tells what has come since the last time; nothing without `-v`.
    pub(super) fn tell(&mut self, output: &mut Output) {
        if !log::log_enabled!(log::Level::Info) {
            return;
        }
        if self.moments.is_none() {
            self.moments = Moments::of(&self.recording).ok();
        }
        let Some(moments) = &mut self.moments else { return };
        let told = moments.look(&mut |moment| {
            output.value(moment);
            log::info!("{moment}");
        });
        if let Err(error) = told {
            log::warn!("cannot read {}: {}", self.recording.display(), with_causes(&error));
        }
    }
}
