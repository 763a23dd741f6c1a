//! `onbrick plot`: runs as a picture.

use std::path::PathBuf;

use super::common::{open_run, scene_of, write_file};
use super::{Exit, Failure, Output};
use crate::report::plot;

/// Draw one or several runs: points red, paths green, walls grey where they are known.
///
/// Examples:
///   onbrick plot onbrick-demo/run.mcap -o map.svg
///   onbrick plot left.mcap right.mcap -o both.html
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Arguments {
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
    let runs = arguments.runs.iter().map(|path| open_run(path)).collect::<Result<Vec<_>, _>>()?;
    let scene = scene_of(&runs, arguments.title.as_deref());
    let failed = |error: &dyn std::error::Error| Failure::from_error(Exit::Failed, "cannot draw", error);
    let ending = arguments.output.extension().map(|ending| ending.to_string_lossy().to_lowercase());
    let bytes = match ending.as_deref() {
        Some("svg") => plot::svg(&scene).map_err(|error| failed(&error))?.into_bytes(),
        Some("png") => plot::png(&scene).map_err(|error| failed(&error))?,
        Some("html") => plot::html(&scene).into_bytes(),
        _ => {
            let name = arguments.output.display();
            return Err(Failure::new(Exit::Usage, format!("what kind of picture is {name}?"))
                .hint("a name that ends in .svg, .png or .html"));
        }
    };
    write_file(&arguments.output, &bytes)?;
    output.show(
        format!("wrote {}", arguments.output.display()),
        &serde_json::json!({ "wrote": arguments.output }),
    );
    Ok(())
}
