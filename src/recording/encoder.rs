//! From what the tick puts into the ring to the messages of the recording.
//!
//! What the ticks repeat is thinned here (poses for ROS ten times a second), what they count is
//! summed up (statistics), and what is small is batched (points), all by the run's clock, so that
//! the same run gives the same bytes.

use serde::Serialize;

use super::about::{Pace, Start};
use super::covariance::from_put_down;
use super::file::RecordingFile;
use super::grid::{self, Grid};
use super::message::{self, Gap, Header, PLANAR_VARIANCE, Quaternion, Time, Vector3, planar};
use super::points;
use super::run::RecordedPose;
use super::sink::{RecordError, Sink};
use super::status::{SAYS, Status};
use super::tick::{Dropped, Entry, Level, TickRecord};
use super::topic::{FRAME_BASE, FRAME_MAP, FRAME_ODOM, FRAME_RANGE, Topic};
use super::walls::Surveyed;
use crate::behavior::Taken;
use crate::clock::{MILLISECOND_NS, SECOND_NS};
use crate::mapping::{Estimate, MapPoint, OccupancyGrid, Range, RangeMount};
use crate::senses::Channel;

/// How often odometry and transforms are written for viewers; `/pose` has every tick.
const ODOMETRY_PERIOD_NS: i64 = 100 * MILLISECOND_NS;

/// How often the map is written while it grows.
const MAP_PERIOD_NS: i64 = 5 * SECOND_NS;

/// How often there are statistics.
const STATISTICS_PERIOD_NS: i64 = SECOND_NS;

/// A sensor in `sensor_msgs/Range`: its `radiation_type`, and the nearest and the farthest that it
/// measures, metres (`ev3dev-interfaces`, 6.4); what the map leaves out beyond `max_m` has been
/// measured all the same.
const ULTRASOUND: (u8, [f32; 2]) = (0, [0.03, 2.55]);
const INFRARED: (u8, [f32; 2]) = (1, [0.0, 0.7]);

/// Turns entries into messages of one file.
#[derive(Debug)]
pub(super) struct Encoder {
    pub(super) file: RecordingFile,
    start: Start,
    sync_period_ns: i64,
    next_sync_ns: Option<i64>,
    next_odometry_ns: Option<i64>,
    next_map_ns: Option<i64>,
    /// The map as the tick makes it, whose own stays on the tick's thread; with what the ring had
    /// no room for missing.
    map: OccupancyGrid,
    map_grew: bool,
    points: Vec<MapPoint>,
    /// What walls are made from at the end, where time is simulated: on a brick, making them would
    /// keep the file open for seconds after the run.
    surveyed: Option<Surveyed>,
    window: Window,
    /// How full the ring was, and its size, in entries.
    ring_high_water: u32,
    ring_size: u32,
    senses: message::SensesMessage,
    pub(super) status: Status,
}

/// The ticks since the last statistics.
#[derive(Debug, Default)]
struct Window {
    first_tick: u64,
    start_ns: i64,
    lateness_ns: Vec<i64>,
    overruns: u32,
}

impl Encoder {
    /// Begins a file; what is known before the first tick is on the disk when this returns.
    pub(super) fn begin(
        sink: Box<dyn Sink>,
        start: Start,
        sync_period_ns: i64,
        ring_size: u32,
    ) -> Result<Self, RecordError> {
        let file = RecordingFile::begin(sink, &start)?;
        let status = Status::at_start(&start);
        let map = OccupancyGrid::around(&start.info.start_pose);
        let surveyed = (start.info.pace == Pace::Virtual).then(Surveyed::default);
        let mut encoder = Self {
            file,
            start,
            sync_period_ns,
            next_sync_ns: None,
            next_odometry_ns: None,
            next_map_ns: None,
            map,
            map_grew: false,
            points: Vec::new(),
            surveyed,
            window: Window::default(),
            ring_high_water: 0,
            ring_size,
            senses: message::SensesMessage::default(),
            status,
        };
        encoder.static_transforms()?;
        encoder.file.sync()?;
        Ok(encoder)
    }

    /// Notes how full the ring was. Where time is simulated that says something of the machine and
    /// nothing of the run.
    pub(super) fn note_ring(&mut self, used: usize) {
        if self.start.info.pace == Pace::Real {
            let used = u32::try_from(used).unwrap_or(u32::MAX);
            self.ring_high_water = self.ring_high_water.max(used);
        }
    }

    pub(super) fn entry(&mut self, entry: &Entry) -> Result<(), RecordError> {
        match entry {
            Entry::Tick(record) => self.tick(record),
            Entry::Transition { tick, time_ns, taken } => self.transition(*tick, *time_ns, *taken),
            Entry::Variables { tick, time_ns, values } => self.variables(*tick, *time_ns, values),
            // The recorder has its state.
            Entry::Checkpoint { .. } => Ok(()),
            Entry::Said { time_ns, text } => {
                self.status.said = text.lines().map(str::to_owned).collect();
                self.log(
                    *time_ns,
                    Level::Info as u8,
                    &format!("{SAYS}{}", text.replace('\n', " / ")),
                )
            }
            Entry::Keyframes { time_ns, keyframes } => {
                let keyframes = keyframes.to_vec();
                self.surveyed.iter_mut().for_each(|all| all.keyframes.clone_from(&keyframes));
                self.file.message(Topic::Keyframes, *time_ns, &message::Keyframes { keyframes })
            }
            Entry::Truth { time_ns, pose } => {
                let header = self.header(*time_ns, FRAME_MAP);
                let pose = message::Pose3::on_floor(pose);
                self.file.message(Topic::Truth, *time_ns, &message::PoseStamped { header, pose })
            }
            Entry::Log { time_ns, level, text } => {
                if *level >= Level::Warn {
                    self.status.warning = Some(text.to_string());
                }
                self.log(*time_ns, *level as u8, text)
            }
            Entry::Gap(dropped) => self.gap(*dropped),
        }
    }

    /// Writes what was held back, the last points, and the map.
    pub(super) fn close(
        &mut self,
        time_ns: i64,
        points: &[MapPoint],
        map: Option<&Grid>,
    ) -> Result<(), RecordError> {
        self.points.extend(points);
        self.flush_points(time_ns)?;
        self.flush_statistics(time_ns)?;
        self.walls(time_ns)?;
        map.map_or(Ok(()), |map| self.write_map(time_ns, map))
    }

    fn write_map(&mut self, time_ns: i64, map: &Grid) -> Result<(), RecordError> {
        let message = grid::message(map, self.header(time_ns, FRAME_MAP));
        self.file.message(Topic::Map, time_ns, &message)
    }

    /// Brings everything so far to the disk.
    pub(super) fn sync(&mut self, time_ns: i64) -> Result<(), RecordError> {
        self.flush_points(time_ns)?;
        self.file.sync()
    }

    /// Notes a gap.
    pub(super) fn gap(&mut self, dropped: Dropped) -> Result<(), RecordError> {
        let gap = Gap {
            first_tick: dropped.first_tick,
            last_tick: dropped.last_tick,
            entries: dropped.entries,
            reason: "the ring to the recorder was full: the disk was slow".to_owned(),
        };
        self.status.dropped = self.status.dropped.saturating_add(dropped.entries);
        self.file.message(Topic::Gap, self.status.time_ns, &gap)
    }

    /// The frames that do not move. Poses are given in the map's frame, so odometry starts from
    /// there.
    fn static_transforms(&mut self) -> Result<(), RecordError> {
        let time_ns = self.start.info.start_ns;
        let still = self.transform(
            time_ns,
            FRAME_MAP,
            FRAME_ODOM,
            Vector3::default(),
            Quaternion::of_yaw(0.0),
        );
        self.file.message(
            Topic::StaticTransforms,
            time_ns,
            &message::TfMessage { transforms: vec![still] },
        )
    }

    fn tick(&mut self, record: &TickRecord) -> Result<(), RecordError> {
        let time_ns = record.senses.time_ns;
        self.status.note(record, &self.start);
        self.senses(record)?;
        self.pose(record)?;
        if due(&mut self.next_odometry_ns, time_ns, ODOMETRY_PERIOD_NS) {
            self.odometry(record)?;
        }
        if record.estimate.sounding.is_some_and(|sounding| sounding.fresh) {
            self.range(record)?;
        }
        self.points.extend(record.placed.iter());
        self.surveyed.iter_mut().for_each(|all| all.note_pose(&record.estimate));
        self.map(record)?;
        self.count(record);
        if time_ns - self.window.start_ns >= STATISTICS_PERIOD_NS {
            self.flush_statistics(time_ns)?;
        }
        if self.next_sync_ns.is_none() {
            self.next_sync_ns = Some(time_ns + self.sync_period_ns);
        } else if due(&mut self.next_sync_ns, time_ns, self.sync_period_ns) {
            self.sync(time_ns)?;
        }
        Ok(())
    }

    fn senses(&mut self, record: &TickRecord) -> Result<(), RecordError> {
        let mut message = std::mem::take(&mut self.senses);
        message.tick = record.senses.tick;
        message.time_ns = record.senses.time_ns;
        message.channel.clear();
        message.value.clear();
        message.read_ns.clear();
        message.changed_ns.clear();
        for channel in Channel::ALL {
            if let Some(reading) = record.senses.get(channel) {
                message.channel.push(channel as u8);
                message.value.push(reading.value);
                message.read_ns.push(reading.read_ns);
                message.changed_ns.push(reading.changed_ns);
            }
        }
        let written = self.file.message(Topic::Senses, message.time_ns, &message);
        self.senses = message;
        written
    }

    fn pose(&mut self, record: &TickRecord) -> Result<(), RecordError> {
        let tick = record.senses.tick;
        let Estimate { time_ns, pose, forward_m_s, turn_rad_s, travelled_m, range, .. } =
            record.estimate;
        let message =
            RecordedPose { tick, time_ns, pose, forward_m_s, turn_rad_s, travelled_m, range };
        self.file.message(Topic::Pose, record.senses.time_ns, &message)
    }

    fn odometry(&mut self, record: &TickRecord) -> Result<(), RecordError> {
        let Estimate { time_ns, pose, forward_m_s, turn_rad_s, covariance, .. } = record.estimate;
        let [forward, turn] = record.estimate.speed_variances();
        let body = message::Pose3::on_floor(&pose);
        let message = message::Odometry {
            header: self.header(time_ns, FRAME_ODOM),
            child_frame_id: FRAME_BASE.to_owned(),
            pose: body,
            pose_covariance: planar(from_put_down(covariance, pose, self.start.info.start_pose)),
            twist: message::Twist {
                linear: Vector3 { x: forward_m_s, ..Vector3::default() },
                angular: Vector3 { z: turn_rad_s, ..Vector3::default() },
            },
            // It does not drive sideways.
            twist_covariance: planar([forward, 0.0, 0.0, PLANAR_VARIANCE, 0.0, turn]),
        };
        self.file.message(Topic::Odometry, time_ns, &message)?;
        let mut transforms =
            vec![self.transform(time_ns, FRAME_ODOM, FRAME_BASE, body.position, body.orientation)];
        if let Some(range) = self.start.range {
            let head_rad = record.senses.get(Channel::Head).map_or(0.0, |head| head.value);
            let place = Vector3 { x: range.ahead_m, y: range.left_m, z: 0.0 };
            let turned = Quaternion::of_yaw(head_rad);
            transforms.push(self.transform(time_ns, FRAME_BASE, FRAME_RANGE, place, turned));
        }
        self.file.message(Topic::Transforms, time_ns, &message::TfMessage { transforms })
    }

    #[expect(
        clippy::cast_possible_truncation,
        reason = "the definition has single precision; /senses has the value"
    )]
    fn range(&mut self, record: &TickRecord) -> Result<(), RecordError> {
        let (Some(sensor), Some(reading)) = (self.start.range, record.senses.get(Channel::Range))
        else {
            return Ok(());
        };
        let range = match record.estimate.range {
            Some(Range::Echo(range_m)) => range_m as f32,
            Some(Range::NoEcho) => f32::INFINITY,
            Some(Range::TooNear) => f32::NEG_INFINITY,
            None => return Ok(()),
        };
        let (radiation_type, [min_range, max_range]) =
            if self.start.infrared { INFRARED } else { ULTRASOUND };
        let message = message::RangeMessage {
            header: self.header(reading.read_ns, FRAME_RANGE),
            radiation_type,
            field_of_view: field_of_view_rad(&sensor) as f32,
            min_range,
            max_range,
            range,
            variance: 0.0,
        };
        self.file.message(Topic::Range, record.senses.time_ns, &message)
    }

    fn map(&mut self, record: &TickRecord) -> Result<(), RecordError> {
        let (Some(sensor), time_ns) = (self.start.range, record.senses.time_ns) else {
            return Ok(());
        };
        self.map_grew |= self.map.take(&record.estimate, sensor.max_m);
        if self.next_map_ns.is_none() {
            self.next_map_ns = Some(time_ns + MAP_PERIOD_NS);
        } else if due(&mut self.next_map_ns, time_ns, MAP_PERIOD_NS) && self.map_grew {
            self.map_grew = false;
            let map = Grid::from(&self.map).trimmed();
            self.write_map(time_ns, &map)?;
        }
        Ok(())
    }

    fn transition(&mut self, tick: u64, time_ns: i64, taken: Taken) -> Result<(), RecordError> {
        let machine = self.start.machines.get(usize::from(taken.machine));
        let state = |index: u16| machine.and_then(|machine| machine.states.get(usize::from(index)));
        let name = |index| state(index).map_or_else(String::new, |state| state.name.clone());
        let condition = taken.transition.and_then(|at| machine?.condition(taken.from, at));
        let message = message::TransitionMessage {
            tick,
            time_ns,
            machine_index: taken.machine,
            from_index: taken.from,
            to_index: taken.to,
            transition_index: taken.transition.map_or(-1, i32::from),
            machine: machine.map_or_else(String::new, |machine| machine.name.clone()),
            from_state: name(taken.from),
            to_state: name(taken.to),
            condition: condition.unwrap_or_default().to_owned(),
        };
        self.status.enter(taken.machine, &message.to_state);
        self.file.message(Topic::Transitions, time_ns, &message)
    }

    fn variables(&mut self, tick: u64, time_ns: i64, values: &[f64]) -> Result<(), RecordError> {
        let (name, value) = (self.start.variables.clone(), values.to_vec());
        self.status.variables = name.iter().cloned().zip(values.iter().copied()).collect();
        let message = message::Variables { tick, time_ns, name, value };
        self.file.message(Topic::Variables, time_ns, &message)
    }

    /// Writes what the pilot carries from a tick to the next.
    pub(super) fn checkpoint<S: Serialize>(
        &mut self,
        tick: u64,
        time_ns: i64,
        state: &S,
    ) -> Result<(), RecordError> {
        let state = message::encode(state).map_err(|error| RecordError {
            doing: "encode a checkpoint",
            source: std::io::Error::other(error.to_string()),
        })?;
        let message = message::Checkpoint { tick, time_ns, state };
        self.file.message(Topic::Checkpoint, time_ns, &message)
    }

    /// Writes a log line.
    pub(super) fn log(&mut self, time_ns: i64, level: u8, text: &str) -> Result<(), RecordError> {
        let message = message::LogMessage {
            stamp: Time::of_ns(self.file.stamp_ns(time_ns)),
            level,
            name: self.start.info.brick.clone(),
            msg: text.to_owned(),
            file: String::new(),
            function: String::new(),
            line: 0,
        };
        self.file.message(Topic::Log, time_ns, &message)
    }

    fn count(&mut self, record: &TickRecord) {
        let window = &mut self.window;
        if window.lateness_ns.is_empty() {
            window.first_tick = record.senses.tick;
            window.start_ns = record.senses.time_ns;
        }
        window.lateness_ns.push(record.lateness_ns);
        window.overruns += u32::from(record.lateness_ns >= self.start.info.period_ns);
    }

    fn flush_statistics(&mut self, time_ns: i64) -> Result<(), RecordError> {
        let mut window = std::mem::take(&mut self.window);
        window.lateness_ns.sort_unstable();
        let Some(lateness_max_ns) = window.lateness_ns.last().copied() else { return Ok(()) };
        let statistics = message::TickStatistics {
            first_tick: window.first_tick,
            ticks: u32::try_from(window.lateness_ns.len()).unwrap_or(u32::MAX),
            overruns: window.overruns,
            lateness_p50_ns: rank(&window.lateness_ns, 50),
            lateness_p99_ns: rank(&window.lateness_ns, 99),
            lateness_max_ns,
            ring_high_water: std::mem::take(&mut self.ring_high_water),
            ring_size: self.ring_size,
        };
        self.window.start_ns = time_ns;
        self.file.message(Topic::Statistics, time_ns, &statistics)
    }

    fn flush_points(&mut self, time_ns: i64) -> Result<(), RecordError> {
        if self.points.is_empty() {
            return Ok(());
        }
        let message = points::message(&self.points, self.header(time_ns, FRAME_MAP));
        if let Some(surveyed) = &mut self.surveyed {
            surveyed.points.extend(&self.points);
        }
        self.points.clear();
        self.file.message(Topic::Points, time_ns, &message)
    }

    /// Writes the walls that all points make, if there are any.
    fn walls(&mut self, time_ns: i64) -> Result<(), RecordError> {
        let header = self.header(time_ns, FRAME_MAP);
        let Some(message) = self.surveyed.take().and_then(|all| all.message(header)) else {
            return Ok(());
        };
        self.file.message(Topic::Walls, time_ns, &message)
    }

    fn transform(
        &self,
        time_ns: i64,
        parent: &str,
        child: &str,
        translation: Vector3,
        rotation: Quaternion,
    ) -> message::TransformStamped {
        message::TransformStamped {
            header: self.header(time_ns, parent),
            child_frame_id: child.to_owned(),
            translation,
            rotation,
        }
    }

    fn header(&self, time_ns: i64, frame: &str) -> Header {
        Header { stamp: Time::of_ns(self.file.stamp_ns(time_ns)), frame_id: frame.to_owned() }
    }
}

/// How wide the range sensor sees.
fn field_of_view_rad(sensor: &RangeMount) -> f64 {
    2.0 * sensor.half_cone_rad
}

/// True where a period is over; the next one begins where this one ended, so nothing drifts, unless
/// a whole one was missed.
fn due(next_ns: &mut Option<i64>, time_ns: i64, period_ns: i64) -> bool {
    let deadline_ns = next_ns.unwrap_or(time_ns);
    if time_ns < deadline_ns {
        return false;
    }
    let next = deadline_ns.saturating_add(period_ns);
    *next_ns = Some(if next > time_ns { next } else { time_ns.saturating_add(period_ns) });
    true
}

/// The value that `percent` of the sorted values do not exceed (nearest rank).
fn rank(sorted: &[i64], percent: usize) -> i64 {
    let place = (sorted.len() * percent).div_ceil(100).saturating_sub(1);
    sorted.get(place).copied().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{DEFAULT_ROBOT, RobotConfig};
    use crate::units::degrees;

    #[test]
    fn the_cone_that_is_recorded_is_the_one_that_the_map_is_made_with() {
        let wide = DEFAULT_ROBOT.replacen("half_cone_deg = 14", "half_cone_deg = 20", 1);
        for (text, half_deg) in [(DEFAULT_ROBOT, 14.0), (&wide, 20.0)] {
            let (config, _) = RobotConfig::load("robot.toml", text.as_bytes()).unwrap();
            let seen_rad = field_of_view_rad(&config.range.unwrap());
            assert!((degrees(seen_rad) - 2.0 * half_deg).abs() < 1e-9, "{seen_rad} rad");
            let mapped = config.geometry().unwrap();
            assert!((mapped.range().half_cone_rad * 2.0 - seen_rad).abs() < 1e-12);
        }
    }

    #[test]
    fn periods_do_not_drift_and_missed_ones_are_not_made_up_for() {
        let mut next = None;
        let fired: Vec<i64> =
            (0..100).map(|tick| tick * 7).filter(|t| due(&mut next, *t, 20)).collect();
        assert_eq!(
            fired[..6],
            [0, 21, 42, 63, 84, 105],
            "each first tick at or behind a multiple of 20"
        );
        assert!(due(&mut next, 10_000, 20));
        assert!(!due(&mut next, 10_019, 20));
    }

    #[test]
    fn percentiles_are_the_nearest_rank() {
        let values: Vec<i64> = (1..=200).collect();
        assert_eq!((rank(&values, 50), rank(&values, 99)), (100, 198));
        assert_eq!((rank(&[7], 50), rank(&[7], 99), rank(&[], 50)), (7, 7, 0));
    }
}
