//! Walls as `visualization_msgs/Marker`: a list of lines, which Foxglove and RViz draw.
//!
//! # Not here
//!
//! No standard deviations, for which the message has no field: a reader makes walls again from
//! points and poses.

use serde::{Deserialize, Serialize};

use super::message::{Header, Pose3, Quaternion, Time, Vector3};
use crate::mapping::{self, Estimate, Keyframe, MapPoint, Sight, Wall, points_now};

const LINE_LIST: i32 = 5;
/// How thick the lines are drawn, metres.
const THICK_M: f64 = 0.03;

/// What walls are made from: a run's points, and where the robot was.
#[derive(Debug, Default)]
pub(super) struct Surveyed {
    pub(super) points: Vec<MapPoint>,
    /// What is known now of where the robot was.
    pub(super) keyframes: Vec<Keyframe>,
    path: Vec<MapPoint>,
}

impl Surveyed {
    pub(super) fn note_pose(&mut self, estimate: &Estimate) {
        let (x_m, y_m) = (estimate.pose.x_m, estimate.pose.y_m);
        self.path.push(MapPoint { time_ns: estimate.time_ns, x_m, y_m });
    }

    /// The walls, if there are any.
    pub(super) fn message(&self, header: Header) -> Option<Marker> {
        let [points, path] = [&self.points, &self.path].map(|all| points_now(&self.keyframes, all));
        let walls = mapping::walls(&Sight::of(&points, &path));
        (!walls.is_empty()).then(|| message(&walls, header))
    }
}

/// `std_msgs/ColorRGBA`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct ColorRgba {
    pub(super) r: f32,
    pub(super) g: f32,
    pub(super) b: f32,
    pub(super) a: f32,
}

/// `visualization_msgs/Marker`, of which its pictures and meshes are always empty here.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Marker {
    pub(crate) header: Header,
    pub(super) ns: String,
    pub(super) id: i32,
    pub(super) r#type: i32,
    pub(super) action: i32,
    pub(super) pose: Pose3,
    pub(super) scale: Vector3,
    pub(super) color: ColorRgba,
    pub(super) lifetime: Time,
    pub(super) frame_locked: bool,
    pub(super) points: Vec<Vector3>,
    pub(super) rest: Rest,
}

/// What of a marker lines do not use; in the encoding it stands as if its fields were the marker's.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Rest {
    colors: Vec<ColorRgba>,
    texture_resource: String,
    texture_header: Header,
    texture_format: String,
    texture_data: Vec<u8>,
    uv_coordinates: Vec<[f32; 2]>,
    text: String,
    mesh_resource: String,
    mesh_file_name: String,
    mesh_file_data: Vec<u8>,
    mesh_use_embedded_materials: bool,
}

/// Walls as one marker, two points a wall.
fn message(walls: &[Wall], header: Header) -> Marker {
    let ends = walls.iter().flat_map(|wall| [wall.from_m, wall.to_m]);
    Marker {
        header,
        ns: "walls".to_owned(),
        id: 0,
        r#type: LINE_LIST,
        action: 0,
        pose: Pose3 { position: Vector3::default(), orientation: Quaternion::of_yaw(0.0) },
        scale: Vector3 { x: THICK_M, ..Vector3::default() },
        color: ColorRgba { r: 0.13, g: 0.15, b: 0.17, a: 1.0 },
        lifetime: Time::default(),
        frame_locked: false,
        points: ends.map(|[x, y]| Vector3 { x, y, z: 0.0 }).collect(),
        rest: Rest::default(),
    }
}
