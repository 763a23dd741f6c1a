//! `onbrick guard`: the process that guards a run. Hidden: `run` starts it.

use super::{Failure, Output};

/// Guard a run: started by `onbrick run`, never by hand.
#[derive(Debug, clap::Args)]
pub(super) struct Arguments {}

pub(super) fn run(_arguments: &Arguments, _output: &mut Output) -> Result<(), Failure> {
    Ok(crate::runtime::guard()?)
}
