//! Reading files that people wrote, as far as they may be long and where they are.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

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

/// `None` where the file or the folder is not there.
///
/// # Errors
///
/// It is there, and cannot be read.
pub fn if_there<T>(read: io::Result<T>) -> io::Result<Option<T>> {
    match read {
        Ok(read) => Ok(Some(read)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}

/// The files of a folder that are TOML by their names, in order.
///
/// # Errors
///
/// The folder cannot be listed.
pub fn toml_files(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder)?.map(|entry| Ok(entry?.path()));
    let mut files = entries.collect::<io::Result<Vec<_>>>()?;
    files.retain(|file| file.extension().is_some_and(|ending| ending == "toml"));
    files.sort();
    Ok(files)
}
