//! Ending a run whose processes do not stop when they are asked to, and stopping the motors that a
//! dead run left.
//!
//! The guard is killed first: a control that is in order then stops its motors within a tick and
//! finishes its recording. Control is killed only where it has not stopped its motors by then. Both
//! are found by the lock, and killed only while they have its file open: the kernel may have given
//! their numbers to other processes.
//!
//! # Not here
//!
//! No asking: a run is asked to stop over its pipe ([`Stopper`](super::Stopper)), by a signal or by
//! a [`StopRequest`](super::StopRequest), and has [`PATIENCE_NS`] to do so.

use std::path::Path;
use std::sync::Arc;

use nix::errno::Errno;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use super::{HardwareLock, LockError, Owner};
use crate::clock::{Clock as _, MILLISECOND_NS, MonotonicClock};
use crate::ev3dev::{LocalTree, PortAddress, Tree};
use crate::robot::{HaltError, still};

/// How long a run that was asked to stop has to stop its motors before it is ended by force,
/// nanoseconds: it needs a tick; its motors' leases end after 300 ms.
pub const PATIENCE_NS: i64 = 700 * MILLISECOND_NS;

/// How long a control whose guard was killed has to stop its motors, nanoseconds.
const YIELDING_NS: i64 = 200 * MILLISECOND_NS;

/// How long a killed process is waited for, nanoseconds: one that sits in a system call is gone
/// when that ends.
const DYING_NS: i64 = 200 * MILLISECOND_NS;

/// How often the lock is looked at meanwhile, nanoseconds.
const LOOK_NS: i64 = 5 * MILLISECOND_NS;

/// Why the motors that a dead run left were not stopped.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OrphansError {
    /// A run has the hardware and sees to its motors itself, or the lock cannot be used.
    #[error(transparent)]
    Lock(#[from] LockError),
    /// Not every motor could be stopped: unplug its cable.
    #[error("cannot stop the motors")]
    Halt(#[from] HaltError),
    /// The motors are still, and the lock still names them.
    #[error("cannot write into the lock")]
    Note(#[from] std::io::Error),
}

/// Gives the run that has the hardware below `root` time to stop its motors, and ends it by force
/// where it does not; only a run that `which` means. One that has stopped its motors and is
/// finishing its recording is left to do so. Takes 0.4 s more than `patience_ns` at the most.
///
/// Returns true where no process of that run can turn a motor any more; false where one cannot be
/// killed: it is another user's, or the kernel holds it in a system call.
///
/// # Errors
///
/// [`LockError::Io`].
pub fn evict(
    root: &Path,
    patience_ns: i64,
    which: impl Fn(&Owner) -> bool,
) -> Result<bool, LockError> {
    let of_run = || Ok(HardwareLock::owner(root)?.filter(|owner| which(owner)));
    let has_yielded = || Ok(of_run()?.is_none_or(|owner| is_finishing(root, &owner)));
    // An error ends the wait, and shows in the look after it.
    let yields_within = |patience_ns| {
        MonotonicClock.wait_for(patience_ns, LOOK_NS, &|| has_yielded().unwrap_or(true));
        has_yielded()
    };
    if yields_within(patience_ns)? {
        return Ok(true);
    }
    let Some(owner) = of_run()? else { return Ok(true) };
    for (process, patience_ns) in [(owner.guard, YIELDING_NS), (Some(owner.pid), DYING_NS)] {
        let Some(process) = process else { continue };
        if HardwareLock::is_held_by(root, process) {
            // One that is gone, or of another user, shows below.
            let _ = kill(Pid::from_raw(process), Signal::SIGKILL);
        }
        if yields_within(patience_ns)? {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Stops the motors of a run all of whose processes were killed before they had stopped them, and
/// no others; the run, or `None` where no run has left any.
///
/// # Errors
///
/// [`OrphansError`].
pub fn stop_orphans(root: &Path) -> Result<Option<Owner>, OrphansError> {
    let Some((mut lock, owner)) = HardwareLock::take_orphans(root)? else { return Ok(None) };
    let tree: Arc<dyn Tree> = Arc::new(LocalTree::new(root));
    // An invalid address fits no motor.
    let ports: Vec<PortAddress> =
        owner.motors.iter().filter_map(|motor| motor.parse().ok()).collect();
    still(&tree, &ports, &MonotonicClock)?;
    lock.nothing_turns()?;
    Ok(Some(owner))
}

/// Evicts the run that `which` means ([`evict`]), and stops the motors that it left
/// ([`stop_orphans`]). False where a process of it cannot be killed.
///
/// # Errors
///
/// [`OrphansError`], but not for a run that yielded and is finishing its recording, or one that has
/// begun since: those see to their motors themselves.
pub fn end_by_force(
    root: &Path,
    patience_ns: i64,
    which: impl Fn(&Owner) -> bool,
) -> Result<bool, OrphansError> {
    let is_over = evict(root, patience_ns, which)?;
    match stop_orphans(root) {
        Ok(_) | Err(OrphansError::Lock(LockError::Taken(_))) => Ok(is_over),
        Err(error) => Err(error),
    }
}

/// True where the process that drove has stopped its motors and lives: it is finishing its
/// recording. What another user's process has open is not to be seen.
fn is_finishing(root: &Path, owner: &Owner) -> bool {
    let is_anothers = || kill(Pid::from_raw(owner.pid), None) == Err(Errno::EPERM);
    owner.stopped && (HardwareLock::is_held_by(root, owner.pid) || is_anothers())
}
