//! Battery and board: classes `power_supply` and `board-info`.

use std::io::Write as _;

use nix::errno::Errno;

use super::text::word;
use super::{Attributes, Context, Driver, Took, line};
use crate::ev3dev::Technology;
use crate::sim::board::Board;

/// One step of the current, in microamperes.
const CURRENT_STEP_UA: f64 = 6_500.0;

/// The cells of which physics knows the voltage.
const CELLS: f64 = 6.0;

/// The design limits as the driver gives them, in microvolts: ten times too large but for NiMH.
fn design_uv(cells: Technology) -> (u32, u32) {
    match cells {
        Technology::Unknown => (90_000_000, 48_000_000),
        Technology::LiIon => (84_000_000, 60_000_000),
        Technology::NiMh => (7_800_000, 5_400_000),
    }
}

/// A board's battery: what its driver knows.
#[derive(Debug)]
pub(crate) struct Battery {
    board: &'static Board,
    cells: Technology,
    voltage_v: f64,
    current_a: f64,
}

impl Battery {
    /// A board's battery with these cells.
    pub(crate) fn new(cells: Technology, board: &'static Board) -> Self {
        Self { board, cells, voltage_v: 0.0, current_a: 0.0 }
    }

    /// Takes what the converter sees.
    pub(crate) fn sample(&mut self, (voltage_v, current_a): (f64, f64)) {
        let cells = f64::from(self.board.platform.cells);
        (self.voltage_v, self.current_a) = (voltage_v * cells / CELLS, current_a);
    }
}

/// The nearest whole number of steps, within what a 10-bit converter has; those of other boards
/// have more.
fn quantised(value: f64, step: f64) -> f64 {
    let most = if step < 9_000.0 { 65_535.0 } else { 1023.0 };
    libm::round((value / step).clamp(0.0, most)) * step
}

impl Driver for Battery {
    fn attributes(&self) -> Attributes {
        [self.board.battery.attributes, &[]]
    }

    fn read(&self, attribute: &str, out: &mut Vec<u8>) -> Result<(), Errno> {
        let (most_uv, least_uv) = design_uv(self.cells);
        match attribute {
            "current_now" => {
                line(out, quantised(libm::fabs(self.current_a) * 1e6, CURRENT_STEP_UA));
            }
            "present" => line(out, 1),
            "status" => line(out, "Discharging"),
            "scope" => line(out, "System"),
            "technology" => line(out, self.cells),
            "type" => line(out, "Battery"),
            "voltage_max_design" => line(out, most_uv),
            "voltage_min_design" => line(out, least_uv),
            "voltage_now" => {
                line(out, quantised(self.voltage_v * 1e6, self.board.battery.step_uv));
            }
            _ => return Err(Errno::ENODEV),
        }
        Ok(())
    }

    fn store(&mut self, attribute: &str, bytes: &[u8], _context: &mut Context<'_>) -> Took {
        match (attribute, self.cells) {
            ("technology", Technology::Unknown) => {
                word(bytes, [Technology::NiMh.as_str()])?;
                self.cells = Technology::NiMh;
                Ok(None)
            }
            _ => Err(Errno::EINVAL),
        }
    }

    fn uevent(&self, out: &mut Vec<u8>) {
        let _ = writeln!(out, "POWER_SUPPLY_NAME={}", self.board.platform.battery);
        // The order in which the EV3's driver has them.
        for attribute in [
            "type",
            "status",
            "present",
            "technology",
            "voltage_max_design",
            "voltage_min_design",
            "voltage_now",
            "current_now",
            "scope",
        ] {
            if self.board.battery.attributes.iter().any(|spec| spec.name == attribute) {
                let _ = write!(out, "POWER_SUPPLY_{}=", attribute.to_ascii_uppercase());
                let _ = self.read(attribute, out);
            }
        }
    }
}

/// `board0`: everything is in its `uevent`.
#[derive(Debug)]
pub(crate) struct BoardInfo {
    says: &'static [&'static str],
    serial: String,
}

impl BoardInfo {
    /// A board that says these things of itself, and whose serial number tells the robots of one
    /// simulation apart.
    pub(crate) fn new(robot: usize, says: &'static [&'static str]) -> Self {
        Self { says, serial: format!("0016535{robot:05X}") }
    }
}

impl Driver for BoardInfo {
    fn uevent(&self, out: &mut Vec<u8>) {
        for says in self.says {
            // The kernel sorts them.
            if *says == "TYPE=main" {
                let _ = writeln!(out, "BOARD_INFO_SERIAL_NUM={}", self.serial);
            }
            let _ = writeln!(out, "BOARD_INFO_{says}");
        }
    }
}
