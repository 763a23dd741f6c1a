//! Tokens to postfix operations, by binding power (Pratt's method), with kinds checked on the way.

use std::ops::Range;

use super::evaluation::{STACK, depth};
use super::function::{FUNCTIONS, Function};
use super::lexer::{Placed, Token, UNIT, described, tokens, with_hyphens};
use super::vocabulary::{SEARCHED, values};
use super::{Comparison, Expression, Infix, Kind, Misreading, Mistake, Op, Vocabulary};
use crate::behavior::blackboard::MAX_PIDS;
use crate::behavior::signals::{Input, Signal, words};
use crate::document::{nearest, nearest_or_all};
use crate::printable;
use crate::senses::{Channel, Unit};

/// How strongly `not` and a leading `-` hold their operand; operators are in [`power`].
const NOT_POWER: u8 = 5;
const NEGATE_POWER: u8 = 13;

/// How strongly an operator holds its operands.
fn power(infix: Infix) -> u8 {
    match infix {
        Infix::Or => 1,
        Infix::And => 3,
        Infix::Compare(_) => 7,
        Infix::Add | Infix::Subtract => 9,
        Infix::Multiply | Infix::Divide => 11,
    }
}

pub(super) fn parse(
    text: &str,
    kind: Option<Kind>,
    vocabulary: &mut Vocabulary<'_>,
) -> Result<Expression, Vec<Misreading>> {
    if text.len() > Expression::MAX_BYTES {
        let misreading = Misreading {
            place: 0..0,
            mistake: Mistake::TooLong(text.len()),
            hint: Some("make several transitions of it".to_owned()),
        };
        return Err(vec![misreading]);
    }
    let tokens = tokens(text).map_err(|misreading| vec![misreading])?;
    let tokens = with_hyphens(text, &tokens, |name, before| vocabulary.is_hyphenated(name, before));
    let mut parser = Parser {
        vocabulary,
        tokens: &tokens,
        at: 0,
        depth: 0,
        ops: Vec::new(),
        names: Vec::new(),
        misreadings: Vec::new(),
        is_unread: false,
    };
    // A mistake in grammar has been noted where it stands.
    let whole = parser.whole(kind);
    match whole {
        Some(kind) if parser.misreadings.is_empty() && !parser.is_unread => Ok(Expression {
            text: text.into(),
            kind,
            ops: parser.ops.into(),
            names: parser.names.into(),
        }),
        _ => Err(parser.misreadings),
    }
}

/// Ways out: of what is nested too deeply, of a parenthesis that is left open.
const IN_TWO: &str = "make two transitions of it";
const TO_CLOSE: &str = "put a `)` where it ends";

/// The way out where a comma stands between digits.
const POINT: &str = "a decimal number has a point, as in `0.25`";

/// The kind of a part and its bytes; `None` where a mistake was found in it, and for the sensor of
/// a robot that is not known.
type Typed = (Option<Kind>, Range<usize>);

struct Parser<'p, 'c> {
    vocabulary: &'p mut Vocabulary<'c>,
    tokens: &'p [Placed<'p>],
    at: usize,
    depth: usize,
    ops: Vec<Op>,
    names: Vec<String>,
    misreadings: Vec<Misreading>,
    /// It uses a number whose value is wrong.
    is_unread: bool,
}

impl<'p> Parser<'p, '_> {
    /// The kind of the whole text; `None` after a mistake in grammar, which ends the reading.
    fn whole(&mut self, expected: Option<Kind>) -> Option<Kind> {
        if let [(Token::End, _)] = self.tokens {
            let example = "write a condition, as in `range_m < 0.25`, or a number";
            return self.refuse(0..0, Mistake::Empty, example);
        }
        let (found, place) = self.expression(0)?;
        let (token, end) = self.peek();
        match token {
            Token::End => {}
            Token::Close => {
                return self.refuse(end, Mistake::NotOpened, "take it out, or open it before");
            }
            other => return self.unexpected(other, end),
        }
        if depth(&self.ops) > STACK {
            self.note(0..place.end, Mistake::TooDeep, IN_TWO);
        }
        if let Some((found, expected)) = found.zip(expected)
            && found != expected
        {
            let hint = if expected == Kind::Truth { way_out(expected) } else { "" };
            self.note(place, Mistake::Whole { expected, found }, hint);
        }
        // What a sensor of an unknown robot measures is what is wanted of it.
        Some(found.or(expected).unwrap_or(Kind::Number))
    }

    /// An operand and what follows it as long as its operators bind at least as strongly as
    /// `least`.
    fn expression(&mut self, least: u8) -> Option<Typed> {
        if self.depth == Expression::MAX_NESTING {
            let place = self.peek().1;
            return self.refuse(place, Mistake::TooDeep, IN_TWO);
        }
        self.depth += 1;
        let mut left = self.operand()?;
        while let (Token::Infix(infix), _) = self.peek()
            && power(infix) >= least
        {
            self.at += 1;
            let right = self.expression(power(infix) + 1)?;
            left = self.combine(infix, left, right);
            if let (Token::Infix(next), place) = self.peek()
                && matches!((infix, next), (Infix::Compare(_), Infix::Compare(_)))
            {
                return self.refuse(place, Mistake::Chained, "write `a < b and b < c`");
            }
        }
        self.depth -= 1;
        Some(left)
    }

    fn operand(&mut self) -> Option<Typed> {
        let (token, place) = self.peek();
        self.at += 1;
        match token {
            Token::Number(number) => Some(self.push(Op::Number(number), Kind::Number, place)),
            Token::Truth(truth) => Some(self.push(Op::Truth(truth), Kind::Truth, place)),
            Token::Name(name) if self.peek().0 == Token::Open => self.call(name, place),
            Token::Name(name) => match name.strip_suffix(".state") {
                Some(machine) => self.in_state(name, machine, place),
                None => Some(self.name(name, place)),
            },
            Token::Not => self.prefix(Op::Not, "not", NOT_POWER, Kind::Truth, place),
            Token::Infix(Infix::Subtract) => {
                self.prefix(Op::Negate, "-", NEGATE_POWER, Kind::Number, place)
            }
            Token::Open => {
                let (kind, _) = self.expression(0)?;
                match self.peek() {
                    (Token::Close, end) => {
                        self.at += 1;
                        Some((kind, place.start..end.end))
                    }
                    (Token::End, _) => self.refuse(place, Mistake::NotClosed, TO_CLOSE),
                    (other, end) => self.unexpected(other, end),
                }
            }
            other => self.refuse(place, Mistake::NoOperand(described(other)), ""),
        }
    }

    /// Something stands where an operator should.
    fn unexpected<T>(&mut self, token: Token<'_>, place: Range<usize>) -> Option<T> {
        let before = self.at.checked_sub(1).and_then(|before| self.tokens.get(before));
        let hint = match (before, token) {
            (_, Token::Comma) => POINT,
            (Some((Token::Number(_), _)), Token::Name(_)) => UNIT,
            _ => "",
        };
        self.refuse(place, Mistake::NoOperator(described(token)), hint)
    }

    /// A function with its arguments; the parenthesis is next.
    fn call(&mut self, name: &'p str, place: Range<usize>) -> Option<Typed> {
        let open = self.peek().1;
        self.at += 1;
        let mut given = 0;
        let function = Function::named(name);
        let end = loop {
            if let (Token::Close, end) = self.peek()
                && given == 0
            {
                break end;
            }
            let argument = self.expression(0)?;
            given += 1;
            if let Some(function) = function {
                self.expect(function.name(), Kind::Number, &argument);
            }
            match self.peek() {
                (Token::Comma, _) => self.at += 1,
                (Token::Close, end) => break end,
                (Token::End, _) => return self.refuse(open, Mistake::NotClosed, TO_CLOSE),
                (other, end) => return self.unexpected(other, end),
            }
        };
        self.at += 1;
        let whole = place.start..end.end;
        let Some(function) = function else {
            let hint = nearest_or_all(name, "known are", FUNCTIONS.iter().map(|row| row.0.name()));
            let mistake = Mistake::NoFunction(printable::name(name).into_owned());
            return Some(self.unusable(place, mistake, hint));
        };
        let takes = function.takes();
        let is_unbounded = function == Function::Pid && given + 1 == takes;
        if is_unbounded {
            self.ops.push(Op::Number(f64::INFINITY));
        }
        let fits = given == takes || is_unbounded || function.is_open() && given > takes;
        if !fits {
            let takes = match takes {
                _ if function.is_open() => "two numbers or more".to_owned(),
                1 => "one number".to_owned(),
                more if function == Function::Pid => format!("{} or {more} numbers", more - 1),
                more => format!("{more} numbers"),
            };
            let usage = function.usage();
            let hint = format!("write `{usage}`; a decimal number has a point, as in `0.25`");
            let mistake = Mistake::Arguments { name: function.name(), takes, given };
            return Some(self.unusable(whole, mistake, hint));
        }
        let slot = match function {
            Function::Random => {
                self.vocabulary.randoms += 1;
                self.vocabulary.randoms
            }
            Function::Pid => self.pid(&place),
            _ => 0,
        };
        // `min(a, b, c)` is `min(a, min(b, c))`.
        let calls = if function.is_open() { given - 1 } else { 1 };
        self.ops.extend(std::iter::repeat_n(Op::Call { function, slot }, calls));
        Some((Some(Kind::Number), whole))
    }

    /// The slot of a `pid`.
    fn pid(&mut self, place: &Range<usize>) -> u32 {
        let Some(slot) = self.vocabulary.pids else {
            self.note(place.clone(), Mistake::NoPid, "");
            return 0;
        };
        self.vocabulary.pids = Some(slot + 1);
        if usize::try_from(slot).is_ok_and(|slot| slot >= MAX_PIDS) {
            self.note(place.clone(), Mistake::TooManyPids, "");
        }
        slot
    }

    /// `NAME.state == STATE`; the operator is next.
    fn in_state(&mut self, name: &'p str, machine: &'p str, place: Range<usize>) -> Option<Typed> {
        let machines = || self.vocabulary.machines.iter().map(|(name, _)| name.as_str());
        let Some(index) = machines().position(|known| known == machine) else {
            if self.vocabulary.unread.contains(name) {
                // Past the operator and the state.
                self.at += 2;
                self.is_unread = true;
                return Some((None, place));
            }
            // What a variable begins with is read before the machines.
            let hint = machines().next().map(|_| nearest_or_all(machine, "it has", machines()));
            let mistake = Mistake::NoMachine(printable::name(machine).into_owned());
            return self.refuse(place, mistake, hint.unwrap_or_default());
        };
        let example = self.vocabulary.machines[index].1.keys().next().map_or("turn", |key| key);
        let hint = format!("as in `{name} == {example}`");
        let comparison = self.peek();
        self.at += 1;
        let state = self.peek();
        self.at += 1;
        let (is, state, end) = match (comparison.0, state) {
            (Token::Infix(Infix::Compare(is)), (Token::Name(state), end))
                if matches!(is, Comparison::Equal | Comparison::NotEqual) =>
            {
                (is, state, end)
            }
            _ => return self.refuse(place, Mistake::State(name.to_owned()), hint),
        };
        let whole = place.start..end.end;
        let states = &self.vocabulary.machines[index].1;
        let Some(at) = states.get(state).cloned() else {
            let hint = nearest(state, states.keys().take(SEARCHED).map(String::as_str))
                .unwrap_or_default();
            let (machine, state) = (machine.to_owned(), printable::name(state).into_owned());
            return Some(self.unusable(end, Mistake::NoState { machine, state }, hint));
        };
        let name = self.remember(&format!("{name} == {state}"));
        let machine = u8::try_from(index).unwrap_or(u8::MAX);
        let (first, last) = (*at.start(), *at.end());
        self.ops.push(Op::InState { name, machine, first, last });
        if is == Comparison::NotEqual {
            self.ops.push(Op::Not);
        }
        Some((Some(Kind::Truth), whole))
    }

    fn prefix(
        &mut self,
        op: Op,
        word: &'static str,
        power: u8,
        kind: Kind,
        place: Range<usize>,
    ) -> Option<Typed> {
        let operand = self.expression(power)?;
        self.expect(word, kind, &operand);
        self.ops.push(op);
        Some((Some(kind), place.start..operand.1.end))
    }

    /// A signal, a named motor's angle, what a named sensor measures, or one of the mission's
    /// numbers.
    fn name(&mut self, name: &'p str, place: Range<usize>) -> Typed {
        if let Some(word) = words().find(|word| word.name == name) {
            let role = word.channel.map(|channel| channel.quantity().role);
            if let Some(role) = role.filter(|role| !self.vocabulary.capabilities.has(*role)) {
                let (mistake, hint) = Mistake::no_part(name, role);
                self.note(place.clone(), mistake, hint);
            }
            let kind = if word.is_truth { Kind::Truth } else { Kind::Number };
            return self.push(Op::Signal(word.input), kind, place);
        }
        if let Some(motor) = name.strip_prefix("motor.").filter(|motor| is_plain(motor)) {
            return match self.vocabulary.motors.place(motor) {
                Ok(at) => self.sensed(name, Channel::MOTORS[usize::from(at)], None, place),
                Err(mistake) => {
                    let hint = self.vocabulary.motors.hint(motor);
                    self.unusable(place, mistake, hint)
                }
            };
        }
        if let Some(sensor) = name.strip_prefix("sensor.").filter(|sensor| is_plain(sensor)) {
            return match self.vocabulary.sensors.place(sensor) {
                Ok(at) => {
                    let measures = self.vocabulary.measures(at);
                    let channel = Channel::SENSORS[usize::from(at)];
                    let (_, place) = self.sensed(name, channel, measures, place);
                    let is_truth = |channel: Channel| channel.quantity().unit == Unit::Truth;
                    let kind = |truth| if truth { Kind::Truth } else { Kind::Number };
                    (measures.map(is_truth).map(kind), place)
                }
                Err(mistake) => {
                    let hint = self.vocabulary.sensors.hint(sensor);
                    self.unusable(place, mistake, hint)
                }
            };
        }
        if self.vocabulary.unread.contains(name) {
            self.is_unread = true;
            return (None, place);
        }
        let own = self.vocabulary.numbers.get(name).copied();
        if let Some(variable) = self.vocabulary.variable(name) {
            return self.own(name, Input::Variable(variable), None, place);
        }
        let known = || values().find(|(known, _)| *known == name).map(|(_, value)| value);
        if let Some(value) = own.or_else(known) {
            let name = self.remember(name);
            return self.push(Op::Named { name, value }, Kind::Number, place);
        }
        if let Some(function) = Function::named(name) {
            let hint = format!("write `{}`", function.usage());
            return self.unusable(place, Mistake::NoArguments(function.name()), hint);
        }
        let before = self.tokens.get(..self.at.saturating_sub(1)).unwrap_or_default();
        let hint = self.vocabulary.name_hint(name, before).unwrap_or_else(|| {
            "a name is what is sensed (`onbrick new mission` lists it), a value such as `red`, or \
             one of [numbers] and [variables]"
                .to_owned()
        });
        self.unusable(place, Mistake::UnknownName(printable::name(name).into_owned()), hint)
    }

    fn sensed(
        &mut self,
        name: &str,
        channel: Channel,
        measures: Option<Channel>,
        place: Range<usize>,
    ) -> Typed {
        self.own(name, Input::Signal(Signal::Sensed(channel)), measures, place)
    }

    fn own(
        &mut self,
        name: &str,
        input: Input,
        measures: Option<Channel>,
        place: Range<usize>,
    ) -> Typed {
        let name = self.remember(name);
        self.push(Op::Own { name, input, measures }, Kind::Number, place)
    }

    /// Puts an operator behind its two operands and says what they come to.
    fn combine(&mut self, infix: Infix, left: Typed, right: Typed) -> Typed {
        let place = left.1.start..right.1.end;
        self.ops.push(Op::Infix(infix));
        let (takes, gives) = match infix {
            Infix::Or | Infix::And => (Kind::Truth, Kind::Truth),
            Infix::Compare(Comparison::Equal | Comparison::NotEqual) => {
                if let (Some(a), Some(b)) = (left.0, right.0)
                    && a != b
                {
                    let hint = "write `touch` or `not touch` for what is true or false";
                    self.note(place.clone(), Mistake::Mixed(infix.as_str()), hint);
                }
                return (Some(Kind::Truth), place);
            }
            Infix::Compare(_) => (Kind::Number, Kind::Truth),
            Infix::Add | Infix::Subtract | Infix::Multiply | Infix::Divide => {
                (Kind::Number, Kind::Number)
            }
        };
        self.expect(infix.as_str(), takes, &left);
        self.expect(infix.as_str(), takes, &right);
        (Some(gives), place)
    }

    fn expect(&mut self, operator: &'static str, expected: Kind, (found, place): &Typed) {
        if let Some(found) = found.filter(|found| *found != expected) {
            let mistake = Mistake::Operand { operator, expected, found };
            self.note(place.clone(), mistake, way_out(expected));
        }
    }

    fn push(&mut self, op: Op, kind: Kind, place: Range<usize>) -> Typed {
        self.ops.push(op);
        (Some(kind), place)
    }

    /// Keeps a name and says where; there are fewer names than bytes in the text.
    fn remember(&mut self, name: &str) -> u16 {
        let at = self.names.iter().position(|known| known == name).unwrap_or_else(|| {
            self.names.push(name.to_owned());
            self.names.len() - 1
        });
        u16::try_from(at).unwrap_or(u16::MAX)
    }

    /// A part of no kind: reading continues behind it.
    fn unusable(&mut self, place: Range<usize>, mistake: Mistake, hint: String) -> Typed {
        self.note(place.clone(), mistake, hint);
        (None, place)
    }

    /// A mistake in grammar: the reading ends.
    fn refuse<T>(
        &mut self,
        place: Range<usize>,
        mistake: Mistake,
        hint: impl Into<String>,
    ) -> Option<T> {
        self.note(place, mistake, hint);
        None
    }

    /// An empty hint is none.
    fn note(&mut self, place: Range<usize>, mistake: Mistake, hint: impl Into<String>) {
        let hint = Some(hint.into()).filter(|hint| !hint.is_empty());
        self.misreadings.push(Misreading { place, mistake, hint });
    }

    fn peek(&self) -> Placed<'p> {
        let last = self.tokens.get(self.at).or(self.tokens.last());
        last.map_or((Token::End, 0..0), |(token, place)| (*token, place.clone()))
    }
}

/// True for a name that an expression can hold as one word.
pub(in crate::behavior) fn is_plain(name: &str) -> bool {
    name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}

/// The way out where something else than `expected` stands.
fn way_out(expected: Kind) -> &'static str {
    match expected {
        Kind::Truth => "compare it with something, as in `… > 0`",
        Kind::Number => "what is true or false cannot be counted with; let it be a condition",
    }
}
