//! `onbrick replay`: the recorded senses through estimator and machines again.

use std::path::{Path, PathBuf};

use clap::ArgGroup;
use serde::Serialize;

use super::common::{WRITABLE, load_robot, method, must_be_new, open_run};
use super::{Exit, Failure, Output};
use crate::mapping::Method;
use crate::runtime::{ReplayError, Replayed, replay, replay_with};
use crate::units::counted;

/// Run estimator and machines again on what a run recorded, and compare; or see what another
/// robot.toml, or another way of estimating, makes of it.
///
/// Examples:
///   onbrick replay onbrick-demo/run.mcap
///   onbrick replay onbrick-runs/*/run.mcap
///   onbrick replay run.mcap --robot wider.toml --out wider.mcap
///   onbrick replay run.mcap --method odometry --out odometry.mcap
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment, group(ArgGroup::new("other").multiple(true)))]
pub(super) struct Arguments {
    /// The recordings; several are replayed one after the other.
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// Another robot: the same senses make a new run, without a comparison.
    #[arg(long, requires = "out", group = "other")]
    robot: Option<PathBuf>,
    /// Another way of estimating poses and placing points.
    #[arg(long, value_parser = method(), requires = "out", group = "other")]
    method: Option<Method>,
    /// Where the new run goes.
    #[arg(long, requires = "other")]
    out: Option<PathBuf>,
}

/// What became of one of several recordings.
#[derive(Serialize)]
struct Named<'r> {
    run: &'r Path,
    #[serde(flatten)]
    replayed: &'r Replayed,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    match (arguments.runs.as_slice(), &arguments.out) {
        ([run], Some(out)) => remake(run, arguments, out, output),
        (_, Some(_)) => Err(Failure::usage("--out is for one recording").hint("once for each")),
        ([run], None) => again(run, false, output),
        (several, None) => {
            let failures: Vec<Failure> = several
                .iter()
                .filter_map(|run| again(run, true, output).err())
                .inspect(|failure| {
                    let text = failure.to_text();
                    // The log begins with it itself.
                    log::error!("{}", text.strip_prefix("error: ").unwrap_or(&text));
                })
                .collect();
            let worst = failures.iter().map(|failure| failure.exit).max_by_key(|exit| *exit as u8);
            worst.map_or(Ok(()), |exit| Err(Failure::new(exit, how_many(&failures, several.len()))))
        }
    }
}

/// How many recordings differ, and how many could not be replayed.
fn how_many(failures: &[Failure], all: usize) -> String {
    let differ = failures.iter().filter(|failure| failure.exit == Exit::Failed).count();
    let all = counted(all, "recording");
    let told = [
        (differ, "did not replay as they were made"),
        (failures.len() - differ, "could not be replayed"),
    ];
    let told = told.into_iter().filter(|(count, _)| *count > 0);
    told.map(|(count, what)| format!("{count} of {all} {what}")).collect::<Vec<_>>().join(", ")
}

/// Replays a run and compares; `named` where it is one of several.
fn again(run: &Path, named: bool, output: &mut Output) -> Result<(), Failure> {
    let recorded = open_run(run)?.run;
    let replayed = replay(&recorded)
        .map_err(|error| failure(&format!("cannot replay {}", run.display()), &error))?;
    if named {
        output.show(format!("{}: {replayed}", run.display()), &Named { run, replayed: &replayed });
    } else {
        output.show(replayed.to_string(), &replayed);
    }
    if replayed.is_same() {
        Ok(())
    } else {
        let message = format!("the replay of {} differs from what was recorded", run.display());
        Err(Failure::failed(message))
    }
}

/// Makes another run from a run's senses.
fn remake(
    run: &Path,
    arguments: &Arguments,
    out: &Path,
    output: &mut Output,
) -> Result<(), Failure> {
    let recorded = open_run(run)?.run;
    must_be_new(out)?;
    let robot = arguments.robot.as_deref().map(|robot| load_robot(Some(robot))).transpose()?;
    let robot = robot.as_ref().map(|robot| &robot.source);
    let made = replay_with(&recorded, robot, arguments.method, out).map_err(|error| {
        let failure = failure(&format!("cannot make {}", out.display()), &error);
        // A part of a run is none that was asked for, and would be in the way of the next try.
        let began = std::fs::remove_file(out).is_ok();
        if began { Failure { exit: Exit::Failed, ..failure } } else { failure }
    })?;
    output.show(format!("{made}\nrecorded in {}", out.display()), &made);
    Ok(())
}

fn failure(doing: &str, error: &ReplayError) -> Failure {
    let failure = Failure::from_error(Exit::Refused, doing, error);
    match error {
        ReplayError::Beheaded(_) => failure.hint("onbrick plot, which draws what is left"),
        ReplayError::Record(_) => failure.hint(WRITABLE),
        _ => failure,
    }
}
