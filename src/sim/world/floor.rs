//! The floor: its colour, what is drawn on it, and where it ends.
//!
//! # What we count on
//!
//! What stands later in the file lies above what stands earlier, patches above lines.

use super::geometry::{Point, contains, distance_to_polyline};
use crate::ev3dev::Colour;

/// What paper of each colour reflects of red, green and blue light, in percent. `none` is grey. Red
/// light makes `COL-REFLECT`: black tape 5 to 10, white paper 60 to 90 (interfaces 15.3).
const REFLECTS_PCT: [(Colour, [f64; 3]); 8] = [
    (Colour::None, [35.0, 35.0, 35.0]),
    (Colour::Black, [7.0, 7.0, 7.0]),
    (Colour::Blue, [9.0, 18.0, 40.0]),
    (Colour::Green, [12.0, 32.0, 14.0]),
    (Colour::Yellow, [70.0, 55.0, 18.0]),
    (Colour::Red, [60.0, 10.0, 9.0]),
    (Colour::White, [75.0, 75.0, 75.0]),
    (Colour::Brown, [25.0, 15.0, 11.0]),
];

/// One place of the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::sim) struct Ground {
    pub(in crate::sim) colour: Colour,
    /// Red, green, blue.
    pub(in crate::sim) reflects_pct: [f64; 3],
}

impl Ground {
    /// Beyond the edge: no floor, no light.
    const MISSING: Self = Self { colour: Colour::None, reflects_pct: [0.0; 3] };

    /// The words for colours.
    pub(super) fn words() -> [(&'static str, Colour); 8] {
        REFLECTS_PCT.map(|(colour, _)| (colour.as_str(), colour))
    }

    /// A colour, or the same colour made lighter or darker so that its red is `reflect_pct`.
    pub(super) fn new(colour: Colour, reflect_pct: Option<f64>) -> Self {
        let known = REFLECTS_PCT.into_iter().find(|(known, _)| *known == colour);
        let own = known.map_or([0.0; 3], |(_, reflects_pct)| reflects_pct);
        let factor = reflect_pct.map_or(1.0, |pct| pct / own[0]);
        Self { colour, reflects_pct: own.map(|pct| (pct * factor).min(100.0)) }
    }
}

/// Something drawn on the floor.
#[derive(Debug, Clone)]
pub(in crate::sim) struct Mark {
    pub(in crate::sim) points: Vec<Point>,
    /// A line of this width; `None` for a filled patch.
    pub(in crate::sim) width_m: Option<f64>,
    pub(in crate::sim) closed: bool,
    pub(in crate::sim) ground: Ground,
}

impl Mark {
    fn covers(&self, place: Point) -> bool {
        match self.width_m {
            Some(width_m) => {
                distance_to_polyline(&self.points, self.closed, place) <= width_m / 2.0
            }
            None => contains(&self.points, place),
        }
    }
}

/// The floor of a world.
#[derive(Debug, Clone)]
pub(in crate::sim) struct Floor {
    pub(in crate::sim) ground: Ground,
    pub(in crate::sim) marks: Vec<Mark>,
    /// The floor's edge; empty for a floor without end.
    pub(in crate::sim) table: Vec<Point>,
}

impl Floor {
    /// What is at a place.
    pub(in crate::sim) fn at(&self, place: Point) -> Ground {
        if !self.has(place) {
            return Ground::MISSING;
        }
        self.marks
            .iter()
            .rev()
            .find(|mark| mark.covers(place))
            .map_or(self.ground, |mark| mark.ground)
    }

    /// False beyond the edge.
    pub(in crate::sim) fn has(&self, place: Point) -> bool {
        self.table.is_empty() || contains(&self.table, place)
    }
}
