//! `onbrick export`: runs in other programs' formats.

use std::path::{Path, PathBuf};

use super::common::{LoadedRun, open_run, scene_of, write_file};
use super::output::with_causes;
use super::{Exit, Failure, Output};
use crate::report::export::{self, Part};
use crate::runtime::recording::Grid;

/// Write runs as CSV, PLY, PGM with Nav2's YAML, or MCAP chunked and indexed for viewers.
///
/// Examples:
///   onbrick export onbrick-demo/run.mcap --format pgm --out map
///   onbrick export left.mcap right.mcap --format mcap --out both
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Arguments {
    /// Recordings.
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// csv: points.csv and path.csv; ply: points.ply; pgm: map.pgm and map.yaml, the occupancy grid; mcap: export.mcap.
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
    Mcap,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let runs = arguments.runs.iter().map(|path| open_run(path)).collect::<Result<Vec<_>, _>>()?;
    let tracks = scene_of(&runs, None).tracks;
    let files: Vec<(&str, Vec<u8>)> = match arguments.format {
        Format::Csv => vec![
            ("points.csv", export::points_csv(&tracks).into_bytes()),
            ("path.csv", export::path_csv(&tracks).into_bytes()),
        ],
        Format::Ply => vec![("points.ply", export::ply(&tracks).into_bytes())],
        Format::Pgm => {
            let grid = grid(&runs)?;
            vec![
                ("map.pgm", export::pgm(&grid)),
                ("map.yaml", export::nav2_yaml(&grid, "map.pgm").into_bytes()),
            ]
        }
        Format::Mcap => vec![("export.mcap", merged(&runs)?)],
    };
    write_all(&arguments.out, files, output)
}

fn write_all(folder: &Path, files: Vec<(&str, Vec<u8>)>, output: &mut Output) -> Result<(), Failure> {
    std::fs::create_dir_all(folder).map_err(|error| {
        Failure::from_error(Exit::Failed, &format!("cannot make {}", folder.display()), &error)
    })?;
    for (name, bytes) in files {
        let path = folder.join(name);
        write_file(&path, &bytes)?;
        output.show(format!("wrote {}", path.display()), &serde_json::json!({ "wrote": path }));
    }
    Ok(())
}

/// The occupancy grid of one run: as it was recorded, or where that does not have all, made again
/// from its senses.
fn grid(runs: &[LoadedRun]) -> Result<Grid, Failure> {
    let [loaded] = runs else {
        return Err(Failure::new(Exit::Usage, "an occupancy grid is made from one run")
            .hint("once for each run, with --out for each"));
    };
    if loaded.run.map.is_none() {
        log::warn!("{}: the recording has no grid; it is made again from the senses", loaded.name);
    }
    match (crate::runtime::whole_map(&loaded.run), &loaded.run.map) {
        (Ok(grid), _) => Ok(grid),
        (Err(error), Some(recorded)) => {
            let lost = loaded.run.points.iter().filter(|point| !recorded.has(point.x_m, point.y_m)).count();
            let (all, why) = (loaded.run.points.len(), with_causes(&error));
            log::warn!(
                "{}: {lost} of {all} points lie beyond the recorded grid and are left out: {why}",
                loaded.name
            );
            Ok(recorded.clone())
        }
        (Err(error), None) => {
            Err(Failure::from_error(Exit::Failed, &format!("cannot replay {}", loaded.name), &error))
        }
    }
}

/// All runs in one file, one namespace a brick.
fn merged(runs: &[LoadedRun]) -> Result<Vec<u8>, Failure> {
    let bytes = runs
        .iter()
        .map(|loaded| {
            std::fs::read(&loaded.path).map_err(|error| {
                Failure::from_error(Exit::Failed, &format!("cannot read {}", loaded.name), &error)
            })
        })
        .collect::<Result<Vec<_>, _>>()?;
    let parts: Vec<Part<'_>> = runs
        .iter()
        .zip(&bytes)
        .map(|(loaded, bytes)| Part { name: loaded.brick(), bytes, shift_ns: 0 })
        .collect();
    export::mcap(&parts).map_err(|error| Failure::from_error(Exit::Failed, "cannot merge", &error))
}
