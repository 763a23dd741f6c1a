//! `onbrick serve`: the service of a brick, in the foreground, as systemd or a person starts it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::brick::{MissionBrick, no_brick};
use super::common::{make_folder, own_program};
use super::terminal::signals;
use super::{Context, Exit, Failure, Hint, Output};
use crate::ev3dev::{Inventory, Tree};
#[cfg(feature = "link")]
use crate::link::{Server, ServerConfig};
use crate::mapping::Pose;
use crate::runtime::Brick;
#[cfg(feature = "link")]
use crate::service::NetworkLink;
use crate::service::config::{BRICK_FOLDER, CONFIG_FILE, own_folder};
use crate::service::{Config, LocalSocket, RobotSite, Service, SocketError};

/// Serve a brick: missions are started and stopped, and runs kept, for the menu and for PCs.
///
/// Examples:
///   onbrick serve                          on the brick, as set up in /etc/onbrick
///   onbrick serve --sim arena              on a PC: each run on a simulated brick
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Arguments {
    /// The folder of onbrick.toml, created if missing; without it /etc/onbrick, and a folder of
    /// your own with --sim or --brick.
    #[arg(long, value_name = "DIR")]
    config: Option<PathBuf>,
    #[command(flatten)]
    brick: MissionBrick,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    // Before anything is done: a signal that comes early must find the way out as well.
    let mut signals = signals()?;
    // Before anything is made: a machine without a brick gets no keys.
    let place = place(arguments)?;
    let config = load_config(&config_folder(arguments)?, arguments.config.is_some())?;
    let service = Service::open(config, place, own_program()?)
        .context(Exit::Failed, "cannot serve")
        .hint(ANOTHER)?;
    let local = LocalSocket::open(&service.config().socket, Arc::new(service.clone())).map_err(
        |error| {
            let hint = match error {
                SocketError::Taken(_) => ANOTHER,
                _ => "[socket] in onbrick.toml: path and group",
            };
            Failure::from_error(Exit::Failed, "cannot serve", &error).hint(hint)
        },
    )?;
    let link = start_link(&service);
    let socket = service.config().socket.path.display().to_string();
    let Config { runs, robot, .. } = service.config();
    log::info!("{} serves: runs in {}", service.name(), runs.display());
    if !robot.is_file() {
        log::warn!(
            "there is no {}: what is started drives as the shipped robot, ports and sizes too; \
             onbrick setup writes the file",
            robot.display()
        );
    }
    output.show(
        format!("serving {} at {socket}", service.name()),
        &serde_json::json!({ "serving": service.name(), "socket": socket }),
    );
    tell_systemd(sd_notify::NotifyState::Ready);
    if let Some(signal) = signals.forever().next() {
        log::info!("told to end (signal {signal})");
    }
    tell_systemd(sd_notify::NotifyState::Stopping);
    service.close();
    drop(local);
    close_link(&service, link);
    Ok(())
}

const ANOTHER: &str =
    "stop the other one (systemctl stop onbrick), or --config with another folder";

/// The network link opens when it can; nothing waits for it. It is closed when what is returned
/// is dropped.
#[cfg(feature = "link")]
fn start_link(service: &Service) -> Option<Arc<Server>> {
    let config = service.config();
    let config = ServerConfig {
        keys: config.keys.clone(),
        name: service.name().clone(),
        listens: config.link.clone(),
    };
    match Server::start(config, Arc::new(service.clone())) {
        Ok(server) => {
            let server = Arc::new(server);
            service.attach_link(Arc::clone(&server) as Arc<dyn NetworkLink>);
            Some(server)
        }
        Err(error) => {
            service.no_link(&format!("no thread can be started for it: {error}"));
            None
        }
    }
}

/// The threads that use the link share it; the last one to drop it closes it.
#[cfg(feature = "link")]
fn close_link(service: &Service, link: Option<Arc<Server>>) {
    service.no_link("the service has ended");
    drop(link);
}

#[cfg(not(feature = "link"))]
fn close_link(_service: &Service, (): ()) {}

#[cfg(not(feature = "link"))]
fn start_link(service: &Service) {
    service.no_link("this onbrick was built without the link");
}

/// A service that systemd did not start has no one to notify.
fn tell_systemd(state: sd_notify::NotifyState<'_>) {
    if let Err(error) = sd_notify::notify(&[state]) {
        log::warn!("systemd was not told: {error}");
    }
}

/// The folder of the configuration: the brick's, or one that was named or is the user's own, which
/// is made.
fn config_folder(arguments: &Arguments) -> Result<PathBuf, Failure> {
    let make = |folder: PathBuf| {
        make_folder(Exit::Refused, &folder)
            .hint("--config with a folder that can be written to")
            .map(|()| folder)
    };
    if let Some(folder) = &arguments.config {
        return make(folder.clone());
    }
    if arguments.brick.is_machine() {
        return Ok(PathBuf::from(BRICK_FOLDER));
    }
    let folder = own_folder().ok_or_else(|| {
        Failure::usage("there is no HOME to keep a configuration below")
            .hint("--config with a folder")
    })?;
    make(folder)
}

/// Reads the folder's `onbrick.toml`. A folder without one is set up as the file's absence says; a
/// folder that was named must be there.
pub(super) fn load_config(folder: &Path, named: bool) -> Result<Config, Failure> {
    let path = folder.join(CONFIG_FILE);
    let refused = |error: &std::io::Error| {
        Failure::from_error(Exit::Refused, &format!("cannot read {}", path.display()), error)
            .hint("--config with the folder of a service, the one that `onbrick serve` has")
    };
    let folder = match folder.canonicalize() {
        Ok(folder) => folder,
        Err(error) if named || error.kind() != std::io::ErrorKind::NotFound => {
            return Err(refused(&error));
        }
        Err(_) => folder.to_owned(),
    };
    if !path.exists() {
        return Ok(Config::below(&folder));
    }
    let bytes = super::common::read_bounded(&path)?;
    let (config, warnings) =
        Config::load(&path.display().to_string(), &bytes, &folder).map_err(|findings| {
            Failure::refused(findings.to_string())
                .hint("onbrick new service, which shows a whole file with comments")
        })?;
    super::common::warn(&warnings);
    Ok(config)
}

/// Where the robot is; a simulated one keeps step with the clock, because people watch.
fn place(arguments: &Arguments) -> Result<RobotSite, Failure> {
    let brick = &arguments.brick;
    #[cfg(feature = "sim")]
    if let Some(path) = &brick.sim {
        let (world, start) = super::common::load_world(path)?;
        let brick = Brick::Simulated { world, seed: brick.seed, realtime: true };
        return Ok(RobotSite { brick, start });
    }
    let tree: Arc<dyn Tree> = Arc::new(brick.files.tree());
    let inventory = Inventory::read(&tree).context(Exit::Failed, "cannot look at the devices")?;
    if inventory.is_empty() {
        return Err(no_brick(brick.files.root()).hint(
            "--sim arena serves a simulated robot, --brick one that is mounted in a folder; or run \
             this on the brick",
        ));
    }
    Ok(RobotSite { brick: Brick::Local(brick.files.tree()), start: Pose::default() })
}
