//! All open files, by the numbers that the kernel keeps for us, and which of them a thread waits
//! for.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Mutex;

use nix::errno::Errno;

use super::handle::Handle;
use crate::threads::lock;

/// All open files and folders of a mount.
#[derive(Debug, Default)]
pub(super) struct Open(Mutex<Table>);

#[derive(Debug, Default)]
struct Table {
    handles: BTreeMap<u64, Handle>,
    watched: BTreeSet<u64>,
    last: u64,
}

impl Open {
    /// Keeps a file; returns its number.
    pub(super) fn insert(&self, handle: Handle) -> u64 {
        let mut table = lock(&self.0);
        table.last += 1;
        let number = table.last;
        table.handles.insert(number, handle);
        number
    }

    /// A file was closed for the last time.
    pub(super) fn remove(&self, number: u64) {
        let mut table = lock(&self.0);
        table.handles.remove(&number);
        table.watched.remove(&number);
    }

    /// Does something with an open file.
    ///
    /// # Errors
    ///
    /// EBADF for a number that is nothing's; what `act` says.
    pub(super) fn with<R>(
        &self,
        number: u64,
        act: impl FnOnce(&mut Handle) -> Result<R, Errno>,
    ) -> Result<R, Errno> {
        act(lock(&self.0).handles.get_mut(&number).ok_or(Errno::EBADF)?)
    }

    /// From now on [`Open::wake`] looks at a file.
    pub(super) fn watch(&self, number: u64) {
        lock(&self.0).watched.insert(number);
    }

    /// Wakes those who wait, where there is something; `interrupts` says whether to look for
    /// interrupted ones too.
    pub(super) fn wake(&self, interrupts: bool) {
        let mut table = lock(&self.0);
        let Table { handles, watched, .. } = &mut *table;
        watched
            .retain(|number| handles.get_mut(number).is_some_and(|handle| handle.wake(interrupts)));
    }

    /// Sends all readers away who wait.
    pub(super) fn release_readers(&self) {
        lock(&self.0).handles.values_mut().for_each(Handle::release_readers);
    }
}
