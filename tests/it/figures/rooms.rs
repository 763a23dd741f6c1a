//! Rooms that chance draws, so that a mission meets shapes, doors and furniture that it was not
//! tuned on.

use std::f64::consts::TAU;
use std::fmt::Write as _;

use crate::support::chance::Chance;

type Place = [f64; 2];

/// The robot starts so far from everything, metres.
const START_M: f64 = 0.25;
/// And between two things there is at least so much, metres.
const BETWEEN_M: f64 = 0.1;

/// The world's file of the room with a number: a rectangle, two rooms with a door of half a metre
/// to 0.8 m between them, an L, a T or a polygon, with up to four blocks and posts in it.
pub(super) fn room(number: u64) -> String {
    let mut chance = Chance::new(number);
    let [w, h] = [chance.between(1.8, 3.6), chance.between(1.5, 2.8)];
    let [x, y] = [w * chance.between(0.35, 0.65), h * chance.between(0.35, 0.65)];
    let outline = match number % 5 {
        0 | 1 => vec![[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]],
        2 => vec![[0.0, 0.0], [w, 0.0], [w, y], [x, y], [x, h], [0.0, h]],
        3 => {
            let [left, right] = [0.55 * x, w - 0.55 * x];
            vec![
                [0.0, 0.0],
                [w, 0.0],
                [w, y],
                [right, y],
                [right, h],
                [left, h],
                [left, y],
                [0.0, y],
            ]
        }
        _ => {
            let corners = 5 + chance.below(4);
            let corner = |corner: usize| {
                let (sin, cos) = libm::sincos(TAU * corner as f64 / corners as f64);
                let share = chance.between(0.85, 1.1);
                [w / 2.0 * (1.0 + share * cos), h / 2.0 * (1.0 + share * sin)]
            };
            (0..corners).map(corner).collect()
        }
    };
    let mut text = format!("name = \"room {number}\"\n");
    // What stands already, and how far it reaches.
    let mut taken: Vec<(Place, f64)> = Vec::new();
    if number % 5 == 1 {
        let door_m = chance.between(0.5, 0.8);
        let from_m = chance.between(0.1, h - door_m - 0.1);
        for [low_m, high_m] in [[0.0, from_m], [from_m + door_m, h]] {
            let [middle_m, length_m] = [(low_m + high_m) / 2.0, high_m - low_m];
            writeln!(text, "[[block]]\nat = [{x}, {middle_m}]\nsize_m = [0.1, {length_m}]")
                .unwrap();
        }
        // Along the wall, and before the door.
        taken.extend((0..=30).map(|tenth| ([x, f64::from(tenth) / 10.0], 0.2)));
    }
    let mut place = |chance: &mut Chance, reach_m: f64, clear_m: f64| {
        for _ in 0..2000 {
            let at = [chance.between(0.0, w), chance.between(0.0, h)];
            let is_free =
                |(other, other_m): &(Place, f64)| far_m(at, *other) > reach_m + other_m + BETWEEN_M;
            if is_clear(&outline, at, clear_m) && taken.iter().all(is_free) {
                taken.push((at, reach_m));
                return Some(at);
            }
        }
        None
    };
    let [start_x, start_y] = place(&mut chance, START_M, START_M).expect("a room to start in");
    let heading_deg = chance.between(-180.0, 180.0);
    writeln!(text, "[[start]]\nat = [{start_x}, {start_y}]\nheading_deg = {heading_deg}").unwrap();
    for _ in 0..chance.below(5) {
        if chance.below(3) == 0 {
            let radius_m = chance.between(0.03, 0.15);
            let Some([x, y]) = place(&mut chance, radius_m + BETWEEN_M, radius_m) else { continue };
            writeln!(text, "[[circle]]\nat = [{x}, {y}]\nradius_m = {radius_m}").unwrap();
        } else {
            let [long_m, wide_m] = [chance.between(0.15, 0.6), chance.between(0.1, 0.35)];
            let reach_m = far_m([long_m, wide_m], [0.0; 2]) / 2.0;
            let Some([x, y]) = place(&mut chance, reach_m, 0.4 * reach_m) else { continue };
            let turn_deg = chance.between(0.0, 180.0);
            writeln!(
                text,
                "[[block]]\nat = [{x}, {y}]\nsize_m = [{long_m}, {wide_m}]\nturn_deg = {turn_deg}"
            )
            .unwrap();
        }
    }
    writeln!(text, "[[wall]]\npoints = {outline:?}\nclosed = true").unwrap();
    text
}

fn far_m([x, y]: Place, [to_x, to_y]: Place) -> f64 {
    libm::hypot(x - to_x, y - to_y)
}

/// Whether a disc is within an outline.
fn is_clear(outline: &[Place], [x, y]: Place, radius_m: f64) -> bool {
    (0..12).all(|turn| {
        let (sin, cos) = libm::sincos(TAU * f64::from(turn) / 12.0);
        is_within(outline, [x + radius_m * cos, y + radius_m * sin])
    })
}

/// By how often a ray from a place meets the outline.
fn is_within(outline: &[Place], [x, y]: Place) -> bool {
    let ends = outline.iter().zip(outline.iter().cycle().skip(1));
    let is_met = |([x1, y1], [x2, y2]): &(&Place, &Place)| {
        (*y1 > y) != (*y2 > y) && x < (x2 - x1) * (y - y1) / (y2 - y1) + x1
    };
    ends.filter(is_met).count() % 2 == 1
}
