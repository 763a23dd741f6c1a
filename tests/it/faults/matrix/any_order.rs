//! Any faults in any order.

use onbrick::sim::{Act, DeviceFault, Order, Port};
use proptest::prelude::*;

use super::{MOTORS, SENSORS, raw, rig};
use crate::drivers_bench::Rig;

/// All that a program can read of the bench's devices, errors included.
fn everything(rig: &Rig) -> Vec<String> {
    let mut found = Vec::new();
    for class in ["tacho-motor", "lego-sensor", "lego-port"] {
        let class = format!("sys/class/{class}");
        for name in rig.tree.list(&class).unwrap() {
            for attribute in rig.tree.list(&format!("{class}/{name}")).unwrap() {
                let path = format!("{class}/{name}/{attribute}");
                found.push(format!("{path} {:?}", rig.read_path(&path)));
            }
        }
    }
    found
}

fn any_order() -> impl Strategy<Value = (usize, DeviceFault, Option<i64>)> {
    let fault = prop::sample::select(DeviceFault::examples());
    (0..8_usize, fault, prop::option::of(0..3_000_000_000_i64))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, ..ProptestConfig::default() })]
    #[test]
    fn any_faults_in_any_order_never_panic_repeat_exactly_and_clear_away(
        orders in prop::collection::vec((any_order(), 1..400_i64), 1..25)
    ) {
        let play = || {
            let rig = rig();
            rig.drive("speed_sp=300 run-forever");
            let mut seen = Vec::new();
            for ((port, fault, for_ns), wait_ms) in &orders {
                let port = Port::ALL[*port];
                // What does not fit is refused, and that is an answer too.
                let act = Act::Inject(port, fault.clone(), *for_ns);
                let answer = rig.bench.simulation.follow(&Order { robot: 0, act });
                seen.push(format!("{answer:?}"));
                rig.pass_ms(*wait_ms);
                seen.extend(everything(&rig));
            }
            rig.bench.simulation.control(0, "clear").unwrap();
            rig.pass_ms(2500);
            (rig, seen)
        };
        let (rig, seen) = play();
        prop_assert!(rig.bench.simulation.faults_active(0).is_empty());
        // Everything is as on a bench that never had a fault, but for numbers and positions.
        for (port, reading, ..) in SENSORS {
            prop_assert_eq!(raw(&rig, port), Ok(reading.into()), "{}", port);
        }
        for port in MOTORS {
            let name = port.as_str();
            rig.write(name, "command", "reset");
            rig.write(name, "speed_sp", "200");
            rig.write(name, "command", "run-forever");
            rig.pass_ms(1500);
            prop_assert!(
                (rig.number(name, "speed") - 200).abs() < 30,
                "{} does {}",
                port,
                rig.read(name, "speed")
            );
        }
        prop_assert_eq!(play().1, seen);
    }
}
