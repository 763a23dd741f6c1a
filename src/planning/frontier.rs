//! Which cell of interest is the best goal: its way's cost, less what it is worth.

use super::layer::Place;
use super::{Goal, Planner, Request, View};

/// A cell is looked at from near within this, cells: the cone is no wider than a wall's piece.
const LOOKED_NEAR: i32 = 9;
/// This number of cells of interest within five by five is worth a way, until the map is doubted: a
/// small room leaves fewer between what was heard of a wall from its middle and the corner.
const WORTHWHILE: i32 = 5;
/// How much longer a way may be for each further cell of interest, and for how many, centimetres.
const GAIN_CM: i32 = 5;
const GAIN_MOST: i32 = 10;
/// How much longer a way may be to stay with the last goal, and how near it is still that one.
const STAY_CM: i32 = 25;
const STAY_NEAR: i32 = 6;
/// What has no wall within this, along rows and columns, lies in the open, cells.
const OPEN: i32 = 20;

impl Planner {
    /// Whether a cell that the wave has come to is the best goal so far.
    pub(super) fn consider(&mut self, request: &Request, place: Place, cost_cm: i32) {
        let Goal::Frontier { within_m } = request.goal else { return };
        let cell_m = self.plan.lattice[2];
        let from_home_m = cell_m * libm::sqrt(f64::from(place.distance2(self.home)));
        if from_home_m > within_m {
            return;
        }
        let is_near = place.distance2(self.start) <= LOOKED_NEAR * LOOKED_NEAR;
        if is_near
            && request.looked.is_some_and(|view| view == View::Around || self.is_ahead(place))
        {
            self.survey.tried.set(place);
            return;
        }
        let gain = self.survey.interest.count_around(place);
        if gain < WORTHWHILE && !self.has_doubted {
            return;
        }
        let is_near_last = |last: Place| place.distance2(last) <= STAY_NEAR * STAY_NEAR;
        let stays = self.last_goal.is_some_and(is_near_last);
        #[expect(clippy::cast_possible_truncation, reason = "it is within the grid")]
        let from_home_cm = (100.0 * from_home_m) as i32;
        let worth_cm = GAIN_CM * gain.min(GAIN_MOST) + if stays { STAY_CM } else { 0 };
        let is_best = |score: i32| self.best.is_none_or(|(best, _)| score < best);
        let score = |gain_cm: i32| cost_cm - worth_cm - gain_cm;
        if !is_best(score(from_home_cm)) {
            return;
        }
        // Out of a door there is always more in the open, the further out the more.
        let is_by_wall = self.survey.walls.has_around(place, OPEN);
        let score = score(if is_by_wall { from_home_cm } else { -from_home_cm });
        if is_best(score) {
            self.best = Some((score, place));
        }
    }

    /// Whether a cell is ahead of the robot or beside it.
    fn is_ahead(&self, place: Place) -> bool {
        let columns = f64::from(place.column - self.start.column);
        let rows = f64::from(place.row - self.start.row);
        columns * self.ahead[0] + rows * self.ahead[1] >= 0.0
    }
}
