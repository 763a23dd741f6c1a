//! The commands as a script uses them: exit codes, files, and what is never overwritten.

use std::path::Path;
use std::process::{Command, Output, Stdio};

use super::*;
use crate::support::brick::shipped_brick;
use crate::support::tested_program;

/// What a person would type for the seed's robot on a brick where nothing moves: name, ready, three
/// motors, measures.
const ANSWERS: &str = "tester\nyes\n1\nforwards\n\nback\n\n\n12 36\n0,2\n\n0.06\n";

fn onbrick(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(tested_program())
        .args(arguments)
        .current_dir(folder)
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

fn says(output: &Output) -> String {
    format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

#[test]
fn setup_writes_a_file_from_answers_and_never_over_one_that_is_there() {
    let folder = tempfile::tempdir().unwrap();
    shipped_brick().write(&folder.path().join("brick"));
    std::fs::write(folder.path().join("answers"), ANSWERS).unwrap();
    let setup = ["setup", "--brick", "brick", "--answers", "answers"];

    let done = onbrick(folder.path(), &setup);
    assert_eq!(done.status.code(), Some(0), "{}", says(&done));
    assert!(
        says(&done).contains("did not turn"),
        "a motor of plain files stands still: {}",
        says(&done)
    );
    let path = folder.path().join("robot.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let robot = load(&Source { name: "robot.toml".to_owned(), text: text.clone() });
    assert_eq!((robot.name.as_str(), robot.drive.wheel_circumference_m), ("tester", 0.2));
    assert_eq!((robot.drive.left.ratio, robot.drive.right.ratio), (1.0, -1.0));
    assert_eq!(robot.range.unwrap().ahead_m, 0.06);

    let refused = onbrick(folder.path(), &setup);
    assert_eq!(refused.status.code(), Some(3), "{}", says(&refused));
    assert!(says(&refused).contains("--force"), "{}", says(&refused));
    assert_eq!(std::fs::read_to_string(&path).unwrap(), text);

    let forced = onbrick(folder.path(), &[&setup[..], &["--force"]].concat());
    assert_eq!(forced.status.code(), Some(0), "{}", says(&forced));
    assert_eq!(std::fs::read_to_string(folder.path().join("robot.toml.1")).unwrap(), text);
}

#[test]
fn without_a_brick_no_command_blames_its_plugs() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("mapper.toml"), DEFAULT_ROBOT).unwrap();
    for line in [&["setup", "--brick", "."][..], &["calibrate", "mapper.toml", "--brick", "."]] {
        let said = onbrick(folder.path(), line);
        assert_eq!(said.status.code(), Some(3), "{line:?}: {}", says(&said));
        assert!(
            says(&said).contains("there is no brick below") && !says(&said).contains("lug"),
            "{line:?}: {}",
            says(&said)
        );
    }
    let said = onbrick(folder.path(), &["doctor", "--brick", "."]);
    assert_eq!(said.status.code(), Some(3), "{}", says(&said));
    assert!(
        says(&said).contains("failed   brick")
            && says(&said).contains("mapper.toml describes")
            && says(&said).contains("1 check failed")
            && !says(&said).contains("plug"),
        "{}",
        says(&said)
    );
}

#[test]
fn an_input_that_ends_fails_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    shipped_brick().write(&folder.path().join("brick"));
    let ended = onbrick(folder.path(), &["setup", "red.toml", "--brick", "brick"]);
    assert_eq!(ended.status.code(), Some(1), "{}", says(&ended));
    assert!(
        says(&ended).contains("red.toml is not written: there is no answer: the input has ended"),
        "{}",
        says(&ended)
    );
    std::fs::write(folder.path().join("answers"), "tester\nmaybe\n").unwrap();
    let unclear = onbrick(folder.path(), &["setup", "--brick", "brick", "--answers", "answers"]);
    assert!(says(&unclear).contains("`maybe` is neither yes nor no"), "{}", says(&unclear));
    let nowhere = onbrick(folder.path(), &["setup", "none/robot.toml", "--brick", "brick"]);
    assert_eq!(nowhere.status.code(), Some(3), "{}", says(&nowhere));
    assert!(
        says(&nowhere).contains("no folder for none/robot.toml\n  try:")
            && !says(&nowhere).contains("Plugged in"),
        "{}",
        says(&nowhere)
    );
    assert!(!folder.path().join("robot.toml").exists());
}

#[test]
fn calibrate_refuses_a_robot_that_is_not_ready_and_leaves_its_file() {
    let folder = tempfile::tempdir().unwrap();
    shipped_brick().write(&folder.path().join("brick"));
    std::fs::write(folder.path().join("robot.toml"), DEFAULT_ROBOT.replace("outD", "outC"))
        .unwrap();
    let refused = onbrick(folder.path(), &["calibrate", "--brick", "brick"]);
    assert_eq!(refused.status.code(), Some(3), "{}", says(&refused));
    assert!(
        says(&refused).contains("drive.right") && says(&refused).contains("outC"),
        "{}",
        says(&refused)
    );
    let missing = onbrick(folder.path(), &["calibrate", "other.toml", "--brick", "brick"]);
    assert_eq!(missing.status.code(), Some(3), "{}", says(&missing));
    assert!(says(&missing).contains("try: onbrick setup other.toml"), "{}", says(&missing));
    // The name of a shipped robot is no file that could be written into.
    let shipped = onbrick(folder.path(), &["calibrate", "mapper", "--brick", "brick"]);
    assert!(says(&shipped).contains("there is no file mapper"), "{}", says(&shipped));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "nothing was written");
}

#[test]
fn doctor_reports_for_people_and_for_programs_and_its_exit_code_tells() {
    let folder = tempfile::tempdir().unwrap();
    shipped_brick().write(&folder.path().join("brick"));
    for motor in 0..3 {
        // Nothing is going to turn here, so the motors can say that they stand still.
        std::fs::write(
            folder.path().join(format!("brick/sys/class/tacho-motor/motor{motor}/state")),
            "\n",
        )
        .unwrap();
    }
    std::fs::write(folder.path().join("robot.toml"), DEFAULT_ROBOT).unwrap();
    let people = onbrick(folder.path(), &["doctor", "--brick", "brick"]);
    // A brick of plain files has no buttons, so a run could not be stopped by hand.
    assert_eq!(people.status.code(), Some(3), "{}", says(&people));
    assert!(says(&people).contains("failed   buttons"), "{}", says(&people));
    assert!(
        says(&people).contains("ok       drive.left     lego-ev3-l-motor on outB"),
        "{}",
        says(&people)
    );
    let programs = onbrick(folder.path(), &["--json", "doctor", "--brick", "brick"]);
    let lines: Vec<serde_json::Value> = String::from_utf8_lossy(&programs.stdout)
        .lines()
        .map(|line| serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}")))
        .collect();
    let buttons = lines.iter().find(|line| line["check"] == "buttons").unwrap();
    assert_eq!(buttons["verdict"], "failed");
    assert_eq!(lines.iter().filter(|line| line["verdict"] == "failed").count(), 1, "{lines:?}");
    assert!(!folder.path().join("onbrick-runs").exists(), "doctor makes nothing");
}
