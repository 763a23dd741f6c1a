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
    connection: Option<BufReader<UnixStream>>,
    next_id: u64,
    menu: bool,
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

    /// Asks what the network may ask as well.
    ///
    /// # Errors
    ///
    /// [`ClientError`]; the next question reconnects if the connection is gone.
    pub fn ask<T: DeserializeOwned>(
        &mut self,
        request: &Request,
        patience: Duration,
    ) -> Result<T, ClientError> {
        understood(self.exchange(request, patience)?.value)
    }

    /// Asks what only the local socket answers.
    ///
    /// # Errors
    ///
    /// As [`Client::ask`].
    pub fn ask_own<T: DeserializeOwned>(
        &mut self,
        request: &LocalOnly,
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
        let deadline_ns = MonotonicClock.now_ns().saturating_add(span_ns(patience));
        // Only an answer that was read to its end leaves the connection in order.
        let mut connection = self.connected(deadline_ns)?;
        let answered = self.over(&mut connection, request, deadline_ns)?;
        self.connection = Some(connection);
        Ok(answered?)
    }

    /// The connection that there is, if the service has not closed it meanwhile, or a new one.
    fn connected(&mut self, deadline_ns: i64) -> Result<BufReader<UnixStream>, ClientError> {
        if let Some(connection) = self.connection.take()
            && !is_closed(&connection)
        {
            return Ok(connection);
        }
        let stream = UnixStream::connect(&self.path)
            .map_err(|source| ClientError::NoService { path: self.path.clone(), source })?;
        let mut connection = BufReader::new(stream);
        if self.menu {
            self.over(&mut connection, &LocalOnly::MenuHere, deadline_ns)??;
        }
        Ok(connection)
    }

    fn over(
        &mut self,
        connection: &mut BufReader<UnixStream>,
        request: &impl Serialize,
        deadline_ns: i64,
    ) -> Result<Result<Answer, Refusal>, ClientError> {
        let id = self.next_id;
        self.next_id = self.next_id.wrapping_add(1);
        let line =
            json_line(&Envelope { version: VERSION, id, request }).map_err(ClientError::Strange)?;
        let stream = connection.get_mut();
        stream.set_write_timeout(Some(left(deadline_ns)?)).map_err(ClientError::Lost)?;
        stream.write_all(&line).map_err(broken)?;
        let reply = read_reply(connection, deadline_ns)?;
        // A refusal before the request was read has no name.
        if reply.id.as_ref().is_some_and(|answered| *answered != Id::Number(id)) {
            return Err(ClientError::Lost(io::Error::other("it answered another question")));
        }
        Ok(match reply.outcome {
            Outcome::Ok(value) => {
                Ok(Answer { bytes: read_bytes(connection, &value, deadline_ns)?, value })
            }
            Outcome::Error(refusal) => Err(refusal),
        })
    }
}

fn understood<T: DeserializeOwned>(value: serde_json::Value) -> Result<T, ClientError> {
    serde_json::from_value(value).map_err(ClientError::Strange)
}

fn read_reply(
    connection: &mut BufReader<UnixStream>,
    deadline_ns: i64,
) -> Result<Reply, ClientError> {
    let mut line = Vec::new();
    while line.last() != Some(&b'\n') {
        connection
            .get_ref()
            .set_read_timeout(Some(left(deadline_ns)?))
            .map_err(ClientError::Lost)?;
        let arrived = match connection.fill_buf() {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            arrived => arrived.map_err(broken)?,
        };
        let (taken, whole) = match arrived.iter().position(|byte| *byte == b'\n') {
            Some(end) => (end + 1, true),
            None => (arrived.len(), false),
        };
        line.extend_from_slice(arrived.get(..taken).unwrap_or_default());
        connection.consume(taken);
        if taken == 0 || (!whole && line.len() as u64 > LONGEST_REPLY) {
            return Err(ClientError::Lost(io::ErrorKind::UnexpectedEof.into()));
        }
    }
    serde_json::from_slice(&line).map_err(ClientError::Strange)
}

/// What comes after the line of a fetch's answer: it alone has a `length` beside a `sha256`.
fn read_bytes(
    connection: &mut BufReader<UnixStream>,
    value: &serde_json::Value,
    deadline_ns: i64,
) -> Result<Option<Vec<u8>>, ClientError> {
    let Ok(fetched) = serde_json::from_value::<Fetched>(value.clone()) else { return Ok(None) };
    let length = usize::try_from(fetched.length.min(MAX_FETCH_BYTES)).unwrap_or(0);
    let mut bytes = vec![0; length];
    let mut filled = 0;
    while filled < length {
        connection
            .get_ref()
            .set_read_timeout(Some(left(deadline_ns)?))
            .map_err(ClientError::Lost)?;
        match connection.read(bytes.get_mut(filled..).unwrap_or_default()) {
            Ok(0) => return Err(ClientError::Lost(io::ErrorKind::UnexpectedEof.into())),
            Ok(more) => filled += more,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(broken(error)),
        }
    }
    Ok(Some(bytes))
}

/// Nothing is due on a connection between two questions: what can be read is its end.
fn is_closed(connection: &BufReader<UnixStream>) -> bool {
    use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
    use std::os::fd::AsFd;
    let mut look = [PollFd::new(connection.get_ref().as_fd(), PollFlags::POLLIN)];
    poll(&mut look, PollTimeout::ZERO) != Ok(0)
}

fn left(deadline_ns: i64) -> Result<Duration, ClientError> {
    let left_ns = deadline_ns.saturating_sub(MonotonicClock.now_ns());
    match u64::try_from(left_ns) {
        Ok(left_ns) if left_ns > 0 => Ok(Duration::from_nanos(left_ns)),
        _ => Err(ClientError::Silent),
    }
}

fn broken(error: io::Error) -> ClientError {
    match error.kind() {
        io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut => ClientError::Silent,
        _ => ClientError::Lost(error),
    }
}
