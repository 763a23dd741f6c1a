//! Back along the wave, from the goal to the robot: what becomes a way's waypoints.

use std::f64::consts::SQRT_2;

use super::layer::Place;
use super::plan::NARROW;
use super::survey::Kind;
use super::{GOAL_NEAR, Outcome, Phase, Plan, Planner, VIEW};

/// Cells that one tick goes back along the way.
const TRACED_CELLS: usize = 100;
/// How many times its length a narrow piece of the way home counts: 0.11 m/s on the shipped
/// mission's way, 0.045 m/s where it is narrow. One that was never driven may be none: beams that
/// met a wall obliquely have freed it. By hand: of 72 runs in rooms that are open to the outside 70
/// come home in time, for 64 with 2.5, 68 with 6, 72 with 10; of the wall in the four worlds of
/// `figures::explore` 95.1 % is mapped in 300 s, for 95.7, 95.6, 94.5.
const NARROW_TIMES: f64 = 2.5;
const NOT_DRIVEN_TIMES: f64 = 8.0;
/// Waypoints that tell whether the robot has driven a way before.
const RETRACED: usize = 4;
/// Within this of where it could not turn the robot cannot turn, cells.
const CRAMPED: i32 = 3;
/// What lies in the way to a place counts as blocked when it was looked at so often.
const LOOKS: u8 = 2;
/// Goals no further apart than the root of this are one, cells.
const SAME2: i32 = 2;

impl Planner {
    /// Goes back along the way from the goal to the robot.
    pub(super) fn trace(&mut self, mut at: u16, goal: Place) -> Option<&Plan> {
        let view = if self.target.is_some() { 0 } else { VIEW };
        for step in 0..TRACED_CELLS {
            let kind = self.survey.kind(at);
            let place = self.survey.place_of(at);
            let is_far = place.distance2(goal) >= view * view;
            if self.target.is_some() && !kind.is_drivable() {
                // So far the way is known: from there the robot looks on.
                self.plan.waypoints.clear();
                self.plan.whole = true;
                self.plan.outcome = Outcome::Frontier;
                self.plan.goal = place.bytes();
            }
            if kind.is_drivable() && is_far && (step % 2 == 0 || self.plan.waypoints.is_empty()) {
                if self.plan.waypoints.is_full() {
                    // The first ones are needed first.
                    self.plan.waypoints.remove(0);
                    self.plan.whole = false;
                }
                let [column, row] = place.bytes();
                let weight = u8::try_from(kind.weight()).unwrap_or(u8::MAX);
                self.plan.waypoints.push([column, row, weight]);
            }
            let Some(before) = self.before(at, kind) else {
                if self.plan.outcome == Outcome::Frontier && !self.looks_new() {
                    return None;
                }
                self.plan.waypoints.reverse();
                self.plan.retraces = self.retraces();
                self.plan.is_cramped = self.is_cramped();
                self.phase = Phase::Home;
                return Some(&self.plan);
            };
            at = before;
        }
        self.phase = Phase::Trace { at, goal };
        None
    }

    /// Measures the way home, from a place on it back to the robot.
    pub(super) fn measure_home(&mut self, mut at: u16, mut way_m: f64) {
        for _ in 0..TRACED_CELLS {
            let kind = self.survey.kind(at);
            let Some(before) = self.before(at, kind) else {
                self.way_home = Some((way_m, self.start));
                self.phase = Phase::Idle;
                return;
            };
            let place = self.survey.place_of(at);
            let apart2 = place.distance2(self.survey.place_of(before));
            let cells = if apart2 == 1 { 1.0 } else { SQRT_2 };
            let times = match kind.weight() > u16::from(NARROW) {
                true if self.survey.stood.has(place) => NARROW_TIMES,
                true => NOT_DRIVEN_TIMES,
                false => 1.0,
            };
            way_m += times * cells * self.survey.cell_m();
            at = before;
        }
        self.phase = Phase::FromHome { at, way_m };
    }

    /// Whether what lies in the way to the place has not just been looked at. What has, and is
    /// still not known, counts as blocked, and the plan begins again.
    fn looks_new(&mut self) -> bool {
        let [column, row] = self.plan.goal.map(i32::from);
        let goal = Place { column, row };
        let is_near = |last: Place| last.distance2(goal) <= SAME2;
        let has_looked = self.request.is_some_and(|request| request.looked.is_some());
        let is_same = self.last_goal.is_some_and(is_near);
        self.looks = if is_same { self.looks + u8::from(has_looked) } else { 0 };
        if self.looks >= LOOKS {
            self.looks = 0;
            self.survey.tried.fill_disc(goal, GOAL_NEAR);
            self.best = None;
            self.phase = Phase::Grow { row: 0 };
            return false;
        }
        self.last_goal = Some(goal);
        true
    }

    /// Whether the robot cannot turn where it is, and has driven the first piece of the way before.
    fn retraces(&self) -> bool {
        let turn = self.request.map_or(0.0, |request| request.turn_m / self.plan.lattice[2]);
        let stood = |[column, row, _]: &[u8; 3]| {
            self.survey.stood.has(Place { column: (*column).into(), row: (*row).into() })
        };
        (self.is_cramped() || self.survey.is_solid_within(self.start, turn))
            && self.plan.waypoints.iter().take(RETRACED).all(stood)
    }

    /// Whether the robot could not turn near to where it is.
    fn is_cramped(&self) -> bool {
        let is_near = |place: Place| place.distance2(self.start) <= CRAMPED * CRAMPED;
        self.cramped.is_some_and(is_near)
    }

    /// The cell before one on the cheapest way to it; none before the start.
    fn before(&self, cell: u16, kind: Kind) -> Option<u16> {
        let own = self.wave.cost(cell)?;
        let mut best = None;
        for (neighbour, length) in self.survey.neighbours(cell) {
            let from = self.survey.kind(neighbour);
            let Some(cost) = self.wave.cost(neighbour) else { continue };
            let through = cost.saturating_add(length);
            let leads = from.is_drivable() || self.leads(from, kind);
            if leads && cost < own && best.is_none_or(|(least, _)| through < least) {
                best = Some((through, neighbour));
            }
        }
        best.map(|(_, before)| before)
    }
}
