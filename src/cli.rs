//! The command line: one file a command, and the only place that prints.
//!
//! A command takes its arguments and an [`Output`] and says how it ended: `Ok`, or a [`Failure`] with an exit code, a message that
//! names the place, and a way out.
//!
//! | exit code | means |
//! |---|---|
//! | 0 | done |
//! | 1 | failed |
//! | 2 | wrong usage |
//! | 3 | refused: a check failed before anything moved |
//! | 4 | no answer in time |
//! | 5 | some bricks failed |

use std::ffi::OsString;
use std::io::Write as _;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

mod calibrate;
mod check;
mod common;
mod control;
mod devices;
mod doctor;
mod fatal;
mod graph;
mod guard;
mod halt;
mod menu;
mod new;
mod output;
mod run;
mod serve;
mod setup;
mod terminal;
mod urgency;

#[cfg(feature = "host")]
mod export;
#[cfg(feature = "host")]
mod plot;
#[cfg(feature = "host")]
mod push;
mod replay;

#[cfg(all(feature = "sim", feature = "host"))]
mod demo;
#[cfg(feature = "sim")]
mod sim;

#[cfg(all(feature = "link", feature = "host"))]
mod bricks;
#[cfg(all(feature = "link", feature = "host"))]
mod fetch;
#[cfg(all(feature = "link", feature = "host"))]
mod identify;
#[cfg(feature = "link")]
mod key;
#[cfg(all(feature = "link", feature = "host"))]
mod missions;
#[cfg(feature = "link")]
mod pair;
#[cfg(all(feature = "link", feature = "host"))]
mod remote;
#[cfg(all(feature = "link", feature = "host"))]
mod runs;
#[cfg(all(feature = "link", feature = "host"))]
mod start;
#[cfg(all(feature = "link", feature = "host"))]
mod status;
#[cfg(all(feature = "link", feature = "host"))]
mod stop;
#[cfg(all(feature = "link", feature = "host"))]
mod team;
#[cfg(all(feature = "link", feature = "host"))]
mod watch;

pub use output::{Exit, Failure, Output};

use crate::printable::{self, Layout};

/// Runs LEGO EV3 robots under ev3dev: missions, maps, and a simulated brick to try them on.
#[derive(Debug, Parser)]
#[command(name = "onbrick", version, propagate_version = true, max_term_width = 110)]
struct Arguments {
    /// Print JSON instead of text, one value a line.
    #[arg(long, global = true)]
    json: bool,
    /// Say more (-v what happens, -vv every detail).
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    verbose: u8,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    #[cfg(all(feature = "sim", feature = "host"))]
    Demo(demo::Arguments),
    #[cfg(feature = "sim")]
    Sim(sim::Arguments),
    Run(run::Arguments),
    Serve(serve::Arguments),
    Menu(menu::Arguments),
    #[cfg(all(feature = "link", feature = "host"))]
    Bricks(bricks::Arguments),
    #[cfg(all(feature = "link", feature = "host"))]
    Missions(missions::Arguments),
    #[cfg(all(feature = "link", feature = "host"))]
    Status(status::Arguments),
    #[cfg(all(feature = "link", feature = "host"))]
    Start(start::Arguments),
    #[cfg(all(feature = "link", feature = "host"))]
    Stop(stop::Arguments),
    #[cfg(all(feature = "link", feature = "host"))]
    Runs(runs::Arguments),
    #[cfg(all(feature = "link", feature = "host"))]
    Fetch(fetch::Arguments),
    #[cfg(all(feature = "link", feature = "host"))]
    Identify(identify::Arguments),
    #[cfg(all(feature = "link", feature = "host"))]
    Team(team::Arguments),
    #[cfg(feature = "link")]
    Key(key::Arguments),
    #[cfg(feature = "link")]
    Pair(pair::Arguments),
    Check(check::Arguments),
    Graph(graph::Arguments),
    New(new::Arguments),
    Setup(setup::Arguments),
    Calibrate(calibrate::Arguments),
    Doctor(doctor::Arguments),
    Devices(devices::Arguments),
    Halt(halt::Arguments),
    #[cfg(feature = "host")]
    Plot(plot::Arguments),
    #[cfg(feature = "host")]
    Export(export::Arguments),
    #[cfg(feature = "host")]
    Push(push::Arguments),
    Replay(replay::Arguments),
    #[command(hide = true)]
    Control(control::Arguments),
    #[command(hide = true)]
    Guard(guard::Arguments),
}

/// Parses the arguments, runs the one command they name, and gives its exit code.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let arguments = match Arguments::try_parse_from(arguments) {
        Ok(arguments) => arguments,
        Err(error) => {
            // `--help` and `--version` come here too; their exit code is 0, that of a wrong usage
            // 2. An argument may be a file's name that the shell found.
            let text = error.render().to_string();
            let text = output::safe(&text);
            let _ = match error.use_stderr() {
                true => std::io::stderr().write_all(text.as_bytes()),
                false => std::io::stdout().write_all(text.as_bytes()),
            };
            return ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2));
        }
    };
    let level = [log::LevelFilter::Warn, log::LevelFilter::Info, log::LevelFilter::Debug];
    // What a service does is what its log is read for.
    let more = usize::from(matches!(arguments.command, Command::Serve(_)));
    let level = level.get(usize::from(arguments.verbose) + more).copied().unwrap_or(log::LevelFilter::Trace);
    env_logger::Builder::new().filter_level(level).format(said).init();

    let mut output = Output::new(arguments.json);
    let ended = match arguments.command {
        #[cfg(all(feature = "sim", feature = "host"))]
        Command::Demo(arguments) => demo::run(&arguments, &mut output),
        #[cfg(feature = "sim")]
        Command::Sim(arguments) => sim::run(&arguments, &mut output),
        Command::Run(arguments) => run::run(&arguments, &mut output),
        Command::Serve(arguments) => serve::run(&arguments, &mut output),
        Command::Menu(arguments) => menu::run(&arguments, &mut output),
        #[cfg(all(feature = "link", feature = "host"))]
        Command::Bricks(arguments) => bricks::run(&arguments, &mut output),
        #[cfg(all(feature = "link", feature = "host"))]
        Command::Missions(arguments) => missions::run(&arguments, &mut output),
        #[cfg(all(feature = "link", feature = "host"))]
        Command::Status(arguments) => status::run(&arguments, &mut output),
        #[cfg(all(feature = "link", feature = "host"))]
        Command::Start(arguments) => start::run(&arguments, &mut output),
        #[cfg(all(feature = "link", feature = "host"))]
        Command::Stop(arguments) => stop::run(&arguments, &mut output),
        #[cfg(all(feature = "link", feature = "host"))]
        Command::Runs(arguments) => runs::run(&arguments, &mut output),
        #[cfg(all(feature = "link", feature = "host"))]
        Command::Fetch(arguments) => fetch::run(&arguments, &mut output),
        #[cfg(all(feature = "link", feature = "host"))]
        Command::Identify(arguments) => identify::run(&arguments, &mut output),
        #[cfg(all(feature = "link", feature = "host"))]
        Command::Team(arguments) => team::run(&arguments, &mut output),
        #[cfg(feature = "link")]
        Command::Key(arguments) => key::run(&arguments, &mut output),
        #[cfg(feature = "link")]
        Command::Pair(arguments) => pair::run(&arguments, &mut output),
        Command::Check(arguments) => check::run(&arguments, &mut output),
        Command::Graph(arguments) => graph::run(&arguments, &mut output),
        Command::New(arguments) => new::run(&arguments, &mut output),
        Command::Setup(arguments) => setup::run(&arguments, &mut output),
        Command::Calibrate(arguments) => calibrate::run(&arguments, &mut output),
        Command::Doctor(arguments) => doctor::run(&arguments, &mut output),
        Command::Devices(arguments) => devices::run(&arguments, &mut output),
        Command::Halt(arguments) => halt::run(&arguments, &mut output),
        #[cfg(feature = "host")]
        Command::Plot(arguments) => plot::run(&arguments, &mut output),
        #[cfg(feature = "host")]
        Command::Export(arguments) => export::run(&arguments, &mut output),
        #[cfg(feature = "host")]
        Command::Push(arguments) => push::run(&arguments, &mut output),
        Command::Replay(arguments) => replay::run(&arguments, &mut output),
        Command::Control(arguments) => control::run(&arguments, &mut output),
        Command::Guard(arguments) => guard::run(&arguments, &mut output),
    };
    match ended {
        Ok(()) => output.code(),
        Err(failure) => output.fail(&failure),
    }
}

/// The longest record of the log, characters.
const LONGEST_RECORD: usize = 20_000;

/// A record of the log as a person reads it: the same form as a failure's. Its further lines, such
/// as those of a finding, begin with a space: nothing that a text brings along looks like a record
/// of its own.
fn said(out: &mut env_logger::fmt::Formatter, record: &log::Record<'_>) -> std::io::Result<()> {
    let text = record.args().to_string();
    let prefix = match record.level() {
        log::Level::Error if !text.starts_with("error:") => "error: ",
        // Findings say "warning:" themselves.
        log::Level::Warn if !text.starts_with("warning:") => "warning: ",
        _ => "",
    };
    let text = printable::shown(text.trim_end(), Layout::Lines, LONGEST_RECORD);
    let level = journal_level(record.level());
    for (number, line) in text.lines().enumerate() {
        let (prefix, indent) = if number == 0 { (prefix, "") } else { ("", "  ") };
        writeln!(out, "{level}{prefix}{indent}{line}")?;
    }
    Ok(())
}

/// Where the journal reads, the number by which it sorts (`sd-daemon(3)`).
fn journal_level(level: log::Level) -> &'static str {
    if std::env::var_os("JOURNAL_STREAM").is_none() {
        return "";
    }
    match level {
        log::Level::Error => "<3>",
        log::Level::Warn => "<4>",
        log::Level::Info => "<6>",
        log::Level::Debug | log::Level::Trace => "<7>",
    }
}
