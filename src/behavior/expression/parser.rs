//! Tokens to postfix operations, by binding power (Pratt's method), with kinds checked on the way.

use std::ops::Range;

use super::lexer::{Placed, Token, shortened, tokens};
use super::{Comparison, Expression, Infix, Kind, Misreading, Mistake, Op, Vocabulary};
use crate::behavior::signals::words;
use crate::document::nearest;

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
    kind: Kind,
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
    let mut parser = Parser {
        vocabulary,
        tokens: &tokens,
        at: 0,
        depth: 0,
        ops: Vec::new(),
        names: Vec::new(),
        misreadings: Vec::new(),
    };
    // A mistake in grammar has been noted where it stands.
    let whole = parser.whole(kind);
    if whole.is_none() || !parser.misreadings.is_empty() {
        return Err(parser.misreadings);
    }
    Ok(Expression { text: text.into(), kind, ops: parser.ops.into(), names: parser.names.into() })
}

/// The kind of a part, `None` where a mistake was found in it, and its bytes.
type Typed = (Option<Kind>, Range<usize>);

struct Parser<'p, 'c> {
    vocabulary: &'p mut Vocabulary<'c>,
    tokens: &'p [Placed<'p>],
    at: usize,
    depth: usize,
    ops: Vec<Op>,
    names: Vec<String>,
    misreadings: Vec<Misreading>,
}

impl<'p> Parser<'p, '_> {
    /// The whole text; `None` after a mistake in grammar, which ends the reading.
    fn whole(&mut self, expected: Kind) -> Option<()> {
        if let [(Token::End, _)] = self.tokens {
            let example = "write a condition, as in `range_m < 0.25`, or a number".to_owned();
            self.note(0..0, Mistake::Empty, Some(example));
            return None;
        }
        let (found, place) = self.expression(0)?;
        let (token, end) = self.peek();
        match token {
            Token::End => {}
            Token::Close => {
                self.note(
                    end,
                    Mistake::NotOpened,
                    Some("take it out, or open it before".to_owned()),
                );
                return None;
            }
            other => {
                self.note(end, Mistake::NoOperator(described(other)), None);
                return None;
            }
        }
        if let Some(found) = found.filter(|found| *found != expected) {
            let hint = (expected == Kind::Truth)
                .then(|| "compare it with something, as in `… > 0`".to_owned());
            self.note(place, Mistake::Whole { expected, found }, hint);
        }
        Some(())
    }

    /// An operand and what follows it as long as its operators bind at least as strongly as
    /// `least`.
    fn expression(&mut self, least: u8) -> Option<Typed> {
        if self.depth == Expression::MAX_NESTING {
            let place = self.peek().1;
            self.note(place, Mistake::TooDeep, Some("make two transitions of it".to_owned()));
            return None;
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
                let hint = "write `a < b and b < c`".to_owned();
                self.note(place, Mistake::Chained, Some(hint));
                return None;
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
            Token::Name(name) => Some(self.name(name, place)),
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
                    (Token::End, _) => self.refuse(place, Mistake::NotClosed),
                    (other, end) => self.refuse(end, Mistake::NoOperator(described(other))),
                }
            }
            other => self.refuse(place, Mistake::NoOperand(described(other))),
        }
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

    /// A signal, a named motor's angle, or one of the mission's numbers.
    fn name(&mut self, name: &'p str, place: Range<usize>) -> Typed {
        if let Some(word) = words().find(|word| word.name == name) {
            let role = word.channel.map(|channel| channel.quantity().role);
            if let Some(role) = role.filter(|role| !self.vocabulary.capabilities().has(*role)) {
                let hint = format!("[{}] in the robot's file would be that part", role.section());
                let mistake = Mistake::NoPart { name: name.to_owned(), part: role.what() };
                self.note(place.clone(), mistake, Some(hint));
            }
            let kind = if word.is_truth { Kind::Truth } else { Kind::Number };
            return self.push(Op::Signal(word.input), kind, place);
        }
        if let Some(motor) = name.strip_prefix("motor.").filter(|motor| is_plain(motor)) {
            return match self.vocabulary.motor(motor) {
                Ok(at) => {
                    let name = self.remember(motor);
                    self.push(Op::Motor { name, place: at }, Kind::Number, place)
                }
                Err(mistake) => {
                    let hint = self.vocabulary.motor_hint(motor);
                    self.unusable(place, mistake, Some(hint))
                }
            };
        }
        if let Some(value) = self.vocabulary.numbers.get(name).copied() {
            let name = self.remember(name);
            return self.push(Op::Named { name, value }, Kind::Number, place);
        }
        let known = words().map(|word| word.name).chain(["and", "or", "not", "true", "false"]);
        let hint = nearest(name, known.chain(self.vocabulary.numbers.keys().map(String::as_str)));
        self.unusable(place, Mistake::UnknownName(shortened(name)), hint)
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
                    let hint = "write `touch` or `not touch` for what is true or false".to_owned();
                    self.note(place.clone(), Mistake::Mixed(infix.as_str()), Some(hint));
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
            let hint = Some(way_out(expected).to_owned());
            self.note(place.clone(), Mistake::Operand { operator, expected, found }, hint);
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

    fn unusable(&mut self, place: Range<usize>, mistake: Mistake, hint: Option<String>) -> Typed {
        self.note(place.clone(), mistake, hint);
        (None, place)
    }

    fn refuse(&mut self, place: Range<usize>, mistake: Mistake) -> Option<Typed> {
        let hint = (mistake == Mistake::NotClosed).then(|| "put a `)` where it ends".to_owned());
        self.note(place, mistake, hint);
        None
    }

    fn note(&mut self, place: Range<usize>, mistake: Mistake, hint: Option<String>) {
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

fn described(token: Token<'_>) -> String {
    match token {
        Token::Number(_) => "a number".to_owned(),
        Token::Name(name) => format!("`{}`", shortened(name)),
        Token::Truth(truth) => format!("`{truth}`"),
        Token::Not => "`not`".to_owned(),
        Token::Infix(infix) => format!("`{}`", infix.as_str()),
        Token::Open => "`(`".to_owned(),
        Token::Close => "`)`".to_owned(),
        Token::End => "the end".to_owned(),
    }
}
