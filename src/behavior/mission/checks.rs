//! A mission looked at as a whole: what can be reached and left, what can never fire, who moves
//! what.

use std::collections::BTreeMap;
use std::ops::Range;

use super::load::{Draft, Reader};
use super::{MachinePlan, OnStall, TransitionPlan};
use crate::behavior::expression::Claims;
use crate::document::{Section, Severity, nearest};
use crate::senses::{Channel, Role};

/// The key `on_stall`: "stop", or a state of the machine that drives the wheels.
pub(super) fn on_stall(root: &Section<'_>, drafts: &[Draft]) -> Option<OnStall> {
    let Some(item) = root.get("on_stall") else { return Some(OnStall::Stop) };
    let state = item.text()?;
    if state == "stop" {
        return Some(OnStall::Stop);
    }
    let Some(driving) = drafts.iter().find(|draft| draft.moves.contains_key(&Role::Wheels)) else {
        item.error("no machine drives the wheels, so none can go on from a stall".to_owned())
            .hint("write `on_stall = \"stop\"`");
        return None;
    };
    if driving.plan.position(state).is_none() {
        let names = driving.plan.states.iter().take(200).map(|state| state.name.as_str());
        item.error(format!(
            "machine `{}` drives the wheels and has no state `{state}`",
            driving.plan.name
        ))
        .hint(nearest(state, names.chain(["stop"])).unwrap_or_default());
        return None;
    }
    Some(OnStall::Enter(state.to_owned()))
}

/// All checks that take more than one key.
pub(super) fn whole(reader: &Reader<'_, '_, '_>, drafts: &[Draft], on_stall: Option<&OnStall>) {
    let root = reader.root;
    one_machine_each(reader, drafts);
    one_mode_each(reader);
    for draft in drafts {
        let impossible = conditions(root, draft);
        // A slip in the name of the state for a stall would look like a state that cannot be
        // reached.
        if draft.complete && on_stall.is_some() {
            let stall = match on_stall {
                Some(OnStall::Enter(state)) if draft.moves.contains_key(&Role::Wheels) => {
                    draft.plan.position(state)
                }
                _ => None,
            };
            paths(root, draft, stall, &impossible);
        }
    }
}

/// Each actuator belongs to one machine.
fn one_machine_each(reader: &Reader<'_, '_, '_>, drafts: &[Draft]) {
    let mut owners: BTreeMap<Role, &str> = BTreeMap::new();
    for draft in drafts {
        for (role, place) in &draft.moves {
            let Some(owner) = owners.insert(*role, &draft.plan.name) else { continue };
            let what = match role {
                Role::Wheels => "the wheels are".to_owned(),
                Role::Head => "the head is".to_owned(),
                Role::Motor(at) => {
                    let name = reader
                        .vocabulary
                        .motors()
                        .get(usize::from(*at))
                        .map_or("?", String::as_str);
                    format!("the motor `{name}` is")
                }
                other => format!("{} is", other.what()),
            };
            let message =
                format!("{what} moved by machine `{}` and by machine `{owner}`", draft.plan.name);
            reader
                .root
                .note(place.clone(), Severity::Error, message)
                .hint("one machine alone can move it");
        }
    }
}

/// A sensor measures in one mode at a time.
fn one_mode_each(reader: &Reader<'_, '_, '_>) {
    let mut firsts: Vec<(Channel, &Range<usize>)> = Vec::new();
    for (channel, place) in &reader.uses {
        if firsts.iter().any(|(known, _)| known == channel) {
            continue;
        }
        if let Some((other, _)) = firsts.iter().find(|(other, _)| !other.goes_with(*channel)) {
            let (one, two) = (other.quantity().name, channel.quantity().name);
            let message = format!(
                "`{one}` and `{two}` are both used, and the sensor gives one of them at a time"
            );
            let hint = "use one of the two in the whole mission";
            reader.root.note(place.clone(), Severity::Error, message).hint(hint);
        }
        firsts.push((*channel, place));
    }
}

/// Transitions that cannot fire, of those for all states and of each state's own.
struct Impossible {
    always: Vec<bool>,
    states: Vec<Vec<bool>>,
}

/// Conditions that can never hold, that always hold, or that come too late.
fn conditions(root: &Section<'_>, draft: &Draft) -> Impossible {
    let plan = &draft.plan;
    let always = claims(&plan.always);
    let states = plan.states.iter().zip(&draft.conditions).enumerate();
    let states = states.map(|(at, (state, places))| {
        // Those for all states come first, but for the final state and the one they lead to.
        let here = always.iter().filter(|(next, _)| {
            usize::from(next.go) != at && plan.end.is_none_or(|end| usize::from(end) != at)
        });
        late(root, here.collect(), &claims(&state.next), places)
    });
    let states = states.collect();
    Impossible { always: late(root, Vec::new(), &always, &draft.always), states }
}

/// A transition, and what its condition claims.
type Claimed<'p> = (&'p TransitionPlan, Claims);

fn claims(transitions: &[TransitionPlan]) -> Vec<Claimed<'_>> {
    transitions.iter().map(|next| (next, Claims::of(&next.when))).collect()
}

/// Which of a list of transitions can never fire, those before it being looked at first.
fn late<'c>(
    root: &Section<'_>,
    mut before: Vec<&'c Claimed<'c>>,
    transitions: &'c [Claimed<'c>],
    places: &[Range<usize>],
) -> Vec<bool> {
    let mut impossible = Vec::with_capacity(transitions.len());
    for (transition, place) in transitions.iter().zip(places) {
        let (next, claim) = transition;
        let earlier = before.iter().find(|(_, earlier)| claim.implies(earlier));
        let (error, warning) = (Severity::Error, Severity::Warning);
        let never = claim.is_never();
        if never {
            root.note(place.clone(), error, "this condition can never hold".to_owned())
                .hint("look at its numbers, or take it out");
        } else if let Some((earlier, _)) = earlier {
            let other = earlier.when.text();
            let message =
                format!("this can never fire: `{other}` before it holds whenever this does");
            root.note(place.clone(), error, message).hint("put the narrower condition first");
        } else if claim.is_always() && next.when.text() != "true" {
            root.note(place.clone(), warning, "this condition always holds".to_owned())
                .hint("write `true` if that is meant");
        }
        impossible.push(never || earlier.is_some());
        before.push(transition);
    }
    impossible
}

/// States that cannot be reached, states that cannot be left, and states from which there is no way
/// to the final one.
fn paths(root: &Section<'_>, draft: &Draft, stall: Option<u16>, impossible: &Impossible) {
    let plan = &draft.plan;
    let (forward, backward) = ways(plan);
    let reached = closure(&forward, [plan.start].into_iter().chain(stall));
    let ends = plan.end.map(|end| closure(&backward, [end]));
    for (at, (state, place)) in plan.states.iter().zip(&draft.states).enumerate() {
        let named = &state.name;
        let is_end = plan.end.is_some_and(|end| usize::from(end) == at);
        let own = state.next.iter().zip(impossible.states.get(at).into_iter().flatten());
        let mut leaves = plan.always.iter().zip(&impossible.always).chain(own);
        let is_left = leaves.any(|(next, never)| usize::from(next.go) != at && !never);
        // A machine of one state does one thing until the mission ends.
        let is_alone = plan.states.len() == 1;
        let (severity, message, way_out) = if reached.get(at) != Some(&true) {
            let message =
                format!("state `{named}` cannot be reached from `{}`", name(draft, plan.start));
            (Severity::Error, message, "a transition of another state should go here")
        } else if !is_end && !is_left && !is_alone {
            let message = format!("state `{named}` cannot be left, and it is not final");
            (Severity::Error, message, "give it a transition, or name it as `final` of its machine")
        } else if let (Some(end), Some(ends)) = (plan.end, &ends)
            && ends.get(at) == Some(&false)
        {
            let end = name(draft, end);
            let message =
                format!("from state `{named}` there is no way to the final state `{end}`");
            (Severity::Warning, message, "without one the mission runs until its time limit")
        } else {
            continue;
        };
        root.note(place.clone(), severity, message).hint(way_out);
    }
}

/// Where each state leads, and from where each is come to.
fn ways(plan: &MachinePlan) -> (Vec<Vec<usize>>, Vec<Vec<usize>>) {
    let mut forward = vec![Vec::new(); plan.states.len()];
    let mut backward = forward.clone();
    for (from, state) in plan.states.iter().enumerate() {
        let is_end = plan.end.is_some_and(|end| usize::from(end) == from);
        let always = plan.always.iter().filter(|_| !is_end);
        for next in always.chain(&state.next) {
            let to = usize::from(next.go);
            if let (Some(ways), Some(back)) = (forward.get_mut(from), backward.get_mut(to)) {
                ways.push(to);
                back.push(from);
            }
        }
    }
    (forward, backward)
}

fn name(draft: &Draft, state: u16) -> &str {
    draft.plan.state(state).map_or("", |state| state.name.as_str())
}

/// All places that can be come to from `roots`.
fn closure(ways: &[Vec<usize>], roots: impl IntoIterator<Item = u16>) -> Vec<bool> {
    let mut reached = vec![false; ways.len()];
    let mut open: Vec<usize> = roots.into_iter().map(usize::from).collect();
    while let Some(at) = open.pop() {
        match reached.get_mut(at) {
            Some(seen) if !*seen => *seen = true,
            _ => continue,
        }
        open.extend(ways.get(at).into_iter().flatten());
    }
    reached
}
