//! A client of the local socket, for the menu and for `onbrick run`: it asks, waits no longer than
//! it is told to, and reconnects by itself.
//!
//! ```no_run
//! use std::time::Duration;
//! use onbrick::service::client::Client;
//! use onbrick::protocol::{Request, Status};
//!
//! let mut client = Client::at("/run/onbrick/socket");
//! let status: Status = client.ask(&Request::Status, Duration::from_secs(1))?;
//! println!("{}: {:?}", status.brick, status.state);
//! # Ok::<(), onbrick::service::client::ClientError>(())
//! ```

use std::io::{self, BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::time::Duration;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::clock::{Clock, MonotonicClock, span_ns};
use crate::printable::json_line;
use crate::protocol::{
    Answer, Envelope, Fetch, Fetched, Id, LocalOnly, MAX_FETCH_BYTES, Outcome, Refusal, Reply,
    Request, VERSION,
};

/// No reply's line is longer, bytes: a list of all runs.
const LONGEST_REPLY: u64 = 16 << 20;

/// Why there is no answer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ClientError {
    /// No service is there: start it.
    #[error("no service answers at {}", path.display())]
    NoService {
        /// The socket.
        path: PathBuf,
        /// What connecting gave.
        source: io::Error,
    },
    /// The service is there and does not answer in time: ask again.
    #[error("the service does not answer")]
    Silent,
    /// The service went away before it answered; what was asked may have been done.
    #[error("the service went away")]
    Lost(#[source] io::Error),
    /// The service does not do it.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// The answer is not to be understood: another version?
    #[error("the service's answer is not to be understood")]
    Strange(#[source] serde_json::Error),
}

/// A client; it connects when it is first asked.
#[derive(Debug)]
pub struct Client {
    path: PathBuf,
    connection: Option<Connection>,
    next_id: u64,
    menu: bool,
}

type Connection = BufReader<Patient>;

/// A stream that is waited for until a deadline, nanoseconds of the monotonic clock.
#[derive(Debug)]
struct Patient {
    stream: UnixStream,
    until_ns: i64,
}

impl Patient {
    fn left(&self) -> io::Result<Duration> {
        let left_ns = self.until_ns.saturating_sub(MonotonicClock.now_ns());
        match u64::try_from(left_ns) {
            Ok(left_ns) if left_ns > 0 => Ok(Duration::from_nanos(left_ns)),
            _ => Err(io::ErrorKind::TimedOut.into()),
        }
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.stream.set_write_timeout(Some(self.left()?))?;
        self.stream.write_all(bytes)
    }
}

impl Read for Patient {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.stream.set_read_timeout(Some(self.left()?))?;
        self.stream.read(bytes)
    }
}

impl Client {
    /// A client of the service at this socket.
    #[must_use]
    pub fn at(socket: impl Into<PathBuf>) -> Self {
        Self { path: socket.into(), connection: None, next_id: 1, menu: false }
    }

    /// A client that is the menu: when its connection closes, the service takes it for the menu's
    /// end ([`LocalOnly::MenuHere`]).
    #[must_use]
    pub fn of_menu_at(socket: impl Into<PathBuf>) -> Self {
        Self { menu: true, ..Self::at(socket) }
    }

    /// Asks for what the network may ask as well, a [`Request`], or for what only the local socket
    /// answers, a [`LocalOnly`].
    ///
    /// # Errors
    ///
    /// [`ClientError`]; the next question reconnects if the connection is gone.
    pub fn ask<T: DeserializeOwned>(
        &mut self,
        request: &impl Serialize,
        patience: Duration,
    ) -> Result<T, ClientError> {
        understood(self.exchange(request, patience)?.value)
    }

    /// Fetches a part of a recording.
    ///
    /// # Errors
    ///
    /// As [`Client::ask`].
    pub fn fetch(
        &mut self,
        fetch: &Fetch,
        patience: Duration,
    ) -> Result<(Fetched, Vec<u8>), ClientError> {
        let Answer { value, bytes } = self.exchange(&Request::Fetch(fetch.clone()), patience)?;
        Ok((understood(value)?, bytes.unwrap_or_default()))
    }

    /// Asks any of these, and gives the answer as it came.
    ///
    /// # Errors
    ///
    /// As [`Client::ask`].
    pub(crate) fn exchange(
        &mut self,
        request: &impl Serialize,
        patience: Duration,
    ) -> Result<Answer, ClientError> {
        let until_ns = MonotonicClock.now_ns().saturating_add(span_ns(patience));
        // Only an answer that was read to its end leaves the connection in order.
        let mut connection = self.connected(until_ns)?;
        let answered = self.over(&mut connection, request)?;
        self.connection = Some(connection);
        Ok(answered?)
    }

    /// The connection that there is, if the service has not closed it meanwhile, or a new one.
    fn connected(&mut self, until_ns: i64) -> Result<Connection, ClientError> {
        if let Some(mut connection) = self.connection.take()
            && !is_closed(&connection)
        {
            connection.get_mut().until_ns = until_ns;
            return Ok(connection);
        }
        let stream = UnixStream::connect(&self.path)
            .map_err(|source| ClientError::NoService { path: self.path.clone(), source })?;
        let mut connection = BufReader::new(Patient { stream, until_ns });
        if self.menu {
            self.over(&mut connection, &LocalOnly::MenuHere)??;
        }
        Ok(connection)
    }

    fn over(
        &mut self,
        connection: &mut Connection,
        request: &impl Serialize,
    ) -> Result<Result<Answer, Refusal>, ClientError> {
        let id = self.next_id;
        self.next_id = self.next_id.wrapping_add(1);
        let line =
            json_line(&Envelope { version: VERSION, id, request }).map_err(ClientError::Strange)?;
        connection.get_mut().write_all(&line).map_err(broken)?;
        let reply = read_reply(connection)?;
        // A refusal before the request was read has no name.
        if reply.id.as_ref().is_some_and(|answered| *answered != Id::Number(id)) {
            return Err(ClientError::Lost(io::Error::other("it answered another question")));
        }
        Ok(match reply.outcome {
            Outcome::Ok(value) => Ok(Answer { bytes: read_bytes(connection, &value)?, value }),
            Outcome::Error(refusal) => Err(refusal),
        })
    }
}

fn understood<T: DeserializeOwned>(value: serde_json::Value) -> Result<T, ClientError> {
    serde_json::from_value(value).map_err(ClientError::Strange)
}

fn read_reply(connection: &mut Connection) -> Result<Reply, ClientError> {
    let mut line = Vec::new();
    connection.take(LONGEST_REPLY).read_until(b'\n', &mut line).map_err(broken)?;
    if line.last() != Some(&b'\n') {
        return Err(ClientError::Lost(io::ErrorKind::UnexpectedEof.into()));
    }
    serde_json::from_slice(&line).map_err(ClientError::Strange)
}

/// What comes after the line of a fetch's answer: it alone has a `length` beside a `sha256`.
fn read_bytes(
    connection: &mut Connection,
    value: &serde_json::Value,
) -> Result<Option<Vec<u8>>, ClientError> {
    let Ok(fetched) = serde_json::from_value::<Fetched>(value.clone()) else { return Ok(None) };
    let length = u64::from(fetched.length.min(MAX_FETCH_BYTES));
    let mut bytes = Vec::new();
    connection.take(length).read_to_end(&mut bytes).map_err(broken)?;
    if (bytes.len() as u64) < length {
        return Err(ClientError::Lost(io::ErrorKind::UnexpectedEof.into()));
    }
    Ok(Some(bytes))
}

/// Nothing is due on a connection between two questions: what can be read is its end.
fn is_closed(connection: &Connection) -> bool {
    use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
    use std::os::fd::AsFd;
    let mut look = [PollFd::new(connection.get_ref().stream.as_fd(), PollFlags::POLLIN)];
    poll(&mut look, PollTimeout::ZERO) != Ok(0)
}

fn broken(error: io::Error) -> ClientError {
    match error.kind() {
        io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut => ClientError::Silent,
        _ => ClientError::Lost(error),
    }
}
