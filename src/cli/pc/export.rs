//! `onbrick export`: runs in other programs' formats.

use std::path::{Path, PathBuf};

use super::plot::nothing;
use super::scene::scene_of;
use crate::cli::common::{LoadedRun, make_folder, may_write, open_runs, write_file};
use crate::cli::folder::GRID;
use crate::cli::{Exit, Failure, Output};
use crate::printable::with_causes;
use crate::recording::Grid;
use crate::report::timeline::{self, Timeline};
use crate::report::{Scene, Track, export};
use crate::runtime::{ReplayError, joint_map, whole_map};
use crate::units::counted;

/// Write runs as CSV, PLY, or PGM with Nav2's YAML. The recording itself is MCAP, which viewers
/// open.
///
/// Examples:
///   onbrick export onbrick-demo/run.mcap --format pgm --out map
///   onbrick export left.mcap right.mcap --format pgm --out both       one map of both
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(in crate::cli) struct Arguments {
    /// Recordings.
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// csv: points.csv, path.csv, walls.csv, the straight stretches of at least 30 cm that
    /// the points make, with standard deviations, and signals.csv, a row a tick with all signals,
    /// what was demanded, and the machines' states; ply: points.ply; pgm: map.pgm and map.yaml, the
    /// occupancy grid, one of all the runs.
    #[arg(long)]
    format: Format,
    /// The folder to write to.
    #[arg(long, default_value = ".")]
    out: PathBuf,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Format {
    Csv,
    Ply,
    Pgm,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let runs = open_runs(&arguments.runs)?;
    let Scene { tracks, walls, .. } = scene_of(&runs, None);
    let is_bare = tracks.iter().all(|track| track.path.is_empty() && track.points.is_empty());
    // What was sensed alone makes signals.csv and the grid again.
    if is_bare && runs.iter().all(|loaded| loaded.run.senses.is_empty()) {
        return Err(nothing("export", &runs));
    }
    let files: Vec<(&str, Vec<u8>)> = match arguments.format {
        Format::Csv => {
            let mut files = vec![
                ("points.csv", export::points_csv(&tracks).into_bytes()),
                ("path.csv", export::path_csv(&tracks).into_bytes()),
                ("walls.csv", export::walls_csv(&walls).into_bytes()),
            ];
            let timelines = timelines(&runs, &tracks);
            if !timelines.is_empty() {
                files.push(("signals.csv", timeline::csv(&timelines).into_bytes()));
            }
            files
        }
        Format::Ply if tracks.iter().all(|track| track.points.is_empty()) => {
            return Err(Failure::refused("nothing to export: no point was found")
                .hint("--format csv, which has the path"));
        }
        Format::Ply => vec![("points.ply", export::ply(&tracks).into_bytes())],
        Format::Pgm => grid_files(&grid(&runs, &tracks)?),
    };
    write_all(&arguments.out, files, output)
}

/// A grid as the files that ROS's map server reads.
pub(super) fn grid_files(grid: &Grid) -> Vec<(&'static str, Vec<u8>)> {
    let [image, yaml] = GRID;
    vec![(image, export::pgm(grid)), (yaml, export::nav2_yaml(grid, image).into_bytes())]
}

fn write_all(
    folder: &Path,
    files: Vec<(&str, Vec<u8>)>,
    output: &mut Output,
) -> Result<(), Failure> {
    make_folder(Exit::Failed, folder)?;
    // What belongs together is written together.
    files.iter().try_for_each(|(name, bytes)| may_write(&folder.join(name), bytes))?;
    for (name, bytes) in files {
        let path = folder.join(name);
        write_file(&path, &bytes)?;
        output.wrote(&path);
    }
    Ok(())
}

/// The runs over time; one that cannot be replayed is left out, and said so.
fn timelines(runs: &[LoadedRun], tracks: &[Track]) -> Vec<Timeline> {
    let one = |(loaded, track): (&LoadedRun, &Track)| {
        let timeline = Timeline::of_run(&loaded.run);
        let timeline = timeline.map_err(|error| {
            log::warn!("{}: not in signals.csv: {}", loaded.name, with_causes(&error));
        });
        Some(Timeline { robot: track.name.clone(), ..timeline.ok()? })
    };
    runs.iter().zip(tracks).filter_map(one).collect()
}

/// The occupancy grid: that of one run as it was recorded, or where that does not have all, made
/// again from its senses, as that of several is.
pub(super) fn grid(runs: &[LoadedRun], tracks: &[Track]) -> Result<Grid, Failure> {
    let cannot = |name: &str, error: &ReplayError| {
        Failure::from_error(Exit::Failed, &format!("cannot replay {name}"), error)
    };
    let [loaded] = runs else {
        for track in tracks.iter().filter(|track| track.is_apart) {
            log::warn!("{}: its map fits no other's: it lies by its start alone", track.name);
        }
        let origins = tracks.iter().map(|track| track.origin);
        let placed: Vec<_> = runs.iter().map(|loaded| &loaded.run).zip(origins).collect();
        return joint_map(&placed).map_err(|(place, error)| {
            cannot(runs.get(place).map_or("the runs", |loaded| &loaded.name), &error)
        });
    };
    if loaded.run.map.is_none() {
        log::warn!("{}: the recording has no grid; it is made again from the senses", loaded.name);
    }
    match (whole_map(&loaded.run), &loaded.run.map) {
        (Ok(grid), _) => Ok(grid),
        (Err(error), Some(recorded)) => {
            let lost = loaded
                .run
                .points
                .iter()
                .filter(|point| !recorded.has(point.x_m, point.y_m))
                .count();
            let (all, why) = (counted(loaded.run.points.len(), "point"), with_causes(&error));
            let (lie, are) = if lost == 1 { ("lies", "is") } else { ("lie", "are") };
            log::warn!(
                "{}: {lost} of {all} {lie} beyond the recorded grid and {are} left out: {why}",
                loaded.name
            );
            Ok(recorded.clone())
        }
        (Err(error), None) => Err(cannot(&loaded.name, &error)),
    }
}
