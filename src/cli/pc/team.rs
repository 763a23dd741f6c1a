//! `onbrick team`: one mission on several bricks at the same time, and one map of what they found.
//!
//! ```text
//! check every brick ──▶ start all ──▶ follow and fetch, a thread a brick ──▶ one picture
//!   │ something is wrong                │ refused, Ctrl-C        │ lost
//!   └▶ a table; nothing moves           └▶ stop all, collect     └▶ the others go on
//! ```

use std::path::{Path, PathBuf};

use super::remote::{Asking, How, PATIENCES_S};
use super::start;
use crate::behavior::Capabilities;
use crate::cli::common::{load_mission, number_within};
use crate::cli::folder::RunFolder;
use crate::cli::run::{set_numbers, setting};
use crate::cli::{Failure, Output};
use crate::link::Team;
use crate::protocol::Chosen;
use crate::runtime::Source;

pub(super) mod check;
mod drive;
mod gather;

/// Run one mission on all bricks of a team at the same time, bring their recordings home, and put
/// their maps together.
///
/// Every brick is checked before anything moves: there, ready, the same version, the same mission,
/// a good battery. Ctrl-C stops them all and brings home what they have; twice, it only stops
/// waiting.
///
/// Examples:
///   onbrick new team team.toml             which bricks, and where each starts
///   onbrick status --team team.toml        who is ready, or why not
///   onbrick team team.toml
///   onbrick team team.toml ./my-mission.toml --out monday
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(in crate::cli) struct Arguments {
    /// The team's file.
    team: PathBuf,
    /// The mission, if not the file's: one that every brick has, or a file of yours (a path with a
    /// / or the ending .toml).
    mission: Option<PathBuf>,
    /// The folder for the recordings, map.svg, map.png, map.pgm, map.yaml, points.csv, path.csv and
    /// team.mcap; without it onbrick-team, or the next free one, onbrick-team-2.
    #[arg(short, long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Give one of the mission's own numbers, or its time_limit_s, another value; can be repeated.
    #[arg(long, value_parser = setting, value_name = "NAME=VALUE")]
    set: Vec<(String, f64)>,
    /// A driving brick that is not heard for this many seconds is given up; the others continue.
    #[arg(
        long,
        default_value_t = 60.0,
        value_parser = number_within(PATIENCES_S),
        value_name = "SECONDS",
    )]
    lost: f64,
    #[command(flatten)]
    how: How,
}

/// What all are to do.
#[derive(Debug)]
struct Wanted {
    chosen: Chosen,
    /// What it is called.
    name: String,
}

/// All that is known before anything starts.
#[derive(Debug)]
struct Plan<'p> {
    team: &'p Team,
    asking: &'p Asking,
    wanted: &'p Wanted,
    set: &'p [(String, f64)],
    out: &'p Path,
    lost_s: f64,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let (team, asking) = arguments.how.team(&arguments.team)?;
    let wanted = match &arguments.mission {
        Some(mission) => Some(wanted(mission, &arguments.set)?),
        None => wanted_by(&team, &arguments.team, &arguments.set)?,
    };
    let wanted = wanted.ok_or_else(|| {
        Failure::usage(format!("which mission? {} names none", arguments.team.display()))
            .hint("mission = \"map\" in the file, or onbrick team TEAM MISSION")
    })?;
    let checked = check::all(&asking, Some(&wanted));
    check::show(&checked, output);
    check::verdict(&checked, ", so none starts")?;
    let folder = RunFolder::of_team(arguments.out.as_deref())?;
    let plan = Plan {
        team: &team,
        asking: &asking,
        wanted: &wanted,
        set: &arguments.set,
        out: &folder.path,
        lost_s: arguments.lost,
    };
    let came = drive::all(&plan, output).inspect_err(|_| folder.take_back())?;
    gather::report(&came, output);
    let gathered = gather::merge(&plan, &came, output);
    folder.take_back();
    gather::verdict(&came, plan.out, output).and(gathered)
}

/// `onbrick status --team`: the table alone.
pub(super) fn show(team: &Path, how: &How, output: &mut Output) -> Result<(), Failure> {
    let (read, asking) = how.team(team)?;
    let wanted = wanted_by(&read, team, &[])?;
    let checked = check::all(&asking, wanted.as_ref());
    check::show(&checked, output);
    check::verdict(&checked, "")
}

/// The mission that a team's file names; a file's path is below the folder of the team's.
fn wanted_by(team: &Team, file: &Path, set: &[(String, f64)]) -> Result<Option<Wanted>, Failure> {
    let Some(mission) = team.mission.as_ref().map(Path::new) else { return Ok(None) };
    let below = || file.parent().unwrap_or(Path::new("")).join(mission);
    let mission = if start::names_a_file(mission) { below() } else { mission.to_owned() };
    wanted(&mission, set).map(Some)
}

/// A mission by name, or a file's text, which must be in order for some robot at least: whether it
/// is for theirs the bricks say. The numbers that are set must be a file's own; those of a name, a
/// brick knows.
fn wanted(mission: &Path, set: &[(String, f64)]) -> Result<Wanted, Failure> {
    let chosen = start::chosen(mission)?;
    let name = match &chosen {
        Chosen::Name(name) => name.clone(),
        Chosen::Text(text) => {
            let source = Source { name: mission.display().to_string(), text: text.clone() };
            let (mut mission, _) = load_mission(&source, &Capabilities::all())?;
            set_numbers(&mut mission, set)?;
            mission.name().to_owned()
        }
    };
    Ok(Wanted { chosen, name })
}
