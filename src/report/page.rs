//! A scene as one HTML page: its data as JSON inside, drawn by a script inside.
//!
//! The page is `page.html` with the data put in. It draws with SVG elements, so what is on screen
//! can be asked for: the text in `#reading` and the numbers at `#plot` (`data-time`, `data-points`,
//! `data-x`, `data-y`) say what is drawn. The address may name a time in seconds: `map.html#t=30`.
//!
//! # Not here
//!
//! No network: no fonts, scripts or styles from elsewhere, and the page's own policy forbids them.
//! A run in progress has another page ([`live`](super::live)).

use serde_json::{Value, json};

use super::{PathPoint, Scene, Track, colours, escaped, is_single, thinned};
use crate::page::inside_script;

const TEMPLATE: &str = include_str!("page.html");

/// Paths in the page are not finer, metres.
const LEAST_STEP_M: f64 = 0.004;

/// The page.
pub(super) fn html(scene: &Scene) -> String {
    let page = TEMPLATE.replace("@TITLE@", &escaped(&scene.title));
    page.replace("\"@DATA@\"", &inside_script(&data(scene).to_string()))
}

fn data(scene: &Scene) -> Value {
    let warnings: Vec<String> = scene
        .tracks
        .iter()
        .flat_map(|track| track.warnings.iter().map(|warning| format!("{}: {warning}", track.name)))
        .collect();
    let bounds = scene.bounds();
    json!({
        "single": is_single(scene),
        "low": bounds.low,
        "high": bounds.high,
        "duration": round(scene.duration_s(), 1e3),
        "outlines": scene.outlines.iter().map(|line| outline(line)).collect::<Vec<_>>(),
        "walls": scene
            .walls
            .iter()
            .map(|wall| outline(&[wall.from_m, wall.to_m]))
            .collect::<Vec<_>>(),
        "tracks": scene
            .tracks
            .iter()
            .enumerate()
            .map(|(place, one)| track(one, place, scene))
            .collect::<Vec<_>>(),
        "warnings": warnings,
    })
}

fn outline(line: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let finite = line.iter().filter(|place| place.iter().all(|value| value.is_finite()));
    finite.map(|place| place.map(|value| round(value, 1e4))).collect()
}

/// Times in milliseconds' and places in tenths of a millimetre's digits, as flat lists: an hour's
/// run stays a few megabytes.
fn track(track: &Track, place: usize, scene: &Scene) -> Value {
    let colours = colours(place, scene.tracks.len());
    let hex = |[red, green, blue]: [u8; 3]| format!("#{red:02x}{green:02x}{blue:02x}");
    let of_path = |p: PathPoint| {
        [round(p.time_s, 1e3), round(p.x_m, 1e4), round(p.y_m, 1e4), round(p.heading_rad, 1e3)]
    };
    json!({
        "name": track.name,
        "pathColour": hex(colours.path),
        "pointColour": hex(colours.points),
        "path": thinned(&track.path, LEAST_STEP_M)
            .into_iter()
            .flat_map(of_path)
            .collect::<Vec<_>>(),
        "points": track
            .points
            .iter()
            .flat_map(|p| [round(p.time_s, 1e3), round(p.x_m, 1e4), round(p.y_m, 1e4)])
            .collect::<Vec<_>>(),
    })
}

fn round(value: f64, digits: f64) -> f64 {
    libm::round(value * digits) / digits
}
