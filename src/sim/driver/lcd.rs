//! The screen: class `graphics`, and the memory behind `dev/fb0`.
//!
//! A frame buffer is asked for its geometry by ioctls that say nothing of their length, and those
//! cross no file system in user space. A program learns it from `sys/class/graphics/fb0`, or is
//! told.
//!
//! # Not here
//!
//! The panel's four grey levels and its slow refresh: what was written is what the picture is.

use std::str::FromStr;

use nix::errno::Errno;

use super::{Attributes, Context, Driver, Took, line, readable, readwriteable};
use crate::ev3dev::AttributeSpec;

const ATTRIBUTES: &[AttributeSpec] = &[
    readwriteable("bits_per_pixel"),
    readwriteable("modes"),
    readable("name"),
    readable("stride"),
    readwriteable("virtual_size"),
];

/// What a frame buffer looks like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LcdGeometry {
    width: u32,
    height: u32,
    bits_per_pixel: u32,
}

/// A text that is no geometry.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "a screen is WIDTHxHEIGHTxBITS: 1 to 4096 pixels each way, and 1, 8, 16, 24 or 32 bits a pixel"
)]
pub struct BadGeometry;

impl LcdGeometry {
    /// A screen of this many pixels.
    ///
    /// # Errors
    ///
    /// [`BadGeometry`] beyond 4096 pixels, for none, and for bits a pixel that no frame buffer has.
    pub fn new(width: u32, height: u32, bits_per_pixel: u32) -> Result<Self, BadGeometry> {
        let is_size = |pixels| (1..=4096).contains(&pixels);
        if is_size(width) && is_size(height) && matches!(bits_per_pixel, 1 | 8 | 16 | 24 | 32) {
            Ok(Self { width, height, bits_per_pixel })
        } else {
            Err(BadGeometry)
        }
    }

    /// Bytes from one row to the next: a whole number of 32-bit words.
    #[must_use]
    pub const fn line_length(self) -> u32 {
        (self.width * self.bits_per_pixel).div_ceil(32) * 4
    }

    /// Bytes of a picture.
    #[must_use]
    pub const fn size(self) -> usize {
        // At most 4096 x 16 384, which every machine's `usize` holds.
        self.line_length() as usize * self.height as usize
    }
}

/// The EV3's: 178 by 128, 32 bits a pixel (XRGB8888).
impl Default for LcdGeometry {
    fn default() -> Self {
        Self { width: 178, height: 128, bits_per_pixel: 32 }
    }
}

/// `178x128x32`.
impl FromStr for LcdGeometry {
    type Err = BadGeometry;

    fn from_str(text: &str) -> Result<Self, BadGeometry> {
        let numbers: Result<Vec<u32>, _> = text.split('x').map(str::parse).collect();
        match numbers.map_err(|_| BadGeometry)?.as_slice() {
            [width, height, bits_per_pixel] => Self::new(*width, *height, *bits_per_pixel),
            _ => Err(BadGeometry),
        }
    }
}

/// One screen.
#[derive(Debug)]
pub(crate) struct Lcd {
    geometry: LcdGeometry,
    /// The picture.
    pub(crate) bytes: Vec<u8>,
    /// How often it was drawn on.
    pub(crate) changes: u32,
}

impl Lcd {
    /// A black one.
    pub(crate) fn new(geometry: LcdGeometry) -> Self {
        Self { geometry, bytes: vec![0; geometry.size()], changes: 0 }
    }

    /// Width, height and each pixel's grey, row by row: 0 black to 255 white.
    pub(crate) fn greys(&self) -> (u32, u32, Vec<u8>) {
        let LcdGeometry { width, height, bits_per_pixel } = self.geometry;
        let rows = self.bytes.chunks_exact((self.geometry.line_length() as usize).max(1));
        let pixels = rows.flat_map(|row| (0..width as usize).map(|x| grey(row, x, bits_per_pixel)));
        (width, height, pixels.collect())
    }

    /// Puts bytes into the picture; returns how many there was room for.
    ///
    /// # Errors
    ///
    /// ENOSPC at its end, as a frame buffer has it.
    pub(crate) fn write(&mut self, offset: usize, bytes: &[u8]) -> Result<usize, Errno> {
        let room = self.bytes.get_mut(offset..).unwrap_or_default();
        if room.is_empty() && !bytes.is_empty() {
            return Err(Errno::ENOSPC);
        }
        let taken = room.len().min(bytes.len());
        self.changes = self.changes.saturating_add(1);
        for (place, byte) in room.iter_mut().zip(bytes) {
            *place = *byte;
        }
        Ok(taken)
    }
}

/// A pixel's grey. With one bit a pixel the first is the lowest, and a bit that is set is black, as
/// the old kernels' driver had it (FB_VISUAL_MONO01).
fn grey(row: &[u8], x: usize, bits_per_pixel: u32) -> u8 {
    let byte = |at: usize| u32::from(row.get(at).copied().unwrap_or(0));
    let luma = |red: u32, green: u32, blue: u32| {
        u8::try_from((red * 77 + green * 150 + blue * 29) >> 8).unwrap_or(u8::MAX)
    };
    match bits_per_pixel {
        1 if byte(x / 8) >> (x % 8) & 1 == 1 => 0,
        1 => u8::MAX,
        8 => luma(byte(x), byte(x), byte(x)),
        16 => {
            let pixel = byte(2 * x) | byte(2 * x + 1) << 8;
            let (red, green, blue) = (pixel >> 11, pixel >> 5 & 0x3f, pixel & 0x1f);
            luma(red * 255 / 31, green * 255 / 63, blue * 255 / 31)
        }
        bits => {
            let at = x * (bits as usize / 8);
            luma(byte(at + 2), byte(at + 1), byte(at))
        }
    }
}

impl Driver for Lcd {
    fn attributes(&self) -> Attributes {
        [ATTRIBUTES, &[]]
    }

    fn read(&self, attribute: &str, out: &mut Vec<u8>) -> Result<(), Errno> {
        let LcdGeometry { width, height, bits_per_pixel } = self.geometry;
        match attribute {
            "bits_per_pixel" => line(out, bits_per_pixel),
            "modes" => line(out, format_args!("U:{width}x{height}p-0")),
            // The driver of the EV3's screen leaves it empty.
            "name" => line(out, ""),
            "stride" => line(out, self.geometry.line_length()),
            "virtual_size" => line(out, format_args!("{width},{height}")),
            _ => return Err(Errno::ENODEV),
        }
        Ok(())
    }

    fn store(&mut self, _attribute: &str, _bytes: &[u8], _context: &mut Context<'_>) -> Took {
        // This screen cannot change its geometry.
        Err(Errno::EINVAL)
    }

    fn uevent(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(b"MAJOR=29\nMINOR=0\nDEVNAME=fb0\n");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bricks_screens_have_the_lengths_of_the_reference() {
        let size = |text: &str| {
            let geometry: LcdGeometry = text.parse().unwrap();
            (geometry.line_length(), geometry.size())
        };
        assert_eq!(size("178x128x32"), (712, 91_136));
        assert_eq!(size("178x128x1"), (24, 3072));
    }

    #[test]
    fn what_is_no_screen_is_refused() {
        for text in
            ["", "178x128", "178x128x32x1", "0x1x1", "5000x1x8", "178x128x7", "-1x1x1", "axbxc"]
        {
            assert_eq!(text.parse::<LcdGeometry>(), Err(BadGeometry), "{text}");
        }
    }

    #[test]
    fn a_pixel_has_the_same_grey_in_every_layout() {
        for (bits, white) in [
            (1, vec![0b1111_1101]),
            (8, vec![0, 255]),
            (16, vec![0, 0, 255, 255]),
            (24, vec![0, 0, 0, 255, 255, 255]),
            (32, vec![0, 0, 0, 0, 255, 255, 255, 0]),
        ] {
            let mut lcd = Lcd::new(LcdGeometry::new(3, 2, bits).unwrap());
            assert_eq!(lcd.changes, 0);
            lcd.write(0, &white).unwrap();
            let (width, height, greys) = lcd.greys();
            assert_eq!((width, height, greys.len(), lcd.changes), (3, 2, 6, 1));
            assert_eq!(greys[..3], [0, 255, 0], "{bits} bits");
        }
    }

    #[test]
    fn a_picture_takes_what_fits() {
        let mut lcd = Lcd::new(LcdGeometry::new(8, 2, 32).unwrap());
        assert_eq!(lcd.write(60, &[1; 8]), Ok(4));
        assert_eq!(lcd.bytes.iter().filter(|byte| **byte == 1).count(), 4);
        assert_eq!(lcd.write(64, &[1]), Err(Errno::ENOSPC));
        assert_eq!(lcd.write(64, &[]), Ok(0));
    }
}
