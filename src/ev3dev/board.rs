//! Which brick this is: class `board-info`.

use std::sync::Arc;

use nix::errno::Errno;

use super::error::{Cause, DeviceError};
use super::node::Node;
use super::tree::{Access, Tree};
use super::value::Legal;

/// What a board says of itself. A board may leave out any of it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct BoardInfo {
    /// It is the board with the processor.
    pub is_main: bool,
    /// `LEGO MINDSTORMS EV3`, or another platform's name.
    pub model: Option<String>,
    /// Revision of the hardware.
    pub hardware_revision: Option<String>,
    /// Revision of the ROM.
    pub rom_revision: Option<String>,
    /// Serial number: 12 hexadecimal digits on an EV3.
    pub serial_number: Option<String>,
}

const FOLDER: &str = "sys/class/board-info";

impl BoardInfo {
    /// The main board's, or `None` where no board says that it is the main one: this machine is no
    /// brick.
    ///
    /// # Errors
    ///
    /// As [`BoardInfo::read_all`].
    pub fn read(tree: &Arc<dyn Tree>) -> Result<Option<Self>, DeviceError> {
        Ok(Self::read_all(tree)?.into_iter().find(|board| board.is_main))
    }

    /// Every board's: a Raspberry Pi with a BrickPi3 has two.
    ///
    /// # Errors
    ///
    /// [`Cause::Malformed`] for a description that is no text; what listing and reading give.
    pub fn read_all(tree: &Arc<dyn Tree>) -> Result<Vec<Self>, DeviceError> {
        let mut boards = match tree.list(FOLDER) {
            Ok(boards) => boards,
            Err(Errno::ENOENT) => return Ok(Vec::new()),
            Err(errno) => {
                return Err(Node::new(tree, FOLDER, None).error(
                    "uevent",
                    None,
                    Cause::Other(errno),
                ));
            }
        };
        boards.sort();
        let read = |board: &String| {
            let text = description(&Node::new(tree, &format!("{FOLDER}/{board}"), None))?;
            Ok(Self {
                is_main: value(&text, "TYPE").as_deref() == Some("main"),
                model: value(&text, "MODEL"),
                hardware_revision: value(&text, "HW_REV"),
                rom_revision: value(&text, "ROM_REV"),
                serial_number: value(&text, "SERIAL_NUM"),
            })
        };
        boards.iter().map(read).collect()
    }
}

/// The one file of which every line counts.
fn description(node: &Node) -> Result<String, DeviceError> {
    let mut buffer = vec![0; 4096];
    let length = node
        .open("uevent", Access::Read)?
        .read(&mut buffer)
        .map_err(|errno| node.error("uevent", None, Cause::Other(errno)))?;
    buffer.truncate(length);
    String::from_utf8(buffer).map_err(|error| {
        node.error("uevent", Some(error.as_bytes()), Cause::Malformed(Legal::Text))
    })
}

fn value(text: &str, key: &str) -> Option<String> {
    let line = text
        .lines()
        .find_map(|line| line.strip_prefix("BOARD_INFO_")?.strip_prefix(key)?.strip_prefix('='));
    line.map(str::to_owned)
}
