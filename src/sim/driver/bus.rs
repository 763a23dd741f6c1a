//! What the kernel adds to every device, and a device of the bus `lego`: what is plugged into a
//! port, bound to a driver (`core/lego_bus.c`). The device of a class, which programs use, lies
//! below it.

use nix::errno::Errno;

use super::text::word;
use super::{Attributes, Driver, Identity, lego_uevent, line, readable, readwriteable};
use crate::ev3dev::AttributeSpec;
use crate::sim::board::Board;

/// Runtime power management, which no driver of the brick takes part in
/// (`drivers/base/power/sysfs.c`).
pub(crate) static POWER: [AttributeSpec; 5] = [
    readwriteable("power/autosuspend_delay_ms"),
    readwriteable("power/control"),
    readable("power/runtime_active_time"),
    readable("power/runtime_status"),
    readable("power/runtime_suspended_time"),
];

/// The words of `power/control`; the first is in force at the start, and neither has an effect.
const CONTROLS: [&str; 2] = ["auto", "on"];

/// Appends the text of a file of [`POWER`].
///
/// # Errors
///
/// EIO for the delay of a device that never suspends itself.
pub(crate) fn read_power(attribute: &str, out: &mut Vec<u8>) -> Result<(), Errno> {
    match attribute {
        "power/control" => line(out, CONTROLS[0]),
        "power/runtime_status" => line(out, "unsupported"),
        "power/autosuspend_delay_ms" => return Err(Errno::EIO),
        _ => line(out, 0),
    }
    Ok(())
}

/// Takes what is written to a file of [`POWER`].
///
/// # Errors
///
/// EIO for the delay, EINVAL for any other word than those of `power/control`.
pub(crate) fn store_power(attribute: &str, bytes: &[u8]) -> Result<(), Errno> {
    if attribute == "power/autosuspend_delay_ms" {
        Err(Errno::EIO)
    } else {
        word(bytes, CONTROLS).map(drop)
    }
}

/// A device of the bus.
#[derive(Debug)]
pub(crate) struct BusDevice {
    /// The driver that it is bound to, of [`BusDevice::drivers`].
    pub(crate) driver: &'static str,
    /// What was plugged in, under the name that its class gives it.
    pub(crate) identity: Identity,
}

impl BusDevice {
    /// Every driver of the bus that a simulated board has.
    pub(crate) fn drivers(board: &Board) -> impl Iterator<Item = &'static str> {
        board.bus.into_iter().chain(["rcx-led", "rcx-motor"])
    }
}

impl Driver for BusDevice {
    fn attributes(&self) -> Attributes {
        const ATTRIBUTES: &[AttributeSpec] = &[readable("modalias")];
        [ATTRIBUTES, &[]]
    }

    fn read(&self, attribute: &str, out: &mut Vec<u8>) -> Result<(), Errno> {
        if attribute != "modalias" {
            return Err(Errno::ENODEV);
        }
        line(out, format_args!("lego:{}", self.driver));
        Ok(())
    }

    fn uevent(&self, out: &mut Vec<u8>) {
        let driver = self.driver;
        line(out, format_args!("DEVTYPE={driver}\nDRIVER={driver}"));
        lego_uevent(out, &self.identity);
        line(out, format_args!("MODALIAS=lego:{driver}"));
    }
}
