//! Lights: any LED, and the brick's status lights, of an EV3 two of a red and a green LED each.

use std::sync::Arc;

use super::error::{Cause, DeviceError};
use super::node::{Attribute, AttributeSpec, Node, attributes};
use super::platform::{Hue, Lamp, Platform};
use super::stream::not_built_in;
use super::tree::Tree;
use super::value::{Legal, Value, Words};
use super::words::words;

/// One LED.
#[derive(Debug)]
pub struct Led {
    node: Node,
    files: LedFiles,
    max_brightness: i32,
}

attributes! {
    /// The class's attributes.
    LedFiles of [impl Led] {
        /// Brightness, 0 to [`Led::max_brightness`].
        pub readwriteable "brightness" => brightness / set_brightness: i32, Legal::Range(0, 255);
        /// The highest brightness, read each time.
        pub readable "max_brightness" => read_max_brightness: i32;
        readwriteable "trigger" => triggers / write_trigger: Words;
        /// Time on, ms. The file is there only under the trigger `timer`.
        pub readwriteable "delay_on" => delay_on / set_delay_on: i32, Legal::NOT_NEGATIVE;
        /// Time off, ms. The file is there only under the trigger `timer`.
        pub readwriteable "delay_off" => delay_off / set_delay_off: i32, Legal::NOT_NEGATIVE;
    }
}

impl Led {
    /// The LED of this name in `sys/class/leds`: `led0:red:brick-status`;
    /// `ev3-ports:outA::brick-status` for a lamp on a port.
    ///
    /// # Errors
    ///
    /// [`Cause::Gone`] where there is none; what reading its highest brightness gives.
    pub fn named(tree: &Arc<dyn Tree>, name: &str) -> Result<Self, DeviceError> {
        let node = Node::new(tree, &format!("sys/class/leds/{name}"), None);
        let files = LedFiles::new();
        let max_brightness = files.read_max_brightness.read(&node)?;
        files.brightness.limit(0, max_brightness.into());
        Ok(Self { node, files, max_brightness })
    }

    /// The highest brightness.
    #[must_use]
    pub fn max_brightness(&self) -> i32 {
        self.max_brightness
    }

    /// What switches the LED; `none` if only [`Led::set_brightness`] does.
    ///
    /// # Errors
    ///
    /// [`Cause::Malformed`] if the driver marks none as active.
    pub fn trigger(&self) -> Result<String, DeviceError> {
        let triggers = self.triggers()?;
        let active = triggers.iter().find_map(|word| word.strip_prefix('[')?.strip_suffix(']'));
        let malformed = || {
            self.node.error("trigger", Some(triggers.0.as_bytes()), Cause::Malformed(Legal::Text))
        };
        active.map(str::to_owned).ok_or_else(malformed)
    }

    /// Sets what switches the LED.
    ///
    /// # Errors
    ///
    /// [`Cause::Refused`] for a trigger that the kernel does not have.
    pub fn set_trigger(&self, trigger: &str) -> Result<(), DeviceError> {
        let triggers = self.triggers()?;
        if !triggers.iter().any(|word| word.trim_matches(['[', ']']) == trigger) {
            return Err(self.node.refusal("trigger", trigger, triggers.as_legal()));
        }
        self.write_trigger(Words(trigger.into()))
    }
}

words! {
    /// A colour of a status light.
    LightColour {
        /// Dark.
        Off = "off",
        /// Green.
        Green = "green",
        /// Red.
        Red = "red",
        /// Both, fully.
        Amber = "amber",
        /// Red, with some green.
        Orange = "orange",
        /// Green, with a little red.
        Yellow = "yellow",
    }
}

impl LightColour {
    /// Red and green, of 255: the mixes that other bindings use as well.
    #[must_use]
    pub const fn mix(self) -> (i32, i32) {
        match self {
            Self::Off => (0, 0),
            Self::Green => (0, 255),
            Self::Red => (255, 0),
            Self::Amber => (255, 255),
            Self::Orange => (255, 128),
            Self::Yellow => (25, 255),
        }
    }
}

/// A status light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Left of the buttons.
    Left,
    /// Right of them.
    Right,
}

/// The brick's status lights, left and right; a board may have one, and other colours.
#[derive(Debug)]
pub struct StatusLights {
    sides: [Vec<(Hue, Led)>; 2],
}

impl StatusLights {
    /// The lights of a board.
    ///
    /// # Errors
    ///
    /// [`Cause::Gone`] where there are none.
    pub fn open(tree: &Arc<dyn Tree>, platform: &Platform) -> Result<Self, DeviceError> {
        if platform.lights.iter().all(|lamps| lamps.is_empty()) {
            return Err(not_built_in(tree, "lights"));
        }
        let light = |lamps: &[Lamp]| -> Result<Vec<_>, DeviceError> {
            lamps.iter().map(|lamp| Ok((lamp.hue, Led::named(tree, lamp.led)?))).collect()
        };
        let [left, right] = platform.lights;
        Ok(Self { sides: [light(left)?, light(right)?] })
    }

    fn leds(&self) -> impl Iterator<Item = &Led> {
        self.sides.iter().flatten().map(|(_, led)| led)
    }

    /// Whether the lights could be switched; nothing is.
    ///
    /// # Errors
    ///
    /// [`Cause::Other`] with EACCES for a user who is not in the group `ev3dev`.
    pub fn check_writable(&self) -> Result<(), DeviceError> {
        self.leds().try_for_each(|led| led.files.brightness.open_for_writing(&led.node))
    }

    /// Takes the lights from whatever else switches them: brickman lets them blink while a program
    /// runs.
    ///
    /// # Errors
    ///
    /// What writing gives.
    pub fn take(&self) -> Result<(), DeviceError> {
        for led in self.leds() {
            if led.trigger()? != "none" {
                led.set_trigger("none")?;
            }
        }
        Ok(())
    }

    /// Sets a light's colour: a write an LED. On kernels of the EV3 before 2.3.0 every mix is full
    /// on; a light of one LED shines in any colour.
    ///
    /// # Errors
    ///
    /// What writing gives.
    pub fn set(&self, side: Side, colour: LightColour) -> Result<(), DeviceError> {
        let (red, green) = colour.mix();
        for (hue, led) in &self.sides[side as usize] {
            let part = match hue {
                Hue::Red => red,
                Hue::Green => green,
                Hue::Blue => 0,
                Hue::Only => red.max(green),
            };
            led.set_brightness(scaled(part, led.max_brightness()))?;
        }
        Ok(())
    }

    /// Sets both lights' colour.
    ///
    /// # Errors
    ///
    /// What writing gives.
    pub fn set_both(&self, colour: LightColour) -> Result<(), DeviceError> {
        self.set(Side::Left, colour)?;
        self.set(Side::Right, colour)
    }
}

/// A part of 255 as a part of `max`, rounded up, so that a little light stays a little light.
fn scaled(part: i32, max: i32) -> i32 {
    let scaled = (i64::from(part) * i64::from(max) + 254) / 255;
    i32::try_from(scaled).unwrap_or(max)
}
