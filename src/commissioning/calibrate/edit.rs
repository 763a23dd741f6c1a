//! Numbers put into a file that a person wrote: comments, order and layout stay as they are.

use std::ops::Range;

use crate::document::{Document, Findings, Section};
use crate::runtime::Source;

/// Why a number could not be put in.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EditError {
    /// The file is no TOML any more.
    #[error(transparent)]
    Findings(#[from] Findings),
    /// The file does not have this number: write it in by hand.
    #[error("{file} has no `{key}` to write to")]
    Missing {
        /// The file's name.
        file: String,
        /// The number's key with its parents.
        key: String,
    },
}

/// The file's text with other values under some keys (`drive.track_width_m`), which are numbers and
/// lists as TOML writes them. Comments behind a value stay in their column where there is room. A
/// key that the file does not have gets a line of its own under its section's head.
///
/// # Errors
///
/// [`EditError`]; no value is put in where one of them has no place.
pub fn set_values(source: &Source, values: &[(&str, String)]) -> Result<String, EditError> {
    let document = Document::new(&source.name, source.text.as_bytes())?;
    let places = document
        .read(|root| Some(values.iter().map(|(key, _)| place(root, key)).collect::<Vec<_>>()));
    let (places, _) = places?;
    let mut edits = Vec::new();
    for ((key, value), place) in values.iter().zip(places) {
        let missing = || EditError::Missing { file: source.name.clone(), key: (*key).to_owned() };
        let edit = match place {
            Some(place) => (place, value.clone()),
            None => new_line(&source.text, key, value).ok_or_else(missing)?,
        };
        edits.push(edit);
    }
    // From the end, so that the places before stay right; what begins at one place stays in order.
    edits.reverse();
    edits.sort_by_key(|(place, _)| std::cmp::Reverse(place.start));
    let mut text = source.text.clone();
    for (place, value) in edits {
        put(&mut text, place, &value);
    }
    Ok(text)
}

/// Where a value stands, if it is there and is a number or a list.
fn place(root: &Section<'_>, key: &str) -> Option<Range<usize>> {
    let mut parts = key.split('.');
    let last = parts.next_back()?;
    let mut section = root.clone();
    for part in parts {
        section = section.section(part)?;
    }
    let item = section.get(last)?;
    (item.is_list() || item.number(f64::MIN..=f64::MAX).is_some()).then(|| item.place())
}

/// The place behind the head of a key's section, and the line to put there.
fn new_line(text: &str, key: &str, value: &str) -> Option<(Range<usize>, String)> {
    let (section, last) = key.rsplit_once('.')?;
    let head = format!("[{section}]");
    let mut at = 0;
    for line in text.split_inclusive('\n') {
        at += line.len();
        let behind = line.trim_start().strip_prefix(&head).map(str::trim_start);
        if behind.is_some_and(|behind| behind.is_empty() || behind.starts_with('#')) {
            let begin = if line.ends_with('\n') { "" } else { "\n" };
            return Some((at..at, format!("{begin}{last} = {value}\n")));
        }
    }
    None
}

/// A number to a micrometre.
pub(super) fn rounded(number: f64) -> String {
    let text = format!("{number:.6}");
    let short = text.trim_end_matches('0');
    // TOML wants a digit behind the point.
    if short.ends_with('.') { format!("{short}0") } else { short.to_owned() }
}

/// Replaces a stretch; the spaces between it and a comment on its line take up the difference in
/// length.
fn put(text: &mut String, place: Range<usize>, number: &str) {
    let rest = &text[place.end..];
    let spaces = rest.len() - rest.trim_start_matches(' ').len();
    let mut end = place.end;
    let mut padding = String::new();
    if spaces > 0 && rest[spaces..].starts_with('#') {
        let width = place.len() + spaces;
        end += spaces;
        padding = " ".repeat(width.saturating_sub(number.len()).max(1));
    }
    text.replace_range(place.start..end, &format!("{number}{padding}"));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::Geometry;
    use crate::robot::{DEFAULT_ROBOT, RobotConfig};
    use proptest::prelude::*;

    fn source(text: &str) -> Source {
        Source { name: "robot.toml".to_owned(), text: text.to_owned() }
    }

    fn set_numbers(source: &Source, numbers: &[(&str, f64)]) -> Result<String, EditError> {
        let values: Vec<(&str, String)> =
            numbers.iter().map(|(key, number)| (*key, rounded(*number))).collect();
        set_values(source, &values)
    }

    #[test]
    fn a_list_is_put_in_and_what_is_not_there_gets_a_line_in_its_section() {
        let values = [
            ("range.bias_m", "-0.014".to_owned()),
            ("range.scale", "1.01".to_owned()),
            ("range.own_echoes", "[[1, 2, 0.2]]".to_owned()),
        ];
        let old = "[range]  # eye\nport = \"in1\"\nown_echoes = []  # none\n[gyro]\n";
        assert_eq!(
            set_values(&source(old), &values).unwrap(),
            "[range]  # eye\nbias_m = -0.014\nscale = 1.01\nport = \"in1\"\n\
             own_echoes = [[1, 2, 0.2]] # none\n[gyro]\n"
        );
        let error = set_values(&source("[gyro]\n"), &values).unwrap_err();
        assert_eq!(error.to_string(), "robot.toml has no `range.bias_m` to write to");
        assert_eq!(
            set_values(&source("[range]"), &values[..1]).unwrap(),
            "[range]\nbias_m = -0.014\n"
        );
    }

    #[test]
    fn only_the_numbers_change_and_comments_keep_their_column() {
        let numbers = [("drive.track_width_m", 0.115_432_1), ("drive.wheel_circumference_m", 0.19)];
        let text = set_numbers(&source(DEFAULT_ROBOT), &numbers).unwrap();
        let differing: Vec<(&str, &str)> = DEFAULT_ROBOT
            .lines()
            .zip(text.lines())
            .filter(|(before, after)| before != after)
            .collect();
        assert_eq!(
            differing,
            [
                (
                    "wheel_circumference_m = 0.188976        # metres driven in one turn \
                     of a wheel",
                    "wheel_circumference_m = 0.19            # metres driven in one turn of a wheel"
                ),
                (
                    "track_width_m = 0.1143                  # metres between the wheels",
                    "track_width_m = 0.115432                # metres between the wheels"
                ),
            ]
        );
        assert_eq!(DEFAULT_ROBOT.lines().count(), text.lines().count());
    }

    #[test]
    fn a_number_is_found_however_it_is_written() {
        let inline = "drive = { track_width_m = 1, x = 2 }";
        let text = set_numbers(&source(inline), &[("drive.track_width_m", 0.1)]).unwrap();
        assert_eq!(text, "drive = { track_width_m = 0.1, x = 2 }");
        let dotted = "drive.track_width_m = 0.1143# wide\n";
        let text = set_numbers(&source(dotted), &[("drive.track_width_m", 2.0)]).unwrap();
        assert_eq!(text, "drive.track_width_m = 2.0# wide\n");
    }

    #[test]
    fn a_number_that_is_not_there_is_said_and_nothing_is_put_in() {
        let error = set_numbers(&source("[drive]\na = 1\n"), &[("drive.a", 2.0), ("head.b", 2.0)])
            .unwrap_err();
        assert_eq!(error.to_string(), "robot.toml has no `head.b` to write to");
        assert!(set_numbers(&source("[drive\n"), &[("drive.a", 2.0)]).is_err());
        assert!(set_numbers(&source("drive = 1\n"), &[("drive.a", 2.0)]).is_err());
        assert!(set_numbers(&source("drive.a = \"wide\"\n"), &[("drive.a", 2.0)]).is_err());
    }

    proptest! {
        #[test]
        fn the_file_reads_back_with_the_new_numbers_and_nothing_else_changed(
            circumference_m in Geometry::WHEEL_CIRCUMFERENCE_M,
            track_m in Geometry::TRACK_WIDTH_M,
            gap in 0..30_usize,
        ) {
            let gapped =
                DEFAULT_ROBOT.replacen(
                    "0.1143                  #",
                    &format!("0.1143{}#", " ".repeat(gap)),
                    1,
                );
            let numbers =
                [
                    ("drive.wheel_circumference_m", circumference_m),
                    ("drive.track_width_m", track_m),
                ];
            let text = set_numbers(&source(&gapped), &numbers).unwrap();
            let (before, _) = RobotConfig::load("before", gapped.as_bytes()).unwrap();
            let (mut after, _) = RobotConfig::load("after", text.as_bytes())
                .map_err(|findings| TestCaseError::fail(findings.to_string()))?;
            prop_assert!((after.drive.wheel_circumference_m - circumference_m).abs() <= 0.5e-6);
            prop_assert!((after.drive.track_width_m - track_m).abs() <= 0.5e-6);
            after.drive.wheel_circumference_m = before.drive.wheel_circumference_m;
            after.drive.track_width_m = before.drive.track_width_m;
            prop_assert_eq!(after, before);
            let comments = |text: &str| text.matches('#').count();
            prop_assert_eq!(comments(&text), comments(&gapped));
            // Once more with the same numbers changes nothing: the layout has settled.
            prop_assert_eq!(set_numbers(&source(&text), &numbers).unwrap(), text);
        }
    }
}
