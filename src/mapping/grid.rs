//! Occupancy grid: what is free and what is not, in log-odds.
//!
//! The grid lies on one lattice for every robot: cell (i, j) covers x from i to i + 1 and y from j
//! to j + 1 times the cell's size, world frame. So grids of several robots are united by adding
//! cells, without turning or shifting.
//!
//! # The sensor's model
//!
//! A sonar hears the nearest thing in a cone and does not say where in the cone it is (Thrun,
//! Burgard and Fox, *Probabilistic Robotics*, section 9.2; Elfes, *Using occupancy grids for mobile
//! robot perception and navigation*, 1989). An echo makes the cone free up to the distance and
//! occupied at it, more near the axis than beside it. No echo makes little free, and only near the
//! axis: a wall that is met at more than 30° from its normal sends none either. Too near makes the
//! place right at the sensor occupied and nothing free.
//!
//! For the same reason one echo says more for a wall than one cone says against it: a wall that was
//! seen squarely is in the cones of all looks along it, and does not echo there. So in a map that
//! is drawn after the run what has echoed is freed at a third of the rate ([`FREED_PER`]; `map` has
//! the figures), and where many points lie, something stands ([`standing`]). A reading sees no
//! further than that: what comes back from behind it has come by a detour. A robot that drives by
//! its grid frees at the full rate: at a third it takes passages for closed, and exploring `gap`
//! (40 runs) it maps 87 % of the wall for 95 %.
//!
//! # What it costs
//!
//! 200 × 200 cells of one byte. An update visits the cells between the edges of its cone and three
//! beside them, each once, in 32-bit integers alone.

mod cone;
mod standing;

use super::{Estimate, MapPoint, Pose, Range, Sounding, room};
use cone::{Cone, Zone, integer};
pub(super) use standing::Standing;

/// A cell's size: the sensor's own error is a centimetre or two, its cone at 1 m is 35 cm wide.
const CELL_M: f64 = 0.05;
/// Cells in each direction: 10 m.
const SIDE: u16 = 200;
/// What is further than this is left to other soundings, metres: it bounds the cost of an update
/// and keeps products in 32 bits.
const REACH_M: f64 = 2.6;
/// A place just before the sensor, metres: nearer than it can measure.
const TOO_NEAR_M: f64 = 0.03;

/// Log-odds are in twentieths and kept within ±100, which is odds of 148 to 1: a cell can change
/// its mind.
const LIMIT: i8 = 100;
const ODDS_STEP: f64 = 0.05;
const HIT_AXIS: i8 = 12;
const HIT_CONE: i8 = 5;
/// Of a point whose place within the cone is known. One makes a cell occupied: what drives by the
/// grid has to see it.
const HIT_POINT: i8 = 24;
const FREE_AXIS: i8 = -6;
const FREE_CONE: i8 = -3;
const MISS_AXIS: i8 = -1;
/// What makes a cell free does so at one of this many parts where something has echoed, when a map
/// is drawn after the run.
const FREED_PER: i8 = 3;
/// From these log-odds on a cell counts as occupied (0.73) or free (0.27).
const OCCUPIED_FROM: i8 = 20;
const FREE_FROM: i8 = -20;

/// What a cell is taken for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cell {
    /// Not known, or contradictory.
    Unknown,
    /// Nothing there.
    Free,
    /// Something there.
    Occupied,
}

impl Cell {
    /// What a cell of these log-odds, in twentieths, is taken for.
    #[must_use]
    pub fn of(log_odds: i8) -> Self {
        match log_odds {
            OCCUPIED_FROM.. => Self::Occupied,
            i8::MIN..=FREE_FROM => Self::Free,
            _ => Self::Unknown,
        }
    }
}

/// A grid of log-odds over a rectangle of the world.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OccupancyGrid {
    /// Lattice place of the lower left cell.
    first: [i32; 2],
    columns: usize,
    rows: usize,
    /// Row by row from below.
    cells: Vec<i8>,
    outside: u64,
    /// [`FREED_PER`], or 1 where a robot drives by it.
    freed_per: i8,
}

impl OccupancyGrid {
    /// An empty grid of 10 m × 10 m around a pose. A pose further than 10 km off counts as there.
    #[must_use]
    pub fn around(start: &Pose) -> Self {
        let half = i32::from(SIDE / 2);
        let first = [lattice(start.x_m) - half, lattice(start.y_m) - half];
        Self::empty(first, usize::from(SIDE), usize::from(SIDE))
    }

    /// An empty grid over all places that a robot can have seen from a rectangle of the world,
    /// between two corners in metres, where it has been; `None` where that is more than
    /// [`OccupancyGrid::MOST_M`] in a direction. For maps that are made after the run, where memory
    /// is no matter.
    #[must_use]
    pub fn covering(low_m: [f64; 2], high_m: [f64; 2]) -> Option<Self> {
        // The sensor is not in the middle of the robot, and a cell counts as a whole.
        let reach_m = REACH_M + 0.5;
        let first = low_m.map(|low_m| lattice(low_m - reach_m));
        let beyond = high_m.map(|high_m| lattice(high_m + reach_m) + 1);
        let most = lattice(Self::MOST_M);
        let size = [beyond[0].saturating_sub(first[0]), beyond[1].saturating_sub(first[1])];
        let [columns, rows] = size.map(|size| usize::try_from(size).ok().filter(|_| size <= most));
        Some(Self::empty(first, columns?, rows?))
    }

    /// The longest side of a grid that is made after a run, metres.
    pub const MOST_M: f64 = 200.0;

    fn empty(first: [i32; 2], columns: usize, rows: usize) -> Self {
        let cells = room::filled(0, columns * rows);
        Self { first, columns, rows, cells, outside: 0, freed_per: 1 }
    }

    /// All of several grids in one that covers them: log-odds are added. `None` where there are
    /// none.
    #[must_use]
    pub fn united(grids: &[&Self]) -> Option<Self> {
        let least =
            |axis: usize| grids.iter().filter_map(|grid| grid.first.get(axis).copied()).min();
        let most =
            |axis: usize| grids.iter().filter_map(|grid| grid.beyond().get(axis).copied()).max();
        let first = [least(0)?, least(1)?];
        let size = [most(0)? - first[0], most(1)? - first[1]];
        let mut union =
            Self::empty(first, usize::try_from(size[0]).ok()?, usize::try_from(size[1]).ok()?);
        for grid in grids {
            union.outside = union.outside.saturating_add(grid.outside);
            for (row, y) in (0..grid.rows).zip(grid.first[1]..) {
                let mut line = union.row_at(y);
                for (column, x) in (0..grid.columns).zip(grid.first[0]..) {
                    let log_odds = grid.log_odds(column, row).unwrap_or(0);
                    line.weigh(x, |_| log_odds);
                }
            }
        }
        Some(union)
    }

    /// An empty grid over the same places, for a map that is drawn after the run.
    pub(super) fn to_draw(&self) -> Self {
        Self { freed_per: FREED_PER, ..Self::empty(self.first, self.columns, self.rows) }
    }

    /// Takes one update: its new reading and the points that now have their place. True where
    /// there was any. `range_max_m`: from there on an echo is no echo.
    pub fn take(&mut self, estimate: &Estimate, range_max_m: f64) -> bool {
        let sounding = estimate.sounding.filter(|sounding| sounding.fresh);
        if let Some(sounding) = &sounding {
            self.add(sounding, range_max_m);
        }
        for point in estimate.placed.iter() {
            self.hit(point);
        }
        sounding.is_some() || !estimate.placed.is_empty()
    }

    /// Takes one reading. Where its echo waits for its place, only what is before it is taken.
    pub fn add(&mut self, sounding: &Sounding, range_max_m: f64) {
        let most_m = range_max_m.min(REACH_M);
        let (free_m, hit) = match sounding.range {
            Range::Echo(range_m) if range_m < most_m => (range_m, true),
            Range::Echo(_) | Range::NoEcho => (most_m, false),
            Range::TooNear => (TOO_NEAR_M, true),
        };
        let Some(cone) = Cone::of(sounding, free_m) else {
            self.outside = self.outside.saturating_add(1);
            return;
        };
        let before = match sounding.range {
            Range::Echo(_) => [FREE_AXIS, FREE_CONE],
            Range::NoEcho => [MISS_AXIS, 0],
            Range::TooNear => [0, 0],
        };
        let at = if hit && !sounding.waits { [HIT_AXIS, HIT_CONE] } else { [0, 0] };
        self.weigh(&cone, before, at);
    }

    /// Takes a point that has its place: there is something.
    pub(super) fn hit(&mut self, point: &MapPoint) {
        let x = lattice(point.x_m);
        self.row_at(lattice(point.y_m)).weigh(x, |_| HIT_POINT);
    }

    /// Makes the cells occupied in which something stands, whatever went through them, and those
    /// free, for certain, where the robot was, though nothing was heard there.
    pub(super) fn stand(&mut self, standing: &Standing) {
        for (log_odds, cell) in self.cells.iter_mut().zip(standing.cells()) {
            *log_odds = match cell {
                Cell::Occupied => (*log_odds).max(OCCUPIED_FROM),
                Cell::Free => -LIMIT,
                Cell::Unknown => *log_odds,
            };
        }
    }

    /// Adds to the log-odds of a cone's cells: before the distance and at it, each near the axis
    /// and beside it.
    fn weigh(&mut self, cone: &Cone, before: [i8; 2], at: [i8; 2]) {
        // Rows run across the axis: its edges then move by no more than a cell or two from a row to
        // the next.
        let turned = cone.is_along_x();
        let cone = if turned { cone.transposed() } else { *cone };
        let (low, high) = cone.bounds();
        let edges = cone.edges();
        for y in low[1]..=high[1] {
            let (first, last) = cone.row(edges, y);
            let mut line = if turned { self.column_at(y) } else { self.row_at(y) };
            line.weigh_cone(&cone, y, [first.max(low[0]), last.min(high[0])], before, at);
        }
    }

    /// True where all places of another grid are in this one.
    #[must_use]
    pub fn has(&self, other: &Self) -> bool {
        let within = |low: [i32; 2], high: [i32; 2]| low[0] <= high[0] && low[1] <= high[1];
        within(self.first, other.first) && within(other.beyond(), self.beyond())
    }

    /// Metres of a cell's side.
    #[must_use]
    pub fn cell_m(&self) -> f64 {
        CELL_M
    }

    /// World x and y, metres, of the lower left corner.
    #[must_use]
    pub fn origin_m(&self) -> [f64; 2] {
        self.first.map(|place| f64::from(place) * CELL_M)
    }

    /// Cells in x.
    #[must_use]
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Cells in y.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// A cell's log-odds in twentieths, counted from the lower left; `None` outside.
    #[must_use]
    pub fn log_odds(&self, column: usize, row: usize) -> Option<i8> {
        if column >= self.columns {
            return None;
        }
        self.cells.get(row.checked_mul(self.columns)?.checked_add(column)?).copied()
    }

    /// The log-odds of a row's cells in twentieths, rows counted from below; none outside.
    #[must_use]
    pub fn row(&self, row: usize) -> &[i8] {
        let first = row.saturating_mul(self.columns);
        self.cells.get(first..first.saturating_add(self.columns)).unwrap_or_default()
    }

    /// The probability, 0 to 1, that a cell is occupied; 0.5 where nothing is known; `None`
    /// outside.
    #[must_use]
    pub fn probability(&self, column: usize, row: usize) -> Option<f64> {
        let log_odds = f64::from(self.log_odds(column, row)?) * ODDS_STEP;
        Some(1.0 / (1.0 + libm::exp(-log_odds)))
    }

    /// What a cell is taken for; outside nothing is known.
    #[must_use]
    pub fn cell(&self, column: usize, row: usize) -> Cell {
        Cell::of(self.log_odds(column, row).unwrap_or(0))
    }

    /// What the place at x and y, metres, world frame, is taken for.
    #[must_use]
    pub fn at(&self, x_m: f64, y_m: f64) -> Cell {
        let log_odds = self.index(x_m, y_m).and_then(|place| self.cells.get(place));
        log_odds.map_or(Cell::Unknown, |log_odds| Cell::of(*log_odds))
    }

    /// Where the cell of a place at x and y, metres, world frame, is kept.
    fn index(&self, x_m: f64, y_m: f64) -> Option<usize> {
        let column = usize::try_from(lattice(x_m) - self.first[0]).ok()?;
        let row = usize::try_from(lattice(y_m) - self.first[1]).ok()?;
        (column < self.columns && row < self.rows).then_some(row * self.columns + column)
    }

    /// How often a reading concerned a cell that the grid does not have.
    #[must_use]
    pub fn outside(&self) -> u64 {
        self.outside
    }

    /// Gives a cell of the lattice log-odds: maps as drawings.
    #[cfg(test)]
    pub(crate) fn set_for_tests(&mut self, x: i32, y: i32, log_odds: i8) {
        self.row_at(y).weigh(x, |_| log_odds);
    }

    fn beyond(&self) -> [i32; 2] {
        let count = |cells: usize| i32::try_from(cells).unwrap_or(i32::MAX);
        [
            self.first[0].saturating_add(count(self.columns)),
            self.first[1].saturating_add(count(self.rows)),
        ]
    }

    /// The cells of one y of the lattice, by x.
    fn row_at(&mut self, y: i32) -> GridLine<'_> {
        let row = usize::try_from(y - self.first[1]).ok().filter(|row| *row < self.rows);
        GridLine {
            first: self.first[0],
            count: row.map_or(0, |_| self.columns),
            start: row.map_or(0, |row| row * self.columns),
            stride: 1,
            cells: &mut self.cells,
            outside: &mut self.outside,
            freed_per: self.freed_per,
        }
    }

    /// The cells of one x of the lattice, by y.
    fn column_at(&mut self, x: i32) -> GridLine<'_> {
        let column =
            usize::try_from(x - self.first[0]).ok().filter(|column| *column < self.columns);
        GridLine {
            first: self.first[1],
            count: column.map_or(0, |_| self.rows),
            start: column.unwrap_or(0),
            stride: self.columns,
            cells: &mut self.cells,
            outside: &mut self.outside,
            freed_per: self.freed_per,
        }
    }
}

/// A row or a column of a grid.
#[derive(Debug)]
struct GridLine<'a> {
    /// The lattice's place of its first cell.
    first: i32,
    /// How many cells it has; none where the grid has no such line.
    count: usize,
    /// Where it begins in the grid's cells, and how far its cells are apart there.
    start: usize,
    stride: usize,
    cells: &'a mut [i8],
    outside: &'a mut u64,
    freed_per: i8,
}

impl GridLine<'_> {
    /// Adds to the log-odds of those cells of a cone that are in row `y` between two places, in the
    /// cone's own x and y.
    fn weigh_cone(
        &mut self,
        cone: &Cone,
        y: i32,
        [first, last]: [i32; 2],
        before: [i8; 2],
        at: [i8; 2],
    ) {
        let mut place = cone.place(first, y);
        let mut met = false;
        let mut x = first;
        while x <= last {
            match cone.part_of(&place) {
                // The cone is convex: a row that has left it does not meet it again.
                Zone::Outside if met => return,
                Zone::Outside => {}
                part => {
                    met = true;
                    let weight = match part {
                        Zone::Before { axis: true } => before[0],
                        Zone::Before { axis: false } => before[1],
                        Zone::Arc { axis: true } => at[0],
                        _ => at[1],
                    };
                    if weight != 0 {
                        let per = if weight < 0 { self.freed_per } else { 1 };
                        self.weigh(x, |odds| if odds > 0 { weight / per } else { weight });
                    }
                }
            }
            place.step(cone.axis);
            x += 1;
        }
    }

    /// Adds to the log-odds of a cell, by its place on the lattice, what `weight` makes of them.
    fn weigh(&mut self, at: i32, weight: impl FnOnce(i8) -> i8) {
        match self.cell(at) {
            Some(cell) => *cell = cell.saturating_add(weight(*cell)).clamp(-LIMIT, LIMIT),
            None => *self.outside = self.outside.saturating_add(1),
        }
    }

    fn cell(&mut self, at: i32) -> Option<&mut i8> {
        let along = usize::try_from(at.checked_sub(self.first)?).ok()?;
        let place = self.start.checked_add(along.checked_mul(self.stride)?)?;
        self.cells.get_mut(place).filter(|_| along < self.count)
    }
}

/// Cells further than this from the origin are not on the lattice: 10 km.
const LATTICE_LIMIT: i32 = 200_000;

/// The lattice's cell of a coordinate in metres, kept on the lattice.
fn lattice(m: f64) -> i32 {
    integer(libm::floor(m / CELL_M)).clamp(-LATTICE_LIMIT, LATTICE_LIMIT)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    pub(super) fn sounding(x_m: f64, y_m: f64, direction_rad: f64, range: Range) -> Sounding {
        let beam = [libm::cos(direction_rad), libm::sin(direction_rad)];
        Sounding {
            time_ns: 0,
            x_m,
            y_m,
            beam,
            echo: beam,
            half_cone_rad: 0.21,
            range,
            fresh: true,
            waits: false,
        }
    }

    fn repeated(range: Range) -> OccupancyGrid {
        let mut grid = OccupancyGrid::around(&Pose::default());
        for _ in 0..4 {
            grid.add(&sounding(0.0, 0.0, 0.0, range), 2.0);
        }
        grid
    }

    #[test]
    fn an_echo_at_a_metre_is_occupied_there_free_before_and_unknown_behind() {
        let grid = repeated(Range::Echo(1.0));
        assert_eq!(grid.at(1.0, 0.0), Cell::Occupied);
        assert_eq!(grid.at(0.98, 0.17), Cell::Occupied, "10 degrees beside the axis");
        assert_eq!(grid.at(0.5, 0.0), Cell::Free);
        assert_eq!(grid.at(0.1, 0.0), Cell::Free);
        assert_eq!(grid.at(1.1, 0.0), Cell::Unknown);
        assert_eq!(grid.at(0.5, 0.3), Cell::Unknown);
        assert_eq!(grid.at(-0.1, 0.0), Cell::Unknown);
    }

    #[test]
    fn echoes_misses_and_too_near_are_kept_apart() {
        assert_eq!(
            repeated(Range::Echo(3.0)),
            freed(FREE_AXIS, FREE_CONE),
            "an echo from beyond the maximum"
        );
        assert_eq!(repeated(Range::NoEcho), freed(MISS_AXIS, 0));
        let miss = repeated(Range::NoEcho);
        assert_eq!(miss.at(1.0, 0.0), Cell::Unknown, "four misses prove nothing");
        assert!(miss.cells.iter().all(|cell| *cell <= 0), "a miss makes nothing occupied");
        let near = repeated(Range::TooNear);
        assert_eq!(near.at(0.02, 0.0), Cell::Occupied);
        assert_eq!(near.at(0.15, 0.0), Cell::Unknown);
        assert!(near.cells.iter().all(|cell| *cell >= 0), "too near makes nothing free");
    }

    /// The grid after four readings that only make free, without bounds and rules.
    fn freed(at_axis: i8, beside: i8) -> OccupancyGrid {
        let mut grid = OccupancyGrid::around(&Pose::default());
        let cone = Cone::of(&sounding(0.0, 0.0, 0.0, Range::NoEcho), 2.0).expect("on the lattice");
        for (y, x) in (-60..60).flat_map(|y| (-60..60).map(move |x| (y, x))) {
            if let Zone::Before { axis } = cone.part_of(&cone.place(x, y)) {
                grid.row_at(y).weigh(x, |_| 4 * if axis { at_axis } else { beside });
            }
        }
        grid
    }

    #[test]
    fn what_has_echoed_is_freed_at_once_on_the_way_and_by_many_looks_in_a_map_of_the_run() {
        let driven_by = OccupancyGrid::around(&Pose::default());
        let drawn = driven_by.to_draw();
        let beyond = sounding(0.0, 0.0, 0.0, Range::Echo(1.8));
        let after = |mut grid: OccupancyGrid, looks: usize| {
            grid.hit(&MapPoint { time_ns: 0, x_m: 1.02, y_m: 0.02 });
            (0..looks).for_each(|_| grid.add(&beyond, 2.0));
            [0.82, 1.02].map(|x_m| grid.at(x_m, 0.02))
        };
        assert_eq!(after(driven_by.clone(), 2), [Cell::Unknown; 2]);
        assert_eq!(after(drawn.clone(), 2), [Cell::Unknown, Cell::Occupied]);
        assert_eq!(after(driven_by, 18), [Cell::Free; 2]);
        assert_eq!(after(drawn, 18), [Cell::Free; 2], "what is gone is freed in the end");
    }

    #[test]
    fn what_lies_outside_is_counted() {
        let mut grid = OccupancyGrid::around(&Pose::default());
        grid.add(&sounding(4.5, 0.0, 0.0, Range::Echo(1.0)), 2.0);
        let counted = grid.outside();
        assert!(counted > 10, "{counted} cells outside");
        grid.add(&sounding(1e300, 0.0, 0.0, Range::Echo(1.0)), 2.0);
        assert_eq!(grid.outside(), counted + 1);
    }

    #[test]
    fn two_robots_grids_agree_on_the_lattice_and_add_up() {
        let wall = |start: Pose| {
            let mut grid = OccupancyGrid::around(&start);
            grid.add(&sounding(0.013, 0.0, 0.0, Range::Echo(1.0)), 2.0);
            grid
        };
        let one = wall(Pose::default());
        let other = wall(Pose { x_m: 3.01, y_m: -1.0, heading_rad: 1.0 });
        let both = OccupancyGrid::united(&[&one, &other]).expect("two grids");
        assert_eq!((both.columns(), both.rows()), (260, 220));
        assert_eq!(both.at(1.0, 0.0), Cell::Occupied, "24 of 20");
        assert_eq!(one.at(1.0, 0.0), Cell::Unknown, "12 of 20");
        let [x_m, y_m] = both.origin_m();
        assert!((x_m + 5.0).abs() < 1e-9 && (y_m + 6.0).abs() < 1e-9, "({x_m}, {y_m}) m");
        assert_eq!(OccupancyGrid::united(&[]), None);
    }

    #[test]
    fn probabilities_follow_the_log_odds() {
        let grid = repeated(Range::Echo(1.0));
        let occupied = grid.probability(120, 100).expect("a cell of the grid");
        assert!((occupied - 1.0 / (1.0 + libm::exp(-2.4))).abs() < 1e-12, "{occupied}");
        assert_eq!(grid.probability(0, 0), Some(0.5));
        assert_eq!(grid.probability(200, 0), None);
    }

    proptest! {
        #[test]
        fn every_cell_of_the_cone_and_no_other_is_weighed(
            x in -1.0..1.0, y in -1.0..1.0, direction in -7.0..7.0, range in 0.0..2.6
        ) {
            let one = sounding(x, y, direction, Range::Echo(range));
            let mut grid = OccupancyGrid::around(&Pose::default());
            grid.add(&one, 2.6);
            let cone = Cone::of(&one, range).expect("on the lattice");
            for (cell_y, cell_x) in (-99..99).flat_map(|y| (-99..99).map(move |x| (y, x))) {
                let expected = match cone.part_of(&cone.place(cell_x, cell_y)) {
                    Zone::Outside => 0,
                    Zone::Before { axis: true } => FREE_AXIS,
                    Zone::Before { axis: false } => FREE_CONE,
                    Zone::Arc { axis: true } => HIT_AXIS,
                    Zone::Arc { axis: false } => HIT_CONE,
                };
                let (column, row) = (cell_x - grid.first[0], cell_y - grid.first[1]);
                let found = grid.log_odds(column.try_into().unwrap(), row.try_into().unwrap());
                prop_assert_eq!(found, Some(expected), "({}, {})", cell_x, cell_y);
            }
        }

        #[test]
        fn the_cell_of_an_echo_on_the_axis_gains(
            x in -1.0..1.0, y in -1.0..1.0, direction in -7.0..7.0, range in 0.1..1.9
        ) {
            let mut grid = OccupancyGrid::around(&Pose::default());
            let one = sounding(x, y, direction, Range::Echo(range));
            for _ in 0..3 {
                grid.add(&one, 2.0);
            }
            let [hit_x, hit_y] = one.at(range);
            prop_assert_ne!(grid.at(hit_x, hit_y), Cell::Free);
            let [before_x, before_y] = one.at(range / 2.0);
            prop_assert!(range < 0.3 || grid.at(before_x, before_y) != Cell::Occupied);
        }

        #[test]
        fn any_numbers_at_all_are_survived(
            x in any::<f64>(), y in any::<f64>(), range in any::<f64>(), cos in -1.0..1.0,
            sin in -1.0..1.0
        ) {
            let mut grid = OccupancyGrid::around(&Pose { x_m: x, y_m: y, heading_rad: 0.0 });
            for range in [Range::Echo(range), Range::NoEcho, Range::TooNear] {
                let (beam, echo) = ([cos, sin], [cos, sin]);
                let sounding =
                    Sounding { x_m: x, y_m: y, beam, echo, ..sounding(0.0, 0.0, 0.0, range) };
                grid.add(&sounding, 2.0);
            }
            prop_assert_eq!(grid.cells.len(), 40_000);
        }
    }
}
