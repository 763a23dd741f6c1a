//! Machines as they are described, and their names resolved.

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use super::{EngineError, LEVELS, Moment};
use crate::clock::span_ns;

pub(super) type Check<I> = Box<dyn FnMut(&I, Moment) -> bool + Send>;
pub(super) type Action<I> = Box<dyn FnMut(&mut I, Moment) + Send>;

/// A state as it is described: see [`Machine::state`].
pub struct State<I> {
    name: String,
    actions: Actions<I>,
    next: Vec<Transition<I, String>>,
    inner: Option<Machine<I>>,
}

/// What a state does.
pub(super) struct Actions<I> {
    pub(super) entering: Option<Action<I>>,
    pub(super) doing: Option<Action<I>>,
    pub(super) leaving: Option<Action<I>>,
}

/// A check, what is done when it holds, and where it leads: to a state's name, or to its place.
pub(super) struct Transition<I, S> {
    pub(super) check: Check<I>,
    pub(super) taking: Option<Action<I>>,
    pub(super) to: S,
}

impl<I> State<I> {
    fn named(name: String) -> Self {
        let actions = Actions { entering: None, doing: None, leaving: None };
        Self { name, actions, next: Vec::new(), inner: None }
    }

    /// Runs at every step that ends in this state.
    #[must_use]
    pub fn doing(mut self, action: impl FnMut(&mut I, Moment) + Send + 'static) -> Self {
        self.actions.doing = Some(Box::new(action));
        self
    }

    /// Runs once whenever the state is entered, the start state included.
    #[must_use]
    pub fn entering(mut self, action: impl FnMut(&mut I, Moment) + Send + 'static) -> Self {
        self.actions.entering = Some(Box::new(action));
        self
    }

    /// Runs once whenever the state is left.
    #[must_use]
    pub fn leaving(mut self, action: impl FnMut(&mut I, Moment) + Send + 'static) -> Self {
        self.actions.leaving = Some(Box::new(action));
        self
    }

    /// Adds a transition: to `destination` when `check` holds and no transition before it does.
    #[must_use]
    pub fn when(
        mut self,
        check: impl FnMut(&I, Moment) -> bool + Send + 'static,
        destination: impl Into<String>,
    ) -> Self {
        self.next.push(Transition { check: Box::new(check), taking: None, to: destination.into() });
        self
    }

    /// Gives the transition that was added last an action, which runs when it is taken.
    #[must_use]
    pub fn taking(mut self, action: impl FnMut(&mut I, Moment) + Send + 'static) -> Self {
        if let Some(last) = self.next.last_mut() {
            last.taking = Some(Box::new(action));
        }
        self
    }

    /// Adds a timeout: to `destination` once the state has been active for `time`.
    #[must_use]
    pub fn after(self, time: Duration, destination: impl Into<String>) -> Self {
        let limit_ns = span_ns(time);
        self.when(move |_, at| at.now_ns.saturating_sub(at.entered_ns) >= limit_ns, destination)
    }

    /// Makes a sub-machine of the state: while it is active, so is one of the states of `machine`.
    /// Entering it enters the start state of `machine` as well; whose name and final state say
    /// nothing to the engine.
    #[must_use]
    pub fn containing(mut self, machine: Machine<I>) -> Self {
        self.inner = Some(machine);
        self
    }
}

/// A machine as it is described; [`Engine::new`](super::Engine::new) makes it run.
pub struct Machine<I> {
    pub(super) name: String,
    start: String,
    end: Option<String>,
    always: Vec<Transition<I, String>>,
    states: Vec<State<I>>,
}

impl<I> Machine<I> {
    /// A machine that starts in the state `start`.
    #[must_use]
    pub fn new(name: impl Into<String>, start: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            start: start.into(),
            end: None,
            always: Vec::new(),
            states: Vec::new(),
        }
    }

    /// Adds a state; `describe` gives it actions and transitions.
    #[must_use]
    pub fn state(
        mut self,
        name: impl Into<String>,
        describe: impl FnOnce(State<I>) -> State<I>,
    ) -> Self {
        self.states.push(describe(State::named(name.into())));
        self
    }

    /// Adds transitions of every state, before its own, but for the final state and the one that
    /// they lead to.
    #[must_use]
    pub fn always(mut self, describe: impl FnOnce(State<I>) -> State<I>) -> Self {
        self.always.extend(describe(State::named(String::new())).next);
        self
    }

    /// Names the final state. A machine without one never finishes.
    #[must_use]
    pub fn ending_in(mut self, state: impl Into<String>) -> Self {
        self.end = Some(state.into());
        self
    }
}

/// What holds for all states of a machine, or of a sub-machine, by their places.
pub(super) struct Region<I> {
    pub(super) start: u16,
    pub(super) end: Option<u16>,
    pub(super) always: Vec<Transition<I, u16>>,
}

/// A state with its names resolved. The states inside it follow it.
pub(super) struct Node<I> {
    pub(super) name: String,
    pub(super) actions: Actions<I>,
    pub(super) next: Vec<Transition<I, u16>>,
    /// The state that it is inside.
    pub(super) parent: Option<u16>,
    /// How many states it is inside.
    pub(super) level: usize,
    /// The last state inside it, or itself.
    pub(super) last: u16,
    pub(super) inner: Option<Region<I>>,
}

/// A machine's name, what holds for all of its states, and its states with those inside them.
pub(super) type Resolved<I> = (String, Region<I>, Vec<Node<I>>);

pub(super) fn resolve<I>(machine: Machine<I>) -> Result<Resolved<I>, EngineError> {
    let name = machine.name.clone();
    let mut nodes = Vec::new();
    let region = region(machine, &name, None, 0, &mut nodes)?;
    let transitions = |node: &Node<I>| {
        node.next.len() + node.inner.as_ref().map_or(0, |inner| inner.always.len())
    };
    let most = nodes.iter().map(transitions).max().unwrap_or_default();
    index(region.always.len() + most * LEVELS, &name)?;
    Ok((name, region, nodes))
}

/// Puts the states of a machine behind those there are.
fn region<I>(
    machine: Machine<I>,
    name: &str,
    parent: Option<u16>,
    level: usize,
    nodes: &mut Vec<Node<I>>,
) -> Result<Region<I>, EngineError> {
    if level == LEVELS {
        return Err(EngineError::TooDeep { machine: name.to_owned() });
    }
    let mut places = BTreeMap::new();
    let mut nexts = Vec::with_capacity(machine.states.len());
    for State { name: state, actions, next, inner } in machine.states {
        let place = index(nodes.len(), name)?;
        if places.insert(state.clone(), place).is_some() {
            return Err(EngineError::DuplicateState { machine: name.to_owned(), state });
        }
        let node = Node {
            name: state,
            actions,
            next: Vec::new(),
            parent,
            level,
            last: place,
            inner: None,
        };
        nodes.push(node);
        nexts.push((usize::from(place), next));
        if let Some(inner) = inner {
            let inner = region(inner, name, Some(place), level + 1, nodes)?;
            let last = index(nodes.len() - 1, name)?;
            let node = &mut nodes[usize::from(place)];
            (node.inner, node.last) = (Some(inner), last);
        }
    }
    let find = |state: &str| {
        places.get(state).copied().ok_or_else(|| EngineError::UnknownState {
            machine: name.to_owned(),
            state: state.to_owned(),
        })
    };
    let find_all = |transitions: Vec<Transition<I, String>>| {
        let found = transitions.into_iter().map(|Transition { check, taking, to }| {
            Ok(Transition { check, taking, to: find(&to)? })
        });
        found.collect::<Result<Vec<_>, EngineError>>()
    };
    let start = find(&machine.start)?;
    let end = machine.end.as_deref().map(find).transpose()?;
    for (place, next) in nexts {
        nodes[place].next = find_all(next)?;
    }
    Ok(Region { start, end, always: find_all(machine.always)? })
}

pub(super) fn index(count: usize, what: &str) -> Result<u16, EngineError> {
    u16::try_from(count).map_err(|_| EngineError::TooMany { what: what.to_owned() })
}

impl<I> fmt::Debug for State<I> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("State").field("name", &self.name).finish_non_exhaustive()
    }
}

impl<I> fmt::Debug for Machine<I> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Machine")
            .field("name", &self.name)
            .field("states", &self.states)
            .finish_non_exhaustive()
    }
}
