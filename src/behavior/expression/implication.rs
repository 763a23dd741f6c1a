//! What a condition claims, so far as can be known before anything runs: can it hold at all, does
//! it always hold, does it hold only where another one does.
//!
//! A condition is made of *terms*: signals, and pieces of arithmetic or logic that are taken as
//! they stand. Its truth changes only where a term passes a number that it is compared with. So a
//! claim about all values is one about a few: each such number, what is next to it on both sides,
//! the ends of what the term can be, and that it is not known. A claim is made where it is so for
//! all of their combinations; where those are too many, none is made.
//!
//! # Not here
//!
//! No algebra: `2 * range_m` is a term of its own, and no claim connects it with `range_m`.
//!
//! # What we count on
//!
//! A signal's value is never NaN ([`super::super::Signals::set`]); only a piece of arithmetic may
//! be.

use super::evaluation::{apply, evaluate};
use super::{Expression, Infix, Kind, Op};
use crate::behavior::blackboard::Blackboard;

/// More steps, all combinations together, are not looked at.
const MOST: usize = 16_384;

/// What is known of one condition: how its truth follows from its terms.
#[derive(Debug, Clone, Default)]
pub(in crate::behavior) struct Claims {
    /// In postfix order.
    steps: Vec<Step>,
    terms: Vec<Term>,
}

#[derive(Debug, Clone, Copy)]
enum Step {
    Number(f64),
    /// The value of a term, by its place.
    Term(usize),
    Not,
    Infix(Infix),
}

#[derive(Debug, Clone)]
struct Term {
    /// Without the places of its names, so that two expressions can share it.
    ops: Vec<Op>,
    /// A term that is only true or false has none.
    compared_with: Vec<f64>,
}

/// What a part of an expression is.
#[derive(Debug, Clone, Copy)]
enum Is {
    Constant(f64),
    /// A term that is a number, by its place.
    Number(usize),
    Truth,
}

impl Claims {
    /// What a condition claims; of a number, nothing.
    pub(in crate::behavior) fn of(condition: &Expression) -> Self {
        let ops = &condition.ops;
        // Of each part: what it is, and where its operations and its steps begin.
        let (mut claims, mut parts) = (Self::default(), Vec::<(Is, usize, usize)>::new());
        for (at, op) in ops.iter().enumerate() {
            let operands = parts.split_off(parts.len().saturating_sub(op.takes()));
            let (first, step) = operands
                .first()
                .map_or((at, claims.steps.len()), |(_, first, step)| (*first, *step));
            let operands: Vec<Is> = operands.iter().map(|(is, ..)| *is).collect();
            let is = claims.take(*op, &operands, &ops[first..=at], step);
            parts.push((is, first, step));
        }
        if condition.kind == Kind::Number {
            let number = claims.piece(ops, 0);
            claims.compared(number, 0.0);
        }
        claims
    }

    /// True where it can never hold.
    pub(in crate::behavior) fn is_never(&self) -> bool {
        !self.can_be(|values| values.iter().all(|value| holds(*value)))
    }

    /// True where it holds whenever its signals are known.
    pub(in crate::behavior) fn is_always(&self) -> bool {
        !self.can_be(|values| values.iter().all(|value| *value == Some(0.0)))
    }

    /// True where `other` holds in every case in which this one does.
    pub(in crate::behavior) fn implies(&self, other: &Self) -> bool {
        let mut both = self.clone();
        let places: Vec<usize> = other
            .terms
            .iter()
            .map(|term| {
                let place = both.term(&term.ops);
                both.terms[place].compared_with.extend(&term.compared_with);
                place
            })
            .collect();
        both.steps.extend(other.steps.iter().map(|step| match *step {
            Step::Term(term) => Step::Term(places[term]),
            step => step,
        }));
        !both.can_be(|values| matches!(*values, [this, other] if holds(this) && !holds(other)))
    }

    /// Whether something can be so of what the steps come to; true as well where there are too many
    /// combinations to look at.
    fn can_be(&self, is_so: impl Fn(&[Option<f64>]) -> bool) -> bool {
        let values: Vec<_> = self.terms.iter().map(Term::values).collect();
        let count = values.iter().fold(1_usize, |count, values| count.saturating_mul(values.len()));
        count.saturating_mul(self.steps.len()) > MOST
            || (0..count).any(|mut combination| {
                let mut one_of = |values: &Vec<Option<f64>>| {
                    let value = values[combination % values.len()];
                    combination /= values.len();
                    value
                };
                is_so(&self.evaluate(&values.iter().map(&mut one_of).collect::<Vec<_>>()))
            })
    }

    /// Takes one operation after its operands; `piece` are both, `step` is where their steps begin.
    fn take(&mut self, op: Op, operands: &[Is], piece: &[Op], step: usize) -> Is {
        match (op, operands) {
            (Op::Number(value) | Op::Named { value, .. }, _) => return self.constant(value, step),
            (Op::Truth(truth), _) => {
                self.constant(f64::from(truth), step);
                return Is::Truth;
            }
            (Op::Not | Op::Infix(Infix::And | Infix::Or), _) => {
                // A number among them, of a sensor that is not known, is false where it is 0.
                for operand in operands {
                    self.compared(*operand, 0.0);
                }
            }
            (Op::Infix(Infix::Compare(_)), [Is::Number(_), Is::Number(_)]) => {
                return self.piece(piece, step);
            }
            (
                Op::Infix(Infix::Compare(_)),
                [number, Is::Constant(at)] | [Is::Constant(at), number],
            ) => {
                self.compared(*number, *at);
            }
            (Op::Infix(Infix::Compare(_)), _) => {}
            (Op::Negate | Op::Infix(_) | Op::Call { .. }, _) => {
                let is_pure = !matches!(op, Op::Call { function, .. } if !function.is_pure());
                let is_constant =
                    is_pure && operands.iter().all(|is| matches!(is, Is::Constant(_)));
                let board = Blackboard::default();
                let value = is_constant.then(|| evaluate(piece, board.seen_by(0, 0))).flatten();
                return match value {
                    Some(value) => self.constant(value, step),
                    None => self.piece(piece, step),
                };
            }
            _ => return self.piece(piece, step),
        }
        self.steps.push(if let Op::Infix(infix) = op { Step::Infix(infix) } else { Step::Not });
        Is::Truth
    }

    fn compared(&mut self, operand: Is, with: f64) {
        if let Is::Number(term) = operand {
            self.terms[term].compared_with.push(with);
        }
    }

    fn constant(&mut self, value: f64, step: usize) -> Is {
        self.steps.truncate(step);
        self.steps.push(Step::Number(value));
        Is::Constant(value)
    }

    /// Takes a piece as it stands, in place of the steps that it has.
    fn piece(&mut self, piece: &[Op], step: usize) -> Is {
        let term = self.term(&without_names(piece));
        self.steps.truncate(step);
        self.steps.push(Step::Term(term));
        let is_truth = match piece {
            [Op::InState { .. }] | [.., Op::Infix(Infix::Compare(_))] => true,
            [only] => only.word().is_some_and(|word| word.is_truth),
            _ => false,
        };
        if is_truth { Is::Truth } else { Is::Number(term) }
    }

    /// The place of a term.
    fn term(&mut self, ops: &[Op]) -> usize {
        let known = self.terms.iter().position(|known| known.ops == ops);
        known.unwrap_or_else(|| {
            self.terms.push(Term { ops: ops.to_vec(), compared_with: Vec::new() });
            self.terms.len() - 1
        })
    }

    /// What the steps come to where the terms are these.
    fn evaluate(&self, values: &[Option<f64>]) -> Vec<Option<f64>> {
        let mut stack = Vec::new();
        for step in &self.steps {
            let value = match *step {
                Step::Number(value) => Some(value),
                Step::Term(term) => values[term],
                Step::Not => stack.pop().flatten().map(|truth| f64::from(truth == 0.0)),
                Step::Infix(infix) => {
                    let right = stack.pop().flatten();
                    apply(infix, stack.pop().flatten(), right)
                }
            };
            stack.push(value);
        }
        stack
    }
}

impl Term {
    /// The values that stand for all of its; one that may be lost can be none.
    fn values(&self) -> Vec<Option<f64>> {
        let only = if let [only] = self.ops.as_slice() { Some(only) } else { None };
        let (low, high) =
            only.and_then(Op::word).map_or((f64::NEG_INFINITY, f64::INFINITY), |word| word.domain);
        let near = self.compared_with.iter().flat_map(|at| [at.next_down(), *at, at.next_up()]);
        let mut values: Vec<f64> = near.chain([low, high]).collect();
        if self.compared_with.is_empty() {
            values = vec![0.0, 1.0];
        }
        values.retain(|value| (low..=high).contains(value));
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
}

fn holds(value: Option<f64>) -> bool {
    value.is_some_and(|value| value != 0.0)
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
