//! How a robot truly is: the file `sim/truth`, one line of JSON, made by each read at its
//! beginning. Where it is, and what a person would see of its brick and hear: lights, tone, buttons
//! that are down.
//!
//! No real brick has it. A test reads it after another program has driven, to check whether the
//! robot is where that program meant it to go.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::clock::seconds;
use crate::sim::brick::Class;
use crate::sim::simulation::State;
use crate::units::degrees;

/// What the line says. World frame; angles anticlockwise and not wrapped.
#[derive(Serialize)]
pub(super) struct TruthLine {
    time_s: f64,
    x_m: f64,
    y_m: f64,
    heading_deg: f64,
    speed_mps: f64,
    travelled_m: f64,
    /// Shafts of the drive motors, in the motors' own direction.
    left_deg: f64,
    right_deg: f64,
    /// Head against body.
    head_deg: f64,
    /// The nearest echo before any error of the sensor; null without one.
    echo_m: Option<f64>,
    touching: bool,
    fallen: bool,
    /// Buttons that are down.
    pressed: Vec<&'static str>,
    /// What sounds now, and what sounded last; null for silence.
    tone_hz: Option<u32>,
    last_tone_hz: Option<u32>,
    /// Brightness of each status light, by the name in `sys/class/leds`.
    lights: BTreeMap<String, u32>,
}

/// The line as of now; none where the physics is no world's: the truth is unknown there.
pub(super) fn line(state: &State, robot: usize) -> Option<TruthLine> {
    let world = state.world()?;
    let truth = world.truth(robot)?;
    let brick = state.bricks.get(robot)?;
    let light = |name: &str| Some((name.to_owned(), brick.led(name)?.0));
    let [left_deg, right_deg] = truth.wheels_rad.map(degrees);
    Some(TruthLine {
        time_s: seconds(state.now_ns),
        x_m: truth.x_m,
        y_m: truth.y_m,
        heading_deg: degrees(truth.heading_rad),
        speed_mps: truth.speed_mps,
        travelled_m: truth.travelled_m,
        left_deg,
        right_deg,
        head_deg: degrees(truth.head_rad),
        echo_m: world.echo(robot),
        touching: truth.touching,
        fallen: truth.fallen,
        pressed: brick.buttons.pressed.iter().map(|button| button.as_str()).collect(),
        tone_hz: brick.speaker.tone_hz,
        last_tone_hz: brick.speaker.last_tone_hz,
        lights: brick.names(Class::Leds).filter_map(light).collect(),
    })
}
