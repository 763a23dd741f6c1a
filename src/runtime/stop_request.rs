//! A stop that is asked of the process that has the hardware, whichever user's it is.
//!
//! A signal reaches the processes of the same user alone, and on a brick the service is the user
//! `onbrick`, a person at the menu or over SSH the user `robot`. So such a stop is a lock, on a
//! file beside the hardware's: who asks holds it, and who drives looks at it ten times a second. It
//! ends with its asker, so an old request stops no later run. Any user may ask: stopping is safe.
//!
//! # Not here
//!
//! No force: a process that does not listen is ended by [`evict`](super::evict()), where the kernel
//! permits it.

use std::fs::{File, OpenOptions};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use nix::errno::Errno;
use nix::fcntl::{Flock, FlockArg};

use super::lock::{lock_path, locked, open, open_existing, write_text};
use super::{LockError, StopBy, StopFlags};
use crate::clock::{Clock as _, MILLISECOND_NS, MonotonicClock};
use crate::printable::{from_json, json_line, with_causes};
use crate::threads::Background;

/// How often who drives looks, nanoseconds.
const LOOK_NS: i64 = 100 * MILLISECOND_NS;

/// A request to stop, made of whatever process drives until this is dropped.
#[derive(Debug)]
pub struct StopRequest {
    _file: Flock<File>,
}

impl StopRequest {
    /// Asks what drives the hardware below `root` to stop. `None` where another process asks at
    /// this moment; and where it cannot be asked, which the log says: then only force is left.
    #[must_use]
    pub fn make(root: &Path, by: StopBy) -> Option<Self> {
        match Self::try_make(root, by) {
            Ok(request) => Some(request),
            Err(LockError::Taken(_)) => None,
            Err(error) => {
                log::warn!("what drives is not asked to stop: {}", with_causes(&error));
                None
            }
        }
    }

    fn try_make(root: &Path, by: StopBy) -> Result<Self, LockError> {
        let path = path(root);
        let failed = |source| LockError::Io { path: path.clone(), source };
        let file = open(&path).map_err(failed)?;
        let held = locked(file, FlockArg::LockExclusiveNonblock, &MonotonicClock, failed)?;
        let word = json_line(&by).map_err(|error| failed(error.into()))?;
        write_text(&held, &word).map_err(failed)?;
        Ok(Self { _file: held })
    }
}

impl StopFlags {
    /// A [`StopRequest`] of what drives the hardware below `root` raises its flag, as long as the
    /// result is held.
    ///
    /// # Errors
    ///
    /// The kernel has no room for a thread.
    pub(crate) fn watch_requests(&self, root: &Path) -> io::Result<Background> {
        let (path, flags) = (path(root), self.clone());
        let watch = move |ends: &AtomicBool| {
            while !ends.load(Ordering::Relaxed) {
                if let Some(by) = asked(&path) {
                    flags.raise(by);
                }
                MonotonicClock.sleep_ns(LOOK_NS);
            }
        };
        Background::start("stop-watch", watch)
    }
}

fn path(root: &Path) -> PathBuf {
    lock_path(root).with_extension("stop")
}

/// On whose behalf a stop is asked for at this moment.
fn asked(path: &Path) -> Option<StopBy> {
    let file = open_existing(path, &mut OpenOptions::new()).ok()??;
    match Flock::lock(file, FlockArg::LockSharedNonblock) {
        Err((file, Errno::EWOULDBLOCK)) => {
            let mut word = String::new();
            file.take(64).read_to_string(&mut word).ok()?;
            // What is being written is read the next time.
            from_json(&word).ok()
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::SECOND_NS;
    use crate::recording::StopReason;

    #[test]
    fn a_request_reaches_who_drives_and_stops_no_later_run() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        let (first, second) = (StopFlags::default(), StopFlags::default());
        let watch = first.watch_requests(root).unwrap();
        let request = StopRequest::make(root, StopBy::Remote).unwrap();
        assert!(StopRequest::make(root, StopBy::Here).is_none(), "one asks already");
        assert!(MonotonicClock.wait_for(5 * SECOND_NS, MILLISECOND_NS, &|| first.is_raised()));
        assert_eq!(first.reason(), Some(StopReason::Remote));
        drop((request, watch));
        // A process that another test starts has a copy of all open files until its program begins.
        let is_over = || asked(&path(root)).is_none();
        assert!(MonotonicClock.wait_for(5 * SECOND_NS, MILLISECOND_NS, &is_over));
        let _watch = second.watch_requests(root).unwrap();
        MonotonicClock.sleep_ns(3 * LOOK_NS);
        assert!(!second.is_raised());
        std::fs::remove_file(path(root)).unwrap();
    }
}
