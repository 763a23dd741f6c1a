//! The boards, one row each. Where each fact is from stands in the module above.

use super::{FrameBuffer, Hue, Lamp, Platform};

const fn lamp(hue: Hue, led: &'static str) -> Lamp {
    Lamp { hue, led }
}

const LETTERED: [&str; 4] = ["outA", "outB", "outC", "outD"];
const NUMBERED: [&str; 4] = ["in1", "in2", "in3", "in4"];

const NO_SCREEN: &str = "it has no screen of its own";

/// LEGO's EV3 (`ev3dev-interfaces`, 2 to 12).
pub static EV3: Platform = Platform {
    what: "EV3",
    name: "ev3",
    models: &["LEGO MINDSTORMS EV3"],
    parent: "ev3-ports",
    inputs: NUMBERED,
    outputs: LETTERED,
    detects: true,
    buttons: Some("dev/input/by-path/platform-gpio_keys-event"),
    stop_buttons: "Enter and Back",
    poll_ns: 10_000_000,
    speaker: Some("dev/input/by-path/platform-sound-event"),
    lights: [
        &[lamp(Hue::Red, "led0:red:brick-status"), lamp(Hue::Green, "led0:green:brick-status")],
        &[lamp(Hue::Red, "led1:red:brick-status"), lamp(Hue::Green, "led1:green:brick-status")],
    ],
    battery: "lego-ev3-battery",
    cells: 6,
    most_v: 10.0,
    screen: Ok(FrameBuffer { device: "dev/fb0", description: "sys/class/graphics/fb0" }),
};

/// Dexter Industries' BrickPi3 on a Raspberry Pi. Up to four can be stacked, and `led1` belongs to
/// the first; the others' ports (`ME`, `S5` and on) can be named in full.
pub static BRICKPI3: Platform = Platform {
    what: "BrickPi3",
    name: "brickpi3",
    models: &["Dexter Industries BrickPi3"],
    parent: "spi0.1",
    inputs: ["S1", "S2", "S3", "S4"],
    outputs: ["MA", "MB", "MC", "MD"],
    detects: false,
    buttons: None,
    stop_buttons: "",
    poll_ns: 10_000_000,
    speaker: None,
    lights: [&[lamp(Hue::Only, "led1:amber:brick-status")], &[]],
    battery: "brickpi3-battery",
    cells: 8,
    most_v: 13.0,
    screen: Err(NO_SCREEN),
};

/// Dexter Industries' BrickPi and BrickPi+ on a Raspberry Pi, which say the same of themselves; the
/// first BrickPi has no battery that can be read.
pub static BRICKPI: Platform = Platform {
    what: "BrickPi+",
    name: "brickpi",
    models: &["Dexter Industries BrickPi"],
    parent: "serial0-0",
    inputs: ["S1", "S2", "S3", "S4"],
    outputs: ["MA", "MB", "MC", "MD"],
    detects: false,
    buttons: None,
    stop_buttons: "",
    poll_ns: 4_000_000,
    speaker: None,
    lights: [
        &[lamp(Hue::Only, "led1:blue:brick-status")],
        &[lamp(Hue::Only, "led2:blue:brick-status")],
    ],
    battery: "brickpi-battery",
    cells: 8,
    most_v: 13.0,
    screen: Err(NO_SCREEN),
};

/// mindsensors' PiStorms on a Raspberry Pi 2 or 3. Its driver reads sensors once a second
/// (`PS_DEFAULT_POLL_MS`), and takes speeds in steps of 8 degrees a second, none below 58
/// (`ms_nxtmmx_scale_speed`).
pub static PISTORMS: Platform = Platform {
    what: "PiStorms",
    name: "pistorms",
    models: &["PiStorms"],
    parent: "pistorms",
    inputs: ["BAS1", "BAS2", "BBS1", "BBS2"],
    outputs: ["BAM1", "BAM2", "BBM1", "BBM2"],
    detects: false,
    buttons: Some("dev/input/by-path/platform-3f804000.i2c-event"),
    stop_buttons: "GO",
    poll_ns: 1_000_000_000,
    speaker: None,
    lights: [
        &[
            lamp(Hue::Red, "pistorms:BB:red:brick-status"),
            lamp(Hue::Green, "pistorms:BB:green:brick-status"),
            lamp(Hue::Blue, "pistorms:BB:blue:brick-status"),
        ],
        &[
            lamp(Hue::Red, "pistorms:BA:red:brick-status"),
            lamp(Hue::Green, "pistorms:BA:green:brick-status"),
            lamp(Hue::Blue, "pistorms:BA:blue:brick-status"),
        ],
    ],
    battery: "pistorms-battery",
    cells: 6,
    most_v: 10.5,
    screen: Err("its screen is another one, and GO is its only button"),
};

/// FatcatLab's EVB on a BeagleBone, with the EV3's ports and keys; a QuestCape is one as well.
pub static EVB: Platform = Platform {
    what: "EVB",
    name: "evb",
    models: &["FatcatLab EVB", "QuestCape"],
    parent: "evb-ports",
    inputs: NUMBERED,
    outputs: LETTERED,
    detects: true,
    buttons: Some("dev/input/by-path/platform-evb-buttons-event"),
    stop_buttons: "Enter and Back",
    poll_ns: 10_000_000,
    speaker: None,
    lights: [&[], &[]],
    battery: "evb-battery",
    cells: 6,
    most_v: 10.0,
    screen: Err("its screen is another one"),
};
