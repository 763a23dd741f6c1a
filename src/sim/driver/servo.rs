//! A hobby servo: class `servo-motor` (`servo_motor_class.c`), on a third-party controller.
//!
//! Nothing moves here: the position is what was asked for.

use nix::errno::Errno;

use super::text::{int, known, scan_signed, scan_unsigned, within};
use super::{Attributes, Context, Driver, Took, line, list};
use crate::ev3dev::{self, Polarity, ServoCommand};

/// One output of a servo controller.
#[derive(Debug)]
pub(crate) struct ServoMotor {
    min_pulse_us: i32,
    mid_pulse_us: i32,
    max_pulse_us: i32,
    inversed: bool,
    position_pct: i32,
    rate_ms: Option<u32>,
    runs: bool,
}

impl ServoMotor {
    /// As after plugging in a controller; `has_rate` if it can limit the speed.
    pub(crate) fn new(has_rate: bool) -> Self {
        Self {
            min_pulse_us: 500,
            mid_pulse_us: 1500,
            max_pulse_us: 2500,
            inversed: false,
            position_pct: 0,
            rate_ms: has_rate.then_some(0),
            runs: false,
        }
    }

    /// The pulse that the controller sends, in microseconds; none while it floats.
    pub(crate) fn pulse_us(&self) -> Option<i32> {
        let position = if self.inversed { -self.position_pct } else { self.position_pct };
        let end = if position < 0 { self.min_pulse_us } else { self.max_pulse_us };
        let span = if position < 0 { self.mid_pulse_us - end } else { end - self.mid_pulse_us };
        self.runs.then_some(self.mid_pulse_us + span * position / 100)
    }
}

impl Driver for ServoMotor {
    fn attributes(&self) -> Attributes {
        [ev3dev::ServoMotor::ATTRIBUTES, &[]]
    }

    fn read(&self, attribute: &str, out: &mut Vec<u8>) -> Result<(), Errno> {
        match attribute {
            "min_pulse_sp" => line(out, self.min_pulse_us),
            "mid_pulse_sp" => line(out, self.mid_pulse_us),
            "max_pulse_sp" => line(out, self.max_pulse_us),
            "polarity" => list(out, Polarity::WORDS.get(usize::from(self.inversed)).copied()),
            "position_sp" => line(out, self.position_pct),
            "rate_sp" => line(out, self.rate_ms.ok_or(Errno::EOPNOTSUPP)?),
            "state" => list(out, self.runs.then_some("running")),
            _ => return Err(Errno::ENODEV),
        }
        Ok(())
    }

    fn store(&mut self, attribute: &str, bytes: &[u8], _context: &mut Context<'_>) -> Took {
        match attribute {
            "command" => self.runs = known::<ServoCommand>(bytes)? == ServoCommand::Run,
            "min_pulse_sp" => self.min_pulse_us = within(scan_signed(bytes)?, 0..=1000)?,
            "mid_pulse_sp" => self.mid_pulse_us = within(scan_signed(bytes)?, 1000..=2000)?,
            "max_pulse_sp" => self.max_pulse_us = within(scan_signed(bytes)?, 2000..=3000)?,
            "polarity" => self.inversed = known::<Polarity>(bytes)? == Polarity::Inversed,
            "position_sp" => self.position_pct = within(int(bytes)?, -100..=100)?,
            "rate_sp" => *self.rate_ms.as_mut().ok_or(Errno::EOPNOTSUPP)? = scan_unsigned(bytes)?,
            _ => return Err(Errno::EIO),
        }
        Ok(None)
    }
}
