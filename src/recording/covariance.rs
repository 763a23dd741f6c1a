//! Covariances of recorded poses.

use crate::mapping::Pose;

/// How exactly a robot is put down by hand at the pose that the run starts from, metres and radians
/// (1 cm, 1°): standard deviations.
const PUT_DOWN_M: f64 = 0.01;
const PUT_DOWN_RAD: f64 = std::f64::consts::PI / 180.0;

/// The covariance of a pose together with what the start is uncertain by: an error of the start's
/// heading turns all that was driven since about the start.
pub(super) fn from_put_down(
    [xx, xy, xh, yy, yh, hh]: [f64; 6],
    pose: Pose,
    start: Pose,
) -> [f64; 6] {
    let (m2, rad2) = (PUT_DOWN_M * PUT_DOWN_M, PUT_DOWN_RAD * PUT_DOWN_RAD);
    let (x, y) = (pose.x_m - start.x_m, pose.y_m - start.y_m);
    [
        xx + m2 + y * y * rad2,
        xy - x * y * rad2,
        xh - y * rad2,
        yy + m2 + x * x * rad2,
        yh + x * rad2,
        hh + rad2,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_start_that_is_a_degree_off_puts_what_is_ten_metres_ahead_17_cm_beside() {
        let ahead = Pose { x_m: 11.0, y_m: 2.0, heading_rad: 0.0 };
        let start = Pose { x_m: 1.0, y_m: 2.0, heading_rad: 0.0 };
        let [xx, xy, xh, yy, yh, hh] = from_put_down([0.0; 6], ahead, start);
        let beside_m2 = yy - PUT_DOWN_M * PUT_DOWN_M;
        assert!((libm::sqrt(beside_m2) - 0.1745).abs() < 1e-4, "{yy}");
        assert!((yh / libm::sqrt(beside_m2 * hh) - 1.0).abs() < 1e-12, "all of it by the heading");
        assert!((libm::sqrt(xx) - PUT_DOWN_M).abs() < 1e-12 && xy.abs() + xh.abs() < 1e-12);
    }
}
