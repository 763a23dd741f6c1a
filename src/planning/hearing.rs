//! What the robot has heard, and what that is evidence of.

use arrayvec::ArrayVec;

use super::Planner;
use super::survey::MOST;
use crate::mapping::{Estimate, MapPoint, Range, Sounding};

/// How far the robot's own floor reaches around its middle, cells.
const STANDS: i32 = 2;
/// How near to a cell a map's point must be for its wall to be known, cells.
const POINT_NEAR: i32 = 1;
/// An echo from so near is placed well, metres; what it counts as evidence of something in its
/// cell, and what one from further away does. A beam through a cell takes away one.
const NEAR_M: f64 = 0.8;
const HEARD_NEAR: i8 = 4;
const HEARD: i8 = 2;
/// An echo from further away than this can close a door, metres: the cone is wider than that. Such
/// echoes alone speak for something by no more than this, so that it can be doubted.
const SURE_M: f64 = 0.45;
const DOUBTFUL: u8 = 9;
/// An echo from no further than this makes a wall known, metres.
const POINT_M: f64 = 1.0;
/// On the axis a beam passes through nothing up to so far, and to so far before its echo, metres.
const CLEARS_M: f64 = 0.9;
const BEFORE_M: f64 = 0.12;
/// Echoes whose place is a guess; older ones stay where they were guessed to be.
const GUESSES: usize = 128;

/// Echoes whose sweep is not over, in their order: the first guess of where each lies, and from how
/// far it was heard.
pub(super) type Guesses = ArrayVec<(MapPoint, f64), GUESSES>;

impl Planner {
    /// Takes in where the robot is, what it has heard, if that is new, and where earlier echoes
    /// lie. `range_max_m`: from there on an echo is no echo.
    pub fn note(&mut self, estimate: &Estimate, range_max_m: f64) {
        let here = self.survey.place(estimate.pose.x_m, estimate.pose.y_m);
        if let Some(place) = here.filter(|_| here != self.stood) {
            self.survey.stand(place, STANDS);
            self.points.stand(&self.survey, &estimate.pose);
            self.stood = here;
        }
        if let Some(sounding) = estimate.sounding.filter(|sounding| sounding.fresh) {
            self.listen(&sounding, range_max_m);
        }
        for point in estimate.placed.iter() {
            self.settle(point);
        }
    }

    fn listen(&mut self, sounding: &Sounding, range_max_m: f64) {
        let Range::Echo(range_m) = sounding.range else { return };
        let mut along_m = 0.0;
        let clear_m = range_m.min(CLEARS_M) - BEFORE_M;
        while along_m < clear_m {
            let [x_m, y_m] = sounding.at(along_m);
            self.survey.hear(x_m, y_m, -1, MOST);
            if let Some(place) = self.survey.place(x_m, y_m) {
                self.survey.swept.fill_square(place, 1);
            }
            along_m += self.plan.lattice[2];
        }
        if range_m >= range_max_m {
            return;
        }
        let [x_m, y_m] = sounding.at(range_m);
        let point = MapPoint { time_ns: sounding.time_ns, x_m, y_m };
        if !sounding.waits {
            self.believe(&point, range_m);
            return;
        }
        // Until its sweep says more, something may be there.
        let (weight, most) = evidence(range_m);
        self.survey.hear(x_m, y_m, weight, most);
        if self.guesses.is_full() {
            self.guesses.remove(0);
        }
        self.guesses.push((point, range_m));
    }

    /// A sweep is over: the evidence of its echo moves from where it was guessed to where it lies.
    /// What was heard before and has no place by now was of nothing.
    fn settle(&mut self, point: &MapPoint) {
        while let Some((guess, range_m)) = self.guesses.first().copied()
            && guess.time_ns <= point.time_ns
        {
            self.guesses.remove(0);
            self.survey.hear(guess.x_m, guess.y_m, -evidence(range_m).0, MOST);
            if guess.time_ns == point.time_ns {
                self.believe(point, range_m);
            }
        }
    }

    /// An echo that was heard from so far lies here.
    fn believe(&mut self, point: &MapPoint, range_m: f64) {
        let (weight, most) = evidence(range_m);
        self.survey.hear(point.x_m, point.y_m, weight, most);
        if let Some(place) = self.survey.place(point.x_m, point.y_m).filter(|_| range_m < POINT_M) {
            self.survey.pointed.fill_square(place, POINT_NEAR);
            self.points.add(&self.survey, [point.x_m, point.y_m]);
        }
    }
}

/// What an echo from so far counts as evidence of something in its cell, and the most that it makes
/// of that.
fn evidence(range_m: f64) -> (i8, u8) {
    let weight = if range_m < NEAR_M { HEARD_NEAR } else { HEARD };
    (weight, if range_m < SURE_M { MOST } else { DOUBTFUL })
}
