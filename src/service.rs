//! What a brick does between and around runs: the state, the runs on disk, the operations that both doors offer.
//!
//! People reach a brick through two doors: the network (`link`) and a Unix socket on the brick itself (the menu, `onbrick run`).
//! Both carry the same JSON ([`protocol`]) to the same [`Operations`](protocol::Operations), so that menu, link and log always tell the same story.
//!
//! # Not here
//!
//! No ZeroMQ and no keys (`link`), no tick (`runtime`): a run is a process of its own.

pub mod protocol;
