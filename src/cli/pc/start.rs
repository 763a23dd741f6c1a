//! `onbrick start`: a mission on bricks.

use std::path::{Path, PathBuf};

use super::remote::{Bricks, Unnamed, conclude};
use crate::cli::common::{pose, read_own};
use crate::cli::run::setting;
use crate::cli::{Failure, Output};
use crate::protocol::{Chosen, MAX_MISSION_BYTES, Started};

/// Start a mission on a brick: one that it has, by name, or a file of yours, which it checks as its
/// own and keeps with the run.
///
/// Examples:
///   onbrick start map ev3-blue
///   onbrick start ./my-mission.toml ev3-blue --set speed=120
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(in crate::cli) struct Arguments {
    /// The name of a mission of the brick's, or a mission file (a path with a / or the ending
    /// .toml).
    mission: PathBuf,
    #[command(flatten)]
    bricks: Bricks,
    /// The robot's pose at the start: metres, metres, degrees.
    #[arg(long, value_parser = pose, value_name = "X,Y,DEG", allow_hyphen_values = true)]
    pose: Option<[f64; 3]>,
    /// Give one of the mission's own numbers, or its time_limit_s, another value; can be repeated.
    #[arg(long, value_parser = setting, value_name = "NAME=VALUE")]
    set: Vec<(String, f64)>,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let mission = chosen(&arguments.mission)?;
    let asking = arguments.bricks.asking(Unnamed::TheOnly)?;
    let mut answers =
        asking.ask(|client, _| client.start(mission.clone(), arguments.pose, &arguments.set));
    if let Chosen::Text(_) = mission {
        let failures = answers.iter_mut().filter_map(|(_, answer)| answer.as_mut().err());
        failures.for_each(|failure| name_the_file(failure, &arguments.mission));
    }
    conclude(answers, output, |output, brick, started| {
        output.show(
            format!("{}: started {}{}", brick.name, started.run, limit(&started)),
            &serde_json::json!({
                "brick": brick.name, "run": started.run, "limited_s": started.limited_s
            }),
        );
    })
}

/// Where the brick's settings end it, if that is before its own time limit.
pub(super) fn limit(started: &Started) -> String {
    let limit = |limit_s| format!("; the brick's settings end it after {limit_s} s");
    started.limited_s.map(limit).unwrap_or_default()
}

/// A brick gets a file's text alone, and calls it `mission.toml`.
fn name_the_file(failure: &mut Failure, file: &Path) {
    let place = format!("--> {}:", file.display());
    failure.message = failure.message.replace("--> mission.toml:", &place);
}

/// Whether it is written as a file's path.
pub(super) fn names_a_file(mission: &Path) -> bool {
    mission.to_string_lossy().contains('/')
        || mission.extension().is_some_and(|ending| ending == "toml")
}

/// A file that is named as one, or the name of a mission that the brick has.
pub(super) fn chosen(mission: &Path) -> Result<Chosen, Failure> {
    if !names_a_file(mission) {
        return Ok(Chosen::Name(mission.to_string_lossy().into_owned()));
    }
    const WAY_OUT: &str = "a file that is there, or the name of a mission that the brick has";
    let source = read_own(mission, WAY_OUT)?.with_submachines(mission.parent());
    if source.text.len() > MAX_MISSION_BYTES {
        let message = format!(
            "{} has, with its sub-machines, more than the {MAX_MISSION_BYTES} bytes that a brick \
             takes over the network",
            source.name
        );
        return Err(Failure::refused(message).hint("copy it into the brick's folder of missions"));
    }
    Ok(Chosen::Text(source.text))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_finding_of_the_brick_names_the_file_that_was_sent() {
        let said = "blue: error: unknown key\n  --> mission.toml:3:8\n";
        let mut failure = Failure::refused(said);
        name_the_file(&mut failure, Path::new("./turn.toml"));
        assert_eq!(failure.message, "blue: error: unknown key\n  --> ./turn.toml:3:8\n");
    }
}
