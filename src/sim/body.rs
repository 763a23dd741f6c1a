//! Two-wheeled bodies: wheels that grip and slip, outlines that stop at walls and at each other.
//!
//! Each step collects what may touch and then solves for impulses: both wheels' grip, the tyres'
//! hold sideways, each contact's push and friction, one after the other, round and round, each held
//! to its limit (sequential impulses, E. Catto, "Iterative Dynamics with Temporal Coherence",
//! 2005). A contact counts before it is reached, and allows just the speed that closes the gap in
//! one step, so nothing tunnels; what rounding leaves of an overlap is pushed out.
//!
//! # Not here
//!
//! No electricity: `sim::motor`. No sensors: `sim::sensors`.
//!
//! # What we count on
//!
//! - The centre of mass is at the middle of the axle, the caster only drags.
//! - A body moves less than [`MARGIN_M`] in a step: 5 m/s.

use super::motor::{Motor, MotorConstants, toward_zero};
use super::world::geometry::{Point, Segment, Surfaces, direction, perpendicular, sides};
use super::world::robot::RobotModel;

/// How near a surface is for a contact to be looked at.
const MARGIN_M: f64 = 0.01;
/// Rounds of the solver; with two contacts and two wheels the rest error is far below a micrometre
/// a step.
const ROUNDS: usize = 12;
/// Plastic on concrete.
const WALL_FRICTION: f64 = 0.3;
/// What a head adds to its motor's shaft: about 50 g, 3 cm from the axis, through 12:36.
const HEAD_LOAD_KG_M2: f64 = 0.000_005;
const HEAD_FRICTION_NM: f64 = 0.002;
/// Acceleration by gravity.
const GRAVITY_M_S2: f64 = 9.81;

/// A robot's outline as a core polygon with a radius round it.
#[derive(Debug, Clone, Copy)]
pub(in crate::sim) struct Outline {
    core: [Point; 4],
    corner_m: f64,
}

impl Outline {
    /// The outline of a model, in its own frame.
    pub(in crate::sim) fn new(model: &RobotModel) -> Self {
        let corner_m = model.corner_m;
        let (front, rear) = (model.front_m - corner_m, corner_m - model.rear_m);
        let side = model.half_width_m - corner_m;
        let core = [
            Point::new(rear, -side),
            Point::new(front, -side),
            Point::new(front, side),
            Point::new(rear, side),
        ];
        Self { core, corner_m }
    }

    /// The outline at a pose.
    pub(in crate::sim) fn at(&self, place: Point, heading_rad: f64) -> Self {
        let ahead = direction(heading_rad);
        let aside = perpendicular(ahead);
        Self { core: self.core.map(|p| place + ahead * p.x + aside * p.y), corner_m: self.corner_m }
    }

    /// The four straight sides, moved out to the radius: what other robots' sensors see.
    pub(in crate::sim) fn hull(&self) -> [Segment; 4] {
        let [a, b, c, d] = self.core;
        let ahead = unit(b - a) * self.corner_m;
        let aside = unit(d - a) * self.corner_m;
        let corners = [a - ahead - aside, b + ahead - aside, c + ahead + aside, d - ahead + aside];
        let [p, q, r, s] = corners;
        [(p, q), (q, r), (r, s), (s, p)].map(|(from, to)| Segment { from, to })
    }

    /// Distance from the outline to the nearest surface; negative inside, at most by the corner's
    /// radius.
    pub(in crate::sim) fn clearance(&self, surfaces: &Surfaces) -> f64 {
        let walls = surfaces.segments.iter().map(|segment| self.segment_gap(segment));
        let posts =
            surfaces.discs.iter().map(|disc| self.nearest_core(disc.centre).1 - disc.radius_m);
        walls.chain(posts).fold(f64::INFINITY, f64::min) - self.corner_m
    }

    /// True where a place is inside the core.
    pub(in crate::sim) fn covers(&self, place: Point) -> bool {
        super::world::geometry::contains(&self.core, place)
    }

    fn segment_gap(&self, segment: &Segment) -> f64 {
        if self.covers(segment.from) || sides(&self.core, true).any(|side| side.crosses(segment)) {
            return 0.0;
        }
        let corners = self.core.iter().map(|p| (segment.closest(*p) - p).norm());
        let ends = [segment.from, segment.to].map(|end| self.nearest_core(end).1);
        corners.chain(ends).fold(f64::INFINITY, f64::min)
    }

    /// The core's point nearest to a place, and its distance.
    fn nearest_core(&self, place: Point) -> (Point, f64) {
        let of_side = |side: Segment| {
            let point = side.closest(place);
            (point, (point - place).norm())
        };
        let start = (self.core[0], f64::INFINITY);
        sides(&self.core, true)
            .map(of_side)
            .fold(start, |best, next| if next.1 < best.1 { next } else { best })
    }

    fn reach(&self, centre: Point) -> f64 {
        self.core.iter().map(|p| (p - centre).norm()).fold(0.0, f64::max) + self.corner_m
    }
}

fn unit(vector: Point) -> Point {
    vector.try_normalize(1e-9).unwrap_or_default()
}

/// One robot's body: where it is, how it moves, and what drives it.
#[derive(Debug, Clone)]
pub(in crate::sim) struct Body {
    pub(in crate::sim) place: Point,
    /// Not wrapped.
    pub(in crate::sim) heading_rad: f64,
    pub(in crate::sim) velocity: Point,
    pub(in crate::sim) turning_rad_s: f64,
    pub(in crate::sim) travelled_m: f64,
    pub(in crate::sim) touching: bool,
    /// Ahead, left, behind, right.
    pub(in crate::sim) bumped: [bool; 4],
    pub(in crate::sim) outline: Outline,
    /// By output port.
    pub(in crate::sim) motors: [Option<Motor>; 4],
    pub(in crate::sim) wheels: [Wheel; 2],
    /// The impulses of the wheels' grip, and of the tyres' hold sideways.
    grips: [f64; 3],
    /// From the axle to where the corners begin: ahead, left, behind, right.
    sides_m: [f64; 4],
    inverse_mass: f64,
    inverse_inertia: f64,
    half_track_m: f64,
    drag_n: f64,
    grip_n: f64,
}

impl Body {
    pub(in crate::sim) fn new(
        model: &RobotModel,
        place: Point,
        heading_rad: f64,
        wheels: [Wheel; 2],
    ) -> Self {
        let (length, width) = (model.front_m + model.rear_m, 2.0 * model.half_width_m);
        let inertia = model.mass_kg * (length * length + width * width) / 12.0;
        Self {
            place,
            heading_rad,
            velocity: Point::zeros(),
            turning_rad_s: 0.0,
            travelled_m: 0.0,
            touching: false,
            bumped: [false; 4],
            outline: Outline::new(model),
            motors: motors(model),
            wheels,
            grips: [0.0; 3],
            sides_m: [model.front_m, model.half_width_m, model.rear_m, model.half_width_m]
                .map(|side_m| side_m - model.corner_m),
            inverse_mass: 1.0 / model.mass_kg,
            inverse_inertia: 1.0 / inertia,
            half_track_m: model.track_width_m / 2.0,
            drag_n: model.caster_drag * model.mass_kg * GRAVITY_M_S2,
            grip_n: model.grip_n,
        }
    }

    /// The outline where the body is now.
    pub(in crate::sim) fn outline_now(&self) -> Outline {
        self.outline.at(self.place, self.heading_rad)
    }

    fn push(&mut self, impulse: Point, lever: Point) {
        self.velocity += impulse * self.inverse_mass;
        self.turning_rad_s += lever.perp(&impulse) * self.inverse_inertia;
    }

    fn drag(&mut self, step_s: f64) {
        let speed = self.velocity.norm();
        if speed > 0.0 {
            self.velocity *= toward_zero(speed, self.drag_n * self.inverse_mass * step_s) / speed;
        }
    }

    fn velocity_at(&self, lever: Point) -> Point {
        self.velocity + perpendicular(lever) * self.turning_rad_s
    }

    fn response(&self, lever: Point, along: Point) -> f64 {
        let arm = lever.perp(&along);
        self.inverse_mass + arm * arm * self.inverse_inertia
    }

    /// The motor that is plugged in on an output port.
    pub(in crate::sim) fn motor(&self, out: usize) -> Option<&Motor> {
        self.motors.get(out)?.as_ref()
    }

    /// Where a wheel pushes the body, which looks `ahead`.
    fn lever(&self, wheel: Wheel, ahead: Point) -> Point {
        perpendicular(ahead) * (-wheel.side * self.half_track_m)
    }

    /// Lets a wheel push the ground, which pushes the body and slows the motor.
    fn push_off(&mut self, wheel: Wheel, ahead: Point, impulse: f64) {
        if let Some(motor) = self.motors.get_mut(wheel.out).and_then(Option::as_mut) {
            motor.speed_rad_s -= impulse * wheel.ground_m_per_rad / motor.inertia_kg_m2;
            self.push(ahead * impulse, self.lever(wheel, ahead));
        }
    }

    /// Starts from the grip of the step before: a wheel that pushes a wall would else creep by what
    /// the rounds leave over.
    fn begin(&mut self, ahead: Point) {
        let [left, right, hold] = self.grips;
        for (wheel, impulse) in self.wheels.into_iter().zip([left, right]) {
            self.push_off(wheel, ahead, impulse);
        }
        self.push(perpendicular(ahead) * hold, Point::zeros());
    }

    /// One round of both wheels' grip and of the tyres' hold sideways.
    fn grip(&mut self, ahead: Point, step_s: f64) {
        let limit = self.grip_n * step_s;
        let [mut left, mut right, hold] = self.grips;
        for (wheel, total) in self.wheels.into_iter().zip([&mut left, &mut right]) {
            let Some(motor) = self.motor(wheel.out) else { continue };
            let (lever, reduction) = (self.lever(wheel, ahead), wheel.ground_m_per_rad);
            let slipping = self.velocity_at(lever).dot(&ahead) - motor.speed_rad_s * reduction;
            let response =
                self.response(lever, ahead) + reduction * reduction / motor.inertia_kg_m2;
            let next = (*total - slipping / response).clamp(-limit, limit);
            self.push_off(wheel, ahead, next - *total);
            *total = next;
        }
        let aside = perpendicular(ahead);
        let sliding = self.velocity.dot(&aside);
        let next = (hold - sliding / self.inverse_mass).clamp(-2.0 * limit, 2.0 * limit);
        self.push(aside * (next - hold), Point::zeros());
        self.grips = [left, right, next];
    }
}

/// What is plugged in, at rest.
fn motors(model: &RobotModel) -> [Option<Motor>; 4] {
    let mut motors = [None; 4];
    for (out, (slot, kind)) in motors.iter_mut().zip(model.plug.motors).enumerate() {
        let (load, friction) =
            if model.head == Some(out) { (HEAD_LOAD_KG_M2, HEAD_FRICTION_NM) } else { (0.0, 0.0) };
        *slot = kind.map(|kind| Motor::new(MotorConstants::of(kind), load, friction));
    }
    motors
}

/// A wheel's part in one step.
#[derive(Debug, Clone, Copy)]
pub(in crate::sim) struct Wheel {
    /// Output port of its motor.
    pub(in crate::sim) out: usize,
    /// −1 left, 1 right.
    pub(in crate::sim) side: f64,
    /// Metres of ground for a radian of the motor, with sign; 0 where no motor is plugged in.
    pub(in crate::sim) ground_m_per_rad: f64,
}

#[derive(Debug, Clone, Copy)]
struct Contact {
    body: usize,
    other: Option<usize>,
    /// Away from the surface, toward `body`.
    normal: Point,
    lever: Point,
    other_lever: Point,
    gap_m: f64,
    pushed: f64,
    rubbed: f64,
}

/// The solver, with room for its contacts.
#[derive(Debug, Default)]
pub(in crate::sim) struct Solver {
    contacts: Vec<Contact>,
    /// Where each body looks.
    aheads: Vec<Point>,
}

impl Solver {
    pub(in crate::sim) fn new(bodies: usize) -> Self {
        Self { contacts: Vec::with_capacity(32 * bodies), aheads: Vec::with_capacity(bodies) }
    }

    /// Moves all bodies by `step_s`; the motors have been driven, and get the ground's reaction.
    pub(in crate::sim) fn step(&mut self, bodies: &mut [Body], surfaces: &Surfaces, step_s: f64) {
        self.collect(bodies, surfaces);
        // No body turns within the rounds, and a sine is slow in soft float.
        self.aheads.clear();
        self.aheads.extend(bodies.iter().map(|body| direction(body.heading_rad)));
        for (body, ahead) in bodies.iter_mut().zip(&self.aheads) {
            body.drag(step_s);
            body.begin(*ahead);
        }
        // Walls answer first: the wheels already push as in the step before.
        self.contacts.iter_mut().for_each(|contact| resist(contact, bodies, step_s));
        for _ in 0..ROUNDS {
            for (body, ahead) in bodies.iter_mut().zip(&self.aheads) {
                body.grip(*ahead, step_s);
            }
            for contact in &mut self.contacts {
                resist(contact, bodies, step_s);
            }
        }
        for body in bodies.iter_mut() {
            let path = body.velocity * step_s;
            body.place += path;
            body.travelled_m += path.norm();
            body.heading_rad += body.turning_rad_s * step_s;
        }
        self.separate(bodies, step_s);
    }

    fn collect(&mut self, bodies: &[Body], surfaces: &Surfaces) {
        self.contacts.clear();
        for (index, body) in bodies.iter().enumerate() {
            let outline = body.outline_now();
            let reach = outline.reach(body.place) + MARGIN_M;
            for segment in &surfaces.segments {
                if (segment.closest(body.place) - body.place).norm() < reach {
                    self.against_segment(index, body, &outline, segment, None, 0.0);
                }
            }
            for disc in &surfaces.discs {
                let (core, distance) = outline.nearest_core(disc.centre);
                let gap_m = distance - disc.radius_m - outline.corner_m;
                self.add(index, body, None, core, disc.centre, gap_m);
            }
            for (other_index, other) in bodies.iter().enumerate().skip(index + 1) {
                let hull = other.outline_now();
                if (other.place - body.place).norm() < reach + hull.reach(other.place) {
                    for side in sides(&hull.core, true) {
                        let partner = Some((other_index, other));
                        self.against_segment(index, body, &outline, &side, partner, hull.corner_m);
                    }
                }
            }
        }
    }

    fn against_segment(
        &mut self,
        index: usize,
        body: &Body,
        outline: &Outline,
        segment: &Segment,
        other: Option<(usize, &Body)>,
        radius_m: f64,
    ) {
        let radii = outline.corner_m + radius_m;
        for corner in outline.core {
            let point = segment.closest(corner);
            self.add(index, body, other, corner, point, (corner - point).norm() - radii);
        }
        for end in [segment.from, segment.to] {
            let (core, distance) = outline.nearest_core(end);
            self.add(index, body, other, core, end, distance - radii);
        }
    }

    fn add(
        &mut self,
        body_index: usize,
        body: &Body,
        other: Option<(usize, &Body)>,
        core: Point,
        surface: Point,
        gap_m: f64,
    ) {
        if gap_m > MARGIN_M {
            return;
        }
        let apart = core - surface;
        let normal = apart.try_normalize(1e-9).unwrap_or_else(|| unit(body.place - surface));
        let touch = core - normal * body.outline.corner_m;
        self.contacts.push(Contact {
            body: body_index,
            other: other.map(|(index, _)| index),
            normal,
            lever: touch - body.place,
            other_lever: other.map_or(Point::zeros(), |(_, other)| touch - other.place),
            gap_m,
            pushed: 0.0,
            rubbed: 0.0,
        });
    }

    /// Says who touches what, and pushes out what overlaps.
    fn separate(&mut self, bodies: &mut [Body], step_s: f64) {
        for body in bodies.iter_mut() {
            body.touching = false;
            body.bumped = [false; 4];
        }
        for contact in &self.contacts {
            let left_m = contact.gap_m + closing(contact, bodies) * step_s;
            let share = if contact.other.is_some() { 0.5 } else { 1.0 };
            let out = contact.normal * ((-left_m).max(0.0) * share);
            let body = &mut bodies[contact.body];
            body.place += out;
            body.note_touch(contact.lever, contact.pushed);
            if let Some(other) = contact.other.map(|other| &mut bodies[other]) {
                other.place -= out;
                other.note_touch(contact.other_lever, contact.pushed);
            }
        }
    }
}

impl Body {
    /// Where a place of the robot is, metres ahead of the axle and left of the middle.
    pub(in crate::sim) fn place_of(&self, [ahead_m, left_m]: [f64; 2]) -> Point {
        let ahead = direction(self.heading_rad);
        self.place + ahead * ahead_m + perpendicular(ahead) * left_m
    }

    fn note_touch(&mut self, lever: Point, pushed: f64) {
        if pushed > 0.0 {
            self.touching = true;
            let ahead = direction(self.heading_rad);
            let left = perpendicular(ahead);
            let out_m = [ahead, left, -ahead, -left].map(|side| lever.dot(&side));
            for (bumped, (out_m, side_m)) in
                self.bumped.iter_mut().zip(out_m.iter().zip(self.sides_m))
            {
                *bumped |= *out_m > side_m;
            }
        }
    }
}

/// Relative speed along the contact's normal; negative approaches.
fn closing(contact: &Contact, bodies: &[Body]) -> f64 {
    relative(contact, bodies).dot(&contact.normal)
}

fn relative(contact: &Contact, bodies: &[Body]) -> Point {
    let own = bodies[contact.body].velocity_at(contact.lever);
    contact.other.map_or(own, |other| own - bodies[other].velocity_at(contact.other_lever))
}

/// One round of a contact: no approach beyond the gap, and friction along the surface.
fn resist(contact: &mut Contact, bodies: &mut [Body], step_s: f64) {
    let normal = contact.normal;
    let too_fast = closing(contact, bodies) + contact.gap_m.max(0.0) / step_s;
    let pushed = (contact.pushed - too_fast / answer(contact, bodies, normal)).max(0.0);
    let push = normal * (pushed - contact.pushed);
    contact.pushed = pushed;
    apply(contact, bodies, push);
    let along = perpendicular(normal);
    let sliding = relative(contact, bodies).dot(&along);
    let limit = WALL_FRICTION * contact.pushed;
    let rubbed = (contact.rubbed - sliding / answer(contact, bodies, along)).clamp(-limit, limit);
    let rub = along * (rubbed - contact.rubbed);
    contact.rubbed = rubbed;
    apply(contact, bodies, rub);
}

fn answer(contact: &Contact, bodies: &[Body], along: Point) -> f64 {
    let own = bodies[contact.body].response(contact.lever, along);
    contact.other.map_or(own, |other| own + bodies[other].response(contact.other_lever, along))
}

fn apply(contact: &Contact, bodies: &mut [Body], impulse: Point) {
    bodies[contact.body].push(impulse, contact.lever);
    if let Some(other) = contact.other {
        bodies[other].push(-impulse, contact.other_lever);
    }
}
