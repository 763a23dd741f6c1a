//! Motions that find their way over the map: to what is not known yet, and to a place.
//!
//! The [`crate::planning::Planner`] plans; this drives. It asks for a plan with a [`Request`],
//! follows the plan's places with the head swinging from side to side, and asks again while it
//! drives, so that what the map has gained meanwhile counts. At the end of a way to something
//! unknown it looks there with the head, or where the range sensor is fixed, by turning once on the
//! spot, to the left and to the right in turn. Before it explores, it may spin (`looking`).
//! Exploring is done when two plans in a row have found nothing, with a look round between them;
//! what ends a way to a place stands in `ending`.
//!
//! An echo from within the robot's own lane stops it; it becomes an obstacle of the next plan. A
//! robot whose bumper is pressed, or that is stopped again and again in one place, backs off. So
//! does one whose wheels are blocked: against the way that it drove last, as what blocks it need
//! not be ahead. One that has no room to turn drives back the way that it came. Between cells it
//! goes by the map's points near to it: it steers past them, makes room before a turn on the spot,
//! and backs off no further than to what is behind it.
//!
//! # What was tried and gave nothing
//!
//! - With something ahead to turn on the spot to where the way leads, if that is further aside than
//!   12°, before it stops for it: over 345 runs 0.2 % more of the wall, 104 contacts for 87, and as
//!   many collisions.
//! - To stop where a point of the map is within 11.5 cm ahead, up to 65° aside: 15 contacts for 58
//!   in 195 runs, and 87 % of the wall for 97, as such points close narrow places.
//! - To be slow where a point is within 15 cm ahead, up to 75° aside: of 345 runs 47 contacts for
//!   46. To be slow where a row of points leads to the way, as beside the end of a wall of which no
//!   beam comes back: 26 contacts for 46 and 11 collisions for 14, but 0.7 % less of the wall, and
//!   16 runs of 300 s more that are not home in time.
//! - To drive at 0.12 m/s where the way is wide, for 0.11: of 400 runs of 300 s 0.4 % more of the
//!   wall, but 35 collisions for 17.
//! - To look for what is ahead 1.3 times as far aside as the way leads: twice the collisions; half
//!   as far: 0.5 % less of the wall.
//!
//! # Not here
//!
//! No map and no planner: the runtime hands requests on and plans back. Turning to what is looked
//! at, backing off and the last piece to a place are motions of their own ([`super::motion`]).

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

mod back_off;
mod clearance;
mod cramped;
mod ending;
mod looking;
mod tick;

use super::demands::Drive;
use super::motion::{self, At, GAP_NS, MotionLimits, MotionState};
use super::signals::{Signal, Signals};
use crate::clock::{MILLISECOND_NS, seconds};
use crate::planning::{self, Clearance, Outcome, Plan, Request, View};
use crate::units::within;
use back_off::Way;
use looking::{HEAD_NEAR_RAD, HeadAim, MET_RAD};
use tick::Tick;

/// What is to be reached.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Goal {
    /// Everything unknown that can be reached.
    Explore {
        /// Not further from the start than this, metres.
        within_m: f64,
    },
    /// A place.
    Place {
        /// World x, metres.
        x_m: f64,
        /// World y, metres.
        y_m: f64,
        /// The heading at the end, radians.
        face_rad: Option<f64>,
    },
}

/// A goal and how to drive to it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Order {
    /// What is to be reached.
    pub goal: Goal,
    /// How far the robot's middle stays away from what the map shows, metres.
    pub keep_m: f64,
    /// Metres per second.
    pub speed_m_s: Option<f64>,
    /// Radians per second, on the spot.
    pub turn_rad_s: Option<f64>,
}

/// How far the middle of a usual robot stays away from things, metres: it can turn there.
pub const KEEP_M: f64 = 0.15;

/// What is being done.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
enum Phase {
    #[default]
    Begin,
    /// For a plan.
    Wait,
    Drive,
    /// Towards what is looked at.
    Face,
    Look {
        /// From which angle of the head to which, and whether it is on its way to the second.
        from_rad: f64,
        to_rad: f64,
        back: bool,
    },
    /// Round on the spot, as the sensor is fixed.
    TurnRound,
    BackOff,
    /// The last piece to a place.
    Arrive,
    FaceEnd,
    Done,
}

/// A way under way.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct NavigationState {
    pub(super) order: Option<Order>,
    phase: Phase,
    /// The last request; plans answer it by its serial.
    request: Option<Request>,
    serial: u32,
    plan: Plan,
    /// The plan has not been looked at.
    is_new: bool,
    /// The waypoint that is driven to.
    next: u8,
    /// It turns on the spot to this heading, to face the way; not wrapped.
    pivot_rad: Option<f64>,
    /// It gets out of where it cannot turn, and whether backwards.
    gets_out_back: Option<bool>,
    /// It makes room for a turn: which way, and metres so far.
    makes_room: Option<(Way, f64)>,
    /// The heading at the first step of all, not wrapped.
    first_rad: Option<f64>,
    forward_m_s: f64,
    turn_rad_s: f64,
    last_ns: i64,
    planned_ns: i64,
    /// The head swings to the left.
    head_left: bool,
    /// The next turn round is to the left.
    turns_left: bool,
    /// How many of the spins that exploring begins with it has made.
    spins: u8,
    /// It comes nearer to things than it should, as there is no other way.
    is_tight: bool,
    /// How often it has doubted the map, and tried once more what it tried before.
    doubts: u8,
    /// Efforts in a row that brought it no nearer, and how far from the place that was at least.
    empty: u8,
    nearest_m: Option<f64>,
    /// The bumper was pressed in the step before.
    is_pressed: bool,
    /// Stops in a row, and metres driven at the last one.
    stops: u8,
    stopped_m: f64,
    /// It last drove backwards.
    is_backwards: bool,
    /// The wheels are blocked; how often in one place, and where that is.
    is_blocked: bool,
    blocks: u8,
    blocked_m: [f64; 2],
    /// Each tick brings it, as it does the map.
    #[serde(skip)]
    clearance: Clearance,
}

/// A plan is this old when the next one is asked for, nanoseconds.
const REPLAN_NS: i64 = 1000 * MILLISECOND_NS;

/// The way is steered for so far ahead, metres.
const LOOKAHEAD_M: f64 = 0.13;

/// A way's end is reached within this, metres.
const END_M: f64 = 0.03;

/// A robot that faces further beside its way than the first turns on the spot, up to the second.
const PIVOT_RAD: [f64; 2] = [50.0 * (PI / 180.0), 12.0 * (PI / 180.0)];

/// How many times the error of the heading is turned in a second.
const HOLD_PER_S: f64 = 3.0;

/// On the spot the wheels are slower than on the way by this: it takes the pose with it.
const TURNING: f64 = 0.7;

/// The slowest on the way, metres per second.
const CREEP_M_S: f64 = 0.02;

/// On a narrow way it is no faster, and a robot that finds no other way comes nearer to things by
/// this.
const NARROW_M_S: f64 = 0.045;
const TIGHT: f64 = 0.75;

/// Stops within this are in one place, metres; this number in a row makes it back off.
const SAME_PLACE_M: f64 = 0.10;
const STOPS: u8 = 3;

impl NavigationState {
    /// Whether the goal is reached, or nothing is left to explore.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.phase == Phase::Done
    }

    /// The request for a plan that is not answered yet.
    #[must_use]
    pub fn request(&self) -> Option<&Request> {
        self.request.as_ref().filter(|request| request.serial != self.plan.serial)
    }

    /// The plan to the request.
    pub(super) fn answer(&mut self, plan: &Plan) {
        if self.request().is_some_and(|request| request.serial == plan.serial) {
            self.plan.clone_from(plan);
            self.is_new = true;
        }
    }

    /// Nothing under way; requests count on.
    pub(super) fn reset(&mut self) {
        let Self { serial, turns_left, spins, head_left, first_rad, .. } = *self;
        *self = Self { serial, turns_left, spins, head_left, first_rad, ..Self::default() };
        self.plan.serial = serial;
    }

    /// One tick: what the wheels are to do, and where the head is to point.
    ///
    /// - `order`: asked for once.
    /// - `motion`: what is done besides following a way.
    pub(super) fn step(
        &mut self,
        order: impl FnOnce() -> Option<Order>,
        motion: &mut MotionState,
        signals: &Signals,
        limits: &MotionLimits,
    ) -> (Drive, Option<HeadAim>) {
        let Some(at) = At::of(signals) else { return (Drive::STILL, None) };
        self.order = self.order.or_else(order);
        let Some(order) = self.order else { return (Drive::STILL, None) };
        let step_ns = signals.time_ns().saturating_sub(self.last_ns);
        self.last_ns = signals.time_ns();
        let step_s = if (0..GAP_NS).contains(&step_ns) { seconds(step_ns) } else { 0.0 };
        if step_s <= 0.0 {
            self.rest();
        }
        let first_rad = *self.first_rad.get_or_insert(at.heading_rad);
        let keep_m = self.keep_m(&order);
        let tick = Tick { first_rad, keep_m, order, at, signals, limits, step_s };
        let was_pressed = std::mem::replace(&mut self.is_pressed, tick.is_pressed());
        if std::mem::take(&mut self.is_blocked) {
            self.blocked(at, motion);
        } else if self.is_pressed
            && !was_pressed
            && matches!(self.phase, Phase::Drive | Phase::Arrive)
        {
            self.back_off(motion, Way::Back);
        }
        let drive = match self.phase {
            Phase::Begin => {
                match order.goal {
                    Goal::Explore { .. } => self.look_round(&tick, motion, PI),
                    Goal::Place { .. } => self.ask(&tick, None, None),
                }
                Drive::STILL
            }
            Phase::Wait => {
                if self.is_new {
                    self.adopt(&tick, motion);
                }
                Drive::STILL
            }
            Phase::Drive => self.drive(&tick, motion),
            Phase::Look { from_rad, to_rad, back } => {
                let target_rad = if back { to_rad } else { from_rad };
                let head_rad = tick.head_rad();
                if (head_rad - target_rad).abs() < HEAD_NEAR_RAD {
                    if back {
                        self.looked(&tick, motion, View::Ahead);
                    } else {
                        self.phase = Phase::Look { from_rad, to_rad, back: true };
                    }
                }
                Drive::STILL
            }
            Phase::Face | Phase::TurnRound | Phase::BackOff | Phase::Arrive | Phase::FaceEnd => {
                self.moving(&tick, motion)
            }
            Phase::Done => Drive::STILL,
        };
        if let Drive::Twist { forward_m_s, .. } = drive
            && forward_m_s != 0.0
        {
            self.is_backwards = forward_m_s < 0.0;
        }
        (drive, self.head(&tick))
    }

    /// A motion of its own, and what follows it.
    fn moving(&mut self, tick: &Tick<'_>, motion: &mut MotionState) -> Drive {
        if self.phase == Phase::Arrive && tick.is_ahead(0.0).is_some() {
            self.stop(tick, motion, 0.0);
            return Drive::STILL;
        }
        let drive = motion.step(|| None, tick.signals, tick.limits);
        let is_stopped = self.phase == Phase::BackOff
            && Way::of(drive).is_some_and(|way| self.is_closed(tick, way));
        if motion.is_done() || is_stopped {
            match self.phase {
                Phase::Face => self.look_at(tick, self.plan.goal()),
                Phase::TurnRound => self.looked(tick, motion, View::Around),
                Phase::Arrive => self.face_end(tick, motion),
                Phase::FaceEnd => self.phase = Phase::Done,
                _ if matches!(tick.order.goal, Goal::Explore { .. }) => {
                    self.look_round(tick, motion, MET_RAD);
                }
                _ => self.try_harder(tick, motion),
            }
            return Drive::STILL;
        }
        drive
    }

    fn rest(&mut self) {
        (self.forward_m_s, self.turn_rad_s) = (0.0, 0.0);
    }

    fn ask(&mut self, tick: &Tick<'_>, looked: Option<View>, obstacle: Option<[f64; 2]>) {
        let goal = match tick.order.goal {
            Goal::Explore { within_m } => planning::Goal::Frontier { within_m },
            Goal::Place { x_m, y_m, .. } => planning::Goal::Place { x_m, y_m },
        };
        self.serial = self.serial.wrapping_add(1);
        let serial = self.serial;
        let keep_m = self.keep_m(&tick.order);
        let turn_m = tick.order.keep_m;
        let again = false;
        self.request = Some(Request { serial, goal, keep_m, turn_m, looked, again, obstacle });
        self.is_new = false;
        if self.phase != Phase::Drive || looked.is_some() || obstacle.is_some() {
            self.phase = Phase::Wait;
        }
    }

    /// How far it stays away from things now.
    fn keep_m(&self, order: &Order) -> f64 {
        if self.is_tight { TIGHT * order.keep_m } else { order.keep_m }
    }

    /// A plan has come.
    fn adopt(&mut self, tick: &Tick<'_>, motion: &mut MotionState) {
        self.is_new = false;
        self.planned_ns = tick.signals.time_ns();
        self.next = 0;
        if self.plan.outcome == Outcome::Nothing {
            self.try_harder(tick, motion);
            return;
        }
        if self.leads_away(tick) && !self.is_tight {
            self.is_tight = true;
            self.phase = Phase::Wait;
            self.ask(tick, None, None);
            return;
        }
        self.phase = Phase::Drive;
    }

    /// Along the way.
    fn drive(&mut self, tick: &Tick<'_>, motion: &mut MotionState) -> Drive {
        if self.is_new {
            self.adopt(tick, motion);
            if self.phase != Phase::Drive {
                return Drive::STILL;
            }
        } else if self.request().is_none()
            && tick.signals.time_ns().saturating_sub(self.planned_ns) > REPLAN_NS
        {
            self.ask(tick, None, None);
        }
        let Some((target, left_m)) = self.target(tick.at) else {
            self.rest();
            self.reached(tick, motion);
            return Drive::STILL;
        };
        let (_, bearing_rad) = tick.at.to(target[0], target[1]);
        if let Some(drive) = self.get_out(tick, bearing_rad) {
            return drive;
        }
        if self.pivot_rad.is_none() && bearing_rad.abs() > PIVOT_RAD[0] {
            self.pivot_rad = Some(tick.at.heading_rad + tick.turn_rad(bearing_rad));
        }
        let pivot_rad = self.pivot_rad.map(|to_rad| to_rad - tick.at.heading_rad);
        let pivot_rad = pivot_rad.filter(|left_rad| left_rad.abs() > PIVOT_RAD[1]);
        if pivot_rad.is_none() {
            (self.pivot_rad, self.makes_room) = (None, None);
        } else if let Some(drive) = self.make_room(tick) {
            return drive;
        }
        if pivot_rad.is_none() && tick.is_ahead(bearing_rad).is_some() {
            self.stop(tick, motion, bearing_rad);
            return Drive::STILL;
        }
        let limits = tick.limits;
        let fastest_m_s = tick.order.speed_m_s.unwrap_or(limits.speed_m_s).min(limits.max_m_s);
        let is_narrow = self.plan.is_narrow(usize::from(self.next));
        let fastest_m_s = if is_narrow { fastest_m_s.min(NARROW_M_S) } else { fastest_m_s };
        let turning_m_s = TURNING * limits.speed_m_s;
        let most_rad_s = tick.order.turn_rad_s.unwrap_or(turning_m_s / limits.half_track_m);
        let braking_m_s = libm::sqrt(limits.acceleration_m_s2 * left_m);
        let (forward_m_s, turn_rad_s) = if let Some(pivot_rad) = pivot_rad {
            (0.0, HOLD_PER_S * pivot_rad)
        } else {
            let forward_m_s = (fastest_m_s * libm::cos(bearing_rad)).min(braking_m_s);
            let away_rad_s = self.away_rad_s(tick, Way::Ahead);
            (forward_m_s.max(CREEP_M_S), HOLD_PER_S * bearing_rad + away_rad_s)
        };
        let turn_rad_s = within(turn_rad_s, -most_rad_s, most_rad_s);
        self.twist(tick, forward_m_s, turn_rad_s)
    }

    /// Towards a twist, by what the acceleration allows in a tick.
    fn twist(&mut self, tick: &Tick<'_>, forward_m_s: f64, turn_rad_s: f64) -> Drive {
        let more_m_s = tick.limits.acceleration_m_s2 * tick.step_s;
        let more_rad_s = more_m_s / tick.limits.half_track_m;
        self.forward_m_s = toward(self.forward_m_s, forward_m_s, more_m_s);
        self.turn_rad_s = toward(self.turn_rad_s, turn_rad_s, more_rad_s);
        Drive::Twist { forward_m_s: self.forward_m_s, turn_rad_s: self.turn_rad_s }
    }

    /// The place to steer for, and how far the way's end is; none at the end.
    fn target(&mut self, at: At) -> Option<([f64; 2], f64)> {
        let far_m = |place: [f64; 2]| at.to(place[0], place[1]).0;
        let left = self.plan.waypoints().enumerate().skip(usize::from(self.next));
        let nearest = left.min_by(|(_, one), (_, other)| far_m(*one).total_cmp(&far_m(*other)));
        let (nearest, _) = nearest?;
        self.next = u8::try_from(nearest).unwrap_or(u8::MAX);
        let end = self.plan.waypoints().next_back()?;
        let count = self.plan.waypoints().len();
        let end_m = far_m(end);
        if nearest + 2 >= count && end_m < END_M || nearest + 1 == count && end_m < 2.0 * END_M {
            return None;
        }
        let mut ahead = self.plan.waypoints().skip(nearest);
        let target = ahead.find(|place| far_m(*place) > LOOKAHEAD_M).unwrap_or(end);
        // Where the way is longer than what is told of it, it does not end there.
        Some((target, if self.plan.whole { end_m.max(far_m(target)) } else { f64::INFINITY }))
    }

    /// Something is in the way, which leads so far beside straight ahead.
    fn stop(&mut self, tick: &Tick<'_>, motion: &mut MotionState, way_rad: f64) {
        self.rest();
        if let Goal::Place { x_m, y_m, .. } = tick.order.goal
            && tick.at.to(x_m, y_m).0 < tick.order.keep_m
        {
            if self.is_tight {
                // It may come no nearer.
                self.face_end(tick, motion);
            } else {
                self.is_tight = true;
                self.ask(tick, None, None);
            }
            return;
        }
        if self.phase == Phase::Arrive || self.is_near_end(tick) {
            self.try_harder(tick, motion);
            return;
        }
        let obstacle = tick.is_ahead(way_rad);
        let travelled_m = tick.signals.get(Signal::Travelled).unwrap_or(self.stopped_m);
        let is_same_place = (travelled_m - self.stopped_m).abs() < SAME_PLACE_M;
        self.stops = if is_same_place { self.stops.saturating_add(1) } else { 1 };
        self.stopped_m = travelled_m;
        if self.stops >= STOPS {
            self.back_off(motion, Way::Back);
            return;
        }
        self.ask(tick, None, obstacle);
    }

    fn begin(&mut self, phase: Phase, motion: &mut MotionState, goal: motion::Goal) {
        let turn_rad_s = self.order.and_then(|order| order.turn_rad_s);
        // What is behind is not seen, and the last piece may lead near to things.
        let speed_m_s = Some(NARROW_M_S);
        *motion = MotionState::with(motion::Order { goal, speed_m_s, turn_rad_s });
        self.phase = phase;
    }
}

/// A value on its way to another, by a step at most.
fn toward(from: f64, to: f64, most: f64) -> f64 {
    from + (to - from).clamp(-most, most)
}
