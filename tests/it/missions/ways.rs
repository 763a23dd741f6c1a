//! Ways over the map to a place, on the simulated brick with its usual errors.

use onbrick::runtime::StopReason;
use onbrick::sim::{Truth, World};

use super::motions::steps;
use super::{Played, ROBOT, job, play};
use crate::support::stage::Play;

/// A mission of these steps, with time to find a way.
fn ways(doing: &[&str]) -> String {
    steps(doing).replace("time_limit_s = 60", "time_limit_s = 600")
}

/// A run that finishes.
fn played(doing: &[&str], world: (&str, &str), seed: u64) -> Played {
    let played = play(|file| {
        let mut job = job("square", ROBOT, world, seed, file);
        job.mission.text = ways(doing);
        job
    });
    assert_eq!(played.ended.stop.reason, StopReason::Finished, "{}", played.ended);
    played
}

/// How far the robot truly is from a place at the end, metres.
fn missed_m(played: &Played, [x_m, y_m]: [f64; 2]) -> f64 {
    let truth = played.truths.last().unwrap();
    libm::hypot(truth.x_m - x_m, truth.y_m - y_m)
}

/// A hall of 9 m by 1.5 m; the map of a run that begins in it reaches 5 m to each side.
const HALL: &str = r#"
name = "hall"
[[start]]
at = [0.5, 0.75]
[[wall]]
points = [[0, 0], [9, 0], [9, 1.5], [0, 1.5]]
closed = true
"#;

#[test]
fn a_place_beyond_the_map_is_reached_and_the_start_again() {
    let there_and_back = ["goto = [8.0, 0.75], keep_m = 0.15", "goto = [0.5, 0.75], keep_m = 0.15"];
    for (to_m, doing) in [(8.0, &there_and_back[..1]), (0.5, &there_and_back[..])] {
        let played = played(doing, ("hall", HALL), 1);
        let missed_m = missed_m(&played, [to_m, 0.75]);
        assert!(missed_m < 0.3, "{missed_m} m from {to_m} m");
        assert!(!played.truths.iter().any(|truth| truth.touching));
    }
}

#[test]
fn a_place_in_another_room_is_reached_through_a_door_that_was_never_seen() {
    let rooms = ("rooms", World::text("rooms").unwrap());
    for (x_m, y_m) in [(2.4, 0.8), (2.6, -0.7)] {
        for seed in 1..=4 {
            let played = played(&[&format!("goto = [{x_m}, {y_m}], keep_m = 0.15")], rooms, seed);
            let missed_m = missed_m(&played, [x_m, y_m]);
            assert!(missed_m < 0.15, "({x_m}, {y_m}), seed {seed}: {missed_m} m from there");
        }
    }
}

/// A room with a cupboard, closed on all sides.
const CUPBOARD: &str = r#"
name = "cupboard"
[[start]]
at = [0.5, 0.5]
[[wall]]
points = [[0, 0], [2, 0], [2, 1.5], [0, 1.5]]
closed = true
[[block]]
at = [1.3, 0.75]
size_m = [0.5, 0.5]
"#;

#[test]
fn a_way_to_where_there_is_none_ends_by_itself_near_there() {
    for seed in 1..=3 {
        let inside = [1.3, 0.75];
        let played = played(&["goto = [1.3, 0.75], keep_m = 0.15"], ("cupboard", CUPBOARD), seed);
        let missed_m = missed_m(&played, inside);
        assert!((0.3..0.55).contains(&missed_m), "seed {seed}: {missed_m} m from there");
    }
}

#[test]
fn a_pressed_bumper_is_backed_off_from_and_the_place_driven_round() {
    // A touch sensor that reads the wrong way for a moment, far from everything.
    let pressed = "[[fault]]\nat_s = 20\nuntil_s = 20.5\nport = \"in2\"\nkind = \"wrong\"\n";
    let mut way = Play::of("square", "open", 1).scenario(pressed);
    way.mission_toml = ways(&["goto = [1.2, 0], keep_m = 0.15"]);
    let played = way.play().unwrap();
    assert_eq!(played.reason, StopReason::Finished);
    let truths = &played.truths;
    let speeds = truths.iter().map(|truth| truth.speed_mps);
    let back = speeds.enumerate().find(|(_, speed_mps)| *speed_mps < -0.02).expect("backs off").0;
    let (pressed, end) = (&truths[back], truths.last().unwrap());
    let least_m = truths[back..].iter().map(|truth| truth.x_m).fold(f64::INFINITY, f64::min);
    assert!(least_m < pressed.x_m - 0.05, "back from {} to {least_m}", pressed.x_m);
    let (sin, cos) = libm::sincos(pressed.heading_rad);
    let place = [pressed.x_m + 0.13 * cos, pressed.y_m + 0.13 * sin];
    let near_m = |truth: &Truth| libm::hypot(truth.x_m - place[0], truth.y_m - place[1]);
    let nearest_m = truths[back..].iter().map(near_m).fold(f64::INFINITY, f64::min);
    assert!(nearest_m > 0.09, "it comes within {nearest_m} m of where it was pressed");
    assert!(libm::hypot(end.x_m - 1.2, end.y_m) < 0.1, "it ends at {}, {}", end.x_m, end.y_m);
}

#[test]
fn blocked_wheels_are_backed_off_from_without_a_state_for_it_until_that_does_not_help() {
    let blocked = |until_s: f64| {
        let fault = |port| {
            format!(
                "[[fault]]\nat_s = 20\nuntil_s = {until_s}\nport = \"{port}\"\nkind = \"block\"\n"
            )
        };
        let mut way = Play::of("square", "open", 1).scenario(&(fault("outB") + &fault("outD")));
        way.mission_toml = ways(&["goto = [1.2, 0], keep_m = 0.15"]);
        way.play().unwrap()
    };
    let played = blocked(21.2);
    assert_eq!(played.reason, StopReason::Finished);
    assert!(played.truths.iter().any(|truth| truth.speed_mps < -0.02), "backs off");
    let end = played.truths.last().unwrap();
    assert!(libm::hypot(end.x_m - 1.2, end.y_m) < 0.1, "it ends at {}, {}", end.x_m, end.y_m);
    let played = blocked(300.0);
    assert_eq!(played.reason, StopReason::Stalled);
    assert!(played.drove_s < 30.0, "after {} s", played.drove_s);
}
