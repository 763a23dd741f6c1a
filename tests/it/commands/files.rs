//! `check`, `graph`, `new`: what people write.

use onbrick::behavior::{Capabilities, Mission, shipped};
use onbrick::robot::RobotConfig;
use onbrick::service::Config;
use onbrick::sim::World;

use super::{keys, names, run};

#[test]
fn check_looks_at_every_file_and_says_which_are_broken() {
    let folder = tempfile::tempdir().unwrap();
    let good = shipped::find("map").unwrap().text;
    std::fs::write(folder.path().join("good.toml"), good).unwrap();
    std::fs::write(
        folder.path().join("bad.toml"),
        good.replace("range_m", "rang_m").replace("\"turn_left\"", "\"trun_left\""),
    )
    .unwrap();
    std::fs::write(folder.path().join("binary.toml"), [0xff, 0xfe, 0, 1]).unwrap();
    std::fs::write(folder.path().join("empty.toml"), "").unwrap();
    let said = run(folder.path(), &["check", "map", "good.toml", "bump"]).expect(0);
    assert!(
        said.out.contains(
            "good.toml: in order: drive (4 states), look (2 states), 50 Hz, 120 s at most"
        ),
        "{}",
        said.out
    );
    assert_eq!(said.out.lines().count(), 3, "{}", said.out);
    // What only the robot's file can refute is said where none was given.
    let named =
        good.replace("range_m", "sensor.eye").replacen("do = {", "do = { motor.arm = 9,", 1);
    std::fs::write(folder.path().join("named.toml"), named).unwrap();
    let said = run(folder.path(), &["check", "named.toml"]).expect(0);
    assert!(said.out.ends_with("; for a robot with [motor.arm], [sensor.eye]\n"), "{}", said.out);
    let said = run(folder.path(), &["check", "named.toml", "--json"]).expect(0);
    assert_eq!(said.json()[0]["needs"], serde_json::json!(["[motor.arm]", "[sensor.eye]"]));
    let said = run(folder.path(), &["check", "named.toml", "--robot", "mapper"]).expect(3);
    assert!(said.out.contains("the robot has no motor named `arm`"), "{}", said.out);

    let said = run(
        folder.path(),
        &["check", "bad.toml", "good.toml", "binary.toml", "empty.toml", "none.toml"],
    )
    .expect(3);
    for expected in [
        "did you mean `range_m`?",
        "did you mean `turn_left`?",
        "good.toml: in order",
        "binary.toml:1:1",
        "`name` is missing",
        "none.toml",
    ] {
        assert!(said.out.contains(expected), "`{expected}` is not in\n{}", said.out);
    }
    assert!(said.err.contains("4 missions are not in order"), "{}", said.err);

    let said =
        run(folder.path(), &["check", "--json", "bad.toml", "none.toml", "good.toml"]).expect(3);
    let lines = said.json();
    assert_eq!(lines.len(), 4, "one for each file, and the failure: {}", said.out);
    assert_eq!(keys(&lines[0]), ["findings", "mission", "ok"]);
    assert_eq!(
        keys(&lines[0]["findings"][0]),
        ["column", "file", "hint", "line", "message", "severity"]
    );
    assert_eq!(
        lines.iter().map(|line| line["ok"].as_bool()).collect::<Vec<_>>(),
        [Some(false), Some(false), Some(true), None]
    );
}

#[test]
fn check_for_a_robot_knows_what_it_lacks() {
    let folder = tempfile::tempdir().unwrap();
    run(folder.path(), &["new", "robot", "robot.toml"]).expect(0);
    run(folder.path(), &["check", "map", "--robot", "robot.toml"]).expect(0);
    // Of no robot in particular, what none is as fast as.
    let fast = "name = \"fast\"\n[machine.m.state.a]\ndo = { drive_m = 1, \
                speed_mps = 5 }\n";
    std::fs::write(folder.path().join("fast.toml"), fast).unwrap();
    let said = run(folder.path(), &["check", "fast.toml"]).expect(0).out;
    assert!(
        said.contains("faster than the robot's wheels") && said.contains("it drives at 0.19 m/s\n"),
        "{said}"
    );
    let said = run(folder.path(), &["check", "remote", "--robot", "robot.toml"]).expect(3);
    assert!(said.out.contains("[remote] in the robot's file"), "{}", said.out);
}

#[test]
fn graph_draws_every_shipped_mission() {
    let folder = tempfile::tempdir().unwrap();
    for mission in shipped::MISSIONS {
        let said = run(folder.path(), &["graph", mission.name]).expect(0);
        assert!(
            said.out.starts_with("stateDiagram-v2\n") && said.out.contains("-->"),
            "{}",
            said.out
        );
    }
    let said = run(folder.path(), &["graph", "mapp"]).expect(3);
    assert!(said.err.contains("did you mean `map`?") && said.err.contains("wall"), "{}", said.err);
    let json = run(folder.path(), &["graph", "map", "--json"]).expect(0);
    assert_eq!(keys(&json.json()[0]), ["mermaid", "mission"]);
}

#[test]
fn new_writes_templates_that_load_and_never_writes_over_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    for what in ["mission", "robot", "world", "service"] {
        let file = format!("{what}.toml");
        let said = run(folder.path(), &["new", what, &file]).expect(0);
        assert_eq!(said.out, format!("wrote {file}\n"));
        let shown = run(folder.path(), &["new", what]).expect(0).out;
        let written = String::from_utf8(read(&file)).unwrap();
        assert_eq!(written, shown.replacen("name = \"first\"", "name = \"mission\"", 1));
        std::fs::write(folder.path().join(&file), [&read(&file)[..], b"# mine\n"].concat())
            .unwrap();
        let said = run(folder.path(), &["new", what, &file]).expect(3);
        assert!(
            said.err.contains("is there already") && said.err.contains("another name"),
            "{}",
            said.err
        );
        assert!(read(&file).ends_with(b"# mine\n"));
        let json =
            run(folder.path(), &["new", what, &format!("{what}-2.toml"), "--json"]).expect(0);
        assert_eq!(json.json(), [serde_json::json!({ "wrote": format!("{what}-2.toml") })]);
    }
    assert!(Mission::parse("m", &read("mission.toml"), &Capabilities::all()).unwrap().1.is_empty());
    assert!(RobotConfig::load("r", &read("robot.toml")).unwrap().1.is_empty());
    assert!(World::parse("w", &read("world.toml")).unwrap().1.is_empty());
    assert!(Config::load("s", &read("service.toml"), folder.path()).unwrap().1.is_empty());
    let square = shipped::find("square").unwrap().text;
    for (name, text) in [
        ("square", square.to_owned()),
        ("of-anna", square.replacen("name = \"square\"", "name = \"of-anna\"", 1)),
        ("\"quoted\"", square.to_owned()),
    ] {
        let file = format!("{name}.toml");
        run(folder.path(), &["new", "mission", &file, "--from", "square"]).expect(0);
        assert_eq!(
            String::from_utf8(read(&file)).unwrap(),
            text,
            "its runs are called by its name"
        );
    }
    let said = run(folder.path(), &["new", "mission", "no/where.toml"]).expect(1);
    assert!(said.err.contains("no/where.toml"), "{}", said.err);
    assert_eq!(names(folder.path()).len(), 11);
}

#[test]
fn a_template_runs_on_the_simulated_brick() {
    let folder = tempfile::tempdir().unwrap();
    for what in ["mission", "robot", "world"] {
        run(folder.path(), &["new", what, &format!("{what}.toml")]).expect(0);
    }
    let arguments = [
        "run",
        "mission.toml",
        "--robot",
        "robot.toml",
        "--sim",
        "world.toml",
        "--set",
        "time_limit_s=2",
        "--out",
        "o",
    ];
    run(folder.path(), &arguments).expect(0);
}
