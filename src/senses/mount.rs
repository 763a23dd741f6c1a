//! Where a sensor is on its robot.
//!
//! # Not here
//!
//! The range sensor of `[range]`, which is on the head or looks ahead: the map needs its place,
//! and `[range]` has it.

use crate::document::Section;

/// Where a sensor is on a simulated robot, and where it looks. What is left out is as usual for its
/// kind: a touch sensor is behind the front bumper, a colour sensor 7 cm ahead of the axle, and a
/// range sensor on the head. A touch sensor takes the whole of the side to which it looks.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Mount {
    /// Metres ahead of the axle and to the left of the middle; −1 to 1.
    pub at_m: Option<[f64; 2]>,
    /// Where it looks, degrees anticlockwise from straight ahead; −180 to 180.
    pub facing_deg: Option<f64>,
}

impl Mount {
    /// Its keys in a file.
    pub(crate) const KEYS: [&str; 2] = ["at_m", "facing_deg"];

    /// Reads it from a sensor's section; `None` where it is wrong.
    pub(crate) fn read(section: &Section<'_>) -> Option<Self> {
        let at_m = section.value_or("at_m", None, |item| item.numbers(-1.0..=1.0).map(Some));
        let facing_deg =
            section.value_or("facing_deg", None, |item| item.number(-180.0..=180.0).map(Some));
        Some(Self { at_m: at_m?, facing_deg: facing_deg? })
    }

    /// As a file has it.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let at_m = self.at_m.map(|at_m| format!("at_m = {at_m:?}\n"));
        let facing_deg = self.facing_deg.map(|deg| format!("facing_deg = {deg:?}\n"));
        at_m.into_iter().chain(facing_deg).collect()
    }
}
