//! Our own program against a mounted brick.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::sync::Arc;

use onbrick::clock::{Clock, MILLISECOND_NS, MonotonicClock};
use onbrick::recording::Run;

use super::bench::{Mounted, no_fuse, real_time};
use crate::support::real_time::{Pace, in_real_time};
use crate::support::tested_program;

#[test]
fn our_devices_command_finds_everything_on_a_mounted_brick() {
    let Some(mounted) = Mounted::in_world("arena", 1, Arc::new(MonotonicClock)) else { return };
    let output = Command::new(tested_program())
        .args(["devices", "--brick"])
        .arg(mounted.root())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    for device in [
        "lego-ev3-l-motor",
        "lego-ev3-m-motor",
        "lego-ev3-us",
        "lego-ev3-gyro",
        "voltage",
        "ev3-output-port",
    ] {
        assert!(said.contains(device), "{device} in: {said}");
    }
}

#[test]
fn the_mapping_mission_drives_through_the_mount_and_knows_where_it_is() {
    if no_fuse() {
        return;
    }
    let _alone = real_time();
    in_real_time("map through the mount", |pace| {
        let mounted = Mounted::in_world("arena", 1, Arc::new(MonotonicClock)).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let output = map(pace, &mounted, folder.path());
        let said = String::from_utf8_lossy(&output.stdout);
        println!("{said}");
        // The loop rightly ends a run when it stood still for 200 ms.
        let holds = output.status.success();
        pace.ensure(holds, || format!("{said}{}", String::from_utf8_lossy(&output.stderr)));
        if holds {
            check(pace, &mounted, folder.path());
        }
    });
}

fn map(pace: &Pace, mounted: &Mounted, out: &Path) -> Output {
    let start = mounted.observer.as_ref().unwrap().truth(0).unwrap();
    let pose = format!("{},{},{}", start.x_m, start.y_m, start.heading_rad.to_degrees());
    let run = Pace::command(tested_program())
        .args(["run", "map", "--set", "time_limit_s=12", "--pose", &pose, "--brick"])
        .arg(mounted.root())
        .arg("--out")
        .arg(out.join("out"))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    pace.watch(&run);
    run.wait_with_output().unwrap()
}

fn check(pace: &Pace, mounted: &Mounted, out: &Path) {
    let run = Run::open(&out.join("out/run.mcap")).unwrap();
    let believed = run.poses.last().unwrap().pose;
    let truth = mounted.observer.as_ref().unwrap().truth(0).unwrap();
    let off_m = libm::hypot(believed.x_m - truth.x_m, believed.y_m - truth.y_m);
    println!("off by {off_m:.4} m after {:.2} m; {} points", truth.travelled_m, run.points.len());
    pace.ensure(truth.travelled_m > 0.15, || format!("it drove {} m", truth.travelled_m));
    pace.ensure(run.points.len() > 20, || format!("{} points", run.points.len()));
    pace.near("metres off", off_m, 0.0, 0.03);
    for motor in ["motor0", "motor1", "motor2"] {
        let state = mounted.path(&format!("sys/class/tacho-motor/{motor}/state"));
        assert_eq!(std::fs::read_to_string(state).unwrap(), "\n", "{motor} was stopped");
    }
    MonotonicClock.sleep_ns(300 * MILLISECOND_NS);
    pace.near(
        "speed afterwards",
        mounted.observer.as_ref().unwrap().truth(0).unwrap().speed_mps,
        0.0,
        1e-3,
    );
}
