//! Sensors: every one of class `lego-sensor`, and typed ones for LEGO's EV3 set.
//!
//! A [`Sensor`] is any sensor, with its own modes, units and decimals: NXT, I²C, an unknown UART
//! device. A [`TypedSensor`] knows what its values mean and gives them in SI units:
//! [`TouchSensor`], [`ColourSensor`], [`UltrasonicSensor`], [`GyroSensor`], [`InfraredSensor`].
//!
//! A mode is written only when it changes, and read back. The first values after a change may still
//! be those that the mode had when it was last left, 0 if it was never used, or nonsense;
//! [`Sensor::set_mode`] says for how long, and the caller waits, because only `clock` sleeps. A
//! mode is left as it is when a sensor is bound, and a sensor keeps the mode of the program before:
//! always set the one that is needed.
//!
//! # Not here
//!
//! The factory's modes: COL-CAL, GYRO-CAL and IR-CAL; in COL-CAL and IR-S-ALT the sensor stops
//! answering and restarts (section 6.3 of the interfaces' reference). The colour sensor's factory
//! string is never written: it would overwrite its calibration for good.

mod colour;
mod frame;
mod gyro;
mod infrared;
mod touch;
mod typed;
mod ultrasonic;

pub use colour::{Colour, ColourMode, ColourSensor, RawReflection, RawRgb};
pub use frame::Frame;
pub use gyro::{AngleAndRate, GyroMode, GyroReset, GyroSensor};
pub use infrared::{Beacon, InfraredMode, InfraredSensor, RemoteButtons, RemoteCode};
pub use touch::{TouchMode, TouchSensor};
pub use typed::{SensorMode, TypedSensor};
pub use ultrasonic::{MIN_PING_INTERVAL_NS, UltrasonicMode, UltrasonicSensor};

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use super::address::PortAddress;
use super::error::{Cause, DeviceError, FindError};
use super::find::{Class, Identity, find, find_where};
use super::node::{Attribute, AttributeSpec, Node, attributes};
use super::tree::Tree;
use super::value::{AttributeText, Legal, Value, Word, Words};
use super::words::{BinFormat, Driver};
use crate::clock::MILLISECOND_NS;

/// Any sensor, with its own modes, units and decimals.
#[derive(Debug)]
pub struct Sensor {
    pub(crate) node: Node,
    files: SensorFiles,
    bin_data: Attribute<()>,
    direct: Attribute<()>,
    identity: Identity,
    modes: Words,
    mode: Mode,
}

/// What the driver says of the mode in force.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Mode {
    /// Its name; empty when it is not known, because a change failed.
    pub name: Word,
    /// How many values it has. The driver may say more than the eight that have files.
    pub num_values: usize,
    /// A value is its text divided by ten to the power of this.
    pub decimals: usize,
    /// The values' unit as the driver writes it; may be empty.
    pub units: Word,
    /// How `bin_data` is laid out.
    pub format: BinFormat,
}

attributes! {
    /// The class's attributes that are text.
    SensorFiles of [impl Sensor] {
        /// Where the sensor is plugged in, as the kernel says now.
        pub readable "address" => address: PortAddress;
        /// What the sensor is.
        pub readable "driver_name" => driver_name: Word;
        /// The modes that the sensor says it has, read each time.
        pub readable "modes" => read_modes: Words;
        readwriteable "mode" => mode_word / write_mode: Word;
        /// The commands that the driver takes; none for the sensors of the EV3.
        pub readable "commands" => commands: Words;
        writeable "command" => write_command: Word;
        readable "num_values" => num_values: i32, Legal::Range(0, 255);
        readable "decimals" => decimals: i32, Legal::Range(0, 9);
        readable "units" => units: Word;
        readable "bin_data_format" => bin_data_format: BinFormat;
        /// Time between two polls of an I²C or NXT sensor, ms; other sensors have none.
        pub readwriteable "poll_ms" => poll_ms / set_poll_ms: i32, Legal::NOT_NEGATIVE;
        /// Version of the sensor's own program; empty for most.
        pub readable "fw_version" => fw_version: Word;
        /// The text of the few I²C sensors that give one.
        pub readable "text_value" => text_value: Word;
        readable "value0" => value0: i32;
        readable "value1" => value1: i32;
        readable "value2" => value2: i32;
        readable "value3" => value3: i32;
        readable "value4" => value4: i32;
        readable "value5" => value5: i32;
        readable "value6" => value6: i32;
        readable "value7" => value7: i32;
    }
}

const BIN_DATA: AttributeSpec = AttributeSpec::readable("bin_data", Legal::Bytes);
const DIRECT: AttributeSpec = AttributeSpec::readwriteable("direct", Legal::Bytes);

impl Sensor {
    /// The class's attributes that are bytes.
    pub const BINARY_ATTRIBUTES: &'static [AttributeSpec] = &[BIN_DATA, DIRECT];

    /// The sensor at a port, whatever it is.
    ///
    /// # Errors
    ///
    /// [`FindError`], which says what there is instead.
    pub fn at(tree: &Arc<dyn Tree>, port: &PortAddress) -> Result<Self, FindError> {
        Self::find(tree, Some(port), None)
    }

    /// The one sensor at `port`, if given, with the driver `driver`, if given.
    ///
    /// # Errors
    ///
    /// [`FindError`], which says what there is instead.
    pub fn find(
        tree: &Arc<dyn Tree>,
        port: Option<&PortAddress>,
        driver: Option<&str>,
    ) -> Result<Self, FindError> {
        Ok(Self::bind(tree, find(tree, Class::LegoSensor, port, driver)?)?)
    }

    /// The one sensor of a kind that this program knows, at `port`, if given.
    ///
    /// # Errors
    ///
    /// [`FindError`], which says what there is instead.
    pub fn find_kind(
        tree: &Arc<dyn Tree>,
        port: Option<&PortAddress>,
        driver: Driver,
    ) -> Result<Self, FindError> {
        let fits = |identity: &Identity| identity.known_driver() == Some(driver);
        Ok(Self::bind(tree, find_where(tree, Class::LegoSensor, port, driver.what(), fits)?)?)
    }

    /// The sensor that was found as `identity`, in the mode that it is in.
    ///
    /// # Errors
    ///
    /// Whatever comes of reading its modes.
    pub fn bind(tree: &Arc<dyn Tree>, identity: Identity) -> Result<Self, DeviceError> {
        let node = identity.node(tree);
        let files = SensorFiles::new();
        let modes = files.read_modes.read(&node)?;
        let (bin_data, direct) = (Attribute::new(BIN_DATA), Attribute::new(DIRECT));
        let mut sensor =
            Self { node, files, bin_data, direct, identity, modes, mode: Mode::default() };
        sensor.refresh_mode()?;
        Ok(sensor)
    }

    /// What identifies the sensor, as it was found.
    #[must_use]
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// The modes that the sensor says it has.
    #[must_use]
    pub fn modes(&self) -> &Words {
        &self.modes
    }

    /// The mode in force, as far as this program knows: no other program should change it.
    #[must_use]
    pub fn mode(&self) -> &Mode {
        &self.mode
    }

    /// Puts the sensor into a mode, if it is not in it, and reads it back. Returns for how many
    /// nanoseconds values are to be discarded from now on; 0 if nothing had to be written. A UART
    /// sensor blocks the writer until it answers, up to half a second.
    ///
    /// # Errors
    ///
    /// [`Cause::Refused`] for a mode that the sensor does not have, and where it reads back
    /// another; [`Cause::Other`] with ETIMEDOUT where the sensor does not answer; [`Cause::Gone`].
    pub fn set_mode(&mut self, mode: &str) -> Result<i64, DeviceError> {
        if self.mode.name.as_str() == mode {
            return Ok(0);
        }
        let word = match Word::from(mode) {
            Ok(word) if self.modes.contains(mode) => word,
            _ => return Err(self.node.refusal("mode", mode, self.modes.as_legal())),
        };
        let before = self.mode.name;
        self.write_and_read_back(word)?;
        Ok(settle_ns(self.identity.known_driver(), &before, mode))
    }

    /// Writes the mode in force once more, which makes a single-shot mode measure, and zeroes some
    /// sensors.
    ///
    /// # Errors
    ///
    /// As [`Sensor::set_mode`].
    pub fn rewrite_mode(&mut self) -> Result<(), DeviceError> {
        self.write_and_read_back(self.mode.name)
    }

    /// Looks at the mode that is really in force; true if it is the one that was thought to be.
    ///
    /// # Errors
    ///
    /// Whatever comes of reading it.
    pub fn refresh_mode(&mut self) -> Result<bool, DeviceError> {
        let mode = self.mode_in_force()?;
        let same = mode.name == self.mode.name;
        self.mode = mode;
        Ok(same)
    }

    /// A value as its text says, not yet divided by ten to the power of `decimals`.
    ///
    /// # Errors
    ///
    /// [`Cause::Absent`] for a value that the mode in force does not have; [`Cause::Gone`] also
    /// while a UART sensor is coming back.
    pub fn raw_value(&self, index: usize) -> Result<i32, DeviceError> {
        match index {
            0 => self.value0(),
            1 => self.value1(),
            2 => self.value2(),
            3 => self.value3(),
            4 => self.value4(),
            5 => self.value5(),
            6 => self.value6(),
            7 => self.value7(),
            _ => Err(self.node.error("value7", None, Cause::Absent(nix::errno::Errno::ENXIO))),
        }
    }

    /// A value in the unit of the mode in force.
    ///
    /// # Errors
    ///
    /// As [`Sensor::raw_value`].
    pub fn value(&self, index: usize) -> Result<f64, DeviceError> {
        Ok(f64::from(self.raw_value(index)?) / ten_to_the(self.mode.decimals))
    }

    /// All values of one moment, as the sensor sent them: one read, one frame. For the UART sensors
    /// of the EV3 they are the values; the touch sensor's are millivolts, and an I²C sensor's may
    /// still have to be scaled by its driver, so read those by [`Sensor::value`].
    ///
    /// # Errors
    ///
    /// [`Cause::Malformed`] if there are fewer bytes than the mode says.
    pub fn frame(&self) -> Result<Frame, DeviceError> {
        let mut bytes = [0; Frame::SIZE];
        let length = self.bin_data.read_bytes(&self.node, &mut bytes)?;
        Frame::new(bytes, length, self.mode.format, self.mode.num_values)
            .ok_or_else(|| self.malformed_frame())
    }

    pub(crate) fn malformed_frame(&self) -> DeviceError {
        self.node.error("bin_data", None, Cause::Malformed(Legal::Bytes))
    }

    /// Gives one of the sensor's own commands.
    ///
    /// # Errors
    ///
    /// [`Cause::Refused`] for a command that the sensor does not have; LEGO's EV3 sensors have
    /// none.
    pub fn command(&self, command: &str) -> Result<(), DeviceError> {
        let commands = self.commands()?;
        match Word::from(command) {
            Ok(word) if commands.contains(command) => self.write_command(word),
            _ => Err(self.node.refusal("command", command, commands.as_legal())),
        }
    }

    /// Sends bytes to the sensor itself: 1 to 32 for a UART sensor. Never a colour sensor's factory
    /// string.
    ///
    /// # Errors
    ///
    /// [`Cause::Refused`] for a wrong number of bytes, for anything to a colour sensor, and where
    /// the sensor has no such way in.
    pub fn write_direct(&self, bytes: &[u8]) -> Result<(), DeviceError> {
        // All that the colour sensor understands here would overwrite its calibration for good.
        let is_colour = self.identity.known_driver() == Some(Driver::Colour);
        if is_colour || bytes.is_empty() || bytes.len() > 32 {
            let cause = Cause::Refused { errno: None, legal: Legal::Bytes };
            return Err(self.node.error("direct", Some(bytes), cause));
        }
        self.direct.write_bytes(&self.node, bytes)
    }

    /// Waits until the first value changes, or until `timeout`; true if it did. Only touch sensors
    /// ever say so.
    ///
    /// # Errors
    ///
    /// What `poll` answers.
    pub fn wait_changed(&self, timeout: Duration) -> Result<bool, DeviceError> {
        self.files.value0.wait_changed(&self.node, timeout)
    }

    /// The first value, not yet divided by ten to the power of `decimals`, which must be legal.
    ///
    /// # Errors
    ///
    /// [`Cause::Malformed`] beyond `first` to `last`; else as [`Sensor::raw_value`].
    pub fn first_value_within(&self, first: i32, last: i32) -> Result<i32, DeviceError> {
        let value = self.value0()?;
        if (first..=last).contains(&value) {
            Ok(value)
        } else {
            Err(self.illegal(value, first, last))
        }
    }

    pub(super) fn illegal(&self, value: i32, first: i32, last: i32) -> DeviceError {
        let mut text = AttributeText::new();
        // Eleven digits fit.
        let _ = fmt::Write::write_fmt(&mut text, format_args!("{value}"));
        let cause = Cause::Malformed(Legal::Range(first.into(), last.into()));
        self.node.error("value0", Some(text.as_bytes()), cause)
    }

    fn write_and_read_back(&mut self, mode: Word) -> Result<(), DeviceError> {
        // The mode is unknown until it is read back, so the next change of mode must write it.
        self.mode.name.clear();
        self.write_mode(mode)?;
        self.mode = self.mode_in_force()?;
        if self.mode.name == mode {
            Ok(())
        } else {
            Err(self.node.refusal("mode", &mode, Legal::OneOf(self.mode.name.as_str().into())))
        }
    }

    fn mode_in_force(&self) -> Result<Mode, DeviceError> {
        Ok(Mode {
            name: self.mode_word()?,
            num_values: self.within(self.num_values()?, "num_values", 255)?,
            decimals: self.within(self.decimals()?, "decimals", 9)?,
            units: self.units()?,
            format: self.bin_data_format()?,
        })
    }

    /// A small number that the driver cannot mean otherwise.
    fn within(
        &self,
        number: i32,
        attribute: &'static str,
        last: usize,
    ) -> Result<usize, DeviceError> {
        let malformed = || {
            let legal = Legal::Range(0, i64::try_from(last).unwrap_or(i64::MAX));
            self.node.error(attribute, None, Cause::Malformed(legal))
        };
        usize::try_from(number).ok().filter(|number| *number <= last).ok_or_else(malformed)
    }
}

/// For how long values are to be discarded after a change of mode, by driver, ns.
///
/// - Colour: 20 ms, ultrasonic: up to 2 s between very different modes (ev3dev issue 1401); between
///   two measuring modes two of its frames.
/// - Infrared: two frames of up to 100 ms. Two polls of an I²C sensor, at the 100 ms they start
///   with.
/// - Gyro: the older ones calibrate again, for a time that is not documented; 1 s is our choice.
///   Check for drift as well.
#[must_use]
pub fn settle_ns(driver: Option<Driver>, from: &str, to: &str) -> i64 {
    let measures = |mode: &str| mode.starts_with("US-DIST") || mode.starts_with("US-DC");
    let settle_ms = match driver {
        _ if from == to => 0,
        Some(Driver::Touch) => 0,
        Some(Driver::Colour) => 20,
        Some(Driver::Ultrasonic) if measures(from) && measures(to) => 200,
        Some(Driver::Ultrasonic) => 2000,
        Some(Driver::Gyro) => 1000,
        _ => 200,
    };
    settle_ms * MILLISECOND_NS
}

/// A power of ten, exact for the few decimals that sensors have.
fn ten_to_the(decimals: usize) -> f64 {
    (0..decimals).fold(1.0, |power, _| power * 10.0)
}
