//! The faults that a port can have, and their text.

use std::fmt;

use super::{FaultError, Port};
use crate::clock::{MILLISECOND_NS, SECOND_NS, seconds};
use crate::sim::brick::Plugged;
use crate::sim::driver::sensor::model;
use crate::sim::physics::MotorKind;

/// What is wrong with the device on a port. The text form is what [`fmt::Display`] writes.
///
/// "Counts" are the integers that a driver gives: a motor's position, a sensor's `value0` without
/// its decimals.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum DeviceFault {
    /// `unplug`: the device is pulled. It is plugged in again at the fault's end.
    Unplug,
    /// `plug`: what was pulled is put back. It comes with a new number and its defaults.
    Plug,
    /// `off`: no power. A motor coasts and is still counted. A sensor sends nothing: values stand
    /// still and a change of mode ends in ETIMEDOUT, until its driver misses it after 0.7 s; then
    /// as `resync`.
    Off,
    /// `stuck`: what is measured stays as it is.
    Stuck,
    /// `garbage`: random numbers, new ones with each frame of a sensor and each 2 ms of a motor.
    Garbage,
    /// `garbage text`: random bytes where numbers should stand.
    GarbageText,
    /// `wrong [SCALE [OFFSET]]`: plausible, but multiplied and shifted. A motor's counts are scaled
    /// from where they are when it begins; a touch sensor is inverted, also by `jump`.
    Wrong {
        /// Factor.
        scale: f64,
        /// Counts, added after scaling.
        offset: i32,
    },
    /// `slow [TIMES]`: new values come this many times more seldom. A motor is counted each 2 ms
    /// times this.
    Slow {
        /// How many times the usual period.
        times: u32,
    },
    /// `delayed [MS]`: values come late.
    Delayed {
        /// By so much, nanoseconds.
        delay_ns: i64,
    },
    /// `intermittent [SHARE]`: ENXIO for moments of 20 to 400 ms, at random.
    Intermittent {
        /// Share of the time that it is away.
        share: f64,
    },
    /// `jump [COUNTS]`: from now on, everything is so much more.
    Jump {
        /// Counts.
        by: i32,
    },
    /// `enxio`: measurements and all writes answer ENXIO.
    Enxio,
    /// `eio`: measurements and all writes answer EIO.
    Eio,
    /// `denied`: files cannot be opened for writing (EACCES), as before udev has been there.
    Denied,
    /// `block`: the motor's shaft does not turn.
    Block,
    /// `endless`: the kernel's timer does not end a `run-timed`.
    Endless,
    /// `resync`: the serial line is lost and the sensor describes itself again: values answer
    /// ENXIO, a write of `mode` ENODEV.
    Resync,
    /// `stale [MS]`: after a change of mode, what the new mode measured when it was last used stays
    /// for at least this long; zeros if it never was.
    Stale {
        /// Nanoseconds.
        for_ns: i64,
    },
    /// `write ATTRIBUTE VALUE`: another program writes. `reset` is `write command reset`.
    Write {
        /// The attribute.
        attribute: String,
        /// What is written.
        value: String,
    },
}

/// The word of each fault but `write`, and the fault with the numbers that its word alone means.
pub(super) static USUAL: [(&str, DeviceFault); 18] = [
    ("unplug", DeviceFault::Unplug),
    ("plug", DeviceFault::Plug),
    ("off", DeviceFault::Off),
    ("stuck", DeviceFault::Stuck),
    ("garbage", DeviceFault::Garbage),
    ("garbage text", DeviceFault::GarbageText),
    ("wrong", DeviceFault::Wrong { scale: 1.25, offset: 0 }),
    ("slow", DeviceFault::Slow { times: 10 }),
    ("delayed", DeviceFault::Delayed { delay_ns: 200 * MILLISECOND_NS }),
    ("intermittent", DeviceFault::Intermittent { share: 0.3 }),
    ("jump", DeviceFault::Jump { by: 90 }),
    ("enxio", DeviceFault::Enxio),
    ("eio", DeviceFault::Eio),
    ("denied", DeviceFault::Denied),
    ("block", DeviceFault::Block),
    ("endless", DeviceFault::Endless),
    ("resync", DeviceFault::Resync),
    ("stale", DeviceFault::Stale { for_ns: 2 * SECOND_NS }),
];

impl DeviceFault {
    /// The words that a fault's text can begin with.
    pub fn words() -> impl Iterator<Item = &'static str> + Clone {
        let words = USUAL.iter().map(|(word, _)| *word).filter(|word| !word.contains(' '));
        words.chain(["write", "reset"])
    }

    /// `reset`: another program's.
    pub(super) fn reset() -> Self {
        Self::Write { attribute: "command".to_owned(), value: "reset".to_owned() }
    }

    /// Each fault once, with the numbers that a text without numbers means.
    #[must_use]
    pub fn examples() -> Vec<Self> {
        USUAL.iter().map(|(_, fault)| fault.clone()).chain([Self::reset()]).collect()
    }

    /// True where the fault is over as soon as it is done.
    #[must_use]
    pub fn is_momentary(&self) -> bool {
        matches!(self, Self::Plug | Self::Write { .. })
    }

    /// Says whether a port can have the fault; `home` is what belongs into the port.
    pub(crate) fn fit(&self, port: Port, home: Option<Plugged>) -> Result<(), FaultError> {
        let of_signal = matches!(
            self,
            Self::Stuck
                | Self::Garbage
                | Self::GarbageText
                | Self::Wrong { .. }
                | Self::Slow { .. }
                | Self::Delayed { .. }
                | Self::Jump { .. }
        );
        let of_line = matches!(self, Self::Resync | Self::Stale { .. });
        let why = match home {
            _ if of_line && port.is_output() => "it has no serial line",
            _ if matches!(self, Self::Block | Self::Endless) && !port.is_output() => {
                "nothing turns there"
            }
            Some(Plugged::Sensor(kind)) if of_line && !model(kind).uart => {
                "a touch sensor has no serial line"
            }
            Some(Plugged::Motor(MotorKind::Rcx)) if of_signal => "the motor has no encoder",
            None => "the port has no device of its own",
            _ => return Ok(()),
        };
        Err(FaultError::Unfit { port, fault: self.clone(), why })
    }

    /// Two faults of the same kind on one port replace each other.
    pub(crate) fn replaces(&self, other: &Self) -> bool {
        std::mem::discriminant(self) == std::mem::discriminant(other)
    }
}

impl fmt::Display for DeviceFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let milliseconds = |ns: i64| seconds(ns.saturating_mul(SECOND_NS / MILLISECOND_NS));
        let word =
            USUAL.iter().find(|(_, usual)| usual.replaces(self)).map_or("write", |(word, _)| word);
        match self {
            Self::Wrong { scale, offset } => write!(f, "{word} {scale} {offset}"),
            Self::Slow { times } => write!(f, "{word} {times}"),
            Self::Delayed { delay_ns: ns } | Self::Stale { for_ns: ns } => {
                write!(f, "{word} {}", milliseconds(*ns))
            }
            Self::Intermittent { share } => write!(f, "{word} {share}"),
            Self::Jump { by } => write!(f, "{word} {by}"),
            _ if *self == Self::reset() => f.write_str("reset"),
            Self::Write { attribute, value } => write!(f, "{word} {attribute} {value}"),
            _ => f.write_str(word),
        }
    }
}
