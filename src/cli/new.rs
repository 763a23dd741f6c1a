//! `onbrick new`: a commented file to start from.

use std::path::PathBuf;

use super::common::shipped_mission;
use super::{Exit, Failure, Output};
use crate::behavior::shipped;

/// Write a commented template: a mission, a robot or a world.
///
/// Example: onbrick new mission my-mission.toml
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Arguments {
    /// What to write.
    what: What,
    /// Where to write it; without it, to the terminal.
    file: Option<PathBuf>,
    /// For a mission: start from a shipped one.
    #[arg(long, value_name = "NAME")]
    from: Option<String>,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum What {
    Mission,
    Robot,
    #[cfg(feature = "sim")]
    World,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let text = match arguments.what {
        What::Robot => crate::robot::DEFAULT_ROBOT,
        #[cfg(feature = "sim")]
        What::World => crate::sim::World::TEMPLATE,
        What::Mission => match &arguments.from {
            None => shipped::TEMPLATE,
            Some(name) => shipped_mission(name).ok_or_else(|| {
                let names = shipped::MISSIONS.map(|mission| mission.name).join(", ");
                Failure::new(Exit::Usage, format!("there is no shipped mission `{name}`"))
                    .hint(format!("one of {names}"))
            })?,
        },
    };
    let Some(path) = &arguments.file else {
        output.raw(text);
        return Ok(());
    };
    let written = std::fs::OpenOptions::new().write(true).create_new(true).open(path);
    written.and_then(|mut file| std::io::Write::write_all(&mut file, text.as_bytes())).map_err(|error| {
        let failure = Failure::from_error(Exit::Failed, &format!("cannot write {}", path.display()), &error);
        if error.kind() == std::io::ErrorKind::AlreadyExists {
            failure.hint("another name: a file that is there is never overwritten")
        } else {
            failure
        }
    })?;
    output.show(format!("wrote {}", path.display()), &serde_json::json!({ "wrote": path }));
    Ok(())
}
