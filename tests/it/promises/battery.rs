//! Promise 6: a battery that runs down warns, slows the robot down, and ends the run with its
//! recording saved.

use std::process::Command;
use std::sync::Arc;

use onbrick::clock::MonotonicClock;
use onbrick::ev3dev::Technology;
use onbrick::recording::{Level, Run};
use onbrick::runtime::{StopReason, replay};
use onbrick::senses::Channel;

use crate::mount::bench::{Mounted, await_or_fail, real_time};
use crate::support::pass_over;
use crate::support::promised::promised;
use crate::support::real_time::come_first;
use crate::support::stage::{Play, Played};
use crate::support::tested_program;

const RAMP: &str = "[[battery]]\nat_s = 0\nfrom_v = 8.0\nto_v = 5.0\nover_s = 60\n";

fn run_down(cells: Technology) -> Played {
    let play = Play { cells, journal: true, ..Play::of("map", "arena", 3).seconds(100.0) };
    play.scenario(RAMP).play().unwrap()
}

/// How often the real program is restarted if this machine made its loop late.
const ATTEMPTS: u32 = 8;

/// When the recording's log says something, seconds, and the battery's voltage then.
fn said(run: &Run, what: &str) -> (f64, f64) {
    let line = run.logs.iter().find(|line| line.text.contains(what));
    let line = line.unwrap_or_else(|| panic!("nothing said `{what}`: {:?}", run.logs));
    assert!(line.level >= Level::Warn, "{line:?}");
    (onbrick::clock::seconds(line.time_ns), volts_at(run, line.time_ns))
}

fn volts_at(run: &Run, time_ns: i64) -> f64 {
    let before = run.senses.iter().take_while(|senses| senses.time_ns <= time_ns);
    before.last().and_then(|senses| senses.get(Channel::Battery)).unwrap().value
}

/// The fastest that a wheel was told to turn between two times of the run, counts per second.
fn fastest(played: &Played, from_s: f64, to_s: f64) -> i64 {
    let first_ns = played.writes.first().unwrap().time_ns;
    let wheels = played.writes.iter().filter(|write| {
        let at_s = onbrick::clock::seconds(write.time_ns - first_ns);
        // The head's motor is the first one.
        write.path.ends_with("/speed_sp")
            && !write.path.contains("motor0")
            && at_s >= from_s
            && at_s < to_s
    });
    let speeds = wheels
        .map(|write| String::from_utf8_lossy(&write.value).trim().parse::<i64>().unwrap().abs());
    speeds.max().unwrap()
}

#[test]
fn promise_6_a_battery_from_8_v_to_5_v_warns_slows_down_and_stops_in_time() {
    for (fed, cells, limits) in [
        (Technology::Unknown, "Unknown", [6.2, 5.5, 5.2]),
        (Technology::LiIon, "Li-ion", [7.1, 6.5, 6.2]),
    ] {
        let played = run_down(fed);
        let run = played.run();
        assert_eq!(run.info.as_ref().unwrap().cells.as_str(), cells);
        assert_eq!(played.reason, StopReason::Battery, "{:?}", run.logs);
        played.assert_at_rest("battery");
        let (low_s, low_v) = said(&run, "the battery is low");
        let (slow_s, slow_v) = said(&run, "very low");
        let (end_s, end_v) = said(&run, "the battery is empty");
        assert!(low_s < slow_s && slow_s < end_s, "{low_s} {slow_s} {end_s}");
        for (volts, limit_v) in [low_v, slow_v, end_v].into_iter().zip(limits) {
            // Three readings a second apart, at 0.05 V a second, and the sag of the motors.
            assert!(
                volts < limit_v && volts > limit_v - 0.4,
                "{volts} V at the threshold of {limit_v} V"
            );
        }
        assert!(end_v > 4.8, "{end_v} V: the kernel's least for AA cells");
        let (before, after) =
            (fastest(&played, 0.0, slow_s - 0.01), fastest(&played, slow_s - 0.01, end_s));
        assert!(
            after <= before / 2 + 1,
            "{cells}: {before}, and {after} counts a second when very low"
        );
        // All is on the disk, and the replay thinks the same.
        assert!(played.ended.recording.is_none() && run.integrity.complete && run.ending.is_some());
        let replayed = replay(&run).unwrap();
        assert!(replayed.is_same() && replayed.ticks == played.ended.ticks, "{replayed}");
        promised(&format!(
            "{cells}: warned at {low_v:.2} V, slowed from {before} to {after} counts/s at \
             {slow_v:.2} V, stopped at {end_v:.2} V, {} ticks replayed bit for bit",
            replayed.ticks
        ));
    }
}

#[test]
fn promise_6_a_replay_after_a_gap_knows_how_low_the_battery_was() {
    let played = run_down(Technology::Unknown);
    let mut bytes = played.disk.bytes();
    let run = played.run();
    let (slow_s, _) = said(&run, "very low");
    // One byte of the recording, a second after it got very low: what decides later is in the
    // checkpoints only.
    let share = (slow_s + 1.0) / played.drove_s;
    let place = (0..bytes.len()).find(|at| *at as f64 >= bytes.len() as f64 * share).unwrap();
    bytes[place] ^= 0x20;
    let damaged = Run::read(&bytes).unwrap();
    let replayed = replay(&damaged).unwrap();
    assert_eq!(replayed.gaps.len(), 1, "{replayed}");
    assert!(replayed.is_same() && replayed.skipped < 60, "{replayed}");
    promised(&format!("replay after a gap of ticks {:?}: the same", replayed.gaps[0]));
}

#[test]
fn promise_6_the_program_on_a_brick_stops_before_its_battery_is_flat() {
    let _alone = real_time();
    // What serves the brick's files: a run at real-time priority must not wait for it.
    println!("what serves the brick comes first: {}", come_first());
    let folder = tempfile::tempdir().unwrap();
    for attempt in 1..=ATTEMPTS {
        let Some(mounted) = Mounted::in_world("open", 1, Arc::new(MonotonicClock)) else { return };
        let out = folder.path().join(attempt.to_string());
        let mut child = Command::new(tested_program())
            .args(["run", "map", "--set", "time_limit_s=60", "--brick"])
            .arg(mounted.root())
            .arg("--out")
            .arg(&out)
            .stdout(std::process::Stdio::piped())
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        let driving = || {
            let truth = mounted.observer.as_ref().unwrap().truth(0).unwrap();
            truth.speed_mps.abs() > 0.01 || child.try_wait().unwrap().is_some()
        };
        await_or_fail("the robot drives", driving);
        mounted.simulation.control(0, "battery 8 5 8").unwrap();
        let output = child.wait_with_output().unwrap();
        let complained = String::from_utf8_lossy(&output.stderr);
        if complained.contains("stood still for more than 200 ms") {
            println!("attempt {attempt}: {complained}");
            continue;
        }
        assert_eq!(output.status.code(), Some(1), "{complained}");
        assert!(complained.contains("the battery is empty: charge it"), "{complained}");
        let run = Run::open(&out.join("run.mcap")).unwrap();
        assert!(run.warnings.is_empty() && run.ending.is_some(), "{:?}", run.warnings);
        let (end_s, end_v) = said(&run, "the battery is empty");
        assert!(replay(&run).unwrap().is_same());
        let speed_mps = || mounted.observer.as_ref().unwrap().truth(0).unwrap().speed_mps.abs();
        await_or_fail("a standstill", || speed_mps() < 1e-3);
        return promised(&format!(
            "real program on the mounted brick: stopped {end_s:.1} s after the start at {end_v:.2} \
             V, recording complete"
        ));
    }
    // The same is shown in virtual time above.
    pass_over("time for a control loop: this machine was too busy each time");
}
