//! The seed's node: a program that was written for the seed reads and writes a simulated brick's
//! files over ZeroMQ.
//!
//! One REP socket without keys. A request is one frame of text, and so is its reply:
//!
//! | request | reply |
//! |---|---|
//! | `r:PATH` | the file's text, without white space at its end |
//! | `w:DATA:PATH` | `ok`; DATA has no colon |
//! | `l:PATH` | the names in a folder, with spaces between |
//!
//! `error` is the reply to all else, and to what a file refuses. A file that was opened is kept
//! open, as the seed did.
//!
//! # What can be reached
//!
//! The seed's server gave every file of its machine to everyone on the network: its main flaw. This
//! one serves simulated bricks alone, and the command line lets it listen on 127.0.0.1 alone. The
//! kernel looks every path up as if the brick's folder was `/` (openat2 with `RESOLVE_IN_ROOT`):
//! neither `..` nor a link leads out of it, and no path leads to another file system, or to a file
//! that a process has open.
//!
//! # Not here
//!
//! Real bricks: the file is not in their program.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::os::fd::{AsRawFd as _, OwnedFd};
use std::os::unix::fs::FileExt as _;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use nix::errno::Errno;
use nix::fcntl::{OFlag, OpenHow, ResolveFlag, open, openat2};
use nix::sys::stat::Mode;

use crate::threads::Background;

/// How long a node waits for a request before it looks whether to end, milliseconds.
const LOOK_MS: i32 = 50;

/// A sysfs file's most, bytes.
const PAGE: usize = 4096;

/// The most files that are kept open; then all are closed, and opened as they are asked for.
const MOST_KEPT: usize = 64;

/// How often a file is opened while others are renamed, before its reply is `error`.
const MOST_TRIES: usize = 100;

/// The longest request, bytes: a page of data, and a path.
const LONGEST: i64 = 8192;

/// Why there is no node.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NodeError {
    /// Mount a brick there first.
    #[error("no simulated brick's folder can be opened there")]
    Root(#[source] Errno),
    /// Another program listens there, or it is no address of this machine.
    #[error("cannot listen at {address}")]
    Listen {
        /// Where.
        address: String,
        /// What libzmq said.
        source: zmq::Error,
    },
    /// The system gives no thread.
    #[error("no thread can be started")]
    Thread(#[source] io::Error),
}

/// A node that serves one brick's files until it is dropped.
#[derive(Debug)]
pub struct Node {
    address: String,
    _answering: Background,
}

impl Node {
    /// Serves the files below a brick's root at an address (`127.0.0.1:5555`; port 0 takes any that
    /// is free). Everyone who reaches the address can read and write them.
    ///
    /// # Errors
    ///
    /// [`NodeError`].
    pub fn serve(root: &Path, address: &str) -> Result<Self, NodeError> {
        let flags = OFlag::O_PATH | OFlag::O_DIRECTORY | OFlag::O_CLOEXEC;
        let root = open(root, flags, Mode::empty()).map_err(NodeError::Root)?;
        let listen = || {
            let socket = zmq::Context::new().socket(zmq::REP)?;
            socket.set_linger(0)?;
            socket.set_rcvtimeo(LOOK_MS)?;
            socket.set_maxmsgsize(LONGEST)?;
            socket.bind(&format!("tcp://{address}"))?;
            let bound = socket.get_last_endpoint()?.unwrap_or_default();
            Ok((socket, bound.trim_start_matches("tcp://").to_owned()))
        };
        let (socket, bound) =
            listen().map_err(|source| NodeError::Listen { address: address.to_owned(), source })?;
        let files = Files { root, kept: BTreeMap::new() };
        let answering = Background::start("node", move |ends| answer_all(&socket, files, ends));
        Ok(Self { address: bound, _answering: answering.map_err(NodeError::Thread)? })
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> &str {
        &self.address
    }
}

fn answer_all(socket: &zmq::Socket, mut files: Files, ends: &AtomicBool) {
    while !ends.load(Ordering::Relaxed) {
        let request = match socket.recv_bytes(0) {
            Ok(request) => request,
            Err(zmq::Error::EAGAIN | zmq::Error::EINTR) => continue,
            Err(error) => return log::error!("the node has ended: {error}"),
        };
        let reply = files.answer(&request).unwrap_or_else(|_| b"error".to_vec());
        if let Err(error) = socket.send(reply, 0) {
            log::warn!("the node could not reply: {error}");
        }
    }
}

/// A brick's files, by paths of the brick.
#[derive(Debug)]
struct Files {
    root: OwnedFd,
    /// By path, and whether to write.
    kept: BTreeMap<(String, bool), File>,
}

impl Files {
    fn answer(&mut self, request: &[u8]) -> Result<Vec<u8>, Errno> {
        let request = std::str::from_utf8(request).map_err(|_| Errno::EILSEQ)?;
        match request.split_once(':') {
            Some(("r", path)) => self.with(path, false, |file| {
                let mut text = vec![0; PAGE];
                let length = file.read_at(&mut text, 0)?;
                text.truncate(length);
                text.truncate(text.trim_ascii_end().len());
                Ok(text)
            }),
            Some(("w", rest)) => {
                let (data, path) = rest.split_once(':').ok_or(Errno::EINVAL)?;
                self.with(path, true, |file| file.write_all_at(data.as_bytes(), 0))?;
                Ok(b"ok".to_vec())
            }
            Some(("l", path)) => self.list(path),
            _ => Err(Errno::EINVAL),
        }
    }

    /// Does something with a file; one that fails is not kept, because its device may be gone.
    fn with<T>(
        &mut self,
        path: &str,
        write: bool,
        does: impl FnOnce(&File) -> io::Result<T>,
    ) -> Result<T, Errno> {
        let key = (path.to_owned(), write);
        let file = match self.kept.remove(&key) {
            Some(file) => file,
            None => {
                let access = if write { OFlag::O_WRONLY } else { OFlag::O_RDONLY };
                // Without it, who reads the buttons' file waits for a button.
                File::from(self.open(path, access | OFlag::O_NONBLOCK)?)
            }
        };
        let done = does(&file)
            .map_err(|error| error.raw_os_error().map_or(Errno::EIO, Errno::from_raw))?;
        if self.kept.len() >= MOST_KEPT {
            self.kept.clear();
        }
        self.kept.insert(key, file);
        Ok(done)
    }

    fn list(&self, path: &str) -> Result<Vec<u8>, Errno> {
        let folder = self.open(path, OFlag::O_RDONLY | OFlag::O_DIRECTORY)?;
        // The folder that was opened, whatever is at its path by now.
        let opened = format!("/proc/self/fd/{}", folder.as_raw_fd());
        let entries = std::fs::read_dir(opened).map_err(|_| Errno::EIO)?;
        let mut names: Vec<String> =
            entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok()).collect();
        names.sort();
        Ok(names.join(" ").into_bytes())
    }

    fn open(&self, path: &str, flags: OFlag) -> Result<OwnedFd, Errno> {
        let resolve = ResolveFlag::RESOLVE_IN_ROOT
            | ResolveFlag::RESOLVE_NO_MAGICLINKS
            | ResolveFlag::RESOLVE_NO_XDEV;
        let path = if path.is_empty() { "." } else { path };
        let how = OpenHow::new().flags(flags | OFlag::O_CLOEXEC).resolve(resolve);
        // The kernel says EAGAIN where anything was renamed while it followed a `..`: it cannot be
        // sure then that it is still below the root.
        let mut tries = std::iter::repeat_with(|| openat2(&self.root, path, how)).take(MOST_TRIES);
        tries.find(|opened| !matches!(opened, Err(Errno::EAGAIN))).unwrap_or(Err(Errno::EAGAIN))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    /// A folder as a brick's, beside a secret.
    fn files() -> (tempfile::TempDir, Files) {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("secret"), "of the machine").unwrap();
        let brick = folder.path().join("brick");
        let motor = brick.join("sys/class/tacho-motor/motor0");
        std::fs::create_dir_all(&motor).unwrap();
        std::fs::write(motor.join("position"), "12 \n").unwrap();
        symlink("motor0", brick.join("sys/class/tacho-motor/link")).unwrap();
        symlink(folder.path().join("secret"), brick.join("absolute")).unwrap();
        symlink("../secret", brick.join("relative")).unwrap();
        symlink("..", brick.join("up")).unwrap();
        symlink("/sys", brick.join("rooted")).unwrap();
        let root = open(&brick, OFlag::O_PATH | OFlag::O_DIRECTORY, Mode::empty()).unwrap();
        (folder, Files { root, kept: BTreeMap::new() })
    }

    fn answer(files: &mut Files, request: &str) -> String {
        let answer = files.answer(request.as_bytes());
        answer.map_or_else(|_| "error".to_owned(), |text| String::from_utf8(text).unwrap())
    }

    #[test]
    fn files_are_read_written_and_listed_with_links_inside() {
        let (_folder, mut files) = files();
        for (request, reply) in [
            ("r:sys/class/tacho-motor/motor0/position", "12"),
            ("r:/sys/class/tacho-motor/link/position", "12"),
            ("r:rooted/class/tacho-motor/link/../motor0/position", "12"),
            ("l:sys/class/tacho-motor", "link motor0"),
            ("w:-7:sys/class/tacho-motor/motor0/position", "ok"),
            ("r:sys/class/tacho-motor/motor0/position", "-7"),
            ("l:sys/class/lego-sensor", "error"),
            ("r:sys/class", "error"),
            ("w:1:sys/class/tacho-motor/motor0/made", "error"),
            ("x:sys", "error"),
            ("w:1", "error"),
            ("", "error"),
        ] {
            assert_eq!(answer(&mut files, request), reply, "{request}");
        }
        assert_eq!(files.answer(b"r:\xff"), Err(Errno::EILSEQ));
    }

    #[test]
    fn a_file_is_opened_while_others_are_renamed() {
        let (folder, files) = files();
        let [one, other] = ["one", "other"].map(|name| folder.path().join(name));
        std::fs::write(&one, "").unwrap();
        let over = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while !over.load(Ordering::Relaxed) {
                    std::fs::rename(&one, &other).unwrap();
                    std::fs::rename(&other, &one).unwrap();
                }
            });
            let path = "sys/class/tacho-motor/link/../motor0/position";
            let opened = (0..20_000).map(|_| files.open(path, OFlag::O_RDONLY).map(drop));
            let refused = opened.filter(Result::is_err).count();
            over.store(true, Ordering::Relaxed);
            assert_eq!(refused, 0, "of 20000");
        });
    }

    #[test]
    fn nothing_outside_the_bricks_folder_is_reached() {
        let (folder, mut files) = files();
        let secret = folder.path().join("secret");
        let paths = [
            "../secret".to_owned(),
            "sys/../../secret".to_owned(),
            secret.display().to_string(),
            "absolute".to_owned(),
            "relative".to_owned(),
            "up/secret".to_owned(),
            "/etc/passwd".to_owned(),
            "/proc/self/fd/0".to_owned(),
        ];
        for path in &paths {
            assert_eq!(answer(&mut files, &format!("r:{path}")), "error", "{path}");
            assert_eq!(answer(&mut files, &format!("w:changed:{path}")), "error", "{path}");
        }
        // What is above the folder is the folder.
        let inside = answer(&mut files, "l:/");
        assert!(inside.contains("rooted") && !inside.contains("secret"), "{inside}");
        for folder in ["l:up", "l:../..", "l:"] {
            assert_eq!(answer(&mut files, folder), inside, "{folder}");
        }
        assert_eq!(std::fs::read_to_string(secret).unwrap(), "of the machine");
    }

    #[test]
    fn no_more_files_are_kept_open_than_was_said() {
        let (folder, mut files) = files();
        for number in 0..3 * MOST_KEPT {
            let name = format!("file{number}");
            std::fs::write(folder.path().join("brick").join(&name), "1").unwrap();
            assert_eq!(answer(&mut files, &format!("r:{name}")), "1");
            assert!(files.kept.len() <= MOST_KEPT);
        }
    }
}
