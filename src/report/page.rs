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

use super::plot::{FREE, pale};
use super::{PathPoint, Scene, Track, colours, is_single, thinned};
use crate::clock::seconds;
use crate::page::inside_script;
use crate::printable::escaped;
use crate::sim::{Paint, web_colour};
use crate::units::rounded_to;

const TEMPLATE: &str = include_str!("page.html");

/// The scene as one HTML page that needs nothing else: drag to pan, wheel to zoom, slide through
/// time.
#[must_use]
pub fn html(scene: &Scene) -> String {
    let page = TEMPLATE.replace("@TITLE@", &escaped(&scene.title));
    page.replace("\"@DATA@\"", &inside_script(&data(scene).to_string()))
}

fn data(scene: &Scene) -> Value {
    let warnings: Vec<String> = scene
        .tracks
        .iter()
        .flat_map(|track| track.warnings.iter().map(|warning| format!("{}: {warning}", track.name)))
        .collect();
    let [low, high] = scene.bounds();
    json!({
        "single": is_single(scene),
        "freeColour": web_colour(FREE),
        "low": low,
        "high": high,
        "duration": rounded_to(scene.duration_s(), 1e3),
        "floor": scene.marks.iter().map(floor_mark).collect::<Vec<_>>(),
        "outlines": outlines(&scene.outlines),
        "blocks": outlines(&scene.blocks),
        "edges": outlines(&scene.edges),
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

fn floor_mark(mark: &Paint) -> Value {
    json!({
        "points": outline(&mark.points),
        "width": mark.width_m,
        "closed": mark.closed,
        "colour": web_colour(pale(mark.colour)),
    })
}

fn outlines(lines: &[Vec<[f64; 2]>]) -> Vec<Vec<[f64; 2]>> {
    lines.iter().map(|line| outline(line)).collect()
}

fn outline(line: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let finite = line.iter().filter(|place| place.iter().all(|value| value.is_finite()));
    finite.map(|place| place.map(|value| rounded_to(value, 1e4))).collect()
}

/// Times in milliseconds' and places in tenths of a millimetre's digits, as flat lists: an hour's
/// run stays a few megabytes.
fn track(track: &Track, place: usize, scene: &Scene) -> Value {
    let colours = colours(place, scene.tracks.len());
    let of_path = |p: &PathPoint| {
        [
            rounded_to(seconds(p.time_ns), 1e3),
            rounded_to(p.x_m, 1e4),
            rounded_to(p.y_m, 1e4),
            rounded_to(p.heading_rad, 1e3),
        ]
    };
    json!({
        "name": track.name,
        "pathColour": web_colour(colours.path),
        "pointColour": web_colour(colours.points),
        "path": thinned(&track.path, |at| at.place())
            .into_iter()
            .flat_map(of_path)
            .collect::<Vec<_>>(),
        "free": track.free().map(|corners| outline(&corners)).collect::<Vec<_>>(),
        "truth": true_path(&track.truth),
        "points": track
            .points
            .iter()
            .flat_map(|p| {
                let time_s = rounded_to(seconds(p.time_ns), 1e3);
                [time_s, rounded_to(p.x_m, 1e4), rounded_to(p.y_m, 1e4)]
            })
            .collect::<Vec<_>>(),
    })
}

/// It has no times: the page shows the whole of it.
fn true_path(places: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let thinned = thinned(places, |place| **place).into_iter();
    thinned.map(|place| place.map(|metres| rounded_to(metres, 1e4))).collect()
}
