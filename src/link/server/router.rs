//! A ROUTER socket with CURVE, its monitor and its limits.

use std::net::{IpAddr, Ipv4Addr};
use std::os::fd::RawFd;

use zmq::SocketEvent;

use super::ServerError;
use super::limits::Limits;
use crate::clock::{Clock as _, MILLISECOND_NS, MonotonicClock};
use crate::link::held::Held;
use crate::link::if_ready;
use crate::link::keys::{KeyPair, PublicKey};
use crate::link::monitor::Monitor;
use crate::protocol::MAX_REQUEST_BYTES;

/// Milliseconds: time to shake hands; how often a silent peer is asked whether it lives, and how
/// long it may take to say so.
const HANDSHAKE_MS: i32 = 5000;
const HEARTBEAT_MS: i32 = 2000;
const HEARTBEAT_TIMEOUT_MS: i32 = 6000;

/// What CURVE puts around a message: `MESSAGE` with its length, nonce, flags and authenticator
/// (rfc.zeromq.org/spec/26).
const CURVE_BYTES: usize = 8 + 8 + 1 + 16;

/// Messages that libzmq keeps for each connection.
const REQUESTS_KEPT: i32 = 8;
const REPLIES_KEPT: i32 = 16;

/// How often it is counted what has come, nanoseconds.
const COUNTED_NS: i64 = 100 * MILLISECOND_NS;

/// Connections that wait to be accepted.
const BACKLOG: i32 = 16;

/// One request as it arrived.
#[derive(Debug)]
pub(super) struct Arrived {
    /// The frames that its reply begins with: whose it is and, for a REQ socket, the empty
    /// delimiter.
    pub(super) envelope: Vec<Vec<u8>>,
    /// The key that ZAP has let in; `None` without ZAP.
    pub(super) key: Option<PublicKey>,
    /// The request's one frame; `None` where there were more, or none.
    pub(super) payload: Option<zmq::Message>,
}

/// The socket. It listens from the moment it is made until it is dropped.
pub(super) struct Router {
    socket: zmq::Socket,
    monitor: Monitor,
    limits: Limits,
    /// The port that it listens at.
    pub(super) port: u16,
    /// When it is counted next what has come.
    count_at_ns: i64,
}

impl Router {
    /// Opens a router under one of ZAP's domains.
    pub(super) fn open(
        context: &zmq::Context,
        own: &KeyPair,
        domain: &str,
        endpoint: &str,
    ) -> Result<Self, ServerError> {
        let socket = context.socket(zmq::ROUTER)?;
        configure(&socket, own, domain)?;
        let monitor = Monitor::of(context, &socket)?;
        socket
            .bind(endpoint)
            .map_err(|source| ServerError::Bind { endpoint: endpoint.to_owned(), source })?;
        let bound = socket.get_last_endpoint()?.unwrap_or_default();
        let port = bound.rsplit_once(':').and_then(|(_, port)| port.parse().ok()).unwrap_or(0);
        let now_ns = MonotonicClock.now_ns();
        Ok(Self { socket, monitor, limits: Limits::new(now_ns), port, count_at_ns: now_ns })
    }

    /// For `zmq::poll`: requests, and what the monitor tells.
    pub(super) fn poll_items(&self) -> [zmq::PollItem<'_>; 2] {
        [self.socket.as_poll_item(zmq::POLLIN), self.monitor.poll_item()]
    }

    /// Counts who has come and gone, and shuts what is too much.
    pub(super) fn look_after(&mut self) {
        while let Some(happened) = self.monitor.next() {
            match happened.event {
                SocketEvent::ACCEPTED => self.accepted(happened.value),
                SocketEvent::DISCONNECTED => self.limits.closed(happened.value),
                SocketEvent::ACCEPT_FAILED => {
                    log::warn!(
                        "the link: connections cannot be accepted (errno {})",
                        happened.value
                    )
                }
                _ => {}
            }
        }
        self.count();
    }

    fn accepted(&mut self, descriptor: RawFd) {
        let held = Held::of(descriptor, self.port);
        let peer = held.as_ref().map_or(IpAddr::V4(Ipv4Addr::UNSPECIFIED), |held| held.peer);
        if let Err(why) = self.limits.accepted(descriptor, peer, MonotonicClock.now_ns()) {
            log::debug!("the link: {peer} is shut out: {why:?}");
            held.iter().for_each(Held::shut);
        }
    }

    /// Shuts the connections over which much comes and no request.
    fn count(&mut self) {
        let now_ns = MonotonicClock.now_ns();
        if now_ns < self.count_at_ns {
            return;
        }
        self.count_at_ns = now_ns + COUNTED_NS;
        for descriptor in self.limits.descriptors() {
            if let Some(bytes) = Held::of(descriptor, self.port).and_then(|held| held.received()) {
                self.limits.received(descriptor, bytes);
            }
        }
        for descriptor in self.limits.hoarders(now_ns) {
            if let Some(held) = Held::of(descriptor, self.port) {
                log::warn!(
                    "the link: {} sends much and asks nothing; the connection is shut",
                    held.peer
                );
                held.shut();
            }
        }
    }

    /// The next request, if there is one.
    pub(super) fn receive(&mut self) -> zmq::Result<Option<Arrived>> {
        let Some(mut first) = if_ready(self.socket.recv_msg(zmq::DONTWAIT))? else {
            return Ok(None);
        };
        let mut envelope = vec![first.to_vec()];
        let mut key = key_of(&mut first);
        let mut payload = None;
        let (mut frames, mut bytes, mut peer) = (0, 0, peer_of(&mut first));
        while self.socket.get_rcvmore()? {
            let mut frame = self.socket.recv_msg(0)?;
            if frames == 0
                && frame.is_empty()
                && envelope.len() == 1
                && self.socket.get_rcvmore()?
            {
                envelope.push(Vec::new());
                continue;
            }
            frames += 1;
            bytes += u64::try_from(frame.len()).unwrap_or(u64::MAX);
            peer = peer.or_else(|| peer_of(&mut frame));
            key = key.or_else(|| key_of(&mut frame));
            payload = (frames == 1).then_some(frame);
        }
        if let Some(peer) = peer {
            // With the delimiter, where there is one.
            self.limits.took(peer, frames + 1, bytes);
        }
        Ok(Some(Arrived { envelope, key, payload }))
    }

    /// Sends a reply; a client that has gone away, or reads too slowly, does not get it.
    pub(super) fn reply(&self, frames: Vec<Vec<u8>>) {
        if let Err(error) = self.send(frames) {
            log::debug!("the link: a reply is dropped: {error}");
        }
    }

    fn send(&self, frames: Vec<Vec<u8>>) -> zmq::Result<()> {
        let mut frames = frames.into_iter();
        let whose = frames.next().unwrap_or_default();
        let begin = || self.socket.send(whose.as_slice(), zmq::DONTWAIT | zmq::SNDMORE);
        // libzmq learns only now and then what the client has read meanwhile; asked for its events,
        // it looks.
        let begun = begin().or_else(|error| match error {
            zmq::Error::EAGAIN => self.socket.get_events().and_then(|_| begin()),
            error => Err(error),
        });
        begun.and_then(|()| self.socket.send_multipart(frames, zmq::DONTWAIT))
    }
}

impl Drop for Router {
    fn drop(&mut self) {
        self.monitor.stop(&self.socket);
    }
}

fn configure(socket: &zmq::Socket, own: &KeyPair, domain: &str) -> zmq::Result<()> {
    socket.set_curve_server(true)?;
    socket.set_curve_secretkey(own.secret())?;
    socket.set_zap_domain(domain)?;
    socket.set_ipv6(true)?;
    socket.set_linger(0)?;
    socket.set_backlog(BACKLOG)?;
    socket.set_maxmsgsize(i64::try_from(MAX_REQUEST_BYTES + CURVE_BYTES).unwrap_or(i64::MAX))?;
    socket.set_handshake_ivl(HANDSHAKE_MS)?;
    socket.set_heartbeat_ivl(HEARTBEAT_MS)?;
    socket.set_heartbeat_timeout(HEARTBEAT_TIMEOUT_MS)?;
    socket.set_heartbeat_ttl(HEARTBEAT_TIMEOUT_MS)?;
    socket.set_rcvhwm(REQUESTS_KEPT)?;
    socket.set_sndhwm(REPLIES_KEPT)?;
    // A reply that cannot go out is an error, not a silence.
    socket.set_router_mandatory(true)
}

fn key_of(frame: &mut zmq::Message) -> Option<PublicKey> {
    frame.gets("User-Id").and_then(|text| PublicKey::parse(text).ok())
}

fn peer_of(frame: &mut zmq::Message) -> Option<IpAddr> {
    frame
        .gets("Peer-Address")
        .and_then(|text| text.parse().ok())
        .map(|peer: IpAddr| peer.to_canonical())
}
