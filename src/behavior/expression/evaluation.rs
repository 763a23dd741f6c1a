//! The value of an expression: one pass over its operations.

use arrayvec::ArrayVec;

use super::{Expression, Infix, Op};
use crate::behavior::blackboard::Scope;

/// Operands that wait while the rest is evaluated: at most one for each level of nesting, and the
/// one in hand. Arguments of functions wait as well; the parser counts.
pub(super) const STACK: usize = Expression::MAX_NESTING + 2;

pub(super) fn evaluate(ops: &[Op], scope: Scope<'_>) -> Option<f64> {
    // Most are a number as it stands, or compare a signal with one: no stack is needed.
    match ops {
        [only] => return operand(only, scope),
        [left, right, Op::Infix(Infix::Compare(comparison))] => {
            let (left, right) = (operand(left, scope)?, operand(right, scope)?);
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
            Op::Call { function, slot } => {
                let first = stack.len().checked_sub(function.takes())?;
                let value = function.of(&stack[first..], *slot, scope);
                stack.truncate(first);
                value
            }
            _ => operand(op, scope),
        };
        stack.try_push(value).ok()?;
    }
    stack.pop()?
}

/// How many operands wait at most while `ops` are evaluated.
pub(super) fn depth(ops: &[Op]) -> usize {
    let (mut now, mut most) = (0_usize, 0);
    for op in ops {
        now = now.saturating_sub(op.takes()) + 1;
        most = most.max(now);
    }
    most
}

/// The value of what needs no other; `None` where a lost signal leaves it unknown.
fn operand(op: &Op, scope: Scope<'_>) -> Option<f64> {
    match op {
        Op::Number(number) | Op::Named { value: number, .. } => Some(*number),
        Op::Truth(truth) => Some(f64::from(*truth)),
        Op::Signal(input) | Op::Own { input, .. } => input.read(scope),
        Op::InState { machine, first, last, .. } => {
            let active = scope.board.machines.get(usize::from(*machine))?.state;
            Some(f64::from((*first..=*last).contains(&active)))
        }
        Op::Negate | Op::Not | Op::Infix(_) | Op::Call { .. } => None,
    }
}

/// What an operator gives; unknown by Kleene's logic.
pub(super) fn apply(infix: Infix, left: Option<f64>, right: Option<f64>) -> Option<f64> {
    let is = |side: Option<f64>, truth: bool| side.is_some_and(|value| (value != 0.0) == truth);
    match infix {
        Infix::And if is(left, false) || is(right, false) => Some(0.0),
        Infix::Or if is(left, true) || is(right, true) => Some(1.0),
        Infix::And => left.and(right).map(|_| 1.0),
        Infix::Or => left.and(right).map(|_| 0.0),
        Infix::Compare(comparison) => Some(f64::from(comparison.of(left?, right?))),
        Infix::Add => Some(left? + right?),
        Infix::Subtract => Some(left? - right?),
        Infix::Multiply => Some(left? * right?),
        Infix::Divide => Some(left? / right?),
    }
}
