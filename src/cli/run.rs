//! `onbrick run`: a mission, here and now, in the foreground.

use std::path::{Path, PathBuf};
use std::sync::Arc;

#[cfg(feature = "sim")]
use super::Hint as _;
use super::brick::{MissionBrick, brick_is_there};
#[cfg(feature = "sim")]
use super::common::method;
use super::common::{
    chosen_robot, load_mission, load_robot, number_within, own_program, pose, read_mission,
    stamps_ns, warn,
};
use super::folder::RunFolder;
use super::happenings::Happenings;
use super::terminal::signals;
use super::{Context as _, Exit, Failure, Output};
use crate::behavior::Mission;
use crate::clock::nanoseconds;
use crate::ev3dev::Tree;
#[cfg(feature = "sim")]
use crate::mapping::Method;
use crate::mapping::Pose;
use crate::printable::in_shell;
use crate::robot::RobotConfig;
use crate::runtime::{
    Brick, Ended, Event, Job, RunError, RunProcess, Stop, StopBy, StopReason, Stopper, halt_command,
};
use crate::units::radians;

#[cfg(feature = "host")]
pub(super) mod page;
mod through;

/// Run a mission here, in the foreground, and record it; where a service lives on the brick,
/// through it. The end of this command, of whatever kind, stops the robot.
///
/// Examples:
///   onbrick run map                        on the brick, with the robot of robot.toml
///   onbrick run my-mission.toml --sim arena --out first-try
///   onbrick run my-mission.toml --sim arena --page      and watch it in a browser
///   onbrick run my-mission.toml -v         each transition with its time and why; what it says,
///                                          shows and sounds
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Arguments {
    /// A mission file, or a name: that of one of the brick's own missions, where a service lives on
    /// it, or of a shipped one.
    mission: PathBuf,
    /// The robot's file, or the name of a shipped one: mapper, educator, retail. Without it
    /// ./robot.toml, and where there is none the mapper. A simulated robot is built like it, unless
    /// the world says how.
    #[arg(long)]
    robot: Option<PathBuf>,
    #[command(flatten)]
    brick: MissionBrick,
    /// How poses are estimated and points placed: default, by odometry alone, or as the seed did.
    #[cfg(feature = "sim")]
    #[arg(long, default_value = "default", value_parser = method(), requires = "sim")]
    method: Method,
    /// Let the simulation keep step with the clock on the wall.
    #[cfg(feature = "sim")]
    #[arg(long, requires = "sim")]
    realtime: bool,
    /// Show the run in a browser on this machine, at a port of your choice or any that is free,
    /// until Ctrl-C. With --sim it begins in real time; at the page it can be made faster, stopped,
    /// started again with the mission's file as it is then, recorded in the next free folder, and
    /// the robot can be carried and its buttons pressed. Nothing else changes what is recorded.
    #[cfg(feature = "host")]
    #[arg(
        long,
        value_name = "PORT",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "0",
        conflicts_with = "realtime",
    )]
    page: Option<u16>,
    /// The robot's pose at the start: metres, metres, degrees; in a simulation one of the world's
    /// start poses.
    #[arg(long, value_parser = pose, value_name = "X,Y,DEG", allow_hyphen_values = true)]
    pose: Option<[f64; 3]>,
    /// Give one of the mission's own numbers, or its time_limit_s, another value; can be repeated.
    #[arg(long, value_parser = setting, value_name = "NAME=VALUE")]
    set: Vec<(String, f64)>,
    /// Folder for the recording, run.mcap; without it, the next free one under onbrick-runs.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Run it through the service with this configuration, where one lives; on the brick
    /// /etc/onbrick is looked at without asking.
    #[cfg_attr(feature = "sim", arg(conflicts_with = "sim"))]
    #[arg(long, value_name = "DIR")]
    config: Option<PathBuf>,
    /// Run although no button beside the robot stops it, on a board that has none: keep a hand near
    /// the plug. To be said each time.
    #[cfg_attr(feature = "sim", arg(conflicts_with = "sim"))]
    #[arg(long)]
    no_button: bool,
    /// Seconds between two syncs: a power cut loses at most this much of the recording.
    #[arg(long, default_value_t = 1.0, value_parser = number_within(0.1..=60.0))]
    sync_s: f64,
}

/// A robot this near to a start pose is meant to stand on it: metres, and radians.
#[cfg(feature = "sim")]
const SAME_PLACE: (f64, f64) = (0.01, 0.02);

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    if let Some(living) = through::service(arguments)? {
        return through::run(living, arguments, output);
    }
    #[cfg(feature = "host")]
    if let Some(port) = arguments.page {
        return page::run(port, arguments, output);
    }
    let Prepared { job, mission, folder } = prepare(arguments, arguments.out.as_deref(), output)?;
    let ended = start(&job)
        .and_then(|run| follow(run, &job, &mission, output, |_| ()))
        .inspect_err(|_| folder.take_back())?;
    conclude(&ended, output)
}

/// A run that can be started.
struct Prepared {
    job: Job,
    mission: Mission,
    folder: RunFolder,
}

/// Reads the files, and makes the recording's folder.
fn prepare(
    arguments: &Arguments,
    out: Option<&Path>,
    output: &mut Output,
) -> Result<Prepared, Failure> {
    let chosen = chosen_robot(arguments.robot.as_deref(), output);
    let robot = load_robot(chosen.as_deref())?;
    let source = read_mission(&arguments.mission)?;
    let (mut mission, warnings) = load_mission(&source, &robot.config.capabilities())?;
    warn(&warnings);
    set_numbers(&mut mission, &arguments.set)?;
    mission.within_limits().map_err(|error| Failure::from_error(Exit::Usage, "--set", &error))?;
    let (brick, start) = brick(arguments, chosen.is_some().then_some(&robot.config))?;
    let start = arguments.pose.map_or(start, |[x_m, y_m, deg]| Pose {
        x_m,
        y_m,
        heading_rad: radians(deg),
    });
    let folder = RunFolder::of_mission(out, mission.name())?;
    let job = Job {
        start,
        set: arguments.set.clone(),
        sync_ns: nanoseconds(arguments.sync_s),
        stamps_ns: stamps_ns(output),
        no_button: arguments.no_button,
        #[cfg(feature = "sim")]
        method: arguments.method,
        ..Job::new(source, robot.source, brick, folder.file())
    };
    Ok(Prepared { job, mission, folder })
}

/// `name=value` of `--set`.
pub(super) fn setting(text: &str) -> Result<(String, f64), String> {
    let (name, value) = text.split_once('=').ok_or("it is written name=value")?;
    let (name, value) = (name.trim(), value.trim());
    let value: f64 = value.parse().map_err(|_| format!("`{value}` is not a number"))?;
    if value.is_finite() {
        Ok((name.to_owned(), value))
    } else {
        Err("the number must be finite".to_owned())
    }
}

/// Gives a mission's numbers the values of `--set`.
pub(super) fn set_numbers(mission: &mut Mission, set: &[(String, f64)]) -> Result<(), Failure> {
    set.iter().try_for_each(|(name, value)| {
        mission.set(name, *value).context(Exit::Usage, format_args!("--set {name}={value}"))
    })
}

/// Says how a run ended.
fn conclude(ended: &Ended, output: &mut Output) -> Result<(), Failure> {
    let file = &ended.file;
    // A program has read it already: it was the last event.
    output.line(format!("{ended}\nrecorded in {}", file.display()));
    verdict(&ended.stop, file, output)
}

/// What a run's end, which the line before has said, means for what comes after this command.
pub(super) fn verdict(stop: &Stop, file: &Path, output: &mut Output) -> Result<(), Failure> {
    if !stop.reason.is_wanted() {
        let (seen, json) = (output.is_one_screen(), output.is_json());
        return Err(ended_badly(stop, file, seen, json));
    }
    // At a page it is one of several.
    output.ends_with(if stop.reason.is_complete() { 0 } else { Exit::Stopped as u8 });
    Ok(())
}

/// A run came to no good end, which the line before has said.
///
/// - `seen`: that line stands right above.
/// - `json`: a program reads it, and what programs read stays as it was.
fn ended_badly(stop: &Stop, file: &Path, seen: bool, json: bool) -> Failure {
    let message = match seen {
        true => "the run did not come to a good end, as said above".to_owned(),
        false => stop.to_string(),
    };
    let file = in_shell(file);
    Failure::failed(message).hint(if stop.reason == StopReason::Recording {
        format!("room on its disk, or --out on another one; {file} has what came before")
    } else if cfg!(feature = "host") && !json {
        format!("onbrick plot {file} -o run.html, to see where it was; onbrick replay {file}")
    } else {
        format!("onbrick replay {file}")
    })
}

/// Where the robot is, and its pose at the start where the world says it.
///
/// - `robot`: the robot that a person has chosen; a simulated one is built like it, where its world
///   says nothing else.
fn brick(arguments: &Arguments, robot: Option<&RobotConfig>) -> Result<(Brick, Pose), Failure> {
    #[cfg(feature = "sim")]
    if let Some(path) = &arguments.brick.sim {
        let (world, start) = super::common::load_world(path)?;
        let world = match robot {
            Some(robot) => crate::simulated::furnished(world, robot),
            None => world,
        };
        if let Some(pose) = arguments.pose {
            on_a_start(&world, pose)?;
        }
        let (seed, realtime) = (arguments.brick.seed, arguments.realtime);
        return Ok((Brick::Simulated { world, seed, realtime }, start));
    }
    #[cfg(not(feature = "sim"))]
    let _ = robot;
    let tree = arguments.brick.files.tree();
    let there = brick_is_there(&(Arc::new(tree.clone()) as Arc<dyn Tree>));
    #[cfg(feature = "sim")]
    let there = there.hint(
        "--sim arena, or open where a mission needs room, which drives a simulated one; --brick \
         with the folder where one is mounted",
    );
    there.map(|()| (Brick::Local(tree), Pose::default()))
}

/// A simulated robot stands where its world lets it start, and is not told that it stands
/// elsewhere.
#[cfg(feature = "sim")]
fn on_a_start(world: &crate::runtime::Source, [x_m, y_m, deg]: [f64; 3]) -> Result<(), Failure> {
    use crate::units::wrap_rad;
    let (parsed, _) = world.world()?;
    let is_there = |start: &crate::sim::StartPose| {
        libm::hypot(start.x_m - x_m, start.y_m - y_m) <= SAME_PLACE.0
            && wrap_rad(start.heading_rad - radians(deg)).abs() <= SAME_PLACE.1
    };
    if parsed.starts().iter().any(is_there) {
        return Ok(());
    }
    let starts: Vec<String> = parsed.starts().iter().map(ToString::to_string).collect();
    Err(Failure::refused(format!(
        "no robot starts at {x_m},{y_m},{deg} in the world `{}`",
        parsed.name()
    ))
    .hint(format!(
        "--pose={}, or a world with another [[start]] (onbrick new world)",
        starts.join(" or --pose=")
    )))
}

fn failed(doing: &str, error: &dyn std::error::Error) -> Failure {
    Failure::from_error(Exit::Failed, doing, error)
}

/// Starts the run in a process of its own; Ctrl-C is meant for it from then on.
fn start(job: &Job) -> Result<RunProcess, Failure> {
    let run = RunProcess::start(&own_program()?, job)
        .map_err(|error| failed("the run did not start", &error))?;
    forward_signals(run.stopper())?;
    Ok(run)
}

/// Follows a run to its end.
fn follow(
    mut run: RunProcess,
    job: &Job,
    mission: &Mission,
    output: &mut Output,
    hear: impl Fn(&Event),
) -> Result<Ended, Failure> {
    let progress = super::common::Progress::new(mission, output);
    let mut happenings = Happenings::of(job.file.clone(), Some(progress));
    while let Some(event) = run.next_event() {
        hear(&event);
        happenings.hear(&event, output);
    }
    let ended = run.wait();
    happenings.finish(output);
    ended.map_err(|error| match error {
        RunError::Refused { stop, hint } => Failure::of_refused(stop.to_string(), hint.as_deref()),
        RunError::Silent { stopped: true, .. } => {
            failed("the run", &error).hint(after_silence(&job.file))
        }
        RunError::Silent { .. } | RunError::Io(_) => {
            let halt = halt_command(job.brick.root().unwrap_or(Path::new("/")));
            let hint = format!("{halt}, to be sure that the motors are still");
            failed("the run", &error).hint(hint)
        }
    })
}

/// What is known where the run's processes ended without a word, and its motors were stopped.
fn after_silence(file: &Path) -> String {
    let before = if file.exists() {
        format!("; {} says what happened before", file.display())
    } else {
        String::new()
    };
    format!("its motors were stopped{before}")
}

/// A signal to this process means the run. In a terminal, control gets the signal as well; hearing
/// it twice does no harm.
fn forward_signals(run: Stopper) -> Result<(), Failure> {
    let mut signals = signals()?;
    std::thread::spawn(move || {
        for _ in signals.forever() {
            // A run that is gone needs no telling.
            let _ = run.stop(StopBy::Terminal);
        }
    });
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn why_a_run_ended_badly_is_not_said_twice_on_one_screen() {
        let stop = StopReason::Stalled.into();
        let said = |seen| ended_badly(&stop, Path::new("my r.mcap"), seen, false).to_text();
        let first = "error: a wheel is blocked\n  try: onbrick ";
        assert!(said(false).starts_with(first), "{}", said(false));
        assert!(!said(true).contains("blocked"), "{}", said(true));
        for seen in [true, false] {
            assert!(said(seen).ends_with("onbrick replay 'my r.mcap'"), "{}", said(seen));
        }
    }

    #[test]
    fn a_recording_is_named_only_where_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("run.mcap");
        assert_eq!(after_silence(&file), "its motors were stopped");
        std::fs::write(&file, "").unwrap();
        assert!(after_silence(&file).ends_with("run.mcap says what happened before"));
    }

    #[test]
    fn a_program_reads_why_a_run_ended_badly_as_ever() {
        let ended = |reason: StopReason| {
            ended_badly(&reason.into(), Path::new("r.mcap"), false, true).to_text()
        };
        let said = ended(StopReason::Stalled);
        assert_eq!(said, "error: a wheel is blocked\n  try: onbrick replay r.mcap");
        let said = ended(StopReason::Recording);
        assert!(said.contains("try: room on its disk"), "{said}");
    }
}
