//! Replays of the shipped missions' recordings.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::Command;

use onbrick::mapping::Method;
use onbrick::recording::Run;
use onbrick::runtime::{Source, replay, replay_with};
use onbrick::sim::World;

use super::{Played, ROBOT, job, play, play_in};
use crate::support::tested_program;

#[test]
fn every_run_replays_bit_for_bit() {
    let runs = [
        ("map", "arena"),
        ("map", "rooms"),
        ("bump", "rooms"),
        ("wall", "wall"),
        ("line", "line"),
        ("edge", "table"),
        ("square", "open"),
    ];
    for (mission, world) in runs {
        let played = play_in(mission, world, 3);
        let run = played.run();
        let replayed = replay(&run).unwrap();
        println!("{mission} in {world}: {replayed}");
        assert!(replayed.is_same(), "{mission}: {replayed}");
        assert_eq!(replayed.ticks, played.ended.ticks);
        assert_eq!(replayed.poses, played.ended.ticks);
        assert_eq!(replayed.points, played.ended.points);
        assert_eq!(replayed.transitions, run.transitions.len() as u64);
    }
}

#[test]
fn promise_7_a_replay_goes_on_from_the_checkpoint_after_a_gap() {
    for (mission, world) in [("map", "arena"), ("bump", "rooms"), ("line", "line")] {
        let played = play_in(mission, world, 2);
        let whole = played.run();
        // Senses and everything made of them are gone for 3.3 seconds in the middle.
        let mut run = whole.clone();
        let lost = 1000..1165;
        run.senses.retain(|senses| !lost.contains(&senses.tick));
        run.poses.retain(|pose| !lost.contains(&pose.tick));
        run.transitions.retain(|transition| !lost.contains(&transition.tick));
        run.checkpoints.retain(|checkpoint| !lost.contains(&checkpoint.tick));
        let replayed = replay(&run).unwrap();
        println!("{mission}: {replayed}");
        assert_eq!(replayed.gaps, [(1000, 1164)]);
        assert!(replayed.is_same(), "{mission}: {replayed}");
        assert!(replayed.skipped > 0 && replayed.skipped <= 51, "{} skipped", replayed.skipped);
        assert_eq!(replayed.ticks + replayed.skipped + 165, whole.senses.len() as u64);
    }
}

#[test]
fn promise_7_a_damaged_chunk_is_a_gap_and_the_rest_replays() {
    let played = play_in("map", "arena", 2);
    let (run, missing) = without_a_chunk(&played);
    println!("{:?}", run.warnings);
    assert!(missing > 0 && missing <= 60, "{missing} ticks are missing");
    assert!(!run.warnings.is_empty());
    let replayed = replay(&run).unwrap();
    println!("{replayed}");
    assert_eq!(replayed.gaps.len(), 1, "{replayed}");
    assert!(replayed.is_same(), "{replayed}");
    assert!(replayed.ticks > 5_800, "{replayed}");
}

/// The run with one byte flipped within a chunk, which no longer has its checksum, and how many of
/// its ticks are missing. Between two chunks stand indexes, of which a reader needs none.
fn without_a_chunk(played: &Played) -> (Run, usize) {
    let ticks = played.run().senses.len();
    let flipped = |step: usize| {
        let mut bytes = played.bytes.clone();
        let within = bytes.len() / 3 + 1000 * step;
        bytes[within] ^= 0x10;
        let run = Run::read(&bytes).unwrap();
        let missing = ticks - run.senses.len();
        (run, missing)
    };
    (0..20).map(flipped).find(|(_, missing)| *missing > 0).expect("a chunk")
}

#[test]
fn exploring_replays_bit_for_bit_and_after_a_gap_as_far_as_it_can() {
    let played = play_in("explore", "arena", 2);
    let whole = played.run();
    let replayed = replay(&whole).unwrap();
    assert!(replayed.is_same() && replayed.gaps.is_empty(), "{replayed}");
    let (run, _) = without_a_chunk(&played);
    let replayed = replay(&run).unwrap();
    println!("{replayed}");
    assert_eq!(replayed.gaps.len(), 1, "{replayed}");
    // Poses and points are compared; the plans would need the map before the gap.
    assert!(replayed.is_same(), "{replayed}");
    assert!(replayed.poses > whole.senses.len() as u64 * 9 / 10, "{replayed}");
}

/// A checksum vouches for what was written, not for who wrote it: whatever bytes a checkpoint has,
/// no panic follows. At each place where a number can begin, in the states of missions that map,
/// plan, drive and play, stands one that no state has, and the run is replayed from there.
#[test]
fn promise_7_whatever_a_checkpoint_carries_a_replay_ends() {
    let others = [
        vec![0xff],
        vec![0x7f],
        f64::NAN.to_le_bytes().to_vec(),
        (-1e300_f64).to_le_bytes().to_vec(),
        i64::MIN.to_le_bytes().to_vec(),
        i64::MAX.to_le_bytes().to_vec(),
    ];
    for (mission, world) in [("explore", "arena"), ("dance", "open")] {
        let mut run = play_in(mission, world, 2).run();
        let at = run.checkpoints[run.checkpoints.len() / 2].clone();
        let followed = at.tick..at.tick + 20;
        run.senses.retain(|senses| senses.tick == 0 || followed.contains(&senses.tick));
        run.checkpoints.retain(|checkpoint| checkpoint.tick == at.tick);
        // What no tick of these is held against, each replay would sort again.
        run.poses.retain(|pose| followed.contains(&pose.tick));
        let until_ns = run.senses.last().unwrap().time_ns;
        run.points.retain(|point| (at.time_ns..=until_ns).contains(&point.time_ns));
        run.ending = None;
        assert_eq!(replay(&run).unwrap().ticks, 20, "{mission}: from the checkpoint");
        let mut failed = Vec::new();
        let places = (0..at.state.len()).flat_map(|at| others.iter().map(move |other| (at, other)));
        // CDR's numbers of eight bytes begin at a multiple of four, whatever stands before them.
        for (place, other) in places.filter(|(at, other)| at % other.len().min(4) == 0) {
            let state = &mut run.checkpoints[0].state;
            let Some(bytes) = state.get_mut(place..place + other.len()) else { continue };
            bytes.copy_from_slice(other);
            if catch_unwind(AssertUnwindSafe(|| replay(&run))).is_err() {
                failed.push((place, other));
            }
            run.checkpoints[0].state.clone_from(&at.state);
        }
        assert!(failed.is_empty(), "{mission}: of {} bytes {failed:?}", at.state.len());
    }
}

#[test]
fn another_robot_makes_another_path_of_the_same_ticks() {
    let played = play_in("square", "open", 1);
    let run = played.run();
    // Without a gyro, so that the track width decides about the heading.
    let narrow = ROBOT.replace("track_width_m = 0.1143", "track_width_m = 0.1100");
    let text = narrow.replace("[gyro]\nport = \"in4\"\n", "");
    assert!(text != narrow && narrow != ROBOT, "the shipped robot has both lines");
    let robot = Source { name: "narrow.toml".to_owned(), text };
    let file = played.folder.path().join("again.mcap");
    let remade = replay_with(&run, Some(&robot), None, &file).unwrap();
    println!("as recorded {:?}; {remade}", run.poses.last().unwrap().pose);
    assert_eq!(remade.ticks, played.ended.ticks);
    let again = Run::open(&file).unwrap();
    assert_eq!(again.senses.len(), run.senses.len());
    let last = run.poses.last().unwrap().pose;
    let off_m = libm::hypot(remade.end.x_m - last.x_m, remade.end.y_m - last.y_m);
    assert!(off_m > 0.05, "only {off_m} m apart");
    assert!(replay(&again).unwrap().is_same(), "what was remade replays too");
}

#[test]
fn the_same_robot_makes_the_same_map_again() {
    let played = play_in("map", "arena", 1);
    let run = played.run();
    let robot = Source { name: "robot.toml".to_owned(), text: ROBOT.to_owned() };
    let file = played.folder.path().join("again.mcap");
    replay_with(&run, Some(&robot), None, &file).unwrap();
    let again = Run::open(&file).unwrap();
    assert!(!run.keyframes.is_empty(), "walls have moved the points of the map");
    assert_eq!(again.keyframes, run.keyframes);
    assert_eq!(again.points_now(), run.points_now());
    assert_eq!(again.map, run.map);
}

#[test]
fn another_method_makes_another_path_of_the_same_ticks() {
    let played = play_in("map", "arena", 1);
    let run = played.run();
    let file = played.folder.path().join("again.mcap");
    let remade = replay_with(&run, None, Some(Method::Odometry), &file).unwrap();
    assert_eq!(remade.ticks, played.ended.ticks);
    let again = Run::open(&file).unwrap();
    assert_eq!(again.info.as_ref().unwrap().method, Method::Odometry);
    assert!(!run.keyframes.is_empty() && again.keyframes.is_empty(), "odometry is not corrected");
    assert_ne!(again.poses.last().unwrap().pose, run.poses.last().unwrap().pose);
    assert!(replay(&again).unwrap().is_same(), "what was remade replays too");
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_does_not() {
    let [first, again, other] = [7, 7, 8].map(|seed| play_in("map", "cylinders", seed));
    assert!(first.bytes == again.bytes, "two runs with seed 7 differ");
    assert!(first.bytes != other.bytes, "seeds 7 and 8 gave the same run");
    assert!(first.truths == again.truths);
}

#[test]
fn two_processes_make_the_same_bytes() {
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let [first, again] = folders.each_ref().map(|folder| {
        let done = Command::new(tested_program())
            .args(["--json", "demo", "--seconds", "30", "--seed", "5", "--out"])
            .arg(folder.path())
            .output()
            .unwrap();
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        ["run.mcap", "map.svg", "map.png", "points.csv", "path.csv"]
            .map(|name| std::fs::read(folder.path().join(name)).unwrap())
    });
    assert!(first == again, "two processes differ");
    // And the same as in this one.
    let text = World::text("arena").unwrap();
    let here = play(|file| {
        let mut job = job("explore", ROBOT, ("arena", text), 5, file);
        job.set.push(("time_limit_s".to_owned(), 30.0));
        job
    });
    let there = Run::read(&first[0]).unwrap();
    assert_eq!(here.run().poses, there.poses);
}
