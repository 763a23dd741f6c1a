//! What a condition claims, so far as can be known before anything runs: can it hold at all, does
//! it always hold, does it hold only where another one does.
//!
//! A condition becomes a list of cases, in each of which some terms lie in some sets. A term is a
//! signal or, where a comparison is not with a multiple of one signal, that whole piece of the
//! expression, taken as it stands. A claim is made only where it is certain; a condition that is
//! too involved yields none.
//!
//! # What we count on
//!
//! - A signal's value is never NaN ([`super::super::Signals::set`]); only a piece of arithmetic may
//!   be.
//! - Where a comparison was turned round by arithmetic (`2 * range_m < 0.5`), its bound is taken
//!   with a margin of [`MARGIN`], so that rounding makes no claim false.

use super::evaluation::evaluate;
use super::{Comparison, Expression, Infix, Op};
use crate::behavior::blackboard::Blackboard;
use crate::behavior::signals::Input;

/// Relative margin of a bound that was computed.
const MARGIN: f64 = 1e-9;

/// More cases, or more terms in one case, are not followed up.
const MOST: usize = 8;

/// What is known of one condition.
#[derive(Debug, Clone)]
pub(in crate::behavior) struct Claims {
    /// The cases in which it holds.
    holds: Vec<Case>,
    /// The cases in which it does not.
    fails: Vec<Case>,
}

/// Terms, each with the set in which it lies; all of them at once.
type Case = Vec<(Term, Set)>;

#[derive(Debug, Clone, PartialEq)]
enum Term {
    Input(Input),
    /// A piece of an expression, as it stands.
    Piece(Vec<Op>),
}

/// An interval with open or closed ends, less single points.
#[derive(Debug, Clone, PartialEq)]
struct Set {
    low: f64,
    low_open: bool,
    high: f64,
    high_open: bool,
    except: Vec<f64>,
    /// How far a bound may be off.
    margin: f64,
}

impl Claims {
    /// What a condition claims; of a number, nothing.
    pub(in crate::behavior) fn of(condition: &Expression) -> Self {
        let ops = &condition.ops;
        let mut stack: Vec<Subterm> = Vec::new();
        for (at, op) in ops.iter().enumerate() {
            let part = match op {
                Op::Infix(infix) => {
                    let right = stack.pop();
                    stack
                        .pop()
                        .zip(right)
                        .map(|(left, right)| infix_part(*infix, left, right, ops, at))
                }
                Op::Negate | Op::Not => stack.pop().map(|inner| prefix_part(*op, inner, ops, at)),
                Op::Call { function, .. } => {
                    let first = stack.len().saturating_sub(function.takes());
                    let arguments: Vec<Subterm> = stack.drain(first..).collect();
                    Some(call_part(function.is_pure(), &arguments, ops, at))
                }
                leaf => Some(leaf_part(*leaf, at)),
            };
            stack.extend(part);
        }
        match stack.pop() {
            Some(Subterm { meaning: Meaning::Truth(claims), .. }) => claims,
            _ => Self::piece(ops),
        }
    }

    /// True where it can never hold.
    pub(in crate::behavior) fn is_never(&self) -> bool {
        self.holds.iter().all(is_impossible)
    }

    /// True where it holds whenever its signals are known.
    pub(in crate::behavior) fn is_always(&self) -> bool {
        self.fails.iter().all(is_impossible)
    }

    /// True where `other` holds in every case in which this one does.
    pub(in crate::behavior) fn implies(&self, other: &Self) -> bool {
        self.holds.iter().all(|case| {
            is_impossible(case) || other.holds.iter().any(|wider| is_within(case, wider))
        })
    }

    fn known(truth: bool) -> Self {
        let (always, never) = (vec![Case::new()], Vec::new());
        if truth {
            Self { holds: always, fails: never }
        } else {
            Self { holds: never, fails: always }
        }
    }

    fn term(term: Term, holds: Set, fails: Set) -> Self {
        Self { holds: vec![vec![(term.clone(), holds)]], fails: vec![vec![(term, fails)]] }
    }

    fn piece(ops: &[Op]) -> Self {
        Self::term(Term::Piece(ops.to_vec()), Set::point(1.0), Set::point(0.0))
    }

    fn not(self) -> Self {
        Self { holds: self.fails, fails: self.holds }
    }

    /// Both hold; `None` where that is too involved.
    fn and(&self, other: &Self) -> Option<Self> {
        let fails = [self.fails.as_slice(), &other.fails].concat();
        let holds: Vec<Case> = self
            .holds
            .iter()
            .flat_map(|left| other.holds.iter().map(|right| together(left, right)))
            .collect();
        let simple = fails.len() <= MOST
            && holds.len() <= MOST
            && holds.iter().all(|case| case.len() <= MOST);
        simple.then_some(Self { holds, fails })
    }

    /// At least one holds; `None` where that is too involved.
    fn or(&self, other: &Self) -> Option<Self> {
        self.clone().not().and(&other.clone().not()).map(Self::not)
    }
}

/// A part of an expression while it is looked at.
struct Subterm {
    /// Where its operations begin.
    start: usize,
    meaning: Meaning,
}

enum Meaning {
    Constant(f64),
    Linear(Linear),
    /// Some other number.
    Number,
    Truth(Claims),
}

/// `scale * input + offset`
#[derive(Clone, Copy)]
struct Linear {
    input: Input,
    scale: f64,
    offset: f64,
    /// How many operations made it: without one, rounding has no part in it.
    steps: u8,
}

fn leaf_part(op: Op, start: usize) -> Subterm {
    let leaf = |input: Input| match input.word() {
        Some(word) if word.is_truth => {
            Meaning::Truth(Claims::term(Term::Input(input), Set::point(1.0), Set::point(0.0)))
        }
        _ => Meaning::Linear(Linear { input, scale: 1.0, offset: 0.0, steps: 0 }),
    };
    let meaning = match op {
        Op::Number(value) | Op::Named { value, .. } => Meaning::Constant(value),
        Op::Truth(truth) => Meaning::Truth(Claims::known(truth)),
        Op::Signal(input) | Op::Own { input, .. } => leaf(input),
        Op::InState { .. } => Meaning::Truth(Claims::piece(&[op])),
        Op::Negate | Op::Not | Op::Infix(_) | Op::Call { .. } => Meaning::Number,
    };
    Subterm { start, meaning }
}

/// A function: of constants it is one, of anything else some number.
fn call_part(is_pure: bool, arguments: &[Subterm], ops: &[Op], at: usize) -> Subterm {
    let start = arguments.first().map_or(at, |first| first.start);
    let constant = |argument: &Subterm| matches!(argument.meaning, Meaning::Constant(_));
    let meaning = match is_pure && arguments.iter().all(constant) {
        true => constant_of(&ops[start..=at]),
        false => Meaning::Number,
    };
    Subterm { start, meaning }
}

/// What operations on constants come to.
fn constant_of(piece: &[Op]) -> Meaning {
    evaluate(piece, Blackboard::default().seen_by(0, 0)).map_or(Meaning::Number, Meaning::Constant)
}

fn prefix_part(op: Op, inner: Subterm, ops: &[Op], at: usize) -> Subterm {
    let meaning = match (op, inner.meaning) {
        (Op::Not, Meaning::Truth(claims)) => Meaning::Truth(claims.not()),
        (Op::Negate, Meaning::Constant(value)) => Meaning::Constant(-value),
        (Op::Negate, Meaning::Linear(linear)) => {
            Meaning::Linear(Linear { scale: -linear.scale, offset: -linear.offset, ..linear })
        }
        (Op::Not, _) => Meaning::Truth(Claims::piece(&ops[inner.start..=at])),
        _ => Meaning::Number,
    };
    Subterm { start: inner.start, meaning }
}

fn infix_part(infix: Infix, left: Subterm, right: Subterm, ops: &[Op], at: usize) -> Subterm {
    let start = left.start;
    let piece = &ops[start..=at];
    let middle = right.start;
    let meaning = match (infix, left.meaning, right.meaning) {
        (Infix::And | Infix::Or, Meaning::Truth(a), Meaning::Truth(b)) => {
            let both = if infix == Infix::And { a.and(&b) } else { a.or(&b) };
            Meaning::Truth(both.unwrap_or_else(|| Claims::piece(piece)))
        }
        (Infix::Compare(comparison), Meaning::Truth(a), Meaning::Truth(b)) => {
            let same = a
                .and(&b)
                .zip(a.clone().not().and(&b.not()))
                .and_then(|(both, none)| both.or(&none));
            let same = same.unwrap_or_else(|| Claims::piece(piece));
            Meaning::Truth(if comparison == Comparison::NotEqual { same.not() } else { same })
        }
        (Infix::Compare(comparison), Meaning::Constant(a), Meaning::Constant(b)) => {
            Meaning::Truth(Claims::known(comparison.of(a, b)))
        }
        (Infix::Compare(comparison), number, Meaning::Constant(bound)) => {
            Meaning::Truth(bounded(comparison, &number, &ops[start..middle], bound, piece))
        }
        (Infix::Compare(comparison), Meaning::Constant(bound), number) => {
            Meaning::Truth(bounded(comparison.turned(), &number, &ops[middle..at], bound, piece))
        }
        (Infix::Compare(_) | Infix::And | Infix::Or, _, _) => Meaning::Truth(Claims::piece(piece)),
        (_, left, right) => arithmetic(infix, left, right, piece),
    };
    Subterm { start, meaning }
}

/// A sum, difference, product or quotient.
fn arithmetic(infix: Infix, left: Meaning, right: Meaning, piece: &[Op]) -> Meaning {
    match (infix, left, right) {
        (_, Meaning::Constant(_), Meaning::Constant(_)) => constant_of(piece),
        (_, Meaning::Linear(linear), Meaning::Constant(constant)) => {
            scaled(infix, linear, constant)
        }
        (Infix::Add | Infix::Multiply, Meaning::Constant(constant), Meaning::Linear(linear)) => {
            scaled(infix, linear, constant)
        }
        (Infix::Subtract, Meaning::Constant(constant), Meaning::Linear(linear)) => {
            let turned = Linear { scale: -linear.scale, offset: -linear.offset, ..linear };
            scaled(Infix::Add, turned, constant)
        }
        _ => Meaning::Number,
    }
}

/// A linear term with a constant added, subtracted, multiplied or divided by.
fn scaled(infix: Infix, linear: Linear, constant: f64) -> Meaning {
    let Linear { scale, offset, .. } = linear;
    let (scale, offset) = match infix {
        Infix::Add => (scale, offset + constant),
        Infix::Subtract => (scale, offset - constant),
        Infix::Multiply => (scale * constant, offset * constant),
        Infix::Divide => (scale / constant, offset / constant),
        _ => return Meaning::Number,
    };
    // Each step rounds by at most 1e3 * 2^-53, which comes to less than the margin after division
    // by the scale.
    let steps = linear.steps + 1;
    let sound = steps <= 4 && (1e-3..=1e3).contains(&scale.abs()) && offset.abs() <= 1e3;
    if sound { Meaning::Linear(Linear { scale, offset, steps, ..linear }) } else { Meaning::Number }
}

/// What a comparison of a number that is not constant with one that is claims.
fn bounded(
    comparison: Comparison,
    number: &Meaning,
    operand: &[Op],
    bound: f64,
    whole: &[Op],
) -> Claims {
    let Meaning::Linear(linear) = number else {
        // The piece may come to NaN, where the opposite comparison fails too.
        let term = Term::Piece(operand.to_vec());
        let holds = vec![vec![(term, Set::of(comparison, bound, 0.0))]];
        return Claims { holds, ..Claims::piece(whole) };
    };
    let term = Term::Input(linear.input);
    let turned = if linear.scale < 0.0 { comparison.turned() } else { comparison };
    let at = (bound - linear.offset) / linear.scale;
    let margin = if linear.steps == 0 {
        0.0
    } else {
        MARGIN * (1.0 + at.abs() + (linear.offset / linear.scale).abs())
    };
    if at.is_nan() || margin.is_nan() {
        return Claims::piece(whole);
    }
    Claims::term(term, Set::of(turned, at, margin), Set::of(turned.negated(), at, margin))
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

    /// What holds where it does not, unless one side is NaN.
    fn negated(self) -> Self {
        match self {
            Self::Less => Self::GreaterOrEqual,
            Self::LessOrEqual => Self::Greater,
            Self::Greater => Self::LessOrEqual,
            Self::GreaterOrEqual => Self::Less,
            Self::Equal => Self::NotEqual,
            Self::NotEqual => Self::Equal,
        }
    }
}

impl Set {
    const ALL: Self = Self {
        low: f64::NEG_INFINITY,
        low_open: false,
        high: f64::INFINITY,
        high_open: false,
        except: Vec::new(),
        margin: 0.0,
    };

    fn point(at: f64) -> Self {
        Self { low: at, high: at, ..Self::ALL }
    }

    /// The numbers that compare so with `bound`.
    fn of(comparison: Comparison, bound: f64, margin: f64) -> Self {
        let all = Self { margin, ..Self::ALL };
        match comparison {
            Comparison::Less => Self { high: bound, high_open: true, ..all },
            Comparison::LessOrEqual => Self { high: bound, ..all },
            Comparison::Greater => Self { low: bound, low_open: true, ..all },
            Comparison::GreaterOrEqual => Self { low: bound, ..all },
            Comparison::Equal => Self { low: bound, high: bound, ..all },
            Comparison::NotEqual => Self { except: vec![bound], ..all },
        }
    }

    #[expect(clippy::float_cmp, reason = "equal ends of intervals are the very same number")]
    fn and(&self, other: &Self) -> Self {
        let (low, low_open) = match self.low == other.low {
            true => (self.low, self.low_open || other.low_open),
            false if self.low > other.low => (self.low, self.low_open),
            false => (other.low, other.low_open),
        };
        let (high, high_open) = match self.high == other.high {
            true => (self.high, self.high_open || other.high_open),
            false if self.high < other.high => (self.high, self.high_open),
            false => (other.high, other.high_open),
        };
        let except = [self.except.as_slice(), &other.except].concat();
        Self { low, low_open, high, high_open, except, margin: self.margin.max(other.margin) }
    }

    #[expect(clippy::float_cmp, reason = "equal ends of intervals are the very same number")]
    fn is_empty(&self) -> bool {
        let margin = 2.0 * self.margin;
        let hole = self.low_open || self.high_open || self.except.contains(&self.low);
        self.low > self.high + margin || (margin == 0.0 && self.low == self.high && hole)
    }

    /// True where each of its numbers is in `wider` too.
    #[expect(clippy::float_cmp, reason = "equal ends of intervals are the very same number")]
    fn is_within(&self, wider: &Self) -> bool {
        let margin = self.margin + wider.margin;
        let exact = margin == 0.0;
        let low = wider.low == f64::NEG_INFINITY && !wider.low_open
            || wider.low + margin < self.low
            || exact && wider.low == self.low && (self.low_open || !wider.low_open);
        let high = wider.high == f64::INFINITY && !wider.high_open
            || wider.high - margin > self.high
            || exact && wider.high == self.high && (self.high_open || !wider.high_open);
        let holes = wider.except.iter().all(|hole| {
            hole + margin < self.low
                || hole - margin > self.high
                || exact
                    && (*hole == self.low && self.low_open || *hole == self.high && self.high_open)
                || exact && self.except.contains(hole)
        });
        low && high && holes
    }
}

impl Term {
    /// The values it can have.
    fn domain(&self) -> Set {
        match self {
            Self::Input(input) => input.word().map_or(Set::ALL, |word| Set {
                low: word.domain.0,
                high: word.domain.1,
                ..Set::ALL
            }),
            Self::Piece(_) => Set::ALL,
        }
    }
}

fn together(left: &Case, right: &Case) -> Case {
    let mut case = left.clone();
    for (term, set) in right {
        match case.iter_mut().find(|(known, _)| known == term) {
            Some((_, known)) => *known = known.and(set),
            None => case.push((term.clone(), set.clone())),
        }
    }
    case
}

fn is_impossible(case: &Case) -> bool {
    case.iter().any(|(term, set)| set.and(&term.domain()).is_empty())
}

/// True where all that `wider` asks for is so in `case`; what `wider` needs to know must be known
/// there.
fn is_within(case: &Case, wider: &Case) -> bool {
    wider.iter().all(|(term, set)| match case.iter().find(|(known, _)| known == term) {
        Some((_, known)) => known.and(&term.domain()).is_within(set),
        None => {
            matches!(term, Term::Input(q) if q.is_always_known()) && term.domain().is_within(set)
        }
    })
}
