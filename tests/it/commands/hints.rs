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
    for (arguments, hint) in [
        (&["run", "robot.toml", "--sim", "arena"][..], "this file is a robot, not a mission"),
        (&["graph", "robot.toml"], "this file is a robot, not a mission"),
        (
            &["run", "map", "--robot", "blind.toml", "--sim", "arena"],
            "wants another robot; onbrick new robot",
        ),
        (&["run", "broken.toml", "--sim", "arena"], "onbrick new mission"),
    ] {
        let output = onbrick(folder.path(), arguments).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{arguments:?}: {said}");
        assert!(said.contains(hint), "{arguments:?}: {said}");
    }
}
