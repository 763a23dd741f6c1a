//! One open file, and what its reads, writes and polls do.

use std::fs;

use fuser::{PollEvents, PollNotifier, ReplyData};
use nix::errno::Errno;

use super::events;
use super::files::refusal;
use crate::sim::files::{Kind, SimFile, Write};

/// An open file or folder.
#[derive(Debug)]
pub(super) enum Handle {
    /// A folder as it was when it was opened, so that a listing in several pieces is one listing.
    Folder(Vec<Listed>),
    /// A file, with what was read of it last, and those who wait for an event.
    File { file: SimFile, bytes: Vec<u8>, readers: Vec<Reader>, poller: Option<PollNotifier> },
}

/// An entry of a listing.
#[derive(Debug)]
pub(super) struct Listed {
    pub(super) number: u64,
    pub(super) kind: fuser::FileType,
    pub(super) name: String,
}

/// A thread that waits for an event.
#[derive(Debug)]
pub(super) struct Reader {
    reply: ReplyData,
    room: usize,
    thread: u32,
}

/// One `read`, as the kernel asks for it.
#[derive(Debug)]
pub(super) struct Read {
    pub(super) offset: u64,
    pub(super) room: usize,
    /// It may wait.
    pub(super) blocks: bool,
    /// Who asks; 0 where that is hidden from us.
    pub(super) thread: u32,
}

impl Handle {
    /// Answers a read, or keeps the reader waiting; true if it waits.
    pub(super) fn read(&mut self, read: &Read, reply: ReplyData) -> bool {
        let Self::File { file, bytes, readers, .. } = self else {
            reply.error(refusal(Errno::EISDIR));
            return false;
        };
        match file.read_at(place(read.offset), read.room, bytes) {
            Ok(part) => reply.data(part),
            Err(Errno::EAGAIN) if read.blocks && matches!(file.kind, Kind::Events { .. }) => {
                readers.push(Reader { reply, room: read.room, thread: read.thread });
                return true;
            }
            Err(errno) => reply.error(refusal(errno)),
        }
        false
    }

    /// Takes what one `write` brought.
    ///
    /// # Errors
    ///
    /// The device's.
    pub(super) fn write(&mut self, offset: u64, bytes: &[u8]) -> Result<Write, Errno> {
        match self {
            Self::Folder(_) => Err(Errno::EISDIR),
            Self::File { file, .. } => file.begin_write(place(offset), bytes),
        }
    }

    /// What a poll says that begins now; `poller` is kept until there is more to say.
    pub(super) fn poll(&mut self, keep: Option<PollNotifier>) -> PollEvents {
        let readable = PollEvents::POLLIN | PollEvents::POLLRDNORM;
        let writeable = PollEvents::POLLOUT | PollEvents::POLLWRNORM;
        let Self::File { file, poller, .. } = self else { return readable | writeable };
        *poller = keep.or(poller.take());
        let mut events = writeable;
        if file.is_readable() {
            events |= readable;
        }
        if file.is_changed() {
            events |= PollEvents::POLLPRI | PollEvents::POLLERR;
        }
        events
    }

    /// Answers an ioctl: its result, and the bytes for the caller.
    ///
    /// # Errors
    ///
    /// ENOTTY for what is no input device.
    pub(super) fn ioctl(&self, command: u32, room: usize) -> Result<(i32, Vec<u8>), Errno> {
        match self {
            Self::Folder(_) => Err(Errno::ENOTTY),
            Self::File { file, .. } => events::ioctl(file, command, room),
        }
    }

    /// Wakes the waiter if there is something to be woken for, or, with `interrupts`, if it was
    /// interrupted; false if it waits no more.
    pub(super) fn wake(&mut self, interrupts: bool) -> bool {
        let Self::File { file, bytes, readers, poller } = self else { return false };
        if let Some(poller) = poller.take_if(|_| file.wakes()) {
            // It fails if the file was closed meanwhile, and then no thread waits.
            let _ = poller.notify();
        }
        let waiting = std::mem::take(readers);
        *readers = waiting
            .into_iter()
            .filter_map(|reader| answer(reader, file, bytes, interrupts))
            .collect();
        poller.is_some() || !readers.is_empty()
    }

    /// Sends those who wait away: the simulation ends.
    pub(super) fn release_readers(&mut self) {
        if let Self::File { readers, .. } = self {
            for reader in readers.drain(..) {
                reader.reply.error(refusal(Errno::ENODEV));
            }
        }
    }
}

fn place(offset: u64) -> usize {
    usize::try_from(offset).unwrap_or(usize::MAX)
}

/// Answers a reader who waits, if there is an answer; else gives it back.
fn answer(reader: Reader, file: &SimFile, bytes: &mut Vec<u8>, interrupts: bool) -> Option<Reader> {
    match file.read_at(0, reader.room, bytes) {
        Ok(part) => reader.reply.data(part),
        Err(Errno::EAGAIN) if interrupts && is_interrupted(reader.thread) => {
            reader.reply.error(refusal(Errno::EINTR));
        }
        Err(Errno::EAGAIN) => return Some(reader),
        Err(errno) => reader.reply.error(refusal(errno)),
    }
    None
}

/// True if a thread has a signal to take, or is gone.
///
/// The kernel would report it by FUSE_INTERRUPT, but `fuser` does not pass that on, and a killed
/// process cannot die before its read is answered.
fn is_interrupted(thread: u32) -> bool {
    if thread == 0 {
        // In another namespace: we cannot see its signals.
        return false;
    }
    let Ok(status) = fs::read_to_string(format!("/proc/{thread}/status")) else { return true };
    let mask = |key: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(key))?;
        u64::from_str_radix(line.trim(), 16).ok()
    };
    let pending = mask("SigPnd:").unwrap_or_default() | mask("ShdPnd:").unwrap_or_default();
    pending & !mask("SigBlk:").unwrap_or_default() != 0
}
