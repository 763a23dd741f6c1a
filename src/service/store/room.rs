//! Room for a run: which runs go when there is none.

use super::{RESERVE_BYTES, Store, StoreError, files};
use crate::protocol::RunId;
use crate::threads::lock;

impl Store {
    /// Bytes of all recordings.
    pub(super) fn used(&self) -> u64 {
        let index = lock(&self.index);
        index.runs.values().map(|entry| entry.bytes).fold(0, u64::saturating_add)
    }

    /// Deletes what must go so that `more` bytes fit.
    ///
    /// # Errors
    ///
    /// [`StoreError::NoRoom`] where the disk would still be too full; nothing is deleted in vain.
    /// [`StoreError::Disk`].
    pub(super) fn make_room(&self, more: u64) -> Result<(), StoreError> {
        loop {
            let fits = self.used().saturating_add(more.min(self.quota)) <= self.quota;
            if fits && files::free(&self.folder) >= more {
                return Ok(());
            }
            self.could_have_room()?;
            let Some(run) = self.next_to_go() else {
                // A quota that the run alone exceeds takes nothing else away; only the disk itself
                // can be too full.
                return Ok(());
            };
            log::info!("run {run} is deleted to make room");
            self.delete(&run)?;
        }
    }

    /// The run that is going on has grown: older ones make room for it. Called now and then.
    pub(in crate::service) fn grow(&self) {
        let run = lock(&self.index).going_on.clone();
        let Some(run) = run else { return };
        let bytes = files::length(&self.recording(&run));
        if let Some(entry) = lock(&self.index).find_mut(&run) {
            entry.bytes = bytes;
        }
        // What nothing can be done about shows when the recorder meets it.
        if let Err(error) = self.make_room(RESERVE_BYTES / 4) {
            log::debug!("{error}");
        }
    }

    /// Whether there is room, or would be once all has gone that may go.
    pub(super) fn could_have_room(&self) -> Result<(), StoreError> {
        let free = files::free(&self.folder);
        let index = lock(&self.index);
        let could_be = index.over().map(|entry| entry.bytes).fold(free, u64::saturating_add);
        let needed = if index.going_on.is_some() { RESERVE_BYTES / 4 } else { RESERVE_BYTES };
        if could_be >= needed {
            Ok(())
        } else {
            Err(StoreError::NoRoom { folder: self.folder.clone(), free })
        }
    }

    /// The oldest that was fetched, else the oldest.
    fn next_to_go(&self) -> Option<RunId> {
        let index = lock(&self.index);
        let fetched = index.over().find(|entry| entry.record.fetched);
        fetched.or_else(|| index.over().next()).map(|entry| entry.record.run.clone())
    }
}
