//! The language of conditions, and of the numbers in `do`.
//!
//! ```text
//! range_m < 0.25 and not touch
//! time_s > time_limit_s
//! 200 * (distance_m - range_m)
//! ```
//!
//! | binds, loosest first | takes | gives |
//! |---|---|---|
//! | `or`, then `and`, then `not` | truths | truth |
//! | `<` `<=` `>` `>=` `==` `!=`, not in chains | numbers (`==` and `!=` also two truths) | truth |
//! | `+` `-`, then `*` `/`, then `-` before a number | numbers | number |
//!
//! Operands are numbers (`0.25`, `1e-3`), `true`, `false`, the signals, `motor.NAME`, the mission's
//! own numbers, and expressions in parentheses. Angles are in degrees, as the signals' names say.
//!
//! Arithmetic is that of IEEE 754: dividing by zero gives an infinity or NaN, and a comparison with
//! NaN is false (`!=` is true). A lost signal makes what depends on it unknown, by Kleene's logic:
//! `false and unknown` is false, `true or unknown` is true, everything else with an unknown part is
//! unknown. An unknown condition does not fire.
//!
//! # Not here
//!
//! No assignment, no functions, no strings: what remembers something is a state.
//!
//! # What we count on
//!
//! - An expression has at most [`Expression::MAX_BYTES`] bytes and [`Expression::MAX_NESTING`]
//!   levels, so that reading it cannot exhaust the stack.
//! - It is kept in postfix order; evaluating it is one pass with a stack of fixed size and
//!   allocates nothing.

use std::collections::BTreeMap;
use std::fmt;
use std::ops::Range;

use arrayvec::ArrayVec;

use super::signals::{Capabilities, Input, Signal, Signals};
use super::{MAX_MOTORS, MachineState};
use crate::document::nearest;
use crate::senses::Channel;

mod implication;
mod lexer;
mod parser;

pub(super) use implication::Claims;
pub(super) use parser::is_plain;

/// What an expression gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A number.
    Number,
    /// True or false.
    Truth,
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Number => "a number",
            Self::Truth => "true or false",
        })
    }
}

/// A condition or a number, ready to be evaluated in every tick.
#[derive(Debug, Clone, PartialEq)]
pub struct Expression {
    text: Box<str>,
    kind: Kind,
    ops: Box<[Op]>,
    /// Names that are not the language's own: [`Op::Named`] and [`Op::Motor`] point here.
    names: Box<[String]>,
}

/// One step of the evaluation.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Op {
    Number(f64),
    Truth(bool),
    Signal(Input),
    Motor { name: u16, place: u8 },
    Named { name: u16, value: f64 },
    Negate,
    Not,
    Infix(Infix),
}

/// What stands between two operands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Infix {
    Or,
    And,
    Compare(Comparison),
    Add,
    Subtract,
    Multiply,
    Divide,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Comparison {
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
    Equal,
    NotEqual,
}

impl Expression {
    /// The longest expression that is read, in bytes.
    pub const MAX_BYTES: usize = 4096;

    /// The deepest nesting of parentheses and operators that is read.
    pub const MAX_NESTING: usize = 64;

    /// Reads an expression that must give `kind`.
    ///
    /// # Errors
    ///
    /// Everything that is wrong with it, each with its bytes in `text`; after a mistake in grammar
    /// nothing more is found.
    pub fn parse(
        text: &str,
        kind: Kind,
        vocabulary: &mut Vocabulary<'_>,
    ) -> Result<Self, Vec<Misreading>> {
        parser::parse(text, kind, vocabulary)
    }

    /// The expression that is always this number.
    #[must_use]
    pub fn constant(number: f64) -> Self {
        let mut ops = vec![Op::Number(number.abs())];
        if number.is_sign_negative() {
            ops.push(Op::Negate);
        }
        Self {
            text: number.to_string().into(),
            kind: Kind::Number,
            ops: ops.into(),
            names: Box::default(),
        }
    }

    /// The text as a person wrote it.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.text
    }

    /// What it gives.
    #[must_use]
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// The value, in the units of the names it is made of, a truth as 1 or 0; `None` where a lost
    /// signal leaves it unknown. `since` is when and where the active state was entered.
    #[must_use]
    pub fn evaluate(&self, signals: &Signals, since: &MachineState) -> Option<f64> {
        evaluate(&self.ops, signals, since)
    }

    /// True where it is a condition that is known to hold.
    #[must_use]
    pub fn holds(&self, signals: &Signals, since: &MachineState) -> bool {
        self.kind == Kind::Truth && self.evaluate(signals, since).is_some_and(|truth| truth != 0.0)
    }

    /// Gives one of the mission's own numbers another value.
    pub(super) fn set(&mut self, number: &str, to: f64) {
        for op in &mut self.ops {
            if let Op::Named { name, value } = op
                && self.names.get(usize::from(*name)).is_some_and(|name| name == number)
            {
                *value = to;
            }
        }
    }

    /// What its signals take of what a robot senses.
    pub(super) fn channels(&self) -> impl Iterator<Item = Channel> {
        self.ops.iter().filter_map(|op| match op {
            Op::Signal(input) => input.word()?.channel,
            Op::Motor { place, .. } => Channel::MOTORS.get(usize::from(*place)).copied(),
            _ => None,
        })
    }
}

impl fmt::Display for Expression {
    /// The expression with all of its parentheses: how it was understood. It reads back as the same
    /// expression unless a chain of operators was longer than the nesting that is read.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = |at: u16| self.names.get(usize::from(at)).map_or("?", String::as_str);
        let mut stack: Vec<String> = Vec::new();
        for op in &self.ops {
            let rendered = match op {
                Op::Number(number) => literal(*number),
                Op::Truth(truth) => truth.to_string(),
                Op::Signal(input) => input.word().map_or("?", |word| word.name).to_owned(),
                Op::Motor { name: at, .. } => format!("motor.{}", name(*at)),
                Op::Named { name: at, .. } => name(*at).to_owned(),
                Op::Negate => format!("(-{})", stack.pop().unwrap_or_default()),
                Op::Not => format!("(not {})", stack.pop().unwrap_or_default()),
                Op::Infix(infix) => {
                    let right = stack.pop().unwrap_or_default();
                    format!("({} {} {right})", stack.pop().unwrap_or_default(), infix.as_str())
                }
            };
            stack.push(rendered);
        }
        f.write_str(&stack.pop().unwrap_or_default())
    }
}

/// A number as the language writes it; very large and very small ones by powers of ten.
fn literal(number: f64) -> String {
    if number == 0.0 || (1e-6..1e15).contains(&number) {
        number.to_string()
    } else {
        format!("{number:e}")
    }
}

impl Infix {
    fn as_str(self) -> &'static str {
        match self {
            Self::Or => "or",
            Self::And => "and",
            Self::Compare(comparison) => comparison.as_str(),
            Self::Add => "+",
            Self::Subtract => "-",
            Self::Multiply => "*",
            Self::Divide => "/",
        }
    }
}

impl Comparison {
    fn as_str(self) -> &'static str {
        match self {
            Self::Less => "<",
            Self::LessOrEqual => "<=",
            Self::Greater => ">",
            Self::GreaterOrEqual => ">=",
            Self::Equal => "==",
            Self::NotEqual => "!=",
        }
    }

    #[expect(clippy::float_cmp, reason = "the language's own equality, documented as IEEE 754's")]
    fn of(self, left: f64, right: f64) -> bool {
        match self {
            Self::Less => left < right,
            Self::LessOrEqual => left <= right,
            Self::Greater => left > right,
            Self::GreaterOrEqual => left >= right,
            Self::Equal => left == right,
            Self::NotEqual => left != right,
        }
    }
}

/// Operands that wait while the rest is evaluated: at most one for each level of nesting, and the
/// one in hand.
const STACK: usize = Expression::MAX_NESTING + 2;

fn evaluate(ops: &[Op], signals: &Signals, since: &MachineState) -> Option<f64> {
    // Most are a number as it stands, or compare a signal with one: no stack is needed.
    match ops {
        [only] => return operand(only, signals, since),
        [left, right, Op::Infix(Infix::Compare(comparison))] => {
            let (left, right) = (operand(left, signals, since)?, operand(right, signals, since)?);
            return Some(f64::from(comparison.of(left, right)));
        }
        _ => {}
    }
    let mut stack: ArrayVec<Option<f64>, STACK> = ArrayVec::new();
    for op in ops {
        let value = match op {
            Op::Negate => stack.pop()?.map(|number| -number),
            Op::Not => stack.pop()?.map(|truth| f64::from(truth == 0.0)),
            Op::Infix(infix) => {
                let right = stack.pop()?;
                apply(*infix, stack.pop()?, right)
            }
            _ => operand(op, signals, since),
        };
        stack.try_push(value).ok()?;
    }
    stack.pop()?
}

/// The value of what needs no other; `None` where a lost signal leaves it unknown.
fn operand(op: &Op, signals: &Signals, since: &MachineState) -> Option<f64> {
    match op {
        Op::Number(number) | Op::Named { value: number, .. } => Some(*number),
        Op::Truth(truth) => Some(f64::from(*truth)),
        Op::Signal(input) => input.read(signals, since),
        Op::Motor { place, .. } => motor(*place)?.read(signals, since),
        Op::Negate | Op::Not | Op::Infix(_) => None,
    }
}

/// A named motor's angle.
fn motor(place: u8) -> Option<Input> {
    Channel::MOTORS.get(usize::from(place)).map(|channel| Input::Signal(Signal::Sensed(*channel)))
}

fn apply(infix: Infix, left: Option<f64>, right: Option<f64>) -> Option<f64> {
    let is = |side: Option<f64>, truth: bool| side.is_some_and(|value| (value != 0.0) == truth);
    match infix {
        Infix::And if is(left, false) || is(right, false) => Some(0.0),
        Infix::Or if is(left, true) || is(right, true) => Some(1.0),
        Infix::And => left.and(right).map(|_| 1.0),
        Infix::Or => left.and(right).map(|_| 0.0),
        Infix::Compare(comparison) => Some(f64::from(comparison.of(left?, right?))),
        Infix::Add | Infix::Subtract | Infix::Multiply | Infix::Divide => {
            Some(calculate(infix, left?, right?))
        }
    }
}

fn calculate(infix: Infix, left: f64, right: f64) -> f64 {
    match infix {
        Infix::Add => left + right,
        Infix::Subtract => left - right,
        Infix::Multiply => left * right,
        _ => left / right,
    }
}

/// The names that an expression may use: the signals of a robot, and a mission's own numbers.
#[derive(Debug)]
pub struct Vocabulary<'c> {
    capabilities: &'c Capabilities,
    /// The mission's own numbers.
    pub numbers: BTreeMap<String, f64>,
    /// The named motors; where the robot is not known, those that were used so far.
    motors: Vec<String>,
}

impl<'c> Vocabulary<'c> {
    /// The signals of a robot, and no numbers yet.
    #[must_use]
    pub fn new(capabilities: &'c Capabilities) -> Self {
        let motors = capabilities.motors.clone().unwrap_or_default();
        Self { capabilities, numbers: BTreeMap::new(), motors }
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
    pub(super) fn motor_hint(&self, name: &str) -> String {
        let known = || self.motors.iter().map(String::as_str);
        nearest(name, known()).unwrap_or_else(|| match self.motors.as_slice() {
            [] => "[motor.NAME] in the robot's file would be one".to_owned(),
            _ => format!("it has {}", known().collect::<Vec<_>>().join(", ")),
        })
    }

    /// What the robot has.
    pub(super) fn capabilities(&self) -> &'c Capabilities {
        self.capabilities
    }
}

/// One thing that is wrong with an expression.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{mistake}")]
pub struct Misreading {
    /// The bytes of the expression that it is about.
    pub place: Range<usize>,
    /// What is wrong.
    pub mistake: Mistake,
    /// The way out, where one is known.
    pub hint: Option<String>,
}

/// What can be wrong with an expression.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Mistake {
    /// There is nothing in it.
    #[error("the expression is empty")]
    Empty,
    /// It is longer than [`Expression::MAX_BYTES`].
    #[error("the expression has {0} bytes; at most {max} are read", max = Expression::MAX_BYTES)]
    TooLong(usize),
    /// It is nested deeper than [`Expression::MAX_NESTING`].
    #[error(
        "the expression is nested too deeply; at most {max} levels are read",
        max = Expression::MAX_NESTING
    )]
    TooDeep,
    /// A character that the language does not have.
    #[error("`{0}` has no meaning in an expression")]
    Character(String),
    /// Digits that are no number, or one beyond what can be counted.
    #[error("`{0}` is not a number that can be used")]
    Number(String),
    /// A name that is neither a signal nor one of the mission's numbers.
    #[error("unknown name `{0}`")]
    UnknownName(String),
    /// An operand is missing.
    #[error("a number, a name or `(` should stand here, not {0}")]
    NoOperand(String),
    /// Two operands stand side by side.
    #[error("an operator should stand here, not {0}")]
    NoOperator(String),
    /// A parenthesis is not closed.
    #[error("this `(` is not closed")]
    NotClosed,
    /// A parenthesis is closed that was not opened.
    #[error("this `)` closes nothing")]
    NotOpened,
    /// `a < b < c`.
    #[error("comparisons cannot be chained")]
    Chained,
    /// An operand is a number where a truth belongs, or the other way round.
    #[error("`{operator}` takes {expected}, and this is {found}")]
    Operand {
        /// The operator.
        operator: &'static str,
        /// What it takes.
        expected: Kind,
        /// What it was given.
        found: Kind,
    },
    /// The two sides of `==` or `!=` are of different kinds.
    #[error("`{0}` compares a number with true or false")]
    Mixed(&'static str),
    /// The whole is a number where a truth belongs, or the other way round.
    #[error("this must be {expected}, and it is {found}")]
    Whole {
        /// What it must be.
        expected: Kind,
        /// What it is.
        found: Kind,
    },
    /// A signal of a part that the robot does not have.
    #[error("`{name}` takes {part}, which the robot does not have")]
    NoPart {
        /// The signal.
        name: String,
        /// The part.
        part: &'static str,
    },
    /// A named motor that the robot does not have.
    #[error("the robot has no motor named `{0}`")]
    NoMotor(String),
    /// More named motors than a robot can have.
    #[error("more than {MAX_MOTORS} named motors")]
    TooManyMotors,
}

#[cfg(test)]
mod tests;
