//! `onbrick halt`: stop every motor now.

use std::path::PathBuf;
use std::sync::Arc;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde::Serialize;

use super::common::no_brick;
use super::{Exit, Failure, Output};
use crate::clock::{Clock, MILLISECOND_NS, MonotonicClock, SECOND_NS};
use crate::ev3dev::{LocalTree, PortAddress, Tree};
use crate::robot::{Halted, halt, still, watch_still};
use crate::runtime::{HardwareLock, LockError, Owner};

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
    /// Only the motors of a run all of whose processes were killed before they had stopped them; a run that lives, and motors of other programs, are
    /// left alone.
    #[arg(long)]
    orphaned: bool,
}

#[derive(Serialize)]
struct Orphans {
    left_by: Option<Owner>,
}

#[derive(Serialize)]
struct Report {
    stopped_run: Option<Owner>,
    motors: Vec<Halted>,
    still: bool,
}

/// How long a run has to stop by itself before it is killed, nanoseconds; its leases end after 300 ms.
const PATIENCE_NS: i64 = SECOND_NS / 2;

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let clock = MonotonicClock;
    if arguments.orphaned {
        return stop_orphans(arguments, &clock, output);
    }
    // Should the owner not stop, its motors are stopped all the same.
    let stopped_run = stop_owner(arguments, &clock);
    // A brick without motors is still; a folder that is no brick is a slip, and the robot may be driving elsewhere.
    if !arguments.brick.join("sys/class").is_dir() {
        return Err(no_brick(&arguments.brick));
    }
    let tree: Arc<dyn Tree> = Arc::new(LocalTree::new(&arguments.brick));
    let motors = halt(&tree).map_err(|error| cannot_stop(&error))?;
    let stopped_run = stopped_run?;
    let moving = watch_still(&tree, &clock, SECOND_NS).map_err(|error| cannot_stop(&error))?;
    if let Ok(Some((mut lock, _))) = HardwareLock::take_orphans(&arguments.brick) {
        // They were among those that were just stopped.
        let _ = lock.nothing_turns();
    }
    if let Some(owner) = &stopped_run {
        output.line(format!("stopped {} (process {})", owner.doing, owner.pid));
    }
    for motor in &motors {
        output.line(format!("{}: {} stopped", motor.address, motor.driver_name));
    }
    if motors.is_empty() {
        output.line(format!("there are no motors below {}", arguments.brick.display()));
    }
    output.value(&Report { stopped_run, motors, still: moving.is_empty() });
    if moving.is_empty() {
        return Ok(());
    }
    Err(Failure::new(Exit::Failed, format!("still turning: {}", moving.join(", ")))
        .hint("something else commands these motors, or a hand turns them; unplug their cables"))
}

fn cannot_stop(error: &dyn std::error::Error) -> Failure {
    Failure::from_error(Exit::Failed, "cannot stop the motors", error)
        .hint("unplug the motors' cables, or take out the battery")
}

/// Stops the motors of a run that was killed with its guard, and no others.
fn stop_orphans(arguments: &Arguments, clock: &dyn Clock, output: &mut Output) -> Result<(), Failure> {
    let (mut lock, owner) = match HardwareLock::take_orphans(&arguments.brick) {
        Ok(Some(found)) => found,
        Ok(None) => {
            output.show("no run has left a motor behind", &Orphans { left_by: None });
            return Ok(());
        }
        Err(LockError::Taken(owner)) => {
            let who = format!("{} (process {}) sees to its motors itself", owner.doing, owner.pid);
            output.show(who, &Orphans { left_by: None });
            return Ok(());
        }
        Err(error) => return Err(Failure::from_error(Exit::Failed, "cannot see who drove", &error)),
    };
    let tree: Arc<dyn Tree> = Arc::new(LocalTree::new(&arguments.brick));
    let ports: Vec<PortAddress> = owner.motors.iter().filter_map(|motor| motor.parse().ok()).collect();
    still(&tree, &ports, clock).map_err(|error| cannot_stop(&error))?;
    lock.nothing_turns().map_err(|error| Failure::from_error(Exit::Failed, "cannot note it", &error))?;
    let ports: Vec<String> = ports.iter().map(ToString::to_string).collect();
    let what =
        format!("stopped what {} (process {}) left behind: {}", owner.doing, owner.pid, ports.join(", "));
    output.show(what, &Orphans { left_by: Some(owner) });
    Ok(())
}

/// Asks the run that owns the motors to stop, and kills it where it does not listen.
fn stop_owner(arguments: &Arguments, clock: &dyn Clock) -> Result<Option<Owner>, Failure> {
    let owner = || {
        HardwareLock::owner(&arguments.brick)
            .map_err(|error| Failure::from_error(Exit::Failed, "cannot see who drives", &error))
    };
    let Some(found) = owner()? else { return Ok(None) };
    if found.pid <= 0 {
        return Ok(Some(found));
    }
    let pid = Pid::from_raw(found.pid);
    for signal in [Signal::SIGTERM, Signal::SIGKILL] {
        // A process that has just gone is as good as one that obeys; one of another user's keeps its lock, and shows below.
        let _ = kill(pid, signal);
        let deadline_ns = clock.now_ns() + PATIENCE_NS;
        while clock.now_ns() < deadline_ns {
            if owner()?.is_none() {
                return Ok(Some(found));
            }
            clock.sleep_until_ns(clock.now_ns() + 10 * MILLISECOND_NS);
        }
    }
    Err(Failure::new(Exit::Failed, format!("{} (process {}) does not stop", found.doing, found.pid))
        .hint("run onbrick halt as the same user, or as root"))
}
