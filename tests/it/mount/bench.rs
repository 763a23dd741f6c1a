//! A mounted bench, and what looks at it.

use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use nix::errno::Errno;
use onbrick::clock::{Clock, MILLISECOND_NS, MonotonicClock, SECOND_NS, VirtualClock};
use onbrick::ev3dev::{Access, AttributeFile, LocalTree, Tree};
use onbrick::sim::{
    Entry, EntryKind, EventLayout, Mount, Observer, Options, Physics, Port, Simulation, World,
    WorldPhysics,
};

use crate::drivers_bench::{Bench, InProcess, Rig};
use crate::support::pass_over;
pub(crate) use crate::support::real_time::alone as real_time;
use crate::transcript::Control;

/// A mounted simulation in a folder of its own.
pub(crate) struct Mounted {
    // Before the folder, so that it is unmounted before the folder is taken away.
    mount: Mount,
    folder: tempfile::TempDir,
    pub(crate) simulation: Simulation,
    pub(crate) clock: Arc<dyn Clock>,
    rig: Option<Rig>,
    pub(crate) observer: Option<Observer>,
}

/// True, and said, where this machine cannot mount: a mount is tried once.
pub(crate) fn no_fuse() -> bool {
    static REFUSED: OnceLock<Option<String>> = OnceLock::new();
    let refused = REFUSED.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let clock = Arc::new(VirtualClock::default());
        let simulation = Simulation::new(clock, Box::new(Bench::as_recorded()), 1);
        Mount::new(&simulation, folder.path(), EventLayout::NATIVE)
            .err()
            .map(|error| error.to_string())
    });
    if let Some(refused) = refused {
        pass_over(&format!("FUSE ({refused})"));
    }
    refused.is_some()
}

impl Mounted {
    /// The bench of the transcript, over a clock that moves when a thread sleeps on it.
    pub(crate) fn recorded() -> Option<Self> {
        Self::with_options(Options::default())
    }

    /// The same, with a brick that is not as usual.
    pub(crate) fn with_options(options: Options) -> Option<Self> {
        let bench = InProcess::new(Bench::as_recorded(), options);
        let mut mounted = Self::of(bench.simulation.clone(), bench.clock.clone())?;
        let tree = MovingTree { tree: LocalTree::new(mounted.root()), clock: bench.clock.clone() };
        mounted.rig = Some(Rig { bench, tree: Arc::new(tree) });
        Some(mounted)
    }

    /// Any physics, over any clock.
    pub(crate) fn over(physics: impl Physics, clock: Arc<dyn Clock>) -> Option<Self> {
        Self::of(Simulation::new(clock.clone(), Box::new(physics), 1), clock)
    }

    /// Robots in a built-in world.
    pub(crate) fn in_world(world: &str, robots: usize, clock: Arc<dyn Clock>) -> Option<Self> {
        Self::among(World::named(world).unwrap(), robots, clock)
    }

    /// Robots in a world.
    pub(crate) fn among(world: World, robots: usize, clock: Arc<dyn Clock>) -> Option<Self> {
        let physics = WorldPhysics::new(world, robots, 1).unwrap();
        let observer = physics.observer();
        let mounted = Self::over(physics, clock)?;
        Some(Self { observer: Some(observer), ..mounted })
    }

    fn of(simulation: Simulation, clock: Arc<dyn Clock>) -> Option<Self> {
        if no_fuse() {
            return None;
        }
        let folder = tempfile::tempdir().unwrap();
        let (mount, _) = Mount::new(&simulation, folder.path(), EventLayout::NATIVE).unwrap();
        Some(Self { mount, folder, simulation, clock, rig: None, observer: None })
    }

    pub(crate) fn mount(&self) -> &Mount {
        &self.mount
    }

    /// The first brick's root.
    pub(crate) fn root(&self) -> PathBuf {
        self.mount().root(0)
    }

    pub(crate) fn path(&self, path: &str) -> PathBuf {
        self.folder.path().canonicalize().unwrap().join(path)
    }

    pub(crate) fn rig(&self) -> &Rig {
        self.rig.as_ref().unwrap()
    }

    pub(crate) fn open(&self, path: &str, access: Access) -> io::Result<File> {
        OpenOptions::new()
            .read(access != Access::Write)
            .write(access != Access::Read)
            .open(self.path(path))
    }
}

impl Control for Mounted {
    fn unplug(&self, port: Port) {
        self.rig().bench.unplug(port);
    }

    fn plug(&self, port: Port) {
        self.rig().bench.plug(port);
    }

    fn raw(&self, port: Port, frame: &[u8]) {
        self.rig().bench.raw(port, frame);
    }

    fn settle(&self) {
        self.rig().bench.settle();
    }

    /// By `lstat` of what `readdir` gives.
    fn entries(&self, folder: &str) -> Vec<Entry> {
        let folder = self.path(folder);
        let entries = names(&folder).into_iter().map(|name| {
            let metadata = folder.join(&name).symlink_metadata().unwrap();
            let kind = match metadata.mode() & 0o170_000 {
                0o100_000 => EntryKind::File,
                0o040_000 => EntryKind::Folder,
                0o120_000 => EntryKind::Link,
                other => panic!("{name}: kind {other:o}"),
            };
            Entry { name, kind, permissions: metadata.mode() & 0o7777, size: metadata.len() }
        });
        entries.collect()
    }
}

/// The names in a folder, sorted.
pub(crate) fn names(folder: &Path) -> Vec<String> {
    let entries =
        fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

pub(crate) fn errno(error: io::Error) -> Errno {
    Errno::from_raw(error.raw_os_error().unwrap_or_default())
}

/// Waits for something that other threads or programs do, twenty seconds at most.
pub(crate) fn await_or_fail(what: &str, mut is_there: impl FnMut() -> bool) {
    let deadline_ns = MonotonicClock.now_ns() + 20 * SECOND_NS;
    while !is_there() {
        assert!(MonotonicClock.now_ns() < deadline_ns, "{what} did not come");
        MonotonicClock.sleep_ns(5 * MILLISECOND_NS);
    }
}

/// Files of this machine, with a clock that moves only for those who wait on it.
#[derive(Debug)]
struct MovingTree {
    tree: LocalTree,
    clock: Arc<VirtualClock>,
}

impl Tree for MovingTree {
    fn list(&self, folder: &str) -> Result<Vec<String>, Errno> {
        self.tree.list(folder)
    }

    fn open(&self, path: &str, access: Access) -> Result<Box<dyn AttributeFile>, Errno> {
        Ok(Box::new(MovingFile { file: self.tree.open(path, access)?, clock: self.clock.clone() }))
    }

    fn root(&self) -> &Path {
        self.tree.root()
    }
}

#[derive(Debug)]
struct MovingFile {
    file: Box<dyn AttributeFile>,
    clock: Arc<VirtualClock>,
}

impl AttributeFile for MovingFile {
    fn read(&self, buffer: &mut [u8]) -> Result<usize, Errno> {
        self.file.read(buffer)
    }

    fn write(&self, value: &[u8]) -> Result<usize, Errno> {
        self.file.write(value)
    }

    fn wait_changed(&self, timeout: Duration) -> Result<bool, Errno> {
        let deadline_ns = self.clock.now_ns() + i64::try_from(timeout.as_nanos()).unwrap();
        while !self.file.wait_changed(Duration::ZERO)? {
            if self.clock.now_ns() >= deadline_ns {
                return Ok(false);
            }
            let next_ns = (self.clock.now_ns() / (10 * MILLISECOND_NS) + 1) * 10 * MILLISECOND_NS;
            self.clock.sleep_until_ns(next_ns.min(deadline_ns));
        }
        Ok(true)
    }
}
