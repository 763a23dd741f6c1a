//! Why a file is no TOML, as a person who writes missions understands it.
//!
//! The parser says what it expected next. What people do is leave a quote or a brace out, write a
//! decimal comma, an expression without quotes, a table twice; that is looked for around the place
//! where the parser stopped. One mistake makes several errors, so the first one alone is told.
//!
//! # Not here
//!
//! What is TOML and no mission: that is said by those who read it.

use std::ops::Range;

/// What is wrong, where, and the way out.
pub(super) struct Explained {
    pub(super) place: Range<usize>,
    pub(super) message: String,
    pub(super) hint: String,
}

/// How far before an error a brace that is left open is looked for, in lines.
const LINES_BACK: usize = 20;

/// What is said of keys that stand in brackets, or bare.
const IN_BRACES: &str = "keys with values stand in braces";

/// Where the parser stopped.
struct Spot<'t> {
    text: &'t str,
    at: usize,
    /// The bytes of its line.
    line: Range<usize>,
    /// [`code`] of the line.
    code: String,
    /// Where in the line a text begins that is not closed.
    open: Option<usize>,
}

/// What people do, the surest first.
const MISTAKES: [fn(&Spot<'_>) -> Option<Explained>; 13] = [
    curly_quotes,
    open_text,
    foreign_letter,
    no_value,
    bare_point,
    bare_list,
    bracketed_keys,
    bare_keys,
    decimal_comma,
    colon,
    quotes_inside,
    bare,
    open_brace,
];

/// Explains the parser's first error.
pub(super) fn explain(text: &str, place: &Range<usize>, said: &str) -> Explained {
    let at = text.floor_char_boundary(place.start.min(text.len()));
    let line = line_of(text, at);
    let (code, open) = code(&text[line.clone()]);
    let spot = Spot { text, at, line, code, open };
    let found = if said.starts_with("duplicate key") {
        twice(&spot)
    } else {
        MISTAKES.iter().find_map(|mistake| mistake(&spot))
    };
    found.unwrap_or_else(|| Explained::new(place.clone(), said, ""))
}

impl Explained {
    fn new(place: Range<usize>, message: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { place, message: message.into(), hint: hint.into() }
    }
}

/// A line without what stands in quotes and behind `#`, each letter of it a blank of its own width:
/// places stay. The second is where a text begins that is not closed.
fn code(line: &str) -> (String, Option<usize>) {
    let mut code = String::with_capacity(line.len());
    let mut open: Option<(char, usize)> = None;
    let mut escaped = false;
    for (at, letter) in line.char_indices() {
        let blank = " ".repeat(letter.len_utf8());
        match open {
            Some((quote, _)) => {
                if letter == quote && !escaped {
                    open = None;
                    code.push('"');
                } else {
                    code.push_str(&blank);
                }
                escaped = letter == '\\' && quote == '"' && !escaped;
            }
            None if matches!(letter, '"' | '\'') => {
                open = Some((letter, at));
                code.push('"');
            }
            None if letter == '#' => break,
            None => code.push(letter),
        }
    }
    (code, open.map(|(_, at)| at))
}

/// The bytes of the line that a byte is in.
pub(super) fn line_of(text: &str, at: usize) -> Range<usize> {
    let start = text[..at].rfind('\n').map_or(0, |newline| newline + 1);
    let end = text[at..].find('\n').map_or(text.len(), |newline| at + newline);
    start..end
}

/// A table or a key that is there twice: where it was first.
fn twice(&Spot { text, at, ref line, .. }: &Spot<'_>) -> Option<Explained> {
    let header = |line: &str| {
        let code = code(line).0;
        let name = code.trim().strip_prefix('[')?.trim_matches(['[', ']']).trim().to_owned();
        Some(name)
    };
    let lines: Vec<&str> = text[..line.start].lines().collect();
    let (name, first) = match header(&text[line.clone()]) {
        Some(name) => {
            let first = lines.iter().position(|other| header(other).as_ref() == Some(&name));
            (name, first)
        }
        None => {
            let key = text[at..line.end].split(['=', ' ', '.']).next()?.trim();
            let begins = |other: &str| {
                let rest = other.trim_start().strip_prefix(key);
                rest.is_some_and(|rest| rest.trim_start().starts_with('='))
            };
            // Of the same table alone.
            let table =
                lines.iter().rposition(|line| header(line).is_some()).map_or(0, |at| at + 1);
            let first = lines[table..].iter().position(|other| begins(&code(other).0));
            (key.to_owned(), first.map(|first| table + first))
        }
    };
    let hint = match first {
        Some(first) => format!("the first one is in line {}", first + 1),
        None => "leave one out, or give it another name".to_owned(),
    };
    Some(Explained::new(
        at..at + text[at..line.end].find(['=', ']', ' ']).unwrap_or(1),
        format!("`{name}` is there twice"),
        hint,
    ))
}

/// Quotes as word processors write them.
fn curly_quotes(&Spot { text, ref line, ref code, .. }: &Spot<'_>) -> Option<Explained> {
    let is_curly = |letter: char| "“”„‘’".contains(letter);
    let start = code.find(is_curly)?;
    let word = code[start..].trim_start_matches(is_curly);
    let word = &word[..word.find(is_curly)?];
    let end = code[start..].rfind(is_curly).map_or(code.len(), |last| start + last);
    let place = line.start + start..text.ceil_char_boundary(line.start + end + 1);
    Some(Explained::new(
        place,
        "these are not the quotes of a text",
        format!("write straight quotes: `\"{word}\"`"),
    ))
}

/// A text that is not closed in its line.
fn open_text(&Spot { ref line, open, .. }: &Spot<'_>) -> Option<Explained> {
    let start = line.start + open?;
    Some(Explained::new(start..line.end, "this text is not closed", "put a `\"` where it ends"))
}

/// A key with a letter beyond a to z: TOML takes those in quotes alone.
fn foreign_letter(&Spot { at, ref line, ref code, .. }: &Spot<'_>) -> Option<Explained> {
    let in_key = |letter: char| letter.is_alphanumeric() || "_-".contains(letter);
    let before = code.get(..at - line.start)?;
    let start = before.trim_end_matches(in_key).len();
    let behind = &code[start..];
    let (key, rest) = behind.split_at(behind.find(|letter| !in_key(letter))?);
    let is_header = code.trim_start().starts_with('[');
    let is_key = is_header || rest.trim_start().starts_with('=');
    (is_key && !key.is_ascii()).then(|| {
        Explained::new(
            line.start + start..line.start + start + key.len(),
            "a key with a letter beyond a to z stands in quotes",
            format!("write `\"{key}\"`"),
        )
    })
}

/// A key with nothing behind its `=`.
fn no_value(Spot { line, code, .. }: &Spot<'_>) -> Option<Explained> {
    let equals = code.match_indices('=').map(|(equals, _)| equals).find(|equals| {
        let after = code[equals + 1..].trim_start();
        let is_comparison = code[..*equals].ends_with(['=', '<', '>', '!']);
        !is_comparison && (after.is_empty() || after.starts_with([',', '}', ']']))
    })?;
    let key = code[..equals].trim_end();
    let start = key.rfind([' ', '{', ',']).map_or(0, |before| before + 1);
    Some(Explained::new(
        line.start + start..line.start + equals + 1,
        "a value is missing",
        format!("write what `{}` is behind its `=`", &key[start..]),
    ))
}

/// Numbers with commas between them behind `=`.
fn bare_list(Spot { line, code, .. }: &Spot<'_>) -> Option<Explained> {
    code.match_indices('=').find_map(|(equals, _)| {
        let value = &code[equals + 1..];
        let value = value[..value.find(['}', ']']).unwrap_or(value.len())].trim();
        let numbers: Vec<&str> = value.split(',').map(str::trim).collect();
        // `0,5` is a decimal comma.
        let is_list = numbers.len() > 1 && value.contains(['.', ' ']);
        if !is_list || !numbers.iter().all(|number| number.parse::<f64>().is_ok()) {
            return None;
        }
        let start = line.start + equals + 1 + code[equals + 1..].find(value)?;
        Some(Explained::new(
            start..start + value.len(),
            "a list needs brackets",
            format!("write `[{}]`", numbers.join(", ")),
        ))
    })
}

/// Keys in brackets instead of braces: `do = [forward_mps = 0.1]`.
fn bracketed_keys(&Spot { text, ref line, ref code, .. }: &Spot<'_>) -> Option<Explained> {
    code.match_indices('[').find_map(|(open, _)| {
        let before = code[..open].trim_end().strip_suffix('=')?.trim_end();
        let close = open + code[open..].find(']')?;
        let (key, _) = code[open + 1..close].split_once('=')?;
        if !is_key(key) {
            return None;
        }
        let inner = text[line.start + open + 1..line.start + close].trim();
        let hint = if before.ends_with("next") {
            format!("write `[{{ {inner} }}]`")
        } else {
            format!("write `{{ {inner} }}`")
        };
        Some(Explained::new(line.start + open..line.start + close + 1, IN_BRACES, hint))
    })
}

/// A key with its value, and no braces around: `do = forward_mps = 0.1`.
fn bare_keys(&Spot { text, ref line, ref code, .. }: &Spot<'_>) -> Option<Explained> {
    let code = code.trim_end();
    let (_, behind) = code.split_once('=')?;
    let (key, value) = behind.split_once('=')?;
    if !is_key(key) || value.starts_with('=') {
        return None;
    }
    let end = line.start + code.len();
    let start = end - behind.trim_start().len();
    Some(Explained::new(start..end, IN_BRACES, format!("write `{{ {} }}`", &text[start..end])))
}

/// Whether it can be a key without quotes, dots included.
fn is_key(text: &str) -> bool {
    let in_key = |letter: char| letter.is_alphanumeric() || "_-.".contains(letter);
    !text.trim().is_empty() && text.trim().chars().all(in_key)
}

/// A number that begins or ends with its point.
fn bare_point(&Spot { text, at, ref line, .. }: &Spot<'_>) -> Option<Explained> {
    let in_number = |letter: char| letter.is_ascii_digit() || "+-.".contains(letter);
    let start = line.start + text[line.start..at].trim_end_matches(in_number).len();
    let end = line.end - text[at..line.end].trim_start_matches(in_number).len();
    let place = start..end;
    let number = &text[place.clone()];
    let (sign, digits) =
        number.split_at(number.len() - number.trim_start_matches(['+', '-']).len());
    let whole = match digits.split_once('.')? {
        ("", after) => format!("{sign}0.{after}"),
        (before, "") => format!("{sign}{before}.0"),
        _ => return None,
    };
    whole.parse::<f64>().ok()?;
    Some(Explained::new(
        place,
        "a number has a digit on both sides of its point",
        format!("write `{whole}`"),
    ))
}

/// Digits, a comma and digits behind `=`.
fn decimal_comma(Spot { line, code, .. }: &Spot<'_>) -> Option<Explained> {
    let is_digit = |place: usize| code.as_bytes().get(place).is_some_and(u8::is_ascii_digit);
    let comma =
        code.char_indices().filter(|(_, letter)| *letter == ',').find_map(|(comma, _)| {
            let value =
                code[..comma].rfind(['=', '[', '{']).filter(|at| code[*at..].starts_with('='));
            let between = value.map(|value| code[value + 1..comma].trim());
            let is_number = between.is_some_and(|number| number.parse::<f64>().is_ok());
            (is_number && comma > 0 && is_digit(comma - 1) && is_digit(comma + 1)).then_some(comma)
        })?;
    let start = code[..comma].trim_end_matches(|letter: char| letter.is_ascii_digit()).len();
    let length = code[comma + 1..].find(|letter: char| !letter.is_ascii_digit());
    let end = length.map_or(code.len(), |length| comma + 1 + length);
    Some(Explained::new(
        line.start + start..line.start + end,
        "a decimal number has a point",
        format!("write `{}.{}`", &code[start..comma], &code[comma + 1..end]),
    ))
}

/// A colon between a key and its value.
fn colon(&Spot { at, ref line, ref code, .. }: &Spot<'_>) -> Option<Explained> {
    let colon = code.find(':').filter(|colon| line.start + colon <= at)?;
    Some(Explained::new(
        line.start + colon..line.start + colon + 1,
        "`:` does not stand between a key and its value",
        "write `=`",
    ))
}

/// A word in quotes inside a text: `"colour == "red""`.
fn quotes_inside(&Spot { text, at, ref line, .. }: &Spot<'_>) -> Option<Explained> {
    let begins = text[..at].ends_with('"') && text[..at].contains('=');
    let after = &text[at..line.end];
    let word = &after[..after.find(|letter: char| !(letter.is_alphanumeric() || letter == '_'))?];
    (begins && !word.is_empty() && after[word.len()..].starts_with('"')).then(|| {
        Explained::new(
            at - 1..at + word.len() + 1,
            "a text ends where its quote stands again",
            format!("inside a text it is {word}, without quotes"),
        )
    })
}

/// A value that is neither a number nor in quotes.
fn bare(&Spot { at, ref line, ref code, .. }: &Spot<'_>) -> Option<Explained> {
    let before = &code[..(at - line.start).min(code.len())];
    let equals = before.rfind('=')?;
    let start = equals + 1 + code[equals + 1..].find(|letter: char| letter != ' ')?;
    let ends = |letter: char| matches!(letter, '{' | '}' | '[' | ']' | '"');
    let mut depth = 0_i32;
    let length = code[start..].find(|letter: char| {
        depth += i32::from(letter == '(') - i32::from(letter == ')');
        ends(letter) || letter == ',' && depth <= 0
    });
    let value = code[start..length.map_or(code.len(), |length| start + length)].trim_end();
    let place = line.start + start..line.start + start + value.len();
    let key = before[..equals].rsplit([' ', '{', ',']).find(|key| !key.is_empty()).unwrap_or("");
    if let Some((first, rest)) = value.split_once(' ')
        && rest.contains('=')
        && first.parse::<f64>().is_ok()
    {
        return Some(Explained::new(
            place,
            "a comma is missing between two keys",
            format!("write `{key} = {first}, {}`", rest.trim()),
        ));
    }
    for (sign, what) in [(";", "a line ends without `;`"), ("//", "a comment begins with `#`")] {
        if let Some((before, _)) = value.split_once(sign) {
            let hint = format!("write `{key} = {}`", before.trim_end());
            return Some(Explained::new(place, what, hint));
        }
    }
    let number = value.trim_start_matches('-');
    let begins = number.chars().next()?;
    let unit = number.trim_start_matches(|letter: char| letter.is_ascii_digit() || letter == '.');
    let in_unit = |letter: char| letter.is_alphabetic() || "%°/".contains(letter);
    if begins.is_ascii_digit()
        && unit.contains(in_unit)
        && unit.trim_start().chars().all(in_unit)
        && key.contains('_')
    {
        return Some(Explained::new(
            place,
            "a number stands without its unit",
            format!("write the number alone: `{key}` says its unit"),
        ));
    }
    let what = if value.parse::<f64>().is_ok() || value.contains('=') {
        return None;
    } else if value.chars().all(|letter| letter.is_alphanumeric() || "_-".contains(letter)) {
        if !begins.is_alphabetic() {
            return None;
        }
        "a text belongs in quotes"
    } else {
        "an expression belongs in quotes"
    };
    Some(Explained::new(place, what, format!("write `{key} = \"{value}\"`")))
}

/// A brace or a bracket that is open at the end of a line of a table in one line.
fn open_brace(&Spot { text, ref line, .. }: &Spot<'_>) -> Option<Explained> {
    let mut end = line.end;
    for _ in 0..LINES_BACK {
        let line = line_of(text, end);
        let (code, _) = code(&text[line.clone()]);
        let mut open = Vec::new();
        for (place, letter) in code.char_indices() {
            match letter {
                '{' => open.push(place),
                '}' => {
                    open.pop();
                }
                _ => {}
            }
        }
        if let Some(brace) = open.first() {
            let place = line.start + brace;
            return Some(Explained::new(
                place..place + 1,
                "this `{` is not closed",
                "put a `}` where it ends",
            ));
        }
        end = line.start.checked_sub(1)?;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::super::{Document, Section};

    /// What is said of a file, and the text of the place.
    fn said(text: &str) -> (String, String, String) {
        let document = Document::new("m.toml", text.as_bytes()).unwrap();
        let findings = document.read(|_: &Section<'_>| Some(())).unwrap_err();
        let all: Vec<_> = findings.iter().collect();
        assert_eq!(all.len(), 1, "{findings}");
        let line = text.lines().nth(all[0].line - 1).unwrap_or_default();
        let place: String = line.chars().skip(all[0].column - 1).collect();
        (all[0].message.clone(), all[0].hint.clone().unwrap_or_default(), place)
    }

    #[test]
    fn mistakes_of_beginners_are_named() {
        for (text, message, hint, place) in [
            (
                "[machine.drive.state.vorwärts]\n",
                "a key with a letter beyond a to z stands in quotes",
                "write `\"vorwärts\"`",
                "vorwärts]",
            ),
            (
                "set = { x = 1, größe = 2 }\n",
                "a key with a letter beyond a to z stands in quotes",
                "write `\"größe\"`",
                "größe = 2 }",
            ),
            (
                "start = forward\n",
                "a text belongs in quotes",
                "write `start = \"forward\"`",
                "forward",
            ),
            (
                "do = { turn_dps = min(1,2) }\n",
                "an expression belongs in quotes",
                "write `turn_dps = \"min(1,2)\"`",
                "min(1,2) }",
            ),
            (
                "do = { turn_dps = 2 * x_m, led = \"red\" }\n",
                "an expression belongs in quotes",
                "write `turn_dps = \"2 * x_m\"`",
                "2 * x_m, led = \"red\" }",
            ),
            (
                "do = { forward_mps = 10 cm }\n",
                "a number stands without its unit",
                "write the number alone: `forward_mps` says its unit",
                "10 cm }",
            ),
            (
                "do = { turn_deg = -90° }\n",
                "a number stands without its unit",
                "write the number alone: `turn_deg` says its unit",
                "-90° }",
            ),
            ("time_limit_s = 60;\n", "a line ends without `;`", "write `time_limit_s = 60`", "60;"),
            (
                "time_limit_s = 60 // a minute\n",
                "a comment begins with `#`",
                "write `time_limit_s = 60`",
                "60 // a minute",
            ),
            (
                "time_limit_s = 2min\n",
                "a number stands without its unit",
                "write the number alone: `time_limit_s` says its unit",
                "2min",
            ),
            (
                "do = { forward_mps = 0,25 }\n",
                "a decimal number has a point",
                "write `0.25`",
                "0,25 }",
            ),
            ("rate = 0,5\n", "a decimal number has a point", "write `0.5`", "0,5"),
            ("rate =\u{a0}0,5\n", "a decimal number has a point", "write `0.5`", "0,5"),
            (
                "do = { goto = [1.0, -.5] }\n",
                "a number has a digit on both sides of its point",
                "write `-0.5`",
                "-.5] }",
            ),
            ("rate = 5.\n", "a number has a digit on both sides of its point", "write `5.0`", "5."),
            (
                "do = { a = 1\nnext = [{ when = \"touch\" }]\n[x]\n",
                "this `{` is not closed",
                "put a `}` where it ends",
                "{ a = 1",
            ),
            (
                "next = [{ when = \"touch\", go = \"b }]\n[x]\n",
                "this text is not closed",
                "put a `\"` where it ends",
                "\"b }]",
            ),
            (
                "next = [{ when = \"colour == \"red\"\", go = \"b\" }]\n",
                "a text ends where its quote stands again",
                "inside a text it is red, without quotes",
                "\"red\"\", go = \"b\" }]",
            ),
            (
                "do = { a: 0.1 }\n",
                "`:` does not stand between a key and its value",
                "write `=`",
                ": 0.1 }",
            ),
            (
                "do = { a = 0.1 b = 3 }\n",
                "a comma is missing between two keys",
                "write `a = 0.1, b = 3`",
                "0.1 b = 3 }",
            ),
            (
                "[a.b]\nx = 1\n[a.c]\n[a.b]\n",
                "`a.b` is there twice",
                "the first one is in line 1",
                "b]",
            ),
            ("x = 1\ny = 2\nx = 3\n", "`x` is there twice", "the first one is in line 1", "x = 3"),
            (
                "do = { goto = 0.3, 0.2 }\n",
                "a list needs brackets",
                "write `[0.3, 0.2]`",
                "0.3, 0.2 }",
            ),
            (
                "do = { forward_mps = }\n",
                "a value is missing",
                "write what `forward_mps` is behind its `=`",
                "forward_mps = }",
            ),
            (
                "drive_m =\n",
                "a value is missing",
                "write what `drive_m` is behind its `=`",
                "drive_m =",
            ),
            (
                "do = { drive_m = , led = \"red\" }\n",
                "a value is missing",
                "write what `drive_m` is behind its `=`",
                "drive_m = , led = \"red\" }",
            ),
            (
                "led = “red”\n",
                "these are not the quotes of a text",
                "write straight quotes: `\"red\"`",
                "“red”",
            ),
            (
                "do = forward_mps = 0.1 # on\n",
                "keys with values stand in braces",
                "write `{ forward_mps = 0.1 }`",
                "forward_mps = 0.1 # on",
            ),
            (
                "do = [forward_mps = 0.1]\n",
                "keys with values stand in braces",
                "write `{ forward_mps = 0.1 }`",
                "[forward_mps = 0.1]",
            ),
            ("x = 1 # }\n]\n", "", "", ""),
        ] {
            let (is_message, is_hint, is_place) = said(text);
            if message.is_empty() {
                // Something else: what the parser says.
                assert!(!is_message.is_empty());
                continue;
            }
            assert_eq!(
                (is_message.as_str(), is_hint.as_str(), is_place.as_str()),
                (message, hint, place),
                "{text}"
            );
        }
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_read_or_explained(text in "[a-z=\\[\\]{}\"'#:,.0-9\\\\ \nä\u{a0}]{0,60}") {
            let document = Document::new("m.toml", text.as_bytes()).unwrap();
            if let Err(findings) = document.read(|_: &Section<'_>| Some(())) {
                proptest::prop_assert!(!findings.to_string().is_empty());
            }
        }
    }
}
