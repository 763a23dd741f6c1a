//! A thread that belongs to something.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use super::spawn;

/// A thread that works until this is dropped, which waits for its end.
#[derive(Debug)]
pub(crate) struct Background {
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Background {
    /// Starts it; `work` is handed what is raised when it is to end.
    ///
    /// # Errors
    ///
    /// As [`spawn`].
    pub(crate) fn start(
        name: &str,
        work: impl FnOnce(&AtomicBool) + Send + 'static,
    ) -> io::Result<Self> {
        let ends = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&ends);
        let thread = spawn(name, move || work(&told))?;
        Ok(Self { ends, thread: Some(thread) })
    }

    /// True once it has ended, however it did.
    #[cfg(feature = "link")]
    pub(crate) fn is_gone(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // One that has panicked has said so itself.
            let _ = thread.join();
        }
    }
}
