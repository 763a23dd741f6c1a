//! `onbrick bricks`: who is known, and who is there.

use super::remote::{Bricks, Unnamed};
use super::status::word;
use super::{Failure, Output};

/// List the bricks that this PC knows, and whether they answer.
///
/// Examples:
///   onbrick bricks
///   onbrick bricks --timeout 2 --json
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Arguments {
    #[command(flatten)]
    bricks: Bricks,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let asking = arguments.bricks.asking(Unnamed::All)?;
    // A brick that does not answer is no failure here: that is what is asked for.
    for (brick, answer) in asking.ask(|client, _| client.status()) {
        let (how, state) = match answer {
            Ok(status) => (word(status.state).to_owned(), Some(status.state)),
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
