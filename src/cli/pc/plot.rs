//! `onbrick plot`: runs as a picture.

use std::path::{Path, PathBuf};

use clap::ValueEnum as _;

use super::scene::scene_of;
use crate::cli::common::{LoadedRun, open_runs, write_file};
use crate::cli::{Context as _, Exit, Failure, Output};
use crate::recording::Integrity;
use crate::report::chart::Chart;
use crate::report::timeline::Timeline;
use crate::report::{PlotError, Scene, export, plot};
use crate::units::counted;

/// Draw one or several runs as a map: paths and points, and what is known of the room; or one run's
/// signals over time.
///
/// Examples:
///   onbrick plot onbrick-demo/run.mcap -o map.svg
///   onbrick plot left.mcap right.mcap -o both.html
///   onbrick plot run.mcap --signals range_m,heading_deg -o signals.svg
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(in crate::cli) struct Arguments {
    /// Recordings.
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// The picture: .svg, .png, .pdf, or .html for a page with zoom and a time slider; or .dxf, the
    /// walls alone as lines in metres, for CAD.
    #[arg(short, long)]
    output: PathBuf,
    /// Draw these signals over time instead of the map, with the machines' states and what
    /// happened: names as in conditions (range_m), variables, what was demanded (do.left_dps);
    /// separated by commas.
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    signals: Vec<String>,
    /// What stands above it.
    #[arg(long)]
    title: Option<String>,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let kind = Kind::of(&arguments.output)?;
    let runs = open_runs(&arguments.runs)?;
    let bytes = match &arguments.signals[..] {
        [] => {
            let scene = scene_of(&runs, arguments.title.as_deref());
            if scene.is_empty() {
                return Err(nothing("draw", &runs));
            }
            if matches!(kind, Kind::Dxf) && scene.walls.is_empty() {
                let message = "nothing to draw: no wall of 30 cm was found";
                return Err(Failure::refused(message).hint("a picture, which shows the points"));
            }
            map(kind, &scene)
        }
        names => chart(kind, &runs, names, arguments.title.as_deref())?,
    };
    let bytes = bytes.context(Exit::Failed, "cannot draw")?;
    write_file(&arguments.output, &bytes)?;
    output.wrote(&arguments.output);
    Ok(())
}

/// Recordings without what is to be drawn or exported.
pub(super) fn nothing(to: &str, runs: &[LoadedRun]) -> Failure {
    let readable = |loaded: &LoadedRun| {
        let Integrity { bytes, messages, .. } = &loaded.run.integrity;
        let (bytes, messages) = (counted(*bytes, "byte"), counted(*messages, "message"));
        format!("{messages} in the {bytes} of {}", loaded.name)
    };
    let readable = runs.iter().map(readable).collect::<Vec<_>>().join(", ");
    Failure::refused(format!(
        "nothing to {to}, neither path nor points; what can be read: {readable}"
    ))
    .hint("another recording; or onbrick fetch, where its brick has more of it")
}

fn map(kind: Kind, scene: &Scene) -> Result<Vec<u8>, PlotError> {
    match kind {
        Kind::Svg => plot::svg(scene).map(String::into_bytes),
        Kind::Png => plot::png(scene),
        Kind::Pdf => plot::pdf(scene),
        Kind::Html => Ok(plot::html(scene).into_bytes()),
        Kind::Dxf => Ok(export::dxf(&scene.walls).into_bytes()),
    }
}

fn chart(
    kind: Kind,
    runs: &[LoadedRun],
    names: &[String],
    title: Option<&str>,
) -> Result<Result<Vec<u8>, PlotError>, Failure> {
    let [loaded] = runs else {
        return Err(Failure::usage("signals are drawn of one run")
            .hint("once for each run, with -o for each"));
    };
    let timeline = Timeline::of_run(&loaded.run)
        .context(Exit::Failed, format_args!("cannot replay {}", loaded.name))?;
    // A person puts a space behind a comma.
    let names: Vec<String> = names.iter().map(|name| name.trim().to_owned()).collect();
    let signals = timeline
        .named(&names)
        .map_err(|error| Failure::usage(error.to_string()).hint(error.hint))?;
    let chart = Chart::new(&timeline, &signals, title);
    Ok(match kind {
        Kind::Svg => chart.svg().map(String::into_bytes),
        Kind::Png => chart.png(),
        Kind::Pdf => chart.pdf(),
        Kind::Html => chart.html().map(String::into_bytes),
        Kind::Dxf => {
            return Err(Failure::usage("signals are not drawn as DXF")
                .hint("a name that ends in .svg, .png, .pdf or .html"));
        }
    })
}

/// What kind of picture a file's name asks for, by its ending.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Kind {
    Svg,
    Png,
    Pdf,
    Html,
    Dxf,
}

impl Kind {
    fn of(file: &Path) -> Result<Self, Failure> {
        let ending = file.extension().unwrap_or_default().to_string_lossy();
        Self::from_str(&ending, true).map_err(|_| {
            let message = format!("what kind of picture is {}?", file.display());
            Failure::usage(message)
                .hint("a name that ends in .svg, .png, .pdf or .html; .dxf for the walls alone")
        })
    }
}
