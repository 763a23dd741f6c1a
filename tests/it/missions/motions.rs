//! Motions that end, on the simulated brick with its usual errors: where they end by odometry, and
//! where truly.

use onbrick::mapping::Pose;
use onbrick::runtime::StopReason;
use onbrick::sim::World;
use onbrick::units::{degrees, wrap_rad};

use super::{Played, ROBOT, job, play};
use crate::support::promised::promised;

/// How many seeds each figure is of.
pub const SEEDS: u64 = 20;

/// A mission of one machine whose states' `do` are these, one after the other, each until it is
/// done.
pub fn steps(steps: &[&str]) -> String {
    let mut text =
        "name = \"steps\"\ntime_limit_s = 60\n[machine.m]\nstart = \"s0\"\nfinal = \"end\"\n"
            .to_owned();
    for (at, doing) in steps.iter().enumerate() {
        let go = if at + 1 == steps.len() { "end".to_owned() } else { format!("s{}", at + 1) };
        text.push_str(&format!(
            "[machine.m.state.s{at}]\ndo = {{ {doing} }}\n\
             next = [{{ when = \"done\", go = \"{go}\" }}]\n"
        ));
    }
    text + "[machine.m.state.end]\n"
}

pub fn played(mission: &str, robot: &str, seed: u64) -> Played {
    let world = World::text("open").unwrap();
    let played = play(|file| {
        let mut job = job("square", robot, ("open", world), seed, file);
        mission.clone_into(&mut job.mission.text);
        job
    });
    assert_eq!(played.ended.stop.reason, StopReason::Finished, "{}", played.ended);
    played
}

/// Where the robot truly stands at the end.
pub fn true_end(played: &Played) -> Pose {
    let truth = played.truths.last().unwrap();
    Pose { x_m: truth.x_m, y_m: truth.y_m, heading_rad: truth.heading_rad }
}

/// How far a pose is from a wanted one, metres and degrees.
pub fn miss(pose: Pose, wanted: Pose) -> (f64, f64) {
    let way_m = libm::hypot(pose.x_m - wanted.x_m, pose.y_m - wanted.y_m);
    (way_m, degrees(wrap_rad(pose.heading_rad - wanted.heading_rad)).abs())
}

/// How far the robot's end is from a wanted pose, metres and degrees: by odometry, and truly.
fn misses(mission: &str, wanted: Pose) -> [(f64, f64); 2] {
    let mut worst = [(0.0_f64, 0.0_f64); 2];
    for seed in 1..=SEEDS {
        let played = played(mission, ROBOT, seed);
        let ends = [played.run().poses.last().unwrap().pose, true_end(&played)];
        let ends = ends.map(|pose| miss(pose, wanted));
        for (worst, (way_m, turn_deg)) in worst.iter_mut().zip(ends) {
            *worst = (worst.0.max(way_m), worst.1.max(turn_deg));
        }
    }
    worst
}

fn at(x_m: f64, y_m: f64, heading_deg: f64) -> Pose {
    Pose { x_m, y_m, heading_rad: heading_deg.to_radians() }
}

#[test]
fn motions_end_where_they_should() {
    let square = steps(&["drive_m = 0.5", "turn_deg = 90"].repeat(4));
    for (what, mission, wanted, most_m, most_deg) in [
        ("1 m straight", steps(&["drive_m = 1.0"]), at(1.0, 0.0, 0.0), 0.01, 1.0),
        ("0.4 m back", steps(&["drive_m = -0.4"]), at(-0.4, 0.0, 0.0), 0.01, 1.0),
        ("90 degrees", steps(&["turn_deg = 90"]), at(0.0, 0.0, 90.0), 0.02, 1.0),
        ("-720 degrees", steps(&["turn_deg = -720, speed_dps = 60"]), at(0.0, 0.0, 0.0), 0.02, 1.0),
        (
            "a quarter of 0.3 m",
            steps(&["arc = { radius_m = 0.3, turn_deg = 90 }"]),
            at(0.3, 0.3, 90.0),
            0.02,
            1.0,
        ),
        (
            "the same back, to the right",
            steps(&["arc = { radius_m = -0.3, turn_deg = -90 }"]),
            at(-0.3, 0.3, -90.0),
            0.02,
            1.0,
        ),
        ("a square of 0.5 m", square, at(0.0, 0.0, 0.0), 0.05, 4.0),
        (
            "to a place",
            steps(&["goto = [0.8, -0.2], face_deg = 45"]),
            at(0.8, -0.2, 45.0),
            0.02,
            1.0,
        ),
        (
            "to a place behind, fast",
            steps(&["goto = [-0.4, 0.1], speed_mps = 0.2, face_deg = 0"]),
            at(-0.4, 0.1, 0.0),
            0.02,
            1.0,
        ),
    ] {
        let [odometry, truth] = misses(&mission, wanted);
        promised(&format!(
            "{what}: at most {:.1} mm and {:.2} degrees off by odometry, {:.1} mm and {:.2} \
             degrees truly, of {SEEDS} seeds",
            1000.0 * odometry.0,
            odometry.1,
            1000.0 * truth.0,
            truth.1
        ));
        assert!(odometry.0 < most_m, "{what}: {} m by odometry", odometry.0);
        assert!(odometry.1 < most_deg, "{what}: {} degrees by odometry", odometry.1);
    }
}
