//! Threads, and what they share.

mod background;

use std::io;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::{Builder, JoinHandle};

pub(crate) use background::Background;

/// Starts a thread with a name, by which it is known in a debugger and where it panics.
///
/// # Errors
///
/// The kernel has no room for a thread.
pub(crate) fn spawn<T: Send + 'static>(
    name: &str,
    work: impl FnOnce() -> T + Send + 'static,
) -> io::Result<JoinHandle<T>> {
    Builder::new().name(name.to_owned()).spawn(work)
}

/// Locks what threads share, also after one of them has panicked, which has said so itself.
pub(crate) fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}
