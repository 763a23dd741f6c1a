//! Range readings, each with the place and direction it was taken from.

use serde::{Deserialize, Serialize};

use super::range::Beam;
use super::{Keyframe, MapPoint, Pose, Range, where_now};
use crate::clock::MILLISECOND_NS;

/// The sensor's period: a reading that has not changed for this long counts as a new one of the
/// same value. The EV3's ultrasonic sensor has about ten really new distances a second.
const PERIOD_NS: i64 = 100 * MILLISECOND_NS;

/// A range reading in the world.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sounding {
    /// The instant of the reading, nanoseconds of the run's clock.
    pub time_ns: i64,
    /// Where the sensor was then, world frame, metres.
    pub x_m: f64,
    /// The same.
    pub y_m: f64,
    /// Unit vector of the beam's axis, world frame.
    pub beam: [f64; 2],
    /// Unit vector of the direction in which the echo is taken to be, within the cone around the
    /// axis.
    pub echo: [f64; 2],
    /// Half of the cone around the axis that it was heard in, radians.
    pub half_cone_rad: f64,
    /// What it read.
    pub range: Range,
    /// Whether it is a reading of its own and not the one before once more (the seed places the
    /// same one in each tick).
    pub fresh: bool,
    /// Whether the echo's place is only the first guess: the sweep that it is of decides
    /// ([`super::Estimate::placed`]).
    pub waits: bool,
}

impl Sounding {
    pub(super) fn new(
        time_ns: i64,
        beam: &Beam,
        half_cone_rad: f64,
        range: Range,
        fresh: bool,
    ) -> Self {
        let axis = [beam.cos, beam.sin];
        Self {
            time_ns,
            x_m: beam.x_m,
            y_m: beam.y_m,
            beam: axis,
            echo: axis,
            half_cone_rad,
            range,
            fresh,
            waits: false,
        }
    }

    /// The same with an echo from so far beside the axis, radians anticlockwise.
    /// It waits for its sweep.
    pub(super) fn with_echo_off_axis(self, off_rad: f64) -> Self {
        let waiting = Self { waits: true, ..self };
        if off_rad == 0.0 {
            return waiting;
        }
        let [cos, sin] = self.beam;
        let (off_sin, off_cos) = libm::sincos(off_rad);
        Self { echo: [cos * off_cos - sin * off_sin, sin * off_cos + cos * off_sin], ..waiting }
    }

    /// The same, seen from where it was as it is known now; see [`where_now`].
    pub(super) fn now(&self, keyframes: &[Keyframe]) -> Self {
        let placed = Pose { x_m: self.x_m, y_m: self.y_m, heading_rad: 0.0 };
        let now = where_now(keyframes, self.time_ns, &placed);
        let (sin, cos) = libm::sincos(now.heading_rad);
        let turned = |[x, y]: [f64; 2]| [x * cos - y * sin, x * sin + y * cos];
        Self {
            x_m: now.x_m,
            y_m: now.y_m,
            beam: turned(self.beam),
            echo: turned(self.echo),
            ..*self
        }
    }

    /// The point of the map that it makes, if its echo is nearer than `max_m`.
    pub(super) fn point(&self, max_m: f64) -> Option<MapPoint> {
        let Range::Echo(range_m) = self.range else { return None };
        let [x_m, y_m] = self.at(range_m);
        (range_m < max_m).then_some(MapPoint { time_ns: self.time_ns, x_m, y_m })
    }

    /// The place at this distance in metres in the direction of the echo, world frame.
    #[must_use]
    pub fn at(&self, range_m: f64) -> [f64; 2] {
        let [cos, sin] = self.echo;
        [self.x_m + cos * range_m, self.y_m + sin * range_m]
    }
}

/// Tells new readings from old ones, which the sensor does not.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Schedule {
    /// When the value that was taken last had changed, and when it was taken.
    taken: Option<(i64, i64)>,
}

impl Schedule {
    /// The instant of the reading, before latency, if there is a new one: when its value changed
    /// or, if it did not, now, once in a period.
    pub(super) fn due(&mut self, now_ns: i64, changed_ns: i64) -> Option<i64> {
        let instant_ns = match self.taken {
            Some((changed, taken)) if changed == changed_ns => {
                (now_ns.saturating_sub(taken) >= PERIOD_NS).then_some(now_ns)?
            }
            _ => changed_ns.min(now_ns),
        };
        self.taken = Some((changed_ns, now_ns));
        Some(instant_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reading_counts_when_it_changes_and_once_in_a_period_when_it_does_not() {
        let mut schedule = Schedule::default();
        #[rustfmt::skip]
        let ticks = [
            // now, ms  changed, ms   instant, ms
            (   0,        0,          Some(0)),
            (  20,        0,          None),
            (  40,       35,          Some(35)),
            (  60,       35,          None),
            ( 120,       35,          None),
            ( 140,       35,          Some(140)),
            ( 160,       35,          None),
            ( 180,      180,          Some(180)),
        ];
        for (now, changed, instant) in ticks {
            let due = schedule.due(now * MILLISECOND_NS, changed * MILLISECOND_NS);
            assert_eq!(due, instant.map(|ms| ms * MILLISECOND_NS), "at {now} ms");
        }
    }
}
