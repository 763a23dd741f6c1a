//! `onbrick explain`: the pages of the documentation that are for users.

use clap::ValueEnum as _;

use crate::cli::{Failure, Output};

/// Show a page of the documentation: how missions are written, by examples, or how all of this is
/// used.
///
/// Example: onbrick explain missions | less
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(in crate::cli) struct Arguments {
    /// The page; without one, which there are.
    page: Option<Page>,
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
        Some(Page::Missions) => read_alone(include_str!("../../behavior/missions.md")),
        Some(Page::Using) => include_str!("../../USING.md").to_owned(),
        None => pages(),
    };
    output.text(&text, &serde_json::json!({ "text": text }));
    Ok(())
}

/// A page of the crate documentation without the addresses of its links, which are rustdoc's.
fn read_alone(page: &str) -> String {
    let lines = page.lines().filter(|line| !line.contains("]: crate::"));
    let text: String = lines.flat_map(|line| [line, "\n"]).collect();
    format!("{}\n", text.trim_end())
}

/// Which pages there are, a line each.
fn pages() -> String {
    let line = |page: &Page| {
        let value = page.to_possible_value()?;
        let what = value.get_help().map(ToString::to_string).unwrap_or_default();
        Some(format!("  onbrick explain {:<10}{what}\n", value.get_name()))
    };
    Page::value_variants().iter().filter_map(line).collect()
}
