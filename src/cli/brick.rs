//! Which brick a command is for.

use std::path::{Path, PathBuf};

use clap::builder::{OsStringValueParser, TypedValueParser};

use super::{Exit, Failure};
use crate::ev3dev::{Inventory, LocalTree, Tree};

/// Where this machine has the brick's files: for commands that drive, or listen to the buttons.
#[derive(Debug, clap::Args)]
pub(super) struct BrickFiles {
    /// The folder under which sys/class and dev are found.
    #[arg(long, value_name = "ROOT", default_value = "/", value_parser = utf8_path())]
    brick: PathBuf,
    /// The buttons' input device, if it is not the one below the brick's folder.
    #[arg(long, value_name = "PATH", value_parser = utf8_path())]
    buttons: Option<PathBuf>,
    /// The speaker's input device, if it is not the one below the brick's folder.
    #[arg(long, value_name = "PATH", value_parser = utf8_path())]
    speaker: Option<PathBuf>,
}

/// Reads a path that the processes of a run tell each other in JSON, which is UTF-8.
fn utf8_path() -> impl TypedValueParser<Value = PathBuf> {
    OsStringValueParser::new()
        .try_map(|path| path.into_string().map(PathBuf::from).map_err(|_| "the path is not UTF-8"))
}

impl BrickFiles {
    /// What a simulated brick has no use for.
    #[cfg(feature = "sim")]
    const OPTIONS: [&str; 3] = ["brick", "buttons", "speaker"];

    /// The folder that holds everything else.
    pub(super) fn root(&self) -> &Path {
        &self.brick
    }

    /// Whether buttons or speaker are not below that folder.
    pub(super) fn has_streams_elsewhere(&self) -> bool {
        self.buttons.is_some() || self.speaker.is_some()
    }

    pub(super) fn tree(&self) -> LocalTree {
        LocalTree::new(&self.brick)
            .with_buttons(self.buttons.clone())
            .with_speaker(self.speaker.clone())
    }
}

/// The brick that missions run on: in this machine's files, or a simulated one.
#[derive(Debug, clap::Args)]
pub(super) struct MissionBrick {
    #[command(flatten)]
    pub(super) files: BrickFiles,
    /// Run on a simulated brick in this world: a file, or the name of a built-in world.
    #[cfg(feature = "sim")]
    #[arg(long, value_name = "WORLD", conflicts_with_all = BrickFiles::OPTIONS)]
    pub(super) sim: Option<PathBuf>,
    /// What all chance in the simulation comes from.
    #[cfg(feature = "sim")]
    #[arg(long, default_value_t = 1, requires = "sim")]
    pub(super) seed: u64,
}

impl MissionBrick {
    /// Whether it is this machine itself.
    pub(super) fn is_machine(&self) -> bool {
        #[cfg(feature = "sim")]
        if self.sim.is_some() {
            return false;
        }
        self.files.tree().is_machine()
    }
}

/// Refuses where there is nothing to set up or to measure.
pub(super) fn brick_is_there(tree: &std::sync::Arc<dyn Tree>) -> Result<(), Failure> {
    let refused = || Err(Failure { exit: Exit::Refused, ..no_brick(tree.root()) });
    match Inventory::read(tree) {
        Ok(found) if found.is_empty() => refused(),
        Err(_) if is_dead(tree.root()) => refused(),
        // What cannot be read is said where it is used.
        _ => Ok(()),
    }
}

/// Whether the program behind a mounted brick is gone.
pub(super) fn is_dead(root: &Path) -> bool {
    let errno = root.metadata().err().and_then(|error| error.raw_os_error());
    errno == Some(nix::libc::ENOTCONN)
}

/// Below this folder is no brick.
pub(super) fn no_brick(root: &Path) -> Failure {
    let shown = root.display();
    if is_dead(root) {
        return Failure::failed(format!("the simulated brick that was mounted at {shown} is gone"))
            .hint(format!("umount {shown}, and onbrick sim {shown} once more"));
    }
    let failure = Failure::failed(format!(
        "there is no brick below {shown}: no devices of ev3dev in its sys/class"
    ));
    if root.join("1/sys/class").is_dir() {
        return failure.hint(format!(
            "{}, the first of several that are mounted there",
            root.join("1").display()
        ));
    }
    failure.hint(if cfg!(feature = "sim") {
        "run this on the brick; or onbrick sim FOLDER, which mounts a simulated one, and then \
         --brick FOLDER here"
    } else {
        "run this on the brick, or give --brick the folder where one is mounted"
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_folder_of_several_bricks_is_told_from_that_of_one() {
        let folder = tempfile::tempdir().unwrap();
        let hint = || no_brick(folder.path()).hint.unwrap();
        assert!(hint().contains("onbrick sim FOLDER"), "{}", hint());
        std::fs::create_dir_all(folder.path().join("1/sys/class")).unwrap();
        assert!(hint().starts_with(folder.path().join("1").to_str().unwrap()), "{}", hint());
    }
}
