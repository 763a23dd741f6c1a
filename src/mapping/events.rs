//! What the estimator noticed, as a set of flags.

use std::fmt;
use std::ops::{BitOr, BitOrAssign};

use serde::{Deserialize, Serialize};

/// A set of things noticed in one update. The bits never change their meaning: they are in
/// recordings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Events(u16);

impl Events {
    /// Nothing.
    pub const NONE: Self = Self(0);
    /// The wheels turn the robot less or more than the gyro says: they slip. Set in every update
    /// while it lasts.
    pub const SLIP: Self = Self(1);
    /// The gyro's angle jumped in a way that no motion explains, as after a reset; the heading went
    /// on by the encoders.
    pub const GYRO_RESET: Self = Self(1 << 1);
    /// The gyro is beyond what it can measure: ±440 °/s, or the end of its 16 bits. Set while it
    /// lasts.
    pub const GYRO_SATURATED: Self = Self(1 << 2);
    /// A wheel was not read in this tick. Its way is made up for when it is read again.
    pub const WHEELS_LOST: Self = Self(1 << 3);
    /// The gyro was there and was not read in this tick; the heading is the encoders'.
    pub const GYRO_LOST: Self = Self(1 << 4);
    /// A wheel's angle changed faster than a wheel can turn; the change was left out.
    pub const WHEEL_JUMP: Self = Self(1 << 5);
    /// A reading was not finite or beyond what its sensor can say, and was left out.
    pub const INPUT_REFUSED: Self = Self(1 << 6);
    /// Both wheels have stood still for a while.
    pub const STILL: Self = Self(1 << 7);
    /// The update's time was earlier than that of the one before.
    pub const TIME_BACKWARDS: Self = Self(1 << 8);
    /// A spin has told the gyro's scale, and the pose was corrected by it.
    pub const WHOLE_TURN: Self = Self(1 << 9);

    /// Every flag with its name.
    pub const ALL: [(Self, &'static str); 10] = [
        (Self::SLIP, "slip"),
        (Self::GYRO_RESET, "gyro_reset"),
        (Self::GYRO_SATURATED, "gyro_saturated"),
        (Self::WHEELS_LOST, "wheels_lost"),
        (Self::GYRO_LOST, "gyro_lost"),
        (Self::WHEEL_JUMP, "wheel_jump"),
        (Self::INPUT_REFUSED, "input_refused"),
        (Self::STILL, "still"),
        (Self::TIME_BACKWARDS, "time_backwards"),
        (Self::WHOLE_TURN, "whole_turn"),
    ];

    /// The flags as bits, for a recording.
    #[must_use]
    pub fn bits(self) -> u16 {
        self.0
    }

    /// The flags of a recording; bits without a meaning are kept.
    #[must_use]
    pub fn from_bits(bits: u16) -> Self {
        Self(bits)
    }

    /// Whether all of `other` is in this set.
    #[must_use]
    pub fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Whether nothing is in it.
    #[must_use]
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// What is in this set and not in `other`: with the update before, what is new.
    #[must_use]
    pub fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// This set if `holds`, else nothing.
    #[must_use]
    pub(super) fn when(self, holds: bool) -> Self {
        if holds { self } else { Self::NONE }
    }
}

impl BitOr for Events {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl BitOrAssign for Events {
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}

impl fmt::Display for Events {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut separator = "";
        for (event, name) in Self::ALL {
            if self.contains(event) {
                write!(f, "{separator}{name}")?;
                separator = " ";
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_are_shown_by_name_and_survive_as_bits() {
        let seen = Events::SLIP | Events::WHEEL_JUMP;
        assert_eq!(seen.to_string(), "slip wheel_jump");
        assert_eq!(Events::from_bits(seen.bits()), seen);
        assert_eq!(seen.without(Events::SLIP), Events::WHEEL_JUMP);
        assert!(Events::NONE.is_empty() && Events::NONE.to_string().is_empty());
    }

    #[test]
    fn every_flag_has_a_bit_of_its_own() {
        let all = Events::ALL.iter().fold(Events::NONE, |all, (event, _)| all | *event);
        assert_eq!(all.bits().count_ones() as usize, Events::ALL.len());
    }
}
