//! A run's recording, brought home piece by piece: several pieces are under way at a time, and what
//! breaks is gone on from.

use std::collections::VecDeque;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use super::session::{Answered, Session};
use super::{ClientError, Kind};
use crate::clock::{Clock as _, MILLISECOND_NS, MonotonicClock};
use crate::document::save::beside;
use crate::protocol::{Fetch, Fetched, MAX_FETCH_BYTES, Request, RunId};
use crate::service::digest::sha256_hex_of;

/// How long a piece is, bytes, and how many are under way at a time: together what a WiFi with a
/// delay of 100 ms carries at 20 Mbit/s.
const PIECE_BYTES: u32 = MAX_FETCH_BYTES;
const UNDER_WAY: usize = 6;

/// How often a recording that is still being written is asked for more, and how often the watcher
/// is told, nanoseconds.
const GROWING_NS: i64 = 400 * MILLISECOND_NS;
const TOLD_NS: i64 = 500 * MILLISECOND_NS;

/// A piece that has not come after this long is requested again, nanoseconds.
const PIECE_NS: i64 = 5000 * MILLISECOND_NS;

/// How far a fetch is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FetchProgress {
    /// Bytes that have come, with those of earlier calls.
    pub bytes: u64,
    /// Bytes that the recording has by now.
    pub total: u64,
    /// It does not grow any more.
    pub complete: bool,
    /// It was there already, with the brick's hash, and nothing had to come.
    pub was_there: bool,
}

impl FetchProgress {
    /// Everything has come.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.complete && self.bytes == self.total
    }
}

/// The file that a recording lies in until it is whole, beside the one that it will be.
#[must_use]
pub fn part_of(file: &Path) -> PathBuf {
    beside(file, "part")
}

/// What of a recording has come: the whole file, or that of [`part_of`].
#[must_use]
pub fn file_so_far(file: &Path) -> PathBuf {
    if file.exists() { file.to_owned() } else { part_of(file) }
}

/// Fetches a run into a file, or compares the file that is there.
pub(super) fn fetch(
    line: &mut Session,
    run: &RunId,
    file: &Path,
    most: u64,
    watch: &mut dyn FnMut(&FetchProgress),
) -> Result<FetchProgress, ClientError> {
    if file.exists() {
        return compare(line, run, file);
    }
    let mut part = PartFile::open(file)?;
    if file.exists() {
        // Another fetch, which had the lock before, has brought it home meanwhile.
        part.discard_if_empty();
        return compare(line, run, file);
    }
    let mut had_to_start_over = false;
    loop {
        let mut fetching = Fetching::new(line, run, part, most);
        let ended = fetching.run_to_end(watch);
        let ended = ended.inspect_err(|_| fetching.part.discard_if_empty())?;
        let progress = fetching.progress;
        part = fetching.part;
        match ended {
            End::Whole(sha256) => {
                part.keep(file)?;
                tell(line, run, progress.bytes, sha256);
                return Ok(progress);
            }
            // What lay there is of another recording, or was never synced before the brick lost its
            // power.
            End::Other if !had_to_start_over => {
                log::warn!(
                    "{}: what was there already is not of this run; fetching all of it again",
                    file.display()
                );
                had_to_start_over = true;
                part.start_over()?;
            }
            End::Other => {
                let message =
                    "the recording that came does not have the hash that was named for it";
                return Err(line.not_understood(message.to_owned()));
            }
        }
    }
}

/// Says whether the file that is there is the brick's recording: by its hash, because names are
/// chosen freely.
fn compare(line: &mut Session, run: &RunId, file: &Path) -> Result<FetchProgress, ClientError> {
    let failed = |source| ClientError::File { path: file.to_owned(), source };
    let bytes = std::fs::metadata(file).map_err(failed)?.len();
    let sha256 = sha256_hex_of(file).map_err(failed)?;
    let other = || ClientError::OtherRecording { path: file.to_owned() };
    loop {
        // It may lie here whole although the brick was never told.
        let fetch = Fetch { sha256: Some(sha256.clone()), ..Fetch::part(run, bytes, 0) };
        let fetched: Fetched = match line.ask(&Request::Fetch(fetch)) {
            Err(ClientError::Refused(refusal)) if refusal.kind == Kind::BeyondEnd => {
                return Err(other());
            }
            answered => answered?,
        };
        match fetched.sha256 {
            Some(named) if named == sha256 => {
                return Ok(FetchProgress { bytes, total: bytes, complete: true, was_there: true });
            }
            // Only what is whole has this name; and the hash comes with the end alone.
            Some(_) => return Err(other()),
            None if fetched.total != bytes || !fetched.complete => return Err(other()),
            // The brick computes it.
            None => nap(line, MonotonicClock.now_ns() + GROWING_NS)?,
        }
    }
}

/// Tells the brick that all of a run is here, so that it may delete that run first. Without the
/// brick's answer the recording is still complete.
fn tell(line: &mut Session, run: &RunId, bytes: u64, sha256: String) {
    let whole = Fetch { sha256: Some(sha256), ..Fetch::part(run, bytes, 0) };
    if let Err(error) = line.ask::<serde_json::Value>(&Request::Fetch(whole)) {
        log::warn!("{run} is here, and the brick could not be told: {error}");
    }
}

fn nap(line: &mut Session, until_ns: i64) -> Result<(), ClientError> {
    MonotonicClock.sleep_until_ns(until_ns.min(MonotonicClock.now_ns() + 100 * MILLISECOND_NS));
    line.check_patience()
}

/// How a fetch came to its end.
#[derive(Debug, Clone, PartialEq, Eq)]
enum End {
    /// Everything is on the disk, and this is its hash, and the brick's.
    Whole(String),
    /// What is there is something else.
    Other,
}

/// One fetch under way.
struct Fetching<'l> {
    line: &'l mut Session,
    run: &'l RunId,
    part: PartFile,
    most: u64,
    progress: FetchProgress,
    sha256: Option<String>,
    /// What is asked for and has not come: the request's number, and where its piece begins.
    under_way: VecDeque<(u64, u64)>,
    /// Where the next piece begins.
    next: u64,
    /// When a recording that grows is asked again.
    ask_at_ns: i64,
    told_at_ns: i64,
}

impl<'l> Fetching<'l> {
    fn new(line: &'l mut Session, run: &'l RunId, part: PartFile, most: u64) -> Self {
        line.begin();
        let now_ns = MonotonicClock.now_ns();
        let bytes = part.length;
        Self {
            line,
            run,
            part,
            most,
            progress: FetchProgress { bytes, total: bytes, complete: false, was_there: false },
            sha256: None,
            under_way: VecDeque::new(),
            next: bytes,
            ask_at_ns: now_ns,
            told_at_ns: now_ns,
        }
    }

    fn run_to_end(&mut self, watch: &mut dyn FnMut(&FetchProgress)) -> Result<End, ClientError> {
        loop {
            if self.progress.is_whole()
                && let Some(named) = &self.sha256
            {
                watch(&self.progress);
                let sha256 = self.part.sha256_on_the_disk()?;
                return Ok(if sha256 == *named { End::Whole(sha256) } else { End::Other });
            }
            self.ask_for_more()?;
            if self.under_way.is_empty() {
                // There is nothing to wait for but time.
                nap(self.line, self.ask_at_ns)?;
                continue;
            }
            match self.line.receive(MonotonicClock.now_ns() + PIECE_NS)? {
                Some((id, answer)) => {
                    if self.take(id, answer)? == Some(End::Other) {
                        return Ok(End::Other);
                    }
                }
                None => self.again(),
            }
            if MonotonicClock.now_ns() >= self.told_at_ns {
                self.told_at_ns = MonotonicClock.now_ns() + TOLD_NS;
                watch(&self.progress);
            }
        }
    }

    /// Keeps as many pieces under way as there may be.
    fn ask_for_more(&mut self) -> Result<(), ClientError> {
        while self.under_way.len() < UNDER_WAY {
            let left = self.progress.total.saturating_sub(self.next);
            let is_looking = left == 0;
            // At the end of what is known one piece at a time checks whether there is more.
            if is_looking
                && (!self.under_way.is_empty() || MonotonicClock.now_ns() < self.ask_at_ns)
            {
                return Ok(());
            }
            let piece = u32::try_from(left).unwrap_or(PIECE_BYTES).min(PIECE_BYTES);
            let length = if is_looking { PIECE_BYTES } else { piece };
            let request = Request::Fetch(Fetch::part(self.run, self.next, length));
            let id = self.line.number();
            if !self.line.send(id, &request)? {
                self.again();
                continue;
            }
            self.under_way.push_back((id, self.next));
            if is_looking {
                self.ask_at_ns = MonotonicClock.now_ns() + GROWING_NS;
                return Ok(());
            }
            self.next += u64::from(length);
        }
        Ok(())
    }

    /// Requests the pending pieces again.
    fn again(&mut self) {
        self.under_way.clear();
        self.next = self.part.length;
        self.ask_at_ns = MonotonicClock.now_ns();
    }

    fn take(&mut self, id: u64, answer: Answered) -> Result<Option<End>, ClientError> {
        let Some((_, offset)) = self.under_way.front().copied().filter(|(first, _)| *first == id)
        else {
            // From an earlier connection, or out of order: request the rest again.
            if self.under_way.iter().any(|(waited, _)| *waited == id) {
                self.again();
            }
            return Ok(None);
        };
        self.under_way.pop_front();
        let (value, bytes) = match answer {
            Ok(answer) => answer,
            Err(ClientError::Refused(refusal))
                if refusal.kind == Kind::BeyondEnd && self.part.length > 0 =>
            {
                return Ok(Some(End::Other));
            }
            Err(ClientError::Refused(refusal)) if refusal.kind == Kind::TooMany => {
                self.again();
                return Ok(None);
            }
            Err(error) => return Err(error),
        };
        let fetched: Fetched = self.line.understood(value)?;
        let bytes = bytes.unwrap_or_default();
        let is_right = fetched.offset == offset
            && offset == self.part.length
            && usize::try_from(fetched.length).is_ok_and(|length| length == bytes.len());
        if !is_right {
            let message = format!("a piece at {} that was not asked for", fetched.offset);
            return Err(self.line.not_understood(message));
        }
        // A recording that never ends would fill this machine's disk.
        let has_by_now =
            self.part.length.saturating_add(u64::from(fetched.length)).max(fetched.total);
        if has_by_now > self.most {
            return Err(ClientError::TooLong { bytes: has_by_now, most: self.most });
        }
        self.part.append(&bytes)?;
        self.progress = FetchProgress {
            bytes: self.part.length,
            total: fetched.total,
            complete: fetched.complete,
            was_there: false,
        };
        self.sha256 = fetched.sha256.or(self.sha256.take());
        if self.progress.bytes > self.progress.total {
            return Ok(Some(End::Other));
        }
        if self.under_way.is_empty() {
            // A piece may have been shorter than it was asked for.
            self.next = self.part.length;
        }
        if !bytes.is_empty() && self.next == self.part.length {
            self.ask_at_ns = MonotonicClock.now_ns();
        }
        Ok(None)
    }
}

/// What has come so far, in a file that one fetch alone writes: another one finds it locked.
struct PartFile {
    path: PathBuf,
    file: File,
    length: u64,
}

impl PartFile {
    /// Opens what earlier calls have left, or begins.
    fn open(file: &Path) -> Result<Self, ClientError> {
        let path = part_of(file);
        let failed = |source| ClientError::File { path: path.clone(), source };
        loop {
            let part = OpenOptions::new()
                .read(true)
                .append(true)
                .create(true)
                // A link would have the file that it names overwritten.
                .custom_flags(nix::libc::O_NOFOLLOW)
                .open(&path)
                .map_err(failed)?;
            match part.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Err(ClientError::Taken { path }),
                Err(TryLockError::Error(source)) => return Err(failed(source)),
            }
            let opened = part.metadata().map_err(failed)?;
            // Between opening and locking, the fetch that had the lock may have given the file its
            // final name.
            let is_still_there = std::fs::metadata(&path)
                .is_ok_and(|there| (there.dev(), there.ino()) == (opened.dev(), opened.ino()));
            if is_still_there && (!opened.is_file() || opened.nlink() > 1) {
                return Err(failed(io::Error::other("it is no file, or has another name, too")));
            }
            if is_still_there {
                return Ok(Self { length: opened.len(), path, file: part });
            }
        }
    }

    fn append(&mut self, bytes: &[u8]) -> Result<(), ClientError> {
        self.file.write_all(bytes).map_err(|source| self.failed(source))?;
        self.length += u64::try_from(bytes.len()).unwrap_or(0);
        Ok(())
    }

    /// The hash of the file, read from its beginning once all of it is on the disk.
    fn sha256_on_the_disk(&self) -> Result<String, ClientError> {
        let hash = self.file.sync_all().and_then(|()| sha256_hex_of(&self.path));
        hash.map_err(|source| self.failed(source))
    }

    /// Everything is there and on the disk: the file gets its name, while its lock is held.
    fn keep(&self, file: &Path) -> Result<(), ClientError> {
        let kept = std::fs::rename(&self.path, file);
        kept.map_err(|source| ClientError::File { path: file.to_owned(), source })
    }

    fn start_over(&mut self) -> Result<(), ClientError> {
        self.file.set_len(0).map_err(|source| self.failed(source))?;
        self.length = 0;
        Ok(())
    }

    /// Nothing has come, so there is nothing to go on from.
    fn discard_if_empty(&self) {
        // A write that failed may have put bytes there that `length` does not count.
        if self.file.metadata().is_ok_and(|file| file.len() == 0) {
            let _ = std::fs::remove_file(&self.path);
        }
    }

    fn failed(&self, source: io::Error) -> ClientError {
        ClientError::File { path: self.path.clone(), source }
    }
}
