//! The brick's own program, for its own processor, under `qemu-arm -cpu arm926`: on a mounted
//! brick, and beside this PC's program on a simulated one. The other boards' program, under
//! `qemu-arm -cpu cortex-a7`, beside this PC's as well.
//!
//! `brick-image/build.sh` makes the programs. What it finds out about them by itself (format, size,
//! instructions, system calls) is not done again here.
//!
//! # Not here
//!
//! `onbrick run`: a program that is emulated so cannot start another one. The process that drives
//! is given its job directly, as `run` does.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command, Stdio};

use onbrick::ev3dev::LocalTree;
use onbrick::mapping::Pose;
use onbrick::recording::Run;
use onbrick::robot::DEFAULT_ROBOT;
use onbrick::runtime::{Brick, Ended, Event, Job, replay};
use onbrick::sim::World;

use crate::foreign::bench::Simulator;
use crate::foreign::median_off_m;
use crate::missions::job;
use crate::mount::bench::{no_fuse, real_time};
use crate::support::real_time::{Pace, in_real_time};
use crate::support::tested_program;
use crate::support::{not_asked_for, pass_over};

/// These tests are asked for, because what they run takes minutes to build: `brick-image/build.sh`,
/// then `ONBRICK_ARM=1 cargo test arm::`.
const ASKED_FOR: &str = "ONBRICK_ARM";

/// The same after `brick-image/build.sh --for armv7`.
const ARMV7_ASKED_FOR: &str = "ONBRICK_ARMV7";

/// The emulator's command for a program that `brick-image/build.sh` has left in a folder of
/// `target`.
fn emulated(program: &str, processor: &str) -> Option<[String; 4]> {
    let folder = Path::new(env!("CARGO_BIN_EXE_onbrick")).parent()?.parent()?;
    let file = folder.join(program);
    let emulator = Command::new("qemu-arm").arg("--version").output();
    if !file.exists() || emulator.is_err() {
        pass_over(&format!(
            "{program} and qemu-arm: brick-image/build.sh makes the one and installs the other"
        ));
        return None;
    }
    Some(["qemu-arm", "-cpu", processor, file.to_str()?].map(str::to_owned))
}

/// Hands a job to a process that drives; its last word.
fn drive(pace: &Pace, command: &[String], job: &Job) -> Option<Ended> {
    let mut process = Pace::command(&command[0])
        .args(&command[1..])
        .arg("control")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    pace.watch(&process);
    let mut orders = process.stdin.take().unwrap();
    orders.write_all(&[serde_json::to_vec(job).unwrap().as_slice(), b"\n"].concat()).unwrap();
    let said = BufReader::new(process.stdout.take().unwrap()).lines().map(Result::unwrap);
    let last = said.filter(|line| !line.is_empty()).last().unwrap_or_default();
    assert!(process.wait().unwrap().success(), "{last}");
    let event = serde_json::from_str(&last);
    // Until here the pipe was open: the starter was there.
    drop(orders);
    match event.unwrap_or_else(|error| panic!("{error} in {last}")) {
        Event::Ended(ended) if ended.stop.reason.is_wanted() => Some(ended),
        // The loop rightly ends a run that was kept from the processor for long.
        other => {
            pace.ensure(false, || format!("{other:?}"));
            None
        }
    }
}

#[test]
fn the_bricks_program_maps_a_mounted_room_as_well_as_this_pcs_does() {
    if not_asked_for(ASKED_FOR) {
        return;
    }
    if no_fuse() {
        return;
    }
    let Some(brick) = emulated("brick/onbrick", "arm926") else { return };
    let _alone = real_time();
    in_real_time("ARM through the mount", |pace| map_a_room(pace, &brick));
}

fn map_a_room(pace: &Pace, brick: &[String]) {
    // Longs of the brick's programs have 32 bits.
    let simulator = Simulator::start_with(pace, "arena", &["--event-bits", "32"]);
    let start = simulator.truth();
    let start =
        Pose { x_m: start.x_m, y_m: start.y_m, heading_rad: start.heading_deg.to_radians() };
    let folder = tempfile::tempdir().unwrap();
    let job = Job {
        brick: Brick::Local(LocalTree::new(simulator.root())),
        start,
        ..short_job(folder.path(), "arm")
    };
    let Some(ended) = drive(pace, brick, &job) else { return };
    println!("{ended}");
    let run = Run::open(&job.file).unwrap();
    let (believed, truth) = (run.poses.last().unwrap().pose, simulator.truth());
    let off_m = libm::hypot(believed.x_m - truth.x_m, believed.y_m - truth.y_m);
    println!("off by {off_m:.4} m after {:.2} m", truth.travelled_m);
    pace.ensure(truth.travelled_m > 0.15, || format!("it drove {} m", truth.travelled_m));
    pace.near("metres off", off_m, 0.0, 0.03);
    let from_walls_m = median_off_m(&run);
    pace.near(
        "metres from a wall, half of the points",
        from_walls_m.unwrap_or(f64::INFINITY),
        0.0,
        0.05,
    );
    let in_process = short_job(folder.path(), "pc");
    if drive(pace, &[tested_program().to_owned()], &in_process).is_some() {
        let most_m = median_off_m(&Run::open(&in_process.file).unwrap()).map(|m| 1.5 * m + 0.005);
        pace.ensure(from_walls_m <= most_m, || {
            format!("ARM, mounted: {from_walls_m:?} m, not {most_m:?} m")
        });
    }
    let replayed = replay(&run).unwrap();
    assert!(replayed.is_same(), "on this PC it replays otherwise: {replayed}");
}

#[test]
fn the_same_mission_is_recorded_on_the_bricks_processor_byte_for_byte() {
    if not_asked_for(ASKED_FOR) {
        return;
    }
    records_what_a_pc_records("emulator/onbrick-sim", "arm926");
}

#[test]
fn the_same_mission_is_recorded_on_other_boards_processors_byte_for_byte() {
    if not_asked_for(ARMV7_ASKED_FOR) {
        return;
    }
    records_what_a_pc_records("emulator-armv7/onbrick-sim", "cortex-a7");
}

fn records_what_a_pc_records(program: &str, processor: &str) {
    let Some(brick) = emulated(program, processor) else { return };
    let folder = tempfile::tempdir().unwrap();
    in_real_time("ARM and PC", |pace| {
        let recorded = |command: &[String], name: &str| -> Option<Vec<u8>> {
            let job = short_job(folder.path(), name);
            drive(pace, command, &job).map(|_| std::fs::read(&job.file).unwrap())
        };
        let pc = recorded(&[tested_program().to_owned()], "pc").unwrap();
        let arm = recorded(&brick, "arm").unwrap();
        let same = pc.iter().zip(&arm).take_while(|(pc, arm)| pc == arm).count();
        assert!(
            pc == arm,
            "{} and {} bytes, of which the first {same} are the same",
            pc.len(),
            arm.len()
        );
        println!("{} bytes are the same", pc.len());
    });
}

/// Ten seconds of the mapping mission in the simulated arena.
fn short_job(folder: &Path, name: &str) -> Job {
    let file = folder.join(format!("{name}.mcap"));
    // A point waits for the sweep that tells what it was: about three are placed in a second.
    let set = vec![("time_limit_s".to_owned(), 30.0)];
    Job { set, ..job("map", DEFAULT_ROBOT, ("arena", World::text("arena").unwrap()), 7, file) }
}
