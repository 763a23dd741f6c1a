//! A sounding's cone among the cells of the lattice, in 32-bit integers: places in sixteenths of a
//! cell, directions in 1024ths.
//!
//! What a cell in it is worth is not here but in the grid.

use super::{CELL_M, LATTICE_LIMIT, REACH_M};
use crate::mapping::Sounding;

/// Parts of a cell and of a unit vector in integer geometry.
const PARTS: i32 = 16;
const PARTS_PER_M: f64 = 16.0 / CELL_M;
const UNIT: i32 = 1024;
/// From the middle of a cell to its corner, and a little more.
const TOUCHED: i32 = 12;
/// Tangent of 5°, in [`UNIT`]s: nearer than that to the axis a place is heard best. No cone is
/// narrower.
const TAN_AXIS: i32 = 90;

/// The cone may include this many cells beside an edge: a tolerance of half a cell, the tip's place
/// in its cell, and rounding.
const BESIDE_EDGE: i32 = 3;

/// Where a cell lies in a cone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Zone {
    Outside,
    /// Nearer than the distance; near the axis or beside it.
    Before {
        axis: bool,
    },
    /// At the distance.
    Arc {
        axis: bool,
    },
}

/// A sounding's cone in integers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cone {
    /// The cell of its tip, and the tip's place in that cell in sixteenths.
    tip: [i32; 2],
    within: [i32; 2],
    /// Unit vector of the axis, in 1024ths.
    pub(super) axis: [i32; 2],
    /// The distance, in sixteenths of a cell, less and plus three quarters of a cell, squared: all
    /// cells that it touches.
    free_below: i32,
    arc_to: i32,
    /// Tangent of the cone's half angle, in [`UNIT`]s.
    tangent: i32,
    /// The greater of them, in whole cells, rounded up.
    reach: i32,
}

impl Cone {
    /// `None` for a place that is not on the lattice.
    pub(super) fn of(sounding: &Sounding, range_m: f64) -> Option<Self> {
        let [x, y] = [sounding.x_m, sounding.y_m].map(|m| libm::floor(m * PARTS_PER_M));
        let limit = f64::from(LATTICE_LIMIT * PARTS);
        if !(x.abs() < limit && y.abs() < limit) {
            return None;
        }
        let [x, y] = [integer(x), integer(y)];
        let range = integer(range_m.clamp(0.0, REACH_M) * PARTS_PER_M);
        // A tangent of more than a right angle's half is no sonar's.
        let half_rad = sounding.half_cone_rad.clamp(0.0, 0.5);
        let tangent = integer(libm::round(libm::tan(half_rad) * f64::from(UNIT)));
        let (near, far) = ((range - TOUCHED).max(0), range + TOUCHED);
        Some(Self {
            tip: [x.div_euclid(PARTS), y.div_euclid(PARTS)],
            within: [x.rem_euclid(PARTS), y.rem_euclid(PARTS)],
            axis: sounding.beam.map(|part| integer(libm::round(part * f64::from(UNIT)))),
            free_below: near * near,
            arc_to: far * far,
            tangent: tangent.max(TAN_AXIS),
            reach: far / PARTS + 1,
        })
    }

    /// The lattice's cells among which all of the cone's are: the box of its tip and of the arc's
    /// two ends and middle.
    pub(super) fn bounds(&self) -> ([i32; 2], [i32; 2]) {
        let [cos, sin] = self.axis;
        // The ends lie at (1, ±tan) from the axis, a little outside of the arc; so does all that
        // bulges between them.
        let side = [-sin * self.tangent / UNIT, cos * self.tangent / UNIT];
        let extent = |axis: i32, side: i32| {
            let ends = [0, axis, axis + side, axis - side].map(|part| part * self.reach);
            let low = ends.into_iter().fold(0, i32::min);
            let high = ends.into_iter().fold(0, i32::max);
            (low.div_euclid(UNIT) - 1, high.div_euclid(UNIT) + 2)
        };
        let (low_x, high_x) = extent(cos, side[0]);
        let (low_y, high_y) = extent(sin, side[1]);
        ([self.tip[0] + low_x, self.tip[1] + low_y], [self.tip[0] + high_x, self.tip[1] + high_y])
    }

    /// Whether the axis points more along x than along y.
    pub(super) fn is_along_x(&self) -> bool {
        self.axis[0].abs() > self.axis[1].abs()
    }

    /// The same with x and y exchanged. A cell's part does not change: it asks for the distance
    /// across the axis, not for the side.
    pub(super) fn transposed(mut self) -> Self {
        self.tip.reverse();
        self.within.reverse();
        self.axis.reverse();
        self
    }

    /// What both edges move by in x from a row to the next, in 1024ths of a cell, for an axis along
    /// y.
    pub(super) fn edges(&self) -> [i32; 2] {
        let [cos, sin] = self.axis;
        [self.tangent, -self.tangent].map(|tan| {
            let (x, y) = (cos * UNIT - sin * tan, sin * UNIT + cos * tan);
            // Only a vector that is no direction has none of it along its greater component.
            x.checked_div(y / UNIT).unwrap_or(0)
        })
    }

    /// The first and the last cell of a row between the edges: what is beyond is outside.
    pub(super) fn row(&self, edges: [i32; 2], y: i32) -> (i32, i32) {
        let rows = y - self.tip[1];
        let [one, other] = edges.map(|edge| self.tip[0] + (rows * edge).div_euclid(UNIT));
        (one.min(other) - BESIDE_EDGE, one.max(other) + BESIDE_EDGE)
    }

    /// The place of a cell's middle. All products stay below 2³¹: sixteenths below 2¹⁰, 1024ths
    /// below 2¹¹, tangents below 2¹⁰, and no place is further than 2.6 m.
    pub(super) fn place(&self, x: i32, y: i32) -> Offset {
        let dx = (x - self.tip[0]) * PARTS + PARTS / 2 - self.within[0];
        let dy = (y - self.tip[1]) * PARTS + PARTS / 2 - self.within[1];
        let [cos, sin] = self.axis;
        Offset { dx, dy, along: dx * cos + dy * sin, across: dx * sin - dy * cos }
    }

    /// Where a cell of [`Cone::bounds`] lies.
    pub(super) fn part_of(&self, place: &Offset) -> Zone {
        // Half a cell is granted to each side, so that a cone is a cell wide where it is narrowest.
        let across = if place.across < 0 { -place.across } else { place.across };
        let beside = if across > UNIT * PARTS / 2 { across - UNIT * PARTS / 2 } else { 0 };
        if place.along < 0 || beside > place.along * self.tangent / UNIT {
            return Zone::Outside;
        }
        let squared = place.dx * place.dx + place.dy * place.dy;
        if squared > self.arc_to {
            return Zone::Outside;
        }
        let axis = beside <= place.along * TAN_AXIS / UNIT;
        if squared < self.free_below { Zone::Before { axis } } else { Zone::Arc { axis } }
    }
}

/// A cell's middle from a cone's tip: in x and y in sixteenths, and along and across its axis in
/// those times 1024.
#[derive(Debug, Clone, Copy)]
pub(super) struct Offset {
    dx: i32,
    dy: i32,
    along: i32,
    across: i32,
}

impl Offset {
    /// To the next cell in x.
    pub(super) fn step(&mut self, [cos, sin]: [i32; 2]) {
        self.dx += PARTS;
        self.along += PARTS * cos;
        self.across += PARTS * sin;
    }
}

/// A float's integer part; what does not fit ends at the limits, NaN at 0.
#[expect(clippy::cast_possible_truncation, reason = "a cast from float saturates")]
pub(super) fn integer(value: f64) -> i32 {
    value as i32
}

#[cfg(test)]
mod tests {
    use super::super::tests::sounding;
    use super::*;
    use crate::mapping::Range;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_box_holds_all_of_its_cone_and_an_update_is_cheap(
            x in -1.0..1.0, y in -1.0..1.0, direction in -7.0..7.0, range in 0.0..2.6
        ) {
            let cone =
                Cone::of(&sounding(x, y, direction, Range::NoEcho), range).expect("on the lattice");
            let (low, high) = cone.bounds();
            let visited = (high[0] - low[0] + 1) * (high[1] - low[1] + 1);
            prop_assert!(visited <= 2_600, "{visited} cells visited");
            for cell_y in cone.tip[1] - 60..=cone.tip[1] + 60 {
                for cell_x in cone.tip[0] - 60..=cone.tip[0] + 60 {
                    let inside = (low[0]..=high[0]).contains(&cell_x)
                        && (low[1]..=high[1]).contains(&cell_y);
                    prop_assert!(
                        inside || cone.part_of(&cone.place(cell_x, cell_y)) == Zone::Outside,
                        "({cell_x}, {cell_y}) is in the cone and not in {low:?} to {high:?}"
                    );
                }
            }
        }
    }
}
