//! `onbrick replay`: the recorded senses through estimator and machines again.

use std::path::PathBuf;

use super::common::{load_robot, must_be_new, open_run};
use super::{Exit, Failure, Output};
use crate::runtime::{replay, replay_with};

/// Run estimator and machines again on what a run recorded, and compare; or see what another robot.toml makes of it.
///
/// Examples:
///   onbrick replay onbrick-demo/run.mcap
///   onbrick replay run.mcap --robot wider.toml --out wider.mcap
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Arguments {
    /// The recording.
    run: PathBuf,
    /// Another robot: the same senses make a new run, without a comparison.
    #[arg(long, requires = "out")]
    robot: Option<PathBuf>,
    /// Where the new run goes.
    #[arg(long, requires = "robot")]
    out: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let failed =
        |doing: &str, error: &dyn std::error::Error| Failure::from_error(Exit::Refused, doing, error);
    let name = arguments.run.display().to_string();
    let recorded = open_run(&arguments.run)?.run;
    if let (Some(robot), Some(out)) = (&arguments.robot, &arguments.out) {
        must_be_new(out)?;
        let robot = load_robot(Some(robot), output)?;
        let made = replay_with(&recorded, &robot.source, out)
            .map_err(|error| failed(&format!("cannot make {}", out.display()), &error))?;
        output.show(format!("{made}\nrecorded in {}", out.display()), &made);
        return Ok(());
    }
    let replayed = replay(&recorded).map_err(|error| failed(&format!("cannot replay {name}"), &error))?;
    output.show(replayed.to_string(), &replayed);
    if replayed.is_same() {
        Ok(())
    } else {
        Err(Failure::new(Exit::Failed, "the replay differs from what was recorded"))
    }
}
