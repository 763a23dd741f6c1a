//! A recording that is made for a test, of a drive in which each value moves.

use std::io;
use std::sync::{Arc, Mutex};

use onbrick::behavior::{MachineState, Since, Taken};
use onbrick::ev3dev::{EV3, Technology};
use onbrick::mapping::{Estimate, MapPoint, Pose, Range, RangeMount, Sounding};
use onbrick::recording::{
    End, Grid, Info, Level, MachineNames, Options, Pace, Recorder, Sink, Start, StateNames,
    TickRecord, TickSide,
};
use onbrick::runtime::{PilotState, StopReason};
use onbrick::senses::{Channel, Senses};

pub(crate) const PERIOD_NS: i64 = 20_000_000;

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
    let info = Info {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        run: Some("7f3a".to_owned()),
        brick: "mapper".to_owned(),
        mission: "map <the room> & back".to_owned(),
        start_pose: Pose { x_m: 0.1, y_m: -0.2, heading_rad: 0.3 },
        start_ns: 1_000,
        wall_offset_ns: 1_700_000_000_000_000_000,
        period_ns: PERIOD_NS,
        pace,
        seed: 7,
        cells: Technology::LiIon,
        board: &EV3,
        method: onbrick::mapping::Method::Default,
        settings: vec![("near_m".to_owned(), 0.1 + 0.2)],
    };
    Start {
        info,
        robot_toml: "name = \"mapper\"\n".to_owned(),
        mission_toml: "name = \"map\"\n# ü\n".to_owned(),
        world_toml: Some("name = \"arena\"\n".to_owned()),
        range: Some(RangeMount {
            ahead_m: 0.05,
            max_m: 2.0,
            half_cone_rad: 0.175,
            ..RangeMount::default()
        }),
        infrared: true,
        machines: vec![MachineNames {
            name: "drive".to_owned(),
            start: 0,
            always: Vec::new(),
            states: vec![
                state("forward", &["range_m < 0.25"]),
                state("turn", &["state_turn_deg > 90"]),
            ],
        }],
        variables: vec!["found".to_owned(), "best_m".to_owned()],
    }
}

/// A drive on a circle in a square arena, looking around: each value moves, some are odd on
/// purpose.
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
    let placed = match range {
        Range::Echo(range_m) if number.is_multiple_of(5) => Some(MapPoint {
            time_ns,
            x_m: pose.x_m + range_m * libm::cos(direction_rad),
            y_m: pose.y_m + range_m * libm::sin(direction_rad),
        }),
        _ => None,
    }
    .into_iter()
    .collect();
    let estimate = Estimate {
        time_ns,
        pose,
        forward_m_s: 0.05,
        turn_rad_s: 0.1,
        covariance: [1e-4, 2e-5, 3e-6, 4e-4, 5e-6, 6e-3],
        travelled_m: 0.05 * seconds,
        range: Some(range),
        sounding: Some(Sounding { fresh: number.is_multiple_of(5), ..Sounding::default() }),
        ..Estimate::default()
    };
    let on_time_ns = i64::try_from(number % 50).unwrap() * 1000;
    let lateness_ns = if number % 50 == 3 { PERIOD_NS + 1 } else { on_time_ns };
    TickRecord { senses, estimate, placed, lateness_ns }
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

pub(crate) fn taken(number: u64) -> Taken {
    let to_turn = number.is_multiple_of(50);
    Taken {
        machine: 0,
        from: u16::from(!to_turn),
        to: u16::from(to_turn),
        transition: if number == 25 { None } else { Some(0) },
    }
}

/// The mission's variables after a tick.
#[expect(clippy::cast_precision_loss, reason = "small numbers")]
pub(crate) fn variables(number: u64) -> [f64; 2] {
    [(number / 25) as f64, 0.1 + 0.2]
}

pub(crate) fn put(side: &mut TickSide<PilotState>, number: u64) {
    let record = tick(number);
    let time_ns = record.senses.time_ns;
    if number.is_multiple_of(25) && number > 0 {
        side.transition(number, time_ns, taken(number));
        side.log(time_ns, Level::Warn, "a wall <ahead>");
        side.variables(number, time_ns, &variables(number));
    }
    side.tick(&record);
    if number.is_multiple_of(50) {
        let mut state = PilotState::default();
        state.estimator.odometry = record.estimate.pose;
        let since =
            Since { done: true, entered_ns: time_ns, entered_m: 0.5, entered_heading_rad: 0.25 };
        let since = [since].into_iter().collect();
        state.program.machines.push(MachineState { state: 1, since });
        state.program.variables.extend(variables(number));
        side.checkpoint(number, time_ns, state);
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
        stop: StopReason::Finished.into(),
        time_ns: tick(ticks).senses.time_ns,
        truth: Some(Pose { x_m: 0.5, y_m: 0.25, heading_rad: -0.125 }),
        points: Vec::new(),
        map: Some(grid()),
    }
}

pub(crate) fn options(sync_period_ns: i64, ring_entries: usize) -> Options {
    Options { sync_period_ns, ring_entries }
}

/// A finished recording of this many ticks.
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

/// Where the chunks of a file are, and how many messages each has.
pub(crate) fn chunks(bytes: &[u8]) -> Vec<(std::ops::Range<usize>, u64)> {
    const MESSAGE: u8 = 0x05;
    const CHUNK: u8 = 0x06;
    const HEAD: usize = 9 + 8 + 8 + 8 + 4 + 4 + 8;
    records(&bytes[8..])
        .into_iter()
        .filter(|(_, opcode)| *opcode == CHUNK)
        .map(|(place, _)| place.start + 8..place.end + 8)
        .map(|place| {
            let inside = records(&bytes[place.start + HEAD..place.end]);
            (place, inside.iter().filter(|(_, opcode)| *opcode == MESSAGE).count() as u64)
        })
        .collect()
}

/// Where records lie, and what they are, up to the data's end.
fn records(bytes: &[u8]) -> Vec<(std::ops::Range<usize>, u8)> {
    const DATA_END: u8 = 0x0f;
    let mut at = 0;
    let mut records = Vec::new();
    while let Some(head) = bytes.get(at..at + 9).filter(|head| head[0] != DATA_END) {
        let length = u64::from_le_bytes(head[1..].try_into().unwrap());
        let end = at + 9 + usize::try_from(length).unwrap();
        records.push((at..end, head[0]));
        at = end;
    }
    records
}
