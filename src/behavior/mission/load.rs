//! A mission file to machines: keys, names, expressions.
//!
//! What concerns the mission as a whole is looked at afterwards, in `checks`.

use std::collections::BTreeSet;
use std::ops::Range;

use super::{Assignment, Bounded, Mission, OnLost, Outputs, checks};
use crate::behavior::MAX_VARIABLES;
use crate::behavior::engine::Finish;
use crate::behavior::expression::{
    Claims, Expression, Kind, Misreading, Mistake, Vocabulary, is_plain,
};
use crate::behavior::signals::Capabilities;
use crate::behavior::tune::Tune;
use crate::document::{Document, Findings, Item, Kind as FileKind, Section, Severity};
use crate::printable::{self, is_printable};
use crate::senses::Channel;

mod actions;
mod done;
mod machines;
mod signs;

pub(super) use machines::Draft;

/// Longest name of a mission, a machine or a state, in characters.
const NAME_CHARACTERS: usize = 40;

/// The keys of the whole mission.
const KEYS: [&str; 10] = [
    "name",
    "rate_hz",
    "time_limit_s",
    "finish",
    "on_lost",
    "on_stall",
    "numbers",
    "variables",
    "machine",
    "submachine",
];

const DEFAULT_RATE_HZ: u32 = 50;
const DEFAULT_TIME_LIMIT_S: f64 = 120.0;

pub(super) fn load(
    document: &Document,
    capabilities: &Capabilities,
) -> Result<(Mission, Findings), Findings> {
    document.read(|root| {
        let vocabulary = Vocabulary::new(capabilities);
        let reader = Reader {
            root,
            vocabulary,
            firsts: Vec::new(),
            bounded: Vec::new(),
            uses: Vec::new(),
            absent: BTreeSet::new(),
            tunes: Vec::new(),
            states: 0,
            used: BTreeSet::new(),
        };
        reader.mission()
    })
}

/// A file that is being read.
pub(super) struct Reader<'r, 'd, 'c> {
    pub(super) root: &'r Section<'d>,
    pub(super) vocabulary: Vocabulary<'c>,
    /// What variables begin with that do not begin with a number.
    firsts: Vec<Assignment>,
    /// What the mission's own numbers must not bring out of its limits.
    bounded: Vec<Bounded>,
    /// What of the robot is sensed or moved, and where in the file.
    pub(super) uses: Vec<(Channel, Range<usize>)>,
    /// The parts of which it was said that the robot does not have them.
    absent: BTreeSet<&'static str>,
    /// The tunes so far.
    tunes: Vec<Tune>,
    /// How many states there are so far.
    states: usize,
    /// The sub-machines that are used so far.
    used: BTreeSet<&'d str>,
}

impl<'d> Reader<'_, 'd, '_> {
    fn mission(mut self) -> Option<Mission> {
        let root = self.root;
        if root.is_of_another_kind(FileKind::Mission) {
            return None;
        }
        root.allow(&KEYS);
        let name = root.require("name").and_then(|item| {
            let text = item.text()?;
            is_name(text, &item).then(|| text.to_owned())
        });
        let rate_hz = root.value_or("rate_hz", DEFAULT_RATE_HZ, |item| {
            item.integer(10..=100).and_then(|hz| u32::try_from(hz).ok())
        });
        let (low, high) = Mission::TIME_LIMITS_S;
        let time_limit_s = root
            .value_or(Mission::TIME_LIMIT, DEFAULT_TIME_LIMIT_S, |item| item.number(low..=high));
        let finish = root.value_or("finish", Finish::All, |item| {
            item.word(&[("all", Finish::All), ("any", Finish::Any)])
        });
        let on_lost = root.value_or("on_lost", OnLost::Stop, |item| {
            item.word(&[("stop", OnLost::Stop), ("pause", OnLost::Pause)])
        });
        self.vocabulary
            .numbers
            // With a wrong one nothing is too late.
            .insert(Mission::TIME_LIMIT.to_owned(), time_limit_s.unwrap_or(high));
        self.numbers();
        self.variables();
        let mut drafts = self.machines()?;
        // What would be said of the whole is not certain without a machine that could not be read.
        if drafts.len() < root.items_of("machine").len() {
            return None;
        }
        let knows_stalls = checks::on_stall(root, &mut drafts);
        // A slip in the name of the state for a stall would look like a state that cannot be
        // reached.
        checks::whole(&self, &drafts, finish.unwrap_or(Finish::All), knows_stalls);
        let used: Vec<Channel> = self.uses.iter().map(|(channel, _)| *channel).collect();
        Some(Mission {
            name: name?,
            rate_hz: rate_hz?,
            time_limit_s: time_limit_s?,
            finish: finish?,
            on_lost: on_lost?,
            motors: self.vocabulary.motors.names().to_vec(),
            sensors: self.vocabulary.sensors.names().to_vec(),
            numbers: self.vocabulary.numbers,
            variables: self.vocabulary.variables,
            firsts: self.firsts,
            bounded: self.bounded,
            tunes: self.tunes,
            machines: drafts.into_iter().map(|draft| draft.plan).collect(),
            senses: Channel::ALL.into_iter().filter(|channel| used.contains(channel)).collect(),
        })
    }

    /// When the mission ends at the latest, seconds.
    pub(super) fn time_limit_s(&self) -> f64 {
        let given = self.vocabulary.numbers.get(Mission::TIME_LIMIT);
        given.copied().unwrap_or(DEFAULT_TIME_LIMIT_S)
    }

    /// The mission's own numbers.
    fn numbers(&mut self) {
        for item in self.root.items_of("numbers") {
            let (low, high) = Mission::NUMBERS;
            let value = item.number(low..=high);
            let Some(name) = self.own_name(&item) else { continue };
            if let Some(value) = value {
                self.vocabulary.numbers.insert(name, value);
            } else {
                // Where its value is wrong it is no unknown name.
                self.vocabulary.unread.insert(name);
            }
        }
    }

    /// The mission's variables, with what they are at the start.
    fn variables(&mut self) {
        let items = self.root.items_of("variables");
        if let Some(one_more) = items.get(MAX_VARIABLES) {
            let count = items.len();
            one_more.error_at_key(format!(
                "{count} variables are too many; at most {MAX_VARIABLES} are kept"
            ));
        }
        for item in items.iter().take(MAX_VARIABLES) {
            let Some(name) = self.own_name(item) else { continue };
            if self.vocabulary.numbers.contains_key(&name) {
                item.error_at_key(format!("`{name}` is one of [numbers], which do not change"))
                    .hint("choose another name, or leave it out there");
                continue;
            }
            let value = self.number(item, Mission::NUMBERS);
            let always = value.as_ref().and_then(Expression::always);
            let known = &mut self.vocabulary.variables;
            if let (Some(value), None, Ok(variable)) = (value, always, u8::try_from(known.len())) {
                self.firsts.push(Assignment { variable, value });
            }
            // Where its value is wrong, too: it is no unknown name.
            known.push((name, always.unwrap_or_default()));
        }
    }

    /// A name of the mission's own.
    fn own_name(&self, item: &Item<'d>) -> Option<String> {
        let name = item.key();
        if name == Mission::TIME_LIMIT {
            item.error_at_key(format!("`{name}` is a key of the whole mission"))
                .hint("write it above the first [table] of the file");
        } else if Vocabulary::is_taken(name) {
            item.error_at_key(format!("`{name}` already has a meaning in conditions"))
                .hint("choose another name");
        } else if !is_plain(name) {
            item.error_at_key(format!("`{name}` cannot be a name in conditions"))
                .hint("use letters, digits and `_`, with a letter first");
        } else {
            return Some(name.to_owned());
        }
        None
    }

    /// A number, as it stands or as an expression in quotes.
    pub(super) fn number(
        &mut self,
        item: &Item<'d>,
        (low, high): (f64, f64),
    ) -> Option<Expression> {
        if !item.is_text() {
            return item.number(low..=high).map(Expression::constant);
        }
        let expression = self.expression(item, Kind::Number)?;
        let bounded = Bounded { path: item.path().to_owned(), expression, low, high };
        if let Some(beyond) = bounded.beyond() {
            item.error(beyond.to_string());
            return None;
        }
        let expression = bounded.expression.clone();
        if expression.in_a_run().is_some() && expression.always().is_none() {
            self.bounded.push(bounded);
        }
        Some(expression)
    }

    fn expression(&mut self, item: &Item<'d>, kind: Kind) -> Option<Expression> {
        let read = Expression::parse(item.text()?, kind, &mut self.vocabulary);
        self.understood(item, 0, read)
    }

    /// What was read of an item's text from the byte `start` on; its mistakes become findings.
    fn understood(
        &mut self,
        item: &Item<'d>,
        start: usize,
        read: Result<Expression, Vec<Misreading>>,
    ) -> Option<Expression> {
        match read {
            Ok(expression) => {
                self.uses.extend(expression.channels().map(|channel| (channel, item.place())));
                if let Some((message, hint)) = expression.unordered() {
                    item.error(message).hint(hint);
                    return None;
                }
                if let Some(beyond) = expression.beyond(self.time_limit_s(), None) {
                    let claims = Claims::of(&expression);
                    // One that never holds, or always does, is told as that.
                    if !claims.is_never() && !claims.is_always() {
                        item.warning(beyond.message()).hint(beyond.hint());
                    }
                }
                if let Some((message, hint)) = expression.exactly() {
                    item.warning(message).hint(hint);
                }
                Some(expression)
            }
            Err(misreadings) => {
                for Misreading { place, mistake, hint } in misreadings {
                    // A part that is missing is one thing to do, wherever it is asked for.
                    if let Mistake::NoPart { part, .. } = mistake
                        && !self.absent.insert(part)
                    {
                        continue;
                    }
                    let place = item.place_within(place.start + start..place.end + start);
                    self.root
                        .note(place, Severity::Error, mistake.to_string())
                        .hint(hint.unwrap_or_default());
                }
                None
            }
        }
    }
}

/// Names stand in messages, in graphs and on a small screen.
pub(in crate::behavior) fn can_be_name(name: &str) -> bool {
    (1..=NAME_CHARACTERS).contains(&name.chars().count()) && name.chars().all(is_printable)
}

/// Says so where a text cannot be a name.
fn is_name(name: &str, item: &Item<'_>) -> bool {
    let good = can_be_name(name);
    if !good {
        item.error_at_key(format!(
            "a name has 1 to {NAME_CHARACTERS} characters on one line, not `{}`",
            printable::name(name)
        ));
    }
    good
}
