//! A run's map on the small screen: its path and points as they come, fitted, with a scale bar and
//! the robot as an arrow.
//!
//! Both are kept in cells of 2 cm, finer than a pixel of any room that fits: memory grows with the
//! area and not with the time.

use std::collections::BTreeSet;

use embedded_graphics::Drawable;
use embedded_graphics::pixelcolor::Gray2;
use embedded_graphics::prelude::{DrawTarget, Point, Primitive};
use embedded_graphics::primitives::{Line, PrimitiveStyle, Rectangle, Triangle};

use super::canvas::{Canvas, INK, PAPER};
use super::sheet::{HEAD, HIGH, WIDE, head, size};
use super::text::{Face, write};
use crate::mapping::Pose;
use crate::protocol::RunId;
use crate::recording::{Growing, Piece};
use crate::units::{bounds, rounded};

/// Edge of a cell, metres.
const CELL_M: f64 = 0.02;

/// More cells of points than this are not kept: 400 m² of wall-to-wall points.
const MOST_CELLS: usize = 100_000;

/// Longer paths lose every second of their places.
const MOST_PLACES: usize = 8192;

/// A room of this size is shown when less is known, metres.
const LEAST_M: f64 = 1.0;

/// Lengths that a scale bar may stand for, metres.
const BARS_M: [f64; 10] = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0];

/// How grey a path is: lighter than the walls' points.
const PATH: Gray2 = Gray2::new(1);

type Cell = (i16, i16);

/// The cell that a place is in.
#[expect(
    clippy::cast_possible_truncation,
    reason = "a cast from float saturates, 655 m from the start"
)]
fn cell(x_m: f64, y_m: f64) -> Cell {
    (libm::round(x_m / CELL_M) as i16, libm::round(y_m / CELL_M) as i16)
}

/// A run's path and points as far as they have come.
#[derive(Debug)]
pub(super) struct Track {
    pub(super) run: RunId,
    growing: Growing,
    path: Vec<Cell>,
    points: BTreeSet<Cell>,
    last: Option<Pose>,
    /// All of it is here.
    pub(super) complete: bool,
    /// Why no more comes.
    pub(super) trouble: Option<String>,
}

impl Track {
    pub(super) fn of(run: RunId) -> Self {
        Self {
            run,
            growing: Growing::default(),
            path: Vec::new(),
            points: BTreeSet::new(),
            last: None,
            complete: false,
            trouble: None,
        }
    }

    /// From which byte on the next part is wanted.
    pub(super) fn wanted(&self) -> u64 {
        self.growing.wanted()
    }

    /// Takes a part of the recording; true where it changed the picture.
    pub(super) fn take(&mut self, part: &[u8]) -> bool {
        let mut growing = std::mem::take(&mut self.growing);
        let before = (self.path.len(), self.points.len());
        if !growing.take(part, &mut |piece| self.note(piece)) {
            self.trouble = Some("the rest of this recording is damaged".to_owned());
        }
        self.growing = growing;
        before != (self.path.len(), self.points.len()) || self.trouble.is_some()
    }

    fn note(&mut self, piece: Piece) {
        match piece {
            Piece::Pose(pose) => {
                self.last = Some(pose);
                let place = cell(pose.x_m, pose.y_m);
                if self.path.last() != Some(&place) {
                    self.path.push(place);
                }
                if self.path.len() > MOST_PLACES {
                    let mut keep = false;
                    self.path.retain(|_| {
                        keep = !keep;
                        keep
                    });
                }
            }
            Piece::Points(points) => {
                let room = MOST_CELLS.saturating_sub(self.points.len());
                self.points
                    .extend(points.iter().map(|point| cell(point.x_m, point.y_m)).take(room));
            }
        }
    }

    /// Draws the map; `pose` is newer than the recording's last while the run is in progress.
    pub(super) fn draw(&self, canvas: &mut Canvas, title: &str, corner: &str, pose: Option<Pose>) {
        let Ok(()) = canvas.clear(PAPER);
        let pose = pose.or(self.last).filter(Pose::is_finite);
        let fit = Fit::of(
            self.path
                .iter()
                .chain(&self.points)
                .copied()
                .chain(pose.map(|pose| cell(pose.x_m, pose.y_m))),
        );
        for pair in self.path.windows(2) {
            if let [from, to] = pair {
                let line = Line::new(fit.place(*from), fit.place(*to));
                let Ok(()) = line.into_styled(PrimitiveStyle::with_stroke(PATH, 1)).draw(canvas);
            }
        }
        for point in &self.points {
            let Ok(()) = canvas.fill_solid(&Rectangle::new(fit.place(*point), size(2, 2)), INK);
        }
        if let Some(pose) = pose {
            arrow(canvas, fit.place(cell(pose.x_m, pose.y_m)), pose.heading_rad);
        }
        fit.bar(canvas);
        head(canvas, title, corner, true);
        if let Some(note) = self.note_text() {
            write(canvas, note, Point::new(2, HEAD), Face::Plain, INK);
        }
    }

    fn note_text(&self) -> Option<&'static str> {
        if self.trouble.is_some() {
            Some("not all of it")
        } else if self.path.is_empty() && self.points.is_empty() {
            Some(if self.complete { "no map" } else { "no map yet" })
        } else {
            None
        }
    }
}

/// Rows at the bottom that the scale bar has.
const BELOW: i32 = 16;

/// White around the map, pixels.
const MARGIN: i32 = 5;

/// How metres become pixels.
struct Fit {
    middle: [f64; 2],
    pixels_per_cell: f64,
}

impl Fit {
    fn of(cells: impl Iterator<Item = Cell>) -> Self {
        let [low, high] = bounds(cells.map(|(x, y)| [f64::from(x), f64::from(y)]));
        let [low, high] = if low[0] > high[0] { [[0.0; 2]; 2] } else { [low, high] };
        let room = [f64::from(WIDE - 2 * MARGIN), f64::from(HIGH - HEAD - BELOW - 2 * MARGIN)];
        let scale = |axis: usize| room[axis] / (high[axis] - low[axis]).max(LEAST_M / CELL_M);
        let middle = [0, 1].map(|axis| f64::midpoint(low[axis], high[axis]));
        Self { middle, pixels_per_cell: scale(0).min(scale(1)) }
    }

    /// x to the right, y up, as in every picture of ours.
    fn place(&self, (x, y): Cell) -> Point {
        let right = (f64::from(x) - self.middle[0]) * self.pixels_per_cell;
        let up = (f64::from(y) - self.middle[1]) * self.pixels_per_cell;
        Point::new(WIDE / 2 + rounded(right), (HEAD + HIGH - BELOW) / 2 - rounded(up))
    }

    /// The longest round length that takes at most half of the width.
    fn bar(&self, canvas: &mut Canvas) {
        let pixels = |length_m: &f64| rounded(length_m / CELL_M * self.pixels_per_cell);
        let Some(length_m) = BARS_M.iter().rev().find(|length_m| pixels(length_m) <= WIDE / 2)
        else {
            return;
        };
        let (left, right, y) = (3, 3 + pixels(length_m), HIGH - 5);
        for (from, to) in [
            ((left, y), (right, y)),
            ((left, y - 3), (left, y + 3)),
            ((right, y - 3), (right, y + 3)),
        ] {
            let line = Line::new(Point::from(from), Point::from(to));
            let Ok(()) = line.into_styled(PrimitiveStyle::with_stroke(INK, 1)).draw(canvas);
        }
        write(canvas, &format!("{length_m} m"), Point::new(right + 4, HIGH - 13), Face::Plain, INK);
    }
}

/// The robot: an arrow that points ahead, black with a white edge, so that it is seen on a path and
/// on points.
fn arrow(canvas: &mut Canvas, at: Point, heading_rad: f64) {
    let corner = |length: f64, turn_rad: f64| {
        let angle_rad = heading_rad + turn_rad;
        let (sin, cos) = libm::sincos(angle_rad);
        at + Point::new(rounded(length * cos), -rounded(length * sin))
    };
    let shape = |scale: f64| {
        Triangle::new(corner(8.0 * scale, 0.0), corner(6.0 * scale, 2.5), corner(6.0 * scale, -2.5))
    };
    let Ok(()) = shape(1.3).into_styled(PrimitiveStyle::with_fill(PAPER)).draw(canvas);
    let Ok(()) = shape(1.0).into_styled(PrimitiveStyle::with_fill(INK)).draw(canvas);
}
