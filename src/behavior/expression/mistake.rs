//! What can be wrong with an expression.

use std::ops::Range;

use super::{Expression, Kind};
use crate::behavior::blackboard::MAX_PIDS;
use crate::senses::Role;

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
#[non_exhaustive]
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
    /// A named motor or sensor that the robot does not have.
    #[error("the robot has no {what} named `{name}`")]
    NoNamed {
        /// Motor or sensor.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// A function that the language does not have.
    #[error("there is no function `{0}`")]
    NoFunction(String),
    /// A function without its arguments.
    #[error("`{0}` is a function: its arguments belong behind it in parentheses")]
    NoArguments(&'static str),
    /// More or fewer arguments than it takes.
    #[error("`{name}` takes {takes}, and this is {given}")]
    Arguments {
        /// The function.
        name: &'static str,
        /// How many it takes, in words.
        takes: String,
        /// How many there are.
        given: usize,
    },
    /// `pid` where nothing is asked for in every tick.
    #[error("`pid` remembers from tick to tick, so it belongs in a speed or an angle of `do`")]
    NoPid,
    /// More of them than there is memory for.
    #[error("more than {MAX_PIDS} `pid`s in one state")]
    TooManyPids,
    /// `NAME.state` where there is no such machine.
    #[error("the mission has no machine `{0}`")]
    NoMachine(String),
    /// `NAME.state == STATE` where the machine has no such state.
    #[error("machine `{machine}` has no state `{state}`")]
    NoState {
        /// The machine.
        machine: String,
        /// The name that none of its states has.
        state: String,
    },
    /// A machine's state can be compared and nothing else.
    #[error("`{0}` is compared with the name of a state")]
    State(String),
    /// More named motors or sensors than a robot can have.
    #[error("more than {most} named {what}s")]
    TooManyNamed {
        /// Motor or sensor.
        what: &'static str,
        /// How many it can have.
        most: usize,
    },
}

impl Mistake {
    /// What asks for a part that the robot does not have, and the way out.
    pub(in crate::behavior) fn no_part(name: &str, role: Role) -> (Self, String) {
        let mistake = Self::NoPart { name: name.to_owned(), part: role.what() };
        (mistake, format!("[{}] in the robot's file would be that part", role.section()))
    }
}
