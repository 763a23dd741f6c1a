//! A scene as a picture: SVG, PNG, PDF, HTML.
//!
//! Both axes have the same scale. What one robot drew over another's stays to be seen: the first
//! one's path and points are larger than the last one's.

use plotters::style::text_anchor::{HPos, VPos};
use plotters::style::{RGBColor, WHITE};

use super::canvas::{self, Canvas, Drawing, INK, LEFT_MIDDLE, MESH, PlotError, SOFT, rgb};
pub use super::page::html;
use super::ruler::Ruler;
use super::{Colours, PathPoint, Scene, Track, colours, is_single, thinned};
use crate::sim::Paint;
use crate::units::count;

/// The picture's width in layout units.
const WIDTH: f64 = 800.0;
/// Around the plot, in layout units: left, top, right.
const LEFT: f64 = 62.0;
const TOP: f64 = 52.0;
const RIGHT: f64 = 24.0;
/// From the plot down to the legend, and the height of one of its rows.
const AXIS: f64 = 52.0;
const ROW: f64 = 24.0;

const WALL: RGBColor = RGBColor(0x9a, 0xa1, 0xa9);
/// Free floor, red, green, blue.
pub(super) const FREE: [u8; 3] = [0xe4, 0xf0, 0xe6];
const BLOCK: RGBColor = RGBColor(0xe9, 0xeb, 0xee);
const EDGE: RGBColor = RGBColor(0x6b, 0x73, 0x7c);

/// The scene as SVG, 800 wide.
///
/// # Errors
///
/// [`PlotError::Draw`].
pub fn svg(scene: &Scene) -> Result<String, PlotError> {
    canvas::svg(&Picture::of(scene))
}

/// The scene as PNG, 1200 pixels wide.
///
/// # Errors
///
/// See [`PlotError`].
pub fn png(scene: &Scene) -> Result<Vec<u8>, PlotError> {
    canvas::png(&Picture::of(scene))
}

/// The scene as PDF, a page of its size.
///
/// # Errors
///
/// [`PlotError::Draw`].
pub fn pdf(scene: &Scene) -> Result<Vec<u8>, PlotError> {
    canvas::pdf(&Picture::of(scene))
}

/// Where the world lies in the picture, in layout units.
#[derive(Debug, Clone, PartialEq)]
struct Layout {
    /// The world's point in the plot's lower left corner, metres.
    low: [f64; 2],
    /// Layout units a metre.
    scale: f64,
    /// The plot's size.
    plot: [f64; 2],
    /// The whole picture's.
    height: f64,
}

impl Layout {
    fn of(scene: &Scene) -> Self {
        const LEAST_SPAN_M: f64 = 0.4;
        let [low, high] = scene.bounds();
        let span = [0, 1].map(|axis| 1.08 * (high[axis] - low[axis]).max(LEAST_SPAN_M));
        let width = WIDTH - LEFT - RIGHT;
        let plot = [width, (width * span[1] / span[0]).clamp(260.0, 860.0)];
        let scale = (plot[0] / span[0]).min(plot[1] / span[1]);
        let low = [0, 1].map(|axis| (low[axis] + high[axis] - plot[axis] / scale) / 2.0);
        let symbols = symbols(scene).len().div_ceil(SYMBOLS_IN_A_ROW);
        let names = scene.tracks.len().div_ceil(NAMES_IN_A_ROW);
        let rows = count(symbols + if is_single(scene) { 0 } else { names });
        Self { low, scale, plot, height: TOP + plot[1] + AXIS + rows * ROW + 10.0 }
    }

    /// A point of the world in the picture.
    fn place(&self, x_m: f64, y_m: f64) -> [f64; 2] {
        [
            LEFT + (x_m - self.low[0]) * self.scale,
            TOP + self.plot[1] - (y_m - self.low[1]) * self.scale,
        ]
    }

    /// The values that an axis is marked at, about 80 units apart.
    fn marks(&self, axis: usize) -> Vec<f64> {
        let high = self.low[axis] + self.plot[axis] / self.scale;
        Ruler::over(self.low[axis], high, self.plot[axis] / 80.0).marks()
    }

    fn label(&self, value: f64) -> String {
        Ruler { low: 0.0, high: 0.0, step: Ruler::step(80.0 / self.scale) }.label(value)
    }
}

/// How much of the legend fits into one row.
const SYMBOLS_IN_A_ROW: usize = 8;
const NAMES_IN_A_ROW: usize = 4;

/// The longest name that has room in the legend, letters.
const NAME_LETTERS: usize = 18;

struct Picture<'a> {
    scene: &'a Scene,
    layout: Layout,
}

impl<'a> Picture<'a> {
    fn of(scene: &'a Scene) -> Self {
        Self { scene, layout: Layout::of(scene) }
    }

    fn colours(&self, place: usize) -> Colours {
        colours(place, self.scene.tracks.len())
    }

    /// How much larger than the last one's a robot's path and points are, so that what lies on them
    /// does not hide them.
    fn excess(&self, place: usize) -> f64 {
        let above = self.scene.tracks.len().saturating_sub(place + 1).min(3);
        [0.0, 1.0, 1.8, 2.4].get(above).copied().unwrap_or(0.0)
    }

    fn placed(&self, line: impl IntoIterator<Item = [f64; 2]>) -> Vec<[f64; 2]> {
        line.into_iter().map(|[x_m, y_m]| self.layout.place(x_m, y_m)).collect()
    }
}

impl Drawing for Picture<'_> {
    fn size(&self) -> [f64; 2] {
        [WIDTH, self.layout.height]
    }

    fn draw(&self, canvas: &mut Canvas) {
        for corners in self.scene.tracks.iter().flat_map(Track::free) {
            canvas.polygon(&self.placed(corners), rgb(FREE));
        }
        for mark in &self.scene.marks {
            self.floor_mark(canvas, mark);
        }
        self.mesh(canvas);
        for edge in &self.scene.edges {
            canvas.line(&self.placed(closed(edge)), EDGE, 2.0);
        }
        for outline in &self.scene.outlines {
            canvas.line(&self.placed(outline.iter().copied()), WALL, 3.0);
        }
        // Over the lines between blocks that touch: only their common outline stays.
        for block in &self.scene.blocks {
            canvas.polygon(&self.placed(block.iter().copied()), BLOCK);
        }
        let tracks = || self.scene.tracks.iter().enumerate();
        for (place, track) in tracks() {
            let (colour, radius) =
                (rgb(self.colours(place).points), 1.9 + 0.9 * self.excess(place));
            for point in &track.points {
                canvas.dot(self.layout.place(point.x_m, point.y_m), radius, colour);
            }
        }
        for wall in &self.scene.walls {
            canvas.line(&self.placed([wall.from_m, wall.to_m]), INK, 4.5);
        }
        for (place, track) in tracks() {
            let path = thinned(&track.path, |at| at.place());
            let line = self.placed(path.into_iter().map(PathPoint::place));
            canvas.line(&line, rgb(self.colours(place).path), 2.0 + 1.6 * self.excess(place));
        }
        for (_, track) in tracks() {
            canvas.dashed(&self.placed(track.truth.iter().copied()), INK, 1.2, 5.0);
        }
        for (_, track) in tracks() {
            self.ends(canvas, track);
        }
        let middle = LEFT + self.layout.plot[0] / 2.0;
        canvas.title(&self.scene.title, middle, 2.0 * middle.min(self.size()[0] - middle));
        self.legend(canvas);
    }
}

impl Picture<'_> {
    fn floor_mark(&self, canvas: &mut Canvas, mark: &Paint) {
        let points = mark.points.iter().copied();
        match mark.width_m {
            Some(width_m) => {
                let width = width_m * self.layout.scale;
                let line = if mark.closed { closed(&mark.points) } else { points.collect() };
                canvas.line(&self.placed(line), rgb(pale(mark.colour)), width)
            }
            None => canvas.polygon(&self.placed(points), rgb(pale(mark.colour))),
        }
    }

    fn mesh(&self, canvas: &mut Canvas) {
        let (bottom, right) = (TOP + self.layout.plot[1], LEFT + self.layout.plot[0]);
        for x_m in self.layout.marks(0) {
            let [x, _] = self.layout.place(x_m, 0.0);
            canvas.line(&[[x, TOP], [x, bottom]], MESH, 1.0);
            let label = self.layout.label(x_m);
            canvas.text(&label, [x, bottom + 7.0], 14.0, SOFT, (HPos::Center, VPos::Top));
        }
        for y_m in self.layout.marks(1) {
            let [_, y] = self.layout.place(0.0, y_m);
            canvas.line(&[[LEFT, y], [right, y]], MESH, 1.0);
            let label = self.layout.label(y_m);
            canvas.text(&label, [LEFT - 8.0, y], 14.0, SOFT, (HPos::Right, VPos::Center));
        }
        let frame = [[LEFT, TOP], [right, TOP], [right, bottom], [LEFT, bottom], [LEFT, TOP]];
        canvas.line(&frame, SOFT, 1.0);
        let middle = LEFT + self.layout.plot[0] / 2.0;
        let x_axis = (HPos::Center, VPos::Top);
        canvas.text("x in metres", [middle, bottom + 28.0], 14.0, SOFT, x_axis);
        canvas.text("y in metres", [LEFT - 46.0, TOP - 24.0], 14.0, SOFT, (HPos::Left, VPos::Top));
    }

    /// A ring where the path begins, an arrow in the direction of the robot where it ends.
    fn ends(&self, canvas: &mut Canvas, track: &Track) {
        if let Some(start) = track.path.first() {
            start_mark(canvas, self.layout.place(start.x_m, start.y_m));
        }
        if let Some(end) = track.path.last() {
            end_mark(canvas, self.layout.place(end.x_m, end.y_m), end.heading_rad);
        }
    }

    fn legend(&self, canvas: &mut Canvas) {
        let mut row = TOP + self.layout.plot[1] + AXIS + ROW / 2.0;
        for symbols in symbols(self.scene).chunks(SYMBOLS_IN_A_ROW) {
            let mut x = LEFT;
            for (symbol, word) in symbols {
                x += symbol.draw(canvas, x, row) + 8.0;
                canvas.text(word, [x, row], 14.0, INK, LEFT_MIDDLE);
                x += canvas.text_width(word, 14.0) + 16.0;
            }
            row += ROW;
        }
        if !is_single(self.scene) {
            self.legend_of_robots(canvas, row - ROW);
        }
    }

    /// The robots' colours and names, in rows below `row`.
    fn legend_of_robots(&self, canvas: &mut Canvas, mut row: f64) {
        let mut x = LEFT;
        for (place, track) in self.scene.tracks.iter().enumerate() {
            if place.is_multiple_of(NAMES_IN_A_ROW) {
                (row, x) = (row + ROW, LEFT);
            }
            let colours = self.colours(place);
            for (from, to, colour) in [(0.0, 13.0, colours.path), (13.0, 26.0, colours.points)] {
                canvas.rectangle([x + from, row - 6.0], [x + to, row + 6.0], rgb(colour));
            }
            let name: String = track.name.chars().take(NAME_LETTERS).collect();
            canvas.text(&name, [x + 34.0, row], 14.0, INK, LEFT_MIDDLE);
            x += self.layout.plot[0] / 4.0;
        }
    }
}

/// What a word of the legend is for.
#[derive(Debug, Clone, Copy)]
enum Symbol {
    /// A line of a colour and a width.
    Line(RGBColor, f64),
    Dashes,
    Dots(RGBColor),
    Area(RGBColor),
    Start,
    End,
}

impl Symbol {
    /// Draws it from `x` on in the middle of a row, and gives its width.
    fn draw(self, canvas: &mut Canvas, x: f64, row: f64) -> f64 {
        const WIDE: f64 = 26.0;
        let line = [[x, row], [x + WIDE, row]];
        match self {
            Self::Line(colour, width) => canvas.line(&line, colour, width),
            Self::Dashes => canvas.dashed(&line, INK, 1.2, 5.0),
            Self::Dots(colour) => {
                [4.0, 12.0, 20.0].iter().for_each(|step| canvas.dot([x + step, row], 2.3, colour));
            }
            Self::Area(colour) => {
                canvas.rectangle([x, row - 6.0], [x + WIDE, row + 6.0], colour);
            }
            Self::Start => {
                start_mark(canvas, [x + 6.0, row]);
                return 12.0;
            }
            Self::End => {
                end_mark(canvas, [x + 8.0, row], 0.0);
                return 18.0;
            }
        }
        WIDE
    }
}

/// The legend's symbols, of what the scene has.
fn symbols(scene: &Scene) -> Vec<(Symbol, &'static str)> {
    let Colours { path, points } = colours(0, scene.tracks.len());
    let of_robots = |colour| if is_single(scene) { rgb(colour) } else { SOFT };
    let any = |has: fn(&Track) -> bool| scene.tracks.iter().any(has);
    let all = [
        (true, Symbol::Line(of_robots(path), 2.5), "path"),
        (any(|track| track.truth.len() > 1), Symbol::Dashes, "true path"),
        (true, Symbol::Dots(of_robots(points)), "points"),
        (any(|track| track.free().next().is_some()), Symbol::Area(rgb(FREE)), "free floor"),
        (!scene.walls.is_empty(), Symbol::Line(INK, 4.5), "walls found"),
        (true, Symbol::Start, "start"),
        (true, Symbol::End, "end"),
        (!scene.outlines.is_empty(), Symbol::Line(WALL, 3.0), "true walls"),
        (!scene.edges.is_empty(), Symbol::Line(EDGE, 2.0), "edge of the floor"),
    ];
    all.into_iter()
        .filter(|(is_there, ..)| *is_there)
        .map(|(_, symbol, word)| (symbol, word))
        .collect()
}

fn start_mark(canvas: &mut Canvas, place: [f64; 2]) {
    canvas.dot(place, 6.5, INK);
    canvas.dot(place, 4.2, WHITE);
}

fn end_mark(canvas: &mut Canvas, [x, y]: [f64; 2], heading_rad: f64) {
    let corner = |angle_rad: f64, size: f64| {
        let direction = heading_rad + angle_rad;
        [x + size * libm::cos(direction), y - size * libm::sin(direction)]
    };
    let arrow = |grow: f64| {
        [
            corner(0.0, 9.0 + grow),
            corner(2.5, 8.0 + grow),
            corner(std::f64::consts::PI, 3.0),
            corner(-2.5, 8.0 + grow),
        ]
    };
    canvas.polygon(&arrow(2.5), WHITE);
    canvas.polygon(&arrow(0.0), INK);
}

/// A shape's corners with the first at the end again.
fn closed(corners: &[[f64; 2]]) -> Vec<[f64; 2]> {
    corners.iter().chain(corners.first()).copied().collect()
}

/// A colour of the floor, on which what was measured stands out.
pub(super) fn pale(colour: [u8; 3]) -> [u8; 3] {
    let half = |part: u8| 255 - (255 - part) / 2;
    colour.map(half)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::{Pose, Wall};
    use crate::recording::Grid;
    use proptest::prelude::*;

    fn scene(outline: Vec<[f64; 2]>) -> Scene {
        Scene { outlines: vec![outline], ..Scene::default() }
    }

    proptest! {
        #[test]
        fn both_axes_have_one_scale_and_everything_is_inside(
            outline in proptest::collection::vec([-50.0..50.0, -50.0..50.0], 1..20),
        ) {
            let layout = Layout::of(&scene(outline.clone()));
            for [x_m, y_m] in outline {
                let [x, y] = layout.place(x_m, y_m);
                prop_assert!(x >= LEFT && x <= LEFT + layout.plot[0], "{x}");
                prop_assert!(y >= TOP && y <= TOP + layout.plot[1], "{y}");
            }
            let [a, b, c] =
                [layout.place(0.0, 0.0), layout.place(1.0, 0.0), layout.place(0.0, 1.0)];
            prop_assert!(((b[0] - a[0]) - (a[1] - c[1])).abs() < 1e-6);
            for axis in [0, 1] {
                let marks = layout.marks(axis).len();
                prop_assert!((1..=12).contains(&marks), "{marks} marks");
            }
        }
    }

    #[test]
    fn free_floor_and_a_long_legend_are_inside() {
        let grid = Grid {
            width: 2,
            height: 1,
            resolution_m: 3.0,
            origin_m: [-3.0, -1.0],
            cells: vec![0; 2],
        };
        let origin = Pose { x_m: 5.0, y_m: 0.0, heading_rad: 0.0 };
        let track = Track { grid: Some(grid), origin, ..Track::default() };
        let single = Scene { tracks: vec![track.clone()], ..scene(vec![[0.0; 2]]) };
        let layout = Layout::of(&single);
        for corner in [[2.0, -1.0], [8.0, 2.0]] {
            let [x, y] = layout.place(corner[0], corner[1]);
            assert!((LEFT..=LEFT + layout.plot[0]).contains(&x), "{x}");
            assert!((TOP..=TOP + layout.plot[1]).contains(&y), "{y}");
        }
        let all = Scene {
            walls: vec![Wall::default()],
            edges: vec![vec![[0.0; 2]]],
            tracks: vec![Track { truth: vec![[0.0; 2]; 2], ..track }],
            ..single.clone()
        };
        assert_eq!((symbols(&single).len(), symbols(&all).len()), (6, 9));
        assert!((Layout::of(&all).height - layout.height - ROW).abs() < 1e-9);
    }

    #[test]
    fn marks_are_labelled_with_the_digits_they_need() {
        let layout = Layout::of(&scene(vec![[-1.0, -1.0], [1.0, 1.0]]));
        let labels: Vec<String> =
            layout.marks(0).into_iter().map(|mark| layout.label(mark)).collect();
        assert_eq!(labels, ["-1.0", "-0.5", "0.0", "0.5", "1.0"]);
        let layout = Layout::of(&scene(vec![[0.0, 0.0], [30.0, 10.0]]));
        assert_eq!(layout.label(10.0), "10");
    }
}
