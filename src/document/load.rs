//! Reading a file that a person wrote, as far as it may be long.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use super::Document;

/// Reads at most one byte more than a document may have: enough for it to say that it is too long.
///
/// # Errors
///
/// The file cannot be read.
pub fn read_bounded(path: &Path) -> io::Result<Vec<u8>> {
    let most = u64::try_from(Document::MAX_BYTES + 1).unwrap_or(u64::MAX);
    let mut bytes = Vec::new();
    File::open(path)?.take(most).read_to_end(&mut bytes)?;
    Ok(bytes)
}
