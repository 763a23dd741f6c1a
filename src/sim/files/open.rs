//! An open file of a simulated brick: an attribute, a stream of input events, the screen's memory,
//! or what is told of the robot.

use std::cell::Cell;
use std::time::Duration;

use nix::errno::Errno;

use super::told::{self, Tells};
use super::{LOOK_NS, SimBrick};
use crate::clock::span_ns;
use crate::ev3dev::{Access, AttributeFile, AttributeSpec, Button, Direction, Legal};
use crate::sim::brick::{Brick, MOST_STORED};
use crate::sim::driver::Wait;
use crate::sim::driver::input::{EventLayout, Events};
use crate::sim::physics::STEP_NS;
use crate::sim::simulation::Simulation;

/// An open file.
#[derive(Debug)]
pub(crate) struct SimFile {
    simulation: Simulation,
    robot: usize,
    access: Access,
    /// What it is.
    pub(crate) kind: Kind,
}

/// What is open.
#[derive(Debug)]
pub(crate) enum Kind {
    /// An attribute of a device.
    Attribute {
        id: u32,
        spec: &'static AttributeSpec,
        /// As the journal names it: by class.
        path: String,
        /// What the count of notices was at the last read; none before the first.
        seen: Cell<Option<Option<u32>>>,
    },
    /// Input events.
    Events {
        device: Device,
        layout: EventLayout,
        /// The number of the next event to be read.
        next: Cell<usize>,
    },
    /// The picture on the screen.
    Screen,
    /// What tells of the robot and takes orders.
    Told(Tells),
}

/// The input devices of a brick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Device {
    Buttons,
    Speaker,
}

/// What a write came to.
#[derive(Debug)]
pub(crate) enum Write {
    /// This many bytes were taken.
    Done(usize),
    /// The writer has to wait.
    Waits(Waiting),
}

/// A write that keeps its writer waiting.
#[derive(Debug)]
pub(crate) struct Waiting {
    simulation: Simulation,
    robot: usize,
    id: u32,
    taken: usize,
    wait: Wait,
}

impl Waiting {
    /// Waits; returns how many bytes were taken.
    ///
    /// # Errors
    ///
    /// The driver's; ENODEV if the device was pulled meanwhile.
    pub(crate) fn finish(self) -> Result<usize, Errno> {
        self.simulation.wait_until(self.wait.until_ns.div_euclid(STEP_NS) * STEP_NS + STEP_NS);
        let state = self.simulation.state();
        let brick = state.bricks.get(self.robot).ok_or(Errno::ENODEV)?;
        brick.node(self.id).ok_or(Errno::ENODEV)?;
        self.wait.then.map_or(Ok(self.taken), Err)
    }
}

impl SimBrick {
    /// Opens a file by its path; a stream at its end.
    ///
    /// # Errors
    ///
    /// ENOENT, EISDIR; EACCES for the wrong direction, and for writers while the device is new.
    pub(crate) fn open_file(
        &self,
        path: &str,
        access: Access,
        layout: EventLayout,
    ) -> Result<SimFile, Errno> {
        let state = self.simulation.state();
        let brick = state.bricks.get(self.robot).ok_or(Errno::ENOENT)?;
        let platform = brick.board.platform;
        let stream = |device| {
            let next = Cell::new(events(brick, device).total);
            Kind::Events { device, layout, next }
        };
        let kind = if platform.buttons == Some(path) {
            stream(Device::Buttons)
        } else if platform.speaker == Some(path) {
            stream(Device::Speaker)
        } else if platform.screen.as_ref().is_ok_and(|screen| screen.device == path) {
            Kind::Screen
        } else if let Some(tells) = Tells::at(path) {
            if tells == Tells::Truth && access != Access::Read {
                return Err(Errno::EACCES);
            }
            Kind::Told(tells)
        } else {
            attribute(brick, path, access)?
        };
        drop(state);
        Ok(SimFile { simulation: self.simulation.clone(), robot: self.robot, access, kind })
    }
}

impl SimFile {
    /// The buttons that are down.
    pub(crate) fn pressed(&self) -> Vec<Button> {
        self.simulation.pressed(self.robot)
    }

    /// What one read gets, at most `room` bytes from an offset. A text is made when its beginning
    /// is read, as sysfs does it, and kept in `bytes` from one read to the next; raw bytes with
    /// every read. Of a stream the offset is nothing.
    ///
    /// # Errors
    ///
    /// EBADF for a writer's file; ENODEV once the device is gone; of a stream EAGAIN where there is
    /// no event and EINVAL where not one fits; ENODATA for a truth that is unknown; else the
    /// driver's.
    pub(crate) fn read_at<'b>(
        &self,
        offset: usize,
        room: usize,
        bytes: &'b mut Vec<u8>,
    ) -> Result<&'b [u8], Errno> {
        if self.access == Access::Write {
            return Err(Errno::EBADF);
        }
        if offset == 0 || bytes.is_empty() || !self.is_text() {
            bytes.clear();
            self.make(room, bytes)?;
        } else if self.is_gone() {
            return Err(Errno::ENODEV);
        }
        let offset = if matches!(self.kind, Kind::Events { .. }) { 0 } else { offset };
        let rest = bytes.get(offset..).unwrap_or_default();
        Ok(rest.get(..room).unwrap_or(rest))
    }

    /// Appends all that can be read now; of a stream whole events, at most `room` bytes.
    fn make(&self, room: usize, bytes: &mut Vec<u8>) -> Result<(), Errno> {
        let state = self.simulation.state();
        let brick = state.bricks.get(self.robot).ok_or(Errno::ENODEV)?;
        match &self.kind {
            Kind::Attribute { id, spec, seen, .. } => {
                brick.read(*id, spec.name, bytes)?;
                seen.set(Some(brick.notices(*id, spec.name)));
            }
            Kind::Events { device, layout, next } => {
                next.set(events(brick, *device).read(next.get(), room, *layout, bytes)?);
            }
            Kind::Screen => bytes.extend_from_slice(brick.lcd_bytes()),
            Kind::Told(tells) => told::tell(*tells, &state, self.robot, bytes)?,
        }
        Ok(())
    }

    /// Takes what one `write` brought. The offset is nothing to a text.
    ///
    /// # Errors
    ///
    /// EBADF for a reader's file; ENODEV once the device is gone; EINVAL for raw bytes that do not
    /// begin at the beginning, for orders that are not understood, and for one that could not be
    /// followed; ENOSPC at the picture's end; else the driver's.
    pub(crate) fn begin_write(&self, offset: usize, value: &[u8]) -> Result<Write, Errno> {
        if self.access == Access::Read {
            return Err(Errno::EBADF);
        }
        let mut state = self.simulation.state();
        let brick = state.bricks.get_mut(self.robot).ok_or(Errno::ENODEV)?;
        match &self.kind {
            Kind::Attribute { id, spec, path, .. } => {
                let stored = if !self.is_text() && offset > 0 {
                    Err(Errno::EINVAL)
                } else {
                    state.store(self.robot, *id, spec.name, value)
                };
                let taken = value.len().min(MOST_STORED);
                state.note(self.robot, path, value, stored.map(|_| taken));
                drop(state);
                let (simulation, robot, id) = (self.simulation.clone(), self.robot, *id);
                Ok(stored?.map_or(Write::Done(taken), |wait| {
                    Write::Waits(Waiting { simulation, robot, id, taken, wait })
                }))
            }
            // The EV3's buttons have no lights and no sounds: the kernel takes what is written and
            // does nothing.
            Kind::Events { device: Device::Buttons, layout, .. } => {
                Ok(Write::Done(value.len() / layout.length() * layout.length()))
            }
            Kind::Events { device: Device::Speaker, layout, .. } => {
                let answer = brick.speaker.write(value, *layout, brick.now_ns);
                let path = brick.board.platform.speaker.unwrap_or_default();
                state.note(self.robot, path, value, answer);
                answer.map(Write::Done)
            }
            Kind::Screen => brick.draw(offset, value).map(Write::Done),
            Kind::Told(_) => {
                drop(state);
                told::order(&self.simulation, self.robot, value).map(Write::Done)
            }
        }
    }

    /// True if a poll that begins now finds something to read.
    pub(crate) fn is_readable(&self) -> bool {
        !matches!(self.kind, Kind::Events { .. }) || self.wakes()
    }

    /// True if a poll that begins now has something to tell: a change since the last read, or that
    /// the device is gone. A file that was never read counts as changed, whatever attribute it is.
    pub(crate) fn is_changed(&self) -> bool {
        matches!(self.kind, Kind::Attribute { .. }) && (self.is_gone() || self.wakes())
    }

    /// True if a poll that sleeps is to be woken. The removal of a device wakes no poll, and
    /// neither does a file that cannot wake one, once it was read.
    pub(crate) fn wakes(&self) -> bool {
        let state = self.simulation.state();
        let Some(brick) = state.bricks.get(self.robot) else { return false };
        match &self.kind {
            Kind::Attribute { id, spec, seen, .. } => {
                brick.node(*id).is_some() && seen.get() != Some(brick.notices(*id, spec.name))
            }
            Kind::Events { device, next, .. } => events(brick, *device).total > next.get(),
            Kind::Screen | Kind::Told(_) => false,
        }
    }

    /// True for what is made when its beginning is read; false for raw bytes, of which any part can
    /// be read.
    fn is_text(&self) -> bool {
        match &self.kind {
            Kind::Attribute { spec, .. } => spec.legal != Legal::Bytes,
            Kind::Told(_) => true,
            Kind::Events { .. } | Kind::Screen => false,
        }
    }

    /// True if its device is gone.
    fn is_gone(&self) -> bool {
        let Kind::Attribute { id, .. } = self.kind else { return false };
        let state = self.simulation.state();
        state.bricks.get(self.robot).and_then(|brick| brick.node(id)).is_none()
    }
}

/// An attribute by its path below `sys/class` or `sys/devices`.
fn attribute(brick: &Brick, path: &str, access: Access) -> Result<Kind, Errno> {
    let (id, attribute) = match brick.locate(path) {
        Some(found) => found,
        None => return Err(brick.list(path).map_or(Errno::ENOENT, |_| Errno::EISDIR)),
    };
    if attribute.is_empty() {
        return Err(Errno::EISDIR);
    }
    let spec = brick.attribute(id, attribute).ok_or(Errno::ENOENT)?;
    let reads = access != Access::Write;
    let writes = access != Access::Read;
    if (reads && spec.direction == Direction::Writeable)
        || (writes && (spec.direction == Direction::Readable || brick.is_denied(id)))
    {
        return Err(Errno::EACCES);
    }
    let node = brick.node(id).ok_or(Errno::ENOENT)?;
    let path = format!("sys/class/{}/{}/{attribute}", node.class.as_str(), node.name);
    Ok(Kind::Attribute { id, spec, path, seen: Cell::new(None) })
}

fn events(brick: &Brick, device: Device) -> &Events {
    match device {
        Device::Buttons => &brick.buttons.events,
        Device::Speaker => &brick.speaker.events,
    }
}

impl AttributeFile for SimFile {
    fn read(&self, buffer: &mut [u8]) -> Result<usize, Errno> {
        // The simulation's own buffer, so that reads do not allocate.
        let mut bytes = std::mem::take(&mut self.simulation.state().text);
        let read = self.read_at(0, buffer.len(), &mut bytes).map(|read| {
            buffer.iter_mut().zip(read).for_each(|(to, from)| *to = *from);
            read.len()
        });
        self.simulation.state().text = bytes;
        read
    }

    fn write(&self, value: &[u8]) -> Result<usize, Errno> {
        match self.begin_write(0, value)? {
            Write::Done(taken) => Ok(taken),
            Write::Waits(waiting) => waiting.finish(),
        }
    }

    fn wait_changed(&self, timeout: Duration) -> Result<bool, Errno> {
        let deadline_ns = self.simulation.time_ns().saturating_add(span_ns(timeout));
        if self.is_changed() {
            return Ok(true);
        }
        while !self.wakes() {
            let now_ns = self.simulation.time_ns();
            if now_ns >= deadline_ns {
                // Who was not woken looks once more when the time is over.
                return Ok(self.is_changed());
            }
            let next_look_ns = (now_ns.div_euclid(LOOK_NS) + 1) * LOOK_NS;
            self.simulation.wait_until(next_look_ns.min(deadline_ns));
        }
        Ok(true)
    }
}
