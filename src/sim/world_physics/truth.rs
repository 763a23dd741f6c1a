//! How a simulated robot truly is.

use std::sync::{Arc, Mutex};

use crate::threads::lock;

/// How things truly are with one robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// World frame, metres.
    pub x_m: f64,
    /// World frame, metres.
    pub y_m: f64,
    /// Anticlockwise from the world's x; not wrapped.
    pub heading_rad: f64,
    /// Forward speed, metres a second; negative backwards.
    pub speed_mps: f64,
    /// Shaft angles of the left and the right drive motor, radians, in the motors' own direction.
    pub wheels_rad: [f64; 2],
    /// Head against body, anticlockwise.
    pub head_rad: f64,
    /// Length of the path so far.
    pub travelled_m: f64,
    /// True while the outline pushes against something.
    pub touching: bool,
    /// True once the middle of the axle has been beyond the edge of the floor: the robot would have
    /// fallen.
    pub fallen: bool,
}

/// Sees the truth of every robot while the physics is inside a simulation.
#[derive(Debug, Clone)]
pub struct Observer(pub(super) Arc<Mutex<Vec<Truth>>>);

impl Observer {
    /// One robot's truth after the latest step; `None` where there is no such robot.
    #[must_use]
    pub fn truth(&self, robot: usize) -> Option<Truth> {
        lock(&self.0).get(robot).copied()
    }
}
