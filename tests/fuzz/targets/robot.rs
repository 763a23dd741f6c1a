//! Any bytes as a robot file: loaded or refused; what loads has measures that make sense and
//! thresholds in their order.
#![no_main]

use libfuzzer_sys::fuzz_target;
use onbrick::robot::RobotConfig;

fuzz_target!(|bytes: &[u8]| {
    match RobotConfig::load("robot.toml", bytes) {
        Ok((robot, _)) => {
            assert!(robot.geometry().is_ok(), "{robot:?}");
            let max_wheel_rad_s = robot.drive.max_wheel_rad_s;
            assert!(max_wheel_rad_s.is_finite() && max_wheel_rad_s > 0.0, "{robot:?}");
            let limits = robot.battery.limits();
            assert!(limits.warn_v >= limits.slow_v && limits.slow_v >= limits.stop_v, "{limits:?}");
        }
        Err(findings) => {
            let told = findings.to_string();
            assert!(told.contains("robot.toml"), "no place: {told}");
        }
    }
});
