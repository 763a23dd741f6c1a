//! What a mission's machines know of the world in one tick, and what a robot has that a mission may
//! ask for.
//!
//! Inside the program a signal is in metres, seconds and radians; the language of conditions gives
//! angles in degrees (see [`super::expression`]). A signal that the robot does not have, or whose
//! reading is too old, is lost: nothing is put in its place, and no condition on it fires.
//!
//! # Not here
//!
//! How a reading becomes a signal: which device, how old it may be. That is for the runtime.

use std::collections::BTreeSet;

use super::blackboard::{Scope, Since};
use super::motion::MotionLimits;
use crate::clock::seconds;
use crate::senses::{Channel, QUANTITIES, Quantity, Role, Unit};
use crate::units::{degrees, wrap_rad};

/// A quantity that the runtime provides in each tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Signal {
    /// What is sensed, as it was read, but for the range: that is the estimator's, 0 where it is
    /// too near.
    Sensed(Channel),
    /// 1 where the range sensor has an echo, else 0. Too near counts as an echo.
    Echo,
    /// Heading, radians anticlockwise, not wrapped.
    Heading,
    /// World x of the robot, metres.
    X,
    /// World y of the robot, metres.
    Y,
    /// Metres driven since the start of the run, forwards and backwards both counting.
    Travelled,
    /// Metres to where the run started: straight, or where the mission plans ways, of the way over
    /// the map, of which a narrow piece counts for more (see
    /// [`Planner::home_m`](crate::planning::Planner::home_m)); never less than straight.
    Home,
}

impl Signal {
    /// How many signals there are.
    const COUNT: usize = Channel::COUNT + 6;

    /// Its place among the signals.
    const fn place(self) -> usize {
        match self {
            Self::Sensed(channel) => channel as usize,
            Self::Echo => Channel::COUNT,
            Self::Heading => Channel::COUNT + 1,
            Self::X => Channel::COUNT + 2,
            Self::Y => Channel::COUNT + 3,
            Self::Travelled => Channel::COUNT + 4,
            Self::Home => Channel::COUNT + 5,
        }
    }
}

/// One tick's signals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Signals {
    time_ns: i64,
    /// The same in seconds: a division for all conditions together.
    time_s: f64,
    values: [Option<f64>; Signal::COUNT],
    /// The heading in degrees, wrapped, for all conditions together.
    heading_deg: f64,
    /// The last ones known: a state entered while they are lost counts from there.
    travelled_m: f64,
    heading_rad: f64,
}

impl Default for Signals {
    fn default() -> Self {
        let values = [None; Signal::COUNT];
        let (heading_deg, travelled_m, heading_rad) = (0.0, 0.0, 0.0);
        Self { time_ns: 0, time_s: 0.0, values, heading_deg, travelled_m, heading_rad }
    }
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

    /// Moves to another tick; known values are kept.
    pub fn set_time_ns(&mut self, time_ns: i64) {
        self.time_ns = time_ns;
        self.time_s = seconds(time_ns);
    }

    /// Notes a signal's value, in metres, seconds, radians; `None` where it is not known any more.
    /// What is not a number counts as lost, and so does an infinite value of anything but a
    /// distance that a sensor says is beyond its reach.
    pub fn set(&mut self, signal: Signal, value: impl Into<Option<f64>>) {
        let is_known = |value: &f64| value.is_finite() || *value > 0.0 && may_be_infinite(signal);
        let value = value.into().filter(is_known);
        self.values[signal.place()] = value;
        match (signal, value) {
            (Signal::Travelled, Some(travelled_m)) => self.travelled_m = travelled_m,
            (Signal::Heading, Some(heading_rad)) => {
                self.heading_rad = heading_rad;
                self.heading_deg = degrees(wrap_rad(heading_rad));
            }
            _ => {}
        }
    }

    /// A signal's value, if it is known.
    #[must_use]
    pub fn get(&self, signal: Signal) -> Option<f64> {
        self.values[signal.place()]
    }

    /// The record of a state that is entered now.
    #[must_use]
    pub(super) fn since(&self) -> Since {
        Since {
            done: false,
            entered_ns: self.time_ns,
            entered_m: self.travelled_m,
            entered_heading_rad: self.heading_rad,
        }
    }
}

/// True for what a sensor can say is too far to be measured.
fn may_be_infinite(signal: Signal) -> bool {
    let Signal::Sensed(channel) = signal else { return false };
    let quantity = channel.quantity();
    let mut sources = quantity.sources.iter();
    // What a named sensor measures is the robot's; that it may say so was seen when it was read.
    matches!(quantity.role, Role::Sensor(_))
        || sources.any(|source| source.nothing.is_some_and(|nothing| nothing.means.is_infinite()))
}

/// What a robot has, as far as a mission can ask for it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Capabilities {
    /// Its head and sensors; what every robot has need not be among them.
    pub roles: BTreeSet<Role>,
    /// The named motors and how fast each may turn, radians per second, at most
    /// [`super::MAX_MOTORS`]; `None` where the robot is not known and any name will do.
    pub motors: Option<Vec<(String, f64)>>,
    /// The named sensors and what each measures, at most [`super::MAX_SENSORS`]; `None` as for the
    /// motors.
    pub sensors: Option<Vec<(String, Channel)>>,
    /// How fast its wheels may be; `None` where the robot is not known.
    pub limits: Option<MotionLimits>,
}

impl Capabilities {
    /// Everything: to check a mission without a robot.
    #[must_use]
    pub fn all() -> Self {
        let roles = Role::SENSORS.into_iter().chain([Role::Head]).collect();
        Self { roles, motors: None, sensors: None, limits: None }
    }

    /// Whether the robot can fill a role; a named motor is asked for by its name instead.
    #[must_use]
    pub fn has(&self, role: Role) -> bool {
        matches!(role, Role::Brick | Role::Wheels | Role::Motor(_) | Role::Sensor(_))
            || self.roles.contains(&role)
    }
}

/// What a name in conditions stands for: angles are in degrees there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Input {
    /// A signal in the unit of its name.
    Signal(Signal),
    /// The run's time, seconds.
    Time,
    /// Seconds, metres and degrees since the state was entered.
    StateTime,
    StateDistance,
    StateTurn,
    /// What the state does has come to its end.
    Done,
    /// A variable of the mission.
    Variable(u8),
}

/// What is known of a name before any mission runs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Word {
    /// Its name in conditions.
    pub(super) name: &'static str,
    pub(super) input: Input,
    /// True for what is true or false, and not a number.
    pub(super) is_truth: bool,
    /// What it takes of what the robot senses.
    pub(super) channel: Option<Channel>,
    /// The least and the greatest value that it can have.
    pub(super) domain: (f64, f64),
}

const ANY: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);
const POSITIVE: (f64, f64) = (0.0, f64::INFINITY);

/// The names of what is worked out from readings, and of times.
#[rustfmt::skip]
const DERIVED: [Word; 10] = {
    const fn word(name: &'static str, input: Input, domain: (f64, f64)) -> Word {
        Word { name, input, is_truth: false, channel: None, domain }
    }
    use Input as I;
    [
        Word {
            is_truth: true,
            channel: Some(Channel::Range),
            ..word("echo", I::Signal(Signal::Echo), (0.0, 1.0))
        },
        Word { is_truth: true, ..word("done", I::Done, (0.0, 1.0)) },
        word("heading_deg",    I::Signal(Signal::Heading), (-180.0, 180.0)),
        word("x_m",            I::Signal(Signal::X),       ANY),
        word("y_m",            I::Signal(Signal::Y),       ANY),
        word("way_home_m",     I::Signal(Signal::Home),    POSITIVE),
        word("time_s",         I::Time,                    POSITIVE),
        word("state_s",        I::StateTime,               POSITIVE),
        word("state_m",        I::StateDistance,           POSITIVE),
        word("state_turn_deg", I::StateTurn,               ANY),
    ]
};

/// Every name that conditions of any mission can have.
pub(super) fn words() -> impl Iterator<Item = Word> {
    let sensed = QUANTITIES.iter().filter(|quantity| !quantity.name.is_empty());
    sensed.map(Word::from).chain(DERIVED)
}

impl From<&Quantity> for Word {
    fn from(quantity: &Quantity) -> Self {
        Self {
            name: quantity.name,
            input: Input::Signal(Signal::Sensed(quantity.channel)),
            is_truth: quantity.unit == Unit::Truth,
            channel: Some(quantity.channel),
            domain: quantity.domain,
        }
    }
}

impl Word {
    /// The least and the greatest value that can come: where the domain has no end, what the
    /// sensors can say.
    pub(super) fn reach(&self) -> (f64, f64) {
        match self.input {
            Input::Signal(Signal::Sensed(channel)) => channel.quantity().reach(),
            _ => self.domain,
        }
    }

    /// True for a time, in seconds: it has no value beyond the mission's time limit.
    pub(super) fn is_time(&self) -> bool {
        matches!(self.input, Input::Time | Input::StateTime)
    }

    /// What its values are in; times and truths are numbers here.
    pub(super) fn unit(&self) -> Unit {
        match self.input {
            Input::Signal(Signal::Sensed(channel)) => channel.quantity().unit,
            Input::Signal(Signal::Heading) | Input::StateTurn => Unit::Radians,
            Input::Signal(Signal::X | Signal::Y | Signal::Home) | Input::StateDistance => {
                Unit::Metres
            }
            _ => Unit::Number,
        }
    }
}

impl Input {
    /// What is known of it; `None` for a named motor's angle and a variable, which can be any
    /// number.
    pub(super) fn word(self) -> Option<Word> {
        if let Self::Signal(Signal::Sensed(channel)) = self {
            let quantity = channel.quantity();
            return (!quantity.name.is_empty()).then(|| Word::from(quantity));
        }
        DERIVED.into_iter().find(|word| word.input == self)
    }

    /// True for what begins once more as a state is entered.
    pub(super) fn is_since_entry(self) -> bool {
        matches!(self, Self::StateTime | Self::StateDistance | Self::StateTurn | Self::Done)
    }

    /// True for what cannot be lost.
    pub(super) fn is_always_known(self) -> bool {
        matches!(self, Self::Time | Self::StateTime | Self::Done | Self::Variable(_))
    }

    /// The value in the unit of its name.
    pub(super) fn read(self, scope: Scope<'_>) -> Option<f64> {
        let (signals, since) = (&scope.board.signals, scope.since);
        match self {
            Self::Signal(signal) => {
                let value = signals.get(signal)?;
                Some(match signal {
                    Signal::Sensed(channel) => channel.quantity().unit.in_conditions(value),
                    Signal::Heading => signals.heading_deg,
                    _ => value,
                })
            }
            Self::Time => Some(signals.time_s),
            Self::StateTime => Some(seconds(signals.time_ns.saturating_sub(since.entered_ns))),
            Self::StateDistance => {
                signals.get(Signal::Travelled).map(|now_m| now_m - since.entered_m)
            }
            Self::StateTurn => signals
                .get(Signal::Heading)
                .map(|now_rad| degrees(now_rad - since.entered_heading_rad)),
            Self::Done => Some(f64::from(since.done)),
            Self::Variable(place) => scope.board.variables.get(usize::from(place)).copied(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::behavior::blackboard::Blackboard;
    use crate::behavior::shipped;

    #[test]
    fn a_heading_wraps_in_conditions_and_a_turn_since_the_state_was_entered_does_not() {
        let mut signals = Signals::at(0);
        signals.set(Signal::Heading, 1.0);
        let since = signals.since();
        signals.set(Signal::Heading, 1.0 + 7.0);
        let board = Blackboard::of(signals, since);
        let scope = board.seen_by(0, 0);
        let heading = Input::Signal(Signal::Heading).read(scope).unwrap();
        assert!((heading - degrees(8.0 - std::f64::consts::TAU)).abs() < 1e-9, "{heading}");
        let turn = Input::StateTurn.read(scope).unwrap();
        assert!((turn - degrees(7.0)).abs() < 1e-9, "{turn}");
    }

    #[test]
    fn what_is_not_a_number_is_lost_and_only_a_range_may_be_infinite() {
        let mut signals = Signals::at(0);
        signals.set(Signal::X, 1.0);
        signals.set(Signal::X, f64::NAN);
        signals.set(Signal::Y, f64::INFINITY);
        signals.set(Signal::Sensed(Channel::Range), f64::INFINITY);
        assert_eq!((signals.get(Signal::X), signals.get(Signal::Y)), (None, None));
        assert_eq!(signals.get(Signal::Sensed(Channel::Range)), Some(f64::INFINITY));
    }

    fn is_of_a_name(c: char) -> bool {
        c.is_ascii_alphanumeric() || c == '_'
    }

    #[test]
    fn every_signal_has_a_place_and_every_name_one_meaning() {
        let places: BTreeSet<usize> = Channel::ALL
            .map(Signal::Sensed)
            .into_iter()
            .chain([
                Signal::Echo,
                Signal::Heading,
                Signal::X,
                Signal::Y,
                Signal::Travelled,
                Signal::Home,
            ])
            .map(Signal::place)
            .collect();
        assert_eq!(places, (0..Signal::COUNT).collect());
        let names: Vec<&str> = words().map(|word| word.name).collect();
        assert_eq!(names.iter().collect::<BTreeSet<_>>().len(), names.len(), "{names:?}");
        let listed = |name: &&str| {
            shipped::TEMPLATE.split(|c: char| !is_of_a_name(c)).any(|word| word == *name)
        };
        let missing: Vec<_> = names.iter().filter(|name| !listed(name)).collect();
        assert!(missing.is_empty(), "the template of missions does not list {missing:?}");
    }

    #[test]
    fn only_what_a_sensor_says_is_out_of_reach_may_be_infinite() {
        let may =
            Channel::ALL.into_iter().filter(|channel| may_be_infinite(Signal::Sensed(*channel)));
        let ranges = [Channel::Range, Channel::BeaconDistance].into_iter();
        assert_eq!(may.collect::<Vec<_>>(), ranges.chain(Channel::SENSORS).collect::<Vec<_>>());
    }
}
