//! A recorded run, read back.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::about::{Ending, Info, ending, fit, info, names};
use super::grid::{self, Grid};
use super::message::{self, Checkpoint, Gap, TickStatistics, Variables};
use super::points;
use super::tick::Level;
use super::topic::Topic;
use super::walk::{Found, Integrity, walk};
use crate::behavior::Taken;
use crate::mapping::{self, Keyframe, MapPoint, Method, Pose, Range, Sight};
use crate::senses::{Channel, Reading, Senses};
#[cfg(feature = "host")]
use crate::sim::World;
use crate::units::counted;

/// The longest file that is read: about a day of a run.
const MAX_BYTES: u64 = 2 << 30;

/// What the estimator made of a tick: `onbrick_msgs/Pose`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RecordedPose {
    /// The tick.
    pub tick: u64,
    /// The estimate's time, nanoseconds of the run's clock.
    pub time_ns: i64,
    /// Where the robot was.
    pub pose: Pose,
    /// Forward speed, metres per second.
    pub forward_m_s: f64,
    /// Turning speed, radians per second.
    pub turn_rad_s: f64,
    /// Metres driven.
    pub travelled_m: f64,
    /// What the range reading was taken for.
    #[serde(with = "taken_for")]
    pub range: Option<Range>,
}

/// What a range reading was taken for, as the message has it: metres, and which.
mod taken_for {
    use serde::de::Error as _;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    use crate::mapping::Range;

    pub(super) fn serialize<S: Serializer>(
        range: &Option<Range>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let (range_m, which) = match *range {
            None => (f64::NAN, 0_u8),
            Some(Range::Echo(range_m)) => (range_m, 1),
            Some(Range::NoEcho) => (f64::NAN, 2),
            Some(Range::TooNear) => (f64::NAN, 3),
        };
        (range_m, which).serialize(serializer)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Option<Range>, D::Error> {
        let (range_m, which) = Deserialize::deserialize(deserializer)?;
        match which {
            0_u8 => Ok(None),
            1 => Ok(Some(Range::Echo(range_m))),
            2 => Ok(Some(Range::NoEcho)),
            3 => Ok(Some(Range::TooNear)),
            _ => Err(D::Error::custom("a reading of another version")),
        }
    }
}

/// A transition that a machine took.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Transition {
    /// The tick.
    pub tick: u64,
    /// Its time, nanoseconds of the run's clock.
    pub time_ns: i64,
    /// By place in the mission.
    pub taken: Taken,
    /// The machine's name.
    pub machine: String,
    /// The state left.
    pub from: String,
    /// The state entered.
    pub to: String,
    /// The condition as written; empty where the runtime moved the machine.
    pub condition: String,
}

/// A log line.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LogLine {
    /// Nanoseconds of the run's clock.
    pub time_ns: i64,
    /// How much it matters.
    pub level: Level,
    /// What it says.
    pub text: String,
}

/// A recording that cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The file cannot be opened or read.
    #[error("cannot read {}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the file system says.
        source: io::Error,
    },
    /// It is longer than any recording.
    #[error("the file has {bytes} bytes; at most {MAX_BYTES} are read")]
    TooLong {
        /// Its length.
        bytes: u64,
    },
    /// It is something else.
    #[error("this is not a recording of onbrick: {why}")]
    NotARecording {
        /// What is missing.
        why: &'static str,
    },
    /// It is whole, and has no run, or several, each in a namespace.
    #[error(
        "this is not a recording of onbrick: the file holds no run, or several together, which \
         viewers open; each run has a recording of its own"
    )]
    NotOneRun,
}

/// Everything that a recording holds, in the order of the file. All of it may be empty: a file may
/// have been cut anywhere.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Run {
    /// What the run is; `None` where that part of the file is damaged.
    pub info: Option<Info>,
    /// `robot.toml` as it was read.
    pub robot_toml: Option<String>,
    /// `mission.toml` as it was read.
    pub mission_toml: Option<String>,
    /// `world.toml` as it was read, where the brick was simulated.
    pub world_toml: Option<String>,
    /// Each tick's readings.
    pub senses: Vec<Senses>,
    /// Each tick's estimate.
    pub poses: Vec<RecordedPose>,
    /// Where the robot truly was and when, nanoseconds of the run's clock, where it was simulated;
    /// ten times a second.
    pub truth: Vec<(i64, Pose)>,
    /// The map's points, where they were placed; [`Run::points_now`] is where they are.
    pub points: Vec<MapPoint>,
    /// What is known at the end of where the robot was.
    pub keyframes: Vec<Keyframe>,
    /// Transitions of all machines.
    pub transitions: Vec<Transition>,
    /// The mission's variables, after each tick in which one has changed.
    pub variables: Vec<Variables>,
    /// Log lines.
    pub logs: Vec<LogLine>,
    /// How punctual the ticks were.
    pub statistics: Vec<TickStatistics>,
    /// What can be gone on from.
    pub checkpoints: Vec<Checkpoint>,
    /// What the recorder could not take.
    pub gaps: Vec<Gap>,
    /// The map, where the run recorded one.
    pub map: Option<Grid>,
    /// How the run ended; `None` where the file was cut before, or does not say.
    pub ending: Option<Ending>,
    /// How much of the file was whole.
    pub integrity: Integrity,
    /// What a person should know about the file; empty for one that is whole.
    pub warnings: Vec<String>,
}

impl Run {
    /// Reads a file: all that is whole.
    ///
    /// # Errors
    ///
    /// See [`ReadError`]; a cut or damaged file is none.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        Self::read(&load(path)?)
    }

    /// Reads the bytes of a file: all that is whole.
    ///
    /// # Errors
    ///
    /// [`ReadError::NotARecording`] and [`ReadError::NotOneRun`]; a cut or damaged file is no
    /// error.
    pub fn read(bytes: &[u8]) -> Result<Self, ReadError> {
        let mut collected = Collected::default();
        let mut undecoded = 0_u64;
        let integrity = walk(bytes, &mut |found| {
            if collected.take(found).is_none() {
                undecoded += 1;
            }
        });
        if integrity.parts == 0 {
            recognise(bytes)?;
        }
        let Collected { mut run, ahead_ns, map } = collected;
        let is_whole = integrity.complete && integrity.damaged.is_empty();
        if is_whole && run.info.is_none() && run.poses.is_empty() {
            return Err(ReadError::NotOneRun);
        }
        let offset_ns = run.info.as_ref().map(|info| info.wall_offset_ns).or(ahead_ns).unwrap_or(0);
        // Those that were written while it grew are not all of it.
        let ended_ns = run.ending.as_ref().map(|ending| ending.time_ns.saturating_add(offset_ns));
        run.map = map.filter(|(stamp_ns, _)| Some(*stamp_ns) == ended_ns).map(|(_, map)| map);
        let logged = run.logs.iter_mut().map(|line| &mut line.time_ns);
        for time_ns in logged.chain(run.truth.iter_mut().map(|(time_ns, _)| time_ns)) {
            *time_ns = time_ns.saturating_sub(offset_ns);
        }
        run.warnings = warnings(&integrity, undecoded, run.ending.is_some());
        run.integrity = integrity;
        Ok(run)
    }

    /// The world that it was simulated in, where that is in it and can still be read.
    #[cfg(feature = "host")]
    pub(crate) fn world(&self) -> Option<World> {
        let text = self.world_toml.as_ref()?;
        World::parse("world.toml of the recording", text.as_bytes()).ok().map(|(world, _)| world)
    }

    /// The map's points where they are as it is known at the end, without those of what does not
    /// stand ([`mapping::standing()`]). The seed's map has all of them.
    #[must_use]
    pub fn points_now(&self) -> Vec<MapPoint> {
        self.points_judged().0
    }

    /// The points of [`Run::points_now`], and those that it leaves out.
    #[must_use]
    pub fn points_judged(&self) -> (Vec<MapPoint>, Vec<MapPoint>) {
        let points = mapping::points_now(&self.keyframes, &self.points);
        if self.info.as_ref().is_some_and(|info| info.method == Method::Seed) {
            return (points, Vec::new());
        }
        let place = |(time_ns, Pose { x_m, y_m, .. })| MapPoint { time_ns, x_m, y_m };
        let path: Vec<MapPoint> = self.path_now().map(place).collect();
        // Without a path there are no sights, and nothing speaks against a point.
        let mut stands = mapping::standing(&Sight::of(&points, &path)).into_iter();
        points.into_iter().partition(|_| stands.next().unwrap_or(true))
    }

    /// Each tick's pose as it is known at the end.
    pub fn path_now(&self) -> impl Iterator<Item = (i64, Pose)> {
        let now = |at: &RecordedPose| mapping::where_now(&self.keyframes, at.time_ns, &at.pose);
        self.poses.iter().map(move |at| (at.time_ns, now(at)))
    }
}

/// A run while its file is read.
#[derive(Debug, Default)]
pub(super) struct Collected {
    /// Its log lines have stamps for times: the metadata with the wall clock may be lost.
    pub(super) run: Run,
    /// Wall clock minus run clock as the messages have it.
    ahead_ns: Option<i64>,
    /// The last map, and its stamp.
    pub(super) map: Option<(i64, Grid)>,
}

impl Collected {
    /// Takes one thing from the file; `None` where it cannot be understood.
    pub(super) fn take(&mut self, found: Found<'_>) -> Option<()> {
        let run = &mut self.run;
        match found {
            Found::Attachment { name, data, .. } => {
                let text = String::from_utf8(data.to_vec()).ok()?;
                match name.as_str() {
                    names::ROBOT => run.robot_toml = Some(text),
                    names::MISSION => run.mission_toml = Some(text),
                    names::WORLD => run.world_toml = Some(text),
                    _ => {}
                }
            }
            Found::Metadata(metadata) => match metadata.name.as_str() {
                names::ABOUT => run.info = Some(info(&metadata)),
                names::ENDING => run.ending = Some(ending(&metadata)),
                _ => {}
            },
            Found::Message { topic: None, .. } => {}
            Found::Message { topic: Some(topic), header, data } => {
                let stamp_ns = i64::try_from(header.log_time).unwrap_or(i64::MAX);
                self.message(topic, stamp_ns, data)?;
            }
        }
        Some(())
    }

    fn message(&mut self, topic: Topic, stamp_ns: i64, data: &[u8]) -> Option<()> {
        let run = &mut self.run;
        match topic {
            Topic::Senses => {
                let senses = senses(&message::decode(data)?)?;
                self.ahead_ns.get_or_insert(stamp_ns.saturating_sub(senses.time_ns));
                run.senses.push(senses);
            }
            Topic::Pose => run.poses.push(message::decode(data)?),
            Topic::Truth => run.truth.push((stamp_ns, truth(&message::decode(data)?))),
            Topic::Points => run.points.extend(points::points(&message::decode(data)?)?),
            Topic::Keyframes => {
                let message: message::Keyframes = message::decode(data)?;
                run.keyframes = keyframes(message)?;
            }
            Topic::Map => self.map = Some((stamp_ns, grid::grid(message::decode(data)?)?)),
            Topic::Transitions => run.transitions.push(transition(message::decode(data)?)?),
            Topic::Variables => run.variables.push(variables(message::decode(data)?)?),
            Topic::Log => run.logs.push(log_line(stamp_ns, data)?),
            Topic::Statistics => run.statistics.push(message::decode(data)?),
            Topic::Checkpoint => run.checkpoints.push(message::decode(data)?),
            Topic::Gap => run.gaps.push(message::decode(data)?),
            // For viewers: nothing in them that is not in the others.
            Topic::Odometry
            | Topic::Transforms
            | Topic::StaticTransforms
            | Topic::Range
            | Topic::Walls => {}
        }
        Some(())
    }
}

/// The bytes of a file of at most [`MAX_BYTES`].
fn load(path: &Path) -> Result<Vec<u8>, ReadError> {
    let failed = |source| ReadError::Io { path: path.to_owned(), source };
    let file = File::open(path).map_err(failed)?;
    let length = file.metadata().map_err(failed)?.len();
    if length > MAX_BYTES {
        return Err(ReadError::TooLong { bytes: length });
    }
    let mut bytes = Vec::with_capacity(usize::try_from(length).unwrap_or(0));
    // A device or a pipe has no length beforehand.
    file.take(MAX_BYTES).read_to_end(&mut bytes).map_err(failed)?;
    Ok(bytes)
}

/// Tells a recording that was cut before its first sync from something else.
fn recognise(bytes: &[u8]) -> Result<(), ReadError> {
    let not = |why| Err(ReadError::NotARecording { why });
    if bytes.is_empty() {
        return not("the file is empty");
    }
    let Some(records) = bytes.strip_prefix(mcap::MAGIC) else {
        return match mcap::MAGIC.strip_prefix(bytes) {
            Some(_) => not("only its first few bytes are there"),
            None => not("it is no MCAP file"),
        };
    };
    // Opcode and length of the header, the profile with its length, the library with its length.
    let library = records.get(9 + 4 + "ros2".len() + 4..).unwrap_or_default();
    let ours = b"onbrick ";
    if library.starts_with(ours) {
        Ok(())
    } else if ours.starts_with(library) {
        not("it was cut before anything was recorded")
    } else {
        not("it is an MCAP file of another program")
    }
}

fn warnings(integrity: &Integrity, undecoded: u64, ended: bool) -> Vec<String> {
    let mut warnings = Vec::new();
    for range in &integrity.damaged {
        let (start, length) = (range.start, range.end - range.start);
        let (bytes, are, were) = match length {
            1 => ("1 byte".to_owned(), "is", "was"),
            _ => (counted(length, "byte"), "are", "were"),
        };
        warnings.push(format!("{bytes} from byte {start} on {are} damaged and {were} left out"));
    }
    if !integrity.complete {
        let bytes = counted(integrity.bytes, "byte");
        warnings.push(format!("the file was cut after {bytes}: the recorder did not finish it"));
    }
    if integrity.appended_bytes > 0 {
        let bytes = counted(integrity.appended_bytes, "byte");
        warnings.push(format!("left out what follows the recording's end: {bytes}"));
    }
    if undecoded > 0 {
        warnings.push(format!(
            "{} could not be understood; is this version older than the file?",
            counted(undecoded, "record")
        ));
    }
    if integrity.complete && !ended {
        warnings.push("the run stopped without saying why".to_owned());
    }
    warnings
}

/// No run lasts until then, nanoseconds of its clock, and none has had that many ticks: so what
/// replays it may subtract any two.
const LAST_NS: i64 = i64::MAX / 4;
const LAST_TICK: u64 = u64::MAX / 4;

pub(super) fn senses(message: &message::SensesMessage) -> Option<Senses> {
    let times = message.read_ns.iter().chain(&message.changed_ns).chain([&message.time_ns]);
    if message.tick > LAST_TICK
        || times.into_iter().any(|time_ns| !(-LAST_NS..=LAST_NS).contains(time_ns))
    {
        return None;
    }
    let mut senses = Senses { tick: message.tick, time_ns: message.time_ns, ..Senses::default() };
    let count = message.channel.len();
    if [message.value.len(), message.read_ns.len(), message.changed_ns.len()] != [count; 3] {
        return None;
    }
    let ages = message.read_ns.iter().zip(&message.changed_ns);
    for ((channel, value), (read_ns, changed_ns)) in
        message.channel.iter().zip(&message.value).zip(ages)
    {
        let channel = *Channel::ALL.get(usize::from(*channel))?;
        let reading = Reading { value: *value, read_ns: *read_ns, changed_ns: *changed_ns };
        senses.readings[channel as usize] = Some(reading);
    }
    Some(senses)
}

fn truth(message: &message::PoseStamped) -> Pose {
    let message::Pose3 { position, orientation } = message.pose;
    Pose { x_m: position.x, y_m: position.y, heading_rad: orientation.yaw_rad() }
}

/// Keyframes that are in no order of times could not be looked up.
fn keyframes(message: message::Keyframes) -> Option<Vec<Keyframe>> {
    let keyframes = message.keyframes;
    let is_finite = |one: &Keyframe| one.placed.is_finite() && one.now.is_finite();
    let is_usable = keyframes.is_sorted_by(|one, next| one.time_ns <= next.time_ns)
        && keyframes.iter().all(is_finite);
    is_usable.then_some(keyframes)
}

pub(super) fn transition(message: message::TransitionMessage) -> Option<Transition> {
    let transition = match message.transition_index {
        -1 => None,
        index => Some(u16::try_from(index).ok()?),
    };
    Some(Transition {
        tick: message.tick,
        time_ns: message.time_ns,
        taken: Taken {
            machine: message.machine_index,
            from: message.from_index,
            to: message.to_index,
            transition,
        },
        machine: fit(&message.machine),
        from: fit(&message.from_state),
        to: fit(&message.to_state),
        condition: fit(&message.condition),
    })
}

/// As many values as names, and names that a terminal can show.
pub(super) fn variables(mut message: Variables) -> Option<Variables> {
    for name in &mut message.name {
        *name = fit(name);
    }
    (message.name.len() == message.value.len()).then_some(message)
}

pub(super) fn log_line(time_ns: i64, data: &[u8]) -> Option<LogLine> {
    let message: message::LogMessage = message::decode(data)?;
    Some(LogLine { time_ns, level: Level::of_number(message.level), text: fit(&message.msg) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_and_ticks_that_no_run_has_are_not_understood() {
        let message = |tick, time_ns, read_ns| message::SensesMessage {
            tick,
            time_ns,
            channel: vec![0],
            value: vec![1.0],
            read_ns: vec![read_ns],
            changed_ns: vec![0],
        };
        assert!(senses(&message(7, 140_000_000, -20_000_000)).is_some());
        for (tick, time_ns, read_ns) in [(u64::MAX, 0, 0), (7, i64::MIN, 0), (7, 0, i64::MAX)] {
            assert_eq!(
                senses(&message(tick, time_ns, read_ns)),
                None,
                "{tick} {time_ns} {read_ns}"
            );
        }
    }
}
