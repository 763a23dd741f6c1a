//! What a team brought home: one picture, one recording, and what came of each brick.

use std::path::Path;

use serde_json::json;

use super::super::export::{grid, grid_files};
use super::super::scene::{draw, of_all, scene_of};
use super::super::stop::AT_THE_BRICK;
use super::Plan;
use super::drive::Came;
use crate::cli::common::{LoadedRun, open_run, read_file, write_file};
use crate::cli::{Context, Exit, Failure, Output};
use crate::clock::{SECOND_NS, seconds};
use crate::printable::in_shell;
use crate::recording::Info;
use crate::report::Scene;
use crate::report::export::{self, NamedRecording};
use crate::units::counted;

/// Says brick by brick what came of it.
pub(super) fn report(came: &[Came], output: &mut Output) {
    for one in came {
        let file = one.file.as_ref().map(|file| file.display().to_string());
        let part = if one.whole { "" } else { " (a part of it)" };
        let where_to = file.as_ref().map(|file| format!("; {file}{part}")).unwrap_or_default();
        output.line(format!("{}: {}{where_to}", one.brick.name, said(one)));
        output.value(&json!({
            "brick": one.brick.name,
            "run": one.run,
            "good": is_good(one),
            "end": one.end,
            "file": file,
            "whole": one.whole,
            "error": one.failure.as_ref().map(|failure| &failure.message),
        }));
    }
}

fn said(one: &Came) -> String {
    match (&one.failure, &one.end) {
        (Some(failure), _) => failure.message.clone(),
        (None, Some(end)) => end.to_string(),
        (None, None) => "its recording has no end".to_owned(),
    }
}

fn is_good(one: &Came) -> bool {
    one.failure.is_none() && one.whole && one.end.as_ref().is_some_and(|end| end.is_wanted())
}

/// How the whole ended; `out` has the recordings.
pub(super) fn verdict(came: &[Came], out: &Path, output: &mut Output) -> Result<(), Failure> {
    let bad: Vec<&Came> = came.iter().filter(|one| !is_good(one)).collect();
    if bad.is_empty() {
        let mut ends = came.iter().filter_map(|one| one.end.as_ref());
        if ends.any(|end| !end.stop.reason.is_complete()) {
            output.ends_with(Exit::Stopped as u8);
        }
        return Ok(());
    }
    let names = bad.iter().map(|one| one.brick.name.as_str()).collect::<Vec<_>>().join(", ");
    let exits =
        || bad.iter().map(|one| one.failure.as_ref().map_or(Exit::Failed, |failure| failure.exit));
    let first = exits().next().unwrap_or(Exit::Failed);
    let nothing_moved = came.iter().all(|one| one.file.is_none());
    let exit = match bad.len() == came.len() {
        _ if nothing_moved && bad.iter().any(|one| one.refused) => Exit::Refused,
        true if exits().all(|exit| exit == first) => first,
        true => Exit::Failed,
        false => Exit::SomeFailed,
    };
    let message = format!(
        "{} of {} did not come to a good end: {names}",
        bad.len(),
        counted(came.len(), "brick")
    );
    let lost = bad
        .iter()
        .find(|one| one.failure.as_ref().is_some_and(|failure| failure.exit == Exit::NoAnswer));
    let failure = Failure::new(exit, message);
    let fetch = lost.map(|one| {
        format!(
            "onbrick fetch {} --run {} -o {}, once the brick is back: it resumes where it was \
             cut",
            one.brick.name,
            one.run,
            in_shell(out)
        )
    });
    let is_adrift = bad.iter().any(|one| one.adrift);
    let ways = is_adrift.then(|| AT_THE_BRICK.to_owned()).into_iter().chain(fetch);
    let ways = ways.collect::<Vec<_>>().join("; ");
    Err(if ways.is_empty() { failure } else { failure.hint(ways) })
}

/// Draws all maps in one picture and writes all recordings as one, on one clock.
pub(super) fn merge(plan: &Plan<'_>, came: &[Came], output: &mut Output) -> Result<(), Failure> {
    let opened = came.iter().filter_map(|one| Some((one, opened(one)?)));
    let (ones, runs): (Vec<&Came>, Vec<LoadedRun>) = opened.unzip();
    if runs.is_empty() {
        return Ok(());
    }
    let scene = scene(plan, &ones, &runs);
    draw(plan.out, &scene)?;
    write_file(&plan.out.join("team.mcap"), &merged(&ones, &runs, output)?)?;
    let with_grid = match grid(&runs, &scene.tracks) {
        Ok(grid) => {
            for (name, bytes) in grid_files(&grid) {
                write_file(&plan.out.join(name), &bytes)?;
            }
            "map.pgm, map.yaml, "
        }
        Err(failure) => {
            log::warn!("there is no map.pgm: {}", failure.message);
            ""
        }
    };
    let points: usize = scene.tracks.iter().map(|track| track.points.len()).sum();
    let (count, out) = (runs.len(), plan.out.display());
    output.show(
        format!(
            "{}, {}: map.svg, map.png, {with_grid}points.csv, path.csv and team.mcap in {out}",
            counted(count, "brick"),
            of_all(points, &runs)
        ),
        &json!({
            "points": points,
            "bricks": count,
            "map": plan.out.join("map.svg"),
            "recording": plan.out.join("team.mcap"),
        }),
    );
    Ok(())
}

/// A recording, or the part of it that is here; one of which nothing can be read is said so.
fn opened(one: &Came) -> Option<LoadedRun> {
    let opened = open_run(one.file.as_ref()?);
    opened.map_err(|failure| log::warn!("{}: {}", one.brick.name, failure.message)).ok()
}

fn scene(plan: &Plan<'_>, ones: &[&Came], runs: &[LoadedRun]) -> Scene {
    let mut scene = scene_of(runs, Some(&format!("{}: {}", plan.team.name, plan.wanted.name)));
    for (track, one) in scene.tracks.iter_mut().zip(ones) {
        // Robots of a team have the same robot.toml; bricks are told apart by their own names.
        track.name.clone_from(&one.brick.name);
    }
    scene
}

/// All recordings in one, a namespace a brick, by this PC's clock.
fn merged(ones: &[&Came], runs: &[LoadedRun], output: &mut Output) -> Result<Vec<u8>, Failure> {
    let bytes = runs.iter().map(|loaded| read_file(&loaded.path)).collect::<Result<Vec<_>, _>>()?;
    let parts: Vec<NamedRecording<'_>> = ones
        .iter()
        .zip(runs)
        .zip(&bytes)
        .map(|((one, loaded), bytes)| {
            let shift_ns = loaded.run.info.as_ref().map_or(0, |info| shift_ns(one, info, output));
            NamedRecording { name: &one.brick.name, bytes, shift_ns }
        })
        .collect();
    export::mcap(&parts).context(Exit::Failed, "cannot merge")
}

/// What brings a brick's stamps onto this PC's clock.
fn shift_ns(one: &Came, info: &Info, output: &mut Output) -> i64 {
    let name = &one.brick.name;
    let Some(began) = one.began else {
        log::warn!("{name}: its start was not heard; team.mcap has its own calendar");
        return 0;
    };
    if began.within_ns > SECOND_NS {
        log::warn!(
            "{name}: it was not heard while it drove; in team.mcap it begins when it was started"
        );
    }
    let shift_ns = began.at_ns.saturating_sub(info.wall_offset_ns.saturating_add(info.start_ns));
    let within_s = (began.within_ns <= SECOND_NS).then(|| seconds(began.within_ns));
    output.value(
        &json!({ "brick": name, "clock_behind_s": seconds(shift_ns), "within_s": within_s }),
    );
    shift_ns
}
