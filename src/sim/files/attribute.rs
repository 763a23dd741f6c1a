//! An open attribute of a simulated brick.

use std::cell::Cell;
use std::sync::Arc;
use std::time::Duration;

use nix::errno::Errno;

use super::{brick_of, copy, wait};
use crate::ev3dev::{Access, AttributeFile};
use crate::sim::driver::{Spec, Wait};
use crate::sim::physics::STEP_NS;
use crate::sim::simulation::Shared;

/// An open attribute.
#[derive(Debug)]
pub(crate) struct SimFile {
    shared: Arc<Shared>,
    robot: usize,
    /// As the journal names it: by class.
    path: String,
    access: Access,
    id: u32,
    spec: Spec,
    /// What the count of notices was at the last read; none before the first.
    seen: Cell<Option<Option<u32>>>,
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
    shared: Arc<Shared>,
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
        self.shared.wait_until(self.wait.until_ns.div_euclid(STEP_NS) * STEP_NS + STEP_NS);
        let mut state = self.shared.now();
        brick_of(&mut state, self.robot)?.registered_ns(self.id).ok_or(Errno::ENODEV)?;
        self.wait.then.map_or(Ok(self.taken), Err)
    }
}

impl SimFile {
    /// Opens an attribute by its path below `sys/class` or `sys/devices`.
    ///
    /// # Errors
    ///
    /// ENOENT, EISDIR; EACCES for the wrong direction, and for writers while the device is new.
    pub(crate) fn open(
        shared: &Arc<Shared>,
        robot: usize,
        path: &str,
        access: Access,
    ) -> Result<Self, Errno> {
        let state = shared.now();
        let brick = state.bricks.get(robot).ok_or(Errno::ENOENT)?;
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
        if (reads && spec.permissions & 0o444 == 0) || (writes && spec.permissions & 0o222 == 0) {
            return Err(Errno::EACCES);
        }
        if writes && brick.is_denied(id, state.now_ns) {
            return Err(Errno::EACCES);
        }
        let (class, name) = brick.name(id).ok_or(Errno::ENOENT)?;
        let path = format!("sys/class/{}/{name}/{attribute}", class.as_str());
        drop(state);
        Ok(Self {
            shared: Arc::clone(shared),
            robot,
            path,
            access,
            id,
            spec,
            seen: Cell::new(None),
        })
    }

    /// True for raw bytes, of which any part can be read; false for a text, which is made when its
    /// beginning is read.
    pub(crate) fn is_binary(&self) -> bool {
        self.spec.size != super::super::driver::TEXT_SIZE
    }

    /// Reads the attribute again, in place of what is in `text`.
    ///
    /// # Errors
    ///
    /// EBADF for a writer's file; ENODEV once the device is gone; else the driver's.
    pub(crate) fn read_into(&self, text: &mut Vec<u8>) -> Result<(), Errno> {
        if self.access == Access::Write {
            return Err(Errno::EBADF);
        }
        let mut state = self.shared.now();
        let now_ns = state.now_ns;
        let brick = brick_of(&mut state, self.robot)?;
        text.clear();
        brick.read(self.id, self.spec.name, now_ns, text)?;
        self.seen.set(Some(brick.notices(self.id, self.spec.name)));
        Ok(())
    }

    /// Stores what one `write` brought. The offset is nothing to a text.
    ///
    /// # Errors
    ///
    /// EBADF for a reader's file; ENODEV once the device is gone; EINVAL for raw bytes that do not
    /// begin at the beginning; else the driver's.
    pub(crate) fn begin_write(&self, offset: u64, value: &[u8]) -> Result<Write, Errno> {
        if self.access == Access::Read {
            return Err(Errno::EBADF);
        }
        let mut state = self.shared.now();
        let stored = if self.is_binary() && offset > 0 {
            Err(Errno::EINVAL)
        } else {
            state.store(self.robot, self.id, self.spec.name, value)
        };
        state.note(self.robot, &self.path, value, stored.map(|stored| stored.taken));
        drop(state);
        let stored = stored?;
        Ok(match stored.wait {
            None => Write::Done(stored.taken),
            Some(wait) => Write::Waits(Waiting {
                shared: Arc::clone(&self.shared),
                robot: self.robot,
                id: self.id,
                taken: stored.taken,
                wait,
            }),
        })
    }

    /// True if the device is gone.
    pub(crate) fn is_gone(&self) -> bool {
        self.notices().is_none()
    }

    /// True if a poll that begins now has something to tell: a change since the last read, or that
    /// the device is gone.
    pub(crate) fn is_changed(&self) -> bool {
        self.notices().is_none_or(|notices| self.seen.get() != Some(notices))
    }

    /// True if a poll that sleeps is to be woken. The removal of a device wakes no poll.
    pub(crate) fn wakes(&self) -> bool {
        // A file that was never read counts as changed, whatever it is. One that cannot wake a poll
        // never does after that.
        self.notices().is_some_and(|notices| self.seen.get() != Some(notices))
    }

    fn notices(&self) -> Option<Option<u32>> {
        let state = self.shared.now();
        let brick = state.bricks.get(self.robot)?;
        brick.registered_ns(self.id).map(|_| brick.notices(self.id, self.spec.name))
    }
}

impl AttributeFile for SimFile {
    fn read(&self, buffer: &mut [u8]) -> Result<usize, Errno> {
        // The simulation's own buffer, so that reads do not allocate.
        let mut text = std::mem::take(&mut self.shared.now().text);
        let read = self.read_into(&mut text).map(|()| copy(&text, buffer));
        self.shared.now().text = text;
        read
    }

    fn write(&self, value: &[u8]) -> Result<usize, Errno> {
        match self.begin_write(0, value)? {
            Write::Done(taken) => Ok(taken),
            Write::Waits(waiting) => waiting.finish(),
        }
    }

    fn wait_changed(&self, timeout: Duration) -> Result<bool, Errno> {
        if self.is_changed() {
            return Ok(true);
        }
        // Who was not woken looks once more when the time is over.
        Ok(wait(&self.shared, timeout, || self.wakes().then_some(()))? || self.is_changed())
    }
}
