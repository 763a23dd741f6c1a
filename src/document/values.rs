//! Values that files of several kinds have: gears, and lists of tables; and how values of another
//! kind than the one that stands there are written.

use std::ops::RangeInclusive;

use toml::de::DeValue;

use super::{Item, Noted, Section};

impl<'d> Section<'d> {
    /// The tables of a list such as `[[wall]]`; none without the key, and where there are more than
    /// `most`, which is a finding with a hint.
    #[cfg(feature = "sim")]
    pub(crate) fn tables(&self, key: &str, most: usize, hint: &str) -> Vec<Self> {
        let Some(item) = self.get(key) else { return Vec::new() };
        let list = item.list().unwrap_or_default();
        if list.len() > most {
            let message = format!("there are {} of `{key}`; at most {most} are read", list.len());
            item.error_at_key(message).hint(hint);
            return Vec::new();
        }
        list.iter().filter_map(Item::section).collect()
    }
}

impl<'d> Item<'d> {
    /// The value as a list of exactly `N` numbers, each within `range`.
    pub fn numbers<const N: usize>(&self, range: RangeInclusive<f64>) -> Option<[f64; N]> {
        let list = self.list()?;
        let numbers: Vec<f64> = list.iter().filter_map(|item| item.number(range.clone())).collect();
        if list.len() != N {
            let s = if list.len() == 1 { "" } else { "s" };
            self.error(format!("`{}` has {} value{s}; it takes {N}", self.path, list.len()));
            return None;
        }
        numbers.try_into().ok()
    }

    /// The value as a gear, teeth on the motor and on what it turns: turns of the latter for one of
    /// the motor. A minus turns it round.
    pub(crate) fn gear(&self) -> Option<f64> {
        const MOST_TEETH: f64 = 1000.0;
        let [motor, driven] = self.numbers::<2>(-MOST_TEETH..=MOST_TEETH)?;
        if motor.abs() < 1.0 || driven.abs() < 1.0 {
            self.error(format!("`{}` counts teeth: each number is at least 1", self.path()))
                .hint("such as [12, 36]: 12 teeth on the motor turn a wheel of 36");
            return None;
        }
        Some(motor / driven)
    }

    /// Adds the error that the value is of another kind than what is expected.
    pub(super) fn mistyped(&self, expected: &str) -> Noted<'d> {
        let found = match self.value.get_ref() {
            DeValue::String(_) => "a text",
            DeValue::Integer(_) | DeValue::Float(_) => "a number",
            DeValue::Boolean(_) => "true or false",
            DeValue::Datetime(_) => "a date",
            DeValue::Array(_) => "a list",
            DeValue::Table(_) => "a table",
        };
        self.error(format!("`{}` must be {expected}, not {found}", self.path))
    }

    /// How what was meant is written.
    pub(super) fn other_form(&self, expected: &str) -> Option<String> {
        let raw = self.source.document.text.get(self.value.span()).unwrap_or_default();
        match self.value.get_ref() {
            // "10s" is meant as a number.
            DeValue::String(text) if expected.ends_with("number") => {
                let number = leading_number(text).map(|number| {
                    format!("write {number} without quotes; the unit is part of the name")
                });
                let is_sum = text.contains(['+', '-', '*', '/', '(']);
                number.or_else(|| {
                    is_sum.then(|| {
                        "nothing is worked out here: write the number that it comes to".to_owned()
                    })
                })
            }
            // "0.3, 0.2" is meant as a list.
            DeValue::String(text) if expected.starts_with("a list") => {
                let is_listed = text.chars().all(|letter| "0123456789.,- ".contains(letter));
                is_listed.then(|| format!("write `[{text}]` without quotes"))
            }
            DeValue::String(_) | DeValue::Integer(_) | DeValue::Float(_)
                if expected.starts_with("a table") && raw.len() < 30 =>
            {
                Some(format!("a table has keys, as in `{{ key = {raw} }}`"))
            }
            DeValue::Boolean(_) if expected.ends_with("number") => {
                Some("write 1 for true and 0 for false".to_owned())
            }
            DeValue::Boolean(_) if expected.starts_with("text") => {
                Some(format!("write `\"{raw}\"`"))
            }
            DeValue::Table(_) if expected.starts_with("a list") => {
                Some(match raw.starts_with('{') {
                    true => "put `[` before it and `]` behind it".to_owned(),
                    false => format!("write `[[{}]]`", self.path),
                })
            }
            _ => None,
        }
    }
}

/// The number that a text such as `10s` begins with.
fn leading_number(text: &str) -> Option<&str> {
    let end = text.find(|letter: char| !(letter.is_ascii_digit() || letter == '.'))?;
    let (number, unit) = text.split_at(end);
    let is_unit =
        unit.trim_start().starts_with(|first: char| first.is_alphabetic() || "%°".contains(first));
    (is_unit && number.parse::<f64>().is_ok()).then_some(number)
}
