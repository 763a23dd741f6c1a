//! The text of a `robot.toml` as `setup` writes it: the comments of the shipped file, the values of
//! the answers.

use std::collections::BTreeMap;

use crate::document::save::quoted;
use crate::ev3dev::{Driver, PortAddress};
use crate::robot::{ROBOTS, RobotConfig, ShippedRobot};
use crate::senses::Role;
use crate::units::rounded_to;

/// What was found out about a robot; the measures begin as those of the seed's robot.
#[derive(Debug, Clone, PartialEq)]
pub struct Draft {
    /// The robot's name.
    pub name: String,
    /// The left wheel's motor.
    pub left: Option<DraftMotor>,
    /// The right wheel's motor.
    pub right: Option<DraftMotor>,
    /// Metres driven in one turn of a wheel.
    pub wheel_circumference_m: f64,
    /// Metres between the wheels.
    pub track_width_m: f64,
    /// The motor that turns the range sensor.
    pub head: Option<DraftHead>,
    /// The sensors' ports.
    pub sensors: BTreeMap<Role, String>,
    /// Metres from the middle between the wheels to the range sensor.
    pub range_ahead_m: f64,
    /// Nothing beyond this becomes a point of the map, metres.
    pub range_max_m: f64,
    /// Half of the cone in which the range sensor hears, degrees.
    pub range_half_cone_deg: f64,
    /// The range sensor's driver, where it is not the one that is preferred: a board whose ports do
    /// not find out is told so.
    pub range_driver: Option<Driver>,
    /// The port of the touch sensor that stops a run.
    pub stop_button: Option<String>,
    /// Further motors: name and port.
    pub motors: Vec<(String, String)>,
}

/// A wheel's motor.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DraftMotor {
    /// Where it is plugged in.
    pub port: String,
    /// It turns the wheel backwards when it turns forwards itself.
    pub inverted: bool,
}

/// The head's motor.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DraftHead {
    /// Where it is plugged in.
    pub port: String,
    /// Teeth on the motor, with a minus where the head turns the other way, and on the head.
    pub gear: [i32; 2],
}

impl Default for Draft {
    fn default() -> Self {
        Self {
            name: "mapper".to_owned(),
            left: None,
            right: None,
            wheel_circumference_m: 0.188_976,
            track_width_m: 0.1143,
            head: None,
            sensors: BTreeMap::new(),
            range_ahead_m: 0.0508,
            range_max_m: 2.0,
            range_half_cone_deg: 14.0,
            range_driver: None,
            stop_button: None,
            motors: Vec::new(),
        }
    }
}

/// Where the comments behind values begin, in characters.
const COMMENT_COLUMN: usize = 40;

/// Counts a second of the head's motor: the seed's, and with which a robot that finds its way sees
/// each side again within 0.4 m, ten readings a second being 9° apart.
const HEAD_MOTOR_DPS: [f64; 2] = [130.0, 270.0];

impl Draft {
    /// The shipped robot that is plugged in like this one: the same wheels, a head or none, and all
    /// sensors of this one where that one has them.
    #[must_use]
    pub fn shipped(&self) -> Option<(&'static ShippedRobot, RobotConfig)> {
        let port = |address: &Option<PortAddress>| {
            address.as_ref().map(|address| address.short().to_owned())
        };
        let loaded = ROBOTS.iter().filter_map(|shipped| {
            let (config, _) = RobotConfig::load(shipped.name, shipped.text.as_bytes()).ok()?;
            Some((shipped, config))
        });
        let is_like = |(_, config): &(&ShippedRobot, RobotConfig)| {
            let wheels = [(&self.left, &config.drive.left), (&self.right, &config.drive.right)];
            let same_wheels = wheels.into_iter().all(|(mine, its)| {
                let inverted = its.ratio < 0.0;
                mine.as_ref()
                    .is_some_and(|mine| mine.port == its.port.short() && mine.inverted == inverted)
            });
            let same_sensors = self.sensors.iter().all(|(role, mine)| {
                config.sensors.get(role).is_some_and(|its| port(its).as_ref() == Some(mine))
            });
            same_wheels && same_sensors && self.head.is_some() == config.head.is_some()
        };
        loaded.into_iter().find(is_like).filter(|_| !self.sensors.is_empty())
    }

    /// The file's text.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let Self { name, wheel_circumference_m, track_width_m, .. } = self;
        let wheel = |side: &str, motor: &Option<DraftMotor>, note: &str| {
            motor.as_ref().map_or_else(String::new, |motor| {
                let inverted = if motor.inverted { ", inverted = true" } else { "" };
                format!("{side} = {{ port = {}{inverted} }}{note}\n", quoted(&motor.port))
            })
        };
        let mut text = format!(
            "\
# The robot: what is plugged in where, and its measures. Written by `onbrick setup`;
# `onbrick calibrate` measures it by driving, `onbrick doctor` checks it against what is plugged in.
#
# Every section but [drive] can be left out, and a sensor's port where only one sensor fits.

name = {}
# max_age_s = 0.3\ta reading older than this is lost

[drive]
{}{}wheel_circumference_m = {wheel_circumference_m}\tmetres driven in one turn of a wheel
track_width_m = {track_width_m}\tmetres between the wheels
max_dps = 360\tthe fastest that a wheel may turn, degrees per second
",
            quoted(name),
            wheel("left ", &self.left, "\talso: inverted = true, gear = [12, 36]"),
            wheel("right", &self.right, ""),
        );
        text += &self.head();
        text += &self.range();
        for role in Role::SENSORS.into_iter().filter(|role| *role != Role::Range) {
            let section = role.section();
            let is_remote = role == Role::Remote;
            let note =
                if is_remote { "\tthe infrared sensor that hears the remote control" } else { "" };
            text += &match self.sensors.get(&role) {
                Some(port) => format!("\n[{section}]{note}\nport = {}\n", quoted(port)),
                None => format!("\n# [{section}]\n# port = {}\n", quoted(role.example_port())),
            };
        }
        if self.motors.is_empty() {
            text += NO_MOTOR;
        }
        for (name, port) in &self.motors {
            let port = quoted(port);
            text += &format!(
                "
[motor.{name}]\tmissions know it under this name
port = {port}
gear = [1, 1]
max_dps = 200
"
            );
        }
        if let Some(port) = &self.stop_button {
            let port = quoted(port);
            text += &format!("\n[stop_button]\tthe touch sensor that stops a run\nport = {port}\n");
        }
        aligned(&text)
    }

    fn head(&self) -> String {
        let Some(DraftHead { port, gear: [motor, driven] }) = &self.head else {
            return NO_HEAD.to_owned();
        };
        let ratio = f64::from(motor.abs()) / f64::from((*driven).max(1));
        let [speed_dps, max_dps] =
            HEAD_MOTOR_DPS.map(|motor_dps| rounded_to((motor_dps * ratio).clamp(1.0, 360.0), 10.0));
        format!(
            "
[head]
port = {}
gear = [{motor}, {driven}]\tteeth on the motor, on the head; minus: it reverses
speed_dps = {speed_dps}
max_dps = {max_dps}\twhile it finds its way, so that it sees both sides in time
limit_deg = 90\tno further than this to either side, for the cable's sake
",
            quoted(port)
        )
    }

    fn range(&self) -> String {
        let Some(port) = self.sensors.get(&Role::Range) else { return NO_RANGE.to_owned() };
        let driver = self
            .range_driver
            .map_or_else(String::new, |driver| format!("driver = {}\n", quoted(driver.as_str())));
        format!(
            "
[range]
port = {}\tultrasonic, or infrared (with infrared_m_per_pct)
{driver}ahead_m = {}\tthe sensor, ahead of the middle between the wheels
max_m = {:?}\tnothing beyond this becomes a point of the map
half_cone_deg = {}\tit hears in this cone; 14 fits real scans, 6 infrared
bias_m = 0.0\tit reads this much too far, and
scale = 1.0\tsays this for a metre more: onbrick calibrate --only range
own_echoes = []\thears itself: [[80, 100, 0.2]] from 80 to 100 deg at 0.2 m
",
            quoted(port),
            self.range_ahead_m,
            self.range_max_m,
            self.range_half_cone_deg
        )
    }
}

/// Sections that a robot does not have, as comments to take up later.
const NO_HEAD: &str = "
# [head]
# port = \"outA\"
# gear = [-12, 36]
# speed_dps = 43.3
";
const NO_RANGE: &str = "
# [range]
# port = \"in1\"
# ahead_m = 0.05
# max_m = 2.0
";
const NO_MOTOR: &str = "
# [motor.arm]
# port = \"outC\"
# gear = [1, 1]
# max_dps = 200
";

/// A text whose comments stand behind tabs, with the comments in one column.
fn aligned(text: &str) -> String {
    let line = |line: &str| match line.split_once('\t') {
        Some((value, comment)) => {
            format!("{value:<width$}# {comment}\n", width = COMMENT_COLUMN.max(value.len() + 1))
        }
        None => format!("{line}\n"),
    };
    text.lines().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::Geometry;
    use crate::robot::{DEFAULT_ROBOT, RobotConfig};
    use proptest::prelude::*;

    /// The answers that describe the shipped robot.
    fn seeds() -> Draft {
        let port = |(role, port): (Role, &str)| (role, port.to_owned());
        Draft {
            left: Some(DraftMotor { port: "outB".to_owned(), inverted: false }),
            right: Some(DraftMotor { port: "outD".to_owned(), inverted: false }),
            head: Some(DraftHead { port: "outA".to_owned(), gear: [-12, 36] }),
            sensors: [
                (Role::Range, "in1"),
                (Role::Touch, "in2"),
                (Role::Colour, "in3"),
                (Role::Gyro, "in4"),
            ]
            .map(port)
            .into(),
            ..Draft::default()
        }
    }

    #[test]
    fn the_seeds_answers_make_the_shipped_robot() {
        let (shipped, _) = RobotConfig::load("shipped", DEFAULT_ROBOT.as_bytes()).unwrap();
        let text = seeds().to_toml();
        let (written, findings) = RobotConfig::load("robot.toml", text.as_bytes())
            .unwrap_or_else(|findings| panic!("{findings}\n{text}"));
        assert!(findings.is_empty(), "{findings}");
        assert_eq!(written, shipped, "{text}");
    }

    #[test]
    fn what_is_commented_out_loads_when_it_is_taken_up() {
        let bare = Draft { head: None, sensors: BTreeMap::new(), ..seeds() }.to_toml();
        let taken_up: String = bare
            .lines()
            .skip_while(|line| !line.starts_with("[drive]"))
            .map(|line| line.strip_prefix("# ").unwrap_or(line))
            .filter(|line| !line.contains("[remote]"))
            .collect::<Vec<_>>()
            .join("\n")
            .replacen("port = \"in1\"\n\n[motor", "\n[motor", 1);
        let text = format!("name = \"x\"\n{taken_up}\n");
        let (robot, _) = RobotConfig::load("robot.toml", text.as_bytes())
            .unwrap_or_else(|findings| panic!("{findings}\n{text}"));
        assert!(robot.head.is_some() && robot.has(Role::Range) && robot.has(Role::Gyro), "{text}");
        assert_eq!(robot.motors.len(), 1);
    }

    proptest! {
        #[test]
        fn whatever_was_answered_loads_without_findings(
            name in Strategy::prop_filter("[^\\p{C}]{1,16}", "can be printed", |name: &String| {
                name.chars().all(crate::printable::is_printable)
            }),
            inverted in any::<[bool; 2]>(),
            circumference_m in Geometry::WHEEL_CIRCUMFERENCE_M,
            track_m in Geometry::TRACK_WIDTH_M,
            ahead_m in -1.0..=1.0_f64,
            gear in (1..=1000_i32, 1..=1000_i32, any::<bool>()),
            there in any::<[bool; 4]>(),
        ) {
            let port = |there: bool, port: &str| there.then(|| port.to_owned());
            let sign = if gear.2 { -1 } else { 1 };
            let draft = Draft {
                name: name.clone(),
                left: Some(DraftMotor { port: "outB".to_owned(), inverted: inverted[0] }),
                right: Some(DraftMotor { port: "outC".to_owned(), inverted: inverted[1] }),
                wheel_circumference_m: circumference_m,
                track_width_m: track_m,
                head: there[0].then(
                    || DraftHead { port: "outA".to_owned(), gear: [sign * gear.0, gear.1] },
                ),
                sensors: [
                    (Role::Range, port(there[1], "in1")),
                    (Role::Gyro, port(there[2], "in2")),
                    (Role::Touch, port(there[3], "in3")),
                    (Role::Colour, port(there[0], "in4")),
                ]
                .into_iter()
                .filter_map(|(role, port)| Some((role, port?)))
                .collect(),
                range_ahead_m: ahead_m,
                range_max_m: 0.7,
                range_half_cone_deg: 6.0,
                range_driver: there[2].then_some(Driver::Infrared),
                stop_button: port(there[2] && !there[1], "in1"),
                motors: port(there[1], "outD")
                    .map(|port| ("arm".to_owned(), port))
                    .into_iter()
                    .collect(),
            };
            let text = draft.to_toml();
            let (robot, findings) = RobotConfig::load("robot.toml", text.as_bytes())
                .map_err(|findings| TestCaseError::fail(format!("{findings}\n{text}")))?;
            prop_assert!(findings.is_empty());
            prop_assert_eq!(robot.name, name);
            prop_assert_eq!(robot.drive.wheel_circumference_m.to_bits(), circumference_m.to_bits());
            prop_assert_eq!(robot.drive.track_width_m.to_bits(), track_m.to_bits());
            prop_assert_eq!(robot.drive.left.ratio < 0.0, inverted[0]);
            prop_assert_eq!(robot.head.is_some(), there[0]);
        }
    }

    #[test]
    fn a_robot_that_is_plugged_in_like_a_shipped_one_is_recognised() {
        let motor = |port: &str| Some(DraftMotor { port: port.to_owned(), inverted: false });
        let sensors = |of: &[(Role, &str)]| {
            of.iter().map(|(role, port)| (*role, (*port).to_owned())).collect::<BTreeMap<_, _>>()
        };
        let educator = Draft {
            left: motor("outB"),
            right: motor("outC"),
            sensors: sensors(&[(Role::Range, "in4"), (Role::Gyro, "in2")]),
            ..Draft::default()
        };
        let name = |draft: &Draft| draft.shipped().map(|(shipped, _)| shipped.name);
        assert_eq!(name(&educator), Some("educator"));
        let inverted = DraftMotor { port: "outB".to_owned(), inverted: true };
        assert_eq!(name(&Draft { left: Some(inverted), ..educator.clone() }), None);
        let headed = DraftHead { port: "outA".to_owned(), gear: [-12, 36] };
        assert_eq!(name(&Draft { head: Some(headed), ..educator.clone() }), None);
        let sensors = sensors(&[(Role::Touch, "in1"), (Role::Colour, "in3")]);
        let either = Draft { sensors, ..educator.clone() };
        assert_eq!(name(&either), Some("educator"), "the first that fits");
        assert_eq!(name(&Draft { sensors: BTreeMap::new(), ..educator }), None, "it says nothing");
    }
}
