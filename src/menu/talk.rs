//! Setting up and calibrating on the screen: the same code as the commands, asking here instead of
//! on a terminal.
//!
//! What asks runs on a thread of its own with a [`ScreenDialogue`]; what it says and asks comes to
//! the menu as [`Told`], and what a person answers goes back as [`TalkReply`]. No motor turns while
//! a question is open.
//!
//! Text is written letter by letter: Up and Down change a letter, Left and Right move, Enter takes
//! all.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender};
use std::time::Duration;

use super::sheet::{Sheet, View};
use super::{Menu, Showing};
use crate::commissioning::{CalibrateOptions, Dialogue, NoAnswer};
use crate::ev3dev::Button;
use crate::runtime::StopFlags;

/// What is talked about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TalkKind {
    /// Which motor is which wheel, which sensor is where: `onbrick setup`.
    SetUp,
    /// Wheel circumference and track width: `onbrick calibrate`.
    Calibrate,
    /// What the range sensor reads too far: `onbrick calibrate --only range`.
    Range,
    /// Where it hears the robot itself: `onbrick calibrate --only own-echoes`.
    OwnEchoes,
}

impl TalkKind {
    pub(super) const ALL: [Self; 4] = [Self::SetUp, Self::Calibrate, Self::Range, Self::OwnEchoes];

    /// What is measured, if it is a measurement.
    #[must_use]
    pub fn measures(self) -> Option<CalibrateOptions> {
        match self {
            Self::SetUp => None,
            Self::Calibrate => Some(CalibrateOptions::default()),
            Self::Range => Some(CalibrateOptions { range: true, ..CalibrateOptions::NOTHING }),
            Self::OwnEchoes => {
                Some(CalibrateOptions { own_echoes: true, ..CalibrateOptions::NOTHING })
            }
        }
    }

    /// How it is called on the screen.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::SetUp => "Set up the robot",
            Self::Calibrate => "Calibrate by driving",
            Self::Range => "Measure the range",
            Self::OwnEchoes => "Find own echoes",
        }
    }
}

/// What the talking side tells the screen.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Told {
    /// Something a person should know.
    Said(String),
    /// One of several things is to be chosen.
    Choose {
        /// What is asked.
        question: String,
        /// What there is.
        choices: Vec<String>,
        /// What is chosen at first.
        default: usize,
    },
    /// A text is to be written.
    Write {
        /// What is asked.
        question: String,
        /// What stands there at first.
        default: String,
    },
    /// It is over: what was written, or why nothing was.
    Over(Result<String, String>),
}

/// What a person answers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TalkReply {
    /// This one of the choices.
    Chosen(usize),
    /// This text.
    Written(String),
}

/// Where answers to a talk go.
#[derive(Debug)]
pub struct Replies {
    /// To the one who asks.
    pub sender: Sender<TalkReply>,
    /// Raised by Enter while no question is open.
    pub pressed: Arc<AtomicBool>,
    /// Raised to end it.
    pub flags: StopFlags,
}

/// Who sets up and calibrates: starts a thread that talks.
pub trait Talker {
    /// Begins; what is told comes over `told`, the last of it [`Told::Over`].
    fn begin(&mut self, kind: TalkKind, told: Sender<Told>) -> Replies;
}

/// A [`Dialogue`] whose other side is the menu.
#[derive(Debug)]
pub struct ScreenDialogue {
    /// To the screen.
    pub told: Sender<Told>,
    /// From the person.
    pub replies: Receiver<TalkReply>,
    /// Enter was pressed.
    pub pressed: Arc<AtomicBool>,
    /// It is to end.
    pub flags: StopFlags,
}

impl ScreenDialogue {
    /// Asks, and waits for the answer.
    fn ask(&mut self, question: Told) -> Result<TalkReply, NoAnswer> {
        self.told.send(question).map_err(|_| NoAnswer::Closed)?;
        loop {
            match self.replies.recv_timeout(Duration::from_millis(100)) {
                Ok(reply) => {
                    // The press that answered is no press for what comes after.
                    self.pressed.store(false, Ordering::Relaxed);
                    return Ok(reply);
                }
                Err(RecvTimeoutError::Disconnected) => return Err(NoAnswer::Closed),
                Err(RecvTimeoutError::Timeout) if self.flags.is_raised() => {
                    return Err(NoAnswer::Stopped);
                }
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }
}

impl Dialogue for ScreenDialogue {
    fn say(&mut self, text: &str) {
        // A screen that is gone ends the next question.
        let _ = self.told.send(Told::Said(text.to_owned()));
    }

    fn choose(
        &mut self,
        question: &str,
        choices: &[&str],
        default: usize,
    ) -> Result<usize, NoAnswer> {
        let choices: Vec<String> = choices.iter().map(|choice| (*choice).to_owned()).collect();
        let count = choices.len();
        match self.ask(Told::Choose { question: question.to_owned(), choices, default })? {
            TalkReply::Chosen(choice) if choice < count => Ok(choice),
            _ => Err(NoAnswer::Unclear),
        }
    }

    fn text(&mut self, question: &str, default: &str) -> Result<String, NoAnswer> {
        match self
            .ask(Told::Write { question: question.to_owned(), default: default.to_owned() })?
        {
            TalkReply::Written(text) if text.is_empty() => Ok(default.to_owned()),
            TalkReply::Written(text) => Ok(text),
            TalkReply::Chosen(_) => Err(NoAnswer::Unclear),
        }
    }

    fn is_pressed(&mut self) -> bool {
        self.pressed.swap(false, Ordering::Relaxed)
    }
}

/// Older lines are forgotten.
const MOST_LINES: usize = 40;

/// The letters that Up and Down go through where a number is asked for.
const DIGITS: &str = "0123456789.- ";

/// The letters elsewhere: the space that ends a text is next to `a`.
const LETTERS: &str =
    " abcdefghijklmnopqrstuvwxyzäöüßéèàçñ0123456789-_.:ABCDEFGHIJKLMNOPQRSTUVWXYZ";

/// The longest text that can be written.
const LONGEST: usize = 40;

/// A talk as it stands on the screen.
#[derive(Debug)]
pub(super) struct Talk {
    kind: TalkKind,
    said: Vec<String>,
    question: Option<Question>,
    over: Option<Result<String, String>>,
    pub(super) view: View,
}

#[derive(Debug)]
enum Question {
    Choose { question: String, choices: Vec<String> },
    Write { question: String, letters: Vec<char>, place: usize, alphabet: &'static str },
}

impl Talk {
    pub(super) fn new(kind: TalkKind) -> Self {
        Self { kind, said: Vec::new(), question: None, over: None, view: View::default() }
    }

    fn told(&mut self, told: Told) {
        match told {
            Told::Said(text) => {
                self.said.push(text);
                if self.said.len() > MOST_LINES {
                    self.said.remove(0);
                }
                self.follow();
            }
            Told::Choose { question, choices, default } => {
                self.question = Some(Question::Choose { question, choices });
                self.view = View::at(default);
            }
            Told::Write { question, default } => {
                let alphabet = if default.trim().chars().all(|letter| DIGITS.contains(letter)) {
                    DIGITS
                } else {
                    LETTERS
                };
                let letters = default.chars().take(LONGEST).collect();
                self.question = Some(Question::Write { question, letters, place: 0, alphabet });
                self.view = View::default();
            }
            Told::Over(how) => {
                self.question = None;
                self.over = Some(how);
                self.view = View::default();
            }
        }
    }

    /// Keeps the newest line in view while nothing is asked.
    fn follow(&mut self) {
        if self.question.is_none() {
            let sheet = self.sheet();
            for _ in 0..MOST_LINES {
                self.view = sheet.down(self.view);
            }
        }
    }

    pub(super) fn is_asking(&self) -> bool {
        self.question.is_some()
    }

    pub(super) fn is_over(&self) -> bool {
        self.over.is_some()
    }

    /// The answer as it stands; the question is closed, and what was said before it is read.
    pub(super) fn answer(&mut self) -> Option<TalkReply> {
        let reply = match self.question.take()? {
            Question::Choose { choices, .. } => {
                TalkReply::Chosen(self.view.chosen.min(choices.len().saturating_sub(1)))
            }
            Question::Write { letters, .. } => {
                TalkReply::Written(letters.into_iter().collect::<String>().trim().to_owned())
            }
        };
        self.said.clear();
        self.view = View::default();
        Some(reply)
    }

    /// Changes the text that is being written; true where the button did that.
    pub(super) fn edits(&mut self, button: Button) -> bool {
        if !self.sheet().sees_chosen(self.view) {
            return false;
        }
        let Some(Question::Write { letters, place, alphabet, .. }) = &mut self.question else {
            return false;
        };
        match button {
            Button::Left => *place = place.saturating_sub(1),
            Button::Right => {
                *place = (*place + 1).min(letters.len()).min(LONGEST - 1);
                if *place == letters.len() {
                    letters.push(' ');
                }
            }
            Button::Up | Button::Down => {
                if letters.is_empty() {
                    letters.push(' ');
                }
                if let Some(letter) = letters.get_mut(*place) {
                    *letter = turned(alphabet, *letter, button == Button::Up);
                }
            }
            Button::Enter | Button::Back => return false,
        }
        true
    }

    pub(super) fn sheet(&self) -> Sheet {
        let title = match self.kind {
            TalkKind::SetUp => "Set up",
            TalkKind::Calibrate | TalkKind::Range | TalkKind::OwnEchoes => "Calibrate",
        };
        let sheet = Sheet::new(title).lines(&self.said);
        match (&self.over, &self.question) {
            (Some(Ok(done)), _) => sheet.strong(done).item("OK"),
            (Some(Err(why)), _) => sheet.strong("Nothing was written.").line(why).item("OK"),
            (None, Some(Question::Choose { question, choices })) => {
                sheet.strong(question).items(choices)
            }
            // What is written stands last: Up and Down no longer scroll once it is in view.
            (None, Some(Question::Write { question, letters, place, .. })) => sheet
                .strong(question)
                .line("Up, Down: letter; Right: next; Enter: done.")
                .item(with_cursor(letters, *place)),
            (None, None) => sheet.line("..."),
        }
    }
}

/// The letter before or after one; the first of them for a letter that is not among them.
fn turned(alphabet: &str, letter: char, up: bool) -> char {
    let letters: Vec<char> = alphabet.chars().collect();
    let count = letters.len();
    let place = letters.iter().position(|known| *known == letter).unwrap_or(0);
    let place = if up { place + 1 } else { place + count - 1 } % count;
    letters.get(place).copied().unwrap_or(' ')
}

/// The text with the letter that Up and Down change in brackets.
fn with_cursor(letters: &[char], place: usize) -> String {
    let mut text = String::new();
    for (at, letter) in letters.iter().enumerate() {
        if at == place {
            text.extend(['[', *letter, ']']);
        } else {
            text.push(*letter);
        }
    }
    if letters.is_empty() {
        text.push_str("[ ]");
    }
    text
}

impl Menu {
    /// The talking side said or asked something.
    pub fn told(&mut self, told: Told) {
        if let Some(talk) = &mut self.talk {
            talk.told(told);
            self.changed |= self.showing() == Showing::Talk;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    #[test]
    fn a_text_is_written_with_five_buttons() {
        let mut talk = Talk::new(TalkKind::SetUp);
        talk.told(Told::Write {
            question: "What is it called?".to_owned(),
            default: "ab".to_owned(),
        });
        for button in [
            Button::Up,
            Button::Right,
            Button::Down,
            Button::Right,
            Button::Up,
            Button::Left,
            Button::Left,
            Button::Left,
        ] {
            assert!(talk.edits(button), "{button:?}");
        }
        assert!(!talk.edits(Button::Enter));
        assert_eq!(talk.answer(), Some(TalkReply::Written("baa".to_owned())));
        assert_eq!(talk.answer(), None);
    }

    #[test]
    fn numbers_turn_through_digits() {
        let items = |talk: &Talk| -> Vec<String> {
            let rows = talk.sheet().rows.into_iter();
            rows.filter(|row| row.is_item).map(|row| row.text).collect()
        };
        let mut talk = Talk::new(TalkKind::Calibrate);
        talk.told(Told::Write { question: "How wide?".to_owned(), default: "0.19".to_owned() });
        talk.edits(Button::Down);
        assert_eq!(items(&talk), ["[ ].19"]);
        talk.edits(Button::Up);
        assert_eq!(items(&talk), ["[0].19"]);
    }

    #[test]
    fn the_same_dialogue_asks_here_and_stops_when_it_is_told() {
        let (told, screen) = channel();
        let (sender, replies) = channel();
        let flags = StopFlags::default();
        let mut dialogue =
            ScreenDialogue { told, replies, pressed: Arc::default(), flags: flags.clone() };
        for reply in [
            TalkReply::Chosen(1),
            TalkReply::Written("0,2".to_owned()),
            TalkReply::Written(String::new()),
        ] {
            sender.send(reply).unwrap();
        }
        assert_eq!(dialogue.confirm("ready?"), Ok(false));
        assert_eq!(dialogue.number("how wide?", 0.1, 0.0..=1.0), Ok(0.2));
        assert_eq!(dialogue.text("name?", "mapper"), Ok("mapper".to_owned()));
        assert_eq!(screen.try_iter().count(), 3);
        flags.signal.store(true, Ordering::Relaxed);
        assert_eq!(dialogue.confirm("ready?"), Err(NoAnswer::Stopped));
        drop(sender);
        assert_eq!(dialogue.confirm("ready?"), Err(NoAnswer::Closed));
    }
}
