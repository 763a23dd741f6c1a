//! The language of conditions, and of the numbers in `do`.
//!
//! ```text
//! range_m < 0.25 and not touch
//! found == 4 or drive.state == halt
//! 200 * (keep_m - range_m)
//! ```
//!
//! | binds, loosest first | takes | gives |
//! |---|---|---|
//! | `or`, then `and`, then `not` | truths | truth |
//! | `<` `<=` `>` `>=` `==` `!=`, not in chains | numbers (`==` and `!=` also two truths) | truth |
//! | `+` `-`, then `*` `/`, then `-` before a number | numbers | number |
//!
//! Operands are numbers (`0.25`, `1e-3`), `true`, `false`, the signals, `motor.NAME` (its angle),
//! `sensor.NAME` (what it measures, in the unit of the signal of that kind), the mission's own
//! numbers and variables, names of what a signal can be (`colour == red`), functions with their
//! arguments, and expressions in parentheses. Angles are in degrees, as the signals' names say.
//! `drive.state == turn` is true while the machine `drive` is in its state `turn`, or in a state of
//! the sub-machine that `turn` uses (`drive.state == turn.left` names one of those), as it is at
//! that moment: machines take their steps in the order of the file.
//!
//! | function | gives |
//! |---|---|
//! | `abs(a)` `sqrt(a)` `round(a)` `floor(a)` `sign(a)` | as usual; `sign` is -1, 0 or 1 |
//! | `min(a, b, …)` `max(a, b, …)` `clamp(a, low, high)` | the least, the greatest; `a`, kept within two bounds |
//! | `sin(deg)` `cos(deg)` `atan2(y, x)` | angles in degrees |
//! | `wrap_deg(deg)` | the same direction, from -180 to below 180 |
//! | `distance_m(x, y)` | how far the robot is from that place |
//! | `bearing_deg(x, y)` | how far to the left of straight ahead that place is, -180 to 180 |
//! | `random(a, b)` | a number between the two, drawn when the state is entered |
//! | `pid(error, kp, ki, kd, most)` | a controller's answer: `kp` times the error, `ki` times its sum over the seconds in this state, `kd` times its change a second, kept within `-most` and `most`, where the sum does not grow; `most` can be left out; in `do` alone |
//!
//! Arithmetic is that of IEEE 754: dividing by zero gives an infinity or NaN, and a comparison with
//! NaN is false (`!=` is true). A lost signal makes what depends on it unknown, by Kleene's logic:
//! `false and unknown` is false, `true or unknown` is true, everything else with an unknown part is
//! unknown. An unknown condition does not fire.
//!
//! # Not here
//!
//! No assignment (`set` has that) and no strings.
//!
//! # What we count on
//!
//! - An expression has at most [`Expression::MAX_BYTES`] bytes and [`Expression::MAX_NESTING`]
//!   levels, so that reading it cannot exhaust the stack.
//! - It is kept in postfix order; evaluating it is one pass with a stack of fixed size and
//!   allocates nothing.

use std::fmt;

use self::function::Function;
use super::blackboard::{Blackboard, Scope, Since};
use super::signals::{Input, Signal, Word};
use crate::senses::Channel;

mod evaluation;
mod function;
mod implication;
mod lexer;
mod mistake;
mod parser;
mod reach;
mod vocabulary;

pub(super) use implication::Claims;
pub use mistake::{Misreading, Mistake};
pub(super) use parser::is_plain;
pub(super) use vocabulary::SEARCHED;
pub use vocabulary::Vocabulary;

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
    /// Names that are not the language's own, for those operations that have one.
    names: Box<[String]>,
}

/// One step of the evaluation.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Op {
    Number(f64),
    Truth(bool),
    Signal(Input),
    /// A signal whose name is the robot's or the mission's own, and what it measures if it is a
    /// sensor of a known robot.
    Own {
        name: u16,
        input: Input,
        measures: Option<Channel>,
    },
    Named {
        name: u16,
        value: f64,
    },
    /// A machine is in a state, or in one inside it: `first` to `last`.
    InState {
        name: u16,
        machine: u8,
        first: u16,
        last: u16,
    },
    Negate,
    Not,
    Infix(Infix),
    /// `slot` is where a `pid` remembers, and which `random` this is.
    Call {
        function: Function,
        slot: u32,
    },
}

impl Op {
    /// How many operands it takes.
    fn takes(self) -> usize {
        match self {
            Self::Negate | Self::Not => 1,
            Self::Infix(_) => 2,
            Self::Call { function, .. } => function.takes(),
            _ => 0,
        }
    }

    /// The variable that it is.
    fn variable(self) -> Option<u8> {
        match self {
            Self::Own { input: Input::Variable(variable), .. } => Some(variable),
            _ => None,
        }
    }

    /// What is known of a signal, or of what a named sensor measures.
    fn word(&self) -> Option<Word> {
        match self {
            Self::Signal(input) => input.word(),
            Self::Own { measures, .. } => measures.map(|channel| Word::from(channel.quantity())),
            _ => None,
        }
    }
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

/// What stands between two operands, by its text; longer ones first, so that `<=` is not read as
/// `<`.
const OPERATORS: [(&str, Infix); 12] = [
    ("or", Infix::Or),
    ("and", Infix::And),
    ("<=", Infix::Compare(Comparison::LessOrEqual)),
    (">=", Infix::Compare(Comparison::GreaterOrEqual)),
    ("==", Infix::Compare(Comparison::Equal)),
    ("!=", Infix::Compare(Comparison::NotEqual)),
    ("<", Infix::Compare(Comparison::Less)),
    (">", Infix::Compare(Comparison::Greater)),
    ("+", Infix::Add),
    ("-", Infix::Subtract),
    ("*", Infix::Multiply),
    ("/", Infix::Divide),
];

impl Expression {
    /// The longest expression that is read, in bytes.
    pub const MAX_BYTES: usize = 4096;

    /// The deepest nesting of parentheses and operators that is read.
    pub const MAX_NESTING: usize = 64;

    /// Reads an expression that must give `kind`; where that is `None`, either.
    ///
    /// # Errors
    ///
    /// Everything that is wrong with it, each with its bytes in `text`; after a mistake in grammar
    /// nothing more is found.
    pub fn parse(
        text: &str,
        kind: impl Into<Option<Kind>>,
        vocabulary: &mut Vocabulary<'_>,
    ) -> Result<Self, Vec<Misreading>> {
        parser::parse(text, kind.into(), vocabulary)
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
    /// signal leaves it unknown.
    #[must_use]
    pub fn evaluate(&self, scope: Scope<'_>) -> Option<f64> {
        evaluation::evaluate(&self.ops, scope)
    }

    /// True where it is a condition that is known to hold.
    #[must_use]
    pub fn holds(&self, scope: Scope<'_>) -> bool {
        self.kind == Kind::Truth && self.evaluate(scope).is_some_and(|truth| truth != 0.0)
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

    /// The number that it always is, where it is made of nothing but numbers; not finite where
    /// it divides by zero.
    pub(super) fn always(&self) -> Option<f64> {
        let takes_a_name = self.ops.iter().any(|op| matches!(op, Op::Named { .. }));
        if takes_a_name { None } else { self.in_a_run() }
    }

    /// The number that it is in a whole run, where it is made of nothing but numbers and the
    /// mission's own numbers, as they are now.
    pub(super) fn in_a_run(&self) -> Option<f64> {
        let is_fixed = |op: &Op| match op {
            Op::Call { function, .. } => function.is_pure(),
            op => {
                matches!(op, Op::Number(_) | Op::Named { .. } | Op::Negate | Op::Infix(_))
            }
        };
        if !self.ops.iter().all(is_fixed) {
            return None;
        }
        let board = Blackboard::default();
        self.evaluate(Scope { board: &board, machine: 0, since: &Since::default() })
    }

    /// What a value of it is called, where it is a signal alone whose values have names, as colours
    /// have.
    pub(super) fn called(&self, value: f64) -> Option<&'static str> {
        let [only] = &*self.ops else { return None };
        let mut values = only.word()?.channel?.quantity().values();
        values.find(|(_, known)| (known - value).abs() < 0.5).map(|(name, _)| name)
    }

    /// What its signals take of what a robot senses.
    pub(super) fn channels(&self) -> impl Iterator<Item = Channel> {
        self.ops.iter().filter_map(|op| match op {
            Op::Signal(input) => input.word()?.channel,
            Op::Own { input: Input::Signal(Signal::Sensed(channel)), .. } => Some(*channel),
            _ => None,
        })
    }

    /// True where it takes a variable's value.
    pub(super) fn takes(&self, variable: u8) -> bool {
        self.ops.iter().any(|op| op.variable() == Some(variable))
    }

    /// True where it asks of what is sensed, and of nothing that changes as a state is entered once
    /// more: what is measured since then, chance, a variable that is not one of `counted`.
    pub(super) fn is_level(&self, counted: &[u8]) -> bool {
        let stays = |op: &Op| match op {
            Op::Signal(input) | Op::Own { input, .. } => match input {
                Input::Variable(variable) => counted.contains(variable),
                input => !input.is_since_entry(),
            },
            Op::Call { function, .. } => function.is_pure(),
            _ => true,
        };
        self.channels().next().is_some() && self.ops.iter().all(stays)
    }

    /// What a name of the expression is.
    fn name_of(&self, op: Op) -> String {
        match op {
            Op::Signal(input) => input.word().map(|word| word.name),
            Op::Own { name, .. } | Op::Named { name, .. } | Op::InState { name, .. } => {
                self.names.get(usize::from(name)).map(String::as_str)
            }
            _ => None,
        }
        .unwrap_or("?")
        .to_owned()
    }

    /// True where it asks of what is sensed alone: while the robot stands still, only something
    /// beside it changes that.
    pub(super) fn asks_of_the_world(&self) -> bool {
        let is_of_the_world = |op: &Op| match op {
            Op::Signal(input) => {
                matches!(input, Input::Signal(Signal::Sensed(_) | Signal::Echo))
            }
            op => !matches!(op, Op::Own { .. } | Op::InState { .. }),
        };
        self.ops.iter().any(|op| matches!(op, Op::Signal(_)))
            && self.ops.iter().all(is_of_the_world)
    }

    /// Whether it looks at whether what the state does has come to its end.
    pub(super) fn asks_whether_done(&self) -> bool {
        self.ops.contains(&Op::Signal(Input::Done))
    }
}

impl fmt::Display for Expression {
    /// The expression with all of its parentheses: how it was understood. It reads back as the same
    /// expression unless a chain of operators was longer than the nesting that is read.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut stack: Vec<String> = Vec::new();
        for op in &self.ops {
            let rendered = match op {
                Op::Number(number) => literal(*number),
                Op::Truth(truth) => truth.to_string(),
                Op::Signal(_) | Op::Own { .. } | Op::Named { .. } => self.name_of(*op),
                Op::InState { .. } => format!("({})", self.name_of(*op)),
                Op::Negate => format!("(-{})", stack.pop().unwrap_or_default()),
                Op::Not => format!("(not {})", stack.pop().unwrap_or_default()),
                Op::Infix(infix) => {
                    let right = stack.pop().unwrap_or_default();
                    format!("({} {} {right})", stack.pop().unwrap_or_default(), infix.as_str())
                }
                Op::Call { function, .. } => {
                    let first = stack.len().saturating_sub(function.takes());
                    let arguments: Vec<String> = stack.drain(first..).collect();
                    format!("{}({})", function.name(), arguments.join(", "))
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
        OPERATORS.iter().find(|(_, infix)| *infix == self).map_or("?", |(text, _)| text)
    }
}

impl Comparison {
    /// The same with its operands exchanged.
    fn exchanged(self) -> Self {
        match self {
            Self::Less => Self::Greater,
            Self::LessOrEqual => Self::GreaterOrEqual,
            Self::Greater => Self::Less,
            Self::GreaterOrEqual => Self::LessOrEqual,
            Self::Equal | Self::NotEqual => self,
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

#[cfg(test)]
mod tests;
