//! `robot.toml`: which port is what, and the robot's measures.
//!
//! # Not here
//!
//! Nothing is looked up on a brick: whether something is plugged in where the file says shows when
//! the robot is bound.

mod port;
mod range;
mod stop_button;

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

pub use stop_button::StopButton;

use super::battery::{BatteryConfig, battery};
use crate::clock::SECOND_NS;
use crate::document::{Document, Findings, Item, Kind, Section};
use crate::ev3dev::{Driver, PortAddress};
use crate::mapping::{Geometry, RangeMount};
use crate::printable::is_printable;
use crate::senses::{Channel, Mount, Role};
use crate::units::radians;

/// A robot as its file describes it.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotConfig {
    /// The robot's name.
    pub name: String,
    /// How old a reading may be before it counts as lost, nanoseconds; that of the battery may be
    /// older ([`RobotConfig::age_limit_ns`]).
    pub max_age_ns: i64,
    /// What it drives with.
    pub drive: DriveBase,
    /// What turns the range sensor.
    pub head: Option<HeadRole>,
    /// The sensors that it has, named ones among them, each with its port; `None` where only one
    /// sensor fits.
    pub sensors: BTreeMap<Role, Option<PortAddress>>,
    /// The drivers of sensors, where the file says which of several a role has.
    pub drivers: BTreeMap<Role, Driver>,
    /// Where the sensors are on the robot, for a simulated one.
    pub mounts: BTreeMap<Role, Mount>,
    /// What stops a run besides the board's own buttons.
    pub stop_button: Option<StopButton>,
    /// What missions call the named sensors; at most [`RobotConfig::MAX_SENSORS`].
    pub named_sensors: Vec<NamedSensor>,
    /// How the range sensor sits and measures, where it has one.
    pub range: Option<RangeMount>,
    /// Metres for one percent of the infrared sensor's proximity.
    pub infrared_m_per_pct: f64,
    /// How long the gyro must say no new degree before a run, nanoseconds: a drift that makes one
    /// in less is always noticed.
    pub gyro_watch_ns: i64,
    /// What the gyro says for a degree that is turned, degrees.
    pub gyro_scale: f64,
    /// How low the battery may get.
    pub battery: BatteryConfig,
    /// Further motors, which missions know by their names; at most [`RobotConfig::MAX_MOTORS`].
    pub motors: Vec<NamedMotor>,
}

/// Two wheels, and their measures.
#[derive(Debug, Clone, PartialEq)]
pub struct DriveBase {
    /// The left wheel's motor.
    pub left: MotorRole,
    /// The right wheel's motor.
    pub right: MotorRole,
    /// Metres driven in one turn of a wheel.
    pub wheel_circumference_m: f64,
    /// Metres between the two wheels' points of contact.
    pub track_width_m: f64,
    /// The fastest that a wheel may turn, radians per second at its axle.
    pub max_wheel_rad_s: f64,
    /// How fast a wheel goes along the floor in a motion that ends, unless the mission says
    /// otherwise, metres per second; `None`: half of what it may.
    pub speed_m_s: Option<f64>,
    /// How fast that speed grows and shrinks, metres per second each second.
    pub acceleration_m_s2: f64,
}

/// A motor that a role is bound to.
#[derive(Debug, Clone, PartialEq)]
pub struct MotorRole {
    /// Where it is plugged in.
    pub port: PortAddress,
    /// Turns of the axle for one turn of the motor: negative where the gears or `inverted` turn it
    /// round.
    pub ratio: f64,
}

/// A motor as the file wants it, with where its angle goes.
#[derive(Debug, Clone)]
pub struct WantedMotor<'c> {
    /// The channel of its angle.
    pub channel: Channel,
    /// The key of its section.
    pub section: String,
    /// The motor.
    pub motor: &'c MotorRole,
    /// The fastest that it may turn, radians per second at its axle.
    pub max_rad_s: f64,
}

/// The motor that turns the range sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct HeadRole {
    /// The motor.
    pub motor: MotorRole,
    /// How fast the head turns, radians per second.
    pub speed_rad_s: f64,
    /// How fast it may turn while it looks out for the wheels, radians per second: no less.
    pub max_rad_s: f64,
    /// How far the head may turn to either side, radians.
    pub limit_rad: f64,
}

/// A motor with a name of its own.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedMotor {
    /// The name that missions use.
    pub name: String,
    /// The motor.
    pub motor: MotorRole,
    /// The fastest that it may turn, radians per second at its axle.
    pub max_rad_s: f64,
}

/// A sensor with a name of its own: one more of a kind.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NamedSensor {
    /// The name that missions use.
    pub name: String,
    /// What it measures.
    pub measures: Channel,
}

impl RobotConfig {
    /// How many named sensors a robot can have: as many as [`Channel::SENSORS`].
    pub const MAX_SENSORS: usize = Channel::SENSORS.len();

    /// How many named motors a robot can have: as many as [`Channel::MOTORS`].
    pub const MAX_MOTORS: usize = Channel::MOTORS.len();

    /// Reads a robot's file; `name` is what findings call it.
    ///
    /// # Errors
    ///
    /// Everything that is wrong in it, each with its place.
    pub fn load(name: &str, bytes: &[u8]) -> Result<(Self, Findings), Findings> {
        Document::new(name, bytes)?.read(robot)
    }

    /// Whether it has a part.
    #[must_use]
    pub fn has(&self, role: Role) -> bool {
        match role {
            Role::Brick | Role::Wheels => true,
            Role::Head => self.head.is_some(),
            Role::Motor(place) => usize::from(place) < self.motors.len(),
            sensor => self.sensors.contains_key(&sensor),
        }
    }

    /// How old a channel's reading may be before it counts as lost, nanoseconds.
    #[must_use]
    pub fn age_limit_ns(&self, channel: Channel) -> i64 {
        match channel {
            // It is read about once a second.
            Channel::Battery => 3 * SECOND_NS,
            _ => self.max_age_ns,
        }
    }

    /// Its motors, in the order of their channels.
    pub fn motor_roles(&self) -> impl Iterator<Item = WantedMotor<'_>> {
        let wanted = |channel, section: &str, motor, max_rad_s| {
            let section = section.to_owned();
            WantedMotor { channel, section, motor, max_rad_s }
        };
        let wheels = [
            wanted(Channel::Left, "drive.left", &self.drive.left, self.drive.max_wheel_rad_s),
            wanted(Channel::Right, "drive.right", &self.drive.right, self.drive.max_wheel_rad_s),
        ];
        let head = self.head.as_ref();
        let head = head.map(|head| wanted(Channel::Head, "head", &head.motor, head.max_rad_s));
        let named = Channel::MOTORS.into_iter().zip(&self.motors).map(move |(channel, named)| {
            let section = format!("motor.{}", named.name);
            wanted(channel, &section, &named.motor, named.max_rad_s)
        });
        wheels.into_iter().chain(head).chain(named)
    }

    /// The key of a part's section, with the part's own name where it has one.
    #[must_use]
    pub fn section(&self, role: Role) -> String {
        let name = match role {
            Role::Motor(at) => self.motors.get(usize::from(at)).map(|motor| &motor.name),
            Role::Sensor(at) => self.named_sensors.get(usize::from(at)).map(|sensor| &sensor.name),
            _ => None,
        };
        name.map_or_else(|| role.section().to_owned(), |name| role.section().replace("NAME", name))
    }

    /// Every part that can be plugged in, as the key of its section, with its port if that is
    /// named.
    pub fn ports(&self) -> impl Iterator<Item = (String, Option<&PortAddress>)> {
        let sensors = self.sensors.iter().map(|(role, port)| (self.section(*role), port.as_ref()));
        let stop = match &self.stop_button {
            Some(StopButton::Touch(port)) => Some(("stop_button".to_owned(), Some(port))),
            _ => None,
        };
        let motors = self.motor_roles().map(|wanted| (wanted.section, Some(&wanted.motor.port)));
        motors.chain(sensors).chain(stop)
    }
}

/// The longest name, in bytes: it is shown in tables and on the brick's screen.
const LONGEST_NAME: usize = 64;

/// Speeds beyond this are slips of the pen: the fastest motor does 1560 degrees a second, geared up
/// tenfold.
const FASTEST_DPS: f64 = 15_600.0;

fn robot(root: &Section<'_>) -> Option<RobotConfig> {
    let mut keys = vec!["name", "max_age_s", "drive", "head"];
    keys.extend(Role::SENSORS.map(Role::section));
    keys.extend(["battery", "motor", "sensor", "stop_button"]);
    if root.is_of_another_kind(Kind::Robot) {
        return None;
    }
    root.allow(&keys);
    let name = root.require("name").and_then(|item| name_of(&item));
    let max_age_s = root.value_or("max_age_s", 0.3, |item| item.number(0.05..=10.0));
    let drive =
        root.require("drive").and_then(|item| item.section()).and_then(|section| drive(&section));
    let head = root.value_or("head", None, |item| head(&item.section()?).map(Some));
    let range = root.value_or("range", None, |item| range::range(&item.section()?).map(Some));
    let gyro = |key, usual, range| {
        root.value_or("gyro", usual, |item| {
            item.section()?.value_or(key, usual, |item| item.number(range))
        })
    };
    let gyro_watch_s = gyro("watch_s", GYRO_WATCH_S, GYRO_WATCHES_S);
    let gyro_scale = gyro("scale", 1.0, Geometry::GYRO_SCALE);
    let sensors = sensors(root);
    let named_sensors = named(root, "sensor", RobotConfig::MAX_SENSORS, named_sensor);
    let battery = root.value_or("battery", None, |item| battery(&item.section()?).map(Some));
    let stop_button = root
        .value_or("stop_button", None, |item| stop_button::stop_button(&item.section()?).map(Some));
    let motors = named(root, "motor", RobotConfig::MAX_MOTORS, named_motor);
    let (head, (range, infrared)) = (head?, range?.unzip());
    let on_head = head.is_some();
    let (named_sensors, plugs): (Vec<_>, Vec<_>) = named_sensors?.into_iter().unzip();
    let plugs = sensors?.into_iter().chain((0..).map(Role::Sensor).zip(plugs));
    let (sensors, plugs): (BTreeMap<_, _>, Vec<_>) =
        plugs.map(|(role, plug)| ((role, plug.port.clone()), (role, plug))).unzip();
    let drivers = plugs.iter().filter_map(|(role, plug)| Some((*role, plug.driver?))).collect();
    let mounts = plugs.iter().map(|(role, plug)| (*role, plug.mount)).collect();
    let config = RobotConfig {
        name: name?,
        max_age_ns: crate::clock::nanoseconds(max_age_s?),
        drive: drive?,
        head,
        sensors,
        drivers,
        mounts,
        stop_button: stop_button?,
        named_sensors,
        range: range.map(|range| RangeMount { on_head, ..range }),
        infrared_m_per_pct: infrared.unwrap_or(range::INFRARED_M_PER_PCT),
        gyro_watch_ns: crate::clock::nanoseconds(gyro_watch_s?),
        gyro_scale: gyro_scale?,
        battery: battery?.unwrap_or_default(),
        motors: motors?,
    };
    port::taken_once(root, &config);
    Some(config)
}

/// Whether a robot can be called so.
pub(crate) fn is_name(name: &str) -> bool {
    (1..=LONGEST_NAME).contains(&name.len()) && name.chars().all(is_printable)
}

fn name_of(item: &Item<'_>) -> Option<String> {
    let name = item.text()?;
    if !is_name(name) {
        item.error(format!(
            "`{}` must be 1 to {LONGEST_NAME} bytes of text on one line",
            item.path()
        ));
        return None;
    }
    Some(name.to_owned())
}

/// How fast speeds grow and shrink where the file says nothing, metres per second each second:
/// wheels of a LEGO robot grip at more.
const ACCELERATION_M_S2: f64 = 0.3;

fn drive(section: &Section<'_>) -> Option<DriveBase> {
    section.allow(&[
        "left",
        "right",
        "wheel_circumference_m",
        "track_width_m",
        "max_dps",
        "speed_mps",
        "acceleration_mps2",
    ]);
    let wheel = |key| {
        let wheel = section.require(key)?.section()?;
        wheel.allow(&["port", "inverted", "gear"]);
        motor_role(&wheel)
    };
    let left = wheel("left");
    let right = wheel("right");
    let wheel_circumference_m = section
        .require("wheel_circumference_m")
        .and_then(|item| item.number(Geometry::WHEEL_CIRCUMFERENCE_M));
    let track_width_m =
        section.require("track_width_m").and_then(|item| item.number(Geometry::TRACK_WIDTH_M));
    let max_dps = section.require("max_dps").and_then(|item| item.number(1.0..=FASTEST_DPS));
    let speed_mps = section.value_or("speed_mps", None, |item| item.number(0.01..=2.0).map(Some));
    let acceleration_mps2 =
        section.value_or("acceleration_mps2", ACCELERATION_M_S2, |item| item.number(0.02..=20.0));
    Some(DriveBase {
        left: left?,
        right: right?,
        wheel_circumference_m: wheel_circumference_m?,
        track_width_m: track_width_m?,
        max_wheel_rad_s: radians(max_dps?),
        speed_m_s: speed_mps?,
        acceleration_m_s2: acceleration_mps2?,
    })
}

fn motor_role(section: &Section<'_>) -> Option<MotorRole> {
    let port = section.require("port").and_then(|item| port::address(&item));
    let inverted = section.value_or("inverted", false, |item| item.flag());
    let gear = section.value_or("gear", 1.0, |item| item.gear());
    let direction = if inverted? { -1.0 } else { 1.0 };
    Some(MotorRole { port: port?, ratio: gear? * direction })
}

fn head(section: &Section<'_>) -> Option<HeadRole> {
    section.allow(&["port", "inverted", "gear", "speed_dps", "max_dps", "limit_deg"]);
    let motor = motor_role(section);
    let speed_dps = section.require("speed_dps").and_then(|item| item.number(1.0..=FASTEST_DPS));
    let least_dps = speed_dps.unwrap_or(1.0);
    let max_dps =
        section.value_or("max_dps", least_dps, |item| item.number(least_dps..=FASTEST_DPS));
    let limit_deg = section.value_or("limit_deg", 90.0, |item| item.number(1.0..=360.0));
    Some(HeadRole {
        motor: motor?,
        speed_rad_s: radians(speed_dps?),
        max_rad_s: radians(max_dps?),
        limit_rad: radians(limit_deg?),
    })
}

/// Where the file says nothing, seconds: a drift of 0.2 degrees a second, 24 degrees in two
/// minutes, makes a degree in less. A shorter watch would let faster drifts drive.
const GYRO_WATCH_S: f64 = 5.2;
const GYRO_WATCHES_S: RangeInclusive<f64> = GYRO_WATCH_S..=60.0;

/// Where a sensor is plugged in and mounted, and its driver where the file says it.
struct Plug {
    port: Option<PortAddress>,
    driver: Option<Driver>,
    mount: Mount,
}

/// Reads where a sensor of a kind is plugged in.
fn plug(section: &Section<'_>, kind: Role) -> Option<Plug> {
    let words: Vec<(&str, Driver)> =
        kind.drivers().map(|driver| (driver.as_str(), driver)).collect();
    let driver = section.value_or("driver", None, |item| item.word(&words).map(Some));
    Some(Plug { port: port::port(section)?, driver: driver?, mount: Mount::read(section)? })
}

/// The sensors that the file has; `None` where one of them is wrong.
fn sensors(root: &Section<'_>) -> Option<BTreeMap<Role, Plug>> {
    let sensor = |role: Role| {
        let section = root.get(role.section())?.section();
        Some(section.and_then(|section| {
            match role {
                Role::Range => {}
                Role::Gyro => section.allow(&["port", "driver", "watch_s", "scale"]),
                Role::Touch | Role::Colour => {
                    section.allow(&[["port", "driver"], Mount::KEYS].concat());
                }
                _ => section.allow(&["port", "driver"]),
            }
            Some((role, plug(&section, role)?))
        }))
    };
    // Each of them is looked at, also behind one that is wrong.
    let found: Vec<_> = Role::SENSORS.into_iter().filter_map(sensor).collect();
    found.into_iter().collect()
}

/// Motors or sensors with names of their own, no more than `most`; `None` where one is wrong.
fn named<T>(
    root: &Section<'_>,
    what: &str,
    most: usize,
    read: fn(&Item<'_>) -> Option<T>,
) -> Option<Vec<T>> {
    let Some(all) = root.get(what) else { return Some(Vec::new()) };
    let items = all.section()?.items();
    if items.len() > most {
        let message = format!("{} named {what}s; a robot can have {most}", items.len());
        all.error_at_key(message);
        return None;
    }
    items.iter().map(read).collect()
}

fn named_motor(item: &Item<'_>) -> Option<NamedMotor> {
    let section = item.section()?;
    section.allow(&["port", "inverted", "gear", "max_dps"]);
    let name = own_name(item, "motor");
    let motor = motor_role(&section);
    let max_dps = section.require("max_dps").and_then(|item| item.number(1.0..=FASTEST_DPS));
    Some(NamedMotor { name: name?, motor: motor?, max_rad_s: radians(max_dps?) })
}

/// Whether a motor or a sensor can be called so: conditions use the name.
pub(crate) fn is_own_name(name: &str) -> bool {
    name.starts_with(|first: char| first.is_ascii_alphabetic())
        && name.len() <= LONGEST_NAME
        && name.chars().all(|letter| letter.is_ascii_alphanumeric() || letter == '_')
}

/// The name of a motor or a sensor, which conditions use.
fn own_name(item: &Item<'_>, what: &str) -> Option<String> {
    let name = item.key();
    let plain = is_own_name(name);
    if !plain {
        item.error_at_key(format!("`{name}` is no name for a {what}"))
            .hint("a letter, then letters, digits and _: conditions use it");
    }
    plain.then(|| name.to_owned())
}

/// A named sensor with its port.
fn named_sensor(item: &Item<'_>) -> Option<(NamedSensor, Plug)> {
    let section = item.section()?;
    section.allow(&[&["port", "driver", "measures"], Mount::KEYS.as_slice()].concat());
    let name = own_name(item, "sensor");
    let words: Vec<(&str, Channel)> =
        Channel::measurable().map(|quantity| (quantity.name, quantity.channel)).collect();
    let measures = section.require("measures").and_then(|item| item.word(&words))?;
    let plug = plug(&section, measures.quantity().role);
    Some((NamedSensor { name: name?, measures }, plug?))
}

#[cfg(test)]
mod tests {
    use super::super::DEFAULT_ROBOT;
    use super::*;
    use crate::mapping::RangeMount;

    fn findings(text: &str) -> String {
        RobotConfig::load("robot.toml", text.as_bytes())
            .expect_err("this robot has a mistake")
            .to_string()
    }

    /// The shipped file with one piece of text replaced.
    fn changed(from: &str, to: &str) -> String {
        assert!(DEFAULT_ROBOT.contains(from), "the shipped robot.toml has no `{from}`");
        DEFAULT_ROBOT.replacen(from, to, 1)
    }

    #[test]
    fn the_shipped_robot_is_the_seeds() {
        let (robot, warnings) = RobotConfig::load("robot.toml", DEFAULT_ROBOT.as_bytes()).unwrap();
        assert!(warnings.is_empty(), "{warnings}");
        assert!((robot.drive.wheel_circumference_m - 37.2 * 0.0254 / 5.0).abs() < 1e-9);
        assert!((robot.drive.track_width_m - 4.5 * 0.0254).abs() < 1e-9);
        let head = robot.head.unwrap();
        assert!((head.motor.ratio + 12.0 / 36.0).abs() < 1e-12);
        assert!(
            (head.speed_rad_s - radians(130.0 / 3.0)).abs() < 1e-3,
            "130 counts a second through 12:36"
        );
        assert!((head.max_rad_s - radians(90.0)).abs() < 1e-9);
        let slower = DEFAULT_ROBOT.replacen("max_dps = 90", "max_dps = 40", 1);
        assert!(RobotConfig::load("robot.toml", slower.as_bytes()).is_err());
        assert!((robot.range.unwrap().ahead_m - 2.0 * 0.0254).abs() < 1e-9);
    }

    #[test]
    fn every_role_but_the_wheels_may_be_missing() {
        let text = "name = \"two wheels\"\n[drive]\nleft = { port = \"outB\" }\n\
                    right = { port = \"outC\", inverted = true }\n\
                    wheel_circumference_m = 0.2\ntrack_width_m = 0.1\nmax_dps = 300\n";
        let (robot, _) = RobotConfig::load("robot.toml", text.as_bytes()).unwrap();
        assert!(robot.head.is_none() && robot.range.is_none() && robot.sensors.is_empty());
        assert_eq!((robot.drive.left.ratio, robot.drive.right.ratio), (1.0, -1.0));
    }

    #[test]
    fn mistakes_have_a_place_and_a_way_out() {
        let cases = [
            ("track_width_m", "track_widht_m", "did you mean `track_width_m`?"),
            ("gear = [-12, 36]", "gear = [0, 36]", "each number is at least 1"),
            ("gear = [-12, 36]", "gear = [-12]", "has 1 value; it takes 2"),
            ("max_dps = 360", "max_dps = nan", "`drive.max_dps` is NaN"),
            ("max_dps = 360", "max_dps = -5", "it can be 1 to 15600"),
            ("port = \"in4\"", "port = \"in1\"", "`gyro` and `range` are both on in1"),
            ("port = \"in4\"", "port = \"ev3-ports:in1\"", "`gyro` and `range` are both on in1"),
            ("{ port = \"outB\" }", "{ inverted = true }", "`port` is missing in [drive.left]"),
            ("port = \"in4\"", "port = \"out Z\"", "such as \"outA\""),
            ("port = \"in4\"", "port = \"in4\"\nwatch_s = 1", "it can be 5.2 to 60"),
            ("port = \"in4\"", "port = \"in4\"\nscale = 2", "it can be 0.8 to 1.25"),
            ("name = \"mapper\"", "name = \"\"", "must be 1 to 64 bytes"),
            ("name = \"mapper\"", "", "`name` is missing"),
        ];
        for (from, to, expected) in cases {
            let found = findings(&changed(from, to));
            assert!(found.contains(expected), "`{to}` should say `{expected}`:\n{found}");
            assert!(found.contains("--> robot.toml:"), "{found}");
        }
    }

    #[test]
    fn the_measures_that_a_file_may_have_are_those_that_mapping_takes() {
        let ranges = [
            ("wheel_circumference_m = 0.188976", Geometry::WHEEL_CIRCUMFERENCE_M),
            ("track_width_m = 0.1143", Geometry::TRACK_WIDTH_M),
            ("ahead_m = 0.0508", RangeMount::AHEAD_M),
            ("max_m = 2.0", *RangeMount::MAX_M.start()..=2.55),
        ];
        for (line, range) in ranges {
            let with = |value: f64| {
                changed(line, &format!("{} = {value:?}", line.split(' ').next().unwrap()))
            };
            for end in [*range.start(), *range.end()] {
                let (robot, _) = RobotConfig::load("robot.toml", with(end).as_bytes()).unwrap();
                assert!(robot.geometry().is_ok(), "{line}: {end}");
            }
            for beyond in [range.start() - 0.001, range.end() + 0.001] {
                assert!(findings(&with(beyond)).contains("it can be"), "{line}: {beyond}");
            }
        }
    }

    #[test]
    fn a_named_motor_has_a_plain_name_and_a_limit() {
        let good = format!("{DEFAULT_ROBOT}\n[motor.arm]\nport = \"outC\"\nmax_dps = 200\n");
        let (robot, _) = RobotConfig::load("robot.toml", good.as_bytes()).unwrap();
        assert_eq!(robot.motors[0].name, "arm");
        let bad = format!("{DEFAULT_ROBOT}\n[motor.\"an arm\"]\nport = \"outC\"\n");
        let found = findings(&bad);
        assert!(
            found.contains("`an arm` is no name") && found.contains("`max_dps` is missing"),
            "{found}"
        );
    }
}
