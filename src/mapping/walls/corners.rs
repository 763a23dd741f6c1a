//! Walls that meet end where they meet.
//!
//! A sonar's echo is as wide as its cone, and in a corner it comes from both walls at once: a wall
//! that was found runs past the other one, or ends before it. Through what is left open no robot
//! would fit.

use super::{SHORTEST_M, Wall};

/// Walls that meet are turned against each other by at least this much, sine: 30°.
const TURNED: f64 = 0.5;
/// So near to a wall's end another meets it, metres: as wide as a robot.
const NEAR_M: f64 = 0.16;

/// The walls, with the ends that are near another wall moved to where they meet it. Their other
/// ends are those of `free`, and all are where a wall would become too short for one.
pub(super) fn met(walls: &[Wall], free: &[Wall]) -> Vec<Wall> {
    let end = |from_m: [f64; 2], to_m: [f64; 2], free_m: [f64; 2]| {
        let meetings = walls.iter().filter_map(|other| meeting(from_m, to_m, other));
        let nearest = meetings.min_by(|a, b| a.0.total_cmp(&b.0));
        nearest.map_or(free_m, |(_, at_m)| at_m)
    };
    let ends = |(wall, free): (&Wall, &Wall)| {
        let Wall { from_m, to_m, .. } = *wall;
        let [from_m, to_m] = [end(from_m, to_m, free.from_m), end(to_m, from_m, free.to_m)];
        let met = Wall { from_m, to_m, ..*wall };
        if met.length_m() < SHORTEST_M { *free } else { met }
    };
    walls.iter().zip(free).map(ends).collect()
}

/// Where another wall meets the one from `from_m` to `to_m` near its first end, and how far from
/// that.
fn meeting(from_m: [f64; 2], to_m: [f64; 2], other: &Wall) -> Option<(f64, [f64; 2])> {
    let between = |[ax, ay]: [f64; 2], [bx, by]: [f64; 2]| [bx - ax, by - ay];
    let unit = |[x, y]: [f64; 2]| [x, y].map(|m| m / libm::hypot(x, y));
    let cross = |[ax, ay]: [f64; 2], [bx, by]: [f64; 2]| ax * by - ay * bx;
    let along = unit(between(from_m, to_m));
    let along_other = unit(between(other.from_m, other.to_m));
    let sine = cross(along, along_other);
    let apart = between(from_m, other.from_m);
    let inward_m = cross(apart, along_other) / sine;
    let on_other_m = cross(apart, along) / sine;
    let meets = sine.abs() >= TURNED
        && inward_m.abs() <= NEAR_M
        && (-NEAR_M..=other.length_m() + NEAR_M).contains(&on_other_m);
    let at_m = [0, 1].map(|axis| from_m[axis] + inward_m * along[axis]);
    meets.then_some((inward_m.abs(), at_m))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wall(from_m: [f64; 2], to_m: [f64; 2]) -> Wall {
        Wall { from_m, to_m, ..Wall::default() }
    }

    #[test]
    fn walls_end_where_they_meet_and_gaps_as_wide_as_a_robot_stay() {
        // One that runs past, one that ends before, a door, and one that is not turned.
        let walls = [
            wall([-0.1, 0.0], [2.0, 0.0]),
            wall([0.0, 0.1], [0.0, 1.0]),
            wall([1.2, 0.18], [1.2, 1.0]),
            wall([2.1, 0.02], [3.0, 0.02]),
        ];
        let met = met(&walls, &walls);
        let ends: Vec<[[f64; 2]; 2]> = met.iter().map(|wall| [wall.from_m, wall.to_m]).collect();
        let expected = [
            [[0.0, 0.0], [2.0, 0.0]],
            [[0.0, 0.0], [0.0, 1.0]],
            [[1.2, 0.18], [1.2, 1.0]],
            [[2.1, 0.02], [3.0, 0.02]],
        ];
        let far = ends.iter().flatten().flatten().zip(expected.iter().flatten().flatten());
        assert!(far.into_iter().all(|(a, b)| (a - b).abs() < 1e-9), "{ends:?}");
    }

    #[test]
    fn no_wall_becomes_too_short_for_one() {
        let walls = [wall([-0.1, 0.0], [0.22, 0.0]), wall([0.0, -1.0], [0.0, 1.0])];
        assert_eq!(met(&walls, &walls)[0], walls[0]);
    }
}
