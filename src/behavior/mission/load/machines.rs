//! Machines, sub-machines, states and transitions.
//!
//! A state that uses a sub-machine is read as a state with the states of the sub-machine inside it,
//! each time it is used: what is the same in the file is read more than once.

use std::collections::BTreeMap;
use std::ops::{Range, RangeInclusive};

use super::done::is_to_end;
use super::{Reader, is_name};
use crate::behavior::engine::LEVELS;
use crate::behavior::expression::{Kind, SEARCHED, Vocabulary};
use crate::behavior::mission::{
    Assignment, MachinePlan, Mission, RegionPlan, StatePlan, TransitionPlan,
};
use crate::behavior::shipped::SUBMACHINES;
use crate::behavior::{MAX_MACHINES, MAX_VARIABLES};
use crate::document::{Item, Section, Severity, nearest, nearest_or_all};
use crate::printable;
use crate::senses::Role;

/// The keys of a machine, and of a sub-machine.
const MACHINE: [&str; 4] = ["start", "final", "always", "state"];
const SUBMACHINE: [&str; 6] = ["variables", "start", "final", "on_stall", "always", "state"];

/// The keys of a state, and of one that uses a sub-machine.
const STATE: [&str; 4] = ["do", "on_entry", "on_exit", "next"];
const USING: [&str; 5] = ["use", "with", "on_entry", "on_exit", "next"];

/// A machine that is being read.
pub(in crate::behavior::mission) struct Draft {
    pub(in crate::behavior::mission) plan: MachinePlan,
    /// What it moves, and where that is said first.
    pub(in crate::behavior::mission) moves: BTreeMap<Role, Range<usize>>,
    /// False where a part could not be read: checks of the whole would then mislead.
    pub(in crate::behavior::mission) complete: bool,
}

/// The states of a machine or of a sub-machine, whose names are known and nothing else.
struct Layout<'d> {
    section: Section<'d>,
    states: Vec<StateLayout<'d>>,
}

struct StateLayout<'d> {
    item: Item<'d>,
    /// Its places in the machine: its own, and those of the states inside it.
    places: RangeInclusive<u16>,
    /// The sub-machine that it uses.
    inner: Option<Inner<'d>>,
}

struct Inner<'d> {
    layout: Layout<'d>,
    /// The sub-machine's own variables, each with its place.
    variables: Vec<(Item<'d>, u8)>,
}

impl StateLayout<'_> {
    fn place(&self) -> u16 {
        *self.places.start()
    }
}

/// A machine, or a sub-machine that is used: what findings call it, and the names of its states.
#[derive(Clone, Copy)]
struct Names<'n> {
    machine: &'n str,
    places: &'n BTreeMap<&'n str, u16>,
}

/// Where reading names has come to.
#[derive(Default)]
struct Walk<'d> {
    /// The machine's name, and those of the states that the next ones are inside.
    path: Vec<&'d str>,
    /// The sub-machines that are in use there.
    used: Vec<&'d str>,
    /// How many states the machine has so far.
    states: usize,
    /// Their names, each with its places.
    names: BTreeMap<String, RangeInclusive<u16>>,
}

impl<'d> Reader<'_, 'd, '_> {
    pub(super) fn machines(&mut self) -> Option<Vec<Draft>> {
        let section = self.root.require("machine")?.section()?;
        let items = section.items();
        if items.is_empty() {
            section.error("a mission needs at least one machine");
        }
        if let Some(item) = items.get(MAX_MACHINES) {
            item.error_at_key(format!(
                "this is machine {}; at most {MAX_MACHINES} run side by side",
                MAX_MACHINES + 1
            ));
            return None;
        }
        // Conditions may name the states of any machine, and variables of its sub-machines, so all
        // names are read first.
        let mut found = Vec::with_capacity(items.len());
        for item in &items {
            let Some(section) = item.section() else { continue };
            is_name(item.key(), item);
            let mut walk = Walk { path: vec![item.key()], ..Walk::default() };
            if let Some(layout) = self.layout(item, section, &mut walk) {
                self.vocabulary.machines.push((item.key().to_owned(), walk.names));
                found.push((item.clone(), layout));
            } else {
                // Of what is wrong with it enough was said: its states are no unknown ones.
                self.vocabulary.unread.insert(format!("{}.state", item.key()));
            }
        }
        if found.len() == items.len() {
            self.unused();
        }
        Some(found.iter().map(|(item, layout)| self.machine(item, layout)).collect())
    }

    /// The names of the states of a machine or sub-machine.
    fn layout(
        &mut self,
        item: &Item<'d>,
        section: Section<'d>,
        walk: &mut Walk<'d>,
    ) -> Option<Layout<'d>> {
        let keys: &[&str] = if walk.used.is_empty() { &MACHINE } else { &SUBMACHINE };
        section.allow(keys);
        let items = section.require("state")?.section()?.items();
        if items.is_empty() {
            section.error(format!("machine `{}` has no state", printable::name(item.key())));
        }
        let mut states = Vec::with_capacity(items.len());
        for item in items {
            self.states += 1;
            if self.states > Mission::MAX_STATES {
                item.error_at_key(format!(
                    "there are more than {} states, those of sub-machines counted at each use",
                    Mission::MAX_STATES
                ));
                return None;
            }
            let first = u16::try_from(walk.states).ok()?;
            walk.states += 1;
            let key = item.key();
            walk.path.push(key);
            let inner = match item.get("use") {
                Some(using) => Some(self.inner(&item, &using, walk)?),
                None => None,
            };
            let places = first..=u16::try_from(walk.states - 1).ok()?;
            walk.names.insert(walk.path[1..].join("."), places.clone());
            walk.path.pop();
            states.push(StateLayout { item, places, inner });
        }
        Some(Layout { section, states })
    }

    /// The sub-machine that a state uses.
    fn inner(
        &mut self,
        state: &Item<'d>,
        using: &Item<'d>,
        walk: &mut Walk<'d>,
    ) -> Option<Inner<'d>> {
        let name = using.text()?;
        let defined = self.root.section("submachine");
        let Some(item) = defined.as_ref().and_then(|defined| defined.get(name)) else {
            let own = defined.iter().flat_map(Section::items);
            let file = format!("{name}.toml");
            let held = own.clone().filter(|item| item.part() == Some(&file));
            let held: Vec<_> = held.map(|item| printable::name(item.key())).collect();
            let own = own.map(|item| item.key());
            let shipped = SUBMACHINES.map(|shipped| shipped.name);
            let hint = if shipped.contains(&name) {
                "it comes with onbrick: submachines::joined puts it into the text".to_owned()
            } else if !held.is_empty() {
                let (held, name) = (held.join(", "), printable::name(name));
                format!("{name}.toml has {held}: rename it there to [submachine.{name}]")
            } else {
                nearest(name, own.chain(shipped)).unwrap_or_else(|| {
                    let name = printable::name(name);
                    format!(
                        "[submachine.{name}] would be one, here or in {name}.toml beside this file"
                    )
                })
            };
            using.error(format!("there is no sub-machine `{}`", printable::name(name))).hint(hint);
            return None;
        };
        let (key, section) = (item.key(), item.section()?);
        if walk.used.contains(&key) {
            let way: Vec<_> = walk.used.iter().copied().chain([key]).map(printable::name).collect();
            using
                .error(format!("the sub-machine uses itself: {}", way.join(" uses ")))
                .hint("one of them must do without the other");
            return None;
        }
        if walk.used.len() + 1 == LEVELS {
            using
                .error(format!("there are at most {LEVELS} levels of states within states"))
                .hint("let the sub-machines use each other less");
            return None;
        }
        is_name(key, &item);
        self.used.insert(key);
        let mut variables = Vec::new();
        for own in section.items_of("variables") {
            let (low, high) = Mission::NUMBERS;
            // An expression is worked out when the state is entered.
            let first = if own.is_text() { Some(0.0) } else { own.number(low..=high) };
            let Some((name, first)) = self.own_name(&own).zip(first) else { continue };
            let places = &mut self.vocabulary.variables;
            if places.len() == MAX_VARIABLES {
                let message = format!(
                    "with this there are more than {MAX_VARIABLES} variables; a sub-machine has \
                     its own at each use"
                );
                state.error_at_key(message).hint("use it in fewer places");
                return None;
            }
            let place = u8::try_from(places.len()).ok()?;
            places.push((format!("{}.{name}", walk.path.join(".")), first));
            variables.push((own, place));
        }
        walk.used.push(key);
        let layout = self.layout(&item, section, walk)?;
        walk.used.pop();
        Some(Inner { layout, variables })
    }

    /// Sub-machines that no state uses: nothing in them has been looked at.
    fn unused(&self) {
        for item in self.root.items_of("submachine") {
            if !self.used.contains(item.key()) {
                let message =
                    format!("no state uses the sub-machine `{}`; it was not checked", item.key());
                self.root.note(item.key_place(), Severity::Warning, message).hint(format!(
                    "`use = \"{}\"` in a state, or leave it out",
                    printable::name(item.key())
                ));
            }
        }
    }

    fn machine(&mut self, item: &Item<'d>, layout: &Layout<'d>) -> Draft {
        let mut draft = Draft {
            plan: MachinePlan {
                name: item.key().to_owned(),
                region: RegionPlan::default(),
                states: Vec::new(),
            },
            moves: BTreeMap::new(),
            complete: true,
        };
        item.key().clone_into(&mut self.vocabulary.scope);
        draft.plan.region = self.region(item.key(), layout, None, &mut draft);
        self.vocabulary.scope.clear();
        draft
    }

    /// A machine, or the sub-machine inside the state `parent`; its states are put into the draft.
    fn region(
        &mut self,
        name: &str,
        layout: &Layout<'d>,
        parent: Option<u16>,
        draft: &mut Draft,
    ) -> RegionPlan {
        let Layout { section, states } = layout;
        let places = states.iter().map(|state| (state.item.key(), state.place())).collect();
        let names = Names { machine: name, places: &places };
        let named = |key: &str| section.get(key).map(|item| names.find(&item));
        let start = named("start").unwrap_or_else(|| states.first().map(StateLayout::place));
        let end = named("final");
        // Of a machine, the mission's own key says it.
        let on_stall = parent.and_then(|_| named("on_stall"));
        let always = self.transitions_of(section, "always", names);
        draft.complete &= start.is_some()
            && ![end, on_stall].contains(&Some(None))
            && always.iter().all(Option::is_some);
        let always: Vec<TransitionPlan> = always.into_iter().flatten().collect();
        for state in states {
            if state.inner.is_some() && end == Some(Some(state.place())) {
                let message = "the final state cannot use a sub-machine: it is the end";
                state.item.error_at_key(message).hint("let one more state be final");
            }
            self.state(state, parent, names, draft);
        }
        let ends = states.iter().any(|state| {
            let plan = draft.plan.state(state.place());
            plan.is_some_and(StatePlan::ends) || is_to_end(&state.item)
        });
        self.can_be_done(&always, ends);
        let (end, on_stall) = (end.flatten(), on_stall.flatten());
        RegionPlan { start: start.unwrap_or_default(), end, on_stall, always }
    }

    fn state(
        &mut self,
        layout: &StateLayout<'d>,
        parent: Option<u16>,
        names: Names<'_>,
        draft: &mut Draft,
    ) {
        let StateLayout { item, places, inner } = layout;
        is_name(item.key(), item);
        let section = item.section();
        if let Some(section) = &section {
            let known: &[&str] = if inner.is_some() { &USING } else { &STATE };
            if let Some(doing) = section.get("do").filter(|_| inner.is_some()) {
                doing
                    .error_at_key("`do` and `use` both say what the state does")
                    .hint("leave one out");
            } else if let Some(with) = section.get("with").filter(|_| inner.is_none()) {
                with.error_at_key("`with` goes together with `use`");
            } else {
                section.allow(known);
            }
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
        let mut set = table("on_entry").map(|table| self.assignments(&table)).unwrap_or_default();
        set.extend(inner.iter().flat_map(|inner| self.with(item, table("with"), inner)));
        let next = match &section {
            Some(section) => self.transitions_of(section, "next", names),
            None => Vec::new(),
        };
        draft.complete &= next.iter().all(Option::is_some);
        let outer = parent.and_then(|parent| draft.plan.state(parent));
        let name = match outer {
            Some(outer) => format!("{}.{}", outer.name, item.key()),
            None => item.key().to_owned(),
        };
        let at = draft.plan.states.len();
        draft.plan.states.push(StatePlan {
            name,
            place: item.key_place(),
            parent,
            last: *places.end(),
            inner: None,
            doing,
            on_entry,
            set,
            on_exit,
            next: next.into_iter().flatten().collect(),
        });
        if let Some(Inner { layout, .. }) = inner {
            let outside = self.vocabulary.scope.len();
            self.vocabulary.scope.push('.');
            self.vocabulary.scope.push_str(item.key());
            let used = format!("{}.{}", names.machine, item.key());
            let region = self.region(&used, layout, Some(*places.start()), draft);
            self.vocabulary.scope.truncate(outside);
            if let Some(plan) = draft.plan.states.get_mut(at) {
                plan.inner = Some(region);
            }
        }
        if let Some(plan) = draft.plan.states.get(at) {
            self.can_be_done(&plan.next, plan.ends() || is_to_end(item));
        }
    }

    /// What the variables of a sub-machine begin with: what `with` says, else their own.
    fn with(
        &mut self,
        state: &Item<'d>,
        with: Option<Section<'d>>,
        inner: &Inner<'d>,
    ) -> Vec<Assignment> {
        for item in with.iter().flat_map(Section::items) {
            let known = || inner.variables.iter().map(|(own, _)| own.key());
            if !known().any(|name| name == item.key()) {
                let using = state.get("use").and_then(|using| using.text());
                let message = format!(
                    "the sub-machine `{}` has no variable `{}`",
                    printable::name(using.unwrap_or_default()),
                    printable::name(item.key())
                );
                let hint = match known().next() {
                    Some(_) => nearest_or_all(item.key(), "it has", known()),
                    None => "it has none".to_owned(),
                };
                item.error_at_key(message).hint(hint);
            }
        }
        let first = |(own, variable): &(Item<'d>, u8)| {
            let given = with.as_ref().and_then(|with| with.get(own.key()));
            let value = self.number(given.as_ref().unwrap_or(own), Mission::NUMBERS)?;
            Some(Assignment { variable: *variable, value })
        };
        inner.variables.iter().filter_map(first).collect()
    }

    /// The transitions under a key, `None` for each that could not be read, and one `None` for all
    /// where there are too many.
    fn transitions_of(
        &mut self,
        section: &Section<'d>,
        key: &str,
        names: Names<'_>,
    ) -> Vec<Option<TransitionPlan>> {
        let Some(item) = section.get(key) else { return Vec::new() };
        let Some(list) = item.list() else { return vec![None] };
        if let Some(one_more) = list.get(Mission::MAX_TRANSITIONS) {
            let (count, most) = (list.len(), Mission::MAX_TRANSITIONS);
            one_more.error(format!("{count} transitions are too many; at most {most} are read"));
            return vec![None];
        }
        list.iter().map(|item| self.transition(item, names)).collect()
    }

    fn transition(&mut self, item: &Item<'d>, names: Names<'_>) -> Option<TransitionPlan> {
        let section = item.section()?;
        section.allow(&["when", "set", "go"]);
        let (when, go) = (section.require("when"), section.require("go"));
        let go = go.and_then(|go| names.find(&go));
        let set = self.assignments(&section);
        let when = when?;
        let condition = self.expression(&when, Kind::Truth);
        Some(TransitionPlan { when: condition?, place: when.place(), set, go: go? })
    }

    /// The table `set` of a section: variables and what they become.
    fn assignments(&mut self, section: &Section<'d>) -> Vec<Assignment> {
        section.items_of("set").iter().filter_map(|item| self.assignment(item)).collect()
    }

    fn assignment(&mut self, item: &Item<'d>) -> Option<Assignment> {
        let name = item.key();
        let variable = self.vocabulary.variable(name);
        if variable.is_none() {
            let names = || self.vocabulary.variables.iter().map(|(name, _)| name.as_str());
            let hint = if self.vocabulary.numbers.contains_key(name) {
                "one of [numbers] does not change; it can be one of [variables]".to_owned()
            } else if Vocabulary::is_taken(name) {
                "it already has a meaning in conditions; give a variable another name".to_owned()
            } else {
                nearest(name, names()).unwrap_or_else(|| {
                    format!("`{} = 0` in [variables] makes it one", printable::name(name))
                })
            };
            item.error_at_key(format!("there is no variable `{}`", printable::name(name)))
                .hint(hint);
        }
        let value = self.number(item, Mission::NUMBERS);
        Some(Assignment { variable: variable?, value: value? })
    }
}

impl Names<'_> {
    fn find(&self, item: &Item<'_>) -> Option<u16> {
        let name = item.text()?;
        let found = self.places.get(name).copied();
        if found.is_none() {
            item.error(format!(
                "machine `{}` has no state `{}`",
                printable::name(self.machine),
                printable::name(name)
            ))
            .hint(self.hint(name));
        }
        found
    }

    /// The nearest name, or all of them where they are few.
    fn hint(&self, name: &str) -> String {
        let known = || self.places.keys().copied();
        match self.places.len() {
            0..=8 => nearest(name, known()).unwrap_or_else(|| {
                format!("it has {}", known().map(printable::name).collect::<Vec<_>>().join(", "))
            }),
            9..=SEARCHED => nearest(name, known()).unwrap_or_default(),
            _ => String::new(),
        }
    }
}
