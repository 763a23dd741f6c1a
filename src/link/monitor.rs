//! What libzmq says of a socket's connections, read from its monitor.
//!
//! # What we count on
//!
//! - libzmq's own threads block on a full monitor queue, so ours has no bound: the owner reads it
//!   often.
//! - They also block, for ever, if a monitor has no reader, and all sockets of a context block with
//!   them. A dropped socket still reports for a while, so the owner of a monitor ends it with
//!   [`Monitor::stop`] before both are dropped.

use std::sync::atomic::{AtomicU32, Ordering};

use zmq::SocketEvent;

/// A socket's monitor. It belongs to the thread that uses the socket.
pub(super) struct Monitor {
    events: zmq::Socket,
}

/// What happened to a connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Happened {
    /// One of those that are looked at.
    pub(super) event: SocketEvent,
    /// A file descriptor, an error's number or a status code, depending on what happened.
    pub(super) value: i32,
}

/// What is looked at of what libzmq tells.
const EVENTS: [SocketEvent; 9] = [
    // A TCP connection was made from here; the value is its descriptor.
    SocketEvent::CONNECTED,
    // Making a connection failed or took too long, or a listener was closed.
    SocketEvent::CLOSED,
    // A peer connected to us; the value is the descriptor.
    SocketEvent::ACCEPTED,
    // No further peer can connect to us: mostly for want of descriptors.
    SocketEvent::ACCEPT_FAILED,
    // Both sides have the keys that they should have.
    SocketEvent::HANDSHAKE_SUCCEEDED,
    // The other side does not let this key in; the value is the ZAP status code.
    SocketEvent::HANDSHAKE_FAILED_AUTH,
    // The connection broke while the sides introduced themselves; the value is an `errno`.
    SocketEvent::HANDSHAKE_FAILED_NO_DETAIL,
    // The other side speaks something else, or has another key.
    SocketEvent::HANDSHAKE_FAILED_PROTOCOL,
    // A connection is gone; the value is its descriptor.
    SocketEvent::DISCONNECTED,
];

impl Monitor {
    /// Watches a socket.
    pub(super) fn of(context: &zmq::Context, socket: &zmq::Socket) -> zmq::Result<Self> {
        let endpoint = fresh_endpoint();
        let mask = EVENTS.iter().fold(0, |mask, event| mask | i32::from(event.to_raw()));
        socket.monitor(&endpoint, mask)?;
        let events = context.socket(zmq::PAIR)?;
        events.set_rcvhwm(0)?;
        events.set_linger(0)?;
        events.connect(&endpoint)?;
        Ok(Self { events })
    }

    /// Ends the telling: when this returns, nothing more is said here of the socket, which is the
    /// one that is watched.
    pub(super) fn stop(&self, socket: &zmq::Socket) {
        // A new monitor takes an old one's place, and one of no events says nothing. Where even
        // that is refused, libzmq is ending.
        let _ = socket.monitor(&fresh_endpoint(), 0);
    }

    /// For `zmq::poll`.
    pub(super) fn poll_item(&self) -> zmq::PollItem<'_> {
        self.events.as_poll_item(zmq::POLLIN)
    }

    /// The next thing that happened, if there is one.
    pub(super) fn next(&self) -> Option<Happened> {
        loop {
            // First frame: two bytes of event, four of value, in the machine's own order
            // (zmq_socket_monitor(3)). Second: the endpoint.
            let first = self.events.recv_msg(zmq::DONTWAIT).ok()?;
            while self.events.get_rcvmore().ok()? {
                let _ = self.events.recv_msg(zmq::DONTWAIT).ok()?;
            }
            let raw =
                first.get(..2).and_then(|bytes| bytes.try_into().ok()).map(u16::from_ne_bytes);
            let value =
                first.get(2..6).and_then(|bytes| bytes.try_into().ok()).map(i32::from_ne_bytes);
            let event = EVENTS.into_iter().find(|event| Some(event.to_raw()) == raw);
            if let (Some(event), Some(value)) = (event, value) {
                return Some(Happened { event, value });
            }
        }
    }
}

/// A name is free again only some time after its socket was closed, so each monitor has its own.
fn fresh_endpoint() -> String {
    static NUMBER: AtomicU32 = AtomicU32::new(0);
    format!("inproc://monitor.{}", NUMBER.fetch_add(1, Ordering::Relaxed))
}
