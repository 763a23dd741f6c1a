//! `onbrick missions`: what bricks can do.

use super::remote::{Bricks, Unnamed, conclude};
use super::{Failure, Output};

/// List the missions of bricks, with what keeps any of them from being started.
///
/// Examples:
///   onbrick missions ev3-blue
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Arguments {
    #[command(flatten)]
    bricks: Bricks,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let asking = arguments.bricks.asking(Unnamed::All)?;
    let answers = asking.ask(|client, _| client.missions());
    conclude(answers, output, |output, brick, missions| {
        for mission in &missions.missions {
            let limit = mission.time_limit_s.map(|limit| format!("  {limit:.0} s")).unwrap_or_default();
            let short = mission.sha256.get(..8).unwrap_or_default();
            let findings = mission.findings.as_ref();
            let findings = findings.map(|text| format!("\n{}", text.trim_end())).unwrap_or_default();
            output.line(format!("{}  {}{limit}  {short}{findings}", brick.name, mission.name));
        }
        output.value(&serde_json::json!({ "brick": brick.name, "missions": missions.missions }));
    })
}
