//! The touch sensor. Its driver looks 100 times a second and does not debounce beyond that.

use std::time::Duration;

use crate::ev3dev::error::DeviceError;
use crate::ev3dev::words::words;

use super::typed::{TypedSensor, sensor_modes};

words! {
    /// The touch sensor's mode.
    TouchMode {
        /// Pressed or not.
        Touch = "TOUCH",
    }
}

sensor_modes!(TouchMode, Touch);

/// The touch sensor, `lego-ev3-touch`.
pub type TouchSensor = TypedSensor<TouchMode>;

impl TouchSensor {
    /// Whether it is pressed.
    ///
    /// # Errors
    ///
    /// [`Cause::Malformed`](crate::ev3dev::Cause::Malformed) for anything but 0 and 1; what reading
    /// gives.
    pub fn is_pressed(&self) -> Result<bool, DeviceError> {
        Ok(self.first_in(TouchMode::Touch, 0, 1)? == 1)
    }

    /// The voltage at the sensor's pin, volts; pressed is above 0.25 V.
    ///
    /// # Errors
    ///
    /// What reading gives.
    pub fn pin_v(&self) -> Result<f64, DeviceError> {
        self.frame_in(TouchMode::Touch, |frame| {
            frame.values().first().map(|millivolts| millivolts / 1000.0)
        })
    }

    /// Waits until it is pressed or let go, or until `timeout`; true if it was.
    ///
    /// # Errors
    ///
    /// What `poll` answers.
    pub fn wait_changed(&self, timeout: Duration) -> Result<bool, DeviceError> {
        self.sensor().wait_changed(timeout)
    }
}
