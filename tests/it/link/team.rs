//! Teams: several real services with simulated bricks, and `onbrick team` as a person calls it.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;

use nix::sys::signal::Signal;
use onbrick::link::keys::Authorised;
use onbrick::link::{KeyPair, KnownBrick, KnownBricks};
use onbrick::mapping::stats::quantile;
use onbrick::recording::Run;
use onbrick::sim::World;
use serde_json::Value;

use super::bench::{Service, onbrick, text, until};
use super::commands::SHORT;
use crate::recording::decoder::python;
use crate::support::brick::shipped_brick;
use crate::support::exported::exported_grid;
use crate::support::real_time::{Pace, beside_others, in_real_time};

mod figures;

/// A PC and the bricks that it knows, each with its pose in `team.toml`.
pub(super) struct Bricks {
    pc: tempfile::TempDir,
    bricks: Vec<Service>,
}

impl Bricks {
    /// Bricks in a world, each introduced to the PC.
    pub(super) fn in_world(world: &str, names: &[&str]) -> Self {
        let mut team = Self { pc: tempfile::tempdir().unwrap(), bricks: Vec::new() };
        for name in names {
            team.add(name, &["--sim", world]);
        }
        team
    }

    /// The same, for a scenario in real time.
    pub(super) fn watched(world: &str, names: &[&str], pace: &Pace) -> Self {
        let team = Self::in_world(world, names);
        team.bricks.iter().for_each(|brick| pace.watch(brick.process()));
        team
    }

    fn add(&mut self, name: &str, place: &[&str]) -> &Service {
        let service = Service::of(name, place);
        service.introduce_to(&self.keys());
        self.bricks.push(service);
        self.bricks.last().unwrap()
    }

    fn keys(&self) -> PathBuf {
        self.pc.path().join("keys")
    }

    fn path(&self, name: &str) -> PathBuf {
        self.pc.path().join(name)
    }

    pub(super) fn brick(&self, name: &str) -> &Service {
        self.bricks.iter().find(|brick| brick.name == name).unwrap()
    }

    /// Writes `team.toml`: the mission, and each brick's x, y and heading.
    pub(super) fn write(&self, mission: &str, poses: &[(&str, f64, f64, f64)]) {
        let mut toml = format!("name = \"two\"\nmission = \"{mission}\"\n");
        for (name, x_m, y_m, heading_deg) in poses {
            writeln!(toml, "[brick.{name}]\nx_m = {x_m}\ny_m = {y_m}\nheading_deg = {heading_deg}")
                .unwrap();
        }
        std::fs::write(self.path("team.toml"), toml).unwrap();
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = onbrick();
        command.env("ONBRICK_KEYS", self.keys()).current_dir(self.pc.path()).args(arguments);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    fn pc(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }

    pub(super) fn start(&self, arguments: &[&str]) -> Child {
        self.command(arguments).spawn().unwrap()
    }

    /// What a command says, which must end with this exit code, or by a signal; both streams.
    #[track_caller]
    fn said(&self, output: &Output, code: impl Into<Option<i32>>) -> String {
        let said = format!("{}{}", text(&output.stdout), text(&output.stderr));
        let logs: Vec<String> =
            self.bricks.iter().map(|brick| format!("\n{}: {}", brick.name, brick.log())).collect();
        assert_eq!(output.status.code(), code.into(), "{said}{}", logs.concat());
        said
    }

    /// The same as the lines of its JSON.
    #[track_caller]
    pub(super) fn lines(&self, output: &Output, code: impl Into<Option<i32>>) -> Vec<Value> {
        self.said(output, code);
        text(&output.stdout).lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }

    /// How much of a brick's recording has come, bytes.
    fn part_of(&self, name: &str) -> u64 {
        let entries = std::fs::read_dir(self.path("onbrick-team"));
        let files = entries.into_iter().flatten().map(|entry| entry.unwrap());
        let is_its = |file: &str| file.contains(&format!("-{name}-")) && file.contains(".mcap");
        let found = files.filter(|file| is_its(file.file_name().to_str().unwrap()));
        found.filter_map(|file| Some(file.metadata().ok()?.len())).max().unwrap_or(0)
    }

    /// How a brick's last run ended.
    fn last(&self, name: &str) -> String {
        text(&self.pc(&["status", name]).stdout)
    }

    fn read(&self, file: &str) -> Vec<u8> {
        let path = self.path("onbrick-team").join(file);
        std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    }

    /// What came of a brick: the line with its end and its file.
    #[track_caller]
    pub(super) fn came<'l>(&self, lines: &'l [Value], name: &str) -> &'l Value {
        let found = lines.iter().find(|line| line["brick"] == name && line["good"].is_boolean());
        found.unwrap_or_else(|| panic!("{name}: {lines:?}"))
    }
}

/// Whether all got as far as driving; a machine that starves them may keep them from it.
pub(super) fn all_drove(team: &Bricks, lines: &[Value], names: &[&str], pace: &Pace) -> bool {
    let still = names.iter().find(|name| !team.came(lines, name)["file"].is_string());
    pace.ensure(still.is_none(), || format!("{still:?} did not drive: {lines:?}"));
    still.is_none()
}

/// Sends a process Ctrl-C.
fn interrupt(child: &Child) {
    send(child, Signal::SIGINT);
}

fn send(child: &Child, signal: Signal) {
    let pid = nix::unistd::Pid::from_raw(i32::try_from(child.id()).unwrap());
    // One that is over already hears nothing.
    let _ = nix::sys::signal::kill(pid, signal);
}

const APART: [(&str, f64, f64, f64); 2] = [("blue", 0.0, 0.0, 0.0), ("red", 3.0, 0.0, 90.0)];

#[test]
fn the_seeds_two_robots_map_two_arenas_in_one_picture() {
    // As long as in the seed: `ONBRICK_TEAM_S=120 cargo test --test it link::team::the_seeds --
    // --nocapture`.
    let seconds = figures::number("ONBRICK_TEAM_S").unwrap_or(10);
    let _machine = beside_others();
    in_real_time("the seed's two robots", |pace| {
        let team = Bricks::watched("two-arenas", &["blue", "red"], pace);
        team.write("map", &APART);
        let limit = format!("time_limit_s={seconds}");
        let output = team.pc(&["--json", "team", "team.toml", "--set", &limit]);
        // A run whose loop stood still ended there, and then the team did not come to a good end.
        pace.same("exit code", &output.status.code(), &Some(0));
        let lines = team.lines(&output, output.status.code().unwrap());
        if !all_drove(&team, &lines, &["blue", "red"], pace) {
            return;
        }
        for name in ["blue", "red"] {
            let came = team.came(&lines, name);
            pace.same(name, &came["end"]["word"].as_str(), &Some("finished"));
            let (file, run) = (came["file"].as_str().unwrap(), came["run"].as_str().unwrap());
            let brought = std::fs::read(team.path(file)).unwrap();
            let brick = team.brick(name).path("runs").join(run).join("run.mcap");
            assert!(brought == std::fs::read(brick).unwrap(), "{file} is not the brick's");
        }
        is_one_map(&team, pace);
        is_on_one_clock(&team, &lines, pace);
    });
}

/// Both arenas are in the picture's data, each by its own robot, and the points lie on the walls
/// that are truly there.
fn is_one_map(team: &Bricks, pace: &Pace) {
    let world = World::named("two-arenas").unwrap();
    let csv = text(&team.read("points.csv"));
    // Where one arena ends and the other begins.
    const BETWEEN_M: f64 = 1.83;
    let (mut errors_m, mut counts, mut strayed) = (Vec::new(), [0_usize; 2], 0_usize);
    for line in csv.lines().skip(1) {
        let fields: Vec<&str> = line.split(',').collect();
        let [x_m, y_m] = [1, 2].map(|field: usize| fields[field].parse::<f64>().unwrap());
        errors_m.push(world.distance_to_nearest_surface(x_m, y_m));
        let is_red = fields[3] == "red";
        counts[usize::from(is_red)] += 1;
        strayed += usize::from(is_red != (x_m > BETWEEN_M));
    }
    pace.ensure(counts.iter().all(|count| *count >= 20), || format!("too few points: {counts:?}"));
    if errors_m.is_empty() {
        return;
    }
    let (median_m, p90_m) =
        (quantile(&mut errors_m, 0.5).unwrap(), quantile(&mut errors_m, 0.9).unwrap());
    println!(
        "{} points of blue and {} of red: to the nearest true wall {:.1} cm (median), {:.1} cm \
         (90th percentile)",
        counts[0],
        counts[1],
        median_m * 100.0,
        p90_m * 100.0
    );
    pace.ensure(strayed * 50 <= errors_m.len(), || {
        format!("{strayed} points are in the other's arena")
    });
    pace.ensure(median_m < 0.06 && p90_m < 0.25, || format!("{median_m} m, {p90_m} m"));
    let path = text(&team.read("path.csv"));
    assert!(path.contains(",blue\n") && path.contains(",red\n"), "{path}");
    let svg = text(&team.read("map.svg"));
    // Two colours, two names, and the walls of the one world that both were in.
    for part in ["two: map", ">\nblue\n<", ">\nred\n<", "walls", "#0072B2", "#E69F00"] {
        assert!(svg.contains(part), "no {part} in the picture");
    }
    let png = team.read("map.png");
    assert_eq!(&png[..8], b"\x89PNG\r\n\x1a\n");
    let cell = exported_grid(&team.path("onbrick-team"));
    for (name, x_m, y_m, _) in APART {
        assert_eq!(cell(x_m, y_m), Some(254), "{name} stood there, so it is free");
    }
    if let Some(keep) = std::env::var_os("ONBRICK_TEAM_OUT") {
        for file in ["map.pgm", "map.svg", "map.png", "points.csv", "path.csv", "team.mcap"] {
            std::fs::create_dir_all(&keep).unwrap();
            std::fs::write(Path::new(&keep).join(file), team.read(file)).unwrap();
        }
    }
}

/// Another reader finds a namespace a brick, all in one frame, and both beginning within seconds of
/// each other.
fn is_on_one_clock(team: &Bricks, lines: &[Value], pace: &Pace) {
    let merged = team.read("team.mcap");
    let Some(found) = python(&merged, "indexed") else { return };
    let (topics, metadata) = (&found["topics"], &found["metadata"]);
    let mut begun_ns = Vec::new();
    for (name, x_m) in [("blue", 0.0), ("red", 3.0)] {
        let file = team.path(team.came(lines, name)["file"].as_str().unwrap());
        let run = Run::open(&file).unwrap();
        assert_eq!(topics[format!("/{name}/senses")]["count"], run.senses.len(), "{name}");
        let odometry = &topics[format!("/{name}/odom")]["first"];
        assert_eq!(odometry["header"]["frame_id"], format!("{name}/odom"));
        assert_eq!(odometry["child_frame_id"], format!("{name}/base_link"));
        let x = odometry["pose"]["pose"]["position"]["x"].as_f64().unwrap();
        assert!((x - x_m).abs() < 0.05, "{name} begins at {x} m");
        assert_eq!(found["attachments"][format!("{name}/mission.toml")], run.mission_toml.unwrap());
        let offset_ns = metadata[format!("{name}/onbrick")]["wall_offset_ns"].as_str().unwrap();
        begun_ns.push(offset_ns.parse::<i64>().unwrap());
        let clock = lines
            .iter()
            .find(|line| line["brick"] == name && !line["clock_behind_s"].is_null())
            .unwrap();
        // Brick and PC are one machine here, with one calendar.
        let behind_s = clock["clock_behind_s"].as_f64().unwrap();
        println!(
            "{name}: its clock is {behind_s:.3} s behind the PC's, within {}",
            clock["within_s"]
        );
        pace.near(&format!("{name}'s clock, s"), behind_s, 0.0, 0.25);
    }
    let apart_s = onbrick::clock::seconds(begun_ns[0] - begun_ns[1]);
    pace.near("the one begins after the other, s", apart_s, 0.0, 5.0);
}

#[test]
fn a_team_of_which_one_is_not_ready_does_not_start_at_all_and_says_why() {
    let mut team = Bricks::in_world("arena", &["blue", "green"]);
    for name in ["blue", "green"] {
        team.brick(name).mission("short", SHORT);
    }
    let names = ["blue", "green", "other", "broken", "robot", "flat", "shut", "gone"];
    let poses: Vec<_> =
        (0..).zip(names).map(|(at, name)| (name, 3.0 * f64::from(at), 0.0, 0.0)).collect();
    team.add("other", &["--sim", "arena"])
        .mission("short", &SHORT.replace("time_s > 2", "time_s > 3"));
    team.add("broken", &["--sim", "arena"])
        .mission("short", &SHORT.replace("left_dps", "left_dpz"));
    let robot = team.add("robot", &["--sim", "arena"]);
    robot.mission("short", SHORT);
    std::fs::write(robot.path("robot.toml"), "name = 3\n").unwrap();
    let plain = tempfile::tempdir().unwrap();
    shipped_brick().write(plain.path());
    let battery = plain.path().join("sys/class/power_supply/lego-ev3-battery/voltage_now");
    std::fs::write(battery, "5100000\n").unwrap();
    team.add("flat", &["--brick", plain.path().to_str().unwrap()]).mission("short", SHORT);
    let shut = team.add("shut", &["--sim", "arena"]);
    Authorised::below(&shut.path("keys")).remove("anna").unwrap();
    let key = KeyPair::generate().unwrap().public();
    let gone = KnownBrick { name: "gone".to_owned(), address: "127.0.0.1:1".to_owned(), key };
    KnownBricks::load(&team.keys()).unwrap().put(&gone, None).unwrap();
    until("the robot is looked at", || team.last("robot").contains("fault").then_some(()));

    team.write("short", &poses);
    let output = team.pc(&["team", "team.toml"]);
    let said = team.said(&output, 3);
    let line = |name: &str| {
        said.lines().find(|line| line.starts_with(name)).unwrap_or_else(|| panic!("{name}: {said}"))
    };
    for (name, part) in [
        ("blue ", "short "),
        ("blue ", "  ready"),
        ("green ", "  ready"),
        ("other ", "another mission: "),
        ("broken ", "unknown key `left_dpz`"),
        ("robot ", "fault: "),
        ("flat ", "5.1 V"),
        ("flat ", "charge it"),
        ("shut ", "authorised"),
        ("gone ", "no answer from 127.0.0.1:1"),
        ("error: ", "6 of 8 bricks are not ready"),
    ] {
        assert!(line(name).contains(part), "{part} is not in: {}", line(name));
    }
    assert!(!team.path("onbrick-team").exists(), "nothing was started");
    for name in ["blue", "green", "other", "broken", "flat"] {
        let runs = text(&team.pc(&["runs", name]).stdout);
        assert_eq!(runs, format!("{name}: no run is there yet\n"));
    }
    // The same table by itself, and those that are ready alone.
    team.write("short", &poses[..7]);
    let table = team.said(&team.pc(&["status", "--team", "team.toml"]), 3);
    assert!(table.contains("another mission"), "{table}");
    team.write("short", &poses[..2]);
    let lines = team.lines(&team.pc(&["status", "--team", "team.toml", "--json"]), 0);
    assert!(
        lines.iter().all(|line| line["ready"] == true && line["sha256"].is_string()),
        "{lines:?}"
    );
    team.write("short", &poses[7..]);
    team.said(&team.pc(&["team", "team.toml", "--timeout", "1"]), 4);
}

#[test]
fn a_brick_that_does_not_take_the_start_stops_the_others() {
    let team = Bricks::in_world("two-arenas", &["blue", "red"]);
    // A mission that comes from the PC is checked by each brick for its own robot, and red's has no
    // range sensor.
    let robot = "name = \"r\"\n[drive]\nmax_dps = 360\nleft = { port = \"outB\" }\n\
                 right = { port = \"outD\" }\nwheel_circumference_m = 0.19\ntrack_width_m = 0.11\n";
    std::fs::write(team.brick("red").path("robot.toml"), robot).unwrap();
    let mission = SHORT.replace("time_s > 2", "range_m < 0.01");
    std::fs::write(team.path("near.toml"), mission).unwrap();
    team.write("./near.toml", &APART);
    let output = team.pc(&["team", "team.toml"]);
    let code = output.status.code().unwrap();
    // Blue may have begun to drive meanwhile, and then its recording is here.
    assert!(code == 3 || code == 5, "{code}");
    let said = team.said(&output, code);
    assert!(said.contains("red: ") && said.contains("range_m"), "{said}");
    let blue = team.last("blue");
    assert!(blue.starts_with("blue  ") && !blue.contains("started by"), "it continues: {blue}");
}

#[test]
fn a_brick_that_is_lost_in_the_middle_leaves_what_has_come_and_the_others_go_on() {
    let _machine = beside_others();
    in_real_time("a brick that is lost in the middle", |pace| {
        let mut team = Bricks::watched("two-arenas", &["blue", "red"], pace);
        for brick in &team.bricks {
            brick.mission("short", &SHORT.replace("time_s > 2", "time_s > 8"));
        }
        team.write("short", &APART);
        let mut child =
            team.start(&["--json", "team", "team.toml", "--lost", "4", "--timeout", "2"]);
        until("something of red's has come, or all is over", || {
            (team.part_of("red") > 100_000 || child.try_wait().unwrap().is_some()).then_some(())
        });
        let red = team.bricks.iter_mut().find(|brick| brick.name == "red").unwrap();
        red.kill();
        let output = child.wait_with_output().unwrap();
        pace.same("exit code", &output.status.code(), &Some(5));
        let lines = team.lines(&output, output.status.code().unwrap());
        if !all_drove(&team, &lines, &["blue", "red"], pace) {
            return;
        }
        let (blue, red) = (team.came(&lines, "blue"), team.came(&lines, "red"));
        assert_eq!(blue["whole"], true, "{blue}");
        pace.same("blue", &blue["end"]["word"].as_str(), &Some("finished"));
        if red["whole"] == true {
            return pace.ensure(false, || format!("red was over before it was lost: {red}"));
        }
        assert!(red["error"].as_str().unwrap().contains("no answer"), "{red}");
        let (file, run) = (red["file"].as_str().unwrap(), red["run"].as_str().unwrap());
        let part = Run::open(&team.path(file)).unwrap();
        println!("of red {} ticks have come", part.senses.len());
        assert!(file.ends_with(".part") && part.senses.len() >= 50, "{} ticks", part.senses.len());
        // Its part is in picture and recording.
        assert!(text(&team.read("path.csv")).contains(",red\n"));
        let merged = team.read("team.mcap");
        if let Some(found) = python(&merged, "indexed") {
            assert_eq!(found["topics"]["/red/senses"]["count"], part.senses.len());
        }
        // And when it is there again, the rest comes.
        let red = team.bricks.iter_mut().find(|brick| brick.name == "red").unwrap();
        red.start();
        let fetch = ["fetch", "red", "--run", run, "-o", "onbrick-team"];
        team.said(&team.pc(&fetch), 0);
        let whole = team.path("onbrick-team").join(format!("{run}.mcap"));
        let ticks = Run::open(&whole).unwrap().senses.len();
        assert!(ticks >= part.senses.len() && !team.path(file).exists(), "{ticks} ticks");
    });
}

#[test]
fn ctrl_c_stops_every_brick_and_brings_home_what_they_have() {
    let _machine = beside_others();
    in_real_time("Ctrl-C", |pace| {
        let team = Bricks::watched("two-arenas", &["blue", "red"], pace);
        team.write("map", &APART);
        let mut child = team.start(&["--json", "team", "team.toml"]);
        until("something has come of both, or all is over", || {
            let both = ["blue", "red"].iter().all(|name| team.part_of(name) > 10_000);
            (both || child.try_wait().unwrap().is_some()).then_some(())
        });
        interrupt(&child);
        let output = child.wait_with_output().unwrap();
        // A shell hears of Ctrl-C.
        pace.same("exit code", &output.status.code(), &None);
        let lines = team.lines(&output, output.status.code());
        if !all_drove(&team, &lines, &["blue", "red"], pace) {
            return;
        }
        for name in ["blue", "red"] {
            let came = team.came(&lines, name);
            assert_eq!(came["whole"], true, "{came}");
            pace.same(name, &came["end"]["word"].as_str(), &Some("remote"));
            let recorded = Run::open(&team.path(came["file"].as_str().unwrap())).unwrap();
            assert!(recorded.ending.is_some(), "{came}");
            assert!(!team.last(name).contains("started by"), "it continues: {}", team.last(name));
        }
        assert!(team.path("onbrick-team/map.png").exists());
    });
}

#[test]
fn a_brick_that_ctrl_c_does_not_reach_is_said_to_be_driving_with_the_way_out() {
    let _machine = beside_others();
    in_real_time("Ctrl-C without one of the bricks", |pace| {
        let mut team = Bricks::watched("two-arenas", &["blue", "red"], pace);
        team.write("map", &APART);
        let mut child = team.start(&["team", "team.toml", "--timeout", "1"]);
        until("something of red's has come, or all is over", || {
            (team.part_of("red") > 10_000 || child.try_wait().unwrap().is_some()).then_some(())
        });
        team.bricks.iter_mut().find(|brick| brick.name == "red").unwrap().kill();
        interrupt(&child);
        let output = child.wait_with_output().unwrap();
        // A shell hears of Ctrl-C.
        pace.same("exit code", &output.status.code(), &None);
        let said = team.said(&output, output.status.code());
        let red = said.lines().find(|line| line.starts_with("red: ")).unwrap();
        let is_said = red.contains("it was not stopped, and may still be driving");
        pace.ensure(is_said, || said.clone());
        let way_out = "try: press Enter or Back on the brick, or run `onbrick halt` there";
        pace.ensure(said.contains(way_out) && said.contains("onbrick fetch red"), || said.clone());
    });
}

#[test]
fn a_brick_that_was_given_up_and_is_in_reach_again_is_stopped_with_the_others() {
    let _machine = beside_others();
    in_real_time("Ctrl-C after one of the bricks was given up", |pace| {
        let team = Bricks::watched("two-arenas", &["blue", "red"], pace);
        team.write("map", &APART);
        let team_command = ["--json", "team", "team.toml", "--lost", "2", "--timeout", "1"];
        let mut child = team.start(&team_command);
        until("something of red's has come, or all is over", || {
            (team.part_of("red") > 10_000 || child.try_wait().unwrap().is_some()).then_some(())
        });
        // The service alone is away, as a network would be: the robot drives on.
        send(team.brick("red").process(), Signal::SIGSTOP);
        std::thread::sleep(Duration::from_secs(6));
        send(team.brick("red").process(), Signal::SIGCONT);
        std::thread::sleep(Duration::from_secs(1));
        let before = team.last("red");
        pace.ensure(before.contains("started by"), || format!("it drives on: {before}"));
        interrupt(&child);
        let output = child.wait_with_output().unwrap();
        pace.same("exit code", &output.status.code(), &None);
        let lines = team.lines(&output, output.status.code());
        if !all_drove(&team, &lines, &["blue", "red"], pace) {
            return;
        }
        let red = team.came(&lines, "red");
        let error = red["error"].as_str().unwrap_or_default();
        pace.ensure(error.contains("no answer"), || format!("it was not given up: {red}"));
        let after = team.last("red");
        assert!(!error.contains("not stopped") && !after.contains("started by"), "{red}: {after}");
    });
}

#[test]
fn a_teams_file_with_mistakes_is_refused_with_their_places_and_its_bricks_are_meant_by_it() {
    let team = Bricks::in_world("arena", &["blue"]);
    team.write("map", &[("blue", 0.0, 0.0, 0.0), ("bleu", 1.0, 0.0, 0.0)]);
    let said = team.said(&team.pc(&["team", "team.toml"]), 3);
    assert!(said.contains("team.toml:7:8") && said.contains("did you mean `blue`?"), "{said}");
    assert!(!said.contains("onbrick new team"), "the file is in order: {said}");
    team.write("map", &[("blue", 0.0, 0.0, 0.0)]);
    assert!(
        team.said(&team.pc(&["stop", "--team", "team.toml"]), 0)
            .contains("blue: nothing was running")
    );
    team.said(&team.pc(&["stop", "blue", "--team", "team.toml"]), 2);
    // A number that a file's mission does not have is refused before a brick is asked.
    std::fs::write(team.path("short.toml"), SHORT).unwrap();
    let foreign = ["team", "team.toml", "./short.toml", "--set", "foo=1"];
    let said = team.said(&team.pc(&foreign), 2);
    assert!(said.contains("no number `foo`") && !said.contains("ready"), "{said}");
    // The map of an earlier run stays.
    std::fs::create_dir(team.path("monday")).unwrap();
    std::fs::write(team.path("monday/team.mcap"), "earlier").unwrap();
    let said = team.said(&team.pc(&["team", "team.toml", "--out", "monday"]), 3);
    assert!(said.contains("monday/team.mcap is there already"), "{said}");
    assert!(said.contains("another folder for --out"), "{said}");
    let runs = text(&team.pc(&["runs", "blue"]).stdout);
    assert_eq!(runs, "blue: no run is there yet\n", "nothing was started");
    let file =
        text(&std::fs::read(team.path("team.toml")).unwrap()).replace("mission = \"map\"\n", "");
    std::fs::write(team.path("team.toml"), file).unwrap();
    assert!(team.said(&team.pc(&["team", "team.toml"]), 2).contains("which mission?"));
    let template = text(&team.pc(&["new", "team"]).stdout);
    assert!(template.contains("[brick.ev3-blue]"), "{template}");
}
