//! Promise 3: each fault of the simulated brick on each device of the robot, on the mapping mission: noticed or not, how soon, how far it
//! was driven blind, and where the robot believes to be at the end.

use crate::support::promised::promised;
use crate::support::stage::{Play, Played, fault};
use onbrick::runtime::StopReason;

const FAULTS: [&str; 8] = ["off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent", "jump"];
const DEVICES: [(&str, &str); 5] =
    [("outB", "left"), ("outD", "right"), ("outA", "head"), ("in1", "range"), ("in4", "gyro")];

/// What may be driven after a fault that nothing shows, metres.
const BLIND_M: f64 = 0.5;

/// Cells that are driven blind, and why nothing in the readings shows them: `device fault: reason`, one a line.
fn undetectable() -> String {
    std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/undetectable-faults.txt"))
        .unwrap()
}

/// A minute of the mapping mission.
fn mapping() -> Play {
    Play::of("map", "arena", 3).seconds(60.0)
}

/// How far it drove between the fault and the end, metres.
fn blind_m(ended: &Played) -> f64 {
    let at_fault = ended.truths[500.min(ended.truths.len() - 1)].travelled_m;
    ended.truth.travelled_m - at_fault
}

#[test]
fn promise_3_each_fault_on_each_device_is_noticed_in_time_or_known_to_be_undetectable() {
    let clean = mapping().play().unwrap();
    promised(&format!(
        "clean run: {:.2} m, off by {:.3} m at the end",
        clean.truth.travelled_m,
        clean.pose_error_m()
    ));
    promised(
        "device  fault         noticed                                        after s  blind m  off by m",
    );
    let cells = DEVICES.iter().flat_map(|device| FAULTS.iter().map(move |fault| (device, fault)));
    let played: Vec<_> = std::thread::scope(|scope| {
        let threads: Vec<_> = cells
            .map(|((port, device), kind)| {
                scope.spawn(move || {
                    let scenario = fault(port, kind);
                    (device, kind, mapping().scenario(&scenario).play().unwrap())
                })
            })
            .collect();
        threads.into_iter().map(|thread| thread.join().expect("no cell panics")).collect()
    });
    let undetectable = undetectable();
    let mut blind = Vec::new();
    for (device, kind, ended) in &played {
        let noticed = (ended.reason != StopReason::Finished).then(|| ended.reason.to_string());
        let blind_m = blind_m(ended);
        promised(&format!(
            "{device:7} {kind:13} {:46} {:7.2} {blind_m:8.2} {:9.3}",
            noticed.as_deref().unwrap_or("no"),
            ended.drove_s - 10.0,
            ended.pose_error_m()
        ));
        ended.assert_at_rest(&format!("{device} {kind}"));
        let cell = format!("{device} {kind}:");
        let known = undetectable.lines().any(|line| line.starts_with(&cell) && line.len() > cell.len() + 10);
        if blind_m > BLIND_M && !known {
            blind.push(format!("{cell} {blind_m:.2} m"));
        }
    }
    assert!(blind.is_empty(), "driven blind, and not known to be: {blind:#?}");
}
