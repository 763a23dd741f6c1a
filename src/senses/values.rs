//! What a quantity's values are called, where it is one of several things: a colour, a button.

use super::{Channel, Quantity};
use crate::ev3dev::{Colour, RemoteCode};

/// How many of the remote's codes have names in conditions: all but the last two, which are both
/// buttons of one column.
const REMOTE_NAMES: usize = 10;

impl Quantity {
    /// The names of its values in conditions, where it is one of several things: `colour == red`.
    pub fn values(&self) -> impl Iterator<Item = (&'static str, f64)> + Clone {
        let (words, most) = match self.channel {
            Channel::Colour => (Colour::WORDS, Colour::WORDS.len()),
            Channel::Remote => (RemoteCode::WORDS, REMOTE_NAMES),
            _ => (&[][..], 0),
        };
        words.iter().take(most).zip(0_u8..).map(|(word, value)| (*word, f64::from(value)))
    }
}
