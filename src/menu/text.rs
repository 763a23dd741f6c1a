//! Text on the screen: one font that can be read at arm's length, lines that wrap, letters of
//! western Europe.
//!
//! A pixel of the brick's panel is 0.21 mm. The font's capitals are 9 pixels or 1.9 mm high, 25
//! letters a line; headlines are 9 × 18. Both are embedded-graphics' ISO 8859-15: Latin letters
//! with their accents, the euro. Signs that it lacks are written otherwise where they have a plain
//! form, and as `?` else. (`profont` has fewer letters; `u8g2-fonts` has more, and cost 60 kB for
//! the one font that would help.)

use embedded_graphics::Drawable;
use embedded_graphics::mono_font::iso_8859_15::{FONT_7X13, FONT_7X13_BOLD, FONT_9X18_BOLD};
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::Gray2;
use embedded_graphics::prelude::Point;
use embedded_graphics::text::{Baseline, Text};

use super::canvas::Canvas;

/// What a text looks like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Face {
    /// What most is written in.
    Plain,
    /// What matters in it.
    Strong,
    /// Headlines.
    Big,
}

impl Face {
    fn font(self) -> &'static MonoFont<'static> {
        match self {
            Self::Plain => &FONT_7X13,
            Self::Strong => &FONT_7X13_BOLD,
            Self::Big => &FONT_9X18_BOLD,
        }
    }

    /// From one line to the next, pixels.
    pub(super) fn line(self) -> i32 {
        self.font().character_size.height.cast_signed()
    }

    /// How wide a letter is, pixels.
    pub(super) fn letter(self) -> i32 {
        self.font().character_size.width.cast_signed()
    }
}

/// Writes a line; `place` is its upper left corner.
pub(super) fn write(canvas: &mut Canvas, text: &str, place: Point, face: Face, colour: Gray2) {
    let style = MonoTextStyle::new(face.font(), colour);
    let Ok(_) = Text::with_baseline(text, place, style, Baseline::Top).draw(canvas);
}

/// How wide a line is, pixels.
pub(super) fn width(text: &str, face: Face) -> i32 {
    i32::try_from(text.chars().count()).unwrap_or(i32::MAX).saturating_mul(face.letter())
}

/// The same text in letters that the font has.
pub(super) fn plain(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '\n' => plain.push('\n'),
            '–' | '—' | '−' | '‐' | '‑' => plain.push('-'),
            '‘' | '’' => plain.push('\''),
            '“' | '”' | '„' => plain.push('"'),
            '…' => plain.push_str("..."),
            '→' => plain.push_str("->"),
            '≤' => plain.push_str("<="),
            '≥' => plain.push_str(">="),
            // Accents that follow their letter, as a Mac writes names: the letter alone.
            '\u{300}'..='\u{36f}' | '\u{200b}'..='\u{200f}' => {}
            letter if letter.is_control() || letter.is_whitespace() => plain.push(' '),
            letter => plain.push(letter),
        }
    }
    plain
}

/// A text in lines of at most `columns` letters, at least one line: broken at spaces, and within
/// what is longer than a line.
pub(super) fn wrap(text: &str, columns: usize) -> Vec<String> {
    let columns = columns.max(1);
    let mut lines = Vec::new();
    for paragraph in plain(text).split('\n') {
        let mut line = String::new();
        let mut length = 0;
        for word in paragraph.split_inclusive(' ') {
            let letters = word.trim_end_matches(' ').chars().count();
            if length > 0 && length + letters > columns {
                lines.push(std::mem::take(&mut line));
                length = 0;
            }
            for letter in word.chars() {
                if length == columns {
                    // A space at a line's end is not missed.
                    if letter == ' ' {
                        continue;
                    }
                    lines.push(std::mem::take(&mut line));
                    length = 0;
                }
                line.push(letter);
                length += 1;
            }
        }
        lines.push(line);
    }
    for line in &mut lines {
        line.truncate(line.trim_end().len());
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::menu::canvas::INK;

    #[test]
    fn lines_break_at_spaces_and_long_words_where_they_must() {
        assert_eq!(wrap("", 5), [""]);
        assert_eq!(wrap("a wall is near", 6), ["a wall", "is", "near"]);
        assert_eq!(wrap("abcdefghijk lm", 5), ["abcde", "fghij", "k lm"]);
        assert_eq!(wrap("one\ntwo three", 20), ["one", "two three"]);
        assert_eq!(wrap("  in 5", 9), ["  in 5"]);
    }

    proptest::proptest! {
        #[test]
        fn nothing_that_can_be_seen_is_lost_and_no_line_is_too_long(
            text: String,
            columns in 1_usize..40,
        ) {
            let lines = wrap(&text, columns);
            let seen = |text: &str| {
                text.chars().filter(|letter| !letter.is_whitespace()).collect::<String>()
            };
            proptest::prop_assert_eq!(seen(&lines.concat()), seen(&plain(&text)));
            for line in lines {
                proptest::prop_assert!(line.chars().count() <= columns, "`{}`", line);
            }
        }
    }

    #[test]
    fn accents_are_drawn_and_what_the_font_lacks_is_a_question_mark() {
        let drawn = |text: &str| {
            let mut canvas = Canvas::default();
            write(&mut canvas, text, Point::zero(), Face::Plain, INK);
            canvas
        };
        let unknown = drawn("?");
        for letter in ["ä", "É", "ß", "ñ", "€", "°", "±", "ø", "Ž"] {
            assert_ne!(drawn(letter), unknown, "{letter}");
        }
        assert_eq!(drawn("雪"), unknown);
        assert_eq!(plain("a\u{308}“b”…−3→"), "a\"b\"...-3->");
    }
}
