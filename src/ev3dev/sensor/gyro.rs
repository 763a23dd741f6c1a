//! The gyro sensor. **Clockwise is positive here**, seen from the side with the arrows, as the
//! sensor has it: only `robot` reverses the sign.
//!
//! # What we count on
//!
//! - Whole degrees. At the end of its range (±32767°) the angle sticks or wraps, by the sensor's
//!   make; rates beyond ±440 °/s saturate and cost the angle its truth.
//! - It must stand still while it starts, or it drifts all session.
//! - The most robust use is never to reset it, and to keep an offset.

use crate::ev3dev::error::DeviceError;
use crate::ev3dev::words::words;
use crate::units::radians;

use super::typed::{TypedSensor, sensor_modes};

words! {
    /// The gyro sensor's usable modes. GYRO-CAL is left out: it is for calibration and not for
    /// measuring.
    GyroMode {
        /// Angle.
        Angle = "GYRO-ANG",
        /// Rate.
        Rate = "GYRO-RATE",
        /// Rate, fast and raw.
        Fast = "GYRO-FAS",
        /// Angle and rate. Some sensors hang in it.
        AngleAndRate = "GYRO-G&A",
        /// Rate about the second axis, on newer sensors.
        TiltRate = "TILT-RATE",
        /// Angle about the second axis, on newer sensors.
        TiltAngle = "TILT-ANG",
    }
}

sensor_modes!(GyroMode, Gyro);

/// The gyro sensor, `lego-ev3-gyro`.
pub type GyroSensor = TypedSensor<GyroMode>;

/// Angle and rate of one frame; clockwise is positive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AngleAndRate {
    /// Angle, radians.
    pub angle_rad: f64,
    /// Rate, radians per second.
    pub rate_rad_s: f64,
}

/// What a newer sensor can be told to do; the older ones (date code ending in 2 or 3) do both at
/// every real change of mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GyroReset {
    /// The present angle becomes 0, after about 25 ms.
    Zero,
    /// It calibrates again, and must stand still.
    Calibrate,
}

impl GyroSensor {
    /// Angle, radians, clockwise positive. Mode [`GyroMode::Angle`].
    ///
    /// # Errors
    ///
    /// [`Cause::Refused`](crate::ev3dev::Cause::Refused) in any other mode;
    /// [`Cause::Malformed`](crate::ev3dev::Cause::Malformed) beyond 16 bits.
    pub fn angle_rad(&self) -> Result<f64, DeviceError> {
        self.in_radians(GyroMode::Angle)
    }

    /// Rate, radians per second, clockwise positive. Mode [`GyroMode::Rate`].
    ///
    /// # Errors
    ///
    /// As [`GyroSensor::angle_rad`].
    pub fn rate_rad_s(&self) -> Result<f64, DeviceError> {
        self.in_radians(GyroMode::Rate)
    }

    /// Rate as the sensor's converter has it, −1464 to 1535, clockwise positive; its scale is
    /// written down nowhere. Mode [`GyroMode::Fast`].
    ///
    /// # Errors
    ///
    /// As [`GyroSensor::angle_rad`].
    pub fn fast_rate_raw(&self) -> Result<i32, DeviceError> {
        self.whole(GyroMode::Fast)
    }

    /// Angle and rate of one frame. Mode [`GyroMode::AngleAndRate`].
    ///
    /// # Errors
    ///
    /// As [`GyroSensor::angle_rad`].
    pub fn angle_and_rate(&self) -> Result<AngleAndRate, DeviceError> {
        self.frame_in(GyroMode::AngleAndRate, |frame| match frame.values() {
            [angle, rate, ..] => {
                Some(AngleAndRate { angle_rad: radians(*angle), rate_rad_s: radians(*rate) })
            }
            _ => None,
        })
    }

    /// Rate about the second axis, radians per second, positive clockwise seen from the side
    /// opposite the plug. Mode [`GyroMode::TiltRate`].
    ///
    /// # Errors
    ///
    /// As [`GyroSensor::angle_rad`].
    pub fn tilt_rate_rad_s(&self) -> Result<f64, DeviceError> {
        self.in_radians(GyroMode::TiltRate)
    }

    /// Angle about the second axis, radians, positive clockwise seen from the side opposite the
    /// plug. Mode [`GyroMode::TiltAngle`].
    ///
    /// # Errors
    ///
    /// As [`GyroSensor::angle_rad`].
    pub fn tilt_angle_rad(&self) -> Result<f64, DeviceError> {
        self.in_radians(GyroMode::TiltAngle)
    }

    /// Tells a newer sensor to start over. Mode [`GyroMode::Angle`]. There is no answer; look at
    /// the angle.
    ///
    /// # Errors
    ///
    /// [`Cause::Refused`](crate::ev3dev::Cause::Refused) in any other mode; what writing gives.
    pub fn reset(&self, what: GyroReset) -> Result<(), DeviceError> {
        self.in_mode(GyroMode::Angle)?;
        // ev3dev issues 362, 1372 and 1387.
        self.sensor().write_direct(match what {
            GyroReset::Zero => &[0x11],
            GyroReset::Calibrate => &[0x88],
        })
    }

    fn whole(&self, mode: GyroMode) -> Result<i32, DeviceError> {
        self.first_in(mode, i16::MIN.into(), i16::MAX.into())
    }

    fn in_radians(&self, mode: GyroMode) -> Result<f64, DeviceError> {
        Ok(radians(f64::from(self.whole(mode)?)))
    }
}
