//! One run owns the hardware at a time: a lock that names its owner.
//!
//! The lock is the kernel's advisory lock on a file beside other programs' locks. It ends with the
//! process that holds it, however that process ends, so a stale lock needs no clearing up. The
//! file's text names the owner, for the message to the next run. Between runs nothing is held:
//! other programs have the motors.
//!
//! The text also names the motors that a run has taken over, until it has stopped them. If it still
//! does while no process holds the lock, all of the run's processes were killed at once, and these
//! motors, no others, are orphans ([`HardwareLock::take_orphans`]).

use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Read, Seek};
use std::os::unix::fs::{FileExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use nix::errno::Errno;
use nix::fcntl::{FcntlArg, FdFlag, Flock, FlockArg, fcntl};
use nix::sys::statfs::{FUSE_SUPER_MAGIC, statfs};
use serde::{Deserialize, Serialize};

use super::open_files;
use crate::clock::{Clock, MILLISECOND_NS, MonotonicClock};
use crate::document::if_there;
use crate::printable::{from_json, in_shell, json_line, line};

/// How long to wait for a process that only reads the owner, nanoseconds: some system calls, and on
/// a busy brick other processes in between. A process that is refused has waited as long.
const ASKING_NS: i64 = 100 * MILLISECOND_NS;

/// The command that stops what drives the brick below `root`, as hints have it.
#[must_use]
pub fn halt_command(root: &Path) -> String {
    match root == Path::new("/") {
        true => "onbrick halt".to_owned(),
        false => format!("onbrick halt --brick {}", in_shell(root)),
    }
}

/// Who owns the hardware.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Owner {
    /// The process that drives; before it has said so, the guard.
    pub pid: i32,
    /// Its guard, where it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub guard: Option<i32>,
    /// What it is doing, for people: the mission's name.
    pub doing: String,
    /// It has stopped its motors for good, and only its recording is not yet finished.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub stopped: bool,
    /// The motors that it has taken over and not yet stopped, by their ports.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub motors: Vec<String>,
}

impl Owner {
    /// This process, which has no guard and has taken over no motor.
    #[must_use]
    pub fn here(doing: &str) -> Self {
        let pid = nix::unistd::getpid().as_raw();
        Self { pid, guard: None, doing: doing.to_owned(), stopped: false, motors: Vec::new() }
    }
}

/// The hardware, held until this is dropped or the process ends.
#[derive(Debug)]
pub struct HardwareLock {
    file: Flock<File>,
}

/// Why the hardware could not be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LockError {
    /// Another run drives: wait, stop it (`onbrick halt`), or use another brick.
    #[error("the motors belong to {} (process {})", .0.doing, .0.pid)]
    Taken(Owner),
    /// The lock file cannot be used: look at its folder's permissions.
    #[error("cannot use the lock file {path}")]
    Io {
        /// The lock file.
        path: PathBuf,
        /// What went wrong.
        source: io::Error,
    },
}

impl HardwareLock {
    /// Takes the hardware below `root` for this process.
    ///
    /// # Errors
    ///
    /// [`LockError::Taken`] with its owner, or [`LockError::Io`].
    pub fn take(root: &Path, doing: &str) -> Result<Self, LockError> {
        let path = lock_path(root);
        let failed = |source| LockError::Io { path: path.clone(), source };
        let file = open(&path).map_err(failed)?;
        let held = locked(file, FlockArg::LockExclusiveNonblock, &MonotonicClock, failed)?;
        write_owner(&held, &Owner::here(doing)).map_err(failed)?;
        Ok(Self { file: held })
    }

    /// Takes the hardware below `root` if a run was killed before it had stopped its motors, which
    /// the caller must then stop; `None` if no run has left any. The caller then confirms it
    /// ([`HardwareLock::nothing_turns`]).
    ///
    /// # Errors
    ///
    /// [`LockError::Taken`] by a run that lives and sees to its motors itself, or
    /// [`LockError::Io`].
    pub fn take_orphans(root: &Path) -> Result<Option<(Self, Owner)>, LockError> {
        let path = lock_path(root);
        let failed = |source| LockError::Io { path: path.clone(), source };
        let Some(file) = open_existing(&path, OpenOptions::new().write(true)).map_err(failed)?
        else {
            return Ok(None);
        };
        let mut held = locked(file, FlockArg::LockExclusiveNonblock, &MonotonicClock, failed)?;
        let owner = read_owner(&mut held);
        Ok(Some((Self { file: held }, owner)).filter(|(_, owner)| !owner.motors.is_empty()))
    }

    /// No motor is left to stop, should the run's processes be killed from now on.
    ///
    /// # Errors
    ///
    /// What writing into the lock gave.
    pub fn nothing_turns(&mut self) -> io::Result<()> {
        let owner = read_owner(&mut self.file);
        write_owner(&self.file, &Owner { stopped: true, motors: Vec::new(), ..owner })
    }

    /// Lets the processes that are started from now on share the lock: it is free when the last of
    /// them is gone.
    ///
    /// # Errors
    ///
    /// What the kernel answers.
    pub fn share(&self) -> io::Result<()> {
        fcntl(&*self.file, FcntlArg::F_SETFD(FdFlag::empty()))?;
        Ok(())
    }

    /// Writes who owns hardware that this process, or its guard, has taken.
    ///
    /// # Errors
    ///
    /// [`LockError::Io`].
    pub fn name_owner(root: &Path, owner: &Owner) -> Result<(), LockError> {
        let path = lock_path(root);
        let failed = |source| LockError::Io { path: path.clone(), source };
        write_owner(&open(&path).map_err(failed)?, owner).map_err(failed)
    }

    /// True where this process has the lock file below `root` open: a number that the file names
    /// may belong to a stranger by now, or be a slip of another program, and a stranger is not
    /// killed.
    #[must_use]
    pub fn is_held_by(root: &Path, pid: i32) -> bool {
        open_files::has_open(pid, &lock_path(root))
    }

    /// The owner of the hardware below `root`, if any.
    ///
    /// # Errors
    ///
    /// [`LockError::Io`].
    pub fn owner(root: &Path) -> Result<Option<Owner>, LockError> {
        let path = lock_path(root);
        let failed = |source| LockError::Io { path: path.clone(), source };
        let Some(file) = open_existing(&path, &mut OpenOptions::new()).map_err(failed)? else {
            return Ok(None);
        };
        match locked(file, FlockArg::LockSharedNonblock, &MonotonicClock, failed) {
            Ok(_) => Ok(None),
            Err(LockError::Taken(owner)) => Ok(Some(owner)),
            Err(error) => Err(error),
        }
    }
}

/// Locks the file, or says who has it locked. Who only asks whose it is ([`HardwareLock::owner`])
/// holds it for a moment, and is waited for by this clock.
pub(super) fn locked(
    mut file: File,
    how: FlockArg,
    clock: &dyn Clock,
    failed: impl FnOnce(io::Error) -> LockError,
) -> Result<Flock<File>, LockError> {
    let deadline_ns = clock.now_ns() + ASKING_NS;
    loop {
        let (back, errno) = match Flock::lock(file, how) {
            Ok(held) => return Ok(held),
            Err(refused) => refused,
        };
        file = back;
        let takes = matches!(how, FlockArg::LockExclusiveNonblock);
        match errno {
            Errno::EWOULDBLOCK if takes && clock.now_ns() < deadline_ns => {
                clock.sleep_ns(MILLISECOND_NS);
            }
            Errno::EWOULDBLOCK => return Err(LockError::Taken(read_owner(&mut file))),
            errno => return Err(failed(errno.into())),
        }
    }
}

/// Every user that may drive may lock, so the file is writable for all; the sticky folder keeps
/// others from replacing it.
pub(super) fn open(path: &Path) -> io::Result<File> {
    const EVERYBODY: u32 = 0o666;
    // With `fs.protected_regular`, which Debian sets, the kernel refuses another user's file in
    // such a folder to who would create it.
    if let Some(file) = open_existing(path, OpenOptions::new().write(true))? {
        return Ok(file);
    }
    let file = OpenOptions::new()
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .mode(EVERYBODY)
        .custom_flags(nix::libc::O_NOFOLLOW | nix::libc::O_CLOEXEC)
        .open(path)?;
    // The umask took write permission from the others; only the file's maker can give it.
    if file.metadata()?.uid() == nix::unistd::geteuid().as_raw() {
        file.set_permissions(std::os::unix::fs::PermissionsExt::from_mode(EVERYBODY))?;
    }
    Ok(file)
}

/// `None` if the lock has never been held.
pub(super) fn open_existing(path: &Path, how: &mut OpenOptions) -> io::Result<Option<File>> {
    if_there(how.read(true).custom_flags(nix::libc::O_NOFOLLOW | nix::libc::O_CLOEXEC).open(path))
}

fn write_owner(file: &File, owner: &Owner) -> io::Result<()> {
    write_text(file, &json_line(owner)?)
}

/// One write of a whole line, so that a reader never sees half a name; the rest of an earlier text
/// is then cut off.
pub(super) fn write_text(file: &File, text: &[u8]) -> io::Result<()> {
    file.write_all_at(text, 0)?;
    file.set_len(u64::try_from(text.len()).unwrap_or(u64::MAX))
}

/// What the file says; a holder that has not yet written its name is still a holder.
fn read_owner(file: &mut File) -> Owner {
    let mut text = String::new();
    let _ = file.rewind().and_then(|()| BufReader::new(file.take(4096)).read_line(&mut text));
    // The file is writable for all.
    let owner: Option<Owner> = from_json(&text).ok();
    owner
        .map(|owner| Owner { doing: line(&owner.doing).into_owned(), ..owner })
        .unwrap_or_else(|| Owner { pid: 0, ..Owner::here("another run") })
}

/// One file a brick: the machine's own hardware, or the brick below a mount point. The hardware is
/// in `sys`, and that is what its device and inode say, whatever path leads to it: a link, a bind
/// mount, a namespace whose own `/sys` it is.
pub(super) fn lock_path(root: &Path) -> PathBuf {
    let folder = Path::new("/run/lock");
    let folder = if folder.is_dir() { folder.to_owned() } else { std::env::temp_dir() };
    let sys = root.join("sys");
    let identity =
        |path: &Path| std::fs::metadata(path).ok().map(|folder| (folder.dev(), folder.ino()));
    let is_simulated = statfs(&sys).is_ok_and(|sys| sys.filesystem_type() == FUSE_SUPER_MAGIC);
    let is_machine =
        !is_simulated && identity(root).is_some_and(|root| Some(root) == identity(Path::new("/")));
    folder.join(match identity(&sys).or_else(|| identity(root)) {
        _ if is_machine => "onbrick.lock".to_owned(),
        Some((device, inode)) => format!("onbrick-{device:x}-{inode:x}.lock"),
        // A missing folder has no hardware to take, and no owner: least of all that of the
        // machine's.
        None => "onbrick-none.lock".to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;
    use std::sync::atomic::{AtomicI32, Ordering};

    use super::*;
    use crate::clock::SECOND_NS;

    /// A reader's lock, which the first sleep releases. A thousand sleeps are as long as a reader
    /// is waited for: a process that another test starts has a copy until its program begins.
    #[derive(Debug)]
    struct Asking(Mutex<Option<Flock<File>>>, AtomicI32);

    impl Clock for Asking {
        fn now_ns(&self) -> i64 {
            i64::from(self.1.load(Ordering::Relaxed)) * ASKING_NS / 1000
        }

        fn sleep_until_ns(&self, _deadline_ns: i64) {
            self.0.lock().unwrap().take();
            MonotonicClock.sleep_ns(MILLISECOND_NS);
            self.1.fetch_add(1, Ordering::Relaxed);
        }
    }

    #[test]
    fn who_only_asks_whose_it_is_keeps_no_run_from_taking_it() {
        let folder = tempfile::tempdir().unwrap();
        let open = || File::create(folder.path().join("lock")).unwrap();
        let asking = Flock::lock(open(), FlockArg::LockSharedNonblock).unwrap();
        let asking = Asking(Mutex::new(Some(asking)), AtomicI32::new(0));
        locked(open(), FlockArg::LockExclusiveNonblock, &asking, |_| unreachable!()).unwrap();
        assert!(asking.0.lock().unwrap().is_none(), "it had to be waited for");
    }

    #[test]
    fn the_second_to_come_is_told_who_has_it_and_gets_it_afterwards() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(HardwareLock::owner(folder.path()).unwrap(), None);
        let first = HardwareLock::take(folder.path(), "mission map").unwrap();
        let refused = HardwareLock::take(folder.path(), "mission bump").unwrap_err();
        assert!(
            refused.to_string().starts_with("the motors belong to mission map (process "),
            "{refused}"
        );
        let owner = HardwareLock::owner(folder.path()).unwrap().unwrap();
        assert_eq!(owner.pid, nix::unistd::getpid().as_raw());
        drop(first);
        // A process that another test starts has a copy of all open files until its program begins.
        let is_free = || HardwareLock::owner(folder.path()).unwrap().is_none();
        assert!(MonotonicClock.wait_for(5 * SECOND_NS, MILLISECOND_NS, &is_free));
        HardwareLock::take(folder.path(), "mission bump").unwrap();
        std::fs::remove_file(lock_path(folder.path())).unwrap();
    }

    #[test]
    fn what_stops_another_brick_than_this_machine_names_it() {
        assert_eq!(halt_command(Path::new("/")), "onbrick halt");
        assert_eq!(halt_command(Path::new("my b")), "onbrick halt --brick 'my b'");
    }

    #[test]
    fn a_brick_is_the_same_whatever_path_leads_to_it() {
        let folder = tempfile::tempdir().unwrap();
        let (brick, other) = (folder.path().join("brick"), folder.path().join("other"));
        std::fs::create_dir(&brick).unwrap();
        std::fs::create_dir(&other).unwrap();
        std::os::unix::fs::symlink(&brick, folder.path().join("link")).unwrap();
        for path in ["link", "brick/../brick", "other/../link/."] {
            assert_eq!(lock_path(&folder.path().join(path)), lock_path(&brick), "{path}");
        }
        assert_ne!(lock_path(&other), lock_path(&brick));
        // Its devices below another folder.
        std::fs::create_dir(brick.join("sys")).unwrap();
        std::os::unix::fs::symlink(brick.join("sys"), other.join("sys")).unwrap();
        assert_eq!(lock_path(&other), lock_path(&brick));
        assert!(lock_path(Path::new("/")).ends_with("onbrick.lock"));
        assert!(lock_path(Path::new("/usr/..")).ends_with("onbrick.lock"));
        assert!(!lock_path(&folder.path().join("missing")).ends_with("onbrick.lock"));
    }

    #[test]
    fn motors_that_a_run_has_not_stopped_are_orphans_when_it_is_gone() {
        let folder = tempfile::tempdir().unwrap();
        let orphans = || HardwareLock::take_orphans(folder.path());
        assert!(orphans().unwrap().is_none(), "no run was ever here");
        let run = HardwareLock::take(folder.path(), "mission map").unwrap();
        let motors = ["outB".to_owned(), "outD".to_owned()];
        let owner = Owner { motors: motors.to_vec(), ..Owner::here("mission map") };
        HardwareLock::name_owner(folder.path(), &owner).unwrap();
        assert!(
            matches!(orphans().unwrap_err(), LockError::Taken(owner) if owner.motors == motors)
        );
        drop(run);
        let (mut held, owner) = orphans().unwrap().unwrap();
        assert_eq!((owner.doing.as_str(), owner.motors), ("mission map", motors.to_vec()));
        assert!(
            HardwareLock::take(folder.path(), "mission bump").is_err(),
            "no run begins meanwhile"
        );
        drop(held);
        (held, _) = orphans().unwrap().expect("nothing has stopped them yet");
        held.nothing_turns().unwrap();
        drop(held);
        assert!(orphans().unwrap().is_none());
        std::fs::remove_file(lock_path(folder.path())).unwrap();
    }
}
