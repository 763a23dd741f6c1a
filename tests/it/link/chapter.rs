//! The README's chapter on the link, from one machine to another: two network namespaces with a cable that is pulled out while the robot drives.

use std::io::{BufRead as _, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use onbrick::runtime::recording::Run;
use serde_json::Value;

use super::bench::{text, until};
use crate::support::network::{BRICK, Network};
use crate::support::real_time::{alone, patiently};

pub const PROGRAM: &str = env!("CARGO_BIN_EXE_onbrick");

/// A brick on its machine, and a person at a PC on another.
pub struct Apart {
    pub network: Network,
    pub folder: tempfile::TempDir,
    service: Option<Child>,
}

impl Apart {
    /// Serves a simulated brick, called `blue`; `None` where there are no network namespaces.
    pub fn new() -> Option<Self> {
        let network = Network::new()?;
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(folder.path().join("brick")).unwrap();
        std::fs::create_dir_all(folder.path().join("pc")).unwrap();
        std::fs::write(folder.path().join("brick/onbrick.toml"), "name = \"blue\"\n").unwrap();
        let mut apart = Self { network, folder, service: None };
        apart.serve();
        Some(apart)
    }

    /// Starts the service and waits until it listens.
    pub fn serve(&mut self) {
        let log = std::fs::File::create(self.folder.path().join("log")).unwrap();
        let mut service = self.network.brick(PROGRAM);
        service.args(["-v", "serve", "--sim", "arena", "--config"]).arg(self.folder.path().join("brick"));
        service.stdin(Stdio::null()).stdout(Stdio::null()).stderr(log);
        self.service = Some(service.spawn().unwrap());
        until("the link listens", || self.log().contains("the link listens").then_some(()));
    }

    /// Ends it.
    pub fn stop(&mut self) {
        if let Some(mut service) = self.service.take() {
            let _ = (service.kill(), service.wait());
        }
    }

    pub fn log(&self) -> String {
        std::fs::read_to_string(self.folder.path().join("log")).unwrap_or_default()
    }

    /// A command at the PC.
    pub fn pc(&self, line: &str) -> Command {
        let mut command = self.network.pc(PROGRAM);
        command
            .env("ONBRICK_KEYS", self.folder.path().join("keys"))
            .current_dir(self.folder.path().join("pc"));
        command.args(line.split(' '));
        command
    }

    /// The same, and it works out; what it said.
    #[track_caller]
    pub fn done(&self, line: &str) -> String {
        let output = self.pc(line).output().unwrap();
        let (said, error) = (text(&output.stdout), text(&output.stderr));
        assert!(output.status.success(), "{line}: {said}{error}\nthe service: {}", self.log());
        said
    }

    /// Two people, one at the brick and one at the PC, who compare the code and find it the same.
    pub fn pair(&self) {
        let yes = self.folder.path().join("yes");
        std::fs::write(&yes, "yes\n").unwrap();
        let mut there = self.network.brick(PROGRAM);
        there.args(["pair", "--config"]).arg(self.folder.path().join("brick")).arg("--answers").arg(&yes);
        let mut there = there.stdout(Stdio::null()).spawn().unwrap();
        let said = self.done(&format!("pair {BRICK} --name anna --answers {} --timeout 60", yes.display()));
        assert!(said.starts_with("blue is known from now on"), "{said}");
        assert!(there.wait().unwrap().success());
    }

    /// The file on the brick of the only run.
    pub fn recording(&self) -> PathBuf {
        let runs = std::fs::read_dir(self.folder.path().join("brick/runs")).unwrap();
        let files = runs.map(|entry| entry.unwrap().path().join("run.mcap")).filter(|file| file.exists());
        let files: Vec<PathBuf> = files.collect();
        let [file] = files.as_slice() else { panic!("{files:?}") };
        file.clone()
    }
}

impl Drop for Apart {
    fn drop(&mut self) {
        self.stop();
    }
}

#[test]
fn the_readmes_chapter_works_from_one_machine_to_another_with_the_cable_pulled_out_meanwhile() {
    let _alone = alone();
    patiently("the chapter on the link", the_readmes_chapter);
}

fn the_readmes_chapter() {
    let Some(apart) = Apart::new() else { return };
    apart.pair();
    assert!(apart.done("bricks").contains(BRICK));
    assert!(apart.done("missions blue").contains("blue  map  120 s"));
    assert!(apart.done("start map blue").starts_with("blue: started map-"));
    let mut follow =
        apart.pc("--json fetch blue --follow --timeout 120").stdout(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(follow.stdout.take().unwrap()).lines();
    let mut next = || serde_json::from_str::<Value>(&lines.next().unwrap().unwrap()).unwrap();
    assert!(next()["page"].is_string());
    until("it is seen to drive", || next()["how"].as_str().filter(|how| how.contains("running")).map(drop));

    apart.network.pull();
    let recording = apart.recording();
    let length = || std::fs::metadata(&recording).unwrap().len();
    let before = length();
    let silent = apart.pc("status blue --timeout 1").output().unwrap();
    assert_eq!(silent.status.code(), Some(4), "{}", text(&silent.stderr));
    until("it records on by itself", || (length() > before + 50_000).then_some(()));
    apart.network.plug();

    // Nobody started it again: it has been driving all the while.
    assert!(apart.done("status blue --timeout 60").contains("running"));
    assert!(apart.done("stop blue").contains("stopped map-"));
    let last = loop {
        let line = next();
        if line["file"].is_string() {
            break line;
        }
    };
    assert!(follow.wait().unwrap().success(), "{last}");
    let home = apart.folder.path().join("pc").join(last["file"].as_str().unwrap());
    let (ours, theirs) = (std::fs::read(&home).unwrap(), std::fs::read(&recording).unwrap());
    assert!(ours == theirs, "{} bytes came of {}", ours.len(), theirs.len());
    let run = Run::read_checked(&ours).unwrap();
    assert!(run.gaps.is_empty() && run.warnings.is_empty(), "{:?} {:?}", run.gaps, run.warnings);
    assert!(run.senses.is_sorted_by(|a, b| a.tick + 1 == b.tick), "a tick is missing");
    assert!(apart.done("runs blue").contains("fetched"));
    apart.done(&format!("plot {} -o map.svg", home.display()));
    let map = std::fs::read_to_string(apart.folder.path().join("pc/map.svg")).unwrap();
    assert!(map.starts_with("<svg") && map.len() > 2000, "{} bytes", map.len());
}

/// A start that lay in an outage drives nothing off afterwards.
#[test]
fn a_start_that_was_caught_by_an_outage_starts_nothing_when_the_cable_is_back() {
    let Some(apart) = Apart::new() else { return };
    apart.pair();
    apart.done("status blue");
    apart.network.pull();
    let silent = apart.pc("start map blue --timeout 2").output().unwrap();
    assert_eq!(silent.status.code(), Some(4), "{}", text(&silent.stderr));
    apart.network.plug();
    apart.done("status blue --timeout 60");
    std::thread::sleep(Duration::from_secs(1));
    let status = apart.done("status blue");
    assert!(status.contains("ready") && !status.contains("running"), "{status}");
}
