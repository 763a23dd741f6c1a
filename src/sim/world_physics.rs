//! Robots in a world: motors, bodies and sensors under the drivers.
//!
//! [`WorldPhysics`] is the [`Physics`] of a [`World`]. Inside the simulation it is reached only
//! through the trait; an [`Observer`], taken before, still sees where the robots truly are, for
//! scores and pictures.
//!
//! # Not here
//!
//! No driver behaviour, no files: `sim::driver`.
//!
//! # What we count on
//!
//! - One step is [`STEP_NS`]; it allocates nothing once the lists of contacts have grown, and takes
//!   a few microseconds a robot.
//! - The same world, seed, bridges and calls of `measure` give the same bytes on every machine.

mod truth;

use std::f64::consts::PI;
use std::sync::{Arc, Mutex};

pub use self::truth::{Observer, Truth};
use super::body::{Body, Outline, Solver, Wheel};
use super::chance::Chance;
use super::motor::Motor;
use super::physics::{Bridge, Fault, MotorKind, Physics, Plug, STEP_NS, SensorKind};
use super::sensors::{Gyro, Scene, one};
use super::world::geometry::{Point, Surfaces, direction};
use super::world::{RobotModel, StartPose, World};
use crate::clock::seconds;
use crate::senses::Mount;
use crate::threads::lock;
use crate::units::radians;

/// What the brick itself draws, amperes.
const IDLE_A: f64 = 0.18;
/// How fast a tyre's creep wanders, seconds.
const SLIP_S: f64 = 0.5;

/// A world has no place for that many robots: give it more start poses, or start fewer.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "world `{world}` has {}, not {robots}",
    crate::units::counted(*.starts, "start pose")
)]
pub struct NoStartPose {
    /// The world's name.
    pub world: String,
    /// How many it has.
    pub starts: usize,
    /// How many were asked for.
    pub robots: usize,
}

/// Robots in a world.
#[derive(Debug)]
pub struct WorldPhysics {
    world: World,
    steps: i64,
    seed: u64,
    bodies: Vec<Body>,
    rigs: Vec<Rig>,
    solver: Solver,
    truths: Arc<Mutex<Vec<Truth>>>,
}

/// What a robot has besides its body.
#[derive(Debug)]
struct Rig {
    gyro: Gyro,
    head_rad: f64,
    ground_m_per_rad: [f64; 2],
    slip: [f64; 2],
    slip_chance: Chance,
    sensor_chance: [Chance; 4],
    battery_v: f64,
    load_a: f64,
    fallen: bool,
}

impl WorldPhysics {
    /// The first `robots` start poses of a world, each with a robot on it; `seed` draws their
    /// imperfections and all noise.
    ///
    /// # Errors
    ///
    /// [`NoStartPose`] where the world has fewer.
    pub fn new(world: World, robots: usize, seed: u64) -> Result<Self, NoStartPose> {
        let starts = world.starts();
        if robots > starts.len() {
            return Err(NoStartPose {
                world: world.name().to_owned(),
                starts: starts.len(),
                robots,
            });
        }
        let model = world.robot();
        let rigs: Vec<Rig> =
            (0_u64..).take(robots).map(|robot| Rig::new(model, seed, robot)).collect();
        let body = |(start, rig): (&StartPose, &Rig)| {
            let place = Point::new(start.x_m, start.y_m);
            Body::new(model, place, start.heading_rad, rig.wheels(model))
        };
        let bodies = starts.iter().zip(&rigs).map(body).collect();
        let solver = Solver::new(robots);
        let truths = Arc::default();
        let mut physics = Self { world, steps: 0, seed, bodies, rigs, solver, truths };
        physics.publish();
        Ok(physics)
    }

    /// A handle on the truth that stays when the physics has gone into a simulation.
    #[must_use]
    pub fn observer(&self) -> Observer {
        Observer(Arc::clone(&self.truths))
    }

    /// One robot's truth now; `None` where there is no such robot.
    #[must_use]
    pub fn truth(&self, robot: usize) -> Option<Truth> {
        self.observer().truth(robot)
    }

    /// The world.
    #[must_use]
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Puts a robot elsewhere, standing still, as a hand would; the gyro does not notice the turn.
    pub fn carry(&mut self, robot: usize, pose: StartPose) {
        if let Some(body) = self.bodies.get_mut(robot) {
            body.place = Point::new(pose.x_m, pose.y_m);
            body.heading_rad = pose.heading_rad;
            body.velocity = Point::zeros();
            body.turning_rad_s = 0.0;
        }
        // A hand that sets it down has picked it up.
        if let Some(rig) = self.rigs.get_mut(robot) {
            rig.fallen = false;
        }
        self.publish();
    }

    /// True where a robot could stand: on the floor, clear of walls and of other robots.
    fn has_room(&self, robot: usize, pose: StartPose) -> bool {
        let Some(body) = self.bodies.get(robot) else { return false };
        let place = Point::new(pose.x_m, pose.y_m);
        let outline = body.outline.at(place, pose.heading_rad);
        let others = self.bodies.iter().enumerate().filter(|(other, _)| *other != robot);
        let mut others = others.map(|(_, body)| body.outline_now());
        let meets = |other: &Outline| {
            let near = Surfaces { segments: other.hull().to_vec(), ..Surfaces::default() };
            other.covers(place) || outline.clearance(&near) <= 0.0
        };
        self.world.floor.has(place)
            && self.world.is_clear(pose)
            && !others.any(|other| meets(&other))
    }

    /// How far a robot's outline is from the nearest surface, metres; negative where it has gone
    /// in.
    #[must_use]
    pub fn clearance(&self, robot: usize) -> Option<f64> {
        self.bodies.get(robot).map(|body| body.outline_now().clearance(&self.world.surfaces))
    }

    /// The nearest echo before the errors of a reading, metres; `None` without one.
    #[must_use]
    pub fn echo(&self, robot: usize) -> Option<f64> {
        self.scene(robot)?.echo()
    }

    /// The corners of a robot's body, world frame, metres.
    pub(in crate::sim) fn outline(&self, robot: usize) -> Option<[[f64; 2]; 4]> {
        let hull = self.bodies.get(robot)?.outline_now().hull();
        Some(hull.map(|side| [side.from.x, side.from.y]))
    }

    /// Where a robot's range sensor is, where it looks, and half of its cone: world frame, metres
    /// and radians.
    pub(in crate::sim) fn sight(&self, robot: usize) -> Option<([f64; 2], f64, f64)> {
        let (from, axis_rad) = self.scene(robot)?.range_sensor()?;
        Some(([from.x, from.y], axis_rad, radians(self.world.robot().errors.cone_deg)))
    }

    fn scene(&self, robot: usize) -> Option<Scene<'_>> {
        let head_rad = self.rigs.get(robot)?.head_rad;
        let (world, bodies) = (&self.world, self.bodies.as_slice());
        let (time_s, seed) = (self.time_s(), self.seed);
        let (model, mount) = (world.robot(), Mount::default());
        Some(Scene { world, model, bodies, robot, head_rad, mount, time_s, seed })
    }

    fn time_s(&self) -> f64 {
        seconds(self.steps.saturating_mul(STEP_NS))
    }

    fn publish(&mut self) {
        let model = self.world.robot();
        let mut truths = lock(&self.truths);
        truths.clear();
        truths.extend(self.bodies.iter().zip(&mut self.rigs).map(|(body, rig)| {
            rig.fallen |= !self.world.floor.has(body.place);
            let shaft = |out| body.motor(out).map_or(0.0, |motor| motor.angle_rad);
            Truth {
                x_m: body.place.x,
                y_m: body.place.y,
                heading_rad: body.heading_rad,
                speed_mps: body.velocity.dot(&direction(body.heading_rad)),
                wheels_rad: model.drive.map(shaft),
                head_rad: rig.head_rad,
                travelled_m: body.travelled_m,
                touching: body.touching,
                fallen: rig.fallen,
            }
        }));
    }
}

impl Physics for WorldPhysics {
    fn robots(&self) -> usize {
        self.bodies.len()
    }

    fn plug(&self, _robot: usize) -> Plug {
        self.world.robot().plug
    }

    fn step(&mut self, bridges: &[[Bridge; 4]]) {
        let step_s = seconds(STEP_NS);
        let model = self.world.robot();
        let time_s = self.time_s();
        for ((rig, body), bridges) in self.rigs.iter_mut().zip(&mut self.bodies).zip(bridges) {
            rig.drive(&mut body.motors, bridges, model, time_s, step_s);
            rig.creep(&mut body.wheels, model, step_s);
        }
        self.solver.step(&mut self.bodies, &self.world.surfaces, step_s);
        for (rig, body) in self.rigs.iter_mut().zip(&mut self.bodies) {
            rig.settle(body, model, step_s);
            rig.gyro.follow(body.turning_rad_s, step_s);
        }
        self.steps += 1;
        self.publish();
    }

    fn edges(&self, robot: usize, out: usize) -> i64 {
        let motor = self.bodies.get(robot).and_then(|body| body.motor(out));
        let kind = self.world.robot().plug.motors.get(out).copied().flatten();
        motor.zip(kind).map_or(0, |(motor, kind)| whole(motor.angle_rad * edges_per_rad(kind)))
    }

    fn measure(&mut self, robot: usize, input: usize, mode: &str) -> [i32; 8] {
        let kind = self.world.robot().plug.sensors.get(input).copied().flatten();
        let Some(rig) = self.rigs.get_mut(robot) else { return [0; 8] };
        let Some(own) = rig.sensor_chance.get_mut(input) else { return [0; 8] };
        // Taken out and put back, because the scene looks at the whole of the physics.
        let mut chance = own.clone();
        let gyro = rig.gyro;
        let mount = self.world.robot().mounts.get(input).copied().unwrap_or_default();
        let Some(scene) = self.scene(robot).map(|scene| Scene { mount, ..scene }) else {
            return [0; 8];
        };
        let values = match kind {
            Some(SensorKind::Ultrasonic) => scene.ultrasonic(mode, &mut chance),
            Some(SensorKind::Infrared) => scene.infrared(mode, &mut chance),
            Some(SensorKind::Colour) => scene.colour(mode, &mut chance),
            Some(SensorKind::Gyro) => gyro.values(mode),
            Some(SensorKind::Touch) => one(scene.is_pressed().into()),
            None => [0; 8],
        };
        if let Some(own) = self.rigs.get_mut(robot).and_then(|rig| rig.sensor_chance.get_mut(input))
        {
            *own = chance;
        }
        values
    }

    fn fail(&mut self, robot: usize, fault: Fault) {
        let Some((rig, body)) = self.rigs.get_mut(robot).zip(self.bodies.get_mut(robot)) else {
            return;
        };
        let mut block = |out: usize, blocked| {
            if let Some(motor) = body.motors.get_mut(out).and_then(Option::as_mut) {
                motor.block(blocked);
            }
        };
        match fault {
            Fault::BlockedMotor(out) => block(out, true),
            Fault::FreedMotor(out) => block(out, false),
            Fault::BatteryV(volts) => rig.battery_v = volts,
            Fault::OwnBattery => rig.battery_v = self.world.robot().errors.battery_v,
        }
    }

    fn place(&mut self, robot: usize, pose: Option<[f64; 3]>) -> bool {
        let start = self.world.starts().get(robot).copied();
        let pose =
            pose.map(|[x_m, y_m, heading_rad]| StartPose { x_m, y_m, heading_rad }).or(start);
        let Some(pose) = pose.filter(|pose| self.has_room(robot, *pose)) else { return false };
        self.carry(robot, pose);
        true
    }

    fn battery(&self, robot: usize) -> (f64, f64) {
        let ohm = self.world.robot().errors.battery_ohm;
        self.rigs.get(robot).map_or((0.0, 0.0), |rig| {
            let current_a = IDLE_A + rig.load_a;
            (rig.rest_v(self.world.robot(), self.time_s()) - ohm * current_a, current_a)
        })
    }
}

impl Rig {
    fn new(model: &RobotModel, seed: u64, robot: u64) -> Self {
        let errors = &model.errors;
        let stream = |number: u64| Chance::new(seed, robot * 16 + number);
        let mut build = stream(0);
        let gyro = Gyro::new(
            errors.gyro_scale + errors.gyro_scale_sd * build.normal(),
            errors.gyro_drift_dps,
        );
        let nominal = model.wheel_circumference_m / (2.0 * PI);
        let wheel = |error: f64, inverted: bool, chance: &mut Chance| {
            let size = nominal * (1.0 + error + errors.wheel_sd * chance.normal()).max(0.1);
            if inverted { -size } else { size }
        };
        let [left_inverted, right_inverted] = model.drive_inverted;
        let left = wheel(errors.wheel_left, left_inverted, &mut build);
        let right = wheel(errors.wheel_right, right_inverted, &mut build);
        Self {
            gyro,
            head_rad: 0.0,
            ground_m_per_rad: [left, right],
            slip: [0.0; 2],
            slip_chance: stream(1),
            sensor_chance: [stream(4), stream(5), stream(6), stream(7)],
            battery_v: errors.battery_v,
            load_a: 0.0,
            fallen: false,
        }
    }

    fn wheels(&self, model: &RobotModel) -> [Wheel; 2] {
        let [left, right] = self.ground_m_per_rad;
        let [left_out, right_out] = model.drive;
        [
            Wheel { out: left_out, side: -1.0, ground_m_per_rad: left },
            Wheel { out: right_out, side: 1.0, ground_m_per_rad: right },
        ]
    }

    /// The battery without load.
    fn rest_v(&self, model: &RobotModel, time_s: f64) -> f64 {
        (self.battery_v - model.errors.battery_fade_v_per_s * time_s).max(0.0)
    }

    /// Lets bridges and battery act on the motors; the sag is that of the step before.
    fn drive(
        &mut self,
        motors: &mut [Option<Motor>; 4],
        bridges: &[Bridge; 4],
        model: &RobotModel,
        time_s: f64,
        step_s: f64,
    ) {
        let sag_v = model.errors.battery_ohm * (IDLE_A + self.load_a);
        let battery_v = (self.rest_v(model, time_s) - sag_v).max(0.0);
        self.load_a = 0.0;
        for (motor, bridge) in motors.iter_mut().zip(bridges) {
            let Some(motor) = motor else { continue };
            motor.drive(*bridge, battery_v, step_s);
            self.load_a += motor.current_a;
        }
    }

    /// Lets the tyres' creep wander: an Ornstein-Uhlenbeck walk of each wheel's share.
    fn creep(&mut self, wheels: &mut [Wheel; 2], model: &RobotModel, step_s: f64) {
        let sd = model.errors.slip_sd;
        if sd <= 0.0 {
            return;
        }
        let kick = sd * libm::sqrt(2.0 * step_s / SLIP_S);
        for ((wheel, slip), size) in
            wheels.iter_mut().zip(&mut self.slip).zip(self.ground_m_per_rad)
        {
            *slip += kick * self.slip_chance.normal() - *slip * step_s / SLIP_S;
            wheel.ground_m_per_rad = size * (1.0 - slip.clamp(-0.5, 0.5));
        }
    }

    /// Turns the shafts, and the head within its gears' play.
    fn settle(&mut self, body: &mut Body, model: &RobotModel, step_s: f64) {
        for (motor, kind) in body.motors.iter_mut().zip(model.plug.motors) {
            let Some(motor) = motor else { continue };
            motor.turn(step_s);
            stop_at_ends(motor, kind);
        }
        if let Some(motor) = model.head.and_then(|out| body.motor(out)) {
            let driven_rad = motor.angle_rad * model.head_ratio;
            let play_rad = radians(model.errors.head_play_deg) / 2.0;
            self.head_rad = self.head_rad.clamp(driven_rad - play_rad, driven_rad + play_rad);
        }
    }
}

/// Edges for a radian of the shaft. Linear actuators do 24 counts (48 edges) a second where the
/// medium motor that stands for them turns 1560 degrees (interfaces 2: `max_speed`); the RCX motor
/// has no encoder.
fn edges_per_rad(kind: MotorKind) -> f64 {
    match kind {
        MotorKind::Large | MotorKind::Medium => 720.0 / (2.0 * PI),
        MotorKind::Linear50 | MotorKind::Linear100 => 48.0 / radians(1560.0),
        MotorKind::Rcx => 0.0,
    }
}

/// A linear actuator ends where its screw does: 100 or 200 counts of two edges (interfaces 2:
/// `full_travel_count`).
fn stop_at_ends(motor: &mut Motor, kind: Option<MotorKind>) {
    let (kind, edges) = match kind {
        Some(kind @ MotorKind::Linear50) => (kind, 200.0),
        Some(kind @ MotorKind::Linear100) => (kind, 400.0),
        _ => return,
    };
    let inside = motor.angle_rad.clamp(0.0, edges / edges_per_rad(kind));
    if (inside - motor.angle_rad).abs() > 0.0 {
        motor.angle_rad = inside;
        motor.speed_rad_s = 0.0;
    }
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "a cast from float saturates, and NaN becomes 0"
)]
fn whole(value: f64) -> i64 {
    libm::floor(value + 0.5) as i64
}
