//! A recording's bytes on their way out: records of MCAP, buffered, checksummed, synced.
//!
//! Plain MCAP has no checksum outside of chunks. At each sync a private record (opcode [`SYNC_OPCODE`]) says where the stretch
//! began that it closes, how long it is and what its CRC32 is; the stretches follow each other without a hole from the first
//! byte of the file, and a sync record belongs to none. The record, all numbers little-endian:
//!
//! | bytes | |
//! |---|---|
//! | 1 + 8 | opcode 0x80, length 44 |
//! | 8 | [`SYNC_MAGIC`] |
//! | 8 | where the stretch begins in the file |
//! | 8 | its length in bytes; it ends where this record begins |
//! | 8 | wall clock minus run clock, nanoseconds, signed |
//! | 4 | checksum of the table of topics and schemas |
//! | 4 | CRC32 of the stretch |
//! | 4 | CRC32 of this record's 40 bytes before |
//!
//! # What we count on
//!
//! - `mcap::Writer` writes in order and never goes back when it may not seek.

use std::fmt::Debug;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{McapError, WriteOptions, Writer};
use serde::Serialize;

use super::crc::Crc;
use super::topic::{Topic, table_checksum};
use super::{cdr, message};

/// The opcode of the private record that closes a stretch; MCAP leaves 0x80 and above to applications.
pub const SYNC_OPCODE: u8 = 0x80;

/// The first bytes of that record's body.
pub const SYNC_MAGIC: [u8; 8] = *b"ONBRICK\x01";

/// The length of its body.
pub(super) const SYNC_BODY: usize = 44;

/// How much is collected before it goes to the sink: one write of 64 KiB costs an SD card little more than one of a page.
const BUFFER_BYTES: usize = 64 << 10;

/// Where a recording's bytes go. Tests put faults behind it.
pub trait Sink: Debug + Send {
    /// Takes all bytes, behind those of the last call.
    ///
    /// # Errors
    ///
    /// What the file system says; nothing is asked of the sink afterwards.
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Returns when all bytes taken so far will survive a loss of power.
    ///
    /// # Errors
    ///
    /// What the file system says; nothing is asked of the sink afterwards.
    fn sync(&mut self) -> io::Result<()>;
}

impl Sink for File {
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        Write::write_all(self, bytes)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.sync_data()
    }
}

/// Creates the file of a recording, empty, and makes its name survive a loss of power. What was there before is gone. While the file is open,
/// [`writer`](super::writer) names this process.
///
/// # Errors
///
/// What the file system says.
pub fn create(path: &Path) -> io::Result<File> {
    let file = File::create(path)?;
    // A file system without locks still takes a recording.
    let _ = super::outside::hold(&file);
    let folder = match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    File::open(folder)?.sync_all()?;
    Ok(file)
}

/// Recording failed: what was being done, and why it could not be.
#[derive(Debug, thiserror::Error)]
#[error("recording stopped: cannot {doing}; what was synced before is safe")]
pub struct RecordError {
    /// What was being done.
    pub doing: &'static str,
    /// What the file system says.
    #[source]
    pub source: io::Error,
}

/// A recording that is being written.
pub(super) struct RecordingFile {
    /// Before the tap small pieces are collected: a record comes in seven, and each would take the lock.
    writer: Writer<NoSeek<BufWriter<Tap>>>,
    output: Arc<Mutex<Output>>,
    sequence: [u32; Topic::ALL.len()],
    wall_offset_ns: i64,
    table: u32,
    encoded: cdr::Writer,
    dirty: bool,
}

impl Debug for RecordingFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RecordingFile").field("output", &self.output).finish_non_exhaustive()
    }
}

impl RecordingFile {
    /// Begins a file: header, schemas and channels of all topics.
    pub(super) fn begin(sink: Box<dyn Sink>, wall_offset_ns: i64) -> Result<Self, RecordError> {
        let output = Arc::new(Mutex::new(Output::new(sink)));
        let options = WriteOptions::new()
            .profile("ros2")
            .library(concat!("onbrick ", env!("CARGO_PKG_VERSION")))
            .use_chunks(false)
            .disable_seeking(true)
            // Syncs have checksums of their own, and an interrupted run never gets to this one.
            .calculate_data_section_crc(false);
        let writer = options
            .create(NoSeek::new(BufWriter::new(Tap(Arc::clone(&output)))))
            .map_err(failed("begin the file"))?;
        let sequence = [0; Topic::ALL.len()];
        let mut file = Self {
            writer,
            output,
            sequence,
            wall_offset_ns,
            table: table_checksum(),
            encoded: cdr::Writer::default(),
            dirty: false,
        };
        file.describe_channels().map_err(failed("describe the channels"))?;
        Ok(file)
    }

    /// Puts a message; `time_ns` is of the run's clock.
    pub(super) fn message<T: Serialize>(
        &mut self,
        topic: Topic,
        time_ns: i64,
        message: &T,
    ) -> Result<(), RecordError> {
        let log_time = self.stamp_ns(time_ns);
        let encoded = message::encode_into(message, &mut self.encoded).map_err(|error| RecordError {
            doing: "encode a message",
            source: io::Error::other(error.to_string()),
        })?;
        let channel_id = topic as u16;
        let counter = &mut self.sequence[topic as usize];
        let header = MessageHeader { channel_id, sequence: *counter, log_time, publish_time: log_time };
        *counter = counter.wrapping_add(1);
        self.dirty = true;
        self.writer.write_to_known_channel(&header, encoded).map_err(failed("write a message"))
    }

    /// A time of the run's clock as a stamp, nanoseconds since 1970.
    pub(super) fn stamp_ns(&self, time_ns: i64) -> u64 {
        u64::try_from(time_ns.saturating_add(self.wall_offset_ns)).unwrap_or(0)
    }

    /// Attaches a file as it was read.
    pub(super) fn attach(&mut self, name: &str, text: &str, time_ns: i64) -> Result<(), RecordError> {
        let stamp = self.stamp_ns(time_ns);
        let attachment = mcap::Attachment {
            log_time: stamp,
            create_time: stamp,
            name: name.to_owned(),
            media_type: "application/toml".to_owned(),
            data: text.as_bytes().into(),
        };
        self.writer.attach(&attachment).map_err(failed("attach a file"))
    }

    /// Puts a record of names and values.
    pub(super) fn metadata(&mut self, metadata: &Metadata) -> Result<(), RecordError> {
        self.writer.write_metadata(metadata).map_err(failed("write what is known of the run"))
    }

    /// Closes the stretch since the last sync and waits until all of it is on the disk. Nothing new is nothing to do.
    pub(super) fn sync(&mut self) -> Result<(), RecordError> {
        self.dirty = false;
        self.writer.flush().map_err(failed("write a message"))?;
        let stretch = self.lock().stretch();
        if stretch.length == 0 {
            return Ok(());
        }
        let body = SyncBody { stretch, wall_offset_ns: self.wall_offset_ns, table: self.table }.to_bytes();
        self.writer
            .write_private_record(SYNC_OPCODE, &body, Default::default())
            .and_then(|()| self.writer.flush())
            .map_err(failed("write a sync"))?;
        let mut output = self.lock();
        output.begin_stretch();
        output.sync().map_err(|source| RecordError { doing: "bring the file to the disk", source })
    }

    /// True where a message was put since the last sync.
    pub(super) fn is_dirty(&self) -> bool {
        self.dirty
    }

    /// Puts the last sync and MCAP's own end, with its summary.
    pub(super) fn finish(mut self) -> Result<u64, RecordError> {
        self.sync()?;
        self.writer.finish().map_err(failed("finish the file"))?;
        let Self { writer, output, .. } = self;
        // What is still collected goes on with it.
        writer
            .into_inner()
            .into_inner()
            .into_inner()
            .map_err(|error| RecordError { doing: "finish the file", source: error.into_error() })?;
        let mut output = output.lock().unwrap_or_else(PoisonError::into_inner);
        output.sync().map_err(|source| RecordError { doing: "bring the file's end to the disk", source })?;
        Ok(output.position)
    }

    fn describe_channels(&mut self) -> Result<(), McapError> {
        for topic in Topic::ALL {
            let schema =
                self.writer.add_schema(&topic.schema_name(), "ros2msg", topic.schema().as_bytes())?;
            let metadata = topic.channel_metadata();
            self.writer.add_channel_with_id(topic as u16, schema, topic.name(), "cdr", &metadata)?;
        }
        Ok(())
    }

    fn lock(&self) -> MutexGuard<'_, Output> {
        self.output.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn failed(doing: &'static str) -> impl Fn(McapError) -> RecordError {
    move |error| {
        let source = match error {
            McapError::Io(source) => source,
            other => io::Error::other(other.to_string()),
        };
        RecordError { doing, source }
    }
}

/// A stretch of the file that a sync closes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Stretch {
    pub(super) start: u64,
    pub(super) length: u64,
    pub(super) crc: u32,
}

/// The body of a sync record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SyncBody {
    pub(super) stretch: Stretch,
    pub(super) wall_offset_ns: i64,
    pub(super) table: u32,
}

impl SyncBody {
    fn to_bytes(self) -> [u8; SYNC_BODY] {
        let mut bytes = [0; SYNC_BODY];
        bytes[..8].copy_from_slice(&SYNC_MAGIC);
        bytes[8..16].copy_from_slice(&self.stretch.start.to_le_bytes());
        bytes[16..24].copy_from_slice(&self.stretch.length.to_le_bytes());
        bytes[24..32].copy_from_slice(&self.wall_offset_ns.to_le_bytes());
        bytes[32..36].copy_from_slice(&self.table.to_le_bytes());
        bytes[36..40].copy_from_slice(&self.stretch.crc.to_le_bytes());
        let own = crc32fast::hash(&bytes[..40]);
        bytes[40..].copy_from_slice(&own.to_le_bytes());
        bytes
    }

    /// `None` where the bytes are no sync, or one that was damaged.
    pub(super) fn of_bytes(bytes: &[u8]) -> Option<Self> {
        let bytes: &[u8; SYNC_BODY] = bytes.try_into().ok()?;
        let own = u32::from_le_bytes(bytes[40..].try_into().ok()?);
        if bytes[..8] != SYNC_MAGIC || crc32fast::hash(&bytes[..40]) != own {
            return None;
        }
        Some(Self {
            stretch: Stretch {
                start: u64::from_le_bytes(bytes[8..16].try_into().ok()?),
                length: u64::from_le_bytes(bytes[16..24].try_into().ok()?),
                crc: u32::from_le_bytes(bytes[36..40].try_into().ok()?),
            },
            wall_offset_ns: i64::from_le_bytes(bytes[24..32].try_into().ok()?),
            table: u32::from_le_bytes(bytes[32..36].try_into().ok()?),
        })
    }
}

/// The buffer before the sink, with the running checksum.
#[derive(Debug)]
struct Output {
    sink: Box<dyn Sink>,
    buffer: Vec<u8>,
    /// How much of the buffer is in the checksum: it goes in in one piece, which is many times faster than field by field.
    hashed: usize,
    crc: Crc,
    stretch_start: u64,
    position: u64,
    failed: bool,
}

impl Output {
    fn new(sink: Box<dyn Sink>) -> Self {
        Self {
            sink,
            buffer: Vec::with_capacity(BUFFER_BYTES + 4096),
            hashed: 0,
            crc: Crc::default(),
            stretch_start: 0,
            position: 0,
            failed: false,
        }
    }

    fn take(&mut self, bytes: &[u8]) -> io::Result<()> {
        if self.failed {
            return Err(io::Error::other("an earlier write failed"));
        }
        self.buffer.extend_from_slice(bytes);
        self.position += bytes.len() as u64;
        if self.buffer.len() < BUFFER_BYTES { Ok(()) } else { self.pass_on() }
    }

    fn stretch(&mut self) -> Stretch {
        self.hash();
        let length = self.position - self.stretch_start;
        Stretch { start: self.stretch_start, length, crc: self.crc.value() }
    }

    /// What is in the buffer up to here belongs to the sync before.
    fn begin_stretch(&mut self) {
        self.crc = Crc::default();
        self.hashed = self.buffer.len();
        self.stretch_start = self.position;
    }

    fn sync(&mut self) -> io::Result<()> {
        self.pass_on()?;
        let synced = self.sink.sync();
        self.failed |= synced.is_err();
        synced
    }

    fn pass_on(&mut self) -> io::Result<()> {
        self.hash();
        let written = self.sink.write_all(&self.buffer);
        self.failed |= written.is_err();
        self.buffer.clear();
        self.hashed = 0;
        written
    }

    fn hash(&mut self) {
        self.crc.update(self.buffer.get(self.hashed..).unwrap_or_default());
        self.hashed = self.buffer.len();
    }
}

/// What the MCAP writer writes to: it keeps its own end to itself, so the buffer is shared with it.
#[derive(Debug)]
struct Tap(Arc<Mutex<Output>>);

impl Write for Tap {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take(bytes)?;
        Ok(bytes.len())
    }

    /// Only a sync passes on early.
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
