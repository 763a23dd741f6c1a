//! The colour sensor. Each mode has its own lights, so a change of mode can be seen.

use crate::ev3dev::error::DeviceError;
use crate::ev3dev::words::words;

use super::Frame;
use super::typed::{TypedSensor, sensor_modes};

words! {
    /// The colour sensor's usable modes. COL-CAL is left out: it is the factory's, and the sensor
    /// stops answering in it.
    ColourMode {
        /// Reflected red light.
        Reflect = "COL-REFLECT",
        /// Light from elsewhere.
        Ambient = "COL-AMBIENT",
        /// Which colour lies about 1 cm below.
        Colour = "COL-COLOR",
        /// The converter's numbers with the light on and off.
        RefRaw = "REF-RAW",
        /// The converter's numbers for red, green and blue.
        RgbRaw = "RGB-RAW",
    }
}

sensor_modes!(ColourMode, Colour);

/// The colour sensor, `lego-ev3-color`.
pub type ColourSensor = TypedSensor<ColourMode>;

words! {
    /// What the sensor takes a surface for, with its name in missions and worlds; the discriminant
    /// is the sensor's number.
    #[repr(u8)]
    Colour {
        /// Nothing near enough.
        None = "none",
        /// Black.
        Black = "black",
        /// Blue.
        Blue = "blue",
        /// Green.
        Green = "green",
        /// Yellow.
        Yellow = "yellow",
        /// Red.
        Red = "red",
        /// White.
        White = "white",
        /// Brown.
        Brown = "brown",
    }
}

impl Colour {
    /// The sensor's number for it.
    #[must_use]
    pub const fn number(self) -> u8 {
        self as u8
    }
}

/// The converter's numbers, 0 to 1023; larger is darker, and reflectance goes with `dark` − `lit`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RawReflection {
    /// With the red light on.
    pub lit: i64,
    /// With the light off.
    pub dark: i64,
}

/// The converter's numbers by colour of the light, about 0 to 1020.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RawRgb {
    /// In red light.
    pub red: i64,
    /// In green light.
    pub green: i64,
    /// In blue light.
    pub blue: i64,
    /// With the light off; drivers of the present image do not give it.
    pub dark: Option<i64>,
}

impl ColourSensor {
    /// Reflected light, percent. Mode [`ColourMode::Reflect`].
    ///
    /// # Errors
    ///
    /// [`Cause::Refused`](crate::ev3dev::Cause::Refused) in any other mode;
    /// [`Cause::Malformed`](crate::ev3dev::Cause::Malformed) beyond 0 to 100.
    pub fn reflected_pct(&self) -> Result<f64, DeviceError> {
        self.first_in(ColourMode::Reflect, 0, 100).map(f64::from)
    }

    /// Light from elsewhere, percent. Mode [`ColourMode::Ambient`].
    ///
    /// # Errors
    ///
    /// As [`ColourSensor::reflected_pct`].
    pub fn ambient_pct(&self) -> Result<f64, DeviceError> {
        self.first_in(ColourMode::Ambient, 0, 100).map(f64::from)
    }

    /// The colour below. Mode [`ColourMode::Colour`].
    ///
    /// # Errors
    ///
    /// As [`ColourSensor::reflected_pct`], with 0 to 7.
    pub fn colour(&self) -> Result<Colour, DeviceError> {
        let number = self.first_in(ColourMode::Colour, 0, 7)?;
        let colour =
            usize::try_from(number).ok().and_then(|number| Colour::ALL.get(number).copied());
        colour.ok_or_else(|| self.sensor().illegal(number, 0, 7))
    }

    /// The converter's numbers with the light on and off, of one frame. Mode
    /// [`ColourMode::RefRaw`].
    ///
    /// # Errors
    ///
    /// As [`ColourSensor::reflected_pct`].
    pub fn raw_reflection(&self) -> Result<RawReflection, DeviceError> {
        self.frame_in(ColourMode::RefRaw, |frame| {
            Some(RawReflection { lit: frame.whole(0)?, dark: frame.whole(1)? })
        })
    }

    /// The converter's numbers by colour, of one frame. Mode [`ColourMode::RgbRaw`].
    ///
    /// # Errors
    ///
    /// As [`ColourSensor::reflected_pct`].
    pub fn raw_rgb(&self) -> Result<RawRgb, DeviceError> {
        self.frame_in(ColourMode::RgbRaw, raw_rgb)
    }
}

fn raw_rgb(frame: &Frame) -> Option<RawRgb> {
    Some(RawRgb {
        red: frame.whole(0)?,
        green: frame.whole(1)?,
        blue: frame.whole(2)?,
        dark: frame.whole(3),
    })
}
