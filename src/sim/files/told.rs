//! What is told of a robot, and done to it on purpose: the files `sim/truth`, `sim/faults` and
//! `sim/orders`.
//!
//! The truth is only read. To the others each write is a text of orders, one a line (`in1 stuck`,
//! `battery 6.2`, `press enter for 1`, `place 0.5 0 90`, `clear`); a text that is not understood
//! does nothing and answers EINVAL. A read says behind `#` what was done when; in `sim/faults`
//! first of all what is wrong now, as orders that would bring it about. No brick has these files.

use std::io::Write as _;

use nix::errno::Errno;

use super::truth;
use crate::clock::seconds;
use crate::sim::Simulation;
use crate::sim::brick::tree::{FAULTS, ORDERS, TRUTH};
use crate::sim::simulation::State;

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

impl Tells {
    /// The file at a path; none at any other.
    pub(super) fn at(path: &str) -> Option<Self> {
        match path {
            TRUTH => Some(Self::Truth),
            FAULTS => Some(Self::Wrong),
            ORDERS => Some(Self::Done),
            _ => None,
        }
    }
}

/// Appends the text as of now.
///
/// # Errors
///
/// ENODATA for a truth that is unknown.
pub(super) fn tell(
    tells: Tells,
    state: &State,
    robot: usize,
    text: &mut Vec<u8>,
) -> Result<(), Errno> {
    if tells == Tells::Truth {
        let line = truth::line(state, robot).ok_or(Errno::ENODATA)?;
        serde_json::to_writer(&mut *text, &line).map_err(|_| Errno::EIO)?;
        text.push(b'\n');
        return Ok(());
    }
    let brick = state.bricks.get(robot).filter(|_| tells == Tells::Wrong);
    for (port, fault) in brick.into_iter().flat_map(|brick| brick.faults_active()) {
        // Writing to a vector does not fail.
        let _ = writeln!(text, "{port} {fault}");
    }
    for done in state.faults.done.iter().filter(|done| done.robot == robot) {
        let _ = writeln!(text, "# {:.3} s: {}", seconds(done.time_ns), done.what);
    }
    Ok(())
}

/// Follows the orders in a text; returns its length.
///
/// # Errors
///
/// EINVAL for a text that is not understood, and for an order that could not be followed.
pub(super) fn order(simulation: &Simulation, robot: usize, bytes: &[u8]) -> Result<usize, Errno> {
    let text = std::str::from_utf8(bytes).map_err(|_| Errno::EINVAL)?;
    simulation.control(robot, text).map_err(|_| Errno::EINVAL)?;
    Ok(bytes.len())
}
