//! Where to drive: frontiers of the map, and ways to them and to places along free cells.
//!
//! A [`Planner`] looks at an [`OccupancyGrid`] and answers a [`Request`] with a [`Plan`]: the next
//! places of a way, or that there is none. To explore is to drive where free cells that can be
//! reached lie beside cells that are not known (Yamauchi, *A frontier-based approach for autonomous
//! exploration*, 1997), or beside walls of which the map has no point yet. Of all these it takes
//! the one whose way costs least, less how far it is from home, where the robot started: what is
//! further out comes first, as the robot has to come back and can look at the rest then. In the
//! open, where no wall was heard within 1 m, what is nearer to home comes first: out of a door
//! there is always more. The way is the cheapest one over the cells (Dijkstra with buckets; Dial
//! 1969), where cells near something cost more. After a plan the same search goes as far as home:
//! how long the way home is.
//!
//! # What a cell is
//!
//! What is *solid* is not taken from the grid. A beam that meets a wall obliquely has no echo of
//! it, or that of another wall behind, and then the grid frees cells through the wall; an echo from
//! far away is as wide as a door. So the planner keeps evidence of its own: an echo counts for the
//! cell where it lies, more when it comes from near; a beam takes some away from the cells that it
//! passes near the robot. As long as its sweep is not over, it counts where it was guessed to lie
//! at once, and what its sweep then leaves out of the map counts no more. Echoes of a doorway's
//! sides that were heard from afar close it: so where nothing is left, all that was heard is
//! believed half as much ([`Request::again`]). What was not heard from near then stands no more,
//! and the robot goes there and looks. What has stopped it is forgotten, and what was heard where
//! it once stood: so it gets out of where it came in. After a second such request what was heard
//! from near stands no more, either, if it was not heard again since, and points of the map make a
//! wall known only where one still stands.
//!
//! *Known*: free by the grid, or the robot stood there. *Drivable*: known, nothing solid within the
//! distance to keep, nothing unknown beside it; or its middle was there, and nothing solid is
//! within half that distance, so that echoes beside its own way do not close it, unless they have
//! stopped the robot. *Open*: neither known nor near an echo from near. A known cell beside an open
//! one is of *interest*, until the robot has looked at it from near: then it is *tried*, so that
//! exploring ends. A step costs four times as much, and is driven slowly, where something solid or
//! unknown is near or through which no beam went from near.
//!
//! The way to a place goes over known floor where that leads there, however long it is. Otherwise
//! it takes what is not known to be free until the robot has looked at it (the freespace
//! assumption; Koenig and Likhachev, *D\* Lite*, 2002): it is told as far as it is known, and the
//! robot looks on from there ([`Outcome::Frontier`]). What is still not known after two looks
//! counts as blocked, and so does what a map's point is near to. So a place that cannot be reached
//! is given up in the end, after as many looks as exploring takes. Where the robot stood nothing
//! else does, whatever was heard there since: only what stops it keeps it from going back.
//!
//! What is of interest need not be drivable: the way ends where the robot can look at it. A robot
//! that stands nearer to something than it should gets away from there over any cell that is not
//! solid.
//!
//! # Not here
//!
//! No motion: what drives a plan is [`crate::behavior::navigation`]. No shape of the robot: it is a
//! disc. No uncertainty of the pose.
//!
//! # What was tried and gave nothing
//!
//! - In the second try a wall counts only where it was heard from near, echoes from afar close
//!   nothing: of three runs in `gap` that missed the passage two then found it, but looking at each
//!   wall from near takes so long that of 40 runs of 300 s the mean coverage fell from 96 to 92 %.
//! - To count an echo only once its sweep has placed it: coverage as now, and four times the
//!   collisions. To count the first guess for good: beside posts and in passages echoes at wrong
//!   places close the way, and of 160 runs in 80 rooms that chance drew 84 % instead of 90 % map 95
//!   % of the wall.
//! - A speed of 0.14 or 0.18 m/s: coverage as at 0.11 m/s, and three to five times the collisions.
//! - Of a goal's score, each over 60 to 120 runs of 300 s: turns to it as 10 or 20 cm a radian,
//!   gains of twice as much, none at all, not to stay with the last goal: the mean coverage changes
//!   by less than half a per cent. Half again as much for how far from home it is: up to 2 % more
//!   in two worlds, 4 % less where three rooms lie in a row.
//! - In the open how far from home a goal is counts nothing, for being against it: of nine rooms
//!   that are open to nothing 87 % of the wall for 92 (66 where it counts in its favour). Open from
//!   0.6 m on: 94 %, but in `arena` 96 % after 5 minutes for 97, and of rooms within a yard with a
//!   wall around 50 % of all walls for 58.
//! - To take the goal that the shortest tour over up to 24 of them begins with, which ends at home
//!   (cheapest insertion, then 2-opt; ways between goals straight): of 160 runs of 300 s 95.3 % of
//!   the wall for 95.7 %.
//! - 0.06 m/s on narrow ways, or to take a way as wide though nothing was heard through it: none.
//! - A way counts as narrow where beams from one direction alone went through, of four by 45°: a
//!   fifth of the collisions above 5 cm/s in 240 runs of 300 s, as it is slow there, and 6 to 10 %
//!   less of the wall among pillars, slanted blocks and in corridors. Such a way costs twice as
//!   much but is driven as fast: as many collisions.
//! - A beam takes evidence away only where it comes from the side that an echo of that cell came
//!   from, so that beams beside the end of a wall leave it: of 195 runs in seven kinds of rooms 57
//!   contacts for 58, 13 collisions for 11, and 0.5 % less of the wall. A quarter as much from
//!   other sides: 72 contacts and 17 collisions.
//! - To keep 0.17 m for 0.15: 72 contacts, 19 collisions, and 1.2 % less of the wall (in `arena`
//!   3.6), as more ways are narrow and the robot gets out of more places that it should not be in.
//! - To count nothing for solid that was heard where the robot stood, exploring as well: all of 465
//!   runs come home for 464, with as much of the wall, and 36 collisions for 25.
//! - In the third try to forget all that was heard, or not to look again at what was looked at: it
//!   finds no more, and takes as long.
//!
//! # What it costs
//!
//! Nothing is allocated after construction: 0.5 MB, for grids of up to [`Planner::MOST_COLUMNS`]
//! columns and 65 000 cells. A plan is made in slices, one a tick: 36 rows of the grid become bits,
//! or 12 rows with something known are widened by the distance to keep, or the wave goes over 300
//! cells. To explore, it goes over all that can be reached: a plan for a room of 2 m² takes 13
//! ticks, and about one more for each 0.75 m² of floor. One to a place that cannot be reached takes
//! 150, after the wave over known floor alone. It is made while the robot drives by the one before.
//! Measured on x86-64 at opt-level 1: 64 000 instructions for the rows that become bits, 53 000 for
//! those that are widened. After a plan the way home takes a tick for 300 cells more, and one for
//! each 100 cells of the way to measure it, also where no mission asks for it.
//!
//! # What we count on
//!
//! The same requests, poses, soundings and grids in the same order give the same plans, bit for
//! bit. Between plans the planner remembers where the robot stood, what it heard, which cells were
//! tried, obstacles, and the way home; like the map, none of this is in checkpoints. After a gap in
//! a recording a replay cannot plan as the robot did, and does not compare transitions of a mission
//! that plans.

use arrayvec::ArrayVec;

use crate::mapping::{OccupancyGrid, Pose};

mod clearance;
mod frontier;
mod hearing;
mod layer;
mod plan;
mod survey;
mod trace;
mod wave;

pub use clearance::Clearance;
use clearance::Points;
use hearing::Guesses;
use layer::Place;
pub use plan::{Goal, Outcome, Plan, Request, View, WAYPOINTS};
use survey::{Kind, Survey};
use wave::Wave;

/// Rows of the grid that one tick reads.
const SCANNED_ROWS: usize = 36;
/// Rows that one tick widens.
const GROWN_ROWS: usize = 12;
/// Cells that the wave takes in one tick.
const WAVE_CELLS: usize = 300;

/// Around the goal of a look all is tried within this, cells.
const GOAL_NEAR: i32 = 4;
/// A way ends so far before what is of interest, cells: from there a sweep sees it best.
const VIEW: i32 = 5;
/// Obstacles kept, and for how many plans: by then the grid has them, or they were ghosts.
const OBSTACLES: usize = 16;
const OBSTACLE_PLANS: u8 = 20;

/// What is being done for a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    Idle,
    Scan {
        row: usize,
    },
    Grow {
        row: usize,
    },
    Spread,
    Trace {
        at: u16,
        goal: Place,
    },
    /// After the plan is told: the wave is taken further until it comes home.
    Home,
    /// Back from home along that way, of which so much is measured, metres.
    FromHome {
        at: u16,
        way_m: f64,
    },
}

/// Plans over one grid.
#[derive(Debug, Clone)]
pub struct Planner {
    survey: Survey,
    wave: Wave,
    phase: Phase,
    request: Option<Request>,
    /// The robot's cell when the plan was begun, and the goal's.
    start: Place,
    /// Where it looked then, as a unit vector.
    ahead: [f64; 2],
    target: Option<Place>,
    /// Known floor does not lead there: what is not known is assumed to be free.
    assumes: bool,
    /// The best goal so far: what it costs, less what it is worth.
    best: Option<(i32, Place)>,
    /// The goal of the plan before.
    last_goal: Option<Place>,
    /// How often it was looked at.
    looks: u8,
    /// The robot's cell in the tick before.
    stood: Option<Place>,
    home: Place,
    /// What [`Planner::home_m`] was after the last plan whose wave came home, and from where.
    way_home: Option<(f64, Place)>,
    obstacles: ArrayVec<(Place, u8), OBSTACLES>,
    guesses: Guesses,
    points: Points,
    /// Where it could not turn.
    cramped: Option<Place>,
    /// It was asked to try once more what it had tried.
    has_doubted: bool,
    plan: Plan,
}

impl Planner {
    /// The most columns of a grid.
    pub const MOST_COLUMNS: usize = layer::COLUMNS;

    /// A planner over grids as large as this one and at its place, for a robot that starts at a
    /// pose. `None` for a larger grid than it can do.
    #[must_use]
    pub fn new(grid: &OccupancyGrid, start: &Pose) -> Option<Self> {
        let survey = Survey::new(grid)?;
        let wave = Wave::new(grid.columns() * grid.rows());
        let home = survey.place(start.x_m, start.y_m).unwrap_or_default();
        let [x_m, y_m] = grid.origin_m();
        let plan = Plan { lattice: [x_m, y_m, grid.cell_m()], ..Plan::default() };
        Some(Self {
            survey,
            wave,
            phase: Phase::Idle,
            request: None,
            start: home,
            ahead: [1.0, 0.0],
            target: None,
            assumes: false,
            best: None,
            last_goal: None,
            looks: 0,
            stood: None,
            home,
            way_home: None,
            obstacles: ArrayVec::new(),
            guesses: Guesses::new(),
            points: Points::new(grid.columns() * grid.rows()),
            cramped: None,
            has_doubted: false,
            plan,
        })
    }

    /// Takes in that something blocks the robot at a place, world x and y, metres, which the sensor
    /// does not see.
    pub fn bump(&mut self, [x_m, y_m]: [f64; 2]) {
        if let Some(place) = self.survey.place(x_m, y_m) {
            self.survey.block(place);
        }
    }

    /// Takes in that the robot could not turn where it is.
    pub fn cramp(&mut self) {
        self.cramped = self.stood;
    }

    /// Takes in that something is at a place, which the map need not show.
    fn obstruct(&mut self, [x_m, y_m]: [f64; 2]) {
        let Some(place) = self.survey.place(x_m, y_m) else { return };
        self.obstacles.retain(|(known, _)| *known != place);
        if self.obstacles.is_full() {
            self.obstacles.remove(0);
        }
        self.obstacles.push((place, OBSTACLE_PLANS));
    }

    /// How far home is, where the robot started, from a pose: the way over the map, metres, of
    /// which a narrow piece counts two and a half times, as it is driven slowly, and eight times
    /// where the robot never was, as it may be closed. `None` before the first plan, and where no
    /// way was found.
    #[must_use]
    pub fn home_m(&self, pose: &Pose) -> Option<f64> {
        let (way_m, from) = self.way_home?;
        let [x_m, y_m] = self.plan.middle(from.bytes());
        Some(way_m + libm::hypot(pose.x_m - x_m, pose.y_m - y_m))
    }

    /// The points of the map that are nearer to a pose than what a turn on the spot needs; none
    /// before the first request.
    #[must_use]
    pub fn clearance(&self, pose: &Pose) -> Clearance {
        let near = |request: &Request| self.points.clearance(&self.survey, pose, request.turn_m);
        self.request.as_ref().map(near).unwrap_or_default()
    }

    /// One slice of the work on a request, or without one on the last one's way home; the plan,
    /// when it is made.
    pub fn step(
        &mut self,
        request: Option<&Request>,
        grid: &OccupancyGrid,
        pose: &Pose,
    ) -> Option<&Plan> {
        if let Some(request) = request
            && self.request.is_none_or(|known| known.serial != request.serial)
        {
            self.begin(*request, pose);
        }
        let request = self.request?;
        match self.phase {
            Phase::Idle => None,
            Phase::Scan { row } => {
                self.survey.scan(grid, row..row + SCANNED_ROWS);
                self.phase = self.rows_done(row + SCANNED_ROWS, |row| Phase::Scan { row });
                if self.phase == Phase::Spread {
                    self.phase = Phase::Grow { row: 0 };
                }
                None
            }
            Phase::Grow { row } => {
                let keep = request.keep_m / grid.cell_m();
                let next = self.survey.grow(row, GROWN_ROWS, keep, self.target.is_some());
                self.wave.clear(self.survey.cells(row..next));
                self.phase = self.rows_done(next, |row| Phase::Grow { row });
                if self.phase == Phase::Spread {
                    self.survey.escape(self.start);
                    self.spread_out();
                }
                None
            }
            Phase::Spread => {
                for _ in 0..WAVE_CELLS {
                    if !self.spread(&request) {
                        return self.choose(&request);
                    }
                }
                None
            }
            Phase::Trace { at, goal } => self.trace(at, goal),
            Phase::Home => {
                let home = self.survey.index(self.home);
                for _ in 0..WAVE_CELLS {
                    if self.wave.is_final(home) || self.advance().is_none() {
                        let way = self.wave.cost(home);
                        self.phase =
                            way.map_or(Phase::Idle, |_| Phase::FromHome { at: home, way_m: 0.0 });
                        break;
                    }
                }
                None
            }
            Phase::FromHome { at, way_m } => {
                self.measure_home(at, way_m);
                None
            }
        }
    }

    fn spread_out(&mut self) {
        self.wave.begin(self.survey.index(self.start));
        self.phase = Phase::Spread;
    }

    fn rows_done(&self, row: usize, more: impl Fn(usize) -> Phase) -> Phase {
        if row < self.survey.rows() { more(row) } else { Phase::Spread }
    }

    fn begin(&mut self, request: Request, pose: &Pose) {
        let doubts_more = request.again && self.has_doubted;
        if request.again {
            self.has_doubted = true;
            self.obstacles.clear();
        }
        if let Some(obstacle) = request.obstacle {
            self.obstruct(obstacle);
        }
        self.survey.obstacles.clear();
        for (place, plans) in &mut self.obstacles {
            *plans = plans.saturating_sub(1);
            self.survey.obstacles.set(*place);
        }
        self.obstacles.retain(|(_, plans)| *plans > 0);
        if matches!(request.goal, Goal::Frontier { .. })
            && request.looked.is_some()
            && let Some(goal) = self.last_goal
        {
            self.survey.tried.fill_disc(goal, GOAL_NEAR);
        }
        if request.again {
            self.survey.tried.clear();
            self.survey.doubt();
            self.points.doubt(&self.survey);
        }
        if doubts_more {
            self.survey.doubt_points();
        }
        self.target = match request.goal {
            Goal::Frontier { .. } => None,
            Goal::Place { x_m, y_m } => self.survey.nearest(x_m, y_m),
        };
        self.start = self.survey.nearest(pose.x_m, pose.y_m).unwrap_or(self.home);
        let (sin, cos) = libm::sincos(pose.heading_rad);
        self.ahead = [cos, sin];
        self.assumes = false;
        self.best = None;
        self.request = Some(request);
        self.phase = Phase::Scan { row: 0 };
    }

    /// Looks for a goal in one more cell. False where none that is left can be a better one.
    fn spread(&mut self, request: &Request) -> bool {
        let Some((index, cost)) = self.advance() else { return false };
        match self.target {
            Some(target) => {
                // What can be reached nearest to the target, and of equals the first.
                let place = self.survey.place_of(index);
                let worth = place.distance2(target);
                if self.best.is_none_or(|(best, _)| worth < best) {
                    self.best = Some((worth, place));
                }
                if worth == 0 {
                    return false;
                }
            }
            None => {
                if self.survey.kind(index).is_of_interest() {
                    self.consider(request, self.survey.place_of(index), i32::from(cost));
                }
            }
        }
        true
    }

    /// Takes the wave on by a cell: which one it came to, and what that cost.
    fn advance(&mut self) -> Option<(u16, u16)> {
        let (index, cost) = self.wave.pop()?;
        let kind = self.survey.kind(index);
        for (neighbour, length) in self.survey.neighbours(index) {
            let to = self.survey.kind(neighbour);
            if self.leads(kind, to) {
                self.wave.offer(neighbour, cost, length * to.weight());
            }
        }
        Some((index, cost))
    }

    /// Whether there is a step from a cell to one beside it.
    fn leads(&self, from: Kind, to: Kind) -> bool {
        if from.is_drivable() && to.is_drivable() {
            return true;
        }
        if self.target.is_some() {
            return self.assumes && from.is_promising() && to.is_promising();
        }
        // From what is only seen nothing leads back to the floor.
        to.is_passable() && !to.is_drivable()
    }

    /// The wave has come to its end: what it has found becomes the goal.
    fn choose(&mut self, request: &Request) -> Option<&Plan> {
        self.plan.serial = request.serial;
        self.plan.waypoints.clear();
        self.plan.whole = true;
        if self.target.is_none() {
            self.last_goal = self.best.map(|(_, goal)| goal);
        }
        let Some((worth, goal)) = self.best else {
            self.phase = Phase::Home;
            self.plan.outcome = Outcome::Nothing;
            return Some(&self.plan);
        };
        let is_near = self.target.is_some() && worth > 0;
        if is_near && !self.assumes {
            self.assumes = true;
            self.best = None;
            self.wave.clear(self.survey.cells(0..self.survey.rows()));
            self.spread_out();
            return None;
        }
        self.plan.outcome = if is_near { Outcome::Near } else { Outcome::Way };
        self.plan.goal = goal.bytes();
        self.phase = Phase::Trace { at: self.survey.index(goal), goal };
        None
    }
}

#[cfg(test)]
mod tests;
