//! Battery and board: classes `power_supply` and `board-info`.

use std::io::Write as _;

use nix::errno::Errno;

use super::text::word;
use super::{Context, Driver, Spec, Wait, line, readable, readwriteable};

/// One step of the 10-bit converter that measures the voltage, in microvolts.
const VOLTAGE_STEP_UV: f64 = 9_775.0;

/// One step of the current, in microamperes.
const CURRENT_STEP_UA: f64 = 6_500.0;

const BATTERY: &[Spec] = &[
    readable("current_now"),
    readable("scope"),
    readwriteable("technology"),
    readable("type"),
    readable("voltage_max_design"),
    readable("voltage_min_design"),
    readable("voltage_now"),
];

/// What the brick is fed from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Pack {
    /// Six AA cells; the kernel says `Unknown`.
    #[default]
    Aa,
    /// LEGO's rechargeable pack, known by its switch.
    LithiumIon,
    /// Six AA cells that the user has declared as rechargeable.
    NickelMetalHydride,
}

impl Pack {
    fn technology(self) -> &'static str {
        match self {
            Self::Aa => "Unknown",
            Self::LithiumIon => "Li-ion",
            Self::NickelMetalHydride => "NiMH",
        }
    }

    /// The design limits as the driver gives them, in microvolts: ten times too large but for NiMH.
    fn design_uv(self) -> (u32, u32) {
        match self {
            Self::Aa => (90_000_000, 48_000_000),
            Self::LithiumIon => (84_000_000, 60_000_000),
            Self::NickelMetalHydride => (7_800_000, 5_400_000),
        }
    }
}

/// `lego-ev3-battery`.
#[derive(Debug)]
pub(crate) struct Battery {
    pack: Pack,
    voltage_v: f64,
    current_a: f64,
}

impl Battery {
    /// A battery with these cells.
    pub(crate) fn new(pack: Pack) -> Self {
        Self { pack, voltage_v: 0.0, current_a: 0.0 }
    }

    /// Takes what the converter sees.
    pub(crate) fn sample(&mut self, (voltage_v, current_a): (f64, f64)) {
        (self.voltage_v, self.current_a) = (voltage_v, current_a);
    }

    fn voltage_uv(&self) -> f64 {
        quantised(self.voltage_v * 1e6, VOLTAGE_STEP_UV)
    }

    fn current_ua(&self) -> f64 {
        quantised(libm::fabs(self.current_a) * 1e6, CURRENT_STEP_UA)
    }
}

/// The nearest whole number of steps, within what a 10-bit converter has.
fn quantised(value: f64, step: f64) -> f64 {
    libm::round((value / step).clamp(0.0, 1023.0)) * step
}

impl Driver for Battery {
    fn attributes(&self) -> &'static [Spec] {
        BATTERY
    }

    fn read(&self, attribute: &str, out: &mut Vec<u8>) -> Result<(), Errno> {
        match attribute {
            "current_now" => line(out, self.current_ua()),
            "scope" => line(out, "System"),
            "technology" => line(out, self.pack.technology()),
            "type" => line(out, "Battery"),
            "voltage_max_design" => line(out, self.pack.design_uv().0),
            "voltage_min_design" => line(out, self.pack.design_uv().1),
            "voltage_now" => line(out, self.voltage_uv()),
            _ => return Err(Errno::ENODEV),
        }
        Ok(())
    }

    fn store(
        &mut self,
        attribute: &str,
        bytes: &[u8],
        _context: &mut Context<'_>,
    ) -> Result<Option<Wait>, Errno> {
        match (attribute, self.pack) {
            ("technology", Pack::Aa) => {
                word(bytes, ["NiMH"])?;
                self.pack = Pack::NickelMetalHydride;
                Ok(None)
            }
            _ => Err(Errno::EINVAL),
        }
    }

    fn uevent(&self, out: &mut Vec<u8>) {
        let (max, min) = self.pack.design_uv();
        let _ = writeln!(
            out,
            "POWER_SUPPLY_NAME=lego-ev3-battery\nPOWER_SUPPLY_TYPE=Battery\n\
             POWER_SUPPLY_TECHNOLOGY={}\n\
             POWER_SUPPLY_VOLTAGE_MAX_DESIGN={max}\nPOWER_SUPPLY_VOLTAGE_MIN_DESIGN={min}\n\
             POWER_SUPPLY_VOLTAGE_NOW={}\nPOWER_SUPPLY_CURRENT_NOW={}\nPOWER_SUPPLY_SCOPE=System",
            self.pack.technology(),
            self.voltage_uv(),
            self.current_ua(),
        );
    }
}

/// `board0`: everything is in its `uevent`.
#[derive(Debug)]
pub(crate) struct Board {
    serial: String,
}

impl Board {
    /// A brick whose serial number tells the robots of one simulation apart.
    pub(crate) fn new(robot: usize) -> Self {
        Self { serial: format!("0016535{robot:05X}") }
    }
}

impl Driver for Board {
    fn attributes(&self) -> &'static [Spec] {
        &[]
    }

    fn read(&self, _attribute: &str, _out: &mut Vec<u8>) -> Result<(), Errno> {
        Err(Errno::ENODEV)
    }

    fn store(
        &mut self,
        _attribute: &str,
        _bytes: &[u8],
        _context: &mut Context<'_>,
    ) -> Result<Option<Wait>, Errno> {
        Err(Errno::EIO)
    }

    fn uevent(&self, out: &mut Vec<u8>) {
        let _ = writeln!(
            out,
            "BOARD_INFO_HW_REV=7\nBOARD_INFO_MODEL=LEGO MINDSTORMS EV3\nBOARD_INFO_ROM_REV=6\n\
             BOARD_INFO_SERIAL_NUM={}\nBOARD_INFO_TYPE=main",
            self.serial
        );
    }
}
