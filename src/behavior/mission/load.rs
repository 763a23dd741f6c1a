//! A mission file to machines: keys, names, expressions.
//!
//! What concerns the mission as a whole is looked at afterwards, in `checks`.

use std::collections::BTreeMap;
use std::ops::Range;

use super::{Assignment, MachinePlan, Mission, OnLost, Outputs, StatePlan, TransitionPlan, checks};
use crate::behavior::engine::Finish;
use crate::behavior::expression::{Expression, Kind, Misreading, SEARCHED, Vocabulary, is_plain};
use crate::behavior::signals::Capabilities;
use crate::behavior::tune::Tune;
use crate::behavior::{MAX_MACHINES, MAX_VARIABLES};
use crate::document::{Document, Findings, Item, Kind as FileKind, Section, Severity, nearest};
use crate::printable::is_printable;
use crate::senses::{Channel, Role};

mod actions;
mod signs;

/// Longest name of a mission, a machine or a state, in characters.
const NAME_CHARACTERS: usize = 40;

/// What `done` needs.
const NOTHING_ENDS: &str = "`done` can never hold: nothing that the state does comes to an end";
const ENDING: &str = "`drive_m`, `turn_deg`, `arc`, `goto` and `head_deg` end";

/// The keys of the whole mission.
const KEYS: [&str; 9] = [
    "name",
    "rate_hz",
    "time_limit_s",
    "finish",
    "on_lost",
    "on_stall",
    "numbers",
    "variables",
    "machine",
];

const DEFAULT_RATE_HZ: u32 = 50;
const DEFAULT_TIME_LIMIT_S: f64 = 120.0;

pub(super) fn load(
    document: &Document,
    capabilities: &Capabilities,
) -> Result<(Mission, Findings), Findings> {
    document.read(|root| {
        let vocabulary = Vocabulary::new(capabilities);
        Reader { root, vocabulary, uses: Vec::new(), tunes: Vec::new(), states: 0 }.mission()
    })
}

/// A file that is being read.
pub(super) struct Reader<'r, 'd, 'c> {
    pub(super) root: &'r Section<'d>,
    pub(super) vocabulary: Vocabulary<'c>,
    /// What of the robot is sensed or moved, and where in the file.
    pub(super) uses: Vec<(Channel, Range<usize>)>,
    /// The tunes so far.
    tunes: Vec<Tune>,
    /// How many states there are so far.
    states: usize,
}

/// A machine with the places of its parts.
pub(super) struct Draft {
    pub(super) plan: MachinePlan,
    /// Where each state's name stands.
    pub(super) states: Vec<Range<usize>>,
    /// Where the conditions for all states stand.
    pub(super) always: Vec<Range<usize>>,
    /// Where each state's conditions stand.
    pub(super) conditions: Vec<Vec<Range<usize>>>,
    /// What it moves, and where that is said first.
    pub(super) moves: BTreeMap<Role, Range<usize>>,
    /// False where a part could not be read: checks of the whole would then mislead.
    pub(super) complete: bool,
}

/// A transition, and where its condition stands.
type Placed = (TransitionPlan, Range<usize>);

/// A machine of the file whose states' names are known.
struct Found<'d> {
    item: Item<'d>,
    section: Section<'d>,
    states: Vec<Item<'d>>,
}

/// The names of a machine's states.
#[derive(Clone, Copy)]
struct Names<'n> {
    machine: &'n str,
    places: &'n BTreeMap<String, u16>,
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
            .insert(Mission::TIME_LIMIT.to_owned(), time_limit_s.unwrap_or(DEFAULT_TIME_LIMIT_S));
        self.numbers();
        self.variables();
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
            variables: self.vocabulary.variables,
            tunes: self.tunes,
            machines: drafts.into_iter().map(|draft| draft.plan).collect(),
            senses: Channel::ALL.into_iter().filter(|channel| used.contains(channel)).collect(),
        })
    }

    /// The mission's own numbers.
    fn numbers(&mut self) {
        for item in self.root.section("numbers").iter().flat_map(Section::items) {
            if let Some((name, number)) = self.own_number(&item) {
                self.vocabulary.numbers.insert(name, number);
            }
        }
    }

    /// The mission's variables, with what they are at the start.
    fn variables(&mut self) {
        let items = self.root.section("variables").map(|section| section.items());
        let items = items.unwrap_or_default();
        if let Some(one_more) = items.get(MAX_VARIABLES) {
            let count = items.len();
            one_more.error_at_key(format!(
                "{count} variables are too many; at most {MAX_VARIABLES} are kept"
            ));
        }
        for item in items.iter().take(MAX_VARIABLES) {
            let Some((name, first)) = self.own_number(item) else { continue };
            if self.vocabulary.numbers.contains_key(&name) {
                item.error_at_key(format!("`{name}` is one of [numbers], which do not change"))
                    .hint("choose another name, or leave it out there");
            } else {
                self.vocabulary.variables.push((name, first));
            }
        }
    }

    /// A name of the mission's own, and its number.
    fn own_number(&self, item: &Item<'d>) -> Option<(String, f64)> {
        let (low, high) = Mission::NUMBERS;
        let name = item.key();
        if Vocabulary::is_taken(name) || name == Mission::TIME_LIMIT {
            item.error_at_key(format!("`{name}` already has a meaning in conditions"))
                .hint("choose another name");
        } else if !is_plain(name) {
            item.error_at_key(format!("`{name}` cannot be a name in conditions"))
                .hint("use letters, digits and `_`, with a letter first");
        } else {
            return Some((name.to_owned(), item.number(low..=high)?));
        }
        None
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
        // Conditions may name the states of any machine, so all names are read first.
        let found: Vec<Found<'d>> = items.iter().filter_map(|item| self.names(item)).collect();
        let machines = found.iter().map(|found| {
            let states = found.states.iter().map(|state| state.key().to_owned());
            (found.item.key().to_owned(), states.zip(0_u16..).collect())
        });
        self.vocabulary.machines = machines.collect();
        Some(found.iter().enumerate().map(|(at, found)| self.machine(at, found)).collect())
    }

    /// A machine's name and those of its states.
    fn names(&mut self, item: &Item<'d>) -> Option<Found<'d>> {
        let section = item.section()?;
        is_name(item.key(), item);
        let states = section.require("state")?.section()?.items();
        if states.is_empty() {
            section.error(format!("machine `{}` has no state", shown(item.key())));
        }
        self.states += states.len();
        if self.states > Mission::MAX_STATES {
            item.error_at_key(format!(
                "{} states are too many; at most {} are read",
                self.states,
                Mission::MAX_STATES
            ));
            return None;
        }
        Some(Found { item: item.clone(), section, states })
    }

    fn machine(&mut self, at: usize, found: &Found<'d>) -> Draft {
        let Found { item, section, states } = found;
        section.allow(&["start", "final", "always", "state"]);
        // Taken out while it is used, because expressions need the whole vocabulary.
        let places = self.vocabulary.machines.get(at).map(|machine| machine.1.clone());
        let names = Names { machine: item.key(), places: &places.unwrap_or_default() };
        // The one state that there is need not be named.
        let start = match section.get("start") {
            None if states.len() == 1 => Some(0),
            _ => section.require("start").and_then(|start| names.find(&start)),
        };
        let end = section.get("final").map(|end| names.find(&end));
        let always = self.transitions_of(section, "always", names);
        let mut draft = Draft {
            complete: start.is_some() && end != Some(None) && always.iter().all(Option::is_some),
            plan: MachinePlan {
                name: item.key().to_owned(),
                start: start.unwrap_or_default(),
                end: end.flatten(),
                always: Vec::new(),
                states: Vec::with_capacity(states.len()),
            },
            states: states.iter().map(Item::key_place).collect(),
            always: Vec::new(),
            conditions: Vec::with_capacity(states.len()),
            moves: BTreeMap::new(),
        };
        (draft.plan.always, draft.always) = always.into_iter().flatten().unzip();
        for state in states {
            self.state(state, names, &mut draft);
        }
        let ends = draft.plan.states.iter().any(|state| state.doing.ends());
        for (always, place) in draft.plan.always.iter().zip(&draft.always) {
            if always.when.asks_whether_done() && !ends {
                self.root
                    .note(place.clone(), Severity::Error, NOTHING_ENDS.to_owned())
                    .hint(ENDING);
            }
        }
        draft
    }

    fn state(&mut self, item: &Item<'d>, names: Names<'_>, draft: &mut Draft) {
        is_name(item.key(), item);
        let section = item.section();
        if let Some(section) = &section {
            let known = ["do", "on_entry", "on_exit", "next"];
            section.allow(&known);
            // A slip in `next` would look like a state that cannot be left.
            draft.complete &= section.items().iter().all(|item| known.contains(&item.key()));
        }
        let table = |key: &str| section.as_ref()?.get(key)?.section();
        self.vocabulary.pids = Some(0);
        let doing =
            table("do").map(|table| self.actions(&table, &mut draft.moves)).unwrap_or_default();
        self.vocabulary.pids = None;
        let mut signs = |key: &str, more: &[&str]| {
            table(key).map(|table| self.signs(&table, more)).unwrap_or_default()
        };
        let (on_entry, on_exit) = (signs("on_entry", &["set"]), signs("on_exit", &[]));
        let set = table("on_entry").map(|table| self.assignments(&table)).unwrap_or_default();
        let next =
            section.map(|section| self.transitions_of(&section, "next", names)).unwrap_or_default();
        draft.complete &= next.iter().all(Option::is_some);
        let (next, conditions): (Vec<TransitionPlan>, Vec<_>) = next.into_iter().flatten().unzip();
        for (next, place) in next.iter().zip(&conditions) {
            if next.when.asks_whether_done() && !doing.ends() {
                self.root
                    .note(place.clone(), Severity::Error, NOTHING_ENDS.to_owned())
                    .hint(ENDING);
            }
        }
        draft.conditions.push(conditions);
        draft.plan.states.push(StatePlan {
            name: item.key().to_owned(),
            doing,
            on_entry,
            set,
            on_exit,
            next,
        });
    }

    /// The transitions under a key, `None` for each that could not be read, and one `None` for all
    /// where there are too many.
    fn transitions_of(
        &mut self,
        section: &Section<'d>,
        key: &str,
        names: Names<'_>,
    ) -> Vec<Option<Placed>> {
        let Some(item) = section.get(key) else { return Vec::new() };
        let Some(list) = item.list() else { return vec![None] };
        if let Some(one_more) = list.get(Mission::MAX_TRANSITIONS) {
            let (count, most) = (list.len(), Mission::MAX_TRANSITIONS);
            one_more.error(format!("{count} transitions are too many; at most {most} are read"));
            return vec![None];
        }
        list.iter().map(|item| self.transition(item, names)).collect()
    }

    /// A transition, and where its condition stands.
    fn transition(&mut self, item: &Item<'d>, names: Names<'_>) -> Option<Placed> {
        let section = item.section()?;
        section.allow(&["when", "set", "go"]);
        let (when, go) = (section.require("when"), section.require("go"));
        let go = go.and_then(|go| names.find(&go));
        let set = self.assignments(&section);
        let when = when?;
        let condition = self.expression(&when, Kind::Truth);
        Some((TransitionPlan { when: condition?, set, go: go? }, when.place()))
    }

    /// The table `set` of a section: variables and what they become.
    fn assignments(&mut self, section: &Section<'d>) -> Vec<Assignment> {
        let items = section.section("set").map(|set| set.items()).unwrap_or_default();
        items.iter().filter_map(|item| self.assignment(item)).collect()
    }

    fn assignment(&mut self, item: &Item<'d>) -> Option<Assignment> {
        let name = item.key();
        let variable = self.vocabulary.variable(name);
        if variable.is_none() {
            let names = || self.vocabulary.variables.iter().map(|(name, _)| name.as_str());
            let hint = match self.vocabulary.numbers.contains_key(name) {
                true => "one of [numbers] does not change; it can be one of [variables]".to_owned(),
                false => nearest(name, names()).unwrap_or_else(|| {
                    format!("`{} = 0` in [variables] makes it one", shown(name))
                }),
            };
            item.error_at_key(format!("there is no variable `{}`", shown(name))).hint(hint);
        }
        let value = self.number(item, Mission::NUMBERS);
        Some(Assignment { variable: variable?, value: value? })
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
                if let Some(number) = expression.centimetres() {
                    let message = format!("`range_m` is in metres, and no sensor sees {number} m");
                    let hint = format!("{number} cm are {}", number / 100.0);
                    item.warning(message).hint(hint);
                }
                Some(expression)
            }
            Err(misreadings) => {
                for Misreading { place, mistake, hint } in misreadings {
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

impl Names<'_> {
    fn find(&self, item: &Item<'_>) -> Option<u16> {
        let name = item.text()?;
        let found = self.places.get(name).copied();
        if found.is_none() {
            item.error(format!("machine `{}` has no state `{}`", shown(self.machine), shown(name)))
                .hint(self.hint(name));
        }
        found
    }

    /// The nearest name, or all of them where they are few.
    fn hint(&self, name: &str) -> String {
        let known = || self.places.keys().map(String::as_str);
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
