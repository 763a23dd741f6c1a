//! What the wheels are to do: from a mission's demand to wheel speeds within the robot's limits.

use std::f64::consts::PI;

use super::RobotConfig;
use crate::behavior::{Capabilities, Drive, MotionLimits};
use crate::mapping::{Geometry, GeometryError};
use crate::senses::Role;

impl RobotConfig {
    /// What a mission can ask of this robot.
    #[must_use]
    pub fn capabilities(&self) -> Capabilities {
        let head = self.head.iter().map(|_| Role::Head);
        Capabilities {
            roles: self.sensors.keys().copied().chain(head).collect(),
            motors: Some(
                self.motors.iter().map(|motor| (motor.name.clone(), motor.max_rad_s)).collect(),
            ),
            sensors: Some(
                self.named_sensors
                    .iter()
                    .map(|named| (named.name.clone(), named.measures))
                    .collect(),
            ),
            limits: Some(self.motion_limits()),
        }
    }

    /// The measures that odometry and mapping need.
    ///
    /// # Errors
    ///
    /// A measure that makes no sense, though it passed when the file was read.
    pub fn geometry(&self) -> Result<Geometry, GeometryError> {
        let usual = Geometry::new(self.drive.wheel_circumference_m, self.drive.track_width_m)?;
        // Wheels that are geared up are faster than any motor.
        let fastest_rad_s = self.drive.max_wheel_rad_s.max(usual.max_wheel_rad_s());
        usual
            .with_gyro_scale(self.gyro_scale)?
            .with_max_wheel_rad_s(fastest_rad_s)?
            .with_range(self.range.unwrap_or_default())
    }

    /// Metres driven for a radian of a wheel.
    #[must_use]
    pub fn metres_per_rad(&self) -> f64 {
        self.drive.wheel_circumference_m / (2.0 * PI)
    }

    /// What motions that end keep to.
    #[must_use]
    pub fn motion_limits(&self) -> MotionLimits {
        let max_m_s = self.drive.max_wheel_rad_s * self.drive.wheel_circumference_m / (2.0 * PI);
        MotionLimits {
            // Half of what the wheels may do leaves them room for steering.
            speed_m_s: self.drive.speed_m_s.unwrap_or(max_m_s / 2.0),
            max_m_s,
            max_wheel_rad_s: self.drive.max_wheel_rad_s,
            acceleration_m_s2: self.drive.acceleration_m_s2,
            half_track_m: self.drive.track_width_m / 2.0,
            head_rad: self.head.as_ref().map_or(0.0, |head| head.limit_rad),
            head_max_rad_s: self.head.as_ref().map_or(0.0, |head| head.max_rad_s),
            range_ahead_m: self.range.as_ref().map_or(0.0, |range| range.ahead_m),
            spins_first: self.range.is_some()
                && self.has(Role::Gyro)
                && self.geometry().is_ok_and(|geometry| !geometry.knows_gyro_scale()),
        }
    }

    /// The speeds of the left and the right wheel for a demand, radians per second at the axle.
    ///
    /// Where one would be too fast, both are scaled down, so that the robot keeps its curve. No
    /// demand, a stop, and a demand that is not finite are no speed.
    #[must_use]
    pub fn wheel_speeds(&self, drive: Option<Drive>) -> [f64; 2] {
        let wanted = match drive {
            None | Some(Drive::Stop(_)) => [0.0; 2],
            Some(Drive::Wheels { left_rad_s, right_rad_s }) => [left_rad_s, right_rad_s],
            Some(Drive::Twist { forward_m_s, turn_rad_s }) => {
                let metres_per_rad = self.metres_per_rad();
                let turning_m_s = turn_rad_s * self.drive.track_width_m / 2.0;
                [
                    (forward_m_s - turning_m_s) / metres_per_rad,
                    (forward_m_s + turning_m_s) / metres_per_rad,
                ]
            }
        };
        if wanted.iter().all(|speed| speed.abs() <= self.drive.max_wheel_rad_s) {
            wanted
        } else {
            self.slower(wanted)
        }
    }

    /// Wheels that are told to turn too fast, at the same ratio; none where a speed is not finite.
    #[cold]
    fn slower(&self, wanted: [f64; 2]) -> [f64; 2] {
        let fastest = wanted[0].abs().max(wanted[1].abs());
        if wanted.iter().all(|speed| speed.is_finite()) {
            wanted.map(|speed| speed * (self.drive.max_wheel_rad_s / fastest))
        } else {
            [0.0; 2]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::MILLISECOND_NS;
    use crate::mapping::{Estimator, EstimatorConfig, Inputs, Method, Pose};
    use crate::robot::DEFAULT_ROBOT;
    use proptest::prelude::*;

    fn robot() -> RobotConfig {
        RobotConfig::load("robot.toml", DEFAULT_ROBOT.as_bytes()).unwrap().0
    }

    #[test]
    fn a_turn_on_the_spot_turns_the_wheels_against_each_other() {
        let [left, right] =
            robot().wheel_speeds(Some(Drive::Twist { forward_m_s: 0.0, turn_rad_s: 1.0 }));
        assert!(
            (left + right).abs() < 1e-12 && right > 0.0,
            "anticlockwise: the right wheel goes ahead: {left} {right}"
        );
        let expected = 0.1143 / 2.0 / (0.188_976 / (2.0 * PI));
        assert!((right - expected).abs() < 1e-9, "{right} instead of {expected}");
    }

    #[test]
    fn too_fast_keeps_the_curve() {
        let robot = robot();
        let [left, right] =
            robot.wheel_speeds(Some(Drive::Wheels { left_rad_s: 100.0, right_rad_s: -50.0 }));
        assert!(
            (left - robot.drive.max_wheel_rad_s).abs() < 1e-9
                && (right + robot.drive.max_wheel_rad_s / 2.0).abs() < 1e-9
        );
    }

    #[test]
    fn wheels_that_are_geared_up_are_followed() {
        let mut robot = robot();
        // A motor of 18 rad/s with 36 teeth on 12.
        robot.drive.max_wheel_rad_s = 54.0;
        let (geometry, start) = (robot.geometry().unwrap(), Pose::default());
        let mut estimator =
            Estimator::new(EstimatorConfig { geometry, method: Method::Default }, start);
        let driven = (0..=50).map(|tick| {
            let rad = Some(54.0 * 0.02 * f64::from(tick));
            let time_ns = i64::from(tick) * 20 * MILLISECOND_NS;
            let inputs = Inputs { time_ns, left_rad: rad, right_rad: rad, ..Inputs::default() };
            estimator.update(&inputs).pose.x_m
        });
        let (x_m, expected_m) = (driven.last().unwrap(), 54.0 * robot.metres_per_rad());
        assert!((x_m - expected_m).abs() < 0.01, "{x_m} m for {expected_m} m");
    }

    proptest! {
        #[test]
        fn whatever_is_demanded_stays_within_the_limit(
            left_rad_s in proptest::num::f64::ANY,
            right_rad_s in proptest::num::f64::ANY,
            twist in any::<bool>(),
        ) {
            let robot = robot();
            let drive = if twist {
                Drive::Twist { forward_m_s: left_rad_s, turn_rad_s: right_rad_s }
            } else {
                Drive::Wheels { left_rad_s, right_rad_s }
            };
            for speed in robot.wheel_speeds(Some(drive)) {
                prop_assert!(
                    speed.abs() <= robot.drive.max_wheel_rad_s * (1.0 + 1e-12),
                    "{drive:?} gave {speed}"
                );
            }
        }
    }
}
