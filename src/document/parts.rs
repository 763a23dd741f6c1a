//! Several files in one text: a line of its own says where each of them begins.

/// How the line begins that says which file the lines after it are of.
const MARK: &str = "# onbrick: from ";

/// A file within a text, up to the text's end.
pub(super) struct Part<'t> {
    pub(super) name: &'t str,
    pub(super) text: &'t str,
}

/// A text with another file's text behind it; findings there have its name and its lines.
pub fn append(text: &str, name: &str, part: &str) -> String {
    format!("{}\n\n{MARK}{name}\n{part}", text.trim_end())
}

/// The file that a byte of a text is of; `None` for the first one.
pub(super) fn part_of(text: &str, at: usize) -> Option<Part<'_>> {
    let before = text.get(..at)?;
    let mark = before.rfind(&format!("\n{MARK}"))? + 1;
    let (line, rest) = text.get(mark..)?.split_once('\n')?;
    // The line itself is of no file.
    (mark + line.len() < at).then_some(())?;
    Some(Part { name: line.strip_prefix(MARK)?, text: rest })
}
