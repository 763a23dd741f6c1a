//! One bit for each cell of a grid, a row in a few words.

/// Words of a row.
const WORDS: usize = 7;
/// The most columns.
pub(super) const COLUMNS: usize = WORDS * 32;

/// A row's bits, the first column lowest.
pub(super) type Row = [u32; WORDS];

/// A cell, counted from the lower left.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Place {
    pub(super) column: i32,
    pub(super) row: i32,
}

impl Place {
    /// The square of the distance, in cells.
    pub(super) fn distance2(self, other: Self) -> i32 {
        let (columns, rows) = (self.column - other.column, self.row - other.row);
        columns * columns + rows * rows
    }

    /// The cells up to so far from it along each axis.
    pub(super) fn square(self, radius: i32) -> impl Iterator<Item = Self> {
        let columns = self.column - radius..=self.column + radius;
        let rows = self.row - radius..=self.row + radius;
        rows.flat_map(move |row| columns.clone().map(move |column| Self { column, row }))
    }

    pub(super) fn bytes(self) -> [u8; 2] {
        [self.column, self.row].map(|place| u8::try_from(place).unwrap_or(u8::MAX))
    }
}

/// A bit for each cell.
#[derive(Debug, Clone)]
pub(super) struct Layer {
    rows: Vec<Row>,
}

impl Layer {
    pub(super) fn new(rows: usize) -> Self {
        Self { rows: vec![[0; WORDS]; rows] }
    }

    /// A row; an empty one outside.
    pub(super) fn row(&self, row: i32) -> Row {
        let row = usize::try_from(row).ok().and_then(|row| self.rows.get(row));
        row.copied().unwrap_or_default()
    }

    pub(super) fn set_row(&mut self, row: i32, bits: Row) {
        let row = usize::try_from(row).ok().and_then(|row| self.rows.get_mut(row));
        if let Some(row) = row {
            *row = bits;
        }
    }

    pub(super) fn clear(&mut self) {
        self.rows.fill([0; WORDS]);
    }

    /// Whether a cell is in it; none outside is.
    pub(super) fn has(&self, place: Place) -> bool {
        let row = usize::try_from(place.row).ok().and_then(|row| self.rows.get(row));
        let word = usize::try_from(place.column >> 5).ok();
        let word = row.zip(word).and_then(|(row, word)| row.get(word));
        word.is_some_and(|word| word >> (place.column & 31) & 1 == 1)
    }

    pub(super) fn set(&mut self, place: Place) {
        let row = usize::try_from(place.row).ok().and_then(|row| self.rows.get_mut(row));
        if let Some(row) = row {
            set(row, place.column);
        }
    }

    /// Puts a cell in, or takes it out.
    pub(super) fn put(&mut self, place: Place, is_in: bool) {
        let row = usize::try_from(place.row).ok().and_then(|row| self.rows.get_mut(row));
        let word = usize::try_from(place.column >> 5).ok();
        if let Some(word) = row.zip(word).and_then(|(row, word)| row.get_mut(word)) {
            let bit = place.column & 31;
            *word = *word & !(1 << bit) | u32::from(is_in) << bit;
        }
    }

    pub(super) fn fill_disc(&mut self, middle: Place, radius: i32) {
        for place in middle.square(radius) {
            if place.distance2(middle) <= radius * radius {
                self.set(place);
            }
        }
    }

    pub(super) fn fill_square(&mut self, middle: Place, radius: i32) {
        for place in middle.square(radius) {
            self.set(place);
        }
    }

    /// Whether any of the cells up to so far from one along each axis is in it.
    pub(super) fn has_around(&self, middle: Place, radius: i32) -> bool {
        let mut columns = Row::default();
        for column in middle.column - radius..=middle.column + radius {
            set(&mut columns, column);
        }
        let mut rows = middle.row - radius..=middle.row + radius;
        rows.any(|row| both(self.row(row), columns) != Row::default())
    }

    /// How many of the five by five cells around one are in it.
    pub(super) fn count_around(&self, place: Place) -> i32 {
        place.square(2).map(|cell| i32::from(self.has(cell))).sum()
    }
}

/// Sets a column's bit; there is none outside.
fn set(row: &mut Row, column: i32) {
    if let Some(word) = usize::try_from(column >> 5).ok().and_then(|word| row.get_mut(word)) {
        *word |= 1 << (column & 31);
    }
}

/// Every bit of both.
pub(super) fn both(one: Row, other: Row) -> Row {
    std::array::from_fn(|word| one[word] & other[word])
}

/// Every bit of either.
pub(super) fn either(one: Row, other: Row) -> Row {
    std::array::from_fn(|word| one[word] | other[word])
}

/// Every bit of the first that is not one of the second.
pub(super) fn without(one: Row, other: Row) -> Row {
    std::array::from_fn(|word| one[word] & !other[word])
}

/// Each bit and those next to it.
pub(super) fn widened(row: Row) -> Row {
    either(row, beside(row))
}

/// The bits next to each bit.
pub(super) fn beside(row: Row) -> Row {
    let word = |at: Option<usize>| at.and_then(|at| row.get(at)).copied().unwrap_or(0);
    std::array::from_fn(|at| {
        let higher = row[at] << 1 | word(at.checked_sub(1)) >> 31;
        let lower = row[at] >> 1 | word(Some(at + 1)) << 31;
        higher | lower
    })
}
