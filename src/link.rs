//! The network: a person at a PC starts and stops missions on bricks and brings their maps home.
//!
//! Nothing that drives waits for anything here.

pub mod client;
pub mod curve;
pub mod keys;
mod monitor;
pub mod pairing;
pub mod server;

use std::path::PathBuf;

pub use client::{Client, ClientError, FetchProgress, Patience};
pub use keys::{KeyPair, KnownBrick, KnownBricks, PublicKey};
pub use server::{LinkState, Server, ServerConfig};

/// A PC's folder of keys: `$ONBRICK_KEYS`, or `onbrick` in the folder of configurations (`$XDG_CONFIG_HOME`, `~/.config`); `None` where there is no home.
#[must_use]
pub fn key_folder() -> Option<PathBuf> {
    let named = |name| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let below = |folder: PathBuf| folder.join("onbrick");
    let home = || named("HOME").map(|home| below(home.join(".config")));
    named("ONBRICK_KEYS").or_else(|| named("XDG_CONFIG_HOME").map(below)).or_else(home)
}
