//! Writing a file that a person keeps: whole or not at all, and never over another one unasked.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};

use super::if_there;

/// Why a file was not written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SaveError {
    /// There is such a file already: choose another name, or say that it may be replaced.
    #[error("{} is there already", .0.display())]
    Exists(PathBuf),
    /// The disk or its permissions.
    #[error("cannot write {}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What went wrong.
        source: io::Error,
    },
}

/// Who may read a file that is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Readers {
    /// Those who could read the one that was there; of a new one, as the umask has it.
    AsUsual,
    /// Its owner alone.
    Owner,
}

/// Writes a new file.
///
/// # Errors
///
/// [`SaveError::Exists`] where there is one; a file that is there is never touched, and a disk that
/// is full leaves none.
pub fn create(path: &Path, text: &str, readers: Readers) -> Result<(), SaveError> {
    write_beside(readers, path, text.as_bytes(), |fresh| match std::fs::hard_link(fresh, path) {
        // A file system without links, as on many memory cards.
        Err(error)
            if matches!(
                error.kind(),
                io::ErrorKind::Unsupported | io::ErrorKind::PermissionDenied
            ) =>
        {
            if path.symlink_metadata().is_ok() {
                return Err(io::ErrorKind::AlreadyExists.into());
            }
            std::fs::rename(fresh, path)
        }
        linked => linked.and_then(|()| std::fs::remove_file(fresh)),
    })
    .map_err(|error| match error {
        SaveError::Io { source, .. } if source.kind() == io::ErrorKind::AlreadyExists => {
            SaveError::Exists(path.to_owned())
        }
        other => other,
    })
}

/// Writes a file that can be made again, over one of its name.
///
/// # Errors
///
/// [`SaveError::Io`]; what was there is then as it was.
pub fn write(path: &Path, bytes: &[u8], readers: Readers) -> Result<(), SaveError> {
    // What is no file, such as a terminal or a pipe, is no name that could change hands.
    if std::fs::metadata(path).is_ok_and(|known| !known.is_file()) {
        return std::fs::write(path, bytes).map_err(failed(path));
    }
    // The name of a link stays a link: what it leads to is written.
    let led_to = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    write_beside(readers, &led_to, bytes, |fresh| std::fs::rename(fresh, &led_to))
}

/// Writes a file beside the one that is meant, and has it take the name when its bytes are on the
/// disk: a power cut or a full disk leaves what was there.
fn write_beside(
    readers: Readers,
    path: &Path,
    bytes: &[u8],
    take_name: impl FnOnce(&Path) -> io::Result<()>,
) -> Result<(), SaveError> {
    // Of this process alone: two may write the same file at once.
    let fresh = beside(path, &format!("{}.new", std::process::id()));
    let mode = if readers == Readers::Owner { 0o600 } else { 0o666 };
    // One that a killed process with this number left may have other readers.
    let _ = std::fs::remove_file(&fresh);
    let opened = File::options().write(true).create_new(true).mode(mode).open(&fresh);
    let written = opened.and_then(|mut file| {
        if let Ok(known) = std::fs::metadata(path)
            && readers == Readers::AsUsual
        {
            file.set_permissions(known.permissions())?;
        }
        file.write_all(bytes)?;
        file.sync_all()
    });
    written.and_then(|()| take_name(&fresh)).map_err(|source| {
        // An incomplete file is useless.
        let _ = std::fs::remove_file(&fresh);
        failed(path)(source)
    })
}

fn failed(path: &Path) -> impl FnOnce(io::Error) -> SaveError {
    let path = path.to_owned();
    |source| SaveError::Io { path, source }
}

/// Replaces a file and keeps the old one beside it, as `robot.toml.1` and so on; returns where. A
/// missing file is created.
///
/// # Errors
///
/// [`SaveError`]; the file is then as it was.
pub fn replace(path: &Path, text: &str) -> Result<Option<PathBuf>, SaveError> {
    let before = if_there(std::fs::read(path)).map_err(failed(path))?;
    let backup = before.map(|before| keep(path, &before)).transpose()?;
    write(path, text.as_bytes(), Readers::AsUsual)?;
    Ok(backup)
}

/// Copies what was there to the first free name.
fn keep(path: &Path, before: &[u8]) -> Result<PathBuf, SaveError> {
    let mut number = 1_u32;
    loop {
        let backup = beside(path, &number.to_string());
        match OpenOptions::new().write(true).create_new(true).open(&backup) {
            Ok(mut file) => {
                let kept = file.write_all(before).and_then(|()| file.sync_all());
                return kept.map_err(failed(&backup)).map(|()| backup);
            }
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                number = number.saturating_add(1)
            }
            Err(error) => return Err(failed(&backup)(error)),
        }
    }
}

/// The file of the same name with one more ending.
pub(crate) fn beside(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".");
    name.push(ending);
    PathBuf::from(name)
}

/// A text as TOML writes it: as JSON does, but for one character that JSON leaves as it is.
#[must_use]
pub fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string().replace('\u{7f}', "\\u007F")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::document::Document;

    #[test]
    fn a_file_that_is_there_is_never_overwritten_unasked() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.toml");
        create(&path, "first", Readers::AsUsual).unwrap();
        let refused = create(&path, "second", Readers::AsUsual).unwrap_err();
        assert!(matches!(refused, SaveError::Exists(_)), "{refused}");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "first");
    }

    #[test]
    fn what_is_replaced_is_kept_under_a_name_of_its_own_each_time() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.toml");
        assert_eq!(replace(&path, "first").unwrap(), None);
        let one = replace(&path, "second").unwrap().unwrap();
        let two = replace(&path, "third").unwrap().unwrap();
        let texts = [&one, &two, &path].map(|path| std::fs::read_to_string(path).unwrap());
        assert_eq!(texts, ["first", "second", "third"]);
        assert_eq!(
            std::fs::read_dir(folder.path()).unwrap().count(),
            3,
            "nothing else is left behind"
        );
    }

    #[test]
    fn what_can_be_made_again_is_written_through_links_and_to_what_is_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("map.svg"), folder.path().join("link.svg"));
        write(&file, b"first", Readers::AsUsual).unwrap();
        std::os::unix::fs::symlink("map.svg", &link).unwrap();
        write(&link, b"second", Readers::AsUsual).unwrap();
        assert_eq!(std::fs::read(&file).unwrap(), b"second");
        assert!(link.symlink_metadata().unwrap().is_symlink());
        write(Path::new("/dev/null"), b"third", Readers::AsUsual).unwrap();
        assert_eq!(
            std::fs::read_dir(folder.path()).unwrap().count(),
            2,
            "nothing else is left behind"
        );
    }

    #[test]
    fn a_folder_that_is_not_there_is_said() {
        let error = replace(Path::new("not/there/robot.toml"), "x").unwrap_err();
        assert!(error.to_string().contains("not/there/robot.toml"), "{error}");
    }

    #[test]
    fn any_name_can_be_written_as_toml() {
        for name in ["ev3", "say \"hi\"", "back\\slash", "tab\t", "\0\u{8}\u{1b}", "ü🧱", "\u{7f}"]
        {
            let text = format!("name = {}", quoted(name));
            let document = Document::new("t", text.as_bytes()).unwrap();
            let (read, _) =
                document.read(|root| root.get("name")?.text().map(str::to_owned)).unwrap();
            assert_eq!(read, name);
        }
    }
}
