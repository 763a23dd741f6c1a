//! Tests of the recording: what goes in comes out, however slow the disk, wherever the file is cut.

use std::io::{self, Write as _};
use std::os::unix::fs::FileExt as _;
use std::sync::{Arc, Mutex};

use onbrick::clock::{Clock, MonotonicClock};
use onbrick::mapping::MapPoint;
use onbrick::recording::{
    Followed, Level, Options, Pace, ReadError, Recorder, Run, Status, TickRecord, create, ending_of,
};
use onbrick::runtime::PilotState;
use onbrick::runtime::StopReason;
use onbrick::senses::Senses;
use proptest::prelude::*;

pub(crate) mod decoder;
mod disks;
mod older;
mod readers;
pub(crate) mod sample;

use sample::{Memory, PERIOD_NS, chunks, end, grid, options, put, sample, start, taken, tick};

#[test]
fn what_is_recorded_comes_back_bit_for_bit() {
    let run = Run::read(&sample(120, 1_000_000_000)).unwrap();
    assert_eq!(run.warnings, Vec::<String>::new());
    let expected: Vec<TickRecord> = (0..120).map(tick).collect();
    // Bits, so that −0 is not 0.
    let bits = |senses: &Senses| senses.readings.map(|reading| reading.map(|r| r.value.to_bits()));
    for (read, record) in run.senses.iter().zip(&expected) {
        assert_eq!(read, &record.senses);
        assert_eq!(bits(read), bits(&record.senses));
    }
    assert_eq!(run.senses.len(), 120);
    for (read, record) in run.poses.iter().zip(&expected) {
        assert_eq!(read.pose, record.estimate.pose);
        assert_eq!((read.tick, read.time_ns), (record.senses.tick, record.estimate.time_ns));
        assert_eq!(read.range, record.estimate.range);
        assert_eq!(read.travelled_m.to_bits(), record.estimate.travelled_m.to_bits());
    }
    assert_eq!(run.poses.len(), 120);
    let points: Vec<MapPoint> = expected.iter().flat_map(|record| record.placed.to_vec()).collect();
    assert_eq!(run.points, points);
    assert_eq!(run.map, Some(grid()));
}

#[test]
fn a_file_on_a_disk_is_written_and_opened() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let sink = create(&path).unwrap();
    assert_eq!(create(&path).unwrap_err().kind(), io::ErrorKind::AlreadyExists);
    let (recorder, mut side) =
        Recorder::start(Box::new(sink), start(Pace::Virtual), Options::default(), Box::new(|_| {}))
            .unwrap();
    let on_disk = Run::open(&path).unwrap();
    assert_eq!(on_disk.robot_toml, Some(start(Pace::Virtual).robot_toml), "before the first tick");
    (0..100).for_each(|number| put(&mut side, number));
    let summary = recorder.finish(side, end(100)).unwrap();
    assert_eq!(summary.bytes, std::fs::metadata(&path).unwrap().len());
    let run = Run::open(&path).unwrap();
    assert_eq!((run.senses.len(), run.warnings.len(), run.integrity.complete), (100, 0, true));
    assert!(create(&folder.path().join("no/such/run.mcap")).is_err());
}

#[test]
fn a_recording_is_followed_whose_empty_file_was_deleted_and_made_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap.part");
    let mut followed = Followed::of(path.clone());
    for there in [None, Some(Vec::new()), None, Some(sample(100, 1_000_000_000)), None] {
        match there {
            Some(bytes) => std::fs::write(&path, bytes).unwrap(),
            None => drop(std::fs::remove_file(&path)),
        }
        followed.look().unwrap();
    }
    assert_eq!(followed.run().poses.len(), 100);
}

#[test]
fn what_happened_is_recorded_by_name() {
    let run = Run::read(&sample(120, 1_000_000_000)).unwrap();
    let told: Vec<_> = run
        .transitions
        .iter()
        .map(|t| {
            (
                t.tick,
                t.taken,
                t.machine.as_str(),
                t.from.as_str(),
                t.to.as_str(),
                t.condition.as_str(),
            )
        })
        .collect();
    let expected = [
        (25, taken(25), "drive", "turn", "forward", ""),
        (50, taken(50), "drive", "forward", "turn", "range_m < 0.25"),
        (75, taken(75), "drive", "turn", "forward", "state_turn_deg > 90"),
        (100, taken(100), "drive", "forward", "turn", "range_m < 0.25"),
    ];
    assert_eq!(told, expected);
    let line = &run.logs[0];
    assert_eq!(
        (line.time_ns, line.level, line.text.as_str()),
        (1_000 + 25 * PERIOD_NS, Level::Warn, "a wall <ahead>")
    );
    let ticks: Vec<u64> = run.checkpoints.iter().map(|checkpoint| checkpoint.tick).collect();
    assert_eq!(ticks, [0, 50, 100]);
    let state: PilotState = run.checkpoints[1].state().unwrap();
    assert_eq!(state.estimator.odometry, tick(50).estimate.pose);
    assert_eq!(state.program.machines[0].since[0].entered_m, 0.5);
    assert_eq!(state.program.variables[..], sample::variables(50));
    let found: Vec<f64> = run.variables.iter().map(|told| told.value[0]).collect();
    assert_eq!(found, [1.0, 2.0, 3.0, 4.0]);
    let second = run.statistics[0];
    assert_eq!((second.first_tick, second.ticks, second.overruns), (0, 51, 1), "{second:?}");
    assert_eq!(
        (second.lateness_p50_ns, second.lateness_max_ns),
        (25_000, PERIOD_NS + 1),
        "{second:?}"
    );
    assert_eq!(run.statistics.iter().map(|window| window.ticks).sum::<u32>(), 120);
}

#[test]
fn what_the_run_is_and_how_it_ended_is_recorded() {
    let run = Run::read(&sample(10, 1_000_000_000)).unwrap();
    let expected = start(Pace::Virtual);
    assert_eq!(run.robot_toml, Some(expected.robot_toml));
    assert_eq!(run.mission_toml, Some(expected.mission_toml));
    assert_eq!(run.world_toml, expected.world_toml);
    assert_eq!(run.info, Some(expected.info));
    let ending = run.ending.unwrap();
    assert_eq!((ending.stop.reason, ending.truth), (StopReason::Finished, end(10).truth));
}

#[test]
fn the_same_run_gives_the_same_bytes_and_a_small_ring_loses_nothing_in_simulated_time() {
    let bytes = sample(3_000, 1_000_000_000);
    assert_eq!(bytes, sample(3_000, 1_000_000_000));
    let run = Run::read(&bytes).unwrap();
    assert_eq!((run.senses.len(), run.gaps.len()), (3_000, 0));
    println!("a tick costs {} bytes of file", bytes.len() / 3_000);
}

#[test]
fn what_recording_costs_is_printed() {
    let records: Vec<TickRecord> = (0..6_000).map(tick).collect();
    let (recorder, mut side) = Recorder::start::<()>(
        Box::new(Memory::default()),
        start(Pace::Real),
        options(1_000_000_000, 8_192),
        Box::new(|_| {}),
    )
    .unwrap();
    let started_ns = MonotonicClock.now_ns();
    records.iter().for_each(|record| side.tick(record));
    let put_ns = MonotonicClock.now_ns() - started_ns;
    let summary = recorder.finish(side, end(6_000)).unwrap();
    let all_ns = MonotonicClock.now_ns() - started_ns;
    println!(
        "6000 ticks: {} ns each for the tick, {} ns each for the recorder, {} bytes each",
        put_ns / 6_000,
        all_ns / 6_000,
        summary.bytes / 6_000
    );
    assert_eq!(summary.dropped, 0, "the ring held them all");
}

#[test]
fn the_status_follows_the_run() {
    let seen = Arc::new(Mutex::new(Vec::<Status>::new()));
    let tell = Arc::clone(&seen);
    let (recorder, mut side) = Recorder::start(
        Box::new(Memory::default()),
        start(Pace::Virtual),
        Options::default(),
        Box::new(move |status| tell.lock().unwrap().push(status.clone())),
    )
    .unwrap();
    (0..200).for_each(|number| put(&mut side, number));
    recorder.finish(side, end(200)).unwrap();
    let seen = seen.lock().unwrap();
    assert_eq!(seen.len(), 21, "five times a second for four seconds, and at the end");
    let last = seen.last().unwrap();
    assert_eq!((last.tick, last.pose), (199, tick(199).estimate.pose));
    assert_eq!(last.elapsed_ns, 199 * PERIOD_NS);
    assert_eq!(last.battery_v, Some(7.9));
    assert_eq!(last.states, [("drive".to_owned(), "forward".to_owned())]);
    assert!(last.points > 20, "{last:?}");
}

#[test]
fn a_recorder_whose_listener_panics_is_seen_as_failed() {
    let (recorder, mut side) = Recorder::start::<()>(
        Box::new(Memory::default()),
        start(Pace::Virtual),
        options(1_000_000_000, 4),
        Box::new(|_| panic!("a listener's mistake")),
    )
    .unwrap();
    (0..100).for_each(|number| side.tick(&tick(number)));
    assert!(side.failed());
    let error = recorder.finish(side, end(100)).unwrap_err();
    assert!(error.source.to_string().contains("panicked"), "{error:?}");
}

#[test]
fn promise_7_a_file_cut_anywhere_gives_all_whole_records_before_the_cut() {
    let bytes = sample(24, 100_000_000);
    let whole = Run::read(&bytes).unwrap();
    let chunks = chunks(&bytes);
    assert!(chunks.len() >= 5, "{} chunks", chunks.len());
    for cut in 0..bytes.len() {
        let run = match Run::read(&bytes[..cut]) {
            Ok(run) => run,
            Err(ReadError::NotARecording { .. }) if cut < 60 => continue,
            Err(error) => panic!("cut at {cut}: {error}"),
        };
        let integrity = &run.integrity;
        let before: u64 =
            chunks.iter().filter(|(place, _)| place.end <= cut).map(|(_, messages)| messages).sum();
        assert_eq!(integrity.messages, before, "cut at {cut}");
        assert_eq!(run.senses, whole.senses[..run.senses.len()], "cut at {cut}");
        assert_eq!(run.points, whole.points[..run.points.len()], "cut at {cut}");
        assert_eq!(integrity.damaged, [], "cut at {cut}");
        assert!(
            !integrity.complete && run.warnings.iter().any(|w| w.contains("cut")),
            "cut at {cut}"
        );
    }
}

#[test]
fn what_was_appended_to_a_recording_is_said_and_left_out() {
    let whole = Run::read(small()).unwrap();
    for (more, said) in [(&b"x"[..], "the recording's end: 1 byte"), (small(), " bytes")] {
        let run = Run::read(&[small(), more].concat()).unwrap();
        assert!(run.integrity.complete && run.integrity.damaged.is_empty(), "{:?}", run.integrity);
        assert_eq!(run.integrity.appended_bytes, more.len() as u64);
        assert_eq!((run.senses, run.ending), (whole.senses.clone(), whole.ending.clone()));
        let [warning] = &run.warnings[..] else { panic!("{:?}", run.warnings) };
        assert!(warning.contains(said), "{warning}");
    }
}

#[test]
fn what_is_no_recording_is_refused_with_a_reason() {
    let mut other = Vec::new();
    let mut writer = mcap::Writer::new(io::Cursor::new(&mut other)).unwrap();
    writer.finish().unwrap();
    drop(writer);
    for (bytes, why) in [
        (&b""[..], "the file is empty"),
        (b"\x89MCA", "only its first few bytes"),
        (b"name = \"map\"\n", "it is no MCAP file"),
        (&[0; 5_000], "it is no MCAP file"),
        (&other, "an MCAP file of another program"),
    ] {
        let error = Run::read(bytes).unwrap_err().to_string();
        assert!(error.contains(why), "{error}");
    }
    let error = Run::open(std::path::Path::new("/no/such/run.mcap")).unwrap_err().to_string();
    assert_eq!(error, "cannot read /no/such/run.mcap");
}

#[test]
fn promise_7_an_ending_is_seen_from_outside_as_it_was_written_or_not_at_all() {
    let bytes = small();
    let ending = Run::read(bytes).unwrap().ending;
    assert!(ending.is_some());
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    assert_eq!(ending_of(file.path()).unwrap(), ending);
    // Each byte of what a summary's reader looks at first, and some of all others.
    let places = (0..bytes.len()).filter(|place| place % 13 == 0 || place + 500 > bytes.len());
    let mut unseen = 0;
    for place in places {
        file.as_file().write_at(&[bytes[place] ^ 0x80], place as u64).unwrap();
        let seen = ending_of(file.path()).unwrap();
        file.as_file().write_at(&bytes[place..=place], place as u64).unwrap();
        // No text has such a byte in it: what is not counted by the summary's checksum is noticed
        // too.
        assert!(seen.is_none() || seen == ending, "byte {place}: {seen:?}");
        unseen += usize::from(seen.is_none());
    }
    // The ending has a checksum of its own; the summary matters only where it leads there.
    assert!(unseen > 100, "{unseen} unseen");
    for length in [0, 8, bytes.len() / 2, bytes.len() - 37, bytes.len() - 8, bytes.len() - 1] {
        file.as_file().set_len(length as u64).unwrap();
        assert_eq!(ending_of(file.path()).unwrap(), None, "{length} bytes");
        file.as_file().write_at(bytes, 0).unwrap();
    }
}

#[test]
fn promise_7_after_as_many_chunks_as_in_ten_hours_the_summary_leads_to_each() {
    let bytes = sample(36_000, PERIOD_NS);
    let summary = mcap::Summary::read(&bytes).unwrap().expect("a summary");
    assert!(summary.chunk_indexes.len() >= 35_990, "{} chunks", summary.chunk_indexes.len());
    let last = summary.chunk_indexes.iter().max_by_key(|chunk| chunk.chunk_start_offset).unwrap();
    let messages = summary.stream_chunk(&bytes, last).unwrap().map(Result::unwrap);
    assert!(messages.map(|message| message.channel.topic.clone()).any(|topic| topic == "/map"));
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(&bytes).unwrap();
    assert_eq!(ending_of(file.path()).unwrap(), Run::read(&bytes).unwrap().ending);
    assert!(Run::read(&bytes).unwrap().ending.is_some());
}

proptest! {
    #[test]
    fn promise_7_no_bytes_make_the_reader_panic(
        garbage in proptest::collection::vec(any::<u8>(), 0..400),
        keep in 0_usize..20_000,
        place in 0_usize..20_000,
    ) {
        let _ = Run::read(&garbage);
        let mut bytes = small().clone();
        bytes.truncate(keep);
        bytes.extend_from_slice(&garbage);
        let _ = Run::read(&bytes);
        let mut bytes = small().clone();
        for (offset, byte) in garbage.iter().enumerate() {
            if let Some(target) = bytes.get_mut(place + offset) {
                *target = *byte;
            }
        }
        let checked = Run::read(&bytes);
        if let Ok(run) = checked {
            let known: Vec<Senses> = (0..9).map(|number| tick(number).senses).collect();
            prop_assert!(run.senses.iter().all(|senses| known.contains(senses)));
        }
    }
}

fn small() -> &'static Vec<u8> {
    static SMALL: std::sync::OnceLock<Vec<u8>> = std::sync::OnceLock::new();
    SMALL.get_or_init(|| sample(9, 60_000_000))
}

#[test]
fn a_recorder_that_is_let_go_closes_its_file() {
    let memory = Memory::default();
    let (recorder, mut side) = Recorder::start(
        Box::new(memory.clone()),
        start(Pace::Real),
        Options::default(),
        Box::new(|_| {}),
    )
    .unwrap();
    (0..30).for_each(|number| put(&mut side, number));
    drop(side);
    drop(recorder);
    let run = Run::read(&memory.bytes()).unwrap();
    assert_eq!((run.senses.len(), run.ending, run.integrity.complete), (30, None, true));
    assert_eq!(run.warnings, ["the run stopped without saying why"]);
}
