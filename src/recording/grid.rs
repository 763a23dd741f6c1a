//! An occupancy grid as `nav_msgs/OccupancyGrid`.

use std::ops::Range;

use super::message::{Header, OccupancyGridMessage, Pose3, Quaternion, Vector3};
use crate::mapping::{Cell, OccupancyGrid};
use crate::units::count;

/// An occupancy grid.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Grid {
    /// Cells along x.
    pub width: u32,
    /// Cells along y.
    pub height: u32,
    /// A cell's edge, metres.
    pub resolution_m: f64,
    /// The outer corner of the first cell, world frame, metres.
    pub origin_m: [f64; 2],
    /// Row by row along x, from the least y on: −1 unknown, 0 free to 100 occupied.
    pub cells: Vec<i8>,
}

impl From<&OccupancyGrid> for Grid {
    /// Cells as ROS counts them: −1 where nothing is known, 100 where it is occupied, else the
    /// probability of that in percent.
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
    /// The least part with all that is known.
    pub(super) fn trimmed(self) -> Self {
        let width = usize::try_from(self.width).unwrap_or(0).max(1);
        let known =
            || (0..).zip(&self.cells).filter(|(_, cell)| **cell >= 0).map(|(place, _)| place);
        let columns = known().map(|place: usize| place % width);
        let rows = known().map(|place| place / width);
        let (Some(left), Some(right)) = (columns.clone().min(), columns.max()) else { return self };
        let (Some(below), Some(above)) = (rows.clone().min(), rows.max()) else { return self };
        let row = |row: usize| &self.cells[row * width + left..=row * width + right];
        let cells: Vec<i8> = (below..=above).flat_map(row).copied().collect();
        let count = |cells: usize| u32::try_from(cells).unwrap_or(u32::MAX);
        let [x_m, y_m] = self.origin_m;
        let from = |cells: usize| f64::from(count(cells)) * self.resolution_m;
        Self {
            width: count(right - left + 1),
            height: count(above - below + 1),
            resolution_m: self.resolution_m,
            origin_m: [x_m + from(left), y_m + from(below)],
            cells,
        }
    }

    /// True where a place of the world, metres, is in the grid.
    #[must_use]
    pub fn has(&self, x_m: f64, y_m: f64) -> bool {
        let [from_x_m, from_y_m] = self.origin_m;
        let side_m = |cells: u32| f64::from(cells) * self.resolution_m;
        (from_x_m..from_x_m + side_m(self.width)).contains(&x_m)
            && (from_y_m..from_y_m + side_m(self.height)).contains(&y_m)
    }

    /// Whether a cell counts as free: at most 19 percent sure to be occupied, less than Nav2's grey
    /// for "unknown" says.
    pub(crate) fn is_free(cell: i8) -> bool {
        (0..20).contains(&cell)
    }

    /// What is free, as rectangles that do not overlap: two opposite corners each, metres.
    #[must_use]
    pub fn free(&self) -> Vec<[[f64; 2]; 2]> {
        let width = usize::try_from(self.width).unwrap_or(0).max(1);
        let place = |[column, row]: [usize; 2]| {
            let [x_m, y_m] = self.origin_m;
            [x_m + count(column) * self.resolution_m, y_m + count(row) * self.resolution_m]
        };
        // Of each rectangle that the row before ends: its columns, and its first row.
        let mut open: Vec<(Range<usize>, usize)> = Vec::new();
        let mut free = Vec::new();
        let is_free = |cell: &i8| Self::is_free(*cell);
        let rows = self.cells.chunks(width).chain([&[][..]]).enumerate();
        for (row, cells) in rows {
            let mut column = 0;
            let mut next = Vec::new();
            for stretch in cells.chunk_by(|a, b| is_free(a) == is_free(b)) {
                let columns = column..column + stretch.len();
                column = columns.end;
                if stretch.first().is_some_and(is_free) {
                    let before = open.iter().position(|(other, _)| *other == columns);
                    next.push(before.map_or((columns, row), |place| open.swap_remove(place)));
                }
            }
            for (columns, first) in std::mem::replace(&mut open, next) {
                free.push([place([columns.start, first]), place([columns.end, row])]);
            }
        }
        free
    }
}

fn percent(grid: &OccupancyGrid, column: usize, row: usize) -> i8 {
    if grid.log_odds(column, row).is_none_or(|log_odds| log_odds == 0) {
        return -1;
    }
    // Nav2 takes a cell for an obstacle at 100 and at nothing less; the odds stop at 99 percent.
    if grid.cell(column, row) == Cell::Occupied {
        return 100;
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::{collection, prelude::*};

    #[test]
    fn trimmed_a_grid_has_all_that_is_known_at_its_place() {
        let cells = vec![-1, -1, -1, -1, -1, 0, 100, -1, -1, 50, -1, -1, -1, -1, -1, -1];
        let all = Grid { width: 4, height: 4, resolution_m: 0.5, origin_m: [-1.0, 2.0], cells };
        let trimmed = all.trimmed();
        assert_eq!((trimmed.width, trimmed.height), (2, 2));
        assert_eq!(trimmed.cells, [0, 100, 50, -1]);
        assert_eq!(trimmed.origin_m.map(f64::to_bits), [-0.5_f64, 2.5].map(f64::to_bits));
        let nothing = Grid { cells: vec![-1; 4], width: 2, height: 2, ..Grid::default() };
        assert_eq!(nothing.clone().trimmed(), nothing);
        assert_eq!(Grid::default().trimmed(), Grid::default());
    }

    proptest! {
        #[test]
        fn the_free_rectangles_have_each_free_cell_once(
            (width, cells) in (1_usize..7, 0_usize..7).prop_flat_map(|(width, height)| {
                let cell = prop_oneof![Just(-1_i8), Just(0), Just(19), Just(20), Just(100)];
                (Just(width), collection::vec(cell, width * height))
            }),
        ) {
            let size = |cells: usize| u32::try_from(cells).unwrap();
            let (width, height) = (size(width), size(cells.len() / width));
            let grid = Grid { width, height, resolution_m: 0.5, origin_m: [-1.0, 2.0], cells };
            let free = grid.free();
            let middle = |place: u32, from_m: f64| from_m + 0.5 * (f64::from(place) + 0.5);
            let places = (0..height).flat_map(|y| (0..width).map(move |x| [x, y]));
            for ([x, y], cell) in places.zip(&grid.cells) {
                let at_m = [middle(x, -1.0), middle(y, 2.0)];
                let has = |[low, high]: &&[[f64; 2]; 2]| {
                    (0..2).all(|axis| (low[axis]..high[axis]).contains(&at_m[axis]))
                };
                let expected = usize::from([0, 19].contains(cell));
                prop_assert_eq!(free.iter().filter(has).count(), expected, "{:?}", at_m);
            }
        }
    }
}
