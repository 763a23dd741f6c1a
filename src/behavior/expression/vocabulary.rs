//! The names that an expression may use.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;

use super::Infix;
use super::function::FUNCTIONS;
use super::lexer::{Placed, Token, foreign};
use super::mistake::Mistake;
use crate::behavior::signals::{Capabilities, words};
use crate::behavior::{MAX_MOTORS, MAX_SENSORS};
use crate::document::{nearest, nearest_or_all, one_of};
use crate::senses::{Channel, QUANTITIES, Quantity};

/// With more names than this the nearest one is not looked for: it would take longer than reading
/// the file.
pub(in crate::behavior) const SEARCHED: usize = 200;

/// The language's own words.
const LANGUAGE: [&str; 5] = ["and", "or", "not", "true", "false"];

/// Names that people look for, and what there is instead.
const NOT_HERE: [(&str, &str); 11] = [
    ("button_enter", STOPS),
    ("button_center", STOPS),
    ("button_back", STOPS),
    ("travelled_m", DRIVEN),
    (
        "distance",
        "`range_m` is how far what is ahead is, `state_m` how far it has driven in this state",
    ),
    ("encoder", DRIVEN),
    ("speed", "`state_m / state_s` is the mean speed in this state"),
    ("yaw", TURNED),
    ("angle", TURNED),
    ("light", "`reflect_pct` is the light that comes back, `ambient_pct` that of the room"),
    ("time", "`time_s` is since the run began, `state_s` since the state was entered"),
];

const DRIVEN: &str = "`state_m` is how far it has driven since the state was entered";
const TURNED: &str = "`heading_deg` is where it looks, `state_turn_deg` how far it has turned in \
                      this state";

const STOPS: &str = "Enter and Back stop the run; a mission has `button_up`, `button_down`, \
                     `button_left` and `button_right`";

/// The names that an expression may use: the signals of a robot, and a mission's own names.
#[derive(Debug)]
pub struct Vocabulary<'c> {
    /// What the robot has.
    pub(in crate::behavior) capabilities: &'c Capabilities,
    /// The mission's own numbers.
    pub numbers: BTreeMap<String, f64>,
    /// Those of them whose values are wrong, of which enough was said.
    pub(in crate::behavior) unread: BTreeSet<String>,
    /// The mission's variables, each with what it is at the start, in the order of their places.
    pub variables: Vec<(String, f64)>,
    /// The mission's machines in their order, each with its states and their places.
    ///
    /// A state has the places of the states inside it as well, which have names as `look.left`.
    pub machines: Vec<(String, BTreeMap<String, RangeInclusive<u16>>)>,
    /// The machine that is read, and the states that the reader is inside: `drive.look`. Names of
    /// variables are looked for there first.
    pub(in crate::behavior) scope: String,
    /// The named motors.
    pub motors: Named,
    /// The named sensors.
    pub sensors: Named,
    /// How many `pid`s the state that is read has so far; `None` outside `do`.
    pub(in crate::behavior) pids: Option<u32>,
    /// How many `random`s there are so far.
    pub(super) randoms: u32,
}

impl<'c> Vocabulary<'c> {
    /// The signals of a robot, and no numbers yet.
    #[must_use]
    pub fn new(capabilities: &'c Capabilities) -> Self {
        fn names<T>(named: Option<&Vec<(String, T)>>) -> Option<Vec<String>> {
            named.map(|all| all.iter().map(|(name, _)| name.clone()).collect())
        }
        Self {
            capabilities,
            numbers: BTreeMap::new(),
            unread: BTreeSet::new(),
            variables: Vec::new(),
            machines: Vec::new(),
            scope: String::new(),
            motors: Named::new("motor", MAX_MOTORS, names(capabilities.motors.as_ref())),
            sensors: Named::new("sensor", MAX_SENSORS, names(capabilities.sensors.as_ref())),
            pids: None,
            randoms: 0,
        }
    }

    /// The place of a variable: of the sub-machine that is read, of one that it is inside, of the
    /// machine's sub-machines (`look.nearest_m`), of the mission, or of any machine's
    /// (`drive.look.nearest_m`).
    #[must_use]
    pub fn variable(&self, name: &str) -> Option<u8> {
        let mut scope = self.scope.as_str();
        loop {
            let is_it = |known: &str| match scope {
                "" => known == name,
                _ => {
                    known.strip_prefix(scope).and_then(|rest| rest.strip_prefix('.')) == Some(name)
                }
            };
            if let Some(place) = self.variables.iter().position(|(known, _)| is_it(known)) {
                return u8::try_from(place).ok();
            }
            if scope.is_empty() {
                return None;
            }
            scope = scope.rsplit_once('.').map_or("", |(outer, _)| outer);
        }
    }

    /// Whether there is a machine's state, a variable of a sub-machine, or, where one is compared
    /// with, a state of this name.
    ///
    /// - `before`: the tokens before the name.
    pub(super) fn is_hyphenated(&self, name: &str, before: &[Placed<'_>]) -> bool {
        let machine = |name: &str| {
            let machine = name.strip_suffix(".state")?;
            self.machines.iter().find(|(known, _)| known == machine)
        };
        if let [.., (Token::Name(state), _), (Token::Infix(Infix::Compare(_)), _)] = before
            && let Some((_, states)) = machine(state)
        {
            return states.contains_key(name);
        }
        machine(name).is_some() || self.variable(name).is_some()
    }

    /// What a named sensor measures, by its place; `None` where the robot is not known.
    pub(super) fn measures(&self, place: u8) -> Option<Channel> {
        let sensors = self.capabilities.sensors.as_ref()?;
        sensors.get(usize::from(place)).map(|(_, measures)| *measures)
    }

    /// What there is instead of a name that is not known: the values of what it is compared with,
    /// or the nearest name. Of the mission's own the first are looked at.
    ///
    /// - `before`: the tokens before the name.
    pub(super) fn name_hint(&self, name: &str, before: &[Placed<'_>]) -> Option<String> {
        let instead = NOT_HERE.iter().find(|(missing, _)| *missing == name);
        let instead = instead.map(|(_, instead)| (*instead).to_owned());
        if let Some(hint) = instead.or_else(|| value_hint(name, before)) {
            return Some(hint);
        }
        let own = self.numbers.keys().chain(self.variables.iter().map(|(name, _)| name));
        let own = own.take(SEARCHED).map(String::as_str);
        let known = words().map(|word| word.name).chain(LANGUAGE).chain(values().map(|row| row.0));
        let functions = FUNCTIONS.iter().map(|row| row.0.name());
        nearest(name, known.chain(functions).chain(own))
    }

    /// Whether a name has a meaning in every mission.
    pub(in crate::behavior) fn is_taken(name: &str) -> bool {
        words().any(|word| word.name == name)
            || LANGUAGE.into_iter().chain(["motor", "sensor"]).any(|word| word == name)
            || foreign(name).is_some()
            || FUNCTIONS.iter().any(|row| row.0.name() == name)
    }
}

/// The names of a robot's motors, or of its sensors; where the robot is not known, those that were
/// used so far, and any may be used.
#[derive(Debug)]
pub struct Named {
    what: &'static str,
    most: usize,
    names: Vec<String>,
    is_known: bool,
}

impl Named {
    fn new(what: &'static str, most: usize, names: Option<Vec<String>>) -> Self {
        Self { what, most, is_known: names.is_some(), names: names.unwrap_or_default() }
    }

    /// The names in the order of their places.
    #[must_use]
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// The place of a name.
    ///
    /// # Errors
    ///
    /// [`Mistake::NoNamed`] or [`Mistake::TooManyNamed`].
    pub fn place(&mut self, name: &str) -> Result<u8, Mistake> {
        let Self { what, most, .. } = *self;
        let place = match self.names.iter().position(|known| known == name) {
            Some(place) => place,
            None if self.is_known => {
                return Err(Mistake::NoNamed { what, name: name.to_owned() });
            }
            None => self.names.len(),
        };
        if place >= most {
            return Err(Mistake::TooManyNamed { what, most });
        }
        if place == self.names.len() {
            self.names.push(name.to_owned());
        }
        u8::try_from(place).map_err(|_| Mistake::TooManyNamed { what, most })
    }

    /// The way out where the robot has none of this name.
    pub(in crate::behavior) fn hint(&self, name: &str) -> String {
        match self.names.as_slice() {
            [] => format!("[{}.NAME] in the robot's file would be one", self.what),
            names => nearest_or_all(name, "it has", names.iter().map(String::as_str)),
        }
    }
}

/// The values that stand behind `colour ==`.
fn value_hint(name: &str, before: &[Placed<'_>]) -> Option<String> {
    let [.., (Token::Name(signal), _), (Token::Infix(Infix::Compare(_)), _)] = before else {
        return None;
    };
    let channel = words().find(|word| word.name == *signal)?.channel?;
    let values = channel.quantity().values().map(|(value, _)| value);
    values.clone().next()?;
    Some(format!("`{signal}` is {}", one_of(name, values)))
}

/// The names of what signals can be, such as colours.
pub(super) fn values() -> impl Iterator<Item = (&'static str, f64)> {
    QUANTITIES.iter().flat_map(Quantity::values)
}
