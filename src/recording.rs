//! `run.mcap`: what a run recorded, and how it is written and read.
//!
//! One file holds everything about a run. It is MCAP, its messages are ROS 2 CDR with their
//! definitions inside, so Foxglove and `ros2 bag` open it; and the senses alone are enough to run
//! estimator and machines again.
//!
//! ```text
//!  tick thread ── TickSide ──▶ ring (lock-free, fixed size)
//!                                └──▶ recorder thread ── Sink ──▶ run.mcap ──▶ Run
//! ```
//!
//! # Topics
//!
//! | topic | type | when | what |
//! |---|---|---|---|
//! | `/senses` | `onbrick_msgs/msg/Senses` | every tick | the readings of the channels that the robot has, each with its two ages; bit for bit |
//! | `/pose` | `onbrick_msgs/msg/Pose` | every tick | pose in frame `map`, speeds, metres driven, what the range reading was taken for; bit for bit |
//! | `/odom` | `nav_msgs/msg/Odometry` | 10 Hz | `base_link` in `odom`, speeds in `base_link`, both with covariance (below) |
//! | `/tf` | `tf2_msgs/msg/TFMessage` | 10 Hz | `odom` → `base_link`; `base_link` → `range_link`, which turns with the head |
//! | `/tf_static` | `tf2_msgs/msg/TFMessage` | once | `map` → `odom`: the same, because the start pose is in the poses |
//! | `/range` | `sensor_msgs/msg/Range` | each new reading | metres in `range_link`; +Inf: no echo, −Inf: too near (REP 117) |
//! | `/points` | `sensor_msgs/msg/PointCloud2` | each sync | the map's new points in `map`: `x y z` in single precision for viewers, `x_m y_m` in double, time in nanoseconds of the run's clock as `time_ns_low time_ns_high` |
//! | `/map` | `nav_msgs/msg/OccupancyGrid` | every 5 s while it grows: what is known, as it was placed; at the end: all, where it is as it is known then | −1 unknown, 100 occupied, below that the probability in percent; in `map` |
//! | `/keyframes` | `onbrick_msgs/msg/Keyframes` | 1 Hz | some poses of the way, as they were estimated then and as they are now: what moves points and path when walls are seen again ([`where_now`](crate::mapping::where_now)) |
//! | `/walls` | `visualization_msgs/msg/Marker` | at the end of a simulated run | the walls that the points make, as a list of lines in `map`; on a brick they would keep the run from ending for seconds, and `plot` and `export` make them of any run |
//! | `/transitions` | `onbrick_msgs/msg/Transition` | as they happen | machine, states, condition: by place and by name |
//! | `/rosout` | `rcl_interfaces/msg/Log` | as they happen | log lines: what the mission says, shows and sounds, too |
//! | `/stats` | `onbrick_msgs/msg/TickStatistics` | each second | overruns, lateness, the ring's high-water mark |
//! | `/checkpoint` | `onbrick_msgs/msg/Checkpoint` | each second | what estimator and machines carry to the next tick |
//! | `/variables` | `onbrick_msgs/msg/Variables` | when one has changed | the mission's variables |
//! | `/truth` | `geometry_msgs/msg/PoseStamped` | 10 Hz, simulated runs | where the robot truly is, in `map` |
//! | `/gap` | `onbrick_msgs/msg/Gap` | when there was one | which ticks lost entries, and why |
//!
//! Lengths are metres, angles radians, x ahead, y left, anticlockwise positive (REP 103); frames
//! are those of REP 105. The definitions stand in `schema/`; `sensor_msgs/Range` has the `variance`
//! that ROS 2 added after Humble.
//!
//! Stamps and MCAP's log times are nanoseconds since 1970: the run's monotonic clock plus what the
//! wall clock was ahead of it *when the run started*. A wall clock that is set during the run
//! therefore changes no order. Fields called `time_ns` are of the run's clock itself, which begins
//! with the run. A run in simulated time has no wall clock: its offset is what its caller gives,
//! the time at which it was started or, where the same run has to give the same bytes, 0; no other
//! byte of its file comes from this machine's clock or chance.
//!
//! The pose's covariance is that of the estimator, which grows from zero, together with that of the
//! start: a robot is put down by hand to 1 cm and 1°, and the degree puts what is 10 m ahead 17 cm
//! beside. The speeds' is what the same errors of wheels and gyro come to within the tenth of a
//! second over which speeds are smoothed, and the steps in which both count: 1.4 mm/s and 4°/s
//! standing, 1 cm/s at 20 cm/s. What the robot cannot do (drive sideways, lift off, tip over) is
//! nearly certain and not zero, which filters take for "unknown".
//!
//! Attached are `robot.toml`, `mission.toml` and, where there is one, `world.toml`, as they were
//! read. The metadata record `onbrick` says what the run is ([`Info`]), the record `onbrick.end`
//! how it ended ([`Ending`]).
//!
//! # Chunks
//!
//! Each second (see [`Options::sync_period_ns`]) the chunk that is open is written with its
//! checksum and its message indexes, and the file is brought to the disk; the layout stands in
//! `file`. So a run that is cut or killed loses at most the second that was open, and a flipped bit
//! costs one chunk: reading hands on only what a checksum vouches for ([`Integrity`]). MCAP has
//! none for records of names and values; ours carry one among their values (`crc32`). At the end
//! follows the summary that other programs seek by. Of a file that was cut, [`walk()`] finds all
//! that is whole, and `onbrick repair` makes a file with a summary.
//!
//! # Costs
//!
//! The shipped robot's seven channels at 50 Hz are 36 kB a second, 130 MB an hour, of which `/odom`
//! and `/tf` are a quarter; a map of a room of 3 m adds 3.6 kB every five seconds.
//! The ring has [`Options::ring_entries`] entries of 4.6 kB, as long as a checkpoint.
//! The tick pays for one copy of the entry (0.4 µs on a PC), the recorder for encoding it (5 µs).
//!
//! # Example
//!
//! ```no_run
//! use onbrick::recording::Run;
//!
//! let run = Run::open("run.mcap".as_ref())?;
//! for warning in &run.warnings {
//!     eprintln!("run.mcap: {warning}");
//! }
//! println!("{} ticks, {} points", run.senses.len(), run.points.len());
//! # Ok::<(), onbrick::recording::ReadError>(())
//! ```
//!
//! # Not here
//!
//! No decision what a failed recording means for the run ([`TickSide::failed`] tells), no replay,
//! no pictures.
//!
//! # What we count on
//!
//! - Times given to one [`TickSide`] do not go back.
//! - [`Recorder::start`] is called before the tick's thread takes its real-time priority: threads
//!   inherit it.

mod about;
mod covariance;
mod encoder;
mod file;
mod followed;
mod grid;
mod growing;
pub mod message;
mod moments;
mod names;
mod outside;
mod points;
mod progress;
mod record;
mod recorder;
mod run;
mod sink;
mod status;
mod stop;
mod tick;
mod topic;
mod walk;
pub(crate) mod walls;

pub use about::{End, Ending, Info, MachineNames, Pace, Start, StateNames};
pub use followed::Followed;
pub use grid::Grid;
pub use growing::{Growing, Piece};
pub use message::{Checkpoint, Gap, TickStatistics, Variables};
pub use moments::{Moment, Moments};
pub use outside::ending_of;
pub use progress::Progress;
#[cfg(feature = "host")]
pub(crate) use record::sealed;
pub use recorder::{Options, Recorder, Summary};
pub use run::{LogLine, ReadError, RecordedPose, Run, Transition};
pub(crate) use sink::free_bytes;
pub use sink::{DiskFile, RecordError, Sink, create, writer};
pub use status::Status;
pub use stop::{STALL_NS, Stop, StopReason};
pub use tick::{Level, MAX_LOG_BYTES, TickRecord, TickSide};
pub use topic::{FRAME_BASE, FRAME_MAP, FRAME_ODOM, FRAME_RANGE, Topic};
pub use walk::{Found, Integrity, walk};
