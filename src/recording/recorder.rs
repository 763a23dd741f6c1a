//! The recorder: a thread that empties the ring into the file.
//!
//! It looks at the ring every 50 ms, so a tick never has to wake it. When the disk fails it raises
//! a flag that the tick sees, keeps the error for [`Recorder::finish`], and continues to empty the
//! ring, so that the tick runs as before.

use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::thread::{JoinHandle, Thread};
use std::time::Duration;

use rtrb::{Consumer, RingBuffer};
use serde::Serialize;

use super::about::{End, Pace, Start, of_end};
use super::encoder::Encoder;
use super::sink::{RecordError, Sink};
use super::status::Status;
use super::tick::{Dropped, Entry, Flags, State, TickSide};
use crate::clock::{MILLISECOND_NS, SECOND_NS};
use crate::threads::{lock, spawn};

/// Checkpoints on their way at most: one comes in a second.
const STATES: usize = 4;

/// How often the ring is looked at.
const LOOK_PERIOD: Duration = Duration::from_millis(50);

/// How often, in looks, what came without a tick after it is synced.
const IDLE_LOOKS: u32 = 20;

/// How often the status is told, nanoseconds of the run's clock.
const STATUS_PERIOD_NS: i64 = 200 * MILLISECOND_NS;

/// How to record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// How often the file is brought to the disk with a checksum, nanoseconds: what a loss of power
    /// can cost.
    pub sync_period_ns: i64,
    /// How many entries the ring holds; a tick is one, and a slow card may take seconds for a sync.
    pub ring_entries: usize,
}

impl Default for Options {
    /// A second; ten seconds of ticks at 50 Hz.
    fn default() -> Self {
        Self { sync_period_ns: SECOND_NS, ring_entries: 512 }
    }
}

/// What a finished recording came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Summary {
    /// The file's length, bytes.
    pub bytes: u64,
    /// Entries that did not fit into the ring.
    pub dropped: u32,
}

/// A recording in progress. Dropping it closes the file without a reason for the end;
/// [`finish`](Self::finish) is the way.
#[derive(Debug)]
pub struct Recorder {
    flags: Arc<Flags>,
    end: Arc<Mutex<Closing>>,
    thread: Option<JoinHandle<Result<u64, RecordError>>>,
}

/// What the recorder is told when the run is over.
#[derive(Debug, Default)]
struct Closing {
    end: Option<End>,
    pending: Option<Dropped>,
}

impl Recorder {
    /// Begins a recording: what is known of the run is on the disk when this returns.
    ///
    /// `on_status` is called by the recorder's thread at most five times a second of the run's
    /// clock, and at the end.
    ///
    /// # Errors
    ///
    /// The file cannot be written, or there is no thread to be had.
    pub fn start<S: Send + Serialize + 'static>(
        sink: Box<dyn Sink>,
        start: Start,
        options: Options,
        on_status: Box<dyn FnMut(&Status) + Send>,
    ) -> Result<(Self, TickSide<S>), RecordError> {
        const { assert!(size_of::<Entry>() <= 2048, "small enough for a ring of hundreds") };
        let ring_entries = options.ring_entries.max(1);
        let (put, take) = RingBuffer::new(ring_entries);
        let (put_states, take_states) = RingBuffer::new(STATES);
        let ring_size = u32::try_from(ring_entries).unwrap_or(u32::MAX);
        let pace = start.info.pace;
        let encoder = Encoder::begin(sink, start, options.sync_period_ns, ring_size)?;
        let flags = Arc::new(Flags::default());
        let end = Arc::new(Mutex::new(Closing::default()));
        let work = Work {
            ring: take,
            states: take_states,
            flags: Arc::clone(&flags),
            end: Arc::clone(&end),
            pace,
            on_status,
            next_status_ns: i64::MIN,
        };
        let thread = spawn("recorder", move || work.run(encoder))
            .map_err(|source| RecordError { doing: "start the recorder's thread", source })?;
        let waits_for: Option<Thread> = (pace == Pace::Virtual).then(|| thread.thread().clone());
        let tick_side = TickSide::new(put, put_states, Arc::clone(&flags), waits_for);
        Ok((Self { flags, end, thread: Some(thread) }, tick_side))
    }

    /// Writes what is left, the reason for the end and MCAP's summary, and waits until all of it is
    /// on the disk.
    ///
    /// # Errors
    ///
    /// The file could not be written, now or earlier; what was synced before that is safe.
    pub fn finish<S>(mut self, tick_side: TickSide<S>, end: End) -> Result<Summary, RecordError> {
        let dropped = tick_side.dropped();
        {
            let mut closing = lock(&self.end);
            *closing = Closing { end: Some(end), pending: tick_side.pending };
        }
        drop(tick_side);
        match self.join() {
            Some(result) => Ok(Summary { bytes: result?, dropped }),
            None => {
                let source = std::io::Error::other("the recorder's thread panicked");
                Err(RecordError { doing: "finish the file", source })
            }
        }
    }

    fn join(&mut self) -> Option<Result<u64, RecordError>> {
        self.flags.closing.store(true, Ordering::Release);
        let thread = self.thread.take()?;
        thread.thread().unpark();
        thread.join().ok()
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        // Who let go of it without finishing has an error of his own to tell.
        let _ = self.join();
    }
}

/// What the thread works with.
struct Work<S> {
    ring: Consumer<Entry>,
    states: Consumer<State<S>>,
    flags: Arc<Flags>,
    end: Arc<Mutex<Closing>>,
    pace: Pace,
    on_status: Box<dyn FnMut(&Status) + Send>,
    next_status_ns: i64,
}

impl<S: Serialize> Work<S> {
    fn run(mut self, mut encoder: Encoder) -> Result<u64, RecordError> {
        match self.record(&mut encoder) {
            Ok(()) => self.close(encoder),
            Err(error) => {
                // Who finishes the recording tells of it: one message is enough.
                self.flags.failed.store(true, Ordering::Relaxed);
                drop(encoder);
                self.discard();
                Err(error)
            }
        }
    }

    /// Empties the ring until the run is over.
    fn record(&mut self, encoder: &mut Encoder) -> Result<(), RecordError> {
        let mut idle_looks = 0;
        loop {
            // Asked before emptying: what was put before closing is then seen.
            let closing = self.flags.closing.load(Ordering::Acquire);
            encoder.note_ring(self.ring.slots());
            let mut ticks = false;
            // Taken where they lie: an entry is large.
            while let Ok(entries) = self.ring.read_chunk(1) {
                for entry in entries.as_slices().0 {
                    ticks |= matches!(entry, Entry::Tick(_));
                    match *entry {
                        Entry::Checkpoint { tick, time_ns } => {
                            checkpoint(&mut self.states, encoder, tick, time_ns)?;
                        }
                        _ => encoder.entry(entry)?,
                    }
                }
                entries.commit_all();
                self.tell(&encoder.status);
            }
            if closing {
                return Ok(());
            }
            // The run's clock decides about syncs, but where no ticks come it stands still.
            idle_looks = if ticks { 0 } else { idle_looks + 1 };
            if self.pace == Pace::Real && idle_looks >= IDLE_LOOKS && encoder.file.is_dirty() {
                encoder.sync(encoder.status.time_ns)?;
            }
            std::thread::park_timeout(LOOK_PERIOD);
        }
    }

    fn close(&mut self, mut encoder: Encoder) -> Result<u64, RecordError> {
        let closing = std::mem::take(&mut *lock(&self.end));
        (self.on_status)(&encoder.status);
        let ending = closing.end.as_ref().map(of_end);
        let finished = finish(&mut encoder, &closing).and_then(|()| encoder.file.finish(ending));
        if finished.is_err() {
            self.flags.failed.store(true, Ordering::Relaxed);
        }
        finished
    }

    /// Keeps the ring empty, so that nothing changes for the tick.
    fn discard(&mut self) {
        while !self.flags.closing.load(Ordering::Acquire) {
            while self.ring.pop().is_ok() {}
            while self.states.pop().is_ok() {}
            std::thread::park_timeout(LOOK_PERIOD);
        }
    }

    fn tell(&mut self, status: &Status) {
        if status.time_ns >= self.next_status_ns {
            self.next_status_ns = status.time_ns.saturating_add(STATUS_PERIOD_NS);
            (self.on_status)(status);
        }
    }
}

/// Writes the state of a checkpoint. One whose entry was dropped is passed over.
fn checkpoint<S: Serialize>(
    states: &mut Consumer<State<S>>,
    encoder: &mut Encoder,
    tick: u64,
    time_ns: i64,
) -> Result<(), RecordError> {
    while let Ok(states) = states.read_chunk(1) {
        let (first, _) = states.as_slices();
        let due = first.iter().find(|state| state.tick == tick);
        let written = due.map(|due| encoder.checkpoint(tick, time_ns, &due.state));
        states.commit_all();
        if let Some(written) = written {
            return written;
        }
    }
    Ok(())
}

impl<S> Drop for Work<S> {
    fn drop(&mut self) {
        // A panic in the status' callback must not look like a slow disk.
        if std::thread::panicking() {
            self.flags.failed.store(true, Ordering::Relaxed);
        }
    }
}

fn finish(encoder: &mut Encoder, closing: &Closing) -> Result<(), RecordError> {
    if let Some(dropped) = closing.pending {
        encoder.gap(dropped)?;
    }
    let last_ns = encoder.status.time_ns;
    match &closing.end {
        Some(end) => encoder.close(end.time_ns, &end.points, end.map.as_ref()),
        None => encoder.close(last_ns, &[], None),
    }
}
