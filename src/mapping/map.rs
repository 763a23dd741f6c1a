//! Points, path and grid of one robot.
//!
//! The grid is drawn as the readings come, and once more at the run's end: each reading and each
//! point where it is as it is known then (`keyframes`), what has echoed is freed slowly, where many
//! points lie something stands, and behind that nothing is seen (`grid`). Exploring with the usual
//! errors, 10 to 20 runs a world, 80 in rooms that chance draws; % of the occupied cells that are
//! within 5 cm of a wall, and of the wall that is within 5 cm of an occupied cell:
//!
//! | | `arena` | `rooms` | a passage | pillars | drawn by chance |
//! |---|---|---|---|---|---|
//! | once more | 93, 64 | 88, 73 | 86, 81 | 85, 69 | 87, 80 |
//! | and where many points lie | 89, 88 | 86, 95 | 84, 95 | 81, 87 | 85, 94 |
//! | and nothing behind that | 92, 92 | 91, 97 | 92, 97 | 86, 91 | 89, 97 |
//! | many are 0.4 of the mean, not 0.7 | 85, 93 | 89, 99 | 80, 95 | 78, 93 | 87, 98 |
//!
//! The last line is of two runs a world. As drawn on the way it was 39 to 52 % of the wall, of
//! other runs. Of the free cells that are not at a wall 0.4 to 2 % are behind one, where it was 46
//! to 60 % (two runs a world), and 95 to 98 % of the floor is free, for 98 to 99.
//! `ONBRICK_LONG=1 cargo test --test it figures_of_explore -- --nocapture` prints the third line.
//! What stood for long and then went away stays in it, as it does among the points, unless the
//! robot drove there. After five minutes it takes 43 million instructions on x86-64 (`valgrind
//! --tool=callgrind --toggle-collect='onbrick::mapping::map::drawn*' onbrick replay run.mcap`):
//! some tenths of a second on a brick, after the robot has stopped, estimated and not measured.
//!
//! # Not here
//!
//! Cones and log-odds (`grid`). Where a reading is as it is known now (`keyframes`).

use super::cloud::{Cloud, Path, Thinned};
use super::grid::Standing;
use super::keyframes::point_now;
use super::{
    Estimate, Keyframe, MapPoint, OccupancyGrid, Placed, Pose, RangeMount, Sounding, points_now,
};
use crate::units::bounds;

/// Points kept: ten a second for half an hour, at 24 bytes.
const POINTS: usize = 20_000;
/// Places of the path kept: 150 m of way, a centimetre apart, at 24 bytes.
const PLACES: usize = 15_000;

/// Readings kept, for the grid to be drawn once more: ten a second for a quarter of an hour, at 88
/// bytes.
const SOUNDINGS: usize = 10_000;

/// What one robot has found: points, path and occupancy grid, bounded in memory for a mission of
/// any length.
#[derive(Debug, Clone)]
pub struct Map {
    points: Cloud,
    path: Path,
    grid: OccupancyGrid,
    soundings: Thinned<Sounding>,
    range_max_m: f64,
}

impl Map {
    /// An empty map with all its memory; the grid is centred on the start.
    #[must_use]
    pub fn new(range: &RangeMount, start: &Pose) -> Self {
        Self {
            points: Cloud::new(POINTS),
            path: Path::new(PLACES),
            grid: OccupancyGrid::around(start),
            soundings: Thinned::new(SOUNDINGS),
            range_max_m: range.max_m,
        }
    }

    /// The same map with another grid, which has seen nothing yet.
    #[must_use]
    pub fn with_grid(mut self, grid: OccupancyGrid) -> Self {
        self.grid = grid;
        self
    }

    /// Takes one update; returns the points that now have their place. Every point is returned,
    /// also one that the thinned cloud does not keep.
    pub fn add(&mut self, estimate: &Estimate) -> Placed {
        self.path.offer(estimate.time_ns, &estimate.pose);
        self.grid.take(estimate, self.range_max_m);
        let mut placed = estimate.placed;
        if let Some(sounding) = estimate.sounding.filter(|sounding| sounding.fresh) {
            self.soundings.offer(sounding);
        }
        if let Some(sounding) = &estimate.sounding
            && let Some(point) = sounding.point(self.range_max_m)
        {
            if sounding.waits {
                self.points.expect(point);
            } else {
                placed.push(point);
            }
        }
        for point in placed.iter() {
            self.points.place(*point);
        }
        placed
    }

    /// Ends the map: takes the points that waited, and draws the grid once more, each reading and
    /// point that was kept where it is as it is known now. Without keyframes it stays as it is.
    pub fn finish(&mut self, points: &[MapPoint], keyframes: &[Keyframe]) {
        for point in points {
            self.grid.hit(point);
            self.points.place(*point);
        }
        self.points.finish();
        if !keyframes.is_empty() {
            self.grid = drawn(&self.grid, &[(self, keyframes)]);
        }
    }

    /// The points, in the order of their time. Until [`Map::finish`] those at the end may still
    /// wait for their place: the sweep that they are of is not over.
    #[must_use]
    pub fn points(&self) -> &[MapPoint] {
        self.points.all()
    }

    /// One of this many points found is kept: 1 until the cloud was full for the first time.
    #[must_use]
    pub fn points_stride(&self) -> u64 {
        self.points.stride()
    }

    /// The way the robot took, in the order of time.
    #[must_use]
    pub fn path(&self) -> &[MapPoint] {
        self.path.places()
    }

    /// The occupancy grid.
    #[must_use]
    pub fn grid(&self) -> &OccupancyGrid {
        &self.grid
    }
}

/// One grid of several robots' maps, after their runs: `None` where there are none, or it is too
/// large ([`OccupancyGrid::covering`]).
///
/// - `maps`: each with the keyframes that move it into the grid's frame.
#[must_use]
pub fn joint_grid(maps: &[(&Map, &[Keyframe])]) -> Option<OccupancyGrid> {
    let [low_m, high_m] = bounds(path_now(maps).map(|place| [place.x_m, place.y_m]));
    Some(drawn(&OccupancyGrid::covering(low_m, high_m)?, maps))
}

/// Where the robots were.
fn path_now(maps: &[(&Map, &[Keyframe])]) -> impl Iterator<Item = MapPoint> {
    maps.iter()
        .flat_map(|(map, keyframes)| map.path().iter().map(|place| point_now(keyframes, place)))
}

/// What was heard, drawn once more over the places of a grid.
fn drawn(places: &OccupancyGrid, maps: &[(&Map, &[Keyframe])]) -> OccupancyGrid {
    let mut grid = places.to_draw();
    let points: Vec<Vec<MapPoint>> =
        maps.iter().map(|(map, keyframes)| points_now(keyframes, map.points())).collect();
    let standing = Standing::of(&grid, points.iter().flatten(), path_now(maps));
    for ((map, keyframes), points) in maps.iter().zip(&points) {
        let mut to_come = points.iter().peekable();
        for sounding in map.soundings.kept() {
            let now = sounding.now(keyframes);
            while let Some(point) = to_come.next_if(|point| point.time_ns <= sounding.time_ns) {
                if point.time_ns < sounding.time_ns || standing.is_in_sight(&now, point) {
                    grid.hit(point);
                }
            }
            grid.add(&now, map.range_max_m.min(standing.sight_m(&now)));
        }
        to_come.for_each(|point| grid.hit(point));
    }
    grid.stand(&standing);
    grid
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::{Cell, Events, Range};
    use crate::units::radians;

    const FOUND: MapPoint = MapPoint { time_ns: 0, x_m: 1.02, y_m: 0.02 };

    /// Looks along x from the origin, four echoes at a metre.
    fn looked() -> Map {
        heard(&[1.0; 4])
    }

    fn heard(ranges_m: &[f64]) -> Map {
        let mut map = Map::new(&RangeMount::default(), &Pose::default());
        for (time_ns, range_m) in (0..).zip(ranges_m) {
            let sounding = Sounding {
                time_ns,
                beam: [1.0, 0.0],
                echo: [1.0, 0.0],
                half_cone_rad: 0.21,
                range: Range::Echo(*range_m),
                fresh: true,
                waits: true,
                ..Sounding::default()
            };
            map.add(&Estimate {
                time_ns,
                pose: Pose::default(),
                forward_m_s: 0.0,
                turn_rad_s: 0.0,
                covariance: [0.0; 6],
                travelled_m: 0.0,
                range: None,
                sounding: Some(sounding),
                placed: Placed::default(),
                events: Events::default(),
            });
        }
        map
    }

    fn turned(deg: f64) -> [Keyframe; 1] {
        let now = Pose { heading_rad: radians(deg), ..Pose::default() };
        [Keyframe { time_ns: 0, placed: Pose::default(), now }]
    }

    #[test]
    fn the_grid_is_where_the_way_was_corrected_to() {
        let mut map = looked();
        map.finish(&[FOUND], &turned(90.0));
        assert_eq!(map.grid().at(-0.02, 1.02), Cell::Occupied);
        assert_eq!(map.grid().at(0.0, 0.5), Cell::Free);
        assert_eq!(map.grid().at(1.02, 0.02), Cell::Unknown);
        assert_eq!(map.grid().at(0.5, 0.0), Cell::Unknown);
        assert_eq!(map.points(), [FOUND], "points stay where they were placed");
    }

    #[test]
    fn behind_what_stands_nothing_is_seen_and_no_echo_counts() {
        let mut map = heard(&[[1.0; 4], [1.8; 4], [1.8; 4]].concat());
        let beyond = MapPoint { time_ns: 4, x_m: 1.82, y_m: 0.02 };
        let wall = (0..4).map(|time_ns| MapPoint { time_ns, ..FOUND });
        map.finish(&wall.chain([beyond]).collect::<Vec<_>>(), &turned(0.0));
        let cells = [0.5, 1.02, 1.5, 1.82].map(|x_m| map.grid().at(x_m, 0.02));
        assert_eq!(cells, [Cell::Free, Cell::Occupied, Cell::Unknown, Cell::Unknown]);
    }

    #[test]
    fn what_waits_in_vain_is_none_of_the_map() {
        let mut map = looked();
        assert_eq!(map.points().len(), 4);
        map.finish(&[], &turned(0.0));
        assert_eq!(map.points(), []);
        assert_eq!(map.grid().at(0.5, 0.0), Cell::Free);
    }
}
