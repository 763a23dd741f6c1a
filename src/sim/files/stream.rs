//! An open stream of input events of a simulated brick.

use std::cell::Cell;
use std::sync::Arc;
use std::time::Duration;

use nix::errno::Errno;

use super::{brick_of, copy, wait};
use crate::ev3dev::{Access, AttributeFile, Button};
use crate::sim::brick::Brick;
use crate::sim::driver::input::{EventLayout, Events};
use crate::sim::simulation::Shared;

/// The input devices of a brick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Device {
    Buttons,
    Speaker,
}

/// An open stream of input events.
#[derive(Debug)]
pub(crate) struct StreamFile {
    shared: Arc<Shared>,
    robot: usize,
    device: Device,
    access: Access,
    layout: EventLayout,
    /// The number of the next event to be read.
    next: Cell<usize>,
}

impl StreamFile {
    /// Opens a stream at its end.
    ///
    /// # Errors
    ///
    /// ENOENT without such a robot.
    pub(crate) fn open(
        shared: &Arc<Shared>,
        robot: usize,
        device: Device,
        access: Access,
        layout: EventLayout,
    ) -> Result<Self, Errno> {
        let state = shared.now();
        let brick = state.bricks.get(robot).ok_or(Errno::ENOENT)?;
        let next = Cell::new(events(brick, device).total());
        drop(state);
        Ok(Self { shared: Arc::clone(shared), robot, device, access, layout, next })
    }

    /// Which it is.
    pub(crate) fn device(&self) -> Device {
        self.device
    }

    /// The buttons that are down.
    pub(crate) fn pressed(&self) -> Vec<Button> {
        let state = self.shared.now();
        state.bricks.get(self.robot).map_or_else(Vec::new, |brick| brick.buttons.pressed().to_vec())
    }

    /// True if there is something to read.
    pub(crate) fn is_pending(&self) -> bool {
        let state = self.shared.now();
        let total = state.bricks.get(self.robot).map(|brick| events(brick, self.device).total());
        total.is_some_and(|total| total > self.next.get())
    }

    /// Whole events, at most `room` bytes, in place of what is in `bytes`.
    ///
    /// # Errors
    ///
    /// EAGAIN where there is none, EINVAL where not one fits, EBADF for a writer's file.
    pub(crate) fn read_into(&self, room: usize, bytes: &mut Vec<u8>) -> Result<(), Errno> {
        if self.access == Access::Write {
            return Err(Errno::EBADF);
        }
        let mut state = self.shared.now();
        let brick = brick_of(&mut state, self.robot)?;
        bytes.clear();
        self.next.set(events(brick, self.device).read(
            self.next.get(),
            room,
            self.layout,
            bytes,
        )?);
        Ok(())
    }
}

fn events(brick: &Brick, device: Device) -> &Events {
    match device {
        Device::Buttons => &brick.buttons.events,
        Device::Speaker => &brick.speaker.events,
    }
}

impl AttributeFile for StreamFile {
    fn read(&self, buffer: &mut [u8]) -> Result<usize, Errno> {
        let mut bytes = std::mem::take(&mut self.shared.now().text);
        let read = self.read_into(buffer.len(), &mut bytes).map(|()| copy(&bytes, buffer));
        self.shared.now().text = bytes;
        read
    }

    fn write(&self, value: &[u8]) -> Result<usize, Errno> {
        if self.access == Access::Read {
            return Err(Errno::EBADF);
        }
        if self.device == Device::Buttons {
            // The EV3's buttons have no lights and no sounds: the kernel takes what is written and
            // does nothing.
            return Ok(value.len() / self.layout.length() * self.layout.length());
        }
        let mut state = self.shared.now();
        let now_ns = state.now_ns;
        let answer = brick_of(&mut state, self.robot)?.speaker.write(value, self.layout, now_ns);
        let path = brick_of(&mut state, self.robot)?.board.platform.speaker.unwrap_or_default();
        state.note(self.robot, path, value, answer);
        answer
    }

    fn wait_changed(&self, timeout: Duration) -> Result<bool, Errno> {
        wait(&self.shared, timeout, || self.is_pending().then_some(()))
    }
}
