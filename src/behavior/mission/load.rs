//! A mission file to machines: keys, names, expressions.
//!
//! What concerns the mission as a whole is looked at afterwards, in `checks`.

use std::collections::BTreeMap;
use std::ops::Range;

use super::{MachinePlan, Mission, OnLost, Outputs, StatePlan, TransitionPlan, checks};
use crate::behavior::MAX_MACHINES;
use crate::behavior::engine::Finish;
use crate::behavior::expression::{Expression, Kind, Vocabulary, is_plain};
use crate::behavior::signals::{Capabilities, words};
use crate::document::{Document, Findings, Item, Section, Severity, nearest};
use crate::printable::is_printable;
use crate::senses::{Channel, Role};

mod actions;

/// Longest name of a mission, a machine or a state, in characters.
const NAME_CHARACTERS: usize = 40;

/// With more names than this the nearest one is not looked for: it would take longer than reading
/// the file.
const SEARCHED: usize = 200;

/// The keys of the whole mission.
const KEYS: [&str; 8] =
    ["name", "rate_hz", "time_limit_s", "finish", "on_lost", "on_stall", "numbers", "machine"];

const DEFAULT_RATE_HZ: u32 = 50;
const DEFAULT_TIME_LIMIT_S: f64 = 120.0;

pub(super) fn load(
    document: &Document,
    capabilities: &Capabilities,
) -> Result<(Mission, Findings), Findings> {
    document.read(|root| {
        Reader { root, vocabulary: Vocabulary::new(capabilities), uses: Vec::new(), states: 0 }
            .mission()
    })
}

/// A file that is being read.
pub(super) struct Reader<'r, 'd, 'c> {
    pub(super) root: &'r Section<'d>,
    pub(super) vocabulary: Vocabulary<'c>,
    /// What of the robot is sensed or moved, and where in the file.
    pub(super) uses: Vec<(Channel, Range<usize>)>,
    /// How many states there are so far.
    states: usize,
}

/// A machine with the places of its parts.
pub(super) struct Draft {
    pub(super) plan: MachinePlan,
    /// Where each state's name stands.
    pub(super) states: Vec<Range<usize>>,
    /// Where each state's conditions stand.
    pub(super) conditions: Vec<Vec<Range<usize>>>,
    /// What it moves, and where that is said first.
    pub(super) moves: BTreeMap<Role, Range<usize>>,
    /// False where a part could not be read: checks of the whole would then mislead.
    pub(super) complete: bool,
}

/// A transition, and where its condition stands.
type Placed = (TransitionPlan, Range<usize>);

/// The names of a machine's states.
struct Names<'d> {
    machine: &'d str,
    places: BTreeMap<&'d str, u16>,
}

impl<'d> Reader<'_, 'd, '_> {
    fn mission(mut self) -> Option<Mission> {
        let root = self.root;
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
            .insert(Mission::TIME_LIMIT.to_owned(), time_limit_s.unwrap_or(DEFAULT_TIME_LIMIT_S));
        self.numbers();
        let drafts = self.machines()?;
        let on_stall = checks::on_stall(root, &drafts);
        checks::whole(&self, &drafts, on_stall.as_ref());
        let used: Vec<Channel> = self.uses.iter().map(|(channel, _)| *channel).collect();
        Some(Mission {
            name: name?,
            rate_hz: rate_hz?,
            time_limit_s: time_limit_s?,
            finish: finish?,
            on_lost: on_lost?,
            on_stall: on_stall?,
            motors: self.vocabulary.motors().to_vec(),
            numbers: self.vocabulary.numbers,
            machines: drafts.into_iter().map(|draft| draft.plan).collect(),
            senses: Channel::ALL.into_iter().filter(|channel| used.contains(channel)).collect(),
        })
    }

    /// The mission's own numbers.
    fn numbers(&mut self) {
        let (low, high) = Mission::NUMBERS;
        for item in self.root.section("numbers").iter().flat_map(Section::items) {
            let name = item.key();
            let taken = words().any(|word| word.name == name)
                || [Mission::TIME_LIMIT, "and", "or", "not", "true", "false", "motor"]
                    .contains(&name);
            if taken {
                item.error_at_key(format!("`{name}` already has a meaning in conditions"))
                    .hint("choose another name");
            } else if !is_plain(name) {
                item.error_at_key(format!("`{name}` cannot be a name in conditions"))
                    .hint("use letters, digits and `_`, with a letter first");
            } else if let Some(number) = item.number(low..=high) {
                self.vocabulary.numbers.insert(name.to_owned(), number);
            }
        }
    }

    fn machines(&mut self) -> Option<Vec<Draft>> {
        let section = self.root.require("machine")?.section()?;
        let items = section.items();
        if items.is_empty() {
            section.error("a mission needs at least one machine".to_owned());
        }
        if let Some(item) = items.get(MAX_MACHINES) {
            item.error_at_key(format!(
                "this is machine {}; at most {MAX_MACHINES} run side by side",
                items.len()
            ));
            return None;
        }
        Some(items.iter().filter_map(|item| self.machine(item)).collect())
    }

    fn machine(&mut self, item: &Item<'d>) -> Option<Draft> {
        let section = item.section()?;
        is_name(item.key(), item);
        section.allow(&["start", "final", "state"]);
        let start = section.require("start");
        let states = section.require("state")?.section()?.items();
        self.states += states.len();
        if self.states > Mission::MAX_STATES {
            item.error_at_key(format!(
                "{} states are too many; at most {} are read",
                self.states,
                Mission::MAX_STATES
            ));
            return None;
        }
        let places = (0_u16..).zip(&states).map(|(at, state)| (state.key(), at)).collect();
        let names = Names { machine: item.key(), places };
        let start = start.and_then(|start| names.find(&start));
        let end = section.get("final").map(|end| names.find(&end));
        let mut draft = Draft {
            plan: MachinePlan {
                name: item.key().to_owned(),
                start: start.unwrap_or_default(),
                end: end.flatten(),
                states: Vec::with_capacity(states.len()),
            },
            states: states.iter().map(Item::key_place).collect(),
            conditions: Vec::with_capacity(states.len()),
            moves: BTreeMap::new(),
            complete: start.is_some() && end != Some(None),
        };
        for state in &states {
            self.state(state, &names, &mut draft);
        }
        Some(draft)
    }

    fn state(&mut self, item: &Item<'d>, names: &Names<'d>, draft: &mut Draft) {
        is_name(item.key(), item);
        let section = item.section();
        if let Some(section) = &section {
            let known = ["do", "on_entry", "on_exit", "next"];
            section.allow(&known);
            // A slip in `next` would look like a state that cannot be left.
            draft.complete &= section.items().iter().all(|item| known.contains(&item.key()));
        }
        let table = |key: &str| section.as_ref()?.get(key)?.section();
        let doing =
            table("do").map(|table| self.actions(&table, &mut draft.moves)).unwrap_or_default();
        let mut signs = |key: &str| table(key).map(|table| self.signs(&table)).unwrap_or_default();
        let (on_entry, on_exit) = (signs("on_entry"), signs("on_exit"));
        let next = section
            .and_then(|section| section.get("next"))
            .map_or(Some(Vec::new()), |next| next.list());
        draft.complete &= next.is_some();
        let next = self.transitions(next.unwrap_or_default(), names);
        draft.complete &= next.iter().all(Option::is_some);
        let (next, conditions) = next.into_iter().flatten().unzip();
        draft.conditions.push(conditions);
        draft.plan.states.push(StatePlan {
            name: item.key().to_owned(),
            doing,
            on_entry,
            on_exit,
            next,
        });
    }

    /// Transitions, `None` for each that could not be read, and for all where there are too many.
    fn transitions(&mut self, list: Vec<Item<'d>>, names: &Names<'d>) -> Vec<Option<Placed>> {
        if let Some(one_more) = list.get(Mission::MAX_TRANSITIONS) {
            let (count, most) = (list.len(), Mission::MAX_TRANSITIONS);
            one_more.error(format!("{count} transitions are too many; at most {most} are read"));
            return vec![None];
        }
        list.iter().map(|item| self.transition(item, names)).collect()
    }

    /// A transition, and where its condition stands.
    fn transition(&mut self, item: &Item<'d>, names: &Names<'d>) -> Option<Placed> {
        let section = item.section()?;
        section.allow(&["when", "go"]);
        let (when, go) = (section.require("when"), section.require("go"));
        let go = go.and_then(|go| names.find(&go));
        let when = when?;
        let condition = self.expression(&when, Kind::Truth);
        Some((TransitionPlan { when: condition?, go: go? }, when.place()))
    }

    /// A number, as it stands or as an expression in quotes.
    pub(super) fn number(
        &mut self,
        item: &Item<'d>,
        (low, high): (f64, f64),
    ) -> Option<Expression> {
        if item.is_text() {
            self.expression(item, Kind::Number)
        } else {
            item.number(low..=high).map(Expression::constant)
        }
    }

    fn expression(&mut self, item: &Item<'d>, kind: Kind) -> Option<Expression> {
        match Expression::parse(item.text()?, kind, &mut self.vocabulary) {
            Ok(expression) => {
                self.uses.extend(expression.channels().map(|channel| (channel, item.place())));
                Some(expression)
            }
            Err(misreadings) => {
                for misreading in misreadings {
                    let place = item.place_within(misreading.place);
                    self.root
                        .note(place, Severity::Error, misreading.mistake.to_string())
                        .hint(misreading.hint.unwrap_or_default());
                }
                None
            }
        }
    }
}

impl Names<'_> {
    fn find(&self, item: &Item<'_>) -> Option<u16> {
        let name = item.text()?;
        let found = self.places.get(name).copied();
        if found.is_none() {
            item.error(format!("machine `{}` has no state `{}`", self.machine, shown(name)))
                .hint(self.hint(name));
        }
        found
    }

    /// The nearest name, or all of them where they are few.
    fn hint(&self, name: &str) -> String {
        let known = || self.places.keys().copied();
        match self.places.len() {
            0..=8 => nearest(name, known()).unwrap_or_else(|| {
                format!("it has {}", known().map(shown).collect::<Vec<_>>().join(", "))
            }),
            9..=SEARCHED => nearest(name, known()).unwrap_or_default(),
            _ => String::new(),
        }
    }
}

/// Says so where a text cannot be a name: names stand in messages, in graphs and on a small screen.
fn is_name(name: &str, item: &Item<'_>) -> bool {
    let length = name.chars().count();
    let good = (1..=NAME_CHARACTERS).contains(&length) && name.chars().all(is_printable);
    if !good {
        item.error_at_key(format!(
            "a name has 1 to {NAME_CHARACTERS} characters on one line, not `{}`",
            shown(name)
        ));
    }
    good
}

/// A text as a message shows it.
fn shown(text: &str) -> String {
    let mut shown: String =
        text.chars().take(NAME_CHARACTERS).flat_map(char::escape_debug).collect();
    if text.chars().nth(NAME_CHARACTERS).is_some() {
        shown.push('…');
    }
    shown
}
