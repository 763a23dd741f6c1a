//! `onbrick check`: is a mission in order?

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::common::{SHOW_MISSION, chosen_robot, load_robot, read_mission};
use super::{Failure, Output};
use crate::behavior::{Capabilities, Mission, submachines};
use crate::document::Finding;
use crate::runtime::Source;
use crate::units::counted;

/// Check missions and sub-machines: names, conditions, states that cannot be reached or left.
///
/// Example: onbrick check map my-mission.toml --robot robot.toml
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Arguments {
    /// Mission files, or names of shipped missions.
    #[arg(required = true)]
    missions: Vec<PathBuf>,
    /// The robot they are for; without it that of ./robot.toml, and where there is none, a mission
    /// may use any device there is, and is as fast as the shipped mapper at most.
    #[arg(long)]
    robot: Option<PathBuf>,
}

#[derive(Default, Serialize)]
struct Checked<'f> {
    mission: String,
    ok: bool,
    findings: Vec<&'f Finding>,
    /// The named motors and sensors that a robot for it has, where none was given.
    #[serde(skip_serializing_if = "<[String]>::is_empty")]
    needs: &'f [String],
    /// Why the file could not even be read.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<&'f str>,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let robot = chosen_robot(arguments.robot.as_deref(), output);
    let capabilities = match &robot {
        Some(path) => load_robot(Some(path))?.config.capabilities(),
        None => {
            let limits = load_robot(None)?.config.capabilities().limits;
            Capabilities { limits, ..Capabilities::all() }
        }
    };
    let (mut broken, mut has_all_hints) = (0_usize, true);
    for path in &arguments.missions {
        let source = match read_mission(path) {
            Ok(source) => source,
            Err(unread) => {
                broken += 1;
                show_unread(path, &unread, output);
                continue;
            }
        };
        let using = using_submachines(path, &source);
        let (mission, findings) = match using.as_ref().unwrap_or(&source).mission(&capabilities) {
            Ok((mission, warnings)) => (Some(mission), warnings),
            Err(findings) => (None, findings),
        };
        broken += usize::from(mission.is_none());
        let is_bare = |finding: &Finding| finding.hint.is_none();
        has_all_hints &= mission.is_some() || !findings.iter().any(is_bare);
        let needs = mission.as_ref().filter(|_| robot.is_none()).map(named);
        let needs = needs.unwrap_or_default();
        let checked = Checked {
            mission: source.name.clone(),
            ok: mission.is_some(),
            findings: findings.iter().collect(),
            needs: &needs,
            ..Checked::default()
        };
        let verdict = match &mission {
            None => "broken".to_owned(),
            // The mission around it is none that a person has written.
            Some(_) if using.is_some() => "in order: a part of missions".to_owned(),
            Some(mission) => summary(mission, &needs),
        };
        output.show(format!("{findings}{}: {verdict}", source.name), &checked);
    }
    if broken == 0 {
        return Ok(());
    }
    let are = if broken == 1 { "is" } else { "are" };
    let failure = Failure::refused(format!("{} {are} not in order", counted(broken, "mission")));
    Err(if has_all_hints { failure } else { failure.hint(SHOW_MISSION) })
}

/// A mission that uses each sub-machine of a file, where that has nothing else.
fn using_submachines(path: &Path, source: &Source) -> Option<Source> {
    let text = submachines::using(&source.text, &source.name)?;
    Some(Source { text, ..source.clone() }.with_submachines(path.parent()))
}

/// An unreadable file does not stop the check of the others.
fn show_unread(path: &Path, unread: &Failure, output: &mut Output) {
    let mission = path.display().to_string();
    let text = format!("{}\n{mission}: broken", unread.to_text());
    let error = Some(unread.message.as_str());
    output.show(text, &Checked { mission, error, ..Checked::default() });
}

/// The named motors and sensors of a mission, as a robot's file has them: a slip in such a name is
/// one that only that file could refute.
fn named(mission: &Mission) -> Vec<String> {
    let motors = mission.motors().iter().map(|name| format!("[motor.{name}]"));
    motors.chain(mission.sensors().iter().map(|name| format!("[sensor.{name}]"))).collect()
}

fn summary(mission: &Mission, needs: &[String]) -> String {
    let machines: Vec<String> = mission
        .machines()
        .iter()
        .map(|machine| format!("{} ({})", machine.name, counted(machine.states.len(), "state")))
        .collect();
    let robot = if needs.is_empty() { "" } else { "; for a robot with " };
    format!(
        "in order: {}, {} Hz, {} s at most{robot}{}",
        machines.join(", "),
        mission.rate_hz(),
        mission.time_limit_s(),
        needs.join(", ")
    )
}
