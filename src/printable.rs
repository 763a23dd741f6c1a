//! Texts of others, made fit to be shown: on a terminal, in a log, on a page.
//!
//! A text that comes from a peer, a file, a recording or a device may hold characters that a
//! terminal obeys instead of showing them, that turn the order of the others round, or that end a
//! line and begin a forged one. Every such text passes [`shown`] before a person sees it: what
//! cannot be printed is written as an escape (`\u{1b}`), and what is too long is cut.
//!
//! | where it passes | as |
//! |---|---|
//! | a brick's replies, as the PC reads them (`link::client`) | [`Layout::Line`], findings [`Layout::Lines`] |
//! | an operation's name, a finding's message, a recording's texts, as they are read | [`Layout::Line`] |
//! | all that a command prints (`cli::output`), each record of the log, each progress bar | [`Layout::Lines`] |
//! | all JSON that a command prints | [`json`], which loses nothing |
//!
//! # Not here
//!
//! Names that people compare have an alphabet of their own ([`Name`](crate::protocol::Name)):
//! letters that look alike are a matter of alphabets, not of what can be printed. HTML and TOML
//! have their own escapes, where they are written.

use std::borrow::Cow;
use std::fmt::Write as _;
use std::path::Path;

/// How a text is laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layout {
    /// It stands in a line: its own line ends are escaped.
    Line,
    /// It may have lines of its own, and tabs in them.
    Lines,
}

/// The longest text of others that stands in a line, characters.
pub const LONGEST_LINE: usize = 1000;

/// The longest text of others that has lines of its own, characters: some dozen findings.
pub const LONGEST_LINES: usize = 20_000;

/// A text as it may be shown: at most `most` characters, each of which can be printed, or belongs
/// to the escape of one that cannot. A text that is cut ends with `…`.
///
/// It changes nothing in a text that has passed already, as long as `most` is not smaller.
#[must_use]
pub fn shown(text: &str, layout: Layout, most: usize) -> Cow<'_, str> {
    let stays = |letter: char| {
        is_printable(letter) || layout == Layout::Lines && matches!(letter, '\n' | '\t')
    };
    let is_short = text.len() <= most || text.char_indices().nth(most).is_none();
    if is_short && text.chars().all(stays) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len().min(most));
    // Characters so far, and where the text can be cut so that `…` still fits behind it.
    let (mut count, mut cut) = (0, 0);
    for letter in text.chars() {
        if stays(letter) {
            shown.push(letter);
            count += 1;
        } else {
            shown.extend(letter.escape_default());
            count += letter.escape_default().len();
        }
        if count > most {
            shown.truncate(cut);
            shown.extend((most > 0).then_some('…'));
            break;
        }
        if count < most {
            cut = shown.len();
        }
    }
    Cow::Owned(shown)
}

/// A text of others that stands in a line.
#[must_use]
pub fn line(text: &str) -> Cow<'_, str> {
    shown(text, Layout::Line, LONGEST_LINE)
}

/// What a person wrote as a name, for a message: the first 40 characters.
pub(crate) fn name(text: &str) -> Cow<'_, str> {
    shown(text, Layout::Line, 40)
}

/// A text that stands in a line, between the tags of a page or a picture.
#[cfg(feature = "sim")]
pub(crate) fn escaped(text: &str) -> String {
    let text = line(text);
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A text of others that may have lines of its own.
#[must_use]
pub fn lines(text: &str) -> Cow<'_, str> {
    shown(text, Layout::Lines, LONGEST_LINES)
}

/// A JSON text as it may be shown: the same value, with what cannot be printed in JSON's own
/// escapes.
#[must_use]
pub fn json(text: &str) -> Cow<'_, str> {
    let stays = |letter: char| is_printable(letter) || letter == '\n';
    if text.chars().all(stays) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len());
    for letter in text.chars() {
        if stays(letter) {
            shown.push(letter);
            continue;
        }
        for unit in letter.encode_utf16(&mut [0; 2]) {
            let _ = write!(shown, "\\u{unit:04x}");
        }
    }
    Cow::Owned(shown)
}

/// A value as a line of JSON, as processes tell each other.
pub(crate) fn json_line(value: &impl serde::Serialize) -> serde_json::Result<Vec<u8>> {
    let mut line = serde_json::to_vec(value)?;
    line.push(b'\n');
    Ok(line)
}

/// The value in a text of JSON. By its bytes: with serde_json's reader of texts beside that of
/// bytes, the brick's file has the code of all types twice, 40 kB.
pub(crate) fn from_json<T: serde::de::DeserializeOwned>(text: &str) -> serde_json::Result<T> {
    serde_json::from_slice(text.as_bytes())
}

/// Letters without a shape, which the table of what can be printed takes for letters: names with
/// and without them look alike.
const BLANK: [char; 8] =
    ['\u{34f}', '\u{115f}', '\u{1160}', '\u{17b4}', '\u{17b5}', '\u{2800}', '\u{3164}', '\u{ffa0}'];

/// True for a character that a terminal shows as it is: none that controls it (C0, C1), changes the
/// order or the shape of others (Unicode's Cf: bidi, zero width), ends a line, or is no character
/// at all.
#[must_use]
pub fn is_printable(letter: char) -> bool {
    if letter.is_ascii() {
        return matches!(letter, ' '..='~');
    }
    if letter.is_control() || matches!(letter, '\u{2028}' | '\u{2029}') || BLANK.contains(&letter) {
        return false;
    }
    // A space of another width is one.
    letter.is_whitespace() || is_in_table(letter)
}

/// What std's own table says, which is reached only so: `escape_debug` leaves alone what can be
/// printed. A mark is one behind the letter that it belongs to, so it is asked for behind one.
fn is_in_table(letter: char) -> bool {
    let mut bytes = [b'a'; 5];
    let [_, rest @ ..] = &mut bytes;
    let length = 1 + letter.encode_utf8(rest).len();
    let behind_a_letter = bytes.get(..length).and_then(|bytes| std::str::from_utf8(bytes).ok());
    behind_a_letter.is_some_and(|text| text.escape_debug().eq(text.chars()))
}

/// A path as a command in a hint has it, to be copied: in quotes where a shell would split it.
#[must_use]
pub fn in_shell(path: &Path) -> String {
    let text = path.display().to_string();
    if text.chars().all(|letter| letter.is_alphanumeric() || "/._-+,:@%".contains(letter)) {
        return text;
    }
    format!("'{}'", text.replace('\'', r"'\''"))
}

/// An error and all its causes, in one text.
#[must_use]
pub fn with_causes(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text = format!("{text}: {error}");
        cause = error.source();
    }
    text
}

/// `Debug` for a type by one of its fields: the others are secret, or nothing to be shown.
macro_rules! debug_by {
    ($what:ident $(<$life:lifetime>)?, $field:ident) => {
        impl std::fmt::Debug for $what $(<$life>)? {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                let mut shown = f.debug_struct(stringify!($what));
                shown.field(stringify!($field), &self.$field).finish_non_exhaustive()
            }
        }
    };
}
pub(crate) use debug_by;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_terminal_would_obey_is_shown_as_an_escape() {
        for (text, expected) in [
            ("plain, with ü, ñ, 漢字, हिन्दी and ⚠", "plain, with ü, ñ, 漢字, हिन्दी and ⚠"),
            ("\u{1b}]0;code\u{7}", r"\u{1b}]0;code\u{7}"),
            ("\u{9b}2J and \u{7f}", r"\u{9b}2J and \u{7f}"),
            ("a\u{202e}b\u{2066}c\u{200f}d", r"a\u{202e}b\u{2066}c\u{200f}d"),
            ("a\u{200b}b\u{feff}c\u{ad}d\u{3164}e", r"a\u{200b}b\u{feff}c\u{ad}d\u{3164}e"),
            ("a\nb\rc\td\u{2028}e\u{2029}f\u{85}g", r"a\nb\rc\td\u{2028}e\u{2029}f\u{85}g"),
            ("\u{e0041}\u{fff9}\u{10ffff}", r"\u{e0041}\u{fff9}\u{10ffff}"),
        ] {
            assert_eq!(line(text), expected);
        }
        assert_eq!(lines("a\n\tb\r\n\u{1b}[2K"), "a\n\tb\\r\n\\u{1b}[2K");
    }

    #[test]
    fn what_is_too_long_is_cut_and_says_so() {
        let cut = |text, most| shown(text, Layout::Line, most).into_owned();
        assert_eq!(cut("abc", 3), "abc");
        assert_eq!(cut("abcd", 3), "ab…");
        assert_eq!(cut("üüüü", 3), "üü…");
        assert_eq!(cut("ab", 1), "…");
        assert_eq!(cut("ab", 0), "");
        assert_eq!(cut("a\u{1b}b", 7), "a…");
        assert_eq!(cut("a\u{1b}b", 8), r"a\u{1b}b");
        assert_eq!(line(&"x".repeat(5000)).chars().count(), LONGEST_LINE);
    }

    #[test]
    fn whatever_is_printed_here_can_be_printed() {
        // By general category: Cc, Cf, Zl, Zp, as far as they lie in ranges.
        let controls = ('\0'..='\u{1f}').chain('\u{7f}'..='\u{9f}');
        let formats = "\u{ad}\u{61c}\u{6dd}\u{70f}\u{180e}\u{feff}\u{110bd}\u{e0001}".chars();
        let ranges = ('\u{600}'..='\u{605}')
            .chain('\u{200b}'..='\u{200f}')
            .chain('\u{2028}'..='\u{202e}')
            .chain('\u{2060}'..='\u{206f}')
            .chain('\u{fff9}'..='\u{fffb}')
            .chain('\u{1bca0}'..='\u{1bca3}')
            .chain('\u{1d173}'..='\u{1d17a}')
            .chain('\u{e0020}'..='\u{e007f}');
        for letter in controls.chain(formats).chain(ranges) {
            assert!(!is_printable(letter), "{letter:?}");
        }
        for letter in ('\u{20}'..='~').chain('\u{a0}'..='\u{ac}').chain('\u{ae}'..='\u{24f}') {
            assert!(is_printable(letter), "{letter:?}");
        }
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_safe_bounded_and_settled_after_one_pass(text: String, most in 0_usize..50) {
            for layout in [Layout::Line, Layout::Lines] {
                let once = shown(&text, layout, most).into_owned();
                let may_stay = |letter: char| {
                    is_printable(letter) || layout == Layout::Lines && "\n\t".contains(letter)
                };
                proptest::prop_assert!(once.chars().all(may_stay), "{once:?}");
                proptest::prop_assert!(once.chars().count() <= most);
                proptest::prop_assert_eq!(shown(&once, layout, most).into_owned(), once.clone());
                let whole = shown(&text, layout, usize::MAX).into_owned();
                proptest::prop_assert_eq!(shown(&whole, layout, usize::MAX).into_owned(), whole);
            }
        }

        #[test]
        fn json_keeps_its_value_and_has_nothing_that_a_terminal_obeys(text: String) {
            let value = serde_json::json!({ "text": text, text.clone(): [1, 2] });
            let written = serde_json::to_string(&value).unwrap_or_default();
            let safe = json(&written).into_owned();
            proptest::prop_assert!(safe.chars().all(is_printable), "{safe:?}");
            proptest::prop_assert_eq!(
                serde_json::from_str::<serde_json::Value>(&safe).ok(),
                Some(value)
            );
        }
    }
}
