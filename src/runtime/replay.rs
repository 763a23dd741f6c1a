//! The recorded senses through estimator and machines again.
//!
//! The senses alone are enough: they, the robot's and the mission's files and the start pose are
//! all in the recording, and the [`Pilot`] is the one that drove. So a replay computes the same
//! poses, points and transitions bit for bit, on any machine; otherwise it reports the first tick
//! that differs. After a gap in the recording it continues from the next checkpoint.
//!
//! # Not here
//!
//! No judging of the map: a replay says what the robot thought, not whether it was right.

use std::collections::BTreeMap;
use std::fmt;

use serde::Serialize;

use crate::behavior::{Demands, Mission, SetError, Taken};
use crate::document::Findings;
use crate::mapping::{Keyframe, MapPoint, Method, OccupancyGrid, Pose, joint_grid};
use crate::robot::RobotConfig;
use crate::senses::Senses;
use crate::units::{bounds, counted};

use super::pilot::{Pilot, PilotError, Step};
use crate::recording::{Checkpoint, Grid, Info, RecordError, Run};

mod remade;

pub use remade::{Remade, replay_with};

/// How many differences are told one by one.
const TOLD: usize = 10;

/// Where a replay came to something else than the recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// The tick.
    pub tick: u64,
    /// What differs: a pose, a point, a transition.
    pub what: String,
}

/// What a replay came to.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Replayed {
    /// Ticks that were replayed.
    pub ticks: u64,
    /// Poses that were the same, bit for bit.
    pub poses: u64,
    /// Points of the map that were the same, bit for bit.
    pub points: u64,
    /// Transitions that were the same.
    pub transitions: u64,
    /// Gaps in the recording, each as its first and last missing tick.
    pub gaps: Vec<(u64, u64)>,
    /// Ticks between a gap and the next checkpoint, which could not be replayed.
    pub skipped: u64,
    /// Poses, points and transitions that the recording no longer has: what a cut took of its last
    /// ticks, or damage anywhere.
    pub unrecorded: u64,
    /// How many differences there are.
    pub differing: u64,
    /// The first of them.
    pub differences: Vec<Difference>,
}

/// Why a recording cannot be replayed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReplayError {
    /// The beginning of the file, which says what the run was, is damaged or cut off.
    #[error("the recording does not say {0}: its beginning is damaged")]
    Beheaded(&'static str),
    /// A file inside the recording does not load: it was made by another version.
    #[error("a file in the recording does not load any more\n{0}")]
    Findings(Findings),
    /// A number was set that the mission does not have.
    #[error("a number that was set for the run")]
    Setting(#[from] SetError),
    /// The new run cannot be recorded.
    #[error("recording the new run")]
    Record(#[from] RecordError),
    /// Robot and mission do not go together.
    #[error("robot and mission")]
    Pilot(#[from] PilotError),
    /// No grid is made over so much of the world.
    #[error(
        "the robot came so far that its map would be more than {} m wide",
        OccupancyGrid::MOST_M
    )]
    TooWide,
}

impl From<Findings> for ReplayError {
    fn from(findings: Findings) -> Self {
        Self::Findings(findings)
    }
}

/// A pilot at the start of a recorded run, and the robot that recorded it.
#[derive(Debug)]
pub struct Cast {
    /// The pilot.
    pub pilot: Pilot,
    /// The robot.
    pub robot: RobotConfig,
    /// The mission, with the numbers of this run.
    pub mission: Mission,
    /// What the run is.
    pub info: Info,
}

impl Cast {
    /// The pilot that drove a run.
    ///
    /// # Errors
    ///
    /// [`ReplayError`].
    pub fn of(run: &Run) -> Result<Self, ReplayError> {
        Self::with(run, None, None)
    }

    /// The pilot that would have driven a run with another robot, or by another method.
    fn with(
        run: &Run,
        other: Option<&RobotConfig>,
        method: Option<Method>,
    ) -> Result<Self, ReplayError> {
        let mut info = run.info.clone().ok_or(ReplayError::Beheaded("what run it is"))?;
        info.method = method.unwrap_or(info.method);
        let robot =
            run.robot_toml.as_ref().ok_or(ReplayError::Beheaded("with which robot it was made"))?;
        let mission =
            run.mission_toml.as_ref().ok_or(ReplayError::Beheaded("which mission was run"))?;
        let (robot, _) = RobotConfig::load("robot.toml of the recording", robot.as_bytes())?;
        let robot = robot.fed_by(info.cells, info.board);
        let other = other.map(|other| other.clone().fed_by(info.cells, info.board));
        let pilots = other.as_ref().unwrap_or(&robot);
        let (mut mission, _) = Mission::parse(
            "mission.toml of the recording",
            mission.as_bytes(),
            &pilots.capabilities(),
        )?;
        for (name, value) in &info.settings {
            mission.set(name, *value)?;
        }
        let pilot = Pilot::new(pilots, &mission, info.method, info.start_pose)?;
        let pilot = pilot.with_seed(info.seed);
        Ok(Self { pilot, robot, mission, info })
    }
}

/// Replays a run with the robot and the mission that are in it, and compares.
///
/// # Errors
///
/// [`ReplayError`] where the recording does not have what a replay needs; differences are no error.
pub fn replay(run: &Run) -> Result<Replayed, ReplayError> {
    let mut again = Again::of(run, Cast::of(run)?);
    let recorded = Recorded::of(run);
    let mut replayed = Replayed::default();
    for senses in &run.senses {
        let mut taken = Vec::new();
        let Some(step) = again.step(senses, |transition| taken.push(transition)) else {
            replayed.skipped += 1;
            continue;
        };
        replayed.ticks += 1;
        // The map before a gap is lost, and with it the plans that a mission drives by.
        let plans = !again.gaps.is_empty() && again.cast.mission.navigates();
        replayed.compare(senses, &step, (!plans).then_some(&taken), &recorded);
    }
    if run.ending.is_some() && !again.is_lost {
        let points = again.cast.pilot.finish();
        replayed.compare_points(again.next_tick, &points, &recorded);
    }
    replayed.gaps = again.gaps;
    Ok(replayed)
}

/// A run tick by tick once more; over a gap in its senses from the next checkpoint on.
#[derive(Debug)]
pub(crate) struct Again<'r> {
    pub(crate) cast: Cast,
    /// What the last step demanded.
    pub(crate) demands: Demands,
    checkpoints: BTreeMap<u64, &'r Checkpoint>,
    /// Each gap as its first and last missing tick.
    gaps: Vec<(u64, u64)>,
    next_tick: u64,
    is_lost: bool,
}

impl<'r> Again<'r> {
    pub(crate) fn of(run: &'r Run, cast: Cast) -> Self {
        let checkpoints = run.checkpoints.iter().map(|point| (point.tick, point)).collect();
        let (demands, gaps) = (Demands::default(), Vec::new());
        Self { cast, demands, checkpoints, gaps, next_tick: 0, is_lost: false }
    }

    /// The next tick's step; `None` between a gap and the next checkpoint.
    pub(crate) fn step(&mut self, senses: &Senses, taken: impl FnMut(Taken)) -> Option<Step> {
        if senses.tick != self.next_tick {
            self.gaps.push((self.next_tick, senses.tick.saturating_sub(1)));
            self.is_lost = true;
        }
        self.next_tick = senses.tick + 1;
        if self.is_lost {
            // A checkpoint is what was carried out of its tick.
            let state = self.checkpoints.get(&senses.tick).and_then(|at| at.state());
            self.is_lost = !state.is_some_and(|state| self.cast.pilot.restore(&state));
            return None;
        }
        Some(self.cast.pilot.step(senses, &mut self.demands, taken))
    }
}

/// The occupancy grid of a run: the recorded one, which covers 5 m around the start, or where the
/// robot came further or the recording was cut, one that is made again from the senses.
///
/// # Errors
///
/// [`ReplayError`].
pub fn whole_map(run: &Run) -> Result<Grid, ReplayError> {
    let start = run.info.as_ref().map(|info| info.start_pose).unwrap_or_default();
    let poses = run.poses.iter().map(|pose| pose.pose).chain([start]);
    let [low_m, high_m] = bounds(poses.map(|pose| [pose.x_m, pose.y_m]));
    let usual = OccupancyGrid::around(&start);
    let whole = OccupancyGrid::covering(low_m, high_m).ok_or(ReplayError::TooWide)?;
    let is_usual = usual.has(&whole);
    if let Some(grid) = run.map.as_ref().filter(|_| is_usual) {
        return Ok(grid.clone());
    }
    let united = || OccupancyGrid::united(&[&usual, &whole]).ok_or(ReplayError::TooWide);
    let grid = (!is_usual).then(united).transpose()?;
    Ok(Grid::from(ended(run, grid)?.map().grid()))
}

/// One occupancy grid of several runs, made again from their senses. An error has the run's place,
/// one behind the last where they lie too far apart.
///
/// - `runs`: each with where the origin of its own frame lies in the grid's.
///
/// # Errors
///
/// [`ReplayError`].
pub fn joint_map(runs: &[(&Run, Pose)]) -> Result<Grid, (usize, ReplayError)> {
    let mut maps = Vec::new();
    for (place, (run, origin)) in runs.iter().enumerate() {
        let pilot = ended(run, None).map_err(|error| (place, error))?;
        let mut keyframes = pilot.keyframes().to_vec();
        if keyframes.is_empty() {
            keyframes.push(Keyframe::default());
        }
        for keyframe in &mut keyframes {
            keyframe.now = origin.then(&keyframe.now);
        }
        maps.push((pilot, keyframes));
    }
    let maps: Vec<_> =
        maps.iter().map(|(pilot, keyframes)| (pilot.map(), &keyframes[..])).collect();
    let grid = joint_grid(&maps).ok_or((maps.len(), ReplayError::TooWide))?;
    Ok(Grid::from(&grid))
}

/// The run once more, to its end.
///
/// - `grid`: another than the usual one.
fn ended(run: &Run, grid: Option<OccupancyGrid>) -> Result<Pilot, ReplayError> {
    let mut pilot = Cast::of(run)?.pilot;
    if let Some(grid) = grid {
        pilot = pilot.with_grid(grid);
    }
    let mut demands = Demands::default();
    for senses in &run.senses {
        pilot.step(senses, &mut demands, |_| {});
    }
    pilot.finish();
    Ok(pilot)
}

/// What the recording says, by tick.
///
/// A tick's senses are written before its pose and transitions, and points come in batches, so a
/// file that was cut lacks some of what belongs to its last ticks. That is no difference; what the
/// file has and says otherwise is one.
struct Recorded<'r> {
    poses: BTreeMap<u64, Pose>,
    points: BTreeMap<i64, &'r MapPoint>,
    transitions: BTreeMap<u64, Vec<Taken>>,
    last_tick: Option<u64>,
    cut: bool,
    damaged: bool,
}

impl<'r> Recorded<'r> {
    fn of(run: &'r Run) -> Self {
        let mut transitions: BTreeMap<u64, Vec<Taken>> = BTreeMap::new();
        for transition in &run.transitions {
            transitions.entry(transition.tick).or_default().push(transition.taken);
        }
        Self {
            poses: run.poses.iter().map(|pose| (pose.tick, pose.pose)).collect(),
            points: run.points.iter().map(|point| (point.time_ns, point)).collect(),
            transitions,
            last_tick: run.senses.last().map(|senses| senses.tick),
            cut: run.ending.is_none(),
            damaged: !run.integrity.damaged.is_empty(),
        }
    }

    /// True where a pose may be missing without being a difference.
    fn may_lack_pose(&self, tick: u64) -> bool {
        self.damaged || self.cut && self.poses.last_key_value().is_none_or(|(&last, _)| tick > last)
    }

    fn may_lack_point(&self, time_ns: i64) -> bool {
        self.damaged
            || self.cut
                && self.points.last_key_value().is_none_or(|(&last_ns, _)| time_ns > last_ns)
    }

    fn may_lack_transitions(&self, tick: u64) -> bool {
        self.damaged || self.cut && self.last_tick == Some(tick)
    }
}

impl Replayed {
    /// True where everything came out as it was recorded.
    #[must_use]
    pub fn is_same(&self) -> bool {
        self.differing == 0
    }

    /// - `taken`: the transitions, where they can be compared.
    fn compare(
        &mut self,
        senses: &Senses,
        step: &Step,
        taken: Option<&Vec<Taken>>,
        recorded: &Recorded<'_>,
    ) {
        let tick = senses.tick;
        let pose = step.estimate.pose;
        match recorded.poses.get(&tick) {
            Some(was) if same_pose(was, &pose) => self.poses += 1,
            None if recorded.may_lack_pose(tick) => self.unrecorded += 1,
            was => self.differ(tick, || format!("pose {pose:?} instead of {was:?}")),
        }
        self.compare_points(tick, &step.placed, recorded);
        let were = recorded.transitions.get(&tick).map_or(&[][..], Vec::as_slice);
        let Some(taken) = taken else {
            self.unrecorded += were.len() as u64;
            return;
        };
        if taken == were || taken.starts_with(were) && recorded.may_lack_transitions(tick) {
            self.transitions += were.len() as u64;
            self.unrecorded += taken.len() as u64 - were.len() as u64;
        } else {
            self.differ(tick, || format!("transitions {taken:?} instead of {were:?}"));
        }
    }

    fn compare_points(&mut self, tick: u64, points: &[MapPoint], recorded: &Recorded<'_>) {
        for point in points {
            match recorded.points.get(&point.time_ns) {
                Some(was) if same_point(point, was) => self.points += 1,
                None if recorded.may_lack_point(point.time_ns) => self.unrecorded += 1,
                was => self.differ(tick, || format!("point {point:?} instead of {was:?}")),
            }
        }
    }

    fn differ(&mut self, tick: u64, what: impl FnOnce() -> String) {
        self.differing += 1;
        if self.differences.len() < TOLD {
            self.differences.push(Difference { tick, what: what() });
        }
    }
}

fn same_pose(a: &Pose, b: &Pose) -> bool {
    let bits = |pose: &Pose| [pose.x_m, pose.y_m, pose.heading_rad].map(f64::to_bits);
    bits(a) == bits(b)
}

fn same_point(a: &MapPoint, b: &MapPoint) -> bool {
    a.x_m.to_bits() == b.x_m.to_bits() && a.y_m.to_bits() == b.y_m.to_bits()
}

impl fmt::Display for Replayed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} replayed: {}, {} and {} the same, bit for bit",
            counted(self.ticks, "tick"),
            counted(self.poses, "pose"),
            counted(self.points, "point"),
            counted(self.transitions, "transition")
        )?;
        for (first, last) in &self.gaps {
            write!(f, "\nthe recording has no ticks {first} to {last}")?;
        }
        if self.skipped > 0 {
            let (ticks, were) =
                (counted(self.skipped, "tick"), if self.skipped == 1 { "was" } else { "were" });
            write!(f, "\n{ticks} after gaps {were} passed over, up to the next checkpoint")?;
        }
        if self.unrecorded > 0 {
            let (what, them, they_depend) = match self.unrecorded {
                1 => ("pose, point or transition", "it", "it depends"),
                _ => ("poses, points and transitions", "them", "they depend"),
            };
            write!(
                f,
                "\n{} {what} could not be compared: the file no longer has {them}, or the map \
                 that {they_depend} on",
                self.unrecorded
            )?;
        }
        if self.differing > 0 {
            write!(f, "\n{}", counted(self.differing, "difference"))?;
        }
        for difference in &self.differences {
            write!(f, "\ntick {}: {}", difference.tick, difference.what)?;
        }
        Ok(())
    }
}
