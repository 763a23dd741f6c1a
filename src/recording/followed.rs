//! A recording that is looked at while another process, or a download, writes it: all that a
//! [`Run`] has and a person looks at, as far as it has come.
//!
//! # Not here
//!
//! What only a replay needs: of senses only the newest tick's are kept, and no checkpoints.
//! [`Progress`](super::Progress) keeps nothing but the status, for a brick's memory.

use std::io;
use std::path::PathBuf;

use super::grid::Grid;
use super::growing::GrowingFile;
use super::progress::Heard;
use super::run::{Collected, Run};
use super::status::Status;
use crate::document::if_there;

/// A recording that is followed. It lags behind the run by a sync, a second as a rule.
#[derive(Debug)]
pub struct Followed {
    path: PathBuf,
    /// Open since there was something in it: a download that is complete is given another name.
    file: Option<GrowingFile>,
    heard: Heard,
    collected: Collected,
}

impl Followed {
    /// Begins at a recording's beginning. The file need not be there yet.
    #[must_use]
    pub fn of(path: PathBuf) -> Self {
        Self { path, file: None, heard: Heard::default(), collected: Collected::default() }
    }

    /// Reads on to the file's end.
    ///
    /// # Errors
    ///
    /// The file is there and cannot be read.
    pub fn look(&mut self) -> io::Result<()> {
        // A download deletes its empty file when it fails; the next one makes another.
        if self.file.as_ref().is_none_or(GrowingFile::is_unread)
            && let Some(file) = if_there(GrowingFile::open(&self.path))?
        {
            self.file = Some(file);
        }
        let Some(file) = &mut self.file else { return Ok(()) };
        let (heard, collected) = (&mut self.heard, &mut self.collected);
        while file.look(&mut |found| {
            let _ = heard.take(&found);
            let _ = collected.take(found);
        })? {
            collected.run.checkpoints.clear();
            collected.run.senses.drain(..collected.run.senses.len().saturating_sub(1));
        }
        Ok(())
    }

    /// What has come of the run.
    #[must_use]
    pub fn run(&self) -> &Run {
        &self.collected.run
    }

    /// How the run is going; `None` before it drives.
    #[must_use]
    pub fn status(&self) -> Option<&Status> {
        self.heard.drives.then_some(&self.heard.status)
    }

    /// The map as it was recorded last, and its stamp: [`Run::map`] is the whole one at the end.
    #[must_use]
    pub fn map(&self) -> Option<(i64, &Grid)> {
        self.collected.map.as_ref().map(|(stamp_ns, map)| (*stamp_ns, map))
    }
}
