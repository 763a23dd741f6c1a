//! The mount point: whether it can be one, what a dead simulator left there, and how it is taken
//! away.

use std::ffi::OsString;
use std::fs;
use std::io;
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::{Path, PathBuf};
use std::process::Command;

use nix::errno::Errno;
use nix::mount::{MntFlags, umount2};
use nix::unistd::geteuid;

use super::Found;
use crate::printable::in_shell;

/// What the machine's table of mounts calls ours.
pub(super) const SOURCE: &str = "onbrick-sim";

const DEVICE: &str = "/dev/fuse";
const HELPERS: [&str; 2] = ["fusermount3", "fusermount"];

/// Why a simulation was not mounted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MountError {
    /// Choose another mount point.
    #[error("cannot mount at {}: {why}", point.display())]
    Unfit {
        /// The mount point.
        point: PathBuf,
        /// What is wrong with it.
        why: Unfit,
    },
    /// The machine is not ready for FUSE: install or allow something.
    #[error("users of this machine cannot mount file systems: {0}")]
    NoFuse(Remedy),
    /// Anything else.
    #[error("cannot mount or unmount at {}", point.display())]
    Failed {
        /// The mount point.
        point: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

/// What is wrong with a mount point.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Unfit {
    /// There is no folder, and no folder for it to be made in.
    #[error("it cannot be made: {0}")]
    NotThere(io::ErrorKind),
    /// A file.
    #[error("it is not a folder")]
    NotAFolder,
    /// It holds files of other programs.
    #[error("it is not empty")]
    NotEmpty,
    /// Something is mounted there.
    #[error("`{0}` is mounted there already")]
    Busy(String),
    /// The program behind the mount is gone, and it was not a simulator of ours.
    #[error("the program behind what is mounted there is gone, and it was no simulator")]
    Stale,
    /// No right to look at it.
    #[error("its owner lets no other user use it")]
    Forbidden,
}

/// What is missing for FUSE.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Remedy {
    /// The kernel has no FUSE loaded, or the container does not pass it on.
    #[error("/dev/fuse is missing")]
    NoDevice,
    /// `/dev/fuse` cannot be opened.
    #[error("/dev/fuse cannot be opened")]
    Forbidden,
    /// Not root, and no helper that mounts for others.
    #[error("fusermount3 is missing")]
    NoHelper,
}

impl MountError {
    /// The way out.
    #[must_use]
    pub fn hint(&self) -> String {
        let hint = match self {
            Self::Unfit { point, why: Unfit::Busy(_) | Unfit::Stale } => {
                return format!("another folder, or: umount {}", in_shell(point));
            }
            Self::Unfit { .. } => "an empty folder of your own",
            Self::NoFuse(Remedy::NoDevice) => {
                "modprobe fuse, as root; in a container: docker run --device /dev/fuse --cap-add \
                 SYS_ADMIN"
            }
            Self::NoFuse(Remedy::Forbidden) => {
                "ls -l /dev/fuse: your user needs to read and write it"
            }
            Self::NoFuse(Remedy::NoHelper) => "apt install fuse3, or run this as root",
            Self::Failed { .. } => {
                "mounting as root; in a container with: --cap-add SYS_ADMIN --security-opt \
                 apparmor=unconfined"
            }
        };
        hint.to_owned()
    }
}

/// Makes sure that something can be mounted at `point`; returns its absolute path.
pub(super) fn prepare(point: &Path) -> Result<(PathBuf, Found), MountError> {
    check_fuse().map_err(MountError::NoFuse)?;
    let unfit = |why| MountError::Unfit { point: point.to_owned(), why };
    let mut found = Found { made: false, stale: clear(point)? };
    match fs::symlink_metadata(point) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            fs::create_dir(point).map_err(|error| unfit(Unfit::NotThere(error.kind())))?;
            found.made = true;
        }
        Err(_) => return Err(unfit(Unfit::Forbidden)),
        Ok(_) => {}
    }
    let absolute = point.canonicalize().map_err(|_| unfit(Unfit::Forbidden))?;
    if let Some(uppermost) = mounts_at(&absolute).pop() {
        return Err(unfit(Unfit::Busy(uppermost.source)));
    }
    if !absolute.is_dir() {
        return Err(unfit(Unfit::NotAFolder));
    }
    let mut entries = absolute.read_dir().map_err(|_| unfit(Unfit::Forbidden))?;
    if entries.next().is_some() {
        return Err(unfit(Unfit::NotEmpty));
    }
    Ok((absolute, found))
}

fn check_fuse() -> Result<(), Remedy> {
    match fs::File::options().read(true).write(true).open(DEVICE) {
        Err(error) if error.kind() == io::ErrorKind::PermissionDenied => {
            return Err(Remedy::Forbidden);
        }
        Err(_) => return Err(Remedy::NoDevice),
        Ok(_) => {}
    }
    if geteuid().is_root() || helper().is_some() { Ok(()) } else { Err(Remedy::NoHelper) }
}

/// The program that mounts and unmounts for those who are not root.
fn helper() -> Option<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders: Vec<PathBuf> =
        std::env::split_paths(&path).chain(["/bin".into(), "/sbin".into()]).collect();
    let candidates =
        HELPERS.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name)));
    candidates.into_iter().find(|candidate| candidate.is_file())
}

/// Removes mounts that dead simulators of ours left behind; true if there was any.
fn clear(point: &Path) -> Result<bool, MountError> {
    let mut cleared = false;
    // Several may lie over each other.
    while fs::metadata(point)
        .is_err_and(|error| error.raw_os_error() == Some(Errno::ENOTCONN as i32))
    {
        let absolute = absolute_of_stale(point);
        let uppermost = mounts_at(&absolute).pop();
        let ours =
            uppermost.is_some_and(|mount| mount.kind.starts_with("fuse") && mount.source == SOURCE);
        if !ours {
            return Err(MountError::Unfit { point: point.to_owned(), why: Unfit::Stale });
        }
        detach(&absolute)
            .map_err(|source| MountError::Failed { point: absolute.clone(), source })?;
        cleared = true;
    }
    Ok(cleared)
}

/// A folder whose file system does not answer cannot be resolved itself, only the one that it lies
/// in.
fn absolute_of_stale(point: &Path) -> PathBuf {
    let parent =
        point.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    match (parent.canonicalize(), point.file_name()) {
        (Ok(parent), Some(name)) => parent.join(name),
        _ => point.to_owned(),
    }
}

/// Unmounts without waiting for those who still use it.
pub(super) fn detach(point: &Path) -> io::Result<()> {
    match umount2(point, MntFlags::MNT_DETACH) {
        Ok(()) => Ok(()),
        Err(Errno::EPERM) => detach_with_helper(point),
        Err(errno) => Err(errno.into()),
    }
}

fn detach_with_helper(point: &Path) -> io::Result<()> {
    let helper = helper().ok_or(Errno::EPERM)?;
    let output = Command::new(helper).args(["-u", "-z", "--"]).arg(point).output()?;
    if output.status.success() {
        Ok(())
    } else {
        Err(io::Error::other(String::from_utf8_lossy(&output.stderr).trim().to_owned()))
    }
}

/// A line of the machine's table of mounts.
#[derive(Debug, Clone, PartialEq, Eq)]
struct MountLine {
    /// The kernel's own number of the mount.
    id: String,
    kind: String,
    source: String,
}

/// The kernel's number of what is mounted at a path; none if nothing is.
pub(super) fn identity(point: &Path) -> Option<String> {
    mounts_at(point).pop().map(|mount| mount.id)
}

/// What is mounted at a path, the uppermost last.
fn mounts_at(point: &Path) -> Vec<MountLine> {
    let table = fs::read("/proc/self/mountinfo").unwrap_or_default();
    table.split(|byte| *byte == b'\n').filter_map(|line| mount_at(line, point)).collect()
}

/// A line of the table (`proc_pid_mountinfo(5)`): the first field is the mount's number, the fifth
/// the mount point; kind and source follow a single `-`.
fn mount_at(line: &[u8], point: &Path) -> Option<MountLine> {
    let text = |field: &[u8]| unescape(field).to_string_lossy().into_owned();
    let mut fields = line.split(|byte| *byte == b' ');
    let id = text(fields.next()?);
    if unescape(fields.nth(3)?).as_bytes() != point.as_os_str().as_bytes() {
        return None;
    }
    let mut fields = fields.skip_while(|field| *field != b"-").skip(1);
    Some(MountLine { id, kind: text(fields.next()?), source: text(fields.next()?) })
}

/// The table writes spaces and their like as a backslash and three octal digits.
fn unescape(field: &[u8]) -> OsString {
    let mut bytes = Vec::with_capacity(field.len());
    let mut rest = field;
    while let Some((first, after)) = rest.split_first() {
        let digits = after
            .get(..3)
            .filter(|_| *first == b'\\')
            .and_then(|digits| std::str::from_utf8(digits).ok());
        match digits.and_then(|digits| u8::from_str_radix(digits, 8).ok()) {
            Some(byte) => {
                bytes.push(byte);
                rest = after.get(3..).unwrap_or_default();
            }
            None => {
                bytes.push(*first);
                rest = after;
            }
        }
    }
    OsString::from_vec(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_in_a_hint_can_be_copied() {
        let why = Unfit::Busy(SOURCE.to_owned());
        let error = MountError::Unfit { point: "/tmp/my brick".into(), why };
        assert_eq!(error.hint(), "another folder, or: umount '/tmp/my brick'");
    }

    #[test]
    fn a_line_of_the_table_of_mounts_gives_number_kind_and_source() {
        let line = b"98 32 0:45 / /tmp/my\\040brick rw,nosuid - fuse onbrick-sim rw,user_id=0";
        let found = mount_at(line, Path::new("/tmp/my brick"));
        let [id, kind, source] = ["98", "fuse", "onbrick-sim"].map(str::to_owned);
        assert_eq!(found, Some(MountLine { id, kind, source }));
        assert_eq!(mount_at(line, Path::new("/tmp/my")), None);
        for odd in
            [b"".as_slice(), b"1 2 3 4", b"1 2 3 4 /a", b"1 2 3 4 /a rw -", b"1 2 3 4 /a rw - fuse"]
        {
            assert_eq!(mount_at(odd, Path::new("/a")), None, "{}", String::from_utf8_lossy(odd));
        }
    }

    #[test]
    fn what_is_no_escape_stays() {
        for (text, expected) in
            [("a\\134b", "a\\b"), ("\\", "\\"), ("\\9", "\\9"), ("\\08x", "\\08x"), ("", "")]
        {
            assert_eq!(unescape(text.as_bytes()), expected, "{text}");
        }
    }
}
