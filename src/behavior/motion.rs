//! Motions that end: straight ahead, on the spot, along an arc, to a place.
//!
//! A motion is decided tick by tick from the estimated pose, as a speed for that tick; the leases
//! below it are the same as for any other demand. Its speed grows and shrinks with the robot's
//! acceleration, and a straight line holds its heading and comes back to the line. All speeds are
//! those of the faster wheel along the floor, so that one profile serves lines, turns and arcs.
//!
//! A motion has arrived where what is left is within a millimetre or two of wheel's way; it is done
//! when the robot has stood there for a moment, so that the next one begins at rest.
//!
//! # Not here
//!
//! No obstacles: a state's conditions look for them. A wheel that is blocked is the runtime's. No
//! ways over the map: [`super::navigation`].

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use serde::{Deserialize, Serialize};

use super::demands::Drive;
use super::signals::{Signal, Signals};
use crate::clock::{MILLISECOND_NS, SECOND_NS, seconds};
use crate::units::{within, wrap_rad};

/// What a robot's motions keep to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionLimits {
    /// The usual speed of a wheel along the floor, metres per second.
    pub speed_m_s: f64,
    /// The fastest that a wheel may be, metres per second.
    pub max_m_s: f64,
    /// The fastest that a wheel may turn, radians per second.
    pub max_wheel_rad_s: f64,
    /// How fast a wheel's speed may grow and shrink, metres per second each second.
    pub acceleration_m_s2: f64,
    /// Half of the way between the wheels, metres.
    pub half_track_m: f64,
    /// How far the head may turn to either side, radians.
    pub head_rad: f64,
    /// How fast the head may turn while it looks out for the wheels, radians per second.
    pub head_max_rad_s: f64,
    /// The range sensor, ahead of the middle between the wheels, metres.
    pub range_ahead_m: f64,
    /// Whether exploring begins with spins, by which the estimator finds out what the gyro counts
    /// for a turn.
    pub spins_first: bool,
}

impl Default for MotionLimits {
    /// Those of a usual LEGO robot.
    fn default() -> Self {
        Self {
            speed_m_s: 0.09,
            max_m_s: 0.19,
            max_wheel_rad_s: TAU,
            acceleration_m_s2: 0.3,
            half_track_m: 0.057,
            head_rad: FRAC_PI_2,
            head_max_rad_s: FRAC_PI_2,
            range_ahead_m: 0.05,
            spins_first: false,
        }
    }
}

/// What a motion is to come to, in metres and radians.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Goal {
    /// Straight on, backwards where negative.
    Ahead {
        /// How far, metres.
        way_m: f64,
    },
    /// On the spot, anticlockwise where positive.
    Turn {
        /// How far, radians.
        turn_rad: f64,
    },
    /// Along a circle: to the left where the turn is positive, backwards where the radius is
    /// negative.
    Arc {
        /// From the circle's middle to the robot's, metres.
        radius_m: f64,
        /// How far to turn, radians.
        turn_rad: f64,
    },
    /// To a place: turns to it, drives there, and turns again where a heading is asked for.
    Place {
        /// World x, metres.
        x_m: f64,
        /// World y, metres.
        y_m: f64,
        /// The heading at the end, radians.
        face_rad: Option<f64>,
    },
}

/// A goal, and the speed that a mission asks for: of the robot's middle, or turning on the spot.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Order {
    /// What to come to.
    pub goal: Goal,
    /// Metres per second.
    pub speed_m_s: Option<f64>,
    /// Radians per second.
    pub turn_rad_s: Option<f64>,
}

/// A motion under way.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct MotionState {
    /// None until all its numbers are known.
    pub(super) order: Option<Order>,
    leg: Option<Leg>,
    /// The faster wheel's speed that was asked for last, metres per second.
    speed_m_s: f64,
    /// When that was, nanoseconds.
    last_ns: i64,
    /// When this leg first had arrived.
    arrived_ns: Option<i64>,
    done: bool,
}

/// A part of a motion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
enum Leg {
    Line {
        x_m: f64,
        y_m: f64,
        heading_rad: f64,
        way_m: f64,
    },
    Turn {
        to_rad: f64,
    },
    /// Round a middle that is `radius_m` to the left, or to the right where that is negative.
    Arc {
        x_m: f64,
        y_m: f64,
        radius_m: f64,
        to_rad: f64,
    },
}

/// Where the robot is; its heading is not wrapped.
#[derive(Debug, Clone, Copy)]
pub(super) struct At {
    pub(super) x_m: f64,
    pub(super) y_m: f64,
    pub(super) heading_rad: f64,
}

/// Within so much of a line's end the robot has arrived, metres.
const NEAR_M: f64 = 0.002;

/// Within so much of a turn's end it has arrived, radians.
const NEAR_RAD: f64 = 0.4 * (PI / 180.0);

/// A robot that has rolled on is still there within this many times that.
const LEEWAY: f64 = 2.0;

/// A place is reached within this, else it is driven to once more, metres.
const PLACE_M: f64 = 0.015;

/// For how long it has to stand there, and for how long it tries at most to get nearer,
/// nanoseconds.
const STAND_NS: i64 = 150 * MILLISECOND_NS;
const TRY_NS: i64 = 2 * SECOND_NS;

/// The slowest that a wheel is asked to turn: more slowly it sticks, metres per second.
const CREEP_M_S: f64 = 0.006;

/// Near the end, how many times what is left is driven in a second: motors follow a speed with a
/// delay of about a tenth of a second, and a third of that rate does not overshoot.
const APPROACH_PER_S: f64 = 4.0;

/// How many times the error of the heading is turned in a second.
const HOLD_PER_S: f64 = 4.0;

/// A line is steered for so far ahead, metres.
const LOOKAHEAD_M: f64 = 0.12;

/// At most this part of the speed is for steering.
const STEERING: f64 = 0.4;

/// A step that took longer begins again from rest, nanoseconds: the robot waited for something.
pub(super) const GAP_NS: i64 = 200 * MILLISECOND_NS;

impl MotionState {
    /// A motion that begins with the next step.
    pub(super) fn with(order: Order) -> Self {
        Self { order: Some(order), ..Self::default() }
    }

    /// Whether the motion has come to its end.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.done
    }

    /// One tick: what the wheels are to do. Until the order and the robot's place are known they
    /// stand still.
    ///
    /// - `order`: asked for once.
    pub(super) fn step(
        &mut self,
        order: impl FnOnce() -> Option<Order>,
        signals: &Signals,
        limits: &MotionLimits,
    ) -> Drive {
        let Some(at) = At::of(signals) else { return Drive::STILL };
        self.order = self.order.or_else(order);
        let Some(order) = self.order else { return Drive::STILL };
        let now_ns = signals.time_ns();
        let step_ns = now_ns.saturating_sub(self.last_ns);
        if !(0..GAP_NS).contains(&step_ns) {
            (self.speed_m_s, self.last_ns) = (0.0, now_ns);
        }
        if self.leg.is_none() && !self.done {
            self.begin(first(order.goal, at));
        }
        let Some(leg) = self.leg else { return Drive::STILL };
        let profile = Profile {
            fastest_m_s: order.fastest_m_s(leg, limits),
            acceleration_m_s2: limits.acceleration_m_s2,
            step_s: seconds(now_ns.saturating_sub(self.last_ns)),
            stays: self.arrived_ns.is_some(),
        };
        self.last_ns = now_ns;
        let (missing_m, near_m) = leg.missing(at, limits);
        let Some(speed_m_s) = profile.speed_m_s(self.speed_m_s, missing_m, near_m) else {
            self.speed_m_s = 0.0;
            self.arrive(order.goal, leg, at, now_ns);
            return Drive::STILL;
        };
        self.speed_m_s = speed_m_s;
        if self.arrived_ns.is_some_and(|arrived_ns| now_ns.saturating_sub(arrived_ns) > TRY_NS) {
            self.finish(order.goal, leg, at);
            return Drive::STILL;
        }
        leg.twist(speed_m_s, at, limits)
    }

    fn begin(&mut self, leg: Option<Leg>) {
        self.leg = leg;
        self.arrived_ns = None;
        self.done = leg.is_none();
    }

    /// The leg has arrived; once the robot has stood there, the next one begins.
    fn arrive(&mut self, goal: Goal, leg: Leg, at: At, now_ns: i64) {
        let arrived_ns = *self.arrived_ns.get_or_insert(now_ns);
        if now_ns.saturating_sub(arrived_ns) >= STAND_NS {
            self.finish(goal, leg, at);
        }
    }

    fn finish(&mut self, goal: Goal, leg: Leg, at: At) {
        self.begin(next(goal, leg, at));
    }
}

/// The first leg to a goal; `None` where the robot is there.
fn first(goal: Goal, at: At) -> Option<Leg> {
    let At { x_m, y_m, heading_rad } = at;
    Some(match goal {
        Goal::Ahead { way_m } => Leg::Line { x_m, y_m, heading_rad, way_m },
        Goal::Turn { turn_rad } => Leg::Turn { to_rad: heading_rad + turn_rad },
        Goal::Arc { radius_m, turn_rad } => {
            let (sin, cos) = libm::sincos(heading_rad);
            let radius_m = radius_m * turn_rad.signum();
            let to_rad = heading_rad + turn_rad;
            if radius_m.abs() < NEAR_M {
                return Some(Leg::Turn { to_rad });
            }
            let (x_m, y_m) = (x_m - radius_m * sin, y_m + radius_m * cos);
            Leg::Arc { x_m, y_m, radius_m, to_rad }
        }
        Goal::Place { x_m, y_m, face_rad } => {
            let (way_m, bearing_rad) = at.to(x_m, y_m);
            if way_m < PLACE_M {
                let turn_rad = wrap_rad(face_rad? - heading_rad);
                return Some(Leg::Turn { to_rad: heading_rad + turn_rad });
            }
            Leg::Turn { to_rad: heading_rad + bearing_rad }
        }
    })
}

/// What comes after a leg.
fn next(goal: Goal, leg: Leg, at: At) -> Option<Leg> {
    let Goal::Place { x_m, y_m, face_rad } = goal else { return None };
    let (way_m, bearing_rad) = at.to(x_m, y_m);
    match leg {
        _ if way_m < PLACE_M => {
            // The turn at the place is the last leg.
            let face = face_rad.map(|face_rad| wrap_rad(face_rad - at.heading_rad));
            let face = face.filter(|turn_rad| turn_rad.abs() > LEEWAY * NEAR_RAD);
            face.map(|turn_rad| Leg::Turn { to_rad: at.heading_rad + turn_rad })
        }
        Leg::Turn { .. } => {
            let heading_rad = at.heading_rad + bearing_rad;
            Some(Leg::Line { x_m: at.x_m, y_m: at.y_m, heading_rad, way_m })
        }
        Leg::Line { .. } | Leg::Arc { .. } => first(goal, at),
    }
}

impl At {
    pub(super) fn of(signals: &Signals) -> Option<Self> {
        Some(Self {
            x_m: signals.get(Signal::X)?,
            y_m: signals.get(Signal::Y)?,
            heading_rad: signals.get(Signal::Heading)?,
        })
    }

    /// How far a place is, metres, and how far to the left of straight ahead, radians.
    pub(super) fn to(self, x_m: f64, y_m: f64) -> (f64, f64) {
        let (dx_m, dy_m) = (x_m - self.x_m, y_m - self.y_m);
        let bearing_rad = wrap_rad(libm::atan2(dy_m, dx_m) - self.heading_rad);
        (libm::hypot(dx_m, dy_m), bearing_rad)
    }

    /// On a circle round a middle, `radius_m` to the left: the heading that its line has here, not
    /// wrapped, and how far to the left of the line the robot is, metres.
    fn round(self, x_m: f64, y_m: f64, radius_m: f64) -> (f64, f64) {
        let (side_m, down_m) = (self.x_m - x_m, y_m - self.y_m);
        let line_rad = libm::atan2(side_m * radius_m.signum(), down_m * radius_m.signum());
        let outside_m = libm::hypot(side_m, down_m) - radius_m.abs();
        let along_rad = self.heading_rad + wrap_rad(line_rad - self.heading_rad);
        (along_rad, -outside_m * radius_m.signum())
    }

    /// How fast to turn beside what the line itself asks for, so that the robot comes back to a
    /// line of this heading, to whose left it is: radians per second.
    fn steer(self, heading_rad: f64, aside_m: f64, forward_m_s: f64, half_track_m: f64) -> f64 {
        // Backwards the same heading leads to the other side.
        let back_rad = -libm::atan2(aside_m, LOOKAHEAD_M) * forward_m_s.signum();
        let most_rad_s = STEERING * forward_m_s.abs() / half_track_m;
        let turn_rad_s = HOLD_PER_S * (heading_rad + back_rad - self.heading_rad);
        within(turn_rad_s, -most_rad_s, most_rad_s)
    }
}

impl Order {
    /// The fastest that the faster wheel may be on a leg.
    fn fastest_m_s(&self, leg: Leg, limits: &MotionLimits) -> f64 {
        let asked_m_s = match leg {
            Leg::Line { .. } => self.speed_m_s,
            Leg::Turn { .. } => self.turn_rad_s.map(|rad_s| rad_s * limits.half_track_m),
            Leg::Arc { radius_m, .. } => {
                let outer = 1.0 + limits.half_track_m / radius_m.abs();
                self.speed_m_s.map(|speed_m_s| speed_m_s * outer)
            }
        };
        let asked_m_s = asked_m_s.map_or(limits.speed_m_s, f64::abs);
        asked_m_s.clamp(CREEP_M_S, limits.max_m_s.max(CREEP_M_S))
    }
}

impl Leg {
    /// The way of the faster wheel that is left, metres, backwards or clockwise where negative, and
    /// how little of it is nothing.
    fn missing(self, at: At, limits: &MotionLimits) -> (f64, f64) {
        match self {
            Self::Line { x_m, y_m, heading_rad, way_m } => {
                let (sin, cos) = libm::sincos(heading_rad);
                let along_m = (at.x_m - x_m) * cos + (at.y_m - y_m) * sin;
                (way_m - along_m, NEAR_M)
            }
            Self::Turn { to_rad } => {
                let arm_m = limits.half_track_m;
                ((to_rad - at.heading_rad) * arm_m, NEAR_RAD * arm_m)
            }
            Self::Arc { x_m, y_m, radius_m, to_rad } => {
                let arm_m = limits.half_track_m + radius_m.abs();
                let (along_rad, _) = at.round(x_m, y_m, radius_m);
                ((to_rad - along_rad) * arm_m, NEAR_M)
            }
        }
    }

    /// What the robot does for a speed of the faster wheel.
    fn twist(self, speed_m_s: f64, at: At, limits: &MotionLimits) -> Drive {
        let half_track_m = limits.half_track_m;
        match self {
            Self::Line { x_m, y_m, heading_rad, .. } => {
                let (sin, cos) = libm::sincos(heading_rad);
                let aside_m = (at.y_m - y_m) * cos - (at.x_m - x_m) * sin;
                let turn_rad_s = at.steer(heading_rad, aside_m, speed_m_s, half_track_m);
                Drive::Twist { forward_m_s: speed_m_s, turn_rad_s }
            }
            Self::Turn { .. } => {
                Drive::Twist { forward_m_s: 0.0, turn_rad_s: speed_m_s / half_track_m }
            }
            Self::Arc { x_m, y_m, radius_m, .. } => {
                let turn_rad_s = speed_m_s / (half_track_m + radius_m.abs());
                let forward_m_s = radius_m * turn_rad_s;
                let (along_rad, aside_m) = at.round(x_m, y_m, radius_m);
                let steering_rad_s = at.steer(along_rad, aside_m, forward_m_s, half_track_m);
                Drive::Twist { forward_m_s, turn_rad_s: turn_rad_s + steering_rad_s }
            }
        }
    }
}

/// How a speed grows and shrinks.
struct Profile {
    fastest_m_s: f64,
    acceleration_m_s2: f64,
    step_s: f64,
    /// It has arrived before, and may roll on a little.
    stays: bool,
}

impl Profile {
    /// The speed after one that was `last_m_s`, with so much way left; `None` where it is there.
    fn speed_m_s(&self, last_m_s: f64, missing_m: f64, near_m: f64) -> Option<f64> {
        let left_m = missing_m.abs();
        if left_m <= if self.stays { LEEWAY * near_m } else { near_m } || !left_m.is_finite() {
            return None;
        }
        // What is left can still be braked in, and is approached gently at the end.
        let braking_m_s = libm::sqrt(2.0 * self.acceleration_m_s2 * left_m);
        let approach_m_s = APPROACH_PER_S * left_m + CREEP_M_S;
        let before_m_s = (last_m_s * missing_m.signum()).max(0.0);
        let faster_m_s = before_m_s + self.acceleration_m_s2 * self.step_s;
        let wanted_m_s = self.fastest_m_s.min(braking_m_s).min(approach_m_s).min(faster_m_s);
        Some(wanted_m_s.max(CREEP_M_S) * missing_m.signum())
    }
}
