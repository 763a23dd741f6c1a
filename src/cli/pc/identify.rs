//! `onbrick identify`: which of the bricks on the table is it?

use super::remote::{Bricks, Unnamed, conclude};
use crate::cli::{Failure, Output};

/// Make a brick beep and blink, so that you see which one it is.
///
/// Examples:
///   onbrick identify ev3-blue
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(in crate::cli) struct Arguments {
    #[command(flatten)]
    bricks: Bricks,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let asking = arguments.bricks.asking(Unnamed::TheOnly)?;
    let answers = asking.ask(|client, _| client.identify());
    conclude(answers, output, |output, brick, _| {
        output.show(
            format!("{} beeps and blinks", brick.name),
            &serde_json::json!({ "brick": brick.name, "identified": true }),
        );
    })
}
