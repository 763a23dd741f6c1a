//! `onbrick plot`: runs as a picture.

use std::path::{Path, PathBuf};

use crate::cli::common::{open_run, scene_of, write_file};
use crate::cli::{Exit, Failure, Output};
use crate::report::plot;

/// Draw one or several runs: points red, paths green, walls grey where they are known.
///
/// Examples:
///   onbrick plot onbrick-demo/run.mcap -o map.svg
///   onbrick plot left.mcap right.mcap -o both.html
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(in crate::cli) struct Arguments {
    /// Recordings.
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// The picture: .svg, .png, or .html for a page with zoom and a time slider.
    #[arg(short, long)]
    output: PathBuf,
    /// What stands above it.
    #[arg(long)]
    title: Option<String>,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let kind = Kind::of(&arguments.output)?;
    let runs = arguments.runs.iter().map(|path| open_run(path)).collect::<Result<Vec<_>, _>>()?;
    let scene = scene_of(&runs, arguments.title.as_deref());
    let failed =
        |error: &dyn std::error::Error| Failure::from_error(Exit::Failed, "cannot draw", error);
    let bytes = match kind {
        Kind::Svg => plot::svg(&scene).map_err(|error| failed(&error))?.into_bytes(),
        Kind::Png => plot::png(&scene).map_err(|error| failed(&error))?,
        Kind::Html => plot::html(&scene).into_bytes(),
    };
    write_file(&arguments.output, &bytes)?;
    output.show(
        format!("wrote {}", arguments.output.display()),
        &serde_json::json!({ "wrote": arguments.output }),
    );
    Ok(())
}

/// What kind of picture a file's name asks for.
#[derive(Debug, Clone, Copy)]
enum Kind {
    Svg,
    Png,
    Html,
}

impl Kind {
    fn of(file: &Path) -> Result<Self, Failure> {
        let ending = file.extension().map(|ending| ending.to_string_lossy().to_lowercase());
        match ending.as_deref() {
            Some("svg") => Ok(Self::Svg),
            Some("png") => Ok(Self::Png),
            Some("html") => Ok(Self::Html),
            _ => Err(Failure::new(
                Exit::Usage,
                format!("what kind of picture is {}?", file.display()),
            )
            .hint("a name that ends in .svg, .png or .html")),
        }
    }
}
