//! Talking with the person beside the robot: the same questions on a terminal, on the brick's
//! screen and in a test.
//!
//! Setting up a robot needs a person who looks: which wheel moved, where the wall is. The code that
//! asks knows only this trait, so a terminal and the brick's menu are two front ends of one
//! program.
//!
//! # Not here
//!
//! No printing and no reading: the trait's implementations do both. No motor turns while a question
//! is open; the one exception is [`Dialogue::is_pressed`], which does not wait.

use std::ops::RangeInclusive;

/// How often a question is asked again when the answer makes no sense.
const TRIES: usize = 5;

/// Why there was no answer. Nothing turns then, and nothing was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NoAnswer {
    /// No answer can come: the input has ended.
    #[error("there is no answer: the input has ended")]
    Closed,
    /// Ctrl-C, or a signal.
    #[error("stopped while a question was open")]
    Stopped,
    /// The person would rather not.
    #[error("you said no; nothing was written")]
    Declined,
    /// Several answers in a row made no sense.
    #[error("no answer that makes sense in {TRIES} tries")]
    Unclear,
}

/// A person who is told things and answers questions.
pub trait Dialogue {
    /// Tells the person something.
    fn say(&mut self, text: &str);

    /// Asks for one of several things and returns its place in `choices`; `default` is what an
    /// empty answer means.
    ///
    /// # Errors
    ///
    /// [`NoAnswer`].
    fn choose(
        &mut self,
        question: &str,
        choices: &[&str],
        default: usize,
    ) -> Result<usize, NoAnswer>;

    /// Asks for a line of text; an empty answer means `default`.
    ///
    /// # Errors
    ///
    /// [`NoAnswer`].
    fn text(&mut self, question: &str, default: &str) -> Result<String, NoAnswer>;

    /// True if the person has pressed Enter since the last question or the last call. Does not
    /// wait: motors are turning.
    fn is_pressed(&mut self) -> bool;

    /// Waits until the person says that it can go on; false where they would rather not.
    ///
    /// # Errors
    ///
    /// [`NoAnswer`].
    fn confirm(&mut self, question: &str) -> Result<bool, NoAnswer> {
        self.choose(question, &["yes", "no"], 0).map(|choice| choice == 0)
    }

    /// Waits until the person says that it can go on.
    ///
    /// # Errors
    ///
    /// [`NoAnswer`]; [`NoAnswer::Declined`] where they would rather not.
    fn agree(&mut self, question: &str) -> Result<(), NoAnswer> {
        if self.confirm(question)? { Ok(()) } else { Err(NoAnswer::Declined) }
    }

    /// Asks for a number within `range`.
    ///
    /// # Errors
    ///
    /// [`NoAnswer`].
    fn number(
        &mut self,
        question: &str,
        default: f64,
        range: RangeInclusive<f64>,
    ) -> Result<f64, NoAnswer> {
        parsed(self, question, &default.to_string(), |text| {
            // People on half of the continents write a comma.
            match text.replace(',', ".").parse::<f64>() {
                Ok(number) if range.contains(&number) => Ok(number),
                Ok(number) => Err(format!(
                    "{number} is not between {} and {}; please try again",
                    range.start(),
                    range.end()
                )),
                Err(_) => {
                    Err(format!("`{text}` is not a number; please write one such as {default}"))
                }
            }
        })
    }
}

/// Asks for text until `read` can make something of it; what `read` objects to is said.
pub(super) fn parsed<T>(
    dialogue: &mut (impl Dialogue + ?Sized),
    question: &str,
    default: &str,
    read: impl Fn(&str) -> Result<T, String>,
) -> Result<T, NoAnswer> {
    for _ in 0..TRIES {
        let text = dialogue.text(question, default)?;
        match read(text.trim()) {
            Ok(value) => return Ok(value),
            Err(objection) => dialogue.say(&objection),
        }
    }
    Err(NoAnswer::Unclear)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Answers from a list; what it was told is kept.
    #[derive(Default)]
    struct Script {
        answers: Vec<&'static str>,
        told: Vec<String>,
    }

    impl Dialogue for Script {
        fn say(&mut self, text: &str) {
            self.told.push(text.to_owned());
        }

        fn choose(&mut self, _: &str, choices: &[&str], default: usize) -> Result<usize, NoAnswer> {
            let answer = self.text("", "")?;
            Ok(choices.iter().position(|choice| *choice == answer).unwrap_or(default))
        }

        fn text(&mut self, _: &str, default: &str) -> Result<String, NoAnswer> {
            let answer = if self.answers.is_empty() { None } else { Some(self.answers.remove(0)) };
            answer
                .map(|text| if text.is_empty() { default.to_owned() } else { text.to_owned() })
                .ok_or(NoAnswer::Closed)
        }

        fn is_pressed(&mut self) -> bool {
            false
        }
    }

    #[test]
    fn a_number_is_asked_for_until_it_makes_sense() {
        let mut person = Script { answers: vec!["wide", "9", "nan", "0,2"], ..Script::default() };
        assert_eq!(person.number("how wide?", 0.1, 0.01..=2.0), Ok(0.2));
        assert_eq!(person.told.len(), 3, "{:?}", person.told);
        assert!(person.told[0].contains("`wide` is not a number"), "{:?}", person.told);
        assert!(person.told[1].contains("9 is not between 0.01 and 2"), "{:?}", person.told);
    }

    #[test]
    fn an_empty_answer_is_the_default_and_no_answer_is_an_error() {
        let mut person = Script { answers: vec![""], ..Script::default() };
        assert_eq!(person.number("how wide?", 0.1, 0.01..=2.0), Ok(0.1));
        assert_eq!(person.number("how wide?", 0.1, 0.01..=2.0), Err(NoAnswer::Closed));
        let mut person = Script { answers: vec!["x"; 20], ..Script::default() };
        assert_eq!(person.number("how wide?", 0.1, 0.01..=2.0), Err(NoAnswer::Unclear));
    }
}
