//! Promise 7, damaged bytes: whole chunks are read, and no wrong record is taken for a right one.

use std::ops::Range;

use onbrick::recording::Run;
use onbrick::runtime::replay;
use onbrick::senses::Senses;

use crate::recording::sample::{chunks, sample};
use crate::support::chance::Chance;
use crate::support::is_long;
use crate::support::promised::promised;
use crate::support::stage::Play;

/// A whole recording, and what each of its chunks holds.
struct Whole {
    bytes: Vec<u8>,
    run: Run,
    /// Where each chunk is, and how many ticks, points and transitions there are up to its end.
    chunks: Vec<(Range<usize>, [usize; 3])>,
}

impl Whole {
    fn of(bytes: Vec<u8>) -> Self {
        let run = Run::read(&bytes).unwrap();
        let places = chunks(&bytes).into_iter().map(|(place, _)| place);
        let chunks = places
            .map(|place| (place.clone(), counts(&Run::read(&bytes[..place.end]).unwrap())))
            .collect();
        Self { bytes, run, chunks }
    }

    /// The chunk that a byte is in; none where nothing of a tick is lost with it, as with the times
    /// that a chunk begins with: others seek by them.
    fn chunk(&self, place: usize) -> Option<usize> {
        let times = |chunk: &Range<usize>| chunk.start + 9..chunk.start + 25;
        self.chunks
            .iter()
            .position(|(chunk, _)| chunk.contains(&place) && !times(chunk).contains(&place))
    }

    /// What must be read where these chunks are damaged: everything in all the others, to the last
    /// bit.
    fn judge(&self, damaged: &[u8], hit: &[usize], what: &str) {
        let run = Run::read(damaged).unwrap_or_else(|error| panic!("{what}: {error}"));
        let kept = |of: usize, all: usize| -> Vec<usize> {
            let from = |chunk: usize| if chunk == 0 { 0 } else { self.chunks[chunk - 1].1[of] };
            let lost = |at: &usize| {
                hit.iter().any(|&chunk| (from(chunk)..self.chunks[chunk].1[of]).contains(at))
            };
            (0..all).filter(|at| !lost(at)).collect()
        };
        let senses: Vec<&Senses> =
            kept(0, self.run.senses.len()).into_iter().map(|at| &self.run.senses[at]).collect();
        assert_eq!(run.senses.iter().collect::<Vec<_>>(), senses, "{what}: senses");
        let points: Vec<_> =
            kept(1, self.run.points.len()).into_iter().map(|at| self.run.points[at]).collect();
        assert_eq!(run.points, points, "{what}: points");
        let taken: Vec<_> = kept(2, self.run.transitions.len())
            .into_iter()
            .map(|at| &self.run.transitions[at])
            .collect();
        assert_eq!(run.transitions.iter().collect::<Vec<_>>(), taken, "{what}: transitions");
        assert!(hit.is_empty() || !run.warnings.is_empty(), "{what}: no warning");
    }
}

fn counts(run: &Run) -> [usize; 3] {
    [run.senses.len(), run.points.len(), run.transitions.len()]
}

/// Shares the work among the machine's processors.
fn in_parallel(from: usize, to: usize, work: impl Fn(usize) + Sync) {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for thread in 0..threads {
            let work = &work;
            scope.spawn(move || (from + thread..to).step_by(threads).for_each(work));
        }
    });
}

#[test]
fn promise_7_every_single_flipped_bit_of_a_small_recording_costs_at_most_its_chunk() {
    let whole = Whole::of(sample(9, 60_000_000));
    let texts = whole.chunks[0].0.start + 300..whole.chunks[0].0.end - 1_500;
    let flips = std::sync::atomic::AtomicUsize::new(0);
    in_parallel(0, whole.bytes.len(), |place| {
        let mut damaged = whole.bytes.clone();
        let hit: Vec<usize> = whole.chunk(place).into_iter().collect();
        // In the short form, one bit of each byte in the long texts of the schemas.
        let bits =
            if texts.contains(&place) && !is_long() { place % 8..place % 8 + 1 } else { 0..8 };
        for bit in bits {
            damaged[place] ^= 1 << bit;
            whole.judge(&damaged, &hit, &format!("bit {bit} of byte {place}"));
            damaged[place] ^= 1 << bit;
            flips.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        }
    });
    let flips = flips.into_inner();
    promised(&format!(
        "{flips} single bits of {} bytes flipped: the other chunks are read to the last bit, 0 \
         wrong records",
        whole.bytes.len()
    ));
}

#[test]
fn promise_7_random_flips_in_a_large_recording_cost_at_most_their_chunks() {
    let seconds = if is_long() { 120.0 } else { 30.0 };
    let played = Play::of("map", "arena", 3).seconds(seconds).play().unwrap();
    let whole = Whole::of(played.disk.bytes());
    let wanted: usize = if is_long() { 100_000 } else { 2_000 };
    // One flip a file in the long form; in the short one up to ten, so that damage meets damage.
    let most = if is_long() { 1 } else { 10 };
    let files = wanted / most;
    let flips = std::sync::atomic::AtomicUsize::new(0);
    in_parallel(0, files, |file| {
        let mut chance = Chance::new(file as u64);
        let mut damaged = whole.bytes.clone();
        let mut hit = Vec::new();
        let mut beginning = false;
        for _ in 0..most {
            let place = chance.below(damaged.len());
            damaged[place] ^= 1 << chance.below(8);
            hit.extend(whole.chunk(place));
            // Robot, mission and what the run is.
            beginning |= place < whole.chunks[0].0.start;
        }
        flips.fetch_add(most, std::sync::atomic::Ordering::Relaxed);
        hit.sort_unstable();
        hit.dedup();
        whole.judge(&damaged, &hit, &format!("seed {file}"));
        // Replay continues behind every gap, and is right about all that it replays.
        if file % 50 == 0 && !beginning {
            let run = Run::read(&damaged).unwrap();
            let replayed = replay(&run).unwrap();
            assert!(replayed.is_same(), "seed {file}: {replayed}");
            let ticks = |chunk: usize| whole.chunks[chunk].1[0];
            let inner =
                hit.iter().any(|&chunk| ticks(chunk) > 0 && ticks(chunk) < whole.run.senses.len());
            assert!(!inner || !replayed.gaps.is_empty(), "seed {file}: {replayed}");
        }
    });
    promised(&format!(
        "{} random bits of {} kB in {} chunks flipped, in {files} files: 0 wrong records, replays \
         go on behind the gaps",
        flips.into_inner(),
        whole.bytes.len() / 1000,
        whole.chunks.len()
    ));
}
