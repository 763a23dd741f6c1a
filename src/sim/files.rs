//! For programs in this process: a brick's files as a [`Tree`]. The mounted file system
//! goes through the same one.
//!
//! Beside `sys` there are two streams of input events, the buttons and the speaker, and the
//! screen's memory. A read of a stream takes what came since the last one; there is no ioctl here,
//! so the keys that are held at the start are not known. In `sim`, where no program looks for
//! anything, is the truth about the robot.

mod attribute;
mod stream;
mod told;
mod truth;

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use nix::errno::Errno;

pub(crate) use self::attribute::{SimFile, Write};
pub(crate) use self::stream::{Device, StreamFile};
use self::told::Tells;
pub(crate) use self::told::ToldFile;
use super::brick::Brick;
use super::brick::tree::{FAULTS, ORDERS, TRUTH};
use super::driver::Entry;
use super::driver::input::EventLayout;
use super::simulation::{Shared, State};
use crate::ev3dev::{Access, AttributeFile, Platform, Tree};

/// The interval at which waiting readers look again: the period of the fastest worker that wakes
/// any.
pub(crate) const LOOK_NS: i64 = 10_000_000;

/// One robot's brick.
#[derive(Debug)]
pub struct SimBrick {
    shared: Arc<Shared>,
    robot: usize,
}

impl SimBrick {
    pub(crate) fn new(shared: Arc<Shared>, robot: usize) -> Self {
        Self { shared, robot }
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
        let state = self.shared.now();
        look(state.bricks.get(self.robot).ok_or(Errno::ENOENT)?)
    }

    /// Opens an attribute.
    pub(crate) fn open_attribute(&self, path: &str, access: Access) -> Result<SimFile, Errno> {
        SimFile::open(&self.shared, self.robot, path, access)
    }

    /// Opens a stream of events; none at a path that is no stream's.
    pub(crate) fn open_stream(
        &self,
        path: &str,
        access: Access,
        layout: EventLayout,
    ) -> Option<Result<StreamFile, Errno>> {
        let platform = self.platform()?;
        let device = if platform.buttons == Some(path) {
            Device::Buttons
        } else if platform.speaker == Some(path) {
            Device::Speaker
        } else {
            return None;
        };
        Some(StreamFile::open(&self.shared, self.robot, device, access, layout))
    }

    fn platform(&self) -> Option<&'static Platform> {
        self.look(|brick| Ok(brick.board.platform)).ok()
    }

    /// Whether a path is the screen's memory.
    pub(crate) fn is_screen(&self, path: &str) -> bool {
        self.look(|brick| Ok(brick.is_screen(path))).unwrap_or(false)
    }

    /// Opens what tells of the robot and takes orders; none at any other path.
    pub(crate) fn open_told(&self, path: &str, access: Access) -> Option<Result<ToldFile, Errno>> {
        let tells = match path {
            TRUTH => Tells::Truth,
            FAULTS => Tells::Wrong,
            ORDERS => Tells::Done,
            _ => return None,
        };
        Some(ToldFile::open(&self.shared, self.robot, tells, access))
    }

    /// Reads the picture on the screen from an offset.
    pub(crate) fn picture(&self, offset: usize, most: usize) -> Result<Vec<u8>, Errno> {
        self.look(|brick| {
            let rest = brick.lcd_bytes().get(offset..).unwrap_or_default();
            Ok(rest.get(..most).unwrap_or(rest).to_vec())
        })
    }

    /// Draws on the screen.
    pub(crate) fn draw(&self, offset: usize, bytes: &[u8]) -> Result<usize, Errno> {
        let mut state = self.shared.now();
        state.bricks.get_mut(self.robot).ok_or(Errno::ENODEV)?.draw(offset, bytes)
    }
}

impl Tree for SimBrick {
    fn list(&self, folder: &str) -> Result<Vec<String>, Errno> {
        Ok(self.entries(folder)?.into_iter().map(|entry| entry.name).collect())
    }

    fn open(&self, path: &str, access: Access) -> Result<Box<dyn AttributeFile>, Errno> {
        let path = path.trim_start_matches('/');
        if let Some(stream) = self.open_stream(path, access, EventLayout::NATIVE) {
            return Ok(Box::new(stream?));
        }
        if self.is_screen(path) {
            let brick = Self::new(Arc::clone(&self.shared), self.robot);
            return Ok(Box::new(ScreenFile { brick, access }));
        }
        if let Some(told) = self.open_told(path, access) {
            return Ok(Box::new(told?));
        }
        Ok(Box::new(self.open_attribute(path, access)?))
    }

    fn root(&self) -> &Path {
        Path::new("simulated brick")
    }
}

/// The open screen: each call is about the whole picture.
#[derive(Debug)]
struct ScreenFile {
    brick: SimBrick,
    access: Access,
}

impl AttributeFile for ScreenFile {
    fn read(&self, buffer: &mut [u8]) -> Result<usize, Errno> {
        if self.access == Access::Write {
            return Err(Errno::EBADF);
        }
        Ok(copy(&self.brick.picture(0, buffer.len())?, buffer))
    }

    fn write(&self, value: &[u8]) -> Result<usize, Errno> {
        if self.access == Access::Read {
            return Err(Errno::EBADF);
        }
        self.brick.draw(0, value)
    }

    fn wait_changed(&self, timeout: Duration) -> Result<bool, Errno> {
        wait(&self.brick.shared, timeout, || None)
    }
}

/// Copies as much as there is room for.
fn copy(from: &[u8], to: &mut [u8]) -> usize {
    let length = from.len().min(to.len());
    for (to, from) in to.iter_mut().zip(from) {
        *to = *from;
    }
    length
}

/// Looks until something is there or the time is over; true if something is.
fn wait(shared: &Shared, timeout: Duration, look: impl Fn() -> Option<()>) -> Result<bool, Errno> {
    let timeout_ns = i64::try_from(timeout.as_nanos()).unwrap_or(i64::MAX);
    let deadline_ns = shared.time_ns().saturating_add(timeout_ns);
    loop {
        if look().is_some() {
            return Ok(true);
        }
        let now_ns = shared.time_ns();
        if now_ns >= deadline_ns {
            return Ok(false);
        }
        let next_look_ns = (now_ns.div_euclid(LOOK_NS) + 1) * LOOK_NS;
        shared.wait_until(next_look_ns.min(deadline_ns));
    }
}

/// A robot's brick in the locked state.
fn brick_of(state: &mut State, robot: usize) -> Result<&mut Brick, Errno> {
    state.bricks.get_mut(robot).ok_or(Errno::ENODEV)
}
