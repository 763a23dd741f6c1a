//! `demo`, and `run` on a simulated brick.

use std::io::{BufRead, BufReader};
use std::process::Stdio;

use onbrick::recording::Run;
use onbrick::runtime::StopReason;

use super::{keys, names, onbrick, run, text};

const FILES: [&str; 5] = ["map.png", "map.svg", "path.csv", "points.csv", "run.mcap"];

#[test]
fn the_readmes_figures_of_demo_come_out() {
    let folder = tempfile::tempdir().unwrap();
    let quality = |seconds: &[&str]| {
        let said = run(folder.path(), &[&["demo", "--json"], seconds].concat()).expect(0);
        said.json().pop().unwrap()
    };
    let (whole, short) = (quality(&[]), quality(&["--seconds", "300"]));
    let number = |name: &str| whole[name].as_f64().unwrap();
    let percent = |quality: &serde_json::Value, name: &str| {
        format!("{:.0} %", 100.0 * quality[name].as_f64().unwrap())
    };
    let rows = [
        format!(
            "{:.0} points, median {:.1} cm from the nearest wall, {} within 5 cm",
            number("points"),
            100.0 * number("wall_median_m"),
            percent(&whole, "near_wall")
        ),
        format!(
            "{} of the wall that the robot can hear has a point after 10 minutes, {} after 5",
            percent(&whole, "coverage"),
            percent(&short, "coverage")
        ),
        format!(
            "the last pose {:.1} cm and {:.1}° from the true one, after {:.1} m",
            100.0 * number("pose_error_m"),
            number("heading_error_deg"),
            number("travelled_m")
        ),
    ];
    let readme = include_str!("../../../README.md");
    for row in rows {
        assert!(readme.contains(&format!("| `demo`: {row} |")), "README.md: {row}");
    }
}

#[test]
fn demo_leaves_its_files_and_the_same_seed_gives_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let said = run(folder.path(), &["demo", "--seconds", "30"]).expect(0);
    assert!(
        said.out.contains("to the nearest wall")
            && said.out.contains("under 5 cm")
            && said.out.contains("coverage: ")
            && said.out.contains("onbrick-demo"),
        "{}",
        said.out
    );
    assert_eq!(said.err, "", "progress is for terminals");
    assert_eq!(names(&folder.path().join("onbrick-demo")), FILES);
    for (out, seed) in [("again", "1"), ("third", "1"), ("other", "2")] {
        let json = run(
            folder.path(),
            &["demo", "--seconds", "30", "--seed", seed, "--out", out, "--json"],
        )
        .expect(0);
        let [ended, quality] = json.json().try_into().unwrap();
        assert_eq!(ended["event"], "ended", "{ended}");
        assert!(ended["ticks"].as_u64() > Some(0), "{ended}");
        assert_eq!(
            keys(&quality),
            [
                "coverage",
                "heading_error_deg",
                "most_heading_error_deg",
                "most_pose_error_m",
                "near_wall",
                "points",
                "pose_error_m",
                "travelled_m",
                "wall_median_m",
                "wall_p90_m"
            ]
        );
        for (at_the_end, most) in
            [("pose_error_m", "most_pose_error_m"), ("heading_error_deg", "most_heading_error_deg")]
        {
            assert!(quality[most].as_f64() >= quality[at_the_end].as_f64(), "{quality}");
        }
        // The pose may be worst at the end, the heading is not: the robot has turned back.
        let worst_deg = quality["most_heading_error_deg"].as_f64();
        assert!(worst_deg > quality["heading_error_deg"].as_f64(), "{quality}");
    }
    let read = |out: &str, file: &str| std::fs::read(folder.path().join(out).join(file)).unwrap();
    for file in FILES {
        assert!(read("third", file) == read("again", file), "{file} differs with the same seed");
        let stamped = file == "run.mcap";
        assert!(stamped || read("onbrick-demo", file) == read("again", file), "{file} differs");
    }
    // A person's run is stamped with the day's time, a program's from 1970 on.
    let stamped =
        |out: &str| Run::read(&read(out, "run.mcap")).unwrap().info.unwrap().wall_offset_ns;
    assert_eq!(stamped("again"), 0);
    assert!((onbrick::clock::wall_ns() - stamped("onbrick-demo")).abs() < 3_600_000_000_000);
    assert!(
        read("onbrick-demo", "points.csv") != read("other", "points.csv"),
        "another seed, another run"
    );
    // No recording is written over: a second demo has a folder of its own.
    let before = read("onbrick-demo", "run.mcap");
    let said = run(folder.path(), &["demo", "--seconds", "1"]).expect(0);
    assert!(said.out.trim_end().ends_with("/onbrick-demo-2"), "{}", said.out);
    assert_eq!(names(&folder.path().join("onbrick-demo-2")), FILES);
    let said = run(folder.path(), &["demo", "--seconds", "1", "--out", "onbrick-demo"]).expect(3);
    assert!(said.err.contains("run.mcap is there already"), "{}", said.err);
    assert!(said.err.contains("try: another folder for --out"), "{}", said.err);
    assert!(read("onbrick-demo", "run.mcap") == before, "the first one's recording was changed");
}

#[test]
fn demo_runs_the_seeds_robot_and_its_estimator_and_replays_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let demo = |out: &str, method: &str| {
        let arguments =
            ["demo", "--mission", "map", "--seconds", "20", "--method", method, "--out", out];
        run(folder.path(), &arguments).expect(0);
        Run::open(&folder.path().join(out).join("run.mcap")).unwrap()
    };
    let (seed, default) = (demo("seed", "seed"), demo("default", "default"));
    // The seed has a point a tick, the default one a reading.
    assert!(seed.points.len() > 2 * default.points.len(), "{}", seed.points.len());
    run(folder.path(), &["replay", "seed/run.mcap"]).expect(0);
    run(folder.path(), &["replay", "default/run.mcap"]).expect(0);
    let said = run(folder.path(), &["demo", "--mission", "mapp"]).expect(2);
    assert!(said.err.contains("map"), "{}", said.err);
    let said = run(folder.path(), &["demo", "--method", "sed"]).expect(2);
    assert!(said.err.contains("default, odometry, seed"), "{}", said.err);
}

#[test]
fn demo_takes_another_world_and_refuses_one_that_is_none() {
    let folder = tempfile::tempdir().unwrap();
    run(folder.path(), &["demo", "--seconds", "1", "--world", "rooms", "--out", "rooms"]).expect(0);
    let said = run(folder.path(), &["demo", "--world", "areena", "--out", "none"]).expect(3);
    assert!(said.err.contains("areena") && said.err.contains("arena, "), "{}", said.err);
    std::fs::write(
        folder.path().join("w.toml"),
        "name = \"w\"\n[[block]]\nat = [0, 0]\nsize_m = [1, 1]\n",
    )
    .unwrap();
    let said = run(folder.path(), &["demo", "--world", "w.toml", "--out", "none"]).expect(3);
    assert!(
        said.err.contains("starts inside a wall") && said.err.contains("--> w.toml:"),
        "{}",
        said.err
    );
    assert_eq!(names(folder.path()), ["rooms", "w.toml"]);
}

#[test]
fn the_process_that_drives_says_as_much_as_the_one_that_started_it() {
    let folder = tempfile::tempdir().unwrap();
    for (more, says) in [(&["-vv"][..], true), (&[], false)] {
        let arguments = ["run", "square", "--sim", "open", "--set", "time_limit_s=1"];
        let said = run(folder.path(), &[more, &arguments].concat()).expect(0);
        assert_eq!(said.err.contains("the robot is bound"), says, "{more:?}: {}", said.err);
    }
}

#[test]
fn with_v_a_run_tells_each_transition_and_what_the_mission_says_shows_and_sounds() {
    let folder = tempfile::tempdir().unwrap();
    let mission = r#"name = "two"
[machine.m]
start = "ahead"
final = "home"
[machine.m.state.ahead]
do = { forward_mps = 0.1, led = "orange", say = "Größe {2 + 1}" }
next = [{ when = "state_s > 1.5", go = "back" }]
[machine.m.state.back]
do = { drive_m = -0.05, tone_hz = 440 }
next = [{ when = "done", go = "home" }]
[machine.m.state.home]
on_entry = { led = "green" }
"#;
    std::fs::write(folder.path().join("two.toml"), mission).unwrap();
    let arguments = ["run", "two.toml", "--sim", "open", "--out", "told", "-v"];
    let said = run(folder.path(), &arguments).expect(0);
    let wanted = [
        "    0.00 s  says: Größe 3",
        "    0.00 s  lights: orange",
        " s  m: ahead -> back  (state_s > 1.5)",
        " s  tone: 440 Hz",
        " s  m: back -> home  (done)",
        " s  lights: green",
        " s  the mission is finished",
    ];
    let mut lines = said.err.lines();
    for line in wanted {
        assert!(lines.any(|said| said.ends_with(line)), "`{line}` in its place: {}", said.err);
    }
    // Without it, what the mission says and nothing else.
    let quiet = run(folder.path(), &["run", "two.toml", "--sim", "open", "--out", "q"]).expect(0);
    assert_eq!(quiet.err, "");
    assert!(quiet.out.starts_with("    0.00 s  says: Größe 3\nthe mission is"), "{}", quiet.out);
    // For programs, the same as values.
    let arguments = ["--json", "run", "two.toml", "--sim", "open", "--out", "json", "-v"];
    let told = run(folder.path(), &arguments).expect(0).json();
    let moved = told.iter().find(|value| value["event"] == "transition").unwrap();
    assert_eq!((&moved["from"], &moved["to"]), (&"ahead".into(), &"back".into()));
    // Where a simulated robot truly was is in its recording, ten times a second.
    let recorded = Run::open(&folder.path().join("told/run.mcap")).unwrap();
    let seconds = recorded.poses.len() / 50;
    assert!(recorded.truth.len().abs_diff(10 * seconds) <= 10, "{}", recorded.truth.len());
    let (time_ns, truth) = recorded.truth.last().unwrap();
    let then = recorded.poses.iter().find(|pose| pose.time_ns == *time_ns).expect("a tick's time");
    assert!((truth.x_m - then.pose.x_m).abs() < 0.03, "{truth:?} {then:?}");
}

#[test]
fn a_simulated_run_tells_how_it_goes_and_is_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let arguments =
        ["run", "map", "--sim", "arena", "--set", "time_limit_s=3", "--out", "first", "--json"];
    let events = run(folder.path(), &arguments).expect(0).json();
    assert_eq!(events[0]["event"], "driving", "{}", events[0]);
    let statuses: Vec<_> = events.iter().filter(|event| event["event"] == "status").collect();
    assert!(statuses.len() > 5, "{} statuses", statuses.len());
    assert_eq!(
        keys(statuses[0]),
        [
            "battery_v",
            "dropped",
            "elapsed_ns",
            "event",
            "latest_ns",
            "overruns",
            "points",
            "pose",
            "range",
            "said",
            "states",
            "tick",
            "time_ns",
            "travelled_m",
            "variables",
            "warning"
        ]
    );
    let ended = events.last().unwrap();
    assert_eq!(
        keys(ended),
        [
            "event",
            "file",
            "latest_s",
            "overruns",
            "points",
            "recording",
            "stopped",
            "ticks",
            "time_s",
            "travelled_m",
            "word"
        ]
    );
    assert_eq!((&ended["event"], &ended["word"]), (&"ended".into(), &"finished".into()));
    assert_eq!(events.iter().filter(|event| event["event"] == "ended").count(), 1, "one end");
    let file = folder.path().join("first/run.mcap");
    assert_eq!(ended["file"].as_str().unwrap(), text(file.canonicalize().unwrap()));
    let recorded = Run::open(&file).unwrap();
    assert_eq!(recorded.senses.len() as u64, ended["ticks"].as_u64().unwrap());
    assert!(recorded.warnings.is_empty(), "{:?}", recorded.warnings);

    let before = std::fs::read(&file).unwrap();
    let said = run(folder.path(), &arguments[..8]).expect(3);
    assert!(said.err.contains("there already") && said.err.contains("--out"), "{}", said.err);
    assert!(std::fs::read(&file).unwrap() == before, "a recording is never written over");
}

#[test]
fn runs_without_a_folder_take_the_next_free_one() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["run", "map", "--sim", "arena", "--set", "time_limit_s=1"];
    for number in 1..=3 {
        let said = run(folder.path(), &arguments).expect(0);
        assert!(said.out.contains(&format!("onbrick-runs/map-{number}/run.mcap")), "{}", said.out);
        assert!(said.out.contains("the mission is finished"), "{}", said.out);
        assert_eq!(said.err, "");
    }
    assert_eq!(names(&folder.path().join("onbrick-runs")), ["map-1", "map-2", "map-3"]);
}

#[test]
fn a_run_that_is_refused_leaves_no_folder() {
    let folder = tempfile::tempdir().unwrap();
    let said = run(folder.path(), &["run", "map", "--brick", "nowhere"]).expect(3);
    assert!(
        said.err.contains("no brick below nowhere") && said.err.contains("--brick"),
        "{}",
        said.err
    );
    // A brick with nothing plugged in.
    std::fs::create_dir_all(folder.path().join("bare/sys/class")).unwrap();
    for out in ["mine", "mine/very/own"] {
        let said = run(folder.path(), &["run", "map", "--brick", "bare", "--out", out]).expect(3);
        assert!(
            said.err.contains("no brick below bare") && said.err.contains("--sim arena"),
            "{}",
            said.err
        );
    }
    assert_eq!(names(folder.path()), ["bare"]);
}

#[test]
fn the_start_pose_is_one_of_the_worlds() {
    let folder = tempfile::tempdir().unwrap();
    for (out, world, pose, expected) in [
        ("given", "arena", Some("-0.5,0,30"), [-0.5, 0.0, 30.0]),
        ("second", "two-arenas", Some("3,0,90"), [3.0, 0.0, 90.0]),
        ("worlds", "arena", None, [-0.5, 0.0, 30.0]),
    ] {
        let mut arguments =
            vec!["run", "map", "--sim", world, "--set", "time_limit_s=1", "--out", out];
        arguments.extend(pose.iter().flat_map(|pose| ["--pose", pose]));
        run(folder.path(), &arguments).expect(0);
        let run = Run::open(&folder.path().join(out).join("run.mcap")).unwrap();
        let near = |pose: onbrick::mapping::Pose, within: f64| {
            let found = [pose.x_m, pose.y_m, pose.heading_rad.to_degrees()];
            assert!(
                found.iter().zip(expected).all(|(is, want)| (is - want).abs() < within),
                "{found:?}"
            );
        };
        near(run.info.unwrap().start_pose, 1e-9);
        // It stands there, too: a second is over before it has driven off far.
        near(run.ending.unwrap().truth.unwrap(), 15.0);
    }
    // Elsewhere no robot starts, and the map would lie where the robot is not.
    let said =
        run(folder.path(), &["run", "map", "--sim", "arena", "--pose", "1.5,-2,90"]).expect(3);
    assert!(
        said.err.contains("no robot starts at 1.5,-2,90") && said.err.contains("--pose=-0.5,0,30"),
        "{}",
        said.err
    );
}

/// Beside a `robot.toml` as `setup` writes it, `run` drives that robot, as `doctor` examines it.
#[test]
fn the_robot_of_the_folder_is_the_one_that_is_run() {
    let folder = tempfile::tempdir().unwrap();
    let text = onbrick::robot::DEFAULT_ROBOT;
    let named = |name: &str| text.replacen("name = ", &format!("name = \"{name}\" # "), 1);
    assert!(named("mine").contains("name = \"mine\""));
    let drive = |out: &str, more: &[&str]| {
        let arguments = ["run", "square", "--sim", "open", "--set", "time_limit_s=1", "--out", out];
        let said = run(folder.path(), &[&arguments, more].concat()).expect(0);
        (
            said.out,
            Run::open(&folder.path().join(out).join("run.mcap")).unwrap().info.unwrap().brick,
        )
    };
    let (said, shipped) = drive("shipped", &[]);
    assert!(!said.contains("robot.toml"), "{said}");
    std::fs::write(folder.path().join("robot.toml"), named("mine")).unwrap();
    std::fs::write(folder.path().join("other.toml"), named("other")).unwrap();
    let (said, mine) = drive("mine", &[]);
    assert!(said.contains("with the robot of robot.toml"), "{said}");
    let (_, other) = drive("other", &["--robot", "other.toml"]);
    assert_eq!((mine.as_str(), other.as_str()), ("mine", "other"));
    assert_ne!(shipped, "mine");
    std::fs::write(folder.path().join("robot.toml"), "name = 5\n").unwrap();
    let said = run(folder.path(), &["run", "square", "--sim", "open"]).expect(3);
    assert!(said.err.contains("robot.toml"), "{}", said.err);
}

/// What has no value is said in words: a robot that fell, a room without walls.
#[test]
fn a_robot_that_falls_ends_its_run_and_nothing_is_not_a_number() {
    let folder = tempfile::tempdir().unwrap();
    let said = run(folder.path(), &["demo", "--world", "table"]).expect(1);
    let all = format!("{}{}", said.out, said.err);
    let at = "fell over the edge of the floor: drive in ";
    assert!(said.err.contains(at) && said.err.contains(", at x "), "{all}");
    assert!(!all.contains("NaN") && !all.contains("inf"), "{all}");
    let recorded = Run::open(&folder.path().join("onbrick-demo/run.mcap")).unwrap();
    let ending = recorded.ending.unwrap();
    assert_eq!(ending.stop.reason, StopReason::Fallen);
    let truth = ending.truth.unwrap();
    let over_m =
        [-0.5 - truth.x_m, truth.x_m - 1.1, -0.5 - truth.y_m, truth.y_m - 0.6].map(|over_m| over_m);
    let over_m = over_m.into_iter().fold(f64::NEG_INFINITY, f64::max);
    assert!((0.0..0.1).contains(&over_m), "it ended where it fell: {truth:?}");
    for world in ["open", "line"] {
        let said =
            run(folder.path(), &["demo", "--seconds", "20", "--world", world, "--out", world])
                .expect(0);
        assert!(!said.out.contains("NaN") && !said.out.contains("inf"), "{}", said.out);
        let words =
            ["no echo", "no wall in this world"].iter().any(|words| said.out.contains(words));
        assert!(words, "{}", said.out);
    }
}

#[test]
fn control_is_a_process_of_its_own_that_ends_with_its_run() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["run", "map", "--sim", "arena", "--realtime", "--json"];
    let mut child = onbrick(folder.path(), &arguments).stdout(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    assert!(lines.next().unwrap().unwrap().contains("driving"));
    let parent = child.id();
    let children =
        std::fs::read_to_string(format!("/proc/{parent}/task/{parent}/children")).unwrap();
    let control: i32 = children.trim().parse().expect("one child");
    let command = std::fs::read(format!("/proc/{control}/cmdline")).unwrap();
    assert!(command.ends_with(b"\0control\0"), "{}", String::from_utf8_lossy(&command));
    nix::sys::signal::kill(nix::unistd::Pid::from_raw(control), nix::sys::signal::Signal::SIGINT)
        .unwrap();
    let ended = lines.last().unwrap().unwrap();
    assert!(ended.contains("\"word\":\"signal\""), "{ended}");
    assert_eq!(child.wait().unwrap().code(), Some(6));
    assert!(
        !std::path::Path::new(&format!("/proc/{control}")).exists(),
        "control is gone and waited for"
    );
}

#[test]
fn a_demo_that_is_stopped_ends_as_a_run_does() {
    use nix::sys::signal::Signal;
    for (signal, code) in [(Signal::SIGINT, None), (Signal::SIGTERM, Some(6))] {
        let folder = tempfile::tempdir().unwrap();
        let mut command = onbrick(folder.path(), &["demo", "--realtime"]);
        let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let recording = folder.path().join("onbrick-demo/run.mcap");
        let has_begun = || std::fs::metadata(&recording).is_ok_and(|file| file.len() > 0);
        crate::support::turning_brick::await_that("the demo drives", has_begun);
        let process = nix::unistd::Pid::from_raw(i32::try_from(child.id()).unwrap());
        nix::sys::signal::kill(process, signal).unwrap();
        let said = super::done(&child.wait_with_output().unwrap());
        assert_eq!(said.code, code, "{}{}", said.out, said.err);
        assert!(said.out.contains("stopped by a signal"), "{}{}", said.out, said.err);
    }
}

#[test]
fn a_run_says_once_that_it_ended() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["run", "map", "--sim", "open", "--set", "time_limit_s=1", "--json"];
    let said = run(folder.path(), &arguments).expect(0);
    let events = said.json();
    assert!(
        events.iter().all(|event| event["event"].is_string()),
        "every line is an event: {}",
        said.out
    );
}

#[test]
fn every_shipped_robot_drives_in_any_world_and_the_one_of_the_folder_is_treated_alike_everywhere() {
    let folder = tempfile::tempdir().unwrap();
    for robot in ["mapper", "educator", "retail"] {
        let said =
            run(folder.path(), &["run", "square", "--sim", "open", "--robot", robot]).expect(0);
        assert!(said.out.contains("finished"), "{robot}: {}", said.out);
    }
    let said = run(folder.path(), &["run", "square", "--sim", "open", "--robot", "edu"]).expect(3);
    assert!(said.err.contains("educator"), "{}", said.err);
    run(folder.path(), &["new", "robot", "robot.toml", "--from", "educator"]).expect(0);
    // A patch of colour 0.3 m ahead, and the education set's sensors: no head, gyro on 2.
    let said = run(folder.path(), &["run", "line", "--sim", "line", "--set", "time_limit_s=3"]);
    let said = said.expect(0);
    assert!(said.out.contains("with the robot of robot.toml"), "{}", said.out);
    let brick = folder.path().join("no-brick");
    std::fs::create_dir(&brick).unwrap();
    let said = run(folder.path(), &["doctor", "--brick", "no-brick"]);
    assert!(said.out.contains("with the robot of robot.toml"), "{}", said.out);
    // A check is for the same robot, and of sub-machines as well.
    let said = run(folder.path(), &["check", "map"]).expect(3);
    assert!(said.out.contains("[head] in the robot's file would be that part"), "{}", said.out);
    run(folder.path(), &["new", "submachine", "home.toml", "--from", "come-home"]).expect(0);
    let said = run(folder.path(), &["check", "home.toml"]).expect(0);
    assert!(said.out.ends_with("home.toml: in order: a part of missions\n"), "{}", said.out);
    let said = run(folder.path(), &["run", "home.toml", "--sim", "open"]).expect(3);
    assert!(said.err.contains("this file is a sub-machine, not a mission"), "{}", said.err);
    // Two sensors in one place would follow no line.
    let text = std::fs::read_to_string(folder.path().join("robot.toml")).unwrap();
    let eye = "[sensor.eye]\nport = \"in1\"\nmeasures = \"reflect_pct\"\n";
    let text = text.replace("[touch]\nport = \"in1\"\n", "");
    for (more, warns) in [("", true), ("at_m = [0.07, 0.02]\n", false)] {
        std::fs::write(folder.path().join("two.toml"), format!("{text}\n{eye}{more}")).unwrap();
        let line =
            ["run", "line", "--sim", "line", "--robot", "two.toml", "--set", "time_limit_s=1"];
        let said = run(folder.path(), &line).expect(0);
        let warning = "[sensor.eye] and [colour] measure the same in the simulation";
        assert_eq!(said.err.contains(warning), warns, "{}", said.err);
    }
    // What it has not, a mission cannot ask for.
    let said = run(folder.path(), &["run", "map", "--sim", "arena"]).expect(3);
    assert!(said.err.contains("[head] in the robot's file would be that part"), "{}", said.err);
}

#[test]
fn a_sub_machine_of_a_file_beside_the_mission_is_part_of_what_is_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    put(
        "mine.toml",
        "name = \"mine\"\n[machine.drive]\nstart = \"a\"\nfinal = \"end\"\n\
         [machine.drive.state.a]\nuse = \"hop\"\nwith = { way_m = 0.2 }\n\
         next = [{ when = \"done\", go = \"end\" }]\n[machine.drive.state.end]\n",
    );
    put(
        "hop.toml",
        "[submachine.hop]\nstart = \"on\"\nfinal = \"over\"\nvariables = { way_m = 1 }\n\
         [submachine.hop.state.on]\ndo = { drive_m = \"way_m\" }\n\
         next = [{ when = \"done\", go = \"over\" }]\n[submachine.hop.state.over]\n",
    );
    run(folder.path(), &["check", "mine.toml"]).expect(0);
    let graph = run(folder.path(), &["graph", "mine.toml"]).expect(0);
    assert!(graph.out.contains("state \"a\" as m0s0 {"), "{}", graph.out);
    run(folder.path(), &["run", "mine.toml", "--sim", "open", "--out", "run"]).expect(0);
    let recorded = Run::open(&folder.path().join("run/run.mcap")).unwrap();
    let taken: Vec<_> = recorded
        .transitions
        .iter()
        .map(|next| (next.from.as_str(), next.to.as_str(), next.condition.as_str()))
        .collect();
    assert_eq!(taken, [("a.on", "a.over", "done"), ("a.over", "end", "done")]);
    // The recording needs no other file.
    std::fs::remove_file(folder.path().join("hop.toml")).unwrap();
    run(folder.path(), &["replay", "run/run.mcap"]).expect(0);
    let said = run(folder.path(), &["check", "mine.toml"]).expect(3);
    assert!(said.out.contains("here or in hop.toml beside this file"), "{}", said.out);
    put(
        "hop.toml",
        "[submachine.hop]\nstart = \"on\"\n[submachine.hop.state.on]\ndo = { drve_m = 1 }\n",
    );
    let said = run(folder.path(), &["check", "mine.toml"]).expect(3);
    assert!(said.out.contains("--> hop.toml:4:8"), "{}", said.out);
}

#[test]
fn demo_takes_other_robots_and_says_who_runs_missions_of_ones_own() {
    let folder = tempfile::tempdir().unwrap();
    let demo = ["demo", "--robot", "educator", "--seconds", "20", "--out", "e"];
    run(folder.path(), &demo).expect(0);
    let recorded = Run::open(&folder.path().join("e/run.mcap")).unwrap();
    assert!(recorded.robot_toml.unwrap().contains("name = \"educator\""));
    let said = run(folder.path(), &["demo", "--mission", "my.toml"]).expect(2);
    assert!(said.err.contains("onbrick run FILE --sim WORLD"), "{}", said.err);
}

#[test]
fn shipped_sub_machines_can_be_had_as_files() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["wander", "look-round", "follow-wall", "come-home"] {
        let file = format!("{name}.toml");
        run(folder.path(), &["new", "submachine", &file, "--from", name]).expect(0);
        let text = std::fs::read_to_string(folder.path().join(&file)).unwrap();
        assert!(text.contains(&format!("[submachine.{name}]")), "{text}");
    }
    // It is used by its file's name.
    run(folder.path(), &["new", "submachine", "tour.toml"]).expect(0);
    let mission = "name = \"m\"\n[machine.drive.state.about]\nuse = \"tour\"\n";
    std::fs::write(folder.path().join("m.toml"), mission).unwrap();
    run(folder.path(), &["check", "m.toml"]).expect(0);
    let said = run(folder.path(), &["new", "submachine", "--from", "look"]).expect(2);
    assert!(said.err.contains("did you mean `look-round`?"), "{}", said.err);
}
