//! Where the robot is and what is around it: odometry, heading, point cloud, occupancy grid.

use serde::{Deserialize, Serialize};

/// A pose in the plane, world frame: x ahead of the start, y left, heading anticlockwise from x.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pose {
    /// Metres.
    pub x_m: f64,
    /// Metres.
    pub y_m: f64,
    /// Radians; it does not wrap, so that turns can be counted.
    pub heading_rad: f64,
}

/// What the range sensor says, told apart.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Range {
    /// Something reflects at this distance from the sensor, in metres.
    Echo(f64),
    /// Nothing within range.
    NoEcho,
    /// Something is nearer than the sensor can measure.
    TooNear,
}

/// One point of the map, world frame, in metres, with the time of its reading.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MapPoint {
    /// Nanoseconds of the run's clock.
    pub time_ns: i64,
    /// Metres.
    pub x_m: f64,
    /// Metres.
    pub y_m: f64,
}

/// What the estimator carries from tick to tick: enough to go on from.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct EstimatorState {
    /// The pose.
    pub pose: Pose,
}

/// What one update came to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The time of the update.
    pub time_ns: i64,
    /// The pose.
    pub pose: Pose,
    /// Forward speed, metres per second.
    pub forward_m_s: f64,
    /// Turning speed, radians per second.
    pub turn_rad_s: f64,
    /// Variances and covariances of x, y, heading: xx, xy, xh, yy, yh, hh in m², m·rad and rad².
    pub covariance: [f64; 6],
    /// Metres driven since the start, forwards and backwards both counting.
    pub travelled_m: f64,
    /// The range reading as it is to be understood; `None` without a range sensor or while it is lost.
    pub range: Option<Range>,
}
