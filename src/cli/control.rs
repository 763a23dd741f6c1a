//! `onbrick control`: the process that drives. Hidden: the guard starts it.

use super::common::environment;
use super::{Failure, Output};

/// Drive: started by the guard of a run, never by hand.
#[derive(Debug, clap::Args)]
pub(super) struct Arguments {}

pub(super) fn run(_arguments: &Arguments, _output: &mut Output) -> Result<(), Failure> {
    Ok(crate::runtime::control(environment)?)
}
