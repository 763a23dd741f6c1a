//! A mission's text with the sub-machines that it uses and does not define itself.
//!
//! They are put behind it, so that link and recording carry one text, and a replay needs nothing
//! else.
//!
//! # Not here
//!
//! Where files are: the caller finds them.

use std::collections::BTreeSet;

use super::shipped;
use crate::document::{self, Document, Item, Section};

/// The longest name that is looked for as a file.
const NAME_CHARACTERS: usize = 40;

/// The text with all sub-machines that it uses.
///
/// What is found must define sub-machines and nothing else. A name that is not found stays for the
/// reader of the mission to tell of.
///
/// - `find`: the text of the file that is called like a sub-machine, if there is one; without one
///   the sub-machine that comes with the program is taken. It is only asked for names of letters,
///   digits, `-` and `_`.
#[must_use]
pub fn joined(text: &str, mut find: impl FnMut(&str) -> Option<String>) -> String {
    let mut joined = text.to_owned();
    let mut asked = BTreeSet::new();
    loop {
        let missing = missing(&joined);
        let Some(name) = missing.into_iter().find(|name| !asked.contains(name)) else { break };
        let found = if is_plain(&name) { find(&name) } else { None };
        let found = found.or_else(|| shipped::submachine(&name).map(|found| found.text.to_owned()));
        if let Some(part) = found.filter(|part| is_part(part)) {
            joined = document::append(&joined, &format!("{name}.toml"), &part);
        }
        asked.insert(name);
    }
    joined
}

/// A mission that uses each sub-machine of a text, so that they can be checked; `None` for a text
/// that has anything else.
///
/// - `file`: the name of the text's file, for what is found in it.
#[must_use]
pub fn using(text: &str, file: &str) -> Option<String> {
    let document = Document::new("", text.as_bytes()).ok().filter(|_| is_part(text))?;
    let names = |root: &Section<'_>| {
        let all = root.items_of("submachine");
        Some(all.iter().map(|item| item.key().to_owned()).collect::<Vec<_>>())
    };
    let (names, _) = document.read(names).ok()?;
    let end = names.len();
    let mut mission = format!("name = \"check\"\n[machine.uses]\nfinal = \"{end}\"\n");
    for (at, name) in names.iter().enumerate() {
        let (name, next) = (document::save::quoted(name), at + 1);
        mission.push_str(&format!(
            "[machine.uses.state.{at}]\nuse = {name}\n\
             next = [{{ when = \"state_s > 1\", go = \"{next}\" }}]\n"
        ));
    }
    mission.push_str(&format!("[machine.uses.state.{end}]\n"));
    Some(document::append(&mission, file, text))
}

/// The sub-machines that are used and not defined.
fn missing(text: &str) -> BTreeSet<String> {
    let Ok(document) = Document::new("", text.as_bytes()) else { return BTreeSet::new() };
    let names = document.read(|root| {
        let machines = ["machine", "submachine"].into_iter().filter_map(|key| root.get(key));
        let machines = machines.filter_map(|item| item.section()).flat_map(|all| all.items());
        let states = machines.filter_map(|machine| machine.get("state")?.section());
        let used = states.flat_map(|states| states.items()).filter_map(|state| {
            let name = state.get("use").filter(Item::is_text)?;
            name.text().map(str::to_owned)
        });
        let defined = root.section("submachine");
        let is_defined = |name: &str| defined.as_ref().is_some_and(|all| all.get(name).is_some());
        Some(used.filter(|name| !is_defined(name)).collect())
    });
    names.map(|(names, _)| names).unwrap_or_default()
}

/// Whether a name may be looked for as a file.
fn is_plain(name: &str) -> bool {
    (1..=NAME_CHARACTERS).contains(&name.len())
        && name.chars().all(|sign| sign.is_ascii_alphanumeric() || matches!(sign, '-' | '_'))
}

/// Whether a text has sub-machines and nothing else; one that is no TOML is told of when it is
/// read.
fn is_part(text: &str) -> bool {
    let Ok(document) = Document::new("", text.as_bytes()) else { return false };
    let keys = document.read(|root: &Section<'_>| {
        Some(root.items().iter().map(|item| item.key().to_owned()).collect::<Vec<_>>())
    });
    keys.map_or(true, |(keys, _)| keys == ["submachine"])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::behavior::{Capabilities, Mission};

    const USER: &str = "name = \"m\"\n[machine.drive]\nstart = \"a\"\nfinal = \"end\"\n\
        [machine.drive.state.a]\nuse = \"NAME\"\nnext = [{ when = \"done\", go = \"end\" }]\n\
        [machine.drive.state.end]\n";

    fn part(name: &str, state: &str) -> String {
        format!(
            "[submachine.{name}]\nstart = \"x\"\nfinal = \"y\"\n[submachine.{name}.state.x]\n\
            {state}\nnext = [{{ when = \"done\", go = \"y\" }}]\n[submachine.{name}.state.y]\n"
        )
    }

    fn load(text: &str) -> Result<Mission, String> {
        let read = Mission::parse("m.toml", text.as_bytes(), &Capabilities::all());
        read.map(|(mission, _)| mission).map_err(|findings| findings.to_string())
    }

    #[test]
    fn parts_are_found_through_parts_and_each_is_put_there_once() {
        let mut asked = Vec::new();
        let whole = joined(&USER.replace("NAME", "one"), |name| {
            asked.push(name.to_owned());
            match name {
                "one" => Some(part("one", "use = \"two\"")),
                "two" => Some(part("two", "do = { drive_m = 1 }")),
                _ => None,
            }
        });
        assert_eq!(asked, ["one", "two"]);
        let mission = load(&whole).unwrap();
        let states = &mission.machines()[0].states;
        let names: Vec<&str> = states.iter().map(|state| state.name.as_str()).collect();
        assert_eq!(names, ["a", "a.x", "a.x.x", "a.x.y", "a.y", "end"]);
        assert_eq!(joined(&whole, |_| None), whole, "it is whole already");
    }

    #[test]
    fn sub_machines_are_checked_by_a_mission_that_uses_them() {
        let two = part("one", "do = { drive_m = 1 }") + &part("to-wall", "use = \"one\"");
        load(&using(&two, "two.toml").unwrap()).unwrap();
        let error =
            load(&using(&two.replace("drive_m = 1", "drive_m = \"rangem\""), "two.toml").unwrap())
                .unwrap_err();
        assert!(error.contains("--> two.toml:5:"), "{error}");
        assert_eq!(using("name = \"m\"\n[machine.m.state.a]\n", "m.toml"), None);
        for shipped in shipped::SUBMACHINES {
            load(&using(shipped.text, shipped.name).unwrap()).unwrap();
        }
    }

    #[test]
    fn a_mistake_in_a_part_is_told_at_its_own_place() {
        let whole = joined(&USER.replace("NAME", "one"), |_| {
            Some(part("one", "do = { drive_m = \"rangem\" }"))
        });
        let error = load(&whole).unwrap_err();
        assert!(error.contains("--> one.toml:5:"), "{error}");
        let broken = joined(&USER.replace("NAME", "one"), |_| Some(part("one", "do = {")));
        let error = load(&broken).unwrap_err();
        assert!(error.contains("--> one.toml:5:"), "{error}");
    }

    #[test]
    fn a_file_without_the_sub_machine_of_its_name_is_told_with_what_it_has() {
        let whole =
            joined(&USER.replace("NAME", "hop"), |name| (name == "hop").then(|| part("jump", "")));
        let error = load(&whole).unwrap_err();
        assert!(error.contains("there is no sub-machine `hop`"), "{error}");
        let hint = "hop.toml has jump: rename it there to [submachine.hop]";
        assert!(error.contains(hint), "{error}");
    }

    #[test]
    fn only_plain_names_are_looked_for_and_only_sub_machines_are_taken() {
        for name in ["../etc/passwd", "a/b", "", "ä"] {
            let text = USER.replace("NAME", name);
            let whole = joined(&text, |name| panic!("`{name}` was looked for"));
            assert_eq!(whole, text);
        }
        let text = USER.replace("NAME", "bump");
        let mission = shipped::find("bump").unwrap().text;
        assert_eq!(joined(&text, |_| Some(mission.to_owned())), text);
        let error = load(&text).unwrap_err();
        assert!(error.contains("there is no sub-machine `bump`"), "{error}");
        let error = load(&USER.replace("NAME", "wander")).unwrap_err();
        assert!(error.contains("it comes with onbrick"), "{error}");
    }
}
