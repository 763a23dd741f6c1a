//! Where attribute files are: the machine's own file system below some root, or a simulated brick.
//!
//! This is the seed's abstract node. Motors and sensors know only a [`Tree`] and the
//! [`AttributeFile`]s it opens, so the same bindings drive a real brick, a mounted simulation and
//! the simulation inside this process.
//!
//! # What we count on
//!
//! - A read at offset 0 makes the driver produce the text again; a write is one complete store, its
//!   offset ignored.
//! - A kept file of a device that is gone answers ENODEV, and its path ENOENT.
//! - Plain files are not sysfs: a short value leaves the tail of a longer one. [`LocalTree`]
//!   therefore ends what it writes with a newline, and readers look at the first line only; one
//!   code path serves both.

use std::fmt::Debug;
use std::fs::{File, OpenOptions};
use std::os::fd::AsFd;
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::Duration;

use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use serde::{Deserialize, Serialize};

use super::platform::{PLATFORMS, Platform};

/// What a file is opened for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// Reading only.
    Read,
    /// Writing only.
    Write,
    /// Both.
    ReadWrite,
}

/// The files below a brick's root. Paths are relative to it:
/// `sys/class/tacho-motor/motor0/position`.
pub trait Tree: Debug + Send + Sync {
    /// The names in a folder, in no particular order.
    ///
    /// # Errors
    ///
    /// ENOENT where there is no such folder: on a brick without a device of that class the class's
    /// folder may be missing.
    fn list(&self, folder: &str) -> Result<Vec<String>, Errno>;

    /// Opens a file, to be kept.
    ///
    /// # Errors
    ///
    /// ENOENT, EACCES (wrong direction; also in the first moments after a device was plugged in),
    /// and what else the kernel says.
    fn open(&self, path: &str, access: Access) -> Result<Box<dyn AttributeFile>, Errno>;

    /// Where the tree is, for messages: the root's path, or a name for a simulation.
    fn root(&self) -> &Path;

    /// A file's path on this machine, for devices that are streams of events and no attributes
    /// (buttons, speaker): those are read and written in sequence. A tree that is not in the file
    /// system says `None`, and is then asked to [`Tree::open`] them, each `read` taking the events
    /// that are pending.
    fn local_path(&self, _path: &str) -> Option<PathBuf> {
        None
    }
}

/// An open attribute: each call is one system call, and none allocates.
pub trait AttributeFile: Debug + Send {
    /// Reads the attribute from offset 0; returns how many bytes there are.
    ///
    /// # Errors
    ///
    /// What the driver answers; ENODEV once its device is gone.
    fn read(&self, buffer: &mut [u8]) -> Result<usize, Errno>;

    /// Stores a value, all of it at once; returns how many bytes were taken.
    ///
    /// # Errors
    ///
    /// What the driver answers: EINVAL, ERANGE, EOPNOTSUPP, ENODEV and others.
    fn write(&self, value: &[u8]) -> Result<usize, Errno>;

    /// Waits until the driver says that the attribute has changed since the last
    /// [`AttributeFile::read`] (POLLPRI), or until `timeout` is over; true if it has. Only `state`
    /// of tacho motors and `value0` of touch sensors ever say so.
    ///
    /// # Errors
    ///
    /// What `poll` answers.
    fn wait_changed(&self, timeout: Duration) -> Result<bool, Errno>;
}

/// The machine's own file system below a root: `/` on the brick, a mount point or a folder of plain
/// files elsewhere.
///
/// Two files may be somewhere else: those that a bench, another keyboard or another board has under
/// another name.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct LocalTree {
    root: PathBuf,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    buttons: Option<PathBuf>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    speaker: Option<PathBuf>,
}

impl LocalTree {
    /// The tree below `root`.
    pub fn new(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into(), buttons: None, speaker: None }
    }

    /// With another file in the place of the board's buttons, if one is given; a relative path is
    /// below the working folder.
    #[must_use]
    pub fn with_buttons(self, buttons: Option<PathBuf>) -> Self {
        Self { buttons, ..self }
    }

    /// With another file in the place of the board's speaker, if one is given; a relative path is
    /// below the working folder.
    #[must_use]
    pub fn with_speaker(self, speaker: Option<PathBuf>) -> Self {
        Self { speaker, ..self }
    }

    /// Whether this is a brick's own tree, where a person is near and motors are real.
    #[must_use]
    pub fn is_machine(&self) -> bool {
        self.root == Path::new("/")
    }

    fn path(&self, path: &str) -> PathBuf {
        let is = |device: fn(&Platform) -> Option<&'static str>| {
            PLATFORMS.into_iter().any(|platform| device(platform) == Some(path))
        };
        let elsewhere = if is(|platform| platform.buttons) {
            self.buttons.as_ref()
        } else if is(|platform| platform.speaker) {
            self.speaker.as_ref()
        } else {
            None
        };
        elsewhere.cloned().unwrap_or_else(|| self.root.join(path))
    }
}

impl Tree for LocalTree {
    fn list(&self, folder: &str) -> Result<Vec<String>, Errno> {
        let entries = std::fs::read_dir(self.root.join(folder)).map_err(errno)?;
        entries
            .map(|entry| {
                entry.map(|entry| entry.file_name().to_string_lossy().into_owned()).map_err(errno)
            })
            .collect()
    }

    fn open(&self, path: &str, access: Access) -> Result<Box<dyn AttributeFile>, Errno> {
        let file = OpenOptions::new()
            .read(access != Access::Write)
            .write(access != Access::Read)
            // A program that we start must not inherit a motor; a device node must not block or
            // become our terminal.
            .custom_flags(nix::libc::O_CLOEXEC | nix::libc::O_NONBLOCK | nix::libc::O_NOCTTY)
            .open(self.path(path))
            .map_err(errno)?;
        Ok(Box::new(LocalFile { file }))
    }

    fn root(&self) -> &Path {
        &self.root
    }

    fn local_path(&self, path: &str) -> Option<PathBuf> {
        Some(self.path(path))
    }
}

#[derive(Debug)]
struct LocalFile {
    file: File,
}

impl AttributeFile for LocalFile {
    fn read(&self, buffer: &mut [u8]) -> Result<usize, Errno> {
        self.file.read_at(buffer, 0).map_err(errno)
    }

    fn write(&self, value: &[u8]) -> Result<usize, Errno> {
        self.file.write_at(value, 0).map_err(errno)
    }

    fn wait_changed(&self, timeout: Duration) -> Result<bool, Errno> {
        let mut watched = [PollFd::new(self.file.as_fd(), PollFlags::POLLPRI)];
        let timeout = PollTimeout::try_from(timeout).unwrap_or(PollTimeout::MAX);
        poll(&mut watched, timeout)?;
        Ok(watched[0].revents().is_some_and(|events| events.contains(PollFlags::POLLPRI)))
    }
}

pub(super) fn errno(error: std::io::Error) -> Errno {
    error.raw_os_error().map_or(Errno::EIO, Errno::from_raw)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ev3dev::EV3;

    #[test]
    fn a_kept_file_is_read_anew_each_time_and_written_whole() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("position"), "100\n").unwrap();
        let tree = LocalTree::new(folder.path());
        let (reader, writer) = (
            tree.open("position", Access::Read).unwrap(),
            tree.open("position", Access::Write).unwrap(),
        );
        let mut buffer = [0; 8];
        assert_eq!(reader.read(&mut buffer), Ok(4));
        assert_eq!(writer.write(b"7\n"), Ok(2));
        let length = reader.read(&mut buffer).unwrap();
        assert_eq!(buffer[..length].split(|&byte| byte == b'\n').next(), Some(b"7".as_slice()));
        assert_eq!(
            reader.wait_changed(Duration::ZERO),
            Ok(false),
            "a plain file never says that it changed"
        );
    }

    #[test]
    fn what_is_not_there_is_said_by_its_number() {
        let folder = tempfile::tempdir().unwrap();
        let tree = LocalTree::new(folder.path());
        assert_eq!(tree.list("sys/class/tacho-motor").unwrap_err(), Errno::ENOENT);
        assert_eq!(tree.open("sys/class", Access::Read).unwrap_err(), Errno::ENOENT);
        assert_eq!(tree.local_path("dev/input").unwrap(), folder.path().join("dev/input"));
    }

    #[test]
    fn buttons_and_speaker_may_be_elsewhere() {
        let [buttons, speaker] = [EV3.buttons.unwrap(), EV3.speaker.unwrap()];
        let tree = LocalTree::new("/mnt")
            .with_buttons(Some("/dev/input/event3".into()))
            .with_speaker(Some("beeps".into()));
        assert_eq!(tree.local_path(buttons).unwrap(), Path::new("/dev/input/event3"));
        assert_eq!(tree.local_path(speaker).unwrap(), Path::new("beeps"));
        assert_eq!(tree.local_path("dev/fb0").unwrap(), Path::new("/mnt/dev/fb0"));
        let plain = tree.with_buttons(None).with_speaker(None);
        assert_eq!(plain.local_path(buttons).unwrap(), Path::new("/mnt").join(buttons));
        assert_eq!(plain, LocalTree::new("/mnt"));
    }

    #[test]
    fn a_file_opened_for_reading_is_not_written() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("speed"), "0\n").unwrap();
        let file = LocalTree::new(folder.path()).open("speed", Access::Read).unwrap();
        assert_eq!(file.write(b"1\n"), Err(Errno::EBADF));
    }
}
