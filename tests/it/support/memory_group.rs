//! A control group of the kernel's with little memory, so that its out-of-memory killer kills what
//! is in it (`cgroups(7)`; Linux, `Documentation/admin-guide/cgroup-v2.rst` and
//! `cgroup-v1/memory.rst`). It needs root and a hierarchy that can be written to.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU32, Ordering};

use nix::unistd::Pid;

use super::pass_over;

/// What its processes may have together, bytes: what one had when it was put there is not counted.
const LIMIT: &str = "16777216";

/// The two versions of the interface: where the hierarchy is, and its files.
#[derive(Debug, Clone, Copy)]
struct Version {
    root: &'static str,
    limit: &'static str,
    /// What keeps its memory from being swapped out instead, and the value that does.
    swap: (&'static str, &'static str),
    /// Has a line `oom_kill` and how often.
    events: &'static str,
}

const VERSIONS: [Version; 3] = [
    Version {
        root: "/sys/fs/cgroup/memory",
        limit: "memory.limit_in_bytes",
        swap: ("memory.swappiness", "0"),
        events: "memory.oom_control",
    },
    Version { root: "/sys/fs/cgroup", ..UNIFIED },
    Version { root: "/sys/fs/cgroup/unified", ..UNIFIED },
];

const UNIFIED: Version = Version {
    root: "",
    limit: "memory.max",
    swap: ("memory.swap.max", "0"),
    events: "memory.events",
};

/// A group of its own; it is taken away when this is dropped, and its processes should be gone by
/// then.
#[derive(Debug)]
pub struct MemoryGroup {
    version: Version,
    folder: PathBuf,
}

impl MemoryGroup {
    pub fn new() -> io::Result<Self> {
        let mut last = io::Error::from(io::ErrorKind::NotFound);
        for version in VERSIONS {
            match Self::of(version) {
                Ok(group) => return Ok(group),
                Err(error) => last = error,
            }
        }
        Err(last)
    }

    fn of(version: Version) -> io::Result<Self> {
        static NUMBER: AtomicU32 = AtomicU32::new(1);
        let root = Path::new(version.root);
        if version.limit == UNIFIED.limit {
            // Where the controller is there already, writing this again changes nothing.
            fs::write(root.join("cgroup.subtree_control"), "+memory")?;
        } else if !root.join(version.limit).exists() {
            return Err(io::ErrorKind::NotFound.into());
        }
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let folder = root.join(format!("onbrick-test-{}-{number}", std::process::id()));
        fs::create_dir(&folder)?;
        let group = Self { version, folder };
        fs::write(group.folder.join(version.limit), LIMIT)?;
        // A kernel without swapping does not have this file.
        let (swap, value) = version.swap;
        match fs::write(group.folder.join(swap), value) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
            _ => Ok(group),
        }
    }

    pub fn put(&self, process: Pid) {
        fs::write(self.folder.join("cgroup.procs"), process.to_string()).unwrap();
    }

    /// How many processes the kernel has killed here because memory ran out.
    pub fn kills(&self) -> u32 {
        let events = fs::read_to_string(self.folder.join(self.version.events)).unwrap();
        let kills = events.lines().find_map(|line| line.strip_prefix("oom_kill "));
        kills.unwrap_or_else(|| panic!("no kills in `{events}`")).parse().unwrap()
    }
}

impl Drop for MemoryGroup {
    fn drop(&mut self) {
        // A group that is not empty stays behind, and does no harm.
        let _ = fs::remove_dir(&self.folder);
    }
}

/// True, and said, where this machine has no such groups for us: one is tried once.
pub fn no_memory_groups() -> bool {
    static REFUSED: OnceLock<Option<String>> = OnceLock::new();
    let refused = REFUSED.get_or_init(|| MemoryGroup::new().err().map(|error| error.to_string()));
    if let Some(refused) = refused {
        pass_over(&format!("a memory cgroup, for the out-of-memory killer ({refused})"));
    }
    refused.is_some()
}
