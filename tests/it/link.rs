//! The link: real sockets on loopback, in this process and between processes of the real program.
#![cfg(feature = "host")]

mod bench;
mod chapter;
mod class;
mod commands;
mod discovery;
mod fetching;
mod figures;
mod hostile;
mod keys;
mod listening;
mod lists;
mod pairing;
mod python;
mod team;
