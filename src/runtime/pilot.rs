//! From senses to demands: estimate, map, decide.
//!
//! The pilot is the part of the tick that knows nothing of files, clocks or threads. The control
//! loop hands it what the robot sensed and carries out what it demands; replay hands it what a
//! recording says was sensed and compares. Both therefore run the very same code, and the same
//! senses give the same bits.
//!
//! # Not here
//!
//! No devices (`robot`), no deadlines (`runtime::control`), no files (`recording`).

use arrayvec::ArrayVec;
use serde::{Deserialize, Serialize};

use crate::behavior::{
    Demands, EngineError, MAX_VARIABLES, Mission, MotionLimits, OnLost, Program, ProgramState,
    Progress, Signal, Signals, Taken,
};
use crate::clock::nanoseconds;
use crate::mapping::{
    Estimate, Estimator, EstimatorConfig, EstimatorState, GeometryError, GyroReading, Inputs,
    KeyframeList, Map, MapPoint, Method, OccupancyGrid, Placed, Pose, Range, RangeReading,
};
use crate::planning::Planner;
use crate::recording::TickRecord;
use crate::robot::{BatteryLimits, RobotConfig};
use crate::senses::{Channel, Role, Senses};

use super::StopReason;
use super::battery::{BatteryWatch, Charge};
use super::plausibility::{Plausibility, PlausibilityState};
use super::stall::{Stall, StallWatch};

/// What blocks the wheels is so far from the middle between them, metres.
const BLOCKED_M: f64 = 0.13;

/// Why a pilot cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PilotError {
    /// The robot's measures make no sense.
    #[error("the robot's measures")]
    Geometry(#[from] GeometryError),
    /// The mission's machines do not hang together.
    #[error("the mission's machines")]
    Machines(#[from] EngineError),
}

/// Everything between one tick's senses and its demands.
#[derive(Debug)]
pub struct Pilot {
    config: RobotConfig,
    required: Vec<Channel>,
    /// The readings that the mission can ask for, as signals.
    sensed: Vec<Channel>,
    on_lost: OnLost,
    time_limit_ns: i64,
    estimator: Estimator,
    map: Map,
    /// Where the mission finds its way over the map.
    planner: Option<Planner>,
    /// The bumper was pressed in the tick before.
    is_pressed: bool,
    /// Where it started, world x and y, metres.
    home_m: [f64; 2],
    program: Program,
    signals: Signals,
    plausibility: Plausibility,
    limits: BatteryLimits,
    carried: Carried,
}

/// The mission's variables, told when one of them has changed.
#[derive(Debug, Default)]
pub struct ChangedVariables(ArrayVec<f64, MAX_VARIABLES>);

impl ChangedVariables {
    /// The values after a tick, where they are not those that were told last.
    pub fn next<'v>(&mut self, values: &'v [f64]) -> Option<&'v [f64]> {
        if self.0.as_slice() == values {
            return None;
        }
        self.0 = values.iter().copied().take(MAX_VARIABLES).collect();
        Some(values)
    }
}

/// What one step came to.
#[derive(Debug, Clone, Copy)]
pub struct Step {
    /// Where the robot is.
    pub estimate: Estimate,
    /// The points that now have their place in the map.
    pub placed: Placed,
    /// A wheel is blocked.
    pub stalled: bool,
    /// What was lost, where the mission waits until it is back.
    pub paused: Option<Channel>,
    /// How the battery is.
    pub charge: Charge,
    /// The reason to end the run, if there is one.
    pub end: Option<StopReason>,
}

impl Step {
    /// As a recording holds it, with the senses that it came from.
    pub(super) fn record(&self, senses: &Senses, lateness_ns: i64) -> TickRecord {
        let Self { estimate, placed, .. } = *self;
        TickRecord { senses: *senses, estimate, placed, lateness_ns }
    }
}

/// What a pilot carries from tick to tick, so that a replay can go on after a gap in the recording.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct PilotState {
    /// The estimator's part.
    pub estimator: EstimatorState,
    /// The mission's part.
    pub program: ProgramState,
    carried: Carried,
}

/// The pilot's own part.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
struct Carried {
    stalls: StallWatch,
    battery: BatteryWatch,
    wheels_rad_s: [f64; 2],
    paused: bool,
    #[serde(default)]
    plausibility: PlausibilityState,
    #[serde(default)]
    head_rad: Option<f64>,
}

impl Pilot {
    /// A pilot at the start of a mission.
    ///
    /// - `method`: how poses are estimated and points placed.
    /// - `start`: the robot's pose in the world.
    ///
    /// # Errors
    ///
    /// [`PilotError`]; neither happens with files that were loaded without a finding.
    pub fn new(
        config: &RobotConfig,
        mission: &Mission,
        method: Method,
        start: Pose,
    ) -> Result<Self, PilotError> {
        let estimator = EstimatorConfig { geometry: config.geometry()?, method };
        let map = Map::new(estimator.geometry.range(), &start);
        let planner = mission.navigates().then(|| Planner::new(map.grid(), &start)).flatten();
        let limits = config.motion_limits();
        // Another method does not correct the pose.
        let spins_first = limits.spins_first && method == Method::Default;
        let limits = MotionLimits { spins_first, ..limits };
        let mut required = Channel::WHEELS.to_vec();
        required.extend(config.has(Role::Gyro).then_some(Channel::Gyro));
        required
            .extend(mission.senses().iter().filter(|channel| !Channel::WHEELS.contains(channel)));
        // The range is the estimator's. A bumper helps to find the way, and may be missing.
        let mut sensed = required.clone();
        sensed.retain(|channel| *channel != Channel::Range);
        if planner.is_some() && !sensed.contains(&Channel::Touch) {
            sensed.push(Channel::Touch);
        }
        Ok(Self {
            config: config.clone(),
            plausibility: Plausibility::new(config, &required),
            sensed,
            required,
            on_lost: mission.on_lost(),
            time_limit_ns: nanoseconds(mission.time_limit_s()),
            estimator: Estimator::new(estimator, start),
            map,
            planner,
            is_pressed: false,
            home_m: [start.x_m, start.y_m],
            program: mission.start()?.with_limits(limits),
            signals: Signals::default(),
            limits: config.battery.limits(),
            carried: Carried::default(),
        })
    }

    /// One tick: takes in what was sensed, writes what is wanted to `demands`, and calls `taken`
    /// for each transition.
    ///
    /// After a step with an `end`, `demands` says stop.
    pub fn step(
        &mut self,
        senses: &Senses,
        demands: &mut Demands,
        taken: impl FnMut(Taken),
    ) -> Step {
        let inputs = self.inputs(senses);
        let estimate = self.estimator.update(&inputs);
        let placed = self.map.add(&estimate);
        let angles_rad = Channel::WHEELS.map(|wheel| senses.fresh(wheel, self.config.max_age_ns));
        let stalled =
            self.carried.stalls.step(senses.time_ns, self.carried.wheels_rad_s, angles_rad);
        let lost = self.lost(senses);
        let carried = &mut self.carried;
        let doubted =
            self.plausibility.step(&mut carried.plausibility, senses, &estimate, carried.head_rad);
        let end = self.decide(senses, &estimate, lost, stalled, demands, taken);
        self.plan(&estimate, stalled.is_some());
        let end = end.or(doubted.map(StopReason::Implausible));
        let volts = self.fresh(senses, Channel::Battery);
        let charge = self.carried.battery.step(&self.limits, senses.time_ns, volts);
        charge.limit(demands);
        let end = end.or((charge == Charge::Empty).then_some(StopReason::Battery));
        if end.is_some() {
            // What people are told stays.
            *demands = Demands { led: demands.led, say: demands.say, ..Demands::still() };
        }
        self.carried.wheels_rad_s = self.config.wheel_speeds(demands.drive);
        self.carried.head_rad = demands.head_rad;
        Step {
            estimate,
            placed,
            stalled: stalled.is_some(),
            paused: lost.filter(|_| self.carried.paused),
            charge,
            end,
        }
    }

    /// The same pilot, whose mission draws its chance from a seed; without one it is 0.
    #[must_use]
    pub fn with_seed(mut self, seed: u64) -> Self {
        self.program = self.program.with_seed(seed);
        self
    }

    /// The same pilot, whose map has another grid. For maps that are made after the run.
    #[must_use]
    pub fn with_grid(mut self, grid: OccupancyGrid) -> Self {
        self.planner = None;
        self.map = self.map.with_grid(grid);
        self
    }

    /// What is known now of where the robot was; see [`Estimator::keyframes`].
    #[must_use]
    pub fn keyframes(&self) -> KeyframeList {
        self.estimator.keyframes()
    }

    /// Ends the run's map: what waits for its place is placed. Returns those points.
    pub fn finish(&mut self) -> Vec<MapPoint> {
        let points = self.estimator.finish();
        self.map.finish(&points, &self.keyframes());
        points
    }

    /// The map so far.
    #[must_use]
    pub fn map(&self) -> &Map {
        &self.map
    }

    /// The machines.
    #[must_use]
    pub fn program(&self) -> &Program {
        &self.program
    }

    /// What is carried from tick to tick; the map is not in it.
    #[must_use]
    pub fn state(&self) -> PilotState {
        PilotState {
            estimator: self.estimator.state(),
            program: self.program.state(),
            carried: self.carried,
        }
    }

    /// Continues from the state of a tick; the map keeps what it has. Returns false if the state
    /// does not fit the mission or itself: then only another state makes the pilot whole again.
    pub fn restore(&mut self, state: &PilotState) -> bool {
        let fits =
            self.program.restore(&state.program) && self.estimator.restore(state.estimator.clone());
        if fits {
            self.carried = state.carried;
        }
        fits
    }

    /// The first channel that the mission needs and that could not be read for too long. When a run
    /// begins, at 0, all had just been read (`prepare`): a reading that fails in the first tick is
    /// no more a loss than one that fails later.
    fn lost(&self, senses: &Senses) -> Option<Channel> {
        let read_ns = |channel| senses.get(channel).map_or(0, |reading| reading.read_ns);
        let age_ns = |channel| senses.time_ns - read_ns(channel);
        let too_old = |&channel: &Channel| age_ns(channel) > self.config.age_limit_ns(channel);
        self.required.iter().copied().find(too_old)
    }

    fn fresh(&self, senses: &Senses, channel: Channel) -> Option<f64> {
        senses.fresh(channel, self.config.age_limit_ns(channel))
    }

    /// What the estimator takes: angles that were read in this very tick, because an old one looks
    /// like slip; the range, whose sensor has a new one ten times a second, for as long as it
    /// counts as fresh.
    fn inputs(&self, senses: &Senses) -> Inputs {
        let now = |channel| senses.fresh(channel, 0);
        let changed_ns = |channel| senses.get(channel).map(|reading| reading.changed_ns);
        let gyro = now(Channel::Gyro).zip(changed_ns(Channel::Gyro));
        let range = self.fresh(senses, Channel::Range).zip(changed_ns(Channel::Range));
        Inputs {
            time_ns: senses.time_ns,
            left_rad: now(Channel::Left),
            right_rad: now(Channel::Right),
            gyro: gyro.map(|(value_rad, changed_ns)| GyroReading { value_rad, changed_ns }),
            head_rad: now(Channel::Head),
            range: range.map(|(value_m, changed_ns)| RangeReading { value_m, changed_ns }),
        }
    }

    fn decide(
        &mut self,
        senses: &Senses,
        estimate: &Estimate,
        lost: Option<Channel>,
        stalled: Option<Stall>,
        demands: &mut Demands,
        taken: impl FnMut(Taken),
    ) -> Option<StopReason> {
        self.carried.paused = lost.is_some();
        match (lost, self.on_lost) {
            (Some(channel), OnLost::Stop) => return Some(StopReason::Lost(channel)),
            (Some(_), OnLost::Pause) => {
                *demands = Demands::still();
                return self.time_is_up(senses).then_some(StopReason::TimeLimit);
            }
            (None, _) => {}
        }
        // A wheel that turns neither way leaves a mission nothing to back off with.
        if stalled.is_some_and(|stall| stall == Stall::Dead || !self.program.stall()) {
            return Some(StopReason::Stalled);
        }
        self.sense_signals(senses, estimate);
        match self.program.step(&self.signals, demands, taken) {
            Progress::Finished => Some(StopReason::Finished),
            // The runtime's own limit comes after the machines' step, so that a mission whose
            // conditions look at the time can finish; machines without a final state do so then.
            Progress::Running => self.time_is_up(senses).then(|| {
                let is_finished = self.program.waits_for_time();
                if is_finished { StopReason::Finished } else { StopReason::TimeLimit }
            }),
        }
    }

    /// A slice of the plan that the machines wait for.
    fn plan(&mut self, estimate: &Estimate, stalled: bool) {
        let Some(planner) = &mut self.planner else { return };
        let pose = estimate.pose;
        planner.note(estimate, self.estimator.config().geometry.range().max_m);
        let [left_rad_s, right_rad_s] = self.carried.wheels_rad_s;
        let touch = self.signals.get(Signal::Sensed(Channel::Touch));
        // A bumper that stays pressed says nothing about where the robot comes to.
        let was_pressed = std::mem::replace(&mut self.is_pressed, touch.is_some_and(|on| on > 0.5));
        let is_bumped = self.is_pressed && !was_pressed && left_rad_s + right_rad_s > 0.0;
        if stalled && left_rad_s * right_rad_s < 0.0 {
            planner.cramp();
        } else if stalled || is_bumped {
            // What blocks the wheels the sensor does not see, or it would not have come to that.
            let way_m = BLOCKED_M * (left_rad_s + right_rad_s).signum();
            let (sin, cos) = libm::sincos(pose.heading_rad);
            planner.bump([pose.x_m + way_m * cos, pose.y_m + way_m * sin]);
        }
        self.program.keep_clear(planner.clearance(&pose));
        if let Some(plan) = planner.step(self.program.request(), self.map.grid(), &pose) {
            self.program.answer(plan);
        }
    }

    fn time_is_up(&self, senses: &Senses) -> bool {
        senses.time_ns > self.time_limit_ns
    }

    fn sense_signals(&mut self, senses: &Senses, estimate: &Estimate) {
        let range_m = estimate.range.map(|range| match range {
            Range::Echo(range_m) => range_m,
            Range::NoEcho => f64::INFINITY,
            Range::TooNear => 0.0,
        });
        let pose = estimate.pose;
        let straight_m = libm::hypot(pose.x_m - self.home_m[0], pose.y_m - self.home_m[1]);
        let planned_m = self.planner.as_ref().and_then(|planner| planner.home_m(&pose));
        let estimated = [
            (Signal::Sensed(Channel::Range), range_m),
            (Signal::Echo, range_m.map(|range_m| f64::from(u8::from(range_m.is_finite())))),
            (Signal::Heading, Some(pose.heading_rad)),
            (Signal::X, Some(pose.x_m)),
            (Signal::Y, Some(pose.y_m)),
            (Signal::Travelled, Some(estimate.travelled_m)),
            (Signal::Home, Some(planned_m.unwrap_or(0.0).max(straight_m))),
        ];
        self.signals.set_time_ns(senses.time_ns);
        for (signal, value) in estimated {
            self.signals.set(signal, value);
        }
        for &channel in &self.sensed {
            let value = self.fresh(senses, channel);
            self.signals.set(Signal::Sensed(channel), value);
        }
    }
}
