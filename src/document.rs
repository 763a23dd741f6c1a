//! Files that a person writes, read so that every mistake has a place and a way out.
//!
//! `robot.toml`, `mission.toml`, `world.toml` and their like are TOML. A [`Document`] is parsed
//! once; a builder then asks its [`Section`]s for the keys it knows and gets typed values or, for
//! each mistake, a [`Finding`]: file, line, column, a caret under the place, a nearest name.
//! Reading continues after a mistake, so one look shows them all.
//!
//! # Not here
//!
//! No schema: what a robot, a mission or a world consists of stands with each of them. No I/O but
//! in [`read_bounded`], [`toml_files`] and [`save`].
//!
//! # What we count on
//!
//! - Keys come back in the order of the file (the parser sorts them; their places put them back).
//! - A file is at most [`Document::MAX_BYTES`] long, so that a caret's line and column stay small
//!   numbers.

use std::cell::RefCell;
use std::fmt;
use std::ops::{Range, RangeInclusive};

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::printable;

mod finding;
mod kind;
mod load;
mod parts;
pub mod save;
mod syntax;
mod values;

pub(crate) use finding::nearest_or_all;
pub use finding::{Finding, Findings, Severity, nearest, one_of};
pub use kind::Kind;
pub use load::{if_there, read_bounded, toml_files};
pub use parts::append;
use syntax::Explained;

/// One file as a person wrote it.
#[derive(Debug, Clone)]
pub struct Document {
    name: String,
    text: String,
}

impl Document {
    /// The longest file that is read, in bytes; ten thousand states of a mission fit four times
    /// over.
    pub const MAX_BYTES: usize = 4 << 20;

    /// The most findings that are kept: each costs a look through the file, and a person reads the
    /// first of them.
    const MAX_FINDINGS: usize = 200;

    /// Takes the bytes of a file; `name` is what findings call it.
    ///
    /// # Errors
    ///
    /// One finding where the bytes are too many or not UTF-8.
    pub fn new(name: &str, bytes: &[u8]) -> Result<Self, Findings> {
        let refuse = |place: usize, message: String, hint: &str| {
            let text = String::from_utf8_lossy(&bytes[..place]).into_owned();
            let document = Self { name: name.to_owned(), text };
            let finding = document.finding(place..place, Severity::Error, message).with_hint(hint);
            Findings::from(vec![finding])
        };
        if bytes.len() > Self::MAX_BYTES {
            let message =
                format!("the file is too long: at most {} bytes are read", Self::MAX_BYTES);
            return Err(refuse(0, message, "is this the file you meant?"));
        }
        match std::str::from_utf8(bytes) {
            Ok(text) => Ok(Self { name: name.to_owned(), text: text.to_owned() }),
            Err(error) => Err(refuse(
                error.valid_up_to(),
                "this is not text (not UTF-8 from here on)".to_owned(),
                "save the file as UTF-8 text",
            )),
        }
    }

    /// The name that findings use.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The file's text.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Parses the file and lets `build` take it apart.
    ///
    /// `build` returns `None` where something it cannot do without was missing or wrong; it must
    /// have said so through the section. Warnings come back beside the value.
    ///
    /// # Errors
    ///
    /// All findings, if at least one of them is an error.
    pub fn read<T>(
        &self,
        build: impl FnOnce(&Section<'_>) -> Option<T>,
    ) -> Result<(T, Findings), Findings> {
        let (root, errors) = DeTable::parse_recoverable(&self.text);
        let place_of = |error: &toml::de::Error| error.span().unwrap_or(0..0);
        // They do not come in the order of the file.
        if let Some(first) = errors.iter().min_by_key(|error| place_of(error).start) {
            let place = place_of(first);
            let Explained { place, message, hint } =
                syntax::explain(&self.text, &place, first.message());
            let finding = self.finding(place, Severity::Error, message).with_hint(&hint);
            return Err(Findings::from(vec![finding]));
        }
        let findings = RefCell::new(Vec::new());
        let place = root.span().start..root.span().start;
        let source = Source { document: self, findings: &findings };
        let value = build(&Section { source, table: root.get_ref(), place, path: String::new() });
        let findings = Findings::from(findings.into_inner());
        match value {
            Some(value) if !findings.has_errors() => Ok((value, findings)),
            _ if findings.has_errors() => Err(findings),
            _ => Err(Findings::from(vec![self.finding(
                0..0,
                Severity::Error,
                "the file could not be read as what it should be".to_owned(),
            )])),
        }
    }

    /// A finding at a byte range of this document.
    pub fn finding(&self, place: Range<usize>, severity: Severity, message: String) -> Finding {
        Finding::new(&self.name, &self.text, place, severity, message)
    }
}

/// Where findings go: the document and its list, shared by all of its sections.
#[derive(Clone, Copy)]
struct Source<'d> {
    document: &'d Document,
    findings: &'d RefCell<Vec<Finding>>,
}

/// A table of a document: keys and values in the order of the file.
#[derive(Clone)]
pub struct Section<'d> {
    source: Source<'d>,
    table: &'d DeTable<'d>,
    place: Range<usize>,
    path: String,
}

crate::printable::debug_by!(Section<'_>, path);

impl<'d> Section<'d> {
    /// Says which keys there may be: every other key becomes a finding with the nearest of them.
    pub fn allow(&self, keys: &[&str]) {
        for item in self.items() {
            if !keys.contains(&item.key()) {
                self.unknown(&item, keys);
            }
        }
    }

    /// Adds an error at a key that is not among those that there may be.
    pub(crate) fn unknown(&self, item: &Item<'d>, keys: &[&str]) {
        item.error_at_key(format!("unknown key `{}`{}", item.key(), self.within()))
            .hint(nearest_or_all(item.key(), "known here:", keys.iter().copied()));
    }

    /// All keys with their values, in the order of the file.
    pub fn items(&self) -> Vec<Item<'d>> {
        let mut items: Vec<Item<'d>> = self
            .table
            .iter()
            .map(|(key, value)| self.item(key.get_ref(), key.span(), value))
            .collect();
        items.sort_by_key(|item| item.key_place.start);
        items
    }

    /// The value of a key, if it is there.
    pub fn get(&self, key: &str) -> Option<Item<'d>> {
        let (name, value) = self.table.get_key_value(key)?;
        Some(self.item(name.get_ref(), name.span(), value))
    }

    /// The value of a key; a finding where it is not there.
    pub fn require(&self, key: &str) -> Option<Item<'d>> {
        let found = self.get(key);
        if found.is_none() {
            self.error(format!("`{key}` is missing{}", self.within()));
        }
        found
    }

    /// What `read` makes of a key's value; `default` without the key, `None` where its value is
    /// wrong.
    pub fn value_or<T>(
        &self,
        key: &str,
        default: T,
        read: impl FnOnce(&Item<'d>) -> Option<T>,
    ) -> Option<T> {
        self.get(key).map_or(Some(default), |item| read(&item))
    }

    /// The table under a key, if it is there.
    pub fn section(&self, key: &str) -> Option<Section<'d>> {
        self.get(key)?.section()
    }

    /// All keys of the table under a key, as [`Section::items`]; none where it is not there.
    pub(crate) fn items_of(&self, key: &str) -> Vec<Item<'d>> {
        self.section(key).map(|section| section.items()).unwrap_or_default()
    }

    /// Adds an error at the table's own place.
    pub fn error(&self, message: impl Into<String>) -> Noted<'d> {
        note(self.source, self.place.clone(), Severity::Error, message)
    }

    /// The byte range where the table's name stands, or its first brace.
    pub fn place(&self) -> Range<usize> {
        self.place.clone()
    }

    /// Adds a finding at any byte range of the document: for checks that span several keys.
    pub fn note(
        &self,
        place: Range<usize>,
        severity: Severity,
        message: impl Into<String>,
    ) -> Noted<'d> {
        note(self.source, place, severity, message)
    }

    /// The table's name with its parents, such as `machine.drive`; empty for the whole file.
    pub fn path(&self) -> &str {
        &self.path
    }

    fn within(&self) -> String {
        if self.path.is_empty() { String::new() } else { format!(" in [{}]", self.path) }
    }

    fn item(
        &self,
        key: &'d str,
        key_place: Range<usize>,
        value: &'d Spanned<DeValue<'d>>,
    ) -> Item<'d> {
        let path =
            if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) };
        Item { source: self.source, key, key_place, value, path }
    }
}

/// A value of a document, with its key and its place.
#[derive(Clone)]
pub struct Item<'d> {
    source: Source<'d>,
    key: &'d str,
    key_place: Range<usize>,
    value: &'d Spanned<DeValue<'d>>,
    path: String,
}

crate::printable::debug_by!(Item<'_>, path);

impl<'d> Item<'d> {
    /// The key under which the value stands; for an element of an array, the array's key.
    pub fn key(&self) -> &'d str {
        self.key
    }

    /// Key and parents, such as `head.gear`.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// The file that [`append`] put it in from; `None` for the document's own.
    pub(crate) fn part(&self) -> Option<&'d str> {
        parts::part_of(&self.source.document.text, self.key_place.start).map(|part| part.name)
    }

    /// The value's byte range.
    pub fn place(&self) -> Range<usize> {
        self.value.span()
    }

    /// The key's byte range.
    pub fn key_place(&self) -> Range<usize> {
        self.key_place.clone()
    }

    /// The byte range of a part of a string value, `part` counted in bytes of the string. Where the
    /// string has escapes the two do not run in step, and the whole value is the place.
    pub fn place_within(&self, part: Range<usize>) -> Range<usize> {
        let whole = self.value.span();
        let Some(content) = self.value.get_ref().as_str() else { return whole };
        let raw = &self.source.document.text[whole.clone()];
        let quotes = if raw.starts_with("\"\"\"") || raw.starts_with("'''") { 3 } else { 1 };
        match raw.get(quotes..quotes + content.len()) {
            Some(same) if same == content => {
                let start = whole.start + quotes;
                start + part.start..start + part.end
            }
            _ => whole,
        }
    }

    /// Adds an error at the value.
    pub fn error(&self, message: impl Into<String>) -> Noted<'d> {
        note(self.source, self.value.span(), Severity::Error, message)
    }

    /// Adds a warning at the value.
    pub fn warning(&self, message: impl Into<String>) -> Noted<'d> {
        note(self.source, self.value.span(), Severity::Warning, message)
    }

    /// Adds an error at the key.
    pub fn error_at_key(&self, message: impl Into<String>) -> Noted<'d> {
        note(self.source, self.key_place.clone(), Severity::Error, message)
    }

    /// The value as text.
    pub fn text(&self) -> Option<&'d str> {
        self.typed(self.value.get_ref().as_str(), "text in quotes")
    }

    /// The value as one of a few words, each with its meaning.
    pub fn word<T: Copy>(&self, words: &[(&str, T)]) -> Option<T> {
        let list =
            words.iter().map(|(word, _)| format!("\"{word}\"")).collect::<Vec<_>>().join(", ");
        let Some(text) = self.value.get_ref().as_str() else {
            self.mistyped("text in quotes").hint(format!("it can be {list}"));
            return None;
        };
        let found = words.iter().find(|(word, _)| *word == text).map(|(_, meaning)| *meaning);
        if found.is_none() {
            self.error(format!("`{}` is \"{text}\"; it can be {list}", self.path))
                .hint(nearest(text, words.iter().map(|(word, _)| *word)).unwrap_or_default());
        }
        found
    }

    /// The value as `true` or `false`.
    pub fn flag(&self) -> Option<bool> {
        self.typed(self.value.get_ref().as_bool(), "true or false")
    }

    /// The value as a finite number within `range`, given as a whole or a decimal number.
    pub fn number(&self, range: RangeInclusive<f64>) -> Option<f64> {
        let number = match self.value.get_ref() {
            DeValue::Float(float) => float.as_str().parse().ok(),
            #[expect(
                clippy::cast_precision_loss,
                reason = "a number of a person's, far below 2^53"
            )]
            DeValue::Integer(integer) => match self.whole() {
                Some(whole) => Some(whole as f64),
                // More digits than an integer has.
                None => integer.as_str().parse().ok(),
            },
            _ => None,
        };
        self.within(self.typed(number, "a number")?, range)
    }

    /// The value as a whole number within `range`.
    pub fn integer(&self, range: RangeInclusive<i64>) -> Option<i64> {
        match self.value.get_ref() {
            DeValue::Integer(digits) if self.whole().is_none() => {
                self.beyond(digits.as_str(), &range);
                None
            }
            _ => self.within(self.typed(self.whole(), "a whole number")?, range),
        }
    }

    fn within<N: PartialOrd + fmt::Display + fmt::LowerExp>(
        &self,
        number: N,
        range: RangeInclusive<N>,
    ) -> Option<N> {
        if range.contains(&number) {
            return Some(number);
        }
        /// No more letters are read as a number at a glance.
        const READABLE: usize = 20;
        let plain = number.to_string();
        let shown = if plain.len() > READABLE { format!("{number:e}") } else { plain };
        self.beyond(&shown, &range);
        None
    }

    fn beyond<N: fmt::Display>(&self, number: &str, range: &RangeInclusive<N>) {
        let (low, high) = (range.start(), range.end());
        self.error(format!("`{}` is {number}; it can be {low} to {high}", self.path));
    }

    /// The value as a table.
    pub fn section(&self) -> Option<Section<'d>> {
        let table = self.typed(self.value.get_ref().as_table(), "a table")?;
        Some(Section {
            source: self.source,
            table,
            place: self.key_place.clone(),
            path: self.path.clone(),
        })
    }

    /// The value of a key of the value, where that is a table which has it.
    pub fn get(&self, key: &str) -> Option<Item<'d>> {
        self.is_table().then(|| self.section())?.and_then(|section| section.get(key))
    }

    /// The value as a list.
    pub fn list(&self) -> Option<Vec<Item<'d>>> {
        let array = self.typed(self.value.get_ref().as_array(), "a list in [ ]")?;
        let element = |(index, value): (usize, &'d Spanned<DeValue<'d>>)| Item {
            source: self.source,
            key: self.key,
            key_place: value.span(),
            value,
            path: format!("{}[{index}]", self.path),
        };
        Some(array.iter().enumerate().map(element).collect())
    }

    /// True where the value is text: for keys that take a number or an expression.
    pub fn is_text(&self) -> bool {
        self.value.get_ref().is_str()
    }

    /// True where the value is a list.
    pub fn is_list(&self) -> bool {
        self.value.get_ref().is_array()
    }

    /// True where the value is a table: for keys that come in a short and a long form.
    pub fn is_table(&self) -> bool {
        self.value.get_ref().is_table()
    }

    fn whole(&self) -> Option<i64> {
        let integer = self.value.get_ref().as_integer()?;
        i64::from_str_radix(integer.as_str(), integer.radix()).ok()
    }

    fn typed<T>(&self, value: Option<T>, expected: &str) -> Option<T> {
        if value.is_none() {
            self.mistyped(expected).hint(self.other_form(expected).unwrap_or_default());
        }
        value
    }
}

/// A finding that was just added; a hint can still be put to it.
#[derive(Debug)]
pub struct Noted<'d> {
    findings: &'d RefCell<Vec<Finding>>,
    index: usize,
}

impl Noted<'_> {
    /// Adds the hint to the finding; an empty one is left out.
    pub fn hint(self, hint: impl Into<String>) {
        let hint = hint.into();
        if let Some(finding) = self.findings.borrow_mut().get_mut(self.index)
            && !hint.is_empty()
        {
            finding.hint = Some(printable::line(&hint).into_owned());
        }
    }
}

fn note<'d>(
    source: Source<'d>,
    place: Range<usize>,
    severity: Severity,
    message: impl Into<String>,
) -> Noted<'d> {
    let mut findings = source.findings.borrow_mut();
    let has_error = || findings.iter().any(|finding| finding.severity == Severity::Error);
    // An error is never left out where it is the only one: it decides whether the file can be used.
    if findings.len() >= Document::MAX_FINDINGS && (severity == Severity::Warning || has_error()) {
        return Noted { findings: source.findings, index: usize::MAX };
    }
    findings.push(source.document.finding(place, severity, message.into()));
    Noted { findings: source.findings, index: findings.len() - 1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read<T>(text: &str, build: impl FnOnce(&Section<'_>) -> Option<T>) -> Result<T, String> {
        let document = Document::new("robot.toml", text.as_bytes()).map_err(|f| f.to_string())?;
        document.read(build).map(|(value, _)| value).map_err(|findings| findings.to_string())
    }

    #[test]
    fn keys_come_in_the_order_of_the_file() {
        let keys = read("zebra = 1\napple = 2\n[b]\n[a]\n", |root| {
            Some(root.items().iter().map(|item| item.key().to_owned()).collect::<Vec<_>>())
        });
        assert_eq!(keys.unwrap(), ["zebra", "apple", "b", "a"]);
    }

    #[test]
    fn an_unknown_key_has_its_place_and_the_nearest_name() {
        let text = "name = \"x\"\n\n[drive]\ntrack_widht_m = 0.1\n";
        let error = read(text, |root| {
            root.section("drive")?.allow(&["track_width_m", "max_dps"]);
            Some(())
        })
        .unwrap_err();
        let expected = "\
error: unknown key `track_widht_m` in [drive]
  --> robot.toml:4:1
   |
 4 | track_widht_m = 0.1
   | ^^^^^^^^^^^^^ did you mean `track_width_m`?
";
        assert_eq!(error, expected);
    }

    #[test]
    fn several_mistakes_are_found_in_one_go() {
        let text = "a = \"one\"\nb = 5\nc = nan\n";
        let error = read(text, |root| {
            let a = root.require("a")?.number(0.0..=1.0);
            let b = root.require("b")?.number(0.0..=1.0);
            let c = root.require("c")?.number(0.0..=1.0);
            let d = root.require("d").map(|item| item.place());
            Some((a?, b?, c?, d?))
        })
        .unwrap_err();
        assert_eq!(error.matches("error: ").count(), 4, "{error}");
        assert!(error.contains("`a` must be a number, not a text"), "{error}");
        assert!(error.contains("`b` is 5; it can be 0 to 1"), "{error}");
        assert!(error.contains("`c` is NaN; it can be 0 to 1"), "{error}");
        assert!(error.contains("`d` is missing"), "{error}");
    }

    #[test]
    fn what_was_meant_is_told_where_another_kind_of_value_stands() {
        let text = "a = 1e300\nb = 99999999999999999999\nc = -99999999999999999999\nd = true\n\
            e = true\nf = { x = 1 }\n[g]\nx = 1\n";
        let error = read(text, |root| {
            let numbers =
                ["a", "b", "d"].map(|key| root.get(key).and_then(|item| item.number(0.0..=9.0)));
            let whole = root.get("c").and_then(|item| item.integer(0..=9));
            let text = root.get("e").and_then(|item| item.text()).is_some();
            let lists = ["f", "g"].map(|key| root.get(key).and_then(|item| item.list()));
            Some((numbers, whole, text, lists.map(|list| list.is_some())))
        })
        .unwrap_err();
        for told in [
            "`a` is 1e300; it can be 0 to 9\n",
            "`b` is 1e20; it can be 0 to 9\n",
            "`c` is -99999999999999999999; it can be 0 to 9\n",
            "write 1 for true and 0 for false\n",
            "write `\"true\"`\n",
            "put `[` before it and `]` behind it\n",
            "write `[[g]]`\n",
        ] {
            assert!(error.contains(told), "{told}{error}");
        }
    }

    #[test]
    fn what_is_no_text_where_a_word_belongs_is_told_the_words() {
        let error = read("beep = true\n", |root| {
            root.get("beep").and_then(|item| item.word(&[("ok", 1), ("error", 2)]))
        })
        .unwrap_err();
        assert!(error.contains("must be text in quotes, not true or false"), "{error}");
        assert!(error.contains("it can be \"ok\", \"error\"\n"), "{error}");
    }

    #[test]
    fn a_place_inside_a_string_is_found_unless_escapes_shift_it() {
        let text = "when = \"range_m < foo\"\nother = \"a\\tb < foo\"\n";
        let places = read(text, |root| {
            Some((root.get("when")?.place_within(10..13), root.get("other")?.place_within(5..8)))
        })
        .unwrap();
        assert_eq!(&text[places.0], "foo");
        assert_eq!(&text[places.1], "\"a\\tb < foo\"");
    }

    #[test]
    fn of_too_many_findings_the_first_are_kept_and_no_file_passes_for_it() {
        let text: String = (0..5000).map(|key| format!("k{key} = 1\n")).collect();
        let document = Document::new("f", text.as_bytes()).unwrap();
        let findings = document
            .read(|root| {
                root.items().iter().for_each(|item| item.warning("odd").hint("?"));
                root.error("wrong");
                root.error("wrong again");
                Some(())
            })
            .unwrap_err();
        assert_eq!(findings.iter().count(), Document::MAX_FINDINGS + 1);
    }

    #[test]
    fn what_is_not_toml_or_not_text_says_where() {
        assert!(read("a = [1,\n", |_| Some(())).unwrap_err().contains("robot.toml:"));
        let error = Document::new("robot.toml", b"a = 1\nb = \xff\xfe").unwrap_err().to_string();
        assert!(error.contains("robot.toml:2:5"), "{error}");
        let error =
            Document::new("big", &vec![b'#'; Document::MAX_BYTES + 1]).unwrap_err().to_string();
        assert!(error.contains("at most"), "{error}");
        assert!(read("a = 1\na = 2\n", |_| Some(())).unwrap_err().contains("robot.toml:2:1"));
        assert!(
            read("", |root| root.require("name").map(|_| ()))
                .unwrap_err()
                .contains("`name` is missing")
        );
    }
}
