//! One update of the estimator: wheels, heading, step, covariance, history, range, in this order.

use serde::{Deserialize, Serialize};

use super::drift::{DriftWatch, Turned, Verdict};
use super::filter::Step;
use super::geometry::{EstimatorConfig, Geometry, Method};
use super::gyro::{GyroInput, GyroState};
use super::history::{History, Placement};
use super::keyframes::KeyframeList;
use super::pose::Correction;
use super::range::{Beam, RangeFilter};
use super::slip::SlipState;
use super::sounding::{Schedule, Sounding};
use super::survey::{Heard, Survey};
use super::uncertainty::{self, Covariance};
use super::wheels::{WheelStep, WheelsState};
use super::whole_turn::SpinWatch;
use super::{Estimate, Events, Inputs, MapPoint, Pose, Range, RangeReading};
use crate::clock::seconds_nearly;

/// Speeds are smoothed over this: a whole degree of a wheel in a tick of 10 ms would else be 5
/// cm/s.
pub(super) const SPEED_MEMORY_S: f64 = 0.1;

/// A head that is nearer to straight ahead than this looks there, radians: 6°.
const STRAIGHT_RAD: f64 = 0.105;

/// A standstill that finds another bias than this has found the same, rad/s: 0.02° in ten minutes.
const SAME_BIAS_RAD_S: f64 = 6e-7;

/// Within this a correction of the pose is half to two thirds told.
const SETTLE_S: f64 = 0.3;

/// What the estimator carries from tick to tick: everything that later results depend on, and
/// nothing else. It is of fixed size and has only finite numbers.
///
/// Text that is to carry it bit for bit has to keep floats exactly (with `serde_json` that is its
/// feature `float_roundtrip`).
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct EstimatorState {
    /// The pose by odometry alone.
    pub odometry: Pose,
    /// The time of the last update; `None` before the first.
    time_ns: Option<i64>,
    /// The heading when both wheels were last read.
    wheels_heading_rad: f64,
    covariance: Covariance,
    travelled_m: f64,
    forward_m_s: f64,
    turn_rad_s: f64,
    wheels: WheelsState,
    gyro: GyroState,
    drift: DriftWatch,
    slip: SlipState,
    history: History,
    near: RangeFilter,
    schedule: Schedule,
    survey: Survey,
    spin: SpinWatch,
    /// What the pose that is told is still behind by after corrections.
    unsettled: Pose,
}

/// Estimates the pose from wheels and gyro, and places range readings. See [`crate::mapping`] for
/// the formulas.
#[derive(Debug, Clone)]
pub struct Estimator {
    config: EstimatorConfig,
    state: EstimatorState,
}

impl Estimator {
    /// An estimator at its start. A start that is not finite counts as the origin.
    #[must_use]
    pub fn new(config: EstimatorConfig, start: Pose) -> Self {
        let pose = if start.is_finite() { start } else { Pose::default() };
        let placement = Placement { time_ns: i64::MIN, pose, head_rad: None };
        let mut history = History::default();
        history.note(placement);
        let state = EstimatorState {
            odometry: pose,
            survey: Survey::new(pose, config.geometry.gyro_scale_sd()),
            wheels_heading_rad: pose.heading_rad,
            covariance: uncertainty::at_start(),
            history,
            ..EstimatorState::default()
        };
        Self { config, state }
    }

    /// What it was made from.
    #[must_use]
    pub fn config(&self) -> &EstimatorConfig {
        &self.config
    }

    /// Everything it carries from tick to tick.
    #[must_use]
    pub fn state(&self) -> EstimatorState {
        self.state.clone()
    }

    /// Continues from a state: the same inputs then give the same bits as without an interruption.
    /// Returns false, and changes nothing, if the state's parts do not fit each other.
    pub fn restore(&mut self, state: EstimatorState) -> bool {
        let fits = state.survey.landmarks.is_whole();
        if fits {
            self.state = state;
        }
        fits
    }

    /// The pose at a time within the last quarter of a second; the newest for later times, the
    /// oldest kept for earlier ones.
    #[must_use]
    pub fn pose_at(&self, time_ns: i64) -> Pose {
        self.state.history.at(time_ns).pose
    }

    /// What is known now of where the robot was, for [`where_now`](super::where_now); empty where
    /// nothing corrects the pose.
    #[must_use]
    pub fn keyframes(&self) -> KeyframeList {
        match (self.config.method, self.state.time_ns) {
            (Method::Default, Some(now_ns)) => self.state.survey.keyframes(now_ns),
            _ => KeyframeList::default(),
        }
    }

    /// The points that still wait for their place, at the end of a run: the sweep ends here.
    pub fn finish(&mut self) -> Vec<MapPoint> {
        self.state.survey.finish(self.config.geometry.range().max_m)
    }

    /// Takes one tick's readings. Readings that no sensor can have made are left out and noticed;
    /// whatever comes in, the pose stays finite.
    pub fn update(&mut self, inputs: &Inputs) -> Estimate {
        let (inputs, mut events) = inputs.checked();
        let passed_s = self.passed_s(inputs.time_ns, &mut events);
        let wheels = self.state.wheels.update(
            &self.config.geometry,
            inputs.time_ns,
            inputs.left_rad,
            inputs.right_rad,
        );
        events |= wheels.events;
        let before = self.state.odometry;
        let trust = self.turn(&inputs, &wheels, passed_s, &mut events);
        let turned_rad = self.state.odometry.heading_rad - before.heading_rad;
        self.step(&wheels, passed_s, trust);
        self.smooth_speeds(wheels.forward_m, turned_rad, passed_s);
        if self.config.method == Method::Default {
            self.follow(&before, passed_s, trust);
            self.state.survey.keep_pose(inputs.time_ns);
        }
        let pose = self.pose();
        let told = self.told(&pose, passed_s);
        self.state.history.note(Placement {
            time_ns: inputs.time_ns,
            pose,
            head_rad: inputs.head_rad,
        });
        let inputs =
            Inputs { range: inputs.range.and_then(|range| self.heard(&inputs, range)), ..inputs };
        let range = self.understand(&inputs);
        let sounding = range.and_then(|range| self.sound(&inputs, range, &mut events));
        let placed = self.state.survey.placed();
        Estimate {
            time_ns: inputs.time_ns,
            pose: told,
            forward_m_s: self.state.forward_m_s,
            turn_rad_s: self.state.turn_rad_s,
            covariance: self.state.covariance,
            travelled_m: self.state.travelled_m,
            range,
            sounding,
            placed,
            events,
        }
    }

    /// The pose: that of odometry, corrected by landmarks.
    fn pose(&self) -> Pose {
        match self.config.method {
            Method::Default => self.state.survey.pose(),
            Method::Odometry | Method::Seed => self.state.odometry,
        }
    }

    /// The pose as it is told: a correction comes in over [`SETTLE_S`], so that what drives by the
    /// pose does not jump.
    fn told(&mut self, pose: &Pose, passed_s: f64) -> Pose {
        let unsettled = &mut self.state.unsettled;
        if *unsettled == Pose::default() {
            return *pose;
        }
        *unsettled = unsettled.toward(&Pose::default(), (passed_s / SETTLE_S).min(1.0));
        // Below a micrometre nothing is left.
        if unsettled.x_m.abs() + unsettled.y_m.abs() + unsettled.heading_rad.abs() < 1e-6 {
            *unsettled = Pose::default();
        }
        pose.plus(unsettled)
    }

    /// Hands the step from an earlier pose of odometry on to what corrects it.
    fn follow(&mut self, before: &Pose, passed_s: f64, trust: Trust) {
        let now = self.state.odometry;
        let (x_m, y_m) = (now.x_m - before.x_m, now.y_m - before.y_m);
        let [cos, sin] =
            if x_m != 0.0 || y_m != 0.0 { unit(before.heading_rad) } else { [1.0, 0.0] };
        self.state.survey.landmarks.filter.step(&Step {
            forward_m: x_m * cos + y_m * sin,
            left_m: y_m * cos - x_m * sin,
            turn_rad: now.heading_rad - before.heading_rad,
            passed_s,
            by_gyro: trust.by_gyro,
            slip_m: trust.slip_m,
        });
    }

    fn passed_s(&mut self, now_ns: i64, events: &mut Events) -> f64 {
        let Some(last_ns) = self.state.time_ns.replace(now_ns) else { return 0.0 };
        *events |= Events::TIME_BACKWARDS.when(now_ns < last_ns);
        seconds_nearly(now_ns.saturating_sub(last_ns).max(0))
    }

    /// Brings the heading up to now; returns how far the step can be trusted.
    fn turn(
        &mut self,
        inputs: &Inputs,
        wheels: &WheelStep,
        passed_s: f64,
        events: &mut Events,
    ) -> Trust {
        let before_rad = self.state.odometry.heading_rad;
        let stood_with_rad_s = self.state.gyro.stands_with_rad_s();
        let step = self.state.gyro.update(GyroInput {
            time_ns: inputs.time_ns,
            value_rad: inputs.gyro.map(|gyro| gyro.value_rad),
            per_scale: self.config.geometry.per_gyro_scale(),
            heading_rad: before_rad,
            encoder_rad: wheels.turn_rad,
            still: wheels.still,
        });
        *events |= step.events;
        let gyro = &self.state.gyro;
        let has_stood = stood_with_rad_s.filter(|_| gyro.stands_with_rad_s().is_none());
        if has_stood.is_some_and(|before| (before - gyro.bias_rad_s()).abs() > SAME_BIAS_RAD_S) {
            self.state.survey.landmarks.filter.forget_bias();
        }
        self.state.odometry.heading_rad = match self.config.method {
            Method::Default | Method::Odometry => step.heading_rad,
            // Without a believable change of the gyro the seed's heading stays.
            Method::Seed => before_rad + step.change_rad.unwrap_or(0.0),
        };
        let by_gyro = step.gyro_rad.is_some();
        let Some(gyro_rad) = step.gyro_rad.filter(|_| wheels.read) else {
            self.watch_drift(None);
            return Trust { by_gyro, slip_m: 0.0 };
        };
        let slipping = self.state.slip.update(passed_s, wheels.turn_rad, gyro_rad);
        self.watch_drift(step.change_rad.filter(|_| !slipping).map(|gyro_rad| Turned {
            passed_s,
            forward_m: wheels.forward_m,
            wheels_m: wheels.left_m.abs() + wheels.right_m.abs(),
            encoder_rad: wheels.turn_rad,
            gyro_rad,
        }));
        *events |= Events::SLIP.when(slipping);
        let unexplained_rad = if slipping { wheels.turn_rad - gyro_rad } else { 0.0 };
        Trust {
            by_gyro,
            slip_m: unexplained_rad.abs() * self.config.geometry.track_width_m() / 2.0,
        }
    }

    /// Tells a slow drift of the gyro by the wheels.
    fn watch_drift(&mut self, turned: Option<Turned>) {
        let per_track_width_m = self.config.geometry.per_track_width_m();
        let Some(drift) = self.state.drift.update(turned, per_track_width_m) else { return };
        let before_rad_s = self.state.gyro.bias_rad_s();
        let filter = &mut self.state.survey.landmarks.filter;
        match self.state.gyro.drifts(drift, filter.bias()) {
            Verdict::Wait => {}
            Verdict::NotBegun => {
                self.state.drift.begin_again(before_rad_s);
                filter.forget_bias();
            }
            Verdict::Remove(bias_rad_s) if self.config.method == Method::Default => {
                let by_rad_s = bias_rad_s - before_rad_s;
                let correction = self.state.survey.correct(|filter| filter.rebias(by_rad_s));
                self.correct(&correction);
            }
            Verdict::Remove(_) => {}
        }
    }

    /// Tells the gyro's scale by whole turns; takes the reading of a time.
    fn watch_spin(&mut self, time_ns: i64, range: Range, events: &mut Events) {
        let Placement { pose, head_rad, .. } = self.state.history.at(time_ns);
        // Landmarks correct the pose, and must have no say here.
        let since_rad = self.pose().heading_rad - pose.heading_rad;
        let odometry = &self.state.odometry;
        let at = Pose { heading_rad: odometry.heading_rad - since_rad, ..*odometry };
        let head_rad = head_rad.filter(|_| self.config.geometry.range().on_head);
        let is_straight = head_rad.is_none_or(|head_rad| head_rad.abs() < STRAIGHT_RAD);
        let range_m = match range {
            Range::Echo(range_m) => range_m,
            Range::NoEcho => f64::INFINITY,
            Range::TooNear => 0.0,
        };
        let Some(scale) = self.state.spin.take(&at, is_straight, range_m) else { return };
        *events |= Events::WHOLE_TURN;
        let off = 1.0 / scale - 1.0;
        let deviation = Geometry::MEASURED_GYRO_SCALE_SD;
        let correction =
            self.state.survey.correct(|filter| filter.observe_gyro_scale(off, deviation));
        self.correct(&correction);
    }

    /// Follows a correction of the pose.
    fn correct(&mut self, correction: &Correction) {
        let state = &mut self.state;
        state.history.correct(correction);
        state.covariance = state.survey.landmarks.filter.of_pose();
        state.unsettled = state.unsettled.plus(&correction.back());
    }

    /// Moves the pose along the wheels' way: the seed along the heading before, the default along
    /// the mean of the headings before and after, which is the chord's direction of an arc (Thrun,
    /// Burgard and Fox, section 5.4).
    fn step(&mut self, wheels: &WheelStep, passed_s: f64, trust: Trust) {
        let state = &mut self.state;
        let after_rad = state.odometry.heading_rad;
        let turned_rad = after_rad - state.wheels_heading_rad;
        let along_rad = match self.config.method {
            Method::Seed => state.wheels_heading_rad,
            Method::Default | Method::Odometry => state.wheels_heading_rad + turned_rad / 2.0,
        };
        if wheels.read {
            state.wheels_heading_rad = after_rad;
        }
        let moved = wheels.left_m != 0.0 || wheels.right_m != 0.0;
        let direction = if moved { unit(along_rad) } else { [1.0, 0.0] };
        let [cos, sin] = direction;
        state.odometry.x_m += cos * wheels.forward_m;
        state.odometry.y_m += sin * wheels.forward_m;
        state.travelled_m += wheels.forward_m.abs();
        state.covariance = uncertainty::propagated(
            state.covariance,
            &uncertainty::Step {
                direction,
                forward_m: wheels.forward_m,
                wheels_m: wheels.left_m.abs() + wheels.right_m.abs(),
                turn_rad: turned_rad,
                passed_s,
                per_track_width_m: self.config.geometry.per_track_width_m(),
                by_gyro: trust.by_gyro,
                slip_m: trust.slip_m,
            },
        );
    }

    /// A smoothed speed is the mean of what it was and of way / time, weighted by what the time
    /// leaves of the memory (the exponential's first order, as in `slip`) and by the time. An
    /// update that takes longer than the memory is all there is.
    fn smooth_speeds(&mut self, forward_m: f64, turned_rad: f64, passed_s: f64) {
        let state = &mut self.state;
        if passed_s >= SPEED_MEMORY_S {
            [state.forward_m_s, state.turn_rad_s] = [forward_m / passed_s, turned_rad / passed_s];
        } else if passed_s > 0.0 {
            let keep = 1.0 - passed_s * (1.0 / SPEED_MEMORY_S);
            state.forward_m_s = state.forward_m_s * keep + forward_m * (1.0 / SPEED_MEMORY_S);
            state.turn_rad_s = state.turn_rad_s * keep + turned_rad * (1.0 / SPEED_MEMORY_S);
        }
    }

    /// A reading as the distance that it stands for: without the sensor's bias and scale, and none
    /// where the robot has heard itself. Nothing after this knows of either.
    fn heard(&self, inputs: &Inputs, range: RangeReading) -> Option<RangeReading> {
        let mount = self.config.geometry.range();
        let at_ns = range.changed_ns.min(inputs.time_ns).saturating_sub(mount.latency_ns);
        // A reading that has not changed may be of then or of now.
        let heads_rad = [self.state.history.at(at_ns).head_rad, inputs.head_rad];
        let is_own = heads_rad
            .iter()
            .flatten()
            .any(|head_rad| mount.own_echoes.has(*head_rad, range.value_m));
        (!is_own).then(|| RangeReading { value_m: mount.distance_m(range.value_m), ..range })
    }

    fn understand(&mut self, inputs: &Inputs) -> Option<Range> {
        let reading = inputs.range?;
        let newest =
            Placement { time_ns: inputs.time_ns, pose: self.pose(), head_rad: inputs.head_rad };
        let mut near = self.state.near;
        let range = near.understood(reading.value_m, || {
            // Without the head's angle the beam is taken as straight ahead: where the robot drives.
            self.beam(&newest).unwrap_or_else(|| self.beam_at(&newest, 0.0))
        });
        self.state.near = near;
        Some(range)
    }

    /// Places the reading, if it is to be placed in this tick.
    fn sound(&mut self, inputs: &Inputs, range: Range, events: &mut Events) -> Option<Sounding> {
        let due_ns = self.state.schedule.due(inputs.time_ns, inputs.range?.changed_ns);
        let (time_ns, fresh) = match (self.config.method, due_ns) {
            (Method::Seed, due_ns) => (inputs.time_ns, due_ns.is_some()),
            (Method::Default | Method::Odometry, due_ns) => {
                (due_ns?.saturating_sub(self.config.geometry.range().latency_ns), true)
            }
        };
        if self.config.method == Method::Default {
            self.watch_spin(time_ns, range, events);
        }
        let placement = self.state.history.at(time_ns);
        let beam = self.beam(&placement)?;
        let mount = self.config.geometry.range();
        let sounding = Sounding::new(time_ns, &beam, mount.half_cone_rad, range, fresh);
        // What has no width needs no sweep.
        if self.config.method == Method::Seed || mount.half_cone_rad == 0.0 {
            return Some(sounding);
        }
        let head_rad = placement.head_rad.filter(|_| mount.on_head).unwrap_or(0.0);
        let (off_rad, correction) = self.state.survey.take(&Heard {
            time_ns,
            beam: &beam,
            bearing_rad: placement.pose.heading_rad + head_rad,
            range,
            half_cone_rad: mount.half_cone_rad,
            max_m: mount.max_m,
            corrects: self.config.method == Method::Default,
        });
        if let Some(correction) = correction {
            self.correct(&correction);
        }
        Some(sounding.with_echo_off_axis(off_rad))
    }

    /// Pose × translation to the sensor × rotation by the head's angle; `None` where the head's
    /// angle is not known.
    fn beam(&self, placement: &Placement) -> Option<Beam> {
        let head_rad = if self.config.geometry.range().on_head { placement.head_rad? } else { 0.0 };
        Some(self.beam_at(placement, head_rad))
    }

    fn beam_at(&self, placement: &Placement, head_rad: f64) -> Beam {
        let mount = self.config.geometry.range();
        let pose = placement.pose;
        let [cos, sin] = unit(pose.heading_rad);
        let [beam_cos, beam_sin] = unit(pose.heading_rad + head_rad);
        Beam {
            x_m: pose.x_m + cos * mount.ahead_m - sin * mount.left_m,
            y_m: pose.y_m + sin * mount.ahead_m + cos * mount.left_m,
            cos: beam_cos,
            sin: beam_sin,
        }
    }
}

/// How far a step can be trusted.
#[derive(Debug, Clone, Copy)]
struct Trust {
    /// Whether its turn is the gyro's.
    by_gyro: bool,
    /// What a slip may have falsified its way by, metres.
    slip_m: f64,
}

fn unit(direction_rad: f64) -> [f64; 2] {
    let (sin, cos) = libm::sincos(direction_rad);
    [cos, sin]
}
