//! What stops a run beside the board's own buttons: a touch sensor, or a button on a GPIO.

use std::sync::Arc;

use super::bind::BindError;
use super::config::StopButton;
use crate::ev3dev::{Buttons, DeviceError, TouchSensor, Tree};

/// Opens a stop button and looks at it once.
///
/// # Errors
///
/// [`BindError`]: it is not there, or cannot be read.
pub fn stop_button_answers(tree: &Arc<dyn Tree>, button: &StopButton) -> Result<(), BindError> {
    StopSwitch::open(tree, button)?
        .is_pressed()
        .map(drop)
        .map_err(|source| BindError::Device { role: "stop_button".to_owned(), source })
}

/// A stop button that is looked at.
#[derive(Debug)]
pub(super) enum StopSwitch {
    Touch(Box<TouchSensor>),
    Keys(Box<Buttons>),
}

impl StopSwitch {
    /// Opens it; a board that does not find out what is plugged in has been told before.
    pub(super) fn open(tree: &Arc<dyn Tree>, button: &StopButton) -> Result<Self, BindError> {
        let role = || "stop_button".to_owned();
        match button {
            StopButton::Touch(port) => TouchSensor::at(tree, port)
                .map(|sensor| Self::Touch(Box::new(sensor)))
                .map_err(|source| BindError::Find { role: role(), source }),
            StopButton::Device(device) => {
                let device = device.to_string_lossy();
                Buttons::open_at(tree, device.trim_start_matches('/'))
                    .map(|buttons| Self::Keys(Box::new(buttons)))
                    .map_err(|source| BindError::Device { role: role(), source })
            }
        }
    }

    /// Whether it asks to stop.
    pub(super) fn is_pressed(&mut self) -> Result<bool, DeviceError> {
        match self {
            Self::Touch(sensor) => sensor.is_pressed(),
            Self::Keys(buttons) => buttons.changes().map(|changes| changes.pressed.stops()),
        }
    }
}
