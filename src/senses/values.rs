//! What a quantity's values are called, where it is one of several things: a colour, a button.

use super::{Channel, Quantity};

/// What nothing is called, of all that has names: no colour, no button.
const NONE: (&str, f64) = ("none", 0.0);

/// The colours that the colour sensor tells apart.
const COLOURS: [(&str, f64); 8] = [
    NONE,
    ("black", 1.0),
    ("blue", 2.0),
    ("green", 3.0),
    ("yellow", 4.0),
    ("red", 5.0),
    ("white", 6.0),
    ("brown", 7.0),
];

/// The remote's buttons: red is left, blue is right; one of each side may be held together.
const REMOTE_BUTTONS: [(&str, f64); 10] = [
    NONE,
    ("left_up", 1.0),
    ("left_down", 2.0),
    ("right_up", 3.0),
    ("right_down", 4.0),
    ("both_up", 5.0),
    ("left_up_right_down", 6.0),
    ("left_down_right_up", 7.0),
    ("both_down", 8.0),
    ("beacon", 9.0),
];

impl Quantity {
    /// The names of its values in conditions, where it is one of several things: `colour == red`.
    #[must_use]
    pub fn values(&self) -> &'static [(&'static str, f64)] {
        match self.channel {
            Channel::Colour => &COLOURS,
            Channel::Remote => &REMOTE_BUTTONS,
            _ => &[],
        }
    }
}
