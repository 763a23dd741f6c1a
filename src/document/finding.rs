//! What was found in a file, as a person reads it.

use std::fmt;
use std::ops::Range;

use serde::Serialize;

use super::{parts, syntax};
use crate::printable::{self, is_printable};

/// How bad a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// The file can be used; this is probably not what was meant.
    Warning,
    /// The file cannot be used.
    Error,
}

/// One thing that is wrong in a file: where, what, and the way out.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// The file's name.
    pub file: String,
    /// Line, counted from 1.
    pub line: usize,
    /// Column in characters, counted from 1.
    pub column: usize,
    /// `"error"` or `"warning"`.
    pub severity: Severity,
    /// What is wrong.
    pub message: String,
    /// The way out, where one is known.
    pub hint: Option<String>,
    /// The line's text.
    #[serde(skip)]
    source: String,
    /// How many characters the place is wide, at least 1.
    #[serde(skip)]
    width: usize,
}

impl Finding {
    /// The longest stretch of a line that is shown, in characters.
    const SHOWN: usize = 100;

    pub(super) fn new(
        file: &str,
        text: &str,
        place: Range<usize>,
        severity: Severity,
        message: String,
    ) -> Self {
        let start = text.floor_char_boundary(place.start.min(text.len()));
        let (file, start, place, text) = match parts::part_of(text, start) {
            Some(part) => {
                let begins = text.len() - part.text.len();
                let place = place.start.saturating_sub(begins)..place.end.saturating_sub(begins);
                (part.name, start - begins, place, part.text)
            }
            None => (file, start, place, text),
        };
        let end = text.floor_char_boundary(place.end.clamp(start, text.len()));
        let Range { start: line_start, end: line_end } = syntax::line_of(text, start);
        let line = text[..start].matches('\n').count() + 1;
        let column = text[line_start..start].chars().count() + 1;
        let width = text[start..end.min(line_end).max(start)].chars().count().max(1);
        let source = text[line_start..line_end].trim_end_matches('\r').to_owned();
        // What a file says may be repeated in it.
        let message = printable::line(&message).into_owned();
        Self { file: file.to_owned(), line, column, severity, message, hint: None, source, width }
    }

    /// The same finding with a way out; an empty one is left out.
    #[must_use]
    pub fn with_hint(mut self, hint: &str) -> Self {
        self.hint = (!hint.is_empty()).then(|| printable::line(hint).into_owned());
        self
    }
}

impl fmt::Display for Severity {
    /// `error` or `warning`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

impl fmt::Display for Finding {
    /// Message, place, the line and a caret under the place; a long line is shown around it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}: {}", self.severity, self.message)?;
        writeln!(f, "  --> {}:{}:{}", printable::line(&self.file), self.line, self.column)?;
        let first = (self.column - 1).saturating_sub(Self::SHOWN / 2);
        // A tab or another control character would shift the caret or the terminal.
        let shown: String = self
            .source
            .chars()
            .skip(first)
            .take(Self::SHOWN)
            .map(|character| if is_printable(character) { character } else { ' ' })
            .collect();
        let gutter = format!("{:>2}", self.line);
        let blank = " ".repeat(gutter.len());
        let indent = " ".repeat(self.column - 1 - first);
        let caret = "^".repeat(self.width.min(Self::SHOWN));
        let hint = self.hint.as_deref().map(|hint| format!(" {hint}")).unwrap_or_default();
        writeln!(f, "{blank} |\n{gutter} | {shown}\n{blank} | {indent}{caret}{hint}")
    }
}

/// All that was found in a file.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Findings(Vec<Finding>);

impl Findings {
    /// The findings, in the order of the file.
    pub fn iter(&self) -> std::slice::Iter<'_, Finding> {
        self.0.iter()
    }

    /// True where nothing was found.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// True where at least one finding is an error.
    pub fn has_errors(&self) -> bool {
        self.0.iter().any(|finding| finding.severity == Severity::Error)
    }

    /// How many findings are printed; a file of ten thousand mistakes shows the first of them.
    const SHOWN: usize = 20;
}

impl From<Vec<Finding>> for Findings {
    fn from(mut findings: Vec<Finding>) -> Self {
        findings.sort_by_key(|finding| (finding.line, finding.column));
        findings.dedup();
        Self(findings)
    }
}

impl<'f> IntoIterator for &'f Findings {
    type Item = &'f Finding;
    type IntoIter = std::slice::Iter<'f, Finding>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

impl fmt::Display for Findings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, finding) in self.0.iter().take(Self::SHOWN).enumerate() {
            if index > 0 {
                writeln!(f)?;
            }
            write!(f, "{finding}")?;
        }
        match self.0.len().saturating_sub(Self::SHOWN) {
            0 => Ok(()),
            more => writeln!(f, "\n… and {more} more"),
        }
    }
}

impl std::error::Error for Findings {}

/// "did you mean `…`?" with the candidate nearest to `word`, where one is near enough to be a slip.
#[must_use]
pub fn nearest<'c>(word: &str, candidates: impl IntoIterator<Item = &'c str>) -> Option<String> {
    /// Below this similarity (0 to 1) the two words have little to do with each other.
    const NEAR: f64 = 0.75;
    /// What begins alike passes that, however it continues: at least this part of the letters must
    /// be the same, but for the beginning of a longer name.
    const SAME: f64 = 0.4;
    let edits = |name: &str| {
        if word.len() > 1 && name.starts_with(word) {
            return Some(0);
        }
        let is_slip = strsim::normalized_damerau_levenshtein(word, name) >= SAME;
        is_slip.then(|| strsim::damerau_levenshtein(word, name))
    };
    let scored = candidates.into_iter().filter_map(|name| {
        let similarity = strsim::jaro_winkler(word, name);
        (similarity >= NEAR).then_some((edits(name)?, similarity, name))
    });
    // Jaro-Winkler alone prefers a common beginning to fewer edits.
    let best = scored.max_by(|a, b| b.0.cmp(&a.0).then(a.1.total_cmp(&b.1)))?;
    Some(format!("did you mean `{}`?", best.2))
}

/// As [`nearest`]; where none is near enough all of them, behind `words`.
pub(crate) fn nearest_or_all<'c>(
    word: &str,
    words: &str,
    candidates: impl Iterator<Item = &'c str> + Clone,
) -> String {
    nearest(word, candidates.clone())
        .unwrap_or_else(|| format!("{words} {}", candidates.collect::<Vec<_>>().join(", ")))
}

/// All of them, and [`nearest`]: "one of a, b; did you mean `a`?".
#[must_use]
pub fn one_of<'c>(word: &str, candidates: impl Iterator<Item = &'c str> + Clone) -> String {
    let near = nearest(word, candidates.clone()).map(|near| format!("; {near}"));
    let all = candidates.collect::<Vec<_>>().join(", ");
    format!("one of {all}{}", near.unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_caret_stands_under_the_place_after_letters_of_several_bytes() {
        let text = "tür = 'auf' # x\n";
        let start = text.find("'auf'").unwrap();
        let finding =
            Finding::new("f", text, start..start + 5, Severity::Warning, "closed".to_owned());
        assert_eq!((finding.line, finding.column), (1, 7));
        assert_eq!(
            finding.to_string(),
            "warning: closed\n  --> f:1:7\n   |\n 1 | tür = 'auf' # x\n   |       ^^^^^\n"
        );
    }

    #[test]
    fn a_long_line_is_shown_around_the_place() {
        let text = format!("{}x = 1", " ".repeat(5000));
        let finding = Finding::new("f", &text, 5000..5001, Severity::Error, "bad".to_owned());
        assert!(finding.to_string().len() < 400, "{finding}");
        assert!(finding.to_string().contains("x = 1"), "{finding}");
    }

    #[test]
    fn a_place_outside_the_text_is_moved_to_its_end() {
        let finding = Finding::new("f", "ab", 10..20, Severity::Error, "bad".to_owned());
        assert_eq!((finding.line, finding.column), (1, 3));
    }

    #[test]
    fn only_a_slip_has_a_nearest_name() {
        assert_eq!(
            nearest("forwad", ["forward", "halt"]).as_deref(),
            Some("did you mean `forward`?")
        );
        assert_eq!(nearest("zebra", ["forward", "halt"]), None);
        assert_eq!(nearest("x", []), None);
    }

    #[test]
    fn the_nearest_name_takes_the_fewest_edits_and_the_beginning_of_a_name_none() {
        for (word, candidates, expected) in [
            ("headin_deg", ["heading_deg", "head_deg"], "heading_deg"),
            ("left", ["lift", "left_dps"], "left_dps"),
            ("rang", ["ranges_m", "range_m"], "range_m"),
        ] {
            let nearest = nearest(word, candidates);
            assert_eq!(nearest, Some(format!("did you mean `{expected}`?")), "{word}");
        }
    }
}
