//! `onbrick setup`: write `robot.toml` from what is plugged in.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::brick::brick_is_there;
use super::common::WRITABLE;
use super::terminal::{Driving, Terminal};
use super::{Exit, Failure, Output};
use crate::clock::MonotonicClock;
use crate::commissioning::SetupError;
use crate::document::save::{self, Readers, SaveError};
use crate::ev3dev::{LocalTree, Tree};

/// Write robot.toml from what is plugged in, asking which wheel moved.
///
/// Each motor turns for half a second, after it was announced.
///
/// Example: onbrick setup robot.toml
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Arguments {
    /// Where to write it.
    #[arg(default_value = "robot.toml")]
    file: PathBuf,
    /// Replace a file that is there; what was in it is kept beside it.
    #[arg(long)]
    force: bool,
    /// A file of answers, one a line, instead of asking.
    #[arg(long, value_name = "FILE")]
    answers: Option<PathBuf>,
    /// The folder under which sys/class is found.
    #[arg(long, default_value = "/")]
    brick: PathBuf,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let file = &arguments.file;
    if file.exists() && !arguments.force {
        return Err(not_written(&SaveError::Exists(file.clone())));
    }
    // Before any motor turns: the answers would be lost.
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
    if folder.is_some_and(|folder| !folder.is_dir()) {
        return Err(
            Failure::refused(format!("there is no folder for {}", file.display())).hint(WRITABLE)
        );
    }
    let tree: Arc<dyn Tree> = Arc::new(LocalTree::new(&arguments.brick));
    brick_is_there(&tree)?;
    let driving = Driving::begin(&arguments.brick, "onbrick setup")?;
    let flags = &driving.flags;
    let mut terminal = Terminal::open(arguments.answers.as_deref(), flags)?;
    let text = crate::commissioning::setup(&tree, &MonotonicClock, flags, &mut terminal)
        .map_err(|error| failed(file, &error))?;
    let kept = if arguments.force {
        save::replace(file, &text).map_err(|error| not_written(&error))?
    } else {
        save::create(file, &text, Readers::AsUsual).map_err(|error| not_written(&error))?;
        None
    };
    let was = what_was(kept.as_deref());
    output.show(
        format!("wrote {}{was}; next: onbrick doctor, onbrick calibrate", file.display()),
        &serde_json::json!({ "wrote": file, "kept": kept }),
    );
    Ok(())
}

/// Where the text is now that a file had before.
pub(super) fn what_was(kept: Option<&Path>) -> String {
    kept.map(|kept| format!(" (what was there is now {})", kept.display())).unwrap_or_default()
}

/// What was found before a motor turned is a refusal; what ends it later is a failure, as is every
/// end of the answers, which does not tell whether a motor has turned.
fn failed(file: &Path, error: &SetupError) -> Failure {
    let exit = match error {
        SetupError::TooFewMotors { .. } | SetupError::Find(_) => Exit::Refused,
        _ => Exit::Failed,
    };
    match error {
        SetupError::Findings(_) | SetupError::Stopped => Failure::new(exit, error.to_string()),
        error => {
            let doing = format!("{} is not written", file.display());
            Failure::from_error(exit, &doing, error)
        }
    }
}

pub(super) fn not_written(error: &SaveError) -> Failure {
    let failure = Failure::from_error(Exit::Refused, "nothing was written", error);
    match error {
        SaveError::Exists(_) => failure.hint("another name, or --force, which keeps a copy"),
        SaveError::Io { .. } => failure,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commissioning::NoAnswer;

    #[test]
    fn only_what_is_found_before_a_motor_turns_is_a_refusal() {
        for (error, exit) in [
            (SetupError::TooFewMotors { found: "none is" }, Exit::Refused),
            (SetupError::NoAnswer(NoAnswer::Closed), Exit::Failed),
            (SetupError::Stopped, Exit::Failed),
            (SetupError::NoWheel("left"), Exit::Failed),
        ] {
            assert_eq!(failed(Path::new("robot.toml"), &error).exit, exit, "{error}");
        }
    }
}
