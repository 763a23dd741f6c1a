//! A disk that is slow, full or broken costs records, never a tick.

use std::collections::BTreeSet;
use std::io;
use std::sync::{Arc, Condvar, Mutex};

use onbrick::clock::{Clock, MonotonicClock};
use onbrick::recording::{Options, Pace, RecordError, Recorder, Run, Sink};
use onbrick::senses::Senses;

use super::sample::{Memory, PERIOD_NS, end, options, put, sample, start, tick};

/// A disk that stands still until it is let go.
#[derive(Debug, Clone, Default)]
struct SlowDisk {
    memory: Memory,
    open: Arc<(Mutex<bool>, Condvar)>,
}

impl SlowDisk {
    fn set(&self, open: bool) {
        *self.open.0.lock().unwrap() = open;
        self.open.1.notify_all();
    }
}

impl Sink for SlowDisk {
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        let open = self.open.0.lock().unwrap();
        drop(self.open.1.wait_while(open, |open| !*open).unwrap());
        self.memory.write_all(bytes)
    }

    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn promise_7_a_slow_disk_never_holds_up_the_tick_and_its_gap_is_named() {
    let disk = SlowDisk::default();
    disk.set(true);
    let (recorder, mut side) = Recorder::start::<()>(
        Box::new(disk.clone()),
        start(Pace::Real),
        options(PERIOD_NS, 16),
        Box::new(|_| {}),
    )
    .unwrap();
    disk.set(false);
    // The disk hangs at the first sync; far more is put than the ring holds. That this returns at
    // all is the point.
    (0..500).for_each(|number| side.tick(&tick(number)));
    assert!(side.dropped() > 400, "{} dropped", side.dropped());
    assert!(!side.failed());
    disk.set(true);
    let dropped = side.dropped();
    let summary = recorder.finish(side, end(500)).unwrap();
    assert_eq!(summary.dropped, dropped);
    let run = Run::read(&disk.memory.bytes()).unwrap();
    let recorded: BTreeSet<u64> = run.senses.iter().map(|senses| senses.tick).collect();
    let missing: BTreeSet<u64> =
        run.gaps.iter().flat_map(|gap| gap.first_tick..=gap.last_tick).collect();
    let all: BTreeSet<u64> = recorded.union(&missing).copied().collect();
    assert_eq!(all, (0..500).collect(), "every tick is recorded or named");
    assert_eq!(recorded.intersection(&missing).count(), 0, "{:?}", run.gaps);
    assert_eq!(run.gaps.iter().map(|gap| gap.entries).sum::<u32>(), dropped);
    assert!(run.gaps[0].reason.contains("disk"), "{:?}", run.gaps);
}

#[test]
fn promise_7_what_no_tick_follows_is_synced_all_the_same() {
    let memory = Memory::default();
    let (recorder, mut side) = Recorder::start::<()>(
        Box::new(memory.clone()),
        start(Pace::Real),
        Options::default(),
        Box::new(|_| {}),
    )
    .unwrap();
    (0..5).for_each(|number| side.tick(&tick(number)));
    let deadline_ns = MonotonicClock.now_ns() + 20_000_000_000;
    let synced = || Run::read(&memory.bytes()).unwrap().senses.len();
    while synced() < 5 {
        assert!(MonotonicClock.now_ns() < deadline_ns, "{} of 5 ticks are synced", synced());
        MonotonicClock.sleep_ns(20_000_000);
    }
    recorder.finish(side, end(5)).unwrap();
}

/// A disk that is full after this many bytes, or that cannot sync any more.
#[derive(Debug, Clone)]
struct FailingDisk {
    memory: Memory,
    room: usize,
    syncs: usize,
}

impl Sink for FailingDisk {
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        let fits = bytes.len().min(self.room);
        self.room -= fits;
        self.memory.write_all(&bytes[..fits])?;
        if fits < bytes.len() { Err(io::ErrorKind::StorageFull.into()) } else { Ok(()) }
    }

    fn sync(&mut self) -> io::Result<()> {
        self.syncs = self.syncs.checked_sub(1).ok_or_else(|| io::Error::from_raw_os_error(5))?;
        Ok(())
    }
}

/// Records on a failing disk; how far it got.
fn record_on(disk: &FailingDisk) -> Result<(), RecordError> {
    let (recorder, mut side) = Recorder::start(
        Box::new(disk.clone()),
        start(Pace::Virtual),
        options(100_000_000, 16),
        Box::new(|_| {}),
    )?;
    (0..100).for_each(|number| put(&mut side, number));
    let result = recorder.finish(side, end(100)).map(|_| ());
    assert!(result.is_err(), "the disk failed");
    result
}

#[test]
fn promise_7_a_full_disk_stops_the_recording_with_one_message_and_keeps_what_was_synced() {
    let length = sample(100, 100_000_000).len();
    for room in (0..length - 1).step_by(1_313) {
        let disk = FailingDisk { memory: Memory::default(), room, syncs: usize::MAX };
        let error = record_on(&disk).unwrap_err();
        assert!(error.to_string().contains("recording stopped: cannot"), "{error}");
        assert_eq!(error.source.kind(), io::ErrorKind::StorageFull, "{error:?}");
        let bytes = disk.memory.bytes();
        assert_eq!(bytes.len(), room);
        if let Ok(run) = Run::read(&bytes) {
            let expected: Vec<Senses> =
                (0..run.senses.len() as u64).map(|number| tick(number).senses).collect();
            assert_eq!(run.senses, expected, "with room for {room} bytes");
            assert_eq!(run.integrity.damaged, []);
        }
    }
}

#[test]
fn promise_7_a_disk_that_cannot_sync_is_seen_by_the_tick() {
    let disk = FailingDisk { memory: Memory::default(), room: usize::MAX, syncs: 2 };
    let (recorder, mut side) = Recorder::start::<()>(
        Box::new(disk.clone()),
        start(Pace::Virtual),
        options(100_000_000, 16),
        Box::new(|_| {}),
    )
    .unwrap();
    let seen = (0..100_000).find(|number| {
        side.tick(&tick(*number));
        side.failed()
    });
    assert!(seen.is_some_and(|number| number > 5), "{seen:?}");
    let error = recorder.finish(side, end(100)).unwrap_err();
    assert_eq!(error.source.raw_os_error(), Some(5), "{error:?}");
    assert_eq!(
        error.to_string(),
        "recording stopped: cannot bring the file to the disk; what was synced before is safe"
    );
}

#[test]
fn promise_7_a_disk_that_fails_at_once_is_known_before_anything_moves() {
    let disk = FailingDisk { memory: Memory::default(), room: 10, syncs: 9 };
    let error = Recorder::start::<()>(
        Box::new(disk),
        start(Pace::Real),
        Options::default(),
        Box::new(|_| {}),
    )
    .unwrap_err();
    assert_eq!(error.source.kind(), io::ErrorKind::StorageFull, "{error:?}");
}
