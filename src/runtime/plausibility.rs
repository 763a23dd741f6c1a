//! Readings that cannot be true: they stand still although they must move, or leap about.
//!
//! A device that is gone answers with an error and is *lost*. A sensor whose line is dead repeats
//! its last value instead. What shows it is that something else moves what it measures:
//!
//! | reading | must change | and has not |
//! |---|---|---|
//! | gyro | while the wheels turn the robot to one side | that way by its least step in 60° |
//! | range | while the robot drives towards what it measures, or away from it | by a bit in 0.2 m and 2 s |
//! | head's angle | while the head is told to turn to a place that is far from it | by a count in 1 s |
//!
//! A live sensor never comes near that: a gyro says whole degrees, and of a robot that spun its
//! wheels on a smooth floor it still saw 40 % of the turn (`tests/it/figures/encoder_gyro.rs`). A
//! range says millimetres or, with infrared, a few of them.
//!
//! A gyro or a head that leaps eight times in two seconds, further than anything turns, is not
//! believed either; a reset sensor leaps once.
//!
//! A gyro that turns the other way round than the wheels has left and right exchanged beside it, or
//! is upside down.
//!
//! The wheels' own angles are watched by `stall`: a wheel whose angle stands still is blocked.
//!
//! # Not here
//!
//! - A sensor that says no echo for ever: in the open a good one does so as well.
//! - A scale that is off, values that are late by less than a second: slipping wheels, a track
//!   width that is not quite right, and a gyro that drifts look the same.
//!
//! # What we count on
//!
//! - [`Reading::changed_ns`](crate::senses::Reading) is when the reading changed last, by whatever
//!   little.
//! - Wheels that turn a robot which cannot move, or in the air, are seen here as a gyro that stands
//!   still. The run ends rightly then, too: the robot's position is unknown.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use crate::clock::SECOND_NS;
use crate::mapping::{Estimate, Events, Range};
use crate::robot::RobotConfig;
use crate::senses::{Channel, Senses};

/// So far the wheels may turn the robot to one side while the gyro does not move, radians.
const TURN_RAD: f64 = PI / 3.0;

/// So far the robot may drive along the beam while the range does not move, metres, and so long it
/// must take, nanoseconds: something that moves before the robot at its own speed keeps its
/// distance for moments.
const WAY_M: f64 = 0.2;
const WAY_NS: i64 = 2 * SECOND_NS;

/// A way is along the beam up to 30° beside it: the square of that cosine. Beside a wall the
/// distance stays as it is.
const ALONG_SHARE: f64 = 0.75;

/// A head that is told to turn further than this, radians, moves within this time, nanoseconds.
const HEAD_FAR_RAD: f64 = 0.087;
const HEAD_NS: i64 = SECOND_NS;

/// No head turns by this much from tick to tick, radians.
const HEAD_LEAP_RAD: f64 = 1.0;

/// This many leaps in such a time, nanoseconds, are no accident.
const LEAPS: u8 = 8;
const LEAPS_NS: i64 = 2 * SECOND_NS;

/// No robot is turned so far by its wheels from tick to tick, radians: a wheel's angle leaped.
const WHEELS_LEAP_RAD: f64 = 0.5;

/// Looks for readings that cannot be true: what a robot can do, and what a run needs of it.
#[derive(Debug)]
pub(super) struct Plausibility {
    /// How far the robot turns for a radian that one wheel turns more than the other.
    turn_per_rad: f64,
    /// How far the head may turn to either side, radians.
    head_limit_rad: f64,
    gyro: bool,
    range: bool,
    head: bool,
}

/// What is carried from tick to tick.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct PlausibilityState {
    /// What the right wheel has turned more than the left one, radians.
    wheels_rad: Option<f64>,
    /// Where the range sensor was when it last measured.
    sensor_m: Option<[f64; 2]>,
    head_rad: Option<f64>,
    /// Since when the head has been told to turn.
    told_since_ns: Option<i64>,
    gyro: Still,
    /// Recordings made before this was in them have none.
    #[serde(default)]
    gyro_rad: Option<f64>,
    range: Still,
    gyro_leaps: Leaps,
    head_leaps: Leaps,
}

/// A reading that does not change, and what should have changed it since.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
struct Still {
    changed_ns: i64,
    moved: f64,
}

impl Still {
    /// How far what is measured has moved since the reading changed, without its sign.
    fn add(&mut self, changed_ns: i64, moved: f64) -> f64 {
        if self.changed_ns == changed_ns {
            self.moved += moved;
        } else {
            *self = Self { changed_ns, moved: 0.0 };
        }
        self.moved.abs()
    }
}

/// Leaps since a time.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
struct Leaps {
    since_ns: i64,
    count: u8,
}

impl Leaps {
    /// True if there were too many.
    fn add(&mut self, now_ns: i64) -> bool {
        if self.count == 0 || now_ns.saturating_sub(self.since_ns) > LEAPS_NS {
            *self = Self { since_ns: now_ns, count: 0 };
        }
        self.count = self.count.saturating_add(1);
        self.count >= LEAPS
    }
}

impl Plausibility {
    /// Watches those of the robot's readings that the run needs.
    pub(super) fn new(config: &RobotConfig, required: &[Channel]) -> Self {
        let needs = |channel| required.contains(&channel);
        Self {
            turn_per_rad: config.drive.wheel_circumference_m
                / (2.0 * PI * config.drive.track_width_m),
            head_limit_rad: config.head.as_ref().map_or(0.0, |head| head.limit_rad),
            gyro: needs(Channel::Gyro),
            range: needs(Channel::Range),
            head: needs(Channel::Head),
        }
    }

    /// One tick: the reading that cannot be true, if there is one.
    ///
    /// - `head_rad`: where the head was told to point at the tick before.
    pub(super) fn step(
        &self,
        state: &mut PlausibilityState,
        senses: &Senses,
        estimate: &Estimate,
        head_rad: Option<f64>,
    ) -> Option<Channel> {
        let turned_rad = self.turned_rad(state, senses);
        [
            (Channel::Gyro, self.gyro && self.doubts_gyro(state, senses, estimate, turned_rad)),
            (Channel::Range, self.range && self.doubts_range(state, senses, estimate)),
            (Channel::Head, self.head && self.doubts_head(state, senses, head_rad)),
        ]
        .into_iter()
        .find_map(|(channel, doubted)| doubted.then_some(channel))
    }

    /// How far the wheels have turned the robot since the tick before, radians.
    fn turned_rad(&self, state: &mut PlausibilityState, senses: &Senses) -> f64 {
        let wheel = |channel| senses.fresh(channel, 0);
        let (Some(left_rad), Some(right_rad)) = (wheel(Channel::Left), wheel(Channel::Right))
        else {
            // What they turn meanwhile is made up for, as they are counts.
            return 0.0;
        };
        let wheels_rad = right_rad - left_rad;
        let before_rad = state.wheels_rad.replace(wheels_rad).unwrap_or(wheels_rad);
        (wheels_rad - before_rad) * self.turn_per_rad
    }

    fn doubts_gyro(
        &self,
        state: &mut PlausibilityState,
        senses: &Senses,
        estimate: &Estimate,
        turned_rad: f64,
    ) -> bool {
        // One that could not be read in this tick has not been seen to stand still.
        let Some(gyro) = senses.get(Channel::Gyro).filter(|gyro| gyro.read_ns == senses.time_ns)
        else {
            return false;
        };
        let turned_rad = if turned_rad.abs() < WHEELS_LEAP_RAD { turned_rad } else { 0.0 };
        let leaps =
            estimate.events.contains(Events::GYRO_RESET) && state.gyro_leaps.add(senses.time_ns);
        let step_rad = gyro.value - state.gyro_rad.replace(gyro.value).unwrap_or(gyro.value);
        // One that moves against the wheels does not follow them.
        let follows = step_rad.abs() > 0.0 && step_rad * state.gyro.moved >= 0.0;
        let changed_ns = if follows { senses.time_ns } else { state.gyro.changed_ns };
        leaps || state.gyro.add(changed_ns, turned_rad) > TURN_RAD
    }

    fn doubts_range(
        &self,
        state: &mut PlausibilityState,
        senses: &Senses,
        estimate: &Estimate,
    ) -> bool {
        let Some(sounding) = estimate.sounding.filter(|sounding| sounding.fresh) else {
            return false;
        };
        let Some(range) = senses.get(Channel::Range) else { return false };
        let here_m = [sounding.x_m, sounding.y_m];
        let before_m = state.sensor_m.replace(here_m).unwrap_or(here_m);
        let [x_m, y_m] = [here_m[0] - before_m[0], here_m[1] - before_m[1]];
        let along_m = x_m * sounding.beam[0] + y_m * sounding.beam[1];
        let is_along = along_m * along_m >= ALONG_SHARE * (x_m * x_m + y_m * y_m);
        let measures = matches!(sounding.range, Range::Echo(_));
        let moved_m = if is_along && measures { along_m } else { 0.0 };
        state.range.add(range.changed_ns, moved_m) > WAY_M
            && measures
            && senses.time_ns - range.changed_ns >= WAY_NS
    }

    fn doubts_head(
        &self,
        state: &mut PlausibilityState,
        senses: &Senses,
        wanted_rad: Option<f64>,
    ) -> bool {
        let Some(head) = senses.get(Channel::Head) else { return false };
        let before_rad = state.head_rad.replace(head.value).unwrap_or(head.value);
        if (head.value - before_rad).abs() > HEAD_LEAP_RAD && state.head_leaps.add(senses.time_ns) {
            return true;
        }
        let limit_rad = self.head_limit_rad;
        let is_far = |wanted_rad: f64| {
            let beyond = wanted_rad.abs() > limit_rad;
            let reached_rad = if beyond { limit_rad.copysign(wanted_rad) } else { wanted_rad };
            (reached_rad - head.value).abs() > HEAD_FAR_RAD
        };
        if !wanted_rad.is_some_and(is_far) {
            state.told_since_ns = None;
            return false;
        }
        let since_ns = *state.told_since_ns.get_or_insert(senses.time_ns);
        senses.time_ns.saturating_sub(since_ns.max(head.changed_ns)) > HEAD_NS
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::MILLISECOND_NS;
    use crate::mapping::{
        Estimator, EstimatorConfig, GyroReading, Inputs, Method, Pose, RangeReading,
    };
    use crate::robot::DEFAULT_ROBOT;

    const TICK_NS: i64 = 20 * MILLISECOND_NS;

    /// A robot whose readings are made up tick by tick.
    struct Bench {
        watch: Plausibility,
        state: PlausibilityState,
        estimator: Estimator,
        senses: Senses,
        head_rad: Option<f64>,
    }

    impl Bench {
        fn new() -> Self {
            let config = RobotConfig::load("robot.toml", DEFAULT_ROBOT.as_bytes()).unwrap().0;
            let geometry = config.geometry().unwrap();
            Self {
                watch: Plausibility::new(&config, &Channel::ALL),
                state: PlausibilityState::default(),
                estimator: Estimator::new(
                    EstimatorConfig { geometry, method: Method::Default },
                    Pose::default(),
                ),
                senses: Senses::default(),
                head_rad: None,
            }
        }

        fn tick(&mut self, readings: [(Channel, f64); 5]) -> Option<Channel> {
            self.senses.time_ns += TICK_NS;
            readings.into_iter().for_each(|(channel, value)| self.senses.set(channel, value));
            let get = |channel| self.senses.get(channel).unwrap();
            let (gyro, range) = (get(Channel::Gyro), get(Channel::Range));
            let estimate = self.estimator.update(&Inputs {
                time_ns: self.senses.time_ns,
                left_rad: Some(get(Channel::Left).value),
                right_rad: Some(get(Channel::Right).value),
                gyro: Some(GyroReading { value_rad: gyro.value, changed_ns: gyro.changed_ns }),
                head_rad: Some(get(Channel::Head).value),
                range: Some(RangeReading { value_m: range.value, changed_ns: range.changed_ns }),
            });
            self.watch.step(&mut self.state, &self.senses, &estimate, self.head_rad)
        }

        /// Plays a minute of readings by the time in seconds: when one was doubted, and which.
        fn play(&mut self, readings: impl Fn(f64) -> [f64; 5]) -> Option<(f64, Channel)> {
            (1..3000).find_map(|tick| {
                let time_s = f64::from(tick) * 0.02;
                let [left, right, head, range, gyro] = readings(time_s);
                self.tick([
                    (Channel::Left, left),
                    (Channel::Right, right),
                    (Channel::Head, head),
                    (Channel::Range, range),
                    (Channel::Gyro, gyro),
                ])
                .map(|channel| (time_s, channel))
            })
        }
    }

    /// Whole degrees, as the sensor says them.
    fn whole(angle_rad: f64) -> f64 {
        crate::units::radians(libm::round(crate::units::degrees(angle_rad)))
    }

    /// A wheel's angle after a way.
    fn wheel(way_m: f64) -> f64 {
        way_m / 0.188_976 * 2.0 * PI
    }

    #[test]
    fn a_gyro_that_stands_still_while_the_wheels_turn_the_robot_is_doubted() {
        // A wheel each way at 60 degrees a second: 31.5 degrees a second round.
        let turning = |time_s: f64| wheel(0.0315 * time_s);
        let turn_rad = |time_s: f64| 2.0 * 0.0315 * time_s / 0.1143;
        let live = Bench::new().play(|time_s| {
            [-turning(time_s), turning(time_s), 0.0, f64::INFINITY, whole(turn_rad(time_s))]
        });
        assert_eq!(live, None);
        let slipping = Bench::new().play(|time_s| {
            [-turning(time_s), turning(time_s), 0.0, f64::INFINITY, whole(0.1 * turn_rad(time_s))]
        });
        assert_eq!(slipping, None, "a tenth of the turn is slip");
        let (at_s, doubted) = Bench::new()
            .play(|time_s| [-turning(time_s), turning(time_s), 0.0, f64::INFINITY, 0.5])
            .expect("it never moves");
        assert!(doubted == Channel::Gyro && (1.8..2.1).contains(&at_s), "{doubted} after {at_s} s");
        let (at_s, doubted) = Bench::new()
            .play(|time_s| {
                let gyro_rad = whole(-turn_rad(time_s));
                [-turning(time_s), turning(time_s), 0.0, f64::INFINITY, gyro_rad]
            })
            .expect("it turns the other way round");
        assert!(doubted == Channel::Gyro && (1.8..2.3).contains(&at_s), "{doubted} after {at_s} s");
        let trembling = Bench::new().play(|time_s| {
            let gyro_rad = whole(turn_rad(time_s) + 0.03 * libm::sin(90.0 * time_s));
            [-turning(time_s), turning(time_s), 0.0, f64::INFINITY, gyro_rad]
        });
        assert_eq!(trembling, None);
        let straight =
            Bench::new().play(|time_s| [turning(time_s), turning(time_s), 0.0, 2.0 - time_s, 0.5]);
        assert_eq!(straight, None, "straight on it may");
    }

    #[test]
    fn wheels_that_go_to_and_fro_do_not_add_up() {
        let shaking = |time_s: f64| 0.4 * libm::sin(3.0 * time_s);
        let doubted = Bench::new()
            .play(|time_s| [-shaking(time_s), shaking(time_s), 0.0, f64::INFINITY, 0.5]);
        assert_eq!(doubted, None);
    }

    #[test]
    fn a_gyro_that_leaps_about_is_doubted_and_one_that_is_reset_is_not() {
        let leaping = |time_s: f64| whole(30.0 * libm::sin(time_s * 1000.0));
        let (at_s, doubted) =
            Bench::new().play(|time_s| [0.0, 0.0, 0.0, f64::INFINITY, leaping(time_s)]).unwrap();
        assert!(doubted == Channel::Gyro && at_s < 1.0, "{doubted} after {at_s} s");
        let reset = |time_s: f64| if time_s % 3.0 < 1.5 { 0.0 } else { 2.0 };
        assert_eq!(Bench::new().play(|time_s| [0.0, 0.0, 0.0, f64::INFINITY, reset(time_s)]), None);
    }

    #[test]
    fn a_range_that_stands_still_while_the_robot_drives_towards_what_it_measures_is_doubted() {
        let drive = |range: fn(f64) -> f64, head_rad: f64| {
            let on = |time_s: f64| wheel(0.05 * time_s);
            Bench::new().play(move |time_s| [on(time_s), on(time_s), head_rad, range(time_s), 0.0])
        };
        let (at_s, doubted) = drive(|_| 0.7, 0.0).unwrap();
        assert!(
            doubted == Channel::Range && (4.0..4.5).contains(&at_s),
            "{doubted} after {at_s} s"
        );
        let (at_s, doubted) = drive(|_| 0.7, PI).unwrap();
        assert!(
            doubted == Channel::Range && (4.0..4.5).contains(&at_s),
            "{doubted} after {at_s} s, away"
        );
        assert_eq!(drive(|_| f64::INFINITY, 0.0), None, "in the open");
        assert_eq!(drive(|_| 0.7, PI / 3.0), None, "along a wall");
        assert_eq!(drive(|time_s| whole(3.0 - 0.05 * time_s), 0.0), None, "in coarse steps");
    }

    #[test]
    fn something_that_moves_along_before_the_robot_keeps_its_distance_for_a_while() {
        let fast = |time_s: f64| wheel(0.3 * time_s);
        let changing = |time_s: f64| 0.5 + 0.01 * libm::floor(time_s / 1.5);
        assert_eq!(
            Bench::new().play(|time_s| [fast(time_s), fast(time_s), 0.0, changing(time_s), 0.0]),
            None
        );
    }

    #[test]
    fn a_head_that_does_not_turn_as_it_is_told_is_doubted_and_one_that_stands_where_it_should_is_not()
     {
        let mut bench = Bench { head_rad: Some(1.0), ..Bench::new() };
        let (at_s, doubted) = bench.play(|_| [0.0, 0.0, 0.2, f64::INFINITY, 0.0]).unwrap();
        assert!(doubted == Channel::Head && (1.0..1.2).contains(&at_s), "{doubted} after {at_s} s");
        let mut bench = Bench { head_rad: Some(1.0), ..Bench::new() };
        assert_eq!(bench.play(|_| [0.0, 0.0, 0.95, f64::INFINITY, 0.0]), None);
        let mut bench = Bench { head_rad: Some(1.0), ..Bench::new() };
        let slow = |time_s: f64| (0.02 * time_s).min(1.0);
        assert_eq!(bench.play(|time_s| [0.0, 0.0, slow(time_s), f64::INFINITY, 0.0]), None);
        let mut bench = Bench::new();
        assert_eq!(
            bench.play(|_| [0.0, 0.0, 0.2, f64::INFINITY, 0.0]),
            None,
            "it was told nothing"
        );
    }

    #[test]
    fn a_head_whose_angle_leaps_about_is_doubted() {
        let leaping = |time_s: f64| 50.0 * libm::sin(time_s * 1000.0);
        let (at_s, doubted) =
            Bench::new().play(|time_s| [0.0, 0.0, leaping(time_s), f64::INFINITY, 0.0]).unwrap();
        assert!(doubted == Channel::Head && at_s < 1.0, "{doubted} after {at_s} s");
    }
}
