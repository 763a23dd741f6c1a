//! A status light: class `leds`.

use nix::errno::Errno;

use super::text::{unsigned, word};
use super::{Attributes, Context, Driver, Took, line, list};
use crate::ev3dev::{self, AttributeSpec};

/// The triggers of a real brick's kernel.
const TRIGGERS: [&str; 24] = [
    "none",
    "rfkill-any",
    "kbd-scrolllock",
    "kbd-numlock",
    "kbd-capslock",
    "kbd-kanalock",
    "kbd-shiftlock",
    "kbd-altgrlock",
    "kbd-ctrllock",
    "kbd-altlock",
    "kbd-shiftllock",
    "kbd-shiftrlock",
    "kbd-ctrlllock",
    "kbd-ctrlrlock",
    "mmc0",
    "timer",
    "heartbeat",
    "default-on",
    "transient",
    "lego-ev3-battery-charging-or-full",
    "lego-ev3-battery-charging",
    "lego-ev3-battery-full",
    "lego-ev3-battery-charging-blink-full-solid",
    "rfkill0",
];
const NONE: usize = 0;
const TIMER: usize = 15;
const DEFAULT_ON: usize = 17;

/// One light.
#[derive(Debug)]
pub(crate) struct Led {
    /// How bright it is, while it is on.
    pub(crate) brightness: u32,
    max_brightness: u32,
    trigger: usize,
    delay_on_ms: u32,
    delay_off_ms: u32,
}

impl Led {
    /// A light without a trigger.
    pub(crate) fn new(brightness: u32, max_brightness: u32) -> Self {
        Self { brightness, max_brightness, trigger: NONE, delay_on_ms: 500, delay_off_ms: 500 }
    }

    /// What else makes it shine: `none`, `timer`, `heartbeat`, …
    pub(crate) fn trigger(&self) -> &'static str {
        TRIGGERS.get(self.trigger).copied().unwrap_or_default()
    }

    fn set_trigger(&mut self, trigger: usize) {
        self.trigger = trigger;
        match trigger {
            NONE => self.brightness = 0,
            DEFAULT_ON => self.brightness = self.max_brightness,
            TIMER => (self.delay_on_ms, self.delay_off_ms) = (500, 500),
            _ => {}
        }
    }
}

impl Driver for Led {
    fn attributes(&self) -> Attributes {
        // The times, which only that trigger has, are the last rows.
        let is_there =
            |spec: &AttributeSpec| self.trigger == TIMER || !spec.name.starts_with("delay_");
        let (there, _) =
            ev3dev::Led::ATTRIBUTES.split_at(ev3dev::Led::ATTRIBUTES.partition_point(is_there));
        [there, &[]]
    }

    fn read(&self, attribute: &str, out: &mut Vec<u8>) -> Result<(), Errno> {
        match attribute {
            "brightness" => line(out, self.brightness),
            "max_brightness" => line(out, self.max_brightness),
            "trigger" => {
                let active = format!("[{}]", self.trigger());
                let words = TRIGGERS.iter().enumerate();
                list(
                    out,
                    words.map(|(index, word)| if index == self.trigger { &active } else { *word }),
                );
            }
            "delay_on" if self.trigger == TIMER => line(out, self.delay_on_ms),
            "delay_off" if self.trigger == TIMER => line(out, self.delay_off_ms),
            _ => return Err(Errno::ENODEV),
        }
        Ok(())
    }

    fn store(&mut self, attribute: &str, bytes: &[u8], _context: &mut Context<'_>) -> Took {
        match attribute {
            "brightness" => {
                let value = unsigned(bytes)?;
                if value == 0 {
                    self.trigger = NONE;
                }
                self.brightness = value.min(self.max_brightness);
            }
            "trigger" => {
                let trigger = word(bytes, TRIGGERS)?;
                self.set_trigger(trigger);
            }
            "delay_on" if self.trigger == TIMER => self.delay_on_ms = unsigned(bytes)?,
            "delay_off" if self.trigger == TIMER => self.delay_off_ms = unsigned(bytes)?,
            _ => return Err(Errno::ENODEV),
        }
        Ok(None)
    }
}
