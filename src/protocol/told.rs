//! What a reply says, as it is read: texts of a brick, which are shown to people.

use serde::{Deserialize, Deserializer};
use serde_json::Value;

use super::{Outcome, Refusal};
use crate::printable::{line, lines};

/// The fields that may have lines of their own: findings, and refusals with findings in them. Every
/// other text of a reply stands in a line.
const OF_SEVERAL_LINES: [&str; 5] = ["message", "hint", "findings", "robot", "detail"];

/// What is answered, as it may be shown.
pub(super) fn outcome<'r, D: Deserializer<'r>>(reply: D) -> Result<Outcome, D::Error> {
    Ok(match Outcome::deserialize(reply)? {
        Outcome::Ok(value) => Outcome::Ok(shown(value, false)),
        Outcome::Error(Refusal { kind, message, hint }) => Outcome::Error(Refusal {
            kind,
            message: lines(&message).into_owned(),
            hint: hint.map(|hint| lines(&hint).into_owned()),
        }),
    })
}

/// The same value with texts that may be shown.
fn shown(value: Value, of_several_lines: bool) -> Value {
    match value {
        Value::String(text) if of_several_lines => Value::String(lines(&text).into_owned()),
        Value::String(text) => Value::String(line(&text).into_owned()),
        Value::Array(values) => {
            Value::Array(values.into_iter().map(|value| shown(value, of_several_lines)).collect())
        }
        Value::Object(fields) => {
            let field = |(name, value): (String, Value)| {
                let value = shown(value, OF_SEVERAL_LINES.contains(&name.as_str()));
                (line(&name).into_owned(), value)
            };
            Value::Object(fields.into_iter().map(field).collect())
        }
        plain @ (Value::Null | Value::Bool(_) | Value::Number(_)) => plain,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::Reply;

    fn read(text: &str) -> Outcome {
        serde_json::from_str::<Reply>(text).unwrap().outcome
    }

    #[test]
    fn no_text_of_a_reply_controls_a_terminal_or_forges_a_line() {
        let text = r#"{"id":1,"ok":{"brick":"a\u001b]0;x\nb","missions":[{"name":"m\u202e\n","findings":"a\nb\u009b"}]}}"#;
        let expected = serde_json::json!({
            "brick": r"a\u{1b}]0;x\nb",
            "missions": [{ "name": r"m\u{202e}\n", "findings": "a\nb\\u{9b}" }],
        });
        assert_eq!(read(text), Outcome::Ok(expected));
        let text = r#"{"id":1,"error":{"kind":"busy","message":"\u001b[2Jx\ny","hint":"\u0007"}}"#;
        let Outcome::Error(refusal) = read(text) else { panic!("no refusal") };
        assert_eq!(
            (refusal.message.as_str(), refusal.hint.as_deref()),
            ("\\u{1b}[2Jx\ny", Some("\\u{7}"))
        );
    }

    #[test]
    fn a_text_of_a_reply_has_a_bounded_length() {
        let long = "x".repeat(100_000);
        let Outcome::Ok(Value::String(text)) = read(&format!(r#"{{"id":1,"ok":"{long}"}}"#)) else {
            panic!("no text")
        };
        assert_eq!(text.chars().count(), crate::printable::LONGEST_LINE);
    }
}
