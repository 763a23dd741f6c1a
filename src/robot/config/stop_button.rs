//! `[stop_button]` of `robot.toml`: what stops a run on a board that has no buttons.

use std::path::PathBuf;

use crate::document::Section;
use crate::ev3dev::PortAddress;

/// What stops a run beside the board's own buttons.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum StopButton {
    /// A touch sensor: pressing it stops the run.
    Touch(PortAddress),
    /// An input device of the kernel, as a button on a GPIO is one (`gpio-keys`): its keys Enter
    /// and Back (`KEY_BACKSPACE`) stop the run.
    Device(PathBuf),
}

/// Reads the section; `None` where it is wrong.
pub(super) fn stop_button(section: &Section<'_>) -> Option<StopButton> {
    section.allow(&["port", "device"]);
    let device = section.get("device");
    match (super::port::port(section)?, device) {
        (Some(port), None) => Some(StopButton::Touch(port)),
        (None, Some(device)) => Some(StopButton::Device(device.text()?.into())),
        _ => {
            section.error("a stop button has either a port or a device").hint(
                "port = \"S2\" for a touch sensor; device = \"dev/input/by-path/…\" for a button \
                 on a GPIO",
            );
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ev3dev::Driver;
    use crate::robot::{DEFAULT_ROBOT, RobotConfig};
    use crate::senses::Role;

    fn load(more: &str) -> Result<RobotConfig, String> {
        let text = format!("{DEFAULT_ROBOT}\n{more}");
        RobotConfig::load("robot.toml", text.as_bytes())
            .map(|(config, _)| config)
            .map_err(|findings| findings.to_string())
    }

    #[test]
    fn a_stop_button_is_a_touch_sensor_or_a_device_of_the_kernel() {
        let own = load("").unwrap();
        assert_eq!(own.stop_button, None);
        let port = load("[stop_button]\nport = \"BBS1\"").unwrap().stop_button;
        assert_eq!(port, Some(StopButton::Touch("BBS1".parse().unwrap())));
        let device = load("[stop_button]\ndevice = \"dev/input/by-path/gpio\"").unwrap();
        let path = "dev/input/by-path/gpio".into();
        assert_eq!(device.stop_button, Some(StopButton::Device(path)));
        for (more, says) in [
            ("[stop_button]", "has either a port or a device"),
            ("[stop_button]\nport = \"in3\"\ndevice = \"x\"", "has either a port or a device"),
            ("[stop_button]\nport = \"in4\"", "`stop_button` and `gyro` are both on in4"),
            ("[stop_button]\nkey = \"in3\"", "unknown key `key` in [stop_button]"),
        ] {
            let said = load(more).unwrap_err();
            assert!(said.contains(says), "{more}: {said}");
        }
    }

    #[test]
    fn a_sensors_driver_is_one_that_its_role_can_have() {
        let with = |driver: &str| {
            let text = DEFAULT_ROBOT.replace("# driver = \"lego-ev3-us\"", driver);
            assert_ne!(text, DEFAULT_ROBOT);
            RobotConfig::load("robot.toml", text.as_bytes()).map(|(config, _)| config)
        };
        assert_eq!(with("").unwrap().driver_of(Role::Range), Some(Driver::Ultrasonic));
        let infrared = with("driver = \"lego-ev3-ir\"").unwrap();
        assert_eq!(infrared.driver_of(Role::Range), Some(Driver::Infrared));
        let said = with("driver = \"lego-ev3-gyro\"").unwrap_err().to_string();
        assert!(said.contains("lego-ev3-us") && said.contains("lego-ev3-ir"), "{said}");
    }
}
