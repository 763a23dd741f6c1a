//! `onbrick menu`: the screen and the buttons of the brick, or the same in a terminal.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};
use std::time::Duration;

use super::brick::BrickFiles;
use super::common::{LoadedRobot, load_robot};
use super::serve::load_config;
use super::terminal::stop_flags;
use super::{Context, Exit, Failure, Hint, Output};
use crate::clock::{MonotonicClock, wall_ns};
use crate::document::save;
use crate::ev3dev::{Buttons, Console, LocalTree, Platform, Screen, Tree};
use crate::menu::{
    Canvas, Display, Keys, Menu, MenuError, MenuOptions, Parts, Replies, ScreenDialogue,
    ServiceConnection, StartedBy, TalkKind, Talker, Told, Trouble, WIDTH, attend,
};
use crate::protocol::{Answer, LocalRequest};
use crate::runtime::{HardwareLock, StopFlags};
use crate::service::client::{Client, ClientError};
use crate::service::config::BRICK_FOLDER;

#[cfg(feature = "host")]
mod frames;
#[cfg(feature = "host")]
mod window;

#[cfg(feature = "host")]
use frames::Frames;
#[cfg(feature = "host")]
use window::{TerminalKeys, Window};

/// The menu on the brick's screen: missions, runs, ports, setting up, settings; it talks to
/// `onbrick serve`.
///
/// Examples:
///   onbrick menu                           on the brick, from brickman's file browser
///   onbrick menu --at-boot                 as a service of its own, in brickman's place
///   onbrick menu --window --config DIR     on a PC, for `onbrick serve --sim arena --config DIR`
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Arguments {
    /// The folder of onbrick.toml, as given to `serve`.
    #[arg(long, value_name = "DIR", default_value = BRICK_FOLDER)]
    config: PathBuf,
    /// Started by our own unit, in brickman's place: Back is a button like the others, and a run
    /// survives the menu.
    #[arg(long)]
    at_boot: bool,
    /// In this terminal instead: arrows and Enter; Backspace or Escape for Back, q to close.
    #[cfg(feature = "host")]
    #[arg(long, conflicts_with = "at_boot")]
    window: bool,
    /// Write each new picture into this folder as a PNG file, and read keys from the standard
    /// input.
    #[cfg(feature = "host")]
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["window", "at_boot"])]
    frames: Option<PathBuf>,
    #[command(flatten)]
    brick: BrickFiles,
    /// The screen's frame buffer, if it is not dev/fb0 below the brick's folder.
    #[arg(long, value_name = "PATH")]
    screen: Option<PathBuf>,
    /// The console that is put in graphics mode, if it is not the one that the menu was started on.
    #[arg(long, value_name = "PATH")]
    console: Option<PathBuf>,
}

impl Arguments {
    fn started_by(&self) -> StartedBy {
        #[cfg(feature = "host")]
        if self.window || self.frames.is_some() {
            return StartedBy::Terminal;
        }
        if self.at_boot { StartedBy::Boot } else { StartedBy::Brickman }
    }

    /// A brick that is not below `--brick` cannot be set up from here: the service's own simulated
    /// one.
    fn no_talks(&self) -> Option<String> {
        (self.started_by() == StartedBy::Terminal && self.brick.tree().is_machine()).then(|| {
            "The service's simulated brick is not in this machine's files. With a mounted one \
             (onbrick sim), --brick names it."
                .to_owned()
        })
    }
}

pub(super) fn run(arguments: &Arguments, _output: &mut Output) -> Result<(), Failure> {
    // The folder may be named or not: without a file in it, its defaults hold.
    let config = load_config(&arguments.config, true)?;
    let flags = stop_flags()?;
    let started_by = arguments.started_by();
    let mut menu =
        Menu::new(MenuOptions { started_by, no_talks: arguments.no_talks(), seed: wall_ns() });
    let socket = &config.socket.path;
    // Under brickman the menu's end ends the run, and the service sees that end by the end of the
    // connection for orders.
    let orders = match started_by {
        StartedBy::Brickman => Client::of_menu_at(socket),
        StartedBy::Boot | StartedBy::Terminal => Client::at(socket),
    };
    let connections: [Box<dyn ServiceConnection>; 2] = [
        Box::new(SocketConnection { client: Client::at(socket), patience: LOOK_PATIENCE }),
        Box::new(SocketConnection { client: orders, patience: ORDER_PATIENCE }),
    ];
    let mut talker = RobotTalker { brick: arguments.brick.tree(), robot: config.robot.clone() };
    let show = |keys: &mut dyn Keys, display: &mut dyn Display| {
        let parts = Parts {
            clock: &MonotonicClock,
            keys,
            display,
            connections,
            talker: &mut talker,
            stop: &flags.signal,
        };
        attend(&mut menu, parts).map_err(|error| failed(&error))
    };
    #[cfg(feature = "host")]
    if let Some(folder) = &arguments.frames {
        let mut frames = Frames::into(folder).map_err(|error| failed(&error.into()))?;
        return show(&mut TerminalKeys::open(), &mut frames);
    }
    #[cfg(feature = "host")]
    if arguments.window {
        let mut window = Window::open().map_err(|error| failed(&error.into()))?;
        return show(&mut TerminalKeys::open(), &mut window);
    }
    let tree: Arc<dyn Tree> = Arc::new(arguments.brick.tree());
    let platform = Platform::of(&tree);
    let built_in = platform.screen.as_ref().map_err(|why| {
        let message = format!("the menu is not shown on {}: {why}", platform.one());
        Failure::new(Exit::Refused, message)
            .hint("onbrick start and onbrick status from a PC, or onbrick run here")
    })?;
    let mut buttons = Buttons::open(&tree, platform)
        .context(Exit::Refused, "there are no buttons")
        .hint("onbrick menu --window, or --buttons with the input device's path")?;
    let root = arguments.brick.root();
    let path = arguments.screen.clone().unwrap_or_else(|| root.join(built_in.device));
    let mut screen = Screen::open(&path, &root.join(built_in.description))
        .map_err(|error| failed(&error.into()))?;
    // Put back when it is dropped, and this function unwinds on every way out that is not SIGKILL.
    let console = Console::take(arguments.console.as_deref());
    if console.is_none() {
        log::info!("no console: the picture is drawn without");
    }
    show(&mut buttons, &mut screen)
}

/// A look that takes longer has failed; it is repeated.
const LOOK_PATIENCE: Duration = Duration::from_secs(10);

/// An order is waited for: giving its connection up would be taken for the menu's end.
const ORDER_PATIENCE: Duration = Duration::from_secs(60);

fn failed(error: &MenuError) -> Failure {
    Failure::from_error(Exit::Failed, "the menu has ended", error)
}

impl Display for Screen {
    fn show(&mut self, _menu: &Menu, picture: &Canvas) -> Result<(), MenuError> {
        let width = usize::try_from(WIDTH).unwrap_or(usize::MAX);
        Ok(Self::show(self, picture.pixels(), width)?)
    }
}

/// The service's local socket.
#[derive(Debug)]
struct SocketConnection {
    client: Client,
    patience: Duration,
}

impl ServiceConnection for SocketConnection {
    fn ask(&mut self, request: &LocalRequest) -> Result<Answer, Trouble> {
        self.client.exchange(request, self.patience).map_err(|error| match error {
            ClientError::Refused(refusal) => Trouble::Refused(refusal),
            other => Trouble::Gone(crate::printable::with_causes(&other)),
        })
    }
}

/// Sets up and calibrates the robot below a brick's root, as the commands do.
#[derive(Debug)]
struct RobotTalker {
    brick: LocalTree,
    robot: PathBuf,
}

impl Talker for RobotTalker {
    fn begin(&mut self, kind: TalkKind, told: Sender<Told>) -> Replies {
        let (sender, replies) = channel();
        let (pressed, flags) = (Arc::default(), StopFlags::default());
        let answers = Replies { sender, pressed: Arc::clone(&pressed), flags: flags.clone() };
        let dialogue = ScreenDialogue { told: told.clone(), replies, pressed, flags };
        let (brick, robot) = (self.brick.clone(), self.robot.clone());
        std::thread::spawn(move || {
            // The screen that is gone by then needs no last word.
            let _ = told.send(Told::Over(talk(kind, dialogue, &brick, &robot)));
        });
        answers
    }
}

/// Talks until it is done; what was written, or why nothing was.
fn talk(
    kind: TalkKind,
    mut dialogue: ScreenDialogue,
    brick: &LocalTree,
    robot: &Path,
) -> Result<String, String> {
    let text = |error: &dyn std::error::Error| crate::printable::with_causes(error);
    let measures = kind.measures();
    let doing = match measures {
        None => "setting up at the menu",
        Some(_) => "calibrating at the menu",
    };
    let _lock = HardwareLock::take(brick.root(), doing).map_err(|error| text(&error))?;
    let tree: Arc<dyn Tree> = Arc::new(brick.clone());
    let flags = dialogue.flags.clone();
    // A stop from a PC ends a calibration, and not the menu.
    let _requests = flags.watch_requests(brick.root()).map_err(|error| text(&error))?;
    let written = match measures {
        None => crate::commissioning::setup(&tree, &MonotonicClock, &flags, &mut dialogue)
            .map_err(|error| text(&error))?,
        Some(_) if !robot.is_file() => {
            let set_up = TalkKind::SetUp.words();
            return Err(format!("There is no {} yet: {set_up} first.", robot.display()));
        }
        Some(options) => {
            let LoadedRobot { source, config } =
                load_robot(Some(robot)).map_err(|failure| failure.message)?;
            let calibration = crate::commissioning::calibrate(
                &tree,
                &MonotonicClock,
                &flags,
                &mut dialogue,
                &config,
                &options,
            )
            .map_err(|error| text(&error))?;
            calibration.apply(&source).map_err(|error| text(&error))?
        }
    };
    let kept = save::replace(robot, &written).map_err(|error| text(&error))?;
    let was =
        kept.map(|kept| format!(" What was there is now {}.", kept.display())).unwrap_or_default();
    Ok(format!("{} is written.{was}", robot.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_measures_a_robot_without_a_file_says_to_set_it_up() {
        let folder = tempfile::tempdir().unwrap();
        let (told, (_sender, replies)) = (channel().0, channel());
        let (pressed, flags) = (Arc::default(), StopFlags::default());
        let dialogue = ScreenDialogue { told, replies, pressed, flags };
        let brick = LocalTree::new(folder.path());
        let over = talk(TalkKind::Range, dialogue, &brick, &folder.path().join("robot.toml"));
        let why = over.unwrap_err();
        assert!(why.ends_with("robot.toml yet: Set up the robot first."), "{why}");
    }
}
