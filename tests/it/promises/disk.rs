//! Promise 7, the disk: full, failing, read-only, slow, without power.

use std::collections::BTreeSet;
use std::io;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::{Arc, Condvar, Mutex};

use nix::errno::Errno;
use onbrick::clock::{Clock, MILLISECOND_NS, MonotonicClock};
use onbrick::recording::{Options, Pace, Recorder, Run, Sink};
use onbrick::runtime::{StopReason, replay};
use onbrick::senses::Senses;

use crate::recording::sample::{end, start, tick};
use crate::support::chance::Chance;
use crate::support::faulty::{Kind, Plan, Trouble};
use crate::support::is_long;
use crate::support::memory::MemoryDisk;
use crate::support::pass_over;
use crate::support::promised::promised;
use crate::support::stage::Play;
use crate::support::tested_program;

const DISK: [Kind; 2] = [Kind::Write, Kind::Sync];
const SYNC_NS: i64 = 250_000_000;

fn play(records: &Plan) -> Play {
    let play = Play::of("map", "arena", 3).seconds(4.0);
    Play { records: records.clone(), sync_ns: SYNC_NS, ..play }
}

fn ticks(run: &Run) -> Vec<Senses> {
    run.senses.clone()
}

#[test]
fn promise_7_a_disk_that_fails_at_the_nth_call_stops_the_run_cleanly_for_every_n() {
    let clean = play(&Plan::counting(&[])).play().unwrap();
    let whole = ticks(&clean.run());
    let troubles = [
        Trouble::Fail(Errno::ENOSPC),
        Trouble::Fail(Errno::EIO),
        Trouble::Fail(Errno::EROFS),
        Trouble::Short(700),
    ];
    let (mut refused, mut stopped, mut most_lost) = (0, 0, 0);
    for nth in 1.. {
        let mut failed = false;
        // In the short form one kind of failure at each place, in turn.
        let kinds =
            troubles.iter().enumerate().filter(|(kind, _)| is_long() || nth % 4 == *kind as u64);
        for (_, trouble) in kinds {
            let plan = Plan::once(&DISK, nth, trouble.clone());
            let disk = MemoryDisk::default();
            let outcome = play(&plan).play_on(disk.clone());
            failed = plan.hits() > 0;
            let error = match outcome {
                // Before the first tick: the run does not even begin.
                Err(error) => {
                    refused += 1;
                    Some(error.stop().to_string())
                }
                Ok(played) => {
                    played.assert_at_rest("a failing disk");
                    let ended =
                        [StopReason::Recording, StopReason::Finished].contains(&played.reason);
                    assert!(ended, "call {nth}: {}", played.reason);
                    stopped += u32::from(played.ended.recording.is_some());
                    played.ended.recording
                }
            };
            // A sync has no bytes to come short of.
            let harmless = matches!(trouble, Trouble::Short(_)) && error.is_none();
            assert!(error.is_some() == failed || harmless, "call {nth} {trouble:?}");
            if let Some(text) = error {
                assert!(
                    text.contains("recording stopped: cannot ") && !text.contains('\n'),
                    "{text}"
                );
            }
            most_lost = most_lost.max(judge_left(&disk, &whole, nth));
        }
        if !failed {
            break;
        }
    }
    promised(&format!(
        "ENOSPC, EIO, EROFS and short writes at the nth call, n = 1, 2, …: {refused} runs refused \
         before anything moved, {stopped} stopped, \
         at most {most_lost} ticks unsynced"
    ));
}

/// What is on the disk is a beginning of the whole run, and what was synced is checked. How many
/// ticks the sync had not reached.
fn judge_left(disk: &MemoryDisk, whole: &[Senses], nth: u64) -> usize {
    let bytes = disk.bytes();
    let Ok(all) = Run::read(&bytes) else { return 0 };
    assert_eq!(all.senses, whole[..all.senses.len()], "call {nth}: all that is there");
    let synced = Run::read(&bytes[..disk.synced()]).map_or(0, |run| run.senses.len());
    assert!(all.senses.len() >= synced, "call {nth}: a synced tick is gone");
    all.senses.len() - synced
}

#[test]
fn promise_7_a_power_cut_loses_at_most_what_came_since_the_last_sync() {
    let clean = play(&Plan::counting(&[])).play().unwrap();
    let whole = ticks(&clean.run());
    let mut chance = Chance::new(7);
    let (mut cuts, mut most_lost) = (0, 0);
    for nth in 1.. {
        let plan = Plan::once(&DISK, nth, Trouble::Die(chance.below(3_000)));
        let disk = MemoryDisk::default();
        let played = play(&plan).play_on(disk.clone());
        if plan.hits() == 0 {
            break;
        }
        assert!(played.is_ok(), "who is dead learns of nothing");
        // Of what was not synced a file system keeps all, some, or puts zeros or old bytes in its
        // place.
        let (bytes, synced) = (disk.bytes(), disk.synced());
        let rest = bytes.len() - synced;
        for fate in 0..5 {
            let mut left = bytes.clone();
            match fate {
                0 => {}
                1 => left.truncate(synced + chance.below(rest + 1)),
                2 => left[synced..].fill(0),
                3 => left[synced..]
                    .iter_mut()
                    .for_each(|byte| *byte = chance.bits().to_le_bytes()[0]),
                _ => left[synced..].reverse(),
            }
            cuts += 1;
            let Ok(run) = Run::read(&left) else {
                assert_eq!(synced, 0, "cut {nth}: what was synced cannot be opened");
                continue;
            };
            let safe = Run::read(&bytes[..synced]).map_or(0, |run| run.senses.len());
            assert!(
                run.senses.len() >= safe,
                "cut {nth}, fate {fate}: {} of {safe} ticks",
                run.senses.len()
            );
            assert_eq!(run.senses, whole[..run.senses.len()], "cut {nth}, fate {fate}");
            let _ = Run::read(&left).map(|run| replay(&run).map(|replayed| replayed.to_string()));
            let reached = Run::read(&bytes).map_or(0, |run| run.senses.len());
            most_lost = most_lost.max(reached - safe);
        }
    }
    let period = usize::try_from(SYNC_NS / 20_000_000).unwrap();
    // A sync comes with the first tick behind its period, and the tick before may be in the buffer
    // still.
    assert!(most_lost <= period + 4, "{most_lost} ticks lost, {period} between two syncs");
    promised(&format!(
        "power cut at every call, {cuts} states of the disk: at most {most_lost} ticks lost of \
         {period} between syncs, no wrong one read"
    ));
}

/// A disk whose sync does not return until it is let go.
#[derive(Debug, Clone, Default)]
struct Stuck {
    memory: MemoryDisk,
    stuck: Arc<(Mutex<bool>, Condvar)>,
}

impl Stuck {
    fn set(&self, stuck: bool) {
        *self.stuck.0.lock().unwrap() = stuck;
        self.stuck.1.notify_all();
    }
}

impl Sink for Stuck {
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.memory.write_all(bytes)
    }

    fn sync(&mut self) -> io::Result<()> {
        let stuck = self.stuck.0.lock().unwrap();
        drop(self.stuck.1.wait_while(stuck, |stuck| *stuck).unwrap());
        self.memory.sync()
    }
}

#[test]
fn promise_7_a_sync_that_hangs_blocks_no_tick_and_the_gap_is_reported() {
    let disk = Stuck::default();
    let options = Options { sync_period_ns: 100_000_000, ring_entries: 64 };
    let (recorder, mut side) =
        Recorder::start::<()>(Box::new(disk.clone()), start(Pace::Real), options, Box::new(|_| {}))
            .unwrap();
    disk.set(true);
    // A minute of ticks while one sync hangs. They are put without waiting, or this would not come
    // to its end.
    (0..3_000).for_each(|number| side.tick(&tick(number)));
    let dropped = side.dropped();
    assert!(dropped > 2_000 && !side.failed(), "{dropped} dropped");
    disk.set(false);
    // When the disk is back, recording continues: several ticks in a row find room again.
    let (mut number, mut fitting) = (3_000, 0);
    while fitting < 100 {
        assert!(number < 10_000, "the recorder does not come back");
        let before = side.dropped();
        side.tick(&tick(number));
        number += 1;
        fitting = if side.dropped() == before { fitting + 1 } else { 0 };
        MonotonicClock.sleep_ns(5 * MILLISECOND_NS);
    }
    recorder.finish(side, end(number)).unwrap();
    let run = Run::read(&disk.memory.bytes()).unwrap();
    let there: BTreeSet<u64> = run.senses.iter().map(|senses| senses.tick).collect();
    let named: BTreeSet<u64> =
        run.gaps.iter().flat_map(|gap| gap.first_tick..=gap.last_tick).collect();
    assert_eq!(
        there.len() + named.len(),
        usize::try_from(number).unwrap(),
        "every tick is recorded or named"
    );
    assert!(there.is_disjoint(&named) && there.range(3_000..).count() >= 100);
    promised(&format!(
        "3000 ticks put while a sync hung: none waited, {} named as lost in {} gaps",
        named.len(),
        run.gaps.len()
    ));
}

/// Runs the real program on a disk that is made small first, in a mount namespace of its own.
fn on_a_small_disk(kilobytes: u32, out: &Path) -> Option<Output> {
    let disk = out.join("disk");
    let kept = out.join("kept");
    std::fs::create_dir_all(&disk).unwrap();
    std::fs::create_dir_all(&kept).unwrap();
    let script = format!(
        "mount -t tmpfs -o size={kilobytes}k none {disk} || exit 99; \
         {program} run map --sim arena --set time_limit_s=60 --out {disk}/run; code=$?; cp \
         {disk}/run/run.mcap {kept}; exit $code",
        disk = disk.display(),
        kept = kept.display(),
        program = tested_program(),
    );
    let user: &[&str] =
        if nix::unistd::geteuid().is_root() { &[] } else { &["--map-root-user", "--user"] };
    let output = Command::new("unshare").args(user).args(["--mount", "sh", "-c", &script]).output();
    let usable = output.as_ref().is_ok_and(|output| {
        output.status.code() != Some(99)
            && !String::from_utf8_lossy(&output.stderr).starts_with("unshare:")
    });
    if !usable {
        pass_over("mount namespaces (unshare --mount)");
        return None;
    }
    output.ok()
}

#[test]
fn promise_7_the_program_on_a_full_disk_says_so_once_and_keeps_what_it_synced() {
    let folder = tempfile::tempdir().unwrap();
    let Some(output) = on_a_small_disk(600, folder.path()) else { return };
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    let told = String::from_utf8_lossy(&output.stdout) + said.clone();
    assert_eq!(told.matches("No space left on device").count(), 1, "{told}");
    let run = Run::open(&folder.path().join("kept/run.mcap")).unwrap();
    assert!(run.integrity.damaged.is_empty() && run.senses.len() > 500, "{:?}", run.integrity);
    assert!(replay(&run).unwrap().is_same());
    promised(&format!(
        "real program on a tmpfs of 600 kB: stopped with one message, {} ticks kept",
        run.senses.len()
    ));
}

#[test]
fn promise_7_the_program_at_its_file_size_limit_says_so_and_is_not_killed() {
    let folder = tempfile::tempdir().unwrap();
    let script = format!(
        "ulimit -f 1000; exec {} run map --sim arena --set time_limit_s=60 --out {}",
        tested_program(),
        folder.path().join("run").display()
    );
    let output = Command::new("bash").args(["-c", &script]).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert_eq!(said.matches("File too large").count(), 1, "{said}");
    let run = Run::open(&folder.path().join("run/run.mcap")).unwrap();
    assert!(run.integrity.damaged.is_empty() && run.senses.len() > 500, "{:?}", run.integrity);
    promised(&format!(
        "real program under RLIMIT_FSIZE: EFBIG instead of SIGXFSZ, {} ticks kept",
        run.senses.len()
    ));
}
