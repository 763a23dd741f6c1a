//! Which points of a map are of things that stand.
//!
//! - Where a robot has been nothing stands.
//! - A wall that was found from one side is found from there again. So where sound passes that
//!   comes from the same side and about as near, nothing stands: the point is of another robot or a
//!   person who went away, or of sound that went round. Sound that passes at another angle says
//!   nothing: a wall that is met obliquely sends no echo back. (What is seen through has moved:
//!   usual with laser scanners, which need not ask for the angle; Pomerleau et al., *Long-term 3D
//!   map maintenance in dynamic environments*, 2014.)
//! - What lies behind a wall of the others ([`walls()`](super::walls())) is sound that went round.
//!
//! # Not here
//!
//! - The points on the way: a robot that drives goes by its grid, where cells change their minds
//!   (`grid`).
//! - Time: what stood there first and what came later are both left out.
//! - Soundings without an echo: they say little (`grid`).
//!
//! # Measured
//!
//! Exploring with the usual errors, points within 5 cm of a wall and coverage, all points and of
//! what stands, %, 20 runs a world (`figures_of_explore` prints the points of other seeds):
//!
//! | | `arena` | `rooms` | a passage | slanted blocks | pillars |
//! |---|---|---|---|---|---|
//! | points | 85.3, 89.2 | 82.1, 89.0 | 82.7, 88.9 | 83.3, 87.3 | 77.7, 81.8 |
//! | coverage | 93.5, 92.8 | 98.6, 98.3 | 92.6, 92.3 | 84.9, 84.5 | 90.4, 90.0 |
//!
//! Two robots in one room (`what_two_robots_in_one_room_take_for_walls`, 6 runs): 80 % of a robot's
//! points are at walls and 3 % on the other robot; then 85 and 2 %, and by the sights of both 87
//! and 0.9 %. Of real robots' scans from five places each (`figures_of_what_stands_in_real_scans`)
//! 0.4 to 3 % more are at walls, with up to 1.5 % less coverage. Maps of 4000 points take 20 ms on
//! a PC.
//!
//! # What was tried and gave nothing
//!
//! - Points in cells that the grid has as free: 88 to 91 % of the points left are at walls, but 7
//!   to 14 % of the coverage is lost.
//! - Soundings instead of points as what passes, so that those without an echo count: 2 points more
//!   at walls, 1 to 3 % less coverage.
//! - Sound of another robot's sensor as single readings that fit neither of their neighbours, left
//!   out before anything else looks at them or in `sweep` alone: no gain over 12 pairs of robots
//!   with crosstalk of 0, 5, 10 and 20 %. Robots that hear an obstacle a tenth of a second later
//!   touch each other.

use std::collections::BTreeMap;

use super::Sight;
use super::walls::walls_of;
use crate::units::floored;

/// A robot is no narrower than twice this, metres: with LEGO's large motors at its sides.
const BODY_M: f64 = 0.08;
/// Sound passes a point if it goes by within the first and comes back from the second behind it,
/// metres: half of a robot's width, and more than twice what a range is wrong by.
const ASIDE_M: f64 = 0.05;
const BEHIND_M: f64 = 0.1;
/// A point is found again by one that is as near, metres.
const AGAIN_M: f64 = 0.08;
/// From the same side is within this, cosine: 25°.
const SAME_SIDE: f64 = 0.906;
/// As near is no further than this beyond the distance that it was found from, metres: what is
/// farther answers more faintly.
const FARTHER_M: f64 = 0.3;
/// Sound that has to pass before a point is doubted.
const PASSES: u32 = 2;
/// A sight longer than this is none of a sonar's, metres.
const LONGEST_M: f64 = 3.0;
/// Points are looked for by squares of this side, metres.
const SQUARE_M: f64 = 0.25;

/// Of each sight, whether what it is of stands. Sights of several robots may be mixed.
#[must_use]
pub fn standing(sights: &[Sight]) -> Vec<bool> {
    let clear = clear(sights);
    let walls = walls_of(sights, &clear);
    let is_behind = |sight: &Sight| walls.iter().any(|wall| wall.hides(sight));
    sights.iter().zip(clear).map(|(sight, clear)| clear && !is_behind(sight)).collect()
}

/// Of each sight, whether its point was neither driven over nor seen through.
fn clear(sights: &[Sight]) -> Vec<bool> {
    let mut squares: BTreeMap<[i32; 2], Vec<usize>> = BTreeMap::new();
    for (place, sight) in sights.iter().enumerate() {
        squares.entry(square(sight.at_m)).or_default().push(place);
    }
    let between = |low: [f64; 2], high: [f64; 2]| {
        let ([left, below], [right, above]) = (square(low), square(high));
        let squares = &squares;
        (left..=right)
            .flat_map(move |x| squares.range([x, below]..=[x, above]))
            .flat_map(|(_, places)| places.iter().copied())
    };
    let rays: Vec<Ray> = sights.iter().map(Ray::of).collect();
    let mut found = vec![Evidence::default(); sights.len()];
    // What is no number is no ray either.
    for (place, ray) in rays.iter().enumerate().filter(|(_, ray)| ray.length_m < LONGEST_M) {
        let low = [0, 1].map(|axis| ray.from_m[axis].min(ray.at_m[axis]) - BODY_M);
        let high = [0, 1].map(|axis| ray.from_m[axis].max(ray.at_m[axis]) + BODY_M);
        for other in between(low, high).filter(|other| *other != place) {
            if let Some((point, evidence)) = rays.get(other).zip(found.get_mut(other)) {
                evidence.add(point, ray);
            }
        }
    }
    found.iter().map(Evidence::is_clear).collect()
}

fn square(at_m: [f64; 2]) -> [i32; 2] {
    at_m.map(|m| floored(m / SQUARE_M))
}

/// A sight as a vector, metres.
#[derive(Debug, Clone, Copy)]
struct Ray {
    from_m: [f64; 2],
    at_m: [f64; 2],
    way_m: [f64; 2],
    length_m: f64,
}

impl Ray {
    fn of(&Sight { from_m, at_m }: &Sight) -> Self {
        let way_m = vector(from_m, at_m);
        Self { from_m, at_m, way_m, length_m: libm::sqrt(dot(way_m, way_m)) }
    }
}

fn vector(from_m: [f64; 2], to_m: [f64; 2]) -> [f64; 2] {
    [to_m[0] - from_m[0], to_m[1] - from_m[1]]
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// What other sights say of a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Evidence {
    is_driven_over: bool,
    passed: u32,
    again: u32,
}

impl Evidence {
    /// Lengths are compared by their squares: of thousands of sights each comes here with most of
    /// the others.
    fn add(&mut self, point: &Ray, ray: &Ray) {
        let way_m = vector(ray.from_m, point.at_m);
        let square = dot(way_m, way_m);
        if square < BODY_M * BODY_M {
            self.is_driven_over = true;
            return;
        }
        let farthest_m = point.length_m + FARTHER_M;
        let along_own = dot(way_m, point.way_m);
        let least = SAME_SIDE * point.length_m;
        if square > farthest_m * farthest_m
            || along_own < 0.0
            || along_own * along_own < least * least * square
        {
            return;
        }
        let along_m = dot(way_m, ray.way_m) / ray.length_m;
        let aside_m = (way_m[0] * ray.way_m[1] - way_m[1] * ray.way_m[0]) / ray.length_m;
        let between_m = vector(ray.at_m, point.at_m);
        if along_m > 0.0 && aside_m.abs() < ASIDE_M && ray.length_m > along_m + BEHIND_M {
            self.passed += 1;
        } else if dot(between_m, between_m) < AGAIN_M * AGAIN_M {
            self.again += 1;
        }
    }

    fn is_clear(&self) -> bool {
        !self.is_driven_over && (self.passed < PASSES || self.passed < self.again)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// 21 points across the x axis, every 5 cm at a metre and as much further apart as they are
    /// further away, found from a place.
    fn line(x_m: f64, from_m: [f64; 2]) -> Vec<Sight> {
        (-10..=10).map(|step| Sight { at_m: [x_m, f64::from(step) * 0.05 * x_m], from_m }).collect()
    }

    /// How many of the first sights stand.
    fn stand(sights: &[Sight], first: usize) -> usize {
        standing(sights).iter().take(first).filter(|stands| **stands).count()
    }

    #[test]
    fn what_is_seen_through_from_its_own_side_is_gone_and_what_is_behind_it_stands() {
        let mut sights = line(1.0, [0.0, 0.0]);
        sights.extend(line(2.0, [0.0, 0.0]));
        sights.extend(line(2.0, [0.0, 0.0]));
        assert_eq!(stand(&sights, 21), 0);
        assert_eq!(stand(&sights[21..], 42), 42);
        // Once is not enough.
        assert_eq!(stand(&[sights[10], sights[31]], 2), 2);
    }

    #[test]
    fn what_is_passed_from_elsewhere_stands() {
        let wall = line(1.0, [0.0, 0.0]);
        // From its end, from the other side, and from so far that it would be faint.
        for [from_m, at_m] in [[[0.8, -0.8], [1.2, 0.8]], [[1.5, 0.0], [0.2, 0.0]]] {
            let mut sights = wall.clone();
            sights.extend([Sight { at_m, from_m }; 5]);
            assert_eq!(stand(&sights, 21), 21, "from {from_m:?}");
        }
        let mut sights = vec![Sight { at_m: [1.0, 0.0], from_m: [0.7, 0.0] }];
        sights.extend([Sight { at_m: [2.0, 0.0], from_m: [0.0, 0.0] }; 5]);
        assert_eq!(stand(&sights, 1), 1);
    }

    #[test]
    fn what_is_found_again_more_often_than_it_is_passed_stands() {
        let wall = line(1.0, [0.0, 0.0]);
        let through = Sight { at_m: [1.5, 0.0], from_m: [0.0, 0.0] };
        let mut sights = wall.repeat(2);
        sights.extend([through; 2]);
        assert_eq!(stand(&sights, 42), 42);
        sights.extend([through; 10]);
        assert!(stand(&sights, 42) < 42);
    }

    #[test]
    fn what_lies_behind_a_wall_does_not_stand_and_what_is_seen_past_its_end_does() {
        let mut sights = line(1.0, [0.0, 0.0]).repeat(2);
        let wall = sights.len();
        for (place, sight) in (0..).zip(&mut sights) {
            sight.at_m[0] += if place % 2 == 0 { 0.005 } else { -0.005 };
        }
        sights.push(Sight { at_m: [1.3, 0.1], from_m: [0.0, 0.0] });
        sights.push(Sight { at_m: [1.3, 0.9], from_m: [0.0, 0.0] });
        assert_eq!(stand(&sights, wall), wall);
        assert_eq!(standing(&sights)[wall..], [false, true]);
    }

    #[test]
    fn nothing_stands_where_a_robot_has_been() {
        let mut sights = line(1.0, [0.0, 0.0]);
        sights.push(Sight { at_m: [1.0, 2.0], from_m: [1.0, 0.0] });
        assert_eq!(stand(&sights, 21), 21 - 3);
    }

    proptest! {
        #[test]
        fn any_numbers_at_all_are_survived(
            numbers in proptest::collection::vec((any::<f64>(), any::<f64>(), -1.0..1.0), 0..60)
        ) {
            let sights: Vec<Sight> = numbers
                .into_iter()
                .flat_map(|(a, b, c)| {
                    [Sight { at_m: [a, b], from_m: [c, a] }, Sight { at_m: [c, c], from_m: [b, c] }]
                })
                .collect();
            prop_assert_eq!(standing(&sights).len(), sights.len());
        }

        /// The order does not matter, nor where the map's origin is.
        #[test]
        fn the_order_of_sights_does_not_matter(
            places in proptest::collection::vec(proptest::array::uniform4(-1.0..1.0), 2..60)
        ) {
            let sight = |[a, b, c, d]: [f64; 4]| Sight { at_m: [a, b], from_m: [c, d] };
            let forth: Vec<Sight> = places.iter().copied().map(sight).collect();
            let back: Vec<Sight> = forth.iter().copied().rev().collect();
            let mut of_back = standing(&back);
            of_back.reverse();
            prop_assert_eq!(standing(&forth), of_back);
        }
    }
}
