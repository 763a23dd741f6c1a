//! The true robot of a world: its measures, what is plugged in, and how imperfect it is.
//!
//! The defaults are the seed's robot with a bumper and a colour sensor added, so that every shipped
//! mission can run on it.
//!
//! # Not here
//!
//! `robot.toml`, which is what the program *believes*; a test may make the two differ.

use crate::document::{Item, Section};
use crate::ev3dev::EV3;
use crate::senses::Mount;
use crate::sim::driver::sensor::MODELS;
use crate::sim::echo::EchoModel;
use crate::sim::physics::{MotorKind, Plug, SensorKind};

/// A robot as it truly is.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotModel {
    /// Rolled by one turn of a drive motor, metres; 37.2 inches in five turns in the seed.
    pub wheel_circumference_m: f64,
    /// Between the wheels' points of contact, metres; 4.5 inches in the seed.
    pub track_width_m: f64,
    /// From the axle to the front end of the outline, metres.
    pub front_m: f64,
    /// From the axle to the rear end of the outline, metres.
    pub rear_m: f64,
    /// Half of the outline's width, metres.
    pub half_width_m: f64,
    /// Radius of the outline's corners, metres; with all four measures equal the robot is round.
    pub corner_m: f64,
    /// Mass, kilograms; its middle is over the axle.
    pub mass_kg: f64,
    /// What one tyre can push along the ground, newtons, before it slips. A 1 kg robot on a bare
    /// floor has about 4 and spins its wheels against a wall; the default is above the motors'
    /// stall force, so that wheels stall there.
    pub grip_n: f64,
    /// Force of the caster as a share of the weight.
    pub caster_drag: f64,
    /// Output ports of the left and the right wheel's motor, 0 for outA.
    pub drive: [usize; 2],
    /// True where a drive motor is built in the other way round.
    pub drive_inverted: [bool; 2],
    /// Output port of the head's motor.
    pub head: Option<usize>,
    /// Head angle for a motor angle, with sign; 12:36 and turned round in the seed.
    pub head_ratio: f64,
    /// Range sensor (ultrasonic or infrared) ahead of the axle, metres; it turns with the head.
    pub range_ahead_m: f64,
    /// Where the sensor on each input port is.
    pub mounts: [Mount; 4],
    /// What is plugged in.
    pub plug: Plug,
    /// How the ultrasonic hears.
    pub echo: EchoModel,
    /// Where the ultrasonic hears the robot itself. Two teams of nine had such a robot
    /// (`lego-rotating-sonar`): 19 to 22 cm at fixed angles of the head.
    pub own_echoes: Vec<OwnEcho>,
    /// Imperfections.
    pub errors: Errors,
}

/// An echo of the robot's own body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OwnEcho {
    /// From this angle of the head on, degrees, −180 to 180.
    pub from_deg: f64,
    /// Up to this one, anticlockwise from the first.
    pub to_deg: f64,
    /// What the sensor then says, metres, unless something is nearer.
    pub range_m: f64,
}

impl OwnEcho {
    /// Whether it is heard at an angle of the head.
    pub(in crate::sim) fn is_at(&self, head_deg: f64) -> bool {
        (head_deg - self.from_deg).rem_euclid(360.0)
            <= (self.to_deg - self.from_deg).rem_euclid(360.0)
    }
}

impl Default for RobotModel {
    fn default() -> Self {
        Self {
            wheel_circumference_m: 0.188_976,
            track_width_m: 0.1143,
            front_m: 0.09,
            rear_m: 0.10,
            half_width_m: 0.075,
            corner_m: 0.02,
            mass_kg: 0.9,
            grip_n: 16.0,
            caster_drag: 0.02,
            drive: [1, 3],
            drive_inverted: [false; 2],
            head: Some(0),
            head_ratio: -12.0 / 36.0,
            range_ahead_m: 0.0508,
            mounts: [Mount::default(); 4],
            plug: Plug {
                motors: [
                    Some(MotorKind::Medium),
                    Some(MotorKind::Large),
                    None,
                    Some(MotorKind::Large),
                ],
                sensors: [
                    Some(SensorKind::Ultrasonic),
                    Some(SensorKind::Touch),
                    Some(SensorKind::Colour),
                    Some(SensorKind::Gyro),
                ],
            },
            echo: EchoModel::default(),
            own_echoes: Vec::new(),
            errors: Errors::default(),
        }
    }
}

macro_rules! errors {
    ($(
        $(#[$doc:meta])*
        $name:ident = $default:literal, $low:literal to $high:literal, none $none:literal;
    )+) => {
        /// Imperfections. Those that end in `_sd` are deviations, drawn once for each robot or each
        /// reading from the seed.
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct Errors {
            $($(#[$doc])* pub $name: f64,)+
        }

        impl Default for Errors {
            fn default() -> Self {
                Self { $($name: $default),+ }
            }
        }

        impl Errors {
            /// No imperfection at all: what a drawing on paper says.
            pub const NONE: Self = Self { $($name: $none),+ };
            const KEYS: &'static [&'static str] = &[$(stringify!($name)),+];

            fn read(section: &Section<'_>, left_out: &Self) -> Self {
                section.allow(Self::KEYS);
                Self { $($name: number(section, stringify!($name), $low, $high, left_out.$name)),+ }
            }
        }
    };
}

errors! {
    /// Gyro: turned angle read too large by this share. People find 1 to 4 %
    /// (`lego-sensor-tables`).
    gyro_scale = 0.0, -0.2 to 0.2, none 0.0;
    /// Gyro: deviation of the scale between sensors.
    gyro_scale_sd = 0.01, 0.0 to 0.1, none 0.0;
    /// Gyro: drift, degrees a second, clockwise on the sensor. A good start has none (interfaces
    /// 15.3).
    gyro_drift_dps = 0.0, -20.0 to 20.0, none 0.0;
    /// Left wheel larger by this share.
    wheel_left = 0.0, -0.1 to 0.1, none 0.0;
    /// Right wheel larger by this share.
    wheel_right = 0.0, -0.1 to 0.1, none 0.0;
    /// Deviation of each wheel's size between robots.
    wheel_sd = 0.002, 0.0 to 0.05, none 0.0;
    /// Creep of each tyre: deviation of a share that wanders within half a second.
    slip_sd = 0.005, 0.0 to 0.2, none 0.0;
    /// Ultrasonic: half of the cone, degrees; with the lobe, where an echo is 1.8 dB fainter than
    /// on the axis. 14 fits the scans of `lego-rotating-sonar` in both models; the NXT tables have
    /// 15.
    cone_deg = 14.0, 0.5 to 45.0, none 14.0;
    /// Ultrasonic, cone: steepest incidence that still echoes, degrees. 32 fits the same scans.
    incidence_deg = 32.0, 1.0 to 89.0, none 32.0;
    /// Ultrasonic, lobe: how loud an endless wall is, square ahead at 1 m, above what is heard,
    /// decibels. 10.5 fits the same scans (9 to 12 one team): 1.8 m of reach on the average.
    range_gain_db = 10.5, -20.0 to 60.0, none 10.5;
    /// Ultrasonic, lobe: deviation of that between places, decibels. 6.8 fits the same scans (5 to
    /// 9 one team).
    range_walls_sd_db = 6.8, 0.0 to 30.0, none 0.0;
    /// Ultrasonic, lobe: how late the echo of a wall is whose foot is 40° off the axis, metres.
    range_late_m = 0.034, 0.0 to 0.2, none 0.0;
    /// Ultrasonic, lobe: share of the directions without an echo in which the sound finds another
    /// way. 0.22 fits the same scans (0.1 to 0.6 one team).
    range_round_share = 0.22, 0.0 to 1.0, none 0.0;
    /// Ultrasonic: nearest that is measured, metres; below, the sensor says 255 cm (5 mm does so,
    /// 25 mm reads 32: `lego-sensor-tables`).
    too_near_m = 0.035, 0.0 to 0.3, none 0.035;
    /// Ultrasonic: deviation of a reading near by, metres. In `lego-rotating-sonar`, 81 % of
    /// neighbours on a plateau are the same centimetre.
    range_sd_m = 0.002, 0.0 to 0.1, none 0.0;
    /// Ultrasonic: growth of that deviation with the range, metres a metre; the same scans.
    range_sd_per_m = 0.001, 0.0 to 0.1, none 0.0;
    /// Ultrasonic: bias, metres. The median of 70 scans in `lego-rotating-sonar`, −7 to +5 cm: the
    /// face of a sensor is ahead of the head's axis.
    range_bias_m = -0.014, -0.1 to 0.1, none 0.0;
    /// Ultrasonic: distances read too large by this share.
    range_scale = 0.0, -0.2 to 0.2, none 0.0;
    /// Ultrasonic: share of readings without an echo that should have one. Single ones are fewer
    /// than 1 in 1000 in the same scans; what is missed there is missed from a place.
    range_dropout = 0.001, 0.0 to 1.0, none 0.0;
    /// Ultrasonic: share of readings that another robot's sensor in sight spoils.
    range_crosstalk = 0.0, 0.0 to 1.0, none 0.0;
    /// Colour: deviation of a reading, percent.
    colour_sd_pct = 0.7, 0.0 to 20.0, none 0.0;
    /// Colour: diameter of the spot it sees, metres.
    colour_spot_m = 0.01, 0.0 to 0.1, none 0.01;
    /// Infrared: deviation of a reading, percent.
    infrared_sd_pct = 1.0, 0.0 to 20.0, none 0.0;
    /// Play of the head's gears, degrees of the head.
    head_play_deg = 1.0, 0.0 to 20.0, none 0.0;
    /// Battery at rest, volts.
    battery_v = 7.6, 3.0 to 10.0, none 7.6;
    /// Battery's own resistance, ohms.
    battery_ohm = 0.2, 0.0 to 3.0, none 0.2;
    /// Battery: volts lost in a second; for runs that end with an empty one.
    battery_fade_v_per_s = 0.0, 0.0 to 1.0, none 0.0;
}

impl Errors {
    /// What a cone's readings are wrong by unless its file says otherwise: 50 mm ± 1.6 and 100 mm ±
    /// 2.3, +1 to +4 mm in `lego-sensor-tables`, 1 m ± 6 mm in `nxt_us_filwisher.md`, 1.8 % odd
    /// readings in `nxt_us_pedrokost.txt`.
    fn of(echo: EchoModel) -> Self {
        match echo {
            EchoModel::Lobe => Self::default(),
            EchoModel::Cone => Self {
                range_sd_m: 0.003,
                range_sd_per_m: 0.003,
                range_bias_m: 0.002,
                range_dropout: 0.01,
                ..Self::default()
            },
        }
    }
}

/// Output ports as a world's file names them.
const OUTPUTS: [(&str, usize); 4] = [("outA", 0), ("outB", 1), ("outC", 2), ("outD", 3)];
const MOTORS: [(&str, Option<MotorKind>); 6] = [
    ("none", None),
    ("large", Some(MotorKind::Large)),
    ("medium", Some(MotorKind::Medium)),
    ("linear50", Some(MotorKind::Linear50)),
    ("linear100", Some(MotorKind::Linear100)),
    ("rcx", Some(MotorKind::Rcx)),
];

/// What a world's file says of a robot besides the numbers that come first in its hints.
const OTHERS: [&str; 12] = [
    "left",
    "right",
    "left_inverted",
    "right_inverted",
    "head",
    "head_gear",
    "range_ahead_m",
    "sensors",
    "ports",
    "echo",
    "own_echoes",
    "errors",
];

impl RobotModel {
    /// Reads `[robot]`; what is left out keeps its default.
    pub(super) fn read(section: &Section<'_>) -> Self {
        let mut model = Self::default();
        let numbers = [
            ("wheel_circumference_m", &mut model.wheel_circumference_m, 0.01, 2.0),
            ("track_width_m", &mut model.track_width_m, 0.02, 1.0),
            ("front_m", &mut model.front_m, 0.02, 1.0),
            ("rear_m", &mut model.rear_m, 0.02, 1.0),
            ("half_width_m", &mut model.half_width_m, 0.02, 1.0),
            ("corner_m", &mut model.corner_m, 0.01, 1.0),
            ("mass_kg", &mut model.mass_kg, 0.1, 20.0),
            ("grip_n", &mut model.grip_n, 0.1, 200.0),
            ("caster_drag", &mut model.caster_drag, 0.0, 1.0),
        ];
        section.allow(&[numbers.each_ref().map(|number| number.0).as_slice(), &OTHERS].concat());
        for (key, value, low, high) in numbers {
            *value = number(section, key, low, high, *value);
        }
        let flag = |key| section.get(key).and_then(|item| item.flag()).unwrap_or(false);
        let port =
            |key, default| section.get(key).and_then(|item| item.word(&OUTPUTS)).unwrap_or(default);
        let echo = section.get("echo").and_then(|item| item.word(&EchoModel::WORDS));
        let gear = section.get("head_gear").and_then(|item| item.gear());
        model.drive = [port("left", model.drive[0]), port("right", model.drive[1])];
        model.drive_inverted = [flag("left_inverted"), flag("right_inverted")];
        model.head = head(section, model.head);
        model.head_ratio = gear.unwrap_or(model.head_ratio);
        model.range_ahead_m = number(section, "range_ahead_m", -1.0, 1.0, model.range_ahead_m);
        if let Some(sensors) = section.section("sensors") {
            model.mounts = mounts(&sensors);
        }
        if let Some(ports) = section.section("ports") {
            model.plug = plug(&ports, model.plug);
        }
        model.echo = echo.unwrap_or_default();
        model.own_echoes = own_echoes(section);
        model.errors = Errors::of(model.echo);
        if let Some(errors) = section.section("errors") {
            model.errors = Errors::read(&errors, &model.errors);
        }
        model.check(section);
        model
    }

    fn check(&self, section: &Section<'_>) {
        if self.corner_m > self.half_width_m.min(self.front_m).min(self.rear_m) {
            section
                .error("the robot's corners are rounder than the robot is large")
                .hint("make `corner_m` at most `half_width_m`, `front_m` and `rear_m`");
        }
        let [left, right] = self.drive;
        if left == right || self.head.is_some_and(|head| head == left || head == right) {
            section
                .error("two of `left`, `right` and `head` share an output port")
                .hint("left is outB, right is outD and head is outA unless you say otherwise");
        }
    }
}

fn head(section: &Section<'_>, default: Option<usize>) -> Option<usize> {
    let outputs = OUTPUTS.map(|(name, out)| (name, Some(out)));
    let heads = [&[("none", None)], outputs.as_slice()].concat();
    section.get("head").and_then(|item| item.word(&heads)).unwrap_or(default)
}

fn own_echoes(section: &Section<'_>) -> Vec<OwnEcho> {
    let list = section.get("own_echoes").and_then(|item| item.list()).unwrap_or_default();
    let own = |item: &Item<'_>| {
        let [from_deg, to_deg, range_m] = item.numbers::<3>(-180.0..=180.0)?;
        (range_m > 0.0).then_some(OwnEcho { from_deg, to_deg, range_m }).or_else(|| {
            item.error("an echo is more than 0 m away")
                .hint("angles of the head from and to, degrees, then metres: [80, 100, 0.2]");
            None
        })
    };
    list.iter().filter_map(own).collect()
}

fn mounts(section: &Section<'_>) -> [Mount; 4] {
    section.allow(&EV3.inputs);
    EV3.inputs.map(|name| {
        let sensor = section.section(name);
        let read = |sensor: Section<'_>| {
            sensor.allow(&Mount::KEYS);
            Mount::read(&sensor)
        };
        sensor.and_then(read).unwrap_or_default()
    })
}

fn plug(section: &Section<'_>, mut plug: Plug) -> Plug {
    section.allow(&[EV3.outputs, EV3.inputs].concat());
    for (name, slot) in EV3.outputs.iter().zip(&mut plug.motors) {
        *slot = section.get(name).and_then(|item| item.word(&MOTORS)).unwrap_or(*slot);
    }
    let kinds = MODELS.iter().map(|model| (model.word, Some(model.kind)));
    let sensors: Vec<_> = std::iter::once(("none", None)).chain(kinds).collect();
    for (name, slot) in EV3.inputs.iter().zip(&mut plug.sensors) {
        *slot = section.get(name).and_then(|item| item.word(&sensors)).unwrap_or(*slot);
    }
    plug
}

/// A number under a key; the default where it is left out or wrong (and then there is a finding).
pub(super) fn number(section: &Section<'_>, key: &str, low: f64, high: f64, default: f64) -> f64 {
    section.get(key).and_then(|item| item.number(low..=high)).unwrap_or(default)
}
