//! Faults end guard and control at once; `unsafe` is kept in this file.
//!
//! Rust's runtime handles SIGSEGV and SIGBUS to report a stack overflow: such a signal from another
//! process is swallowed, and the program continues. A core dump to a slow card keeps a dead
//! process, and with it its pipes, for seconds.

#![allow(
    unsafe_code,
    reason = "nix has no safe call that puts back what the kernel does by itself"
)]

use nix::sys::resource::{Resource, setrlimit};
use nix::sys::signal::{SigHandler, Signal, signal};

/// SIGSEGV, SIGBUS, SIGILL, SIGFPE and SIGABRT kill this process from now on, and no core is
/// dumped.
///
/// # Errors
///
/// What the kernel answers.
pub(super) fn ends_at_once() -> nix::Result<()> {
    setrlimit(Resource::RLIMIT_CORE, 0, 0)?;
    for fault in [Signal::SIGSEGV, Signal::SIGBUS, Signal::SIGILL, Signal::SIGFPE, Signal::SIGABRT]
    {
        // SAFETY: no handler is installed: the kernel's own action runs none of our code.
        unsafe { signal(fault, SigHandler::SigDfl) }?;
    }
    Ok(())
}
