//! One open file, and what its reads, writes and polls do.

use std::fs;
use std::sync::Arc;

use fuser::{PollEvents, PollNotifier, ReplyData};
use nix::errno::Errno;

use super::files::refusal;
use super::{SimBrick, events};
use crate::ev3dev::AttributeFile;
use crate::sim::files::{SimFile, StreamFile, ToldFile, Write};

/// An open file or folder.
#[derive(Debug)]
pub(super) enum Handle {
    /// A folder as it was when it was opened, so that a listing in several pieces is one listing.
    Folder(Vec<Listed>),
    /// An attribute, with the text that was made when its beginning was last read.
    Attribute { file: SimFile, text: Vec<u8>, poller: Option<PollNotifier> },
    /// Input events, with those who wait for one.
    Events { file: StreamFile, bytes: Vec<u8>, readers: Vec<Reader>, poller: Option<PollNotifier> },
    /// The screen's memory.
    Screen(Arc<SimBrick>),
    /// What tells of the robot, with the text that was made when its beginning was last read.
    Told { file: ToldFile, text: Vec<u8> },
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
        let offset = usize::try_from(read.offset).unwrap_or(usize::MAX);
        match self {
            Self::Folder(_) => reply.error(refusal(Errno::EISDIR)),
            Self::Attribute { file, text, .. } => match attribute(file, text, offset, read.room) {
                Ok(bytes) => reply.data(bytes),
                Err(errno) => reply.error(refusal(errno)),
            },
            Self::Events { file, bytes, readers, .. } => match file.read_into(read.room, bytes) {
                Ok(()) => reply.data(bytes),
                Err(Errno::EAGAIN) if read.blocks => {
                    readers.push(Reader { reply, room: read.room, thread: read.thread });
                    return true;
                }
                Err(errno) => reply.error(refusal(errno)),
            },
            Self::Screen(brick) => match brick.picture(offset, read.room) {
                Ok(bytes) => reply.data(&bytes),
                Err(errno) => reply.error(refusal(errno)),
            },
            Self::Told { file, text } => match told(file, text, offset, read.room) {
                Ok(bytes) => reply.data(bytes),
                Err(errno) => reply.error(refusal(errno)),
            },
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
            Self::Attribute { file, .. } => file.begin_write(offset, bytes),
            Self::Events { file, .. } => file.write(bytes).map(Write::Done),
            Self::Told { file, .. } => file.order(bytes).map(Write::Done),
            Self::Screen(brick) => {
                brick.draw(usize::try_from(offset).unwrap_or(usize::MAX), bytes).map(Write::Done)
            }
        }
    }

    /// What a poll says that begins now; `poller` is kept until there is more to say.
    pub(super) fn poll(&mut self, keep: Option<PollNotifier>) -> PollEvents {
        let readable = PollEvents::POLLIN | PollEvents::POLLRDNORM;
        let writeable = PollEvents::POLLOUT | PollEvents::POLLWRNORM;
        match self {
            Self::Folder(_) | Self::Screen(_) | Self::Told { .. } => readable | writeable,
            Self::Attribute { file, poller, .. } => {
                *poller = keep.or(poller.take());
                let changed = PollEvents::POLLPRI | PollEvents::POLLERR;
                readable | writeable | if file.is_changed() { changed } else { PollEvents::empty() }
            }
            Self::Events { file, poller, .. } => {
                *poller = keep.or(poller.take());
                writeable | if file.is_pending() { readable } else { PollEvents::empty() }
            }
        }
    }

    /// Answers an ioctl: its result, and the bytes for the caller.
    ///
    /// # Errors
    ///
    /// ENOTTY for what is no input device.
    pub(super) fn ioctl(&self, command: u32, room: usize) -> Result<(i32, Vec<u8>), Errno> {
        match self {
            Self::Events { file, .. } => events::ioctl(file, command, room),
            _ => Err(Errno::ENOTTY),
        }
    }

    /// Wakes the waiter if there is something to be woken for, or, with `interrupts`, if it was
    /// interrupted; false if it waits no more.
    pub(super) fn wake(&mut self, interrupts: bool) -> bool {
        match self {
            Self::Folder(_) | Self::Screen(_) | Self::Told { .. } => false,
            Self::Attribute { file, poller, .. } => {
                if file.wakes() {
                    notify(poller);
                }
                poller.is_some()
            }
            Self::Events { file, bytes, readers, poller } => {
                if file.is_pending() {
                    notify(poller);
                }
                let waiting = std::mem::take(readers);
                *readers = waiting
                    .into_iter()
                    .filter_map(|reader| answer(reader, file, bytes, interrupts))
                    .collect();
                poller.is_some() || !readers.is_empty()
            }
        }
    }

    /// Sends those who wait away: the simulation ends.
    pub(super) fn release_readers(&mut self) {
        if let Self::Events { readers, .. } = self {
            for reader in readers.drain(..) {
                reader.reply.error(refusal(Errno::ENODEV));
            }
        }
    }
}

/// A part of an attribute: the text is made when its beginning is read, as sysfs does it; raw bytes
/// with every read.
fn attribute<'t>(
    file: &SimFile,
    text: &'t mut Vec<u8>,
    offset: usize,
    room: usize,
) -> Result<&'t [u8], Errno> {
    if offset == 0 || text.is_empty() || file.is_binary() {
        file.read_into(text)?;
    } else if file.is_gone() {
        return Err(Errno::ENODEV);
    }
    Ok(part(text, offset, room))
}

/// A part of what is told, which is found out when its beginning is read.
fn told<'t>(
    file: &ToldFile,
    text: &'t mut Vec<u8>,
    offset: usize,
    room: usize,
) -> Result<&'t [u8], Errno> {
    if offset == 0 || text.is_empty() {
        file.read_into(text)?;
    }
    Ok(part(text, offset, room))
}

fn part(text: &[u8], offset: usize, room: usize) -> &[u8] {
    let rest = text.get(offset..).unwrap_or_default();
    rest.get(..room).unwrap_or(rest)
}

fn notify(poller: &mut Option<PollNotifier>) {
    if let Some(poller) = poller.take() {
        // It fails if the file was closed meanwhile, and then no thread waits.
        let _ = poller.notify();
    }
}

/// Answers a reader who waits, if there is an answer; else gives it back.
fn answer(
    reader: Reader,
    file: &StreamFile,
    bytes: &mut Vec<u8>,
    interrupts: bool,
) -> Option<Reader> {
    match file.read_into(reader.room, bytes) {
        Ok(()) => reader.reply.data(bytes),
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
