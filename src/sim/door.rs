//! The door for programs in this process: a brick's files as a [`Tree`].
//!
//! Beside the classes of devices there are two streams of input events: the buttons and the speaker. A read of the buttons takes what came since the
//! last one; there is no ioctl here, so the keys that are held at the start are not known.

use std::cell::Cell;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use nix::errno::Errno;

use super::brick::Class;
use super::driver::{Entry, readable, writeable};
use super::physics::STEP_NS;
use super::simulation::Shared;
use crate::ev3dev::{Access, AttributeFile, Tree};

const INPUT_FOLDER: &str = "dev/input/by-path";
const BUTTONS: &str = "platform-gpio_keys-event";
const SPEAKER: &str = "platform-sound-event";

/// Those who wait look again this often: the period of the fastest worker that wakes anybody.
const LOOK_NS: i64 = 10_000_000;

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
        let state = self.shared.now();
        let brick = state.bricks.get(self.robot).ok_or(Errno::ENOENT)?;
        let folder = folder.trim_matches('/');
        if folder == INPUT_FOLDER {
            return Ok(vec![Entry::file(&readable(BUTTONS)), Entry::file(&writeable(SPEAKER))]);
        }
        let path = folder.strip_prefix("sys/class").ok_or(Errno::ENOENT)?;
        let mut parts = path.trim_start_matches('/').splitn(3, '/');
        let class = parts.next().unwrap_or_default();
        if class.is_empty() {
            return Ok(Class::ALL.iter().map(|class| Entry::folder(class.as_str())).collect());
        }
        let Some(name) = parts.next() else {
            let class = Class::ALL.into_iter().find(|known| known.as_str() == class).ok_or(Errno::ENOENT)?;
            let mut entries: Vec<Entry> = brick.names(class).map(Entry::link).collect();
            entries.sort_by(|one, other| one.name.cmp(&other.name));
            return Ok(entries);
        };
        let id = brick.find(class, name).ok_or(Errno::ENOENT)?;
        brick.entries(id, parts.next().unwrap_or_default())
    }

    fn open_stream(&self, name: &str, access: Access) -> Result<Stream, Errno> {
        let state = self.shared.now();
        let brick = state.bricks.get(self.robot).ok_or(Errno::ENOENT)?;
        match (name, access) {
            (BUTTONS, Access::Read) => Ok(Stream::Buttons(Cell::new(brick.buttons.total()))),
            (SPEAKER, Access::Write) => Ok(Stream::Speaker),
            (BUTTONS | SPEAKER, _) => Err(Errno::EACCES),
            _ => Err(Errno::ENOENT),
        }
    }

    fn open_attribute(&self, path: &str, access: Access) -> Result<SimAttribute, Errno> {
        let state = self.shared.now();
        let brick = state.bricks.get(self.robot).ok_or(Errno::ENOENT)?;
        let mut parts = path.strip_prefix("sys/class/").ok_or(Errno::ENOENT)?.splitn(3, '/');
        let (Some(class), Some(name), Some(attribute)) = (parts.next(), parts.next(), parts.next()) else {
            return Err(Errno::EISDIR);
        };
        let id = brick.find(class, name).ok_or(Errno::ENOENT)?;
        let spec = brick.attribute(id, attribute).ok_or(Errno::ENOENT)?;
        let reads = access != Access::Write;
        let writes = access != Access::Read;
        if (reads && spec.permissions & 0o444 == 0) || (writes && spec.permissions & 0o222 == 0) {
            return Err(Errno::EACCES);
        }
        if writes && brick.is_denied(id, state.now_ns) {
            return Err(Errno::EACCES);
        }
        Ok(SimAttribute { id, name: spec.name, seen: Cell::new(None) })
    }
}

impl Tree for SimBrick {
    fn list(&self, folder: &str) -> Result<Vec<String>, Errno> {
        Ok(self.entries(folder)?.into_iter().map(|entry| entry.name).collect())
    }

    fn open(&self, path: &str, access: Access) -> Result<Box<dyn AttributeFile>, Errno> {
        let path = path.trim_start_matches('/');
        let shared = Arc::clone(&self.shared);
        let robot = self.robot;
        let file: Box<dyn AttributeFile> = match path.strip_prefix(INPUT_FOLDER) {
            Some(name) => {
                let stream = self.open_stream(name.trim_start_matches('/'), access)?;
                Box::new(StreamFile { shared, robot, path: path.to_owned(), stream })
            }
            None => {
                let attribute = self.open_attribute(path, access)?;
                Box::new(SimFile { shared, robot, path: path.to_owned(), access, attribute })
            }
        };
        Ok(file)
    }

    fn root(&self) -> &Path {
        Path::new("simulated brick")
    }
}

#[derive(Debug)]
struct SimAttribute {
    id: u32,
    name: &'static str,
    /// What the count of notices was at the last read; none before the first.
    seen: Cell<Option<Option<u32>>>,
}

/// An open attribute.
#[derive(Debug)]
struct SimFile {
    shared: Arc<Shared>,
    robot: usize,
    path: String,
    access: Access,
    attribute: SimAttribute,
}

impl AttributeFile for SimFile {
    fn read(&self, buffer: &mut [u8]) -> Result<usize, Errno> {
        if self.access == Access::Write {
            return Err(Errno::EBADF);
        }
        let mut state = self.shared.now();
        let state = &mut *state;
        let brick = state.bricks.get(self.robot).ok_or(Errno::ENODEV)?;
        state.text.clear();
        brick.read(self.attribute.id, self.attribute.name, state.now_ns, &mut state.text)?;
        self.attribute.seen.set(Some(brick.notices(self.attribute.id, self.attribute.name)));
        let length = state.text.len().min(buffer.len());
        for (to, from) in buffer.iter_mut().zip(&state.text) {
            *to = *from;
        }
        Ok(length)
    }

    fn write(&self, value: &[u8]) -> Result<usize, Errno> {
        if self.access == Access::Read {
            return Err(Errno::EBADF);
        }
        let mut state = self.shared.now();
        let now_ns = state.now_ns;
        let brick = state.bricks.get_mut(self.robot).ok_or(Errno::ENODEV)?;
        let stored = brick.store(self.attribute.id, self.attribute.name, value, now_ns);
        state.note(self.robot, &self.path, value, stored.map(|stored| stored.taken));
        drop(state);
        let stored = stored?;
        if let Some(wait) = stored.wait {
            self.shared.wait_until(wait.until_ns.div_euclid(STEP_NS) * STEP_NS + STEP_NS);
            // The device may have been pulled meanwhile.
            let state = self.shared.now();
            let brick = state.bricks.get(self.robot).ok_or(Errno::ENODEV)?;
            brick.registered_ns(self.attribute.id).ok_or(Errno::ENODEV)?;
            wait.then.map_or(Ok(()), Err)?;
        }
        Ok(stored.taken)
    }

    fn wait_changed(&self, timeout: Duration) -> Result<bool, Errno> {
        let gone = |shared: &Shared| {
            let state = shared.now();
            state.bricks.get(self.robot).is_none_or(|brick| brick.registered_ns(self.attribute.id).is_none())
        };
        if gone(&self.shared) {
            // POLLERR and POLLPRI at once; one that sleeps already is not woken by the removal.
            return Ok(true);
        }
        wait(&self.shared, timeout, || {
            let state = self.shared.now();
            let brick = state.bricks.get(self.robot)?;
            let notices = brick.notices(self.attribute.id, self.attribute.name);
            // A file that was never read has changed, whatever it is; one that wakes nobody never does after that.
            (self.attribute.seen.get() != Some(notices)).then_some(())
        })
    }
}

#[derive(Debug)]
enum Stream {
    /// With the number of the next event to be read.
    Buttons(Cell<usize>),
    Speaker,
}

/// An open stream of input events.
#[derive(Debug)]
struct StreamFile {
    shared: Arc<Shared>,
    robot: usize,
    path: String,
    stream: Stream,
}

impl AttributeFile for StreamFile {
    fn read(&self, buffer: &mut [u8]) -> Result<usize, Errno> {
        let Stream::Buttons(next) = &self.stream else { return Err(Errno::EBADF) };
        let mut state = self.shared.now();
        let state = &mut *state;
        let brick = state.bricks.get(self.robot).ok_or(Errno::ENODEV)?;
        state.text.clear();
        next.set(brick.buttons.read(next.get(), buffer.len(), &mut state.text)?);
        for (to, from) in buffer.iter_mut().zip(&state.text) {
            *to = *from;
        }
        Ok(state.text.len())
    }

    fn write(&self, value: &[u8]) -> Result<usize, Errno> {
        let Stream::Speaker = self.stream else { return Err(Errno::EBADF) };
        let mut state = self.shared.now();
        let answer = state.bricks.get_mut(self.robot).ok_or(Errno::ENODEV)?.speaker.write(value);
        state.note(self.robot, &self.path, value, answer);
        answer
    }

    fn wait_changed(&self, timeout: Duration) -> Result<bool, Errno> {
        let Stream::Buttons(next) = &self.stream else { return Ok(true) };
        wait(&self.shared, timeout, || {
            let state = self.shared.now();
            (state.bricks.get(self.robot)?.buttons.total() > next.get()).then_some(())
        })
    }
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
