//! What a person sees of a simulation: the room, the robots in it, what their sensors see, what is
//! wrong with them.
//!
//! A [`View`] is a picture of one moment, as numbers; `still` draws it as SVG, the live page
//! (`report::live`) sends it to a browser. What robots have driven and seen gathers while the
//! simulation is watched ([`Simulation::watch`]): each echo at the place where it truly was
//! measured, so that a lying sensor shows.
//!
//! # Not here
//!
//! Maps that robots have made of a room: those are in their recordings.

mod brick;
mod still;
mod trail;

use serde::{Serialize, Serializer};

use self::brick::sighted_m;
pub use self::still::still;
pub(crate) use self::trail::Trail;
pub use self::trail::{Mark, MarkKind};
use super::simulation::Simulation;
use super::world::World;
use super::world_physics::WorldPhysics;
use crate::clock::seconds;
use crate::units::{bounds, degrees, wrap_rad};

/// A simulation at one moment.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct View {
    /// Simulated seconds since the beginning.
    pub time_s: f64,
    /// The robots.
    pub robots: Vec<RobotView>,
    /// Path and echoes since [`View::next`] of an earlier view.
    pub marks: Vec<Mark>,
    /// Ask the next view for marks from this number on.
    pub next: u64,
    /// The last things that were done on purpose, the newest last.
    pub done: Vec<String>,
}

/// A robot at one moment.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RobotView {
    /// Metres, world frame.
    pub x_m: f64,
    /// Metres, world frame.
    pub y_m: f64,
    /// −180 to 180, anticlockwise from x.
    pub heading_deg: f64,
    /// Head against body, −180 to 180, anticlockwise.
    pub head_deg: f64,
    /// Metres a second; negative backwards.
    pub speed_mps: f64,
    /// Metres since the beginning.
    pub travelled_m: f64,
    /// It pushes against something.
    pub touching: bool,
    /// It has gone over the floor's edge.
    pub fallen: bool,
    /// The body's corners, world frame, metres.
    pub outline: [[f64; 2]; 4],
    /// What its range sensor sees.
    pub beam: Option<Beam>,
    /// Volts.
    pub battery_v: f64,
    /// What is on its ports.
    pub devices: Vec<DeviceView>,
    /// What is wrong: orders' texts.
    pub faults: Vec<String>,
    /// Buttons that are down.
    pub pressed: Vec<&'static str>,
    /// The brick's lights, left and right.
    pub lights: [Light; 2],
    /// The tone that sounds, hertz.
    pub tone_hz: Option<u32>,
    /// Counts what was drawn on the screen: 0 where nothing has been yet.
    pub screen: u32,
}

/// A light of the brick, which is red, green or both: how bright, 0 to 255.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Light {
    /// Red.
    pub red: u32,
    /// Green.
    pub green: u32,
}

/// A range sensor's view.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Beam {
    /// Where the sensor is, world frame, metres.
    pub from: [f64; 2],
    /// Where it looks, degrees anticlockwise from x.
    pub axis_deg: f64,
    /// Half of its cone, degrees.
    pub half_deg: f64,
    /// What it says, metres; none without an echo or without an answer.
    pub echo_m: Option<f64>,
}

/// A device on a port.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DeviceView {
    /// `in1` to `outD`.
    pub port: &'static str,
    /// Its name in its class: `motor0`.
    pub name: String,
    /// What it is: the driver's name.
    pub driver: &'static str,
    /// A sensor's mode, a motor's state.
    pub state: String,
    /// What a program reads: a sensor's first value, a motor's speed; or the error.
    pub value: String,
    /// What a sensor measures, what a motor does: for people.
    pub what: String,
    /// The value with its unit.
    pub told: String,
}

/// What of a world does not change.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Room {
    /// The world's name.
    pub name: String,
    /// Lower left corner of what is to be seen, metres.
    pub low: [f64; 2],
    /// Upper right corner.
    pub high: [f64; 2],
    /// Walls, blocks and posts as polylines, metres.
    pub walls: Vec<Vec<[f64; 2]>>,
    /// What is on the floor, the lowest first.
    pub floor: Vec<Paint>,
}

/// Something drawn on the floor.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Paint {
    /// Its points, metres.
    pub points: Vec<[f64; 2]>,
    /// A line of this width, metres; none for a filled patch.
    pub width_m: Option<f64>,
    /// A line's ends are joined.
    pub closed: bool,
    /// Red, green, blue.
    #[serde(serialize_with = "as_web_colour")]
    pub colour: [u8; 3],
}

/// A colour as pages and pictures have it.
pub(crate) fn web_colour([red, green, blue]: [u8; 3]) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

fn as_web_colour<S: Serializer>(colour: &[u8; 3], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&web_colour(*colour))
}

/// Around what stands in a world, metres; a world with nothing in it is shown so far.
const MARGIN_M: f64 = 0.1;
const EMPTY_M: f64 = 0.9;

impl Room {
    /// The room of a world.
    #[must_use]
    pub fn of(world: &World) -> Self {
        let plain =
            |points: &[super::world::geometry::Point]| points.iter().map(|p| [p.x, p.y]).collect();
        let mut floor = Vec::new();
        if !world.floor.table.is_empty() {
            let colour = colour_of(world.floor.ground.reflects_pct);
            floor.push(Paint {
                points: plain(&world.floor.table),
                width_m: None,
                closed: true,
                colour,
            });
        }
        floor.extend(world.floor.marks.iter().map(|mark| Paint {
            points: plain(&mark.points),
            width_m: mark.width_m,
            closed: mark.closed,
            colour: colour_of(mark.ground.reflects_pct),
        }));
        let places =
            world.outlines().iter().flatten().chain(floor.iter().flat_map(|paint| &paint.points));
        let places = widened(places.copied(), MARGIN_M);
        let reach = if places.clone().next().is_none() { EMPTY_M } else { 0.2 };
        let starts = world.starts().iter().map(|start| [start.x_m, start.y_m]);
        let [low, high] = bounds(places.chain(widened(starts, reach)));
        Self { name: world.name().to_owned(), low, high, walls: world.outlines().to_vec(), floor }
    }
}

/// Places with a margin around each, as two corners.
fn widened(
    places: impl Iterator<Item = [f64; 2]> + Clone,
    margin_m: f64,
) -> impl Iterator<Item = [f64; 2]> + Clone {
    places.flat_map(move |place| [-margin_m, margin_m].map(|by_m| place.map(|at_m| at_m + by_m)))
}

/// Reflected light as a colour on a screen, by the screen's own curve.
fn colour_of(reflects_pct: [f64; 3]) -> [u8; 3] {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "clamped to a byte"
    )]
    let byte = |pct: f64| {
        (255.0 * libm::pow((pct / 85.0).clamp(0.0, 1.0), 0.4545)).clamp(0.0, 255.0) as u8
    };
    reflects_pct.map(byte)
}

/// How many of the last things done a view tells.
const TOLD: usize = 8;

impl Simulation {
    /// Gathers from now on what robots drive and see, for [`View::marks`].
    pub fn watch(&self) {
        self.state().trail.get_or_insert_default();
    }

    /// The room; none where the physics is not a [`WorldPhysics`].
    #[must_use]
    pub fn room(&self) -> Option<Room> {
        self.inspect(|world: &mut WorldPhysics| Room::of(world.world()))
    }

    /// How things are now, with the marks from a number on; none where the physics is not a
    /// [`WorldPhysics`].
    #[must_use]
    pub fn view(&self, since: u64) -> Option<View> {
        let state = &*self.state();
        let world = state.world()?;
        let robots = state.bricks.iter().enumerate().filter_map(|(robot, brick)| {
            let truth = world.truth(robot)?;
            let devices = brick.device_views();
            let (from, axis_rad, half_rad) = world.sight(robot)?;
            let beam = |echo_m| Beam {
                from,
                axis_deg: degrees(wrap_rad(axis_rad)),
                half_deg: degrees(half_rad),
                echo_m,
            };
            Some(RobotView {
                x_m: truth.x_m,
                y_m: truth.y_m,
                heading_deg: degrees(wrap_rad(truth.heading_rad)),
                head_deg: degrees(wrap_rad(truth.head_rad)),
                speed_mps: truth.speed_mps,
                travelled_m: truth.travelled_m,
                touching: truth.touching,
                fallen: truth.fallen,
                outline: world.outline(robot)?,
                beam: devices.iter().find_map(sighted_m).map(beam),
                battery_v: super::physics::Physics::battery(world, robot).0,
                devices,
                lights: brick.lights(),
                tone_hz: brick.speaker.tone_hz,
                screen: brick.lcd().map_or(0, |lcd| lcd.changes),
                pressed: brick.buttons.pressed.iter().map(|button| button.as_str()).collect(),
                faults: brick
                    .faults_active()
                    .map(|(port, fault)| format!("{port} {fault}"))
                    .collect(),
            })
        });
        let done = &state.faults.done;
        let told = done.iter().skip(done.len().saturating_sub(TOLD));
        let several = state.bricks.len() > 1;
        let done = told.map(|record| {
            let who = if several { format!("robot {} ", record.robot + 1) } else { String::new() };
            format!("{:.1} s: {who}{}", seconds(record.time_ns), record.what)
        });
        let (marks, next) =
            state.trail.as_ref().map_or((Vec::new(), 0), |trail| trail.since(since));
        Some(View {
            time_s: seconds(state.now_ns),
            robots: robots.collect(),
            marks,
            next,
            done: done.collect(),
        })
    }
}
