//! Which process has a file open, as `/proc` tells: of this user's processes, and for root of all.

use std::fs::Metadata;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use crate::printable::line;

/// True where this process has that very file open, by whatever path.
pub(super) fn has_open(pid: i32, file: &Path) -> bool {
    let Ok(wanted) = std::fs::metadata(file) else { return false };
    let is_wanted = |file: Metadata| (file.dev(), file.ino()) == (wanted.dev(), wanted.ino());
    links(pid).any(|link| std::fs::metadata(link).is_ok_and(is_wanted))
}

/// The other processes that have files open in this folder, each as `name (process 123)`; in the
/// order of their numbers.
pub(super) fn users_of(folder: &Path) -> Vec<String> {
    let Ok(folder) = folder.canonicalize() else { return Vec::new() };
    let Ok(processes) = std::fs::read_dir("/proc") else { return Vec::new() };
    let own = nix::unistd::getpid().as_raw();
    let mut pids: Vec<i32> = processes
        .flatten()
        .filter_map(|process| process.file_name().to_str()?.parse().ok())
        .filter(|pid| *pid != own)
        .filter(|pid| {
            links(*pid)
                .any(|link| std::fs::read_link(link).is_ok_and(|file| file.starts_with(&folder)))
        })
        .collect();
    pids.sort_unstable();
    pids.into_iter().map(|pid| format!("{} (process {pid})", name(pid))).collect()
}

/// The links to a process's open files.
fn links(pid: i32) -> impl Iterator<Item = PathBuf> {
    std::fs::read_dir(format!("/proc/{pid}/fd"))
        .into_iter()
        .flatten()
        .flatten()
        .map(|link| link.path())
}

/// The name that the process gave itself may hold anything.
fn name(pid: i32) -> String {
    let name = std::fs::read_to_string(format!("/proc/{pid}/comm")).unwrap_or_default();
    line(name.trim_end()).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_is_found_by_what_it_has_open() {
        let folder = tempfile::tempdir().unwrap();
        let (file, other) = (folder.path().join("command"), folder.path().join("other"));
        std::fs::write(&file, "").unwrap();
        std::fs::write(&other, "").unwrap();
        let stdin = std::fs::File::open(&file).unwrap();
        let mut sleeper =
            std::process::Command::new("sleep").arg("60").stdin(stdin).spawn().unwrap();
        let pid = i32::try_from(sleeper.id()).unwrap();
        // Under QEMU's user mode `spawn` comes back before the other program has begun.
        let name = format!("/proc/{pid}/comm");
        while std::fs::read_to_string(&name).unwrap().trim_end() != "sleep" {
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        let users = users_of(folder.path());
        let found = (
            has_open(pid, &file),
            has_open(pid, &other),
            has_open(pid, &folder.path().join("none")),
        );
        sleeper.kill().unwrap();
        sleeper.wait().unwrap();
        assert_eq!(users, [format!("sleep (process {pid})")]);
        assert_eq!(found, (true, false, false));
        assert!(!has_open(pid, &file), "it is gone");
    }
}
