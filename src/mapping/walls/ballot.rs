//! Votes of spots for the lines that they are near to.
//!
//! # Not here
//!
//! What becomes of a line that is elected (`walls`).

use std::f64::consts::PI;

use super::{FEWEST, Line, Spot};
use crate::units::{count, floored};

/// Lines that are voted for: directions in half a turn, and metres between parallel ones.
const DIRECTIONS: usize = 120;
const LINE_M: f64 = 0.03;
/// What is further from the middle of all is left out, metres.
const REACH_M: f64 = 100.0;

/// How many spots each line has.
pub(super) struct Ballot {
    middle_m: [f64; 2],
    directions: Vec<[f64; 2]>,
    /// Lines of a direction.
    lines: usize,
    votes: Vec<i32>,
}

impl Ballot {
    pub(super) fn of(spots: &[Spot]) -> Self {
        let n = count(spots.len()).max(1.0);
        let middle_m = [0, 1].map(|axis| spots.iter().map(|s| s.at_m[axis]).sum::<f64>() / n);
        let far_m =
            |spot: &Spot| libm::hypot(spot.at_m[0] - middle_m[0], spot.at_m[1] - middle_m[1]);
        let reach_m = spots.iter().map(far_m).fold(0.0, f64::max).min(REACH_M);
        let lines = usize::try_from(2 * floored(reach_m / LINE_M) + 6).unwrap_or(6);
        let direction = |place: usize| {
            let (sin, cos) = libm::sincos(count(place) * PI / count(DIRECTIONS));
            [cos, sin]
        };
        let directions = (0..DIRECTIONS).map(direction).collect();
        let mut ballot = Self { middle_m, directions, lines, votes: vec![0; DIRECTIONS * lines] };
        spots.iter().for_each(|spot| ballot.count(spot, 1));
        ballot
    }

    /// Adds to the votes of all lines that a spot is near to: of two of each direction, so that no
    /// line falls between.
    pub(super) fn count(&mut self, spot: &Spot, by: i32) {
        let [x_m, y_m] = [0, 1].map(|axis| spot.at_m[axis] - self.middle_m[axis]);
        let half = i32::try_from(self.lines / 2).unwrap_or(0);
        for ([cos, sin], votes) in self.directions.iter().zip(self.votes.chunks_mut(self.lines)) {
            let below = usize::try_from(floored((x_m * cos + y_m * sin) / LINE_M) + half);
            if let Some(pair) = below.ok().and_then(|below| votes.get_mut(below..below + 2)) {
                pair.iter_mut().for_each(|vote| *vote = vote.saturating_add(by));
            }
        }
    }

    /// The line with the most votes, and its place; `None` where none has enough.
    pub(super) fn best(&self) -> Option<(usize, Line)> {
        let (place, votes) =
            self.votes.iter().enumerate().rev().max_by_key(|(_, votes)| **votes)?;
        let normal = *self.directions.get(place / self.lines)?;
        let from_middle = count(place % self.lines) - count(self.lines / 2);
        let of_middle_m = self.middle_m[0] * normal[0] + self.middle_m[1] * normal[1];
        let line = Line { normal, distance_m: from_middle * LINE_M + of_middle_m };
        (usize::try_from(*votes).is_ok_and(|votes| votes >= FEWEST)).then_some((place, line))
    }

    /// A line is not looked at again.
    pub(super) fn dismiss(&mut self, place: usize) {
        if let Some(votes) = self.votes.get_mut(place) {
            *votes = i32::MIN / 2;
        }
    }
}
