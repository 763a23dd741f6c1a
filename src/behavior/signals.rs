//! What a mission's machines know of the world in one tick, and what a robot has that a mission may ask for.
//!
//! Inside the program a signal is in metres, seconds and radians; the language of conditions gives angles in degrees
//! (see [`super::expression`]). A signal that the robot does not have, or whose reading is too old, is lost: nothing is put in
//! its place, and no condition on it fires.
//!
//! # Not here
//!
//! How a reading becomes a signal: which device, how old it may be. That is for the runtime.

use super::{MAX_MOTORS, MachineState};
use crate::clock::seconds;
use crate::units::{degrees, wrap_rad};

/// A quantity that the runtime provides in each tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Signal {
    /// Distance to what is ahead of the range sensor, metres; infinite without an echo, 0 where it is too near.
    Range,
    /// 1 where the range sensor has an echo, else 0. Too near counts as an echo.
    Echo,
    /// Heading, radians anticlockwise, not wrapped.
    Heading,
    /// Angle of the head, radians anticlockwise from straight ahead.
    Head,
    /// World x of the robot, metres.
    X,
    /// World y of the robot, metres.
    Y,
    /// Metres driven since the start of the run, forwards and backwards both counting.
    Travelled,
    /// Angle of the left wheel, radians, forwards positive.
    Left,
    /// Angle of the right wheel, radians, forwards positive.
    Right,
    /// Battery, volts.
    Battery,
    /// 1 while the touch sensor is pressed, else 0.
    Touch,
    /// Colour number, 0 to 7.
    Colour,
    /// Reflected light, percent.
    Reflect,
    /// Code of the infrared remote's buttons, 0 to 11.
    Remote,
    /// Angle of the first named motor, radians.
    Motor0,
    /// Angle of the second named motor, radians.
    Motor1,
    /// Angle of the third named motor, radians.
    Motor2,
    /// Angle of the fourth named motor, radians.
    Motor3,
}

impl Signal {
    /// How many signals there are.
    pub const COUNT: usize = 18;

    /// The named motors' angles, in the order of the capabilities.
    pub const MOTORS: [Self; MAX_MOTORS] = [Self::Motor0, Self::Motor1, Self::Motor2, Self::Motor3];
}

/// One tick's signals.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Signals {
    time_ns: i64,
    /// The same in seconds: a division for all conditions together.
    time_s: f64,
    values: [Option<f64>; Signal::COUNT],
    /// The last ones known: a state entered while they are lost counts from there.
    travelled_m: f64,
    heading_rad: f64,
}

impl Signals {
    /// Signals of a moment at which nothing else is known.
    #[must_use]
    pub fn at(time_ns: i64) -> Self {
        let mut signals = Self::default();
        signals.set_time_ns(time_ns);
        signals
    }

    /// The tick's time, nanoseconds of the run's clock, whose zero is the start of the run.
    #[must_use]
    pub fn time_ns(&self) -> i64 {
        self.time_ns
    }

    /// Goes on to another tick; what is known stays known.
    pub fn set_time_ns(&mut self, time_ns: i64) {
        self.time_ns = time_ns;
        self.time_s = seconds(time_ns);
    }

    /// Notes a signal's value, in metres, seconds, radians. What is not a number counts as lost, and so does an infinite
    /// value of anything but the range.
    pub fn set(&mut self, signal: Signal, value: f64) {
        let known = value.is_finite() || (signal == Signal::Range && value > 0.0);
        self.values[signal as usize] = known.then_some(value);
        match signal {
            Signal::Travelled if known => self.travelled_m = value,
            Signal::Heading if known => self.heading_rad = value,
            _ => {}
        }
    }

    /// Notes that a signal is not known any more.
    pub fn lose(&mut self, signal: Signal) {
        self.values[signal as usize] = None;
    }

    /// A signal's value, if it is known.
    #[must_use]
    pub fn get(&self, signal: Signal) -> Option<f64> {
        self.values[signal as usize]
    }

    /// The record of a machine that enters `state` now.
    #[must_use]
    pub(super) fn entering(&self, state: u16) -> MachineState {
        MachineState {
            state,
            entered_ns: self.time_ns,
            entered_m: self.travelled_m,
            entered_heading_rad: self.heading_rad,
        }
    }
}

/// Parts of a robot beyond the two wheels, which every robot has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// The two wheels, moved by the mission.
    Wheels,
    /// The head's motor.
    Head,
    /// The range sensor, ultrasonic or infrared.
    Range,
    /// The touch sensor.
    Touch,
    /// The colour sensor, naming colours.
    Colour,
    /// The colour sensor, measuring reflected light.
    Reflect,
    /// The infrared sensor, listening to the remote.
    Remote,
    /// A named motor, by its place in the capabilities.
    Motor(u8),
}

/// What a robot has, as far as a mission can ask for it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[expect(clippy::struct_excessive_bools, reason = "a list of what is there and what is not")]
pub struct Capabilities {
    /// A motor turns the head.
    pub head: bool,
    /// There is a range sensor.
    pub range: bool,
    /// The range sensor is the infrared one, which cannot listen to the remote at the same time.
    pub range_is_infrared: bool,
    /// There is a gyro sensor. No signal needs it: without one the heading comes from the wheels.
    pub gyro: bool,
    /// There is a touch sensor.
    pub touch: bool,
    /// There is a colour sensor.
    pub colour: bool,
    /// There is an infrared sensor.
    pub remote: bool,
    /// The named motors, at most [`MAX_MOTORS`]; `None` where the robot is not known and any name will do.
    pub motors: Option<Vec<String>>,
}

impl Capabilities {
    /// Everything: to check a mission without a robot.
    #[must_use]
    pub fn all() -> Self {
        Self {
            head: true,
            range: true,
            range_is_infrared: false,
            gyro: true,
            touch: true,
            colour: true,
            remote: true,
            motors: None,
        }
    }

    /// Whether the robot can fill a role; a named motor is asked for by its name instead.
    #[must_use]
    pub fn has(&self, role: Role) -> bool {
        match role {
            Role::Wheels | Role::Motor(_) => true,
            Role::Head => self.head,
            Role::Range => self.range,
            Role::Touch => self.touch,
            Role::Colour | Role::Reflect => self.colour,
            Role::Remote => self.remote,
        }
    }
}

/// A quantity as the language of conditions has it: the unit that its name ends in, angles in degrees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Quantity {
    Range,
    Echo,
    Heading,
    Head,
    X,
    Y,
    Left,
    Right,
    Time,
    Battery,
    StateTime,
    StateDistance,
    StateTurn,
    Touch,
    Colour,
    Reflect,
    Remote,
    /// A named motor's angle, by its place.
    Motor(u8),
}

/// What is known of a quantity before any mission runs.
#[derive(Debug)]
pub(super) struct Word {
    /// Its name in conditions.
    pub(super) name: &'static str,
    pub(super) quantity: Quantity,
    /// True for what is true or false, and not a number.
    pub(super) is_truth: bool,
    /// The part of the robot it takes.
    pub(super) role: Option<Role>,
    /// The least and the greatest value that it can have.
    pub(super) domain: (f64, f64),
}

const ANY: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);
const POSITIVE: (f64, f64) = (0.0, f64::INFINITY);

/// Every quantity with a fixed name.
#[rustfmt::skip]
pub(super) const WORDS: [Word; 17] = {
    use Quantity as Q;
    const fn word(name: &'static str, quantity: Quantity, role: Option<Role>, domain: (f64, f64)) -> Word {
        Word { name, quantity, is_truth: matches!(quantity, Q::Echo | Q::Touch), role, domain }
    }
    [
        word("range_m",        Q::Range,         Some(Role::Range),   POSITIVE),
        word("echo",           Q::Echo,          Some(Role::Range),   (0.0, 1.0)),
        word("heading_deg",    Q::Heading,       None,                (-180.0, 180.0)),
        word("head_deg",       Q::Head,          Some(Role::Head),    ANY),
        word("x_m",            Q::X,             None,                ANY),
        word("y_m",            Q::Y,             None,                ANY),
        word("left_deg",       Q::Left,          None,                ANY),
        word("right_deg",      Q::Right,         None,                ANY),
        word("time_s",         Q::Time,          None,                POSITIVE),
        word("battery_v",      Q::Battery,       None,                POSITIVE),
        word("state_s",        Q::StateTime,     None,                POSITIVE),
        word("state_m",        Q::StateDistance, None,                POSITIVE),
        word("state_turn_deg", Q::StateTurn,     None,                ANY),
        word("touch",          Q::Touch,         Some(Role::Touch),   (0.0, 1.0)),
        word("colour",         Q::Colour,        Some(Role::Colour),  (0.0, 7.0)),
        word("reflect_pct",    Q::Reflect,       Some(Role::Reflect), (0.0, 100.0)),
        word("remote",         Q::Remote,        Some(Role::Remote),  (0.0, 11.0)),
    ]
};

impl Quantity {
    /// What is known of it; `None` for a named motor's angle, which can be any number.
    pub(super) fn word(self) -> Option<&'static Word> {
        WORDS.iter().find(|word| word.quantity == self)
    }

    /// True for what cannot be lost.
    pub(super) fn is_always_known(self) -> bool {
        matches!(self, Self::Time | Self::StateTime)
    }

    /// The value in the unit of its name; `since` is when and where the state was entered.
    pub(super) fn read(self, signals: &Signals, since: &MachineState) -> Option<f64> {
        let angle = |signal| signals.get(signal).map(degrees);
        match self {
            Self::Range => signals.get(Signal::Range),
            Self::Echo => signals.get(Signal::Echo),
            Self::Heading => signals.get(Signal::Heading).map(|heading_rad| degrees(wrap_rad(heading_rad))),
            Self::Head => angle(Signal::Head),
            Self::X => signals.get(Signal::X),
            Self::Y => signals.get(Signal::Y),
            Self::Left => angle(Signal::Left),
            Self::Right => angle(Signal::Right),
            Self::Time => Some(signals.time_s),
            Self::Battery => signals.get(Signal::Battery),
            Self::StateTime => Some(seconds(signals.time_ns.saturating_sub(since.entered_ns))),
            Self::StateDistance => signals.get(Signal::Travelled).map(|now_m| now_m - since.entered_m),
            Self::StateTurn => {
                signals.get(Signal::Heading).map(|now_rad| degrees(now_rad - since.entered_heading_rad))
            }
            Self::Touch => signals.get(Signal::Touch),
            Self::Colour => signals.get(Signal::Colour),
            Self::Reflect => signals.get(Signal::Reflect),
            Self::Remote => signals.get(Signal::Remote),
            Self::Motor(place) => Signal::MOTORS.get(usize::from(place)).and_then(|signal| angle(*signal)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_heading_wraps_in_conditions_and_a_turn_since_the_state_was_entered_does_not() {
        let mut signals = Signals::at(0);
        signals.set(Signal::Heading, 1.0);
        let since = signals.entering(0);
        signals.set(Signal::Heading, 1.0 + 7.0);
        let heading = Quantity::Heading.read(&signals, &since).unwrap();
        assert!((heading - degrees(8.0 - std::f64::consts::TAU)).abs() < 1e-9, "{heading}");
        let turn = Quantity::StateTurn.read(&signals, &since).unwrap();
        assert!((turn - degrees(7.0)).abs() < 1e-9, "{turn}");
    }

    #[test]
    fn what_is_not_a_number_is_lost_and_only_a_range_may_be_infinite() {
        let mut signals = Signals::at(0);
        signals.set(Signal::X, 1.0);
        signals.set(Signal::X, f64::NAN);
        signals.set(Signal::Y, f64::INFINITY);
        signals.set(Signal::Range, f64::INFINITY);
        assert_eq!((signals.get(Signal::X), signals.get(Signal::Y)), (None, None));
        assert_eq!(signals.get(Signal::Range), Some(f64::INFINITY));
    }

    #[test]
    fn every_signal_has_a_place_of_its_own() {
        assert_eq!(Signal::Motor3 as usize + 1, Signal::COUNT);
        let mut signals = Signals::at(0);
        for (value, signal) in [(1.0, Signal::Motor0), (2.0, Signal::Motor3), (3.0, Signal::Range)] {
            signals.set(signal, value);
        }
        signals.lose(Signal::Motor0);
        let motors =
            [0, 1, 2, 3].map(|place| Quantity::Motor(place).read(&signals, &MachineState::default()));
        assert_eq!(motors, [None, None, None, Some(degrees(2.0))]);
        assert_eq!(Quantity::Motor(4).read(&signals, &MachineState::default()), None);
    }
}
