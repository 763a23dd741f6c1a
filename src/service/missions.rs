//! The missions that a brick offers, and its robot: files in folders that a person edits, read each
//! time.
//!
//! A mission goes by its file's name without the ending. Where there is no folder of missions, the
//! shipped ones are offered.

use std::io;
use std::path::Path;

use super::digest::sha256_hex;
use crate::behavior::{Capabilities, Mission, shipped};
use crate::document::{if_there, nearest_or_all, read_bounded};
use crate::printable::line;
use crate::protocol::{Chosen, Kind, MAX_MISSION_BYTES, MissionInfo, Refusal};
use crate::robot::{DEFAULT_ROBOT, RobotConfig};
use crate::runtime::Source;

/// No more missions are listed: a page of a menu, not a library.
const MOST_MISSIONS: usize = 200;

/// Reads the robot's file, and what it says; where there is none, takes the shipped one.
///
/// # Errors
///
/// What is wrong with it, for people.
pub(super) fn robot(path: &Path) -> Result<(Source, RobotConfig), String> {
    let name = path.display().to_string();
    let read = if_there(read(path)).map_err(|error| format!("cannot read {name}: {error}"))?;
    let source = match read {
        Some(bytes) => Source::of(&name, &bytes).map_err(|findings| findings.to_string())?,
        None => Source { name: "robot.toml".to_owned(), text: DEFAULT_ROBOT.to_owned() },
    };
    let (config, _) = source.robot().map_err(|findings| findings.to_string())?;
    Ok((source, config))
}

/// All missions, by name, each with what `check` says against it.
///
/// # Errors
///
/// The folder is there and cannot be listed.
pub(super) fn list(folder: &Path, capabilities: &Capabilities) -> io::Result<Vec<MissionInfo>> {
    let mut missions: Vec<MissionInfo> = match names(folder)? {
        Some(names) => {
            names.iter().map(|name| info(name, source_in(folder, name), capabilities)).collect()
        }
        None => shipped::MISSIONS
            .iter()
            .map(|mission| info(mission.name, Ok(shipped_source(mission)), capabilities))
            .collect(),
    };
    missions.sort_by(|one, other| one.name.cmp(&other.name));
    Ok(missions)
}

/// The mission that a start names or carries.
///
/// # Errors
///
/// [`Kind::UnknownMission`], or [`Kind::BrokenMission`] for one that cannot even be read.
pub(super) fn choose(folder: &Path, chosen: &Chosen) -> Result<Source, Refusal> {
    match chosen {
        Chosen::Text(text) if text.len() > MAX_MISSION_BYTES => {
            let message = format!(
                "the mission has {} bytes, and {MAX_MISSION_BYTES} are the most",
                text.len()
            );
            Err(Refusal::new(Kind::BrokenMission, message))
        }
        Chosen::Text(text) => {
            let source = Source { name: "mission.toml".to_owned(), text: text.clone() };
            Ok(source.with_submachines(None))
        }
        Chosen::Name(name) => by_name(folder, name),
    }
}

/// Loads a mission for a robot.
///
/// # Errors
///
/// [`Kind::BrokenMission`] with what was found.
pub(super) fn load(source: &Source, capabilities: &Capabilities) -> Result<Mission, Refusal> {
    source
        .mission(capabilities)
        .map(|(mission, _)| mission)
        .map_err(|findings| Refusal::new(Kind::BrokenMission, findings.to_string()))
}

fn by_name(folder: &Path, name: &str) -> Result<Source, Refusal> {
    let failed = |error: io::Error| {
        Refusal::failed(format!("cannot read the missions in {}: {error}", folder.display()))
    };
    let (known, source) = match names(folder).map_err(failed)? {
        // Only names that the folder lists are opened: no path comes from outside.
        Some(names) => {
            let found = names.contains(&name.to_owned()).then(|| source_in(folder, name));
            (names, found)
        }
        None => {
            let names = shipped::MISSIONS.iter().map(|mission| mission.name.to_owned()).collect();
            (names, shipped::find(name).map(|mission| Ok(shipped_source(mission))))
        }
    };
    match source {
        Some(Ok(source)) => Ok(source),
        Some(Err(why)) => Err(Refusal::new(Kind::BrokenMission, why)),
        None => {
            let name: String = name.chars().take(64).collect();
            let refusal = Refusal::new(
                Kind::UnknownMission,
                format!("there is no mission `{}` here", line(&name)),
            );
            Err(match known.as_slice() {
                [] => refusal.hint("the folder of missions is empty"),
                known => {
                    let known = known.iter().map(String::as_str);
                    refusal.hint(nearest_or_all(&name, "there are", known))
                }
            })
        }
    }
}

/// The names in the folder; `None` where there is no folder.
fn names(folder: &Path) -> io::Result<Option<Vec<String>>> {
    let Some(entries) = if_there(std::fs::read_dir(folder))? else { return Ok(None) };
    let mut names = Vec::new();
    for entry in entries.take(10 * MOST_MISSIONS) {
        let name = entry?.file_name();
        if let Some(name) = name.to_str().and_then(|name| name.strip_suffix(".toml"))
            && !name.is_empty()
            && !name.starts_with('.')
        {
            names.push(name.to_owned());
        }
    }
    names.sort();
    names.truncate(MOST_MISSIONS);
    Ok(Some(names))
}

fn source_in(folder: &Path, name: &str) -> Result<Source, String> {
    let file = format!("{name}.toml");
    let bytes =
        read(&folder.join(&file)).map_err(|error| format!("cannot read {file}: {error}"))?;
    let source = Source::of(&file, &bytes).map_err(|findings| findings.to_string())?;
    Ok(source.with_submachines(Some(folder)))
}

fn shipped_source(mission: &shipped::Shipped) -> Source {
    Source { name: format!("{}.toml", mission.name), text: mission.whole() }
}

fn info(name: &str, source: Result<Source, String>, capabilities: &Capabilities) -> MissionInfo {
    let unread = |findings| MissionInfo {
        name: name.to_owned(),
        sha256: String::new(),
        time_limit_s: None,
        findings: Some(findings),
    };
    let source = match source {
        Ok(source) => source,
        Err(why) => return unread(why),
    };
    let loaded = load(&source, capabilities);
    MissionInfo {
        name: name.to_owned(),
        sha256: sha256_hex(source.text.as_bytes()),
        time_limit_s: loaded.as_ref().ok().map(Mission::time_limit_s),
        findings: loaded.err().map(|refusal| refusal.message),
    }
}

/// Reads at most one byte more than a document may have; what is no plain file is not read, because
/// it may never end.
pub(super) fn read(path: &Path) -> io::Result<Vec<u8>> {
    if !std::fs::metadata(path)?.is_file() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "it is no file"));
    }
    read_bounded(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_folder_the_shipped_missions_are_offered_and_all_are_in_order() {
        let (_, robot) = robot(Path::new("/not/there/robot.toml")).unwrap();
        let missions = list(Path::new("/not/there"), &robot.capabilities()).unwrap();
        assert_eq!(missions.len(), shipped::MISSIONS.len());
        let map = missions.iter().find(|mission| mission.name == "map").unwrap();
        assert_eq!((map.findings.as_ref(), map.sha256.len()), (None, 64));
        assert_eq!(map.sha256, sha256_hex(shipped::find("map").unwrap().text.as_bytes()));
    }

    #[test]
    fn a_folder_says_which_missions_there_are_and_what_is_wrong_with_them() {
        let folder = tempfile::tempdir().unwrap();
        let put = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        put("mine.toml", shipped::find("bump").unwrap().text);
        put("broken.toml", "name = 3\n");
        put("notes.txt", "nothing");
        put(".hidden.toml", "");
        std::fs::create_dir(folder.path().join("folder.toml")).unwrap();
        let missions = list(folder.path(), &Capabilities::all()).unwrap();
        let names: Vec<&str> = missions.iter().map(|mission| mission.name.as_str()).collect();
        assert_eq!(names, ["broken", "folder", "mine"]);
        assert!(
            missions[0].findings.as_ref().unwrap().contains("broken.toml:1"),
            "{:?}",
            missions[0]
        );
        assert!(missions[1].findings.as_ref().unwrap().contains("no file"), "{:?}", missions[1]);
        assert_eq!(missions[2].findings, None);
    }

    #[test]
    fn no_path_comes_from_outside() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("bump.toml"), shipped::find("bump").unwrap().text)
            .unwrap();
        let inside = folder.path().join("inside");
        std::fs::create_dir(&inside).unwrap();
        for name in ["../bump", "/etc/passwd", "", ".", "../inside/../bump", "bump.toml"] {
            let refusal = choose(&inside, &Chosen::Name(name.to_owned())).unwrap_err();
            assert_eq!(refusal.kind, Kind::UnknownMission, "{name}: {refusal}");
        }
        let long = Chosen::Text("x".repeat(MAX_MISSION_BYTES + 1));
        assert_eq!(choose(&inside, &long).unwrap_err().kind, Kind::BrokenMission);
        let near = choose(folder.path(), &Chosen::Name("bmp".to_owned())).unwrap_err();
        assert!(near.hint.as_ref().unwrap().contains("bump"), "{near:?}");
    }
}
