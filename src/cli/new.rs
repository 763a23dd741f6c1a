//! `onbrick new`: a commented file to start from.

use std::ffi::OsStr;
use std::path::PathBuf;

use super::common::{WRITABLE, must_be_new};
use super::{Failure, Output};
use crate::behavior::shipped::{self, Shipped};
use crate::document::one_of;
use crate::document::save::{self, Readers};
use crate::printable::with_causes;
use crate::robot::ROBOTS;

/// Write a commented file to start from: a mission, a sub-machine, a robot, a world, a team, or the
/// service's configuration.
///
/// Example: onbrick new mission my-mission.toml
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Arguments {
    /// What to write.
    what: What,
    /// Where to write it; without it, to the terminal.
    file: Option<PathBuf>,
    /// For a mission, a sub-machine, a robot or a world: start from a shipped one.
    #[arg(long, value_name = "NAME")]
    from: Option<String>,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum What {
    Mission,
    Submachine,
    Robot,
    #[cfg(feature = "sim")]
    World,
    Service,
    #[cfg(feature = "host")]
    Team,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let is_one = match arguments.what {
        What::Service => true,
        #[cfg(feature = "host")]
        What::Team => true,
        _ => false,
    };
    if is_one && arguments.from.is_some() {
        return Err(Failure::usage(
            "--from is for a mission, a sub-machine, a robot or a world: of the others there is \
             only one",
        ));
    }
    let submachine = arguments.from.as_deref().unwrap_or(shipped::SUBMACHINES[0].name);
    let text = match arguments.what {
        What::Robot => {
            let robots = ROBOTS.map(|robot| (robot.name, robot.text));
            start_from("robot", &robots, arguments.from.as_deref().unwrap_or(robots[0].0))?
        }
        What::Service => crate::service::config::DEFAULT_CONFIG,
        #[cfg(feature = "host")]
        What::Team => crate::link::team::TEMPLATE,
        #[cfg(feature = "sim")]
        What::World => match &arguments.from {
            None => crate::sim::World::TEMPLATE,
            Some(name) => start_from("world", &worlds(), name)?,
        },
        What::Mission => match &arguments.from {
            None => shipped::TEMPLATE,
            Some(name) => start_from("mission", &shipped::MISSIONS.map(pair), name)?,
        },
        What::Submachine => start_from("sub-machine", &shipped::SUBMACHINES.map(pair), submachine)?,
    };
    let Some(path) = &arguments.file else {
        output.text(text, &serde_json::json!({ "text": text }));
        return Ok(());
    };
    must_be_new(path)?;
    // By the name in the text its runs are called, or it is used.
    let name = path.file_stem().and_then(OsStr::to_str);
    let text = match (arguments.what, name) {
        (What::Mission, Some(name)) => &shipped::called(text, name),
        (What::Submachine, Some(name)) => &shipped::called_submachine(text, submachine, name),
        _ => text,
    };
    save::create(path, text, Readers::AsUsual)
        .map_err(|error| Failure::failed(with_causes(&error)).hint(WRITABLE))?;
    output.wrote(path);
    Ok(())
}

#[cfg(feature = "sim")]
fn worlds() -> Vec<(&'static str, &'static str)> {
    use crate::sim::World;
    World::names().filter_map(|name| Some((name, World::text(name)?))).collect()
}

fn pair(shipped: Shipped) -> (&'static str, &'static str) {
    (shipped.name, shipped.text)
}

/// The text of a shipped one, by its name.
fn start_from(
    what: &str,
    shipped: &[(&'static str, &'static str)],
    name: &str,
) -> Result<&'static str, Failure> {
    shipped.iter().find(|(known, _)| *known == name).map(|(_, text)| *text).ok_or_else(|| {
        Failure::usage(format!("there is no shipped {what} `{name}`"))
            .hint(one_of(name, shipped.iter().map(|(known, _)| *known)))
    })
}
