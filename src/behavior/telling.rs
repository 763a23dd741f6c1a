//! What a mission tells people: a text with values in braces.
//!
//! `found {found} at {x_m:.2} m` shows the two values as they are at that moment, the second with
//! two digits behind the point. Without such a number a whole value has none and any other two, and
//! a colour is its name. A value that is not known is shown as `?`. `{{` and `}}` are braces.
//!
//! # Not here
//!
//! Where the text is shown: a screen, a log, a page.

use std::fmt::Write as _;
use std::ops::Range;

use arrayvec::ArrayString;

use super::blackboard::Scope;
use super::demands::SAY_BYTES;
use super::expression::{Expression, Kind};

/// A text with values.
#[derive(Debug, Clone, Default)]
pub(super) struct Telling(pub(super) Vec<Piece>);

/// A part of a text.
#[derive(Debug, Clone)]
pub(super) enum Piece<V = Expression> {
    /// As it is written.
    Text(String),
    /// A value, with a number of digits behind the point.
    Value { value: V, digits: Option<usize> },
}

/// What is wrong with a text, and where.
pub(super) type Wrong = (&'static str, Range<usize>);

/// The most digits behind the point.
const MOST_DIGITS: usize = 6;

/// Takes a text apart; values are the bytes of the expressions.
pub(super) fn parts(text: &str) -> Result<Vec<Piece<Range<usize>>>, Wrong> {
    let mut parts = Vec::new();
    let mut words = String::new();
    let mut rest = text;
    while let Some(at) = rest.find(['{', '}']) {
        let (before, brace) = rest.split_at(at);
        let start = text.len() - brace.len();
        words.push_str(before);
        if brace.starts_with("{{") || brace.starts_with("}}") {
            words.push_str(&brace[..1]);
            rest = &brace[2..];
            continue;
        }
        if brace.starts_with('}') {
            return Err(("this `}` closes nothing; write `}}` for a brace", start..start + 1));
        }
        let Some(end) = brace.find('}') else {
            return Err(("this `{` is not closed; write `{{` for a brace", start..start + 1));
        };
        let inside = &brace[1..end];
        let (value, digits) = match inside.split_once(':') {
            None => (inside, None),
            Some((value, format)) => {
                let place = start + 1 + value.len() + 1..start + end;
                (value, Some(digits(format).ok_or((DIGITS, place))?))
            }
        };
        if !words.is_empty() {
            parts.push(Piece::Text(std::mem::take(&mut words)));
        }
        parts.push(Piece::Value { value: start + 1..start + 1 + value.len(), digits });
        rest = &brace[end + 1..];
    }
    words.push_str(rest);
    if !words.is_empty() {
        parts.push(Piece::Text(words));
    }
    Ok(parts)
}

const DIGITS: &str = "how many digits to show is written as `.0` to `.6`, as in `{x_m:.2}`";

fn digits(format: &str) -> Option<usize> {
    let digits = format.strip_prefix('.')?.parse().ok()?;
    (digits <= MOST_DIGITS).then_some(digits)
}

impl Telling {
    /// The text as it is now; what is too long is cut.
    pub(super) fn text(&self, scope: Scope<'_>) -> ArrayString<SAY_BYTES> {
        let mut text = ArrayString::new();
        for piece in &self.0 {
            match piece {
                Piece::Text(words) => append(&mut text, words),
                Piece::Value { value, digits } => {
                    let mut shown = ArrayString::<NUMBER_BYTES>::new();
                    // A number that is longer than any screen shows nothing.
                    let _ = write_value(&mut shown, value, *digits, scope);
                    append(&mut text, &shown);
                }
            }
        }
        text
    }

    /// Every expression in it.
    pub(super) fn expressions_mut(&mut self) -> impl Iterator<Item = &mut Expression> {
        self.0.iter_mut().filter_map(|piece| match piece {
            Piece::Value { value, .. } => Some(value),
            Piece::Text(_) => None,
        })
    }

    /// How many bytes its words have; values come in addition.
    pub(super) fn words(&self) -> usize {
        let words = |piece: &Piece| if let Piece::Text(words) = piece { words.len() } else { 0 };
        self.0.iter().map(words).sum()
    }
}

/// The longest number: 1e308 is not for a screen.
const NUMBER_BYTES: usize = 32;

fn write_value(
    shown: &mut ArrayString<NUMBER_BYTES>,
    value: &Expression,
    digits: Option<usize>,
    scope: Scope<'_>,
) -> std::fmt::Result {
    let number = match (value.evaluate(scope), value.kind()) {
        (None, _) => return shown.write_str("?"),
        (Some(truth), Kind::Truth) => {
            return shown.write_str(if truth == 0.0 { "no" } else { "yes" });
        }
        (Some(number), Kind::Number) => number,
    };
    if let (None, Some(name)) = (digits, value.called(number)) {
        return shown.write_str(name);
    }
    let is_whole = (libm::round(number) - number).abs() < 1e-9;
    let digits = digits.unwrap_or(if is_whole { 0 } else { 2 });
    // No minus before a number that is shown as 0.
    let least = 0.5 * libm::exp10(-f64::from(u8::try_from(digits).unwrap_or(0)));
    let number = if number.abs() < least { 0.0 } else { number };
    if number.abs() < 1e9 {
        write!(shown, "{number:.digits$}")
    } else {
        write!(shown, "{number:e}")
    }
}

fn append(text: &mut ArrayString<SAY_BYTES>, more: &str) {
    text.push_str(&more[..more.floor_char_boundary(text.remaining_capacity())]);
}

#[cfg(test)]
mod tests {
    use super::super::blackboard::{Blackboard, Since};
    use super::super::expression::Vocabulary;
    use super::super::signals::{Capabilities, Signal, Signals};
    use super::*;

    fn told(text: &str) -> String {
        let mut signals = Signals::at(0);
        for (signal, value) in [(Signal::X, 0.826), (Signal::Y, -0.001), (Signal::Echo, 1.0)] {
            signals.set(signal, value);
        }
        let board = Blackboard::of(signals, Since::default());
        let capabilities = Capabilities::all();
        let mut vocabulary = Vocabulary::new(&capabilities);
        let pieces = parts(text).unwrap().into_iter().map(|part| match part {
            Piece::Text(words) => Piece::Text(words),
            Piece::Value { value, digits } => Piece::Value {
                value: Expression::parse(&text[value], None, &mut vocabulary).unwrap(),
                digits,
            },
        });
        Telling(pieces.collect()).text(board.seen_by(0, 0)).to_string()
    }

    #[test]
    fn values_are_shown_as_people_write_them() {
        for (text, expected) in [
            ("hello", "hello"),
            ("x {x_m} m", "x 0.83 m"),
            ("x {x_m:.1} y {y_m:.2}", "x 0.8 y 0.00"),
            ("{100 * x_m:.0} cm", "83 cm"),
            ("{2 + 2}{{{touch}}}", "4{?}"),
            ("wall: {echo}, far: {range_m}", "wall: yes, far: ?"),
            ("{1 / 0} {1e300:.6}", "inf 1e300"),
            ("größer als {5}", "größer als 5"),
        ] {
            assert_eq!(told(text), expected, "{text}");
        }
        let long = "ä".repeat(SAY_BYTES);
        assert_eq!(told(&long).len(), SAY_BYTES / 2 * 2, "cut at a letter");
    }

    #[test]
    fn braces_that_do_not_fit_have_a_place() {
        for (text, place) in [("a {x_m", 2..3), ("a} b", 1..2), ("{x_m:2}", 5..6), ("{x:.9}", 3..5)]
        {
            assert_eq!(parts(text).unwrap_err().1, place, "{text}");
        }
    }
}
