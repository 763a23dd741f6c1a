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
use std::io::{self, Read, Seek, SeekFrom};
use std::os::fd::AsFd;
use std::path::Path;

use mcap::records::MetadataIndex;
use mcap::sans_io::summary_reader::{SummaryReadEvent, SummaryReader, SummaryReaderOptions};
use nix::fcntl::{FcntlArg, fcntl};
use nix::libc;

use super::Ending;
use super::run::{ending, names};

/// No record of a summary is longer, bytes: the longest is a definition of messages.
const LONGEST_RECORD: usize = 1 << 20;

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

/// How a recording ended; `None` where it was cut, or is no recording.
///
/// # Errors
///
/// The file cannot be read.
pub fn ending_of(path: &Path) -> io::Result<Option<Ending>> {
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    let options =
        SummaryReaderOptions::default().with_file_size(length).with_record_length_limit(LONGEST_RECORD);
    let mut reader = SummaryReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        match event {
            Ok(SummaryReadEvent::ReadRequest(wanted)) => {
                let read = file.read(reader.insert(wanted))?;
                reader.notify_read(read);
            }
            Ok(SummaryReadEvent::SeekRequest(to)) => reader.notify_seeked(file.seek(to)?),
            // A file that was cut has no summary.
            Err(_) => return Ok(None),
        }
    }
    let indexes = reader.finish().map(|summary| summary.metadata_indexes).unwrap_or_default();
    let Some(index) = indexes.into_iter().find(|index| index.name == names::ENDING) else { return Ok(None) };
    let length = usize::try_from(index.length).unwrap_or(usize::MAX).min(LONGEST_RECORD);
    let mut record = vec![0; length];
    file.seek(SeekFrom::Start(index.offset))?;
    file.read_exact(&mut record)?;
    let alone = MetadataIndex { offset: 0, ..index };
    Ok(mcap::read::metadata(&record, &alone).ok().map(|metadata| ending(&metadata)))
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
