//! What a robot senses: one table, from the number that a driver gives to the name that missions
//! use.
//!
//! A row of [`QUANTITIES`] says everything about one sensed quantity: its [`Channel`], its name in
//! conditions, its unit and legal domain, the part of the robot that it takes, and from which mode
//! of which driver it comes. Binding sensors, the vocabulary of conditions, the checks of a
//! mission, `onbrick setup` and `onbrick doctor`, replay with another robot and the recording's
//! description of its channels all iterate over this table and over [`Role::SENSORS`].
//!
//! # A new quantity of a known sensor
//!
//! One row at the end of the table, and a line in the template of missions
//! (`behavior/shipped/template.toml`), which lists all signals.
//!
//! # A new sensor
//!
//! 1. its driver's name in `ev3dev::Driver` (`src/ev3dev/words.rs`), and its time to settle
//!    (`ev3dev::settle_ns`);
//! 2. a [`Role`] and the rows of its quantities here;
//! 3. its modes and values in the simulator (`src/sim/driver/sensor.rs`, `src/sim/sensors.rs`);
//! 4. the template of missions.
//!
//! # Not here
//!
//! Nothing is read here (`robot`), and nothing is concluded (`mapping`). What is worked out from
//! readings - heading, position, times - has its names in `behavior`.

#[cfg(feature = "tick")]
mod mount;
mod readings;
mod told;
mod values;

use std::fmt;

use serde::{Deserialize, Serialize};

#[cfg(feature = "tick")]
pub use mount::Mount;
pub use readings::{Reading, Senses};
pub use told::told;

use crate::ev3dev::{ColourMode, Driver, GyroMode, InfraredMode, TouchMode, UltrasonicMode};
use crate::units::degrees;

/// A sensed quantity, with all that is known of it before anything is plugged in.
#[derive(Debug)]
pub struct Quantity {
    /// Its place in [`Senses`].
    pub channel: Channel,
    /// Its name in conditions; empty where missions know it by other names: the gyro's angle as the
    /// heading, a named motor's by the motor's.
    pub name: &'static str,
    /// What people call the device.
    pub what: &'static str,
    /// Its unit.
    pub unit: Unit,
    /// The least and the greatest value that it can have, as conditions see it.
    pub domain: (f64, f64),
    /// The part of the robot that it takes.
    pub role: Role,
    /// Where a sensor gives it, the one to be preferred first; none for what is no sensor.
    pub sources: &'static [Source],
}

/// What a quantity's values are in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Unit {
    /// 1 for true, 0 for false.
    Truth,
    /// A number of its own scale, or a code.
    Number,
    /// Percent.
    Percent,
    /// Metres.
    Metres,
    /// Radians; degrees in conditions.
    Radians,
    /// Radians a second; degrees a second in conditions.
    RadiansPerSecond,
    /// Volts.
    Volts,
}

impl Unit {
    /// The unit's symbol as recordings give it.
    #[must_use]
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Truth => "0 or 1",
            Self::Number => "number",
            Self::Percent => "%",
            Self::Metres => "m",
            Self::Radians => "rad",
            Self::RadiansPerSecond => "rad/s",
            Self::Volts => "V",
        }
    }

    /// A value as conditions have it.
    #[must_use]
    pub fn in_conditions(self, value: f64) -> f64 {
        match self {
            Self::Radians | Self::RadiansPerSecond => degrees(value),
            _ => value,
        }
    }
}

/// A value of a sensor's mode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Source {
    /// The sensor's driver.
    pub driver: Driver,
    /// The mode, as the driver writes it.
    pub mode: &'static str,
    /// Which of the mode's values.
    pub value: usize,
    /// The least and the greatest number that the sensor can say.
    pub legal: (i32, i32),
    /// What one of the sensor's is in the quantity's unit.
    pub scale: f64,
    /// How the sensor says that there is nothing to measure.
    pub nothing: Option<Nothing>,
}

/// How a sensor says that there is nothing to measure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nothing {
    /// Which of the mode's values says so.
    pub value: usize,
    /// By which number.
    pub number: i32,
    /// What the quantity is then: infinite for a distance, NaN for what is unknown, so that no
    /// condition on it holds.
    pub means: f64,
}

impl Source {
    const fn new(driver: Driver, mode: &'static str, legal: (i32, i32), scale: f64) -> Self {
        Self { driver, mode, value: 0, legal, scale, nothing: None }
    }

    const fn at(self, value: usize) -> Self {
        Self { value, ..self }
    }

    const fn nothing(self, value: usize, number: i32, means: f64) -> Self {
        Self { nothing: Some(Nothing { value, number, means }), ..self }
    }

    /// What a number of the sensor stands for, in the quantity's unit.
    #[must_use]
    pub fn value_of(&self, number: i32) -> f64 {
        match self.nothing {
            Some(nothing) if nothing.value == self.value && nothing.number == number => {
                nothing.means
            }
            _ => f64::from(number) * self.scale,
        }
    }

    /// True where the mode's first value tells all.
    #[must_use]
    pub fn is_first_value(&self) -> bool {
        self.value == 0 && self.nothing.is_none_or(|nothing| nothing.value == 0)
    }
}

/// A part of a robot, as `robot.toml` has it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Role {
    /// The brick itself: battery, buttons.
    Brick,
    /// The two wheels, which every robot has.
    Wheels,
    /// The head's motor.
    Head,
    /// The range sensor, ultrasonic or infrared.
    Range,
    /// The gyro sensor.
    Gyro,
    /// The touch sensor.
    Touch,
    /// The colour sensor.
    Colour,
    /// The infrared sensor that listens to the remote and looks for its beacon.
    Remote,
    /// A named motor, by its place among them.
    Motor(u8),
    /// A named sensor, by its place among them: one more of a kind.
    Sensor(u8),
}

impl Role {
    /// The parts that are sensors.
    pub const SENSORS: [Self; 5] =
        [Self::Range, Self::Gyro, Self::Touch, Self::Colour, Self::Remote];

    /// Its section in the robot's file, what messages call it, what a sensor of this role does, and
    /// the port that examples give it.
    const fn texts(self) -> [&'static str; 4] {
        match self {
            Self::Brick => ["battery", "the brick", "", "in1"],
            Self::Wheels => ["drive", "two wheels", "", "in1"],
            Self::Head => ["head", "a head", "", "in1"],
            Self::Range => ["range", "a range sensor", "measures the range", "in1"],
            Self::Gyro => ["gyro", "a gyro sensor", "measures the heading", "in4"],
            Self::Touch => ["touch", "a touch sensor", "is the bumper", "in2"],
            Self::Colour => ["colour", "a colour sensor", "looks at the floor", "in3"],
            Self::Remote => {
                ["remote", "an infrared sensor for the remote", "hears the remote control", "in1"]
            }
            Self::Motor(_) => ["motor.NAME", "a named motor", "", "in1"],
            Self::Sensor(_) => ["sensor.NAME", "a named sensor", "", "in1"],
        }
    }

    /// Its section in the robot's file.
    #[must_use]
    pub const fn section(self) -> &'static str {
        self.texts()[0]
    }

    /// What messages call it.
    #[must_use]
    pub const fn what(self) -> &'static str {
        self.texts()[1]
    }

    /// What a sensor of this role does, as a question about it says.
    #[must_use]
    pub const fn purpose(self) -> &'static str {
        self.texts()[2]
    }

    /// The port that examples in a robot's file give it.
    #[must_use]
    pub const fn example_port(self) -> &'static str {
        self.texts()[3]
    }

    /// Its quantities.
    pub fn quantities(self) -> impl Iterator<Item = &'static Quantity> {
        QUANTITIES.iter().filter(move |quantity| quantity.role == self)
    }

    /// The drivers of the sensors that can be this part, the one to be preferred first.
    pub fn drivers(self) -> impl Iterator<Item = Driver> {
        let mut drivers = Vec::new();
        for source in self.quantities().flat_map(|quantity| quantity.sources) {
            if !drivers.contains(&source.driver) {
                drivers.push(source.driver);
            }
        }
        drivers.into_iter()
    }

    /// The first mode of a driver that gives all of `channels` that are this part's.
    #[must_use]
    pub fn mode(self, driver: Driver, channels: &[Channel]) -> Option<&'static str> {
        let wanted = || {
            self.quantities()
                .filter(|quantity| channels.contains(&quantity.channel))
                .map(|q| q.channel)
        };
        let modes = self.quantities().flat_map(|quantity| quantity.sources);
        let mut modes = modes.filter(|source| source.driver == driver).map(|source| source.mode);
        modes.find(|mode| wanted().all(|channel| channel.source(driver, mode).is_some()))
    }
}

macro_rules! quantities {
    ($(
        $(#[$doc:meta])*
        $channel:ident: $name:literal, $what:literal, $unit:ident, $domain:expr, $role:expr,
            $sources:expr;
    )+) => {
        /// A quantity that the robot senses. Its discriminant is its place in [`Senses`] and in a
        /// recording.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
        #[serde(rename_all = "snake_case")]
        #[repr(u8)]
        #[non_exhaustive]
        pub enum Channel { $($(#[$doc])* $channel,)+ }

        impl Channel {
            /// How many there are.
            pub const COUNT: usize = [$(stringify!($channel)),+].len();

            /// Every channel, in the order of their places.
            pub const ALL: [Self; Self::COUNT] = [$(Self::$channel),+];
        }

        /// What is known of each quantity, by channel.
        pub static QUANTITIES: [Quantity; Channel::COUNT] = [$(Quantity {
            channel: Channel::$channel,
            name: $name,
            what: $what,
            unit: Unit::$unit,
            domain: $domain,
            role: $role,
            sources: &$sources,
        }),+];
    };
}

const ANY: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);
const POSITIVE: (f64, f64) = (0.0, f64::INFINITY);
const TRUTH: (f64, f64) = (0.0, 1.0);
const PERCENT: (f64, f64) = (0.0, 100.0);

/// No board takes more, volts ([`Platform::most_v`](crate::ev3dev::Platform)).
pub const MOST_V: f64 = 13.0;

/// The gyro sensor counts clockwise; from here on anticlockwise is positive.
const ANTICLOCKWISE_RAD: f64 = -std::f64::consts::PI / 180.0;

const WHOLE_16: (i32, i32) = (i16::MIN as i32, i16::MAX as i32);

const fn ultrasonic() -> Source {
    // 255.0 cm is "no echo" (`ev3dev-interfaces`, 6.3), counted in tenths.
    Source::new(Driver::Ultrasonic, UltrasonicMode::DistCm.as_str(), (0, 2550), 0.001).nothing(
        0,
        2550,
        f64::INFINITY,
    )
}

const fn infrared(mode: InfraredMode, legal: (i32, i32), scale: f64) -> Source {
    Source::new(Driver::Infrared, mode.as_str(), legal, scale)
}

const fn gyro(mode: GyroMode) -> Source {
    Source::new(Driver::Gyro, mode.as_str(), WHOLE_16, ANTICLOCKWISE_RAD)
}

const fn colour(mode: ColourMode, most: i32, scale: f64) -> Source {
    Source::new(Driver::Colour, mode.as_str(), (0, most), scale)
}

/// The converter of the colour sensor has ten bits.
const fn raw_colour(value: usize) -> Source {
    colour(ColourMode::RgbRaw, 1023, 100.0 / 1023.0).at(value)
}

/// The beacon on channel 1. Its heading is the sensor's own scale, no angle, and clockwise on the
/// sensor; without a beacon the distance reads −128 (`ev3dev-interfaces`, 6.3).
const fn beacon(value: usize, legal: (i32, i32), scale: f64, without: f64) -> Source {
    infrared(InfraredMode::Seek, legal, scale).at(value).nothing(1, -128, without)
}

// The order is that of recordings: a new row goes to the end.
#[rustfmt::skip]
quantities! {
    /// Angle of the left wheel at its axle, forwards positive.
    Left: "left_deg", "left wheel", Radians, ANY, Role::Wheels, [];
    /// Angle of the right wheel at its axle, forwards positive.
    Right: "right_deg", "right wheel", Radians, ANY, Role::Wheels, [];
    /// Angle of the head, anticlockwise from straight ahead.
    Head: "head_deg", "head", Radians, ANY, Role::Head, [];
    /// Distance to what reflects, from the sensor; infinite where there is no echo.
    Range: "range_m", "range sensor", Metres, POSITIVE, Role::Range, [
        ultrasonic(),
        // 100 % is "far away or nothing"; LEGO says that it is about 0.7 m.
        infrared(InfraredMode::Proximity, (0, 100), 0.007).nothing(0, 100, f64::INFINITY),
    ];
    /// Heading of the gyro sensor, anticlockwise, with an arbitrary zero.
    Gyro: "", "gyro", Radians, ANY, Role::Gyro, [
        gyro(GyroMode::Angle),
        gyro(GyroMode::AngleAndRate),
    ];
    /// 1 while the touch sensor is pressed, else 0.
    Touch: "touch", "touch sensor", Truth, TRUTH, Role::Touch, [
        Source::new(Driver::Touch, TouchMode::Touch.as_str(), (0, 1), 1.0),
    ];
    /// Number of the colour that the colour sensor sees: 0 none, 1 black, 2 blue, 3 green, 4
    /// yellow, 5 red, 6 white, 7 brown.
    Colour: "colour", "colour sensor", Number, (0.0, 7.0), Role::Colour, [
        colour(ColourMode::Colour, 7, 1.0),
    ];
    /// Reflected red light.
    Reflect: "reflect_pct", "colour sensor", Percent, PERCENT, Role::Colour, [
        colour(ColourMode::Reflect, 100, 1.0),
    ];
    /// Code of the infrared remote's buttons, 0 to 11.
    Remote: "remote", "remote", Number, (0.0, 11.0), Role::Remote, [
        infrared(InfraredMode::Remote, (0, 11), 1.0),
    ];
    /// Battery.
    Battery: "battery_v", "battery", Volts, (0.0, MOST_V), Role::Brick, [];
    /// Angle of the first named motor at its axle; the others follow.
    Motor0: "", "first named motor", Radians, ANY, Role::Motor(0), [];
    /// Angle of the second named motor.
    Motor1: "", "second named motor", Radians, ANY, Role::Motor(1), [];
    /// Angle of the third named motor.
    Motor2: "", "third named motor", Radians, ANY, Role::Motor(2), [];
    /// Angle of the fourth named motor.
    Motor3: "", "fourth named motor", Radians, ANY, Role::Motor(3), [];
    /// How fast the gyro sensor turns, anticlockwise.
    GyroRate: "gyro_dps", "gyro", RadiansPerSecond, ANY, Role::Gyro, [
        gyro(GyroMode::AngleAndRate).at(1),
    ];
    /// Light from elsewhere.
    Ambient: "ambient_pct", "colour sensor", Percent, PERCENT, Role::Colour, [
        colour(ColourMode::Ambient, 100, 1.0),
    ];
    /// Reflected red light as the converter has it, of its whole scale.
    Red: "red_pct", "colour sensor", Percent, PERCENT, Role::Colour, [raw_colour(0)];
    /// Reflected green light as the converter has it, of its whole scale.
    Green: "green_pct", "colour sensor", Percent, PERCENT, Role::Colour, [raw_colour(1)];
    /// Reflected blue light as the converter has it, of its whole scale.
    Blue: "blue_pct", "colour sensor", Percent, PERCENT, Role::Colour, [raw_colour(2)];
    /// Where the beacon on channel 1 is, −25 (right) to 25 (left); unknown without a beacon.
    BeaconHeading: "beacon_heading", "beacon", Number, (-25.0, 25.0), Role::Remote, [
        beacon(0, (-25, 25), -1.0, f64::NAN),
    ];
    /// How far the beacon on channel 1 is, of about 2 m; infinite without a beacon.
    BeaconDistance: "beacon_pct", "beacon", Percent, POSITIVE, Role::Remote, [
        beacon(1, (0, 100), 1.0, f64::INFINITY),
    ];
    /// 1 while the brick's button Up is held, or was pressed since the last tick.
    ButtonUp: "button_up", "brick's buttons", Truth, TRUTH, Role::Brick, [];
    /// The same of Down.
    ButtonDown: "button_down", "brick's buttons", Truth, TRUTH, Role::Brick, [];
    /// The same of Left.
    ButtonLeft: "button_left", "brick's buttons", Truth, TRUTH, Role::Brick, [];
    /// The same of Right.
    ButtonRight: "button_right", "brick's buttons", Truth, TRUTH, Role::Brick, [];
    /// What the first named sensor measures, in the unit that conditions have; the others follow.
    Sensor0: "", "first named sensor", Number, ANY, Role::Sensor(0), [];
    /// What the second named sensor measures.
    Sensor1: "", "second named sensor", Number, ANY, Role::Sensor(1), [];
    /// What the third named sensor measures.
    Sensor2: "", "third named sensor", Number, ANY, Role::Sensor(2), [];
    /// What the fourth named sensor measures.
    Sensor3: "", "fourth named sensor", Number, ANY, Role::Sensor(3), [];
}

impl Channel {
    /// The wheels' channels, left and right.
    pub const WHEELS: [Self; 2] = [Self::Left, Self::Right];

    /// The named motors' channels.
    pub const MOTORS: [Self; 4] = [Self::Motor0, Self::Motor1, Self::Motor2, Self::Motor3];

    /// The named sensors' channels.
    pub const SENSORS: [Self; 4] = [Self::Sensor0, Self::Sensor1, Self::Sensor2, Self::Sensor3];

    /// The quantities that a named sensor can measure.
    pub fn measurable() -> impl Iterator<Item = &'static Quantity> {
        QUANTITIES
            .iter()
            .filter(|quantity| !quantity.name.is_empty() && !quantity.sources.is_empty())
    }

    /// What is known of it.
    #[must_use]
    pub fn quantity(self) -> &'static Quantity {
        &QUANTITIES[self as usize]
    }

    /// What gives it in a mode of a driver.
    #[must_use]
    pub fn source(self, driver: Driver, mode: &str) -> Option<&'static Source> {
        self.quantity().sources.iter().find(|source| source.driver == driver && source.mode == mode)
    }

    /// False where the two are of one sensor that never gives both at a time.
    #[must_use]
    pub fn goes_with(self, other: Self) -> bool {
        let role = self.quantity().role;
        role != other.quantity().role
            || self.quantity().sources.is_empty()
            || role.drivers().any(|driver| role.mode(driver, &[self, other]).is_some())
    }
}

impl fmt::Display for Channel {
    /// What people call it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.quantity().what)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_stands_at_its_channels_place_with_a_name_of_its_own() {
        for (place, row) in QUANTITIES.iter().enumerate() {
            assert_eq!(row.channel as usize, place, "{:?}", row.channel);
            let namesakes = QUANTITIES.iter().filter(|other| other.name == row.name).count();
            assert!(row.name.is_empty() || namesakes == 1, "{} stands there twice", row.name);
        }
        // The numbers of recordings.
        assert_eq!(
            [Channel::Left as u8, Channel::Battery as u8, Channel::Motor3 as u8],
            [0, 9, 13]
        );
    }

    #[test]
    fn a_sensor_has_its_preferred_mode_first_and_one_that_gives_all_that_is_asked() {
        use Channel::{
            Ambient, BeaconDistance, BeaconHeading, Blue, Colour, Gyro, GyroRate, Red, Remote,
        };
        for (role, driver, channels, mode) in [
            (Role::Colour, Driver::Colour, &[][..], Some("COL-COLOR")),
            (Role::Colour, Driver::Colour, &[Gyro, Ambient], Some("COL-AMBIENT")),
            (Role::Colour, Driver::Colour, &[Red, Blue], Some("RGB-RAW")),
            (Role::Colour, Driver::Colour, &[Red, Colour], None),
            (Role::Gyro, Driver::Gyro, &[Gyro], Some("GYRO-ANG")),
            (Role::Gyro, Driver::Gyro, &[GyroRate, Gyro], Some("GYRO-G&A")),
            (Role::Remote, Driver::Infrared, &[BeaconHeading, BeaconDistance], Some("IR-SEEK")),
            (Role::Range, Driver::Infrared, &[Channel::Range], Some("IR-PROX")),
            (Role::Range, Driver::Ultrasonic, &[Channel::Range], Some("US-DIST-CM")),
            (Role::Range, Driver::Touch, &[], None),
        ] {
            assert_eq!(role.mode(driver, channels), mode, "{role:?} {channels:?}");
        }
        assert!(
            Gyro.goes_with(GyroRate)
                && Colour.goes_with(Remote)
                && Channel::Left.goes_with(Channel::Right)
        );
        assert!(!Colour.goes_with(Red) && !BeaconHeading.goes_with(Remote));
        assert_eq!(
            Role::Range.drivers().collect::<Vec<_>>(),
            [Driver::Ultrasonic, Driver::Infrared]
        );
    }
}
