//! A run's recording, brought home piece by piece: several pieces are under way at a time, and what breaks is gone on from.

use std::collections::VecDeque;
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use super::line::{Answered, Line, Waited};
use super::{ClientError, Kind};
use crate::clock::{Clock as _, MILLISECOND_NS, MonotonicClock};
use crate::service::protocol::{Fetch, Fetched, Request, RunId};

/// How long a piece is, bytes, and how many are under way at a time: together what a WiFi with a delay of 100 ms carries at 20 Mbit/s.
const PIECE_BYTES: u32 = 64 << 10;
const UNDER_WAY: usize = 6;

/// How often a recording that is still being written is asked for more, and how often the watcher is told, nanoseconds.
const GROWING_NS: i64 = 400 * MILLISECOND_NS;
const TOLD_NS: i64 = 500 * MILLISECOND_NS;

/// A piece that has not come after this long is asked for anew, nanoseconds.
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
    let mut name = file.as_os_str().to_owned();
    name.push(".part");
    PathBuf::from(name)
}

/// Fetches a run into a file.
pub(super) fn fetch(
    line: &mut Line,
    run: &RunId,
    file: &Path,
    watch: &mut dyn FnMut(&FetchProgress),
) -> Result<FetchProgress, ClientError> {
    let mut had_to_start_over = false;
    loop {
        let part = Part::open(file)?;
        let mut fetching = Fetching::new(line, run, part);
        let ended = fetching.run_to_end(watch)?;
        let Fetching { part, progress, .. } = fetching;
        match ended {
            End::Whole => {
                part.keep(file)?;
                return Ok(progress);
            }
            // What lay there is of another recording, or was never synced before the brick lost its power.
            End::Other if !had_to_start_over => {
                log::warn!(
                    "{}: what was there already is not of this run; fetching all of it anew",
                    file.display()
                );
                had_to_start_over = true;
                part.start_over()?;
            }
            End::Other => {
                let message =
                    "the recording that came does not have the hash that was named for it".to_owned();
                return Err(ClientError::NotUnderstood { address: line.address().to_owned(), message });
            }
        }
    }
}

/// How a fetch came to its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    /// Everything is there, and its hash is the brick's.
    Whole,
    /// What is there is something else.
    Other,
}

/// One fetch under way.
struct Fetching<'l> {
    line: &'l mut Line,
    run: &'l RunId,
    part: Part,
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
    fn new(line: &'l mut Line, run: &'l RunId, part: Part) -> Self {
        line.begin();
        let now_ns = line.now_ns();
        let bytes = part.length;
        Self {
            line,
            run,
            part,
            progress: FetchProgress { bytes, total: bytes, complete: false },
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
                let is_it = self.part.sha256() == *named;
                return Ok(if is_it { End::Whole } else { End::Other });
            }
            self.ask_for_more()?;
            let until_ns =
                if self.under_way.is_empty() { self.ask_at_ns } else { self.line.now_ns() + PIECE_NS };
            if self.under_way.is_empty() {
                // There is nothing to wait for but time.
                self.nap(until_ns)?;
                continue;
            }
            match self.line.receive(until_ns)? {
                Waited::Reply(id, answer) => {
                    if self.take(id, answer)? == Some(End::Other) {
                        return Ok(End::Other);
                    }
                }
                Waited::Broken => self.again(),
                Waited::Nothing => {
                    self.line.hang_up();
                    self.again();
                }
            }
            if self.line.now_ns() >= self.told_at_ns {
                self.told_at_ns = self.line.now_ns() + TOLD_NS;
                watch(&self.progress);
            }
        }
    }

    /// Keeps as many pieces under way as there may be.
    fn ask_for_more(&mut self) -> Result<(), ClientError> {
        while self.under_way.len() < UNDER_WAY {
            let left = self.progress.total.saturating_sub(self.next);
            let is_looking = left == 0;
            // At the end of what is known one piece at a time looks whether there is more.
            if is_looking && (!self.under_way.is_empty() || self.line.now_ns() < self.ask_at_ns) {
                return Ok(());
            }
            let piece = u32::try_from(left).unwrap_or(PIECE_BYTES).min(PIECE_BYTES);
            let length = if is_looking { PIECE_BYTES } else { piece };
            let request = Request::Fetch(Fetch { run: self.run.clone(), offset: self.next, length });
            let id = self.line.number();
            if !self.line.send(id, &request)? {
                self.again();
                continue;
            }
            self.under_way.push_back((id, self.next));
            if is_looking {
                self.ask_at_ns = self.line.now_ns() + GROWING_NS;
                return Ok(());
            }
            self.next += u64::from(length);
        }
        Ok(())
    }

    /// What was under way is asked for anew.
    fn again(&mut self) {
        self.under_way.clear();
        self.next = self.part.length;
        self.ask_at_ns = self.line.now_ns();
    }

    fn take(&mut self, id: u64, answer: Answered) -> Result<Option<End>, ClientError> {
        let Some((_, offset)) = self.under_way.front().copied().filter(|(first, _)| *first == id) else {
            // Of a connection before this one, or out of turn: then the rest is asked for anew.
            if self.under_way.iter().any(|(waited, _)| *waited == id) {
                self.again();
            }
            return Ok(None);
        };
        self.under_way.pop_front();
        let (value, bytes) = match answer {
            Ok(answer) => answer,
            Err(ClientError::Refused(refusal)) if refusal.kind == Kind::BeyondEnd && self.part.length > 0 => {
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
            return Err(ClientError::NotUnderstood { address: self.line.address().to_owned(), message });
        }
        self.part.append(&bytes)?;
        self.progress =
            FetchProgress { bytes: self.part.length, total: fetched.total, complete: fetched.complete };
        self.sha256 = fetched.sha256.or(self.sha256.take());
        if self.progress.bytes > self.progress.total {
            return Ok(Some(End::Other));
        }
        if self.under_way.is_empty() {
            // A piece may have been shorter than it was asked for.
            self.next = self.part.length;
        }
        if !bytes.is_empty() && self.next == self.part.length {
            self.ask_at_ns = self.line.now_ns();
        }
        Ok(None)
    }

    fn nap(&mut self, until_ns: i64) -> Result<(), ClientError> {
        MonotonicClock.sleep_until_ns(until_ns.min(self.line.now_ns() + 100 * MILLISECOND_NS));
        self.line.check_patience()
    }
}

/// What has come so far.
struct Part {
    path: PathBuf,
    file: File,
    hash: Sha256,
    length: u64,
}

impl Part {
    /// Opens what earlier calls have left, or begins; what is there is read once for its hash.
    fn open(file: &Path) -> Result<Self, ClientError> {
        let path = part_of(file);
        let opened = OpenOptions::new().read(true).append(true).create(true).open(&path);
        let mut part = match opened {
            Ok(file) => Self { path, file, hash: Sha256::new(), length: 0 },
            Err(source) => return Err(ClientError::File { path, source }),
        };
        part.read_all().map_err(|source| part.failed(source))?;
        Ok(part)
    }

    fn read_all(&mut self) -> io::Result<()> {
        let mut piece = vec![0; 64 << 10];
        loop {
            let read = match self.file.read(&mut piece) {
                Ok(0) => return Ok(()),
                Ok(read) => read,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(error),
            };
            self.hash.update(piece.get(..read).unwrap_or_default());
            self.length += u64::try_from(read).unwrap_or(0);
        }
    }

    fn append(&mut self, bytes: &[u8]) -> Result<(), ClientError> {
        self.file.write_all(bytes).map_err(|source| self.failed(source))?;
        self.hash.update(bytes);
        self.length += u64::try_from(bytes.len()).unwrap_or(0);
        Ok(())
    }

    fn sha256(&self) -> String {
        self.hash.clone().finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// Everything is there: the file gets its name once its bytes are on the disk.
    fn keep(self, file: &Path) -> Result<(), ClientError> {
        let kept = self.file.sync_all().and_then(|()| std::fs::rename(&self.path, file));
        kept.map_err(|source| ClientError::File { path: file.to_owned(), source })
    }

    fn start_over(mut self) -> Result<(), ClientError> {
        let emptied = self.file.set_len(0).and_then(|()| self.file.rewind());
        emptied.map_err(|source| self.failed(source))
    }

    fn failed(&self, source: io::Error) -> ClientError {
        ClientError::File { path: self.path.clone(), source }
    }
}
