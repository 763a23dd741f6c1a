//! What an attribute's text can mean: parsing from bytes, writing into a stack buffer, and what is
//! legal.
//!
//! # Not here
//!
//! No files: those are in `node`. No words: those are tables in `words`.

use std::fmt::{self, Write};
use std::sync::Arc;

use arrayvec::ArrayString;

use crate::units::Duty;

/// Room for a value on its way to the kernel. The longest are trigger names, of about 45
/// characters.
pub(crate) type AttributeText = ArrayString<64>;

/// A single word of the kernel that is no enum: a driver's name, a sensor's mode.
pub type Word = ArrayString<48>;

/// Which values an attribute may have.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Legal {
    /// Any 32-bit whole number.
    Number,
    /// Whole numbers from the first to the last, both included.
    Range(i64, i64),
    /// One of these words.
    Words(&'static [&'static str]),
    /// Any of these words, in this order, separated by spaces; also none.
    Flags(&'static [&'static str]),
    /// One of these words, known since the device was bound: a sensor's modes.
    OneOf(Arc<str>),
    /// Any text.
    Text,
    /// Bytes that are no text.
    Bytes,
}

impl Legal {
    /// Any 32-bit whole number from 0 on.
    pub const NOT_NEGATIVE: Self = Self::Range(0, i32::MAX as i64);

    /// Whether a whole number is legal here; where no number is expected, none is refused.
    #[must_use]
    pub fn allows(&self, number: i64) -> bool {
        match self {
            Self::Range(first, last) => *first <= number && number <= *last,
            Self::Number => i32::try_from(number).is_ok(),
            _ => true,
        }
    }

    /// Whether a word is legal here; where no word is expected, none is refused.
    #[must_use]
    pub fn admits(&self, word: &str) -> bool {
        match self {
            Self::Words(words) => words.contains(&word),
            Self::OneOf(words) => words.split_whitespace().any(|legal| legal == word),
            _ => true,
        }
    }
}

impl fmt::Display for Legal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number => f.write_str("a whole number"),
            Self::Range(first, last) => write!(f, "{first} to {last}"),
            Self::Words(words) => write!(f, "one of {}", words.join(" ")),
            Self::Flags(words) => write!(f, "any of {}", words.join(" ")),
            Self::OneOf(words) => write!(f, "one of {words}"),
            Self::Text => f.write_str("text"),
            Self::Bytes => f.write_str("bytes"),
        }
    }
}

/// A type that stands for an attribute's text.
pub(crate) trait Value: Sized {
    /// What is legal for every attribute of this type; a row of a table may say more.
    const LEGAL: Legal;

    /// Whether the text may be longer than [`SHORT`] bytes; such attributes are read when a device
    /// is bound, never in a tick.
    const LONG: bool = false;

    /// The value of an attribute's first line, without its newline.
    fn parse(text: &[u8]) -> Option<Self>;

    /// Writes the value as the kernel expects it, without a newline.
    fn render(&self, line: &mut AttributeText) -> fmt::Result;

    /// The value as a number, for attributes with a range.
    fn number(&self) -> Option<i64> {
        None
    }
}

/// Bytes of the buffer for everything that is read in a tick.
pub(crate) const SHORT: usize = 64;

/// The first line of what was read, without its newline.
pub(crate) fn first_line(text: &[u8]) -> &[u8] {
    text.split(|&byte| byte == b'\n').next().unwrap_or_default()
}

/// A number of up to nine digits, which cannot overflow: every reading of a tick, at a third of
/// what any text costs. `None` for all else.
fn short(text: &[u8]) -> Option<i32> {
    let (minus, digits) = match text {
        [b'-', digits @ ..] => (true, digits),
        digits => (false, digits),
    };
    if !(1..=9).contains(&digits.len()) {
        return None;
    }
    let mut number = 0;
    for byte in digits {
        let digit = byte.wrapping_sub(b'0');
        if digit > 9 {
            return None;
        }
        number = 10 * number + i32::from(digit);
    }
    Some(if minus { -number } else { number })
}

impl Value for i32 {
    const LEGAL: Legal = Legal::Number;

    fn parse(text: &[u8]) -> Option<Self> {
        short(text).or_else(|| std::str::from_utf8(text).ok()?.parse().ok())
    }

    fn render(&self, line: &mut AttributeText) -> fmt::Result {
        write!(line, "{self}")
    }

    fn number(&self) -> Option<i64> {
        Some(i64::from(*self))
    }
}

impl Value for Duty {
    const LEGAL: Legal = Legal::Range(-100, 100);

    fn parse(text: &[u8]) -> Option<Self> {
        Self::new(i32::parse(text)?).ok()
    }

    fn render(&self, line: &mut AttributeText) -> fmt::Result {
        write!(line, "{}", self.percent())
    }

    fn number(&self) -> Option<i64> {
        Some(i64::from(self.percent()))
    }
}

impl Value for Word {
    const LEGAL: Legal = Legal::Text;

    fn parse(text: &[u8]) -> Option<Self> {
        Self::from(std::str::from_utf8(text).ok()?).ok()
    }

    fn render(&self, line: &mut AttributeText) -> fmt::Result {
        line.write_str(self)
    }
}

/// A list of words: the kernel's `modes`, `commands`, `trigger`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Words(pub(crate) Arc<str>);

impl Words {
    /// The words in the kernel's order.
    pub fn iter(&self) -> impl Iterator<Item = &str> {
        self.0.split_whitespace()
    }

    /// Whether a word is in the list.
    #[must_use]
    pub fn contains(&self, word: &str) -> bool {
        self.iter().any(|known| known == word)
    }

    pub(crate) fn as_legal(&self) -> Legal {
        Legal::OneOf(Arc::clone(&self.0))
    }
}

impl Value for Words {
    const LEGAL: Legal = Legal::Text;
    const LONG: bool = true;

    fn parse(text: &[u8]) -> Option<Self> {
        Some(Self(std::str::from_utf8(text).ok()?.into()))
    }

    fn render(&self, line: &mut AttributeText) -> fmt::Result {
        line.try_push_str(&self.0).map_err(|_| fmt::Error)
    }
}

#[cfg(test)]
mod tests {
    use super::super::words::{StopAction, TachoCommand};
    use super::*;
    use proptest::prelude::*;

    fn rendered(value: &impl Value) -> AttributeText {
        let mut line = AttributeText::new();
        value.render(&mut line).unwrap();
        line
    }

    proptest! {
        #[test]
        fn any_bytes_are_a_number_or_refused(
            bytes in proptest::collection::vec(any::<u8>(), 0..80),
        ) {
            let text = first_line(&bytes);
            if let Some(number) = i32::parse(text) {
                let digits = std::str::from_utf8(text).unwrap();
                prop_assert_eq!(digits.parse::<i32>(), Ok(number));
            }
            if let Some(command) = TachoCommand::parse(text) {
                prop_assert_eq!(command.as_str().as_bytes(), text);
            }
            if let Some(word) = Word::parse(text) {
                prop_assert_eq!(word.as_bytes(), text);
            }
        }

        #[test]
        fn a_number_is_what_rust_takes_for_one(text in "[-+]?[0-9]{0,12}[a: ]?") {
            prop_assert_eq!(i32::parse(text.as_bytes()), text.parse().ok());
        }

        #[test]
        fn every_number_comes_back_as_it_was_written(number in any::<i32>()) {
            prop_assert_eq!(i32::parse(rendered(&number).as_bytes()), Some(number));
        }
    }

    #[test]
    fn every_word_comes_back_as_it_was_written() {
        for action in StopAction::ALL {
            assert_eq!(StopAction::parse(rendered(action).as_bytes()), Some(*action));
        }
        for command in TachoCommand::ALL {
            assert_eq!(TachoCommand::parse(rendered(command).as_bytes()), Some(*command));
            assert_eq!(command.as_str().parse(), Ok(*command));
        }
    }

    #[test]
    fn numbers_beyond_32_bits_blanks_and_nothing_are_no_numbers() {
        for text in ["", " 5", "5 ", "1.5", "0x10", "2147483648", "-2147483649", "five"] {
            assert_eq!(i32::parse(text.as_bytes()), None, "`{text}`");
        }
        assert_eq!(i32::parse(b"-2147483648"), Some(i32::MIN));
    }

    #[test]
    fn only_the_first_line_counts() {
        assert_eq!(first_line(b"12\n345\n"), b"12");
        assert_eq!(first_line(b"12"), b"12");
        assert_eq!(first_line(b"\n"), b"");
        assert_eq!(first_line(b""), b"");
    }
}
