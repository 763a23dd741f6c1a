//! Our own program against a mounted brick.

use std::path::Path;
use std::process::{Command, Output};
use std::sync::Arc;

use onbrick::clock::{Clock, MILLISECOND_NS, MonotonicClock};
use onbrick::runtime::recording::Run;

use super::bench::{Mounted, real_time};

const PROGRAM: &str = env!("CARGO_BIN_EXE_onbrick");

#[test]
fn our_devices_command_finds_everything_on_a_mounted_brick() {
    let Some(mounted) = Mounted::in_world("arena", 1, Arc::new(MonotonicClock)) else { return };
    let output = Command::new(PROGRAM).args(["devices", "--brick"]).arg(mounted.root()).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    for device in
        ["lego-ev3-l-motor", "lego-ev3-m-motor", "lego-ev3-us", "lego-ev3-gyro", "voltage", "ev3-output-port"]
    {
        assert!(said.contains(device), "{device} in: {said}");
    }
}

#[test]
fn the_mapping_mission_drives_through_the_mount_and_knows_where_it_is() {
    let _alone = real_time();
    let folder = tempfile::tempdir().unwrap();
    // The loop rightly ends a run when it stood still for 200 ms. On a machine that is busy with other things that is no fault of the mount.
    for attempt in ["1", "2", "3"] {
        let Some(mounted) = Mounted::in_world("arena", 1, Arc::new(MonotonicClock)) else { return };
        let out = folder.path().join(attempt);
        let output = map(&mounted, &out);
        let said = String::from_utf8_lossy(&output.stdout);
        let complained = String::from_utf8_lossy(&output.stderr);
        if complained.contains("stood still for more than 200 ms") {
            println!("attempt {attempt}: {complained}");
            continue;
        }
        assert!(output.status.success(), "{said}{complained}");
        println!("{said}");
        return check(&mounted, &out);
    }
    panic!("this machine is too busy for a control loop");
}

fn map(mounted: &Mounted, out: &Path) -> Output {
    let start = mounted.observer.as_ref().unwrap().truth(0).unwrap();
    let pose = format!("{},{},{}", start.x_m, start.y_m, start.heading_rad.to_degrees());
    Command::new(PROGRAM)
        .args(["run", "map", "--set", "time_limit_s=8", "--pose", &pose, "--brick"])
        .arg(mounted.root())
        .arg("--out")
        .arg(out)
        .output()
        .unwrap()
}

fn check(mounted: &Mounted, out: &Path) {
    let run = Run::open(&out.join("run.mcap")).unwrap();
    let believed = run.poses.last().unwrap().pose;
    let truth = mounted.observer.as_ref().unwrap().truth(0).unwrap();
    let off_m = libm::hypot(believed.x_m - truth.x_m, believed.y_m - truth.y_m);
    println!("off by {off_m:.4} m after {:.2} m; {} points", truth.travelled_m, run.points.len());
    assert!(truth.travelled_m > 0.15, "it drove {} m", truth.travelled_m);
    assert!(run.points.len() > 20, "{} points", run.points.len());
    assert!(off_m < 0.03, "off by {off_m} m");
    for motor in ["motor0", "motor1", "motor2"] {
        let state = mounted.path(&format!("sys/class/tacho-motor/{motor}/state"));
        assert_eq!(std::fs::read_to_string(state).unwrap(), "\n", "{motor} was stopped");
    }
    MonotonicClock.sleep_until_ns(MonotonicClock.now_ns() + 300 * MILLISECOND_NS);
    let speed_mps = mounted.observer.as_ref().unwrap().truth(0).unwrap().speed_mps;
    assert!(speed_mps.abs() < 1e-3, "left standing still, not at {speed_mps} m/s");
}
