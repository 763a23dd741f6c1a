//! A mission looked at as a whole: what can be reached and left, what can never fire, who moves
//! what.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use super::load::{Draft, Reader};
use super::{DrivePlan, MachinePlan, TransitionPlan};
use crate::behavior::engine::Finish;
use crate::behavior::expression::{Claims, Vocabulary};
use crate::document::{Section, Severity, nearest};
use crate::senses::{Channel, QUANTITIES, Quantity, Role};

/// The key `on_stall`: "stop", or a state of the machine that drives the wheels, which learns it.
/// False where it is neither.
pub(super) fn on_stall(root: &Section<'_>, drafts: &mut [Draft]) -> bool {
    let Some(item) = root.get("on_stall") else { return true };
    let Some(state) = item.text() else { return false };
    if state == "stop" {
        return true;
    }
    let Some(driving) = drafts.iter_mut().find(|draft| draft.moves.contains_key(&Role::Wheels))
    else {
        item.error("no machine drives the wheels, so none can go on from a stall")
            .hint("write `on_stall = \"stop\"`");
        return false;
    };
    driving.plan.region.on_stall = driving.plan.position(state);
    if driving.plan.region.on_stall.is_none() {
        let names = driving.plan.inside(None).take(200).map(|(_, state)| state.name.as_str());
        item.error(format!(
            "machine `{}` drives the wheels and has no state `{state}`",
            driving.plan.name
        ))
        .hint(nearest(state, names.chain(["stop"])).unwrap_or_default());
    }
    driving.plan.region.on_stall.is_some()
}

/// All checks that take more than one key; those of ways only where all that leads somewhere is
/// known.
pub(super) fn whole(
    reader: &Reader<'_, '_, '_>,
    drafts: &[Draft],
    finish: Finish,
    ways_are_known: bool,
) {
    let root = reader.root;
    if finish == Finish::Any || drafts.len() == 1 {
        drafts.iter().for_each(|draft| after_the_end(root, &draft.plan));
    } else {
        outlasting(root, drafts);
    }
    one_machine_each(reader, drafts);
    if drafts.iter().all(|draft| draft.complete) {
        never_set(reader, drafts);
    }
    one_mode_each(reader);
    for draft in drafts {
        counts_ticks(root, &draft.plan, &reader.vocabulary);
        let impossible = conditions(root, &draft.plan, reader.time_limit_s());
        if draft.complete && ways_are_known {
            paths(root, draft, &impossible);
            stands(root, &draft.plan);
        }
    }
}

/// What a final state says where the mission ends with it.
fn after_the_end(root: &Section<'_>, plan: &MachinePlan) {
    let Some(state) = plan.region.end.and_then(|end| plan.state(end)) else { return };
    let name = &state.name;
    let warn = |place: &Range<usize>, what: &str| {
        let message = format!("the mission ends in the final state `{name}`: {what}");
        root.note(place.clone(), Severity::Warning, message)
            .hint("let one more state come before it, or be final");
    };
    if state.doing.roles().next().is_some()
        && !matches!(state.doing.drive, Some(DrivePlan::Stop(_)))
    {
        warn(&state.place, "nothing moves there");
    }
    if let Some(next) = state.next.first() {
        warn(&next.place, "no condition is looked at there");
    }
}

/// Machines without an end, for which the others wait until the time is over.
fn outlasting(root: &Section<'_>, drafts: &[Draft]) {
    let ends = |draft: &&Draft| draft.plan.region.end.is_some();
    let Some(ending) = drafts.iter().find(ends) else { return };
    for endless in drafts.iter().filter(|draft| !ends(draft)) {
        let (ending, name) = (&ending.plan.name, &endless.plan.name);
        let place = endless.plan.states.first().map_or(0..0, |state| state.place.clone());
        let message = format!(
            "`{ending}` has an end and `{name}` has none: the mission lasts until its time limit"
        );
        root.note(place, Severity::Warning, message)
            .hint("write `finish = \"any\"` above the machines, or give it a `final`");
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
                        .motors
                        .names()
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
            let hint = one_of_two(*other, *channel);
            reader.root.note(place.clone(), Severity::Error, message).hint(hint);
        }
        firsts.push((*channel, place));
    }
}

/// The way out where a sensor would have to measure two things: one of them, or what it measures
/// together.
fn one_of_two(one: Channel, two: Channel) -> String {
    let role = one.quantity().role;
    let same = || QUANTITIES.iter().filter(|quantity| quantity.role == role);
    let goes_with_another = |quantity: &&Quantity| {
        let channel = quantity.channel;
        same().any(|other| other.channel != channel && other.channel.goes_with(channel))
    };
    let together: Vec<&Quantity> = same().filter(goes_with_another).collect();
    let hint = "use one of the two in the whole mission";
    if together.is_empty() || together.iter().any(|each| [one, two].contains(&each.channel)) {
        return hint.to_owned();
    }
    let names: Vec<&str> = together.iter().map(|quantity| quantity.name).collect();
    format!("{hint}; {} come together", names.join(", "))
}

/// Transitions that cannot fire: those for all states, by the state that they are inside, and each
/// state's own.
struct Impossible {
    always: BTreeMap<Option<u16>, Vec<bool>>,
    states: Vec<Vec<bool>>,
}

/// Conditions that can never hold, that always hold, or that come too late.
///
/// Those of a state and of the state that it is inside are not compared: `state_s` is another time
/// in each.
fn conditions(root: &Section<'_>, plan: &MachinePlan, time_limit_s: f64) -> Impossible {
    let inner =
        (0..).zip(&plan.states).filter_map(|(at, state)| Some((Some(at), state.inner.as_ref()?)));
    let regions = inner.chain([(None, &plan.region)]);
    let always: BTreeMap<Option<u16>, Vec<Claimed<'_>>> =
        regions.map(|(parent, region)| (parent, claims(&region.always))).collect();
    let states = (0..).zip(&plan.states).map(|(at, state)| {
        let end = plan.around(state).and_then(|region| region.end);
        // Those for all states come first, but for the final state and the one they lead to.
        let here = always.get(&state.parent).into_iter().flatten();
        let here = here.filter(|(next, _)| next.go != at && end != Some(at));
        late(root, here.collect(), &claims(&state.next), time_limit_s)
    });
    let states = states.collect();
    let always = always
        .iter()
        .map(|(parent, claims)| (*parent, late(root, Vec::new(), claims, time_limit_s)));
    Impossible { always: always.collect(), states }
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
    time_limit_s: f64,
) -> Vec<bool> {
    let mut impossible = Vec::with_capacity(transitions.len());
    for transition in transitions {
        let (next, claim) = transition;
        let place = next.place.clone();
        let earlier = before.iter().find(|(_, earlier)| claim.implies(earlier));
        let (error, warning) = (Severity::Error, Severity::Warning);
        let never = claim.is_never();
        let why = |holds: bool, else_hint: &str| {
            let beyond = next.when.beyond(time_limit_s, Some(holds));
            beyond.map_or_else(|| else_hint.to_owned(), |beyond| beyond.why())
        };
        if never {
            root.note(place, error, "this condition can never hold")
                .hint(why(false, "look at its numbers, or take it out"));
        } else if let Some((earlier, _)) = earlier {
            let other = earlier.when.text();
            let message =
                format!("this can never fire: `{other}` before it holds whenever this does");
            root.note(place, error, message).hint("put the narrower condition first");
        } else if claim.is_always() && next.when.text() != "true" {
            root.note(place, warning, "this condition always holds")
                .hint(why(true, "write `true` if that is meant"));
        }
        impossible.push(never || earlier.is_some());
        before.push(transition);
    }
    impossible
}

/// Variables of the mission that conditions compare with a number and nothing sets.
fn never_set(reader: &Reader<'_, '_, '_>, drafts: &[Draft]) {
    let plans = || drafts.iter().map(|draft| &draft.plan);
    let transitions = || plans().flat_map(MachinePlan::all_transitions);
    let of_states = plans().flat_map(|plan| &plan.states).flat_map(|state| &state.set);
    let set: BTreeSet<u8> = transitions()
        .flat_map(|next| &next.set)
        .chain(of_states)
        .map(|assignment| assignment.variable)
        .collect();
    for (at, (name, _)) in (0_u8..).zip(&reader.vocabulary.variables) {
        let asks = transitions().find(|next| next.when.compares(at) && !set.contains(&at));
        if let Some(next) = asks {
            let message = format!("nothing sets the variable `{name}`: it stays what it is");
            reader.root.note(next.place.clone(), Severity::Warning, message).hint(format!(
                "to count, write `set = {{ {name} = \"{name} + 1\" }}` in a transition"
            ));
        }
    }
}

/// Transitions that enter their own state once more in each tick as long as they hold, and count.
fn counts_ticks(root: &Section<'_>, plan: &MachinePlan, vocabulary: &Vocabulary<'_>) {
    for (at, state) in (0..).zip(&plan.states) {
        for next in state.next.iter().filter(|next| next.go == at) {
            let counting = next.set.iter().filter(|set| set.value.takes(set.variable));
            let counted: Vec<u8> = counting.map(|set| set.variable).collect();
            let Some(first) = counted.first().filter(|_| next.when.is_level(&counted)) else {
                continue;
            };
            let name = vocabulary.variables.get(usize::from(*first));
            let name = name.map_or("?", |(name, _)| name.as_str());
            let message =
                format!("this fires in each tick in which it holds, so that `{name}` counts ticks");
            root.note(next.place.clone(), Severity::Warning, message)
                .hint("let it go to a state that waits until it no longer holds");
        }
    }
}

/// States whose motion comes to its end while each way out waits for something beside the robot.
fn stands(root: &Section<'_>, plan: &MachinePlan) {
    for (at, state) in (0..).zip(&plan.states) {
        let moves =
            matches!(state.doing.drive, Some(DrivePlan::Motion(_) | DrivePlan::Navigation { .. }));
        let is_final = plan.around(state).is_some_and(|region| region.end == Some(at));
        if !moves || is_final || state.next.is_empty() {
            continue;
        }
        if plan.transitions(at).all(|next| next.when.asks_of_the_world()) {
            let message = format!(
                "no transition of state `{}` asks for `done` or a time: after its motion the robot \
                 may wait for ever",
                state.name
            );
            root.note(state.place.clone(), Severity::Warning, message)
                .hint("write `done or \u{2026}`, or one more transition with `when = \"done\"`");
        }
    }
}

/// States that cannot be reached, states that cannot be left, and states from which there is no way
/// to the final one, each in its machine or sub-machine.
fn paths(root: &Section<'_>, draft: &Draft, impossible: &Impossible) {
    let plan = &draft.plan;
    let blocked = ways_of_stalls(plan);
    let (forward, backward) = ways(plan, &blocked);
    // No way leads into a sub-machine or out of it, so that all can be looked at together.
    let regions =
        || plan.states.iter().filter_map(|state| state.inner.as_ref()).chain([&plan.region]);
    let stalls = regions()
        .filter_map(|region| region.on_stall.filter(|_| draft.moves.contains_key(&Role::Wheels)));
    let reached = closure(&forward, regions().map(|region| region.start).chain(stalls));
    let ends = closure(&backward, regions().filter_map(|region| region.end));
    let mut beside: BTreeMap<Option<u16>, usize> = BTreeMap::new();
    for state in &plan.states {
        *beside.entry(state.parent).or_default() += 1;
    }
    for (at, state) in (0_u16..).zip(&plan.states) {
        let Some(region) = plan.around(state) else { continue };
        let index = usize::from(at);
        let named = &state.name;
        let own = state.next.iter().zip(impossible.states.get(index).into_iter().flatten());
        let always = impossible.always.get(&state.parent).into_iter().flatten();
        let mut leaves = region.always.iter().zip(always).chain(own);
        let is_left = leaves.any(|(next, never)| next.go != at && !never)
            || blocked.iter().any(|(from, to)| *from == index && *to != index);
        // A machine of one state does one thing until the mission ends, and a sub-machine without a
        // final state is left by the state that uses it.
        let may_stay = region.end == Some(at)
            || beside.get(&state.parent) == Some(&1)
            || state.parent.is_some() && region.end.is_none();
        let (severity, message, way_out) = if reached.get(index) != Some(&true) {
            let start = name(draft, region.start);
            let message = format!("state `{named}` cannot be reached from `{start}`");
            (
                Severity::Error,
                message,
                "let another state go here, or name it as `start` of its machine",
            )
        } else if !may_stay && !is_left {
            let message = format!("state `{named}` cannot be left, and it is not final");
            (
                Severity::Error,
                message,
                "give it a transition to another state, or name it as `final` of its machine",
            )
        } else if let Some(end) = region.end
            && ends.get(index) == Some(&false)
        {
            let end = name(draft, end);
            let message =
                format!("from state `{named}` there is no way to the final state `{end}`");
            (Severity::Warning, message, "without one the mission runs until its time limit")
        } else {
            continue;
        };
        root.note(state.place.clone(), severity, message).hint(way_out);
    }
}

/// Where states lead whose wheels are blocked: from the one that is left, beside the other or
/// around it. A motion over the map backs off by itself.
fn ways_of_stalls(plan: &MachinePlan) -> Vec<(usize, usize)> {
    let can_be_blocked = |at: u16| {
        let drives = plan.chain(at).filter_map(|(_, state)| state.doing.drive.as_ref());
        !matches!(drives.last(), None | Some(DrivePlan::Stop(_) | DrivePlan::Navigation { .. }))
    };
    let led = (0..).zip(plan.stalls()).filter(|(at, _)| can_be_blocked(*at));
    let way = |(at, to): (u16, Option<u16>)| {
        let (to, beside) = (to?, plan.state(to?)?.parent);
        let (from, _) = plan.chain(at).find(|(_, state)| state.parent == beside)?;
        Some((usize::from(from), usize::from(to)))
    };
    led.filter_map(way).collect()
}

/// Where each state leads, and from where each is come to.
fn ways(plan: &MachinePlan, more: &[(usize, usize)]) -> (Vec<Vec<usize>>, Vec<Vec<usize>>) {
    let mut forward = vec![Vec::new(); plan.states.len()];
    let mut backward = forward.clone();
    for (from, to) in more {
        if let (Some(ways), Some(back)) = (forward.get_mut(*from), backward.get_mut(*to)) {
            ways.push(*to);
            back.push(*from);
        }
    }
    for (from, state) in plan.states.iter().enumerate() {
        let Some(region) = plan.around(state) else { continue };
        let is_end = region.end.is_some_and(|end| usize::from(end) == from);
        let always = region.always.iter().filter(|_| !is_end);
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
