//! What a condition claims, so far as can be known before anything runs: can it hold at all, does
//! it always hold, does it hold only where another one does.
//!
//! A condition is made of *terms*: signals, and pieces of arithmetic or logic that are taken as
//! they stand. Its truth changes only where a term passes a number that it is compared with. So a
//! claim about all values is one about a few: each such number, what is next to it on both sides,
//! the ends of what the term can be, and that it is not known. A claim is made where it is so for
//! all of their combinations; where those are too many, none is made.
//!
//! # What we count on
//!
//! - A signal's value is never NaN ([`super::super::Signals::set`]); only a piece of arithmetic may
//!   be.
//! - Where a comparison was turned round by arithmetic (`2 * range_m < 0.5`), it may come out
//!   either way within [`MARGIN`] of its number, so that rounding makes no claim false.

use super::evaluation::evaluate;
use super::{Comparison, Expression, Infix, Op};
use crate::behavior::blackboard::Blackboard;

/// Relative margin of a number that was computed.
const MARGIN: f64 = 1e-9;

/// More steps, all combinations together, are not looked at.
const MOST: usize = 16_384;

/// What is known of one condition: how its truth follows from that of comparisons, in postfix
/// order.
#[derive(Debug, Clone, Default)]
pub(in crate::behavior) struct Claims {
    steps: Vec<Step>,
    /// Signals and pieces of the expression, without the places of their names.
    terms: Vec<Vec<Op>>,
}

#[derive(Debug, Clone, Copy)]
enum Step {
    Known(bool),
    /// A term that is true or false.
    Is(usize),
    /// A term that is compared with a number, which may be off by a margin.
    Compares {
        term: usize,
        comparison: Comparison,
        at: f64,
        margin: f64,
    },
    Not,
    And,
    Or,
    /// Both are true, or both are false.
    Same,
}

/// A part of an expression while it is looked at.
struct Part {
    /// Where its operations begin, and its steps.
    start: usize,
    steps: usize,
    /// Of a number; a truth has steps instead.
    number: Option<Linear>,
}

/// `scale * term + offset`; without a term the offset alone, a constant.
struct Linear {
    term: Option<Vec<Op>>,
    scale: f64,
    offset: f64,
    /// How many operations made it: without one, rounding has no part in it.
    steps: u8,
}

impl Claims {
    /// What a condition claims; of a number, nothing.
    pub(in crate::behavior) fn of(condition: &Expression) -> Self {
        let ops = &condition.ops;
        let (mut claims, mut stack) = (Self::default(), Vec::<Part>::new());
        for (at, op) in ops.iter().enumerate() {
            let parts = stack.split_off(stack.len().saturating_sub(op.takes()));
            let (start, steps) =
                parts.first().map_or((at, claims.steps.len()), |first| (first.start, first.steps));
            let number = claims.take(*op, parts, &ops[start..=at], steps);
            stack.push(Part { start, steps, number });
        }
        if stack.pop().is_none_or(|whole| whole.number.is_some()) {
            claims.piece(ops, 0);
        }
        claims
    }

    /// True where it can never hold.
    pub(in crate::behavior) fn is_never(&self) -> bool {
        !self.can_be(|truths| truths.iter().all(|truth| truth & TRUE != 0))
    }

    /// True where it holds whenever its signals are known.
    pub(in crate::behavior) fn is_always(&self) -> bool {
        !self.can_be(|truths| truths.iter().all(|truth| truth & FALSE != 0))
    }

    /// True where `other` holds in every case in which this one does.
    pub(in crate::behavior) fn implies(&self, other: &Self) -> bool {
        let mut both = self.clone();
        for mut step in other.steps.iter().copied() {
            if let Step::Is(term) | Step::Compares { term, .. } = &mut step {
                *term = both.term(other.terms[*term].clone());
            }
            both.steps.push(step);
        }
        !both.can_be(
            |truths| matches!(truths, [this, other] if this & TRUE != 0 && other & !TRUE != 0),
        )
    }

    /// Whether something can be so of what the steps come to; true as well where there are too many
    /// combinations to look at.
    fn can_be(&self, is_so: impl Fn(&[Truth]) -> bool) -> bool {
        let values: Vec<_> = (0..self.terms.len()).map(|term| self.values(term)).collect();
        let count = values.iter().fold(1_usize, |count, values| count.saturating_mul(values.len()));
        count.saturating_mul(self.steps.len()) > MOST
            || (0..count).any(|mut combination| {
                let mut one_of = |values: &Vec<Option<f64>>| {
                    let value = values[combination % values.len()];
                    combination /= values.len();
                    value
                };
                is_so(&self.truths(&values.iter().map(&mut one_of).collect::<Vec<_>>()))
            })
    }

    /// Takes one operation with its operands: the number that it gives, or the steps to its truth.
    fn take(&mut self, op: Op, parts: Vec<Part>, piece: &[Op], steps: usize) -> Option<Linear> {
        let truths = parts.iter().all(|part| part.number.is_none());
        let numbers: Vec<Linear> = parts.into_iter().filter_map(|part| part.number).collect();
        let step = match (op, <[Linear; 2]>::try_from(numbers)) {
            (Op::Number(value) | Op::Named { value, .. }, _) => {
                return Some(Linear::constant(value));
            }
            (Op::Signal(_) | Op::Own { .. }, _) if op.word().is_none_or(|word| !word.is_truth) => {
                return Some(Linear::of(piece));
            }
            (Op::Truth(truth), _) => Step::Known(truth),
            (Op::Not, _) if truths => Step::Not,
            (Op::Infix(Infix::And), _) if truths => Step::And,
            (Op::Infix(Infix::Or), _) if truths => Step::Or,
            (Op::Infix(Infix::Compare(comparison)), _) if truths => {
                self.steps.push(Step::Same);
                if comparison == Comparison::Equal {
                    return None;
                }
                Step::Not
            }
            (Op::Infix(Infix::Compare(comparison)), Ok([left, right])) => {
                match self.compares(comparison, left, right) {
                    Some(step) => step,
                    None => return self.piece(piece, steps),
                }
            }
            (Op::Infix(infix), Ok([left, right])) => {
                return Some(left.with(infix, right).unwrap_or_else(|| Linear::of(piece)));
            }
            (Op::Negate, Err(numbers)) => {
                let number = numbers.into_iter().next()?;
                return Some(Linear { scale: -number.scale, offset: -number.offset, ..number });
            }
            (Op::Call { function, .. }, numbers) => {
                let all: Vec<Linear> = numbers.map_or_else(|few| few, Vec::from);
                let is_known = function.is_pure() && all.iter().all(|number| number.term.is_none());
                let board = Blackboard::default();
                let known = is_known.then(|| evaluate(piece, board.seen_by(0, 0))).flatten();
                return Some(known.map_or_else(|| Linear::of(piece), Linear::constant));
            }
            _ => return self.piece(piece, steps),
        };
        self.steps.push(step);
        None
    }

    /// A comparison of a term with a number; `None` where neither side is one.
    fn compares(&mut self, comparison: Comparison, left: Linear, right: Linear) -> Option<Step> {
        let (number, bound, comparison) = match (&left.term, &right.term) {
            (None, None) => return Some(Step::Known(comparison.of(left.offset, right.offset))),
            (Some(_), None) => (left, right.offset, comparison),
            (None, Some(_)) => (right, left.offset, comparison.turned()),
            (Some(_), Some(_)) => return None,
        };
        let Linear { term, scale, offset, steps } = number;
        let comparison = if scale < 0.0 { comparison.turned() } else { comparison };
        let at = (bound - offset) / scale;
        let margin = MARGIN * (1.0 + at.abs() + (offset / scale).abs());
        let margin = if steps == 0 { 0.0 } else { margin };
        let term = self.term(term?);
        (!at.is_nan() && margin.is_finite()).then_some(Step::Compares {
            term,
            comparison,
            at,
            margin,
        })
    }

    /// Takes a piece that is true or false as it stands, in place of the steps that it has.
    fn piece(&mut self, piece: &[Op], steps: usize) -> Option<Linear> {
        self.steps.truncate(steps);
        let term = self.term(without_names(piece));
        self.steps.push(Step::Is(term));
        None
    }

    /// The place of a term.
    fn term(&mut self, term: Vec<Op>) -> usize {
        let known = self.terms.iter().position(|known| *known == term);
        known.unwrap_or_else(|| {
            self.terms.push(term);
            self.terms.len() - 1
        })
    }

    /// The values of a term that stand for all of them; one that may be lost can be none.
    fn values(&self, place: usize) -> Vec<Option<f64>> {
        let term = self.terms[place].as_slice();
        let only = if let [only] = term { Some(only) } else { None };
        let word = only.and_then(Op::word);
        let (low, high) = word.map_or((f64::NEG_INFINITY, f64::INFINITY), |word| word.domain);
        let mut values = Vec::new();
        for step in &self.steps {
            match *step {
                Step::Is(term) if term == place => values.extend([0.0, 1.0]),
                Step::Compares { term, at, margin, .. } if term == place => {
                    let ends = [at - margin, at + margin].into_iter();
                    let near = ends.flat_map(|at| [at.next_down(), at, at.next_up()]);
                    values.extend(near.chain([low, high]));
                }
                _ => {}
            }
        }
        values.retain(|value| (low..=high).contains(value));
        if values.is_empty() {
            // No step that is left asks for it.
            values.push(0.0);
        }
        values.sort_by(f64::total_cmp);
        values.dedup();
        values.extend(only.is_none().then_some(f64::NAN));
        let is_known = match only {
            Some(Op::Signal(input) | Op::Own { input, .. }) => input.is_always_known(),
            Some(Op::InState { .. }) => true,
            _ => false,
        };
        values.into_iter().map(Some).chain((!is_known).then_some(None)).collect()
    }

    /// What the steps can come to where the terms are these.
    fn truths(&self, values: &[Option<f64>]) -> Vec<Truth> {
        let mut stack = Vec::new();
        for step in &self.steps {
            let mut pop = || stack.pop().unwrap_or(UNKNOWN);
            let truth = match *step {
                Step::Known(truth) => known(truth),
                Step::Is(term) => values[term].map_or(UNKNOWN, |is| known(is != 0.0)),
                Step::Compares { term, comparison, at, margin } => match values[term] {
                    None => UNKNOWN,
                    Some(value) if margin > 0.0 && (value - at).abs() <= margin => TRUE | FALSE,
                    Some(value) => known(comparison.of(value, at)),
                },
                Step::Not => not(pop()),
                Step::And => and(pop(), pop()),
                Step::Or => or(pop(), pop()),
                Step::Same => {
                    let (a, b) = (pop(), pop());
                    or(and(a, b), and(not(a), not(b)))
                }
            };
            stack.push(truth);
        }
        stack
    }
}

/// The same operations, which two expressions can share.
fn without_names(ops: &[Op]) -> Vec<Op> {
    let bare = |op: &Op| match *op {
        Op::Own { input, measures, .. } => Op::Own { name: 0, input, measures },
        Op::Named { value, .. } => Op::Number(value),
        Op::InState { machine, first, last, .. } => Op::InState { name: 0, machine, first, last },
        other => other,
    };
    ops.iter().map(bare).collect()
}

impl Linear {
    fn constant(value: f64) -> Self {
        Self { term: None, scale: 0.0, offset: value, steps: 0 }
    }

    /// A signal, or a piece as it stands.
    fn of(piece: &[Op]) -> Self {
        Self { term: Some(without_names(piece)), scale: 1.0, offset: 0.0, steps: 0 }
    }

    /// A sum, difference, product or quotient, where it is linear too.
    fn with(self, infix: Infix, other: Self) -> Option<Self> {
        let (scale, offset) = match (infix, &self.term, &other.term) {
            (Infix::Add | Infix::Subtract, Some(_), Some(_)) => return None,
            (Infix::Add, ..) => (self.scale + other.scale, self.offset + other.offset),
            (Infix::Subtract, ..) => (self.scale - other.scale, self.offset - other.offset),
            (Infix::Multiply, _, None) => (self.scale * other.offset, self.offset * other.offset),
            (Infix::Multiply, None, _) => (other.scale * self.offset, other.offset * self.offset),
            (Infix::Divide, _, None) => (self.scale / other.offset, self.offset / other.offset),
            _ => return None,
        };
        let steps = self.steps + other.steps + 1;
        let Some(term) = self.term.or(other.term) else { return Some(Self::constant(offset)) };
        // Each step rounds by at most 1e3 * 2^-53, which comes to less than the margin after
        // division by the scale.
        let sound = steps <= 4 && (1e-3..=1e3).contains(&scale.abs()) && offset.abs() <= 1e3;
        sound.then_some(Self { term: Some(term), scale, offset, steps })
    }
}

impl Comparison {
    /// The comparison with its sides exchanged.
    fn turned(self) -> Self {
        match self {
            Self::Less => Self::Greater,
            Self::LessOrEqual => Self::GreaterOrEqual,
            Self::Greater => Self::Less,
            Self::GreaterOrEqual => Self::LessOrEqual,
            same => same,
        }
    }
}

/// What a condition can come to: some of these.
type Truth = u8;
const TRUE: Truth = 1;
const FALSE: Truth = 2;
const UNKNOWN: Truth = 4;

fn known(truth: bool) -> Truth {
    if truth { TRUE } else { FALSE }
}

fn not(a: Truth) -> Truth {
    (a & TRUE) << 1 | (a & FALSE) >> 1 | a & UNKNOWN
}

fn and(a: Truth, b: Truth) -> Truth {
    let neither_fails = a & !FALSE != 0 && b & !FALSE != 0;
    a & b & TRUE | (a | b) & FALSE | if neither_fails { (a | b) & UNKNOWN } else { 0 }
}

fn or(a: Truth, b: Truth) -> Truth {
    not(and(not(a), not(b)))
}
