//! A picture of the screen's size in memory, drawn on with `embedded-graphics`.

use std::convert::Infallible;

use embedded_graphics::pixelcolor::{Gray2, GrayColor};
use embedded_graphics::prelude::{Dimensions, DrawTarget, OriginDimensions, Pixel, Point, Size};
use embedded_graphics::primitives::Rectangle;

/// Pixels in a row of the brick's screen.
pub const WIDTH: u32 = 178;

/// Rows of the brick's screen.
pub const HEIGHT: u32 = 128;

/// White: the paper.
pub(super) const PAPER: Gray2 = Gray2::WHITE;

/// Black: what is written on it.
pub(super) const INK: Gray2 = Gray2::BLACK;

/// One picture: a byte a pixel, 0 black to 255 white, row by row, in the panel's four greys.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Canvas {
    pixels: Vec<u8>,
}

impl Default for Canvas {
    /// White paper.
    fn default() -> Self {
        Self { pixels: vec![u8::MAX; at(0, HEIGHT)] }
    }
}

/// Where a pixel is in the row of bytes.
const fn at(x: u32, y: u32) -> usize {
    // Both are small: at most 178 and 128.
    (y * WIDTH + x) as usize
}

/// The panel shows the top two bits of what it gets.
fn luma(colour: Gray2) -> u8 {
    colour.luma() * 85
}

impl Canvas {
    /// The bytes, [`WIDTH`] a row.
    #[must_use]
    pub fn pixels(&self) -> &[u8] {
        &self.pixels
    }

    /// A pixel's grey; white outside.
    #[must_use]
    pub fn pixel(&self, x: u32, y: u32) -> u8 {
        if x < WIDTH { self.pixels.get(at(x, y)).copied().unwrap_or(u8::MAX) } else { u8::MAX }
    }
}

impl OriginDimensions for Canvas {
    fn size(&self) -> Size {
        Size::new(WIDTH, HEIGHT)
    }
}

impl DrawTarget for Canvas {
    type Color = Gray2;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Gray2>>>(
        &mut self,
        pixels: I,
    ) -> Result<(), Infallible> {
        for Pixel(point, colour) in pixels {
            if let (Ok(x), Ok(y)) = (u32::try_from(point.x), u32::try_from(point.y))
                && x < WIDTH
                && let Some(place) = self.pixels.get_mut(at(x, y))
            {
                *place = luma(colour);
            }
        }
        Ok(())
    }

    /// Whole rows at once: the paper of each frame is laid this way.
    fn fill_solid(&mut self, area: &Rectangle, colour: Gray2) -> Result<(), Infallible> {
        let area = area.intersection(&self.bounding_box());
        let Point { x, y } = area.top_left;
        let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y)) else { return Ok(()) };
        for row in y..y + area.size.height {
            if let Some(row) = self.pixels.get_mut(at(x, row)..at(x + area.size.width, row)) {
                row.fill(luma(colour));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_outside_are_left_out_and_greys_are_the_panels() {
        let mut canvas = Canvas::default();
        let pixels = [(0, 0, 0), (177, 127, 1), (178, 0, 0), (-1, 5, 0), (3, 128, 0), (5, 5, 2)];
        canvas
            .draw_iter(pixels.map(|(x, y, grey)| Pixel(Point::new(x, y), Gray2::new(grey))))
            .unwrap();
        assert_eq!([canvas.pixel(0, 0), canvas.pixel(177, 127), canvas.pixel(5, 5)], [0, 85, 170]);
        assert_eq!(canvas.pixels().iter().filter(|grey| **grey != 255).count(), 3);
        canvas.fill_solid(&Rectangle::new(Point::new(-4, 120), Size::new(500, 500)), INK).unwrap();
        assert_eq!(canvas.pixels().iter().filter(|grey| **grey == 0).count(), 8 * 178 + 1);
    }
}
