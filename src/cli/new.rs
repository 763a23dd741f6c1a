//! `onbrick new`: a commented file to start from.

use std::path::PathBuf;

use super::common::{must_be_new, shipped_mission};
use super::{Exit, Failure, Output};
use crate::behavior::shipped;
use crate::document::nearest;
use crate::document::save;
use crate::printable::with_causes;

/// Write a commented template: a mission, a robot, a world, a team, or the service's configuration.
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
    Service,
    #[cfg(feature = "host")]
    Team,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    if arguments.from.is_some() && !matches!(arguments.what, What::Mission) {
        return Err(Failure::new(
            Exit::Usage,
            "--from is only for a mission: of the others there is one to start from",
        ));
    }
    let text = match arguments.what {
        What::Robot => crate::robot::DEFAULT_ROBOT,
        What::Service => crate::service::config::DEFAULT_CONFIG,
        #[cfg(feature = "host")]
        What::Team => crate::link::team::TEMPLATE,
        #[cfg(feature = "sim")]
        What::World => crate::sim::World::TEMPLATE,
        What::Mission => match &arguments.from {
            None => shipped::TEMPLATE,
            Some(name) => shipped_mission(name).ok_or_else(|| {
                let names = shipped::MISSIONS.map(|mission| mission.name);
                let nearest =
                    nearest(name, names).map(|hint| format!("; {hint}")).unwrap_or_default();
                Failure::new(Exit::Usage, format!("there is no shipped mission `{name}`"))
                    .hint(format!("one of {}{nearest}", names.join(", ")))
            })?,
        },
    };
    let Some(path) = &arguments.file else {
        output.text(text, &serde_json::json!({ "text": text }));
        return Ok(());
    };
    must_be_new(path)?;
    save::create(path, text).map_err(|error| {
        Failure::new(Exit::Failed, with_causes(&error))
            .hint("a name in a folder that is there and can be written to")
    })?;
    output.show(format!("wrote {}", path.display()), &serde_json::json!({ "wrote": path }));
    Ok(())
}
