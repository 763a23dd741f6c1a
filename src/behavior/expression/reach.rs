//! Signals that are compared with a number that they never are, where another unit may have been
//! meant; and by size with one of several things, which have no order.

use super::{Comparison, Expression, Infix, Op};
use crate::behavior::signals::Word;
use crate::senses::Unit;

/// A comparison with a number out of a signal's reach.
#[derive(Debug)]
pub(in crate::behavior) struct Beyond {
    name: String,
    signal: Word,
    number: f64,
    /// The least and the greatest value that it can be.
    reach: (f64, f64),
}

impl Beyond {
    /// What is wrong.
    pub(in crate::behavior) fn message(&self) -> String {
        format!("{}, and {} is beyond", self.domain(), self.number)
    }

    /// What to do about it.
    pub(in crate::behavior) fn hint(&self) -> String {
        let (least, most) = self.reach;
        self.meant().unwrap_or_else(|| {
            if self.signal.is_time() {
                return format!("the mission ends after {most} s: `time_limit_s` can be longer");
            }
            format!("write a number from {least} to {most}")
        })
    }

    /// Why a condition never holds, or always does.
    pub(in crate::behavior) fn why(&self) -> String {
        let meant = self.meant().map(|meant| format!("; {meant}"));
        format!("{}{}", self.domain(), meant.unwrap_or_default())
    }

    /// What the signal can be.
    fn domain(&self) -> String {
        let (least, most) = self.reach;
        format!("`{}` is {}, from {least} to {most}", self.name, self.unit().0)
    }

    /// The number in the signal's unit, if it was meant in one that people use for the same.
    fn meant(&self) -> Option<String> {
        let (least, most) = self.reach;
        self.unit().1.iter().find_map(|(symbol, parts)| {
            let number = self.number / parts;
            let fits = (least..=most).contains(&number);
            fits.then(|| format!("{} {symbol} are {number}", self.number))
        })
    }

    /// How messages name the unit that conditions have, and smaller ones of its kind: how many of
    /// them it has.
    fn unit(&self) -> (&'static str, &'static [(&'static str, f64)]) {
        match self.signal.unit() {
            _ if self.signal.is_time() => ("in seconds", &[]),
            Unit::Truth | Unit::Number => ("a number", &[]),
            Unit::Percent => ("in percent", &[]),
            Unit::Metres => ("in metres", &[("cm", 100.0), ("mm", 1000.0)]),
            Unit::Radians => ("in degrees", &[]),
            Unit::RadiansPerSecond => ("in degrees a second", &[]),
            Unit::Volts => ("in volts", &[("mV", 1000.0)]),
        }
    }
}

impl Expression {
    /// Each signal that is compared with a number, and how: the signal stands first.
    fn comparisons(&self) -> impl Iterator<Item = (Op, Word, f64, Comparison)> {
        (0..self.ops.len()).filter_map(|at| compared(&self.ops[at..]))
    }

    /// A comparison of a signal with a number that it cannot be in a mission that lasts
    /// `time_limit_s`: the first one that always holds, or never, as is asked; else the first.
    ///
    /// Places and ways have no bound that a robot could not pass, so nothing is said of them.
    pub(in crate::behavior) fn beyond(
        &self,
        time_limit_s: f64,
        holds: Option<bool>,
    ) -> Option<Beyond> {
        let found = || {
            self.comparisons().filter_map(|(op, signal, number, comparison)| {
                let reach = if signal.is_time() { (0.0, time_limit_s) } else { signal.reach() };
                let (least, most) = reach;
                let beyond = || Beyond { name: self.name_of(op), signal, number, reach };
                let is_beyond = number < least || number > most;
                is_beyond.then(|| (comparison.of(least, number), beyond()))
            })
        };
        let asked = found().find(|(always, _)| Some(*always) == holds);
        asked.or_else(|| found().next()).map(|(_, beyond)| beyond)
    }

    /// The first question whether something measured is exactly a number: what is wrong, and what
    /// to do about it. The ends of what it can be are met, as where a sensor hears nothing.
    pub(in crate::behavior) fn exactly(&self) -> Option<(String, String)> {
        self.comparisons().find_map(|(op, signal, number, comparison)| {
            let (least, most) = signal.reach();
            let is_end = number <= least || number >= most;
            if comparison != Comparison::Equal || is_end || !is_measured(signal) {
                return None;
            }
            let name = self.name_of(op);
            Some((
                format!("`{name}` is measured, and hardly ever exactly {number}"),
                format!("write `{name} >= {number}` or `{name} <= {number}`"),
            ))
        })
    }

    /// True where it compares a variable with a number.
    pub(in crate::behavior) fn compares(&self, variable: u8) -> bool {
        let is_number = |op: &Op| matches!(op, Op::Number(_) | Op::Named { .. });
        self.ops.windows(3).any(|ops| match ops {
            [one, other, Op::Infix(Infix::Compare(_))] => {
                let asks = |op: &Op| op.variable() == Some(variable);
                asks(one) && is_number(other) || is_number(one) && asks(other)
            }
            _ => false,
        })
    }

    /// The first comparison by size of a signal that is one of several things, such as a colour:
    /// what is wrong, and what to do about it.
    pub(in crate::behavior) fn unordered(&self) -> Option<(String, String)> {
        self.comparisons().find_map(|(op, signal, number, comparison)| {
            let mut values = signal.channel?.quantity().values();
            let is_equality = matches!(comparison, Comparison::Equal | Comparison::NotEqual);
            let first = values.clone().next().filter(|_| !is_equality)?.0;
            let value =
                values.find(|row| Comparison::Equal.of(row.1, number)).map_or(first, |row| row.0);
            let name = self.name_of(op);
            Some((
                format!("`{name}` is one of several things, of which none is more than another"),
                format!("write `{name} == {value}` or `{name} != {value}`; several with `or`"),
            ))
        })
    }
}

/// What a number is compared with is measured, and meets it by chance alone.
fn is_measured(signal: Word) -> bool {
    let units = [Unit::Metres, Unit::Radians, Unit::RadiansPerSecond, Unit::Volts];
    signal.is_time() || units.contains(&signal.unit())
}

/// A signal and a number that are compared at the beginning of some operations, and how.
fn compared(ops: &[Op]) -> Option<(Op, Word, f64, Comparison)> {
    let (one, rest) = operand(ops)?;
    let (other, rest) = operand(rest)?;
    let Some(Op::Infix(Infix::Compare(comparison))) = rest.first() else { return None };
    match (one, other) {
        (Operand::Signal(op, signal), Operand::Number(number)) => {
            Some((op, signal, number, *comparison))
        }
        (Operand::Number(number), Operand::Signal(op, signal)) => {
            Some((op, signal, number, comparison.exchanged()))
        }
        _ => None,
    }
}

enum Operand {
    Signal(Op, Word),
    Number(f64),
}

/// A signal or a number at the beginning of some operations, and what follows it.
fn operand(ops: &[Op]) -> Option<(Operand, &[Op])> {
    match *ops {
        [op @ (Op::Signal(_) | Op::Own { .. }), ref rest @ ..] => {
            Some((Operand::Signal(op, op.word()?), rest))
        }
        [Op::Number(value) | Op::Named { value, .. }, Op::Negate, ref rest @ ..] => {
            Some((Operand::Number(-value), rest))
        }
        [Op::Number(value) | Op::Named { value, .. }, ref rest @ ..] => {
            Some((Operand::Number(value), rest))
        }
        _ => None,
    }
}
