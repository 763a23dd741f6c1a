//! Where echoes that came from several sides cross.
//!
//! A range is right to a centimetre or two, its direction to ten degrees: an echo lies on an arc
//! about the sensor, and what several sides heard lies where their arcs cross (Choset, Nagatani and
//! Lazar, *The arc-transversal median algorithm: a geometric approach to increasing ultrasonic
//! sensor azimuth accuracy*, 2003). So each arc votes for the cells that it goes through, apart for
//! each side that it comes from, and a point is turned on its arc to where more sides agree. Points
//! of a post, which lie beside it on tangents, come together; those of a wall hardly move.
//!
//! # Not here
//!
//! - The points on the way: all of a run's echoes vote, and a robot that drives goes by its grid.
//! - The sensor's place: arcs are about the robot's middle. A sensor six centimetres before it is
//!   one centimetre wrong at the end of an arc.
//!
//! # Measured
//!
//! One exploration each of 68 rooms, most of them drawn by chance, for 300 and for 600 s: 89.5 and
//! 92.6 % of the points are within 5 cm of a wall for 87.7 and 89.5 %, 73.3 and 76.3 % within 2.5
//! cm for 71.6 and 73.9 %; 86.3 and 97.2 % of the wall have a point for 86.4 and 97.6 %. Of the 29
//! that nothing was tuned on 89.8 and 92.9 % for 88.0 and 90.0 %. Where posts stand it is most:
//! among legs of tables 89.6 % for 85.7 % after 600 s. Of real robots' scans from five places each
//! 0.3 % more are near walls where the places are fitted, none where they are as a hand set the
//! robots down (`figures_of_what_stands_in_real_scans`). Maps of 4000 points take 20 ms on a PC.
//!
//! # What was tried and gave nothing
//!
//! - Votes that are less at the ends of an arc, points that turn less far where as many sides
//!   agree, a second round in which arcs are about where the points came to.
//! - To go where seven tenths of a side more agree: 0.5 % more of the points are near walls, but 2
//!   to 4 % less of the wall has a point in real scans whose places are not fitted.
//! - To turn lone points as well: 0.5 % more of the points near walls, 0.7 % less coverage.
//! - Walls ([`walls()`](super::walls())) of points that are turned: as many are right, but 1 % less
//!   of the wall is found, and twice as many of round things are taken for walls.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use super::Sight;
use crate::units::{count, floored};

/// The steps in which a point is turned, radians, and how many to each side: less than half a cone.
const STEP_RAD: f64 = 2.5 * (PI / 180.0);
const STEPS: i32 = 4;
/// Cells that arcs cross in, metres.
const CELL_M: f64 = 0.015;
/// Directions that echoes come from.
const SIDES: usize = 8;
/// A side agrees with this number of arcs, and in part with fewer.
const AGREED: f64 = 8.0;
/// This number of sides more has to agree elsewhere for a point to go there.
const MORE: f64 = 1.0;
/// Where no more points than this are in a square and the eight around it, one may be all that its
/// piece of wall has, and stays; and the square's side, metres.
const LONE: u32 = 12;
const SQUARE_M: f64 = 0.05;

/// Of each sight, where its point lies by what the others say. Sights of several robots may be
/// mixed.
#[must_use]
pub fn crossings(sights: &[Sight]) -> Vec<[f64; 2]> {
    let arcs: Vec<Arc> = sights.iter().map(Arc::of).collect();
    let mut votes: BTreeMap<[i32; 2], [u16; SIDES]> = BTreeMap::new();
    let mut squares: BTreeMap<[i32; 2], u32> = BTreeMap::new();
    for arc in &arcs {
        for place in arc.places() {
            let vote = &mut votes.entry(cell(place, CELL_M)).or_default()[arc.side];
            *vote = vote.saturating_add(1);
        }
        *squares.entry(cell(arc.at_m, SQUARE_M)).or_default() += 1;
    }
    let agreeing = |place: [f64; 2]| {
        let mut arcs = [0.0; SIDES];
        for (near, share) in around(cell(place, CELL_M)) {
            let votes = votes.get(&near).into_iter().flatten();
            arcs.iter_mut().zip(votes).for_each(|(arcs, vote)| *arcs += share * f64::from(*vote));
        }
        arcs.iter().map(|arcs| (arcs / AGREED).min(1.0)).sum::<f64>()
    };
    let is_lone = |at_m: [f64; 2]| {
        let near = around(cell(at_m, SQUARE_M)).filter_map(|(near, _)| squares.get(&near));
        near.sum::<u32>() <= LONE
    };
    let crossing = |arc: &Arc| {
        if is_lone(arc.at_m) {
            return arc.at_m;
        }
        let sides = arc.places().map(|place| (agreeing(place), place));
        let most = sides.max_by(|(one, _), (other, _)| one.total_cmp(other));
        let more = most.filter(|(sides, _)| *sides > agreeing(arc.at_m) + MORE);
        more.map_or(arc.at_m, |(_, place)| place)
    };
    arcs.iter().map(crossing).collect()
}

/// Where an echo may have come from.
#[derive(Debug, Clone, Copy)]
struct Arc {
    from_m: [f64; 2],
    at_m: [f64; 2],
    side: usize,
}

impl Arc {
    fn of(&Sight { from_m, at_m }: &Sight) -> Self {
        let direction_rad = libm::atan2(at_m[1] - from_m[1], at_m[0] - from_m[0]);
        let side = floored((direction_rad + PI) / TAU * count(SIDES));
        Self { from_m, at_m, side: usize::try_from(side).unwrap_or(0).min(SIDES - 1) }
    }

    /// From both ends to the middle: of places that are as good the last is turned least.
    fn places(&self) -> impl Iterator<Item = [f64; 2]> {
        let [x_m, y_m] = [0, 1].map(|axis| self.at_m[axis] - self.from_m[axis]);
        (0..=2 * STEPS).map(move |place| {
            let aside = STEPS - place / 2;
            let step = if place % 2 == 0 { aside } else { -aside };
            let (sin, cos) = libm::sincos(f64::from(step) * STEP_RAD);
            [self.from_m[0] + x_m * cos - y_m * sin, self.from_m[1] + x_m * sin + y_m * cos]
        })
    }
}

fn cell(place: [f64; 2], side_m: f64) -> [i32; 2] {
    place.map(|m| floored(m / side_m))
}

/// A cell and the eight around it, with how much of each counts.
fn around([column, row]: [i32; 2]) -> impl Iterator<Item = ([i32; 2], f64)> {
    let steps = [(-1, 0.5), (0, 1.0), (1, 0.5)];
    steps.into_iter().flat_map(move |(up, share)| {
        steps.map(move |(aside, also)| {
            ([column.saturating_add(aside), row.saturating_add(up)], share * also)
        })
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A place that is a metre away, as seen from directions: each a little beside it, as a tangent
    /// has it.
    fn seen(at_m: [f64; 2], directions_deg: &[f64]) -> Vec<Sight> {
        let sights = directions_deg.iter().flat_map(|direction_deg| {
            let (sin, cos) = libm::sincos(direction_deg.to_radians());
            let from_m = [at_m[0] + cos, at_m[1] + sin];
            let beside = move |step: i32| {
                let (aside_m, back_m) = (0.01 * f64::from(step), 0.5e-4 * f64::from(step * step));
                [at_m[0] - aside_m * sin + back_m * cos, at_m[1] + aside_m * cos + back_m * sin]
            };
            (-12..=12).map(move |step| Sight { at_m: beside(step), from_m })
        });
        sights.collect()
    }

    fn far_m(from: [f64; 2], to: [f64; 2]) -> f64 {
        libm::hypot(to[0] - from[0], to[1] - from[1])
    }

    #[test]
    fn what_several_sides_heard_comes_together() {
        let post = [0.31, -0.22];
        let sights = seen(post, &[10.0, 100.0, 190.0, 280.0]);
        let mean_m = |places: &[[f64; 2]]| {
            places.iter().map(|place| far_m(*place, post)).sum::<f64>() / 100.0
        };
        let before: Vec<[f64; 2]> = sights.iter().map(|sight| sight.at_m).collect();
        let after = crossings(&sights);
        assert!(mean_m(&before) > 0.06 && mean_m(&after) < 0.03, "{}", mean_m(&after));
    }

    #[test]
    fn what_one_side_heard_and_what_is_alone_stay() {
        let one_side = seen([0.0, 0.0], &[40.0]);
        assert_eq!(crossings(&one_side), one_side.iter().map(|s| s.at_m).collect::<Vec<_>>());
        // A few echoes from another side, off the post of the others.
        let mut sights = seen([0.0, 0.0], &[10.0, 100.0, 190.0]);
        let lone = Sight { at_m: [0.16, 0.0], from_m: [0.0, -1.0] };
        sights.push(lone);
        assert_eq!(crossings(&sights).last(), Some(&lone.at_m));
    }

    #[test]
    fn a_wall_stays_where_it_is() {
        // Each piece heard squarely, and 40° from either side: arcs that leave the wall.
        let sights: Vec<Sight> = (0..450)
            .map(|step| {
                let (along_m, place) = (0.01 * f64::from(step % 150), step / 150 - 1);
                let at_m = [along_m, 0.003 * f64::from(step % 3)];
                Sight { at_m, from_m: [along_m + 0.5 * f64::from(place), 0.6] }
            })
            .collect();
        for (sight, place) in sights.iter().zip(crossings(&sights)) {
            assert!((place[1] - sight.at_m[1]).abs() < 0.02, "{sight:?} {place:?}");
        }
    }

    proptest! {
        #[test]
        fn any_numbers_are_survived_and_points_stay_on_their_arcs(
            numbers in prop::collection::vec((any::<f64>(), any::<f64>(), -0.1..0.1, -0.1..0.1), 40)
        ) {
            let sights: Vec<Sight> = numbers
                .iter()
                .flat_map(|&(x, y, a, b)| {
                    let sight = |at_m, from_m| Sight { at_m, from_m };
                    [sight([x, y], [a, b]), sight([a, b], [1.0, a])]
                })
                .collect();
            let places = crossings(&sights);
            prop_assert_eq!(places.len(), sights.len());
            for (sight, place) in sights.iter().zip(places) {
                let [before_m, after_m] = [sight.at_m, place].map(|at_m| far_m(sight.from_m, at_m));
                let is_same = (before_m - after_m).abs() < 1e-9 * before_m.max(1.0);
                prop_assert!(is_same || !before_m.is_finite(), "{:?} {:?}", sight, place);
            }
        }
    }
}
