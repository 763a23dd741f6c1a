//! The missions of a class: files in a folder of this PC, each edit of which is kept; what `check`
//! says of a text; and the run of one on a simulated brick.
//!
//! ```text
//! FOLDER/missions/NAME.toml          as it is now: any editor may change it as well
//! FOLDER/kept/NAME/STAMP.toml        as it was saved from the page, each time, or found changed
//! FOLDER/kept/NAME/STAMP-BRICK.toml  as it was started on a brick
//! ```
//!
//! A stamp is in milliseconds since 1970.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::Ordering;

use serde_json::{Value, json};

use crate::behavior::{Capabilities, shipped};
use crate::cli::Failure;
use crate::cli::common::{load_mission, load_robot, load_world, read_own};
use crate::cli::run::page::watched;
use crate::clock::{MILLISECOND_NS, wall_ns};
use crate::document::if_there;
use crate::document::save::{self, Readers};
use crate::printable::with_causes;
use crate::protocol::{MAX_MISSION_BYTES, Name};
use crate::report::live::{Board, Sources, Wish};
use crate::runtime::{Brick, Job, Source, StopBy, StopFlags};
use crate::threads::lock;

/// What a new mission is called among the templates.
const TEMPLATE: &str = "template";

/// The folder of missions.
#[derive(Debug)]
pub(super) struct Missions {
    folder: PathBuf,
}

impl Missions {
    pub(super) fn below(folder: &Path) -> Self {
        Self { folder: folder.to_owned() }
    }

    fn file(&self, name: &Name) -> PathBuf {
        self.folder.join("missions").join(format!("{}.toml", name.as_str()))
    }

    fn kept(&self, name: &Name) -> PathBuf {
        self.folder.join("kept").join(name.as_str())
    }

    /// The names of the files, and those of the templates.
    pub(super) fn list(&self) -> Value {
        let templates = shipped::MISSIONS.iter().map(|mission| mission.name);
        let templates: Vec<&str> = std::iter::once(TEMPLATE).chain(templates).collect();
        json!({ "missions": stems(&self.folder.join("missions")), "templates": templates })
    }

    /// A file's text.
    pub(super) fn read(&self, name: &str) -> Result<String, String> {
        text_of(&self.file(&named(name)?))
    }

    /// A template's text, for a mission that is called otherwise.
    pub(super) fn template(name: &str, called: &str) -> Result<String, String> {
        let text = match name {
            TEMPLATE => Some(shipped::TEMPLATE),
            name => shipped::find(name).map(|mission| mission.text),
        };
        text.map(|text| shipped::called(text, called))
            .ok_or_else(|| "there is no such template".to_owned())
    }

    /// The stamps under which a mission was kept, the newest first.
    pub(super) fn versions(&self, name: &str) -> Result<Value, String> {
        let mut stamps = stems(&self.kept(&named(name)?));
        stamps.reverse();
        Ok(json!(stamps))
    }

    /// The text of one of them.
    pub(super) fn version(&self, name: &str, stamp: &str) -> Result<String, String> {
        // A stamp is a file's name, and nothing that leads elsewhere.
        let stamp = named(stamp)?;
        text_of(&self.kept(&named(name)?).join(format!("{}.toml", stamp.as_str())))
    }

    /// Writes a mission's file, and keeps what was written, and what another editor had changed.
    /// True where the file was changed elsewhere since the page had its text, `known`.
    pub(super) fn save(&self, name: &str, text: &str, known: &str) -> Result<bool, String> {
        let name = named(name)?;
        if text.len() > MAX_MISSION_BYTES {
            return Err(format!("a mission has at most {MAX_MISSION_BYTES} bytes"));
        }
        let file = self.file(&name);
        let mut is_changed = false;
        // What cannot be read cannot be kept, and is not written over.
        if let Some(before) = file.exists().then(|| text_of(&file)).transpose()? {
            if before == text {
                return Ok(false);
            }
            is_changed = before != known;
            let newest = stems(&self.kept(&name)).pop();
            let newest = newest.map(|stamp| self.version(name.as_str(), &stamp)).transpose()?;
            if newest.as_ref() != Some(&before) {
                self.keep(&name, "", &before)?;
            }
        }
        self.keep(&name, "", text)?;
        self.write(&file, text)?;
        Ok(is_changed)
    }

    /// Keeps what is started on a brick.
    pub(super) fn keep_started(&self, name: &str, brick: &str, text: &str) -> Result<(), String> {
        self.keep(&named(name)?, &format!("-{}", Name::nearest(brick).as_str()), text)
    }

    fn keep(&self, name: &Name, behind: &str, text: &str) -> Result<(), String> {
        let newest = stems(&self.kept(name)).pop();
        let newest = newest.and_then(|stem| stem.split('-').next()?.parse::<i64>().ok());
        // Later than all that is kept: two may be kept in one millisecond.
        let stamp = (wall_ns() / MILLISECOND_NS).max(newest.map_or(0, |newest| newest + 1));
        self.write(&self.kept(name).join(format!("{stamp}{behind}.toml")), text)
    }

    fn write(&self, file: &Path, text: &str) -> Result<(), String> {
        let folder = file.parent().unwrap_or(&self.folder);
        std::fs::create_dir_all(folder)
            .map_err(|error| format!("cannot make {}: {error}", folder.display()))?;
        save::write(file, text.as_bytes(), Readers::AsUsual).map_err(|error| with_causes(&error))
    }

    /// A mission with the sub-machines that it uses, which lie beside it.
    pub(super) fn source(&self, name: &str, text: &str) -> Source {
        let source = Source { name: format!("{name}.toml"), text: text.to_owned() };
        source.with_submachines(Some(&self.folder.join("missions")))
    }

    /// What `check` says of a text, for a robot that has every device: what a brick's own robot
    /// lacks, the brick says when it is started.
    pub(super) fn check(&self, name: &str, text: &str) -> Value {
        let (findings, mission) = match self.source(name, text).mission(&Capabilities::all()) {
            Ok((mission, warnings)) => (warnings, Some(mission)),
            Err(findings) => (findings, None),
        };
        json!({
            "findings": findings.iter().collect::<Vec<_>>(),
            "good": mission.is_some(),
            "name": mission.as_ref().map(|mission| mission.name()),
            "limit_s": mission.as_ref().map(|mission| mission.time_limit_s()),
        })
    }
}

fn named(name: &str) -> Result<Name, String> {
    Name::new(name).map_err(|error| error.to_string())
}

fn text_of(file: &Path) -> Result<String, String> {
    let read = read_own(file, "").map_err(|failure| failure.message)?;
    Ok(read.text)
}

/// The names of a folder's TOML files without their ending, in order.
fn stems(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let stems = names.filter_map(|name| Some(name.strip_suffix(".toml")?.to_owned()));
    let mut stems: Vec<String> = stems.filter(|stem| Name::new(stem).is_ok()).collect();
    stems.sort();
    stems
}

/// The one simulated run of the page.
#[derive(Debug, Default)]
pub(super) struct Trial {
    pub(super) board: Board,
    flags: StopFlags,
    /// Held while a run is in progress.
    running: Mutex<()>,
    again: Mutex<Option<Trying>>,
}

/// What is tried, and where.
#[derive(Debug, Clone)]
pub(super) struct Trying {
    pub(super) mission: Source,
    /// A built-in world's name, or a file's.
    pub(super) world: String,
    /// The recording.
    pub(super) file: PathBuf,
}

impl Trial {
    pub(super) fn new() -> Self {
        let trial = Self::default();
        trial.board.grants(&[Wish::Stop, Wish::Again]);
        trial
    }

    /// Ends the run that is in progress, if one is.
    pub(super) fn stop(&self) {
        self.flags.raise(StopBy::Page);
    }

    /// What was tried last.
    pub(super) fn last(&self) -> Option<Trying> {
        lock(&self.again).clone()
    }

    /// Drives it until it ends, or the next one comes; why it does not is on the board.
    pub(super) fn play(&self, trying: &Trying) {
        *lock(&self.again) = Some(trying.clone());
        self.stop();
        let _running = lock(&self.running);
        self.flags.page.store(false, Ordering::Relaxed);
        if let Err(failure) = self.drive(trying) {
            self.board.refuse(&failure.to_text());
        }
    }

    fn drive(&self, trying: &Trying) -> Result<(), Failure> {
        let Trying { mission: source, world, file } = trying;
        // A name is that of a built-in world, as for `run --sim`.
        let (world_source, start) = load_world(Path::new(world))?;
        let robot = load_robot(None)?;
        let (mission, _) = load_mission(source, &robot.config.capabilities())?;
        // It is a trial: only the newest recording is kept.
        if_there(std::fs::remove_file(file)).map_err(|error| {
            Failure::refused(format!("cannot replace {}: {error}", file.display()))
        })?;
        let brick = Brick::Simulated { world: world_source, seed: 1, realtime: false };
        let job = Job {
            start,
            stamps_ns: wall_ns(),
            ..Job::new(source.clone(), robot.source, brick, file.clone())
        };
        let sources = Sources {
            title: format!("{} in {world}", mission.name()),
            recording: Some(file.clone()),
            ..Sources::default()
        };
        watched(&job, &mission, sources, &self.board, &self.flags, &mut |_| ()).map(|_| ())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_edit_is_kept_and_a_name_leads_nowhere_else() {
        let folder = tempfile::tempdir().unwrap();
        let missions = Missions::below(folder.path());
        for bad in ["../x", "", "a/b", ".hidden", "a\nb"] {
            assert!(missions.save(bad, "name = 1", "").is_err(), "{bad:?}");
            assert!(missions.version("mine", bad).is_err(), "{bad:?}");
        }
        assert_eq!(missions.list()["missions"], json!([]));
        for (text, known) in [("one", ""), ("two", "one"), ("two", "one")] {
            assert!(!missions.save("mine", text, known).unwrap(), "{text}");
        }
        missions.keep_started("mine", "ev3-blue", "two").unwrap();
        assert_eq!(missions.read("mine").unwrap(), "two");
        let stamps = missions.versions("mine").unwrap();
        let stamps: Vec<&str> =
            stamps.as_array().unwrap().iter().map(|stamp| stamp.as_str().unwrap()).collect();
        assert_eq!(stamps.len(), 3, "what is the same is kept once: {stamps:?}");
        assert!(stamps[0].ends_with("-ev3-blue"), "{stamps:?}");
        assert_eq!(missions.version("mine", stamps[2]).unwrap(), "one");

        let file = folder.path().join("missions/mine.toml");
        std::fs::write(&file, "by an editor").unwrap();
        assert!(missions.save("mine", "three", "two").unwrap(), "it says that there was another");
        let kept = folder.path().join("kept/mine");
        let texts = stems(&kept).into_iter().map(|stamp| missions.version("mine", &stamp).unwrap());
        let texts: Vec<String> = texts.collect();
        assert_eq!(texts, ["one", "two", "two", "by an editor", "three"]);
        std::fs::write(&file, b"\xff").unwrap();
        assert!(missions.save("mine", "four", "three").is_err());
        assert_eq!(std::fs::read(&file).unwrap(), b"\xff", "what cannot be kept stays");
    }

    #[test]
    fn a_text_is_checked_as_the_command_checks_it() {
        let missions = Missions::below(Path::new("/nowhere"));
        let checked = missions.check("mine", &Missions::template("map", "mine").unwrap());
        assert_eq!((&checked["good"], &checked["name"]), (&json!(true), &json!("mine")));
        let checked = missions.check("mine", "name = \"x\"\nrate = 3\n");
        assert_eq!(checked["good"], json!(false));
        let finding = &checked["findings"][0];
        assert_eq!(
            (&finding["line"], &finding["severity"]),
            (&json!(1), &json!("error")),
            "{checked}"
        );
    }
}
