//! What is done to a robot on purpose: the files `sim/faults` and `sim/orders`.
//!
//! Each write is a text of orders, one a line (`in1 stuck`, `battery 6.2`, `press enter for 1`,
//! `place 0.5 0 90`, `clear`); a text that is not understood does nothing and answers EINVAL. A
//! read says behind `#` what was done when; in `sim/faults` first of all what is wrong now, as
//! orders that would bring it about. No brick has these files.

use std::fmt::Write as _;
use std::sync::Arc;
use std::time::Duration;

use nix::errno::Errno;

use super::{copy, wait};
use crate::clock::seconds;
use crate::ev3dev::AttributeFile;
use crate::sim::Simulation;
use crate::sim::simulation::Shared;

/// What a read begins with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Tells {
    /// What is wrong now.
    Wrong,
    /// Nothing: what was done is all.
    Done,
}

/// An open file.
#[derive(Debug)]
pub(crate) struct OrdersFile {
    shared: Arc<Shared>,
    robot: usize,
    tells: Tells,
}

impl OrdersFile {
    /// Opens it.
    pub(crate) fn open(shared: &Arc<Shared>, robot: usize, tells: Tells) -> Self {
        Self { shared: Arc::clone(shared), robot, tells }
    }

    /// The text as of now, in place of what is in `text`.
    pub(crate) fn read_into(&self, text: &mut Vec<u8>) {
        let simulation = Simulation::of(&self.shared);
        let mut lines = String::new();
        if self.tells == Tells::Wrong {
            for (port, fault) in simulation.faults_active(self.robot) {
                let _ = writeln!(lines, "{port} {fault}");
            }
        }
        for done in simulation.faults_done().iter().filter(|done| done.robot == self.robot) {
            let _ = writeln!(lines, "# {:.3} s: {}", seconds(done.time_ns), done.what);
        }
        text.clear();
        text.extend_from_slice(lines.as_bytes());
    }

    /// Follows the orders in a text.
    ///
    /// # Errors
    ///
    /// EINVAL for a text that is not understood, and for an order that could not be followed.
    pub(crate) fn order(&self, bytes: &[u8]) -> Result<usize, Errno> {
        let text = std::str::from_utf8(bytes).map_err(|_| Errno::EINVAL)?;
        Simulation::of(&self.shared).control(self.robot, text).map_err(|_| Errno::EINVAL)?;
        Ok(bytes.len())
    }
}

impl AttributeFile for OrdersFile {
    fn read(&self, buffer: &mut [u8]) -> Result<usize, Errno> {
        let mut text = Vec::new();
        self.read_into(&mut text);
        Ok(copy(&text, buffer))
    }

    fn write(&self, value: &[u8]) -> Result<usize, Errno> {
        self.order(value)
    }

    fn wait_changed(&self, timeout: Duration) -> Result<bool, Errno> {
        wait(&self.shared, timeout, || None)
    }
}
