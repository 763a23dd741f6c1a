//! `brenner-lego`: wheel ticks of a run of 9.4 m through the odometry, against the camera above.

use std::f64::consts::TAU;
use std::fs;
use std::path::Path;

use onbrick::mapping::{Estimator, EstimatorConfig, Events, Geometry, Inputs, Method, Pose, stats};
use onbrick::units::radians;

use crate::support;

/// The lectures' constant.
const METRES_PER_TICK: f64 = 0.349e-3;
/// Where the run starts.
const START: (f64, f64, f64) = (1.850, 1.897, 213.0);
/// What a plain script found for a track width: (track width, RMSE) in mm.
const EXPECTED_MM: [(f64, f64); 3] = [(150.0, 731.0), (155.0, 593.0), (173.0, 69.0)];

/// What the way of pairing records changes: camera and wheels were not recorded at the same
/// instants. Here the path is interpolated to the camera's time; taking the wheels' last record
/// before it gives 715, 573 and 70 mm, and stepping along the heading after each turn 730, 591 and
/// 66 mm.
const MATCHING_MM: f64 = 12.0;

#[test]
fn odometry_without_a_gyro_is_as_far_from_the_camera_as_a_plain_script_says() {
    let Some(folder) = support::shared().map(|shared| shared.join("data/brenner-lego")) else {
        return support::pass_over("the run of brenner-lego");
    };
    let motors = records(&folder.join("robot4_motors.txt"), [1, 2, 6]);
    let camera = records(&folder.join("robot4_reference.txt"), [1, 2, 3]);
    println!("brenner-lego, odometry against the camera (mm):");
    for (track_mm, expected_mm) in EXPECTED_MM {
        let path = drive(&motors, track_mm / 1000.0);
        let errors: Vec<f64> = camera
            .iter()
            .map(|&[time_ms, x_mm, y_mm]| {
                let (x_m, y_m) = at(&path, time_ms);
                libm::hypot(x_m * 1000.0 - x_mm, y_m * 1000.0 - y_mm)
            })
            .collect();
        let rmse = stats::rms(&errors).expect("there are records");
        let (last, most) =
            (errors.last().expect("a last one"), errors.iter().fold(0.0, |a: f64, b| a.max(*b)));
        println!(
            "  track {track_mm}: RMSE {rmse:.0} (script {expected_mm}), most {most:.0}, last \
             {last:.0}"
        );
        let allowed_mm = f64::max(0.05 * expected_mm, MATCHING_MM);
        assert!((rmse - expected_mm).abs() < allowed_mm, "{rmse} mm, expected {expected_mm} mm");
    }
}

/// Times in ms and places in m after each record.
fn drive(motors: &[[f64; 3]], track_m: f64) -> Vec<(f64, f64, f64)> {
    // A tick is taken as a degree.
    let geometry = Geometry::new(360.0 * METRES_PER_TICK, track_m).expect("a robot");
    let (x_m, y_m, degrees) = START;
    let start = Pose { x_m, y_m, heading_rad: radians(degrees) };
    let mut estimator =
        Estimator::new(EstimatorConfig { geometry, method: Method::Default }, start);
    motors
        .iter()
        .map(|&[time_ms, left, right]| {
            let estimate = estimator.update(&Inputs {
                #[expect(clippy::cast_possible_truncation, reason = "whole milliseconds")]
                time_ns: time_ms as i64 * 1_000_000,
                left_rad: Some(left * TAU / 360.0),
                right_rad: Some(right * TAU / 360.0),
                ..Inputs::default()
            });
            assert!(estimate.events.without(Events::STILL).is_empty(), "{}", estimate.events);
            (time_ms, estimate.pose.x_m, estimate.pose.y_m)
        })
        .collect()
}

/// The place at a time, on the straight line between two records.
fn at(path: &[(f64, f64, f64)], time_ms: f64) -> (f64, f64) {
    let next = path.partition_point(|place| place.0 <= time_ms).clamp(1, path.len() - 1);
    let ((from_ms, from_x, from_y), (to_ms, to_x, to_y)) = (path[next - 1], path[next]);
    let share = ((time_ms - from_ms) / (to_ms - from_ms)).clamp(0.0, 1.0);
    (from_x + (to_x - from_x) * share, from_y + (to_y - from_y) * share)
}

fn records(path: &Path, columns: [usize; 3]) -> Vec<[f64; 3]> {
    let text = fs::read_to_string(path).expect("a recording");
    text.lines()
        .map(|line| {
            let cells: Vec<&str> = line.split_whitespace().collect();
            columns.map(|column| cells[column].parse().expect("a number"))
        })
        .collect()
}
