//! The runs on a brick's disk: a folder each, a quota over all, and what is remembered of those
//! that are gone.
//!
//! ```text
//! runs/<identifier>/run.mcap    the recording, written by the run's own process
//! runs/<identifier>/run.json    what the service knows of it ([`Record`]), replaced in one piece
//! runs/deleted                  identifiers and numbers of deleted runs, a line each
//! runs/service.lock             held by the service that keeps this folder
//! ```
//!
//! Room is made by deleting: runs that a client has fetched go first, oldest first, then the
//! others, oldest first; never the run in progress. A run counts as fetched when a client has named
//! the hash of all of it, as it lies on that client's disk.
//!
//! # Not here
//!
//! No decision when a run starts or is over. No path comes from outside: a folder's name is a
//! [`RunId`], which has no signs that a path could use.
//!
//! # What we count on
//!
//! - One service keeps a folder; the lock sees to that.
//! - A recording only grows.
//!
//! # Costs
//!
//! The index is in memory, about 500 bytes a run. While it is locked, the only disk access is
//! writing a `run.json`. A hash is computed once, piece by piece, by the caller of
//! [`Store::hash_one`], with nothing locked.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use nix::fcntl::Flock;

use super::digest::sha256_hex_of;
use crate::document::if_there;
use crate::protocol::{
    Disk, Fetch, Fetched, Kind, LastStop, MAX_FETCH_BYTES, Refusal, RunId, RunInfo,
};
use crate::threads::lock;

mod files;
mod record;
mod room;

pub(super) use files::replace_file;
pub(super) use record::Record;

/// A run needs this much room to begin with, bytes: five minutes of the shipped robot. While it
/// grows, room is made for it.
pub(super) const RESERVE_BYTES: u64 = 8 << 20;

/// The recording's name in a run's folder.
pub(super) const RECORDING: &str = "run.mcap";

/// The runs on the disk.
#[derive(Debug)]
pub(super) struct Store {
    folder: PathBuf,
    quota: u64,
    index: Mutex<Index>,
    /// Held while a `run.json` is written: several threads note things of the same run.
    saving: Mutex<()>,
    /// Nothing where the folder cannot be written to; then nothing is written.
    _lock: Option<Flock<File>>,
}

#[derive(Debug, Default)]
struct Index {
    /// By number, so oldest first.
    runs: BTreeMap<u64, Entry>,
    deleted: BTreeSet<RunId>,
    next: u64,
    going_on: Option<RunId>,
}

/// A run in memory.
#[derive(Debug, Clone)]
struct Entry {
    record: Record,
    /// Of the recording; of one that is going on, as of the last look.
    bytes: u64,
    /// The file says the same.
    saved: bool,
}

/// Why something was not done with the runs.
#[derive(Debug, thiserror::Error)]
pub(super) enum StoreError {
    /// Another service keeps this folder: stop it, or use another folder.
    #[error("another service keeps the runs in {}", .0.display())]
    Kept(PathBuf),
    /// The disk is full and nothing can be deleted: make room on it.
    #[error(
        "no room for a run: {} MB are free in {}, {} MB are needed, and there is nothing more \
         that may be deleted",
        free >> 20,
        folder.display(),
        RESERVE_BYTES >> 20
    )]
    NoRoom {
        /// The folder of runs.
        folder: PathBuf,
        /// Bytes that are free.
        free: u64,
    },
    /// The disk does not do it: look at its permissions, or whether it is read-only.
    #[error("cannot {doing} {}: {source}", path.display())]
    Disk {
        /// What was being done.
        doing: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// What the file system says.
        source: io::Error,
    },
    /// There is no such run.
    #[error("there is no run `{0}` here")]
    Unknown(RunId),
    /// It is being written.
    #[error("the run `{0}` is going on")]
    GoingOn(RunId),
    /// A fetch from beyond the end.
    #[error("the recording has {total} bytes, and {offset} is beyond its end")]
    BeyondEnd {
        /// Asked for.
        offset: u64,
        /// The recording's length.
        total: u64,
    },
}

impl From<StoreError> for Refusal {
    fn from(error: StoreError) -> Self {
        const DELETE: &str = "delete something else from the card, or use a larger one";
        let (kind, hint) = match &error {
            StoreError::NoRoom { .. } => (Kind::NoRoom, Some(DELETE)),
            StoreError::Unknown(_) => (Kind::UnknownRun, Some("onbrick runs lists them")),
            StoreError::GoingOn(_) => (Kind::Busy, Some("stop it first")),
            StoreError::BeyondEnd { .. } => (Kind::BeyondEnd, None),
            StoreError::Kept(_) | StoreError::Disk { .. } => (Kind::Failed, None),
        };
        let refusal = Self::new(kind, error.to_string());
        hint.into_iter().fold(refusal, Self::hint)
    }
}

impl Store {
    /// Takes a folder of runs and creates it if needed. A read-only folder is taken for what is in
    /// it; [`Store::trouble`] reports it.
    ///
    /// # Errors
    ///
    /// [`StoreError::Kept`].
    pub(super) fn open(folder: &Path, quota: u64) -> Result<Self, StoreError> {
        let lock = match files::keep(folder) {
            Err(error @ StoreError::Kept(_)) => return Err(error),
            lock => lock.ok(),
        };
        let index = Index::read(folder, lock.is_some());
        Ok(Self {
            folder: folder.to_owned(),
            quota,
            index: Mutex::new(index),
            saving: Mutex::default(),
            _lock: lock,
        })
    }

    /// True for a run that is or once was here.
    pub(super) fn knows(&self, run: &RunId) -> bool {
        let index = lock(&self.index);
        index.deleted.contains(run) || index.find(run).is_some()
    }

    /// What keeps any run from being recorded.
    pub(super) fn trouble(&self) -> Option<StoreError> {
        let looked = match &self._lock {
            None => files::keep(&self.folder).map(drop),
            Some(_) => files::look(&self.folder),
        };
        looked.and_then(|()| self.could_have_room()).err()
    }

    /// Begins a run: makes room, and a folder for it. Where its recording goes.
    ///
    /// # Errors
    ///
    /// [`StoreError`]; nothing is left of it then.
    pub(super) fn begin(&self, record: Record) -> Result<PathBuf, StoreError> {
        if self._lock.is_none() {
            files::keep(&self.folder)?;
        }
        self.make_room(RESERVE_BYTES)?;
        let mut index = lock(&self.index);
        let record = Record { number: index.next, ..record };
        let folder = self.folder_of(&record.run);
        files::make_folder(&folder)?;
        if let Err(error) = files::write(&folder, &record, false) {
            files::remove(&folder);
            return Err(error);
        }
        index.next += 1;
        index.going_on = Some(record.run.clone());
        // The start does not wait for the disk, but a record that never gets there would be an
        // empty file after a power cut: the keeper writes it again, and waits.
        index.runs.insert(record.number, Entry { record, bytes: 0, saved: false });
        Ok(folder.join(RECORDING))
    }

    /// A run that did not start leaves no folder; its identifier is remembered.
    pub(super) fn take_back(&self, run: &RunId) {
        lock(&self.index).going_on = None;
        if let Err(error) = self.delete(run) {
            log::warn!("{error}");
        }
    }

    /// A run that an earlier service began is still going on.
    pub(super) fn goes_on(&self, run: &RunId) {
        lock(&self.index).going_on = Some(run.clone());
    }

    /// A run is over: notes how it ended. A disk that does not take it is tried again by
    /// [`Store::save`].
    pub(super) fn end(
        &self,
        run: &RunId,
        end: Option<LastStop>,
        travelled_m: Option<f64>,
        points: Option<u64>,
    ) {
        let bytes = files::length(&self.recording(run));
        let mut index = lock(&self.index);
        if index.is_going_on(run) {
            index.going_on = None;
        }
        if let Some(entry) = index.find_mut(run) {
            entry.record = Record { end, travelled_m, points, ..entry.record.clone() };
            entry.bytes = bytes;
            entry.saved = false;
        }
        drop(index);
        self.save();
    }

    /// Writes what the disk did not take before.
    pub(super) fn save(&self) {
        let _one_at_a_time = lock(&self.saving);
        let unsaved: Vec<Record> = lock(&self.index)
            .runs
            .values()
            .filter(|entry| !entry.saved)
            .map(|entry| entry.record.clone())
            .collect();
        for record in unsaved {
            match files::write(&self.folder_of(&record.run), &record, true) {
                Ok(()) => {
                    let mut index = lock(&self.index);
                    // It may have changed again meanwhile.
                    if let Some(entry) =
                        index.find_mut(&record.run).filter(|entry| entry.record == record)
                    {
                        entry.saved = true;
                    }
                }
                Err(error) => log::debug!("{error}"),
            }
        }
    }

    /// The runs, newest first.
    pub(super) fn list(&self) -> Vec<RunInfo> {
        let index = lock(&self.index);
        let info = |entry: &Entry| {
            let is_going_on = index.is_going_on(&entry.record.run);
            let bytes = if is_going_on {
                files::length(&self.recording(&entry.record.run))
            } else {
                entry.bytes
            };
            entry.record.info(bytes, is_going_on)
        };
        index.runs.values().rev().map(info).collect()
    }

    /// Runs without an end that are not known to be in progress: an earlier service died over them.
    pub(super) fn open_ended(&self) -> Vec<Record> {
        let index = lock(&self.index);
        let records = index.over().map(|entry| &entry.record);
        records.filter(|record| record.end.is_none()).cloned().collect()
    }

    /// How the newest run ended, where it did.
    pub(super) fn last_end(&self) -> Option<LastStop> {
        lock(&self.index).runs.values().next_back().and_then(|entry| entry.record.end.clone())
    }

    /// A part of a recording, and what is known of the whole.
    ///
    /// # Errors
    ///
    /// [`StoreError::Unknown`], [`StoreError::BeyondEnd`], [`StoreError::Disk`].
    pub(super) fn fetch(&self, fetch: &Fetch) -> Result<(Fetched, Vec<u8>), StoreError> {
        let (complete, sha256) = {
            let index = lock(&self.index);
            let entry =
                index.find(&fetch.run).ok_or_else(|| StoreError::Unknown(fetch.run.clone()))?;
            (!index.is_going_on(&fetch.run), entry.record.sha256.clone())
        };
        let path = self.recording(&fetch.run);
        let failed = |source| StoreError::Disk { doing: "read", path: path.clone(), source };
        // A run that was refused, or has not come so far, has no recording.
        let file = if_there(File::open(&path)).map_err(failed)?;
        let read = file.map(|file| part(&file, fetch)).transpose().map_err(failed)?;
        let (total, bytes) = read.unwrap_or_default();
        if fetch.offset > total {
            return Err(StoreError::BeyondEnd { offset: fetch.offset, total });
        }
        let length = u32::try_from(bytes.len()).unwrap_or(MAX_FETCH_BYTES);
        let at_end = complete && fetch.offset + u64::from(length) == total;
        if complete && sha256.is_some() && sha256 == fetch.sha256 {
            self.change(&fetch.run, |record| record.fetched = true);
        }
        let sha256 = sha256.filter(|_| at_end);
        Ok((
            Fetched {
                run: fetch.run.clone(),
                offset: fetch.offset,
                length,
                total,
                complete,
                sha256,
            },
            bytes,
        ))
    }

    /// Deletes a run's files; its identifier is remembered.
    ///
    /// # Errors
    ///
    /// [`StoreError::Unknown`], [`StoreError::GoingOn`], [`StoreError::Disk`].
    pub(super) fn delete(&self, run: &RunId) -> Result<(), StoreError> {
        let mut index = lock(&self.index);
        if index.is_going_on(run) {
            return Err(StoreError::GoingOn(run.clone()));
        }
        let number = index.find(run).ok_or_else(|| StoreError::Unknown(run.clone()))?.record.number;
        if files::remember_deleted(&self.folder, run, number).is_err() {
            // On a full disk the recording first makes room for the line.
            let _ = std::fs::remove_file(self.recording(run));
            files::remember_deleted(&self.folder, run, number)?;
        }
        index.runs.remove(&number);
        index.deleted.insert(run.clone());
        drop(index);
        files::remove(&self.folder_of(run));
        Ok(())
    }

    /// Computes the hash of one run that is complete and has none, if there is one; true if there
    /// was.
    pub(super) fn hash_one(&self) -> bool {
        let unhashed = {
            let index = lock(&self.index);
            // The newest is what a client waits for.
            let newest = index.over().rev().find(|entry| entry.record.sha256.is_none());
            newest.map(|entry| entry.record.run.clone())
        };
        let Some(run) = unhashed else { return false };
        let hash = match sha256_hex_of(&self.recording(&run)) {
            Ok(hash) => hash,
            Err(error) if error.kind() == io::ErrorKind::NotFound => super::digest::sha256_hex(&[]),
            Err(error) => {
                log::warn!("cannot read the recording of run {run}: {error}");
                return false;
            }
        };
        self.change(&run, |record| record.sha256 = Some(hash));
        true
    }

    /// What the runs take.
    pub(super) fn disk(&self) -> Disk {
        Disk { used: self.used(), quota: self.quota, free: files::free(&self.folder) }
    }

    /// A run's folder.
    fn folder_of(&self, run: &RunId) -> PathBuf {
        self.folder.join(run.as_str())
    }

    /// A run's recording.
    pub(super) fn recording(&self, run: &RunId) -> PathBuf {
        self.folder_of(run).join(RECORDING)
    }

    fn change(&self, run: &RunId, change: impl FnOnce(&mut Record)) {
        let changed = {
            let mut index = lock(&self.index);
            let Some(entry) = index.find_mut(run) else { return };
            let before = entry.record.clone();
            change(&mut entry.record);
            entry.saved &= entry.record == before;
            !entry.saved
        };
        if changed {
            self.save();
        }
    }
}

impl Index {
    /// Looks through the folder. What is not ours is passed over; a deletion that was interrupted
    /// is finished where `may_write`.
    fn read(folder: &Path, may_write: bool) -> Self {
        let deleted = files::deleted(folder);
        let mut index = Self { next: 1, ..Self::default() };
        for (run, number) in deleted {
            index.next = index.next.max(number.saturating_add(1));
            index.deleted.insert(run);
        }
        for run in files::folders(folder) {
            let place = folder.join(run.as_str());
            if index.deleted.contains(&run) {
                if may_write {
                    files::remove(&place);
                }
                continue;
            }
            let record = match files::read(&place) {
                Ok(record) if record.run == run => record,
                Ok(_) => continue,
                Err(error) => {
                    log::warn!("{error}");
                    continue;
                }
            };
            index.next = index.next.max(record.number.saturating_add(1));
            let bytes = files::length(&place.join(RECORDING));
            index.runs.insert(record.number, Entry { record, bytes, saved: true });
        }
        index
    }

    fn is_going_on(&self, run: &RunId) -> bool {
        self.going_on.as_ref() == Some(run)
    }

    /// All but the run that is going on, oldest first.
    fn over(&self) -> impl DoubleEndedIterator<Item = &Entry> {
        self.runs.values().filter(|entry| !self.is_going_on(&entry.record.run))
    }

    fn find(&self, run: &RunId) -> Option<&Entry> {
        self.runs.values().rev().find(|entry| &entry.record.run == run)
    }

    fn find_mut(&mut self, run: &RunId) -> Option<&mut Entry> {
        self.runs.values_mut().rev().find(|entry| &entry.record.run == run)
    }
}

/// A file's length, and the bytes that are asked for as far as they are there.
fn part(file: &File, fetch: &Fetch) -> io::Result<(u64, Vec<u8>)> {
    let total = file.metadata()?.len();
    let wanted =
        u64::from(fetch.length.min(MAX_FETCH_BYTES)).min(total.saturating_sub(fetch.offset));
    let mut bytes = vec![0; usize::try_from(wanted).unwrap_or(0)];
    if !bytes.is_empty() {
        file.read_exact_at(&mut bytes, fetch.offset)?;
    }
    Ok((total, bytes))
}

#[cfg(test)]
mod tests;
