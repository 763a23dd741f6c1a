//! `plot`, `export`, `replay`: finished runs, whole, cut and changed.

use std::path::Path;
use std::sync::OnceLock;

use onbrick::recording::{self, End, Options, Pace, ReadError, Recorder, Run, Start};
use onbrick::report::{Track, export};
use onbrick::runtime::{ReplayError, StopReason, replay};

use super::{keys, names, run};
use crate::recording::sample::{start, tick};
use crate::support::exported::exported_grid;
use crate::support::tested_program;

/// A folder with two recordings of the simulated brick, `left.mcap` and `right.mcap`, made once.
fn recorded() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        for (name, seed) in [("left", "1"), ("right", "2")] {
            let arguments = [
                "run",
                "map",
                "--sim",
                "arena",
                "--set",
                "time_limit_s=4",
                "--seed",
                seed,
                "--out",
                name,
            ];
            run(folder.path(), &arguments).expect(0);
            let file = format!("{name}/run.mcap");
            std::fs::rename(folder.path().join(file), folder.path().join(format!("{name}.mcap")))
                .unwrap();
        }
        folder
    });
    folder.path()
}

/// A folder of the test's own with both recordings in it.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in ["left.mcap", "right.mcap"] {
        std::fs::copy(recorded().join(name), folder.path().join(name)).unwrap();
    }
    folder
}

#[test]
fn plot_draws_one_run_and_several_in_every_format() {
    let folder = folder();
    for (ending, begins) in [
        ("svg", &b"<svg"[..]),
        ("png", b"\x89PNG"),
        ("pdf", b"%PDF-"),
        ("html", b"<!DOCTYPE html>"),
    ] {
        for (runs, name) in [(&["left.mcap"][..], "one"), (&["left.mcap", "right.mcap"], "both")] {
            let file = format!("{name}.{ending}");
            let arguments = [&["plot"], runs, &["-o", &file]].concat();
            let said = run(folder.path(), &arguments).expect(0);
            assert_eq!((said.out, said.err), (format!("wrote {file}\n"), String::new()));
            let drawn = std::fs::read(folder.path().join(&file)).unwrap();
            assert!(drawn.to_ascii_lowercase().starts_with(&begins.to_ascii_lowercase()), "{file}");
        }
    }
    let json =
        run(folder.path(), &["plot", "left.mcap", "-o", "j.SVG", "--title", "A & B", "--json"])
            .expect(0);
    assert_eq!(json.json(), [serde_json::json!({ "wrote": "j.SVG" })]);
    let titled = std::fs::read_to_string(folder.path().join("j.SVG")).unwrap();
    assert!(titled.contains("A &amp; B"), "a title is text, not markup");
    let said = run(folder.path(), &["plot", "left.mcap", "-o", "no/where.svg"]).expect(1);
    assert!(said.err.contains("no/where.svg"), "{}", said.err);
}

#[test]
fn plot_draws_signals_with_states_and_what_happened_in_every_format() {
    let folder = folder();
    for (ending, begins) in [
        ("svg", &b"<svg"[..]),
        ("png", b"\x89PNG"),
        ("pdf", b"%PDF-"),
        ("html", b"<!doctype html>"),
    ] {
        let file = format!("signals.{ending}");
        let signals = ["--signals", "range_m,heading_deg,x_m,do.left_dps"];
        let arguments = [&["plot", "left.mcap", "-o", &file][..], &signals].concat();
        let said = run(folder.path(), &arguments).expect(0);
        assert_eq!((said.out, said.err), (format!("wrote {file}\n"), String::new()));
        let drawn = std::fs::read(folder.path().join(&file)).unwrap();
        let begins = begins.to_ascii_lowercase();
        assert!(drawn.to_ascii_lowercase().starts_with(&begins), "{file}");
    }
    let svg = std::fs::read_to_string(folder.path().join("signals.svg")).unwrap();
    for word in ["mapper: map", "drive", "look", "forward", "x_m   in m", "heading_deg   in °"] {
        assert!(svg.contains(&format!("\n{word}\n")), "`{word}` is not in the picture");
    }
    assert!(svg.contains("time in seconds") && !svg.contains("x in metres"));
    // A name that is not known: the nearest, and all.
    let said = run(folder.path(), &["plot", "left.mcap", "-o", "x.svg", "--signals", "rangem"]);
    let said = said.expect(2);
    assert!(said.err.contains("the run has no signal `rangem`"), "{}", said.err);
    assert!(said.err.contains("did you mean `range_m`?"), "{}", said.err);
    assert!(said.err.contains("one of left_deg, right_deg, head_deg, range_m"), "{}", said.err);
    assert!(!folder.path().join("x.svg").exists());
    let both = ["plot", "left.mcap", "right.mcap", "-o", "x.svg", "--signals", "range_m"];
    assert!(run(folder.path(), &both).expect(2).err.contains("one run"));
}

#[test]
fn a_named_sensor_is_a_signal_as_in_conditions() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    let robot = onbrick::robot::DEFAULT_ROBOT
        .replace("[colour]\nport", "[sensor.eye]\nmeasures = \"reflect_pct\"\nport");
    write("robot.toml", &robot);
    write(
        "look.toml",
        "name = \"look\"\ntime_limit_s = 1\n[machine.m.state.look]\n\
         do = { forward_mps = 0.05, say = \"{sensor.eye}\" }\n",
    );
    run(folder.path(), &["run", "look.toml", "--sim", "open", "--out", "out"]).expect(0);
    let signals = ["--signals", "sensor.eye, x_m"];
    let drawn = [&["plot", "out/run.mcap", "-o", "eye.svg"][..], &signals].concat();
    run(folder.path(), &drawn).expect(0);
    run(folder.path(), &["export", "out/run.mcap", "--format", "csv", "--out", "csv"]).expect(0);
    let csv = std::fs::read_to_string(folder.path().join("csv/signals.csv")).unwrap();
    let column = csv.lines().next().unwrap().split(',').position(|name| name == "sensor.eye");
    let row: Vec<&str> = csv.lines().last().unwrap().split(',').collect();
    let reflect_pct: f64 = row[column.unwrap()].parse().unwrap();
    assert!((10.0..=90.0).contains(&reflect_pct), "{reflect_pct} % of a grey floor");
}

#[test]
fn robots_of_one_name_are_told_apart_by_their_recordings() {
    let folder = folder();
    run(folder.path(), &["plot", "left.mcap", "right.mcap", "-o", "both.svg"]).expect(0);
    let svg = std::fs::read_to_string(folder.path().join("both.svg")).unwrap();
    for name in ["left", "right", "left, right: map"] {
        assert!(svg.contains(&format!("\n{name}\n")), "`{name}` is not in the picture");
    }
    assert!(!svg.contains("\nmapper\n"), "both are called so");
}

#[test]
fn signals_in_a_table_are_what_was_recorded_a_row_a_tick() {
    let folder = folder();
    run(folder.path(), &["export", "left.mcap", "right.mcap", "--format", "csv"]).expect(0);
    let table = std::fs::read_to_string(folder.path().join("signals.csv")).unwrap();
    let mut lines = table.lines();
    let head: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column = |name: &str| {
        head.iter().position(|known| *known == name).unwrap_or_else(|| panic!("{name}: {head:?}"))
    };
    let rows: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    let recorded = Run::open(&folder.path().join("left.mcap")).unwrap();
    let left: Vec<_> = rows.iter().filter(|row| row[column("robot")] == "left").collect();
    assert_eq!(left.len(), recorded.senses.len());
    assert!(rows.len() > left.len(), "the other run is in the table, too");
    let number = |row: &[&str], name: &str| row[column(name)].parse::<f64>().unwrap();
    for (row, pose) in left.iter().zip(&recorded.poses) {
        assert!((number(row, "x_m") - pose.pose.x_m).abs() < 1e-6, "{row:?}");
        assert!((number(row, "travelled_m") - pose.travelled_m).abs() < 1e-6, "{row:?}");
    }
    // The wheels were told to turn before they did.
    let speed = |row: &&Vec<&str>| number(row, "do.left_dps") > 10.0;
    let moves = left.iter().position(speed).expect("it drove");
    assert!(number(left[moves], "left_deg").abs() < 0.5, "{:?}", left[moves]);
    assert!(number(left.last().unwrap(), "left_deg") > 5.0);
    for transition in &recorded.transitions {
        let tick = usize::try_from(transition.tick).unwrap();
        let name = format!("{}.state", transition.machine);
        assert_eq!(left[tick][column(&name)], transition.to, "{transition:?}");
    }
}

#[test]
fn export_writes_every_format() {
    let folder = folder();
    for (format, files) in [
        ("csv", &["path.csv", "points.csv", "signals.csv", "walls.csv"][..]),
        ("ply", &["points.ply"]),
        ("pgm", &["map.pgm", "map.yaml"]),
    ] {
        let said =
            run(folder.path(), &["export", "left.mcap", "--format", format, "--out", format])
                .expect(0);
        assert_eq!(names(&folder.path().join(format)), files, "{}", said.out);
        assert_eq!(said.out.lines().count(), files.len());
    }
    // A run that saw nothing has a path alone; one that was cut at once has not even that.
    let square = ["run", "square", "--sim", "open", "--set", "time_limit_s=1", "--out", "open"];
    run(folder.path(), &square).expect(0);
    run(folder.path(), &["export", "open/run.mcap", "--format", "csv", "--out", "o"]).expect(0);
    let signals = std::fs::read_to_string(folder.path().join("o/signals.csv")).unwrap();
    assert!(signals.lines().next().unwrap().contains(",range_m,"), "{signals:.300}");
    let whole = std::fs::read(folder.path().join("left.mcap")).unwrap();
    std::fs::write(folder.path().join("cut.mcap"), &whole[..3000]).unwrap();
    for (arguments, told) in [
        (&["plot", "open/run.mcap", "-o", "walls.dxf"][..], "no wall of 30 cm was found"),
        (&["export", "open/run.mcap", "--format", "ply", "--out", "no"], "no point was found"),
        (&["export", "cut.mcap", "--format", "csv", "--out", "no"], "neither path nor points"),
        (&["export", "cut.mcap", "--format", "ply", "--out", "no"], "neither path nor points"),
        (&["export", "cut.mcap", "--format", "pgm", "--out", "no"], "neither path nor points"),
    ] {
        let said = run(folder.path(), arguments).expect(3).err;
        assert!(said.contains(told) && said.contains("  try: "), "{arguments:?}: {said}");
    }
    assert!(["walls.dxf", "no"].iter().all(|name| !folder.path().join(name).exists()));
}

#[test]
fn the_grid_of_several_runs_has_the_floor_of_each() {
    let folder = folder();
    let export = ["export", "left.mcap", "right.mcap", "--format", "pgm", "--out", "both"];
    run(folder.path(), &export).expect(0);
    let both = exported_grid(&folder.path().join("both"));
    let steps = || (-80..80).map(|step| f64::from(step) * 0.05);
    let free_of = |grid: &dyn Fn(f64, f64) -> Option<u8>| {
        steps()
            .flat_map(|x| steps().map(move |y| grid(x, y)))
            .filter(|cell| *cell == Some(254))
            .count()
    };
    for name in ["left", "right"] {
        let recording = format!("{name}.mcap");
        let last = Run::open(&folder.path().join(&recording)).unwrap().poses.last().unwrap().pose;
        assert_eq!(both(last.x_m, last.y_m), Some(254), "{name}: where it stood");
        run(folder.path(), &["export", &recording, "--format", "pgm", "--out", name]).expect(0);
        let [all, own] = [free_of(&both), free_of(&exported_grid(&folder.path().join(name)))];
        assert!(all > own && own > 0, "{name}: {own} free cells, {all} of both");
    }
}

#[test]
fn runs_of_several_missions_and_worlds_are_told_apart() {
    let folder = folder();
    let arguments = ["run", "square", "--sim", "open", "--set", "time_limit_s=1", "--out", "out"];
    run(folder.path(), &arguments).expect(0);
    let title = |recordings: &[&str]| {
        let said =
            run(folder.path(), &[&["plot", "-o", "map.html"], recordings].concat()).expect(0);
        let page = std::fs::read_to_string(folder.path().join("map.html")).unwrap();
        let title = page.split("<title>").nth(1).unwrap().split('<').next().unwrap().to_owned();
        (title, said.err)
    };
    let long = "long ".repeat(60);
    run(folder.path(), &["plot", "left.mcap", "-o", "long.svg", "--title", &long]).expect(0);
    let picture = std::fs::read_to_string(folder.path().join("long.svg")).unwrap();
    assert!(picture.contains('…') && !picture.contains(long.trim()), "a title is cut at its end");
    let same = title(&["left.mcap", "right.mcap"]);
    assert_eq!(same, ("left, right: map".to_owned(), String::new()));
    let (several, said) = title(&["left.mcap", "out/run.mcap"]);
    assert_eq!(several, "left: map, out: square");
    assert!(said.contains("different worlds") && said.contains(": arena, open"), "{said}");
}

#[test]
fn a_file_of_another_kind_is_not_written_over_and_a_picture_is() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    for (name, text) in [("notes.svg", "<?xml version=\"1.0\"?>"), ("points.csv", "x,y\n1,2\n")] {
        std::fs::write(at(name), text).unwrap();
    }
    std::fs::copy(at("left.mcap"), at("kept.svg")).unwrap();
    std::fs::create_dir(at("edited")).unwrap();
    std::fs::write(at("edited/map.yaml"), "image: map.pgm\n").unwrap();
    std::fs::write(at("map.pgm"), "P5\n# CREATOR: map_saver\n1 1\n255\n0").unwrap();
    let before = |name: &str| std::fs::read(at(name)).unwrap();
    for (name, arguments) in [
        ("notes.svg", &["plot", "left.mcap", "-o", "notes.svg"][..]),
        ("kept.svg", &["plot", "left.mcap", "-o", "kept.svg"]),
        ("points.csv", &["export", "left.mcap", "--format", "csv"]),
        ("map.pgm", &["export", "left.mcap", "--format", "pgm"]),
        ("edited/map.yaml", &["export", "left.mcap", "--format", "pgm", "--out", "edited"]),
    ] {
        let kept = before(name);
        let said = run(folder.path(), arguments).expect(3).err;
        assert!(said.contains(name) && said.contains("of another kind\n  try: "), "{said}");
        assert_eq!(before(name), kept, "{name}");
    }
    assert!(!at("edited/map.pgm").exists(), "all or none");
    for arguments in [
        &["-o", "map.svg"][..],
        &["-o", "map.png"],
        &["-o", "map.pdf"],
        &["-o", "map.svg", "--signals", "range_m"],
        &["-o", "map.svg"],
        &["-o", "map.png", "--title", "again"],
        &["-o", "map.pdf", "--title", "again"],
    ] {
        run(folder.path(), &[&["plot", "right.mcap"], arguments].concat()).expect(0);
    }
    for format in ["csv", "pgm", "ply"] {
        for recording in ["left.mcap", "right.mcap"] {
            let arguments = ["export", recording, "--format", format, "--out", "again"];
            run(folder.path(), &arguments).expect(0);
        }
    }
}

#[test]
fn repair_makes_a_whole_file_of_a_cut_one_and_one_of_several() {
    let folder = folder();
    let indexed = |name: &str| {
        let bytes = std::fs::read(folder.path().join(name)).unwrap();
        let summary = mcap::Summary::read(&bytes).unwrap().expect("a summary: it is indexed");
        assert!(
            !summary.chunk_indexes.is_empty() && summary.channels.len() > 8,
            "{:?}",
            summary.stats
        );
        Run::read(&bytes)
    };
    run(folder.path(), &["repair", "left.mcap", "right.mcap", "--out", "both.mcap"]).expect(0);
    assert!(indexed("both.mcap").is_err(), "it is for viewers");
    for command in [&["plot", "-o", "both.svg"][..], &["replay"], &["export", "--format", "csv"]] {
        let said = run(folder.path(), &[command, &["both.mcap"]].concat()).expect(3);
        assert!(said.err.contains("a recording of its own"), "{}", said.err);
    }
    // As `*.mcap` in a team's folder: the others are drawn.
    let several = ["plot", "left.mcap", "both.mcap", "-o", "both.svg"];
    let said = run(folder.path(), &several).expect(0);
    assert!(said.err.contains("both.mcap is left out"), "{}", said.err);
    run(folder.path(), &["plot", "both.mcap", "both.mcap", "-o", "both.svg"]).expect(3);
    let bytes = std::fs::read(folder.path().join("left.mcap")).unwrap();
    let cut = &bytes[..bytes.len() / 2];
    std::fs::write(folder.path().join("cut.mcap"), cut).unwrap();
    let said = run(folder.path(), &["repair", "cut.mcap"]).expect(0);
    assert!(
        said.err.contains("was cut after") && said.out.contains("wrote cut.repaired.mcap"),
        "{}",
        said.err
    );
    let (cut, repaired) = (Run::read(cut).unwrap(), indexed("cut.repaired.mcap").unwrap());
    assert_eq!(repaired.senses, cut.senses);
    assert_eq!((repaired.logs, repaired.checkpoints), (cut.logs, cut.checkpoints));
    assert_eq!(repaired.info, cut.info);
    assert_eq!(repaired.warnings, ["the run stopped without saying why"]);
    run(folder.path(), &["replay", "cut.repaired.mcap"]).expect(0);
    let said = run(folder.path(), &["repair", "left.mcap", "right.mcap"]).expect(2);
    assert!(said.err.contains("--out both.mcap"), "{}", said.err);
}

/// A corridor of 20 m: what lies beyond the 5 m that a robot's own grid covers is in the picture,
/// too.
#[test]
fn the_exported_grid_has_all_that_the_robot_has_seen() {
    let folder = tempfile::tempdir().unwrap();
    let world = "name = \"long\"\n[[wall]]\npoints = [[-1, 0.5], [20, 0.5], [20, -0.5], [-1, \
                 -0.5]]\nclosed = true\n";
    let mission = "name = \"ahead\"\ntime_limit_s = 90\n[machine.drive]\nstart = \"on\"\n\
                   final = \"off\"\n\
                   [machine.drive.state.on]\ndo = { left_dps = 340, right_dps = 340, head_deg = 90 \
                   }\n\
                   next = [{ when = \"time_s > 60\", go = \"off\" }]\n[machine.drive.state.off]\n";
    std::fs::write(folder.path().join("long.toml"), world).unwrap();
    std::fs::write(folder.path().join("ahead.toml"), mission).unwrap();
    run(folder.path(), &["run", "ahead.toml", "--sim", "long.toml", "--out", "out"]);
    let recorded = Run::open(&folder.path().join("out/run.mcap")).unwrap();
    let furthest_m = recorded.points.iter().map(|point| point.x_m).fold(0.0, f64::max);
    assert!(furthest_m > 6.0, "it came {furthest_m} m far: {:?}", recorded.ending);
    let said = run(folder.path(), &["export", "out/run.mcap", "--format", "pgm", "--out", "map"])
        .expect(0);
    assert_eq!(said.err, "");
    let grid = exported_grid(&folder.path().join("map"));
    // Nearly every place where an echo came from is there, and mostly dark.
    let (mut dark, mut all) = (0, 0);
    for point in &recorded.points {
        let cell = grid(point.x_m, point.y_m);
        let cell = cell.unwrap_or_else(|| panic!("{point:?} is beyond the picture"));
        all += 1;
        dark += usize::from(cell < 205);
    }
    assert!(dark * 10 > all * 5, "{dark} of {all} points are in dark cells");
}

#[test]
fn several_recordings_are_replayed_one_after_the_other() {
    let folder = folder();
    let said = run(folder.path(), &["replay", "left.mcap", "right.mcap"]).expect(0);
    let same = said.out.matches("the same, bit for bit").count();
    assert!(
        same == 2 && said.out.contains("left.mcap: ") && said.out.contains("right.mcap: "),
        "{}",
        said.out
    );
    let json =
        run(folder.path(), &["replay", "left.mcap", "right.mcap", "--json"]).expect(0).json();
    assert_eq!(
        json.iter().map(|line| line["run"].as_str().unwrap()).collect::<Vec<_>>(),
        ["left.mcap", "right.mcap"]
    );
    let bytes = std::fs::read(folder.path().join("left.mcap")).unwrap();
    let cut = [&bytes[..8], &bytes[bytes.len() / 2..]].concat();
    std::fs::write(folder.path().join("cut.mcap"), cut).unwrap();
    let said = run(folder.path(), &["replay", "cut.mcap"]).expect(3).err;
    assert!(said.contains("its beginning is damaged\n  try: onbrick plot"), "{said}");
    // One that is none does not keep the next one from being replayed.
    std::fs::write(folder.path().join("bad.mcap"), "no recording").unwrap();
    let said = run(folder.path(), &["replay", "bad.mcap", "right.mcap"]);
    assert!(matches!(said.code, Some(1 | 3)), "{said:?}");
    assert!(
        said.out.contains("right.mcap: ")
            && said.err.contains("1 of 2 recordings could not be replayed"),
        "{said:?}"
    );
    assert!(said.err.starts_with("error: cannot use bad.mcap: "), "said once: {}", said.err);
    let nowhere = ["replay", "left.mcap", "--robot", "mapper", "--out", "none/made.mcap"];
    let said = run(folder.path(), &nowhere).expect(3).err;
    assert!(said.contains("none/made.mcap") && said.contains("try: a name in a folder"), "{said}");
    let said = run(
        folder.path(),
        &["replay", "left.mcap", "right.mcap", "--robot", "r.toml", "--out", "o"],
    )
    .expect(2);
    assert!(said.err.contains("one recording"), "{}", said.err);
}

/// What a full disk leaves: nothing that looks like a file, and what was there before as it was.
#[test]
fn a_full_disk_leaves_no_empty_files_and_the_old_ones_whole() {
    let folder = folder();
    let limited = |arguments: &str| {
        // No file may grow: the write fails as on a full disk, once SIGXFSZ is ignored.
        let script = format!("trap '' XFSZ; ulimit -f 0; exec \"$0\" {arguments}");
        let mut command = std::process::Command::new("sh");
        let command = command.args(["-c", &script, tested_program()]).current_dir(folder.path());
        super::done(&command.output().unwrap())
    };
    std::fs::create_dir(folder.path().join("out")).unwrap();
    let old = [("out/map.pgm", "P5\n# onbrick\nold"), ("old.svg", "<svg width=\"800\" old")];
    for (name, text) in old {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    let before = names(folder.path());
    for arguments in [
        "new robot fresh.toml",
        "new mission fresh.toml",
        "plot left.mcap -o old.svg",
        "plot left.mcap -o fresh.png",
        "export left.mcap --format pgm --out out",
        "export left.mcap --format csv --out out",
        "replay left.mcap --robot mapper --out fresh.mcap",
    ] {
        let said = limited(arguments).expect(1);
        let told = ["cannot write", "cannot make"].iter().any(|told| said.err.contains(told));
        assert!(told, "{arguments}: {}", said.err);
        assert_eq!(names(folder.path()), before, "{arguments}");
        assert_eq!(names(&folder.path().join("out")), ["map.pgm"], "{arguments}");
        for (name, text) in old {
            let there = std::fs::read_to_string(folder.path().join(name)).unwrap();
            assert_eq!(there, text, "{arguments}: {name}");
        }
    }
    run(folder.path(), &["plot", "left.mcap", "-o", "/dev/null"]);
}

#[test]
fn replay_of_an_honest_run_is_the_same_and_of_a_changed_one_is_not() {
    let folder = folder();
    let said = run(folder.path(), &["replay", "left.mcap"]).expect(0);
    assert!(said.out.contains("the same, bit for bit"), "{}", said.out);
    let [json] =
        run(folder.path(), &["replay", "left.mcap", "--json"]).expect(0).json().try_into().unwrap();
    assert_eq!(
        keys(&json),
        [
            "differences",
            "differing",
            "gaps",
            "points",
            "poses",
            "skipped",
            "ticks",
            "transitions",
            "unrecorded"
        ]
    );
    assert_eq!(json["differing"], 0);

    // With another robot's measures in it, the recorded poses are not what its senses come to.
    let mut tampered = Run::open(&folder.path().join("left.mcap")).unwrap();
    let robot = tampered.robot_toml.as_mut().unwrap();
    *robot = robot.replace("wheel_circumference_m = 0.188976", "wheel_circumference_m = 0.2");
    let replayed = replay(&tampered).unwrap();
    assert!(!replayed.is_same() && !replayed.differences.is_empty(), "{replayed}");
    assert!(
        replayed.to_string().contains("\ntick ") && replayed.to_string().contains("pose"),
        "{replayed}"
    );

    // A recording whose poses were made up.
    make_up(&folder.path().join("made-up.mcap"));
    let said = run(folder.path(), &["replay", "made-up.mcap"]).expect(1);
    assert!(
        said.out.contains("differences") && said.err.contains("differs"),
        "{}{}",
        said.out,
        said.err
    );
    let json = run(folder.path(), &["replay", "made-up.mcap", "--json"]).expect(1).json();
    assert!(json[0]["differing"].as_u64().unwrap() > 0 && json[1]["exit"] == 1, "{json:?}");
}

/// A recording of the shipped robot and mission whose senses and poses have nothing to do with each
/// other.
fn make_up(file: &Path) {
    let mut start = Start {
        robot_toml: onbrick::robot::DEFAULT_ROBOT.to_owned(),
        mission_toml: onbrick::behavior::shipped::find("map").unwrap().text.to_owned(),
        ..start(Pace::Virtual)
    };
    start.info.settings.clear();
    let sink = Box::new(recording::create(file).unwrap());
    let (recorder, mut side) =
        Recorder::start::<()>(sink, start, Options::default(), Box::new(|_| {})).unwrap();
    (0..100).for_each(|number| side.tick(&tick(number)));
    let end = End {
        stop: StopReason::Finished.into(),
        time_ns: 2_000_000_000,
        truth: None,
        ..End::default()
    };
    recorder.finish(side, end).unwrap();
}

#[test]
fn replay_with_another_robot_makes_a_new_run_and_never_writes_over_one() {
    let folder = folder();
    let wider =
        onbrick::robot::DEFAULT_ROBOT.replace("track_width_m = 0.1143", "track_width_m = 0.16");
    std::fs::write(folder.path().join("wider.toml"), wider).unwrap();
    let arguments = ["replay", "left.mcap", "--robot", "wider.toml", "--out", "wider.mcap"];
    run(folder.path(), &arguments).expect(0);
    run(folder.path(), &["replay", "wider.mcap"]).expect(0);
    let before = std::fs::read(folder.path().join("left.mcap")).unwrap();
    for out in ["left.mcap", "wider.mcap"] {
        let arguments = ["replay", "left.mcap", "--robot", "wider.toml", "--out", out];
        let said = run(folder.path(), &arguments).expect(3);
        assert!(said.err.contains("is there already"), "{}", said.err);
    }
    assert!(before == std::fs::read(folder.path().join("left.mcap")).unwrap());
}

#[test]
fn a_run_cut_at_every_offset_gives_plot_and_replay_what_came_before_the_cut() {
    let folder = tempfile::tempdir().unwrap();
    // A quarter of a second is the whole file's structure with a few ticks in it: each offset of it
    // is cut at.
    let mission = onbrick::behavior::shipped::find("map").unwrap().text.replacen(
        "[machine.drive.state.forward]\n",
        "[machine.drive]\nstart = \"forward\"\nfinal = \"end\"\n\
         always = [{ when = \"time_s > 0.2\", go = \"end\" }]\nstate.end = {}\n\
         [machine.drive.state.forward]\n",
        1,
    );
    assert!(mission.contains("state.end"), "the shipped mission has another first state");
    let mission = mission.replacen("time_limit_s", "finish = \"any\"\ntime_limit_s", 1);
    std::fs::write(folder.path().join("short.toml"), mission).unwrap();
    run(folder.path(), &["run", "short.toml", "--sim", "arena", "--out", "o"]).expect(0);
    let bytes = std::fs::read(folder.path().join("o/run.mcap")).unwrap();
    let whole = Run::read(&bytes).unwrap();
    let path = Track::of_run(&whole, "whole").path;
    assert!(
        whole.senses.len() > 8 && path.len() > 1,
        "{} ticks, {} poses drawn",
        whole.senses.len(),
        path.len()
    );
    let (mut last, mut replays) = (0, 0);
    for cut in 0..=bytes.len() {
        let run = match Run::read(&bytes[..cut]) {
            Ok(run) => run,
            Err(ReadError::NotARecording { .. }) if cut < 60 => continue,
            Err(error) => panic!("cut at {cut}: {error}"),
        };
        let ticks = run.senses.len();
        assert!(ticks >= last, "cut at {cut}: {ticks} ticks, and {last} one byte earlier");
        assert_eq!(run.senses, whole.senses[..ticks], "cut at {cut}");
        let poses = run.poses.len();
        assert!(
            poses <= ticks && poses + 1 >= ticks,
            "cut at {cut}: {poses} poses of {ticks} ticks"
        );
        assert_eq!(run.poses, whole.poses[..poses], "cut at {cut}");
        let track = Track::of_run(&run, "cut");
        assert_eq!(track.path.is_empty(), poses == 0, "cut at {cut}: what there is is drawn");
        assert_eq!(track.points.len(), run.points.len(), "cut at {cut}");
        if ticks > last || cut + 1 >= bytes.len() || cut % 997 == 0 {
            replays += 1;
            match replay(&run) {
                Ok(replayed) => {
                    assert_eq!(replayed.ticks, ticks as u64, "cut at {cut}");
                    assert!(replayed.is_same(), "cut at {cut}: {replayed}");
                }
                Err(ReplayError::Beheaded(_)) => assert_eq!(ticks, 0, "cut at {cut}"),
                Err(error) => panic!("cut at {cut}: {error}"),
            }
        }
        last = ticks;
    }
    assert_eq!(last, whole.senses.len());
    println!("cut at {} offsets, {replays} replays", bytes.len() + 1);
}

#[test]
fn the_commands_take_a_cut_file_and_say_so() {
    let folder = folder();
    let bytes = std::fs::read(folder.path().join("left.mcap")).unwrap();
    for percent in [0, 1, 20, 50, 90, 99] {
        std::fs::write(folder.path().join("cut.mcap"), &bytes[..bytes.len() * percent / 100])
            .unwrap();
        // In the beginning of a recording there is nothing to draw.
        let drawn = if percent < 20 { 3 } else { 0 };
        let plot = run(folder.path(), &["plot", "cut.mcap", "-o", "cut.svg"]).expect(drawn);
        assert!(plot.err.contains("cut"), "{percent} %: {}", plot.err);
        assert_eq!(plot.err.contains("neither path nor points"), percent == 1, "{}", plot.err);
        assert_eq!(plot.err.contains("try: another recording"), percent == 1, "{}", plot.err);
        assert_eq!(folder.path().join("cut.svg").exists(), drawn == 0, "{percent} %");
        // One percent is still inside the beginning, which says what the run was.
        let replay =
            run(folder.path(), &["replay", "cut.mcap"]).expect(if percent < 20 { 3 } else { 0 });
        assert!(percent < 20 || replay.out.contains("the same"), "{percent} %: {}", replay.out);
        assert!(
            percent >= 20 || replay.err.contains("beginning") || replay.err.contains("empty"),
            "{}",
            replay.err
        );
        // At 20 % the room is known, which is drawn, and nothing of the run.
        let exported = if percent < 50 { 3 } else { 0 };
        let export = ["export", "cut.mcap", "--out", "x", "--format"];
        for format in ["csv", "pgm"] {
            run(folder.path(), &[&export[..], &[format]].concat()).expect(exported);
        }
        // No point may have come yet.
        let ply = run(folder.path(), &[&export[..], &["ply"]].concat());
        assert!(ply.code == Some(3) || ply.code == Some(exported), "{}", ply.err);
        let repaired = if percent < 20 { 3 } else { 0 };
        run(folder.path(), &["repair", "cut.mcap"]).expect(repaired);
        if repaired == 0 {
            let again = run(folder.path(), &["repair", "cut.mcap"]).expect(3);
            assert!(again.err.contains("cut.repaired.mcap is there already"), "{}", again.err);
            std::fs::remove_file(folder.path().join("cut.repaired.mcap")).unwrap();
        }
    }
}

#[test]
fn what_is_no_recording_is_refused_by_every_command() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("empty"), "").unwrap();
    std::fs::write(folder.path().join("text"), "x,y\n1,2\n").unwrap();
    std::fs::write(folder.path().join("binary"), [0xff; 5000]).unwrap();
    for file in ["empty", "text", "binary", "none", "."] {
        for arguments in [
            &["plot", file, "-o", "x.svg"][..],
            &["export", file, "--format", "csv"],
            &["replay", file],
        ] {
            let said = run(folder.path(), arguments).expect(3);
            assert!(said.err.contains(&format!(" {file}")), "{}", said.err);
            assert_eq!(said.err.matches("cannot").count(), 1, "said once: {}", said.err);
            assert!(said.err.contains("onbrick run"), "{}", said.err);
        }
    }
    assert_eq!(names(folder.path()), ["binary", "empty", "text"]);
}

#[test]
fn a_drawing_of_nothing_is_a_drawing() {
    // A run that was cut before its first tick has no path and no points, and is still a picture
    // with axes.
    let run = Run { senses: Vec::new(), ..Run::default() };
    let scene = onbrick::report::Scene {
        title: String::new(),
        tracks: vec![Track::of_run(&run, "nothing")],
        ..onbrick::report::Scene::default()
    };
    assert!(onbrick::report::plot::svg(&scene).unwrap().contains("<svg"));
    assert!(onbrick::report::plot::png(&scene).unwrap().len() > 100);
    assert!(export::points_csv(&scene.tracks).lines().count() == 1, "the heading only");
}
