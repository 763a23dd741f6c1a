//! `onbrick graph`: a mission as a picture.

use std::path::PathBuf;

use super::common::{load_mission, read_mission};
use super::{Failure, Output};
use crate::behavior::{Capabilities, mermaid};

/// Draw a mission's machines as a Mermaid state diagram, for GitHub, Obsidian or mermaid.live.
///
/// Example: onbrick graph map > map.mmd
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Arguments {
    /// A mission file, or the name of a shipped mission.
    mission: PathBuf,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let source = read_mission(&arguments.mission)?;
    let (mission, _) = load_mission(&source, &Capabilities::all())?;
    let drawn = mermaid(&mission);
    output.text(&drawn, &serde_json::json!({ "mission": mission.name(), "mermaid": drawn }));
    Ok(())
}
