//! A recording's file in memory that knows what is on the disk and what is still on its way.

use std::io;
use std::sync::{Arc, Mutex};

use onbrick::recording::Sink;

/// Clones are handles on the same file.
#[derive(Debug, Clone, Default)]
pub struct MemoryDisk(Arc<Mutex<State>>);

#[derive(Debug, Default)]
struct State {
    bytes: Vec<u8>,
    synced: usize,
}

impl MemoryDisk {
    /// All that was written.
    pub fn bytes(&self) -> Vec<u8> {
        self.0.lock().unwrap().bytes.clone()
    }

    /// How much of it a loss of power leaves for sure.
    pub fn synced(&self) -> usize {
        self.0.lock().unwrap().synced
    }
}

impl Sink for MemoryDisk {
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.0.lock().unwrap().bytes.extend_from_slice(bytes);
        Ok(())
    }

    fn sync(&mut self) -> io::Result<()> {
        let mut state = self.0.lock().unwrap();
        state.synced = state.bytes.len();
        Ok(())
    }
}
