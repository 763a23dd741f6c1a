//! What a brick does between and around runs: the state, the runs on disk, the operations that both
//! transports offer.
//!
//! ```text
//!  network ── link ──┐                                   ┌── run.mcap, run.json ── store
//!                    ├─▶ Operations = Service ── machine ┤
//!  Unix socket ──────┘        │                          └── lights, sounds ── signs
//!                             └── starts, follows, stops ──▶ the run's own processes (runtime)
//! ```
//!
//! People reach a brick through two transports: the network (`link`) and a Unix socket on the brick
//! itself ([`socket`]: the menu, `onbrick run`). Both carry the same JSON ([`protocol`]) to the
//! same [`Operations`](protocol::Operations), so that menu, link and log always tell the same
//! story.
//!
//! [`Service`] is that one story: a pure state machine ([`Machine`]), the runs on disk (`store`),
//! and a thread for each run in progress. A run has processes of its own: it survives the service's
//! death, and a restarted service finds it by the lock on its recording.
//!
//! # Not here
//!
//! No ZeroMQ and no keys (`link`), no tick (`runtime`): a run is a process of its own.
//!
//! # What we count on
//!
//! - One service a folder of runs, and one a socket; each is locked.

use crate::mapping::Pose;
use crate::protocol;
use crate::runtime::Brick;

pub mod client;
pub mod config;
mod core;
pub(crate) mod digest;
mod follow;
mod hardware;
mod keep;
pub mod machine;
mod missions;
mod settings;
mod signs;
pub mod socket;
mod start;
mod store;
mod token;

pub use self::config::Config;
pub use self::core::{OpenError, Service};
pub use self::machine::Machine;
pub use self::socket::{LocalSocket, SocketError};

/// Where the service's robot is.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotSite {
    /// Its files.
    pub brick: Brick,
    /// Its pose at the start of a run that says no other.
    pub start: Pose,
}

/// What the service asks the network link, once there is one.
pub trait NetworkLink: std::fmt::Debug + Send + Sync {
    /// `ready`, or what it waits for.
    fn state(&self) -> String;

    /// The fingerprint of the brick's key, where it has one.
    fn fingerprint(&self) -> Option<String>;

    /// What the pairing window shows.
    fn pairing(&self) -> protocol::Pairing;

    /// Opens the pairing window for some time, or closes it (0 seconds).
    fn open_pairing(&self, seconds: u32) -> protocol::Pairing;

    /// A person has compared the codes.
    fn answer_pairing(&self, same: bool) -> protocol::Pairing;
}
