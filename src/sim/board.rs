//! The boards that can be simulated: what their drivers do otherwise than the EV3's. What programs
//! must know of a board stands in [`Platform`]; the sources of both are named there.
//!
//! # Not here
//!
//! - The controllers of BrickPi3 and PiStorms regulate in firmware that we have not read: the
//!   EV3's regulator stands in for theirs.
//! - Motors without an encoder, lamps, and the folders of devices that are no port's, are the
//!   EV3's on each board; NXT and I²C sensors are on none.
//! - What stands above a port in `sys/devices` is as good as known for the Raspberry Pi, and not
//!   for the BeagleBone.

use crate::ev3dev::{
    self, AttributeSpec, BRICKPI, BRICKPI3, EV3, EVB, PISTORMS, Platform, StopAction,
};
use crate::sim::driver::readable;
use crate::sim::ports::Port;

/// A board as the kernel shows it.
#[derive(Debug)]
pub(crate) struct Board {
    pub(crate) platform: &'static Platform,
    /// The ports' parent below `sys/devices`.
    pub(crate) parent: &'static str,
    /// Each port is a device of its own there.
    pub(crate) nested: bool,
    pub(crate) inputs: PortKind,
    pub(crate) outputs: PortKind,
    /// The drivers on the bus `lego`: of analog sensors, of serial ones, of motors.
    pub(crate) bus: [&'static str; 3],
    pub(crate) motors: MotorDriver,
    pub(crate) battery: Supply,
    /// How bright an LED can be.
    pub(crate) brightest: u32,
    /// What the boards say of themselves, before a serial number; the EV3 is one board.
    pub(crate) boards: &'static [&'static [&'static str]],
}

/// A driver of ports.
#[derive(Debug)]
pub(crate) struct PortKind {
    pub(crate) driver: &'static str,
    pub(crate) modes: &'static [&'static str],
}

/// What a driver of motors does otherwise.
#[derive(Debug)]
pub(crate) struct MotorDriver {
    pub(crate) stop_actions: &'static [StopAction],
    /// It has `run-direct`.
    pub(crate) direct: bool,
    /// `speed` and `duty_cycle` can be read.
    pub(crate) rates: bool,
    /// The gains can be read and written.
    pub(crate) gains: bool,
    /// `state` says `stalled`.
    pub(crate) stalls: bool,
    /// A motor that holds says that it runs, too.
    pub(crate) holding_runs: bool,
    /// A position is refused while the motor is driven (EBUSY).
    pub(crate) still_for_position: bool,
    /// A position other than 0 is refused.
    pub(crate) zero_only: bool,
    /// `duty_cycle` is of 255, and scaled once too often.
    pub(crate) odd_duty: bool,
    /// The speed that comes of one that was asked for.
    pub(crate) speed: fn(i32) -> i32,
}

/// A battery's driver.
#[derive(Debug)]
pub(crate) struct Supply {
    pub(crate) attributes: &'static [AttributeSpec],
    /// One step of the voltage, microvolts.
    pub(crate) step_uv: f64,
}

const EV3_MOTORS: MotorDriver = MotorDriver {
    stop_actions: StopAction::ALL,
    direct: true,
    rates: true,
    gains: true,
    stalls: true,
    holding_runs: false,
    still_for_position: false,
    zero_only: false,
    odd_duty: false,
    speed: |speed| speed,
};

const EV3_INPUTS: PortKind = PortKind {
    driver: "ev3-input-port",
    modes: &[
        "auto",
        "nxt-analog",
        "nxt-color",
        "nxt-i2c",
        "other-i2c",
        "ev3-analog",
        "ev3-uart",
        "other-uart",
        "raw",
    ],
};

const EV3_OUTPUTS: PortKind = PortKind {
    driver: "ev3-output-port",
    modes: &["auto", "tacho-motor", "dc-motor", "led", "raw"],
};

const BRICKPI_INPUT_MODES: &[&str] =
    &["none", "nxt-analog", "nxt-color", "nxt-i2c", "ev3-analog", "ev3-uart"];

const BRICKPI_OUTPUT_MODES: &[&str] = &["tacho-motor", "dc-motor", "led"];

/// A driver that only knows the voltage.
const VOLTAGE_ONLY: &[AttributeSpec] =
    &[readable("scope"), readable("type"), readable("voltage_now")];

const WITH_STATUS: &[AttributeSpec] = &[
    readable("present"),
    readable("scope"),
    readable("status"),
    readable("technology"),
    readable("type"),
    readable("voltage_now"),
];

const RASPBERRY_PI: &[&str] =
    &["HW_REV=A02082", "MODEL=Raspberry Pi 3 Model B Rev 1.2", "TYPE=main"];

/// The drivers of sensors and motors on boards whose ports are served by another controller.
const REMOTE: [&str; 3] = ["ev3-analog-sensor", "ev3-uart-sensor", "ev3-motor"];

/// Every board, in the order of [`PLATFORMS`](crate::ev3dev::PLATFORMS).
static BOARDS: [Board; 5] = [
    Board {
        platform: &EV3,
        parent: "platform/ev3-ports",
        nested: true,
        inputs: EV3_INPUTS,
        outputs: EV3_OUTPUTS,
        bus: ["ev3-analog-sensor", "ev3-uart-host", "legoev3-motor"],
        motors: EV3_MOTORS,
        battery: Supply { attributes: ev3dev::Battery::ATTRIBUTES, step_uv: 9_775.0 },
        brightest: 255,
        boards: &[&["HW_REV=7", "MODEL=LEGO MINDSTORMS EV3", "ROM_REV=6", "TYPE=main"]],
    },
    Board {
        platform: &BRICKPI3,
        parent: "platform/soc/3f204000.spi/spi_master/spi0/spi0.1",
        nested: false,
        inputs: PortKind { driver: "brickpi3-in-port", modes: BRICKPI_INPUT_MODES },
        outputs: PortKind { driver: "brickpi3-out-port", modes: BRICKPI_OUTPUT_MODES },
        bus: REMOTE,
        motors: MotorDriver { gains: false, stalls: false, holding_runs: true, ..EV3_MOTORS },
        battery: Supply { attributes: VOLTAGE_ONLY, step_uv: 1_000.0 },
        brightest: 100,
        boards: &[
            RASPBERRY_PI,
            &["FW_VER=1.4.6", "HW_REV=3.2.1", "MODEL=Dexter Industries BrickPi3", "TYPE=aux"],
        ],
    },
    Board {
        platform: &BRICKPI,
        parent: "platform/soc/3f201000.serial/serial0/serial0-0",
        nested: false,
        inputs: PortKind { driver: "brickpi-in-port", modes: BRICKPI_INPUT_MODES },
        outputs: PortKind { driver: "brickpi-out-port", modes: BRICKPI_OUTPUT_MODES },
        bus: REMOTE,
        motors: MotorDriver {
            stop_actions: &[StopAction::Coast, StopAction::Hold],
            still_for_position: true,
            odd_duty: true,
            ..EV3_MOTORS
        },
        battery: Supply { attributes: WITH_STATUS, step_uv: 17_725.0 },
        brightest: 255,
        boards: &[RASPBERRY_PI, &["FW_VER=2", "MODEL=Dexter Industries BrickPi", "TYPE=aux"]],
    },
    Board {
        platform: &PISTORMS,
        parent: "platform/soc/3f804000.i2c/i2c-1/1-001a",
        nested: false,
        inputs: PortKind {
            driver: "pistorms-in-port",
            modes: &["none", "nxt-analog", "nxt-color", "i2c-thru", "ev3-analog", "ev3-uart"],
        },
        outputs: PortKind { driver: "ms-nxtmmx-out-port", modes: &["tacho-motor"] },
        bus: REMOTE,
        motors: MotorDriver {
            direct: false,
            rates: false,
            holding_runs: true,
            still_for_position: true,
            zero_only: true,
            speed: pistorms_speed,
            ..EV3_MOTORS
        },
        battery: Supply { attributes: WITH_STATUS, step_uv: 40_000.0 },
        brightest: 255,
        boards: &[RASPBERRY_PI, &["FW_VER=V2.06", "MODEL=PiStorms", "TYPE=aux"]],
    },
    Board {
        platform: &EVB,
        parent: "platform/evb-ports",
        nested: true,
        inputs: EV3_INPUTS,
        outputs: EV3_OUTPUTS,
        bus: ["ev3-analog-sensor", "ev3-uart-host", "legoev3-motor"],
        motors: EV3_MOTORS,
        battery: Supply { attributes: VOLTAGE_ONLY, step_uv: 2_677.0 },
        brightest: 255,
        boards: &[&["MODEL=TI AM335x BeagleBone Black", "TYPE=main"], &["MODEL=FatcatLab EVB"]],
    },
];

impl Board {
    /// The board of a platform.
    pub(crate) fn of(platform: &Platform) -> &'static Self {
        let [ev3, ..] = &BOARDS;
        BOARDS.iter().find(|board| board.platform == platform).unwrap_or(ev3)
    }

    /// A port's address.
    pub(crate) fn address(&self, port: Port) -> String {
        let name = self.platform.ports().nth(port.index()).unwrap_or_default();
        format!("{}:{name}", self.platform.parent)
    }

    /// How often a controller reads sensors for the driver, nanoseconds; `None` where they send.
    pub(crate) fn polls_ns(&self) -> Option<i64> {
        (!self.platform.detects).then_some(self.platform.poll_ns)
    }
}

/// `ms_nxtmmx_scale_speed`: nothing up to 50 degrees a second, then steps of 8.
fn pistorms_speed(speed: i32) -> i32 {
    let steps = (speed.saturating_abs().saturating_sub(50) / 8).clamp(0, 100);
    if steps == 0 { 0 } else { (50 + 8 * steps) * speed.signum() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ev3dev::PLATFORMS;

    #[test]
    fn every_platform_has_a_board() {
        for platform in PLATFORMS {
            assert_eq!(Board::of(platform).platform, platform);
        }
    }

    #[test]
    fn the_pistorms_takes_speeds_in_steps() {
        let speeds = [0, 50, 57, 58, 60, 66, -100, 2000, i32::MIN];
        assert_eq!(speeds.map(pistorms_speed), [0, 0, 0, 58, 58, 66, -98, 850, -850]);
    }
}
