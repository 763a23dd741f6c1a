//! How a recording ended, without reading all of it: its summary says where that stands.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::Path;

use mcap::records::op;

use super::about::{Ending, ending, names};
use super::record::{self, FRAME_BYTES, frame, frames};

/// What a whole file ends with, bytes: the footer and the magic (mcap.dev/spec).
const END_BYTES: u64 = (FRAME_BYTES + 20 + mcap::MAGIC.len()) as u64;

/// No part of the summary that is looked at is longer, bytes, and no record of an ending.
const LONGEST_PART: u64 = 1 << 16;

/// How a recording ended; `None` where it was cut or damaged, or is no recording.
///
/// # Errors
///
/// The file cannot be read.
pub fn ending_of(path: &Path) -> io::Result<Option<Ending>> {
    let file = File::open(path)?;
    let length = file.metadata()?.len();
    let read = |place: Option<Range<u64>>| match place {
        Some(place) if place.end <= length => part(&file, place),
        _ => Ok(Vec::new()),
    };
    let footer = length.saturating_sub(END_BYTES);
    let last = read(Some(footer..length))?;
    let offsets = read(offsets_start(&last).map(|start| start..footer))?;
    let group = record_of(&offsets, op::SUMMARY_OFFSET, |body| {
        record::summary_offset(body).filter(|(opcode, _)| *opcode == op::METADATA_INDEX)
    });
    let indexes = read(group.map(|(_, place)| place))?;
    let index = record_of(&indexes, op::METADATA_INDEX, |body| {
        record::metadata_index(body).filter(|(_, name)| *name == names::ENDING)
    });
    let metadata = read(index.map(|(place, _)| place))?;
    // It has a checksum of its own, so the summary's is not asked.
    Ok(record_of(&metadata, op::METADATA, record::metadata)
        .filter(|metadata| metadata.name == names::ENDING)
        .map(|metadata| ending(&metadata)))
}

/// Where the offsets of the summary begin, from the last bytes of a file.
fn offsets_start(last: &[u8]) -> Option<u64> {
    let footer = frame(last, 0).filter(|record| record.opcode == op::FOOTER)?;
    let is_end = last.get(footer.next..) == Some(mcap::MAGIC);
    record::footer(footer.body).filter(|start| is_end && *start > 0)
}

/// What the first of some records says that says it.
fn record_of<'a, T>(
    bytes: &'a [u8],
    opcode: u8,
    says: impl Fn(&'a [u8]) -> Option<T>,
) -> Option<T> {
    frames(bytes).filter(|record| record.opcode == opcode).find_map(|record| says(record.body))
}

/// A part of a file; nothing where it is longer than any that is looked at.
fn part(file: &File, place: Range<u64>) -> io::Result<Vec<u8>> {
    let length = place.end.saturating_sub(place.start);
    let mut bytes =
        vec![0; if length > LONGEST_PART { 0 } else { usize::try_from(length).unwrap_or(0) }];
    file.read_exact_at(&mut bytes, place.start)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::writer;

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
