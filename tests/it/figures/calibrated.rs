//! How far a calibrated robot truly is from where motions should end.

use onbrick::commissioning::CalibrateOptions;
use onbrick::mapping::Pose;

use crate::missions::motions::{SEEDS, miss, played, steps, true_end};
use crate::setup::Bench;
use crate::setup::calibrate::{Measurer, measure_with, wrong};

/// The robot's file after `calibrate` has measured the robot of a seed, whose wheels, track width
/// and gyro are those of the same seed in any world.
fn calibrated(seed: u64) -> String {
    // A file that is wrong one way or the other.
    let (circumference, track) =
        [(0.9, 1.1), (1.1, 0.9), (1.1, 1.1), (0.9, 0.9)][usize::try_from(seed % 4).unwrap()];
    let robot = wrong(circumference, track, true);
    let bench = Bench::new("", seed);
    let mut person = Measurer::new(&bench);
    let options = CalibrateOptions::default();
    let calibration = measure_with(&bench, &robot, &options, &mut person)
        .unwrap_or_else(|error| panic!("seed {seed}: {error}"));
    calibration.apply(&robot).unwrap_or_else(|error| panic!("seed {seed}: {error}"))
}

#[test]
fn a_calibrated_robot_truly_ends_where_it_should() {
    let robots: Vec<(u64, String)> = (1..=SEEDS).map(|seed| (seed, calibrated(seed))).collect();
    let at = |x_m: f64| Pose { x_m, y_m: 0.0, heading_rad: 0.0 };
    let square =
        |side_m: f64| steps(&[format!("drive_m = {side_m}").as_str(), "turn_deg = 90"].repeat(4));
    println!("| motion, after calibrate | off by truth at most, cm, degrees | mean, cm |");
    for (what, mission, wanted, most_m) in [
        ("1 m straight", steps(&["drive_m = 1.0"]), at(1.0), 0.02),
        ("square of 0.5 m", square(0.5), at(0.0), 0.05),
        ("square of 1 m", square(1.0), at(0.0), 0.05),
    ] {
        let misses: Vec<(f64, f64)> = robots
            .iter()
            .map(|(seed, robot)| miss(true_end(&played(&mission, robot, *seed)), wanted))
            .collect();
        let (way_m, turn_deg) = misses
            .iter()
            .fold((0.0_f64, 0.0_f64), |most, miss| (most.0.max(miss.0), most.1.max(miss.1)));
        let mean_m = misses.iter().map(|miss| miss.0).sum::<f64>() / misses.len() as f64;
        println!("| {what} | {:.1}, {turn_deg:.1} | {:.1} |", 100.0 * way_m, 100.0 * mean_m);
        assert!(way_m < most_m, "{what}: {misses:.3?}");
    }
}
