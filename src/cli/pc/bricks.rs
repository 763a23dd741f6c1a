//! `onbrick bricks`: who is known, who is there, and who makes itself known.

use super::remote::{Bricks, PATIENCES_S, Unnamed};
use crate::cli::common::number_within;
use crate::cli::{Context, Exit, Failure, Output};
use crate::link::KnownBricks;
use crate::link::client::PORT;
use crate::link::discover::{Announced, discover};
use crate::link::pairing::pair_command;

/// List the bricks that this PC knows, and whether they answer; or those that announce themselves
/// in this network.
///
/// Examples:
///   onbrick bricks
///   onbrick bricks --timeout 2 --json
///   onbrick bricks --discover              also unknown ones, where the network carries mDNS
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(in crate::cli) struct Arguments {
    #[command(flatten)]
    bricks: Bricks,
    /// Listen for bricks that announce themselves (mDNS); many networks do not carry that.
    #[arg(long, conflicts_with_all = ["hosts", "team"])]
    discover: bool,
    /// How long to listen, in seconds.
    #[arg(
        long,
        default_value_t = 3.0,
        value_parser = number_within(PATIENCES_S),
        value_name = "SECONDS",
        requires = "discover",
    )]
    listen: f64,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    if arguments.discover {
        return heard(arguments, output);
    }
    let asking = arguments.bricks.listing(Unnamed::All)?;
    // A brick that does not answer is no failure here: that is what is asked for.
    for (brick, answer) in asking.ask(|client, _| client.status()) {
        let (how, state) = match answer {
            Ok(status) => (status.state.to_string(), Some(status.state)),
            Err(failure) => (failure.message, None),
        };
        let fingerprint = brick.key.fingerprint();
        output.show(
            format!("{}  {}  {fingerprint}  {how}", brick.name, brick.address),
            &serde_json::json!({
                "brick": brick.name,
                "address": brick.address,
                "fingerprint": fingerprint,
                "state": state,
                "said": how,
            }),
        );
    }
    Ok(())
}

/// What is announced, and whether it is known here. An announcement has no key, so it is matched by
/// name and address alone.
fn heard(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let folder = arguments.bricks.how.folder.path()?;
    let known = KnownBricks::load(&folder)?;
    let interrupted = crate::cli::terminal::stop_flags()?.signal;
    let heard = discover(arguments.listen, &interrupted).context(Exit::Failed, "no discovery")?;
    if heard.is_empty() {
        output.line("no brick announced itself; a name or an address still finds one");
    }
    for brick in &heard {
        let numbers = brick.addresses.iter().map(ToString::to_string).collect::<Vec<_>>();
        let address = address(brick);
        let of_it = |part: &str| known.find(part).is_some();
        let is_known =
            of_it(&brick.name) || of_it(&address) || numbers.iter().any(|number| of_it(number));
        let way_in = if is_known { "known".to_owned() } else { pair_command(&address) };
        output.show(
            format!("{}  {address}  {}  {way_in}", brick.name, numbers.join(" ")),
            &serde_json::json!({
                "brick": brick.name,
                "address": address,
                "numbers": numbers,
                "known": is_known,
            }),
        );
    }
    Ok(())
}

/// As it is typed.
fn address(brick: &Announced) -> String {
    match brick.port {
        PORT => brick.host.clone(),
        port => format!("{}:{port}", brick.host),
    }
}
