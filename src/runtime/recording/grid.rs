//! An occupancy grid as `nav_msgs/OccupancyGrid`.

use super::Grid;
use super::message::{Header, OccupancyGridMessage, Pose3, Quaternion, Vector3};
use crate::mapping::OccupancyGrid;

impl From<&OccupancyGrid> for Grid {
    /// Cells as ROS counts them: −1 where nothing is known, else the probability in percent that it is occupied.
    fn from(grid: &OccupancyGrid) -> Self {
        let size = |cells: usize| u32::try_from(cells).unwrap_or(u32::MAX);
        let cells = (0..grid.rows())
            .flat_map(|row| (0..grid.columns()).map(move |column| percent(grid, column, row)));
        Self {
            width: size(grid.columns()),
            height: size(grid.rows()),
            resolution_m: grid.cell_m(),
            origin_m: grid.origin_m(),
            cells: cells.collect(),
        }
    }
}

impl Grid {
    /// True where a place of the world, metres, is in the grid.
    #[must_use]
    pub fn has(&self, x_m: f64, y_m: f64) -> bool {
        let [from_x_m, from_y_m] = self.origin_m;
        let side_m = |cells: u32| f64::from(cells) * self.resolution_m;
        (from_x_m..from_x_m + side_m(self.width)).contains(&x_m)
            && (from_y_m..from_y_m + side_m(self.height)).contains(&y_m)
    }
}

fn percent(grid: &OccupancyGrid, column: usize, row: usize) -> i8 {
    if grid.log_odds(column, row).is_none_or(|log_odds| log_odds == 0) {
        return -1;
    }
    let probability = grid.probability(column, row).unwrap_or(0.5);
    #[expect(clippy::cast_possible_truncation, reason = "a probability is 0 to 100 percent")]
    let percent = libm::round(probability * 100.0) as i8;
    percent
}

#[expect(clippy::cast_possible_truncation, reason = "the definition has single precision")]
pub(super) fn message(grid: &Grid, header: Header) -> OccupancyGridMessage {
    let [x, y] = grid.origin_m;
    OccupancyGridMessage {
        map_load_time: header.stamp,
        header,
        resolution: grid.resolution_m as f32,
        width: grid.width,
        height: grid.height,
        origin: Pose3 { position: Vector3 { x, y, z: 0.0 }, orientation: Quaternion::of_yaw(0.0) },
        data: grid.cells.clone(),
    }
}

/// The grid of a message; `None` where its sizes contradict each other.
pub(super) fn grid(message: OccupancyGridMessage) -> Option<Grid> {
    let cells = u64::from(message.width) * u64::from(message.height);
    let grid = Grid {
        width: message.width,
        height: message.height,
        resolution_m: rounded(message.resolution),
        origin_m: [message.origin.position.x, message.origin.position.y],
        cells: message.data,
    };
    let possible = grid.resolution_m > 0.0 && grid.resolution_m.is_finite();
    (possible && cells == grid.cells.len() as u64).then_some(grid)
}

/// The shortest decimal number that single precision has for a value: 0.05, and not 0.0500000007.
fn rounded(single: f32) -> f64 {
    single.to_string().parse().unwrap_or_else(|_| f64::from(single))
}
