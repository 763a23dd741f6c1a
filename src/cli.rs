//! The command line: one file a command, and the only place that prints.
//!
//! A command takes its arguments and an [`Output`] and says how it ended: `Ok`, or a [`Failure`]
//! with an exit code, a message that names the place, and a way out.
//!
//! | exit code | means |
//! |---|---|
//! | 0 | done |
//! | 1 | failed |
//! | 2 | wrong usage |
//! | 3 | refused: a check failed before anything moved |
//! | 4 | no answer in time |
//! | 5 | some bricks failed |
//! | 6 | a run was stopped before its end; by Ctrl-C, the signal itself |

use std::ffi::OsString;
use std::io::Write as _;
use std::process::ExitCode;

use clap::error::{ContextKind, ContextValue};
use clap::{CommandFactory as _, FromArgMatches as _, Parser};

mod brick;
mod calibrate;
mod check;
mod common;
mod control;
mod devices;
mod doctor;
mod folder;
mod graph;
mod guard;
mod halt;
mod happenings;
mod menu;
mod new;
mod output;
mod run;
mod serve;
mod setup;
mod terminal;

mod replay;

#[cfg(feature = "link")]
mod key;
#[cfg(feature = "link")]
mod pair;
#[cfg(feature = "host")]
mod pc;
#[cfg(feature = "sim")]
mod sim;

use output::{Context, Hint};
pub use output::{Exit, Failure, Output};

use crate::document::nearest;
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

/// The commands of a program, each with its file's `Arguments` and `run`.
macro_rules! commands {
    ($see:vis enum $command:ident {
        $($(#[cfg($when:meta)])? $(#[command($how:meta)])? $name:ident($module:ident),)*
    }) => {
        #[derive(Debug, clap::Subcommand)]
        $see enum $command {
            $($(#[cfg($when)])? $(#[command($how)])? $name($module::Arguments),)*
        }

        impl $command {
            $see fn run(
                &self,
                output: &mut $crate::cli::Output,
            ) -> Result<(), $crate::cli::Failure> {
                match self {
                    $($(#[cfg($when)])? Self::$name(arguments) => $module::run(arguments, output),)*
                }
            }
        }
    };
}
#[cfg(feature = "host")]
use commands;

commands! {
    enum Command {
        #[cfg(feature = "sim")]
        Sim(sim),
        Run(run),
        Serve(serve),
        Menu(menu),
        #[cfg(feature = "host")]
        #[command(flatten)]
        Pc(pc),
        #[cfg(feature = "link")]
        Key(key),
        #[cfg(feature = "link")]
        Pair(pair),
        Check(check),
        Graph(graph),
        New(new),
        Setup(setup),
        Calibrate(calibrate),
        Doctor(doctor),
        Devices(devices),
        Halt(halt),
        Replay(replay),
        #[command(hide = true)]
        Control(control),
        #[command(hide = true)]
        Guard(guard),
    }
}

/// Parses the arguments, runs the one command they name, and gives its exit code.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let arguments: Vec<OsString> = with_whole_numbers(arguments).collect();
    let parsed = described().try_get_matches_from(&arguments);
    let arguments = match parsed.and_then(|matches| Arguments::from_arg_matches(&matches)) {
        Ok(arguments) => arguments,
        Err(mut error) => {
            keep_near_tips(&mut error);
            // `--help` and `--version` come here too; their exit code is 0, that of a wrong usage
            // 2. An argument may be a file's name that the shell found.
            let text = error.render().to_string();
            // clap's error does not say whether `--json` was parsed.
            let mut ours = arguments.iter().take_while(|argument| *argument != "--");
            if error.use_stderr() && ours.any(|argument| argument == "--json") {
                let message = match error.kind() {
                    // It shows the help for people instead.
                    clap::error::ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
                        "what to do is missing"
                    }
                    _ => text.strip_prefix("error: ").unwrap_or(&text).trim_end(),
                };
                return Output::new(true).fail(&Failure::usage(message));
            }
            let text = output::safe(&text);
            if error.use_stderr() {
                let _ = std::io::stderr().write_all(text.as_bytes());
                return ExitCode::from(Exit::Usage as u8);
            }
            let mut output = Output::new(false);
            output.bytes(text.as_bytes());
            return output.conclude(Ok(()));
        }
    };
    let level = [log::LevelFilter::Warn, log::LevelFilter::Info, log::LevelFilter::Debug];
    // What a service does is what its log is read for.
    let more = usize::from(matches!(arguments.command, Command::Serve(_)));
    let level = level
        .get(usize::from(arguments.verbose) + more)
        .copied()
        .unwrap_or(log::LevelFilter::Trace);
    env_logger::Builder::new().filter_level(level).format(said).init();

    let mut output = Output::new(arguments.json);
    let ended = arguments.command.run(&mut output);
    let is_cut_short = ended.is_err() || output.was_stopped();
    let code = output.conclude(ended);
    if is_cut_short {
        terminal::die_of_interrupt();
    }
    code
}

/// The command line. What a command is for is one paragraph in a list: its lines in the source are
/// not those of the terminal. A number below zero is an option's value: its limits refuse it, not
/// clap as an unknown argument.
fn described() -> clap::Command {
    fn flowing(command: clap::Command) -> clap::Command {
        let about = command.get_about().map(|about| about.to_string().replace('\n', " "));
        let command = command.about(about.unwrap_or_default()).mut_args(|argument| {
            let has_value = argument.get_action().takes_values() && !argument.is_positional();
            if has_value { argument.allow_negative_numbers(true) } else { argument }
        });
        command.mut_subcommands(flowing)
    }
    Arguments::command().mut_subcommands(flowing)
}

/// The arguments, `-.5` among them as `-0.5`: clap takes the first for an option. What follows `--`
/// is another program's.
fn with_whole_numbers(
    arguments: impl IntoIterator<Item = OsString>,
) -> impl Iterator<Item = OsString> {
    let mut is_ours = true;
    arguments.into_iter().map(move |argument| {
        is_ours &= argument != "--";
        let digits = argument.to_str().and_then(|text| text.strip_prefix("-."));
        match digits.filter(|digits| is_ours && digits.starts_with(|at: char| at.is_ascii_digit()))
        {
            Some(digits) => format!("-0.{digits}").into(),
            None => argument,
        }
    })
}

/// Takes out clap's tip, and the usage that is made of it, where the option that it names has
/// little to do with the one that was given.
fn keep_near_tips(error: &mut clap::Error) {
    let (given, tip) = (ContextKind::InvalidArg, ContextKind::SuggestedArg);
    let is_near = match (error.get(given), error.get(tip)) {
        (Some(ContextValue::String(given)), Some(ContextValue::String(tip))) => {
            nearest(given.trim_start_matches('-'), [tip.trim_start_matches('-')]).is_some()
        }
        _ => true,
    };
    if !is_near {
        error.remove(tip);
        error.remove(ContextKind::Usage);
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
