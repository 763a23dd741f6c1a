//! A third-party decoder reads what is recorded, by the definitions in the file itself.

use std::process::Command;

use onbrick::senses::Channel;

use super::sample::{sample, tick};
use crate::support::pass_over;

/// What the Python decoder makes of a file; `None` where there is no Python with the packages.
pub(crate) fn python(bytes: &[u8], how: &str) -> Option<serde_json::Value> {
    read_by(
        &|| Command::new("python3"),
        &["-c", "import mcap, mcap_ros2"],
        "python3 with the packages mcap and mcap-ros2-support",
        "tests/python/decode.py",
        bytes,
        how,
    )
}

/// What a script prints of a file; `None` where `probe` says that what it needs is lacking.
pub(super) fn read_by(
    command: &dyn Fn() -> Command,
    probe: &[&str],
    what: &str,
    script: &str,
    bytes: &[u8],
    how: &str,
) -> Option<serde_json::Value> {
    if !command().args(probe).output().is_ok_and(|output| output.status.success()) {
        pass_over(what);
        return None;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    std::fs::write(&path, bytes).unwrap();
    let script = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(script);
    let output = command().arg(script).arg(&path).arg(how).output().unwrap();
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
        ("/variables", "onbrick_msgs/msg/Variables", 4),
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
    assert_eq!(
        odometry["header"]["stamp"],
        serde_json::json!({"sec": 1_700_000_000, "nanosec": 1_000})
    );
    // The estimator's own, and what a start 1 cm and 1° off makes of where it is by now.
    let rad2 = libm::pow(1_f64.to_radians(), 2.0);
    let covariance = |place: usize| odometry["pose"]["covariance"][place].as_f64().unwrap();
    assert!((covariance(5) - (3e-6 - 0.2 * rad2)).abs() < 1e-12, "{}", covariance(5));
    assert!((covariance(35) - (6e-3 + rad2)).abs() < 1e-12, "{}", covariance(35));
    let [forward, turn] = tick(0).estimate.speed_variances();
    assert_eq!(odometry["twist"]["covariance"][0], forward);
    assert_eq!(odometry["twist"]["covariance"][35], turn);
    assert!(forward > 1e-6 && turn > 1e-3);
    assert_eq!(odometry["twist"]["twist"]["linear"]["x"], 0.05);
    let transforms = &topics["/tf"]["first"]["transforms"];
    assert_eq!(transforms[1]["header"]["frame_id"], "base_link");
    assert_eq!(transforms[1]["child_frame_id"], "range_link");
    assert_eq!(transforms[1]["transform"]["translation"]["x"], 0.05);
    // The head turns the sensor, and does not move it.
    let turned = &topics["/tf"]["last"]["transforms"][1]["transform"];
    assert_eq!(turned["translation"], serde_json::json!({ "x": 0.05, "y": 0.0, "z": 0.0 }));
    assert!(turned["rotation"]["z"].as_f64().unwrap() > 0.2, "{turned}");
    assert_eq!(topics["/range"]["first"]["max_range"], 0.7_f32);
    assert_eq!(topics["/range"]["first"]["radiation_type"], 1);
    assert_eq!(topics["/points"]["first"]["fields"][3]["name"], "x_m");
    assert_eq!(topics["/map"]["first"]["data"], serde_json::json!([-1, 0, 100, 50, 0, -1]));
    assert_eq!(topics["/map"]["first"]["info"]["origin"]["position"]["y"], -0.5);
    assert_eq!(topics["/transitions"]["last"]["to_state"], "turn");
    let variables = &topics["/variables"]["last"];
    assert_eq!(variables["name"], serde_json::json!(["found", "best_m"]));
    assert_eq!(variables["value"], serde_json::json!([4.0, 0.1 + 0.2]));
    assert_eq!(topics["/rosout"]["first"]["msg"], "a wall <ahead>");
    assert_eq!(topics["/stats"]["first"]["ticks"], 51);
}
