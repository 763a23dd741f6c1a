//! `onbrick doctor`: every check before motion, as a report.

use std::path::PathBuf;
use std::sync::Arc;

use super::brick::{BrickFiles, is_dead, no_brick};
use super::common::{chosen_robot, read_robot};
use super::terminal::stop_flags;
use super::{Failure, Output};
use crate::clock::{MonotonicClock, wall_ns};
use crate::commissioning::{Patient, Verdict, examine};
use crate::ev3dev::Tree;
use crate::robot::DEFAULT_ROBOT;
use crate::runtime::Source;
use crate::units::counted;

/// Look at everything that a run needs, before anything moves.
///
/// Example: onbrick doctor --missions missions/
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Arguments {
    /// The robot's file, or the name of a shipped one; without it ./robot.toml, and where there is
    /// none the mapper.
    robot: Option<PathBuf>,
    /// Where recordings go.
    #[arg(long, value_name = "DIR", default_value = "onbrick-runs")]
    recordings: PathBuf,
    /// Check the missions in this folder, too.
    #[arg(long, value_name = "DIR")]
    missions: Option<PathBuf>,
    #[command(flatten)]
    brick: BrickFiles,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let flags = stop_flags()?;
    let tree: Arc<dyn Tree> = Arc::new(arguments.brick.tree());
    let robot = match chosen_robot(arguments.robot.as_deref(), output) {
        Some(path) => read_robot(&path),
        None => {
            output.line("with the shipped robot, the mapper: there is no robot.toml here");
            Ok(Source { name: "mapper.toml".to_owned(), text: DEFAULT_ROBOT.to_owned() })
        }
    };
    let patient = Patient {
        tree: &tree,
        clock: &MonotonicClock,
        flags: &flags,
        robot: robot.as_ref().map_err(|failure| {
            let to_do = failure.hint.as_deref();
            (failure.message.as_str(), to_do.unwrap_or("onbrick setup writes one"))
        }),
        root: Some(arguments.brick.root()),
        recordings: &arguments.recordings,
        missions: arguments.missions.as_deref(),
        wall_ns: wall_ns(),
    };
    if is_dead(arguments.brick.root()) {
        return Err(no_brick(arguments.brick.root()));
    }
    let diagnosis = examine(&patient);
    for checked in &diagnosis.checks {
        output.show(checked.to_string(), checked);
    }
    let warnings = match diagnosis.count(Verdict::Warning) {
        0 => String::new(),
        warnings => format!("; {}", counted(warnings, "warning")),
    };
    match diagnosis.count(Verdict::Failed) {
        0 => {
            output.line(format!("ready to drive{warnings}"));
            Ok(())
        }
        failed => Err(Failure::refused(format!("{} failed{warnings}", counted(failed, "check")))),
    }
}
