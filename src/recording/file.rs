//! A recording's bytes on their way out: a chunk of MCAP a second, with its checksum and indexes,
//! and at the end the summary.
//!
//! ```text
//! magic, header, metadata "onbrick", attachments,
//! chunk, its message indexes, chunk, its message indexes, …       one or more a sync
//! metadata "onbrick.end", data end,
//! summary: schemas, channels, indexes of chunks, attachments and metadata, statistics;
//! footer, magic
//! ```
//!
//! A chunk is in memory until it is closed and then written in one piece, so what is in the file is
//! whole up to the last chunk whatever becomes of the process. Chunks are not compressed: an SD
//! card takes 36 kB a second with ease.
//!
//! # Memory
//!
//! `mcap::Writer` keeps what the summary says of each chunk until the end: some 200 bytes on the
//! brick's processor, 7 MB after 10 hours of a chunk a second, more than the rest of the process.
//! Here a chunk's index goes to a nameless file beside the recording ([`Sink::scratch`]) and from
//! there into the summary: 170 bytes a second, 6 MB in 10 hours, none of it in memory. The records
//! themselves are those of the crate.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Cursor, Read as _, Seek as _, Write as _};

use binrw::BinWrite;
use mcap::records::{self, MessageIndex, MessageIndexEntry, Metadata, op};
use serde::Serialize;

use super::about::{Start, names, of_start};
use super::message;
use super::record::{FRAME_BYTES, sealed};
use super::sink::{RecordError, Sink};
use super::topic::{LIBRARY, Topic};

/// What a chunk's bytes are preceded by: frame, times, size, checksum, no compression, size.
pub(super) const CHUNK_HEAD: usize = FRAME_BYTES + 8 + 8 + 8 + 4 + 4 + 8;

/// A chunk is closed before its second message beyond this: some ten seconds of a run, where syncs
/// are set to be rarer than one a second.
const CHUNK_BYTES: usize = 256 << 10;

/// How much of the summary is collected before it goes to the sink.
const PIECE_BYTES: usize = 64 << 10;

/// A recording that is being written.
#[derive(Debug)]
pub(super) struct RecordingFile {
    sink: Box<dyn Sink>,
    /// How many bytes the sink has taken.
    position: u64,
    wall_offset_ns: i64,
    /// Messages so far, by channel.
    sequence: [u32; Topic::ALL.len()],
    chunk: Chunk,
    /// The indexes of the chunks so far, as records.
    chunk_indexes: BufWriter<File>,
    /// What the summary counts, but for what is counted elsewhere.
    statistics: records::Statistics,
    attachments: Vec<records::AttachmentIndex>,
    metadata: Vec<records::MetadataIndex>,
}

/// The chunk that is open.
#[derive(Debug)]
struct Chunk {
    /// Room for the head, and the records behind it.
    bytes: Vec<u8>,
    /// The least and the greatest log time.
    times: Option<(u64, u64)>,
    /// Where the messages are, by channel.
    indexes: [MessageIndex; Topic::ALL.len()],
}

impl RecordingFile {
    /// Begins a file with what is known of the run, the files that it was made from, and the
    /// channels. Nothing of it is synced yet.
    pub(super) fn begin(sink: Box<dyn Sink>, start: &Start) -> Result<Self, RecordError> {
        let index = |topic| MessageIndex { channel_id: topic as u16, records: Vec::new() };
        let chunk_indexes = sink.scratch().map_err(failed("begin the file"))?;
        let mut file = Self {
            sink,
            position: 0,
            wall_offset_ns: start.info.wall_offset_ns,
            sequence: [0; Topic::ALL.len()],
            chunk: Chunk {
                bytes: vec![0; CHUNK_HEAD],
                times: None,
                indexes: Topic::ALL.map(index),
            },
            chunk_indexes: BufWriter::with_capacity(4096, chunk_indexes),
            statistics: records::Statistics::default(),
            attachments: Vec::new(),
            metadata: Vec::new(),
        };
        let bytes = file.beginning(start).map_err(failed("begin the file"))?;
        file.pass_on(&bytes)?;
        Ok(file)
    }

    fn beginning(&mut self, start: &Start) -> io::Result<Vec<u8>> {
        let mut bytes = mcap::MAGIC.to_vec();
        let header = records::Header { profile: "ros2".to_owned(), library: LIBRARY.to_owned() };
        put(&mut bytes, op::HEADER, &header)?;
        self.metadata.push(put_metadata(&mut bytes, 0, of_start(&start.info))?);
        let stamp = self.stamp_ns(start.info.start_ns);
        let files = [(names::ROBOT, &start.robot_toml), (names::MISSION, &start.mission_toml)];
        let world = start.world_toml.iter().map(|world| (names::WORLD, world));
        for (name, text) in files.into_iter().chain(world) {
            self.attachments.push(put_attachment(&mut bytes, name, text, stamp)?);
        }
        put_schemas(&mut self.chunk.bytes)?;
        put_channels(&mut self.chunk.bytes)?;
        Ok(bytes)
    }

    /// Puts a message; `time_ns` is of the run's clock.
    pub(super) fn message<T: Serialize>(
        &mut self,
        topic: Topic,
        time_ns: i64,
        message: &T,
    ) -> Result<(), RecordError> {
        if self.chunk.bytes.len() > CHUNK_BYTES {
            self.close_chunk()?;
        }
        let log_time = self.stamp_ns(time_ns);
        let sequence = self.sequence[topic as usize];
        let start = self.chunk.bytes.len();
        let put = framed(&mut self.chunk.bytes, op::MESSAGE, |bytes| {
            bytes.extend_from_slice(&(topic as u16).to_le_bytes());
            bytes.extend_from_slice(&sequence.to_le_bytes());
            bytes.extend_from_slice(&log_time.to_le_bytes());
            bytes.extend_from_slice(&log_time.to_le_bytes());
            message::encode_into(message, bytes)
                .map_err(|error| io::Error::other(error.to_string()))
        });
        if let Err(source) = put {
            self.chunk.bytes.truncate(start);
            return Err(RecordError { doing: "encode a message", source });
        }
        let offset = (start - CHUNK_HEAD) as u64;
        self.chunk.indexes[topic as usize].records.push(MessageIndexEntry { log_time, offset });
        let (least, greatest) = self.chunk.times.unwrap_or((log_time, log_time));
        self.chunk.times = Some((least.min(log_time), greatest.max(log_time)));
        self.sequence[topic as usize] = sequence.wrapping_add(1);
        Ok(())
    }

    /// A time of the run's clock as a stamp, nanoseconds since 1970.
    pub(super) fn stamp_ns(&self, time_ns: i64) -> u64 {
        u64::try_from(time_ns.saturating_add(self.wall_offset_ns)).unwrap_or(0)
    }

    /// True where a message was put since the last sync.
    pub(super) fn is_dirty(&self) -> bool {
        self.chunk.times.is_some()
    }

    /// Closes the chunk and waits until all of the file is on the disk. Nothing new is nothing to
    /// do.
    pub(super) fn sync(&mut self) -> Result<(), RecordError> {
        if !self.is_dirty() {
            return Ok(());
        }
        self.close_chunk()?;
        self.sink.sync().map_err(failed("bring the file to the disk"))
    }

    /// Puts how the run ended, where that is known, and the summary; returns the file's length.
    pub(super) fn finish(mut self, ending: Option<Metadata>) -> Result<u64, RecordError> {
        self.sync()?;
        let mut bytes = Vec::new();
        if let Some(ending) = ending {
            let index = put_metadata(&mut bytes, self.position, ending);
            self.metadata.push(index.map_err(failed("finish the file"))?);
        }
        put(&mut bytes, op::DATA_END, &records::DataEnd::default())
            .map_err(failed("finish the file"))?;
        self.pass_on(&bytes)?;
        SummarySection::of(&mut self).write()?;
        self.sink.sync().map_err(failed("bring the file's end to the disk"))?;
        Ok(self.position)
    }

    /// Hands the chunk that is open to the sink, if it has a message.
    fn close_chunk(&mut self) -> Result<(), RecordError> {
        let Some((start_ns, end_ns)) = self.chunk.times.take() else { return Ok(()) };
        let bytes = &mut self.chunk.bytes;
        let crc = crc32fast::hash(&bytes[CHUNK_HEAD..]);
        let length = bytes.len();
        let size = (length - CHUNK_HEAD) as u64;
        let head = [
            &[op::CHUNK][..],
            &((length - FRAME_BYTES) as u64).to_le_bytes(),
            &start_ns.to_le_bytes(),
            &end_ns.to_le_bytes(),
            &size.to_le_bytes(),
            &crc.to_le_bytes(),
            &0_u32.to_le_bytes(),
            &size.to_le_bytes(),
        ];
        bytes[..CHUNK_HEAD].copy_from_slice(&head.concat());
        let mut index = records::ChunkIndex {
            message_start_time: start_ns,
            message_end_time: end_ns,
            chunk_start_offset: self.position,
            chunk_length: length as u64,
            message_index_offsets: BTreeMap::new(),
            message_index_length: 0,
            compression: String::new(),
            compressed_size: size,
            uncompressed_size: size,
        };
        for messages in self.chunk.indexes.iter_mut().filter(|index| !index.records.is_empty()) {
            let offset = self.position + bytes.len() as u64;
            index.message_index_offsets.insert(messages.channel_id, offset);
            put(bytes, op::MESSAGE_INDEX, messages).map_err(failed("write to the file"))?;
            messages.records.clear();
        }
        index.message_index_length = (bytes.len() - length) as u64;
        self.note(&index).map_err(failed("keep an index"))?;
        let bytes = std::mem::take(&mut self.chunk.bytes);
        self.pass_on(&bytes)?;
        self.chunk.bytes = bytes;
        self.chunk.bytes.truncate(CHUNK_HEAD);
        Ok(())
    }

    /// Keeps a chunk's index for the summary.
    fn note(&mut self, index: &records::ChunkIndex) -> io::Result<()> {
        let mut record = Vec::new();
        put(&mut record, op::CHUNK_INDEX, index)?;
        let statistics = &mut self.statistics;
        let (least, greatest) = match statistics.chunk_count {
            0 => (u64::MAX, 0),
            _ => (statistics.message_start_time, statistics.message_end_time),
        };
        statistics.message_start_time = least.min(index.message_start_time);
        statistics.message_end_time = greatest.max(index.message_end_time);
        statistics.chunk_count += 1;
        self.chunk_indexes.write_all(&record)
    }

    fn pass_on(&mut self, bytes: &[u8]) -> Result<(), RecordError> {
        self.sink.write_all(bytes).map_err(failed("write to the file"))?;
        self.position += bytes.len() as u64;
        Ok(())
    }
}

fn failed(doing: &'static str) -> impl Fn(io::Error) -> RecordError {
    move |source| RecordError { doing, source }
}

/// The summary on its way out.
struct SummarySection<'f> {
    file: &'f mut RecordingFile,
    start: u64,
    /// What the sink does not have yet.
    bytes: Vec<u8>,
    /// Of what it has.
    crc: crc32fast::Hasher,
    group_start: u64,
    groups: Vec<records::SummaryOffset>,
}

impl<'f> SummarySection<'f> {
    fn of(file: &'f mut RecordingFile) -> Self {
        let start = file.position;
        let (bytes, crc, groups) = (Vec::new(), crc32fast::Hasher::new(), Vec::new());
        Self { file, start, bytes, crc, group_start: start, groups }
    }

    fn write(mut self) -> Result<(), RecordError> {
        put_schemas(&mut self.bytes).map_err(failed("finish the file"))?;
        self.end_group(op::SCHEMA);
        put_channels(&mut self.bytes).map_err(failed("finish the file"))?;
        self.end_group(op::CHANNEL);
        self.chunk_indexes()?;
        self.end_group(op::CHUNK_INDEX);
        let statistics = self.statistics();
        for index in std::mem::take(&mut self.file.attachments) {
            self.record(op::ATTACHMENT_INDEX, &index)?;
        }
        self.end_group(op::ATTACHMENT_INDEX);
        for index in std::mem::take(&mut self.file.metadata) {
            self.record(op::METADATA_INDEX, &index)?;
        }
        self.end_group(op::METADATA_INDEX);
        self.record(op::STATISTICS, &statistics)?;
        self.end_group(op::STATISTICS);
        let offsets_start = self.here();
        for group in std::mem::take(&mut self.groups) {
            self.record(op::SUMMARY_OFFSET, &group)?;
        }
        self.footer(offsets_start)
    }

    /// What the file has, while that is still known.
    fn statistics(&self) -> records::Statistics {
        let file = &self.file;
        let count = |count: usize| u32::try_from(count).unwrap_or(u32::MAX);
        let messages =
            (0..).zip(file.sequence).map(|(channel, messages)| (channel, u64::from(messages)));
        let schemas = Topic::ALL.into_iter().filter(|topic| topic.names_its_schema()).count();
        records::Statistics {
            message_count: messages.clone().map(|(_, messages)| messages).sum(),
            schema_count: u16::try_from(schemas).unwrap_or(u16::MAX),
            channel_count: count(Topic::ALL.len()),
            attachment_count: count(file.attachments.len()),
            metadata_count: count(file.metadata.len()),
            channel_message_counts: messages.filter(|(_, messages)| *messages > 0).collect(),
            ..file.statistics.clone()
        }
    }

    /// Puts the chunks' indexes, piece by piece.
    fn chunk_indexes(&mut self) -> Result<(), RecordError> {
        self.pass_on()?;
        let indexes = &mut self.file.chunk_indexes;
        indexes
            .flush()
            .and_then(|()| indexes.get_mut().rewind())
            .map_err(failed("keep an index"))?;
        loop {
            let mut piece = self.file.chunk_indexes.get_mut().take(PIECE_BYTES as u64);
            let read = piece.read_to_end(&mut self.bytes).map_err(failed("keep an index"))?;
            self.pass_on()?;
            if read == 0 {
                return Ok(());
            }
        }
    }

    fn record(
        &mut self,
        opcode: u8,
        record: &impl for<'a> BinWrite<Args<'a> = ()>,
    ) -> Result<(), RecordError> {
        put(&mut self.bytes, opcode, record).map_err(failed("finish the file"))?;
        if self.bytes.len() > PIECE_BYTES { self.pass_on() } else { Ok(()) }
    }

    fn pass_on(&mut self) -> Result<(), RecordError> {
        self.crc.update(&self.bytes);
        self.file.pass_on(&self.bytes)?;
        self.bytes.clear();
        Ok(())
    }

    fn here(&self) -> u64 {
        self.file.position + self.bytes.len() as u64
    }

    fn end_group(&mut self, group_opcode: u8) {
        let (group_start, here) = (self.group_start, self.here());
        if here > group_start {
            let group_length = here - group_start;
            self.groups.push(records::SummaryOffset { group_opcode, group_start, group_length });
        }
        self.group_start = here;
    }

    /// The footer, whose checksum is over the summary and the footer itself up to there.
    fn footer(mut self, summary_offset_start: u64) -> Result<(), RecordError> {
        let footer =
            records::Footer { summary_start: self.start, summary_offset_start, summary_crc: 0 };
        put(&mut self.bytes, op::FOOTER, &footer).map_err(failed("finish the file"))?;
        let counted = self.bytes.len() - size_of_val(&footer.summary_crc);
        self.bytes.truncate(counted);
        self.crc.update(&self.bytes);
        self.bytes.extend_from_slice(&self.crc.finalize().to_le_bytes());
        self.bytes.extend_from_slice(mcap::MAGIC);
        self.file.pass_on(&self.bytes)
    }
}

/// A record of what `body` puts.
fn framed(
    bytes: &mut Vec<u8>,
    opcode: u8,
    body: impl FnOnce(&mut Vec<u8>) -> io::Result<()>,
) -> io::Result<()> {
    let start = bytes.len();
    bytes.extend_from_slice(&[opcode, 0, 0, 0, 0, 0, 0, 0, 0]);
    body(bytes)?;
    let length = (bytes.len() - start - FRAME_BYTES) as u64;
    bytes[start + 1..start + FRAME_BYTES].copy_from_slice(&length.to_le_bytes());
    Ok(())
}

fn fields(bytes: &mut Vec<u8>, record: &impl for<'a> BinWrite<Args<'a> = ()>) -> io::Result<()> {
    let end = bytes.len() as u64;
    let mut cursor = Cursor::new(bytes);
    cursor.set_position(end);
    record.write_le(&mut cursor).map_err(|error| io::Error::other(error.to_string()))
}

fn put(
    bytes: &mut Vec<u8>,
    opcode: u8,
    record: &impl for<'a> BinWrite<Args<'a> = ()>,
) -> io::Result<()> {
    framed(bytes, opcode, |bytes| fields(bytes, record))
}

/// The types of all topics, each once.
fn put_schemas(bytes: &mut Vec<u8>) -> io::Result<()> {
    for topic in Topic::ALL.into_iter().filter(|topic| topic.names_its_schema()) {
        let (id, name, definition) = (topic.schema_id(), topic.schema_name(), topic.schema());
        let header = records::SchemaHeader { id, name, encoding: "ros2msg".to_owned() };
        framed(bytes, op::SCHEMA, |bytes| {
            fields(bytes, &header)?;
            bytes.extend_from_slice(&u32::try_from(definition.len()).unwrap_or(0).to_le_bytes());
            bytes.extend_from_slice(definition.as_bytes());
            Ok(())
        })?;
    }
    Ok(())
}

fn put_channels(bytes: &mut Vec<u8>) -> io::Result<()> {
    Topic::ALL.into_iter().try_for_each(|topic| {
        let channel = records::Channel {
            id: topic as u16,
            schema_id: topic.schema_id(),
            topic: topic.name().to_owned(),
            message_encoding: "cdr".to_owned(),
            metadata: topic.channel_metadata(),
        };
        put(bytes, op::CHANNEL, &channel)
    })
}

/// Names and values, sealed; `bytes` are put to the file at `position`.
fn put_metadata(
    bytes: &mut Vec<u8>,
    position: u64,
    metadata: Metadata,
) -> io::Result<records::MetadataIndex> {
    let start = bytes.len();
    let metadata = sealed(metadata);
    put(bytes, op::METADATA, &metadata)?;
    let (offset, length) = (position + start as u64, (bytes.len() - start) as u64);
    Ok(records::MetadataIndex { offset, length, name: metadata.name })
}

/// A file with its checksum; `bytes` begin the file.
fn put_attachment(
    bytes: &mut Vec<u8>,
    name: &str,
    text: &str,
    stamp: u64,
) -> io::Result<records::AttachmentIndex> {
    let start = bytes.len();
    let (name, media_type) = (name.to_owned(), "application/toml".to_owned());
    let header =
        records::AttachmentHeader { log_time: stamp, create_time: stamp, name, media_type };
    framed(bytes, op::ATTACHMENT, |bytes| {
        fields(bytes, &header)?;
        bytes.extend_from_slice(&(text.len() as u64).to_le_bytes());
        bytes.extend_from_slice(text.as_bytes());
        let crc = crc32fast::hash(&bytes[start + FRAME_BYTES..]);
        bytes.extend_from_slice(&crc.to_le_bytes());
        Ok(())
    })?;
    Ok(records::AttachmentIndex {
        offset: start as u64,
        length: (bytes.len() - start) as u64,
        log_time: stamp,
        create_time: stamp,
        data_size: text.len() as u64,
        name: header.name,
        media_type: header.media_type,
    })
}
