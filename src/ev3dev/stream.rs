//! Devices that are streams of the kernel's input events: buttons and the speaker.
//!
//! An event is the kernel's `struct input_event`, as this machine has it: two C longs of time,
//! type, code, value. On the brick that is 16 bytes.

use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::sync::Arc;

use evdev::EventType;
use nix::errno::Errno;

use super::error::{Cause, DeviceError};
use super::node::Node;
use super::tree::{Access, AttributeFile, Tree, errno};

/// Bytes of the time before an event's type.
const TIME_SIZE: usize = 2 * size_of::<std::ffi::c_long>();

/// Bytes of an event.
pub(crate) const EVENT_SIZE: usize = TIME_SIZE + 8;

/// What an event says, without its time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Event {
    pub(crate) kind: EventType,
    pub(crate) code: u16,
    pub(crate) value: i32,
}

impl Event {
    pub(crate) fn parse(bytes: &[u8]) -> Option<Self> {
        let (head, value) = bytes.get(TIME_SIZE..EVENT_SIZE)?.split_at_checked(4)?;
        let (kind, code) = head.split_at_checked(2)?;
        Some(Self {
            kind: EventType(u16::from_ne_bytes(kind.try_into().ok()?)),
            code: u16::from_ne_bytes(code.try_into().ok()?),
            value: i32::from_ne_bytes(value.try_into().ok()?),
        })
    }

    /// The event with no time, as it is written: the kernel puts its own.
    pub(crate) fn to_bytes(self) -> [u8; EVENT_SIZE] {
        let mut bytes = [0; EVENT_SIZE];
        bytes[TIME_SIZE..TIME_SIZE + 2].copy_from_slice(&self.kind.0.to_ne_bytes());
        bytes[TIME_SIZE + 2..TIME_SIZE + 4].copy_from_slice(&self.code.to_ne_bytes());
        bytes[TIME_SIZE + 4..].copy_from_slice(&self.value.to_ne_bytes());
        bytes
    }
}

/// An open stream, that never blocks.
#[derive(Debug)]
pub(crate) enum Stream {
    /// A file of this machine, read and written in sequence.
    Local(File),
    /// A simulation's.
    Other(Box<dyn AttributeFile>),
}

impl Stream {
    pub(crate) fn open(
        tree: &Arc<dyn Tree>,
        path: &str,
        access: Access,
    ) -> Result<Self, DeviceError> {
        let opened = match tree.local_path(path) {
            Some(local) => OpenOptions::new()
                .read(access != Access::Write)
                .write(access != Access::Read)
                .custom_flags(nix::libc::O_NONBLOCK | nix::libc::O_NOCTTY)
                .open(local)
                .map(Self::Local)
                .map_err(errno),
            None => tree.open(path, access).map(Self::Other),
        };
        opened.map_err(|errno| {
            let cause =
                if errno == Errno::ENOENT { Cause::Absent(errno) } else { Cause::Other(errno) };
            failure(&Node::new(tree, path, None), cause)
        })
    }

    /// What is pending, with one system call; nothing is 0 bytes.
    pub(crate) fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Errno> {
        let read = match self {
            Self::Local(file) => file.read(buffer).map_err(errno),
            Self::Other(file) => file.read(buffer),
        };
        match read {
            Err(Errno::EAGAIN | Errno::EINTR) => Ok(0),
            other => other,
        }
    }

    pub(crate) fn write(&mut self, bytes: &[u8]) -> Result<usize, Errno> {
        match self {
            Self::Local(file) => file.write(bytes).map_err(errno),
            Self::Other(file) => file.write(bytes),
        }
    }
}

/// What a board does not have.
pub(crate) fn not_built_in(tree: &Arc<dyn Tree>, what: &str) -> DeviceError {
    failure(&Node::new(tree, what, None), Cause::Absent(Errno::ENODEV))
}

pub(crate) fn failure(node: &Node, cause: Cause) -> DeviceError {
    node.error("events", None, cause)
}

pub(crate) fn io_cause(errno: Errno) -> Cause {
    if errno == Errno::ENODEV { Cause::Gone(errno) } else { Cause::Other(errno) }
}
