//! Whether a command of ours may be running, and whether a drop ends it.

use std::cell::Cell;

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

    /// Whether a drop has something to end.
    pub(super) fn is_to_be_ended(&self) -> bool {
        self.may_drive.get() && self.ends_on_drop.get()
    }
}
