//! `ev3-encoder-gyro`, problem 4: three runs of three segments, heading by gyro against heading by
//! encoders, and slip.
//!
//! Only the ends of segments were recorded; between them wheels and gyro are taken to turn evenly.

use std::f64::consts::TAU;
use std::fs;
use std::path::Path;

use onbrick::mapping::{
    Estimator, EstimatorConfig, Geometry, GyroReading, Inputs, Method, Pose, stats, turns_disagree,
};
use onbrick::units::{degrees, radians};

use crate::support;

/// Ticks in a segment, and of a tick.
const TICKS: i32 = 100;
const TICK_NS: i64 = 20_000_000;
/// The robot's own program turned about a radius of 693 mm with 383 and 287 mm/s at its wheels,
/// which is this track width.
const TRACK_M: f64 = 0.198;
const CIRCUMFERENCE_M: f64 = 0.175;

/// One segment: what was read before and after it, and where the robot was found. Clockwise
/// degrees, millimetres.
#[derive(Debug, Default, Clone, Copy)]
struct Segment {
    before: Reading,
    after: Reading,
    measured_mm: [f64; 2],
}

#[derive(Debug, Default, Clone, Copy)]
struct Reading {
    gyro_deg: f64,
    left_mm: f64,
    right_mm: f64,
}

#[test]
fn the_gyros_heading_is_better_than_the_encoders() {
    let Some(runs) = runs() else { return support::pass_over("the runs of ev3-encoder-gyro") };
    let rms_mm = |track_m: f64, gyro: bool| {
        let errors: Vec<f64> = runs.iter().flat_map(|run| errors_mm(run, track_m, gyro)).collect();
        stats::rms(&errors).expect("there are segments")
    };
    let gyro = rms_mm(TRACK_M, true);
    println!(
        "ev3-encoder-gyro, position at the ends of segments, RMS (mm; a plain script found 160 and \
         208 to 375):"
    );
    println!("  heading by gyro {gyro:.0}");
    assert!((144.0..176.0).contains(&gyro), "{gyro} mm");
    for track_mm in [160.0, 170.0, 180.0, 190.0, 198.0, 210.0] {
        let encoders = rms_mm(track_mm / 1000.0, false);
        println!("  heading by encoders, track {track_mm} mm: {encoders:.0}");
        assert!((200.0..390.0).contains(&encoders), "{encoders} mm");
    }
}

#[test]
fn slip_is_noticed_where_the_wheels_turn_against_each_other_and_not_on_a_straight_way() {
    let Some(runs) = runs() else { return support::pass_over("the runs of ev3-encoder-gyro") };
    println!(
        "ev3-encoder-gyro, slip of a segment by turns of encoders and gyro (degrees clockwise):"
    );
    for (number, run) in (1..).zip(&runs) {
        for (segment, (name, slips)) in
            run.iter().zip([("curve", false), ("straight", false), ("spin", true)])
        {
            let Reading { gyro_deg, left_mm, right_mm } = segment.before;
            let turn_mm = (segment.after.left_mm - left_mm) - (segment.after.right_mm - right_mm);
            let encoder_deg = degrees(turn_mm / (TRACK_M * 1000.0));
            let turned_deg = segment.after.gyro_deg - gyro_deg;
            let found = turns_disagree(radians(encoder_deg), radians(turned_deg));
            println!(
                "  run {number} {name:8}: encoders {encoder_deg:6.1}, gyro {turned_deg:6.1}, \
                 slip: {found}"
            );
            assert_eq!(found, slips, "run {number}, {name}");
        }
    }
}

/// Distances in mm between estimate and tape at the ends of a run's segments.
fn errors_mm(run: &[Segment; 3], track_m: f64, gyro: bool) -> Vec<f64> {
    let geometry = Geometry::new(CIRCUMFERENCE_M, track_m).expect("a robot");
    let mut estimator =
        Estimator::new(EstimatorConfig { geometry, method: Method::Default }, Pose::default());
    let mut time_ns = 0;
    let mut feed = |reading: Reading| {
        time_ns += TICK_NS;
        let wheel_rad = |mm: f64| Some(mm / 1000.0 / CIRCUMFERENCE_M * TAU);
        let value_rad = radians(-libm::round(reading.gyro_deg));
        estimator
            .update(&Inputs {
                time_ns,
                left_rad: wheel_rad(reading.left_mm),
                right_rad: wheel_rad(reading.right_mm),
                gyro: gyro.then_some(GyroReading { value_rad, changed_ns: time_ns }),
                ..Inputs::default()
            })
            .pose
    };
    // The script counted only what happened within the segments, so what the wheels moved between
    // them is taken off here too.
    let mut rolled = Reading::default();
    let mut last = run[0].before;
    run.iter()
        .map(|segment| {
            rolled = rolled.plus(segment.before.less(last));
            last = segment.after;
            let pose = drive(segment.before.less(rolled), segment.after.less(rolled), &mut feed);
            let [x_mm, y_mm] = segment.measured_mm;
            libm::hypot(pose.x_m * 1000.0 - x_mm, pose.y_m * 1000.0 - y_mm)
        })
        .collect()
}

impl Reading {
    fn with(self, other: Self, mix: impl Fn(f64, f64) -> f64) -> Self {
        Self {
            gyro_deg: mix(self.gyro_deg, other.gyro_deg),
            left_mm: mix(self.left_mm, other.left_mm),
            right_mm: mix(self.right_mm, other.right_mm),
        }
    }

    fn plus(self, other: Self) -> Self {
        self.with(other, |a, b| a + b)
    }

    fn less(self, other: Self) -> Self {
        self.with(other, |a, b| a - b)
    }
}

fn drive(from: Reading, to: Reading, feed: &mut impl FnMut(Reading) -> Pose) -> Pose {
    let mut pose = feed(from);
    for tick in 1..=TICKS {
        let share = f64::from(tick) / f64::from(TICKS);
        pose = feed(from.with(to, |from, to| from + (to - from) * share));
    }
    pose
}

fn runs() -> Option<Vec<[Segment; 3]>> {
    let path = support::shared()?.join("data/ev3-encoder-gyro/lab1_problem4_data.md");
    let runs = parsed(&path);
    assert_eq!(runs.len(), 3, "runs in {}", path.display());
    Some(runs)
}

/// Reads the console text below the tables: readings before and after each segment, and what was
/// measured.
fn parsed(path: &Path) -> Vec<[Segment; 3]> {
    let text = fs::read_to_string(path).expect("the recording");
    let mut segments = Vec::new();
    let mut current = Segment::default();
    let mut is_after = false;
    for line in text.lines().skip_while(|line| !line.starts_with("# raw logs")) {
        let number = || -> f64 {
            let word = line.split_whitespace().last().expect("a word").trim_end_matches("mm");
            word.parse().unwrap_or_else(|_| panic!("no number ends {line:?}"))
        };
        let reading = if is_after { &mut current.after } else { &mut current.before };
        if line.starts_with("BEFORE") || line.starts_with("AFTER") {
            is_after = line.starts_with("AFTER");
        } else if line.starts_with("angle") {
            reading.gyro_deg = number();
        } else if line.starts_with("left motor") {
            reading.left_mm = number();
        } else if line.starts_with("right motor") {
            reading.right_mm = number();
        } else if line.starts_with("Measured x") {
            current.measured_mm[0] = number();
        } else if line.starts_with("Measured y") {
            current.measured_mm[1] = number();
            segments.push(current);
        }
    }
    segments.as_chunks::<3>().0.to_vec()
}
