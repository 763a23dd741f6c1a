//! `onbrick stop`: whatever bricks do.

use super::remote::{Bricks, Conclusion, Unnamed};
use crate::cli::{Exit, Failure, Output};
use crate::link::KnownBrick;
use crate::protocol::{RunId, Stopped};

/// Stop what bricks do; answered when their motors have been told. Without a HOST, every brick that
/// is known.
///
/// Examples:
///   onbrick stop
///   onbrick stop ev3-blue
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(in crate::cli) struct Arguments {
    #[command(flatten)]
    bricks: Bricks,
    /// Only this run.
    #[arg(long, value_name = "RUN", value_parser = RunId::new)]
    run: Option<RunId>,
}

/// What stops a brick that does not do what it is asked for.
pub(super) const AT_THE_BRICK: &str =
    "press Enter or Back on the brick, or run `onbrick halt` there, over ssh";

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let asking = arguments.bricks.asking(Unnamed::All)?;
    let mut turning = Vec::new();
    let mut show = |output: &mut Output, brick: &KnownBrick, stopped: Stopped| {
        let text = match &stopped.run {
            Some(run) if stopped.stopped => format!("{}: stopped {run}", brick.name),
            Some(run) => {
                format!("{}: {run} was told to stop, and not every motor took it", brick.name)
            }
            None => match &stopped.other {
                Some(other) => format!("{}: stopped {other}", brick.name),
                None => format!("{}: nothing was running", brick.name),
            },
        };
        output.show(text, &serde_json::json!({ "brick": brick.name, "stopped": stopped }));
        if stopped.run.is_some() && !stopped.stopped {
            turning.push(brick.name.clone());
        }
    };
    let mut conclusion = Conclusion::of(asking.bricks.len());
    // One that is away keeps none waiting for the word that the others stand.
    asking.ask_each(
        |client, _| client.stop(arguments.run.as_ref()),
        |_, (brick, mut answer)| {
            if let Err(failure) = &mut answer {
                let first = failure.hint.take().filter(|_| failure.exit != Exit::NoAnswer);
                let ways = first.into_iter().chain([AT_THE_BRICK.to_owned()]);
                failure.hint = Some(ways.collect::<Vec<_>>().join("; "));
            }
            conclusion.take((brick, answer), output, &mut show);
        },
    );
    conclusion.end()?;
    if turning.is_empty() {
        return Ok(());
    }
    Err(Failure::failed(format!("not every motor of {} was told to stop", turning.join(", ")))
        .hint("onbrick stop once more, or Back on the brick"))
}
