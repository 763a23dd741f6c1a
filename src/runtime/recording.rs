//! `run.mcap`: what a run recorded, and how it is written and read.
//!
//! One file holds everything about a run. It is MCAP, its messages are ROS 2 CDR with their definitions inside, so Foxglove and
//! `ros2 bag` open it; and the senses alone are enough to run estimator and machines again.
//!
//! ```text
//!  tick thread ── TickSide ──▶ ring (lock-free, fixed size) ──▶ recorder thread ── Sink ──▶ run.mcap ──▶ Run
//! ```
//!
//! # Topics
//!
//! | topic | type | when | what |
//! |---|---|---|---|
//! | `/senses` | `onbrick_msgs/msg/Senses` | every tick | the readings of the channels that the robot has, each with its two ages; bit for bit |
//! | `/pose` | `onbrick_msgs/msg/Pose` | every tick | pose in frame `map`, speeds, metres driven, what the range reading was taken for; bit for bit |
//! | `/odom` | `nav_msgs/msg/Odometry` | 10 Hz | `base_link` in `odom` with covariance; speeds in `base_link`, their covariance unknown (zeros) |
//! | `/tf` | `tf2_msgs/msg/TFMessage` | 10 Hz | `odom` → `base_link`; `base_link` → `range_link`, which turns with the head |
//! | `/tf_static` | `tf2_msgs/msg/TFMessage` | once | `map` → `odom`: the same, because the start pose is in the poses |
//! | `/range` | `sensor_msgs/msg/Range` | each new reading | metres in `range_link`; +Inf: no echo, −Inf: too near (REP 117) |
//! | `/points` | `sensor_msgs/msg/PointCloud2` | each sync | the map's new points in `map`: `x y z` in single precision for viewers, `x_m y_m` in double, time in nanoseconds of the run's clock as `time_ns_low time_ns_high` |
//! | `/map` | `nav_msgs/msg/OccupancyGrid` | at the end | −1 unknown, 0 free to 100 occupied, in `map` |
//! | `/transitions` | `onbrick_msgs/msg/Transition` | as they happen | machine, states, condition: by place and by name |
//! | `/rosout` | `rcl_interfaces/msg/Log` | as they happen | log lines |
//! | `/stats` | `onbrick_msgs/msg/TickStatistics` | each second | overruns, lateness, the ring's high-water mark |
//! | `/checkpoint` | `onbrick_msgs/msg/Checkpoint` | each second | what estimator and machines carry to the next tick |
//! | `/gap` | `onbrick_msgs/msg/Gap` | when there was one | which ticks lost entries, and why |
//!
//! Lengths are metres, angles radians, x ahead, y left, anticlockwise positive (REP 103); frames are those of REP 105. The
//! definitions stand in `schema/`; `sensor_msgs/Range` has the `variance` that ROS 2 added after Humble.
//!
//! Stamps and MCAP's log times are nanoseconds since 1970: the run's monotonic clock plus what the wall clock was ahead of it
//! *when the run started*. A wall clock that is set during the run therefore changes no order. Fields called `time_ns` are of the
//! run's clock itself, which begins with the run. A run in simulated time has no wall clock: its offset is what its caller gives, 0 as a
//! rule, and no byte of its file comes from this machine's clock or chance.
//!
//! Attached are `robot.toml`, `mission.toml` and, where there is one, `world.toml`, as they were read. The metadata record
//! `onbrick` says what the run is ([`Info`]), the record `onbrick.end` how it ended ([`Ending`]).
//!
//! # Syncs
//!
//! Each second (see [`Options::sync_period_ns`]) a private record with length and CRC32 closes the stretch since the last one,
//! and the file is brought to the disk; the layout stands in `file`. Reading hands a stretch on only after checking it;
//! what follows the last sync is whole records that nobody can vouch for, and is counted as such ([`Integrity`]).
//!
//! # Costs
//!
//! With five channels at 50 Hz 27 kB a second, 100 MB an hour, of which `/odom` and `/tf` are a third. The ring has
//! [`Options::ring_entries`] entries of 1920 bytes, as long as a checkpoint. The tick pays for one copy of the
//! entry (0.4 µs on a PC), the recorder for encoding it (5 µs).
//!
//! # Example
//!
//! ```no_run
//! use onbrick::runtime::recording::Run;
//!
//! let run = Run::open("run.mcap".as_ref())?;
//! for warning in &run.warnings {
//!     eprintln!("run.mcap: {warning}");
//! }
//! println!("{} ticks, {} points", run.senses.len(), run.points.len());
//! # Ok::<(), onbrick::runtime::recording::ReadError>(())
//! ```
//!
//! # Not here
//!
//! No decision what a failed recording means for the run ([`TickSide::failed`] tells), no replay, no pictures.
//!
//! # What we count on
//!
//! - Times given to one [`TickSide`] do not go back.
//! - [`Recorder::start`] is called before the tick's thread takes its real-time priority: threads inherit it.

mod cdr;
mod crc;
mod encoder;
mod file;
mod grid;
mod growing;
pub mod message;
mod outside;
mod points;
mod progress;
mod record;
mod recorder;
mod run;
mod status;
mod stretch;
mod tick;
mod topic;

use crate::clock::SECOND_NS;
use crate::ev3dev::Technology;
use crate::mapping::Pose;

pub use file::{RecordError, SYNC_MAGIC, SYNC_OPCODE, Sink, create};
pub use growing::{Growing, Piece};
pub use message::{Gap, TickStatistics};
pub use outside::{ending_of, writer};
pub use progress::Progress;
pub use recorder::{Recorder, Summary};
pub use run::{Checkpoint, Ending, Info, LogLine, ReadError, RecordedPose, Run, Transition};
pub use status::Status;
pub use stretch::{Context, Found, Integrity, walk, walk_part};
pub use tick::{Level, MAX_LOG_BYTES, TickRecord, TickSide};
pub use topic::Topic;

/// The frame that maps and poses are given in.
pub const FRAME_MAP: &str = "map";
/// The frame that odometry starts from.
pub const FRAME_ODOM: &str = "odom";
/// The robot: between the wheels, on the floor.
pub const FRAME_BASE: &str = "base_link";
/// The range sensor: where distances are counted from, x in the direction of measuring.
pub const FRAME_RANGE: &str = "range_link";

/// What is known of a run when it starts.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// The run's identifier, where whoever started it chose one.
    pub run: Option<String>,
    /// The brick's name.
    pub brick: String,
    /// The mission's name.
    pub mission: String,
    /// `robot.toml` as it was read.
    pub robot_toml: String,
    /// `mission.toml` as it was read.
    pub mission_toml: String,
    /// `world.toml` as it was read, where the brick is simulated.
    pub world_toml: Option<String>,
    /// Where the robot starts.
    pub start_pose: Pose,
    /// The run's start, nanoseconds of the run's clock.
    pub start_ns: i64,
    /// Wall clock minus run clock at the start, nanoseconds; see [the module](self).
    pub wall_offset_ns: i64,
    /// The tick's period, nanoseconds.
    pub period_ns: i64,
    /// Whether the run's time is real.
    pub pace: Pace,
    /// The seed of the simulation, where there is one.
    pub seed: Option<u64>,
    /// What the brick runs on, which decides about the thresholds of its battery.
    pub cells: Technology,
    /// Named numbers that were set for this run.
    pub settings: Vec<(String, f64)>,
    /// The range sensor, where there is one.
    pub range: Option<RangeSensor>,
    /// The mission's machines, in its order.
    pub machines: Vec<MachineNames>,
}

/// Whether time is real.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// It is: what does not fit into the ring is dropped, counted and named.
    Real,
    /// It is simulated and outruns the disk: a full ring is waited for, so nothing is lost, and only the run's clock decides
    /// when syncs are made, so the same run gives the same bytes.
    Virtual,
}

/// How the range sensor sits and sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeSensor {
    /// From the head's axis to where distances are counted from, metres.
    pub ahead_m: f64,
    /// The least distance that it can measure, metres.
    pub min_m: f64,
    /// The greatest, metres.
    pub max_m: f64,
    /// How wide it sees, radians.
    pub field_of_view_rad: f64,
    /// True for infrared, false for ultrasound.
    pub infrared: bool,
}

/// What a machine and its states are called.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct MachineNames {
    /// The machine.
    pub name: String,
    /// The place of the state in which it starts.
    pub start: u16,
    /// Its states, in the mission's order.
    pub states: Vec<StateNames>,
}

/// What a state is called, and the conditions of the transitions that leave it, as they are written.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct StateNames {
    /// The state.
    pub name: String,
    /// In the mission's order.
    pub conditions: Vec<String>,
}

/// How to record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// How often the file is brought to the disk with a checksum, nanoseconds: what a loss of power can cost.
    pub sync_period_ns: i64,
    /// How many entries the ring holds; a tick is one, and a slow card may take seconds for a sync.
    pub ring_entries: usize,
}

impl Default for Options {
    /// A second; ten seconds of ticks at 50 Hz.
    fn default() -> Self {
        Self { sync_period_ns: SECOND_NS, ring_entries: 512 }
    }
}

/// What is known of a run when it ends.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct End {
    /// Why it ended, for people: "finished", "stopped by a button".
    pub reason: String,
    /// When, nanoseconds of the run's clock.
    pub time_ns: i64,
    /// Where the robot really was, where it is simulated.
    pub truth: Option<Pose>,
    /// The map, if the run made one.
    pub map: Option<Grid>,
}

/// An occupancy grid.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Grid {
    /// Cells along x.
    pub width: u32,
    /// Cells along y.
    pub height: u32,
    /// A cell's edge, metres.
    pub resolution_m: f64,
    /// The outer corner of the first cell, world frame, metres.
    pub origin_m: [f64; 2],
    /// Row by row along x, from the least y on: −1 unknown, 0 free to 100 occupied.
    pub cells: Vec<i8>,
}
