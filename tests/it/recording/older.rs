//! Recordings of the releases before: a newer program reads what an older one recorded.
//!
//! Each release leaves one here, made by `onbrick run tests/data/recordings/VERSION.toml --sim
//! arena` with that release's program. Whether a replay repeats it bit for bit is not promised from
//! one version to the next.

use std::path::Path;

use onbrick::recording::Run;

/// What one has in it, as its own release printed it.
struct Kept {
    version: &'static str,
    ticks: usize,
    points: usize,
    transitions: usize,
    /// The last pose: metres and degrees.
    last: [f64; 3],
}

const KEPT: [Kept; 1] = [Kept {
    version: "0.1.0",
    ticks: 62,
    points: 41,
    transitions: 7,
    last: [-0.363_014, 0.079_160, 89.8153],
}];

#[test]
fn a_recording_of_every_release_is_read_whole() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/recordings");
    let files = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path());
    let recordings = files.filter(|path| path.extension().is_some_and(|end| end == "mcap"));
    assert_eq!(recordings.count(), KEPT.len(), "each has its row");
    for kept in KEPT {
        let path = folder.join(format!("{}.mcap", kept.version));
        let run = Run::open(&path).unwrap();
        assert_eq!(run.warnings, Vec::<String>::new());
        assert!(run.integrity.complete && run.integrity.damaged.is_empty());
        assert_eq!(run.info.as_ref().unwrap().version, kept.version);
        let counts = (run.senses.len(), run.points.len(), run.transitions.len());
        assert_eq!(counts, (kept.ticks, kept.points, kept.transitions), "{}", kept.version);
        let last = run.poses.last().unwrap().pose;
        let last = [last.x_m, last.y_m, last.heading_rad.to_degrees()];
        for (read, expected) in last.into_iter().zip(kept.last) {
            assert!((read - expected).abs() < 1e-4, "{last:?}");
        }
        assert!(run.transitions.iter().any(|row| row.machine == "drive" && row.to == "turn"));
        let mission = std::fs::read_to_string(folder.join(format!("{}.toml", kept.version)));
        assert_eq!(run.mission_toml, mission.ok());
        assert!(run.robot_toml.is_some() && run.world_toml.is_some() && run.map.is_some());
        assert!(run.ending.is_some());
        #[cfg(feature = "host")]
        for (command, made) in [("plot", "map.svg"), ("repair", "again.mcap")] {
            let folder = tempfile::tempdir().unwrap();
            let option = if command == "plot" { "--output" } else { "--out" };
            let path = path.to_str().unwrap();
            crate::commands::run(folder.path(), &[command, path, option, made]).expect(0);
        }
    }
}
