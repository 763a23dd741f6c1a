//! The names that an expression may use.

use std::collections::BTreeMap;

use super::function::FUNCTIONS;
use super::mistake::Mistake;
use crate::behavior::MAX_MOTORS;
use crate::behavior::signals::{Capabilities, words};
use crate::document::nearest;
use crate::senses::{QUANTITIES, Quantity};

/// With more names than this the nearest one is not looked for: it would take longer than reading
/// the file.
pub(in crate::behavior) const SEARCHED: usize = 200;

/// The names that an expression may use: the signals of a robot, and a mission's own names.
#[derive(Debug)]
pub struct Vocabulary<'c> {
    capabilities: &'c Capabilities,
    /// The mission's own numbers.
    pub numbers: BTreeMap<String, f64>,
    /// The mission's variables, each with what it is at the start, in the order of their places.
    pub variables: Vec<(String, f64)>,
    /// The mission's machines in their order, each with its states and their places.
    pub machines: Vec<(String, BTreeMap<String, u16>)>,
    /// The named motors; where the robot is not known, those that were used so far.
    motors: Vec<String>,
    /// How many `pid`s the state that is read has so far; `None` outside `do`.
    pub(in crate::behavior) pids: Option<u32>,
    /// How many `random`s there are so far.
    pub(super) randoms: u32,
}

impl<'c> Vocabulary<'c> {
    /// The signals of a robot, and no numbers yet.
    #[must_use]
    pub fn new(capabilities: &'c Capabilities) -> Self {
        let motors = capabilities.motors.clone().unwrap_or_default();
        Self {
            capabilities,
            numbers: BTreeMap::new(),
            variables: Vec::new(),
            machines: Vec::new(),
            motors,
            pids: None,
            randoms: 0,
        }
    }

    /// The place of a variable.
    #[must_use]
    pub fn variable(&self, name: &str) -> Option<u8> {
        let place = self.variables.iter().position(|(known, _)| known == name)?;
        u8::try_from(place).ok()
    }

    /// The named motors in the order of their places.
    #[must_use]
    pub fn motors(&self) -> &[String] {
        &self.motors
    }

    /// The place of a named motor. Where the robot is not known it has any motor, up to
    /// [`MAX_MOTORS`].
    ///
    /// # Errors
    ///
    /// [`Mistake::NoMotor`] or [`Mistake::TooManyMotors`].
    pub fn motor(&mut self, name: &str) -> Result<u8, Mistake> {
        let place = match self.motors.iter().position(|motor| motor == name) {
            Some(place) => place,
            None if self.capabilities.motors.is_some() => {
                return Err(Mistake::NoMotor(name.to_owned()));
            }
            None => self.motors.len(),
        };
        if place >= MAX_MOTORS {
            return Err(Mistake::TooManyMotors);
        }
        if place == self.motors.len() {
            self.motors.push(name.to_owned());
        }
        u8::try_from(place).map_err(|_| Mistake::TooManyMotors)
    }

    /// The way out where the robot has no motor of this name.
    pub(in crate::behavior) fn motor_hint(&self, name: &str) -> String {
        let known = || self.motors.iter().map(String::as_str);
        nearest(name, known()).unwrap_or_else(|| match self.motors.as_slice() {
            [] => "[motor.NAME] in the robot's file would be one".to_owned(),
            _ => format!("it has {}", known().collect::<Vec<_>>().join(", ")),
        })
    }

    /// The nearest name to one that is not known, of `names` and, where they are few, of all that
    /// an expression can have.
    pub(in crate::behavior) fn name_hint(&self, name: &str) -> Option<String> {
        let own = self.numbers.keys().chain(self.variables.iter().map(|(name, _)| name));
        let own = own.take(SEARCHED).map(String::as_str);
        let language = ["and", "or", "not", "true", "false"];
        let known = words().map(|word| word.name).chain(language).chain(values().map(|row| row.0));
        let functions = FUNCTIONS.iter().map(|row| row.0.name());
        nearest(name, known.chain(functions).chain(own))
    }

    /// Whether a name has a meaning in every mission.
    pub(in crate::behavior) fn is_taken(name: &str) -> bool {
        words().any(|word| word.name == name)
            || ["and", "or", "not", "true", "false", "motor"].contains(&name)
            || FUNCTIONS.iter().any(|row| row.0.name() == name)
    }

    /// What the robot has.
    pub(in crate::behavior) fn capabilities(&self) -> &'c Capabilities {
        self.capabilities
    }
}

/// The names of what signals can be, such as colours.
pub(super) fn values() -> impl Iterator<Item = (&'static str, f64)> {
    QUANTITIES.iter().flat_map(Quantity::values).copied()
}
