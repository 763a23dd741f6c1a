//! What pictures are drawn with, and the formats that they come in: SVG, PNG, PDF.
//!
//! A picture is laid out once, in units of 1/800 of a map's width, and drawn larger: SVG ten times,
//! because `plotters` counts in whole pixels; PNG three times, then made smooth by averaging down.
//! PDF is made from the SVG.
//!
//! # What we count on
//!
//! - The font is inside the program (Ubuntu Light): nothing of the system's is asked for.

use std::fmt::Display;
use std::sync::{Arc, OnceLock};

use plotters::backend::{BitMapBackend, DrawingBackend, SVGBackend};
use plotters::drawing::IntoDrawingArea;
use plotters::element::{Circle, PathElement, Polygon, Rectangle, Text};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{
    Color, FontDesc, FontStyle, IntoFont, RGBAColor, RGBColor, ShapeStyle, TextStyle, WHITE,
    register_font,
};
use svg2pdf::usvg;

use crate::printable;
use crate::units::rounded;

/// Layout units to SVG's.
const SVG_SCALE: f64 = 10.0;
/// Layout units to the pixels that a PNG is drawn in, and how many of those become one.
const PNG_SCALE: f64 = 3.0;
const PNG_AVERAGE: usize = 2;

pub(super) const INK: RGBColor = RGBColor(0x22, 0x26, 0x2b);
pub(super) const SOFT: RGBColor = RGBColor(0x45, 0x4d, 0x56);
pub(super) const MESH: RGBColor = RGBColor(0xe6, 0xe9, 0xed);
const FONT: &str = "sans-serif";

/// Where a text stands to its place.
pub(super) type Anchor = (HPos, VPos);
pub(super) const LEFT_MIDDLE: Anchor = (HPos::Left, VPos::Center);

/// A picture could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlotError {
    /// The drawing library gave up.
    #[error("cannot draw the picture: {0}")]
    Draw(String),
    /// The PNG could not be written.
    #[error("cannot encode the picture")]
    Encode(#[from] png::EncodingError),
}

/// Something that can be drawn in every format.
pub(super) trait Drawing {
    /// Its width and height, layout units.
    fn size(&self) -> [f64; 2];

    /// Draws it on a white ground.
    fn draw(&self, canvas: &mut Canvas);
}

/// A drawing as SVG, as wide as its layout.
pub(super) fn svg(drawing: &impl Drawing) -> Result<String, PlotError> {
    let shown = drawing.size().map(whole);
    let [width, height] = drawing.size().map(|size| whole(size * SVG_SCALE));
    let mut text = String::new();
    let backend = SVGBackend::with_string(&mut text, (width, height));
    Canvas { shapes: Vec::new(), scale: SVG_SCALE, bitmap: false }.present(drawing, backend)?;
    // The coordinates stay ten times as fine; the picture is shown at its size.
    let large = format!("width=\"{width}\" height=\"{height}\" viewBox");
    let size = format!("width=\"{}\" height=\"{}\" viewBox", shown[0], shown[1]);
    Ok(text.replacen(&large, &size, 1))
}

/// A drawing as PNG, one and a half times as wide as its layout.
pub(super) fn png(drawing: &impl Drawing) -> Result<Vec<u8>, PlotError> {
    let average = u32::try_from(PNG_AVERAGE).unwrap_or(1);
    let [width, height] = drawing.size().map(|size| whole(size * PNG_SCALE) / average);
    let large = (width * average, height * average);
    let mut pixels = vec![0xff; large.0 as usize * large.1 as usize * 3];
    let backend = BitMapBackend::with_buffer(&mut pixels, large);
    Canvas { shapes: Vec::new(), scale: PNG_SCALE, bitmap: true }.present(drawing, backend)?;
    let smooth = averaged(&pixels, width as usize, height as usize);
    Ok(png_file([width, height], png::ColorType::Rgb, &smooth)?)
}

/// Pixels, a byte for each part of a colour, as the bytes of a PNG file.
pub(crate) fn png_file(
    [width, height]: [u32; 2],
    colours: png::ColorType,
    pixels: &[u8],
) -> Result<Vec<u8>, png::EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(colours);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(pixels)?;
    writer.finish()?;
    Ok(bytes)
}

/// A drawing as a PDF of one page.
pub(super) fn pdf(drawing: &impl Drawing) -> Result<Vec<u8>, PlotError> {
    let svg = svg(drawing)?;
    let mut fonts = usvg::fontdb::Database::new();
    fonts.load_font_data(epaint_default_fonts::UBUNTU_LIGHT.to_vec());
    let family = fonts.faces().next().and_then(|face| face.families.first());
    if let Some((family, _)) = family.cloned() {
        fonts.set_sans_serif_family(family);
    }
    let options = usvg::Options { fontdb: Arc::new(fonts), ..usvg::Options::default() };
    let tree = usvg::Tree::from_str(&svg, &options).map_err(draw_error)?;
    svg2pdf::to_pdf(&tree, svg2pdf::ConversionOptions::default(), svg2pdf::PageOptions::default())
        .map_err(draw_error)
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

/// What a drawing is drawn on, in layout units.
pub(super) struct Canvas {
    /// What was drawn, from the lowest to the uppermost.
    shapes: Vec<Shape>,
    scale: f64,
    /// True for the bitmap backend. It draws spikes where a thick line turns back, so lines are
    /// drawn piece by piece with round joins; and it sets text higher than others do.
    bitmap: bool,
}

/// What a picture is put together from, in the backend's units.
enum Shape {
    Line(PathElement<(i32, i32)>),
    Dot(Circle<(i32, i32), u32>),
    Polygon(Polygon<(i32, i32)>),
    Rectangle(Rectangle<(i32, i32)>),
    Text(Box<Text<'static, (i32, i32), String>>),
}

impl Canvas {
    fn present<DB: DrawingBackend>(
        mut self,
        drawing: &impl Drawing,
        backend: DB,
    ) -> Result<(), PlotError> {
        register()?;
        drawing.draw(&mut self);
        let area = backend.into_drawing_area();
        area.fill(&WHITE).map_err(draw_error)?;
        for shape in &self.shapes {
            let drawn = match shape {
                Shape::Line(line) => area.draw(line),
                Shape::Dot(dot) => area.draw(dot),
                Shape::Polygon(polygon) => area.draw(polygon),
                Shape::Rectangle(rectangle) => area.draw(rectangle),
                Shape::Text(text) => area.draw(text.as_ref()),
            };
            drawn.map_err(draw_error)?;
        }
        area.present().map_err(draw_error)
    }

    /// A line through these places; one place alone is none, and no reader of SVG takes it for one.
    pub(super) fn line(&mut self, line: &[[f64; 2]], colour: RGBColor, width: f64) {
        if line.len() < 2 {
            return;
        }
        let stroke = whole((width * self.scale).max(1.0));
        let style = ShapeStyle { color: colour.to_rgba(), filled: false, stroke_width: stroke };
        let points: Vec<(i32, i32)> = line.iter().map(|place| self.at(*place)).collect();
        if !self.bitmap {
            return self.shapes.push(Shape::Line(PathElement::new(points, style)));
        }
        let pieces = points.windows(2).map(|pair| PathElement::new(pair.to_vec(), style));
        self.shapes.extend(pieces.map(Shape::Line));
        if points.len() > 2 && stroke > 2 {
            let joins = points.into_iter().map(|at| Circle::new(at, stroke / 2, colour.filled()));
            self.shapes.extend(joins.map(Shape::Dot));
        }
    }

    /// A line of pieces with gaps between them, both this long.
    pub(super) fn dashed(&mut self, line: &[[f64; 2]], colour: RGBColor, width: f64, dash: f64) {
        let mut piece: Vec<[f64; 2]> = Vec::new();
        let (mut left, mut is_drawn) = (dash, true);
        for pair in line.windows(2) {
            let [mut from, to] = [pair[0], pair[1]];
            loop {
                let length = libm::hypot(to[0] - from[0], to[1] - from[1]);
                if is_drawn && piece.is_empty() {
                    piece.push(from);
                }
                // What is no number is no end either.
                if !length.is_finite() {
                    break;
                }
                if length < left {
                    left -= length;
                    if is_drawn {
                        piece.push(to);
                    }
                    break;
                }
                let part = left / length;
                from = [0, 1].map(|axis| from[axis] + part * (to[axis] - from[axis]));
                if is_drawn {
                    piece.push(from);
                    self.line(&std::mem::take(&mut piece), colour, width);
                }
                (left, is_drawn) = (dash, !is_drawn);
            }
        }
        self.line(&piece, colour, width);
    }

    pub(super) fn polygon(&mut self, corners: &[[f64; 2]], colour: RGBColor) {
        let corners: Vec<(i32, i32)> = corners.iter().map(|place| self.at(*place)).collect();
        self.shapes.push(Shape::Polygon(Polygon::new(corners, colour.filled())));
    }

    pub(super) fn rectangle(&mut self, low: [f64; 2], high: [f64; 2], colour: RGBColor) {
        let corners = [self.at(low), self.at(high)];
        self.shapes.push(Shape::Rectangle(Rectangle::new(corners, colour.filled())));
    }

    pub(super) fn dot(&mut self, place: [f64; 2], radius: f64, colour: impl Into<RGBAColor>) {
        let (at, colour): (_, RGBAColor) = (self.at(place), colour.into());
        let dot = Circle::new(at, whole(radius * self.scale), colour.filled());
        self.shapes.push(Shape::Dot(dot));
    }

    /// How wide a text is.
    pub(super) fn text_width(&self, text: &str, size: f64) -> f64 {
        // The one font is in the program and known by now: each text has a size.
        let (width, _) = self.font(size).box_size(text).unwrap_or_default();
        f64::from(width) / self.scale
    }

    pub(super) fn text(
        &mut self,
        text: &str,
        place: [f64; 2],
        size: f64,
        colour: RGBColor,
        (h, v): Anchor,
    ) {
        // The bitmap backend centres a line of text by its box, whose upper part is empty over most
        // letters.
        let lower = if self.bitmap && matches!(v, VPos::Center) { 0.12 * size } else { 0.0 };
        let place = self.at([place[0], place[1] + lower]);
        let mut style = TextStyle::from(self.font(size)).pos(Pos::new(h, v));
        style.color = colour.to_backend_color();
        let text = printable::line(text).into_owned();
        self.shapes.push(Shape::Text(Box::new(Text::new(text, place, style))));
    }

    /// A title around this middle; one that is wider than there is room ends with an ellipsis.
    pub(super) fn title(&mut self, title: &str, middle: f64, room: f64) {
        const SIZE: f64 = 21.0;
        /// More letters than fit into any picture.
        const MOST: usize = 400;
        let mut letters: Vec<char> = title.chars().take(MOST).collect();
        let mut shown: String = letters.iter().collect();
        while self.text_width(&shown, SIZE) > room && letters.pop().is_some() {
            shown = letters.iter().chain(&['…']).collect();
        }
        self.text(&shown, [middle, 10.0], SIZE, INK, (HPos::Center, VPos::Top));
    }

    fn font(&self, size: f64) -> FontDesc<'static> {
        (FONT, size * self.scale).into_font()
    }

    fn at(&self, [x, y]: [f64; 2]) -> (i32, i32) {
        (rounded(x * self.scale), rounded(y * self.scale))
    }
}

pub(super) fn rgb([red, green, blue]: [u8; 3]) -> RGBColor {
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
