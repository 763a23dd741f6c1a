//! Whole missions on a robot that something goes wrong with.

use std::sync::Arc;

use onbrick::behavior::Mission;
use onbrick::clock::{Clock, SECOND_NS, VirtualClock};
use onbrick::ev3dev::Tree;
use onbrick::mapping::{Method, Pose};
use onbrick::robot::{Channel, DEFAULT_ROBOT, Robot, RobotConfig};
use onbrick::runtime::recording::{MachineNames, Options, Recorder};
use onbrick::runtime::{Control, NoHeartbeat, Pilot, StopFlags, StopReason, Tally, prepare};
use onbrick::sim::{Scenario, Simulation, Truth, World, WorldPhysics};

use crate::tick::{Nothing, start};

/// How a run with a scenario ended.
struct Ended {
    reason: StopReason,
    /// When, seconds after the scenario began with the run.
    time_s: f64,
    /// A second later.
    truth: Truth,
    states: Vec<String>,
    done: Vec<String>,
}

/// Runs the map mission for at most 60 s under a scenario that begins with it.
fn run(scenario: &str) -> Ended {
    let (scenario, _) = Scenario::parse("scenario.toml", scenario.as_bytes()).unwrap();
    let clock: Arc<dyn Clock> = Arc::new(VirtualClock::default());
    let physics = WorldPhysics::new(World::named("arena").unwrap(), 1, 3).unwrap();
    let simulation = Simulation::new(Arc::clone(&clock), Box::new(physics), 3);
    let tree: Arc<dyn Tree> = simulation.brick(0);
    let (config, _) = RobotConfig::load("robot.toml", DEFAULT_ROBOT.as_bytes()).unwrap();
    let shipped = onbrick::behavior::shipped::find("map").unwrap().text;
    let (mut mission, _) = Mission::parse("map.toml", shipped.as_bytes(), &config.capabilities()).unwrap();
    mission.set("time_limit_s", 60.0).unwrap();
    let mut robot = Robot::bind(&tree, &config, mission.roles()).unwrap();
    let flags = StopFlags::default();
    prepare(&mut robot, &*clock, &flags, |_| {}).unwrap();
    let mut pilot = Pilot::new(&config, &mission, Method::Default, Pose::default()).unwrap();
    let began = onbrick::runtime::recording::Start {
        machines: mission
            .machines()
            .iter()
            .map(|machine| MachineNames { name: machine.name().to_owned(), ..MachineNames::default() })
            .collect(),
        ..start(&mission)
    };
    let (_recorder, mut tick_side) =
        Recorder::start(Box::new(Nothing), began, Options::default(), Box::new(|_| {})).unwrap();
    simulation.play(&scenario);
    let mut control = Control {
        robot: &mut robot,
        pilot: &mut pilot,
        recorder: &mut tick_side,
        clock: &*clock,
        flags: &flags,
        heartbeat: &mut NoHeartbeat,
        period_ns: 20_000_000,
        tally: Tally::default(),
    };
    let began_ns = clock.now_ns();
    let reason = control.drive();
    let time_s = onbrick::clock::seconds(clock.now_ns() - began_ns);
    clock.sleep_until_ns(clock.now_ns() + SECOND_NS);
    let states = ["outA", "outB", "outD"].map(|port| state_of(&*tree, port));
    Ended {
        reason,
        time_s,
        truth: simulation.inspect(|world: &mut WorldPhysics| world.truth(0)).unwrap().unwrap(),
        states: states.to_vec(),
        done: simulation.faults_done().into_iter().map(|record| record.what).collect(),
    }
}

/// What a motor's driver says that it does; nothing for one that is not there.
fn state_of(tree: &dyn Tree, port: &str) -> String {
    let read = |path: &str| {
        let mut buffer = [0; 256];
        let length =
            tree.open(path, onbrick::ev3dev::Access::Read).and_then(|file| file.read(&mut buffer)).ok()?;
        Some(String::from_utf8_lossy(&buffer[..length]).trim().to_owned())
    };
    let names = tree.list("sys/class/tacho-motor").unwrap();
    let address = Some(format!("ev3-ports:{port}"));
    let found = names.iter().find(|name| read(&format!("sys/class/tacho-motor/{name}/address")) == address);
    found.and_then(|name| read(&format!("sys/class/tacho-motor/{name}/state"))).unwrap_or_default()
}

fn fault(port: &str, kind: &str) -> String {
    format!("[[fault]]\nat_s = 10\nport = \"{port}\"\nkind = \"{kind}\"\n")
}

fn assert_at_rest(ended: &Ended, what: &str) {
    assert!(ended.states.iter().all(String::is_empty), "{what}: motors are {:?}", ended.states);
    assert!(ended.truth.speed_mps.abs() < 1e-3, "{what}: {} m/s", ended.truth.speed_mps);
}

#[test]
fn a_run_without_faults_comes_to_its_end() {
    let ended = run("");
    assert_eq!(ended.reason, StopReason::Finished);
    assert!(ended.truth.travelled_m > 1.0, "{} m", ended.truth.travelled_m);
    assert_at_rest(&ended, "clean");
}

#[test]
fn a_run_that_loses_a_device_stops_its_motors_and_says_which() {
    for (port, kind, channel) in [
        ("in4", "unplug", Channel::Gyro),
        ("in4", "eio", Channel::Gyro),
        ("in4", "resync", Channel::Gyro),
        ("in1", "unplug", Channel::Range),
        ("in1", "enxio", Channel::Range),
        ("in1", "garbage text", Channel::Range),
        ("outB", "unplug", Channel::Left),
        ("outD", "unplug", Channel::Right),
        ("outA", "unplug", Channel::Head),
    ] {
        let ended = run(&fault(port, kind));
        println!("{port} {kind}: {} after {:.2} s", ended.reason, ended.time_s - 10.0);
        assert_eq!(ended.reason, StopReason::Lost(channel), "{port} {kind}");
        assert!((10.0..11.0).contains(&ended.time_s), "{port} {kind}: after {} s", ended.time_s);
        assert_at_rest(&ended, kind);
        assert_eq!(ended.done, [format!("{port} {kind}")]);
    }
}

#[test]
fn a_blocked_wheel_ends_the_run() {
    let ended = run(&fault("outB", "block"));
    assert_eq!(ended.reason, StopReason::Stalled);
    assert!(ended.time_s < 12.1, "after {} s", ended.time_s - 10.0);
    assert_at_rest(&ended, "block");
}

#[test]
fn a_loose_plug_of_a_moment_does_not_end_a_run() {
    let text = "[[fault]]\nat_s = 10\nuntil_s = 10.2\nport = \"in4\"\nkind = \"enxio\"\n";
    let ended = run(text);
    assert_eq!(ended.reason, StopReason::Finished, "{:?}", ended.done);
    assert_at_rest(&ended, "a moment");
}
