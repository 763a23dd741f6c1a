//! The faults on one port, and what they do to what passes through it.

use std::collections::VecDeque;

use nix::errno::Errno;

use super::DeviceFault;
use crate::sim::chance::Chance;
use crate::sim::driver::sensor::{SerialLine, model};
use crate::sim::physics::{STEP_NS, SensorKind};

/// Streams of chance below this belong to the world.
const FIRST_STREAM: u64 = 1 << 32;

/// A motor's count of edges, and where between two of them it is.
type Count = (i64, f64);

/// How a read of an attribute ends instead of reaching its driver.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Reading {
    /// With an error.
    Fails(Errno),
    /// With a text that the driver never wrote.
    Reads(Vec<u8>),
}

/// All that is wrong with one port.
#[derive(Debug)]
pub(crate) struct PortFaults {
    active: Vec<Active>,
    seed: u64,
    stream: u64,
    chance: Chance,
}

#[derive(Debug)]
struct Active {
    fault: DeviceFault,
    until_ns: Option<i64>,
    memory: Memory,
}

/// What a fault has seen since it began.
#[derive(Debug, Default)]
struct Memory {
    count: Option<Count>,
    due_ns: i64,
    frames: u32,
    late_counts: VecDeque<(i64, Count)>,
    late_frames: VecDeque<(i64, &'static str, [i32; 8])>,
    away: bool,
}

impl PortFaults {
    /// A port in order; `seed` and the port's number make its chance.
    pub(crate) fn new(seed: u64, port: u64) -> Self {
        let stream = FIRST_STREAM + port;
        Self { active: Vec::new(), seed, stream, chance: Chance::new(seed, stream) }
    }

    /// Something goes wrong, in place of what was wrong before in the same way.
    pub(crate) fn add(&mut self, fault: DeviceFault, until_ns: Option<i64>) {
        self.active.retain(|active| !active.fault.replaces(&fault));
        self.active.push(Active { fault, until_ns, memory: Memory::default() });
    }

    /// Everything is in order again; returns what was not.
    pub(crate) fn clear(&mut self) -> Vec<DeviceFault> {
        self.active.drain(..).map(|active| active.fault).collect()
    }

    /// A fault is over, if it was there.
    pub(crate) fn remove(&mut self, fault: &DeviceFault) {
        self.active.retain(|active| !active.fault.replaces(fault));
    }

    /// One fault whose end has come, taken away.
    pub(crate) fn take_ended(&mut self, now_ns: i64) -> Option<DeviceFault> {
        let over = |active: &Active| active.until_ns.is_some_and(|until_ns| until_ns <= now_ns);
        let index = self.active.iter().position(over)?;
        Some(self.active.remove(index).fault)
    }

    /// What is wrong now.
    pub(crate) fn active(&self) -> impl Iterator<Item = &DeviceFault> {
        self.active.iter().map(|active| &active.fault)
    }

    /// Lets a step pass: loose plugs come and go.
    pub(crate) fn step(&mut self, now_ns: i64) {
        for Active { fault, memory, .. } in &mut self.active {
            let DeviceFault::Intermittent { share } = fault else { continue };
            if now_ns < memory.due_ns {
                continue;
            }
            // It begins with a moment away, so that an order has an effect that can be seen.
            memory.away = !memory.away;
            let moment_ms = 20 + i64::from(self.chance.below(381));
            let times = if memory.away { 1.0 } else { (1.0 - *share) / *share };
            #[expect(clippy::cast_precision_loss, reason = "milliseconds below a million")]
            let period_ms = moment_ms as f64 * times;
            memory.due_ns = now_ns + crate::clock::nanoseconds(period_ms / 1e3).max(STEP_NS);
        }
    }

    /// What a motor's driver is told of its count.
    pub(crate) fn count(&mut self, mut count: Count, now_ns: i64) -> Count {
        for Active { fault, memory, .. } in &mut self.active {
            count = memory.count(fault, count, now_ns);
        }
        count
    }

    /// What a sensor's driver is sent for a frame that was measured; none where the frame does not
    /// come.
    pub(crate) fn frame(
        &mut self,
        kind: SensorKind,
        mode: &'static str,
        now_ns: i64,
        measure: impl FnOnce() -> [i32; 8],
    ) -> Option<[i32; 8]> {
        let mut frame = Some(measure());
        for Active { fault, memory, .. } in &mut self.active {
            frame = match (&*fault, frame) {
                (DeviceFault::Garbage, Some(_)) => Some(random_frame(&mut self.chance, kind)),
                (_, Some(values)) => memory.frame(fault, kind, mode, values, now_ns),
                // What is late comes although nothing new does.
                (DeviceFault::Delayed { .. }, None) => memory.late_frame(mode, now_ns),
                (_, None) => None,
            };
        }
        frame
    }

    /// How a read of an attribute ends, if it does not reach the driver.
    pub(crate) fn reading(&self, attribute: &str, now_ns: i64) -> Option<Reading> {
        if !is_measured(attribute) {
            return None;
        }
        self.active.iter().rev().find_map(|active| match active.fault {
            DeviceFault::Garbage if matches!(attribute, "position" | "speed" | "duty_cycle") => {
                Some(Reading::Reads(
                    format!("{}\n", self.chance_at(now_ns, attribute).any()).into(),
                ))
            }
            DeviceFault::GarbageText => {
                let mut chance = self.chance_at(now_ns, attribute);
                let length = chance.below(24);
                Some(Reading::Reads((0..length).map(|_| chance.byte()).chain([b'\n']).collect()))
            }
            _ => active.error().map(Reading::Fails),
        })
    }

    /// What a write is answered, if it does not reach the driver.
    pub(crate) fn refusal(&self) -> Option<Errno> {
        self.active.iter().rev().find_map(Active::error)
    }

    /// How the serial line is.
    pub(crate) fn line(&self) -> SerialLine {
        if self.has(&DeviceFault::Resync) {
            SerialLine::Resynchronising
        } else if self.has(&DeviceFault::Off) {
            SerialLine::Silent
        } else {
            SerialLine::Sound
        }
    }

    /// How long a mode's old values stay after it was changed to, at least.
    pub(crate) fn stale_ns(&self) -> i64 {
        let stale = self.active().filter_map(|fault| match fault {
            DeviceFault::Stale { for_ns } => Some(*for_ns),
            _ => None,
        });
        stale.max().unwrap_or(0)
    }

    /// True while a fault is there that has no numbers.
    pub(crate) fn has(&self, fault: &DeviceFault) -> bool {
        self.active().any(|active| active == fault)
    }

    /// Chance that depends on the time and the attribute alone, not on how often it was read.
    fn chance_at(&self, now_ns: i64, attribute: &str) -> Chance {
        let step = now_ns.div_euclid(STEP_NS).cast_unsigned();
        let name = attribute
            .bytes()
            .fold(7_u64, |sum, byte| sum.wrapping_mul(31).wrapping_add(byte.into()));
        Chance::new(self.seed ^ name, self.stream.wrapping_add(step << 8))
    }
}

impl Active {
    fn error(&self) -> Option<Errno> {
        match self.fault {
            DeviceFault::Enxio => Some(Errno::ENXIO),
            DeviceFault::Eio => Some(Errno::EIO),
            DeviceFault::Intermittent { .. } => self.memory.away.then_some(Errno::ENXIO),
            _ => None,
        }
    }
}

impl Memory {
    fn count(&mut self, fault: &DeviceFault, count: Count, now_ns: i64) -> Count {
        match fault {
            DeviceFault::Stuck => *self.count.get_or_insert(count),
            DeviceFault::Slow { times } => {
                if now_ns >= self.due_ns {
                    self.due_ns = now_ns + i64::from(*times) * STEP_NS;
                    self.count = Some(count);
                }
                self.count.unwrap_or(count)
            }
            DeviceFault::Delayed { delay_ns } => {
                let first = *self.count.get_or_insert(count);
                self.late_counts.push_back((now_ns + delay_ns, count));
                while let Some((_, count)) = due(&mut self.late_counts, |late| late.0 <= now_ns) {
                    self.count = Some(count);
                }
                self.count.unwrap_or(first)
            }
            DeviceFault::Wrong { scale, offset } => {
                let (from, exact_from) = *self.count.get_or_insert(count);
                let moved = scaled(count.0 - from, *scale) + 2 * i64::from(*offset);
                (
                    from + moved,
                    exact_from + (count.1 - exact_from) * scale + 2.0 * f64::from(*offset),
                )
            }
            DeviceFault::Jump { by } => {
                (count.0 + 2 * i64::from(*by), count.1 + 2.0 * f64::from(*by))
            }
            _ => count,
        }
    }

    fn frame(
        &mut self,
        fault: &DeviceFault,
        kind: SensorKind,
        mode: &'static str,
        values: [i32; 8],
        now_ns: i64,
    ) -> Option<[i32; 8]> {
        match fault {
            DeviceFault::Stuck => None,
            // A serial line falls silent, an open pin reads as not pressed.
            DeviceFault::Off => (kind == SensorKind::Touch).then_some([0; 8]),
            DeviceFault::Slow { times } => {
                self.frames = self.frames.wrapping_add(1);
                self.frames.is_multiple_of(*times).then_some(values)
            }
            DeviceFault::Delayed { delay_ns } => {
                self.late_frames.push_back((now_ns + delay_ns, mode, values));
                self.late_frame(mode, now_ns)
            }
            DeviceFault::Wrong { .. } if kind == SensorKind::Touch => {
                Some(values.map(|value| i32::from(value == 0)))
            }
            DeviceFault::Wrong { scale, offset } => Some(plausible(kind, mode, values, |value| {
                scaled(value.into(), *scale) + i64::from(*offset)
            })),
            DeviceFault::Jump { by } if kind == SensorKind::Touch => {
                Some(values.map(|value| i32::from((value == 0) == (*by != 0))))
            }
            DeviceFault::Jump { by } => {
                Some(plausible(kind, mode, values, |value| i64::from(value) + i64::from(*by)))
            }
            _ => Some(values),
        }
    }

    /// The newest frame of this mode that is due.
    fn late_frame(&mut self, mode: &'static str, now_ns: i64) -> Option<[i32; 8]> {
        let mut newest = None;
        while let Some((_, of_mode, values)) = due(&mut self.late_frames, |late| late.0 <= now_ns) {
            newest = Some(values).filter(|_| of_mode == mode).or(newest);
        }
        newest
    }
}

/// Takes the oldest of what is waiting, if it is due.
fn due<T>(waiting: &mut VecDeque<T>, is_due: impl FnOnce(&T) -> bool) -> Option<T> {
    if waiting.front().is_some_and(is_due) { waiting.pop_front() } else { None }
}

/// What is measured, or changes by itself.
fn is_measured(attribute: &str) -> bool {
    matches!(attribute, "bin_data" | "position" | "speed" | "duty_cycle" | "state")
        || attribute.starts_with("value")
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_precision_loss,
    reason = "a cast from float saturates; counts stay far below 2^53"
)]
fn scaled(value: i64, scale: f64) -> i64 {
    libm::round(value as f64 * scale).clamp(-1e15, 1e15) as i64
}

/// Changes the values of a frame and keeps them to what the sensor could have sent.
fn plausible(
    kind: SensorKind,
    mode: &str,
    values: [i32; 8],
    change: impl Fn(i32) -> i64,
) -> [i32; 8] {
    let known = model(kind).modes.iter().find(|known| known.name == mode);
    let (least, most) = known.map_or((i32::MIN, i32::MAX), |known| known.range);
    let (least, most) = (i64::from(least), i64::from(most));
    values.map(|value| i32::try_from(change(value).clamp(least, most)).unwrap_or(0))
}

fn random_frame(chance: &mut Chance, kind: SensorKind) -> [i32; 8] {
    let mut values = [0; 8];
    for value in &mut values {
        *value = chance.any();
    }
    // The pin of a touch sensor is only high or low.
    if kind == SensorKind::Touch { values.map(|value| value & 1) } else { values }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::MILLISECOND_NS;

    /// One random moment is at most this long; said in `DeviceFault::Intermittent`.
    const LONGEST_MOMENT_NS: i64 = 400 * MILLISECOND_NS;

    fn faulty(text: &str) -> PortFaults {
        let mut faults = PortFaults::new(5, 0);
        faults.add(DeviceFault::parse(text).unwrap(), None);
        faults
    }

    /// What a driver sees of a motor that turns at an edge a step.
    fn counts(text: &str, steps: i64) -> Vec<i64> {
        let mut faults = faulty(text);
        #[expect(clippy::cast_precision_loss, reason = "small")]
        (0..steps)
            .map(|step| faults.count((100 + step, 100.0 + step as f64), step * STEP_NS).0)
            .collect()
    }

    #[test]
    fn counts_are_stuck_slow_late_wrong_and_jump() {
        assert_eq!(counts("stuck", 4), [100, 100, 100, 100]);
        assert_eq!(counts("slow 3", 7), [100, 100, 100, 103, 103, 103, 106]);
        assert_eq!(counts("delayed 4", 6), [100, 100, 100, 101, 102, 103]);
        assert_eq!(counts("wrong 2 5", 4), [110, 112, 114, 116]);
        assert_eq!(counts("jump 10", 3), [120, 121, 122]);
        assert_eq!(counts("enxio", 3), [100, 101, 102]);
    }

    /// What a driver gets of an ultrasonic sensor that measures 1000, 1001, … mm.
    fn frames(text: &str, count: i32) -> Vec<Option<i32>> {
        let mut faults = faulty(text);
        let frame = |nth: i32| {
            let values = [1000 + nth, 0, 0, 0, 0, 0, 0, 0];
            faults
                .frame(
                    SensorKind::Ultrasonic,
                    "US-DIST-CM",
                    i64::from(nth) * 100 * MILLISECOND_NS,
                    || values,
                )
                .map(|values| values[0])
        };
        (0..count).map(frame).collect()
    }

    #[test]
    fn frames_are_stuck_slow_late_wrong_and_jump() {
        assert_eq!(frames("stuck", 2), [None, None]);
        assert_eq!(frames("off", 2), [None, None]);
        assert_eq!(frames("slow 2", 4), [None, Some(1001), None, Some(1003)]);
        assert_eq!(frames("delayed 250", 5), [None, None, None, Some(1000), Some(1001)]);
        assert_eq!(frames("wrong 0.5 7", 2), [Some(507), Some(508)]);
        assert_eq!(frames("wrong 100", 1), [Some(2550)], "never more than the sensor can say");
        assert_eq!(frames("jump -90", 1), [Some(910)]);
        let random = frames("garbage", 4);
        assert!(random.iter().all(Option::is_some) && random[0] != random[1], "{random:?}");
        assert_eq!(random, frames("garbage", 4), "the same seed gives the same garbage");
    }

    #[test]
    fn a_loose_plug_is_away_for_its_share_of_the_time_and_never_long() {
        for share in [0.1, 0.3, 0.8] {
            let mut faults = faulty(&format!("intermittent {share}"));
            let (mut away, mut longest, mut since) = (0_i64, 0_i64, 0_i64);
            let steps = 500_000;
            for step in 0..steps {
                faults.step(step * STEP_NS);
                let gone =
                    faults.reading("value0", step * STEP_NS) == Some(Reading::Fails(Errno::ENXIO));
                assert_eq!(faults.refusal().is_some(), gone);
                assert_eq!(faults.reading("driver_name", step * STEP_NS), None);
                away += i64::from(gone);
                since = if gone { since + STEP_NS } else { 0 };
                longest = longest.max(since);
            }
            #[expect(clippy::cast_precision_loss, reason = "small")]
            let found = away as f64 / steps as f64;
            assert!((found - share).abs() < 0.05, "{found} of the time, {share} was ordered");
            assert!(longest <= LONGEST_MOMENT_NS + STEP_NS, "{longest} ns");
        }
    }

    #[test]
    fn garbage_depends_on_the_time_and_not_on_the_number_of_reads() {
        let faults = faulty("garbage text");
        let first = faults.reading("position", 10 * STEP_NS);
        assert_eq!(first, faults.reading("position", 10 * STEP_NS));
        assert_ne!(first, faults.reading("position", 11 * STEP_NS));
        assert_ne!(first, faults.reading("speed", 10 * STEP_NS));
    }

    #[test]
    fn a_fault_replaces_its_own_kind_and_ends_when_its_time_has_come() {
        let mut faults = faulty("jump 1");
        faults.add(DeviceFault::Jump { by: 5 }, Some(10));
        faults.add(DeviceFault::Stuck, None);
        assert_eq!(faults.active().count(), 2);
        assert_eq!(faults.take_ended(9), None);
        assert_eq!(faults.take_ended(10), Some(DeviceFault::Jump { by: 5 }));
        assert_eq!(faults.clear(), [DeviceFault::Stuck]);
    }
}
