//! Finding what is whole in a recording's bytes, however they were cut or damaged.
//!
//! From the start of a stretch the records are followed to the next sync. Where that leads nowhere, or to a sync whose
//! checksums do not hold, every place that looks like a sync is tried until one holds for a stretch behind the last good one:
//! the records between are lost, those behind are not. What follows the last sync that holds is walked record by record and
//! comes marked as not checked.
//!
//! # Not here
//!
//! No meaning of messages: that is `run`'s.
//!
//! # What we count on
//!
//! - Nobody can put a sync into a recording from within: a sync's first byte, 0x80, never begins a character of UTF-8, and all
//!   that comes from people (files, names, log lines) is UTF-8.

use std::borrow::Cow;
use std::ops::Range;

use mcap::records::{MessageHeader, Record, op};
use memchr::memmem;
use serde::Serialize;

use super::file::{SYNC_BODY, SYNC_MAGIC, SYNC_OPCODE, SyncBody};
use super::record::{self, FRAME_BYTES, Frame, frame};
use super::topic::{Topic, table_checksum};

/// Something that a recording holds.
#[derive(Debug)]
pub enum Found<'a> {
    /// A message; `topic` is `None` where the channel is not one of ours.
    Message {
        /// The channel.
        topic: Option<Topic>,
        /// Times and sequence number.
        header: MessageHeader,
        /// The message as encoded.
        data: &'a [u8],
    },
    /// A file as it was read.
    Attachment {
        /// Its name.
        name: String,
        /// Its type.
        media_type: String,
        /// Its bytes.
        data: &'a [u8],
    },
    /// A record of names and values.
    Metadata(mcap::records::Metadata),
}

/// Where the bytes that a [`Found`] came from stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Context {
    /// True where a checksum held.
    pub checked: bool,
    /// Wall clock minus run clock as the sync says it.
    pub wall_offset_ns: Option<i64>,
}

/// How much of a file was whole.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct Integrity {
    /// The file's length in bytes.
    pub bytes: u64,
    /// Bytes in stretches whose checksum held.
    pub checked_bytes: u64,
    /// Messages in them.
    pub checked_messages: u64,
    /// Messages behind the last sync, whole but not checked.
    pub unchecked_messages: u64,
    /// Byte ranges whose checksum did not hold; nothing in them was used.
    pub damaged: Vec<Range<u64>>,
    /// Bytes at the end of which nothing could be made: a record that was cut.
    pub cut_bytes: u64,
    /// True where the file has MCAP's own end: the recorder finished it.
    pub complete: bool,
}

/// Walks through everything that is whole, in the order of the file; what follows the last sync only if `unchecked_too`.
pub fn walk<'a>(
    bytes: &'a [u8],
    unchecked_too: bool,
    found: &mut dyn FnMut(Context, Found<'a>),
) -> Integrity {
    let mut walk = Walk {
        bytes,
        channels: Channels::default(),
        integrity: Integrity {
            bytes: bytes.len() as u64,
            complete: is_complete(bytes),
            ..Integrity::default()
        },
        found,
    };
    let mut start = 0;
    while let Some(stretch) = next_stretch(bytes, start) {
        if stretch.range.start > start {
            walk.integrity.damaged.push(start as u64..stretch.range.start as u64);
        }
        if stretch.holds {
            walk.checked(&stretch);
        } else {
            walk.integrity.damaged.push(stretch.range.start as u64..stretch.range.end as u64);
        }
        start = stretch.next;
    }
    walk.rest(start, unchecked_too);
    walk.integrity
}

/// Walks through the whole stretches of a part of a file that is still coming: `part` begins at byte `base` of the file, where a stretch
/// begins. Returns how many bytes of it are done with; the next part begins behind them.
///
/// A stretch whose checksum does not hold is passed over.
pub fn walk_part<'a>(part: &'a [u8], base: u64, found: &mut dyn FnMut(Context, Found<'a>)) -> usize {
    let mut walk =
        Walk { bytes: part, channels: Channels::default(), integrity: Integrity::default(), found };
    let first = if base == 0 { mcap::MAGIC.len() } else { 0 };
    let mut done = 0;
    while let Some(at) = next_sync(part, done.max(first)) {
        let Some(record) = frame(part, at) else { break };
        if let Some(sync) = SyncBody::of_bytes(record.body)
            && sync.stretch.start == base + done as u64
            && sync.stretch.length == (at - done) as u64
            && part.get(done..at).is_some_and(|bytes| crc32fast::hash(bytes) == sync.stretch.crc)
        {
            walk.stretch(done.max(first)..at, &sync);
        }
        done = record.next;
    }
    done
}

/// A stretch that a sync closes.
struct Closed {
    range: Range<usize>,
    sync: SyncBody,
    /// Whether its bytes are those that the sync was made for.
    holds: bool,
    /// Where the next stretch begins.
    next: usize,
}

/// The next stretch at `start` or behind it whose checksum holds; else the next that is known to be damaged, so that it is not
/// taken for one that was never closed.
fn next_stretch(bytes: &[u8], start: usize) -> Option<Closed> {
    if let Some(at) = follow(bytes, start)
        && let Some(closed) = closed(bytes, start, at)
        && closed.range.start == start
        && closed.holds
    {
        return Some(closed);
    }
    let mut damaged = None;
    let mut at = start;
    while let Some(ahead) = bytes.get(at..).and_then(|rest| memmem::find(rest, &SYNC_START)) {
        at += ahead;
        match closed(bytes, start, at) {
            Some(closed) if closed.holds => return Some(closed),
            other => damaged = damaged.or(other),
        }
        at += 1;
    }
    damaged
}

/// Follows the records from the start of a stretch to the place of its sync.
fn follow(bytes: &[u8], start: usize) -> Option<usize> {
    next_sync(bytes, if start == 0 { mcap::MAGIC.len() } else { start })
}

/// Follows the records from one of them to the next sync.
fn next_sync(bytes: &[u8], mut at: usize) -> Option<usize> {
    loop {
        let record = frame(bytes, at)?;
        if record.opcode == SYNC_OPCODE && record.body.starts_with(&SYNC_MAGIC) {
            return Some(at);
        }
        at = record.next;
    }
}

/// The stretch that a sync at a place closes, if there is a sync and it can be believed.
fn closed(bytes: &[u8], from: usize, at: usize) -> Option<Closed> {
    let record = frame(bytes, at).filter(|record| record.opcode == SYNC_OPCODE)?;
    let sync = SyncBody::of_bytes(record.body)?;
    let start = usize::try_from(sync.stretch.start).ok()?;
    let length = usize::try_from(sync.stretch.length).ok()?;
    if start < from || start.checked_add(length)? != at {
        return None;
    }
    let range = start..at;
    let holds = crc32fast::hash(bytes.get(range.clone())?) == sync.stretch.crc;
    Some(Closed { range, sync, holds, next: record.next })
}

/// How a sync record begins: opcode, length, magic.
const SYNC_START: [u8; FRAME_BYTES + SYNC_MAGIC.len()] = {
    let mut start = [0; FRAME_BYTES + SYNC_MAGIC.len()];
    start[0] = SYNC_OPCODE;
    assert!(SYNC_BODY < 256, "the length fits its first byte");
    start[1] = SYNC_BODY.to_le_bytes()[0];
    let mut place = 0;
    while place < SYNC_MAGIC.len() {
        start[FRAME_BYTES + place] = SYNC_MAGIC[place];
        place += 1;
    }
    start
};

/// The channels that a file describes.
#[derive(Default)]
struct Channels(std::collections::BTreeMap<u16, Topic>);

impl Channels {
    fn describe(&mut self, channel: &record::Channel<'_>) {
        match Topic::of_name(channel.topic) {
            Some(topic) if channel.message_encoding == "cdr" => self.0.insert(channel.id, topic),
            _ => self.0.remove(&channel.id),
        };
    }

    /// A file of this very table needs no description: it may have been in a damaged stretch.
    fn assume_ours(&mut self) {
        self.0 = Topic::ALL.into_iter().map(|topic| (topic as u16, topic)).collect();
    }
}

struct Walk<'a, 'f> {
    bytes: &'a [u8],
    channels: Channels,
    integrity: Integrity,
    found: &'f mut dyn FnMut(Context, Found<'a>),
}

impl<'a> Walk<'a, '_> {
    fn checked(&mut self, stretch: &Closed) {
        let first = if stretch.range.start == 0 { mcap::MAGIC.len() } else { stretch.range.start };
        self.stretch(first..stretch.range.end, &stretch.sync);
        self.integrity.checked_bytes += stretch.range.len() as u64;
    }

    /// The records of a stretch that holds.
    fn stretch(&mut self, records: Range<usize>, sync: &SyncBody) {
        if self.channels.0.is_empty() && sync.table == table_checksum() {
            self.channels.assume_ours();
        }
        let context = Context { checked: true, wall_offset_ns: Some(sync.wall_offset_ns) };
        let whole = self.bytes.get(..records.end).unwrap_or_default();
        let mut at = records.start;
        while let Some(record) = frame(whole, at) {
            self.integrity.checked_messages += u64::from(self.record(context, &record));
            at = record.next;
        }
    }

    /// Everything behind the last sync that holds, up to MCAP's own end.
    fn rest(&mut self, start: usize, hand_on: bool) {
        let mut at = if start == 0 { mcap::MAGIC.len() } else { start };
        let context = Context { checked: false, wall_offset_ns: None };
        while let Some(record) = frame(self.bytes, at) {
            if record.opcode == op::DATA_END {
                return;
            }
            // A sync that cannot be believed: what comes next is anybody's guess, so nothing more is taken.
            if record.opcode == SYNC_OPCODE {
                self.integrity.damaged.push(at as u64..self.bytes.len() as u64);
                return;
            }
            if hand_on {
                self.integrity.unchecked_messages += u64::from(self.record(context, &record));
            }
            at = record.next;
        }
        self.integrity.cut_bytes = self.bytes.len().saturating_sub(at) as u64;
    }

    /// Hands on a record; true where it is a message.
    fn record(&mut self, context: Context, record: &Frame<'a>) -> bool {
        match record.opcode {
            op::ATTACHMENT => {
                if let Some((name, media_type, data)) = record::attachment(record.body) {
                    (self.found)(context, Found::Attachment { name, media_type, data });
                }
            }
            op::CHANNEL => {
                if let Some(channel) = record::channel(record.body) {
                    self.channels.describe(&channel);
                }
            }
            op::METADATA => {
                if let Some(metadata) = record::metadata(record.body) {
                    (self.found)(context, Found::Metadata(metadata));
                }
            }
            op::MESSAGE => {
                // Numbers alone, so the crate makes no room for anything.
                let message = mcap::parse_record(record.opcode, record.body);
                if let Ok(Record::Message { header, data: Cow::Borrowed(data) }) = message {
                    let topic = self.channels.0.get(&header.channel_id).copied();
                    (self.found)(context, Found::Message { topic, header, data });
                    return true;
                }
            }
            _ => {}
        }
        false
    }
}

/// True where the bytes close as an MCAP file does.
fn is_complete(bytes: &[u8]) -> bool {
    bytes.len() >= 2 * mcap::MAGIC.len() && bytes.ends_with(mcap::MAGIC)
}
