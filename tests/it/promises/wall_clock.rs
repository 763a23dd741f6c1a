//! Promise 8: the wall clock jumps, runs backwards, stands at 1970: control does not notice, and
//! the order in the record is kept.

use std::process::Command;

use onbrick::recording::{Found, Run, walk};
use onbrick::runtime::replay;

use crate::support::pass_over;
use crate::support::promised::promised;
use crate::support::real_time::come_first;
use crate::support::stage::{Play, Played};
use crate::support::tested_program;
use crate::support::turning_brick::{TurningBrick, await_that};
use crate::support::wall_clock::{replace, shim};

const YEARS_NS: i64 = 31_556_952_000_000_000;

/// How often the real program is restarted if this machine made its loop late.
const ATTEMPTS: u32 = 8;

/// The log times of all messages, in the order of the file.
fn stamps(bytes: &[u8]) -> Vec<u64> {
    let mut stamps = Vec::new();
    walk(bytes, &mut |found| {
        if let Found::Message { header, .. } = found {
            stamps.push(header.log_time);
        }
    });
    stamps
}

/// Messages of a topic are in order, and so is what different topics say of different ticks: none
/// is more than a sync behind.
fn assert_in_order(bytes: &[u8], what: &str) {
    let run = Run::read(bytes).unwrap();
    assert!(
        run.senses.is_sorted_by(|a, b| a.time_ns < b.time_ns && a.tick + 1 == b.tick),
        "{what}: ticks"
    );
    assert!(run.poses.is_sorted_by(|a, b| a.time_ns < b.time_ns), "{what}: poses");
    assert!(run.logs.is_sorted_by(|a, b| a.time_ns <= b.time_ns), "{what}: log lines");
    let stamps = stamps(bytes);
    let (first, last) = (stamps[0], stamps[stamps.len() - 1]);
    assert!(
        stamps.iter().all(|stamp| (first..=last).contains(stamp)),
        "{what}: a stamp outside of the run"
    );
    let took_ns = run.senses.last().unwrap().time_ns;
    assert!(
        last - first <= took_ns.unsigned_abs() + 1_000_000_000,
        "{what}: {} ns of stamps in {took_ns} ns",
        last - first
    );
}

fn at(wall_offset_ns: i64) -> Played {
    Play { wall_offset_ns, ..Play::of("map", "arena", 5).seconds(6.0) }.play().unwrap()
}

#[test]
fn promise_8_whatever_the_wall_clock_says_at_the_start_the_run_is_the_same() {
    let usual = at(56 * YEARS_NS);
    let offsets = [0, 1, 262_000_000_000, 30 * YEARS_NS, 200 * YEARS_NS];
    for offset_ns in offsets {
        let other = at(offset_ns);
        assert_eq!(other.run().senses, usual.run().senses, "{offset_ns}");
        assert_eq!(other.run().poses, usual.run().poses, "{offset_ns}");
        assert_eq!(other.run().transitions, usual.run().transitions, "{offset_ns}");
        assert_in_order(&other.disk.bytes(), &offset_ns.to_string());
        assert!(replay(&other.run()).unwrap().is_same());
    }
    promised(&format!(
        "{} wall clocks from 1970 on at the start: the same ticks, poses and transitions to the \
         last bit",
        offsets.len() + 1
    ));
}

const STRAIGHT_ON: &str = "name = \"on\"\ntime_limit_s = 4\n[machine.drive]\nstart = \"on\"\n\
    final = \"halt\"\n[machine.drive.state.on]\n\
    do = { left_dps = 60, right_dps = 60 }\nnext = [{ when = \"time_s > 3.5\", go = \"halt\" }]\n\
    [machine.drive.state.halt]\n";

#[test]
#[cfg_attr(target_arch = "arm", ignore = "a static program takes no LD_PRELOAD")]
fn promise_8_a_wall_clock_that_jumps_under_the_running_program_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let Some(library) = shim(folder.path()) else { return };
    let _alone = crate::mount::bench::real_time();
    // What turns the brick's wheels: a run at real-time priority must not wait for it.
    println!("what turns the wheels comes first: {}", come_first());
    let mission = folder.path().join("on.toml");
    std::fs::write(&mission, STRAIGHT_ON).unwrap();
    let now = folder.path().join("now");
    for attempt in 1..=ATTEMPTS {
        let brick = TurningBrick::new();
        let out = folder.path().join(attempt.to_string());
        // As a brick wakes up that has no network and no battery for its clock.
        replace(&now, "@600");
        let mut command = Command::new(tested_program());
        command.arg("run").arg(&mission).arg("--brick").arg(brick.root()).arg("--out").arg(&out);
        command.env("LD_PRELOAD", &library).env("WALL_CLOCK", &now);
        command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped());
        let mut child = command.spawn().unwrap();
        await_that("the wheels turn, or the run is over", || {
            let turning = brick.commands().iter().skip(1).all(|command| command == "run-timed");
            turning || child.try_wait().unwrap().is_some()
        });
        let mut jumps = 0;
        // Forwards, backwards, to the true time and back to 1970, five times a second.
        while jumps < 15 {
            let text = ["+262", "-262", "+0", "@1", "-3600"][jumps % 5];
            replace(&now, text);
            std::thread::sleep(std::time::Duration::from_millis(200));
            jumps += 1;
        }
        let output = child.wait_with_output().unwrap();
        let said =
            String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
        if said.contains("stood still for more than 200 ms") || said.contains("a wheel is blocked")
        {
            println!("attempt {attempt}: {said}");
            continue;
        }
        assert!(output.status.success(), "{said}");
        let bytes = std::fs::read(out.join("run.mcap")).unwrap();
        let run = Run::read(&bytes).unwrap();
        assert!(
            stamps(&bytes)[0] < 3_600_000_000_000,
            "the program saw another clock: {}",
            stamps(&bytes)[0]
        );
        assert_in_order(&bytes, "jumps");
        assert!(
            run.senses.len() > 20 && run.ending.is_some(),
            "{} ticks, {:?}",
            run.senses.len(),
            run.ending
        );
        let replayed = replay(&run).unwrap();
        assert!(replayed.is_same(), "{replayed}");
        return promised(&format!(
            "real program, wall clock from 1970, {jumps} jumps by ±262 s, an hour and 56 years: {} \
             ticks in order",
            run.senses.len()
        ));
    }
    // The same is shown in virtual time above.
    pass_over("time for a control loop: this machine was too busy each time");
}
