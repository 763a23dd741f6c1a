//! What is asked of the planner, and what it answers.

use arrayvec::ArrayVec;
use serde::{Deserialize, Serialize};

/// The most places of a way that are told at once.
pub const WAYPOINTS: usize = 32;

/// This number of them ahead tells whether the way is narrow, by steps that cost more than this.
const NARROW_AHEAD: usize = 2;
pub(super) const NARROW: u8 = 2;

/// What is to be reached.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Goal {
    /// What is not known yet.
    Frontier {
        /// Not further from the start than this, metres.
        within_m: f64,
    },
    /// A place of the world.
    Place {
        /// World x, metres.
        x_m: f64,
        /// World y, metres.
        y_m: f64,
    },
}

/// What the robot has looked at from where it stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum View {
    /// What is ahead of it, and beside it.
    Ahead,
    /// All around.
    Around,
}

/// What a plan is asked for with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Request {
    /// Tells requests apart; a new one ends the work on the one before.
    pub serial: u32,
    /// What is to be reached.
    pub goal: Goal,
    /// How far the robot's middle stays away from what is solid, metres.
    pub keep_m: f64,
    /// How far its middle must be from what is solid, so that it can turn on the spot, metres.
    pub turn_m: f64,
    /// The robot has just looked at the goal of the plan before.
    pub looked: Option<View>,
    /// What was tried is to be tried once more, what was heard from afar is to be doubted, and what
    /// has stopped the robot, or was heard where it once stood, to be forgotten.
    pub again: bool,
    /// Something is in the way that the map does not show, world x and y, metres.
    pub obstacle: Option<[f64; 2]>,
}

/// What came out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Outcome {
    /// Nothing that is asked for can be reached.
    #[default]
    Nothing,
    /// There is a way.
    Way,
    /// There is a way if what is not known there is free: it is told as far as it is known.
    Frontier,
    /// There is a way to the nearest place that can be reached, but not to the goal itself.
    Near,
}

/// A way.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Plan {
    /// The request that it answers.
    pub serial: u32,
    /// What came out.
    pub outcome: Outcome,
    /// Whether the way's end is among the waypoints.
    pub whole: bool,
    pub(super) retraces: bool,
    pub(super) is_cramped: bool,
    /// Where the grid begins, world x and y, and the side of a cell, metres.
    pub(super) lattice: [f64; 3],
    pub(super) goal: [u8; 2],
    /// Column, row, and how many times its length a step there costs.
    pub(super) waypoints: ArrayVec<[u8; 3], WAYPOINTS>,
}

impl Plan {
    /// The places of the way, world x and y, metres. None where the robot is there.
    pub fn waypoints(&self) -> impl DoubleEndedIterator<Item = [f64; 2]> + ExactSizeIterator {
        self.waypoints.iter().map(|[column, row, _]| self.middle([*column, *row]))
    }

    /// Whether something solid or unknown is near to the way from one of its places on.
    #[must_use]
    pub fn is_narrow(&self, waypoint: usize) -> bool {
        let mut near = self.waypoints.iter().skip(waypoint).take(NARROW_AHEAD);
        near.any(|[_, _, weight]| *weight > NARROW)
    }

    /// Whether the robot could not turn where it is.
    #[must_use]
    pub fn is_cramped(&self) -> bool {
        self.is_cramped
    }

    /// Whether the robot cannot turn where it is, and has driven the first piece of the way before.
    #[must_use]
    pub fn retraces(&self) -> bool {
        self.retraces
    }

    /// What is to be looked at from the way's end, world x and y, metres.
    #[must_use]
    pub fn goal(&self) -> [f64; 2] {
        self.middle(self.goal)
    }

    #[cfg(test)]
    pub(crate) fn cramped() -> Self {
        Self { is_cramped: true, ..Self::default() }
    }

    pub(super) fn middle(&self, [column, row]: [u8; 2]) -> [f64; 2] {
        let [x_m, y_m, cell_m] = self.lattice;
        [x_m + (f64::from(column) + 0.5) * cell_m, y_m + (f64::from(row) + 0.5) * cell_m]
    }
}
