//! Points, path and grid of one robot, and several robots' maps together.

use super::cloud::{Cloud, Path};
use super::{Estimate, MapPoint, OccupancyGrid, Placed, Pose, RangeMount};

/// Points kept: ten a second for half an hour, at 24 bytes.
const POINTS: usize = 20_000;
/// Places of the path kept: 150 m of way, a centimetre apart, at 24 bytes.
const PLACES: usize = 15_000;

/// What one robot has found: points, path and occupancy grid, bounded in memory for a mission of
/// any length.
#[derive(Debug, Clone)]
pub struct Map {
    points: Cloud,
    path: Path,
    grid: OccupancyGrid,
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

    /// Takes the points that waited when the run ended.
    pub fn finish(&mut self, points: &[MapPoint]) {
        for point in points {
            self.grid.hit(point);
            self.points.place(*point);
        }
    }

    /// The points, in the order of their time. Those at the end may still wait for their place: the
    /// sweep that they are of is not over.
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

/// Several robots' points one after the other in one frame, as the seed's master did it.
///
/// Each robot's points are in a frame of which `Pose` is the place in the common one: where the
/// robot started, if it counted from its own start, and `Pose::default()`, if it was told its start
/// pose (`--pose`) and its points are in the common frame already.
#[must_use]
pub fn merge(maps: &[(Pose, &[MapPoint])]) -> Vec<MapPoint> {
    maps.iter()
        .flat_map(|(start, points)| {
            let to_common = start.body_to_world();
            points.iter().map(move |point| {
                let placed = to_common * nalgebra::Point2::new(point.x_m, point.y_m);
                MapPoint { time_ns: point.time_ns, x_m: placed.x, y_m: placed.y }
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    #[test]
    fn the_seeds_second_robot_at_3_0_turned_left_finds_its_points_to_the_left() {
        let point = MapPoint { time_ns: 7, x_m: 1.0, y_m: 0.0 };
        let second = Pose { x_m: 3.0, y_m: 0.0, heading_rad: FRAC_PI_2 };
        let both = merge(&[(Pose::default(), &[point]), (second, &[point])]);
        assert_eq!(both[0], point);
        assert_eq!(both[1].time_ns, 7);
        assert!((both[1].x_m - 3.0).abs() < 1e-12 && (both[1].y_m - 1.0).abs() < 1e-12, "{both:?}");
        assert!(merge(&[]).is_empty());
    }
}
