//! What of the map is near around the robot.
//!
//! A cell is as wide as the room that is left beside a robot in a narrow place. So the planner
//! keeps where in its cell a point of the map lies, and tells those that are near: by them a robot
//! steers past things, and gets away from them before it turns on the spot
//! ([`crate::behavior::navigation`]). Beams that pass take none away, as they do of the planner's
//! evidence: one that passes beside the end of a wall has not gone through it.

use arrayvec::ArrayVec;

use super::layer::Place;
use super::survey::Survey;
use crate::mapping::Pose;

/// The most points that are told.
const MOST: usize = 48;
/// So near to the middle of a robot is no point, metres: its body is there.
const BODY_M: f64 = 0.08;
/// A cell is this number of parts wide and high.
const PARTS: u8 = 15;

/// The points of the map that are near, as seen from the robot.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Clearance {
    points: ArrayVec<[f64; 2], MOST>,
}

impl Clearance {
    /// How far each point is ahead of the robot's middle and to the left of it, metres.
    pub fn points(&self) -> impl Iterator<Item = [f64; 2]> {
        self.points.iter().copied()
    }

    #[cfg(test)]
    pub(crate) fn of(points: &[[f64; 2]]) -> Self {
        Self { points: points.iter().copied().collect() }
    }
}

/// For each cell, where in it the last point lies that was heard from near.
#[derive(Debug, Clone)]
pub(super) struct Points {
    /// 0 where there is none; else the part's column in the lower half of the bits, and its row in
    /// the upper one, both from 1.
    parts: Vec<u8>,
}

impl Points {
    pub(super) fn new(cells: usize) -> Self {
        Self { parts: vec![0; cells] }
    }

    pub(super) fn add(&mut self, survey: &Survey, at_m: [f64; 2]) {
        let Some(place) = survey.place(at_m[0], at_m[1]) else { return };
        let corner_m = survey.corner_m(place);
        let [column, row] = [0, 1].map(|axis| {
            let cells = (at_m[axis] - corner_m[axis]) / survey.cell_m();
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "it is within its cell"
            )]
            let part = (cells * f64::from(PARTS)) as u8;
            1 + part.min(PARTS - 1)
        });
        self.set(survey, place, row << 4 | column);
    }

    fn set(&mut self, survey: &Survey, place: Place, parts: u8) {
        if let Some(known) = self.parts.get_mut(usize::from(survey.index(place))) {
            *known = parts;
        }
    }

    fn at_m(&self, survey: &Survey, place: Place) -> Option<[f64; 2]> {
        let parts = self.parts.get(usize::from(survey.index(place))).copied()?;
        let part_m = survey.cell_m() / f64::from(PARTS);
        let [x_m, y_m] = survey.corner_m(place);
        let middle_m = |part: u8| (f64::from(part) - 0.5) * part_m;
        (parts != 0).then(|| [x_m + middle_m(parts & 15), y_m + middle_m(parts >> 4)])
    }

    /// The robot stands there, so nothing else does.
    pub(super) fn stand(&mut self, survey: &Survey, pose: &Pose) {
        let near: ArrayVec<Place, MOST> =
            self.near(survey, pose, BODY_M).map(|(place, _)| place).take(MOST).collect();
        for place in near {
            self.set(survey, place, 0);
        }
    }

    /// Forgets those in cells that the robot once stood in.
    pub(super) fn doubt(&mut self, survey: &Survey) {
        for (index, parts) in (0..u16::MAX).zip(&mut self.parts) {
            if survey.stood.has(survey.place_of(index)) {
                *parts = 0;
            }
        }
    }

    pub(super) fn clearance(&self, survey: &Survey, pose: &Pose, within_m: f64) -> Clearance {
        let (sin, cos) = libm::sincos(pose.heading_rad);
        let seen = |[x_m, y_m]: [f64; 2]| [cos * x_m + sin * y_m, cos * y_m - sin * x_m];
        let near = self.near(survey, pose, within_m).map(|(_, from_m)| seen(from_m));
        Clearance { points: near.take(MOST).collect() }
    }

    /// The points within a distance of a pose, as cells and as vectors from it in the world.
    fn near(
        &self,
        survey: &Survey,
        pose: &Pose,
        within_m: f64,
    ) -> impl Iterator<Item = (Place, [f64; 2])> {
        let middle = survey.place(pose.x_m, pose.y_m);
        let reach = survey.cells_within(within_m);
        let cells = middle.into_iter().flat_map(move |middle| middle.square(reach));
        cells.filter_map(move |place| {
            let [x_m, y_m] = self.at_m(survey, place)?;
            let from_m = [x_m - pose.x_m, y_m - pose.y_m];
            let is_near = from_m[0] * from_m[0] + from_m[1] * from_m[1] < within_m * within_m;
            is_near.then_some((place, from_m))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::OccupancyGrid;
    use crate::units::radians;
    use proptest::prelude::*;

    const START: Pose = Pose { x_m: 0.0, y_m: 0.0, heading_rad: 0.0 };

    fn nothing() -> (Survey, Points) {
        let grid = OccupancyGrid::around(&START);
        (Survey::new(&grid).unwrap(), Points::new(grid.columns() * grid.rows()))
    }

    fn far_m([x_m, y_m]: [f64; 2], [to_x_m, to_y_m]: [f64; 2]) -> f64 {
        libm::hypot(x_m - to_x_m, y_m - to_y_m)
    }

    proptest! {
        /// A cell's parts are 3.3 mm wide: the middle of one is within 2.4 mm of a point in it.
        #[test]
        fn a_point_is_told_where_it_is_as_seen_from_the_robot(
            at_m in [-2.0..2.0_f64, -2.0..2.0],
            way_m in 0.0..0.14_f64,
            bearing_rad in -3.1..3.1_f64,
            heading_rad in -9.0..9.0_f64,
        ) {
            let (survey, mut points) = nothing();
            points.add(&survey, at_m);
            let (sin, cos) = libm::sincos(heading_rad + bearing_rad);
            let pose = Pose { x_m: at_m[0] - way_m * cos, y_m: at_m[1] - way_m * sin, heading_rad };
            let told: Vec<_> = points.clearance(&survey, &pose, 0.15).points().collect();
            let [point] = told[..] else { panic!("{told:?}") };
            let (sin, cos) = libm::sincos(bearing_rad);
            prop_assert!(far_m(point, [way_m * cos, way_m * sin]) < 0.0024, "{point:?}");
        }
    }

    #[test]
    fn the_last_point_of_a_cell_counts_and_none_where_the_robot_stood() {
        let (mut survey, mut points) = nothing();
        let here = Pose { heading_rad: radians(90.0), ..START };
        for at_m in [[0.11, 0.01], [0.14, 0.04], [-0.07, 0.01], [0.3, 0.0]] {
            points.add(&survey, at_m);
        }
        let told: Vec<_> = points.clearance(&survey, &here, 0.15).points().collect();
        let [nearer, last] = told[..] else { panic!("{told:?}") };
        assert!(far_m(nearer, [0.01, 0.07]) < 0.0024, "{nearer:?}");
        assert!(far_m(last, [0.04, -0.14]) < 0.0024, "{last:?}");

        points.stand(&survey, &here);
        assert_eq!(points.clearance(&survey, &here, 0.15).points().count(), 1);

        // What is doubted is only what lies where it once stood.
        points.doubt(&survey);
        assert_eq!(points.clearance(&survey, &here, 0.15).points().count(), 1);
        let place = survey.place(0.14, 0.04).unwrap();
        survey.stand(place, 0);
        points.doubt(&survey);
        assert_eq!(points.clearance(&survey, &here, 0.15).points().count(), 0);
        let there = Pose { x_m: 0.3, ..START };
        assert_eq!(points.clearance(&survey, &there, 0.15).points().count(), 1);
    }
}
