//! Who may connect: libzmq asks this thread (ZAP, rfc.zeromq.org/spec/27) before it lets a key in.
//!
//! libzmq accepts every peer while no handler is bound. So the handler is bound before the first
//! socket, and the server closes its sockets when the handler has ended; even then a connection
//! without a name from here is asked nothing ([`front`](super::front)).

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::{NAP_MS, ServerError};
use crate::link::keys::{Authorised, PublicKey};
use crate::link::pairing::PairingWindow;
use crate::threads::Background;

/// Where libzmq asks.
const ENDPOINT: &str = "inproc://zeromq.zap.01";

/// The domains: authorised keys, and any key while the pairing window is open.
pub(super) const REQUESTS: &str = "onbrick";
pub(super) const PAIRING: &str = "onbrick.pairing";

/// Starts the thread that is asked; it is bound when this returns.
pub(super) fn handler(
    context: &zmq::Context,
    authorised: Authorised,
    window: Arc<PairingWindow>,
) -> Result<Background, ServerError> {
    let socket = context.socket(zmq::REP)?;
    socket.set_linger(0)?;
    socket.set_rcvtimeo(i32::from(NAP_MS))?;
    socket.bind(ENDPOINT)?;
    let serve = move |stop: &AtomicBool| {
        let asked = Asked { socket, authorised, window };
        while !stop.load(Ordering::Relaxed) && asked.answer_one() {}
    };
    Background::start("zap", serve).map_err(ServerError::Thread)
}

struct Asked {
    socket: zmq::Socket,
    authorised: Authorised,
    window: Arc<PairingWindow>,
}

impl Asked {
    /// Answers the next question, if one comes within a nap; false where no more can come.
    fn answer_one(&self) -> bool {
        let question = match self.socket.recv_multipart(0) {
            Ok(question) => question,
            Err(zmq::Error::EAGAIN | zmq::Error::EINTR) => return true,
            Err(_) => return false,
        };
        let id = question.get(1).cloned().unwrap_or_default();
        let (status, text, user) = match self.user(&question) {
            Some(key) => ("200", "OK", key.to_string()),
            None => ("400", "this key is not authorised", String::new()),
        };
        let answer: [&[u8]; 6] =
            [b"1.0", &id, status.as_bytes(), text.as_bytes(), user.as_bytes(), b""];
        self.socket.send_multipart(answer, 0).is_ok()
    }

    /// The key that may come in; `None` if the question is malformed.
    ///
    /// Frames: version, id, domain, address, identity, mechanism, the key's 32 bytes.
    fn user(&self, question: &[Vec<u8>]) -> Option<PublicKey> {
        let [version, _, domain, _, _, mechanism, key] = question else { return None };
        if version != b"1.0" || mechanism != b"CURVE" {
            return None;
        }
        let key = PublicKey::from_bytes(key.as_slice().try_into().ok()?);
        let may = if domain == PAIRING.as_bytes() {
            self.window.is_open()
        } else {
            domain == REQUESTS.as_bytes() && self.is_authorised(&key)
        };
        may.then_some(key)
    }

    fn is_authorised(&self, key: &PublicKey) -> bool {
        let found = self.authorised.find(key);
        if let Err(error) = &found {
            log::warn!("a key is not let in: {error}");
        }
        found.is_ok_and(|name| name.is_some())
    }
}
