//! What is built into a board, and how the kernel names it: the one place that knows the board.
//!
//! # A new board
//!
//! A [`Platform`] of its own here and in [`PLATFORMS`]; drivers with other names in
//! `ev3dev/words.rs`; a `robot.toml` with its ports. Everything else asks the platform.
//!
//! # Not here
//!
//! What is plugged in, which [`find`](super::find()) looks for.

use std::sync::Arc;

use super::board::BoardInfo;
use super::tree::Tree;

/// A board: what is built into it, and how the kernel names it. `None` for what it does not have.
#[derive(Debug, PartialEq, Eq)]
pub struct Platform {
    /// What the board calls itself in class `board-info`.
    pub model: &'static str,
    /// What addresses of its ports begin with: the name of their driver.
    pub ports: &'static str,
    /// The buttons' input device, below the root.
    pub buttons: Option<&'static str>,
    /// The speaker's input device, below the root.
    pub speaker: Option<&'static str>,
    /// The status lights' LEDs: red and green of the left one, then of the right one.
    pub lights: Option<[[&'static str; 2]; 2]>,
    /// The battery in class `power_supply`.
    pub battery: &'static str,
    /// The screen.
    pub screen: Option<FrameBuffer>,
}

/// A screen as the kernel has it.
#[derive(Debug, PartialEq, Eq)]
pub struct FrameBuffer {
    /// Its device, below the root.
    pub device: &'static str,
    /// The folder that describes it, below the root.
    pub description: &'static str,
}

/// LEGO's EV3 (`ev3dev-interfaces`, 2 to 12).
pub static EV3: Platform = Platform {
    model: "LEGO MINDSTORMS EV3",
    ports: "ev3-ports:",
    buttons: Some("dev/input/by-path/platform-gpio_keys-event"),
    speaker: Some("dev/input/by-path/platform-sound-event"),
    lights: Some([
        ["led0:red:brick-status", "led0:green:brick-status"],
        ["led1:red:brick-status", "led1:green:brick-status"],
    ]),
    battery: "lego-ev3-battery",
    screen: Some(FrameBuffer { device: "dev/fb0", description: "sys/class/graphics/fb0" }),
};

/// Every board that this program knows.
pub static PLATFORMS: [&Platform; 1] = [&EV3];

impl Platform {
    /// The board below a root: the EV3 where no board says what it is, as in a simulation.
    #[must_use]
    pub fn of(tree: &Arc<dyn Tree>) -> &'static Self {
        let model = BoardInfo::read(tree).ok().flatten().and_then(|board| board.model);
        let known = PLATFORMS.into_iter().find(|platform| model.as_deref() == Some(platform.model));
        known.unwrap_or(&EV3)
    }

    /// A port's address without what all of the board's addresses begin with: `outB` for
    /// `ev3-ports:outB`.
    #[must_use]
    pub fn short(address: &str) -> &str {
        PLATFORMS
            .into_iter()
            .find_map(|platform| address.strip_prefix(platform.ports))
            .unwrap_or(address)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ev3dev::LocalTree;

    #[test]
    fn a_board_is_found_by_what_it_calls_itself_and_an_unknown_one_is_taken_for_an_ev3() {
        let folder = tempfile::tempdir().unwrap();
        let tree: Arc<dyn Tree> = Arc::new(LocalTree::new(folder.path()));
        assert_eq!(Platform::of(&tree), &EV3);
        let board = folder.path().join("sys/class/board-info/board0");
        std::fs::create_dir_all(&board).unwrap();
        for platform in PLATFORMS {
            let text = format!("BOARD_INFO_TYPE=main\nBOARD_INFO_MODEL={}\n", platform.model);
            std::fs::write(board.join("uevent"), text).unwrap();
            assert_eq!(Platform::of(&tree), platform);
        }
        assert_eq!(["ev3-ports:outB", "in1:i2c1"].map(Platform::short), ["outB", "in1:i2c1"]);
    }
}
