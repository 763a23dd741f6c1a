//! What each cell of the grid is for a plan.
//!
//! Properties are worked out as layers of bits, a row at a time, and put together into a byte a
//! cell, which is what the wave looks at.

use std::ops::Range;

use super::layer::{COLUMNS, Layer, Place, Row, beside, both, either, widened, without};
use crate::mapping::{Cell, OccupancyGrid};

/// How much wider than the distance to keep the band is where a way costs four times as much, and
/// the one where it costs twice as much, cells.
const BANDS: [f64; 2] = [1.0, 2.5];
/// Where its middle was the robot passes again in this share of the distance to keep.
const AGAIN: f64 = 0.5;
/// The furthest that anything is widened, cells.
const WIDEST: u8 = 12;
/// So near to where it stands the robot may get away over any cell that is not solid, cells.
const ESCAPE: i32 = 4;

/// What a cell is for a plan: a bit for each property.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Kind(u8);

impl Kind {
    /// A step to it costs twice, four times as much.
    const DEAR: [u8; 2] = [0x02, 0x04];
    const DRIVABLE: u8 = 0x08;
    const PASSABLE: u8 = 0x10;
    const INTEREST: u8 = 0x20;
    const ASSUMED: u8 = 0x40;

    /// The robot can drive there.
    pub(super) fn is_drivable(self) -> bool {
        self.0 & Self::DRIVABLE != 0
    }

    /// The robot can drive or at least look there.
    pub(super) fn is_passable(self) -> bool {
        self.0 & (Self::DRIVABLE | Self::PASSABLE) != 0
    }

    /// The robot can drive there, or could if what is not known there is free.
    pub(super) fn is_promising(self) -> bool {
        self.0 & (Self::DRIVABLE | Self::ASSUMED) != 0
    }

    pub(super) fn is_of_interest(self) -> bool {
        self.0 & Self::INTEREST != 0
    }

    /// How many times its length a step there costs.
    pub(super) fn weight(self) -> u16 {
        if self.0 & Self::DEAR[1] != 0 || !self.is_drivable() {
            4
        } else if self.0 & Self::DEAR[0] != 0 {
            2
        } else {
            1
        }
    }
}

/// Properties of cells.
#[derive(Debug, Clone)]
pub(super) struct Survey {
    first_m: [f64; 2],
    cell_m: f64,
    columns: usize,
    rows: usize,
    /// The robot stood there.
    pub(super) stood: Layer,
    /// Its middle was there.
    driven: Layer,
    /// A point of the map is there or beside it.
    pub(super) pointed: Layer,
    /// The robot looked at it from near.
    pub(super) tried: Layer,
    /// Something is there that the grid need not show.
    pub(super) obstacles: Layer,
    /// What the grid says.
    free: Layer,
    occupied: Layer,
    pub(super) interest: Layer,
    /// How much speaks for something in a cell, of what was heard.
    evidence: Vec<u8>,
    /// Where that is enough, and where there is any.
    pub(super) walls: Layer,
    suspects: Layer,
    /// A beam passed through from near.
    pub(super) swept: Layer,
    /// The way is to a place: it goes over what is not known, and where the robot stood.
    assumes: bool,
    kinds: Vec<Kind>,
}

/// Evidence is at most this; from the second on something is there, from the third on it may be.
pub(super) const MOST: u8 = 18;
const WALL: u8 = 5;
const SUSPECT: u8 = 2;

impl Survey {
    pub(super) fn new(grid: &OccupancyGrid) -> Option<Self> {
        let (columns, rows) = (grid.columns(), grid.rows());
        if columns > COLUMNS || rows > usize::from(u8::MAX) || columns * rows > 65_000 {
            return None;
        }
        let layer = || Layer::new(rows);
        Some(Self {
            first_m: grid.origin_m(),
            cell_m: grid.cell_m(),
            columns,
            rows,
            stood: layer(),
            driven: layer(),
            pointed: layer(),
            tried: layer(),
            obstacles: layer(),
            free: layer(),
            occupied: layer(),
            interest: layer(),
            evidence: vec![0; columns * rows],
            walls: layer(),
            suspects: layer(),
            swept: layer(),
            assumes: false,
            kinds: vec![Kind::default(); columns * rows],
        })
    }

    pub(super) fn rows(&self) -> usize {
        self.rows
    }

    /// A cell's side, metres.
    pub(super) fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// How many cells reach so far, at most [`WIDEST`].
    pub(super) fn cells_within(&self, within_m: f64) -> i32 {
        #[expect(clippy::cast_possible_truncation, reason = "it is at most the widest")]
        let cells = libm::ceil(within_m / self.cell_m).clamp(0.0, f64::from(WIDEST)) as i32;
        cells
    }

    /// The corner of a cell with the least x and y, metres.
    pub(super) fn corner_m(&self, place: Place) -> [f64; 2] {
        let [x_m, y_m] = self.first_m;
        let corner_m = |first_m: f64, cells: i32| first_m + f64::from(cells) * self.cell_m;
        [corner_m(x_m, place.column), corner_m(y_m, place.row)]
    }

    /// The cell of a place of the world; `None` outside.
    pub(super) fn place(&self, x_m: f64, y_m: f64) -> Option<Place> {
        let cell = |m: f64, first_m: f64, count: usize| {
            let place = libm::floor((m - first_m) / self.cell_m);
            let count = u16::try_from(count).ok()?;
            #[expect(clippy::cast_possible_truncation, reason = "it is within the grid")]
            (0.0..f64::from(count)).contains(&place).then_some(place as i32)
        };
        Some(Place {
            column: cell(x_m, self.first_m[0], self.columns)?,
            row: cell(y_m, self.first_m[1], self.rows)?,
        })
    }

    /// The cell that is nearest to a place of the world and can be driven to, beside the edge for
    /// one beyond it; none for what is no place.
    pub(super) fn nearest(&self, x_m: f64, y_m: f64) -> Option<Place> {
        // The outermost cells are blocked.
        let within = |m: f64, first_m: f64, count: usize| {
            let last = f64::from(u16::try_from(count).unwrap_or(u16::MAX)) - 1.5;
            // A grid without cells has no last one: so `clamp`, which panics there, will not do.
            m.min(first_m + last * self.cell_m).max(first_m + 1.5 * self.cell_m)
        };
        if !x_m.is_finite() || !y_m.is_finite() {
            return None;
        }
        let [first_x_m, first_y_m] = self.first_m;
        self.place(within(x_m, first_x_m, self.columns), within(y_m, first_y_m, self.rows))
    }

    /// A cell's number; that of none outside.
    pub(super) fn index(&self, place: Place) -> u16 {
        let inside = |at: i32, count: usize| usize::try_from(at).ok().filter(|at| *at < count);
        let places = inside(place.column, self.columns).zip(inside(place.row, self.rows));
        let index = places.map(|(column, row)| row * self.columns + column);
        index.and_then(|index| u16::try_from(index).ok()).unwrap_or(u16::MAX)
    }

    pub(super) fn place_of(&self, index: u16) -> Place {
        let columns = u16::try_from(self.columns).unwrap_or(u16::MAX).max(1);
        Place { column: i32::from(index % columns), row: i32::from(index / columns) }
    }

    /// The numbers of the cells of some rows.
    pub(super) fn cells(&self, rows: Range<usize>) -> Range<usize> {
        rows.start * self.columns..rows.end.min(self.rows) * self.columns
    }

    /// The robot stands there: nothing else does.
    pub(super) fn stand(&mut self, middle: Place, radius: i32) {
        self.stood.fill_disc(middle, radius);
        self.driven.fill_disc(middle, 1);
        for place in middle.square(radius) {
            if place.distance2(middle) <= radius * radius {
                self.weigh(place, |_| 0);
            }
        }
    }

    /// Something was heard at a place, or nothing was heard there. More than `most` does not speak
    /// for something by this.
    pub(super) fn hear(&mut self, x_m: f64, y_m: f64, weight: i8, most: u8) {
        if let Some(place) = self.place(x_m, y_m) {
            self.weigh(place, |evidence| {
                evidence.saturating_add_signed(weight).min(most.max(evidence))
            });
        }
    }

    /// All that was heard speaks half as much for something, and no more for anything where the
    /// robot stood.
    pub(super) fn doubt(&mut self) {
        for row in 0..signed(self.rows) {
            for column in 0..signed(self.columns) {
                let place = Place { column, row };
                let stood = self.stood.has(place);
                self.weigh(place, |evidence| if stood { 0 } else { evidence / 2 });
            }
        }
    }

    /// Where no wall stands any more, the map's points do not make it known.
    pub(super) fn doubt_points(&mut self) {
        for row in 0..signed(self.rows) {
            let walls = [row - 1, row, row + 1].map(|row| self.walls.row(row));
            let near = widened(walls.into_iter().fold(Row::default(), either));
            self.pointed.set_row(row, both(self.pointed.row(row), near));
        }
    }

    /// Something that is not heard is at a place.
    pub(super) fn block(&mut self, middle: Place) {
        for place in middle.square(1) {
            self.weigh(place, |_| MOST);
        }
    }

    fn weigh(&mut self, place: Place, weighed: impl Fn(u8) -> u8) {
        let index = usize::from(self.index(place));
        let Some(evidence) = self.evidence.get_mut(index) else { return };
        *evidence = weighed(*evidence);
        self.walls.put(place, *evidence >= WALL);
        self.suspects.put(place, *evidence >= SUSPECT);
    }

    /// Reads rows of the grid.
    pub(super) fn scan(&mut self, grid: &OccupancyGrid, rows: Range<usize>) {
        for row in rows.start..rows.end.min(self.rows) {
            let (mut free, mut occupied) = (Row::default(), Row::default());
            let words = grid.row(row).chunks(32).zip(free.iter_mut().zip(&mut occupied));
            for (cells, (free, occupied)) in words {
                for (bit, log_odds) in cells.iter().enumerate() {
                    match Cell::of(*log_odds) {
                        Cell::Free => *free |= 1 << bit,
                        Cell::Occupied => *occupied |= 1 << bit,
                        Cell::Unknown => {}
                    }
                }
            }
            self.free.set_row(signed(row), free);
            self.occupied.set_row(signed(row), occupied);
        }
    }

    /// Works out what follows for rows, after all were read. Returns the first row that is left:
    /// those without anything known cost little.
    ///
    /// - `keep`: the distance to keep, cells.
    /// - `assumes`: what is not known is assumed to be free, and nothing to stand where the robot
    ///   stood.
    pub(super) fn grow(&mut self, first: usize, most: usize, keep: f64, assumes: bool) -> usize {
        self.assumes = assumes;
        let widest = f64::from(WIDEST);
        #[expect(
            clippy::cast_possible_truncation,
            reason = "it is at most the square of the widest"
        )]
        let reach2 = [AGAIN * keep, keep, keep + BANDS[0], keep + BANDS[1]]
            .map(|cells| cells.clamp(0.0, widest))
            .map(|cells| (cells * cells) as i32);
        let mut done = 0;
        let mut row = first;
        while row < self.rows && done < most && row < first + 8 * most {
            let known = self.known(signed(row));
            if known == Row::default() && !(assumes && self.is_heard(row)) {
                self.interest.set_row(signed(row), known);
                let is_edge = row == 0 || row + 1 == self.rows;
                let cells = self.cells(row..row + 1);
                self.kinds[cells].fill(Kind(if is_edge { 0 } else { Kind::ASSUMED }));
            } else {
                self.derive(row, known, reach2);
                done += 1;
            }
            row += 1;
        }
        row
    }

    /// Whether anything was heard in a row or near to it, or looked at.
    fn is_heard(&self, row: usize) -> bool {
        let reach = -i32::from(WIDEST)..=i32::from(WIDEST);
        let seen = [&self.tried, &self.pointed].map(|layer| layer.row(signed(row)));
        let mut rows = reach.map(|rows| self.solid(signed(row) + rows)).chain(seen);
        rows.any(|row| row != Row::default())
    }

    /// What follows for a row.
    fn derive(&mut self, at: usize, known: Row, reach2: [i32; 4]) {
        const ALL: Row = [u32::MAX; 7];
        let row = signed(at);
        let [touched, close] = near(row, [reach2[0], reach2[1]], |row| self.solid(row));
        // What has stopped the robot would stop it again.
        let [stops] = near(row, [reach2[1]], |row| self.obstacles.row(row));
        let [inner, outer] = near(row, [reach2[2], reach2[3]], |row| {
            either(self.solid(row), self.suspects.row(row))
        });
        let solid = self.solid(row);
        let passable = without(known, solid);
        let unknown = |row: i32| without(ALL, either(self.known(row), self.solid(row)));
        let unknown = either(either(unknown(row - 1), unknown(row)), unknown(row + 1));
        let unknown = widened(unknown);
        let drivable = without(without(passable, close), unknown);
        let again = without(self.driven.row(row), either(touched, stops));
        let drivable = either(drivable, again);
        let seen = either(self.tried.row(row), self.pointed.row(row));
        let assumed = without(without(ALL, close), either(drivable, seen));
        // Two cells further from what is not known nothing unseen stands in the way.
        let inner = either(inner, widened(widened(unknown)));
        let inner =
            either(inner, without(passable, either(self.swept.row(row), self.stood.row(row))));
        let open = |row: i32| without(ALL, either(self.known(row), self.pointed.row(row)));
        let open = either(either(beside(open(row)), open(row - 1)), open(row + 1));
        // Through a crack in a wall nothing is seen.
        let beside_solid =
            [row - 1, row + 1].into_iter().fold(solid, |all, row| either(all, self.solid(row)));
        let passable = without(passable, widened(beside_solid));
        let interest = without(both(passable, open), self.tried.row(row));
        self.interest.set_row(row, interest);
        let properties = [
            (outer, Kind::DEAR[0]),
            (inner, Kind::DEAR[1]),
            (drivable, Kind::DRIVABLE),
            (passable, Kind::PASSABLE),
            (interest, Kind::INTEREST),
            (assumed, Kind::ASSUMED),
        ];
        // The outermost cells stay blocked, so that each of the others has eight neighbours.
        let is_edge = at == 0 || at + 1 == self.rows;
        let (columns, cells) = (self.columns, self.cells(at..at + 1));
        for (column, kind) in self.kinds[cells].iter_mut().enumerate() {
            *kind = Kind::default();
            let (word, bit) = (column >> 5, column & 31);
            if is_edge || column == 0 || column + 1 == columns {
                continue;
            }
            for (bits, property) in &properties {
                if bits[word] >> bit & 1 == 1 {
                    kind.0 |= property;
                }
            }
        }
    }

    /// Free, or the robot stood there.
    fn known(&self, row: i32) -> Row {
        without(either(self.free.row(row), self.stood.row(row)), self.occupied.row(row))
    }

    /// What was heard often enough, and what has stopped the robot.
    fn solid(&self, row: i32) -> Row {
        let walls = self.walls.row(row);
        let walls = if self.assumes { without(walls, self.stood.row(row)) } else { walls };
        either(walls, self.obstacles.row(row))
    }

    /// Lets the robot get away from where it stands, over what it may not drive on otherwise.
    pub(super) fn escape(&mut self, start: Place) {
        for cell in start.square(ESCAPE) {
            let index = usize::from(self.index(cell));
            let stood = self.stood.has(cell);
            let Some(kind) = self.kinds.get_mut(index) else { continue };
            if cell.distance2(start) <= ESCAPE * ESCAPE
                && !kind.is_drivable()
                && (kind.is_passable() || stood)
            {
                kind.0 |= Kind::DRIVABLE | Kind::DEAR[1];
            }
        }
    }

    /// Whether something solid is within some cells of a place, at most [`WIDEST`].
    pub(super) fn is_solid_within(&self, middle: Place, cells: f64) -> bool {
        middle.square(WIDEST.into()).any(|place| {
            f64::from(place.distance2(middle)) < cells * cells
                && (self.walls.has(place) || self.obstacles.has(place))
        })
    }

    /// What a cell is.
    pub(super) fn kind(&self, index: u16) -> Kind {
        self.kinds.get(usize::from(index)).copied().unwrap_or_default()
    }

    /// The eight neighbours of a cell that is not at the edge, with how far they are, centimetres.
    pub(super) fn neighbours(&self, index: u16) -> [(u16, u16); 8] {
        let up = u16::try_from(self.columns).unwrap_or(0);
        let at = |offset: u16| index.wrapping_add(offset);
        let back = |offset: u16| index.wrapping_sub(offset);
        [
            (at(1), 5),
            (at(up), 5),
            (back(1), 5),
            (back(up), 5),
            (at(up + 1), 7),
            (at(up - 1), 7),
            (back(up + 1), 7),
            (back(up - 1), 7),
        ]
    }
}

fn signed(place: usize) -> i32 {
    i32::try_from(place).unwrap_or(i32::MAX)
}

/// Which cells of a row are within each of some distances of a cell that `solid` has, whose squares
/// are given, the furthest last, in cells.
fn near<const N: usize>(row: i32, reach2: [i32; N], solid: impl Fn(i32) -> Row) -> [Row; N] {
    let mut near = [Row::default(); N];
    let (widest, furthest2) = (i32::from(WIDEST), reach2.last().copied().unwrap_or(0));
    for rows in (-widest..=widest).filter(|rows| rows * rows <= furthest2) {
        let mut solid = solid(row + rows);
        if solid == Row::default() {
            continue;
        }
        for columns in 0..=widest {
            let distance2 = rows * rows + columns * columns;
            if distance2 > furthest2 {
                break;
            }
            for (near, reach2) in near.iter_mut().zip(reach2) {
                // Further out all that is nearer is among it.
                let next2 = rows * rows + (columns + 1) * (columns + 1);
                if distance2 <= reach2 && next2 > reach2 {
                    *near = either(*near, solid);
                }
            }
            solid = widened(solid);
        }
    }
    near
}
