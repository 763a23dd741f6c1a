//! `onbrick repair`: what is whole of recordings, as a file with a summary.

use std::path::PathBuf;

use crate::cli::common::{must_be_new, open_run, read_file, write_file};
use crate::cli::{Context, Exit, Failure, Output};
use crate::report::export::{self, NamedRecording};
use crate::units::counted;

/// Make a whole file of a recording that was cut or damaged: all of it that is whole, in the order
/// of time, with the summary that viewers seek by. A run that ended normally needs no repair.
///
/// Several recordings become one, with a namespace for each brick.
///
/// Examples:
///   onbrick repair run.mcap                         writes run.repaired.mcap
///   onbrick repair left.mcap right.mcap --out both.mcap
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(in crate::cli) struct Arguments {
    /// Recordings.
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// The file to write [default: beside a single recording].
    #[arg(long)]
    out: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let out = match (&arguments.out, &*arguments.runs) {
        (Some(out), _) => out.clone(),
        (None, [single]) => single.with_extension("repaired.mcap"),
        (None, _) => {
            return Err(Failure::usage("several recordings become one file: which?")
                .hint("--out both.mcap"));
        }
    };
    must_be_new(&out)?;
    let read = |path: &PathBuf| {
        let loaded = open_run(path)?;
        Ok((loaded, read_file(path)?))
    };
    let runs = arguments.runs.iter().map(read).collect::<Result<Vec<_>, Failure>>()?;
    let parts: Vec<NamedRecording<'_>> = runs
        .iter()
        .map(|(loaded, bytes)| NamedRecording { name: loaded.brick(), bytes, shift_ns: 0 })
        .collect();
    let whole = export::mcap(&parts).context(Exit::Failed, "cannot repair")?;
    let messages: u64 = runs.iter().map(|(loaded, _)| loaded.run.integrity.messages).sum();
    if messages == 0 {
        return Err(Failure::refused("nothing is left that a repair could keep"));
    }
    write_file(&out, &whole)?;
    let lost = runs.iter().flat_map(|(loaded, _)| &loaded.run.warnings).collect::<Vec<_>>();
    let told = serde_json::json!({ "wrote": out, "messages": messages, "warnings": lost });
    output.show(format!("wrote {}: {}", out.display(), counted(messages, "message")), &told);
    Ok(())
}
