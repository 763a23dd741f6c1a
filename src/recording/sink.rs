//! Where a recording's bytes go, and which process is writing one.
//!
//! The process that records holds a lock on its file (`fcntl`, whole file, for writing), which the
//! kernel takes back however the process ends. So a service that was started again learns from the
//! file whether its run is still driving, and in which process.
//!
//! # What we count on
//!
//! - Such a lock belongs to a process and ends when that process closes *any* handle on the file:
//!   the process that records opens it once.
//! - A file system without locks makes a run that is going on look like one that was cut; nothing
//!   else depends on it.

use std::fmt::Debug;
use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::os::fd::AsFd;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use nix::fcntl::{FcntlArg, fcntl};
use nix::libc;
use nix::sys::memfd::{MFdFlags, memfd_create};
use nix::sys::statvfs::statvfs;

use crate::document::if_there;

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

    /// An empty file to read and write, which is gone when it is closed: in memory, where there is
    /// no better place.
    ///
    /// # Errors
    ///
    /// What the file system says.
    fn scratch(&self) -> io::Result<File> {
        memory_file()
    }
}

/// The file of a recording on a disk.
#[derive(Debug)]
pub struct DiskFile {
    file: File,
    folder: PathBuf,
}

impl Sink for DiskFile {
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.file.write_all(bytes)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.file.sync_data()
    }

    /// A file without a name in the same folder, where the file system has such files.
    fn scratch(&self) -> io::Result<File> {
        let mut options = OpenOptions::new();
        options.read(true).write(true).custom_flags(libc::O_TMPFILE);
        options.open(&self.folder).or_else(|_| memory_file())
    }
}

fn memory_file() -> io::Result<File> {
    Ok(File::from(memfd_create("indexes", MFdFlags::MFD_CLOEXEC)?))
}

/// Creates the file of a recording, empty, and makes its name survive a loss of power. While the
/// file is open, [`writer`] names this process.
///
/// # Errors
///
/// What the file system says; that there is one already, which stays as it is.
pub fn create(path: &Path) -> io::Result<DiskFile> {
    let file = File::create_new(path)?;
    // A file system without locks still takes a recording.
    let _ = hold(&file);
    let folder = match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    File::open(folder)?.sync_all()?;
    Ok(DiskFile { file, folder: folder.to_owned() })
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

/// Marks a file as being written by this process, until it is closed.
fn hold(file: &File) -> io::Result<()> {
    fcntl(file.as_fd(), FcntlArg::F_SETLK(&whole_file(libc::F_WRLCK)?))?;
    Ok(())
}

/// The process that is writing a recording, if one is.
///
/// # Errors
///
/// What the file system says; no process writes a file that does not exist.
pub fn writer(path: &Path) -> io::Result<Option<i32>> {
    let Some(file) = if_there(File::open(path))? else { return Ok(None) };
    let mut lock = whole_file(libc::F_RDLCK)?;
    fcntl(file.as_fd(), FcntlArg::F_GETLK(&mut lock))?;
    Ok((i32::from(lock.l_type) != libc::F_UNLCK).then_some(lock.l_pid))
}

/// How many bytes a folder's disk has free for us.
///
/// # Errors
///
/// What the kernel answers.
#[allow(
    clippy::useless_conversion,
    reason = "the kernel's numbers have 32 bits on the brick and 64 on a PC"
)]
pub(crate) fn free_bytes(folder: &Path) -> nix::Result<u64> {
    let disk = statvfs(folder)?;
    Ok(u64::from(disk.blocks_available()).saturating_mul(u64::from(disk.fragment_size())))
}

/// From the first byte to wherever the end will be.
fn whole_file(kind: i32) -> io::Result<libc::flock> {
    let small = |number: i32| {
        i16::try_from(number).map_err(|_| io::Error::from(io::ErrorKind::InvalidInput))
    };
    Ok(libc::flock {
        l_type: small(kind)?,
        l_whence: small(libc::SEEK_SET)?,
        l_start: 0,
        l_len: 0,
        l_pid: 0,
    })
}
