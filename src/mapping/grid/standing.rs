//! Where something stands for certain in a map that is drawn after the run, and what it hides.
//!
//! # Not here
//!
//! Which points are of what stands, by what contradicts them ([`crate::mapping::standing()`]): this
//! counts points in cells.
//!
//! # What was tried
//!
//! Exploring with two seeds a world: a reading that sees no further than its axis leaves a seam of
//! free cells behind walls that are met obliquely. One that sees to what stands and no cell further
//! frees 2 % less of the floor, along the walls.

use super::{CELL_M, Cell, OccupancyGrid, REACH_M, integer, lattice};
use crate::mapping::{MapPoint, Sounding};

/// The fewest points in a cell that make it occupied, and the fewest tenths of the mean of the
/// cells that have any; `map` has the figures.
const FEWEST: u16 = 2;
const FEWEST_TENTHS: u64 = 7;

/// Parts of a cell in which a line of sight is followed, two steps a cell.
const PARTS: i32 = 1024;
const STEP_M: f64 = CELL_M / 2.0;
/// What is nearer to the sensor than this number of steps hides nothing.
const FIRST: i32 = 4;

/// The cells of a grid in which something stands for certain, occupied, or nothing, free.
#[derive(Debug)]
pub(in crate::mapping) struct Standing {
    first: [i32; 2],
    columns: usize,
    cells: Vec<Cell>,
}

impl Standing {
    /// Where many of these points lie, in cells of the grid, whatever went through them: a wall
    /// that is met obliquely has no echo, and the beam frees it. Many are [`FEWEST`], and
    /// [`FEWEST_TENTHS`] of the mean of the cells that have any: where more was heard, more of it
    /// is out of place. On the robot's path, and a cell beside it, nothing does.
    pub(in crate::mapping) fn of<'p>(
        grid: &OccupancyGrid,
        points: impl Iterator<Item = &'p MapPoint>,
        path: impl Iterator<Item = MapPoint>,
    ) -> Self {
        let mut counts = vec![0_u16; grid.cells.len()];
        for point in points {
            let count = grid.index(point.x_m, point.y_m).and_then(|place| counts.get_mut(place));
            if let Some(count) = count {
                *count = count.saturating_add(1);
            }
        }
        let all: u64 = counts.iter().map(|count| u64::from(*count)).sum();
        let cells = counts.iter().map(|count| u64::from((*count).min(1))).sum::<u64>();
        let stands =
            |count: &u16| *count >= FEWEST && 10 * u64::from(*count) * cells >= FEWEST_TENTHS * all;
        let cell = |count: &u16| if stands(count) { Cell::Occupied } else { Cell::Unknown };
        let mut cells: Vec<Cell> = counts.iter().map(cell).collect();
        for MapPoint { x_m, y_m, .. } in path {
            let around = [-CELL_M, 0.0, CELL_M];
            for (dx_m, dy_m) in around.iter().flat_map(|dx| around.map(|dy| (*dx, dy))) {
                let cell = grid.index(x_m + dx_m, y_m + dy_m);
                if let Some(cell) = cell.and_then(|place| cells.get_mut(place)) {
                    *cell = Cell::Free;
                }
            }
        }
        Self { first: grid.first, columns: grid.columns, cells }
    }

    /// Row by row, as the grid's.
    pub(super) fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// How far a reading sees before something stands in its way, on its axis and at both edges of
    /// its cone, metres.
    pub(in crate::mapping) fn sight_m(&self, sounding: &Sounding) -> f64 {
        let (sin, cos) = libm::sincos(sounding.half_cone_rad);
        let [x, y] = sounding.beam;
        let edge = |sin: f64| [x * cos - y * sin, x * sin + y * cos];
        let rays = [sounding.beam, edge(sin), edge(-sin)];
        let far_m = rays.map(|ray| self.far_m(sounding, ray));
        far_m.into_iter().fold(f64::INFINITY, f64::min) + CELL_M
    }

    /// Whether a reading's echo can lie at a place: from behind something that stands it has come
    /// by a detour.
    pub(in crate::mapping) fn is_in_sight(&self, sounding: &Sounding, point: &MapPoint) -> bool {
        let [x_m, y_m] = [point.x_m - sounding.x_m, point.y_m - sounding.y_m];
        let point_m = libm::hypot(x_m, y_m);
        self.far_m(sounding, [x_m / point_m, y_m / point_m]) > point_m - CELL_M
    }

    /// How far something stands in a direction from where a reading was taken, metres; infinite
    /// where nothing does.
    fn far_m(&self, sounding: &Sounding, direction: [f64; 2]) -> f64 {
        let from_m = [sounding.x_m, sounding.y_m];
        let from = [0, 1].map(|axis| {
            let cell = lattice(from_m[axis]);
            let within = (from_m[axis] / CELL_M - f64::from(cell)).clamp(0.0, 1.0);
            (cell - self.first[axis]) * PARTS + integer(within * f64::from(PARTS))
        });
        let step = direction.map(|part| integer(part * f64::from(PARTS / 2)));
        let most = integer(REACH_M / STEP_M);
        let stands = |steps: &i32| {
            let [column, row] =
                [0, 1].map(|axis| (from[axis] + steps * step[axis]).div_euclid(PARTS));
            let place = usize::try_from(column).ok().zip(usize::try_from(row).ok());
            let place = place.filter(|(column, _)| *column < self.columns);
            let place = place.map(|(column, row)| row * self.columns + column);
            place
                .and_then(|place| self.cells.get(place))
                .is_some_and(|cell| *cell == Cell::Occupied)
        };
        (FIRST..most).find(stands).map_or(f64::INFINITY, |steps| f64::from(steps) * STEP_M)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::sounding;
    use super::*;
    use crate::mapping::{Pose, Range};

    fn point(x_m: f64, y_m: f64) -> MapPoint {
        MapPoint { time_ns: 0, x_m, y_m }
    }

    /// Across x, a metre ahead of the origin.
    fn wall(path: &[MapPoint]) -> Standing {
        let grid = OccupancyGrid::around(&Pose::default());
        let points: Vec<MapPoint> =
            (-20..20).map(|at| point(1.02, f64::from(at) * 0.02 + 0.01)).collect();
        Standing::of(&grid, points.iter(), path.iter().copied())
    }

    #[test]
    fn where_many_points_lie_something_stands_whatever_went_through_it() {
        let mut grid = OccupancyGrid::around(&Pose::default()).to_draw();
        let wall: Vec<MapPoint> = (0..12).map(|at| point(1.02, f64::from(at / 4) * 0.05)).collect();
        let stray = [[0.52, 0.0], [0.52, 0.05], [0.52, 0.05], [0.52, 0.05], [99.0, 0.0]]
            .map(|[x_m, y_m]| point(x_m, y_m));
        let beyond = sounding(0.0, 0.0, 0.0, Range::Echo(1.8));
        (0..40).for_each(|_| grid.add(&beyond, 2.0));
        let at = |grid: &OccupancyGrid| {
            [[1.02, 0.0], [1.02, 0.1], [0.52, 0.0], [0.52, 0.05]].map(|[x, y]| grid.at(x, y))
        };
        assert_eq!(at(&grid), [Cell::Free; 4]);
        grid.stand(&Standing::of(&grid, wall.iter().chain(&stray), [].into_iter()));
        let many = [Cell::Occupied, Cell::Occupied, Cell::Free, Cell::Occupied];
        assert_eq!(at(&grid), many, "one is not many");
        grid = grid.to_draw();
        (0..40).for_each(|_| grid.add(&beyond, 2.0));
        let thrice = [&wall, &wall, &wall].into_iter().flatten();
        grid.stand(&Standing::of(&grid, thrice.chain(&stray), [].into_iter()));
        let many = [Cell::Occupied, Cell::Occupied, Cell::Free, Cell::Free];
        assert_eq!(at(&grid), many, "nor are three, where others have twelve");
    }

    #[test]
    fn a_wall_ends_the_sight_of_any_part_of_the_cone_where_it_begins() {
        let sight_m = |direction_rad: f64| {
            wall(&[]).sight_m(&sounding(0.0, 0.0, direction_rad, Range::NoEcho))
        };
        assert!((1.0..1.1).contains(&sight_m(0.0)), "{} m", sight_m(0.0));
        // Half of the cone is 0.21.
        for beside_rad in [-0.5, 0.5] {
            assert!((1.0..1.15).contains(&sight_m(beside_rad)), "{} m", sight_m(beside_rad));
        }
        for away_rad in [-0.7, 0.7, 3.1] {
            assert!(sight_m(away_rad).is_infinite(), "{away_rad}");
        }
    }

    #[test]
    fn what_a_wall_hides_is_out_of_sight_and_the_wall_is_not() {
        let sees = |x_m: f64, y_m: f64| {
            wall(&[]).is_in_sight(&sounding(0.0, 0.0, 0.0, Range::Echo(1.0)), &point(x_m, y_m))
        };
        for (x_m, y_m) in [(0.0, 0.0), (0.5, 0.1), (1.0, 0.0), (1.04, 0.1), (1.2, 0.9)] {
            assert!(sees(x_m, y_m), "{x_m}, {y_m}");
        }
        for (x_m, y_m) in [(1.15, 0.0), (1.6, 0.4), (2.0, -0.2)] {
            assert!(!sees(x_m, y_m), "{x_m}, {y_m}");
        }
    }

    #[test]
    fn where_the_robot_drove_nothing_stands() {
        let driven = wall(&[point(0.98, 0.02), point(1.03, 0.02)]);
        let ahead = sounding(0.0, 0.02, 0.0, Range::Echo(1.0));
        assert!(driven.is_in_sight(&ahead, &point(1.5, 0.02)));
        assert!(!wall(&[]).is_in_sight(&ahead, &point(1.5, 0.02)));
        let mut grid = OccupancyGrid::around(&Pose::default());
        grid.stand(&driven);
        assert_eq!(grid.at(0.98, 0.02), Cell::Free, "though nothing was heard there");
        assert_eq!([grid.at(1.03, 0.22), grid.at(0.5, 0.0)], [Cell::Occupied, Cell::Unknown]);
    }
}
