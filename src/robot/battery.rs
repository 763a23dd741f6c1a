//! How low the battery may get before a run slows down and ends: `[battery]` of `robot.toml`.
//!
//! A brick whose voltage falls too far does not fail cleanly: ev3dev's own watch (`brickd`) shuts
//! the brick down in the middle of a run, and below about 5 V the converter that reads sensors and
//! tells motors apart no longer works (its maintainer, ev3dev issue 1211). So a run warns, then
//! drives slower, which takes load off the cells, and ends by itself while there is still power to
//! brake and to bring the recording to the card.
//!
//! # Where the numbers come from
//!
//! | cells | warn | slow | stop | LEGO's firmware warns, worries, shuts down | brickd shuts down | kernel's `voltage_min_design` |
//! |---|---|---|---|---|---|---|
//! | LEGO's pack (`Li-ion`) | 7.1 V | 6.5 V | 6.2 V | 7.1, 6.5, 6.0 V | 6.0 V | 6.0 V |
//! | six AA cells (`Unknown`) | 6.2 V | 5.5 V | 5.2 V | 6.2, 5.5, 4.5 V | 4.5 V | 4.8 V |
//! | six AA, declared rechargeable (`NiMH`) | 6.6 V | 6.0 V | 5.6 V | does not know them | as AA | 5.4 V |
//!
//! LEGO's numbers are `BATT_…` and `ACCU_…` of `lms2012.h`; brickd's stand in its
//! `power_monitor.vala` and count after ten seconds. `warn` and `slow` are LEGO's two warnings;
//! `stop` is above what shuts the brick down, and above 5 V. For NiMH cells they are 1.1, 1.0 and
//! 0.93 V a cell, above the kernel's 0.9.
//!
//! A board that is fed with eight cells has eight sixths of that.
//!
//! # Not here
//!
//! What a run does about it (`runtime::battery`).

use super::RobotConfig;
use crate::document::Section;
use crate::ev3dev::{Platform, Technology};
use crate::senses::MOST_V;

/// Volts that a threshold can be: fewer do not run a brick, more no board takes.
const VOLTS: std::ops::RangeInclusive<f64> = 4.5..=MOST_V;

/// The cells of which the thresholds speak.
const CELLS: u8 = 6;

/// The thresholds as the file has them, and the cells that decide where it says nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BatteryConfig {
    /// What the brick runs on: known once the robot is bound, and in recordings.
    pub cells: Technology,
    /// How many cells are in series: the board's.
    pub count: u8,
    /// The file's own [`BatteryLimits::warn_v`].
    pub warn_v: Option<f64>,
    /// The file's own [`BatteryLimits::slow_v`].
    pub slow_v: Option<f64>,
    /// The file's own [`BatteryLimits::stop_v`].
    pub stop_v: Option<f64>,
}

impl RobotConfig {
    /// The same robot on a board, with cells of a kind.
    #[must_use]
    pub fn fed_by(self, cells: Technology, board: &Platform) -> Self {
        Self { battery: self.battery.on(cells, board), ..self }
    }
}

/// The thresholds of a run, volts; each is at least the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BatteryLimits {
    /// Below this a person is warned.
    pub warn_v: f64,
    /// Below this the robot drives slower.
    pub slow_v: f64,
    /// Below this the run ends; below `slow_v` none begins.
    pub stop_v: f64,
}

impl Default for BatteryConfig {
    fn default() -> Self {
        Self {
            cells: Technology::default(),
            count: CELLS,
            warn_v: None,
            slow_v: None,
            stop_v: None,
        }
    }
}

impl BatteryConfig {
    /// As the file has it, with these cells on a board.
    #[must_use]
    pub fn on(self, cells: Technology, platform: &Platform) -> Self {
        Self { cells, count: platform.cells, ..self }
    }

    /// What holds for these cells.
    #[must_use]
    pub fn limits(&self) -> BatteryLimits {
        let share = f64::from(self.count) / f64::from(CELLS);
        let of_six = BatteryLimits::of(self.cells);
        let [warn_v, slow_v, stop_v] =
            [of_six.warn_v, of_six.slow_v, of_six.stop_v].map(|limit_v| limit_v * share);
        // One threshold that the file moves takes the others along, so that their order holds.
        let stop_v = self.stop_v.unwrap_or_else(|| {
            stop_v
                .min(self.slow_v.unwrap_or(f64::INFINITY))
                .min(self.warn_v.unwrap_or(f64::INFINITY))
        });
        let slow_v = self
            .slow_v
            .unwrap_or_else(|| slow_v.min(self.warn_v.unwrap_or(f64::INFINITY)).max(stop_v));
        BatteryLimits { warn_v: self.warn_v.unwrap_or(warn_v).max(slow_v), slow_v, stop_v }
    }
}

impl BatteryLimits {
    /// The usual ones of six cells; see the module.
    #[must_use]
    pub const fn of(cells: Technology) -> Self {
        match cells {
            Technology::LiIon => Self { warn_v: 7.1, slow_v: 6.5, stop_v: 6.2 },
            Technology::Unknown => Self { warn_v: 6.2, slow_v: 5.5, stop_v: 5.2 },
            Technology::NiMh => Self { warn_v: 6.6, slow_v: 6.0, stop_v: 5.6 },
        }
    }
}

/// Reads the section; `None` where it is wrong.
pub(super) fn battery(section: &Section<'_>) -> Option<BatteryConfig> {
    const KEYS: [&str; 3] = ["warn_v", "slow_v", "stop_v"];
    section.allow(&KEYS);
    let mut volts = [None; KEYS.len()];
    for (place, key) in volts.iter_mut().zip(KEYS) {
        if let Some(item) = section.get(key) {
            *place = Some(item.number(VOLTS)?);
        }
    }
    for (higher, lower) in [(0, 1), (0, 2), (1, 2)] {
        if let (Some(high), Some(low)) = (volts[higher], volts[lower])
            && high < low
        {
            section
                .error(format!(
                    "`{}` is {high}, which is below `{}`, {low}",
                    KEYS[higher], KEYS[lower]
                ))
                .hint("first it warns, then it slows down, then it stops");
            return None;
        }
    }
    let [warn_v, slow_v, stop_v] = volts;
    Some(BatteryConfig { warn_v, slow_v, stop_v, ..BatteryConfig::default() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ev3dev::{BRICKPI3, EV3};
    use crate::robot::{DEFAULT_ROBOT, RobotConfig};

    fn limits(section: &str, cells: Technology) -> BatteryLimits {
        let text = format!("{DEFAULT_ROBOT}\n{section}");
        let mut robot = RobotConfig::load("robot.toml", text.as_bytes()).unwrap().0;
        robot.battery.cells = cells;
        robot.battery.limits()
    }

    #[test]
    fn the_cells_decide_where_the_file_says_nothing() {
        assert_eq!(
            limits("", Technology::LiIon),
            BatteryLimits { warn_v: 7.1, slow_v: 6.5, stop_v: 6.2 }
        );
        for &cells in Technology::ALL {
            let BatteryLimits { warn_v, slow_v, stop_v } = limits("", cells);
            assert!(warn_v > slow_v && slow_v > stop_v && stop_v > 5.0, "{cells}");
        }
    }

    #[test]
    fn a_board_with_eight_cells_has_eight_sixths_of_the_thresholds() {
        let six = BatteryConfig::default().on(Technology::Unknown, &EV3);
        assert_eq!(six.limits(), BatteryLimits::of(Technology::Unknown));
        let eight = six.on(Technology::Unknown, &BRICKPI3).limits();
        assert!((eight.stop_v - 5.2 * 8.0 / 6.0).abs() < 1e-9, "{eight:?}");
    }

    #[test]
    fn what_the_file_says_holds_and_the_order_stays() {
        let own =
            limits("[battery]\nwarn_v = 7.4\nslow_v = 7.0\nstop_v = 6.8\n", Technology::Unknown);
        assert_eq!(own, BatteryLimits { warn_v: 7.4, slow_v: 7.0, stop_v: 6.8 });
        for (section, expected) in [
            ("warn_v = 5.3", BatteryLimits { warn_v: 5.3, slow_v: 5.3, stop_v: 5.2 }),
            ("stop_v = 6.0", BatteryLimits { warn_v: 6.2, slow_v: 6.0, stop_v: 6.0 }),
            ("slow_v = 5.0", BatteryLimits { warn_v: 6.2, slow_v: 5.0, stop_v: 5.0 }),
            ("stop_v = 7.0", BatteryLimits { warn_v: 7.0, slow_v: 7.0, stop_v: 7.0 }),
        ] {
            assert_eq!(
                limits(&format!("[battery]\n{section}\n"), Technology::Unknown),
                expected,
                "{section}"
            );
        }
    }

    #[test]
    fn thresholds_that_make_no_sense_are_refused() {
        for (section, expected) in [
            ("warn_v = 5.0\nstop_v = 6.0", "`warn_v` is 5, which is below `stop_v`, 6"),
            ("stop_v = 3.0", "it can be 4.5 to 13"),
            ("stopp_v = 6.0", "did you mean `stop_v`?"),
        ] {
            let text = format!("{DEFAULT_ROBOT}\n[battery]\n{section}\n");
            let found = RobotConfig::load("robot.toml", text.as_bytes()).unwrap_err().to_string();
            assert!(found.contains(expected), "`{section}`: {found}");
        }
    }
}
