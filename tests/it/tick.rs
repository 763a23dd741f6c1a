//! What a tick costs, counted: system calls and allocations.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;

use onbrick::behavior::Mission;
use onbrick::clock::{Clock, VirtualClock};
use onbrick::ev3dev::Tree;
use onbrick::mapping::{Method, Pose};
use onbrick::recording::{Info, MachineNames, Options, Pace, Recorder, Sink, Start};
use onbrick::robot::{DEFAULT_ROBOT, Robot, RobotConfig};
use onbrick::runtime::{Control, Heartbeat, Pilot, StopFlags, StopReason, Tally, prepare};
use onbrick::sim::{Simulation, World, WorldPhysics};

use crate::support::tested_program;
use crate::support::{allocations, brick::shipped_brick, pass_over};

/// Straight on, the head still: after the first tick only leases are written.
/// Over before the battery is read again, which is once a second, also where a tick is late.
const STRAIGHT_ON: &str = r#"
name = "straight on"
time_limit_s = 1
[machine.drive]
start = "forward"
final = "halt"
[machine.drive.state.forward]
do = { left_dps = 60, right_dps = 60 }
next = [{ when = "time_s > 0.78", go = "halt" }]
[machine.drive.state.halt]
"#;

/// Calls of one tick, by name.
type Calls = BTreeMap<String, u32>;

/// The calls of each tick: what the thread that beats did up to each heartbeat.
fn ticks_of(trace: &str) -> Vec<Calls> {
    let beat = |line: &str| line.contains("write(1, \"\\n\", 1");
    let mut beats = BTreeMap::<&str, u32>::new();
    for pid in
        trace.lines().filter(|line| beat(line)).filter_map(|line| line.split_whitespace().next())
    {
        *beats.entry(pid).or_default() += 1;
    }
    let Some((thread, _)) = beats.into_iter().max_by_key(|(_, count)| *count) else {
        return Vec::new();
    };
    let mut ticks = vec![Calls::new()];
    for line in trace.lines() {
        let Some((pid, call)) = line.split_once(' ') else { continue };
        // A call that another thread interrupts in the listing is counted where it begins.
        if pid != thread || call.contains("resumed>") || call.trim_start().starts_with(['-', '+']) {
            continue;
        }
        let name = call.trim_start().split('(').next().unwrap_or_default();
        *ticks.last_mut().unwrap().entry(name.to_owned()).or_default() += 1;
        if beat(line) {
            ticks.push(Calls::new());
        }
    }
    ticks.pop();
    ticks
}

#[test]
#[cfg_attr(target_arch = "arm", ignore = "strace sees the calls of QEMU's own threads among ours")]
fn a_tick_makes_one_system_call_an_attribute_and_writes_only_leases_that_are_due() {
    if Command::new("strace").arg("-V").output().is_err() {
        return pass_over("system calls of a tick (no strace)");
    }
    let _alone = crate::mount::bench::real_time();
    // On a machine that is busy with other things ticks are left out, under strace all the more.
    for attempt in 1..=5 {
        let folder = tempfile::tempdir().unwrap();
        let Some((trace, said)) = traced(folder.path(), STRAIGHT_ON) else {
            return pass_over("system calls of a tick (strace may not trace here)");
        };
        let ticks = ticks_of(&trace);
        if ticks.len() > 32 {
            return expect_calls(&ticks);
        }
        println!("attempt {attempt}: {} ticks; {said}", ticks.len());
    }
    panic!("this machine is too busy for a control loop under strace");
}

#[test]
#[cfg_attr(target_arch = "arm", ignore = "strace sees the calls of QEMU's own threads among ours")]
fn at_100_hz_every_second_tick_beats() {
    if Command::new("strace").arg("-V").output().is_err() {
        return pass_over("beats at 100 Hz (no strace)");
    }
    let _alone = crate::mount::bench::real_time();
    let folder = tempfile::tempdir().unwrap();
    let mission = format!("rate_hz = 100\n{STRAIGHT_ON}");
    let Some((trace, said)) = traced(folder.path(), &mission) else {
        return pass_over("beats at 100 Hz (strace may not trace here)");
    };
    let between_beats = ticks_of(&trace);
    let sleeps = |calls: &Calls| calls.get("clock_nanosleep").copied().unwrap_or(0);
    // A tick that is late beats by itself; the first opens the files.
    let (beats, ticks) = (between_beats.len(), between_beats.iter().map(sleeps).sum::<u32>());
    println!("{beats} beats in {ticks} ticks; {said}");
    assert!((12..=42).contains(&beats), "{beats} beats in 0.8 s");
}

/// A run on a brick of plain files: its system calls, and what it said.
fn traced(folder: &Path, text: &str) -> Option<(String, String)> {
    shipped_brick().write(folder);
    let mission = folder.join("straight.toml");
    std::fs::write(&mission, text).unwrap();
    let trace = folder.join("trace");
    let run = Command::new("strace")
        .args(["-f", "-s", "8", "-o"])
        .arg(&trace)
        .arg(tested_program())
        .arg("run")
        .arg(&mission)
        .arg("--brick")
        .arg(folder)
        .arg("--out")
        .arg(folder.join("run"))
        .output()
        .unwrap();
    let said =
        String::from_utf8_lossy(&run.stdout).into_owned() + &String::from_utf8_lossy(&run.stderr);
    let trace = std::fs::read_to_string(&trace).unwrap();
    (!trace.is_empty() && !said.contains("ptrace")).then_some((trace, said))
}

/// Each tick: six attributes read (the positions of two wheels and the head; range and gyro; one
/// aspect of one motor, in which another program's hand would show; the battery once a second), one
/// sleep, one heartbeat; and with the leases, every fifth tick or so, one write a wheel, before
/// which all eight of its aspects are looked at. The clock is read without a system call on a PC.
fn expect_calls(ticks: &[Calls]) {
    let count = |tick: &Calls, name: &str| tick.get(name).copied().unwrap_or(0);
    let mut renewed = 0;
    // The first tick opens the files; the second still has the first's end in it.
    for (number, tick) in ticks.iter().enumerate().skip(2) {
        let reads = count(tick, "pread64");
        let writes = count(tick, "pwrite64");
        assert!(writes == 0 || writes == 2, "tick {number} writes {tick:?}");
        assert_eq!(reads, 6 + 8 * writes, "tick {number} reads {tick:?}");
        assert_eq!(count(tick, "write"), 1, "tick {number} beats {tick:?}");
        assert_eq!(count(tick, "clock_nanosleep"), 1, "tick {number} sleeps {tick:?}");
        let all: u32 = tick.values().sum();
        assert_eq!(all, reads + writes + 2, "tick {number} does something else: {tick:?}");
        renewed += writes / 2;
    }
    let expected = u32::try_from(ticks.len() - 2).unwrap() / 5;
    println!("{} ticks of 8 calls, {renewed} renewals of 2 leases", ticks.len() - 2);
    assert!(renewed.abs_diff(expected) <= 2, "{renewed} renewals in {} ticks", ticks.len() - 2);
}

/// Nowhere.
#[derive(Debug)]
pub(crate) struct Nothing;

impl Sink for Nothing {
    fn write_all(&mut self, _bytes: &[u8]) -> std::io::Result<()> {
        Ok(())
    }

    fn sync(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// Notes at each heartbeat how much this thread has allocated so far.
#[derive(Debug)]
struct Counting {
    at_beat: Vec<u64>,
}

impl Heartbeat for Counting {
    fn beat(&mut self, _now_ns: i64) {
        self.at_beat.push(allocations::so_far());
    }
}

#[test]
fn a_tick_allocates_nothing_after_the_first() {
    assert_eq!(ticks_that_allocate("map"), Vec::<usize>::new());
    // What is first used later opens its files then: the wheels after a look round, the speaker at
    // home. Between them are plans in most ticks.
    let explore = ticks_that_allocate("explore");
    println!("explore: {explore:?}");
    assert!(!explore.iter().any(|tick| (500..2_000).contains(tick)), "{explore:?}");
}

fn ticks_that_allocate(mission: &str) -> Vec<usize> {
    let clock: Arc<dyn Clock> = Arc::new(VirtualClock::default());
    let physics = WorldPhysics::new(World::named("arena").unwrap(), 1, 3).unwrap();
    let simulation = Simulation::new(Arc::clone(&clock), Box::new(physics), 3);
    let tree: Arc<dyn Tree> = simulation.brick(0);
    let (config, _) = RobotConfig::load("robot.toml", DEFAULT_ROBOT.as_bytes()).unwrap();
    let shipped = onbrick::behavior::shipped::find(mission).unwrap().whole();
    let (mut mission, _) =
        Mission::parse("mission.toml", shipped.as_bytes(), &config.capabilities()).unwrap();
    mission.set("time_limit_s", 60.0).unwrap();
    let mut robot = Robot::bind(&tree, &config, mission.senses()).unwrap();
    let flags = StopFlags::default();
    prepare(&mut robot, &*clock, &flags, false, |_| {}).unwrap();
    let mut pilot = Pilot::new(&config, &mission, Method::Default, Pose::default()).unwrap();
    let (recorder, mut tick_side) =
        Recorder::start(Box::new(Nothing), start(&mission), Options::default(), Box::new(|_| {}))
            .unwrap();
    let mut heartbeat = Counting { at_beat: Vec::with_capacity(10_000) };
    let mut control = Control {
        robot: &mut robot,
        pilot: &mut pilot,
        recorder: &mut tick_side,
        clock: &*clock,
        flags: &flags,
        heartbeat: &mut heartbeat,
        guard: None,
        period_ns: 20_000_000,
        truth: None,
        tally: Tally::default(),
    };
    assert!(matches!(control.drive(), StopReason::Finished | StopReason::TimeLimit));
    drop(tick_side);
    drop(recorder);
    let of_tick: Vec<u64> = heartbeat.at_beat.windows(2).map(|pair| pair[1] - pair[0]).collect();
    println!(
        "{} ticks, {} points, allocations: {}",
        of_tick.len(),
        pilot.map().points().len(),
        of_tick.iter().sum::<u64>()
    );
    assert!(of_tick.len() > 2_000 && pilot.map().points().len() > 100, "a minute of mapping");
    let allocating = of_tick.iter().enumerate().filter(|(_, count)| **count > 0);
    allocating.map(|(tick, _)| tick).collect()
}

pub(crate) fn start(mission: &Mission) -> Start {
    let info = Info {
        brick: "mapper".to_owned(),
        mission: mission.name().to_owned(),
        period_ns: 20_000_000,
        pace: Pace::Virtual,
        ..Info::default()
    };
    Start {
        info,
        robot_toml: String::new(),
        mission_toml: String::new(),
        world_toml: None,
        range: None,
        infrared: false,
        machines: mission
            .machines()
            .iter()
            .map(|machine| MachineNames { name: machine.name.clone(), ..MachineNames::default() })
            .collect(),
        variables: Vec::new(),
    }
}

#[test]
fn a_trace_is_cut_into_ticks_at_heartbeats() {
    let trace = "7 clock_nanosleep(1) = 0\n7 pread64(3, \"0\\n\", 64, 0) = 2\n8 futex(1) = 0\n\
                 7 write(1, \"\\n\", 1) = 1\n\
                 7 clock_nanosleep(1 <unfinished ...>\n8 write(5, \"x\", 1) = 1\n\
                 7 <... clock_nanosleep resumed>) = 0\n7 write(1, \"\\n\", 1) = 1\n7 exit(0)\n";
    let ticks = ticks_of(trace);
    assert_eq!(ticks.len(), 2);
    assert_eq!(ticks[0].values().sum::<u32>(), 3);
    assert_eq!(ticks[1].values().sum::<u32>(), 2);
}
