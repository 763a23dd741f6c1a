//! MCAP's records as they lie in a file: framed, and taken apart (mcap.dev/spec).
//!
//! `mcap` reads them too, but makes room for as many bytes as a string says that it has before it
//! checks whether they are there. In a damaged file that may be 4 GB, and on a brick the end of the
//! program. Nothing here makes room for more than is there. `mcap` also panics at an attachment
//! that is shorter than its own checksum, and its readers stop at the first damage.
//!
//! # Not here
//!
//! Which records count, and what is in a message: that is `walk`'s and `message`'s.

use std::collections::BTreeMap;
use std::ops::Range;

use mcap::records::{MessageHeader, Metadata};

/// The bytes of a record before its body: opcode and length.
pub(super) const FRAME_BYTES: usize = 9;

/// A record as framed.
pub(super) struct Frame<'a> {
    pub(super) opcode: u8,
    pub(super) body: &'a [u8],
    /// Where the next one begins.
    pub(super) next: usize,
}

/// The record at a place; `None` where it is not whole.
pub(super) fn frame(bytes: &[u8], at: usize) -> Option<Frame<'_>> {
    let mut fields = Fields(bytes.get(at..)?);
    let opcode = fields.u8()?;
    let length = usize::try_from(fields.u64()?).ok()?;
    let body = fields.take(length)?;
    Some(Frame { opcode, body, next: at + FRAME_BYTES + length })
}

/// The records from the beginning, as far as they are whole.
pub(super) fn frames(bytes: &[u8]) -> impl Iterator<Item = Frame<'_>> {
    let mut next = 0;
    std::iter::from_fn(move || {
        let record = frame(bytes, next)?;
        next = record.next;
        Some(record)
    })
}

/// What of a channel's description says what its messages are.
pub(super) struct Channel<'a> {
    pub(super) id: u16,
    pub(super) topic: &'a str,
    pub(super) message_encoding: &'a str,
}

/// A channel, from the body of its record.
pub(super) fn channel(body: &[u8]) -> Option<Channel<'_>> {
    let mut fields = Fields(body);
    let (id, _schema) = (fields.u16()?, fields.u16()?);
    Some(Channel { id, topic: fields.text()?, message_encoding: fields.text()? })
}

/// The name of the checksum in a record of names and values.
const SEAL: &str = "crc32";

/// What wrote a file, from the body of its header.
pub(super) fn library(body: &[u8]) -> Option<&str> {
    let mut fields = Fields(body);
    let (_profile, library) = (fields.text()?, fields.text()?);
    fields.0.is_empty().then_some(library)
}

/// The records of a chunk, from its body, if its checksum holds. Nothing of ours is compressed.
pub(super) fn chunk(body: &[u8]) -> Option<&[u8]> {
    let mut fields = Fields(body);
    let (_start, _end, uncompressed) = (fields.u64()?, fields.u64()?, fields.u64()?);
    let (crc, compression, length) = (fields.u32()?, fields.text()?, fields.u64()?);
    let size = fields.0.len() as u64;
    let whole = compression.is_empty() && [uncompressed, length] == [size; 2];
    (whole && crc32fast::hash(fields.0) == crc).then_some(fields.0)
}

/// True for the body of an index of messages.
pub(super) fn is_message_index(body: &[u8]) -> bool {
    let mut fields = Fields(body);
    fields.u16().is_some()
        && fields.bytes().is_some_and(|entries| entries.0.len().is_multiple_of(16))
        && fields.0.is_empty()
}

/// Header and body of a message.
pub(super) fn message(body: &[u8]) -> Option<(MessageHeader, &[u8])> {
    let mut fields = Fields(body);
    let header = MessageHeader {
        channel_id: fields.u16()?,
        sequence: fields.u32()?,
        log_time: fields.u64()?,
        publish_time: fields.u64()?,
    };
    Some((header, fields.0))
}

/// A record of names and values, from its body, if its checksum holds; none has a name twice.
pub(super) fn metadata(body: &[u8]) -> Option<Metadata> {
    let mut fields = Fields(body);
    let name = fields.text()?.to_owned();
    let mut pairs = fields.bytes()?;
    let mut metadata = BTreeMap::new();
    while !pairs.0.is_empty() {
        let (key, value) = (pairs.text()?, pairs.text()?);
        if metadata.insert(key.to_owned(), value.to_owned()).is_some() {
            return None;
        }
    }
    (fields.0.is_empty() && metadata.remove(SEAL)? == seal(&name, &metadata))
        .then_some(Metadata { name, metadata })
}

/// The same names and values with their checksum among them: MCAP has none for this record.
#[must_use]
pub(crate) fn sealed(mut metadata: Metadata) -> Metadata {
    metadata.metadata.remove(SEAL);
    metadata.metadata.insert(SEAL.to_owned(), seal(&metadata.name, &metadata.metadata));
    metadata
}

fn seal(name: &str, pairs: &BTreeMap<String, String>) -> String {
    let mut crc = crc32fast::Hasher::new();
    for text in
        [name].into_iter().chain(pairs.iter().flat_map(|(key, value)| [key.as_str(), value]))
    {
        crc.update(&(text.len() as u64).to_le_bytes());
        crc.update(text.as_bytes());
    }
    format!("{:08x}", crc.finalize())
}

/// Where a record of names and values lies in its file, frame and all, and its name; from the body
/// of its index.
pub(super) fn metadata_index(body: &[u8]) -> Option<(Range<u64>, &str)> {
    let mut fields = Fields(body);
    let (offset, length) = (fields.u64()?, fields.u64()?);
    Some((offset..offset.checked_add(length)?, fields.text()?))
}

/// Where the offsets at the end of a file's summary begin, from the footer's body. 0: there are
/// none.
pub(super) fn footer(body: &[u8]) -> Option<u64> {
    let mut fields = Fields(body);
    let (_summary_start, offsets_start) = (fields.u64()?, fields.u64()?);
    Some(offsets_start)
}

/// Which records of the summary lie where.
pub(super) fn summary_offset(body: &[u8]) -> Option<(u8, Range<u64>)> {
    let mut fields = Fields(body);
    let (opcode, start, length) = (fields.u8()?, fields.u64()?, fields.u64()?);
    Some((opcode, start..start.checked_add(length)?))
}

/// Name, type and bytes of an attachment, from the body of its record, if its own checksum holds.
pub(super) fn attachment(body: &[u8]) -> Option<(String, String, &[u8])> {
    let (counted, crc) = body.split_last_chunk::<4>()?;
    let crc = u32::from_le_bytes(*crc);
    if crc32fast::hash(counted) != crc {
        return None;
    }
    let mut fields = Fields(counted);
    let (_logged, _created) = (fields.u64()?, fields.u64()?);
    let (name, media_type) = (fields.text()?, fields.text()?);
    let length = usize::try_from(fields.u64()?).ok()?;
    (length == fields.0.len()).then(|| (name.to_owned(), media_type.to_owned(), fields.0))
}

/// What is left of a body.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn take(&mut self, length: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(taken)
    }

    fn chunk<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    fn u8(&mut self) -> Option<u8> {
        self.chunk().map(u8::from_le_bytes)
    }

    fn u16(&mut self) -> Option<u16> {
        self.chunk().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.chunk().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.chunk().map(u64::from_le_bytes)
    }

    /// As many bytes as a length before them says.
    fn bytes(&mut self) -> Option<Self> {
        let length = usize::try_from(self.u32()?).ok()?;
        self.take(length).map(Self)
    }

    fn text(&mut self) -> Option<&'a str> {
        std::str::from_utf8(self.bytes()?.0).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A string as in a record, with this many bytes as its declared length.
    fn said(length: u32, text: &str) -> Vec<u8> {
        [&length.to_le_bytes(), text.as_bytes()].concat()
    }

    fn string(text: &str) -> Vec<u8> {
        said(u32::try_from(text.len()).unwrap(), text)
    }

    fn pairs(strings: &[&str]) -> Vec<u8> {
        let all = strings.iter().flat_map(|text| string(text)).collect::<Vec<_>>();
        [&u32::try_from(all.len()).unwrap().to_le_bytes()[..], &all].concat()
    }

    #[test]
    fn names_and_values_are_read_as_the_mcap_crate_reads_them() {
        let pair = |(name, value): (&str, &str)| (name.to_owned(), value.to_owned());
        let plain = Metadata {
            name: "onbrick".to_owned(),
            metadata: [("a", "1"), ("b", "2")].map(pair).into(),
        };
        let crc = sealed(plain.clone()).metadata[SEAL].clone();
        let read = |strings: &[&str]| {
            let body = [string("onbrick"), pairs(strings)].concat();
            let theirs = mcap::parse_record(mcap::records::op::METADATA, &body).ok()?;
            let mcap::records::Record::Metadata(theirs) = theirs else { panic!("{theirs:?}") };
            let ours = metadata(&body)?;
            assert_eq!(sealed(ours.clone()), theirs);
            Some(ours)
        };
        assert_eq!(read(&["b", "2", "a", "1", SEAL, &crc]), Some(plain));
        assert_eq!(read(&["b", "2", "a", "2", SEAL, &crc]), None, "not what the checksum is of");
        assert_eq!(read(&["b", "2", "a", "1"]), None, "no checksum");
        let body = [string("onbrick"), pairs(&["a", "2", "a", "1", SEAL, &crc])].concat();
        assert_eq!(metadata(&body), None, "a name twice");
    }

    #[test]
    fn a_string_that_says_it_is_longer_than_its_record_is_none() {
        for length in [4, 0x7FFF_FFFF, 0x8000_0000, u32::MAX] {
            assert_eq!(metadata(&said(length, "abc")), None);
            assert_eq!(metadata(&[string("name"), said(length, "abc")].concat()), None);
            let ids = [0; 4].to_vec();
            assert!(channel(&[ids.clone(), said(length, "abc")].concat()).is_none());
            assert!(channel(&[ids, string("/pose"), said(length, "cdr")].concat()).is_none());
            assert_eq!(metadata_index(&[vec![0; 16], said(length, "abc")].concat()), None);
            assert_eq!(attachment(&[vec![0; 16], said(length, "abc"), vec![0; 4]].concat()), None);
        }
        assert_eq!(
            metadata_index(&[vec![0xFF; 16], string("abc")].concat()),
            None,
            "behind the end of all files"
        );
    }

    #[test]
    fn a_record_that_says_it_is_longer_than_its_file_is_none() {
        for length in [3, u64::from(u32::MAX), u64::MAX] {
            let bytes = [&[1][..], &length.to_le_bytes(), b"ab"].concat();
            assert!(frame(&bytes, 0).is_none());
            assert!(frame(&bytes, 11).is_none());
        }
        assert!(frame(b"", usize::MAX).is_none());
    }
}
