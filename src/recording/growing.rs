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

use super::topic::Topic;
use super::walk::{Found, Rest, Walk};
use super::{message, points, run};
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
    pub(super) fn take_all(&mut self, part: &[u8], found: &mut dyn FnMut(Found<'_>)) -> bool {
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

fn piece(topic: Topic, data: &[u8]) -> Option<Piece> {
    match topic {
        Topic::Pose => run::pose(message::decode(data)?).map(|recorded| Piece::Pose(recorded.pose)),
        Topic::Points => points::points(&message::decode(data)?).map(Piece::Points),
        _ => None,
    }
}
