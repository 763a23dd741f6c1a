//! Finding what is whole in a recording's bytes, however they were cut or damaged.
//!
//! Records are followed from one to the next. What is handed on comes from a chunk, an attachment
//! or a record of names and values whose checksum holds. Where the records lead nowhere, the next
//! place is looked for at which one of these begins: what lies between is damaged, what follows is
//! not.
//!
//! # Not here
//!
//! No meaning of messages: that is `run`'s. Neither summary nor message indexes are read, except
//! for the way past them: a file that was cut has none.

use std::collections::BTreeMap;
use std::ops::Range;

use mcap::records::{MessageHeader, Metadata, op};
use serde::Serialize;

use super::record::{self, FRAME_BYTES, Frame, frame, frames};
use super::topic::{LIBRARY, Topic};

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
    Metadata(Metadata),
}

/// How much of a file was whole.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct Integrity {
    /// The file's length in bytes.
    pub bytes: u64,
    /// Chunks, attachments and records of names and values whose checksum held.
    pub parts: u64,
    /// Messages in them.
    pub messages: u64,
    /// Byte ranges that were damaged; nothing in them was used.
    pub damaged: Vec<Range<u64>>,
    /// Bytes at the end of which nothing could be made: a record that was cut.
    pub cut_bytes: u64,
    /// True where the file has MCAP's own end: the recorder finished it.
    pub complete: bool,
    /// Bytes behind that end.
    pub appended_bytes: u64,
}

/// Walks through everything that is whole, in the order of the file.
pub fn walk<'a>(bytes: &'a [u8], found: &mut dyn FnMut(Found<'a>)) -> Integrity {
    let mut walk = Walk::default();
    let (done, rest) = walk.over(bytes, found);
    let mut integrity = walk.integrity;
    integrity.bytes = bytes.len() as u64;
    let end = if rest == Rest::Ended { end_of(bytes, done) } else { None };
    integrity.appended_bytes = end.map_or(0, |end| (bytes.len() - end) as u64);
    integrity.complete =
        end.is_some() || bytes.len() >= 2 * mcap::MAGIC.len() && bytes.ends_with(mcap::MAGIC);
    match rest {
        Rest::Ended => {}
        Rest::Short(at) if !integrity.complete => integrity.cut_bytes = (bytes.len() - at) as u64,
        Rest::Short(_) | Rest::Damaged => integrity.damaged.push(done as u64..bytes.len() as u64),
    }
    integrity
}

/// Where a whole file ends: behind its footer and the magic, the data's end being at `data_end`.
fn end_of(bytes: &[u8], data_end: usize) -> Option<usize> {
    let footer = frames(bytes.get(data_end..)?).find(|record| record.opcode == op::FOOTER)?;
    let end = data_end + footer.next;
    bytes.get(end..)?.starts_with(mcap::MAGIC).then(|| end + mcap::MAGIC.len())
}

/// What is behind everything that is whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Rest {
    /// The data's end, as the recorder wrote it.
    Ended,
    /// From here on a record of which not all is there.
    Short(usize),
    /// Something that is no record, and none behind it.
    Damaged,
}

/// A walk, which may go over the bytes part by part.
#[derive(Debug, Clone, Default)]
pub(super) struct Walk {
    begun: bool,
    /// The channels that are known.
    channels: BTreeMap<u16, Topic>,
    pub(super) integrity: Integrity,
}

/// What stands at a place.
enum At<'a> {
    /// A record whose checksum holds.
    Checked(Frame<'a>, Content<'a>),
    /// A record without one that is in order.
    Other(Frame<'a>),
    End,
    Short,
    Broken,
}

enum Content<'a> {
    Records(&'a [u8]),
    Found(Found<'a>),
}

impl Walk {
    /// Goes over the records of `bytes`, and returns how many bytes are done with. The next part
    /// begins there; the first begins a file.
    pub(super) fn over<'a>(
        &mut self,
        bytes: &'a [u8],
        found: &mut dyn FnMut(Found<'a>),
    ) -> (usize, Rest) {
        if !self.begun && bytes.len() < mcap::MAGIC.len() {
            return (0, Rest::Short(0));
        }
        let mut at = if std::mem::replace(&mut self.begun, true) { 0 } else { mcap::MAGIC.len() };
        // Behind the last record that was checked: a wrong length in one that was not leads astray.
        let mut sure = at;
        loop {
            match look(bytes, at) {
                At::Checked(record, part) => {
                    self.integrity.parts += 1;
                    self.part(part, found);
                    (at, sure) = (record.next, record.next);
                }
                At::Other(record) => {
                    if record.opcode == op::HEADER && record::library(record.body) == Some(LIBRARY)
                    {
                        self.channels = Topic::ALL.map(|topic| (topic as u16, topic)).into();
                    }
                    at = record.next;
                }
                At::End => return (at, Rest::Ended),
                outside => match next_checked(bytes, sure) {
                    Some(next) => {
                        self.integrity.damaged.push(sure as u64..next as u64);
                        (at, sure) = (next, next);
                    }
                    None if matches!(outside, At::Short) => return (sure, Rest::Short(at)),
                    None => return (sure, Rest::Damaged),
                },
            }
        }
    }

    fn part<'a>(&mut self, part: Content<'a>, found: &mut dyn FnMut(Found<'a>)) {
        let records = match part {
            Content::Records(records) => records,
            Content::Found(thing) => return found(thing),
        };
        for record in frames(records) {
            match record.opcode {
                op::CHANNEL => self.describe(record.body),
                op::MESSAGE => {
                    let Some((header, data)) = record::message(record.body) else { continue };
                    let topic = self.channels.get(&header.channel_id).copied();
                    self.integrity.messages += 1;
                    found(Found::Message { topic, header, data });
                }
                _ => {}
            }
        }
    }

    fn describe(&mut self, body: &[u8]) {
        let Some(channel) = record::channel(body) else { return };
        match Topic::of_name(channel.topic) {
            Some(topic) if channel.message_encoding == "cdr" => {
                self.channels.insert(channel.id, topic)
            }
            _ => self.channels.remove(&channel.id),
        };
    }
}

fn look(bytes: &[u8], at: usize) -> At<'_> {
    let Some(record) = frame(bytes, at) else { return At::Short };
    let body = record.body;
    let in_order = match record.opcode {
        op::CHUNK | op::ATTACHMENT | op::METADATA => {
            return checked(&record).map_or(At::Broken, |part| At::Checked(record, part));
        }
        op::DATA_END if body.len() == 4 => return At::End,
        op::HEADER => record::library(body).is_some(),
        op::MESSAGE_INDEX => record::is_message_index(body),
        _ => false,
    };
    if in_order { At::Other(record) } else { At::Broken }
}

fn checked<'a>(record: &Frame<'a>) -> Option<Content<'a>> {
    match record.opcode {
        op::CHUNK => record::chunk(record.body).map(Content::Records),
        op::METADATA => {
            record::metadata(record.body).map(|metadata| Content::Found(Found::Metadata(metadata)))
        }
        op::ATTACHMENT => {
            let (name, media_type, data) = record::attachment(record.body)?;
            Some(Content::Found(Found::Attachment { name, media_type, data }))
        }
        _ => None,
    }
}

/// The next place at which a record begins whose checksum holds.
fn next_checked(bytes: &[u8], from: usize) -> Option<usize> {
    // None has 16 MB or more.
    let may_begin = |head: &[u8]| {
        matches!(head[0], op::CHUNK | op::ATTACHMENT | op::METADATA)
            && head[4..] == [0; FRAME_BYTES - 4]
    };
    let heads = bytes.get(from..)?.windows(FRAME_BYTES);
    let mut places =
        (from..).zip(heads).filter(|(_, head)| may_begin(head)).map(|(place, _)| place);
    places.find(|place| frame(bytes, *place).is_some_and(|record| checked(&record).is_some()))
}
