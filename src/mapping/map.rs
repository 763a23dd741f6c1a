//! Points, path and grid of one robot.

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
