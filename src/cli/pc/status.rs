//! `onbrick status`: how bricks are.

use super::remote::{Bricks, Unnamed, conclude};
use crate::cli::{Failure, Output};
use crate::protocol::{RunStatus, Status, whose};
use crate::units::counted;

/// Show the bricks' state: battery, what they do, or how their last run ended.
///
/// Examples:
///   onbrick status                         all bricks that are known
///   onbrick status ev3-blue --json
///   onbrick status --team team.toml        one table: who is ready, or why not
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(in crate::cli) struct Arguments {
    #[command(flatten)]
    bricks: Bricks,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    if let Some(team) = &arguments.bricks.team {
        return super::team::show(team, &arguments.bricks.how, output);
    }
    let asking = arguments.bricks.asking(Unnamed::All)?;
    let answers = asking.ask(|client, _| client.status());
    conclude(answers, output, |output, brick, status| {
        let battery = battery(&status);
        let text = format!(
            "{}  {}  {battery}  onbrick {}{}",
            brick.name,
            status.state,
            status.version,
            doing(&status)
        );
        output.show(text, &serde_json::json!({ "brick": brick.name, "status": status }));
    })
}

/// The battery, for people.
pub(super) fn battery(status: &Status) -> String {
    match (status.battery_v, status.simulated) {
        (Some(volts), true) => format!("simulated, {volts:.1} V"),
        (Some(volts), false) => format!("{volts:.1} V"),
        (None, true) => "simulated".to_owned(),
        (None, false) => "no battery".to_owned(),
    }
}

fn doing(status: &Status) -> String {
    let mut lines = String::new();
    if let Some(run) = &status.run {
        lines.push_str(&format!("\n  {}", going(run)));
    } else if let Some(last) = &status.last {
        // Without a mission it is why none can start.
        lines.push_str(&match (&last.run, last.mission.as_str()) {
            (_, "") => format!("\n  {last}"),
            (Some(run), mission) => format!("\n  last: {mission} ({run}): {last}"),
            (None, mission) => format!("\n  last: {mission}: {last}"),
        });
    }
    if let Some(who) = &status.taken {
        lines.push_str(&format!("\n  {who}"));
    }
    if let Some(finding) = &status.robot {
        lines.push_str(&format!("\n  robot: {}", finding.trim_end()));
    }
    if let Some(finding) = &status.clock {
        lines.push_str(&format!("\n  clock: {finding}"));
    }
    if status.link != "ready" {
        lines.push_str(&format!("\n  link: {}", status.link));
    }
    lines
}

/// A run that is going on, in one line.
pub(super) fn going(run: &RunStatus) -> String {
    let how = match (&run.progress, &run.waits) {
        (Some(progress), _) => {
            let states: Vec<&str> =
                progress.states.iter().map(|(_, state)| state.as_str()).collect();
            format!(
                "{:.0} of {:.0} s, {:.1} m, {}; {}",
                crate::clock::seconds(progress.elapsed_ns),
                run.time_limit_s,
                progress.travelled_m,
                counted(progress.points, "point"),
                states.join(", ")
            )
        }
        (None, Some(waits)) => format!("waits: {waits}"),
        (None, None) => "just begun".to_owned(),
    };
    format!("{} ({}), started {}: {how}", run.mission, run.run, whose(&run.by))
}
