//! `onbrick calibrate`: measure wheels, track and range sensor by driving.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::brick::{BrickFiles, brick_is_there};
use super::common::load_robot;
use super::setup::{not_written, what_was};
use super::terminal::{Driving, Terminal};
use super::{Exit, Failure, Output};
use crate::clock::MonotonicClock;
use crate::commissioning::{ApplyError, CalibrateError, CalibrateOptions, Straight};
use crate::document::save;
use crate::ev3dev::Tree;

/// Measure wheel circumference, track width and the gyro's scale by driving, and write them into
/// robot.toml.
///
/// The robot drives before a wall (or a metre that you measure) and spins on the spot, in both
/// directions, at best in a corner or between things: there its range sensor tells a whole turn,
/// and with it what the gyro counts too much. Nothing is written where the measurements are not
/// sure enough. Ctrl-C, and a button on the brick, stop it at once.
///
/// With `--only range` it measures what the range sensor reads too far: have a measuring tape at
/// hand. With `--only own-echoes` it finds where that sensor hears the robot itself.
///
/// Examples:
///   onbrick calibrate                      wheels and track, asking what is needed
///   onbrick calibrate --only track --mark  by spins that you mark on the floor
///   onbrick calibrate --only range         bias and scale of the range sensor, after the wheels
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Arguments {
    /// The robot's file; the new numbers are written into it, and what was there is kept beside it.
    #[arg(default_value = "robot.toml")]
    robot: PathBuf,
    /// Measure only this: wheels' circumference or track, the range sensor's errors, or where it
    /// hears the robot itself.
    #[arg(long)]
    only: Option<Only>,
    /// How to measure the circumference, instead of asking.
    #[arg(long)]
    straight: Option<How>,
    /// Mark two spins by a line on the floor, which measures the gyro's scale too, instead of by
    /// the range sensor.
    #[arg(long)]
    mark: bool,
    /// Mark no spins: trust the gyro where the range sensor does not tell its scale.
    #[arg(long, conflicts_with = "mark")]
    no_mark: bool,
    /// How often each motion is driven in each direction.
    #[arg(long, value_parser = clap::value_parser!(u32).range(2..=20))]
    pairs: Option<u32>,
    /// Measure and say, and write nothing.
    #[arg(long)]
    dry_run: bool,
    /// A file of answers, one a line, instead of asking.
    #[arg(long, value_name = "FILE")]
    answers: Option<PathBuf>,
    #[command(flatten)]
    brick: BrickFiles,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Only {
    Circumference,
    Track,
    Range,
    OwnEchoes,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum How {
    Wall,
    Metre,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    // The name of a shipped robot is no file that numbers can be written into.
    if !arguments.robot.is_file() {
        let message = format!("there is no file {}", arguments.robot.display());
        return Err(Failure::refused(message).hint(format!(
            "onbrick setup {0}, or onbrick new robot {0}, which write one",
            arguments.robot.display()
        )));
    }
    let robot = load_robot(Some(&arguments.robot))?;
    let tree: Arc<dyn Tree> = Arc::new(arguments.brick.tree());
    brick_is_there(&tree)?;
    let driving = Driving::begin(arguments.brick.root(), "onbrick calibrate")?;
    let flags = &driving.flags;
    let mut terminal = Terminal::open(arguments.answers.as_deref(), flags)?;
    let calibration = crate::commissioning::calibrate(
        &tree,
        &MonotonicClock,
        flags,
        &mut terminal,
        &robot.config,
        &options(arguments),
    )
    .map_err(|error| failed(&error))?;
    for (key, measured) in calibration.measured() {
        output.line(format!(
            "{key}: {:.6} before, {:.6} now ± {:.6}",
            measured.before, measured.after, measured.standard_error
        ));
    }
    if let Some(scale) = calibration.gyro_scale {
        output.line(format!("gyro.scale: {:.6} before, {scale:.6} now", robot.config.gyro_scale));
    }
    output.value(&calibration);
    let text =
        calibration.apply(&robot.source).map_err(|error| unsure(&arguments.robot, &error))?;
    if arguments.dry_run {
        return Ok(());
    }
    let kept = save::replace(&arguments.robot, &text).map_err(|error| not_written(&error))?;
    output.line(format!("wrote {}{}", arguments.robot.display(), what_was(kept.as_deref())));
    Ok(())
}

fn options(arguments: &Arguments) -> CalibrateOptions {
    let straight = match arguments.straight {
        None => Straight::Ask,
        Some(How::Wall) => Straight::Wall,
        Some(How::Metre) => Straight::Metre,
    };
    CalibrateOptions {
        straight: matches!(arguments.only, None | Some(Only::Circumference)).then_some(straight),
        track: matches!(arguments.only, None | Some(Only::Track)),
        range: arguments.only == Some(Only::Range),
        own_echoes: arguments.only == Some(Only::OwnEchoes),
        mark: (arguments.mark || arguments.no_mark).then_some(arguments.mark),
        pairs: arguments.pairs,
    }
}

/// What was found before anything moved is a refusal; what went wrong on the way is a failure, as
/// is every end of the answers, which does not tell whether a motor has turned.
fn failed(error: &CalibrateError) -> Failure {
    let exit = match error {
        CalibrateError::Lost { .. }
        | CalibrateError::Blocked
        | CalibrateError::WallLost
        | CalibrateError::NoRoom { .. }
        | CalibrateError::Exchanged(_)
        | CalibrateError::TooFar(_)
        | CalibrateError::Stopped
        | CalibrateError::NoAnswer(_) => Exit::Failed,
        _ => Exit::Refused,
    };
    Failure::from_error(exit, "not calibrated", error)
}

fn unsure(robot: &Path, error: &ApplyError) -> Failure {
    let stays = format!("{} stays as it is", robot.display());
    match error {
        ApplyError::Findings(findings) => {
            Failure::failed(format!("{stays}; with the new numbers:\n{findings}"))
        }
        error => Failure::from_error(Exit::Failed, &stays, error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commissioning::NoAnswer;

    #[test]
    fn only_what_is_found_before_anything_moves_is_a_refusal() {
        for (error, exit) in [
            (CalibrateError::NoHead, Exit::Refused),
            (CalibrateError::NoRange, Exit::Refused),
            (CalibrateError::NoWall("the wall is 3 m off".to_owned()), Exit::Refused),
            (CalibrateError::WallLost, Exit::Failed),
            (CalibrateError::NoRoom { at_m: 0.4 }, Exit::Failed),
            (CalibrateError::Stopped, Exit::Failed),
            (CalibrateError::NoAnswer(NoAnswer::Closed), Exit::Failed),
        ] {
            assert_eq!(failed(&error).exit, exit, "{error}");
        }
    }
}
