//! The store's files.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use nix::fcntl::{Flock, FlockArg};
use nix::sys::statvfs::{FsFlags, statvfs};
use nix::unistd::{AccessFlags, access};

use super::{Record, StoreError};
use crate::document::{if_there, read_bounded};
use crate::protocol::RunId;
use crate::recording::free_bytes;

/// What the service knows of a run.
const RECORD: &str = "run.json";

/// Identifiers of runs that are gone.
const DELETED: &str = "deleted";

/// Held by the service that keeps the folder.
const LOCK: &str = "service.lock";

/// How many of the deleted runs are remembered: the file is read at each start.
const REMEMBERED: usize = 10_000;

/// Makes the folder and takes its lock.
pub(super) fn keep(folder: &Path) -> Result<Flock<File>, StoreError> {
    std::fs::create_dir_all(folder).map_err(failed("make", folder))?;
    let path = folder.join(LOCK);
    let file = OpenOptions::new().create(true).truncate(false).write(true).open(&path);
    match Flock::lock(file.map_err(failed("write", &path))?, FlockArg::LockExclusiveNonblock) {
        Ok(lock) => Ok(lock),
        Err((_, nix::errno::Errno::EWOULDBLOCK)) => Err(StoreError::Kept(folder.to_owned())),
        Err((_, errno)) => Err(failed("lock", &path)(errno.into())),
    }
}

/// Whether the folder could be written to.
pub(super) fn look(folder: &Path) -> Result<(), StoreError> {
    access(folder, AccessFlags::W_OK | AccessFlags::X_OK)
        .map_err(|errno| failed("write to", folder)(errno.into()))?;
    let disk = statvfs(folder).map_err(|errno| failed("look at", folder)(errno.into()))?;
    if disk.flags().contains(FsFlags::ST_RDONLY) {
        return Err(failed("write to", folder)(nix::errno::Errno::EROFS.into()));
    }
    Ok(())
}

/// Bytes that are free for us; 0 if that is not known.
pub(super) fn free(folder: &Path) -> u64 {
    free_bytes(folder).unwrap_or(0)
}

/// Makes a run's folder, which must not be there.
pub(super) fn make_folder(folder: &Path) -> Result<(), StoreError> {
    std::fs::create_dir(folder).map_err(failed("make", folder))
}

/// Removes a run's folder, the recording first. What cannot be removed is removed at the next
/// start.
pub(super) fn remove(folder: &Path) {
    if let Err(error) = if_there(std::fs::remove_file(folder.join(super::RECORDING))) {
        log::warn!("cannot delete {}: {error}", folder.display());
    }
    if let Err(error) = std::fs::remove_dir_all(folder) {
        log::warn!("cannot delete {}: {error}", folder.display());
    }
}

/// The length of a file; 0 if it does not exist.
pub(super) fn length(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |metadata| metadata.len())
}

/// Replaces a run's record in one piece; `synced` waits until it is on the disk.
pub(super) fn write(folder: &Path, record: &Record, synced: bool) -> Result<(), StoreError> {
    let path = folder.join(RECORD);
    let written = serde_json::to_vec(record).map_err(io::Error::from);
    written.and_then(|bytes| replace_file(&path, &bytes, synced)).map_err(failed("write", &path))
}

/// Replaces a file in one piece.
pub(in crate::service) fn replace_file(path: &Path, bytes: &[u8], synced: bool) -> io::Result<()> {
    let fresh = path.with_extension("new");
    let written = File::create(&fresh).and_then(|mut file| {
        file.write_all(bytes)?;
        if synced { file.sync_all() } else { Ok(()) }
    });
    written.and_then(|()| std::fs::rename(&fresh, path)).inspect_err(|_| {
        // An incomplete file is useless.
        let _ = std::fs::remove_file(&fresh);
    })
}

/// Reads a run's record.
pub(super) fn read(folder: &Path) -> Result<Record, StoreError> {
    let path = folder.join(RECORD);
    let bytes = read_bounded(&path).map_err(failed("read", &path))?;
    serde_json::from_slice(&bytes).map_err(|error| failed("understand", &path)(error.into()))
}

/// The folders that could be runs.
pub(super) fn folders(folder: &Path) -> Vec<RunId> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let is_folder = |entry: &std::fs::DirEntry| entry.file_type().is_ok_and(|kind| kind.is_dir());
    let names = entries.flatten().filter(is_folder).map(|entry| entry.file_name());
    let mut runs: Vec<RunId> = names.filter_map(|name| RunId::new(name.to_str()?).ok()).collect();
    runs.sort();
    runs
}

/// The runs that are gone, with their numbers.
pub(super) fn deleted(folder: &Path) -> Vec<(RunId, u64)> {
    let Ok(bytes) = std::fs::read(folder.join(DELETED)) else { return Vec::new() };
    // A line that a power cut or a bad block has spoilt costs that line.
    let text = String::from_utf8_lossy(&bytes);
    let line = |line: &str| {
        let (run, number) = line.split_once(' ')?;
        Some((RunId::new(run).ok()?, number.parse().ok()?))
    };
    let mut runs: Vec<(RunId, u64)> = text.lines().filter_map(line).collect();
    if runs.len() > REMEMBERED {
        runs.drain(..runs.len() - REMEMBERED);
        let text: String = runs.iter().map(|(run, number)| format!("{run} {number}\n")).collect();
        // A folder that cannot be written to keeps its longer list.
        let _ = replace_file(&folder.join(DELETED), text.as_bytes(), false);
    }
    runs
}

/// Notes that a run is gone.
pub(super) fn remember_deleted(folder: &Path, run: &RunId, number: u64) -> Result<(), StoreError> {
    let path = folder.join(DELETED);
    let file = OpenOptions::new().create(true).append(true).open(&path);
    file.and_then(|mut file| file.write_all(format!("{run} {number}\n").as_bytes()))
        .map_err(failed("write", &path))
}

fn failed(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> StoreError + use<> {
    let path: PathBuf = path.to_owned();
    move |source| StoreError::Disk { doing, path, source }
}
