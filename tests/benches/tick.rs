//! What a tick costs: thinking alone, and with real files below it.

#![allow(
    missing_docs,
    clippy::unwrap_used,
    reason = "a bench stops by panicking, and its group has no documentation"
)]

#[path = "../it/support/brick.rs"]
#[allow(dead_code, unreachable_pub, clippy::expect_used, reason = "the tests use the rest of it")]
mod brick;

use std::sync::Arc;

use criterion::{Criterion, criterion_group, criterion_main};
use onbrick::behavior::{Demands, Mission};
use onbrick::clock::{Clock, VirtualClock};
use onbrick::ev3dev::Tree;
use onbrick::mapping::{Method, Pose};
use onbrick::robot::{DEFAULT_ROBOT, Robot, RobotConfig};
use onbrick::runtime::Pilot;
use onbrick::senses::Senses;
use onbrick::sim::{Simulation, World, WorldPhysics};

const PERIOD_NS: i64 = 20_000_000;

fn setting() -> (RobotConfig, Mission) {
    let (config, _) = RobotConfig::load("robot.toml", DEFAULT_ROBOT.as_bytes()).unwrap();
    let text = onbrick::behavior::shipped::find("map").unwrap().text;
    let (mission, _) = Mission::parse("map.toml", text.as_bytes(), &config.capabilities()).unwrap();
    (config, mission)
}

/// A minute of what the mapping robot senses.
fn a_minute() -> Vec<Senses> {
    let (config, mission) = setting();
    let clock: Arc<dyn Clock> = Arc::new(VirtualClock::default());
    let physics = WorldPhysics::new(World::named("arena").unwrap(), 1, 1).unwrap();
    let simulation = Simulation::new(Arc::clone(&clock), Box::new(physics), 1);
    let tree: Arc<dyn Tree> = simulation.brick(0);
    let mut robot = Robot::bind(&tree, &config, mission.senses()).unwrap();
    let mut pilot = Pilot::new(&config, &mission, Method::Default, Pose::default()).unwrap();
    let (mut senses, mut demands) = (Senses::default(), Demands::default());
    clock.sleep_until_ns(3_000_000_000);
    (0..3000)
        .map(|tick| {
            clock.sleep_until_ns(3_000_000_000 + tick * PERIOD_NS);
            (senses.tick, senses.time_ns) = (tick.unsigned_abs(), tick * PERIOD_NS);
            robot.sense(&mut senses);
            pilot.step(&senses, &mut demands, |_| {});
            robot.act(&demands, senses.time_ns);
            senses
        })
        .collect()
}

fn thinking(criterion: &mut Criterion) {
    let (config, mission) = setting();
    let minute = a_minute();
    criterion.bench_function("3000 ticks without files: estimate, map, decide", |bencher| {
        bencher.iter(|| {
            let mut pilot =
                Pilot::new(&config, &mission, Method::Default, Pose::default()).unwrap();
            let mut demands = Demands::default();
            for senses in &minute {
                pilot.step(senses, &mut demands, |_| {});
            }
            demands
        });
    });
}

fn with_files(criterion: &mut Criterion) {
    let (config, mission) = setting();
    let folder = tempfile::tempdir().unwrap();
    let tree = brick::shipped_brick().write(folder.path());
    let mut robot = Robot::bind(&tree, &config, mission.senses()).unwrap();
    let mut pilot = Pilot::new(&config, &mission, Method::Default, Pose::default()).unwrap();
    let (mut senses, mut demands) = (Senses::default(), Demands::default());
    criterion.bench_function(
        "one tick over plain files: sense, estimate, map, decide, act",
        |bencher| {
            bencher.iter(|| {
                senses.tick += 1;
                senses.time_ns += PERIOD_NS;
                robot.sense(&mut senses);
                pilot.step(&senses, &mut demands, |_| {});
                robot.act(&demands, senses.time_ns);
            });
        },
    );
}

criterion_group!(benches, thinking, with_files);
criterion_main!(benches);
