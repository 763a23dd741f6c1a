//! One connection to a brick, from its first packet to its last: a DEALER socket that is thrown
//! away when it breaks.

use std::net::SocketAddr;
use std::os::fd::RawFd;

use zmq::SocketEvent;

use crate::clock::{Clock as _, MILLISECOND_NS, MonotonicClock};
use crate::link::held::Held;
use crate::link::if_ready;
use crate::link::keys::{KeyPair, PublicKey};
use crate::link::monitor::Monitor;
use crate::protocol::{MAX_FETCH_BYTES, Reply};

/// Milliseconds: until TCP has to be through, and until the brick has to have introduced itself.
const CONNECT_MS: i32 = 5000;
const HANDSHAKE_MS: i32 = 5000;

/// A connection that libzmq reports nothing about is given up this long after those times,
/// milliseconds: if libzmq gets no socket from the system, or cannot parse the address, it reports
/// nothing and never tries again (4.3.5, `tcp_connecter_t::open`).
const SILENCE_MS: i32 = 1000;

/// A peer that closes a connection because of what was said on it does so at once. A connection
/// closed later than this was closed by a timeout, milliseconds.
const AT_ONCE_MS: i32 = 4000;
const _: () = assert!(AT_ONCE_MS < HANDSHAKE_MS);

/// How often the brick is asked whether it lives, and how long it may take to say so.
const HEARTBEAT_MS: i32 = 1000;
const HEARTBEAT_TIMEOUT_MS: i32 = 5000;

/// How long a connection that is open may take to take a request, milliseconds.
const SENDING_MS: i64 = 1000;

/// Replies are no longer than what a fetch brings, and JSON.
const LONGEST_REPLY: i64 = 4 << 20;
const _: () = assert!((MAX_FETCH_BYTES as i64) < LONGEST_REPLY);

/// What may have come over a connection without being a reply yet, bytes: two replies of the
/// longest kind. libzmq bounds a frame, and not how many frames a message has, and keeps them all
/// until the last one has come.
const MOST_UNFINISHED: u64 = 8 << 20;
const _: () = assert!(MOST_UNFINISHED >= 2 * LONGEST_REPLY as u64);

/// Replies that libzmq keeps until they are looked at.
const REPLIES_KEPT: i32 = 16;

/// A connection. Dropping it throws away what was not sent yet.
pub(super) struct Connection {
    socket: zmq::Socket,
    monitor: Monitor,
    stage: Stage,
    /// When it came that far.
    since_ns: i64,
    to: SocketAddr,
    /// libzmq's number for it.
    descriptor: Option<RawFd>,
    /// Bytes that had come over it when the last reply was whole.
    finished: u64,
}

/// How far a connection is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stage {
    /// TCP is not through yet.
    Calling,
    /// TCP is through; keys are being shown.
    Greeting,
    /// Requests can be sent.
    Open,
    /// It is over.
    Over(Over),
}

/// Why a connection is over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Over {
    /// TCP did not get through.
    NoConnection,
    /// It was closed while keys were being shown: another key, another program, or too many
    /// connections.
    BrokeOff,
    /// TCP got through, and then no keys were shown for so long that one of the two gave up: a bad
    /// network, or a program that says nothing.
    Mute,
    /// The brick does not know our key.
    NotLetIn,
    /// It was open, and broke.
    Lost,
    /// It keeps sending what is no reply.
    TooMuch,
}

/// A reply with the bytes beside it.
#[derive(Debug)]
pub(super) struct Received {
    pub(super) reply: Result<Reply, String>,
    pub(super) bytes: Option<Vec<u8>>,
}

impl Connection {
    /// Begins to connect.
    pub(super) fn open(
        context: &zmq::Context,
        to: SocketAddr,
        brick: PublicKey,
        own: &KeyPair,
    ) -> zmq::Result<Self> {
        let socket = context.socket(zmq::DEALER)?;
        socket.set_curve_serverkey(brick.as_bytes())?;
        socket.set_curve_publickey(own.public().as_bytes())?;
        socket.set_curve_secretkey(own.secret())?;
        socket.set_ipv6(true)?;
        // Nothing that was not sent stays behind, nothing is queued before there is a connection,
        // and only we connect again.
        socket.set_linger(0)?;
        socket.set_immediate(true)?;
        socket.set_reconnect_ivl(-1)?;
        socket.set_connect_timeout(CONNECT_MS)?;
        socket.set_handshake_ivl(HANDSHAKE_MS)?;
        socket.set_heartbeat_ivl(HEARTBEAT_MS)?;
        socket.set_heartbeat_timeout(HEARTBEAT_TIMEOUT_MS)?;
        socket.set_maxmsgsize(LONGEST_REPLY)?;
        socket.set_rcvhwm(REPLIES_KEPT)?;
        let monitor = Monitor::of(context, &socket)?;
        socket.connect(&format!("tcp://{to}"))?;
        let since_ns = MonotonicClock.now_ns();
        Ok(Self {
            socket,
            monitor,
            stage: Stage::Calling,
            since_ns,
            to,
            descriptor: None,
            finished: 0,
        })
    }

    /// How far it is by now.
    pub(super) fn stage(&mut self) -> Stage {
        let before = self.stage;
        while let Some(happened) = self.monitor.next() {
            if happened.event == SocketEvent::CONNECTED {
                self.descriptor = Some(happened.value);
            }
            self.stage = after(self.stage, happened.event);
        }
        let is_too_much = |received: u64| received.saturating_sub(self.finished) > MOST_UNFINISHED;
        if self.received().is_some_and(is_too_much) {
            self.stage = Stage::Over(Over::TooMuch);
        }
        let now_ns = MonotonicClock.now_ns();
        self.stage = in_time(before, self.stage, now_ns.saturating_sub(self.since_ns));
        if self.stage != before {
            self.since_ns = now_ns;
        }
        self.stage
    }

    /// Waits until something happens, at most this many milliseconds.
    pub(super) fn wait(&self, most_ms: i64) -> zmq::Result<()> {
        let mut items = [self.socket.as_poll_item(zmq::POLLIN), self.monitor.poll_item()];
        if_ready(zmq::poll(&mut items, most_ms)).map(drop)
    }

    /// Sends a request; false where the connection takes none now.
    pub(super) fn send(&self, request: &[u8]) -> zmq::Result<bool> {
        // The monitor may tell of a connection a moment before the socket takes messages for it.
        if_ready(self.socket.poll(zmq::POLLOUT, SENDING_MS))?;
        Ok(if_ready(self.socket.send(request, zmq::DONTWAIT))?.is_some())
    }

    /// The next reply, if one is there.
    pub(super) fn receive(&mut self) -> zmq::Result<Option<Received>> {
        let frames = if_ready(self.socket.recv_multipart(zmq::DONTWAIT))?;
        let Some(mut frames) = frames.map(Vec::into_iter) else { return Ok(None) };
        self.finished = self.received().unwrap_or(0);
        let json = frames.next().unwrap_or_default();
        let reply = serde_json::from_slice(&json).map_err(|error| error.to_string());
        Ok(Some(Received { reply, bytes: frames.next() }))
    }

    /// Bytes that have come over it; `None` where there is no connection, or the kernel does not
    /// count them.
    fn received(&self) -> Option<u64> {
        Held::to(self.descriptor?, self.to)?.received()
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.monitor.stop(&self.socket);
    }
}

fn after(stage: Stage, event: SocketEvent) -> Stage {
    match (stage, event) {
        // The first reason is the one that counts; what follows is the same end seen again.
        (Stage::Over(_), _) => stage,
        (_, SocketEvent::CONNECTED) => Stage::Greeting,
        (_, SocketEvent::HANDSHAKE_SUCCEEDED) => Stage::Open,
        (_, SocketEvent::HANDSHAKE_FAILED_AUTH) => Stage::Over(Over::NotLetIn),
        (
            Stage::Greeting,
            SocketEvent::HANDSHAKE_FAILED_NO_DETAIL
            | SocketEvent::HANDSHAKE_FAILED_PROTOCOL
            | SocketEvent::DISCONNECTED,
        ) => Stage::Over(Over::BrokeOff),
        (Stage::Calling, SocketEvent::CLOSED) => Stage::Over(Over::NoConnection),
        (Stage::Open, SocketEvent::DISCONNECTED) => Stage::Over(Over::Lost),
        _ => stage,
    }
}

/// The stage after what happened, if that before it has lasted this long, nanoseconds.
fn in_time(before: Stage, stage: Stage, lasted_ns: i64) -> Stage {
    let is_longer_than = |most_ms: i32| lasted_ns > i64::from(most_ms) * MILLISECOND_NS;
    match (before, stage) {
        (Stage::Calling, Stage::Calling) if is_longer_than(CONNECT_MS + SILENCE_MS) => {
            Stage::Over(Over::NoConnection)
        }
        (Stage::Greeting, Stage::Greeting) if is_longer_than(HANDSHAKE_MS + SILENCE_MS) => {
            Stage::Over(Over::Mute)
        }
        (Stage::Greeting, Stage::Over(Over::BrokeOff)) if is_longer_than(AT_ONCE_MS) => {
            Stage::Over(Over::Mute)
        }
        _ => stage,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_connection_that_nothing_is_heard_of_is_given_up_and_one_that_is_open_is_not() {
        let after_s = |stage, seconds| in_time(stage, stage, seconds * crate::clock::SECOND_NS);
        for stage in [Stage::Calling, Stage::Greeting, Stage::Open] {
            assert_eq!(after_s(stage, 5), stage);
        }
        assert_eq!(after_s(Stage::Calling, 7), Stage::Over(Over::NoConnection));
        assert_eq!(after_s(Stage::Greeting, 7), Stage::Over(Over::Mute));
        assert_eq!(after_s(Stage::Open, 7000), Stage::Open);
    }

    #[test]
    fn a_network_that_swallows_the_greeting_is_not_taken_for_a_brick_with_another_key() {
        let broke_off = Stage::Over(Over::BrokeOff);
        let after_ms = |ms: i64| in_time(Stage::Greeting, broke_off, ms * MILLISECOND_NS);
        assert_eq!(after_ms(3), broke_off);
        assert_eq!(after_ms(5000), Stage::Over(Over::Mute));
    }

    /// Where a connection is dropped at the first event of its end, libzmq is about to tell of the
    /// next one.
    #[test]
    fn connections_that_break_off_hold_up_none_of_those_after_them() {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let to = listener.local_addr().unwrap();
        std::thread::spawn(move || listener.incoming().for_each(drop));
        let (context, own) = (zmq::Context::new(), KeyPair::generate().unwrap());
        for number in 0..300 {
            let mut connection = Connection::open(&context, to, own.public(), &own).unwrap();
            let over = loop {
                match connection.stage() {
                    Stage::Over(over) => break over,
                    _ => connection.wait(10).unwrap(),
                }
            };
            assert_eq!(over, Over::BrokeOff, "connection {number}");
        }
    }

    #[test]
    fn the_first_reason_of_an_end_is_the_one_that_counts() {
        let through = |happened: &[SocketEvent]| {
            happened.iter().fold(Stage::Calling, |stage, event| after(stage, *event))
        };
        assert_eq!(
            through(&[SocketEvent::CONNECTED, SocketEvent::HANDSHAKE_SUCCEEDED]),
            Stage::Open
        );
        assert_eq!(through(&[SocketEvent::CLOSED]), Stage::Over(Over::NoConnection));
        assert_eq!(
            through(&[
                SocketEvent::CONNECTED,
                SocketEvent::HANDSHAKE_FAILED_NO_DETAIL,
                SocketEvent::DISCONNECTED
            ]),
            Stage::Over(Over::BrokeOff)
        );
        assert_eq!(
            through(&[
                SocketEvent::CONNECTED,
                SocketEvent::HANDSHAKE_FAILED_AUTH,
                SocketEvent::DISCONNECTED
            ]),
            Stage::Over(Over::NotLetIn)
        );
        assert_eq!(
            through(&[
                SocketEvent::CONNECTED,
                SocketEvent::HANDSHAKE_SUCCEEDED,
                SocketEvent::DISCONNECTED
            ]),
            Stage::Over(Over::Lost)
        );
    }
}
