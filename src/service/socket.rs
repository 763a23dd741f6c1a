//! The local socket: a Unix socket with file permissions, for the menu, `onbrick run` and a
//! person's scripts on the brick itself.
//!
//! Requests and replies are lines of JSON ([`protocol`](crate::protocol)); after the reply to a
//! `fetch` come as many bytes as its `length` says. Requests of one connection are answered in
//! their order.
//!
//! Each client has a thread, so a slow or silent one does not delay the others. The cost of a
//! client is bounded: the number of connections, the length of a line, and one *long* line at a
//! time.
//!
//! # Not here
//!
//! What an operation does. Whether a user may come in is the kernel's decision, by the socket's
//! mode and group.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::os::unix::fs::{PermissionsExt, chown};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use nix::sys::socket::{getsockopt, sockopt::PeerCredentials};
use nix::unistd::Gid;

use super::config::SocketConfig;
use crate::clock::{Clock, MILLISECOND_NS, MonotonicClock};
use crate::printable::json_line;
use crate::protocol::{
    Answer, Asked, Caller, Id, Kind, LocalOnly, LocalRequest, MAX_REQUEST_BYTES, Operations,
    Refusal, Reply, Request, parse_local,
};
use crate::runtime::groups;
use crate::threads::{lock, spawn};

/// Connections at a time.
pub const MAX_CLIENTS: usize = 128;

/// Who may use the socket: its user and its group.
const MODE: u32 = 0o660;

/// Lines up to here are taken from every client at once; longer ones carry a mission's text, and
/// come one at a time.
const SHORT_LINE: usize = 16 << 10;

/// How long a reply waits for a client that does not read, and a long line for its end.
const PATIENCE: Duration = Duration::from_secs(5);

/// Only a part of it is ever used; the deepest is the check of a mission.
const STACK_BYTES: usize = 1 << 20;

/// Why the socket cannot be opened.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SocketError {
    /// A service answers there already: stop it, or use another configuration.
    #[error("a service is at {} already", .0.display())]
    Taken(PathBuf),
    /// There is no such group: make it, or name another.
    #[error("the socket's group `{0}` is not there")]
    NoGroup(String),
    /// The socket cannot be made: look at its folder.
    #[error("cannot make the socket {}", path.display())]
    Io {
        /// The socket.
        path: PathBuf,
        /// What went wrong.
        source: io::Error,
    },
}

/// The open socket; the socket's file goes when this is dropped. Clients that are connected stay
/// so.
#[derive(Debug)]
pub struct LocalSocket {
    path: PathBuf,
}

impl LocalSocket {
    /// Opens the socket and answers in threads of its own from now on.
    ///
    /// # Errors
    ///
    /// [`SocketError`].
    pub fn open(
        config: &SocketConfig,
        operations: Arc<dyn Operations>,
    ) -> Result<Self, SocketError> {
        let path = config.path.clone();
        let failed = |source| SocketError::Io { path: path.clone(), source };
        let listener = listen(config)?;
        let socket = Self { path: path.clone() };
        let clients =
            Clients { operations, clients: AtomicUsize::new(0), long_line: Mutex::new(()) };
        spawn("socket", move || Arc::new(clients).accept(&listener)).map_err(failed)?;
        Ok(socket)
    }
}

impl Drop for LocalSocket {
    fn drop(&mut self) {
        // From now on a client shall be told that there is no service.
        let _ = std::fs::remove_file(&self.path);
    }
}

fn listen(config: &SocketConfig) -> Result<UnixListener, SocketError> {
    let path = &config.path;
    let failed = |source| SocketError::Io { path: path.clone(), source };
    let number = |name: &String| {
        let found = groups::number_of(name).map_err(failed)?;
        found.ok_or_else(|| SocketError::NoGroup(name.clone()))
    };
    let group = config.group.as_ref().map(number).transpose()?;
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(failed)?;
    }
    clear(path)?;
    let listener = UnixListener::bind(path).map_err(failed)?;
    // Until here the usual umask lets only our own user write to it, that is, connect.
    if group.is_some() {
        chown(path, None, group.map(Gid::as_raw)).map_err(failed)?;
    }
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(MODE)).map_err(failed)?;
    Ok(listener)
}

/// Takes away what a service that died has left.
fn clear(path: &Path) -> Result<(), SocketError> {
    match UnixStream::connect(path) {
        Ok(_) => Err(SocketError::Taken(path.to_owned())),
        Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => {
            std::fs::remove_file(path)
                .map_err(|source| SocketError::Io { path: path.to_owned(), source })
        }
        // What is no socket stays; binding will say so.
        Err(_) => Ok(()),
    }
}

/// What the clients' threads share.
struct Clients {
    operations: Arc<dyn Operations>,
    clients: AtomicUsize,
    long_line: Mutex<()>,
}

impl Clients {
    fn accept(self: &Arc<Self>, listener: &UnixListener) {
        loop {
            match listener.accept() {
                Ok((stream, _)) => self.serve(stream),
                Err(error) => {
                    // Too many open files, as a rule: clients leave in time.
                    log::warn!("the local socket accepts no connection: {error}");
                    MonotonicClock.sleep_ns(100 * MILLISECOND_NS);
                }
            }
        }
    }

    fn serve(self: &Arc<Self>, stream: UnixStream) {
        let client = ClientThread { clients: Arc::clone(self) };
        if self.clients.fetch_add(1, Ordering::Relaxed) >= MAX_CLIENTS {
            let refusal =
                Refusal::new(Kind::TooMany, format!("{MAX_CLIENTS} clients are connected already"));
            // It has just come, so a line fits into its buffer; if not, it is left without a word.
            let _ = stream.set_nonblocking(true);
            let _ = send(&stream, None, Err(refusal));
            return;
        }
        let thread = std::thread::Builder::new().name("client".to_owned()).stack_size(STACK_BYTES);
        if let Err(error) = thread.spawn(move || client.talk(&stream)) {
            log::warn!("no thread for a client: {error}");
        }
    }
}

/// A client, counted while it is in.
struct ClientThread {
    clients: Arc<Clients>,
}

impl Drop for ClientThread {
    fn drop(&mut self) {
        self.clients.clients.fetch_sub(1, Ordering::Relaxed);
    }
}

impl ClientThread {
    fn talk(&self, stream: &UnixStream) {
        let Ok(peer) = getsockopt(stream, PeerCredentials) else { return };
        let mut caller = Caller::Here;
        let mut at_end = None;
        // However the talk ends: closed, broken, too slow.
        if let Err(error) = self.requests(stream, &mut caller, &mut at_end) {
            log::debug!("process {} at the local socket: {error}", peer.pid());
        }
        if let Some(request) = at_end {
            let stopped = self.operate(&request, &caller);
            log::debug!("menu or starter is gone: {stopped:?}");
        }
    }

    fn requests(
        &self,
        stream: &UnixStream,
        caller: &mut Caller,
        at_end: &mut Option<LocalRequest>,
    ) -> io::Result<()> {
        stream.set_write_timeout(Some(PATIENCE))?;
        let mut reader = BufReader::new(stream);
        let mut line = Vec::new();
        loop {
            line.clear();
            match self.read_line(stream, &mut reader, &mut line)? {
                LineRead::End => return Ok(()),
                LineRead::TooLong => {
                    let message = format!(
                        "a request has at most {MAX_REQUEST_BYTES} bytes, and ends with a \
                         line's end"
                    );
                    // What follows in the stream cannot be told from the rest of it.
                    return send(stream, None, Err(Refusal::bad_request(message)));
                }
                LineRead::Whole => {}
            }
            let (id, answered) = self.answer(&line, caller, at_end);
            send(stream, id, answered)?;
        }
    }

    fn read_line(
        &self,
        stream: &UnixStream,
        reader: &mut BufReader<&UnixStream>,
        line: &mut Vec<u8>,
    ) -> io::Result<LineRead> {
        if read_up_to(reader, line, SHORT_LINE)? == 0 {
            return Ok(LineRead::End);
        }
        if line.last() != Some(&b'\n') && line.len() >= SHORT_LINE {
            let _one_at_a_time = lock(&self.clients.long_line);
            stream.set_read_timeout(Some(PATIENCE))?;
            read_up_to(reader, line, MAX_REQUEST_BYTES + 1)?;
            stream.set_read_timeout(None)?;
        }
        match line.last() {
            Some(b'\n') => {
                line.pop();
                Ok(LineRead::Whole)
            }
            _ if line.len() > MAX_REQUEST_BYTES => Ok(LineRead::TooLong),
            // A client that went away in the middle of a word.
            _ => Ok(LineRead::End),
        }
    }

    fn answer(
        &self,
        line: &[u8],
        caller: &mut Caller,
        at_end: &mut Option<LocalRequest>,
    ) -> (Option<Id>, Result<Answer, Refusal>) {
        match parse_local(line) {
            Ok(Asked { id, request }) => {
                match &request {
                    LocalRequest::Own(LocalOnly::MenuHere) => {
                        *caller = Caller::Menu;
                        *at_end = Some(LocalRequest::Own(LocalOnly::MenuClosed));
                    }
                    LocalRequest::Own(LocalOnly::StarterHere { run }) => {
                        let stop = Request::Stop { run: Some(run.clone()) };
                        *at_end = Some(LocalRequest::Shared(stop));
                    }
                    _ => {}
                }
                (Some(id), self.operate(&request, caller))
            }
            Err(error) => (error.id, Err(error.refusal)),
        }
    }

    fn operate(&self, request: &LocalRequest, caller: &Caller) -> Result<Answer, Refusal> {
        let operations = &self.clients.operations;
        match request {
            LocalRequest::Shared(request) => operations.shared(request, caller),
            LocalRequest::Own(request) => operations.own(request, caller),
        }
    }
}

/// What was read.
enum LineRead {
    /// A line, without its end.
    Whole,
    /// More than a request may have.
    TooLong,
    /// The client is gone.
    End,
}

/// Reads on to the line's end, or until `line` has `most` bytes; how many it has then.
fn read_up_to(
    reader: &mut BufReader<&UnixStream>,
    line: &mut Vec<u8>,
    most: usize,
) -> io::Result<usize> {
    let more = u64::try_from(most.saturating_sub(line.len())).unwrap_or(0);
    reader.by_ref().take(more).read_until(b'\n', line)?;
    Ok(line.len())
}

fn send(
    mut stream: &UnixStream,
    id: Option<Id>,
    answered: Result<Answer, Refusal>,
) -> io::Result<()> {
    let (reply, bytes) = Reply::to(id, answered);
    stream.write_all(&json_line(&reply)?)?;
    bytes.map_or(Ok(()), |bytes| stream.write_all(&bytes))
}
