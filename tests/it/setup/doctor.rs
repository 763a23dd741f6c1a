//! `doctor`: a good brick is in order, and what is sabotaged is named.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use nix::errno::Errno;

use super::*;
use onbrick::commissioning::{Diagnosis, Patient, Verdict, examine};
use onbrick::ev3dev::{Access, AttributeFile};
use onbrick::runtime::HardwareLock;
use onbrick::sim::{Fault, Physics, Port};

/// 2026, for a clock that stands right.
const NOW_NS: i64 = 1_790_000_000 * SECOND_NS;

fn shipped() -> Source {
    Source { name: "robot.toml".to_owned(), text: DEFAULT_ROBOT.to_owned() }
}

/// What is around the brick; usually all is well.
struct Around {
    robot: Result<Source, String>,
    root: Option<PathBuf>,
    recordings: PathBuf,
    missions: Option<PathBuf>,
    wall_ns: i64,
}

/// Looks at a bench; `change` makes something else of what is usual.
fn look(bench: &Bench, change: impl FnOnce(&mut Around)) -> Diagnosis {
    let folder = tempfile::tempdir().unwrap();
    let mut around = Around {
        robot: Ok(shipped()),
        root: None,
        recordings: folder.path().to_owned(),
        missions: None,
        wall_ns: NOW_NS,
    };
    change(&mut around);
    examine(&Patient {
        tree: &bench.tree,
        clock: &*bench.clock,
        flags: &bench.flags,
        robot: around.robot.as_ref().map_err(|why| (why.as_str(), "onbrick setup")),
        root: around.root.as_deref(),
        recordings: &around.recordings,
        missions: around.missions.as_deref(),
        wall_ns: around.wall_ns,
    })
}

/// A brick's files without the speaker's, which cannot be opened.
#[derive(Debug)]
struct Mute {
    tree: Arc<dyn Tree>,
    errno: Errno,
}

impl Tree for Mute {
    fn list(&self, folder: &str) -> Result<Vec<String>, Errno> {
        self.tree.list(folder)
    }

    fn open(&self, path: &str, access: Access) -> Result<Box<dyn AttributeFile>, Errno> {
        if Some(path) == EV3.speaker { Err(self.errno) } else { self.tree.open(path, access) }
    }

    fn root(&self) -> &Path {
        self.tree.root()
    }

    fn local_path(&self, path: &str) -> Option<PathBuf> {
        self.tree.local_path(path)
    }
}

/// The one line that says so, with what it says.
fn line(diagnosis: &Diagnosis, check: &str, verdict: Verdict) -> String {
    let lines: Vec<String> = diagnosis
        .checks
        .iter()
        .filter(|checked| checked.check == check && checked.verdict == verdict)
        .map(ToString::to_string)
        .collect();
    assert_eq!(lines.len(), 1, "{check} {verdict:?} in\n{}", text(diagnosis));
    lines[0].clone()
}

fn text(diagnosis: &Diagnosis) -> String {
    diagnosis.checks.iter().map(|checked| format!("{checked}\n")).collect()
}

/// A brick with one thing wrong: exactly this check fails, and says what to do.
fn fails(bench: &Bench, check: &str, expected: [&str; 2], change: impl FnOnce(&mut Around)) {
    let diagnosis = look(bench, change);
    let line = line(&diagnosis, check, Verdict::Failed);
    for words in expected {
        assert!(line.contains(words), "`{words}` is not in `{line}`");
    }
    assert_eq!(diagnosis.count(Verdict::Failed), 1, "{}", text(&diagnosis));
}

#[test]
fn a_good_brick_is_in_order_and_nothing_moves() {
    let bench = Bench::new("", 1);
    bench.simulation.record_writes(true);
    let before = bench.truth();
    let diagnosis = look(&bench, |_| ());
    println!("{}", text(&diagnosis));
    assert_eq!(diagnosis.count(Verdict::Failed), 0, "{}", text(&diagnosis));
    for check in [
        "robot.toml",
        "brick",
        "lock",
        "drive.left",
        "drive.right",
        "head",
        "range",
        "gyro",
        "battery",
        "buttons",
        "lights",
        "speaker",
        "disk",
        "clock",
    ] {
        line(&diagnosis, check, Verdict::Ok);
    }
    assert!(
        line(&diagnosis, "robot.toml", Verdict::Ok)
            .contains("-> onbrick calibrate measures the gyro")
    );
    assert_eq!(before.wheels_rad, bench.truth().wheels_rad);
    let writes = bench.simulation.take_writes();
    assert!(writes.iter().all(|write| !write.path.contains("motor")), "{writes:?}");
}

#[test]
fn a_robot_whose_gyro_was_measured_is_not_told_to_calibrate() {
    let bench = Bench::new("", 1);
    let text = DEFAULT_ROBOT.replacen("# scale = 1.0 ", "scale = 1.02 ", 1);
    let robot = Source { text, ..shipped() };
    let diagnosis = look(&bench, |around| around.robot = Ok(robot));
    assert!(!line(&diagnosis, "robot.toml", Verdict::Ok).contains("->"));
}

#[test]
fn what_is_not_plugged_in_where_the_file_says_is_named() {
    let bench = Bench::new("[robot.ports]\nin4 = \"none\"\n", 1);
    fails(&bench, "gyro", ["no gyro sensor on in4", "plug it in there"], |_| ());
    let bench = Bench::new("[robot.ports]\noutD = \"none\"\noutC = \"large\"\n", 1);
    fails(&bench, "drive.right", ["on outD", "onbrick setup"], |_| ());
    let bench = Bench::new("[robot.ports]\nin1 = \"touch\"\n", 1);
    fails(&bench, "range", ["lego-ev3-touch", "plug it in there"], |_| ());
}

#[test]
fn a_gyro_that_drifts_and_a_flat_battery_are_seen() {
    let bench = Bench::new("[robot.errors]\ngyro_drift_dps = 4.0\n", 1);
    fails(&bench, "gyro", ["drifts", "unplug it, hold the robot still"], |_| ());
    let bench = Bench::new("", 1);
    bench.simulation.inspect(|world: &mut WorldPhysics| world.fail(0, Fault::BatteryV(5.4)));
    fails(&bench, "battery", ["V -> charge it", "at least 5.5 V"], |_| ());
    bench.simulation.inspect(|world: &mut WorldPhysics| world.fail(0, Fault::BatteryV(6.0)));
    let diagnosis = look(&bench, |_| ());
    assert!(line(&diagnosis, "battery", Verdict::Warning).contains("is low"));
}

#[test]
fn a_speaker_that_cannot_be_opened_is_a_warning_with_the_way_out() {
    for (errno, way_out) in [
        (Errno::EACCES, "sudo usermod -aG input USER"),
        (Errno::ENOENT, "is this an EV3 under ev3dev"),
    ] {
        let mut bench = Bench::new("", 1);
        bench.tree = Arc::new(Mute { tree: bench.tree, errno });
        let diagnosis = look(&bench, |_| ());
        let mute = line(&diagnosis, "speaker", Verdict::Warning);
        assert!(
            mute.contains("a run starts without its beeps") && mute.contains(way_out),
            "{errno}: {mute}"
        );
        // A run does without.
        assert_eq!(diagnosis.count(Verdict::Failed), 0, "{}", text(&diagnosis));
    }
}

#[test]
fn a_taken_lock_says_who_has_it_and_no_mode_is_written_then() {
    let bench = Bench::new("", 1);
    let root = tempfile::tempdir().unwrap();
    let lock = HardwareLock::take(root.path(), "mission map").unwrap();
    // The ultrasonic sensor is in another mode: doctor would have to change it.
    let file = bench.tree.list("sys/class/lego-sensor").unwrap().into_iter().find_map(|name| {
        let path = format!("sys/class/lego-sensor/{name}");
        let driver = bench.tree.open(&format!("{path}/driver_name"), Access::Read).unwrap();
        let mut text = [0; 64];
        let count = driver.read(&mut text).unwrap();
        (&text[..count] == b"lego-ev3-us\n").then_some(format!("{path}/mode"))
    });
    let mode = bench.tree.open(&file.unwrap(), Access::ReadWrite).unwrap();
    mode.write(b"US-LISTEN").unwrap();
    bench.pass(1.0);
    bench.simulation.record_writes(true);
    let diagnosis = look(&bench, |around| around.root = Some(root.path().to_owned()));
    let taken = line(&diagnosis, "lock", Verdict::Failed);
    assert!(taken.contains("mission map") && taken.contains("onbrick halt --brick /"), "{taken}");
    assert!(
        line(&diagnosis, "range", Verdict::Failed).contains("another program has it"),
        "{}",
        text(&diagnosis)
    );
    assert_eq!(bench.simulation.take_writes(), []);
    drop(lock);
    let diagnosis = look(&bench, |around| around.root = Some(root.path().to_owned()));
    assert_eq!(diagnosis.count(Verdict::Failed), 0, "{}", text(&diagnosis));
    assert_eq!(HardwareLock::owner(root.path()).unwrap(), None, "doctor gives the hardware back");
}

#[test]
fn a_motor_that_another_program_runs_is_seen_and_left_alone() {
    let bench = Bench::new("", 1);
    let motor = onbrick::ev3dev::TachoMotor::at(&bench.tree, &"outB".parse().unwrap()).unwrap();
    motor.set_speed_sp(200).unwrap();
    motor.command(onbrick::ev3dev::TachoCommand::RunForever).unwrap();
    bench.pass(0.5);
    let diagnosis = look(&bench, |_| ());
    assert!(
        line(&diagnosis, "drive.left", Verdict::Failed)
            .contains("is running -> another program drives it")
    );
    let before = bench.truth();
    bench.pass(0.5);
    assert_ne!(before.wheels_rad, bench.truth().wheels_rad, "it is not ours to stop");
    motor.stop().unwrap();
    bench.pass(1.0);
    let diagnosis = look(&bench, |_| ());
    assert!(line(&diagnosis, "drive.left", Verdict::Ok).contains("lego-ev3-l-motor on outB"));
}

#[test]
fn a_sensor_that_is_pulled_while_it_is_watched_is_lost() {
    let bench = Bench::new("", 1);
    bench.simulation.unplug(0, Port::In4).unwrap();
    let diagnosis = look(&bench, |_| ());
    assert!(line(&diagnosis, "gyro", Verdict::Failed).contains("in4"), "{}", text(&diagnosis));
}

#[test]
fn recordings_that_cannot_be_written_are_said_before_a_run() {
    let bench = Bench::new("", 1);
    let folder = tempfile::tempdir().unwrap();
    // Root writes everywhere but into a folder that is none.
    let file = folder.path().join("runs");
    std::fs::write(&file, "no folder").unwrap();
    fails(&bench, "disk", ["cannot be written to", "another folder"], |around| {
        around.recordings = file.clone()
    });
    if nix::unistd::geteuid().is_root() {
        println!("root may write into a read-only folder: its permissions are not tried");
    } else {
        let read_only = folder.path().join("read-only");
        std::fs::create_dir(&read_only).unwrap();
        std::fs::set_permissions(&read_only, std::fs::Permissions::from_mode(0o555)).unwrap();
        fails(&bench, "disk", ["cannot be written to", "another folder"], |around| {
            around.recordings = read_only
        });
    }
    // A missing folder will be made, where its parent can be written to.
    let fresh = folder.path().join("not/there/yet");
    let diagnosis = look(&bench, |around| around.recordings = fresh);
    assert_eq!(diagnosis.count(Verdict::Failed), 0, "{}", text(&diagnosis));
    assert!(!folder.path().join("not").exists(), "doctor makes nothing");
}

#[test]
fn a_robot_file_that_is_missing_or_wrong_is_said_and_the_rest_is_looked_at() {
    let bench = Bench::new("", 1);
    fails(&bench, "robot.toml", ["cannot read robot.toml", "onbrick setup"], |around| {
        around.robot = Err("cannot read robot.toml: no such file".to_owned());
    });
    let wrong = robot_with("track_width_m", "track_widht_m");
    let diagnosis = look(&bench, |around| around.robot = Ok(wrong));
    let found = text(&diagnosis);
    assert!(
        found.contains("did you mean `track_width_m`?") && found.contains("line 15"),
        "{found}"
    );
    line(&diagnosis, "battery", Verdict::Ok);
}

#[test]
fn a_clock_that_woke_up_in_1970_is_a_warning() {
    let bench = Bench::new("", 1);
    let diagnosis = look(&bench, |around| around.wall_ns = 40 * SECOND_NS);
    assert!(line(&diagnosis, "clock", Verdict::Warning).contains("it is 1970"));
}

#[test]
fn missions_are_checked_for_this_robot() {
    let bench = Bench::new("", 1);
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    let good = onbrick::behavior::shipped::find("map").unwrap().text;
    write("a-map.toml", good);
    write("b-broken.toml", &good.replace("range_m", "rnage_m"));
    write("notes.txt", "not a mission");
    let diagnosis = look(&bench, |around| around.missions = Some(folder.path().to_owned()));
    assert!(line(&diagnosis, "mission", Verdict::Ok).contains("a-map.toml"));
    let broken = line(&diagnosis, "mission", Verdict::Failed);
    assert!(broken.contains("b-broken.toml line") && broken.contains("onbrick check"), "{broken}");
    let diagnosis = look(&bench, |around| around.missions = Some("not/there".into()));
    assert!(line(&diagnosis, "missions", Verdict::Failed).contains("not/there"));
}

#[test]
fn no_brick_at_all_is_said_with_the_way_out() {
    let bench = Bench::new("", 1);
    let folder = tempfile::tempdir().unwrap();
    let empty: Arc<dyn Tree> = Arc::new(onbrick::ev3dev::LocalTree::new(folder.path()));
    let robot = shipped();
    let patient = Patient {
        tree: &empty,
        clock: &*bench.clock,
        flags: &bench.flags,
        robot: Ok(&robot),
        root: None,
        recordings: folder.path(),
        missions: None,
        wall_ns: NOW_NS,
    };
    let diagnosis = examine(&patient);
    assert!(line(&diagnosis, "brick", Verdict::Failed).contains("--brick"), "{}", text(&diagnosis));
    // What is not there is not looked for one by one.
    assert_eq!(diagnosis.count(Verdict::Failed), 1, "{}", text(&diagnosis));
    bench.flags.signal.store(true, Ordering::Relaxed);
    let stopped = examine(&patient);
    assert_eq!(stopped.checks.len(), 1, "{}", text(&stopped));
}
