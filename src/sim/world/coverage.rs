//! Which parts of a world's walls a robot can map, and how much of them a map has.
//!
//! A wall is sampled; a sample can echo where the sensor of a robot that has driven there can be
//! before it, within the sensor's reach, square enough, and with nothing between. What cannot be
//! driven to does not count, and neither does the far side of a block in a corner.
//!
//! How square is square enough the world's echo model says. With the lobe a wall answers from the
//! foot of the perpendicular alone, and a concave corner from its place in all directions; with the
//! cone anything answers that is met less obliquely than the limit.
//!
//! # Not here
//!
//! Loudness: the lobe hears a wall's end worse than its middle, and some places worse than others.
//! Those count as if they were heard, so that the measure is never kinder than the sensor.

use std::collections::{BTreeSet, VecDeque};

use super::World;
use super::geometry::{Point, direction};
use crate::sim::EchoModel;
use crate::units::{count, radians, rounded};

/// Between two samples of a wall, and between two places of the floor, metres.
const SAMPLE_M: f64 = 0.02;
const FLOOR_M: f64 = 0.03;
/// No further from the start is driven, metres.
const FURTHEST_M: f64 = 12.0;
/// Directions in which a sample is looked at, to either side of its normal.
const DIRECTIONS: i32 = 4;
/// The most oblique of them before a concave corner, degrees.
const CORNER_DEG: f64 = 45.0;
/// In this many directions the sensor can be ahead of the robot's middle, as that turns.
const TURNS: i32 = 16;

impl World {
    /// Samples of the walls that can echo to a robot which drives on the floor that it can reach
    /// from a place; world frame, metres.
    ///
    /// - `reach_m`: what is further away is not heard, or makes no point.
    #[must_use]
    pub fn echoing_walls(&self, x_m: f64, y_m: f64, reach_m: f64) -> Vec<[f64; 2]> {
        let floor = Reachable::from(self, Point::new(x_m, y_m));
        let mut found = Vec::new();
        for outline in &self.outlines {
            for ends in outline.windows(2) {
                let [from, to] = [ends[0], ends[1]].map(|[x, y]| Point::new(x, y));
                let along = to - from;
                let length_m = along.norm();
                if length_m <= 0.0 {
                    continue;
                }
                let normal_rad = libm::atan2(along.x, -along.y);
                let count = libm::ceil(length_m / SAMPLE_M);
                let mut at = 0.5;
                while at < count {
                    let place = from + along * (at / count);
                    let sides = [normal_rad, normal_rad + std::f64::consts::PI];
                    if sides.iter().any(|side| floor.hears(place, *side, reach_m)) {
                        found.push([place.x, place.y]);
                    }
                    at += 1.0;
                }
            }
        }
        found
    }
}

/// The share of places within a distance of which one of the points is; `None` without places.
#[must_use]
pub fn covered(
    places: &[[f64; 2]],
    points: impl Iterator<Item = [f64; 2]> + Clone,
    within_m: f64,
) -> Option<f64> {
    if places.is_empty() {
        return None;
    }
    let is_near = |place: &&[f64; 2]| {
        points.clone().any(|[x_m, y_m]| libm::hypot(x_m - place[0], y_m - place[1]) <= within_m)
    };
    let near = places.iter().filter(is_near).count();
    Some(count(near) / count(places.len()))
}

/// Where the sensor of a robot can be on the floor that it can reach: places of a lattice.
struct Reachable<'w> {
    world: &'w World,
    places: BTreeSet<[i32; 2]>,
}

impl<'w> Reachable<'w> {
    fn from(world: &'w World, start: Point) -> Self {
        let robot = world.robot();
        // It can turn on the spot there, and the sensor with it.
        let radius_m = libm::hypot(robot.front_m.max(robot.rear_m), robot.half_width_m);
        let first = cell(start);
        let mut places = BTreeSet::from([first]);
        let mut edge = VecDeque::from([first]);
        while let Some([x, y]) = edge.pop_front() {
            for next in [[x + 1, y], [x - 1, y], [x, y + 1], [x, y - 1]] {
                let place = Point::new(f64::from(next[0]), f64::from(next[1])) * FLOOR_M;
                if (place - start).norm() < FURTHEST_M
                    && world.surfaces.distance(place) > radius_m
                    && places.insert(next)
                {
                    edge.push_back(next);
                }
            }
        }
        let ahead_m = robot.range_ahead_m;
        let around = |turn: i32| {
            direction(std::f64::consts::TAU * f64::from(turn) / f64::from(TURNS)) * ahead_m
        };
        let sensor = |[x, y]: &[i32; 2]| {
            let middle = Point::new(f64::from(*x), f64::from(*y)) * FLOOR_M;
            (0..TURNS).map(move |turn| cell(middle + around(turn)))
        };
        let places = places.iter().flat_map(sensor).collect();
        Self { world, places }
    }

    /// How far from its normal a wall's place answers, radians.
    fn steepest_rad(&self, place: Point) -> f64 {
        let robot = self.world.robot();
        let is_at = |corner: Point| (corner - place).norm() < SAMPLE_M;
        match robot.echo {
            EchoModel::Cone => radians(robot.errors.incidence_deg) * 0.95,
            EchoModel::Lobe if self.world.surfaces.corners.iter().any(|at| is_at(at.place)) => {
                radians(CORNER_DEG)
            }
            EchoModel::Lobe => 0.0,
        }
    }

    /// Whether a robot hears a wall's place from the side that a normal points to.
    fn hears(&self, place: Point, normal_rad: f64, reach_m: f64) -> bool {
        let steepest_rad = self.steepest_rad(place);
        (-DIRECTIONS..=DIRECTIONS).any(|step| {
            let off_rad = steepest_rad * f64::from(step) / f64::from(DIRECTIONS);
            let toward = direction(normal_rad + off_rad);
            let from = place + toward * 1e-6;
            let hit_m =
                self.world.surfaces.hit(from, toward).map_or(f64::INFINITY, |hit| hit.range_m);
            let most_m = hit_m.min(reach_m);
            let mut at_m = FLOOR_M;
            while at_m < most_m {
                if self.places.contains(&cell(place + toward * at_m)) {
                    return true;
                }
                at_m += FLOOR_M;
            }
            false
        })
    }
}

fn cell(place: Point) -> [i32; 2] {
    [place.x, place.y].map(|m| rounded(m / FLOOR_M))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn world(text: &str) -> World {
        World::parse("world.toml", text.as_bytes()).unwrap().0
    }

    #[test]
    fn all_of_a_square_room_echoes_and_nothing_of_the_room_beside_it() {
        let text = r#"
name = "two"
[[start]]
at = [0.0, 0.0]
[[wall]]
points = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
closed = true
[[wall]]
points = [[2.0, -1.0], [4.0, -1.0], [4.0, 1.0], [2.0, 1.0]]
closed = true
"#;
        let walls = world(text).echoing_walls(0.0, 0.0, 2.0);
        assert!((380..=400).contains(&walls.len()), "8 m, a sample each 2 cm: {}", walls.len());
        assert!(walls.iter().all(|[x_m, _]| *x_m < 1.1));
    }

    #[test]
    fn what_is_behind_a_gap_too_narrow_is_not_reached() {
        let room = |gap_m: f64| {
            world(&format!(
                r#"
name = "gap"
[[start]]
at = [-0.5, 0.0]
[[wall]]
points = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
closed = true
[[wall]]
points = [[0.0, -1.0], [0.0, {}]]
[[wall]]
points = [[0.0, {}], [0.0, 1.0]]
"#,
                -gap_m / 2.0,
                gap_m / 2.0
            ))
        };
        let right = |gap_m: f64| {
            let walls = room(gap_m).echoing_walls(-0.5, 0.0, 2.0);
            // The corners answer through the gap.
            let aside = |y_m: f64| (0.75..0.95).contains(&y_m.abs());
            walls.iter().filter(|[x_m, y_m]| *x_m > 0.9 && aside(*y_m)).count()
        };
        assert_eq!(right(0.2), 0);
        assert!(right(0.5) > 12, "{}", right(0.5));
    }

    #[test]
    fn a_wall_that_is_met_obliquely_alone_echoes_to_the_cone_and_not_to_the_lobe() {
        // Through a slit; the wall behind stands square to the sensor right behind it alone.
        let behind = |echo: &str| {
            let text = format!(
                r#"
name = "slit"
[[start]]
at = [-0.5, 0.0]
[[wall]]
points = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
closed = true
[[wall]]
points = [[0.0, -1.0], [0.0, -0.1]]
[[wall]]
points = [[0.0, 0.1], [0.0, 1.0]]
[robot]
echo = "{echo}"
"#
            );
            let walls = world(&text).echoing_walls(-0.5, 0.0, 2.0);
            let of = |aside: fn(f64) -> bool| {
                walls.iter().filter(|[x_m, y_m]| *x_m > 0.9 && aside(y_m.abs())).count()
            };
            let corners = walls.iter().filter(|[x_m, y_m]| *x_m < -0.98 && y_m.abs() > 0.98);
            [of(|m| m < 0.1), of(|m| (0.12..0.9).contains(&m)), corners.count()]
        };
        let ([square, oblique, _], [square_cone, oblique_cone, _]) =
            (behind("lobe"), behind("cone"));
        assert_eq!([square, square_cone], [10, 10]);
        assert_eq!(oblique, 0);
        assert!(oblique_cone > 20, "{oblique_cone}");
        assert!(behind("lobe")[2] >= 4, "a concave corner answers, two walls each");
    }

    #[test]
    fn a_place_is_covered_within_the_distance() {
        let places = [[0.0, 0.0], [1.0, 0.0]];
        assert_eq!(covered(&places, [[0.04, 0.0]].into_iter(), 0.05), Some(0.5));
        assert_eq!(covered(&places, std::iter::empty(), 0.05), Some(0.0));
        assert_eq!(covered(&[], std::iter::empty(), 0.05), None);
    }
}
