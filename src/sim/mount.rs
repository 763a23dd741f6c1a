//! The simulated brick as a mounted file system (FUSE), for programs in any language that were
//! written for ev3dev.
//!
//! A mounted [`Simulation`] has the files of one brick, or, with several robots, of each in a
//! folder: `1`, `2` and so on. All answers come in the same way as those of [`SimBrick`], so
//! no driver behaviour is written twice. Each read of an attribute at its beginning asks the driver
//! again, each `write` is one store, a poll for POLLPRI is woken within 10 ms.
//!
//! `point` looks after the mount point, `filesystem` answers the kernel with what `files` finds,
//! `open` keeps what is open, `ticker` lets time pass and wakes who waits, `events` answers an
//! input device's ioctls.
//!
//! # Not here
//!
//! - Ioctls of the frame buffer and inotify: they do not cross FUSE.
//! - Owners as udev sets them: everything belongs to the user who mounted it. A mount by root is
//!   open to all users, any other only to its owner. Rights are as
//!   [`Options::udev`](super::Options) says.
//! - Private memory maps of attributes: sysfs refuses every map with ENODEV, FUSE only shared ones.
//! - A screen that follows a map of `dev/fb0` at once: what is stored there arrives with `msync` or
//!   `munmap`, or when the kernel gets round to it. What is written arrives at once.
//!
//! # What we count on
//!
//! - `/dev/fuse`, and either root's rights or `fusermount3` (package `fuse3`).
//! - A writer that a driver keeps waiting (`mode` of a serial sensor) waits on a thread of its own;
//!   all else is done in microseconds by one thread.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fuser::{BackgroundSession, Config, MountOption, Session, SessionACL};
use nix::unistd::geteuid;

use self::files::Files;
use self::open::Open;
pub use self::point::{MountError, Remedy, Unfit};
use super::driver::input::EventLayout;
use super::{SimBrick, Simulation};
use crate::clock::{Clock, MILLISECOND_NS, MonotonicClock};
use crate::threads::Background;

mod events;
mod files;
mod filesystem;
mod handle;
mod nodes;
mod open;
mod point;
mod ticker;

/// A mounted simulation. Dropping it unmounts it.
#[derive(Debug)]
pub struct Mount {
    point: PathBuf,
    /// The kernel's number of the mount.
    identity: Option<String>,
    robots: usize,
    session: Option<BackgroundSession>,
    ticker: Option<Background>,
}

/// What was done to the folder before something was mounted there; a person wants to know it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Found {
    /// The folder was not there, and was made.
    pub made: bool,
    /// A simulator that died had left its mount, and it was taken away.
    pub stale: bool,
}

/// An unmount waits so long for the kernel's farewell; it does not come while a file is open.
const FAREWELL_NS: i64 = 500 * MILLISECOND_NS;

impl Mount {
    /// Mounts a simulation at a folder, which must be empty, or is made.
    ///
    /// A mount that a dead simulator of ours left there is taken away first.
    ///
    /// - `events`: how programs read the events of buttons and speaker.
    ///
    /// # Errors
    ///
    /// [`MountError`], before anything is mounted.
    pub fn new(
        simulation: &Simulation,
        point: &Path,
        events: EventLayout,
    ) -> Result<(Self, Found), MountError> {
        let (point, found) = point::prepare(point)?;
        let robots = simulation.robots();
        let bricks: Vec<Arc<SimBrick>> = (0..robots).map(|robot| simulation.brick(robot)).collect();
        let open = Arc::new(Open::default());
        let files = Files::new(bricks, Arc::clone(&open), events);
        let mut config = Config::default();
        config.mount_options =
            vec![MountOption::FSName(point::SOURCE.to_owned()), MountOption::NoAtime];
        // A brick's devices are open to all users; the kernel lets only root share a mount.
        if geteuid().is_root() {
            config.acl = SessionACL::All;
        }
        let failed = |source| MountError::Failed { point: point.clone(), source };
        let session =
            Session::new(files, &point, &config).and_then(Session::spawn).map_err(failed)?;
        let ticker = ticker::start(simulation.clone(), open).map_err(failed)?;
        let identity = point::identity(&point);
        Ok((Self { point, identity, robots, session: Some(session), ticker: Some(ticker) }, found))
    }

    /// The folder, as the kernel calls it.
    #[must_use]
    pub fn point(&self) -> &Path {
        &self.point
    }

    /// The root of a robot's brick.
    #[must_use]
    pub fn root(&self, robot: usize) -> PathBuf {
        if self.robots == 1 { self.point.clone() } else { self.point.join((robot + 1).to_string()) }
    }

    /// True if it was unmounted by another program.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.session.as_ref().is_none_or(|session| session.guard.is_finished())
    }

    /// Unmounts. Files that are still open answer until this process ends, and ENOTCONN after that.
    ///
    /// # Errors
    ///
    /// [`MountError::Failed`] if the kernel refuses; the mount stays.
    pub fn unmount(mut self) -> Result<(), MountError> {
        self.end()
    }

    fn end(&mut self) -> Result<(), MountError> {
        drop(self.ticker.take());
        let Some(session) = self.session.take() else { return Ok(()) };
        // Another program may have unmounted it, and even have mounted something new.
        if self.identity.is_some() && point::identity(&self.point) == self.identity {
            point::detach(&self.point)
                .map_err(|source| MountError::Failed { point: self.point.clone(), source })?;
        }
        let has_ended = || session.guard.is_finished();
        if !MonotonicClock.wait_for(FAREWELL_NS, MILLISECOND_NS, &has_ended) {
            log::info!(
                "{}: files are still open; they answer until this program ends",
                self.point.display()
            );
        }
        // Dropped, it would unmount by path once more, and hit whatever is mounted there by then.
        // What is left is a descriptor.
        std::mem::forget(session);
        Ok(())
    }
}

impl Drop for Mount {
    fn drop(&mut self) {
        if let Err(error) = self.end() {
            log::warn!("{error}");
        }
    }
}
