//! `onbrick run` where a service lives: it runs the mission, this command only asks, watches and
//! stops.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::Serialize;
use signal_hook::iterator::Signals;

use super::super::common::{Progress, read_mission};
use super::super::serve::load_config;
use super::super::terminal::signals;
use super::super::{Context, Exit, Failure, Output};
use super::{Arguments, Happenings, RunFolder};
use crate::behavior::Capabilities;
use crate::clock::{Clock, MILLISECOND_NS, MonotonicClock, SECOND_NS, wall_ns};
use crate::protocol::{
    Chosen, Done, Fetch, LastStop, LocalOnly, MAX_FETCH_BYTES, MAX_MISSION_BYTES, Request, RunId,
    RunInfo, Runs, Start, Started, Status, Stopped,
};
use crate::runtime::Event;
use crate::service::Config;
use crate::service::client::{Client, ClientError};
use crate::service::config::BRICK_FOLDER;
use crate::service::digest::sha256_hex_of;
use crate::units::counted;

/// How long one answer may take.
const PATIENCE: Duration = Duration::from_secs(3);

/// How long a service may be gone, nanoseconds: systemd restarts it.
const ABSENCE_NS: i64 = 10 * SECOND_NS;

/// How often the state is looked at, nanoseconds.
const LOOK_NS: i64 = 200 * MILLISECOND_NS;

/// A service that lives on this brick.
pub(super) struct Living {
    client: Client,
    config: Config,
}

/// Checks whether a service lives on the brick that is meant.
pub(super) fn service(arguments: &Arguments) -> Result<Option<Living>, Failure> {
    let folder = match &arguments.config {
        Some(folder) => folder.as_path(),
        None if arguments.brick.is_machine() => Path::new(BRICK_FOLDER),
        None => return Ok(None),
    };
    let config = load_config(folder, arguments.config.is_some())?;
    let mut client = Client::at(&config.socket.path);
    match client.ask::<Status>(&Request::Status, PATIENCE) {
        Ok(_) => Ok(Some(Living { client, config })),
        Err(ClientError::NoService { source, .. })
            if source.kind() != std::io::ErrorKind::PermissionDenied =>
        {
            Ok(None)
        }
        Err(error) => Err(failure("a service lives on this brick", &error)),
    }
}

/// Has the service run the mission.
pub(super) fn run(
    mut living: Living,
    arguments: &Arguments,
    output: &mut Output,
) -> Result<(), Failure> {
    refuse_unfit(&living, arguments)?;
    let source = read_mission(&own_mission(&living.config, &arguments.mission))?;
    if source.text.len() > MAX_MISSION_BYTES {
        return Err(Failure::refused(format!(
            "{} has more than {MAX_MISSION_BYTES} bytes",
            source.name
        )));
    }
    // Before anything starts: a signal to this process means the run.
    let mut signals = signals()?;
    // Findings are the service's matter; here the mission gives the run its name, and the bar its
    // length.
    let mission = source.mission(&Capabilities::all()).ok();
    let name = mission.as_ref().map_or("mission", |(mission, _)| mission.name());
    let run = new_id(name)?;
    let folder = arguments.out.as_deref();
    let folder = folder.map(|out| RunFolder::of_mission(Some(out), name)).transpose()?;
    let start = Start {
        run: run.clone(),
        mission: Chosen::Text(source.text),
        token: None,
        pose: arguments.pose,
        set: arguments.set.clone(),
        no_button: arguments.no_button,
    };
    // This process's end, of whatever kind, ends its run: on one connection the service sees it
    // after the start.
    let mut tie = Client::at(&living.config.socket.path);
    let tied = tie.ask::<Done>(&LocalOnly::StarterHere { run: run.clone() }, PATIENCE);
    let started = tied.and_then(|_| tie.ask::<Started>(&LocalOnly::StartHere(start), PATIENCE));
    started.map_err(|error| {
        folder.iter().for_each(RunFolder::take_back);
        failure("the run did not start", &error)
    })?;
    let progress = mission.as_ref().map(|(mission, _)| Progress::new(mission, output));
    let recording = living.config.runs.join(run.as_str()).join("run.mcap");
    let mut happenings = Happenings::of(recording, progress);
    let last = follow(&mut living.client, &run, &mut signals, |event| {
        happenings.hear(event, output);
    });
    happenings.finish(output);
    finish(living, &run, last?, folder.as_ref(), output)
}

/// Refuses options that do not go with a service.
fn refuse_unfit(living: &Living, arguments: &Arguments) -> Result<(), Failure> {
    let robot = living.config.robot.display();
    let stop_it = "stop the service (systemctl stop onbrick)";
    let unfit = [
        #[cfg(feature = "host")]
        (
            arguments.page.is_some(),
            "--page does not go",
            "onbrick fetch --follow on a PC, which shows the same page".to_owned(),
        ),
        (
            arguments.robot.is_some(),
            "--robot does not go",
            format!("put the robot's file at {robot}, or {stop_it}"),
        ),
        (
            arguments.brick.files.has_streams_elsewhere(),
            "--buttons and --speaker do not go",
            format!("give them to onbrick serve, or {stop_it}"),
        ),
    ];
    let Some((_, what, hint)) = unfit.into_iter().find(|(is_there, ..)| *is_there) else {
        return Ok(());
    };
    let message = format!("{what} with the service that lives on this brick");
    Err(Failure::usage(message).hint(hint))
}

/// A name is first of all that of one of this brick's missions, as in its menu and from a PC; then
/// that of a shipped one.
fn own_mission(config: &Config, mission: &Path) -> PathBuf {
    let own = config.missions.join(mission).with_extension("toml");
    let is_name =
        mission.components().count() == 1 && mission.extension().is_none() && !mission.exists();
    if is_name && own.is_file() { own } else { mission.to_owned() }
}

/// What is told of a run that is over.
#[derive(Serialize)]
struct Over<'o> {
    event: &'static str,
    #[serde(flatten)]
    last: &'o LastStop,
    travelled_m: Option<f64>,
    points: Option<u64>,
    file: Option<&'o Path>,
}

fn finish(
    mut living: Living,
    run: &RunId,
    last: LastStop,
    folder: Option<&RunFolder>,
    output: &mut Output,
) -> Result<(), Failure> {
    let runs: Runs =
        living.client.ask(&Request::Runs, PATIENCE).map_err(|error| failure("the run", &error))?;
    let Some(info) = runs.runs.into_iter().find(|info| &info.run == run) else {
        // It did not start, so nothing was recorded.
        folder.into_iter().for_each(RunFolder::take_back);
        return if last.is_wanted() { Ok(()) } else { Err(Failure::refused(last.to_string())) };
    };
    let file = match folder {
        Some(folder) => bring(&mut living.client, &info, folder)?,
        None => living.config.runs.join(run.as_str()).join("run.mcap"),
    };
    let (travelled_m, points) = (info.travelled_m, info.points);
    output.value(&Over { event: "ended", last: &last, travelled_m, points, file: Some(&file) });
    output.line(format!(
        "{}: {:.2} m driven, {}\nrecorded in {}",
        last,
        travelled_m.unwrap_or(0.0),
        counted(points.unwrap_or(0), "point"),
        file.display()
    ));
    super::verdict(&last.stop, &file, output)
}

/// Looks at the run until it is over; asks it to stop where a signal comes.
fn follow(
    client: &mut Client,
    run: &RunId,
    signals: &mut Signals,
    mut show: impl FnMut(&Event),
) -> Result<LastStop, Failure> {
    let mut waits = None;
    let mut heard_ns = MonotonicClock.now_ns();
    loop {
        if signals.pending().next().is_some() {
            let stop = Request::Stop { run: Some(run.clone()) };
            let _: Stopped = client
                .ask(&stop, PATIENCE)
                .map_err(|error| failure("cannot stop the run", &error))?;
        }
        let status: Status = match client.ask(&Request::Status, PATIENCE) {
            Ok(status) => status,
            Err(ClientError::Refused(refusal)) => return Err(failure("the run", &refusal.into())),
            Err(error) if MonotonicClock.now_ns() - heard_ns > ABSENCE_NS => {
                return Err(failure("the run", &error));
            }
            Err(_) => {
                MonotonicClock.sleep_ns(LOOK_NS);
                continue;
            }
        };
        heard_ns = MonotonicClock.now_ns();
        let Some(going_on) = status.run.filter(|going_on| &going_on.run == run) else {
            let last = status.last.filter(|last| last.run.as_ref() == Some(run));
            return last.ok_or_else(|| Failure::failed("how the run ended is not known"));
        };
        if let Some(what) = going_on.waits.clone().filter(|_| waits != going_on.waits) {
            show(&Event::Preparing { what });
        }
        waits = going_on.waits;
        if let Some(progress) = going_on.progress {
            show(&Event::Status(progress));
        }
        MonotonicClock.sleep_ns(LOOK_NS);
    }
}

/// How long the service may take to compute a recording's hash, nanoseconds.
const HASHED_NS: i64 = 10 * SECOND_NS;

/// Brings the recording to where it was asked for.
fn bring(client: &mut Client, info: &RunInfo, folder: &RunFolder) -> Result<PathBuf, Failure> {
    let path = folder.file();
    let doing = format!("cannot write {}", path.display());
    let mut file = std::fs::File::create_new(&path).context(Exit::Failed, &doing)?;
    let mut offset = 0;
    loop {
        let fetch = Fetch::part(&info.run, offset, MAX_FETCH_BYTES);
        let (fetched, bytes) = client
            .fetch(&fetch, PATIENCE)
            .map_err(|error| failure("cannot bring the recording", &error))?;
        file.write_all(&bytes).context(Exit::Failed, &doing)?;
        offset += u64::from(fetched.length);
        if offset >= fetched.total {
            break;
        }
    }
    file.sync_all().context(Exit::Failed, &doing)?;
    let sha256 = sha256_hex_of(&path).context(Exit::Failed, &doing)?;
    let whole = Fetch { sha256: Some(sha256.clone()), ..Fetch::part(&info.run, offset, 0) };
    // The service computes its own hash meanwhile.
    let deadline_ns = MonotonicClock.now_ns() + HASHED_NS;
    loop {
        let (fetched, _) = client
            .fetch(&whole, PATIENCE)
            .map_err(|error| failure("cannot bring the recording", &error))?;
        match fetched.sha256 {
            Some(named) if named == sha256 => return Ok(path),
            Some(_) => {
                let message = format!("{} is not what the service has recorded", path.display());
                return Err(Failure::failed(message).hint("is its disk in order? onbrick replay"));
            }
            None if MonotonicClock.now_ns() >= deadline_ns => {
                log::warn!(
                    "the service has not named the recording's hash: {} is unchecked",
                    path.display()
                );
                return Ok(path);
            }
            None => MonotonicClock.sleep_ns(LOOK_NS),
        }
    }
}

/// An identifier that no run had before: the mission, the time to the nanosecond, this process.
fn new_id(mission: &str) -> Result<RunId, Failure> {
    RunId::of_mission(mission, &format!("{:x}-{:x}", wall_ns(), std::process::id()))
        .context(Exit::Failed, "the run")
}

fn failure(doing: &str, error: &ClientError) -> Failure {
    match error {
        ClientError::Refused(refusal) => {
            Failure::of_refused(refusal.message.clone(), refusal.hint.as_deref())
        }
        ClientError::NoService { .. } | ClientError::Silent | ClientError::Lost(_) => {
            Failure::from_error(Exit::NoAnswer, doing, error)
                .hint("systemctl status onbrick; a user of its socket's group")
        }
        ClientError::Strange(_) => {
            Failure::from_error(Exit::Failed, doing, error).hint("the same onbrick on both sides")
        }
    }
}
