//! What is built into a board, and how the kernel names it: the one place that knows the board.
//!
//! | | EV3 | BrickPi3 | BrickPi, BrickPi+ | PiStorms | EVB |
//! |---|---|---|---|---|---|
//! | ports | `ev3-ports:outA`, `:in1` | `spi0.1:MA`, `:S1` | `serial0-0:MA`, `:S1` | `pistorms:BAM1`, `BAS1` | `evb-ports:outA`, `:in1` |
//! | finds out what is plugged in | all | nothing | nothing | the kind of a serial sensor | all |
//! | motors' driver | by kind | `lego-nxt-motor` | `lego-nxt-motor` | `lego-nxt-motor` | by kind |
//! | stop actions | all | all | no `brake` | all | all |
//! | commands | all | all | all | no `run-direct` | all |
//! | `state` | all | never `stalled`; `holding` is `running` too | all | `holding` is `running` too | all |
//! | `speed`, `duty_cycle` | yes | yes | yes | EOPNOTSUPP | yes |
//! | buttons | six | none | none | GO (Enter) | six |
//! | lights | two, red and green | one, amber | two, blue | two, red, green and blue | none |
//! | battery | `lego-ev3-battery` | `brickpi3-battery` | `brickpi-battery` | `pistorms-battery` | `evb-battery` |
//! | speaker by events | yes | none | none | none | none known |
//! | screen for the menu | 178 × 128 | none | none | none | none |
//!
//! # `run-timed`
//!
//! Every board has it. The class keeps its timer (`tacho_motor_class.c`, `run_timed_work`) for each
//! driver that can regulate a speed and stop, which all five can. So a lease is the promise of the
//! board's kernel everywhere. On the Raspberry Pi the motors are driven by a controller of their
//! own: what that does when the kernel itself has crashed is not known here.
//!
//! # Sources
//!
//! ev3dev's `lego-linux-drivers`: `brickpi3/brickpi3_{ports_in,ports_out,leds,battery,
//! board_info}.c`, `brickpi/brickpi_{ports_in,ports_out,serdev,battery}.c`,
//! `pistorms/pistorms_{core,ports_in,ports_out,leds,input,battery,board_info}.c` with
//! `sensors/ms_nxtmmx.c`, `evb/evb_{ports_in,ports_out,input,battery}.c`,
//! `linux/board_info/bone_cape_board_info.c`, `motors/tacho_motor_class.c`,
//! `core/lego_port_class.c`. Names that a device tree gives (ports of the BrickPi and the EVB,
//! lights of BrickPi and BrickPi3, the path of the PiStorms' and EVB's buttons) are from
//! `ev3dev2/_platform/*.py` of ev3dev-lang-python. What boards call themselves is confirmed by
//! `ev3dev-sysinfo` in ev3dev's issues 1003 (BrickPi3) and ev3dev-lang-java's 597 (PiStorms);
//! that the BrickPi cannot brake by ev3dev's 812, `running holding` by 1188.
//!
//! # Not known
//!
//! - No row but the EV3's was held against a board; nothing of this was measured.
//! - The PiStorms' buttons on a Raspberry Pi 1, Zero or 4, whose I²C has another address in the
//!   path: `[stop_button]` of `robot.toml` or `--buttons` names it. Its touch screen is not read.
//! - How the colour screens of PiStorms and EVB are laid out on their images; so the menu is not
//!   drawn there.
//! - Which speakers the boards have as input devices; the EVB's is a sound card.
//! - How many cells a board is fed with: the usual holder is taken.
//!
//! # A new board
//!
//! A row here, in [`PLATFORMS`]; one in `sim/board.rs`; drivers with other names in
//! `ev3dev/words.rs`. Everything else asks the platform.
//!
//! # Not here
//!
//! What is plugged in, which [`find`](super::find()) looks for.

use std::sync::Arc;

use super::board::BoardInfo;
use super::tree::Tree;

mod boards;

pub use boards::{BRICKPI, BRICKPI3, EV3, EVB, PISTORMS};

/// A board: what is built into it, and how the kernel names it. `None` for what it does not have.
#[derive(Debug, PartialEq)]
pub struct Platform {
    /// What people call it.
    pub what: &'static str,
    /// The word for it on the command line.
    pub name: &'static str,
    /// What the board calls itself in class `board-info`.
    pub models: &'static [&'static str],
    /// What comes before the name of a port in an address: the name of the ports' parent device.
    pub parent: &'static str,
    /// The input ports' names behind that, as they are printed on the board.
    pub inputs: [&'static str; 4],
    /// The output ports' names.
    pub outputs: [&'static str; 4],
    /// Whether the ports find out what is plugged in. Where they do not, `robot.toml` says what is
    /// on a port, and the port is told so before a run.
    pub detects: bool,
    /// The buttons' input device, below the root.
    pub buttons: Option<&'static str>,
    /// Those that stop a run, as they are printed on the board.
    pub stop_buttons: &'static str,
    /// How often its driver reads a sensor, nanoseconds: a mode's values are old for so long.
    pub poll_ns: i64,
    /// The speaker's input device, below the root.
    pub speaker: Option<&'static str>,
    /// The status lights, left and right, each by its LEDs; none where there is no light.
    pub lights: [&'static [Lamp]; 2],
    /// The battery in class `power_supply`.
    pub battery: &'static str,
    /// The cells in series that the board is usually fed with, AA.
    pub cells: u8,
    /// More than this the board does not take, volts: above, the reading is wrong.
    pub most_v: f64,
    /// The screen, or why the menu is not shown on this board.
    pub screen: Result<FrameBuffer, &'static str>,
}

/// An LED of a status light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lamp {
    /// Its part in a colour.
    pub hue: Hue,
    /// Its name in class `leds`.
    pub led: &'static str,
}

/// What an LED is in a colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hue {
    /// The red in it.
    Red,
    /// The green in it.
    Green,
    /// The blue in it, of which no colour here has any.
    Blue,
    /// The light's only LED: on in any colour.
    Only,
}

/// A screen as the kernel has it.
#[derive(Debug, PartialEq, Eq)]
pub struct FrameBuffer {
    /// Its device, below the root.
    pub device: &'static str,
    /// The folder that describes it, below the root.
    pub description: &'static str,
}

/// Every board that this program knows.
pub static PLATFORMS: [&Platform; 5] = [&EV3, &BRICKPI3, &BRICKPI, &PISTORMS, &EVB];

impl Default for &Platform {
    /// The board that everything was made for first: the EV3.
    fn default() -> Self {
        &EV3
    }
}

impl Platform {
    /// What people call one of them: "an EV3", "a BrickPi3".
    #[must_use]
    pub fn one(&self) -> String {
        let article = if self.what.starts_with('E') { "an" } else { "a" };
        format!("{article} {}", self.what)
    }

    /// The board below a root: the EV3 where no board says what it is, as in a simulation.
    #[must_use]
    pub fn of(tree: &Arc<dyn Tree>) -> &'static Self {
        // A board on a Raspberry Pi or a BeagleBone is the second one, beside the main board.
        let boards = BoardInfo::read_all(tree).unwrap_or_default();
        let model = |platform: &&&Self| {
            let is_it = |model: &String| platform.models.contains(&model.as_str());
            boards.iter().any(|board| board.model.as_ref().is_some_and(is_it))
        };
        PLATFORMS.iter().find(model).copied().unwrap_or_default()
    }

    /// The board with a name on the command line.
    #[must_use]
    pub fn named(name: &str) -> Option<&'static Self> {
        PLATFORMS.into_iter().find(|platform| platform.name == name)
    }

    /// A port's address without what all of the board's addresses begin with: `outB` for
    /// `ev3-ports:outB`.
    #[must_use]
    pub fn short(address: &str) -> &str {
        PLATFORMS
            .into_iter()
            .find_map(|platform| address.strip_prefix(platform.parent)?.strip_prefix(':'))
            .unwrap_or(address)
    }

    /// Whether a device's address is on the port that has the name `wanted` on an EV3: `outB` is
    /// `MB` on a BrickPi3, so that a robot's file fits every board.
    #[must_use]
    pub fn is_port(wanted: &str, address: &str) -> bool {
        PLATFORMS.into_iter().any(|platform| {
            let own = address.strip_prefix(platform.parent).and_then(|it| it.strip_prefix(':'));
            let own = own.map(|own| own.split(':').next().unwrap_or_default());
            let mut names = platform.ports().zip(EV3.ports());
            own.is_some_and(|own| names.any(|(name, usual)| name == own && usual == wanted))
        })
    }

    /// Whether a board may have a port that is called so in one word. Those of stacked BrickPi3s
    /// continue after `MD` and `S4`.
    #[must_use]
    pub fn may_have(port: &str) -> bool {
        let is_stacked =
            |first| port.strip_prefix(first).is_some_and(|it| matches!(it.len(), 1 | 2));
        PLATFORMS.into_iter().any(|platform| platform.ports().any(|own| own == port))
            || is_stacked('M')
            || is_stacked('S')
    }

    /// The names of its ports: inputs, then outputs.
    pub fn ports(&self) -> impl Iterator<Item = &'static str> + Clone {
        self.inputs.into_iter().chain(self.outputs)
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
        let describe = |board: &str, text: &str| {
            let board = folder.path().join("sys/class/board-info").join(board);
            std::fs::create_dir_all(&board).unwrap();
            std::fs::write(board.join("uevent"), text).unwrap();
        };
        for platform in PLATFORMS {
            for model in platform.models {
                describe("board0", &format!("BOARD_INFO_TYPE=main\nBOARD_INFO_MODEL={model}\n"));
                assert_eq!(Platform::of(&tree), platform);
            }
            assert_eq!(Platform::named(platform.name), Some(platform));
        }
        // As `ev3dev-sysinfo` prints them of a Raspberry Pi with a BrickPi3.
        let pi = "BOARD_INFO_HW_REV=A02082\nBOARD_INFO_MODEL=Raspberry Pi 3 Model B Rev 1.2\n\
                  BOARD_INFO_TYPE=main\n";
        describe("board0", pi);
        assert_eq!(Platform::of(&tree), &EV3);
        let brickpi3 = "BOARD_INFO_FW_VER=1.4.6\nBOARD_INFO_MODEL=Dexter Industries BrickPi3\n\
                        BOARD_INFO_TYPE=aux\n";
        describe("board1", brickpi3);
        assert_eq!(Platform::of(&tree), &BRICKPI3);
    }

    #[test]
    fn ports_are_shown_as_they_are_printed_on_the_board_and_have_one_name_each() {
        assert_eq!(
            ["ev3-ports:outB", "in1:i2c1", "spi0.1:MA", "pistorms:BAS1", "serial0-0:S4"]
                .map(Platform::short),
            ["outB", "in1:i2c1", "MA", "BAS1", "S4"]
        );
        for (wanted, address, is_it) in [
            ("outB", "spi0.1:MB", true),
            ("outB", "spi0.1:MA", false),
            ("in3", "pistorms:BBS1", true),
            ("in1", "serial0-0:S1:i2c1", true),
            ("MB", "pistorms:BAM2", false),
            ("outB", "outB", false),
        ] {
            assert_eq!(Platform::is_port(wanted, address), is_it, "{wanted} at {address}");
        }
        for platform in PLATFORMS {
            let mut names: Vec<_> = platform.ports().collect();
            names.sort_unstable();
            names.dedup();
            assert_eq!(names.len(), 8, "{}", platform.name);
        }
    }
}
