//! The link: real sockets on loopback, in this process and between processes of the real program.
#![cfg(all(feature = "link", feature = "sim", feature = "host"))]

mod bench;
mod chapter;
mod commands;
mod discovery;
mod fetching;
mod figures;
mod hostile;
mod keys;
mod lists;
mod numbers;
mod pairing;
mod python;
mod team;
