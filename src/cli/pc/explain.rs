//! `onbrick explain`: the pages of the documentation that are for users.

use crate::cli::{Failure, Output};

/// Show a page of the documentation: how missions are written, by examples, or how all of this is
/// used.
///
/// Example: onbrick explain missions | less
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(in crate::cli) struct Arguments {
    /// The page.
    page: Page,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Page {
    /// The mission language, by examples.
    Missions,
    /// Missions, other programs on the simulated brick, bricks in the network, teams, recordings.
    Using,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let text = match arguments.page {
        Page::Missions => include_str!("../../behavior/missions.md"),
        Page::Using => include_str!("../../USING.md"),
    };
    output.text(text, &serde_json::json!({ "text": text }));
    Ok(())
}
