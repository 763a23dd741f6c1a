//! What a motor says about itself.

use std::fmt::{self, Write};

use crate::ev3dev::value::{AttributeText, Legal, Value};

/// A set of the flags in a motor's `state`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MotorState(u8);

const FLAGS: &[&str] = &["running", "ramping", "holding", "overloaded", "stalled"];

impl MotorState {
    /// A run command is in effect. Wait for this to vanish, not for the others.
    #[must_use]
    pub const fn is_running(self) -> bool {
        self.has(0)
    }

    /// A ramp is in effect. The driver sometimes forgets to clear it.
    #[must_use]
    pub const fn is_ramping(self) -> bool {
        self.has(1)
    }

    /// The position is being held. On an EV3 a motor that holds is not running.
    #[must_use]
    pub const fn is_holding(self) -> bool {
        self.has(2)
    }

    /// The regulator wants more than it can have; normal while a motor speeds up.
    #[must_use]
    pub const fn is_overloaded(self) -> bool {
        self.has(3)
    }

    /// Running, and not turning for 100 ms. The driver does nothing about it.
    #[must_use]
    pub const fn is_stalled(self) -> bool {
        self.has(4)
    }

    /// It is to turn: a run command is in effect, and has not come to holding the position, which
    /// BrickPi3 and PiStorms call running as well.
    #[must_use]
    pub const fn is_driven(self) -> bool {
        self.is_running() && !self.is_holding()
    }

    const fn has(self, place: u8) -> bool {
        self.0 & (1 << place) != 0
    }

    /// The flags that are set, in the kernel's order.
    pub fn iter(self) -> impl Iterator<Item = &'static str> {
        FLAGS.iter().zip(0..).filter(move |(_, place)| self.has(*place)).map(|(flag, _)| *flag)
    }
}

impl fmt::Display for MotorState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.iter().collect::<Vec<_>>().join(" "))
    }
}

impl Value for MotorState {
    const LEGAL: Legal = Legal::Flags(FLAGS);

    fn parse(text: &[u8]) -> Option<Self> {
        let words = text.split(|&byte| byte == b' ').filter(|word| !word.is_empty());
        words.map(flag).try_fold(0, |set, flag| Some(set | flag?)).map(Self)
    }

    fn render(&self, line: &mut AttributeText) -> fmt::Result {
        write!(line, "{self}")
    }
}

fn flag(word: &[u8]) -> Option<u8> {
    FLAGS.iter().zip(0..).find(|(flag, _)| flag.as_bytes() == word).map(|(_, place)| 1 << place)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_set_of_flags_reads_back_as_it_was_written() {
        for bits in 0..32 {
            let state = MotorState(bits);
            assert_eq!(MotorState::parse(state.to_string().as_bytes()), Some(state), "`{state}`");
        }
    }

    #[test]
    fn the_kernels_texts_are_understood_and_others_are_not() {
        assert_eq!(MotorState::parse(b""), Some(MotorState::default()));
        let state = MotorState::parse(b"running overloaded stalled").unwrap();
        assert!(state.is_running() && state.is_overloaded() && state.is_stalled());
        assert!(!state.is_ramping() && !state.is_holding());
        assert_eq!(MotorState::parse(b"running fast"), None);
        assert_eq!(MotorState::parse(b"Running"), None);
    }
}
