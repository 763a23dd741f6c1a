//! What several commands do: find a file by path or by name, load a robot, a mission or a world.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::builder::{PossibleValuesParser, TypedValueParser};

#[cfg(feature = "host")]
use super::output::safe;
use super::{Context, Exit, Failure, Hint, Output};
use crate::behavior::{Capabilities, Mission};
use crate::clock::wall_ns;
#[cfg(feature = "sim")]
use crate::document::save::{self, Readers};
use crate::document::{Findings, one_of};
use crate::mapping::Method;
#[cfg(feature = "sim")]
use crate::mapping::Pose;
#[cfg(feature = "host")]
use crate::page::PageError;
use crate::printable::with_causes;
use crate::recording::{ReadError, Run};
use crate::robot::{DEFAULT_ROBOT, ROBOTS, RobotConfig, ShippedRobot};
use crate::runtime::{Brick, Environment, Event, Job, ProcessError, Refused, Source};

/// This program's own file.
pub(super) fn own_program() -> Result<PathBuf, Failure> {
    std::env::current_exe().context(Exit::Failed, "cannot find this program")
}

/// Makes a folder, and those that it lies in, where they are not there.
pub(super) fn make_folder(exit: Exit, folder: &Path) -> Result<(), Failure> {
    let made = std::fs::create_dir_all(folder);
    made.context(exit, format_args!("cannot make {}", folder.display())).hint(WRITABLE)
}

/// The way out where a file or a folder cannot be made.
pub(super) const WRITABLE: &str =
    "a name in a folder that is there and can be written to, on a disk with room";

/// A robot's file as it was read, and what it says.
#[derive(Debug)]
pub(super) struct LoadedRobot {
    pub(super) source: Source,
    pub(super) config: RobotConfig,
}

/// Reads a file, or takes a built-in text by its name. A name is a path only with a folder before
/// it (`./arena`) or an ending (`arena.toml`): the files of the working folder never change what a
/// name means.
pub(super) fn read_source(
    path: &Path,
    carried: impl Fn(&str) -> Option<&'static str>,
) -> Result<Source, Failure> {
    let name = path.to_string_lossy();
    if let Some(text) = carried(&name) {
        if path.is_file() {
            log::warn!("`{name}` is the built-in one; the file is ./{name}");
        }
        return Ok(Source { name: format!("{name}.toml"), text: text.to_owned() });
    }
    Ok(Source::of(&name, &read_bounded(path)?)?)
}

/// Reads a file that a person wrote; `hint` is the way out where there is none of this name.
#[cfg(feature = "sim")]
pub(super) fn read_own(path: &Path, hint: &str) -> Result<Source, Failure> {
    // An existing file's own error says what is wrong with it.
    read_source(path, |_| None)
        .map_err(|failure| if path.is_file() { failure } else { failure.hint(hint) })
}

/// Reads a mission's file, or takes a shipped one, with the sub-machines that it uses.
pub(super) fn read_mission(path: &Path) -> Result<Source, Failure> {
    let source = read_source(path, shipped_mission).map_err(|failure| {
        let names = crate::behavior::shipped::MISSIONS.map(|mission| mission.name);
        hint_at_names(failure, path, "mission", &names)
    })?;
    // The files of the working folder do not change what a shipped mission is either.
    let is_shipped = shipped_mission(&path.to_string_lossy()).is_some();
    Ok(source.with_submachines(path.parent().filter(|_| !is_shipped)))
}

/// The hint if an argument is neither a file nor a known name. An existing file's own error says
/// what is wrong with it.
fn hint_at_names(failure: Failure, path: &Path, what: &str, names: &[&str]) -> Failure {
    if path.is_file() {
        return failure;
    }
    let file = Path::new(".").join(path).with_extension("toml");
    if file.is_file() {
        return failure.hint(format!("{}, where that file is meant", file.display()));
    }
    let names = one_of(&path.to_string_lossy(), names.iter().copied());
    failure.hint(format!("a {what}'s file, or {names}"))
}

/// Reads a file that a person names, as far as a document may be long.
pub(super) fn read_bounded(path: &Path) -> Result<Vec<u8>, Failure> {
    let read = crate::document::read_bounded(path);
    let read = read.context(Exit::Refused, format_args!("cannot read {}", path.display()));
    if path.is_file() { read.hint("a file that you may read") } else { read }
}

/// Reads a recording's file, however long it is.
#[cfg(feature = "host")]
pub(super) fn read_file(path: &Path) -> Result<Vec<u8>, Failure> {
    std::fs::read(path).context(Exit::Failed, format_args!("cannot read {}", path.display()))
}

pub(super) const SHOW_MISSION: &str = "onbrick new mission, which shows a whole file with comments";
const SHOW_ROBOT: &str = "onbrick new robot, which shows a whole file with comments";

/// The robot of the working folder, as `setup` writes it.
const OWN_ROBOT: &str = "robot.toml";

/// The robot's file that a person names, or that of the working folder, if there is one.
pub(super) fn chosen_robot(named: Option<&Path>, output: &mut Output) -> Option<PathBuf> {
    let own = Path::new(OWN_ROBOT);
    if named.is_none() && own.is_file() {
        output.line(format!("with the robot of {OWN_ROBOT}"));
    }
    named.or(own.is_file().then_some(own)).map(Path::to_owned)
}

/// Reads a robot's file, or takes a shipped one by its name.
pub(super) fn read_robot(path: &Path) -> Result<Source, Failure> {
    read_source(path, ShippedRobot::text).map_err(|failure| {
        let names = ROBOTS.map(|robot| robot.name);
        let failure = hint_at_names(failure, path, "robot", &names);
        if path.is_file() { failure.hint(SHOW_ROBOT) } else { failure }
    })
}

/// Loads a robot's file or a shipped one; warnings go to the log.
pub(super) fn load_robot(path: Option<&Path>) -> Result<LoadedRobot, Failure> {
    let source = match path {
        Some(path) => read_robot(path)?,
        None => Source { name: "robot.toml".to_owned(), text: DEFAULT_ROBOT.to_owned() },
    };
    let (config, warnings) = source.robot().map_err(Failure::from).hint(SHOW_ROBOT)?;
    warn(&warnings);
    Ok(LoadedRobot { source, config })
}

/// The text of a shipped mission.
pub(super) fn shipped_mission(name: &str) -> Option<&'static str> {
    crate::behavior::shipped::find(name).map(|mission| mission.text)
}

/// Loads a mission for a robot.
pub(super) fn load_mission(
    source: &Source,
    capabilities: &Capabilities,
) -> Result<(Mission, Findings), Failure> {
    source.mission(capabilities).map_err(|findings| broken_mission(source, &findings))
}

/// The failure of a mission that does not load, with the way out that fits: it may want more than
/// the robot has.
fn broken_mission(source: &Source, findings: &Findings) -> Failure {
    let fits = |capabilities: &Capabilities| source.mission(capabilities).is_ok();
    let hint = if fits(&Capabilities::all()) {
        let shipped = ROBOTS.iter().find(|robot| {
            RobotConfig::load(robot.name, robot.text.as_bytes())
                .is_ok_and(|(config, _)| fits(&config.capabilities()))
        });
        let other = shipped.map_or_else(
            || "FILE, a robot that has it (onbrick new robot FILE writes one)".to_owned(),
            |robot| format!("{}, which has it", robot.name),
        );
        format!(
            "the mission is in order and wants another robot: plug in what is missing and let \
             onbrick setup write a robot.toml; or --robot {other}"
        )
    } else {
        SHOW_MISSION.to_owned()
    };
    Failure::refused(findings.to_string()).hint(hint)
}

/// Puts warnings to the log: the file is usable.
pub(super) fn warn(findings: &Findings) {
    for finding in findings {
        log::warn!("{finding}");
    }
}

/// `x,y,deg` of `--pose`: metres, metres, degrees.
pub(super) fn pose(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> =
        text.split(',').map(|part| part.trim().parse::<f64>()).collect();
    let numbers = numbers.map_err(|_| "a pose is x,y,deg: metres, metres, degrees")?;
    let pose: [f64; 3] = numbers.try_into().map_err(|_| "a pose has three numbers: x,y,deg")?;
    /// Poses farther away than this are slips of the pen.
    const FARTHEST: f64 = 1e6;
    if pose.iter().all(|number| number.abs() <= FARTHEST) {
        Ok(pose)
    } else {
        Err("a pose's numbers are small and finite".to_owned())
    }
}

/// Reads an estimator's method; shells complete its words.
pub(super) fn method() -> impl TypedValueParser<Value = Method> {
    let words = Method::WORDS.map(|(word, _)| word);
    PossibleValuesParser::new(words).try_map(|word| word.parse::<Method>())
}

/// Reads an option's number, which must be within limits.
pub(super) fn number_within<T: FromStr + PartialOrd + Display + Clone>(
    limits: RangeInclusive<T>,
) -> impl Fn(&str) -> Result<T, String> + Clone {
    move |text| {
        let number: T = text.parse().map_err(|_| "not a number".to_owned())?;
        if limits.contains(&number) {
            Ok(number)
        } else {
            Err(format!("it can be {} to {}", limits.start(), limits.end()))
        }
    }
}

/// A recording that was read.
#[derive(Debug)]
pub(super) struct LoadedRun {
    #[cfg(feature = "host")]
    pub(super) path: PathBuf,
    #[cfg(feature = "host")]
    pub(super) name: String,
    pub(super) run: Run,
}

impl LoadedRun {
    /// The brick's name, or the file's where the recording does not say.
    #[cfg(feature = "host")]
    pub(super) fn brick(&self) -> &str {
        self.run
            .info
            .as_ref()
            .map(|info| info.brick.as_str())
            .filter(|name| !name.is_empty())
            .unwrap_or(&self.name)
    }
}

/// What the stamps of a simulated run count from: now, as a real one's do. A program gets the same
/// bytes for the same seed.
pub(super) fn stamps_ns(output: &Output) -> i64 {
    if output.is_json() { 0 } else { wall_ns() }
}

/// Reads a finished recording; what a person should know about it goes to the log.
pub(super) fn open_run(path: &Path) -> Result<LoadedRun, Failure> {
    read_run(path).map(|loaded| warned(path, loaded))
}

/// Reads finished recordings. A file of several runs is left out where it is not alone: `*.mcap` in
/// a team's folder names its team.mcap, too.
#[cfg(feature = "host")]
pub(super) fn open_runs(paths: &[PathBuf]) -> Result<Vec<LoadedRun>, Failure> {
    let mut runs = Vec::new();
    let mut left_out = None;
    for path in paths {
        match read(path) {
            Ok(loaded) => runs.push(warned(path, loaded)),
            Err(error @ ReadError::NotOneRun) if paths.len() > 1 => {
                log::warn!("{} is left out: {error}", path.display());
                left_out = Some(unusable(path, &error));
            }
            Err(error) => return Err(unusable(path, &error)),
        }
    }
    left_out.filter(|_| runs.is_empty()).map_or(Ok(runs), Err)
}

/// Reads a recording, be it one that still grows: its end is missing, and that is no fault.
pub(super) fn read_run(path: &Path) -> Result<LoadedRun, Failure> {
    read(path).map_err(|error| unusable(path, &error))
}

fn read(path: &Path) -> Result<LoadedRun, ReadError> {
    Ok(LoadedRun {
        #[cfg(feature = "host")]
        path: path.to_owned(),
        #[cfg(feature = "host")]
        name: path.display().to_string(),
        run: Run::open(path)?,
    })
}

fn warned(path: &Path, loaded: LoadedRun) -> LoadedRun {
    for warning in &loaded.run.warnings {
        log::warn!("{}: {warning}", path.display());
    }
    loaded
}

fn unusable(path: &Path, error: &ReadError) -> Failure {
    let message = match error {
        // This one names the file itself.
        ReadError::Io { .. } => with_causes(error),
        _ => format!("cannot use {}: {}", path.display(), with_causes(error)),
    };
    Failure::refused(message).hint("a run.mcap that `onbrick run` or `onbrick demo` has written")
}

/// Refuses to write over a file that is there.
pub(super) fn must_be_new(path: &Path) -> Result<(), Failure> {
    if path.exists() {
        return Err(Failure::refused(format!("{} is there already", path.display()))
            .hint("another name: a file that is there is never written over"));
    }
    Ok(())
}

/// Writes a file that can be made again, whole or not at all: over one of the same kind, and over
/// no other.
#[cfg(feature = "sim")]
pub(super) fn write_file(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    may_write(path, bytes)?;
    save::write(path, bytes, Readers::AsUsual)
        .map_err(|error| Failure::failed(with_causes(&error)).hint(WRITABLE))
}

/// Refuses to write over a file of another kind.
#[cfg(feature = "sim")]
pub(super) fn may_write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    if !path.is_file() || begins_alike(path, bytes) {
        return Ok(());
    }
    Err(Failure::refused(format!("{} is there already, and of another kind", path.display()))
        .hint("another name, or move that file away: only one of its kind is written over"))
}

/// Whether a file begins as these bytes do, or is empty. As many bytes are compared as PNG and MCAP
/// have for telling what they are; a table begins with its columns' names.
#[cfg(feature = "sim")]
fn begins_alike(path: &Path, bytes: &[u8]) -> bool {
    use std::io::Read as _;
    const KIND_BYTES: usize = 8;
    let mut there = Vec::new();
    let read = std::fs::File::open(path)
        .and_then(|file| file.take(KIND_BYTES as u64).read_to_end(&mut there));
    read.is_ok() && (there.is_empty() || bytes.get(..KIND_BYTES) == Some(&there[..]))
}

/// Reads a world's file, or takes a built-in one; the pose is the first robot's start.
#[cfg(feature = "sim")]
pub(super) fn load_world(path: &Path) -> Result<(Source, Pose), Failure> {
    let source = read_source(path, crate::sim::World::text).map_err(|failure| {
        let names = crate::sim::World::names().collect::<Vec<_>>();
        hint_at_names(failure, path, "world", &names)
    })?;
    const SHOWN: &str = "onbrick new world, which shows a whole file with comments";
    let (world, warnings) = source.world().map_err(Failure::from).hint(SHOWN)?;
    warn(&warnings);
    let start = world.starts().first();
    let start =
        start.map(|start| Pose { x_m: start.x_m, y_m: start.y_m, heading_rad: start.heading_rad });
    Ok((source, start.unwrap_or_default()))
}

/// What a person sees of a run in progress.
#[derive(Debug)]
pub(super) struct Progress {
    #[cfg(feature = "host")]
    bar: Option<indicatif::ProgressBar>,
}

impl Progress {
    /// A bar over the mission's time, on a terminal only, and not among the lines of `-v`.
    pub(super) fn new(mission: &Mission, output: &Output) -> Self {
        #[cfg(feature = "host")]
        {
            let bar =
                (output.is_watched() && !log::log_enabled!(log::Level::Info)).then(|| bar(mission));
            Self { bar }
        }
        #[cfg(not(feature = "host"))]
        {
            let _ = (mission, output);
            Self {}
        }
    }

    /// Shows an event to a person.
    pub(super) fn show(&self, event: &Event) {
        match event {
            Event::Preparing { what } => log::warn!("{what}"),
            Event::Driving { .. } => log::info!("driving"),
            Event::Status(status) => self.status(status),
            // It is the last line of the recording's log.
            Event::Stopped { .. } | Event::Refused { .. } | Event::Ended(_) => {}
        }
    }

    /// Prints lines that stay, above the bar.
    pub(super) fn above(&self, print: impl FnOnce()) {
        #[cfg(feature = "host")]
        if let Some(bar) = &self.bar {
            return bar.suspend(print);
        }
        print();
    }

    /// Takes the bar away.
    pub(super) fn finish(&self) {
        #[cfg(feature = "host")]
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    #[cfg(feature = "host")]
    fn status(&self, status: &crate::recording::Status) {
        let Some(bar) = &self.bar else { return };
        let states =
            status.states.iter().map(|(_, state)| state.as_str()).collect::<Vec<_>>().join(", ");
        bar.set_position(
            u64::try_from(status.elapsed_ns / crate::clock::MILLISECOND_NS).unwrap_or(0),
        );
        let message = format!(
            "{:.0} s, {:.1} m, {}; {states}{}{}",
            crate::clock::seconds(status.elapsed_ns),
            status.travelled_m,
            crate::units::counted(status.points, "point"),
            status.said.iter().map(|line| format!("; {line}")).collect::<String>(),
            status.warning.as_ref().map(|warning| format!("; {warning}")).unwrap_or_default()
        );
        bar.set_message(safe(&message).into_owned());
    }

    #[cfg(not(feature = "host"))]
    fn status(&self, status: &crate::recording::Status) {
        log::info!("{:.1} m driven", status.travelled_m);
    }
}

/// The bar counts milliseconds of the run.
#[cfg(feature = "host")]
fn bar(mission: &Mission) -> indicatif::ProgressBar {
    let limit_ms = crate::clock::nanoseconds(mission.time_limit_s()) / crate::clock::MILLISECOND_NS;
    let bar = indicatif::ProgressBar::new(u64::try_from(limit_ms).unwrap_or(0));
    bar.with_style(bar_style("{bar:30} {msg}"))
}

/// How a bar looks.
#[cfg(feature = "host")]
pub(super) fn bar_style(template: &str) -> indicatif::ProgressStyle {
    let style = indicatif::ProgressStyle::with_template(template);
    style.unwrap_or_else(|_| indicatif::ProgressStyle::default_bar())
}

impl From<Findings> for Failure {
    fn from(findings: Findings) -> Self {
        Self::refused(findings.to_string())
    }
}

/// A run did not start; nothing moved.
#[cfg(feature = "sim")]
impl From<Refused> for Failure {
    fn from(refused: Refused) -> Self {
        Self::of_refused(refused.stop().to_string(), refused.way_out(None).as_deref())
    }
}

impl From<ProcessError> for Failure {
    fn from(error: ProcessError) -> Self {
        let message = with_causes(&error);
        match error {
            ProcessError::NoJob(_) => Self::usage(message)
                .hint("onbrick run, which starts this process and gives it its job"),
            ProcessError::Simulated => Self::usage(message),
            _ => Self::failed(message),
        }
    }
}

#[cfg(feature = "host")]
impl From<PageError> for Failure {
    fn from(error: PageError) -> Self {
        Self::from_error(Exit::Refused, "no page", &error)
            .hint("another port for --page; 0 is any that is free")
    }
}

/// Where a job is done.
pub(super) fn environment(job: &Job) -> Result<Environment, Refused> {
    match &job.brick {
        Brick::Local(tree) => Ok(Environment::local(tree)),
        #[cfg(feature = "sim")]
        Brick::Simulated { .. } => Ok(crate::simulated::simulated(job)?.environment),
        #[cfg(not(feature = "sim"))]
        Brick::Simulated { .. } => Err(Refused::NoSimulation),
    }
}
