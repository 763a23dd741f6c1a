//! Whether a command of ours may be running, and whether a drop ends it.

use std::cell::Cell;

use crate::ev3dev::node::{Attribute, Node};
use crate::ev3dev::value::Value;

/// A motor's account of the commands that it was given.
#[derive(Debug)]
pub(super) struct Commanded {
    may_drive: Cell<bool>,
    ends_on_drop: Cell<bool>,
}

impl Commanded {
    pub(super) const fn new() -> Self {
        Self { may_drive: Cell::new(false), ends_on_drop: Cell::new(true) }
    }

    /// Gives a command by `write`; `drives` says whether the motor may move after it.
    pub(super) fn give<E>(
        &self,
        drives: bool,
        write: impl FnOnce() -> Result<(), E>,
    ) -> Result<(), E> {
        // Before it is written: a command whose answer is lost may be running.
        self.may_drive.set(self.may_drive.get() || drives);
        write()?;
        self.may_drive.set(drives);
        Ok(())
    }

    pub(super) fn set_ends_on_drop(&self, ends: bool) {
        self.ends_on_drop.set(ends);
    }

    /// At a drop: ends by `command` what may be running.
    pub(super) fn end<C: Value>(&self, node: &Node, file: &Attribute<C>, command: &C) {
        if self.may_drive.get() && self.ends_on_drop.get() && file.is_open_for_writing() {
            // An error cannot be reported from here; an unplugged motor does not turn.
            let _ = file.write(node, command);
        }
    }
}
