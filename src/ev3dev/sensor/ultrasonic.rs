//! The ultrasonic sensor.
//!
//! # What we count on
//!
//! - 255.0 cm means: no echo. The sensor says the same when something is nearer than about 4 cm;
//!   telling the two apart takes more than one reading and is done above.
//! - Two sensors that send disturb each other.

use crate::clock::MILLISECOND_NS;
use crate::ev3dev::error::DeviceError;
use crate::ev3dev::words::words;

use super::typed::{TypedSensor, sensor_modes};

words! {
    /// The ultrasonic sensor's modes.
    UltrasonicMode {
        /// Measures all the time, in tenths of a centimetre.
        DistCm = "US-DIST-CM",
        /// Measures all the time, in tenths of an inch.
        DistIn = "US-DIST-IN",
        /// Sends nothing and hears whether another one does.
        Listen = "US-LISTEN",
        /// Measures once for each [`UltrasonicSensor::ping`], in tenths of a centimetre.
        SingleCm = "US-SI-CM",
        /// Measures once for each [`UltrasonicSensor::ping`], in tenths of an inch.
        SingleIn = "US-SI-IN",
        /// Like [`UltrasonicMode::DistCm`].
        DcCm = "US-DC-CM",
        /// Like [`UltrasonicMode::DistIn`].
        DcIn = "US-DC-IN",
    }
}

sensor_modes!(UltrasonicMode, Ultrasonic);

/// The ultrasonic sensor, `lego-ev3-us`.
pub type UltrasonicSensor = TypedSensor<UltrasonicMode>;

/// The shortest time between two pings: more often, and the sensor can lock up.
pub const MIN_PING_INTERVAL_NS: i64 = 250 * MILLISECOND_NS;

/// No echo, in tenths of a centimetre.
const NO_ECHO_TENTHS_CM: i32 = 2550;

/// No echo, in tenths of an inch.
const NO_ECHO_TENTHS_IN: i32 = 1003;

impl UltrasonicSensor {
    /// Distance to what reflects, metres from the sensor, in steps of a millimetre or a tenth of an
    /// inch; `None` if there is no echo. Any mode but [`UltrasonicMode::Listen`].
    ///
    /// # Errors
    ///
    /// [`Cause::Refused`](crate::ev3dev::Cause::Refused) while it listens;
    /// [`Cause::Malformed`](crate::ev3dev::Cause::Malformed) beyond what the sensor can say.
    pub fn distance_m(&self) -> Result<Option<f64>, DeviceError> {
        use UltrasonicMode::{DcCm, DcIn, DistCm, DistIn, SingleCm, SingleIn};
        const WORDS: &[&str] =
            &["US-DIST-CM", "US-DIST-IN", "US-SI-CM", "US-SI-IN", "US-DC-CM", "US-DC-IN"];
        let (no_echo, tenth_m) = match self.mode() {
            Some(DistCm | SingleCm | DcCm) => (NO_ECHO_TENTHS_CM, 0.001),
            Some(DistIn | SingleIn | DcIn) => (NO_ECHO_TENTHS_IN, 0.00254),
            _ => return Err(self.wrong_mode(WORDS)),
        };
        let tenths = self.sensor().first_value_within(0, no_echo)?;
        Ok((tenths < no_echo).then(|| f64::from(tenths) * tenth_m))
    }

    /// Whether another ultrasonic source is heard. Mode [`UltrasonicMode::Listen`].
    ///
    /// # Errors
    ///
    /// As [`UltrasonicSensor::distance_m`].
    pub fn hears_another(&self) -> Result<bool, DeviceError> {
        Ok(self.first_in(UltrasonicMode::Listen, 0, 1)? == 1)
    }

    /// Makes a single-shot mode measure once. Leave [`MIN_PING_INTERVAL_NS`] between two.
    ///
    /// # Errors
    ///
    /// [`Cause::Refused`](crate::ev3dev::Cause::Refused) in any other mode; what writing a mode
    /// gives.
    pub fn ping(&mut self) -> Result<(), DeviceError> {
        match self.mode() {
            Some(UltrasonicMode::SingleCm | UltrasonicMode::SingleIn) => {
                self.sensor_mut().rewrite_mode()
            }
            _ => Err(self.wrong_mode(&["US-SI-CM", "US-SI-IN"])),
        }
    }
}
