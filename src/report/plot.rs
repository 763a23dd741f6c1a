//! A scene as a picture: SVG, PNG, HTML.
//!
//! Both axes have the same scale. The layout is made once, in units of 1/800 of the picture's
//! width, and drawn larger: SVG ten times, because `plotters` counts in whole pixels; PNG three
//! times, then made smooth by averaging down to 1200 pixels.
//!
//! # What we count on
//!
//! - The font is inside the program (Ubuntu Light): nothing of the system's is asked for.

use std::fmt::Display;
use std::sync::OnceLock;

use plotters::backend::{BitMapBackend, DrawingBackend, SVGBackend};
use plotters::coord::Shift;
use plotters::drawing::{DrawingArea, IntoDrawingArea};
use plotters::element::{Circle, PathElement, Polygon, Rectangle, Text};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{
    Color, FontStyle, IntoFont, RGBColor, ShapeStyle, TextStyle, WHITE, register_font,
};

use super::{Colours, Scene, Track, colours, is_single, page, thinned};
use crate::printable;

/// The picture's width in layout units.
const WIDTH: f64 = 800.0;
/// Around the plot, in layout units: left, top, right.
const LEFT: f64 = 62.0;
const TOP: f64 = 52.0;
const RIGHT: f64 = 24.0;
/// From the plot down to the legend, and the height of one of its rows.
const AXIS: f64 = 52.0;
const ROW: f64 = 24.0;

/// Layout units to SVG's.
const SVG_SCALE: f64 = 10.0;
/// Layout units to the pixels that a PNG is drawn in, and how many of those become one.
const PNG_SCALE: f64 = 3.0;
const PNG_AVERAGE: usize = 2;

/// No path is drawn finer, metres.
const LEAST_STEP_M: f64 = 0.004;

const INK: RGBColor = RGBColor(0x22, 0x26, 0x2b);
const SOFT: RGBColor = RGBColor(0x45, 0x4d, 0x56);
const MESH: RGBColor = RGBColor(0xe6, 0xe9, 0xed);
const WALL: RGBColor = RGBColor(0x9a, 0xa1, 0xa9);
const FONT: &str = "sans-serif";

/// A picture could not be made.
#[derive(Debug, thiserror::Error)]
pub enum PlotError {
    /// The drawing library gave up.
    #[error("cannot draw the picture: {0}")]
    Draw(String),
    /// The PNG could not be written.
    #[error("cannot encode the picture")]
    Encode(#[from] png::EncodingError),
}

/// The scene as SVG, 800 wide.
///
/// # Errors
///
/// [`PlotError::Draw`].
pub fn svg(scene: &Scene) -> Result<String, PlotError> {
    let layout = Layout::of(scene);
    let (width, height) = (whole(WIDTH * SVG_SCALE), whole(layout.height * SVG_SCALE));
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, (width, height)).into_drawing_area();
        Picture { area: &area, scene, layout: &layout, scale: SVG_SCALE, bitmap: false }.draw()?;
        area.present().map_err(draw_error)?;
    }
    // The coordinates stay ten times as fine; the picture is shown at its size.
    let large = format!("width=\"{width}\" height=\"{height}\" viewBox");
    let shown = format!("width=\"{WIDTH}\" height=\"{}\" viewBox", whole(layout.height));
    Ok(text.replacen(&large, &shown, 1))
}

/// The scene as PNG, 1200 pixels wide.
///
/// # Errors
///
/// See [`PlotError`].
pub fn png(scene: &Scene) -> Result<Vec<u8>, PlotError> {
    let layout = Layout::of(scene);
    let average = u32::try_from(PNG_AVERAGE).unwrap_or(1);
    let (width, height) =
        (whole(WIDTH * PNG_SCALE) / average, whole(layout.height * PNG_SCALE) / average);
    let large = (width * average, height * average);
    let mut pixels = vec![0xff; large.0 as usize * large.1 as usize * 3];
    {
        let area = BitMapBackend::with_buffer(&mut pixels, large).into_drawing_area();
        Picture { area: &area, scene, layout: &layout, scale: PNG_SCALE, bitmap: true }.draw()?;
        area.present().map_err(draw_error)?;
    }
    let smooth = averaged(&pixels, width as usize, height as usize);
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header()?.write_image_data(&smooth)?;
    Ok(bytes)
}

/// The scene as one HTML page that needs nothing else: drag to pan, wheel to zoom, slide through
/// time.
#[must_use]
pub fn html(scene: &Scene) -> String {
    page::html(scene)
}

fn draw_error(error: impl Display) -> PlotError {
    PlotError::Draw(error.to_string())
}

/// Each pixel of the result is the mean of a square of [`PNG_AVERAGE`] pixels' edge.
fn averaged(pixels: &[u8], width: usize, height: usize) -> Vec<u8> {
    let row = width * PNG_AVERAGE * 3;
    let mut smooth = Vec::with_capacity(width * height * 3);
    for y in 0..height {
        for x in 0..width {
            for channel in 0..3 {
                let mut sum = 0_usize;
                for place in 0..PNG_AVERAGE * PNG_AVERAGE {
                    let (dy, dx) = (place / PNG_AVERAGE, place % PNG_AVERAGE);
                    let at = (y * PNG_AVERAGE + dy) * row + (x * PNG_AVERAGE + dx) * 3 + channel;
                    sum += usize::from(pixels.get(at).copied().unwrap_or(0xff));
                }
                smooth.push(u8::try_from(sum / (PNG_AVERAGE * PNG_AVERAGE)).unwrap_or(0xff));
            }
        }
    }
    smooth
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a cast from float saturates"
)]
fn whole(value: f64) -> u32 {
    libm::round(value) as u32
}

#[expect(clippy::cast_possible_truncation, reason = "a cast from float saturates")]
fn pixel(value: f64) -> i32 {
    libm::round(value) as i32
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
        let bounds = scene.bounds();
        let span =
            [0, 1].map(|axis| 1.08 * (bounds.high[axis] - bounds.low[axis]).max(LEAST_SPAN_M));
        let width = WIDTH - LEFT - RIGHT;
        let plot = [width, (width * span[1] / span[0]).clamp(260.0, 860.0)];
        let scale = (plot[0] / span[0]).min(plot[1] / span[1]);
        let low =
            [0, 1].map(|axis| (bounds.low[axis] + bounds.high[axis] - plot[axis] / scale) / 2.0);
        let rows = if is_single(scene) { 1.0 } else { 1.0 + rows_of_names(scene) };
        Self { low, scale, plot, height: TOP + plot[1] + AXIS + rows * ROW + 10.0 }
    }

    /// A point of the world in the picture.
    fn place(&self, x_m: f64, y_m: f64) -> [f64; 2] {
        [
            LEFT + (x_m - self.low[0]) * self.scale,
            TOP + self.plot[1] - (y_m - self.low[1]) * self.scale,
        ]
    }

    /// The values that an axis is marked at: multiples of 1, 2 or 5 times a power of ten, about 80
    /// units apart.
    fn marks(&self, axis: usize) -> Vec<f64> {
        let step = self.step();
        let first = libm::ceil(self.low[axis] / step);
        let last = libm::floor((self.low[axis] + self.plot[axis] / self.scale) / step);
        let mut marks = Vec::new();
        let mut at = first;
        while at <= last && marks.len() < 100 {
            marks.push(at * step);
            at += 1.0;
        }
        marks
    }

    fn step(&self) -> f64 {
        let wanted = 80.0 / self.scale;
        let ten = libm::pow(10.0, libm::floor(libm::log10(wanted)));
        [1.0, 2.0, 5.0]
            .map(|times| times * ten)
            .into_iter()
            .find(|step| *step >= wanted)
            .unwrap_or(10.0 * ten)
    }

    fn label(&self, value: f64) -> String {
        let decimals =
            if self.step() >= 1.0 { 0 } else { whole(-libm::floor(libm::log10(self.step()))) };
        // Minus zero plus zero is zero, without the sign.
        format!("{:.*}", decimals as usize, value + 0.0)
    }
}

/// Rows of robots' names in the legend.
fn rows_of_names(scene: &Scene) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "a handful")]
    let rows = scene.tracks.len().div_ceil(NAMES_IN_A_ROW) as f64;
    rows
}

const NAMES_IN_A_ROW: usize = 4;

struct Picture<'a, DB: DrawingBackend> {
    area: &'a DrawingArea<DB, Shift>,
    scene: &'a Scene,
    layout: &'a Layout,
    scale: f64,
    /// True for the bitmap backend. It draws spikes where a thick line turns back, so lines are
    /// drawn piece by piece with round joins; and it sets text higher than others do.
    bitmap: bool,
}

impl<DB: DrawingBackend> Picture<'_, DB> {
    fn draw(&self) -> Result<(), PlotError> {
        register()?;
        self.area.fill(&WHITE).map_err(draw_error)?;
        self.mesh()?;
        for outline in &self.scene.outlines {
            let line: Vec<[f64; 2]> =
                outline.iter().map(|[x, y]| self.layout.place(*x, *y)).collect();
            self.line(&line, WALL, 3.0)?;
        }
        let tracks = || self.scene.tracks.iter().enumerate();
        for (place, track) in tracks() {
            self.points(track, self.colours(place))?;
        }
        for (place, track) in tracks() {
            let path = thinned(&track.path, LEAST_STEP_M);
            let line: Vec<[f64; 2]> =
                path.iter().map(|p| self.layout.place(p.x_m, p.y_m)).collect();
            self.line(&line, rgb(self.colours(place).path), 2.0)?;
        }
        for (_, track) in tracks() {
            self.ends(track)?;
        }
        self.title()?;
        self.legend()
    }

    fn colours(&self, place: usize) -> Colours {
        colours(place, self.scene.tracks.len())
    }

    fn mesh(&self) -> Result<(), PlotError> {
        let (bottom, right) = (TOP + self.layout.plot[1], LEFT + self.layout.plot[0]);
        for x_m in self.layout.marks(0) {
            let [x, _] = self.layout.place(x_m, 0.0);
            self.line(&[[x, TOP], [x, bottom]], MESH, 1.0)?;
            self.text(
                &self.layout.label(x_m),
                [x, bottom + 7.0],
                14.0,
                SOFT,
                (HPos::Center, VPos::Top),
            )?;
        }
        for y_m in self.layout.marks(1) {
            let [_, y] = self.layout.place(0.0, y_m);
            self.line(&[[LEFT, y], [right, y]], MESH, 1.0)?;
            self.text(
                &self.layout.label(y_m),
                [LEFT - 8.0, y],
                14.0,
                SOFT,
                (HPos::Right, VPos::Center),
            )?;
        }
        let frame = [[LEFT, TOP], [right, TOP], [right, bottom], [LEFT, bottom], [LEFT, TOP]];
        self.line(&frame, SOFT, 1.0)?;
        let middle = LEFT + self.layout.plot[0] / 2.0;
        self.text("x in metres", [middle, bottom + 28.0], 14.0, SOFT, (HPos::Center, VPos::Top))?;
        self.text("y in metres", [LEFT - 46.0, TOP - 24.0], 14.0, SOFT, (HPos::Left, VPos::Top))
    }

    fn points(&self, track: &Track, colours: Colours) -> Result<(), PlotError> {
        for point in &track.points {
            self.dot(self.layout.place(point.x_m, point.y_m), 1.9, rgb(colours.points))?;
        }
        Ok(())
    }

    /// A ring where the path begins, an arrow in the direction of the robot where it ends.
    fn ends(&self, track: &Track) -> Result<(), PlotError> {
        if let Some(start) = track.path.first() {
            self.start_mark(self.layout.place(start.x_m, start.y_m))?;
        }
        if let Some(end) = track.path.last() {
            self.end_mark(self.layout.place(end.x_m, end.y_m), end.heading_rad)?;
        }
        Ok(())
    }

    fn start_mark(&self, place: [f64; 2]) -> Result<(), PlotError> {
        self.dot(place, 6.5, INK)?;
        self.dot(place, 4.2, WHITE)
    }

    fn end_mark(&self, [x, y]: [f64; 2], heading_rad: f64) -> Result<(), PlotError> {
        let corner = |angle_rad: f64, size: f64| {
            let direction = heading_rad + angle_rad;
            self.at([x + size * libm::cos(direction), y - size * libm::sin(direction)])
        };
        let arrow = |grow: f64| {
            vec![
                corner(0.0, 9.0 + grow),
                corner(2.5, 8.0 + grow),
                corner(std::f64::consts::PI, 3.0),
                corner(-2.5, 8.0 + grow),
            ]
        };
        self.area.draw(&Polygon::new(arrow(2.5), WHITE.filled())).map_err(draw_error)?;
        self.area.draw(&Polygon::new(arrow(0.0), INK.filled())).map_err(draw_error)
    }

    fn title(&self) -> Result<(), PlotError> {
        let middle = LEFT + self.layout.plot[0] / 2.0;
        self.text(&self.scene.title, [middle, 10.0], 21.0, INK, (HPos::Center, VPos::Top))
    }

    fn legend(&self) -> Result<(), PlotError> {
        let row = TOP + self.layout.plot[1] + AXIS + ROW / 2.0;
        self.legend_of_symbols(row)?;
        if is_single(self.scene) { Ok(()) } else { self.legend_of_robots(row) }
    }

    fn legend_of_symbols(&self, row: f64) -> Result<(), PlotError> {
        let (path, points) = match is_single(self.scene) {
            true => (rgb(self.colours(0).path), rgb(self.colours(0).points)),
            false => (SOFT, SOFT),
        };
        let mut x = LEFT;
        self.line(&[[x, row], [x + 26.0, row]], path, 2.5)?;
        x = self.legend_text("path", x + 34.0, row)?;
        for step in [4.0, 12.0, 20.0] {
            self.dot([x + step, row], 2.3, points)?;
        }
        x = self.legend_text("points", x + 30.0, row)?;
        self.start_mark([x + 6.0, row])?;
        x = self.legend_text("start", x + 20.0, row)?;
        self.end_mark([x + 8.0, row], 0.0)?;
        x = self.legend_text("end", x + 26.0, row)?;
        if !self.scene.outlines.is_empty() {
            self.line(&[[x, row], [x + 26.0, row]], WALL, 3.0)?;
            self.legend_text("walls", x + 34.0, row)?;
        }
        Ok(())
    }

    /// The robots' colours and names, in rows below `row`.
    fn legend_of_robots(&self, mut row: f64) -> Result<(), PlotError> {
        let mut x = LEFT;
        for (place, track) in self.scene.tracks.iter().enumerate() {
            if place.is_multiple_of(NAMES_IN_A_ROW) {
                (row, x) = (row + ROW, LEFT);
            }
            let colours = self.colours(place);
            self.block([x, row], rgb(colours.path), rgb(colours.points))?;
            let name: String = track.name.chars().take(18).collect();
            self.text(&name, [x + 34.0, row], 14.0, INK, (HPos::Left, VPos::Center))?;
            x += self.layout.plot[0] / 4.0;
        }
        Ok(())
    }

    /// Draws a word of the legend; where the next entry begins.
    fn legend_text(&self, word: &str, x: f64, row: f64) -> Result<f64, PlotError> {
        let style = self.style(14.0, INK, (HPos::Left, VPos::Center));
        self.text(word, [x, row], 14.0, INK, (HPos::Left, VPos::Center))?;
        let (width, _) = self.area.estimate_text_size(word, &style).map_err(draw_error)?;
        Ok(x + f64::from(width) / self.scale + 26.0)
    }

    fn block(&self, [x, y]: [f64; 2], left: RGBColor, right: RGBColor) -> Result<(), PlotError> {
        for (from, to, colour) in [(0.0, 13.0, left), (13.0, 26.0, right)] {
            let corners = [self.at([x + from, y - 6.0]), self.at([x + to, y + 6.0])];
            self.area.draw(&Rectangle::new(corners, colour.filled())).map_err(draw_error)?;
        }
        Ok(())
    }

    fn line(&self, line: &[[f64; 2]], colour: RGBColor, width: f64) -> Result<(), PlotError> {
        let stroke = whole((width * self.scale).max(1.0));
        let style = ShapeStyle { color: colour.to_rgba(), filled: false, stroke_width: stroke };
        let points: Vec<(i32, i32)> = line.iter().map(|place| self.at(*place)).collect();
        if !self.bitmap {
            return self.area.draw(&PathElement::new(points, style)).map_err(draw_error);
        }
        for pair in points.windows(2) {
            self.area.draw(&PathElement::new(pair.to_vec(), style)).map_err(draw_error)?;
        }
        if points.len() > 2 && stroke > 2 {
            for point in points {
                let dot = Circle::new(point, stroke / 2, colour.filled());
                self.area.draw(&dot).map_err(draw_error)?;
            }
        }
        Ok(())
    }

    fn dot(&self, place: [f64; 2], radius: f64, colour: RGBColor) -> Result<(), PlotError> {
        let dot = Circle::new(self.at(place), whole(radius * self.scale), colour.filled());
        self.area.draw(&dot).map_err(draw_error)
    }

    fn text(
        &self,
        text: &str,
        place: [f64; 2],
        size: f64,
        colour: RGBColor,
        anchor: (HPos, VPos),
    ) -> Result<(), PlotError> {
        // The bitmap backend centres a line of text by its box, whose upper part is empty over most
        // letters.
        let lower = if self.bitmap && matches!(anchor.1, VPos::Center) { 0.12 * size } else { 0.0 };
        let place = self.at([place[0], place[1] + lower]);
        let style = self.style(size, colour, anchor);
        let text = printable::line(text).into_owned();
        self.area.draw(&Text::new(text, place, style)).map_err(draw_error)
    }

    fn style(&self, size: f64, colour: RGBColor, (h, v): (HPos, VPos)) -> TextStyle<'static> {
        let mut style = TextStyle::from((FONT, size * self.scale).into_font()).pos(Pos::new(h, v));
        style.color = colour.to_backend_color();
        style
    }

    fn at(&self, [x, y]: [f64; 2]) -> (i32, i32) {
        (pixel(x * self.scale), pixel(y * self.scale))
    }
}

fn rgb([red, green, blue]: [u8; 3]) -> RGBColor {
    RGBColor(red, green, blue)
}

/// Makes the font known to the drawing library, once.
fn register() -> Result<(), PlotError> {
    static REGISTERED: OnceLock<bool> = OnceLock::new();
    let known = REGISTERED.get_or_init(|| {
        register_font(FONT, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT).is_ok()
    });
    if *known { Ok(()) } else { Err(PlotError::Draw("its font is not one".to_owned())) }
}

#[cfg(test)]
mod tests {
    use super::*;
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
    fn marks_are_labelled_with_the_digits_they_need() {
        let layout = Layout::of(&scene(vec![[-1.0, -1.0], [1.0, 1.0]]));
        let labels: Vec<String> =
            layout.marks(0).into_iter().map(|mark| layout.label(mark)).collect();
        assert_eq!(labels, ["-1.0", "-0.5", "0.0", "0.5", "1.0"]);
        let layout = Layout::of(&scene(vec![[0.0, 0.0], [30.0, 10.0]]));
        assert_eq!(layout.label(10.0), "10");
    }
}
