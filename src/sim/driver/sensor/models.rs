//! The sensors there are, with their modes: the tables of `ev3_uart_sensor_defs.c` and
//! `ev3_analog_sensor_defs.c`.

use crate::ev3dev::BinFormat;
use crate::sim::physics::SensorKind;

/// The number with this index in a frame; 0 where the frame is too short. Of the formats, the
/// tables below have only some, all little-endian.
pub(crate) fn decode(format: BinFormat, frame: &[u8], index: usize) -> i32 {
    let mut bytes = [0; 4];
    let start = index * format.size();
    if let (Some(from), Some(to)) =
        (frame.get(start..start + format.size()), bytes.get_mut(..format.size()))
    {
        to.copy_from_slice(from);
    }
    let [low, high, ..] = bytes;
    match format {
        BinFormat::S8 => i32::from(i8::from_le_bytes([low])),
        BinFormat::S16 => i32::from(i16::from_le_bytes([low, high])),
        _ => i32::from_le_bytes(bytes),
    }
}

/// Packs numbers; each keeps its low bytes.
pub(crate) fn encode(format: BinFormat, values: &[i32], frame: &mut [u8]) {
    for (value, bytes) in values.iter().zip(frame.chunks_exact_mut(format.size())) {
        bytes.copy_from_slice(value.to_le_bytes().get(..format.size()).unwrap_or_default());
    }
}

/// One mode.
#[derive(Debug)]
pub(crate) struct Mode {
    pub(crate) name: &'static str,
    pub(crate) values: usize,
    pub(crate) format: BinFormat,
    pub(crate) units: &'static str,
    pub(crate) decimals: u8,
    /// The least and the greatest number that the sensor sends.
    pub(crate) range: (i32, i32),
}

const fn mode(
    name: &'static str,
    values: usize,
    format: BinFormat,
    units: &'static str,
    decimals: u8,
    range: (i32, i32),
) -> Mode {
    Mode { name, values, format, units, decimals, range }
}

const PERCENT: (i32, i32) = (0, 100);
const WHOLE_8: (i32, i32) = (i8::MIN as i32, i8::MAX as i32);
const WHOLE_16: (i32, i32) = (i16::MIN as i32, i16::MAX as i32);
/// The converter of the colour sensor, in steps that a frame of it can have.
const RAW: (i32, i32) = (0, 1020);
const MILLIMETRES: (i32, i32) = (0, 2550);
const TENTHS_OF_INCHES: (i32, i32) = (0, 1003);

/// One type of sensor.
#[derive(Debug)]
pub(crate) struct Model {
    pub(crate) kind: SensorKind,
    /// What worlds call it.
    pub(crate) word: &'static str,
    pub(crate) driver_name: &'static str,
    pub(crate) modes: &'static [Mode],
    /// It speaks over the serial line: modes are switched by message, frames come by themselves.
    pub(crate) uart: bool,
    /// The time between really new values. Ultrasonic, infrared, colour and gyro are models: the
    /// drivers give no figure.
    pub(crate) period_ns: i64,
    /// How long old values stay after a change of mode, within a family of modes.
    pub(crate) settles_ns: i64,
}

impl Model {
    /// The mode of a port for such a sensor.
    pub(crate) fn port_mode(&self) -> &'static str {
        if self.uart { "ev3-uart" } else { "ev3-analog" }
    }
}

static TOUCH: Model = Model {
    kind: SensorKind::Touch,
    word: "touch",
    driver_name: "lego-ev3-touch",
    modes: &[mode("TOUCH", 1, BinFormat::S32, "", 0, (0, 1))],
    uart: false,
    period_ns: 10_000_000,
    settles_ns: 0,
};

static COLOUR: Model = Model {
    kind: SensorKind::Colour,
    word: "colour",
    driver_name: "lego-ev3-color",
    modes: &[
        mode("COL-REFLECT", 1, BinFormat::S8, "pct", 0, PERCENT),
        mode("COL-AMBIENT", 1, BinFormat::S8, "pct", 0, PERCENT),
        mode("COL-COLOR", 1, BinFormat::S8, "col", 0, (0, 7)),
        mode("REF-RAW", 2, BinFormat::S16, "", 0, RAW),
        // The sensor reports one value too few, and the brick's kernel believes it.
        mode("RGB-RAW", 3, BinFormat::S16, "", 0, RAW),
        mode("COL-CAL", 3, BinFormat::U16, "", 0, RAW),
    ],
    uart: true,
    period_ns: 4_000_000,
    settles_ns: 20_000_000,
};

static ULTRASONIC: Model = Model {
    kind: SensorKind::Ultrasonic,
    word: "ultrasonic",
    driver_name: "lego-ev3-us",
    modes: &[
        mode("US-DIST-CM", 1, BinFormat::S16, "cm", 1, MILLIMETRES),
        mode("US-DIST-IN", 1, BinFormat::S16, "in", 1, TENTHS_OF_INCHES),
        mode("US-LISTEN", 1, BinFormat::S8, "", 0, (0, 1)),
        mode("US-SI-CM", 1, BinFormat::S16, "cm", 1, MILLIMETRES),
        mode("US-SI-IN", 1, BinFormat::S16, "in", 1, TENTHS_OF_INCHES),
        mode("US-DC-CM", 1, BinFormat::S16, "cm", 1, MILLIMETRES),
        mode("US-DC-IN", 1, BinFormat::S16, "in", 1, TENTHS_OF_INCHES),
    ],
    uart: true,
    period_ns: 100_000_000,
    settles_ns: 100_000_000,
};

static GYRO: Model = Model {
    kind: SensorKind::Gyro,
    word: "gyro",
    driver_name: "lego-ev3-gyro",
    modes: &[
        mode("GYRO-ANG", 1, BinFormat::S16, "deg", 0, WHOLE_16),
        mode("GYRO-RATE", 1, BinFormat::S16, "d/s", 0, WHOLE_16),
        mode("GYRO-FAS", 1, BinFormat::S16, "", 0, WHOLE_16),
        mode("GYRO-G&A", 2, BinFormat::S16, "", 0, WHOLE_16),
        mode("GYRO-CAL", 4, BinFormat::S16, "", 0, WHOLE_16),
        mode("TILT-RATE", 1, BinFormat::S16, "d/s", 0, WHOLE_16),
        mode("TILT-ANG", 1, BinFormat::S16, "deg", 0, WHOLE_16),
    ],
    uart: true,
    period_ns: 4_000_000,
    settles_ns: 0,
};

static INFRARED: Model = Model {
    kind: SensorKind::Infrared,
    word: "infrared",
    driver_name: "lego-ev3-ir",
    modes: &[
        mode("IR-PROX", 1, BinFormat::S8, "pct", 0, PERCENT),
        mode("IR-SEEK", 8, BinFormat::S8, "pct", 0, WHOLE_8),
        mode("IR-REMOTE", 4, BinFormat::S8, "btn", 0, (0, 11)),
        mode("IR-REM-A", 1, BinFormat::S16, "", 0, WHOLE_16),
        mode("IR-S-ALT", 4, BinFormat::S8, "pct", 0, WHOLE_8),
        mode("IR-CAL", 2, BinFormat::S32, "", 0, WHOLE_16),
    ],
    uart: true,
    period_ns: 50_000_000,
    settles_ns: 50_000_000,
};

/// Every sensor.
pub(crate) static MODELS: [&Model; 5] = [&TOUCH, &COLOUR, &ULTRASONIC, &GYRO, &INFRARED];

/// The model of a sensor.
pub(crate) fn model(kind: SensorKind) -> &'static Model {
    MODELS.into_iter().find(|model| model.kind == kind).unwrap_or(&TOUCH)
}

impl SensorKind {
    /// What worlds call the sensor with a driver; `None` for one that is not simulated.
    #[must_use]
    pub fn word_of(driver: &str) -> Option<&'static str> {
        MODELS.into_iter().find(|model| model.driver_name == driver).map(|model| model.word)
    }
}
