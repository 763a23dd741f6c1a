//! A brick's network link: one ROUTER socket with CURVE, and a second one while a PC is
//! being paired.
//!
//! ```text
//!  libzmq's thread ── may this key in? ──▶ zap         one file looked at
//!        │
//!        ▼ requests                                    jobs
//!      front ── the key's name, looked up again ──▶ two workers ── Operations of the service
//!        ▲  └── refusals at once                       │   `stop` has one of its own
//!        └──────────────── replies ────────────────────┘
//! ```
//!
//! Everything here runs on niced threads of its own in the process of `onbrick serve`. It makes the
//! brick's keys if there are none, which may wait for the kernel's random numbers; no other thread
//! waits for that. The server ends when its ZAP handler has ended; the service shows why
//! ([`Server::state`]).
//!
//! # Limits
//!
//! | what | how much |
//! |---|---|
//! | a request | [`MAX_REQUEST_BYTES`] |
//! | time to shake hands | 5 s |
//! | a peer that says nothing, not even libzmq's heartbeat | 6 s |
//! | connections, and new ones a second | 48 and 20; of one address 16 and 8 |
//! | requests of one connection that wait for their answer | 16, of all together 128; one more is refused (`too_many`) |
//! | what has come of one address and is no request yet | 2 MiB: a message of frames without end costs its sender the connection |
//! | replies that wait for a slow client | 16 of at most 64 KiB for each connection; one more is dropped, and the client asks again |
//!
//! # What we count on
//!
//! - Only a key that is authorised gets as far as sending a message, so what libzmq itself keeps
//!   for a connection (up to eight requests) is kept for friends.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU16, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use super::curve::NoCurve;
use super::keys::{Authorised, KeyError, KeyPair};
use super::pairing::PairingWindow;
#[cfg(doc)]
use crate::protocol::MAX_REQUEST_BYTES;
use crate::protocol::{Name, Operations, Pairing};
use crate::service::NetworkLink;
use crate::service::config::LinkConfig;
use crate::threads::{lock, spawn};

mod front;
mod limits;
mod router;
mod workers;
mod zap;

/// How long threads wait before they check whether they are still wanted, milliseconds.
const NAP_MS: u8 = 200;

/// How much less important than others our threads are: the nice value's step (nice(2)).
const NICENESS: i32 = 10;

/// Where a brick listens and who it is.
#[derive(Debug, Clone)]
pub struct ServerConfig {
    /// The folder of keys.
    pub keys: PathBuf,
    /// What the brick calls itself.
    pub name: Name,
    /// Where it listens; port 0 is any that is free.
    pub listens: LinkConfig,
}

/// How the server is.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LinkState {
    /// Not yet there: it waits for this.
    #[error("waits for {0}")]
    Waits(&'static str),
    /// It listens, and this is the fingerprint of the brick's key.
    #[error("ready")]
    Ready {
        /// The fingerprint.
        fingerprint: String,
    },
    /// It is gone, because of this.
    #[error("ended: {0}")]
    Ended(String),
}

/// Why a server ended.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ServerError {
    /// This program cannot encrypt: a mistake in how it was built.
    #[error(transparent)]
    NoCurve(#[from] NoCurve),
    /// The folder of keys: look at the file that it names.
    #[error(transparent)]
    Keys(#[from] KeyError),
    /// Another program listens there, or it is no address of this machine: stop it, or choose
    /// another port or address.
    #[error("cannot listen at {endpoint}: {}", in_words(*source))]
    Bind {
        /// Where.
        endpoint: String,
        /// What libzmq said.
        source: zmq::Error,
    },
    /// The ZAP handler has ended: restart the service.
    #[error("the thread that checks keys has ended")]
    NoHandler,
    /// A worker has died: restart the service.
    #[error("a worker thread has ended")]
    NoWorker,
    /// libzmq has no socket or no memory left.
    #[error("sockets cannot be used: {0}")]
    Socket(#[from] zmq::Error),
    /// The system gives no thread.
    #[error("no thread can be started: {0}")]
    Thread(std::io::Error),
}

/// The second is for an interface behind a `%` that the machine does not have.
fn in_words(bound: zmq::Error) -> String {
    match bound {
        zmq::Error::EADDRNOTAVAIL | zmq::Error::ENODEV => {
            "this machine has no such address; `address` takes `*`, or one of its own".to_owned()
        }
        other => other.to_string(),
    }
}

/// A brick's network link. Dropping it closes it.
pub struct Server {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl std::fmt::Debug for Server {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Server").field("state", &self.state()).finish_non_exhaustive()
    }
}

/// What the server's threads and its owner share.
struct Shared {
    state: Mutex<LinkState>,
    stop: AtomicBool,
    port: AtomicU16,
    pairing_port: AtomicU16,
    window: Arc<PairingWindow>,
}

impl Shared {
    fn set(&self, state: LinkState) {
        *lock(&self.state) = state;
    }

    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

impl Server {
    /// Begins to serve, on threads of its own; whether it works out is seen in [`Server::state`].
    ///
    /// # Errors
    ///
    /// Only where the system gives no thread.
    pub fn start(config: ServerConfig, operations: Arc<dyn Operations>) -> std::io::Result<Self> {
        let window =
            Arc::new(PairingWindow::new(Authorised::below(&config.keys), config.name.clone()));
        let shared = Arc::new(Shared {
            state: Mutex::new(LinkState::Waits("its thread")),
            stop: AtomicBool::new(false),
            port: AtomicU16::new(config.listens.port),
            pairing_port: AtomicU16::new(config.listens.pairing_port),
            window,
        });
        let ours = Arc::clone(&shared);
        let serve = move || {
            let why = match serve(&ours, &config, operations) {
                Ok(()) => "it was told to".to_owned(),
                Err(error) => {
                    let way_out = match error {
                        ServerError::Bind { .. } => {
                            "; no PC reaches this service until it is started again, when the \
                             other program has ended, or with another `port` or `address` below \
                             [link] in onbrick.toml"
                        }
                        _ => "",
                    };
                    log::error!("the link: {error}{way_out}");
                    error.to_string()
                }
            };
            ours.window.close(&why);
            ours.set(LinkState::Ended(why));
        };
        let thread = spawn("link", serve)?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// How it is.
    #[must_use]
    pub fn state(&self) -> LinkState {
        lock(&self.shared.state).clone()
    }

    /// The pairing window.
    #[must_use]
    pub fn window(&self) -> &Arc<PairingWindow> {
        &self.shared.window
    }

    /// The port, once it is ready.
    #[must_use]
    pub fn port(&self) -> u16 {
        self.shared.port.load(Ordering::Relaxed)
    }

    /// The port of the pairing window, while it is open.
    #[must_use]
    pub fn pairing_port(&self) -> u16 {
        self.shared.pairing_port.load(Ordering::Relaxed)
    }
}

impl NetworkLink for Server {
    fn state(&self) -> String {
        Self::state(self).to_string()
    }

    fn fingerprint(&self) -> Option<String> {
        match Self::state(self) {
            LinkState::Ready { fingerprint } => Some(fingerprint),
            LinkState::Waits(_) | LinkState::Ended(_) => None,
        }
    }

    fn pairing(&self) -> Pairing {
        self.window().state()
    }

    fn open_pairing(&self, seconds: u32) -> Pairing {
        self.window().open(seconds)
    }

    fn answer_pairing(&self, same: bool) -> Pairing {
        self.window().answer(same)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        // A thread that waits for random numbers cannot be woken; it ends with the process.
        if matches!(self.state(), LinkState::Waits(_)) {
            return;
        }
        if let Some(thread) = self.thread.take() {
            // One that has panicked has said so itself.
            let _ = thread.join();
        }
    }
}

/// The link's thread, from its first breath to its last.
fn serve(
    shared: &Shared,
    config: &ServerConfig,
    operations: Arc<dyn Operations>,
) -> Result<(), ServerError> {
    // Threads that are started from here, libzmq's too, are as nice as this one.
    if let Err(error) = rustix::process::nice(NICENESS) {
        log::warn!("the link's threads are not niced: {error}");
    }
    super::curve::require()?;
    shared.set(LinkState::Waits("the kernel's random numbers"));
    let own = KeyPair::load_or_make(&config.keys)?;
    // libsodium is made ready here, which waits in the same way.
    let context = zmq::Context::new();
    shared.window.ready(own.public());
    let mut front = front::Front::open(shared, config, own, &context, operations)?;
    front.run()
}
