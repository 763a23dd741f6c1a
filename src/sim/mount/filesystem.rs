//! The kernel's questions and their answers, one function each.

use std::ffi::OsStr;
use std::path::Path;

use fuser::{
    AccessFlags, BsdFileFlags, FileHandle, Filesystem, FopenFlags, Generation, INodeNo, IoctlFlags,
    LockOwner, OpenFlags, PollEvents, PollFlags, PollNotifier, RenameFlags, ReplyAttr, ReplyCreate,
    ReplyData, ReplyDirectory, ReplyEmpty, ReplyEntry, ReplyIoctl, ReplyLseek, ReplyOpen,
    ReplyPoll, ReplyWrite, ReplyXattr, Request, TimeOrNow, WriteFlags,
};
use nix::errno::Errno;

use super::files::{Files, refusal};
use super::handle::{Handle, Read};
use crate::clock::WallTime;
use crate::sim::files::Write;
use crate::threads;
use crate::threads::lock;

/// Questions that always have the same answer, each with the types of what it brings.
macro_rules! always {
    ($answer:ident $errno:tt: $($question:ident($($what:ty),+) -> $reply:ty;)+) => {
        $(fn $question(&self, _request: &Request, $(_: $what,)+ reply: $reply) {
            reply.$answer $errno;
        })+
    };
}

/// Answers with what was found, or with why it was not.
macro_rules! answer {
    ($reply:ident, $found:expr, $what:pat => $answer:expr) => {
        match $found {
            Ok($what) => $answer,
            Err(errno) => $reply.error(refusal(errno)),
        }
    };
}

impl Filesystem for Files {
    fn lookup(&self, _request: &Request, parent: INodeNo, name: &OsStr, reply: ReplyEntry) {
        let found = self.look_up(parent, name);
        answer!(reply, found, (entry, ttl) => reply.entry(&ttl, &entry, Generation(0)));
    }

    fn forget(&self, _request: &Request, node: INodeNo, lookups: u64) {
        lock(&self.nodes).forget(node.0, lookups);
    }

    fn getattr(
        &self,
        _request: &Request,
        node: INodeNo,
        _file: Option<FileHandle>,
        reply: ReplyAttr,
    ) {
        answer!(reply, self.attributes_of(node), (found, ttl) => reply.attr(&ttl, &found));
    }

    /// Lengths and times may be set, to no effect: a program truncates what it writes to. Rights
    /// may be set by root, as udev's rules do on a brick; owners may not.
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
        _ctime: Option<WallTime>,
        file: Option<FileHandle>,
        _crtime: Option<WallTime>,
        _chgtime: Option<WallTime>,
        _bkuptime: Option<WallTime>,
        _flags: Option<BsdFileFlags>,
        reply: ReplyAttr,
    ) {
        let allowed = uid.is_none() && gid.is_none() && (mode.is_none() || request.uid() == 0);
        if !allowed {
            reply.error(fuser::Errno::EPERM);
            return;
        }
        if let Some(mode) = mode {
            self.set_rights(node, mode);
        }
        self.getattr(request, node, file, reply);
    }

    fn readlink(&self, _request: &Request, node: INodeNo, reply: ReplyData) {
        let target = self.place(node).and_then(|place| {
            let brick = self.brick(place.robot.ok_or(Errno::EINVAL)?)?;
            brick.target(&place.path)
        });
        answer!(reply, target, target => reply.data(target.as_bytes()));
    }

    fn open(&self, _request: &Request, node: INodeNo, flags: OpenFlags, reply: ReplyOpen) {
        let opened = self.open_file(node, flags);
        let opened = opened.map(|(handle, flags)| (FileHandle(self.open.insert(handle)), flags));
        answer!(reply, opened, (number, flags) => reply.opened(number, flags));
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
                // At most one writer waits for a sensor: the next one is refused with EBUSY.
                // Without a thread the reply is dropped: EIO.
                let _ = threads::spawn("sim-write", move || written(waiting.finish(), reply));
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
        let listed = self.list(node);
        let number = listed.map(|entries| FileHandle(self.open.insert(Handle::Folder(entries))));
        answer!(reply, number, number => reply.opened(number, FopenFlags::empty()));
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
        answer!(reply, listed, () => reply.ok());
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
        answer!(reply, events, events => reply.poll(events));
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
        let done = self.open.with(file.0, |handle| handle.ioctl(command, room));
        answer!(reply, done, (result, bytes) => reply.ioctl(result, &bytes));
    }

    fn access(&self, request: &Request, node: INodeNo, mask: AccessFlags, reply: ReplyEmpty) {
        let wanted = mask.bits().cast_unsigned() & 0o7;
        let allowed = self.place(node).and_then(|place| self.entry(&place)).and_then(|entry| {
            // Root may read and write whatever the rights say, and find out by opening that sysfs
            // does not let it.
            let rights = match request.uid() {
                0 if entry.permissions & 0o111 != 0 => 0o7,
                0 => 0o6,
                _ => entry.permissions >> 6,
            };
            if wanted & !rights == 0 { Ok(()) } else { Err(Errno::EACCES) }
        });
        answer!(reply, allowed, () => reply.ok());
    }

    always! { ok():
        flush(INodeNo, FileHandle, LockOwner) -> ReplyEmpty;
        fsync(INodeNo, FileHandle, bool) -> ReplyEmpty;
    }

    always! { error(fuser::Errno::EACCES):
        create(INodeNo, &OsStr, u32, u32, i32) -> ReplyCreate;
    }

    always! { error(fuser::Errno::EPERM):
        mknod(INodeNo, &OsStr, u32, u32, u32) -> ReplyEntry;
        mkdir(INodeNo, &OsStr, u32, u32) -> ReplyEntry;
        unlink(INodeNo, &OsStr) -> ReplyEmpty;
        rmdir(INodeNo, &OsStr) -> ReplyEmpty;
        symlink(INodeNo, &OsStr, &Path) -> ReplyEntry;
        rename(INodeNo, &OsStr, INodeNo, &OsStr, RenameFlags) -> ReplyEmpty;
        link(INodeNo, INodeNo, &OsStr) -> ReplyEntry;
    }

    // The kernel remembers ENOSYS and does not ask again.
    always! { error(fuser::Errno::ENOSYS):
        getxattr(INodeNo, &OsStr, u32) -> ReplyXattr;
        listxattr(INodeNo, u32) -> ReplyXattr;
        setxattr(INodeNo, &OsStr, &[u8], i32, u32) -> ReplyEmpty;
        lseek(INodeNo, FileHandle, i64, i32) -> ReplyLseek;
    }
}

fn written(answer: Result<usize, Errno>, reply: ReplyWrite) {
    let taken = answer.and_then(|taken| u32::try_from(taken).map_err(|_| Errno::EIO));
    answer!(reply, taken, taken => reply.written(taken));
}
