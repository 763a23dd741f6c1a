//! The chapter on the link of `src/USING.md`, from one machine to another: two network namespaces
//! with a cable that is pulled out while the robot drives.

use std::io::{BufRead as _, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use onbrick::recording::Run;
use serde_json::Value;

use super::bench::{text, until};
use crate::support::network::{BRICK, Network};
use crate::support::real_time::{beside_others, patiently};
use crate::support::tested_program;

/// A brick, or several, on a machine, and a person at a PC on another.
pub struct Apart {
    pub network: Network,
    pub folder: tempfile::TempDir,
    /// Each brick's name and address.
    bricks: &'static [(&'static str, &'static str)],
    world: &'static str,
    services: Vec<Child>,
}

impl Apart {
    /// Serves a simulated brick, called `blue`; `None` where there are no network namespaces.
    pub fn new() -> Option<Self> {
        Self::of(&[("blue", BRICK)], "arena")
    }

    /// The same for several bricks in a world.
    fn of(bricks: &'static [(&'static str, &'static str)], world: &'static str) -> Option<Self> {
        let network = Network::new()?;
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(folder.path().join("pc")).unwrap();
        for (name, address) in bricks {
            if *address != BRICK {
                network.add_address(address);
            }
            std::fs::create_dir_all(folder.path().join(name)).unwrap();
            let config = format!("name = \"{name}\"\n[link]\naddress = \"{address}\"\n");
            std::fs::write(folder.path().join(name).join("onbrick.toml"), config).unwrap();
        }
        let mut apart = Self { network, folder, bricks, world, services: Vec::new() };
        apart.serve();
        Some(apart)
    }

    /// Starts the services and waits until they listen.
    pub fn serve(&mut self) {
        for (name, _) in self.bricks {
            let log =
                std::fs::File::create(self.folder.path().join(format!("{name}.log"))).unwrap();
            let mut service = self.network.brick(tested_program());
            service
                .args(["-v", "serve", "--sim", self.world, "--config"])
                .arg(self.folder.path().join(name));
            service.stdin(Stdio::null()).stdout(Stdio::null()).stderr(log);
            self.services.push(service.spawn().unwrap());
        }
        let listening = || self.log().matches("the link listens").count() == self.bricks.len();
        until("the link listens", || listening().then_some(()));
    }

    /// Ends them.
    pub fn stop(&mut self) {
        for mut service in self.services.drain(..) {
            let _ = (service.kill(), service.wait());
        }
    }

    pub fn log(&self) -> String {
        let log = |name| std::fs::read_to_string(self.folder.path().join(format!("{name}.log")));
        self.bricks.iter().map(|(name, _)| log(name).unwrap_or_default()).collect()
    }

    /// A command at the PC.
    pub fn pc(&self, line: &str) -> Command {
        let mut command = self.network.pc(tested_program());
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

    /// Two people, one at each brick and one at the PC, who compare the code and find it the same.
    pub fn pair(&self) {
        let yes = self.folder.path().join("yes");
        std::fs::write(&yes, "yes\n").unwrap();
        for (name, address) in self.bricks {
            let mut there = self.network.brick(tested_program());
            there
                .args(["pair", "--config"])
                .arg(self.folder.path().join(name))
                .arg("--answers")
                .arg(&yes);
            let mut there = there.stdout(Stdio::null()).spawn().unwrap();
            let said = self.done(&format!(
                "pair {address} --name anna --answers {} --timeout 60",
                yes.display()
            ));
            assert!(said.starts_with(&format!("{name} is known from now on")), "{said}");
            assert!(there.wait().unwrap().success());
        }
    }

    /// The file on the brick of the only run of the first brick.
    pub fn recording(&self) -> PathBuf {
        let (name, _) = self.bricks[0];
        let files = self.recordings(name);
        let [file] = files.as_slice() else { panic!("{name}: {files:?}") };
        file.clone()
    }

    /// True once the first brick records a run.
    pub fn drives(&self) -> bool {
        !self.recordings(self.bricks[0].0).is_empty()
    }

    /// The files of a brick's runs.
    fn recordings(&self, name: &str) -> Vec<PathBuf> {
        let runs =
            std::fs::read_dir(self.folder.path().join(name).join("runs")).into_iter().flatten();
        let files = runs.map(|entry| entry.unwrap().path().join("run.mcap"));
        files.filter(|file| file.exists()).collect()
    }
}

impl Drop for Apart {
    fn drop(&mut self) {
        self.stop();
    }
}

#[test]
fn the_readmes_chapter_works_from_one_machine_to_another_with_the_cable_pulled_out_meanwhile() {
    let _machine = beside_others();
    patiently("the chapter on the link", the_readmes_chapter);
}

fn the_readmes_chapter() {
    let Some(apart) = Apart::new() else { return };
    apart.pair();
    assert!(apart.done("bricks").contains(BRICK));
    assert!(apart.done("missions blue").contains("blue  map  120 s"));
    assert!(apart.done("start map blue").starts_with("blue: started map-"));
    let mut follow = apart
        .pc("--json fetch blue --follow --timeout 120")
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(follow.stdout.take().unwrap()).lines();
    let mut next = || serde_json::from_str::<Value>(&lines.next().unwrap().unwrap()).unwrap();
    assert!(next()["page"].is_string());
    until("it is seen to drive", || {
        next()["how"].as_str().filter(|how| how.contains("running")).map(drop)
    });

    apart.network.pull();
    let recording = apart.recording();
    let length = || std::fs::metadata(&recording).unwrap().len();
    let before = length();
    let silent = apart.pc("status blue --timeout 1").output().unwrap();
    assert_eq!(silent.status.code(), Some(4), "{}", text(&silent.stderr));
    until("it records on by itself", || (length() > before + 50_000).then_some(()));
    apart.network.plug();

    // No client started it again: it has been driving all the while.
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
    let run = Run::read(&ours).unwrap();
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

const TEAM: &str = "\
mission = \"map\"
[brick.blue]
x_m = 0.0
y_m = 0.0
[brick.red]
x_m = 3.0
y_m = 0.0
heading_deg = 90
";

#[test]
fn the_readmes_chapter_on_teams_works_with_the_cable_pulled_out_meanwhile() {
    let _machine = beside_others();
    patiently("the chapter on teams", the_readmes_chapter_on_teams);
}

fn the_readmes_chapter_on_teams() {
    let Some(apart) = Apart::of(&[("blue", BRICK), ("red", "10.77.0.3")], "two-arenas") else {
        return;
    };
    apart.pair();
    let pc = apart.folder.path().join("pc");
    std::fs::write(pc.join("team.toml"), TEAM).unwrap();
    assert_eq!(apart.done("status --team team.toml").matches("  ready").count(), 2);
    let team = "--json team team.toml --set time_limit_s=15 --lost 120 --timeout 60";
    let team = apart.pc(team).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let lengths = || {
        ["blue", "red"].map(|name| match apart.recordings(name).as_slice() {
            [file] => std::fs::metadata(file).map_or(0, |file| file.len()),
            _ => 0,
        })
    };
    let grown = |what: &str, from: [u64; 2]| {
        until(what, || {
            lengths().iter().zip(from).all(|(now, then)| *now > then + 30_000).then_some(())
        });
    };
    grown("both drive", [0; 2]);
    apart.network.pull();
    grown("both record on by themselves", lengths());
    apart.network.plug();

    let output = team.wait_with_output().unwrap();
    let (said, error) = (text(&output.stdout), text(&output.stderr));
    assert!(output.status.success(), "{said}{error}\nthe services: {}", apart.log());
    let lines: Vec<Value> = said.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    for name in ["blue", "red"] {
        let came = lines.iter().find(|line| line["brick"] == name && line["good"] == true);
        let came = came.unwrap_or_else(|| panic!("{name}: {said}"));
        let ours = std::fs::read(pc.join(came["file"].as_str().unwrap())).unwrap();
        let [theirs] = apart.recordings(name).try_into().unwrap();
        assert!(
            ours == std::fs::read(theirs).unwrap(),
            "{name}: {} bytes are not the brick's",
            ours.len()
        );
        let run = Run::read(&ours).unwrap();
        assert!(run.senses.is_sorted_by(|a, b| a.tick + 1 == b.tick), "{name}: a tick is missing");
    }
    let map = std::fs::read_to_string(pc.join("onbrick-team/map.svg")).unwrap();
    assert!(map.contains(">\nblue\n<") && map.contains(">\nred\n<"), "one picture of both");
    assert!(pc.join("onbrick-team/team.mcap").exists() && pc.join("onbrick-team/map.png").exists());
}
