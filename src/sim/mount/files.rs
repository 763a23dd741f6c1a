//! What the kernel is told of files and folders, and what it is given when it opens one.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use fuser::{FileAttr, FileType, FopenFlags, INodeNo, OpenAccMode, OpenFlags};
use nix::errno::Errno;
use nix::unistd::{getgid, getuid};

use super::handle::{Handle, Listed};
use super::nodes::{NodePath, Nodes, ROOT};
use super::open::Open;
use crate::clock::{WallTime, wall_time};
use crate::ev3dev::Access;
use crate::sim::driver::input::EventLayout;
use crate::sim::files::Kind;
use crate::sim::{Entry, EntryKind, SimBrick};
use crate::threads::lock;

/// The kernel need not ask again for folders that are always there.
const LASTING: Duration = Duration::from_secs(3600);

/// Folders with this many parts are ports,
/// `sys/devices/platform/ev3-ports/ev3-ports:outA/lego-port/port4`, or lie above them. What comes
/// and goes lies in them.
const LASTING_PARTS: usize = 7;

/// What the kernel takes for a number that it does not know yet.
const UNKNOWN: u64 = 0xffff_ffff;

/// The files of one or several bricks.
#[derive(Debug)]
pub(super) struct Files {
    bricks: Vec<Arc<SimBrick>>,
    pub(super) nodes: Mutex<Nodes>,
    pub(super) open: Arc<Open>,
    layout: EventLayout,
    mounted: WallTime,
    /// What root has set, by place. Names of devices are never given twice.
    rights: Mutex<BTreeMap<NodePath, u32>>,
}

impl Files {
    pub(super) fn new(bricks: Vec<Arc<SimBrick>>, open: Arc<Open>, layout: EventLayout) -> Self {
        let nodes = Mutex::new(Nodes::new(bricks.len()));
        Self { bricks, nodes, open, layout, mounted: wall_time(), rights: Mutex::default() }
    }

    /// The place with a number.
    pub(super) fn place(&self, node: INodeNo) -> Result<NodePath, Errno> {
        lock(&self.nodes).place(node.0).cloned().ok_or(Errno::ENOENT)
    }

    /// A robot's brick.
    pub(super) fn brick(&self, robot: usize) -> Result<&Arc<SimBrick>, Errno> {
        self.bricks.get(robot).ok_or(Errno::ENOENT)
    }

    /// What `lstat` says of a place.
    pub(super) fn entry(&self, place: &NodePath) -> Result<Entry, Errno> {
        let mut entry = match place.robot {
            Some(robot) => self.brick(robot)?.entry(&place.path)?,
            None => Entry::folder(""),
        };
        if let Some(rights) = lock(&self.rights).get(place) {
            entry.permissions = *rights;
        }
        Ok(entry)
    }

    /// Notes the rights that root has set.
    pub(super) fn set_rights(&self, node: INodeNo, mode: u32) {
        if let Ok(place) = self.place(node) {
            lock(&self.rights).insert(place, mode & 0o7777);
        }
    }

    /// The place of an entry of a folder.
    fn inside(&self, folder: &NodePath, name: &OsStr) -> Result<NodePath, Errno> {
        let name = name.to_str().ok_or(Errno::ENOENT)?;
        if folder.robot.is_none() {
            let robot = (0..self.bricks.len()).find(|robot| (robot + 1).to_string() == name);
            return Ok(NodePath { robot: Some(robot.ok_or(Errno::ENOENT)?), path: String::new() });
        }
        let path = if folder.path.is_empty() {
            name.to_owned()
        } else {
            format!("{}/{name}", folder.path)
        };
        Ok(NodePath { robot: folder.robot, path })
    }

    fn attributes(&self, node: u64, entry: &Entry) -> FileAttr {
        FileAttr {
            ino: INodeNo(node),
            size: entry.size,
            blocks: 0,
            atime: self.mounted,
            mtime: self.mounted,
            ctime: self.mounted,
            crtime: self.mounted,
            kind: kind(entry.kind),
            perm: u16::try_from(entry.permissions).unwrap_or_default(),
            nlink: if entry.kind == EntryKind::Folder { 2 } else { 1 },
            uid: getuid().as_raw(),
            gid: getgid().as_raw(),
            rdev: 0,
            blksize: 4096,
            flags: 0,
        }
    }

    /// A folder, to be read in pieces.
    pub(super) fn list(&self, node: INodeNo) -> Result<Vec<Listed>, Errno> {
        let folder = self.place(node)?;
        let entries = match folder.robot {
            Some(robot) => self.brick(robot)?.entries(&folder.path)?,
            None => {
                (1..=self.bricks.len()).map(|number| Entry::folder(&number.to_string())).collect()
            }
        };
        let nodes = lock(&self.nodes);
        let mut listed = vec![
            Listed { number: node.0, kind: FileType::Directory, name: ".".to_owned() },
            Listed { number: ROOT, kind: FileType::Directory, name: "..".to_owned() },
        ];
        for entry in entries {
            let place = self.inside(&folder, entry.name.as_ref())?;
            let number = nodes.number(&place).unwrap_or(UNKNOWN);
            listed.push(Listed { number, kind: kind(entry.kind), name: entry.name });
        }
        Ok(listed)
    }

    /// Opens a file: what is kept of it, and what the kernel may do with it by itself.
    pub(super) fn open_file(
        &self,
        node: INodeNo,
        flags: OpenFlags,
    ) -> Result<(Handle, FopenFlags), Errno> {
        let place = self.place(node)?;
        let brick = self.brick(place.robot.ok_or(Errno::EISDIR)?)?;
        let access = match flags.acc_mode() {
            OpenAccMode::O_RDONLY => Access::Read,
            OpenAccMode::O_WRONLY => Access::Write,
            OpenAccMode::O_RDWR => Access::ReadWrite,
        };
        let file = brick.open_file(&place.path, access, self.layout)?;
        // Each read and write comes here as it is; a writer that waits holds up no other.
        let direct = FopenFlags::FOPEN_DIRECT_IO | FopenFlags::FOPEN_NOFLUSH;
        let flags = match &file.kind {
            // With the kernel's pages under it, so that it can be mapped, and with a last write
            // when it is closed.
            Kind::Screen => FopenFlags::empty(),
            Kind::Events { .. } => direct | FopenFlags::FOPEN_STREAM,
            Kind::Told(_) => direct,
            Kind::Attribute { .. } => direct | FopenFlags::FOPEN_PARALLEL_DIRECT_WRITES,
        };
        let (bytes, readers) = (Vec::new(), Vec::new());
        Ok((Handle::File { file, bytes, readers, poller: None }, flags))
    }

    /// What the kernel is told of an entry of a folder, and for how long.
    pub(super) fn look_up(
        &self,
        parent: INodeNo,
        name: &OsStr,
    ) -> Result<(FileAttr, Duration), Errno> {
        let place = self.inside(&self.place(parent)?, name)?;
        let entry = self.entry(&place)?;
        let ttl = lifetime(&place, &entry);
        let number = lock(&self.nodes).look_up(place);
        Ok((self.attributes(number, &entry), ttl))
    }

    /// What the kernel is told of a file it knows.
    pub(super) fn attributes_of(&self, node: INodeNo) -> Result<(FileAttr, Duration), Errno> {
        let place = self.place(node)?;
        let entry = self.entry(&place)?;
        Ok((self.attributes(node.0, &entry), lifetime(&place, &entry)))
    }
}

/// An error number as FUSE sends it.
pub(super) fn refusal(errno: Errno) -> fuser::Errno {
    fuser::Errno::from_i32(errno as i32)
}

fn kind(kind: EntryKind) -> FileType {
    match kind {
        EntryKind::File => FileType::RegularFile,
        EntryKind::Folder => FileType::Directory,
        EntryKind::Link => FileType::Symlink,
    }
}

/// For how long the kernel may believe what it was told: devices come and go, and so do links to
/// them.
fn lifetime(place: &NodePath, entry: &Entry) -> Duration {
    let lasts = entry.kind == EntryKind::Folder && place.path.split('/').count() <= LASTING_PARTS;
    if lasts { LASTING } else { Duration::ZERO }
}
