//! What each stage of the tick costs, by the tick thread's own processor clock: `stages BRICK
//! SECONDS MISSION`, at 100 Hz.
//!
//! It drives the robot of the shipped `robot.toml` through the shipped mission `map`, or through
//! the same among a hundred states and fifty variables (`large`), stage by stage as the runtime's
//! control loop does, but with a look at the clock between the stages, whose own cost it measures
//! first and takes off. It records to nowhere: what the recorder's thread does is not of the tick.
//! The scenario `tick` runs it on the emulated brick.

use std::error::Error;
use std::sync::Arc;
use std::time::Duration;

use nix::time::{ClockId, clock_gettime};
use onbrick::behavior::{Demands, Mission};
use onbrick::clock::{Clock, MonotonicClock};
use onbrick::ev3dev::{LocalTree, StopAction, Tree};
use onbrick::mapping::{Method, Pose};
use onbrick::recording::{Info, Options, Pace, Recorder, Sink, Start, TickRecord};
use onbrick::robot::{DEFAULT_ROBOT, Robot, RobotConfig};
use onbrick::runtime::{Pilot, StopFlags, prepare};
use onbrick::senses::Senses;

const PERIOD_NS: i64 = 10_000_000;
const STAGES: [&str; 4] = ["sense", "estimate, map, decide", "act", "record"];

#[derive(Debug)]
struct Nowhere;

impl Sink for Nowhere {
    fn write_all(&mut self, _bytes: &[u8]) -> std::io::Result<()> {
        Ok(())
    }

    fn sync(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

pub(crate) fn stages(brick: &str, seconds: &str, which: &str) -> Result<(), Box<dyn Error>> {
    let ticks = seconds.parse::<u64>()? * 100;
    let (config, _) = RobotConfig::load("robot.toml", DEFAULT_ROBOT.as_bytes())?;
    let text = onbrick::behavior::shipped::find("map").ok_or("no mission map")?.text;
    let text = if which == "large" { large(text) } else { text.to_owned() };
    let (mission, _) = Mission::parse("map.toml", text.as_bytes(), &config.capabilities())?;
    let tree: Arc<dyn Tree> = Arc::new(LocalTree::new(brick));
    let mut robot = Robot::bind(&tree, &config, mission.senses())?;
    prepare(&mut robot, &MonotonicClock, &StopFlags::default(), false, |_| {})?;
    let mut pilot = Pilot::new(&config, &mission, Method::Default, Pose::default())?;
    let spent_ns = tick_by_tick(&mut robot, &mut pilot, &mission, ticks)?;
    robot.stop(StopAction::Brake);
    let a_look_ns = cost_of_a_look()?;
    for (stage, spent_ns) in STAGES.iter().zip(spent_ns) {
        println!("{}: {stage}", spent_ns / ticks as i64 - a_look_ns);
    }
    Ok(())
}

/// A mission of two machines with four more, which have 24 states each: in every tick each looks at
/// four conditions, and after a tenth of a second at the latest it enters the next state and sets
/// three of the fifty variables.
fn large(map: &str) -> String {
    let mut text = map.replacen("[numbers]", "[variables]\nVARIABLES\n[numbers]", 1);
    let variables: String = (0..50).map(|at| format!("v{at} = {at}\n")).collect();
    text = text.replacen("VARIABLES", &variables, 1);
    for machine in 0..4 {
        text.push_str(&format!("\n[machine.m{machine}]\nstart = \"s0\"\n"));
        for state in 0..24 {
            let (next, v) = ((state + 1) % 24, (machine * 12 + state / 2) % 48);
            text.push_str(&format!(
                "[machine.m{machine}.state.s{state}]\nnext = [\n\
                 {{ when = \"range_m < 0.01 * v{v} and heading_deg > 170\", go = \"s{next}\" }},\n\
                 {{ when = \"distance_m(v{v}, 2) < 0.1\", go = \"s{next}\" }},\n\
                 {{ when = \"abs(wrap_deg(heading_deg - 90)) < 0.01\", go = \"s{next}\" }},\n\
                 {{ when = \"state_s > 0.1\", go = \"s{next}\", set = {{ v{v} = \"v{v} + 1\", \
                 v{} = \"min(v{v}, 9)\", v{} = \"x_m\" }} }},\n]\n",
                v + 1,
                v + 2
            ));
        }
    }
    text
}

/// Nanoseconds that all the ticks spent in each stage.
fn tick_by_tick(
    robot: &mut Robot,
    pilot: &mut Pilot,
    mission: &Mission,
    ticks: u64,
) -> Result<[i64; 4], Box<dyn Error>> {
    let (_recorder, mut record) = Recorder::start::<()>(
        Box::new(Nowhere),
        start(mission),
        Options::default(),
        Box::new(|_| {}),
    )?;
    let (mut senses, mut demands, mut spent_ns) = (Senses::default(), Demands::default(), [0; 4]);
    let start_ns = MonotonicClock.now_ns();
    for tick in 0..ticks {
        MonotonicClock.sleep_until_ns(start_ns + tick as i64 * PERIOD_NS);
        senses.tick = tick;
        senses.time_ns = MonotonicClock.now_ns() - start_ns;
        let mut looks_ns = [used_ns()?; 5];
        robot.sense(&mut senses);
        looks_ns[1] = used_ns()?;
        let step = pilot.step(&senses, &mut demands, |_| {});
        looks_ns[2] = used_ns()?;
        robot.act(&demands, senses.time_ns);
        looks_ns[3] = used_ns()?;
        let (estimate, placed) = (step.estimate, step.placed);
        record.tick(&TickRecord { senses, estimate, placed, lateness_ns: 0 });
        looks_ns[4] = used_ns()?;
        for (spent_ns, looks_ns) in spent_ns.iter_mut().zip(looks_ns.windows(2)) {
            *spent_ns += looks_ns[1] - looks_ns[0];
        }
    }
    Ok(spent_ns)
}

fn cost_of_a_look() -> Result<i64, Box<dyn Error>> {
    const LOOKS: i64 = 1000;
    let started_ns = used_ns()?;
    for _ in 0..LOOKS {
        used_ns()?;
    }
    Ok((used_ns()? - started_ns) / LOOKS)
}

/// What this thread has used of the processor, nanoseconds.
fn used_ns() -> Result<i64, Box<dyn Error>> {
    let used = clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID)?;
    Ok(Duration::from(used).as_nanos().try_into()?)
}

fn start(mission: &Mission) -> Start {
    let info = Info {
        brick: "mapper".to_owned(),
        mission: mission.name().to_owned(),
        period_ns: PERIOD_NS,
        pace: Pace::Real,
        ..Info::default()
    };
    Start {
        info,
        robot_toml: String::new(),
        mission_toml: String::new(),
        world_toml: None,
        range: None,
        infrared: false,
        machines: Vec::new(),
        variables: Vec::new(),
    }
}
