//! A recording seen from outside, without reading all of it: who is writing it, and how it ended.
//!
//! The process that records holds a lock on its file (`fcntl`, whole file, for writing), which the kernel takes back however the
//! process ends. So a service that was started anew learns from the file whether its run is going on, and in which process.
//!
//! # What we count on
//!
//! - Such a lock belongs to a process and ends when that process closes *any* handle on the file: the process that records opens it once.
//! - A file system without locks makes a run that is going on look like one that was cut; nothing else depends on it.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::os::fd::AsFd;
use std::os::unix::fs::FileExt;
use std::path::Path;

use mcap::records::op;
use nix::fcntl::{FcntlArg, fcntl};
use nix::libc;

use super::Ending;
use super::record::{self, FRAME_BYTES, frame};
use super::run::{ending, names};

/// What a whole file ends with, bytes: the footer and the magic (mcap.dev/spec).
const END_BYTES: u64 = (FRAME_BYTES + 20 + mcap::MAGIC.len()) as u64;

/// No summary is longer, bytes, and no record of an ending: most of it are definitions of messages, some ten thousand.
const LONGEST_PART: u64 = 1 << 20;

/// Marks a file as being written by this process, until it is closed.
pub(super) fn hold(file: &File) -> io::Result<()> {
    fcntl(file.as_fd(), FcntlArg::F_SETLK(&whole_file(libc::F_WRLCK)?))?;
    Ok(())
}

/// The process that is writing a recording, if one is.
///
/// # Errors
///
/// What the file system says; a file that is not there is written by nobody.
pub fn writer(path: &Path) -> io::Result<Option<i32>> {
    let file = match File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error),
    };
    let mut lock = whole_file(libc::F_RDLCK)?;
    fcntl(file.as_fd(), FcntlArg::F_GETLK(&mut lock))?;
    Ok((i32::from(lock.l_type) != libc::F_UNLCK).then_some(lock.l_pid))
}

/// How a recording ended; `None` where it was cut or damaged, or is no recording.
///
/// # Errors
///
/// The file cannot be read.
pub fn ending_of(path: &Path) -> io::Result<Option<Ending>> {
    let file = File::open(path)?;
    let Some(summary) = summary(&file)? else { return Ok(None) };
    let Some(place) = ending_in(&summary) else { return Ok(None) };
    let record = part(&file, place)?.unwrap_or_default();
    let metadata = frame(&record, 0).filter(|record| record.opcode == op::METADATA);
    Ok(metadata.and_then(|record| record::metadata(record.body)).map(|metadata| ending(&metadata)))
}

/// The records of a file's summary, if its checksum holds; `None` where there is none, as in a file that was cut.
fn summary(file: &File) -> io::Result<Option<Vec<u8>>> {
    let length = file.metadata()?.len();
    let end = length.saturating_sub(END_BYTES);
    let Some(last) = part(file, end..length)? else { return Ok(None) };
    let Some(footer) = frame(&last, 0).filter(|record| record.opcode == op::FOOTER) else { return Ok(None) };
    let (Some((start @ 1.., crc)), Some(mcap::MAGIC)) =
        (record::footer(footer.body), last.get(footer.next..))
    else {
        return Ok(None);
    };
    let Some(summary) = part(file, start..end)? else { return Ok(None) };
    let mut counted = crc32fast::Hasher::new();
    counted.update(&summary);
    counted.update(last.get(..footer.next - size_of_val(&crc)).unwrap_or_default());
    Ok((counted.finalize() == crc).then_some(summary))
}

/// Where a summary says that the record of the ending lies.
fn ending_in(summary: &[u8]) -> Option<Range<u64>> {
    let mut at = 0;
    while let Some(record) = frame(summary, at) {
        if record.opcode == op::METADATA_INDEX
            && let Some((place, names::ENDING)) = record::metadata_index(record.body)
        {
            return Some(place);
        }
        at = record.next;
    }
    None
}

/// A part of a file; `None` where the file has no such part, or it is longer than any that is looked at.
fn part(file: &File, place: Range<u64>) -> io::Result<Option<Vec<u8>>> {
    let Some(length @ 0..=LONGEST_PART) = place.end.checked_sub(place.start) else { return Ok(None) };
    if place.end > file.metadata()?.len() {
        return Ok(None);
    }
    let mut bytes = vec![0; usize::try_from(length).unwrap_or(0)];
    file.read_exact_at(&mut bytes, place.start)?;
    Ok(Some(bytes))
}

/// From the first byte to wherever the end will be.
fn whole_file(kind: i32) -> io::Result<libc::flock> {
    let small = |number: i32| i16::try_from(number).map_err(|_| io::Error::from(io::ErrorKind::InvalidInput));
    Ok(libc::flock { l_type: small(kind)?, l_whence: small(libc::SEEK_SET)?, l_start: 0, l_len: 0, l_pid: 0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_no_whole_recording_has_no_ending_and_no_writer() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        assert_eq!(writer(&path).unwrap(), None);
        ending_of(&path).unwrap_err();
        for bytes in [&b""[..], b"\x89MCAP0\r\n", &[0; 5000]] {
            std::fs::write(&path, bytes).unwrap();
            assert_eq!(ending_of(&path).unwrap(), None, "{} bytes", bytes.len());
            assert_eq!(writer(&path).unwrap(), None);
        }
    }
}
