//! Faults of a robot that stands in a room: its wheels, its battery, its kernel's timer.

use std::sync::Arc;

use onbrick::ev3dev::Tree;
use onbrick::sim::{Port, Simulation, World, WorldPhysics};

use super::{clear, inject, raw};
use crate::drivers_bench::{InProcess, Rig};

/// A robot in the open, its clock moved by hand.
fn room() -> InProcess {
    let world = World::named("open").unwrap().without_errors();
    InProcess::new(WorldPhysics::new(world, 1, 1).unwrap(), onbrick::sim::Options::default())
}

fn battery_v(simulation: &Simulation) -> f64 {
    let tree: Arc<dyn Tree> = simulation.brick(0);
    onbrick::ev3dev::Battery::open(&tree, &onbrick::ev3dev::EV3).unwrap().voltage_v().unwrap()
}

#[test]
fn a_blocked_wheel_stands_and_a_battery_sags_to_its_end() {
    let room = room();
    let rig = Rig::over(room);
    rig.drive("speed_sp=300 run-forever");
    rig.pass_ms(500);
    inject(&rig, Port::OutB, "block");
    rig.pass_ms(400);
    assert_eq!(rig.read("outB", "state"), "running overloaded stalled");
    let position = raw(&rig, Port::OutB).unwrap();
    rig.pass_ms(400);
    assert_eq!(raw(&rig, Port::OutB), Ok(position));
    clear(&rig, Port::OutB);
    assert!(raw(&rig, Port::OutB).unwrap() > position, "free again");
    rig.write("outB", "command", "stop");
    rig.pass_ms(1000);
    let simulation = &rig.bench.simulation;
    let own_v = battery_v(simulation);
    simulation.control(0, "battery 8 5 60").unwrap();
    let mut last_v = 8.1;
    for second in 1..=60_i32 {
        rig.pass_ms(1000);
        let volts = battery_v(simulation);
        let rest_v = 8.0 - 0.05 * f64::from(second);
        assert!(
            volts < last_v && (volts - rest_v).abs() < 0.1,
            "{volts} V at {second} s, at rest {rest_v} V"
        );
        last_v = volts;
    }
    rig.pass_ms(5000);
    assert!((battery_v(simulation) - last_v).abs() < 0.02, "it stays");
    simulation.control(0, "clear").unwrap();
    rig.pass_ms(20);
    assert!((battery_v(simulation) - own_v).abs() < 0.02, "{} V", battery_v(simulation));
}

#[test]
fn a_timer_that_does_not_fire_leaves_a_lease_without_an_end() {
    let rig = Rig::over(room());
    inject(&rig, Port::OutB, "endless");
    rig.drive("speed_sp=300 time_sp=200 run-timed");
    rig.pass_ms(1000);
    assert_eq!(rig.read("outB", "state"), "running");
    clear(&rig, Port::OutB);
    rig.pass_ms(2);
    assert_eq!(rig.read("outB", "state"), "");
}
