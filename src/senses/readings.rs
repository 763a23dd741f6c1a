//! One tick's readings, in SI units, each with its two ages.

use super::Channel;

/// A value that was read, with what is known of its age: a sensor has no sequence number, so a
/// value that did not change may be new or old.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// The value, in its channel's unit.
    pub value: f64,
    /// When it was last read, nanoseconds of the run's clock.
    pub read_ns: i64,
    /// When it was first read with this value.
    pub changed_ns: i64,
}

/// One tick's readings. A channel that the robot does not have, or that was never read, is `None`;
/// one that cannot be read any more keeps its last reading, whose `read_ns` then stands still.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Senses {
    /// The tick's number, from 0.
    pub tick: u64,
    /// The tick's time, nanoseconds of the run's clock.
    pub time_ns: i64,
    /// By [`Channel`].
    pub readings: [Option<Reading>; Channel::COUNT],
}

impl Senses {
    /// A channel's last reading, however old.
    #[must_use]
    pub fn get(&self, channel: Channel) -> Option<Reading> {
        self.readings[channel as usize]
    }

    /// A channel's value if it was read within the last `max_age_ns`.
    #[must_use]
    pub fn fresh(&self, channel: Channel, max_age_ns: i64) -> Option<f64> {
        self.get(channel)
            .filter(|reading| self.time_ns - reading.read_ns <= max_age_ns)
            .map(|reading| reading.value)
    }

    /// Notes a value read at this tick's time.
    pub fn set(&mut self, channel: Channel, value: f64) {
        let place = &mut self.readings[channel as usize];
        let changed_ns = match place {
            Some(last) if last.value.to_bits() == value.to_bits() => last.changed_ns,
            _ => self.time_ns,
        };
        *place = Some(Reading { value, read_ns: self.time_ns, changed_ns });
    }
}
