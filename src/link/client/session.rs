//! A line to a brick: connections one after the other, and requests that are repeated over them
//! until they are answered.

use std::net::SocketAddr;
use std::sync::atomic::Ordering;
use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::address::Address;
use super::connection::{Connection, Over, Received, Stage};
use super::{ClientError, Patience, Silence};
use crate::clock::{Clock as _, MILLISECOND_NS, MonotonicClock, SECOND_NS, seconds};
use crate::link::curve;
use crate::link::keys::{KeyPair, PublicKey};
use crate::link::pairing::well_known_key;
use crate::protocol::{Envelope, Id, Kind, Outcome, VERSION};
use crate::threads::spawn;

/// How long one waits before one looks again, nanoseconds: the first time, and at most.
const FIRST_BACKOFF_NS: i64 = 100 * MILLISECOND_NS;
const LAST_BACKOFF_NS: i64 = 2 * SECOND_NS;

/// A request that is not answered for this long is sent again over a new connection, nanoseconds:
/// the first time, and at most.
const FIRST_WAIT_NS: i64 = 3 * SECOND_NS;
const LAST_WAIT_NS: i64 = 10 * SECOND_NS;

/// So often in a row a handshake may be broken off before the key is said to be another one: a
/// brick that is flooded breaks off now and then.
const BREAK_OFFS: u32 = 4;

/// An interrupt is noticed within this time, milliseconds.
const NAP_MS: i64 = 100;
const NAP: Duration = Duration::from_millis(NAP_MS as u64);

/// A silence that is worth a word, nanoseconds.
const WORTH_A_WORD_NS: i64 = 2 * SECOND_NS;

/// A line to one brick.
pub(in crate::link) struct Session {
    context: zmq::Context,
    pub(super) written: String,
    address: Address,
    key: PublicKey,
    own: KeyPair,
    pub(super) patience: Patience,
    connection: Option<Connection>,
    /// Which of the host's addresses is tried next.
    turn: usize,
    next_id: u64,
    backoff_ns: i64,
    break_offs: u32,
    silence: Silence,
    /// When the brick was last heard, or the waiting began.
    heard_ns: i64,
    /// There has been a connection since then.
    was_there: bool,
    has_said: bool,
}

crate::printable::debug_by!(Session, written);

/// An answer with the bytes beside it, or why there is none.
pub(super) type Answered = Result<(Value, Option<Vec<u8>>), ClientError>;

impl Session {
    pub(in crate::link) fn new(
        address: &str,
        usual_port: u16,
        key: PublicKey,
        own: &KeyPair,
        patience: Patience,
    ) -> Result<Self, ClientError> {
        curve::require()?;
        Ok(Self {
            context: zmq::Context::new(),
            written: address.to_owned(),
            address: Address::parse(address, usual_port),
            key,
            own: own.clone(),
            patience,
            connection: None,
            turn: 0,
            next_id: 1,
            backoff_ns: 0,
            break_offs: 0,
            silence: Silence::NoConnection,
            heard_ns: MonotonicClock.now_ns(),
            was_there: false,
            has_said: false,
        })
    }

    /// The deadline of a caller that begins to wait now.
    pub(super) fn deadline_ns(&self) -> i64 {
        MonotonicClock.now_ns().saturating_add(self.patience.most_ns)
    }

    /// Asks until it is answered or the patience is over.
    pub(in crate::link) fn ask<T: DeserializeOwned>(
        &mut self,
        request: &impl Serialize,
    ) -> Result<T, ClientError> {
        self.begin();
        let id = self.number();
        let mut wait_ns = FIRST_WAIT_NS;
        loop {
            if !self.send(id, request)? {
                continue;
            }
            let until_ns = MonotonicClock.now_ns().saturating_add(wait_ns);
            while let Some((of, answer)) = self.receive(until_ns)? {
                // Another one is a late answer: its caller has given up.
                if of == id {
                    return self.understood(answer?.0);
                }
            }
            wait_ns = (wait_ns * 2).min(LAST_WAIT_NS);
        }
    }

    /// The patience begins from scratch.
    pub(super) fn begin(&mut self) {
        self.heard_ns = MonotonicClock.now_ns();
        self.was_there = self.connection.is_some();
        self.has_said = false;
    }

    /// A number for a request.
    pub(super) fn number(&mut self) -> u64 {
        let id = self.next_id;
        self.next_id += 1;
        id
    }

    /// Sends a request over a connection that is there or is made; false where that has broken and
    /// is to be tried again.
    ///
    /// # Errors
    ///
    /// When the patience is over, or there is no sense in trying again.
    pub(super) fn send(&mut self, id: u64, request: &impl Serialize) -> Result<bool, ClientError> {
        let envelope = Envelope { version: VERSION, id, request };
        let json = serde_json::to_vec(&envelope)
            .map_err(|error| self.not_understood(format!("a request that is no JSON: {error}")))?;
        if !self.connect()? {
            return Ok(false);
        }
        let sent = self.connection.as_ref().map_or(Ok(false), |connection| connection.send(&json));
        if !sent? {
            self.connection = None;
            self.pause()?;
            return Ok(false);
        }
        Ok(true)
    }

    /// Waits for the next reply, which comes with its request's number. `None` where the connection
    /// broke, and with it all requests that were under way; one that is silent until then is hung
    /// up.
    pub(super) fn receive(
        &mut self,
        until_ns: i64,
    ) -> Result<Option<(u64, Answered)>, ClientError> {
        loop {
            let Some(connection) = &mut self.connection else { return Ok(None) };
            if let Some(received) = connection.receive()? {
                (self.heard_ns, self.has_said, self.backoff_ns) =
                    (MonotonicClock.now_ns(), false, 0);
                return Ok(Some(self.taken(received)));
            }
            if let Stage::Over(over) = connection.stage() {
                self.ended(over)?;
                self.pause()?;
                return Ok(None);
            }
            let left_ms = until_ns.saturating_sub(MonotonicClock.now_ns()) / MILLISECOND_NS;
            if left_ms <= 0 {
                self.check_patience()?;
                self.silence = Silence::NoReply;
                self.connection = None;
                return Ok(None);
            }
            connection.wait(left_ms.min(NAP_MS))?;
            self.check_patience()?;
        }
    }

    /// A reply's number and what it says.
    fn taken(&self, received: Received) -> (u64, Answered) {
        let last_id = self.next_id.saturating_sub(1);
        let reply = match received.reply {
            Ok(reply) => reply,
            Err(message) => return (last_id, Err(self.not_understood(message))),
        };
        let id = match reply.id {
            Some(Id::Number(id)) => id,
            // A request of ours that the brick could not parse has no number; no other client's
            // reply comes here.
            _ => last_id,
        };
        let answer = match reply.outcome {
            Outcome::Ok(value) => Ok((value, received.bytes)),
            Outcome::Error(refusal) if refusal.kind == Kind::NotAuthorised => {
                Err(ClientError::NotAuthorised { address: self.written.clone() })
            }
            Outcome::Error(refusal) => Err(ClientError::Refused(refusal)),
        };
        (id, answer)
    }

    /// An answer as what it should be.
    pub(super) fn understood<T: DeserializeOwned>(&self, value: Value) -> Result<T, ClientError> {
        serde_json::from_value(value).map_err(|error| self.not_understood(error.to_string()))
    }

    pub(super) fn not_understood(&self, message: String) -> ClientError {
        ClientError::NotUnderstood { address: self.written.clone(), message }
    }

    /// Makes sure that there is a connection with both keys shown; false where it broke off and is
    /// to be tried again.
    fn connect(&mut self) -> Result<bool, ClientError> {
        if self.connection.is_none() {
            let found = self.resolved()?;
            let Some(to) = found.get(self.turn % found.len().max(1)) else {
                self.silence = Silence::NoSuchName;
                self.pause()?;
                return Ok(false);
            };
            let opened = Connection::open(&self.context, *to, self.key, &self.own);
            self.connection = Some(opened?);
        }
        loop {
            self.check_patience()?;
            let Some(connection) = &mut self.connection else { return Ok(false) };
            match connection.stage() {
                Stage::Open => {
                    self.break_offs = 0;
                    self.was_there = true;
                    self.silence = Silence::NoReply;
                    return Ok(true);
                }
                Stage::Calling => self.silence = Silence::NoConnection,
                Stage::Greeting => self.silence = Silence::NoHandshake,
                Stage::Over(over) => {
                    self.turn = self.turn.wrapping_add(1);
                    self.ended(over)?;
                    self.pause()?;
                    return Ok(false);
                }
            }
            connection.wait(NAP_MS)?;
        }
    }

    /// Where the brick is. The system takes its own time over a name, so a thread asks it, and is
    /// waited for no longer than the brick.
    fn resolved(&mut self) -> Result<Vec<SocketAddr>, ClientError> {
        let address = self.address.clone();
        let (tell, told) = std::sync::mpsc::sync_channel(1);
        if spawn("name", move || tell.send(address.resolve())).is_err() {
            return Ok(self.address.resolve());
        }
        loop {
            match told.recv_timeout(NAP) {
                Ok(found) => return Ok(found),
                Err(RecvTimeoutError::Disconnected) => return Ok(Vec::new()),
                Err(RecvTimeoutError::Timeout) => {
                    self.silence = Silence::NoSuchName;
                    self.check_patience()?;
                }
            }
        }
    }

    /// Draws the conclusion from a connection's end.
    fn ended(&mut self, over: Over) -> Result<(), ClientError> {
        self.connection = None;
        match over {
            Over::NotLetIn => {
                return Err(ClientError::NotAuthorised { address: self.written.clone() });
            }
            // Each pairing window has this key: only its time can be over, or not come yet.
            Over::BrokeOff if self.key == well_known_key() => self.silence = Silence::NoHandshake,
            Over::BrokeOff => {
                self.break_offs += 1;
                if self.break_offs >= BREAK_OFFS {
                    self.break_offs = 0;
                    return Err(ClientError::AnotherKey { address: self.written.clone() });
                }
            }
            Over::TooMuch => {
                let message = "it sends much more than was asked for".to_owned();
                return Err(self.not_understood(message));
            }
            Over::Mute => self.silence = Silence::NoHandshake,
            Over::NoConnection => self.silence = Silence::NoConnection,
            Over::Lost => self.silence = Silence::NoReply,
        }
        Ok(())
    }

    /// Waits a little longer each time.
    fn pause(&mut self) -> Result<(), ClientError> {
        self.backoff_ns = (self.backoff_ns * 2).clamp(FIRST_BACKOFF_NS, LAST_BACKOFF_NS);
        let until_ns = MonotonicClock.now_ns().saturating_add(self.backoff_ns);
        while MonotonicClock.now_ns() < until_ns {
            self.check_patience()?;
            let nap_ns = MonotonicClock.now_ns().saturating_add(NAP_MS * MILLISECOND_NS);
            MonotonicClock.sleep_until_ns(nap_ns.min(until_ns));
        }
        Ok(())
    }

    /// Ends the waiting where it has lasted too long, or was interrupted.
    pub(super) fn check_patience(&mut self) -> Result<(), ClientError> {
        if self.patience.cancelled.as_ref().is_some_and(|flag| flag.load(Ordering::Relaxed)) {
            self.connection = None;
            return Err(ClientError::Interrupted);
        }
        let waited_ns = MonotonicClock.now_ns().saturating_sub(self.heard_ns);
        let most_ns = if self.was_there { self.patience.most_ns } else { self.patience.absent_ns };
        if waited_ns >= most_ns {
            self.connection = None;
            let waited_s = seconds(waited_ns);
            return Err(ClientError::NoAnswer {
                address: self.written.clone(),
                waited_s,
                silence: self.silence,
            });
        }
        if waited_ns >= WORTH_A_WORD_NS && !self.has_said && !self.patience.is_quiet {
            self.has_said = true;
            log::warn!("{}: {}; trying again", self.written, self.silence);
        }
        Ok(())
    }
}
