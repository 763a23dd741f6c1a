//! What the page's server answers, by address.
//!
//! | address | |
//! |---|---|
//! | `/`, `/*.js`, `/*.css` | the page |
//! | `/state?since=` | all cards, and what is new of each picture |
//! | `/live/N/…`, `/try/…` | the live page of one brick's run, and of the simulated one |
//! | `/runs/N`, `/map/N/FILE` | a brick's runs, and the picture of one that is here |
//! | `/map/team` | the picture of the team's runs |
//! | `/missions…` | the files |
//! | posts | `stop`, `start`, `identify`, `fetch`, `rename`, `delete`, `pair`, `answer`, `save`, `check`, `try`, `team` |

use std::sync::Arc;
use std::sync::atomic::Ordering;

use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use super::brick::{Brick, Order};
use super::hall::Hall;
use super::missions::{Missions, Trying};
use super::together::{self, Member};
use crate::cli::common::{LoadedRun, open_run, read_run};
use crate::cli::pc::scene::scene_of;
use crate::link::client::{PORT, part_of};
use crate::page::{Asked, Kind, Shown};
use crate::printable::{self, with_causes};
use crate::protocol::{Name, RunId, RunInfo};
use crate::report::live::Wish;
use crate::report::plot;
use crate::sim::World;
use crate::threads::{lock, spawn};

/// What the page is made of.
const PARTS: [(&str, Kind, &str); 9] = [
    ("/", Kind::Html, include_str!("page/class.html")),
    ("/class.css", Kind::Style, include_str!("page/class.css")),
    ("/class.js", Kind::Script, include_str!("page/class.js")),
    ("/parts.js", Kind::Script, include_str!("page/parts.js")),
    ("/cards.js", Kind::Script, include_str!("page/cards.js")),
    ("/brick.js", Kind::Script, include_str!("page/brick.js")),
    ("/missions.js", Kind::Script, include_str!("page/missions.js")),
    ("/together.js", Kind::Script, include_str!("page/together.js")),
    ("/picture.js", Kind::Script, include_str!("page/picture.js")),
];

/// Answers what a browser asks.
pub(super) fn answer(hall: &Arc<Hall>, asked: Asked<'_>) -> Shown {
    let path: Vec<&str> = asked.path.trim_start_matches('/').splitn(3, '/').collect();
    match (path.as_slice(), asked.posted) {
        (["live", number, rest], _) => live(hall, number, rest, asked),
        (["try", rest], _) => {
            let path = format!("/{rest}");
            let trying = Arc::clone(hall);
            hall.trial.board.answer(Asked { path: &path, ..asked }, &move |wish| match wish {
                Wish::Stop => trying.trial.stop(),
                Wish::Again => again(&trying),
            })
        }
        (path, None) => shown(hall, path, asked).unwrap_or_else(Shown::Refused),
        (path, Some(text)) => done(hall, path, text).unwrap_or_else(Shown::Refused),
    }
}

/// One brick's live page, whose Stop is that of its card.
fn live(hall: &Hall, number: &str, rest: &str, asked: Asked<'_>) -> Shown {
    let Ok(brick) = numbered(hall, number) else { return Shown::Nothing };
    let path = format!("/{rest}");
    let stops = Arc::clone(&brick);
    brick.board.answer(Asked { path: &path, ..asked }, &move |wish| {
        if wish == Wish::Stop {
            stops.stop();
        }
    })
}

fn numbered(hall: &Hall, number: &str) -> Result<Arc<Brick>, String> {
    hall.brick(number.parse().map_err(|_| "a brick has a number here".to_owned())?)
}

fn shown(hall: &Hall, path: &[&str], asked: Asked<'_>) -> Result<Shown, String> {
    let value = |key: &str| {
        let mut parts = asked.query.split('&').filter_map(|part| part.split_once('='));
        parts.find(|(name, _)| *name == key).map(|(_, value)| value).unwrap_or_default()
    };
    Ok(match path {
        ["state"] => Shown::json(hall.state(value("since"))),
        ["missions"] => json(&hall.missions.list()),
        ["missions", "text"] => json(&json!(hall.missions.read(value("name"))?)),
        ["missions", "template"] => {
            json(&json!(Missions::template(value("name"), value("called"))?))
        }
        ["missions", "versions"] => json(&hall.missions.versions(value("name"))?),
        ["missions", "version"] => {
            json(&json!(hall.missions.version(value("name"), value("stamp"))?))
        }
        ["worlds"] => json(&World::names().collect()),
        ["runs", number] => json(&runs(&*numbered(hall, number)?)),
        ["ports", number] => json(&ports(&*numbered(hall, number)?)),
        ["map", "team"] => team_map(hall)?,
        ["map", number, file] => map(&numbered(hall, number)?.folder.join(recording(file)?))?,
        _ => Shown::part(&PARTS, asked.path),
    })
}

/// A value, the texts in which come from files and bricks.
fn json(value: &Value) -> Shown {
    Shown::json(printable::json(&value.to_string()).into_owned())
}

/// A mission as the page has it.
#[derive(Debug, Deserialize)]
struct Text {
    name: String,
    text: String,
}

/// A mission that was edited, and its text as the page had it before.
#[derive(Debug, Deserialize)]
struct Saved {
    #[serde(flatten)]
    mission: Text,
    #[serde(default)]
    known: String,
}

#[derive(Debug, Deserialize)]
struct StartOn {
    bricks: Vec<usize>,
    #[serde(flatten)]
    mission: Text,
}

#[derive(Debug, Deserialize)]
struct TryIn {
    world: String,
    #[serde(flatten)]
    mission: Text,
}

#[derive(Debug, Deserialize)]
struct StartTeam {
    members: Vec<Member>,
    #[serde(flatten)]
    mission: Text,
}

#[derive(Debug, Deserialize)]
struct OfBrick {
    brick: usize,
    #[serde(default)]
    run: String,
    /// Another name for a file.
    #[serde(default)]
    to: String,
}

#[derive(Debug, Deserialize)]
struct Stranger {
    address: String,
    port: Option<u16>,
}

fn read<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    serde_json::from_str(text).map_err(|error| format!("this is not understood: {error}"))
}

fn done(hall: &Arc<Hall>, path: &[&str], text: &str) -> Result<Shown, String> {
    match path {
        ["stop"] if text.is_empty() => hall.stop(),
        ["stop"] => hall.brick(read::<OfBrick>(text)?.brick)?.stop(),
        ["identify"] => hall.brick(read::<OfBrick>(text)?.brick)?.order(Order::Identify),
        ["start"] => {
            let StartOn { bricks, mission: Text { name, text } } = read(text)?;
            let bricks: Vec<_> =
                bricks.into_iter().map(|number| hall.brick(number)).collect::<Result<_, _>>()?;
            bricks.iter().try_for_each(|brick| hall.start(brick, &name, &text, None))?;
        }
        ["team"] => {
            let StartTeam { members, mission: Text { name, text } } = read(text)?;
            together::start(hall, members, &name, &text)?;
        }
        ["fetch"] => {
            let OfBrick { brick, run, .. } = read(text)?;
            let run = RunId::new(&run).map_err(|error| error.to_string())?;
            hall.brick(brick)?.order(Order::Fetch(run));
        }
        ["rename"] => rename(hall, &read(text)?)?,
        ["delete"] => {
            let OfBrick { brick, run, .. } = read(text)?;
            let file = hall.brick(brick)?.folder.join(recording(&run)?);
            std::fs::remove_file(&file)
                .map_err(|error| format!("cannot delete {}: {error}", file.display()))?;
        }
        ["pair"] => {
            let Stranger { address, port } = read(text)?;
            hall.pair(&address, port.unwrap_or(PORT))?;
        }
        ["answer"] => hall.pairing.answer(text == "yes")?,
        ["close"] => hall.pairing.close()?,
        ["save"] => {
            let Saved { mission, known } = read(text)?;
            let is_changed = hall.missions.save(&mission.name, &mission.text, &known)?;
            return Ok(json(&Value::from(is_changed)));
        }
        ["check"] => {
            let Text { name, text } = read(text)?;
            return Ok(json(&hall.missions.check(&name, &text)));
        }
        ["try"] => try_here(hall, read(text)?)?,
        _ => return Ok(Shown::Fixed),
    }
    Ok(Shown::Done)
}

/// Runs a mission on a simulated brick, in a thread of its own.
fn try_here(hall: &Arc<Hall>, TryIn { world, mission }: TryIn) -> Result<(), String> {
    if World::names().all(|name| name != world) {
        return Err("there is no such world".to_owned());
    }
    let trying = Trying {
        mission: hall.missions.source(&mission.name, &mission.text),
        world,
        file: hall.folder.join("try.mcap"),
    };
    play(hall, trying)
}

fn again(hall: &Arc<Hall>) {
    if let Some(last) = hall.trial.last() {
        // What cannot be started is not started.
        let _ = play(hall, last);
    }
}

fn play(hall: &Arc<Hall>, trying: Trying) -> Result<(), String> {
    let hall = Arc::clone(hall);
    let spawned = spawn("try", move || hall.trial.play(&trying));
    spawned.map(|_| ()).map_err(|error| error.to_string())
}

/// A recording's file from its name, which leads nowhere else.
fn recording(name: &str) -> Result<String, String> {
    Name::new(name).map(|name| format!("{}.mcap", name.as_str())).map_err(|error| error.to_string())
}

/// Gives a recording that is here another name.
fn rename(hall: &Hall, OfBrick { brick, run, to }: &OfBrick) -> Result<(), String> {
    let folder = &hall.brick(*brick)?.folder;
    let (from, to) = (folder.join(recording(run)?), folder.join(recording(to)?));
    if to.exists() {
        return Err(format!("{} is there already", to.display()));
    }
    std::fs::rename(&from, &to)
        .map_err(|error| format!("cannot rename {}: {error}", from.display()))
}

/// What a brick's ports read, which is asked for once more.
fn ports(brick: &Brick) -> Value {
    brick.wanted.ports.store(true, Ordering::Relaxed);
    json!(lock(&brick.seen).ports)
}

/// The runs that a brick has, which are asked for once more, and the recordings that are here.
fn runs(brick: &Brick) -> Value {
    brick.wanted.runs.store(true, Ordering::Relaxed);
    let seen = lock(&brick.seen);
    let there = |info: &RunInfo| json!({ "info": info, "arrival": seen.brought.get(&info.run) });
    let entries = std::fs::read_dir(&brick.folder).into_iter().flatten().flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let mut here: Vec<String> =
        names.filter_map(|name| Some(name.strip_suffix(".mcap")?.to_owned())).collect();
    here.sort();
    json!({
        "there": seen.runs.as_ref().map(|runs| runs.iter().map(there).collect::<Vec<_>>()),
        "here": here,
        "folder": brick.folder.display().to_string(),
    })
}

fn map(file: &std::path::Path) -> Result<Shown, String> {
    let run = file.exists().then(|| open_run(file)).transpose();
    picture(run.map_err(|failure| failure.message)?.as_slice(), None)
}

/// What the team's bricks have found, in one picture.
fn team_map(hall: &Hall) -> Result<Shown, String> {
    let mut runs = Vec::new();
    for number in hall.together.members() {
        let brick = hall.brick(number)?;
        let Some(run) = lock(&brick.seen).started.clone() else { continue };
        let file = brick.folder.join(format!("{run}.mcap"));
        let found = if file.exists() { open_run(&file) } else { read_run(&part_of(&file)) };
        runs.extend(found);
    }
    picture(&runs, Some("together"))
}

fn picture(runs: &[LoadedRun], title: Option<&str>) -> Result<Shown, String> {
    if runs.is_empty() {
        return Err("there is no recording yet".to_owned());
    }
    let svg = plot::svg(&scene_of(runs, title)).map_err(|error| with_causes(&error))?;
    Ok(Shown::Text(Kind::Svg, svg.into()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::{KeyPair, KnownBrick};

    #[test]
    fn nothing_starts_where_one_of_the_bricks_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let own = KeyPair::generate().unwrap();
        let known = KnownBrick {
            name: "blue".to_owned(),
            address: "127.0.0.1:1".to_owned(),
            key: own.public(),
        };
        let hall = Arc::new(Hall::new(folder.path(), folder.path(), own));
        hall.admit(&known);
        let start = json!({ "bricks": [0, 7], "name": "mine", "text": "" }).to_string();
        let refused = done(&hall, &["start"], &start).unwrap_err();
        hall.end();
        assert_eq!(refused, "there is no such brick");
        assert!(!folder.path().join("kept").exists(), "what is started is kept");
    }

    #[test]
    fn a_recording_that_cannot_be_read_says_why() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("run.mcap");
        assert_eq!(map(&file).unwrap_err(), "there is no recording yet");
        std::fs::write(&file, "no recording").unwrap();
        let why = map(&file).unwrap_err();
        assert!(why.contains("it is no MCAP file"), "{why}");
    }
}
