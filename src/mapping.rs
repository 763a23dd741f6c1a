//! Where the robot is and what is around it: odometry, heading, point cloud, occupancy grid.
//!
//! Each tick an [`Estimator`] takes [`Inputs`] and gives an [`Estimate`]: the pose with its
//! covariance, the interpreted range reading, what was noticed ([`Events`]), and,
//! when a range reading is new, a [`Sounding`]: the reading with the place and the direction it was
//! taken from. A [`Map`] takes estimates and keeps points, path and grid.
//!
//! Three ways of estimating stand beside each other ([`Method`]): the seed's, exactly, dead
//! reckoning, and the default, which corrects that by landmarks.
//!
//! # Frames
//!
//! *World*: x ahead of the origin, y left. *Body*: the pose; its origin is the middle between the
//! wheels, x ahead, y left. *Sensor*: translated from the body by the range sensor's place, then
//! turned by the head's angle. Anticlockwise is positive; headings do not wrap. Metres, radians,
//! nanoseconds.
//!
//! # Formulas
//!
//! | what | how | source |
//! |---|---|---|
//! | step, turn | (d_right + d_left) / 2, (d_right − d_left) / track width | Borenstein, Everett, Feng, *Where am I?* 1.1 |
//! | the seed's pose | pose ⊗ (rotation by the gyro's change, translation by the step along x): the step is made along the heading before it | MappingRobots.jl |
//! | the default's pose | the step along the mean of the headings before and after | Thrun, Burgard, Fox, *Probabilistic Robotics* 5.4 |
//! | the default's heading | the encoders' turn, held within half a degree of the gyro's angle; its bias removed, learnt at standstills and, where it is slow, by the wheels | `mapping/gyro.rs`, `mapping/drift.rs` |
//! | slip | recent turns by encoders and gyro differ by more than 4° and a fifth | `mapping/slip.rs` |
//! | covariance | first order; wheel errors grow with the way, gyro errors with turn and time | *Probabilistic Robotics* 5.4; Chong, Kleeman 1997; UMBmark for what calibration removes |
//! | point | pose × (translation to the sensor) × (rotation by the head) × (range, 0), for the default at the instant of the reading | MappingRobots.jl |
//! | echo | off the axis towards falling ranges, for the default | `mapping/bearing.rs` |
//! | what was placed before a correction | moves with keyframes of the way, which the filter corrects with all else | `mapping/keyframes.rs` |
//! | what stands | not what was driven over, seen through or lies behind a wall; after the run | `mapping/standing.rs` |
//! | points that several sides heard | turned about where the robot was to where arcs cross; after the run | `mapping/crossings.rs` |
//! | walls | lines that points vote for, fitted by total least squares; after the run | `mapping/walls.rs` |
//! | maps of several robots | correlative scan matching, and what the other saw | `mapping/align.rs` |
//! | grid | log-odds, a sonar cone | *Probabilistic Robotics* 9.2; Elfes 1989 |
//!
//! # Not here
//!
//! No I/O and no clock: time is in the inputs. No loop closing over what is no landmark any more.
//! No scoring of maps against walls; what that needs of statistics is in [`stats`].
//!
//! # What it costs
//!
//! Nothing is allocated from construction to the run's end. A [`Map`] takes 1.8 MB at most, its
//! points, path and readings thinned when they are full, for a mission of any length; an
//! [`EstimatorState`] 30 kB, most of it the filter's covariances and the echoes and points that
//! wait.
//!
//! On an emulated ARM926 (`brick-image/emulate.sh --exact cost`) a tick of the mission `map` at 100
//! Hz takes 27,000 instructions in the mean for estimate, map and decisions together. What the tick
//! takes in which a sweep's foot corrects the pose was not measured apart.

mod align;
mod bearing;
mod cloud;
mod crossings;
mod drift;
mod estimator;
mod events;
mod filter;
mod geometry;
mod grid;
mod gyro;
mod history;
mod inputs;
mod keyframes;
mod landmarks;
mod map;
mod own_echoes;
mod pose;
mod range;
mod room;
mod sight;
mod slip;
mod sounding;
mod standing;
pub mod stats;
mod survey;
mod sweep;
mod uncertainty;
mod walls;
mod wheels;
pub(crate) mod whole_turn;

pub use align::{Misfit, Testimony, align, has_enough, testimonies};
pub use crossings::crossings;
pub use estimator::{Estimator, EstimatorState};
pub use events::Events;
pub use geometry::{EstimatorConfig, Geometry, GeometryError, Method, RangeMount};
pub use grid::{Cell, OccupancyGrid};
pub use inputs::{GyroReading, Inputs, RangeReading};
pub use keyframes::{Keyframe, KeyframeList, points_now, where_now};
pub use map::{Map, joint_grid};
pub use own_echoes::{OwnEcho, OwnEchoes};
pub use pose::Pose;
pub use range::Range;
pub use sight::Sight;
pub use slip::turns_disagree;
pub use sounding::Sounding;
pub use standing::standing;
pub use walls::{Wall, walls};

use std::ops::Deref;

use serde::{Deserialize, Serialize};

/// One point of the map, world frame, in metres, with the time of its reading.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct MapPoint {
    /// Nanoseconds of the run's clock.
    pub time_ns: i64,
    /// Metres.
    pub x_m: f64,
    /// Metres.
    pub y_m: f64,
}

/// Points that an update placed, a few at a time.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Placed {
    points: [MapPoint; Placed::MOST],
    count: u8,
}

impl Placed {
    /// The most that an update places.
    pub const MOST: usize = 4;

    fn push(&mut self, point: MapPoint) {
        if let Some(place) = self.points.get_mut(usize::from(self.count)) {
            *place = point;
            self.count += 1;
        }
    }
}

/// The first few; what is more has no place.
impl FromIterator<MapPoint> for Placed {
    fn from_iter<I: IntoIterator<Item = MapPoint>>(points: I) -> Self {
        let mut placed = Self::default();
        points.into_iter().for_each(|point| placed.push(point));
        placed
    }
}

impl Deref for Placed {
    type Target = [MapPoint];

    fn deref(&self) -> &[MapPoint] {
        self.points.get(..usize::from(self.count)).unwrap_or_default()
    }
}

/// What one update came to.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Estimate {
    /// The time of the update.
    pub time_ns: i64,
    /// The pose.
    pub pose: Pose,
    /// Forward speed, metres per second, smoothed over a tenth of a second.
    pub forward_m_s: f64,
    /// Turning speed, radians per second, smoothed in the same way.
    pub turn_rad_s: f64,
    /// Variances and covariances of x, y, heading: xx, xy, xh, yy, yh, hh in m², m·rad and rad².
    pub covariance: [f64; 6],
    /// Metres driven since the start, forwards and backwards both counting.
    pub travelled_m: f64,
    /// The interpreted range reading; `None` without a range sensor or while it is lost.
    pub range: Option<Range>,
    /// The range reading in the world, in updates in which there is one to place.
    pub sounding: Option<Sounding>,
    /// Echoes of earlier updates of which it is now known where they lie.
    pub placed: Placed,
    /// What was noticed.
    pub events: Events,
}

impl Estimate {
    /// Variances of the forward speed, m²/s², and of the turning speed, rad²/s².
    #[must_use]
    pub fn speed_variances(&self) -> [f64; 2] {
        uncertainty::of_speeds(self.forward_m_s, self.turn_rad_s, estimator::SPEED_MEMORY_S)
    }
}
