//! Heading from the gyro and the encoders together.
//!
//! The gyro says whole degrees, and 1° is 3.5 cm at 2 m. The encoders say fractions of a degree,
//! and drift as soon as a wheel slips. So the heading moves with the encoders and is held inside
//! the *window* of half a degree to each side of the gyro's angle: between two steps of the gyro
//! the encoders interpolate, and whatever they get wrong is gone at the next step.
//!
//! The window's centre is the sum of the gyro's changes less its bias. Where the gyro cannot be
//! believed (a jump that no motion explains, a turn beyond ±440 °/s, the end of its 16 bits, no
//! reading) the heading follows the encoders, and the window is centred on it again.
//!
//! # Bias
//!
//! While both wheels stand still the robot is taken to stand still, and what the gyro's angle does
//! is bias. Whole degrees make the drift a staircase: counting its steps over T seconds is wrong by
//! up to 1°/T, timing them from the first edge to the last is not. So the bias is (steps between
//! the first and the last edge) / (time between them), once two steps and one second lie between;
//! before that it is what it was, kept inside (net steps ± 1) / T. A new value counts for the whole
//! standstill: the heading is corrected back to its start. A turn of the robot by hand is faster
//! than any bias (5 °/s): it ends the standstill, whose bias is then taken back.
//!
//! # What we count on
//!
//! - `lego-ev3-gyro`: integer degrees, −32768 to 32767, beyond which it wraps or sticks by its
//!   make; ±440 °/s, beyond which the angle loses accuracy; a resynchronised or reset sensor starts
//!   again at 0.
//! - At a standstill the drift of a badly started sensor is constant, 1 °/s or more; of a well
//!   started one, nothing.

use serde::{Deserialize, Serialize};

use super::Events;
use super::drift::{Drift, Information, Verdict};
use crate::clock::{MILLISECOND_NS, SECOND_NS, seconds, seconds_nearly};
use crate::units::within;

/// One step of the sensor, and the unit of this file: a degree in radians.
pub(super) const DEGREE_RAD: f64 = std::f64::consts::PI / 180.0;
/// Half a step: how far the truth can be from the reading.
const WINDOW_RAD: f64 = 0.5 * DEGREE_RAD;
/// All the angles that 16 bits can say.
const RANGE_RAD: f64 = 65_536.0 * DEGREE_RAD;
/// At this angle and beyond the sensor may be stuck.
const RAIL_RAD: f64 = 32_766.5 * DEGREE_RAD;
/// The fastest turn that the sensor can follow.
const RATE_LIMIT_RAD_S: f64 = 440.0 * DEGREE_RAD;
/// From here on it counts as saturated: over 50 ms whole degrees leave the rate uncertain by 20
/// °/s.
const SATURATED_RAD_S: f64 = 425.0 * DEGREE_RAD;
/// The time over which that rate is taken.
const RATE_WINDOW_NS: i64 = 50 * MILLISECOND_NS;
/// A change in one update that is beyond the limit of the rate by this much is a jump.
const JUMP_SLACK_RAD: f64 = 2.0 * DEGREE_RAD;
/// However long the gyro was not read, a change beyond this that the encoders do not explain is a
/// jump.
const JUMP_CAP_RAD: f64 = 10.0 * DEGREE_RAD;
/// From this angle on, a reading that is suddenly 0 is a reset, unless the encoders say otherwise.
const RESET_FROM_RAD: f64 = 2.5 * DEGREE_RAD;
/// No bias is greater; what turns faster at a standstill is turned by someone.
const BIAS_LIMIT_RAD_S: f64 = 5.0 * DEGREE_RAD;
/// A standstill says nothing of the bias before this.
const BIAS_AFTER_NS: i64 = SECOND_NS;

/// Whether the sensor can have said this.
pub(super) fn is_in_range(value_rad: f64) -> bool {
    value_rad.abs() < RAIL_RAD + 3.0 * DEGREE_RAD
}

/// What the heading's estimation carries from tick to tick.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct GyroState {
    /// The last reading and its time; `None` until there is one.
    last: Option<GyroSample>,
    /// The heading that the gyro's angle means, half a step uncertain: the window's centre.
    centre_rad: f64,
    /// What the encoders have turned since the last reading.
    unread_rad: f64,
    bias_rad_s: f64,
    /// Whether it is what driving said, not a standstill.
    bias_is_drift: bool,
    /// Start of the time over which the rate is taken, and the angle since.
    rate_since_ns: i64,
    rate_rad: f64,
    saturated: bool,
    still: Option<Standstill>,
}

/// An angle and when it was read.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct GyroSample {
    time_ns: i64,
    angle_rad: f64,
}

/// A time in which both wheels stand still.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Standstill {
    since_ns: i64,
    /// The heading when it began.
    heading_rad: f64,
    /// The bias until then.
    bias_rad_s: f64,
    /// Net change of the gyro's angle since.
    turned_rad: f64,
    first: Option<StillEdge>,
    last: Option<StillEdge>,
}

/// A change of the angle during a standstill: when, the net change up to and with it, and its own.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct StillEdge {
    time_ns: i64,
    turned_rad: f64,
    step_rad: f64,
}

/// What one update gets.
#[derive(Debug, Clone, Copy)]
pub(super) struct GyroInput {
    pub time_ns: i64,
    /// The gyro's angle, if it was read.
    pub value_rad: Option<f64>,
    /// What is turned for each degree of it.
    pub per_scale: f64,
    /// The heading before.
    pub heading_rad: f64,
    /// The turn since, by the encoders.
    pub encoder_rad: f64,
    /// Whether both wheels have stood still for a while.
    pub still: bool,
}

/// What one update came to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct HeadingStep {
    pub heading_rad: f64,
    /// The gyro's own change, jumps left out: the seed's turn.
    pub change_rad: Option<f64>,
    /// The turn by the gyro alone, bias removed, where it can be believed.
    pub gyro_rad: Option<f64>,
    pub events: Events,
}

impl GyroState {
    /// The bias that is being removed, rad/s.
    pub(super) fn bias_rad_s(&self) -> f64 {
        self.bias_rad_s
    }

    /// While the robot stands, the bias that was removed before it did.
    pub(super) fn stands_with_rad_s(&self) -> Option<f64> {
        self.still.map(|still| still.bias_rad_s)
    }

    /// Takes what driving says of the bias, and what landmarks say of it beyond the one that is
    /// being removed. A standstill finds its own, for all of its time.
    pub(super) fn drifts(&mut self, drift: Drift, seen: Information) -> Verdict {
        if self.still.is_some() {
            return Verdict::Wait;
        }
        let both = drift.with(seen, self.bias_rad_s);
        let verdict = both.verdict(self.bias_rad_s, self.bias_is_drift);
        if let Verdict::Remove(bias_rad_s) = verdict {
            (self.bias_rad_s, self.bias_is_drift) = (bias_rad_s, true);
        }
        verdict
    }

    /// Takes one tick's reading.
    pub(super) fn update(&mut self, input: GyroInput) -> HeadingStep {
        let predicted_rad = input.heading_rad + input.encoder_rad;
        let (Some(value_rad), Some(last)) = (input.value_rad, self.last) else {
            return self.without_change(input, predicted_rad);
        };
        let read_rad = unwrapped(value_rad - last.angle_rad);
        let expected_rad = self.unread_rad + input.encoder_rad;
        let passed_s = seconds_nearly(input.time_ns.saturating_sub(last.time_ns).max(0));
        self.last = Some(GyroSample { time_ns: input.time_ns, angle_rad: value_rad });
        self.unread_rad = 0.0;
        if is_jump(value_rad, last.angle_rad, read_rad, expected_rad, passed_s) {
            self.still = None;
            return self.anew(predicted_rad, Events::GYRO_RESET);
        }
        self.watch_rate(input.time_ns, read_rad);
        let change_rad = read_rad * input.per_scale;
        if self.saturated || value_rad.abs() >= RAIL_RAD {
            return self.beyond_limits(input, change_rad);
        }
        let gyro_rad = change_rad - self.bias_rad_s * passed_s;
        self.centre_rad += gyro_rad;
        let from_rad = self.stand(input, change_rad).unwrap_or(predicted_rad);
        HeadingStep {
            heading_rad: within(
                from_rad,
                self.centre_rad - WINDOW_RAD,
                self.centre_rad + WINDOW_RAD,
            ),
            change_rad: Some(change_rad),
            gyro_rad: Some(gyro_rad),
            events: Events::NONE,
        }
    }

    /// No reading, or the first one.
    fn without_change(&mut self, input: GyroInput, predicted_rad: f64) -> HeadingStep {
        if let Some(angle_rad) = input.value_rad {
            self.last = Some(GyroSample { time_ns: input.time_ns, angle_rad });
            self.rate_since_ns = input.time_ns;
            return self.anew(predicted_rad, Events::NONE);
        }
        self.unread_rad += input.encoder_rad;
        self.still = None;
        let events = Events::GYRO_LOST.when(self.last.is_some());
        HeadingStep { heading_rad: predicted_rad, change_rad: None, gyro_rad: None, events }
    }

    /// Puts the window around a heading that did not come from the gyro.
    fn anew(&mut self, heading_rad: f64, events: Events) -> HeadingStep {
        self.centre_rad = heading_rad;
        HeadingStep { heading_rad, change_rad: None, gyro_rad: None, events }
    }

    /// A saturated gyro says less than the truth: of gyro and encoders, the greater turn in the
    /// gyro's direction counts. At the end of its 16 bits it may be stuck, and then the encoders
    /// alone count.
    fn beyond_limits(&mut self, input: GyroInput, change_rad: f64) -> HeadingStep {
        let same_way = change_rad * input.encoder_rad > 0.0;
        let encoders = !self.saturated || (same_way && input.encoder_rad.abs() > change_rad.abs());
        let turn_rad = if encoders { input.encoder_rad } else { change_rad };
        self.still = None;
        let step = self.anew(input.heading_rad + turn_rad, Events::GYRO_SATURATED);
        HeadingStep { change_rad: Some(change_rad), ..step }
    }

    fn watch_rate(&mut self, now_ns: i64, change_rad: f64) {
        self.rate_rad += change_rad;
        let passed_ns = now_ns.saturating_sub(self.rate_since_ns);
        if passed_ns >= RATE_WINDOW_NS {
            self.saturated = self.rate_rad.abs() > SATURATED_RAD_S * seconds_nearly(passed_ns);
            self.rate_since_ns = now_ns;
            self.rate_rad = 0.0;
        }
    }

    /// Follows a standstill; returns the heading it began with while it lasts.
    fn stand(&mut self, input: GyroInput, change_rad: f64) -> Option<f64> {
        if !input.still {
            self.still = None;
            return None;
        }
        let mut still = self.still.unwrap_or(Standstill {
            since_ns: input.time_ns,
            heading_rad: input.heading_rad,
            bias_rad_s: self.bias_rad_s,
            turned_rad: 0.0,
            first: None,
            last: None,
        });
        let edge = change_rad.abs() > 0.5 * DEGREE_RAD;
        if edge && still.is_turned_by_hand(input.time_ns, change_rad) {
            self.correct_bias(&still, input.time_ns, still.bias_rad_s);
            self.still = None;
            return None;
        }
        if edge {
            still.note(input.time_ns, change_rad);
        }
        if let Some(bias_rad_s) = still.bias(input.time_ns) {
            let limited_rad_s = bias_rad_s.clamp(-BIAS_LIMIT_RAD_S, BIAS_LIMIT_RAD_S);
            self.correct_bias(&still, input.time_ns, limited_rad_s);
        }
        self.still = Some(still);
        Some(still.heading_rad)
    }

    /// Takes up a bias for the whole of a standstill.
    fn correct_bias(&mut self, still: &Standstill, now_ns: i64, bias_rad_s: f64) {
        if bias_rad_s.to_bits() == self.bias_rad_s.to_bits() {
            return;
        }
        let stood_s = seconds_nearly(now_ns.saturating_sub(still.since_ns));
        self.centre_rad -= (bias_rad_s - self.bias_rad_s) * stood_s;
        (self.bias_rad_s, self.bias_is_drift) = (bias_rad_s, false);
    }
}

impl Standstill {
    /// Whether this edge follows the one before, in the same direction, sooner than any bias makes
    /// them.
    fn is_turned_by_hand(&self, now_ns: i64, change_rad: f64) -> bool {
        let Some(before) = self.last.or(self.first) else { return false };
        let between_s = seconds(now_ns.saturating_sub(before.time_ns));
        change_rad * before.step_rad > 0.0 && change_rad.abs() > BIAS_LIMIT_RAD_S * between_s
    }

    fn note(&mut self, time_ns: i64, change_rad: f64) {
        self.turned_rad += change_rad;
        let edge = Some(StillEdge { time_ns, turned_rad: self.turned_rad, step_rad: change_rad });
        if self.first.is_none() {
            self.first = edge;
        } else {
            self.last = edge;
        }
    }

    /// What this standstill says of the bias by now, in rad/s.
    fn bias(&self, now_ns: i64) -> Option<f64> {
        let stood_ns = now_ns.saturating_sub(self.since_ns);
        if stood_ns < BIAS_AFTER_NS {
            return None;
        }
        if let (Some(first), Some(last)) = (self.first, self.last) {
            let between_ns = last.time_ns.saturating_sub(first.time_ns);
            let turned_rad = last.turned_rad - first.turned_rad;
            if between_ns >= BIAS_AFTER_NS && turned_rad.abs() > 1.5 * DEGREE_RAD {
                // Steps that have stopped coming mean less than those that came.
                let most =
                    (turned_rad.abs() + DEGREE_RAD) / seconds(now_ns.saturating_sub(first.time_ns));
                return Some(within(turned_rad / seconds(between_ns), -most, most));
            }
        }
        let stood_s = seconds_nearly(stood_ns);
        let (least_rad, most_rad) = (self.turned_rad - DEGREE_RAD, self.turned_rad + DEGREE_RAD);
        let drifted_rad = self.bias_rad_s * stood_s;
        // As little away from what it was as the steps allow: a body that settles by a degree or
        // two after a turn is not drift.
        Some(if drifted_rad < least_rad {
            least_rad / stood_s
        } else if drifted_rad > most_rad {
            most_rad / stood_s
        } else {
            self.bias_rad_s
        })
    }
}

/// A change of the sensor's angle without the wrap at the end of its 16 bits.
fn unwrapped(change_rad: f64) -> f64 {
    if change_rad > RANGE_RAD / 2.0 {
        change_rad - RANGE_RAD
    } else if change_rad < -RANGE_RAD / 2.0 {
        change_rad + RANGE_RAD
    } else {
        change_rad
    }
}

/// Whether no motion explains this change: it is faster than the sensor can follow, or ends at 0
/// all at once, and the encoders know nothing of it.
fn is_jump(
    value_rad: f64,
    last_rad: f64,
    change_rad: f64,
    expected_rad: f64,
    passed_s: f64,
) -> bool {
    let unexplained_rad = (change_rad - expected_rad).abs();
    if unexplained_rad <= JUMP_SLACK_RAD + 0.25 * expected_rad.abs() {
        return false;
    }
    let possible_rad = (RATE_LIMIT_RAD_S * passed_s).min(JUMP_CAP_RAD) + JUMP_SLACK_RAD;
    let to_zero = value_rad.abs() < 0.5 * DEGREE_RAD && last_rad.abs() > RESET_FROM_RAD;
    change_rad.abs() > possible_rad || to_zero
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK_NS: i64 = 10 * MILLISECOND_NS;

    /// A body that turns, a gyro in whole degrees that drifts, encoders that may slip.
    struct Bench {
        state: GyroState,
        now_ns: i64,
        heading_rad: f64,
        truth_deg: f64,
        gyro_zero_deg: f64,
        drift_deg_s: f64,
        /// What it says for a degree.
        scale: f64,
        events: Events,
    }

    impl Bench {
        fn new(gyro_zero_deg: f64, drift_deg_s: f64) -> Self {
            let mut bench = Self {
                state: GyroState::default(),
                now_ns: 0,
                heading_rad: 0.0,
                truth_deg: 0.0,
                gyro_zero_deg,
                drift_deg_s,
                scale: 1.0,
                events: Events::NONE,
            };
            bench.tick(0.0, 0.0, false);
            bench
        }

        /// What a 16-bit sensor says.
        fn reading_deg(&self) -> f64 {
            let deg = libm::round(
                self.gyro_zero_deg
                    + self.truth_deg * self.scale
                    + self.drift_deg_s * seconds(self.now_ns),
            );
            deg - 65_536.0 * libm::floor((deg + 32_768.0) / 65_536.0)
        }

        fn tick(&mut self, turn_deg: f64, encoder_deg: f64, still: bool) {
            self.now_ns += TICK_NS;
            self.truth_deg += turn_deg;
            let value_rad = Some(self.reading_deg() * DEGREE_RAD);
            self.take(value_rad, encoder_deg, still);
        }

        fn take(&mut self, value_rad: Option<f64>, encoder_deg: f64, still: bool) {
            let step = self.state.update(GyroInput {
                time_ns: self.now_ns,
                value_rad,
                heading_rad: self.heading_rad,
                per_scale: 1.0 / self.scale,
                encoder_rad: encoder_deg * DEGREE_RAD,
                still,
            });
            self.heading_rad = step.heading_rad;
            self.events |= step.events;
        }

        fn run(&mut self, seconds: f64, deg_s: f64, encoder_deg_s: f64) {
            #[expect(clippy::cast_possible_truncation, reason = "a few ticks")]
            for _ in 0..(seconds * 100.0) as i64 {
                self.tick(deg_s / 100.0, encoder_deg_s / 100.0, false);
            }
        }

        fn stand(&mut self, seconds: i64) {
            for _ in 0..seconds * 100 {
                self.tick(0.0, 0.0, true);
            }
        }

        fn error_deg(&self) -> f64 {
            self.heading_rad / DEGREE_RAD - self.truth_deg
        }
    }

    #[test]
    fn encoders_tell_fractions_of_a_degree_between_the_gyros_steps() {
        let mut bench = Bench::new(0.0, 0.0);
        bench.run(0.4, 1.0, 1.0);
        assert!(bench.error_deg().abs() < 1e-9, "{} degrees off", bench.error_deg());
        assert!(bench.reading_deg().abs() < 0.1, "the gyro has not moved");
    }

    #[test]
    fn encoders_that_slip_cannot_take_the_heading_out_of_the_gyros_degree() {
        let mut bench = Bench::new(7.0, 0.0);
        bench.run(10.0, 30.0, 90.0);
        assert!(bench.error_deg().abs() <= 1.0 + 1e-9, "{} degrees off", bench.error_deg());
        bench.run(10.0, -30.0, -20.0);
        assert!(bench.error_deg().abs() <= 1.0 + 1e-9, "{} degrees off", bench.error_deg());
        assert!(bench.events.is_empty(), "{}", bench.events);
    }

    #[test]
    fn the_end_of_sixteen_bits_is_passed() {
        for (zero, rate) in [(32_700.0, 90.0), (-32_700.0, -90.0)] {
            let mut bench = Bench::new(zero, 0.0);
            bench.run(3.0, rate, rate);
            assert!(bench.error_deg().abs() <= 1.0, "{} degrees off", bench.error_deg());
            assert!(!bench.events.contains(Events::GYRO_RESET), "{}", bench.events);
        }
    }

    #[test]
    fn what_a_gyro_counts_too_much_is_taken_off_and_its_bits_end_where_they_do() {
        for (zero, scale, rate) in
            [(0.0, 1.04, 90.0), (32_700.0, 0.97, 90.0), (-32_700.0, 1.04, -90.0)]
        {
            let mut bench = Bench { scale, ..Bench::new(zero, 0.0) };
            bench.run(20.0, rate, rate);
            assert!(bench.error_deg().abs() <= 1.1, "{} degrees off", bench.error_deg());
            assert!(!bench.events.contains(Events::GYRO_RESET), "{}", bench.events);
        }
    }

    #[test]
    fn a_gyro_stuck_at_the_end_of_sixteen_bits_is_left_to_the_encoders() {
        let mut bench = Bench::new(0.0, 0.0);
        bench.take(Some(32_767.0 * DEGREE_RAD), 0.0, false);
        for _ in 0..100 {
            bench.now_ns += TICK_NS;
            bench.take(Some(32_767.0 * DEGREE_RAD), 0.5, false);
        }
        assert!((bench.heading_rad / DEGREE_RAD - 50.0).abs() < 1e-6, "{}", bench.heading_rad);
        assert!(bench.events.contains(Events::GYRO_SATURATED), "{}", bench.events);
    }

    #[test]
    fn a_reset_is_noticed_and_the_heading_goes_on() {
        let mut bench = Bench::new(40.0, 0.0);
        bench.run(1.0, 20.0, 20.0);
        bench.gyro_zero_deg = -bench.truth_deg;
        bench.run(1.0, 20.0, 20.0);
        assert!(bench.events.contains(Events::GYRO_RESET), "{}", bench.events);
        assert!(bench.error_deg().abs() <= 1.0, "{} degrees off", bench.error_deg());
    }

    #[test]
    fn a_lost_gyro_leaves_the_heading_to_the_encoders_and_is_taken_up_again() {
        let mut bench = Bench::new(3.0, 0.0);
        bench.run(1.0, 40.0, 40.0);
        for _ in 0..100 {
            bench.now_ns += TICK_NS;
            bench.truth_deg += 0.4;
            bench.take(None, 0.4, false);
        }
        assert!(bench.events.contains(Events::GYRO_LOST), "{}", bench.events);
        bench.run(1.0, 40.0, 40.0);
        assert!(!bench.events.contains(Events::GYRO_RESET), "{}", bench.events);
        assert!(bench.error_deg().abs() <= 0.6, "{} degrees off", bench.error_deg());
    }

    #[test]
    fn a_turn_beyond_440_degrees_a_second_is_noticed_and_taken_from_the_encoders() {
        let mut bench = Bench::new(0.0, 0.0);
        for _ in 0..100 {
            bench.tick(0.0, 0.0, false);
        }
        // The body turns at 520 °/s; the sensor follows at 440.
        for _ in 0..100 {
            bench.gyro_zero_deg -= 0.8;
            bench.tick(5.2, 5.2, false);
        }
        assert!(bench.events.contains(Events::GYRO_SATURATED), "{}", bench.events);
        assert!(bench.error_deg().abs() < 10.0, "{} degrees off after 520", bench.error_deg());
    }

    #[test]
    fn the_bias_of_a_drifting_gyro_is_timed_at_a_standstill_and_removed() {
        for drift_deg_s in [1.0, -1.0, 0.4, 2.7, -3.3] {
            let mut bench = Bench::new(0.0, drift_deg_s);
            bench.stand(8);
            let bias = bench.state.bias_rad_s() / DEGREE_RAD;
            assert!((bias - drift_deg_s).abs() < 0.03, "{bias} for a drift of {drift_deg_s} °/s");
            assert!(
                bench.error_deg().abs() < 1.0,
                "{} degrees off after standing",
                bench.error_deg()
            );
            bench.run(30.0, 20.0, 20.0);
            assert!(bench.error_deg().abs() < 2.0, "{} degrees off after 30 s", bench.error_deg());
        }
    }

    #[test]
    fn a_gyro_that_does_not_drift_is_given_no_bias() {
        let mut bench = Bench::new(0.0, 0.0);
        bench.stand(60);
        assert!(bench.state.bias_rad_s().abs() < 1e-12, "{} rad/s", bench.state.bias_rad_s());
    }

    #[test]
    fn a_body_that_settles_after_a_turn_leaves_hardly_any_bias() {
        let mut bench = Bench::new(0.0, 0.0);
        bench.tick(1.0, 0.0, true);
        for _ in 0..30 {
            bench.tick(0.0, 0.0, true);
        }
        bench.tick(1.0, 0.0, true);
        bench.stand(10);
        let bias = bench.state.bias_rad_s() / DEGREE_RAD;
        assert!(bias.abs() < 0.11, "{bias} °/s");
        assert!(bench.error_deg().abs() < 1.6, "{} degrees off", bench.error_deg());
    }

    #[test]
    fn a_robot_turned_by_hand_at_a_standstill_keeps_its_turn() {
        let mut bench = Bench::new(0.0, 0.0);
        bench.stand(3);
        for _ in 0..200 {
            bench.tick(0.45, 0.0, true);
        }
        bench.stand(3);
        assert!(
            bench.error_deg().abs() < 3.0,
            "{} degrees off after a turn of 90",
            bench.error_deg()
        );
    }
}
