//! Text to tokens, each with its bytes.

use std::ops::Range;

use super::{Infix, Misreading, Mistake, OPERATORS};
use crate::printable;

/// The smallest parts of an expression.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Token<'t> {
    Number(f64),
    Name(&'t str),
    Truth(bool),
    Not,
    /// An operator; `-` may also stand before its operand.
    Infix(Infix),
    Open,
    Close,
    Comma,
    End,
}

pub(super) fn described(token: Token<'_>) -> String {
    match token {
        Token::Number(_) => "a number".to_owned(),
        Token::Name(name) => format!("`{}`", printable::name(name)),
        Token::Truth(truth) => format!("`{truth}`"),
        Token::Not => "`not`".to_owned(),
        Token::Infix(infix) => format!("`{}`", infix.as_str()),
        Token::Open => "`(`".to_owned(),
        Token::Close => "`)`".to_owned(),
        Token::Comma => "`,`".to_owned(),
        Token::End => "the end".to_owned(),
    }
}

/// A token and the bytes where it stands.
pub(super) type Placed<'t> = (Token<'t>, Range<usize>);

/// What other languages write, and the way out.
const FOREIGN: [(&str, &str); 19] = [
    ("&&", "write `and`"),
    ("||", "write `or`"),
    ("AND", "write `and`"),
    ("OR", "write `or`"),
    ("NOT", "write `not`"),
    ("=", "write `==`"),
    ("!", "write `not`"),
    ("≤", "write `<=`"),
    ("≥", "write `>=`"),
    ("≠", "write `!=`"),
    ("<>", "write `!=`"),
    ("−", "write `-`"),
    ("**", POWER),
    ("^", POWER),
    ("%", "the rest of a division is `a - b * floor(a / b)`; a unit is part of a name"),
    ("'", QUOTES),
    ("\"", QUOTES),
    ("?", CHOICE),
    ("if", CHOICE),
];

const POWER: &str = "a square is `a * a`, and a root `sqrt(a)`";
const QUOTES: &str = "a word stands without quotes, as in `colour == red`";
const CHOICE: &str = "an expression does not choose: a transition for each case, with its `when`";

/// The way out where a word is another language's.
pub(super) fn foreign(word: &str) -> Option<&'static str> {
    FOREIGN.iter().find(|(sign, _)| *sign == word).map(|(_, hint)| *hint)
}

/// What is said of `0.25m`, `25 cm` and `90°`.
pub(super) const UNIT: &str = "a unit is part of a name, as in `range_m < 0.25`";

/// All tokens, the last one being [`Token::End`].
pub(super) fn tokens(text: &str) -> Result<Vec<Placed<'_>>, Misreading> {
    let mut tokens = Vec::new();
    let mut at = 0;
    while let Some(rest) = text.get(at..) {
        let Some(first) = rest.chars().next() else { break };
        if first.is_whitespace() {
            at += first.len_utf8();
            continue;
        }
        let (token, length) = token(rest, first).map_err(|(mistake, length, hint)| Misreading {
            place: at..at + length,
            mistake,
            hint,
        })?;
        tokens.push((token, at..at + length));
        at += length;
    }
    tokens.push((Token::End, text.len()..text.len()));
    Ok(tokens)
}

/// Joins the tokens of names with hyphens, as machines and states may have them: what stands
/// without spaces and is such a name is no difference.
///
/// - `is_name`: whether there is such a name, behind these tokens.
pub(super) fn with_hyphens<'t>(
    text: &'t str,
    tokens: &[Placed<'t>],
    is_name: impl Fn(&str, &[Placed<'t>]) -> bool,
) -> Vec<Placed<'t>> {
    let mut all: Vec<Placed<'t>> = Vec::with_capacity(tokens.len());
    let mut at = 0;
    while let Some((first, place)) = tokens.get(at) {
        let mut longest = (*first, place.clone());
        let mut next = at + 1;
        while let (Token::Name(_), Some([minus, part])) = (first, tokens.get(next..next + 2))
            && minus.0 == Token::Infix(Infix::Subtract)
            && matches!(part.0, Token::Name(_) | Token::Number(_))
            && tokens[next - 1].1.end == minus.1.start
            && minus.1.end == part.1.start
        {
            next += 2;
            let place = place.start..part.1.end;
            let name = &text[place.clone()];
            if is_name(name, &all) {
                (longest, at) = ((Token::Name(name), place), next - 1);
            }
        }
        all.push(longest);
        at += 1;
    }
    all
}

/// A mistake, its length in bytes, and the way out.
type Bad = (Mistake, usize, Option<String>);

fn token(rest: &str, first: char) -> Result<(Token<'_>, usize), Bad> {
    if first.is_ascii_digit() || first == '.' {
        return number(rest);
    }
    if first.is_alphabetic() || first == '_' {
        return name(rest);
    }
    match first {
        '(' => return Ok((Token::Open, 1)),
        ')' => return Ok((Token::Close, 1)),
        ',' => return Ok((Token::Comma, 1)),
        _ => {}
    }
    let foreign = FOREIGN.iter().find(|(sign, _)| rest.starts_with(sign));
    let operator = OPERATORS.iter().find(|(sign, _)| rest.starts_with(sign));
    // The longer one: `==` and not `=`, `**` and not `*`.
    let longer = |sign: &str| foreign.is_none_or(|(other, _)| other.len() < sign.len());
    if let Some((sign, infix)) = operator.filter(|(sign, _)| longer(sign)) {
        return Ok((Token::Infix(*infix), sign.len()));
    }
    let (sign, hint) = match foreign {
        Some((sign, hint)) => return Err(other_languages(sign, hint)),
        None if first == '°' => (first.to_string(), UNIT),
        None => {
            (first.escape_debug().to_string(), "known are + - * / < <= > >= == != and or not ( )")
        }
    };
    Err((Mistake::Character(sign), first.len_utf8(), Some(hint.to_owned())))
}

fn other_languages(sign: &str, hint: &str) -> Bad {
    (Mistake::Character(sign.to_owned()), sign.len(), Some(hint.to_owned()))
}

fn number(rest: &str) -> Result<(Token<'_>, usize), Bad> {
    let length = number_length(rest);
    let text = &rest[..length];
    match text.parse::<f64>() {
        Ok(number) if number.is_finite() => Ok((Token::Number(number), length)),
        _ => {
            let unit =
                text.contains(|c: char| (c.is_alphabetic() && !matches!(c, 'e' | 'E')) || c == '_');
            let way_out = if unit { UNIT } else { "write it as `0.25` or `2.5e-1`" };
            let hint = Some(way_out.to_owned());
            Err((Mistake::Number(printable::name(text).into_owned()), length, hint))
        }
    }
}

/// Digits and letters up to the next sign or space; the sign of an exponent belongs to it.
fn number_length(rest: &str) -> usize {
    let mut before = ' ';
    let inside = |(_, c): &(usize, char)| {
        let exponent = matches!(before, 'e' | 'E') && matches!(c, '+' | '-');
        before = *c;
        c.is_alphanumeric() || matches!(c, '.' | '_') || exponent
    };
    rest.char_indices().take_while(inside).last().map_or(0, |(at, c)| at + c.len_utf8())
}

fn name(rest: &str) -> Result<(Token<'_>, usize), Bad> {
    let length =
        rest.find(|c: char| !(c.is_alphanumeric() || matches!(c, '_' | '.'))).unwrap_or(rest.len());
    if let Some(hint) = foreign(&rest[..length]) {
        return Err(other_languages(&rest[..length], hint));
    }
    let token = match &rest[..length] {
        "not" => Token::Not,
        "true" => Token::Truth(true),
        "false" => Token::Truth(false),
        name => match OPERATORS.iter().find(|(text, _)| *text == name) {
            Some((_, infix)) => Token::Infix(*infix),
            None => Token::Name(name),
        },
    };
    Ok((token, length))
}
