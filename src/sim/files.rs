//! For programs in this process: a brick's files as a [`Tree`]. The mounted file system
//! goes through the same one.
//!
//! Beside `sys` there are two streams of input events, the buttons and the speaker, and the
//! screen's memory. A read of a stream takes what came since the last one; there is no ioctl here,
//! so the keys that are held at the start are not known. In `sim`, where no program looks for
//! anything, is the truth about the robot.

mod open;
mod told;
mod truth;

use std::path::Path;

use nix::errno::Errno;

pub(crate) use self::open::{Device, Kind, SimFile, Write};
use super::brick::Brick;
use super::driver::Entry;
use super::driver::input::EventLayout;
use super::simulation::Simulation;
use crate::ev3dev::{Access, AttributeFile, Tree};

/// The interval at which waiting readers look again: the period of the fastest worker that wakes
/// any.
pub(crate) const LOOK_NS: i64 = 10_000_000;

/// One robot's brick.
#[derive(Debug)]
pub struct SimBrick {
    simulation: Simulation,
    robot: usize,
}

impl SimBrick {
    pub(crate) fn new(simulation: Simulation, robot: usize) -> Self {
        Self { simulation, robot }
    }

    /// The entries of a folder as `lstat` shows them, sorted by name.
    ///
    /// # Errors
    ///
    /// ENOENT where there is no such folder.
    pub fn entries(&self, folder: &str) -> Result<Vec<Entry>, Errno> {
        self.look(|brick| brick.list(folder.trim_matches('/')))
    }

    /// One entry, as `lstat` shows it.
    ///
    /// # Errors
    ///
    /// ENOENT where there is none.
    pub fn entry(&self, path: &str) -> Result<Entry, Errno> {
        self.look(|brick| brick.entry(path.trim_matches('/')))
    }

    /// Where a symbolic link points to, relative to its folder.
    ///
    /// # Errors
    ///
    /// ENOENT where there is nothing, EINVAL where there is no link.
    pub fn target(&self, path: &str) -> Result<String, Errno> {
        self.look(|brick| brick.target(path.trim_matches('/')))
    }

    fn look<R>(&self, look: impl FnOnce(&Brick) -> Result<R, Errno>) -> Result<R, Errno> {
        let state = self.simulation.state();
        look(state.bricks.get(self.robot).ok_or(Errno::ENOENT)?)
    }
}

impl Tree for SimBrick {
    fn list(&self, folder: &str) -> Result<Vec<String>, Errno> {
        Ok(self.entries(folder)?.into_iter().map(|entry| entry.name).collect())
    }

    fn open(&self, path: &str, access: Access) -> Result<Box<dyn AttributeFile>, Errno> {
        let path = path.trim_start_matches('/');
        Ok(Box::new(self.open_file(path, access, EventLayout::NATIVE)?))
    }

    fn root(&self) -> &Path {
        Path::new("simulated brick")
    }
}
