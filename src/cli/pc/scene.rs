//! Recordings as a scene to be drawn: the robots' names, and what is known of the world.

use std::path::Path;

use crate::cli::common::{LoadedRun, write_file};
use crate::cli::folder::DRAWN;
use crate::cli::{Context, Exit, Failure};
use crate::printable;
use crate::report::{Scene, Track, export, plot};
use crate::runtime::whole_map;
use crate::sim::{Room, World};
use crate::units::{counted, degrees};

/// All runs in one picture, with what is known of the worlds that they were in.
pub(super) fn scene_of(runs: &[LoadedRun], title: Option<&str>) -> Scene {
    let mut tracks: Vec<Track> =
        runs.iter().map(|loaded| Track::of_run(&loaded.run, &loaded.name)).collect();
    for (track, loaded) in tracks.iter_mut().zip(runs) {
        // Where the robot left the recorded grid, or nothing was recorded, it is made again.
        track.grid = whole_map(&loaded.run).ok().or(track.grid.take());
    }
    tell_apart(&mut tracks, runs);
    let title = title.map_or_else(|| title_of(&tracks, runs), str::to_owned);
    let mut scene = Scene { title, tracks, ..Scene::default() };
    correct(&mut scene);
    for (loaded, track) in runs.iter().zip(&scene.tracks) {
        let (found, stand) = (loaded.run.points.len(), track.points.len());
        let (all, are) = (counted(found, "point"), if stand == 1 { "is" } else { "are" });
        log::info!("{}: {stand} of {all} {are} of what stands", track.name);
    }
    scene.find_walls();
    scene.turn_points();
    let worlds: Vec<World> = runs.iter().filter_map(|loaded| loaded.run.world()).collect();
    let mut names: Vec<&str> = Vec::new();
    add_new(&mut names, worlds.iter().map(World::name));
    if names.len() > 1 {
        let names = names.join(", ");
        log::warn!("the runs are of different worlds, which lie over each other here: {names}");
    }
    for world in &worlds {
        // Runs in the same world have the same walls.
        add_new(&mut scene.outlines, world.outlines().to_vec());
        add_new(&mut scene.blocks, world.blocks());
        let edge = world.edge();
        // The floor itself is drawn below all marks, where it has an edge.
        let marks = Room::of(world).floor.into_iter().skip(usize::from(!edge.is_empty()));
        add_new(&mut scene.edges, Some(edge).filter(|edge| !edge.is_empty()));
        add_new(&mut scene.marks, marks);
    }
    scene
}

/// How many points of the runs are drawn, and why not all.
pub(super) fn of_all(drawn: usize, runs: &[LoadedRun]) -> String {
    let all: usize = runs.iter().map(|loaded| loaded.run.points.len()).sum();
    let of_all = counted(all, "point");
    if drawn == all {
        return of_all;
    }
    let rest = if runs.len() == 1 { "run" } else { "runs" };
    format!("{drawn} of {of_all} (the others contradict the rest of the {rest})")
}

/// The robots and their missions: one that all have is said once, at the end.
fn title_of(tracks: &[Track], runs: &[LoadedRun]) -> String {
    let missions: Vec<Option<&str>> = runs
        .iter()
        .map(|loaded| loaded.run.info.as_ref().map(|info| info.mission.as_str()))
        .collect();
    let (last, before) = missions.split_last().unwrap_or((&None, &[]));
    let is_common = before.iter().all(|mission| mission == last);
    let said = |(place, (track, mission)): (usize, (&Track, &Option<&str>))| {
        let is_said = !is_common || place == before.len();
        let mission = mission.filter(|_| is_said).map(|mission| format!(": {mission}"));
        format!("{}{}", track.name, mission.unwrap_or_default())
    };
    tracks.iter().zip(&missions).enumerate().map(said).collect::<Vec<_>>().join(", ")
}

/// Corrects start poses against each other, and says of each run but the first what came of it.
fn correct(scene: &mut Scene) {
    let names: Vec<String> = scene.tracks.iter().map(|track| track.name.clone()).collect();
    for (place, outcome) in scene.align() {
        let name = names.get(place).map_or("", String::as_str);
        match outcome {
            Ok((moved_m, turned_rad)) => log::info!(
                "{name}: its map fits; its start was corrected by {:.0} cm and {:.1} degrees",
                moved_m * 100.0,
                degrees(turned_rad)
            ),
            Err(misfit) => log::info!("{name}: its start pose stands: {misfit}"),
        }
    }
}

/// Robots of the same name get that of their recordings besides.
fn tell_apart(tracks: &mut [Track], runs: &[LoadedRun]) {
    let names: Vec<String> = tracks.iter().map(|track| track.name.clone()).collect();
    for (track, loaded) in tracks.iter_mut().zip(runs) {
        if names.iter().filter(|name| **name == track.name).count() > 1 {
            let label = printable::line(&recording_label(&loaded.path)).into_owned();
            // The robot's own name says nothing more.
            track.name = label;
        }
    }
}

/// What a recording is called among others: its file's name, or its folder's where all are
/// `run.mcap`.
fn recording_label(path: &Path) -> String {
    let plain = |name: Option<&std::ffi::OsStr>| {
        name.map_or_else(String::new, |name| name.to_string_lossy().into_owned())
    };
    let folder = || path.canonicalize().ok().and_then(|path| path.parent().map(Path::to_owned));
    match plain(path.file_stem()) {
        name if name == "run" => folder().map_or(name, |folder| plain(folder.file_name())),
        name => name,
    }
}

fn add_new<T: PartialEq>(all: &mut Vec<T>, more: impl IntoIterator<Item = T>) {
    for one in more {
        if !all.contains(&one) {
            all.push(one);
        }
    }
}

/// Writes a picture, as map.svg and map.png, and what is drawn in it, as points.csv and path.csv,
/// into a folder.
pub(super) fn draw(folder: &Path, scene: &Scene) -> Result<(), Failure> {
    const DOING: &str = "cannot draw";
    let files = [
        plot::svg(scene).context(Exit::Failed, DOING)?.into_bytes(),
        plot::png(scene).context(Exit::Failed, DOING)?,
        export::points_csv(&scene.tracks).into_bytes(),
        export::path_csv(&scene.tracks).into_bytes(),
    ];
    DRAWN.iter().zip(&files).try_for_each(|(name, bytes)| write_file(&folder.join(name), bytes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::MapPoint;
    use crate::recording::Run;

    #[test]
    fn how_many_points_are_drawn_is_said_of_all_that_were_found() {
        let point = MapPoint { time_ns: 0, x_m: 0.0, y_m: 0.0 };
        let run = Run { points: vec![point; 2], ..Run::default() };
        let loaded = || LoadedRun { path: "r".into(), name: "r".to_owned(), run: run.clone() };
        let runs = [loaded(), loaded()];
        assert_eq!(of_all(4, &runs), "4 points");
        let told = "3 of 4 points (the others contradict the rest of the runs)";
        assert_eq!(of_all(3, &runs), told);
        let told = "1 of 2 points (the others contradict the rest of the run)";
        assert_eq!(of_all(1, &runs[..1]), told);
    }
}
