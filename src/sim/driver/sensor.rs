//! A sensor: class `lego-sensor` (`lego_sensor_class.c`, `ev3_uart_sensor_ld.c`,
//! `ev3_analog_sensor_core.c`).
//!
//! A sensor holds the last frame of each mode, as the driver's `mode_info[mode].raw_data` does;
//! reads decode that of the mode it is in. Frames come at the sensor's own pace, each is measured
//! once. A write of `mode` to a UART sensor keeps the writer waiting until the first frame of the
//! new mode, 10 to 50 ms. What comes in the first moments after it is what that mode measured when
//! it was last used, and zeros if it never was (ev3dev's issue 1401).

mod models;

use nix::errno::Errno;
use rand_chacha::rand_core::Rng as _;

pub(crate) use self::models::{MODELS, Mode, Model, model};
use self::models::{decode, encode};
use super::text::word;
use super::{Attributes, Context, Driver, Took, Wait, line, list};
use crate::ev3dev;
use crate::sim::physics::SensorKind;

/// The analog pin's voltage from which a touch sensor counts as pressed, in millivolts.
const PRESSED_MV: i32 = 250;

/// What the pin shows when the sensor is pressed; any value well above the threshold will do.
const PRESSED_PIN_MV: i32 = 4000;

/// A gyro takes this long to zero its angle after it was told to.
const ZEROING_NS: i64 = 25_000_000;

/// How a gyro takes a change of mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum GyroMake {
    /// Date code ending in 2 or 3: any real change of mode zeroes the angle.
    Old,
    /// Later ones: only 0x11 or 0x88 written to `direct` does.
    #[default]
    New,
}

/// How the serial line of a sensor is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum SerialLine {
    /// As it should be.
    Sound,
    /// The sensor sends nothing: a write of `mode` ends in ETIMEDOUT after half a second, and
    /// values stay as they are, until the driver misses it after 0.7 s and is
    /// [`SerialLine::Resynchronising`].
    Silent,
    /// The driver has lost it and takes its description again: values answer ENXIO, a write of
    /// `mode` ENODEV.
    Resynchronising,
}

/// The driver looks every 100 ms whether data has come; after more than six misses it
/// resynchronises (interfaces, 6.2).
const KEEP_ALIVE_NS: i64 = 700_000_000;

/// How long a sensor takes to describe itself at 2400 baud.
pub(crate) const HANDSHAKE_NS: i64 = 1_500_000_000;

/// A mode is asked for ten times, 50 ms apart.
const TIMEOUT_NS: i64 = 500_000_000;

/// No sensor has more modes: `EV3_UART_MODE_MAX` and one.
const MOST_MODES: usize = 8;

/// What a message brings at most, bytes.
const FRAME_BYTES: usize = 32;

#[derive(Debug)]
struct Switch {
    mode: usize,
    due_ns: i64,
}

/// One sensor.
#[derive(Debug)]
pub(crate) struct Sensor {
    /// What it is.
    pub(crate) kind: SensorKind,
    /// What its driver is.
    pub(crate) model: &'static Model,
    make: GyroMake,
    /// How often the board's controller is asked for the sensor's values; none where the sensor
    /// sends them to the driver.
    polls_ns: Option<i64>,
    /// How the serial line is, whatever the driver has made of it; an analog sensor has none.
    wire: SerialLine,
    /// Since when the sensor has sent nothing.
    silent_since_ns: Option<i64>,
    /// The driver has missed the sensor, which has not described itself again by then.
    missed_until_ns: Option<i64>,
    least_stale_ns: i64,
    mode: usize,
    /// One a mode; zeros before the mode's first data.
    frames: [[u8; FRAME_BYTES]; MOST_MODES],
    next_frame_ns: i64,
    switch: Option<Switch>,
    /// Until then the frames are those that the mode ended with when it was last left.
    stale_until_ns: i64,
    /// A single-shot mode has delivered its measurement.
    spent: bool,
    /// A frame that was put in by hand stands until it is taken out.
    fed: bool,
    zero_deg: i32,
    zero_due_ns: Option<i64>,
    pressed: bool,
    /// Changes whenever those who poll `value0` are woken.
    pub(crate) notices: u32,
}

impl Sensor {
    /// A sensor that has just reported itself, in its first mode.
    pub(crate) fn new(
        kind: SensorKind,
        make: GyroMake,
        polls_ns: Option<i64>,
        now_ns: i64,
    ) -> Self {
        Self {
            kind,
            model: model(kind),
            make,
            polls_ns,
            wire: SerialLine::Sound,
            silent_since_ns: None,
            missed_until_ns: None,
            least_stale_ns: 0,
            mode: 0,
            frames: [[0; FRAME_BYTES]; MOST_MODES],
            next_frame_ns: now_ns,
            switch: None,
            stale_until_ns: now_ns,
            spent: false,
            fed: false,
            zero_deg: 0,
            zero_due_ns: None,
            pressed: false,
            notices: 0,
        }
    }

    /// What happens in one step. `measure` is asked for the numbers of a frame when one is due; it
    /// has none where the frame does not come.
    pub(crate) fn tick(
        &mut self,
        now_ns: i64,
        measure: impl FnOnce(&'static str) -> Option<[i32; 8]>,
    ) {
        self.keep_alive(now_ns);
        if self.switch.as_ref().is_some_and(|switch| switch.due_ns <= now_ns) {
            self.finish_switch(now_ns);
        }
        if now_ns < self.next_frame_ns {
            return;
        }
        self.next_frame_ns = now_ns + self.model.period_ns.max(self.polls_ns.unwrap_or_default());
        if self.fed
            || self.spent
            || self.line() != SerialLine::Sound
            || now_ns < self.stale_until_ns
        {
            return;
        }
        let mode = self.mode_table();
        let Some(mut values) = measure(mode.name) else { return };
        self.spent = mode.name.starts_with("US-SI");
        self.zero(mode.name, &mut values, now_ns);
        if !self.model.uart {
            values = values.map(|value| if value == 0 { 0 } else { PRESSED_PIN_MV });
        }
        encode(mode.format, &values[..mode.values], &mut self.frames[self.mode]);
        self.notice_touch();
    }

    /// Puts a frame in by hand, as if the sensor went on sending it; with none, the sensor measures
    /// again.
    pub(crate) fn feed(&mut self, frame: Option<&[u8]>) {
        self.fed = frame.is_some();
        if let Some(frame) = frame {
            let sent = frame.iter().copied().chain(std::iter::repeat(0));
            self.frames[self.mode].iter_mut().zip(sent).for_each(|(to, from)| *to = from);
            self.notice_touch();
        }
    }

    /// Faults that lie on the wire: how the line is, and how long old values stay after a change of
    /// mode, at least.
    pub(crate) fn suffer(&mut self, line: SerialLine, stale_ns: i64) {
        let before = self.line();
        self.wire = if self.model.uart { line } else { SerialLine::Sound };
        self.least_stale_ns = stale_ns;
        self.forget_frames(before);
    }

    /// The driver misses a sensor that sends nothing, and takes its description again when it is
    /// back.
    fn keep_alive(&mut self, now_ns: i64) {
        let before = self.line();
        let since_ns =
            (self.wire == SerialLine::Silent).then(|| self.silent_since_ns.unwrap_or(now_ns));
        self.silent_since_ns = since_ns;
        let missed = |since_ns| now_ns - since_ns >= KEEP_ALIVE_NS;
        // A controller that is asked answers with what it has.
        if self.polls_ns.is_none() && since_ns.is_some_and(missed) {
            self.missed_until_ns = Some(now_ns + HANDSHAKE_NS);
        }
        self.missed_until_ns = self.missed_until_ns.filter(|until_ns| now_ns < *until_ns);
        self.forget_frames(before);
    }

    /// How the line is for the driver.
    fn line(&self) -> SerialLine {
        if self.missed_until_ns.is_some() { SerialLine::Resynchronising } else { self.wire }
    }

    fn notice_touch(&mut self) {
        let pressed = self.kind == SensorKind::Touch && self.value(0) == Some(1);
        if pressed != self.pressed {
            self.pressed = pressed;
            self.notices = self.notices.wrapping_add(1);
        }
    }

    fn mode_table(&self) -> &'static Mode {
        &self.model.modes[self.mode]
    }

    /// The last frame of the present mode.
    fn frame(&self) -> &[u8] {
        &self.frames[self.mode]
    }

    /// A description that is taken again begins with no data in any mode.
    fn forget_frames(&mut self, before: SerialLine) {
        if self.line() == SerialLine::Resynchronising && before != SerialLine::Resynchronising {
            self.frames = Default::default();
        }
    }

    fn value(&self, index: usize) -> Option<i32> {
        let mode = self.mode_table();
        if self.line() == SerialLine::Resynchronising || index >= mode.values {
            return None;
        }
        let value = decode(mode.format, self.frame(), index);
        Some(if self.model.uart { value } else { i32::from(value > PRESSED_MV) })
    }

    /// The gyro's angle counts from where it was zeroed.
    fn zero(&mut self, mode: &str, values: &mut [i32; 8], now_ns: i64) {
        if self.kind != SensorKind::Gyro || !matches!(mode, "GYRO-ANG" | "GYRO-G&A") {
            return;
        }
        let [angle, ..] = values;
        if self.zero_due_ns.is_some_and(|due_ns| due_ns <= now_ns) {
            self.zero_due_ns = None;
            self.zero_deg = *angle;
        }
        *angle = angle.wrapping_sub(self.zero_deg);
    }

    fn write_mode(&mut self, bytes: &[u8], context: &mut Context<'_>) -> Took {
        let mode = word(bytes, self.model.modes.iter().map(|mode| mode.name))?;
        if !self.model.uart {
            return Ok(None);
        }
        if self.line() == SerialLine::Resynchronising {
            return Err(Errno::ENODEV);
        }
        if self.switch.is_some() {
            return Err(Errno::EBUSY);
        }
        if let Some(polls_ns) = self.polls_ns {
            // The controller is told, and nothing waits for the sensor.
            self.switch = Some(Switch { mode, due_ns: context.now_ns });
            self.finish_switch(context.now_ns);
            self.next_frame_ns = context.now_ns + polls_ns;
            return Ok(None);
        }
        if self.line() == SerialLine::Silent {
            let due_ns = context.now_ns + TIMEOUT_NS;
            self.switch = Some(Switch { mode: self.mode, due_ns });
            return Ok(Some(Wait { until_ns: due_ns, then: Some(Errno::ETIMEDOUT) }));
        }
        let wait_ms = 10 + i64::from(context.chance.next_u32() % 41);
        let due_ns = context.now_ns + wait_ms * 1_000_000;
        self.switch = Some(Switch { mode, due_ns });
        Ok(Some(Wait { until_ns: due_ns, then: None }))
    }

    fn finish_switch(&mut self, now_ns: i64) {
        let Some(switch) = self.switch.take() else { return };
        let before = self.mode;
        self.mode = switch.mode;
        self.spent = false;
        self.next_frame_ns = now_ns;
        if before == switch.mode {
            return;
        }
        self.stale_until_ns = now_ns + self.settling_ns(before).max(self.least_stale_ns);
        if self.kind == SensorKind::Gyro && self.make == GyroMake::Old {
            self.zero_due_ns = Some(now_ns);
        }
    }

    /// How long the present mode's old values stay after a change from `before`.
    fn settling_ns(&self, before: usize) -> i64 {
        let family = |index: usize| {
            let name = self.model.modes[index].name;
            (name == "US-LISTEN", name.starts_with("US-SI"))
        };
        if family(before) == family(self.mode) {
            self.model.settles_ns
        } else {
            // Up to two seconds were reported between very different modes of the ultrasonic.
            1_000_000_000
        }
    }

    fn write_direct(&mut self, bytes: &[u8], now_ns: i64) -> Took {
        if !self.model.uart {
            return Err(Errno::EOPNOTSUPP);
        }
        // The file is 255 bytes long: the kernel cuts what goes beyond before the driver sees it.
        if bytes.len() > 32 {
            return Err(Errno::EINVAL);
        }
        if self.kind == SensorKind::Gyro && matches!(bytes, [0x11 | 0x88]) {
            self.zero_due_ns = Some(now_ns + ZEROING_NS);
        }
        Ok(None)
    }
}

impl Driver for Sensor {
    fn attributes(&self) -> Attributes {
        [ev3dev::Sensor::ATTRIBUTES, ev3dev::Sensor::BINARY_ATTRIBUTES]
    }

    fn read(&self, attribute: &str, out: &mut Vec<u8>) -> Result<(), Errno> {
        let mode = self.mode_table();
        match attribute {
            "bin_data" => out.extend_from_slice(self.frame()),
            "bin_data_format" => line(out, mode.format),
            "commands" | "fw_version" => line(out, ""),
            "decimals" => line(out, mode.decimals),
            "mode" => line(out, mode.name),
            "modes" => list(out, self.model.modes.iter().map(|mode| mode.name)),
            "num_values" => line(out, mode.values),
            "units" => line(out, mode.units),
            "direct" | "poll_ms" | "text_value" => return Err(Errno::EOPNOTSUPP),
            _ => {
                let index = attribute.strip_prefix("value").and_then(|digits| digits.parse().ok());
                line(out, self.value(index.ok_or(Errno::ENODEV)?).ok_or(Errno::ENXIO)?);
            }
        }
        Ok(())
    }

    fn store(&mut self, attribute: &str, bytes: &[u8], context: &mut Context<'_>) -> Took {
        match attribute {
            "mode" => self.write_mode(bytes, context),
            "direct" => self.write_direct(bytes, context.now_ns),
            "poll_ms" => Err(Errno::EOPNOTSUPP),
            // `command`: no EV3 sensor has any.
            _ => Err(Errno::EINVAL),
        }
    }
}
