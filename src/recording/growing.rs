//! The path and the points of a recording that comes part by part, while it is still being written
//! or from a brick far away.
//!
//! Bytes are put in as they come, in order; what is in a whole chunk comes out, and its bytes are
//! forgotten. So a map can be followed with a few hundred kilobytes of memory, however long the run
//! is.
//!
//! # Not here
//!
//! Where the bytes come from, and what is drawn of them. Senses, checkpoints and all else that a
//! replay needs: [`super::Run`] reads those.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;

use super::run::RecordedPose;
use super::topic::Topic;
use super::walk::{Found, Rest, Walk};
use super::{message, points};
use crate::mapping::{MapPoint, Pose};

/// A chunk is a second of the run, some 30 kB, and never much longer than 256 kB; a record that
/// does not end within this many bytes is damaged.
const LONGEST_RECORD: usize = 1 << 20;

/// What a map is drawn from.
#[derive(Debug, Clone, PartialEq)]
pub enum Piece {
    /// Where the robot was at a tick.
    Pose(Pose),
    /// Points of the map.
    Points(Vec<MapPoint>),
}

/// A recording as far as it has come.
#[derive(Debug, Clone, Default)]
pub struct Growing {
    /// Where `rest` begins in the file.
    base: u64,
    rest: Vec<u8>,
    walk: Walk,
}

impl Growing {
    /// From which byte of the file on the next part is wanted.
    #[must_use]
    pub fn wanted(&self) -> u64 {
        self.base + self.rest.len() as u64
    }

    /// Takes the part that begins at [`Growing::wanted`] and hands on what it completes.
    ///
    /// False where nothing more can be made of the file: a record in it is too long to be one.
    pub fn take(&mut self, part: &[u8], found: &mut dyn FnMut(Piece)) -> bool {
        self.take_all(part, &mut |thing| {
            if let Found::Message { topic: Some(topic), data, .. } = thing
                && let Some(piece) = piece(topic, data)
            {
                found(piece);
            }
        })
    }

    /// The same with everything that is in it.
    fn take_all(&mut self, part: &[u8], found: &mut dyn FnMut(Found<'_>)) -> bool {
        self.rest.extend_from_slice(part);
        let done = match self.walk.over(&self.rest, found) {
            (done, Rest::Short(_) | Rest::Damaged) => done,
            (_, Rest::Ended) => self.rest.len(),
        };
        self.rest.drain(..done);
        self.base += done as u64;
        self.rest.len() <= LONGEST_RECORD
    }
}

/// How much is read at a time, bytes: some seconds of a run. A long one is caught up with bit by
/// bit, which leaves the brick's processor to what drives.
const AT_A_TIME: u64 = 256 << 10;

/// A recording that another process writes. It lags behind the run by a sync, a second as a rule.
#[derive(Debug)]
pub(super) struct GrowingFile {
    file: File,
    growing: Growing,
    is_damaged: bool,
}

impl GrowingFile {
    /// Begins at the file's beginning; nothing is read yet.
    pub(super) fn open(recording: &Path) -> io::Result<Self> {
        let file = File::open(recording)?;
        Ok(Self { file, growing: Growing::default(), is_damaged: false })
    }

    /// Nothing has come yet.
    pub(super) fn is_unread(&self) -> bool {
        self.growing.wanted() == 0
    }

    /// Reads on; false where nothing more has come, or can be made of the file. What is damaged is
    /// the matter of who reads the file when it is whole.
    pub(super) fn look(&mut self, found: &mut dyn FnMut(Found<'_>)) -> io::Result<bool> {
        if self.is_damaged {
            return Ok(false);
        }
        let wanted = self.growing.wanted();
        let there = self.file.metadata()?.len().saturating_sub(wanted).min(AT_A_TIME);
        let mut part = vec![0; usize::try_from(there).unwrap_or(0)];
        let read = self.file.read_at(&mut part, wanted)?;
        part.truncate(read);
        self.is_damaged = !self.growing.take_all(&part, found);
        Ok(read > 0)
    }
}

fn piece(topic: Topic, data: &[u8]) -> Option<Piece> {
    match topic {
        Topic::Pose => message::decode::<RecordedPose>(data).map(|at| Piece::Pose(at.pose)),
        Topic::Points => points::points(&message::decode(data)?).map(Piece::Points),
        _ => None,
    }
}
