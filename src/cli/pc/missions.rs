//! `onbrick missions`: what bricks can do.

use super::remote::{Bricks, Unnamed, conclude};
use crate::cli::{Failure, Output};

/// List the missions of bricks, a line each; with -v also what keeps any of them from being
/// started.
///
/// Examples:
///   onbrick missions ev3-blue
///   onbrick missions -v                    of every brick that is known, with all findings
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(in crate::cli) struct Arguments {
    #[command(flatten)]
    bricks: Bricks,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let asking = arguments.bricks.listing(Unnamed::All)?;
    let answers = asking.ask(|client, _| client.missions());
    conclude(answers, output, |output, brick, missions| {
        for mission in &missions.missions {
            // One that is not in order has none; the columns stay.
            let limit =
                mission.time_limit_s.map_or("-".to_owned(), |limit| format!("{limit:.0} s"));
            let short = mission.sha256.get(..8).unwrap_or_default();
            let findings = match &mission.findings {
                Some(text) if log::log_enabled!(log::Level::Info) => {
                    format!("\n{}", text.trim_end())
                }
                Some(_) => "  not in order: -v says why".to_owned(),
                None => String::new(),
            };
            output.line(format!("{}  {}  {limit}  {short}{findings}", brick.name, mission.name));
        }
        output.value(&serde_json::json!({ "brick": brick.name, "missions": missions.missions }));
    })
}
