//! Ways out that fit what is wrong.

use super::onbrick;

/// A robot that sees nothing.
const TWO_WHEELS: &str = r#"
name = "two wheels"
[drive]
left = { port = "outB" }
right = { port = "outD" }
wheel_circumference_m = 0.188976
track_width_m = 0.1143
max_dps = 360
"#;

#[test]
fn a_mission_that_does_not_load_has_the_way_out_that_fits_it() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("robot.toml", onbrick::robot::DEFAULT_ROBOT);
    write("blind.toml", TWO_WHEELS);
    write("broken.toml", "name = \"x\"\nrate = 3\n");
    write("empty.toml", "");
    for (arguments, hint) in [
        (&["run", "robot.toml", "--sim", "arena"][..], "this file is a robot, not a mission"),
        (&["graph", "robot.toml"], "this file is a robot, not a mission"),
        (
            &["run", "map", "--robot", "blind.toml", "--sim", "arena"],
            "wants another robot: plug in what is missing and let onbrick setup write a \
             robot.toml; or --robot mapper",
        ),
        (&["run", "broken.toml", "--sim", "arena"], "onbrick new mission"),
        (&["check", "empty.toml"], "onbrick new mission, which shows a whole file"),
        // It is there, and the kernel does not let it be read.
        (&["run", "/proc/self/mem", "--sim", "arena"], "a file that you may read"),
    ] {
        let output = onbrick(folder.path(), arguments).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{arguments:?}: {said}");
        assert!(said.contains(hint), "{arguments:?}: {said}");
    }
}

#[test]
fn what_is_not_there_has_a_way_out() {
    let folder = tempfile::tempdir().unwrap();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let page = format!("--page={}", taken.local_addr().unwrap().port());
    for (arguments, hint) in [
        (&["team", "none.toml"][..], "onbrick new team none.toml"),
        (&["start", "./none.toml", "red"], "a file that is there, or the name of a mission"),
        (&["menu", "--config", "none"], "--config with the folder of a service"),
        (&["run", "square", "--sim", "open", &page], "another port for --page"),
        (&["class", "--keys", "keys", &page], "another port for --page"),
        (&["key", "new", "--keys", "/proc/nowhere"], "--keys or ONBRICK_KEYS with a folder"),
    ] {
        let output = onbrick(folder.path(), arguments).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{arguments:?}: {said}");
        assert!(said.contains(&format!("  try: {hint}")), "{arguments:?}: {said}");
    }
    assert!(!folder.path().join("onbrick-runs").exists());
}

#[test]
fn all_that_is_not_plugged_in_is_told_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let world = onbrick::sim::World::text("arena").unwrap();
    for (ports, told) in [
        ("in1 = \"none\"\nin4 = \"none\"\n", &["range", "gyro"][..]),
        ("outB = \"none\"\noutA = \"none\"\nin4 = \"none\"\n", &["drive.left", "head", "gyro"]),
        ("in4 = \"none\"\n", &["gyro"]),
    ] {
        let world = format!("{world}\n[robot.ports]\n{ports}");
        std::fs::write(folder.path().join("bare.toml"), world).unwrap();
        let arguments = ["run", "map", "--sim", "bare.toml"];
        let output = onbrick(folder.path(), &arguments).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{ports}: {said}");
        for part in told {
            assert_eq!(said.matches(&format!("{part}: no ")).count(), 1, "{part}: {said}");
        }
        assert_eq!(said.matches(": no ").count(), told.len(), "{said}");
        assert_eq!(said.matches("plug it in there").count(), 1, "{said}");
    }
}

#[test]
fn a_part_that_the_robot_lacks_is_told_once_however_often_it_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("blind.toml"), TWO_WHEELS).unwrap();
    for (arguments, part) in [
        (&["run", "line", "--robot", "blind.toml", "--sim", "line"][..], "takes a colour sensor"),
        (&["run", "explore", "--robot", "blind.toml", "--sim", "arena"], "takes a range sensor"),
    ] {
        let output = onbrick(folder.path(), arguments).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{arguments:?}: {said}");
        assert_eq!(said.matches(part).count(), 1, "{said}");
        let ways_out = said.matches("plug in what is missing").count();
        assert!(ways_out == 1 && said.contains("or --robot mapper"), "{said}");
    }
}
