//! Values that files of several kinds have: gears, and lists of tables.

use super::{Item, Section};

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

impl Item<'_> {
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
}
