//! Map points as `sensor_msgs/PointCloud2`, and back bit for bit.
//!
//! Viewers want x, y and z in single precision; beside them each point has its own values: `x_m`
//! and `y_m` in double precision and its time in nanoseconds as two halves, because ROS has no
//! 64-bit field.

use super::message::{Header, PointCloud2, PointField};
use crate::mapping::MapPoint;

/// Bytes of a point.
const STEP: u32 = 40;

const UINT32: u8 = 6;
const FLOAT32: u8 = 7;
const FLOAT64: u8 = 8;

/// Name, offset and type of each field.
const FIELDS: [(&str, u32, u8); 7] = [
    ("x", 0, FLOAT32),
    ("y", 4, FLOAT32),
    ("z", 8, FLOAT32),
    ("x_m", 16, FLOAT64),
    ("y_m", 24, FLOAT64),
    ("time_ns_low", 32, UINT32),
    ("time_ns_high", 36, UINT32),
];

/// Points as a cloud in one row.
pub(super) fn message(points: &[MapPoint], header: Header) -> PointCloud2 {
    let field = |(name, offset, datatype): (&str, u32, u8)| PointField {
        name: name.to_owned(),
        offset,
        datatype,
        count: 1,
    };
    let width = u32::try_from(points.len()).unwrap_or(u32::MAX);
    PointCloud2 {
        header,
        height: 1,
        width,
        fields: FIELDS.map(field).to_vec(),
        is_bigendian: false,
        point_step: STEP,
        row_step: width.saturating_mul(STEP),
        data: points.iter().flat_map(bytes_of).collect(),
        is_dense: true,
    }
}

/// The points of a cloud that [`message`] made; nothing of any other.
pub(super) fn points(cloud: &PointCloud2) -> Option<Vec<MapPoint>> {
    let known = cloud.fields.len() == FIELDS.len()
        && cloud.fields.iter().zip(FIELDS).all(|(field, (name, offset, datatype))| {
            field.name == name && field.offset == offset && field.datatype == datatype
        });
    let (points, rest) = cloud.data.as_chunks::<{ STEP as usize }>();
    let whole = rest.is_empty() && u32::try_from(points.len()) == Ok(cloud.width);
    (known && whole && !cloud.is_bigendian).then(|| points.iter().map(point_of).collect())
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "single precision is for viewers; the full values stand beside it"
)]
fn bytes_of(point: &MapPoint) -> [u8; STEP as usize] {
    let mut bytes = [0; STEP as usize];
    bytes[..4].copy_from_slice(&(point.x_m as f32).to_le_bytes());
    bytes[4..8].copy_from_slice(&(point.y_m as f32).to_le_bytes());
    bytes[16..24].copy_from_slice(&point.x_m.to_le_bytes());
    bytes[24..32].copy_from_slice(&point.y_m.to_le_bytes());
    bytes[32..].copy_from_slice(&point.time_ns.to_le_bytes());
    bytes
}

fn point_of(bytes: &[u8; STEP as usize]) -> MapPoint {
    let (eights, _) = bytes.as_chunks::<8>();
    MapPoint {
        x_m: f64::from_le_bytes(eights[2]),
        y_m: f64::from_le_bytes(eights[3]),
        time_ns: i64::from_le_bytes(eights[4]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn points_come_back_bit_for_bit(
            values in proptest::collection::vec((any::<i64>(), -1e6..1e6, -1e6..1e6), 0..50),
        ) {
            let all: Vec<MapPoint> = values
                .into_iter()
                .map(|(time_ns, x_m, y_m)| MapPoint { time_ns, x_m, y_m })
                .collect();
            let cloud = message(&all, Header::default());
            prop_assert_eq!(points(&cloud), Some(all));
        }
    }

    #[test]
    fn another_cloud_has_no_points_of_ours() {
        let mut cloud = message(&[MapPoint { time_ns: 1, x_m: 2.0, y_m: 3.0 }], Header::default());
        cloud.width = 2;
        assert_eq!(points(&cloud), None);
        cloud.width = 1;
        cloud.fields[3].offset = 17;
        assert_eq!(points(&cloud), None);
    }
}
