//! Tests of the recording: what goes in comes out, however slow the disk, wherever the file is cut.

use std::collections::BTreeSet;
use std::io::{self, Write as _};
use std::os::unix::fs::FileExt as _;
use std::process::Command;
use std::sync::{Arc, Condvar, Mutex};

use onbrick::behavior::{MachineState, Taken};
use onbrick::clock::{Clock, MonotonicClock};
use onbrick::ev3dev::Technology;
use onbrick::mapping::{Estimate, MapPoint, Pose, Range};
use onbrick::robot::{Channel, Senses};
use onbrick::runtime::PilotState;
use onbrick::runtime::recording::{
    End, Grid, Level, MachineNames, Options, Pace, RangeSensor, ReadError, Recorder, Run, SYNC_OPCODE, Sink,
    Start, StateNames, Status, TickRecord, TickSide, create, ending_of,
};
use proptest::prelude::*;

use crate::support::pass_over;

const PERIOD_NS: i64 = 20_000_000;

/// A file in memory.
#[derive(Debug, Clone, Default)]
pub(crate) struct Memory(Arc<Mutex<Vec<u8>>>);

impl Memory {
    pub(crate) fn bytes(&self) -> Vec<u8> {
        self.0.lock().unwrap().clone()
    }
}

impl Sink for Memory {
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.0.lock().unwrap().extend_from_slice(bytes);
        Ok(())
    }

    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }
}

pub(crate) fn start(pace: Pace) -> Start {
    let state = |name: &str, conditions: &[&str]| StateNames {
        name: name.to_owned(),
        conditions: conditions.iter().map(|text| (*text).to_owned()).collect(),
    };
    Start {
        run: Some("7f3a".to_owned()),
        brick: "mapper".to_owned(),
        mission: "map <the room> & back".to_owned(),
        robot_toml: "name = \"mapper\"\n".to_owned(),
        mission_toml: "name = \"map\"\n# ü\n".to_owned(),
        world_toml: Some("name = \"arena\"\n".to_owned()),
        start_pose: Pose { x_m: 0.1, y_m: -0.2, heading_rad: 0.3 },
        start_ns: 1_000,
        wall_offset_ns: 1_700_000_000_000_000_000,
        period_ns: PERIOD_NS,
        pace,
        seed: Some(7),
        cells: Technology::LiIon,
        settings: vec![("near_m".to_owned(), 0.1 + 0.2)],
        range: Some(RangeSensor {
            ahead_m: 0.05,
            min_m: 0.03,
            max_m: 2.0,
            field_of_view_rad: 0.35,
            infrared: false,
        }),
        machines: vec![MachineNames {
            name: "drive".to_owned(),
            start: 0,
            states: vec![state("forward", &["range_m < 0.25"]), state("turn", &["state_turn_deg > 90"])],
        }],
    }
}

/// A drive on a circle in a square arena, looking around: each value moves, some are odd on purpose.
pub(crate) fn tick(number: u64) -> TickRecord {
    #[expect(clippy::cast_precision_loss, reason = "small numbers")]
    let seconds = number as f64 * 0.02;
    let time_ns = 1_000 + i64::try_from(number).unwrap() * PERIOD_NS;
    let mut senses = Senses { tick: number, time_ns, ..Senses::default() };
    let heading_rad = 0.1 * seconds;
    let head_rad = 1.5 * libm::sin(seconds);
    for (channel, value) in [
        (Channel::Left, 1.0 / 3.0 * seconds),
        (Channel::Right, -0.0),
        (Channel::Head, head_rad),
        (Channel::Range, if number % 10 == 9 { f64::INFINITY } else { 0.5 }),
        (Channel::Battery, 7.9),
    ] {
        senses.set(channel, value);
    }
    senses.readings[Channel::Head as usize].as_mut().unwrap().changed_ns = time_ns - 7;
    let radius_m = 0.5;
    let pose = Pose {
        x_m: radius_m * libm::sin(heading_rad),
        y_m: radius_m * (1.0 - libm::cos(heading_rad)),
        heading_rad,
    };
    let direction_rad = heading_rad + head_rad;
    let range = match number % 10 {
        9 => Range::NoEcho,
        8 => Range::TooNear,
        _ => Range::Echo(wall(pose, direction_rad)),
    };
    let point = match range {
        Range::Echo(range_m) if number.is_multiple_of(5) => Some(MapPoint {
            time_ns,
            x_m: pose.x_m + range_m * libm::cos(direction_rad),
            y_m: pose.y_m + range_m * libm::sin(direction_rad),
        }),
        _ => None,
    };
    let estimate = Estimate {
        time_ns,
        pose,
        forward_m_s: 0.05,
        turn_rad_s: 0.1,
        covariance: [1e-4, 2e-5, 3e-6, 4e-4, 5e-6, 6e-3],
        travelled_m: 0.05 * seconds,
        range: Some(range),
        ..Estimate::default()
    };
    let on_time_ns = i64::try_from(number % 50).unwrap() * 1000;
    let lateness_ns = if number % 50 == 3 { PERIOD_NS + 1 } else { on_time_ns };
    TickRecord { senses, estimate, point, range_is_new: number.is_multiple_of(5), lateness_ns }
}

/// From a pose to the wall of a square from (−1, −1) to (1, 1).
fn wall(pose: Pose, direction_rad: f64) -> f64 {
    let (x, y) = (libm::cos(direction_rad), libm::sin(direction_rad));
    let along = |place: f64, step: f64| {
        if step == 0.0 { f64::INFINITY } else { (step.signum() - place) / step }
    };
    along(pose.x_m, x).min(along(pose.y_m, y))
}

pub(crate) fn walls() -> Vec<[f64; 2]> {
    vec![[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]]
}

fn taken(number: u64) -> Taken {
    let to_turn = number.is_multiple_of(50);
    Taken {
        machine: 0,
        from: u16::from(!to_turn),
        to: u16::from(to_turn),
        transition: if number == 25 { None } else { Some(0) },
    }
}

fn put(side: &mut TickSide, number: u64) {
    let record = tick(number);
    let time_ns = record.senses.time_ns;
    if number.is_multiple_of(25) && number > 0 {
        side.transition(number, time_ns, taken(number));
        side.log(time_ns, Level::Warn, "a wall <ahead>");
    }
    side.tick(&record);
    if number.is_multiple_of(50) {
        let mut state = PilotState::default();
        state.machine_count = 1;
        state.estimator.pose = record.estimate.pose;
        state.machines[0] =
            MachineState { state: 1, entered_ns: time_ns, entered_m: 0.5, entered_heading_rad: 0.25 };
        side.checkpoint(number, time_ns, &state);
    }
}

pub(crate) fn grid() -> Grid {
    Grid {
        width: 3,
        height: 2,
        resolution_m: 0.05,
        origin_m: [-1.0, -0.5],
        cells: vec![-1, 0, 100, 50, 0, -1],
    }
}

pub(crate) fn end(ticks: u64) -> End {
    End {
        reason: "finished".to_owned(),
        time_ns: tick(ticks).senses.time_ns,
        truth: Some(Pose { x_m: 0.5, y_m: 0.25, heading_rad: -0.125 }),
        map: Some(grid()),
    }
}

fn options(sync_period_ns: i64, ring_entries: usize) -> Options {
    Options { sync_period_ns, ring_entries }
}

/// A finished recording of so many ticks.
pub(crate) fn sample(ticks: u64, sync_period_ns: i64) -> Vec<u8> {
    let memory = Memory::default();
    let (recorder, mut side) = Recorder::start(
        Box::new(memory.clone()),
        start(Pace::Virtual),
        options(sync_period_ns, 64),
        Box::new(|_| {}),
    )
    .unwrap();
    (0..ticks).for_each(|number| put(&mut side, number));
    recorder.finish(side, end(ticks)).unwrap();
    memory.bytes()
}

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
    let points: Vec<MapPoint> = expected.iter().filter_map(|record| record.point).collect();
    assert_eq!(run.points, points);
    assert_eq!(run.map, Some(grid()));
}

#[test]
fn a_file_on_a_disk_is_written_and_opened() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    std::fs::write(&path, vec![0xff; 1 << 20]).unwrap();
    let sink = create(&path).unwrap();
    let (recorder, mut side) =
        Recorder::start(Box::new(sink), start(Pace::Virtual), Options::default(), Box::new(|_| {})).unwrap();
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
fn what_happened_is_recorded_by_name() {
    let run = Run::read(&sample(120, 1_000_000_000)).unwrap();
    let told: Vec<_> = run
        .transitions
        .iter()
        .map(|t| (t.tick, t.taken, t.machine.as_str(), t.from.as_str(), t.to.as_str(), t.condition.as_str()))
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
    assert_eq!(run.checkpoints[1].state.estimator.pose, tick(50).estimate.pose);
    assert_eq!(run.checkpoints[1].state.machines[0].entered_m, 0.5);
    let second = run.statistics[0];
    assert_eq!((second.first_tick, second.ticks, second.overruns), (0, 51, 1), "{second:?}");
    assert_eq!((second.lateness_p50_ns, second.lateness_max_ns), (25_000, PERIOD_NS + 1), "{second:?}");
    assert_eq!(run.statistics.iter().map(|window| window.ticks).sum::<u32>(), 120);
}

#[test]
fn what_the_run_is_and_how_it_ended_is_recorded() {
    let run = Run::read(&sample(10, 1_000_000_000)).unwrap();
    let expected = start(Pace::Virtual);
    assert_eq!(run.robot_toml, Some(expected.robot_toml));
    assert_eq!(run.mission_toml, Some(expected.mission_toml));
    assert_eq!(run.world_toml, expected.world_toml);
    let info = run.info.unwrap();
    assert_eq!(info.run.as_deref(), Some("7f3a"));
    assert_eq!((info.brick.as_str(), info.mission.as_str()), ("mapper", "map <the room> & back"));
    assert_eq!((info.start_pose, info.start_ns), (expected.start_pose, 1_000));
    assert_eq!((info.wall_offset_ns, info.period_ns), (expected.wall_offset_ns, PERIOD_NS));
    assert_eq!((info.virtual_time, info.seed, info.settings), (true, Some(7), expected.settings));
    assert_eq!(info.cells, Technology::LiIon);
    let ending = run.ending.unwrap();
    assert_eq!((ending.reason.as_str(), ending.truth), ("finished", end(10).truth));
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
    let (recorder, mut side) = Recorder::start(
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
    let (recorder, mut side) = Recorder::start(
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

/// Where each record of a file ends, and whether it is a message or a sync.
pub(crate) fn records(bytes: &[u8]) -> Vec<(usize, u8)> {
    let mut at = 8;
    let mut ends = Vec::new();
    while let Some(head) = bytes.get(at..at + 9) {
        let length = u64::from_le_bytes(head[1..].try_into().unwrap());
        at += 9 + usize::try_from(length).unwrap();
        ends.push((at, head[0]));
        if head[0] == 0x0f {
            break;
        }
    }
    ends
}

#[test]
fn promise_7_a_file_cut_anywhere_gives_all_whole_records_before_the_cut() {
    const MESSAGE: u8 = 0x05;
    let bytes = sample(24, 100_000_000);
    let whole = Run::read(&bytes).unwrap();
    let records = records(&bytes);
    assert!(records.iter().filter(|(_, opcode)| *opcode == SYNC_OPCODE).count() >= 5);
    for cut in 0..bytes.len() {
        let messages_before = |end: usize| {
            records.iter().filter(|(at, opcode)| *at <= end && *opcode == MESSAGE).count() as u64
        };
        let last_sync = records.iter().rfind(|(at, opcode)| *at <= cut && *opcode == SYNC_OPCODE);
        let run = match Run::read(&bytes[..cut]) {
            Ok(run) => run,
            Err(ReadError::NotARecording { .. }) if cut < 60 => continue,
            Err(error) => panic!("cut at {cut}: {error}"),
        };
        let integrity = &run.integrity;
        let checked = last_sync.map_or(0, |(at, _)| messages_before(*at));
        assert_eq!(integrity.checked_messages, checked, "cut at {cut}");
        let all = integrity.checked_messages + integrity.unchecked_messages;
        assert_eq!(all, messages_before(cut), "cut at {cut}");
        assert_eq!(run.senses, whole.senses[..run.senses.len()], "cut at {cut}");
        assert_eq!(run.points, whole.points[..run.points.len()], "cut at {cut}");
        assert_eq!(integrity.damaged, [], "cut at {cut}");
        assert!(!integrity.complete && run.warnings.iter().any(|w| w.contains("cut")), "cut at {cut}");
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
        // No text has such a byte in it: what is not counted by the summary's checksum is noticed too.
        assert!(seen.is_none() || seen == ending, "byte {place}: {seen:?}");
        unseen += usize::from(seen.is_none());
    }
    assert!(unseen > 500, "{unseen} unseen");
    for length in [0, 8, bytes.len() / 2, bytes.len() - 37, bytes.len() - 8, bytes.len() - 1] {
        file.as_file().set_len(length as u64).unwrap();
        assert_eq!(ending_of(file.path()).unwrap(), None, "{length} bytes");
        file.as_file().write_at(bytes, 0).unwrap();
    }
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
        let checked = Run::read_checked(&bytes);
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
    let (recorder, mut side) =
        Recorder::start(Box::new(disk.clone()), start(Pace::Real), options(PERIOD_NS, 16), Box::new(|_| {}))
            .unwrap();
    disk.set(false);
    // The disk hangs at the first sync; far more is put than the ring holds. That this returns at all is the point.
    (0..500).for_each(|number| side.tick(&tick(number)));
    assert!(side.dropped() > 400, "{} dropped", side.dropped());
    assert!(!side.failed());
    disk.set(true);
    let dropped = side.dropped();
    let summary = recorder.finish(side, end(500)).unwrap();
    assert_eq!(summary.dropped, dropped);
    let run = Run::read(&disk.memory.bytes()).unwrap();
    let recorded: BTreeSet<u64> = run.senses.iter().map(|senses| senses.tick).collect();
    let missing: BTreeSet<u64> = run.gaps.iter().flat_map(|gap| gap.first_tick..=gap.last_tick).collect();
    let all: BTreeSet<u64> = recorded.union(&missing).copied().collect();
    assert_eq!(all, (0..500).collect(), "every tick is recorded or named");
    assert_eq!(recorded.intersection(&missing).count(), 0, "{:?}", run.gaps);
    assert_eq!(run.gaps.iter().map(|gap| gap.entries).sum::<u32>(), dropped);
    assert!(run.gaps[0].reason.contains("disk"), "{:?}", run.gaps);
}

#[test]
fn promise_7_what_no_tick_follows_is_synced_all_the_same() {
    let memory = Memory::default();
    let (recorder, mut side) =
        Recorder::start(Box::new(memory.clone()), start(Pace::Real), Options::default(), Box::new(|_| {}))
            .unwrap();
    (0..5).for_each(|number| side.tick(&tick(number)));
    let deadline_ns = MonotonicClock.now_ns() + 20_000_000_000;
    let synced = || Run::read_checked(&memory.bytes()).unwrap().senses.len();
    while synced() < 5 {
        assert!(MonotonicClock.now_ns() < deadline_ns, "{} of 5 ticks are synced", synced());
        MonotonicClock.sleep_until_ns(MonotonicClock.now_ns() + 20_000_000);
    }
    recorder.finish(side, end(5)).unwrap();
}

/// A disk that is full after so many bytes, or that cannot sync any more.
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
fn record_on(disk: &FailingDisk) -> Result<(), onbrick::runtime::recording::RecordError> {
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
    let (recorder, mut side) = Recorder::start(
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
    let error =
        Recorder::start(Box::new(disk), start(Pace::Real), Options::default(), Box::new(|_| {})).unwrap_err();
    assert_eq!(error.source.kind(), io::ErrorKind::StorageFull, "{error:?}");
}

#[test]
fn a_recorder_that_is_let_go_closes_its_file() {
    let memory = Memory::default();
    let (recorder, mut side) =
        Recorder::start(Box::new(memory.clone()), start(Pace::Real), Options::default(), Box::new(|_| {}))
            .unwrap();
    (0..30).for_each(|number| put(&mut side, number));
    drop(side);
    drop(recorder);
    let run = Run::read(&memory.bytes()).unwrap();
    assert_eq!((run.senses.len(), run.ending, run.integrity.complete), (30, None, true));
    assert_eq!(run.warnings, ["the run stopped without saying why"]);
}

/// What the Python decoder makes of a file; `None` where there is no Python with the packages.
pub(crate) fn python(bytes: &[u8], how: &str) -> Option<serde_json::Value> {
    let probe = Command::new("python3").args(["-c", "import mcap, mcap_ros2"]).output();
    if !probe.is_ok_and(|output| output.status.success()) {
        pass_over("python3 with the packages mcap and mcap-ros2-support");
        return None;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    std::fs::write(&path, bytes).unwrap();
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/python/decode.py");
    let output =
        Command::new("python3").args([script.as_ref(), path.as_os_str(), how.as_ref()]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(serde_json::from_slice(&output.stdout).unwrap())
}

#[test]
fn an_independent_decoder_reads_every_message_by_its_own_definition() {
    let Some(found) = python(&sample(120, 1_000_000_000), "linear") else { return };
    println!("{found:#}");
    assert_eq!(found["profile"], "ros2");
    let topics = &found["topics"];
    for (topic, schema, count) in [
        ("/senses", "onbrick_msgs/msg/Senses", 120),
        ("/pose", "onbrick_msgs/msg/Pose", 120),
        ("/odom", "nav_msgs/msg/Odometry", 24),
        ("/tf", "tf2_msgs/msg/TFMessage", 24),
        ("/tf_static", "tf2_msgs/msg/TFMessage", 1),
        ("/range", "sensor_msgs/msg/Range", 24),
        ("/points", "sensor_msgs/msg/PointCloud2", 3),
        ("/map", "nav_msgs/msg/OccupancyGrid", 1),
        ("/transitions", "onbrick_msgs/msg/Transition", 4),
        ("/rosout", "rcl_interfaces/msg/Log", 4),
        ("/stats", "onbrick_msgs/msg/TickStatistics", 3),
        ("/checkpoint", "onbrick_msgs/msg/Checkpoint", 3),
    ] {
        assert_eq!(topics[topic]["schema"], schema);
        assert_eq!(topics[topic]["count"], count, "{topic}");
    }
    let last = tick(119);
    let senses = &topics["/senses"]["last"];
    assert_eq!(senses["tick"], 119);
    assert_eq!(senses["channel"], serde_json::json!([0, 1, 2, 3, 9]));
    assert_eq!(senses["value"][0], last.senses.get(Channel::Left).unwrap().value);
    assert_eq!(senses["value"][3], "inf");
    // JSON on the way here costs the last bit.
    let x_m = topics["/pose"]["last"]["x_m"].as_f64().unwrap();
    assert!((x_m - last.estimate.pose.x_m).abs() < 1e-15, "{x_m}");
    let odometry = &topics["/odom"]["first"];
    assert_eq!(odometry["header"]["frame_id"], "odom");
    assert_eq!(odometry["child_frame_id"], "base_link");
    assert_eq!(odometry["header"]["stamp"], serde_json::json!({"sec": 1_700_000_000, "nanosec": 1_000}));
    assert_eq!(odometry["pose"]["covariance"][5], 3e-6);
    assert_eq!(odometry["pose"]["covariance"][35], 6e-3);
    assert_eq!(odometry["twist"]["twist"]["linear"]["x"], 0.05);
    let transforms = &topics["/tf"]["first"]["transforms"];
    assert_eq!(transforms[1]["header"]["frame_id"], "base_link");
    assert_eq!(transforms[1]["child_frame_id"], "range_link");
    assert_eq!(transforms[1]["transform"]["translation"]["x"], 0.05);
    assert_eq!(topics["/range"]["first"]["max_range"], 2.0);
    assert_eq!(topics["/points"]["first"]["fields"][3]["name"], "x_m");
    assert_eq!(topics["/map"]["first"]["data"], serde_json::json!([-1, 0, 100, 50, 0, -1]));
    assert_eq!(topics["/map"]["first"]["info"]["origin"]["position"]["y"], -0.5);
    assert_eq!(topics["/transitions"]["last"]["to_state"], "turn");
    assert_eq!(topics["/rosout"]["first"]["msg"], "a wall <ahead>");
    assert_eq!(topics["/stats"]["first"]["ticks"], 51);
}
