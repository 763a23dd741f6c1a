//! The messages of a recording as ROS 2 encodes them: CDR, little-endian, behind a header of four
//! bytes.
//!
//! Each type repeats its definition in `schema/` field by field; a test has an independent decoder
//! read them by those definitions.
//!
//! # What we count on
//!
//! - CDR aligns to the start of the body, after the four bytes (DDS-RTPS 10.2).

use crate::mapping::{Keyframe, Pose};
use byteorder::LittleEndian;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize, Serializer};

/// A value that CDR has no form for, such as a list of unknown length.
use cdr_encoding::Error as EncodeError;

/// Encapsulation: plain CDR, little-endian, no options (DDS-RTPS 10.2).
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// Puts a message behind bytes, header and all.
pub(super) fn encode_into<T: Serialize>(
    message: &T,
    bytes: &mut Vec<u8>,
) -> Result<(), EncodeError> {
    bytes.extend_from_slice(&ENCAPSULATION);
    cdr_encoding::to_writer::<_, LittleEndian, _>(bytes, message)
}

/// A message as bytes, header and all.
///
/// # Errors
///
/// A type that CDR has no form for, such as a list of unknown length.
pub(crate) fn encode<T: Serialize>(message: &T) -> Result<Vec<u8>, EncodeError> {
    let mut bytes = Vec::new();
    encode_into(message, &mut bytes)?;
    Ok(bytes)
}

/// Takes a message from its bytes; `None` where they are not one.
pub fn decode<T: DeserializeOwned>(bytes: &[u8]) -> Option<T> {
    let body = bytes.strip_prefix(&ENCAPSULATION)?;
    cdr_encoding::from_bytes::<T, LittleEndian>(body).ok().map(|(message, _)| message)
}

/// A list of bytes in one piece, and not each as a number.
fn bytes<S: Serializer>(bytes: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_bytes(bytes)
}

/// `builtin_interfaces/Time`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Time {
    /// Seconds.
    pub sec: i32,
    /// Nanoseconds within the second.
    pub nanosec: u32,
}

impl Time {
    /// A stamp in nanoseconds; beyond 2038 it stays there.
    #[must_use]
    pub fn of_ns(stamp_ns: u64) -> Self {
        let sec = i32::try_from(stamp_ns / 1_000_000_000).unwrap_or(i32::MAX);
        let nanosec = u32::try_from(stamp_ns % 1_000_000_000).unwrap_or(0);
        Self { sec, nanosec }
    }

    /// This many nanoseconds later; before 1970 it stays there.
    #[must_use]
    pub fn later(self, by_ns: i64) -> Self {
        let stamp_ns = i64::from(self.sec) * 1_000_000_000 + i64::from(self.nanosec);
        Self::of_ns(u64::try_from(stamp_ns.saturating_add(by_ns)).unwrap_or(0))
    }
}

/// `std_msgs/Header`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Header {
    /// When the data was valid.
    pub stamp: Time,
    /// The frame it is given in.
    pub frame_id: String,
}

/// `geometry_msgs/Point` and `geometry_msgs/Vector3`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[expect(missing_docs, reason = "x, y, z")]
pub struct Vector3 {
    pub x: f64,
    pub y: f64,
    pub z: f64,
}

/// `geometry_msgs/Quaternion`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "x, y, z, w")]
pub struct Quaternion {
    pub x: f64,
    pub y: f64,
    pub z: f64,
    pub w: f64,
}

impl Quaternion {
    /// A turn about the vertical, anticlockwise seen from above.
    #[must_use]
    pub fn of_yaw(yaw_rad: f64) -> Self {
        let (z, w) = libm::sincos(yaw_rad / 2.0);
        Self { x: 0.0, y: 0.0, z, w }
    }

    /// The turn about the vertical, radians.
    #[must_use]
    pub fn yaw_rad(self) -> f64 {
        2.0 * libm::atan2(self.z, self.w)
    }
}

/// `geometry_msgs/Pose`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "the definition's own names")]
pub struct Pose3 {
    pub position: Vector3,
    pub orientation: Quaternion,
}

impl Pose3 {
    /// A pose on the floor.
    #[must_use]
    pub fn on_floor(pose: &Pose) -> Self {
        let position = Vector3 { x: pose.x_m, y: pose.y_m, z: 0.0 };
        Self { position, orientation: Quaternion::of_yaw(pose.heading_rad) }
    }
}

/// `geometry_msgs/PoseStamped`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "the definition's own names")]
pub struct PoseStamped {
    pub header: Header,
    pub pose: Pose3,
}

/// `geometry_msgs/Twist`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[expect(missing_docs, reason = "the definition's own names")]
pub struct Twist {
    pub linear: Vector3,
    pub angular: Vector3,
}

/// A 6×6 matrix over x, y, z and the rotations about X, Y, Z, row by row.
pub type Covariance = [[f64; 6]; 6];

/// Variance of what a robot on a floor cannot do (lift off, tip over), m² and rad²: nearly none,
/// but not zero, which filters take for "unknown".
pub(super) const PLANAR_VARIANCE: f64 = 1e-9;

/// The estimator's xx, xy, xh, yy, yh, hh in ROS's six by six.
pub(super) fn planar([xx, xy, xh, yy, yh, hh]: [f64; 6]) -> Covariance {
    let still = PLANAR_VARIANCE;
    [
        [xx, xy, 0.0, 0.0, 0.0, xh],
        [xy, yy, 0.0, 0.0, 0.0, yh],
        [0.0, 0.0, still, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, still, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, still, 0.0],
        [xh, yh, 0.0, 0.0, 0.0, hh],
    ]
}

/// `nav_msgs/Odometry`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "the definition's own names")]
pub struct Odometry {
    pub header: Header,
    pub child_frame_id: String,
    pub pose: Pose3,
    pub pose_covariance: Covariance,
    pub twist: Twist,
    pub twist_covariance: Covariance,
}

/// `geometry_msgs/TransformStamped`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "the definition's own names")]
pub struct TransformStamped {
    pub header: Header,
    pub child_frame_id: String,
    pub translation: Vector3,
    pub rotation: Quaternion,
}

/// `tf2_msgs/TFMessage`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct TfMessage {
    /// Any number of transforms.
    pub transforms: Vec<TransformStamped>,
}

/// `sensor_msgs/Range`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "the definition's own names")]
pub struct RangeMessage {
    pub header: Header,
    pub radiation_type: u8,
    pub field_of_view: f32,
    pub min_range: f32,
    pub max_range: f32,
    pub range: f32,
    pub variance: f32,
}

/// `sensor_msgs/PointField`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "the definition's own names")]
pub struct PointField {
    pub name: String,
    pub offset: u32,
    pub datatype: u8,
    pub count: u32,
}

/// `sensor_msgs/PointCloud2`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "the definition's own names")]
pub struct PointCloud2 {
    pub header: Header,
    pub height: u32,
    pub width: u32,
    pub fields: Vec<PointField>,
    pub is_bigendian: bool,
    pub point_step: u32,
    pub row_step: u32,
    #[serde(serialize_with = "bytes")]
    pub data: Vec<u8>,
    pub is_dense: bool,
}

/// `nav_msgs/OccupancyGrid` with its `nav_msgs/MapMetaData`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "the definition's own names")]
pub struct OccupancyGridMessage {
    pub header: Header,
    pub map_load_time: Time,
    pub resolution: f32,
    pub width: u32,
    pub height: u32,
    pub origin: Pose3,
    pub data: Vec<i8>,
}

/// `rcl_interfaces/Log`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "the definition's own names")]
pub struct LogMessage {
    pub stamp: Time,
    pub level: u8,
    pub name: String,
    pub msg: String,
    pub file: String,
    pub function: String,
    pub line: u32,
}

/// `onbrick_msgs/Senses`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct SensesMessage {
    pub(super) tick: u64,
    pub(super) time_ns: i64,
    #[serde(serialize_with = "bytes")]
    pub(super) channel: Vec<u8>,
    pub(super) value: Vec<f64>,
    pub(super) read_ns: Vec<i64>,
    pub(super) changed_ns: Vec<i64>,
}

/// `onbrick_msgs/Transition`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct TransitionMessage {
    pub(super) tick: u64,
    pub(super) time_ns: i64,
    pub(super) machine_index: u16,
    pub(super) from_index: u16,
    pub(super) to_index: u16,
    pub(super) transition_index: i32,
    pub(super) machine: String,
    pub(super) from_state: String,
    pub(super) to_state: String,
    pub(super) condition: String,
}

/// `onbrick_msgs/Keyframes`: what is known now of where the robot was.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Keyframes {
    /// By time; a keyframe's numbers lie in the order of `onbrick_msgs/Keyframe`.
    pub(super) keyframes: Vec<Keyframe>,
}

/// `onbrick_msgs/Variables`: the mission's variables after a tick in which one has changed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Variables {
    /// The tick.
    pub tick: u64,
    /// Its time, nanoseconds of the run's clock.
    pub time_ns: i64,
    /// Their names, in the mission's order.
    pub name: Vec<String>,
    /// The value of each.
    pub value: Vec<f64>,
}

/// `onbrick_msgs/TickStatistics`: the ticks of about a second.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct TickStatistics {
    /// The first of the ticks.
    pub first_tick: u64,
    /// How many there were.
    pub ticks: u32,
    /// How many took longer than the period.
    pub overruns: u32,
    /// How long after its deadline a tick began, the median, in nanoseconds.
    pub lateness_p50_ns: i64,
    /// The same, 99 of 100 at most.
    pub lateness_p99_ns: i64,
    /// The same, the worst.
    pub lateness_max_ns: i64,
    /// The fullest that the ring was, in entries; 0 where time is simulated.
    pub ring_high_water: u32,
    /// The ring's size, in entries.
    pub ring_size: u32,
}

/// `onbrick_msgs/Checkpoint`: enough to go on from after a tick.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Checkpoint {
    /// The tick.
    pub tick: u64,
    /// Its time, nanoseconds of the run's clock.
    pub time_ns: i64,
    /// What the pilot carried, as encoded.
    #[serde(serialize_with = "bytes")]
    pub state: Vec<u8>,
}

impl Checkpoint {
    /// What the pilot carried; `None` where it is of another version.
    #[must_use]
    pub fn state<S: DeserializeOwned>(&self) -> Option<S> {
        decode(&self.state)
    }
}

/// `onbrick_msgs/Gap`: what the recorder could not take.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Gap {
    /// The tick of the first entry that was dropped.
    pub first_tick: u64,
    /// The tick of the last.
    pub last_tick: u64,
    /// How many entries were dropped.
    pub entries: u32,
    /// Why.
    pub reason: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alignment_counts_from_behind_the_header() {
        let gap = Gap { first_tick: 1, last_tick: 2, entries: 3, reason: "a".to_owned() };
        let bytes = encode(&gap).unwrap();
        let expected = [
            0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 3, 0, 0, 0, 2, 0, 0, 0,
            b'a', 0,
        ];
        assert_eq!(bytes, expected, "eight-byte fields begin at body offsets 0 and 8");
        assert_eq!(decode::<Gap>(&bytes), Some(gap));
    }

    #[test]
    fn a_cut_message_or_another_encapsulation_is_none() {
        let bytes = encode(&Header { stamp: Time::of_ns(5), frame_id: "map".to_owned() }).unwrap();
        for length in 0..bytes.len() {
            assert_eq!(decode::<Header>(&bytes[..length]), None, "{length} bytes");
        }
        let mut big_endian = bytes;
        big_endian[1] = 0;
        assert_eq!(decode::<Header>(&big_endian), None);
    }

    #[test]
    fn stamps_beyond_2038_stay_there() {
        assert_eq!(Time::of_ns(1_500_000_000), Time { sec: 1, nanosec: 500_000_000 });
        assert_eq!(Time::of_ns(u64::MAX).sec, i32::MAX);
        assert_eq!(
            Time::of_ns(1_500_000_000).later(-600_000_000),
            Time { sec: 0, nanosec: 900_000_000 }
        );
        assert_eq!(Time::of_ns(5).later(-6), Time::default());
        assert_eq!(Time::of_ns(5).later(i64::MAX).sec, i32::MAX);
    }
}
