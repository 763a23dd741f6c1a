//! What the ev3dev drivers do, as state machines without files, threads or clocks.
//!
//! A [`Driver`] is one device of one class: it answers a read of an attribute with text or an error
//! number, and a store with the number of bytes taken or an error number. Time comes as an
//! argument. A tree (the in-process [`Tree`](crate::ev3dev::Tree), a mounted file system) only has
//! to find the driver and pass bytes.
//!
//! Facts are from the drivers of ev3dev's `lego-linux-drivers` (kernel 4.14, "stretch"), restated,
//! and are held against what those drivers answered when they were run
//! (`tests/data/kernel-transcript.txt`).
//!
//! # Not here
//!
//! No numbering, ports or plugging (`sim::brick`), no walls and motors (`sim::physics`).

pub(crate) mod board;
pub(crate) mod bus;
pub(crate) mod dc;
pub(crate) mod input;
pub(crate) mod jiffies;
pub(crate) mod lcd;
pub(crate) mod led;
pub(crate) mod sensor;
pub(crate) mod servo;
pub(crate) mod tacho;
pub(crate) mod text;

use std::fmt::Debug;
use std::io::Write as _;

use nix::errno::Errno;
use rand_chacha::ChaCha8Rng;

use crate::ev3dev::{AttributeSpec, Direction, Legal};

/// What an entry of a folder is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EntryKind {
    /// A file.
    File,
    /// A folder.
    Folder,
    /// A symbolic link.
    Link,
}

/// An entry of a folder, as `lstat` shows it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entry {
    /// Its name.
    pub name: String,
    /// What it is.
    pub kind: EntryKind,
    /// Permission bits, before udev's rules: a file is born `0644`, `0444` or `0200`.
    pub permissions: u32,
    /// Its size in bytes as the kernel gives it, which is not the length of what is read.
    pub size: u64,
}

impl Entry {
    /// A file.
    pub(crate) fn file(spec: &AttributeSpec) -> Self {
        let permissions = match spec.direction {
            Direction::Readable => 0o444,
            Direction::Writeable => 0o200,
            Direction::Readwriteable => 0o644,
        };
        let size = match spec.name {
            "bin_data" => 32,
            "direct" => 255,
            _ => 4096,
        };
        Self { name: spec.name.to_owned(), kind: EntryKind::File, permissions, size }
    }

    /// A folder.
    pub(crate) fn folder(name: &str) -> Self {
        Self { name: name.to_owned(), kind: EntryKind::Folder, permissions: 0o755, size: 0 }
    }

    /// A link.
    pub(crate) fn link(name: &str) -> Self {
        Self { name: name.to_owned(), kind: EntryKind::Link, permissions: 0o777, size: 0 }
    }

    /// `st_mode`: kind and permissions.
    #[must_use]
    pub fn mode(&self) -> u32 {
        let kind = match self.kind {
            EntryKind::File => 0o100_000,
            EntryKind::Folder => 0o040_000,
            EntryKind::Link => 0o120_000,
        };
        kind | self.permissions
    }
}

/// A file that can be read, and that no table of the bindings has. A name may have a folder in it
/// (`power/control`).
pub(crate) const fn readable(name: &'static str) -> AttributeSpec {
    AttributeSpec::readable(name, Legal::Text)
}

/// Such a file that can be written, too.
pub(crate) const fn readwriteable(name: &'static str) -> AttributeSpec {
    AttributeSpec::readwriteable(name, Legal::Text)
}

/// A store that keeps its writer waiting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Wait {
    /// Until then, on the simulation's time.
    pub(crate) until_ns: i64,
    /// What the writer is told after that, if it is not success.
    pub(crate) then: Option<Errno>,
}

/// What a driver answers to a store: done, a wait until it is, or a refusal.
pub(crate) type Took = Result<Option<Wait>, Errno>;

/// What a store may use besides the driver.
#[derive(Debug)]
pub(crate) struct Context<'a> {
    /// Time since the simulation began.
    pub(crate) now_ns: i64,
    /// Chance.
    pub(crate) chance: &'a mut ChaCha8Rng,
}

/// A device's attributes: a class's table as the bindings have it, which is held against what the
/// kernel lists, and the rows that only some devices have.
pub(crate) type Attributes = [&'static [AttributeSpec]; 2];

/// One device.
pub(crate) trait Driver: Debug + Send {
    /// Its attributes, without those that every device has (`uevent`, `power`, `subsystem`,
    /// `device`).
    fn attributes(&self) -> Attributes {
        [&[]; 2]
    }

    /// Appends the text of an attribute to `out`, but for `address` and `driver_name`.
    ///
    /// # Errors
    ///
    /// The driver's; ENODEV for an attribute that has gone.
    fn read(&self, _attribute: &str, _out: &mut Vec<u8>) -> Result<(), Errno> {
        Err(Errno::ENODEV)
    }

    /// Takes what one `write` brought, which is not empty.
    ///
    /// # Errors
    ///
    /// The driver's.
    fn store(&mut self, _attribute: &str, _bytes: &[u8], _context: &mut Context<'_>) -> Took {
        Err(Errno::EIO)
    }

    /// Appends the lines of `uevent` that its identity does not make.
    fn uevent(&self, _out: &mut Vec<u8>) {}
}

/// What a device of LEGO's classes says of itself: the files `driver_name` and `address`.
#[derive(Debug, Clone)]
pub(crate) struct Identity {
    pub(crate) driver_name: &'static str,
    pub(crate) address: String,
}

/// Appends a line.
pub(crate) fn line(out: &mut Vec<u8>, value: impl std::fmt::Display) {
    // Writing to a vector does not fail.
    let _ = writeln!(out, "{value}");
}

/// Appends words as the kernel lists them: one space between, a newline at the end, also of an
/// empty list.
pub(crate) fn list<'a>(out: &mut Vec<u8>, words: impl IntoIterator<Item = &'a str>) {
    for (index, word) in words.into_iter().enumerate() {
        if index > 0 {
            out.push(b' ');
        }
        out.extend_from_slice(word.as_bytes());
    }
    out.push(b'\n');
}

/// Appends the two lines that every device on a port has in its `uevent`.
pub(crate) fn lego_uevent(out: &mut Vec<u8>, Identity { driver_name, address }: &Identity) {
    line(out, format_args!("LEGO_DRIVER_NAME={driver_name}\nLEGO_ADDRESS={address}"));
}

/// The low 32 bits: what the kernel's `int` makes of a result that does not fit.
#[expect(clippy::cast_possible_truncation, reason = "the driver's arithmetic wraps")]
pub(crate) fn wrap(value: i64) -> i32 {
    value as i32
}
