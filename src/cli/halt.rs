//! `onbrick halt`: stop every motor now.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Serialize;
use serde_json::json;

use super::brick::no_brick;
use super::{Context, Exit, Failure, Output};
use crate::clock::{MonotonicClock, SECOND_NS};
use crate::ev3dev::{Inventory, LocalTree, Tree};
use crate::robot::{Halted, halt, watch_still};
use crate::runtime::{
    HardwareLock, LockError, OrphansError, Owner, PATIENCE_NS, StopBy, StopRequest, evict,
    halt_command, stop_orphans,
};

/// Stop the run that drives, then every motor, and watch for a second that nothing moves.
///
/// Examples:
///   onbrick halt
///   onbrick halt --orphaned      what a service manager calls when the service has ended
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Arguments {
    /// The folder under which sys/class is found.
    #[arg(long, default_value = "/")]
    brick: PathBuf,
    /// Only the motors of a run all of whose processes were killed before they had stopped them; a
    /// run that lives, and motors of other programs, are left alone.
    #[arg(long)]
    orphaned: bool,
}

#[derive(Serialize)]
struct Report {
    stopped_run: Option<Owner>,
    motors: Vec<Halted>,
    still: bool,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    if arguments.orphaned {
        return halt_orphans(arguments, output);
    }
    // Whatever comes of it, every motor is told to stop.
    let stopped_run = stop_owner(&arguments.brick);
    // A brick without motors is still; a folder that is no brick is a slip, and the robot may be
    // driving elsewhere.
    if !arguments.brick.join("sys/class").is_dir() {
        return Err(no_brick(&arguments.brick));
    }
    let tree: Arc<dyn Tree> = Arc::new(LocalTree::new(&arguments.brick));
    let motors = halt(&tree).map_err(|error| cannot_stop(&error))?;
    let moving =
        watch_still(&tree, &MonotonicClock, SECOND_NS).map_err(|error| cannot_stop(&error))?;
    let (stopped_run, ended) = stopped_run?;
    if let Ok(Some((mut lock, _))) = HardwareLock::take_orphans(&arguments.brick) {
        // They were among those that were just stopped.
        let _ = lock.nothing_turns();
    }
    if let Some(owner) = stopped_run.as_ref().filter(|_| ended) {
        output.line(format!("stopped {} (process {})", owner.doing, owner.pid));
    }
    for motor in &motors {
        output.line(format!("{}: {} stopped", motor.address, motor.driver_name));
    }
    if motors.is_empty() {
        if Inventory::read(&tree).is_ok_and(|found| found.is_empty()) {
            return Err(no_brick(&arguments.brick).hint(
                "run this on the brick; onbrick stop stops those that are known in the network",
            ));
        }
        output.line(format!("there are no motors below {}", arguments.brick.display()));
    }
    output.value(&Report {
        stopped_run: stopped_run.clone().filter(|_| ended),
        motors,
        still: moving.is_empty(),
    });
    if let Some(owner) = stopped_run.as_ref().filter(|_| moving.is_empty() && !ended) {
        let why = format!(
            "the motors are still, but {} (process {}) cannot be ended",
            owner.doing, owner.pid
        );
        let hint = format!("{} as the same user, or as root", halt_command(&arguments.brick));
        return Err(Failure::failed(why).hint(hint));
    }
    if moving.is_empty() {
        return Ok(());
    }
    Err(Failure::failed(format!("still turning: {}", moving.join(", ")))
        .hint("something else commands these motors, or a hand turns them; unplug their cables"))
}

fn cannot_stop(error: &dyn std::error::Error) -> Failure {
    Failure::from_error(Exit::Failed, "cannot stop the motors", error)
        .hint("unplug the motors' cables, or take out the battery")
}

/// Stops the motors of a run that was killed with its guard, and no others.
fn halt_orphans(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let owner = match stop_orphans(&arguments.brick) {
        Ok(Some(owner)) => owner,
        Ok(None) => {
            output.show("no run has left a motor behind", &json!({ "left_by": null }));
            return Ok(());
        }
        Err(OrphansError::Lock(LockError::Taken(owner))) => {
            let who = format!("{} (process {}) sees to its motors itself", owner.doing, owner.pid);
            output.show(who, &json!({ "left_by": null }));
            return Ok(());
        }
        Err(error @ OrphansError::Halt(_)) => return Err(cannot_stop(&error)),
        Err(error) => {
            return Err(Failure::from_error(Exit::Failed, "cannot see who drove", &error));
        }
    };
    let ports = owner.motors.join(", ");
    let what = format!("stopped what {} (process {}) left behind: {ports}", owner.doing, owner.pid);
    output.show(what, &json!({ "left_by": owner }));
    Ok(())
}

/// Asks the run that owns the motors to stop, and ends it by force where it does not listen; the
/// run, and whether it cannot turn a motor any more.
fn stop_owner(root: &Path) -> Result<(Option<Owner>, bool), Failure> {
    const DOING: &str = "cannot see who drives";
    let Some(owner) = HardwareLock::owner(root).context(Exit::Failed, DOING)? else {
        return Ok((None, true));
    };
    let _request = StopRequest::make(root, StopBy::Here);
    let ended = evict(root, PATIENCE_NS, |_| true).context(Exit::Failed, DOING)?;
    Ok((Some(owner), ended))
}
