//! The two processes of a run: the guard, which stops the motors when control is gone or hung, and
//! control, which drives.
//!
//! Each is the body of a hidden command of this same program ([`RunProcess`](super::RunProcess)
//! says how they talk). What each concludes from what it hears, and from silence, is in
//! [`Watch`](super::Watch) and [`Pulse`](super::Pulse).

use std::io;

use crate::clock::MILLISECOND_NS;

mod control;
mod fatal;
mod guard;
mod urgency;

pub use control::control;
pub use guard::guard;

/// How often each beats, nanoseconds: often enough to notice that the other is silent for
/// [`MISSED_NS`](super::MISSED_NS).
const BEAT_NS: i64 = 20 * MILLISECOND_NS;

/// Why a process of a run could not begin. Nothing has moved.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProcessError {
    /// The kernel refuses what ends this process, or tells it to end.
    #[error("cannot set up signals")]
    Signals(#[source] io::Error),
    /// The process was not started by a run.
    #[error("standard input has no job")]
    NoJob(#[source] io::Error),
    /// A simulated brick lives inside control.
    #[error("a simulated brick needs no guard")]
    Simulated,
    /// The pipes to the starter fail.
    #[error("cannot talk to the starter")]
    Starter(#[source] io::Error),
    /// The process that drives cannot be started.
    #[error("cannot start the process that drives")]
    Control(#[source] io::Error),
}
