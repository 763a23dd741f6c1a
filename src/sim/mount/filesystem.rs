//! The kernel's questions and their answers.

use std::ffi::OsStr;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use fuser::{
    AccessFlags, BsdFileFlags, FileAttr, FileHandle, FileType, Filesystem, FopenFlags, Generation, INodeNo,
    IoctlFlags, LockOwner, OpenAccMode, OpenFlags, PollEvents, PollFlags, PollNotifier, RenameFlags,
    ReplyAttr, ReplyCreate, ReplyData, ReplyDirectory, ReplyEmpty, ReplyEntry, ReplyIoctl, ReplyOpen,
    ReplyPoll, ReplyWrite, ReplyXattr, Request, TimeOrNow, WriteFlags,
};
use nix::errno::Errno;
use nix::unistd::{getgid, getuid};

use super::handle::{Handle, Listed, Read};
use super::nodes::{Nodes, Place, ROOT};
use super::open::Open;
use crate::clock::wall_ns;
use crate::ev3dev::Access;
use crate::sim::brick::tree::SCREEN;
use crate::sim::door::Write;
use crate::sim::driver::input::EventLayout;
use crate::sim::{Entry, EntryKind, SimBrick};

/// The kernel need not ask again for folders that are always there.
const LASTING: Duration = Duration::from_secs(3600);

/// Folders with so many parts are ports, `sys/devices/platform/ev3-ports/ev3-ports:outA/lego-port/port4`, or lie above them. What comes
/// and goes lies in them.
const LASTING_PARTS: usize = 7;

/// What the kernel takes for a number that it does not know yet.
const UNKNOWN: u64 = 0xffff_ffff;

/// The files of one or several bricks.
#[derive(Debug)]
pub(super) struct Files {
    bricks: Vec<Arc<SimBrick>>,
    nodes: Mutex<Nodes>,
    open: Arc<Open>,
    layout: EventLayout,
    mounted: SystemTime,
}

impl Files {
    pub(super) fn new(bricks: Vec<Arc<SimBrick>>, open: Arc<Open>, layout: EventLayout) -> Self {
        let nodes = Mutex::new(Nodes::new(bricks.len()));
        let mounted = UNIX_EPOCH + Duration::from_nanos(wall_ns().cast_unsigned());
        Self { bricks, nodes, open, layout, mounted }
    }

    fn nodes(&self) -> MutexGuard<'_, Nodes> {
        self.nodes.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn place(&self, node: INodeNo) -> Result<Place, Errno> {
        self.nodes().place(node.0).cloned().ok_or(Errno::ENOENT)
    }

    fn brick(&self, robot: usize) -> Result<&Arc<SimBrick>, Errno> {
        self.bricks.get(robot).ok_or(Errno::ENOENT)
    }

    fn entry(&self, place: &Place) -> Result<Entry, Errno> {
        match place.robot {
            Some(robot) => self.brick(robot)?.entry(&place.path),
            None => Ok(Entry::folder("")),
        }
    }

    /// The place of an entry of a folder.
    fn inside(&self, folder: &Place, name: &OsStr) -> Result<Place, Errno> {
        let name = name.to_str().ok_or(Errno::ENOENT)?;
        if folder.robot.is_none() {
            let robot = (0..self.bricks.len()).find(|robot| (robot + 1).to_string() == name);
            return Ok(Place { robot: Some(robot.ok_or(Errno::ENOENT)?), path: String::new() });
        }
        let path = if folder.path.is_empty() { name.to_owned() } else { format!("{}/{name}", folder.path) };
        Ok(Place { robot: folder.robot, path })
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

    fn list(&self, node: INodeNo) -> Result<Vec<Listed>, Errno> {
        let folder = self.place(node)?;
        let entries = match folder.robot {
            Some(robot) => self.brick(robot)?.entries(&folder.path)?,
            None => (1..=self.bricks.len()).map(|number| Entry::folder(&number.to_string())).collect(),
        };
        let nodes = self.nodes();
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

    fn open_file(&self, node: INodeNo, flags: OpenFlags) -> Result<(Handle, FopenFlags), Errno> {
        let place = self.place(node)?;
        let brick = self.brick(place.robot.ok_or(Errno::EISDIR)?)?;
        let access = match flags.acc_mode() {
            OpenAccMode::O_RDONLY => Access::Read,
            OpenAccMode::O_WRONLY => Access::Write,
            OpenAccMode::O_RDWR => Access::ReadWrite,
        };
        if place.path == SCREEN {
            // With the kernel's pages under it, so that it can be mapped, and with a last write when it is closed.
            return Ok((Handle::Screen(Arc::clone(brick)), FopenFlags::empty()));
        }
        // Each read and write comes here as it is; a writer that waits holds up no other.
        let direct = FopenFlags::FOPEN_DIRECT_IO | FopenFlags::FOPEN_NOFLUSH;
        if let Some(file) = brick.open_stream(&place.path, access, self.layout) {
            let handle = Handle::Events { file: file?, bytes: Vec::new(), readers: Vec::new(), poller: None };
            return Ok((handle, direct | FopenFlags::FOPEN_STREAM));
        }
        let file = brick.open_attribute(&place.path, access)?;
        let handle = Handle::Attribute { file, text: Vec::new(), poller: None };
        Ok((handle, direct | FopenFlags::FOPEN_PARALLEL_DIRECT_WRITES))
    }

    fn look_up(&self, parent: INodeNo, name: &OsStr) -> Result<(FileAttr, Duration), Errno> {
        let place = self.inside(&self.place(parent)?, name)?;
        let entry = self.entry(&place)?;
        let ttl = lifetime(&place, &entry);
        let number = self.nodes().look_up(place);
        Ok((self.attributes(number, &entry), ttl))
    }

    fn attributes_of(&self, node: INodeNo) -> Result<(FileAttr, Duration), Errno> {
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

/// For how long the kernel may believe what it was told: devices come and go, and so do links to them.
fn lifetime(place: &Place, entry: &Entry) -> Duration {
    let lasts = entry.kind == EntryKind::Folder && place.path.split('/').count() <= LASTING_PARTS;
    if lasts { LASTING } else { Duration::ZERO }
}

impl Filesystem for Files {
    fn lookup(&self, _request: &Request, parent: INodeNo, name: &OsStr, reply: ReplyEntry) {
        match self.look_up(parent, name) {
            Ok((attributes, ttl)) => reply.entry(&ttl, &attributes, Generation(0)),
            Err(errno) => reply.error(refusal(errno)),
        }
    }

    fn forget(&self, _request: &Request, node: INodeNo, lookups: u64) {
        self.nodes().forget(node.0, lookups);
    }

    fn getattr(&self, _request: &Request, node: INodeNo, _file: Option<FileHandle>, reply: ReplyAttr) {
        match self.attributes_of(node) {
            Ok((attributes, ttl)) => reply.attr(&ttl, &attributes),
            Err(errno) => reply.error(refusal(errno)),
        }
    }

    /// Lengths and times may be set, to no effect: a program truncates what it writes to. Owners and rights may not.
    fn setattr(
        &self,
        request: &Request,
        node: INodeNo,
        mode: Option<u32>,
        uid: Option<u32>,
        gid: Option<u32>,
        _size: Option<u64>,
        _atime: Option<TimeOrNow>,
        _mtime: Option<TimeOrNow>,
        _ctime: Option<SystemTime>,
        file: Option<FileHandle>,
        _crtime: Option<SystemTime>,
        _chgtime: Option<SystemTime>,
        _bkuptime: Option<SystemTime>,
        _flags: Option<BsdFileFlags>,
        reply: ReplyAttr,
    ) {
        if mode.is_some() || uid.is_some() || gid.is_some() {
            reply.error(fuser::Errno::EPERM);
        } else {
            self.getattr(request, node, file, reply);
        }
    }

    fn readlink(&self, _request: &Request, node: INodeNo, reply: ReplyData) {
        let target = self.place(node).and_then(|place| {
            let brick = self.brick(place.robot.ok_or(Errno::EINVAL)?)?;
            brick.target(&place.path)
        });
        match target {
            Ok(target) => reply.data(target.as_bytes()),
            Err(errno) => reply.error(refusal(errno)),
        }
    }

    fn open(&self, _request: &Request, node: INodeNo, flags: OpenFlags, reply: ReplyOpen) {
        match self.open_file(node, flags) {
            Ok((handle, flags)) => reply.opened(FileHandle(self.open.insert(handle)), flags),
            Err(errno) => reply.error(refusal(errno)),
        }
    }

    fn read(
        &self,
        request: &Request,
        _node: INodeNo,
        file: FileHandle,
        offset: u64,
        size: u32,
        flags: OpenFlags,
        _lock_owner: Option<LockOwner>,
        reply: ReplyData,
    ) {
        let read = Read {
            offset,
            room: usize::try_from(size).unwrap_or(usize::MAX),
            blocks: flags.0 & nix::libc::O_NONBLOCK == 0,
            thread: request.pid(),
        };
        // A number that is nothing's drops the reply, which answers EIO.
        if self.open.with(file.0, |handle| Ok(handle.read(&read, reply))) == Ok(true) {
            self.open.watch(file.0);
        }
    }

    fn write(
        &self,
        _request: &Request,
        _node: INodeNo,
        file: FileHandle,
        offset: u64,
        data: &[u8],
        _write_flags: WriteFlags,
        _flags: OpenFlags,
        _lock_owner: Option<LockOwner>,
        reply: ReplyWrite,
    ) {
        match self.open.with(file.0, |handle| handle.write(offset, data)) {
            Ok(Write::Done(taken)) => written(Ok(taken), reply),
            Ok(Write::Waits(waiting)) => {
                // At most one writer waits for a sensor: the next one is refused with EBUSY. Without a thread the reply is dropped: EIO.
                let _ = std::thread::Builder::new()
                    .name("sim-write".to_owned())
                    .spawn(move || written(waiting.finish(), reply));
            }
            Err(errno) => written(Err(errno), reply),
        }
    }

    fn release(
        &self,
        _request: &Request,
        _node: INodeNo,
        file: FileHandle,
        _flags: OpenFlags,
        _lock_owner: Option<LockOwner>,
        _flush: bool,
        reply: ReplyEmpty,
    ) {
        self.open.remove(file.0);
        reply.ok();
    }

    fn opendir(&self, _request: &Request, node: INodeNo, _flags: OpenFlags, reply: ReplyOpen) {
        match self.list(node) {
            Ok(entries) => {
                let number = self.open.insert(Handle::Folder(entries));
                reply.opened(FileHandle(number), FopenFlags::empty());
            }
            Err(errno) => reply.error(refusal(errno)),
        }
    }

    fn readdir(
        &self,
        _request: &Request,
        _node: INodeNo,
        file: FileHandle,
        offset: u64,
        mut reply: ReplyDirectory,
    ) {
        let listed = self.open.with(file.0, |handle| {
            let Handle::Folder(entries) = handle else { return Err(Errno::ENOTDIR) };
            let start = usize::try_from(offset).unwrap_or(usize::MAX);
            for (next, entry) in (1_u64..).zip(entries.iter()).skip(start) {
                if reply.add(INodeNo(entry.number), next, entry.kind, &entry.name) {
                    break;
                }
            }
            Ok(())
        });
        match listed {
            Ok(()) => reply.ok(),
            Err(errno) => reply.error(refusal(errno)),
        }
    }

    fn releasedir(
        &self,
        _request: &Request,
        _node: INodeNo,
        file: FileHandle,
        _flags: OpenFlags,
        reply: ReplyEmpty,
    ) {
        self.open.remove(file.0);
        reply.ok();
    }

    fn poll(
        &self,
        _request: &Request,
        _node: INodeNo,
        file: FileHandle,
        notifier: PollNotifier,
        _events: PollEvents,
        flags: PollFlags,
        reply: ReplyPoll,
    ) {
        let waits = flags.contains(PollFlags::FUSE_POLL_SCHEDULE_NOTIFY);
        let events = self.open.with(file.0, |handle| Ok(handle.poll(waits.then_some(notifier))));
        if waits {
            self.open.watch(file.0);
        }
        match events {
            Ok(events) => reply.poll(events),
            Err(errno) => reply.error(refusal(errno)),
        }
    }

    fn ioctl(
        &self,
        _request: &Request,
        _node: INodeNo,
        file: FileHandle,
        _flags: IoctlFlags,
        command: u32,
        _in_data: &[u8],
        out_size: u32,
        reply: ReplyIoctl,
    ) {
        let room = usize::try_from(out_size).unwrap_or(usize::MAX);
        match self.open.with(file.0, |handle| handle.ioctl(command, room)) {
            Ok((result, bytes)) => reply.ioctl(result, &bytes),
            Err(errno) => reply.error(refusal(errno)),
        }
    }

    fn access(&self, request: &Request, node: INodeNo, mask: AccessFlags, reply: ReplyEmpty) {
        let entry = self.place(node).and_then(|place| self.entry(&place));
        let wanted = mask.bits().cast_unsigned() & 0o7;
        match entry {
            // Root may read and write whatever the rights say, and find out by opening that sysfs does not let it.
            Ok(entry) if request.uid() == 0 && (wanted & 1 == 0 || entry.permissions & 0o111 != 0) => {
                reply.ok()
            }
            Ok(entry) if wanted & !(entry.permissions >> 6) == 0 => reply.ok(),
            Ok(_) => reply.error(fuser::Errno::EACCES),
            Err(errno) => reply.error(refusal(errno)),
        }
    }

    fn flush(
        &self,
        _request: &Request,
        _node: INodeNo,
        _file: FileHandle,
        _owner: LockOwner,
        reply: ReplyEmpty,
    ) {
        reply.ok();
    }

    fn fsync(
        &self,
        _request: &Request,
        _node: INodeNo,
        _file: FileHandle,
        _datasync: bool,
        reply: ReplyEmpty,
    ) {
        reply.ok();
    }

    fn create(
        &self,
        _request: &Request,
        _parent: INodeNo,
        _name: &OsStr,
        _mode: u32,
        _umask: u32,
        _flags: i32,
        reply: ReplyCreate,
    ) {
        reply.error(fuser::Errno::EACCES);
    }

    fn mknod(
        &self,
        _request: &Request,
        _parent: INodeNo,
        _name: &OsStr,
        _mode: u32,
        _umask: u32,
        _rdev: u32,
        reply: ReplyEntry,
    ) {
        reply.error(fuser::Errno::EPERM);
    }

    fn mkdir(
        &self,
        _request: &Request,
        _parent: INodeNo,
        _name: &OsStr,
        _mode: u32,
        _umask: u32,
        reply: ReplyEntry,
    ) {
        reply.error(fuser::Errno::EPERM);
    }

    fn unlink(&self, _request: &Request, _parent: INodeNo, _name: &OsStr, reply: ReplyEmpty) {
        reply.error(fuser::Errno::EPERM);
    }

    fn rmdir(&self, _request: &Request, _parent: INodeNo, _name: &OsStr, reply: ReplyEmpty) {
        reply.error(fuser::Errno::EPERM);
    }

    fn symlink(
        &self,
        _request: &Request,
        _parent: INodeNo,
        _name: &OsStr,
        _target: &Path,
        reply: ReplyEntry,
    ) {
        reply.error(fuser::Errno::EPERM);
    }

    fn rename(
        &self,
        _request: &Request,
        _parent: INodeNo,
        _name: &OsStr,
        _new_parent: INodeNo,
        _new_name: &OsStr,
        _flags: RenameFlags,
        reply: ReplyEmpty,
    ) {
        reply.error(fuser::Errno::EPERM);
    }

    fn link(
        &self,
        _request: &Request,
        _node: INodeNo,
        _new_parent: INodeNo,
        _new_name: &OsStr,
        reply: ReplyEntry,
    ) {
        reply.error(fuser::Errno::EPERM);
    }

    // The kernel remembers ENOSYS and does not ask again.
    fn getxattr(&self, _request: &Request, _node: INodeNo, _name: &OsStr, _size: u32, reply: ReplyXattr) {
        reply.error(fuser::Errno::ENOSYS);
    }

    fn listxattr(&self, _request: &Request, _node: INodeNo, _size: u32, reply: ReplyXattr) {
        reply.error(fuser::Errno::ENOSYS);
    }

    fn setxattr(
        &self,
        _request: &Request,
        _node: INodeNo,
        _name: &OsStr,
        _value: &[u8],
        _flags: i32,
        _position: u32,
        reply: ReplyEmpty,
    ) {
        reply.error(fuser::Errno::ENOSYS);
    }

    fn lseek(
        &self,
        _request: &Request,
        _node: INodeNo,
        _file: FileHandle,
        _offset: i64,
        _whence: i32,
        reply: fuser::ReplyLseek,
    ) {
        reply.error(fuser::Errno::ENOSYS);
    }
}

fn written(answer: Result<usize, Errno>, reply: ReplyWrite) {
    match answer.map(u32::try_from) {
        Ok(Ok(taken)) => reply.written(taken),
        Ok(Err(_)) => reply.error(fuser::Errno::EIO),
        Err(errno) => reply.error(refusal(errno)),
    }
}
