//! What is told of a robot, and done to it on purpose: the files `sim/truth`, `sim/faults` and
//! `sim/orders`.
//!
//! The truth is only read. To the others each write is a text of orders, one a line (`in1 stuck`,
//! `battery 6.2`, `press enter for 1`, `place 0.5 0 90`, `clear`); a text that is not understood
//! does nothing and answers EINVAL. A read says behind `#` what was done when; in `sim/faults`
//! first of all what is wrong now, as orders that would bring it about. No brick has these files.

use std::io::Write as _;
use std::sync::Arc;
use std::time::Duration;

use nix::errno::Errno;

use super::{copy, truth, wait};
use crate::clock::seconds;
use crate::ev3dev::{Access, AttributeFile};
use crate::sim::Simulation;
use crate::sim::simulation::Shared;

/// What a read tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Tells {
    /// How the robot truly is.
    Truth,
    /// What is wrong now, and what was done.
    Wrong,
    /// What was done.
    Done,
}

/// An open file.
#[derive(Debug)]
pub(crate) struct ToldFile {
    shared: Arc<Shared>,
    robot: usize,
    tells: Tells,
}

impl ToldFile {
    /// Opens it.
    ///
    /// # Errors
    ///
    /// EACCES for a writer of the truth.
    pub(crate) fn open(
        shared: &Arc<Shared>,
        robot: usize,
        tells: Tells,
        access: Access,
    ) -> Result<Self, Errno> {
        if tells == Tells::Truth && access != Access::Read {
            return Err(Errno::EACCES);
        }
        Ok(Self { shared: Arc::clone(shared), robot, tells })
    }

    /// The text as of now, in place of what is in `text`.
    ///
    /// # Errors
    ///
    /// ENODATA for a truth that is unknown.
    pub(crate) fn read_into(&self, text: &mut Vec<u8>) -> Result<(), Errno> {
        text.clear();
        if self.tells == Tells::Truth {
            let line = truth::line(&self.shared.now(), self.robot).ok_or(Errno::ENODATA)?;
            serde_json::to_writer(&mut *text, &line).map_err(|_| Errno::EIO)?;
            text.push(b'\n');
            return Ok(());
        }
        let simulation = Simulation::of(&self.shared);
        if self.tells == Tells::Wrong {
            for (port, fault) in simulation.faults_active(self.robot) {
                // Writing to a vector does not fail.
                let _ = writeln!(text, "{port} {fault}");
            }
        }
        for done in simulation.faults_done().iter().filter(|done| done.robot == self.robot) {
            let _ = writeln!(text, "# {:.3} s: {}", seconds(done.time_ns), done.what);
        }
        Ok(())
    }

    /// Follows the orders in a text.
    ///
    /// # Errors
    ///
    /// EINVAL for a text that is not understood, and for an order that could not be followed; EBADF
    /// for the truth.
    pub(crate) fn order(&self, bytes: &[u8]) -> Result<usize, Errno> {
        if self.tells == Tells::Truth {
            return Err(Errno::EBADF);
        }
        let text = std::str::from_utf8(bytes).map_err(|_| Errno::EINVAL)?;
        Simulation::of(&self.shared).control(self.robot, text).map_err(|_| Errno::EINVAL)?;
        Ok(bytes.len())
    }
}

impl AttributeFile for ToldFile {
    fn read(&self, buffer: &mut [u8]) -> Result<usize, Errno> {
        let mut text = Vec::new();
        self.read_into(&mut text)?;
        Ok(copy(&text, buffer))
    }

    fn write(&self, value: &[u8]) -> Result<usize, Errno> {
        self.order(value)
    }

    fn wait_changed(&self, timeout: Duration) -> Result<bool, Errno> {
        wait(&self.shared, timeout, || None)
    }
}
