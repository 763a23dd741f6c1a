//! What a mission's machines want of the actuators in one tick.
//!
//! Speeds and angles are in radians and metres. `None` demands nothing: a motor without a demand
//! does not turn, and its lease is not renewed; a light and a text stay as they are; a tone ends.
//!
//! # Not here
//!
//! No limits and no leases: the `robot` layer turns demands into motions.

use arrayvec::ArrayString;

use super::MAX_MOTORS;
use crate::ev3dev::{LightColour, StopAction};

/// The longest text that `say` shows, in bytes: four lines across the brick's screen in its small
/// font, with room for letters of two bytes.
pub const SAY_BYTES: usize = 128;

/// The most lines of it.
pub const SAY_LINES: usize = 4;

/// What the machines want in one tick.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Demands {
    /// What the two wheels do.
    pub drive: Option<Drive>,
    /// Where the head points, radians anticlockwise from straight ahead.
    pub head_rad: Option<f64>,
    /// How fast the head turns there, radians per second; without it, as fast as its robot says.
    pub head_rad_s: Option<f64>,
    /// Speeds of the named motors at their axles, radians per second, in the order of the
    /// capabilities.
    pub motors: [Option<f64>; MAX_MOTORS],
    /// The colour of the brick's lights.
    pub led: Option<LightColour>,
    /// A tone, in hertz.
    pub tone_hz: Option<f64>,
    /// A text for people, of one line or more.
    pub say: Option<ArrayString<SAY_BYTES>>,
}

impl Demands {
    /// Nothing moves; all else is as nothing were wanted.
    pub(crate) fn still() -> Self {
        Self { drive: Some(Drive::STILL), ..Self::default() }
    }
}

/// How fast what is turned to an angle turns for each radian that is missing, per second: it slows
/// down on the last stretch instead of swinging over.
const GAIN_PER_S: f64 = 10.0;

/// The speed that takes an axle to an angle, radians per second: 0 where less than `near_rad` is
/// missing, and at most `most_rad_s`.
pub(crate) fn towards(missing_rad: f64, near_rad: f64, most_rad_s: f64) -> f64 {
    let rad_s = (missing_rad * GAIN_PER_S).clamp(-most_rad_s, most_rad_s);
    if missing_rad.abs() < near_rad { 0.0 } else { rad_s }
}

/// What the two wheels do. Every number is finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Drive {
    /// Each wheel at a speed of its own, at its axle.
    Wheels {
        /// Radians per second, forwards positive.
        left_rad_s: f64,
        /// Radians per second, forwards positive.
        right_rad_s: f64,
    },
    /// The robot's centre along and round.
    Twist {
        /// Metres per second, forwards positive.
        forward_m_s: f64,
        /// Radians per second, anticlockwise positive.
        turn_rad_s: f64,
    },
    /// Both wheels stop, in this way.
    Stop(StopAction),
}

impl Drive {
    /// The wheels stop, and resist being turned.
    pub(crate) const STILL: Self = Self::Stop(StopAction::Brake);
}
