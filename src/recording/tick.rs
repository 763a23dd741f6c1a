//! The tick's side of the recorder: values into a ring, nothing else.
//!
//! The ring is lock-free, its entries have a fixed size, and what does not fit is dropped, counted
//! and named by tick: the tick never waits for the disk.
//!
//! # What we count on
//!
//! - One thread puts, one takes.
//! - Where time is simulated ([`Pace::Virtual`](super::Pace)) the ticks outrun the disk by far, and
//!   nothing hurries: then, and only then, a full ring is waited for.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::Thread;
use std::time::Duration;

use arrayvec::{ArrayString, ArrayVec};
use rtrb::Producer;
use serde::Serialize;

use crate::behavior::demands::SAY_BYTES;
use crate::behavior::{MAX_VARIABLES, Taken};
use crate::mapping::{Estimate, KeyframeList, Placed, Pose};
use crate::senses::Senses;

/// How long a full ring is waited for at once: as long as the disk takes for some tens of ticks.
const FULL_RING: Duration = Duration::from_micros(100);

/// The longest log line, in bytes; what is beyond is cut off at a character.
pub const MAX_LOG_BYTES: usize = 240;

/// Everything about one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TickRecord {
    /// What was read; its number and time are the tick's.
    pub senses: Senses,
    /// What the estimator made of it.
    pub estimate: Estimate,
    /// The points that came into the map.
    pub placed: Placed,
    /// How long after its deadline the tick began, nanoseconds.
    pub lateness_ns: i64,
}

/// How much a log line matters; the numbers of `rcl_interfaces/Log`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
#[repr(u8)]
pub enum Level {
    /// For developers of the program.
    Debug = 10,
    /// What happens.
    Info = 20,
    /// The run continues, but look at it.
    Warn = 30,
    /// Something failed.
    Error = 40,
    /// The run ends of it.
    Fatal = 50,
}

impl Level {
    /// The level of a number; what is between two is the lower.
    #[must_use]
    pub fn of_number(number: u8) -> Self {
        match number {
            0..20 => Self::Debug,
            20..30 => Self::Info,
            30..40 => Self::Warn,
            40..50 => Self::Error,
            50.. => Self::Fatal,
        }
    }
}

/// What goes through the ring; as large as its largest variant, so that the ring never allocates.
#[derive(Debug, Clone)]
#[expect(
    clippy::large_enum_variant,
    reason = "entries have a fixed size so that the ring never allocates"
)]
pub(super) enum Entry {
    Tick(TickRecord),
    Transition {
        tick: u64,
        time_ns: i64,
        taken: Taken,
    },
    Variables {
        tick: u64,
        time_ns: i64,
        values: ArrayVec<f64, MAX_VARIABLES>,
    },
    /// Its state is in a ring of its own: it is large, and comes once a second.
    Checkpoint {
        tick: u64,
        time_ns: i64,
    },
    Said {
        time_ns: i64,
        text: ArrayString<SAY_BYTES>,
    },
    Truth {
        time_ns: i64,
        pose: Pose,
    },
    Keyframes {
        time_ns: i64,
        keyframes: KeyframeList,
    },
    Log {
        time_ns: i64,
        level: Level,
        text: LogText,
    },
    Gap(Dropped),
}

pub(super) type LogText = ArrayString<MAX_LOG_BYTES>;

/// What a checkpoint carries, with its tick.
#[derive(Debug, Clone)]
pub(super) struct State<S> {
    pub(super) tick: u64,
    pub(super) state: S,
}

/// What did not fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Dropped {
    pub(super) first_tick: u64,
    pub(super) last_tick: u64,
    pub(super) entries: u32,
}

/// What both sides see.
#[derive(Debug, Default)]
pub(super) struct Flags {
    pub(super) failed: AtomicBool,
    pub(super) closing: AtomicBool,
}

/// The tick thread's handle to the recorder. No call allocates, locks or makes a system call,
/// unless time is simulated.
#[derive(Debug)]
pub struct TickSide<S> {
    ring: Producer<Entry>,
    states: Producer<State<S>>,
    flags: Arc<Flags>,
    /// The recorder, to be woken when the ring is full; only where time is simulated.
    recorder: Option<Thread>,
    tick: u64,
    /// What was dropped since the last entry that fitted: its gap could not be put any more.
    pub(super) pending: Option<Dropped>,
    dropped: u32,
}

impl<S> TickSide<S> {
    pub(super) fn new(
        ring: Producer<Entry>,
        states: Producer<State<S>>,
        flags: Arc<Flags>,
        recorder: Option<Thread>,
    ) -> Self {
        Self { ring, states, flags, recorder, tick: 0, pending: None, dropped: 0 }
    }

    /// Records a tick.
    pub fn tick(&mut self, record: &TickRecord) {
        self.tick = record.senses.tick;
        self.put(Entry::Tick(*record));
    }

    /// Records a transition that a machine took.
    pub fn transition(&mut self, tick: u64, time_ns: i64, taken: Taken) {
        self.tick = tick;
        self.put(Entry::Transition { tick, time_ns, taken });
    }

    /// Records the mission's variables, one of which has changed.
    pub fn variables(&mut self, tick: u64, time_ns: i64, values: &[f64]) {
        self.tick = tick;
        let values = values.iter().copied().take(MAX_VARIABLES).collect();
        self.put(Entry::Variables { tick, time_ns, values });
    }

    /// Records what the pilot carries from a tick to the next.
    pub fn checkpoint(&mut self, tick: u64, time_ns: i64, state: S) {
        self.tick = tick;
        let has_room = self.has_room(|side| side.states.is_full());
        if has_room && self.states.push(State { tick, state }).is_ok() {
            self.put(Entry::Checkpoint { tick, time_ns });
        } else {
            self.drop_one();
        }
    }

    /// Records what the mission tells people; what is too long is cut.
    pub fn said(&mut self, time_ns: i64, text: &str) {
        self.put(Entry::Said { time_ns, text: fitting(text) });
    }

    /// Records what is known now of where the robot was.
    pub fn keyframes(&mut self, time_ns: i64, keyframes: KeyframeList) {
        if !keyframes.is_empty() {
            self.put(Entry::Keyframes { time_ns, keyframes });
        }
    }

    /// Records where a simulated robot truly is.
    pub fn truth(&mut self, time_ns: i64, pose: Pose) {
        self.put(Entry::Truth { time_ns, pose });
    }

    /// Records a log line.
    pub fn log(&mut self, time_ns: i64, level: Level, text: &str) {
        self.put(Entry::Log { time_ns, level, text: fitting(text) });
    }

    /// True once the recorder can write no more; what to do about it is the run's to decide.
    #[must_use]
    pub fn failed(&self) -> bool {
        self.flags.failed.load(Ordering::Relaxed)
    }

    /// How many entries were dropped so far because the ring was full.
    #[must_use]
    pub fn dropped(&self) -> u32 {
        self.dropped
    }

    fn put(&mut self, entry: Entry) {
        if let Some(dropped) = self.pending
            && self.push(Entry::Gap(dropped))
        {
            self.pending = None;
        }
        if self.pending.is_some() || !self.push(entry) {
            self.drop_one();
        }
    }

    /// An entry is large: it is handed on only where there is room, and so never back.
    fn push(&mut self, entry: Entry) -> bool {
        self.has_room(|side| side.ring.is_full()) && self.ring.push(entry).is_ok()
    }

    fn has_room(&self, is_full: impl Fn(&Self) -> bool) -> bool {
        while is_full(self) {
            match &self.recorder {
                Some(recorder) if !self.ring.is_abandoned() => recorder.unpark(),
                _ => return false,
            }
            std::thread::park_timeout(FULL_RING);
        }
        true
    }

    fn drop_one(&mut self) {
        self.dropped = self.dropped.saturating_add(1);
        let before =
            self.pending.unwrap_or(Dropped { first_tick: self.tick, last_tick: 0, entries: 0 });
        let entries = before.entries.saturating_add(1);
        self.pending = Some(Dropped { last_tick: self.tick, entries, ..before });
    }
}

/// As much of a text as fits, cut at a character.
fn fitting<const BYTES: usize>(text: &str) -> ArrayString<BYTES> {
    let mut cut = ArrayString::new();
    cut.push_str(&text[..text.floor_char_boundary(BYTES)]);
    cut
}

#[cfg(test)]
mod tests {
    use super::*;
    use rtrb::RingBuffer;

    fn side(entries: usize) -> (TickSide<u8>, rtrb::Consumer<Entry>) {
        let (put, take) = RingBuffer::new(entries);
        let (put_states, _) = RingBuffer::new(1);
        (TickSide::new(put, put_states, Arc::default(), None), take)
    }

    #[test]
    fn what_does_not_fit_is_named_as_soon_as_there_is_room() {
        let (mut side, mut ring) = side(2);
        for tick in 0..5 {
            side.transition(tick, 0, Taken { machine: 0, from: 0, to: 1, transition: None });
        }
        assert_eq!(side.dropped(), 3);
        while ring.pop().is_ok() {}
        side.log(0, Level::Info, "room again");
        let Ok(Entry::Gap(gap)) = ring.pop() else { panic!("a gap comes first") };
        assert_eq!(gap, Dropped { first_tick: 2, last_tick: 4, entries: 3 });
        assert!(matches!(ring.pop(), Ok(Entry::Log { .. })));
        assert_eq!(side.pending, None);
    }

    #[test]
    fn a_gap_that_takes_the_last_room_costs_the_next_entry() {
        let (mut side, mut ring) = side(1);
        side.log(0, Level::Info, "fits");
        side.log(0, Level::Info, "does not");
        assert!(ring.pop().is_ok());
        side.log(0, Level::Info, "after the gap");
        assert!(matches!(ring.pop(), Ok(Entry::Gap(Dropped { entries: 1, .. }))));
        assert_eq!(side.pending.map(|gap| gap.entries), Some(1));
        assert_eq!(side.dropped(), 2);
    }

    #[test]
    fn long_lines_are_cut_at_a_character() {
        let (mut side, mut ring) = side(4);
        side.log(0, Level::Info, &"ü".repeat(200));
        let Ok(Entry::Log { text, .. }) = ring.pop() else { panic!("a line") };
        assert_eq!(text.as_str(), "ü".repeat(MAX_LOG_BYTES / 2));
    }
}
