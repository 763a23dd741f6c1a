//! `onbrick pair`: introduce a PC to a brick, seen from either side.

use std::path::PathBuf;
use std::time::Duration;

#[cfg(feature = "host")]
use super::key::show_known;
#[cfg(feature = "host")]
use super::pc::remote::How;
use super::terminal::{Terminal, stop_flags};
use super::{Exit, Failure, Output};
use crate::clock::{Clock as _, MILLISECOND_NS, MonotonicClock};
use crate::commissioning::Dialogue as _;
#[cfg(feature = "host")]
use crate::link::client::Silence;
#[cfg(feature = "host")]
use crate::link::pairing::{Introduced, names_a_port};
#[cfg(feature = "host")]
use crate::link::{ClientError, KnownBrick, KnownBricks};
#[cfg(feature = "host")]
use crate::protocol::{Kind, Name};
use crate::protocol::{LocalOnly, Pairing};
use crate::service::client::{Client, ClientError as LocalError};
use crate::service::config::BRICK_FOLDER;

/// Introduce this PC to a brick: both show a code, and you say on both whether it is the same.
///
/// Examples:
///   onbrick pair ev3-blue.local            on the PC
///   onbrick pair 10.0.0.7:6001 --port 6000       where the brick's onbrick.toml has them as
///                                          `pairing_port` and `port`
///   onbrick pair                           on the brick, if no menu can open the window
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Arguments {
    /// The brick's address, and after a colon its `pairing_port`, where that is not 5671; without
    /// HOST, this is the brick, and its pairing window is opened.
    #[cfg(feature = "host")]
    #[arg(value_name = "HOST[:PAIRING_PORT]")]
    host: Option<String>,
    /// On the brick: the folder of onbrick.toml.
    #[arg(long, value_name = "DIR", default_value = BRICK_FOLDER)]
    config: PathBuf,
    /// On the brick: how long the window is open, seconds.
    #[arg(long, value_name = "SECONDS", default_value_t = 120)]
    window: u32,
    /// On the PC: what it calls itself; without it, its host name.
    #[cfg(feature = "host")]
    #[arg(long)]
    name: Option<Name>,
    /// On the PC: the brick's `port`, which all other commands use, where that is not 5670.
    #[cfg(feature = "host")]
    #[arg(long)]
    port: Option<u16>,
    /// Answers from a file instead of the keyboard, for scripts.
    #[arg(long, value_name = "FILE")]
    answers: Option<PathBuf>,
    #[cfg(feature = "host")]
    #[command(flatten)]
    how: How,
}

/// How often the window is looked at, nanoseconds.
const LOOK_NS: i64 = 300 * MILLISECOND_NS;

/// How long the service may take.
const LOCAL: Duration = Duration::from_secs(3);

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    #[cfg(feature = "host")]
    if let Some(host) = &arguments.host {
        return introduce(arguments, host, output);
    }
    here(arguments, output)
}

/// The PC's side.
#[cfg(feature = "host")]
fn introduce(arguments: &Arguments, host: &str, output: &mut Output) -> Result<(), Failure> {
    let own = arguments.how.folder.own()?;
    let folder = arguments.how.folder.path()?;
    let mut known = KnownBricks::load(&folder)?;
    let flags = stop_flags()?;
    let mut terminal = Terminal::open(arguments.answers.as_deref(), &flags)?;
    let name = arguments.name.clone().unwrap_or_else(Name::of_this_machine);
    let patience = arguments.how.patience(&flags.signal);
    // The brick that keeps its name and its key, because the person would rather.
    let mut kept = None;
    let mut is_same = |brick: &Introduced, code: &str| {
        show_code(
            &mut terminal,
            code,
            &format!("what answers at {host} calls itself {}", brick.name),
        );
        if !confirmed(&mut terminal, "does the brick show the same code?") {
            return false;
        }
        let Some(other) = known.another(&brick.name, &brick.key) else { return true };
        terminal.say(&format!(
            "{} is known already, at {}, with another key: {}\n\
             this one has the key {}: it was set up again, or it is \
             another brick of this name",
            other.name,
            other.address,
            other.key.fingerprint(),
            brick.key.fingerprint()
        ));
        let replaces = confirmed(
            &mut terminal,
            "forget the one that is known, and know this one in its place?",
        );
        kept = (!replaces).then(|| other.clone());
        replaces
    };
    let introduced = crate::link::pairing::pair(host, &own, &name, patience, &mut is_same)
        .map_err(|error| kept.as_ref().map_or_else(|| not_introduced(host, &error), stays))?;
    let brick = introduced.keep(&mut known, host, arguments.port)?;
    if arguments.port.is_none() && names_a_port(host) {
        log::warn!(
            "the port in {host} was for pairing only; all other commands ask {} at port 5670: if \
             its onbrick.toml has another `port`, pair once more with --port",
            brick.name
        );
    }
    show_known("paired", &brick, &known, output);
    Ok(())
}

/// A brick of a known name was not to take the place of the one that is known.
#[cfg(feature = "host")]
fn stays(known: &KnownBrick) -> Failure {
    let message = format!("{} stays as it was known: {}", known.name, known.key.fingerprint());
    Failure::refused(message).hint(
        "give one of the two another name: `name` in its onbrick.toml, then `onbrick pair` \
         once more",
    )
}

#[cfg(feature = "host")]
fn not_introduced(host: &str, error: &ClientError) -> Failure {
    let exit = match error {
        ClientError::NoAnswer { .. } => Exit::NoAnswer,
        ClientError::Refused(_) | ClientError::NotAuthorised { .. } => Exit::Refused,
        _ => Exit::Failed,
    };
    let hint = match error {
        ClientError::Refused(refusal) if refusal.kind == Kind::NotAuthorised => {
            "the same once more; where the codes differ again, another machine answers in the \
             brick's place: pair over a cable, or in another network"
                .to_owned()
        }
        ClientError::NoAnswer { silence: Silence::NoSuchName, .. } => {
            "the brick's address, which its menu shows".to_owned()
        }
        _ if names_a_port(host) => format!(
            "is the port in {host} the brick's `pairing_port`, and not its `port`? Open the \
             pairing window first: in its menu, or `onbrick pair` there"
        ),
        _ => "open the pairing window on the brick first: in its menu, or `onbrick pair` there; \
              HOST:PORT, if its onbrick.toml has another `pairing_port` than 5671"
            .to_owned(),
    };
    Failure::from_error(exit, &format!("{host} was not introduced"), error).hint(hint)
}

/// The brick's side, for a brick whose menu is not at hand.
fn here(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let config =
        super::serve::load_config(&arguments.config, arguments.config.as_os_str() != BRICK_FOLDER)?;
    let flags = stop_flags()?;
    let mut terminal = Terminal::open(arguments.answers.as_deref(), &flags)?;
    let mut service = Client::at(&config.socket.path);
    let mut ask =
        |what: &LocalOnly| service.ask::<Pairing>(what, LOCAL).map_err(|error| no_service(&error));
    let mut shown = ask(&LocalOnly::PairingWindow { seconds: arguments.window })?;
    let mut answered = false;
    terminal.say(&format!(
        "the pairing window is open for {} s; now `onbrick pair HOST` on the PC",
        arguments.window
    ));
    loop {
        match shown {
            Pairing::Paired { name } => {
                output.show(
                    format!("{name} may ask from now on"),
                    &serde_json::json!({ "paired": name }),
                );
                return Ok(());
            }
            Pairing::Closed => {
                return Err(Failure::new(Exit::NoAnswer, "no PC paired before the window closed"));
            }
            Pairing::Failed { why } => return Err(Failure::refused(why)),
            Pairing::NoLink { why } => {
                return Err(Failure::refused(format!("no PC can pair: {why}")));
            }
            Pairing::Compare { code, name } if !answered => {
                show_code(
                    &mut terminal,
                    &code,
                    &format!("what asks to be let in calls itself {name}"),
                );
                let same = confirmed(&mut terminal, "does the PC show the same code?");
                answered = true;
                shown = ask(&LocalOnly::PairingAnswer { same })?;
            }
            Pairing::Compare { .. } | Pairing::Open { .. } => {
                if flags.signal.load(std::sync::atomic::Ordering::Relaxed) {
                    ask(&LocalOnly::PairingWindow { seconds: 0 })?;
                    return Err(Failure::failed("interrupted"));
                }
                MonotonicClock.sleep_ns(LOOK_NS);
                shown = ask(&LocalOnly::PairingState)?;
            }
        }
    }
}

/// The code stands alone in its line, and before any word of the other side's: nothing that it says
/// can stand for a code, or hide this one.
fn show_code(terminal: &mut Terminal, code: &str, who: &str) {
    terminal.say("the code is");
    terminal.say(&format!("  {code}"));
    terminal.say(who);
}

/// Enter alone is no answer: the codes have not been compared.
fn confirmed(terminal: &mut Terminal, question: &str) -> bool {
    terminal.choose(question, &["yes", "no"], 1).is_ok_and(|choice| choice == 0)
}

fn no_service(error: &LocalError) -> Failure {
    let exit = match error {
        LocalError::Refused(_) => Exit::Refused,
        _ => Exit::NoAnswer,
    };
    Failure::from_error(exit, "the service on this machine", error).hint(
        "is `onbrick serve` running here? --config with its folder; on a PC, name the brick: \
         onbrick pair HOST",
    )
}
