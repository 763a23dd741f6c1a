//! `onbrick sim exec`: a program in a private view in which a mounted brick lies over this
//! machine's devices.

use std::ffi::OsString;
use std::os::unix::process::ExitStatusExt as _;
use std::path::Path;
use std::process::{Child, Command, ExitStatus};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use super::private::{PrivateError, PrivateView};
use super::stand_in::{STAND_INS, Speaker};
use crate::cli::common::own_program;
use crate::cli::terminal::stop_flags;
use crate::cli::{Context, Exit, Failure, Hint, Output};
use crate::clock::{Clock, MILLISECOND_NS, MonotonicClock};
use crate::runtime::StopFlags;

/// How often it is looked whether the program has ended or was to end.
const LOOK_NS: i64 = 10 * MILLISECOND_NS;

/// How often what was drawn is brought to the brick's screen.
const REFRESH_NS: i64 = 50 * MILLISECOND_NS;

/// What a shell adds to a signal's number for the exit code.
const SIGNALLED: i32 = 128;

/// Runs a program over a mounted brick; its exit code becomes ours.
pub(super) fn exec(brick: &Path, program: &[OsString], output: &mut Output) -> Result<(), Failure> {
    // Before there is any other thread: a user namespace is for a process that has one.
    let mut view = PrivateView::enter(brick, &own_program()?).map_err(|error| {
        let exit =
            if matches!(error, PrivateError::Failed { .. }) { Exit::Failed } else { Exit::Refused };
        Failure::from_error(exit, "no program was started", &error).hint(error.hint())
    })?;
    if !view.lacking.is_empty() {
        let names = view.lacking.join(", ");
        log::warn!("{names}: found by PATH alone, since nothing can be laid over /usr/bin here");
    }
    let flags = stop_flags()?;
    let Some((name, arguments)) = program.split_first() else {
        return Err(Failure::usage("no program is named"));
    };
    let started = Command::new(name).args(arguments).envs(PrivateView::environment()).spawn();
    let name = Path::new(name).display();
    let child = started
        .context(Exit::Failed, format_args!("cannot start {name}"))
        .hint("a program of this machine, or a file that may be executed")?;
    let status = attend(child, &mut view, &flags)?;
    let code = status.code().or_else(|| status.signal().map(|signal| SIGNALLED + signal));
    output.ends_with(code.and_then(|code| u8::try_from(code).ok()).unwrap_or(u8::MAX));
    Ok(())
}

/// Until the program has ended: brings its pictures to the screen, and hands on who asks it to end.
fn attend(
    mut child: Child,
    view: &mut PrivateView,
    flags: &StopFlags,
) -> Result<ExitStatus, Failure> {
    let mut refresh_ns = 0;
    let mut asked = false;
    loop {
        let ended = child.try_wait().context(Exit::Failed, "lost the program")?;
        let now_ns = MonotonicClock.now_ns();
        if ended.is_some() || now_ns >= refresh_ns {
            refresh_ns = now_ns + REFRESH_NS;
            if let Err(error) = view.refresh() {
                log::debug!("the brick's screen: {error}");
            }
        }
        if let Some(status) = ended {
            return Ok(status);
        }
        if flags.is_raised() && !asked {
            asked = true;
            // Ctrl-C has reached it already, and twice does no harm; a signal for us alone has not.
            if let Ok(process) = i32::try_from(child.id()) {
                let _ = kill(Pid::from_raw(process), Signal::SIGTERM);
            }
        }
        MonotonicClock.sleep_until_ns(now_ns + LOOK_NS);
    }
}

/// Does what a stand-in's program would do.
pub(super) fn stand_in(
    view: &Path,
    name: &str,
    arguments: &[String],
    output: &mut Output,
) -> Result<(), Failure> {
    let (_, stand_in) = STAND_INS
        .iter()
        .find(|(known, _)| *known == name)
        .ok_or_else(|| Failure::usage(format!("there is no stand-in for `{name}`")))?;
    let flags = stop_flags()?;
    let mut said = Vec::new();
    let speaker = Speaker { view, ends: &|| flags.is_raised() };
    stand_in(&speaker, arguments, &mut said).context(Exit::Failed, name)?;
    output.bytes(&said);
    Ok(())
}
