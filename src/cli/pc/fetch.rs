//! `onbrick fetch`: bring maps home, and watch them grow.

use std::path::{Path, PathBuf};

use super::remote::{Asking, Bricks, Unnamed, conclude, failure, named};
use super::watch::Watch;
use crate::cli::common::{bar_style, make_folder};
use crate::cli::output::safe;
use crate::cli::{Exit, Failure, Output};
use crate::link::client::{MOST_BYTES, file_so_far};
use crate::link::{Client, ClientError, FetchProgress, KnownBrick};
use crate::protocol::{RunId, RunInfo};
use crate::report::live::{Board, Sources};
use crate::units::counted;

/// Fetch recordings from bricks, byte for byte. The next call resumes a download that was cut; a
/// run in progress is followed to its end.
///
/// Examples:
///   onbrick fetch ev3-blue                 the newest run
///   onbrick fetch ev3-blue --follow        and watch the map grow in a browser
///   onbrick fetch ev3-blue --all -o maps   every run that is not in maps yet
///
/// An existing file is compared with the brick's hash; another recording is left alone.
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(in crate::cli) struct Arguments {
    #[command(flatten)]
    bricks: Bricks,
    /// This run; without it the newest.
    #[arg(long, value_name = "RUN", value_parser = RunId::new, conflicts_with = "all")]
    run: Option<RunId>,
    /// Every run on the brick.
    #[arg(long)]
    all: bool,
    /// The folder for recordings.
    #[arg(short, long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
    /// Take at most this many megabytes of a brick.
    #[arg(long, value_name = "MB", default_value_t = MOST_BYTES >> 20)]
    most_mb: u64,
    /// Show the map of a run in progress as it grows: a page for a browser on this machine, and a
    /// progress line.
    #[arg(long)]
    follow: bool,
    /// The page's port; 0 for any that is free.
    #[arg(long, value_name = "PORT", default_value_t = 0, requires = "follow")]
    page: u16,
}

/// A recording that is here.
#[derive(Debug)]
struct Brought {
    run: RunId,
    file: String,
    progress: FetchProgress,
}

impl Arguments {
    fn most_bytes(&self) -> u64 {
        self.most_mb.saturating_mul(1 << 20)
    }
}

impl Brought {
    /// Bytes that had to come.
    fn came(&self) -> u64 {
        if self.progress.was_there { 0 } else { self.progress.bytes }
    }
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let asking = arguments.bricks.asking(Unnamed::TheOnly)?;
    make_folder(Exit::Refused, &arguments.out)?;
    if arguments.follow {
        let [brick] = asking.bricks.as_slice() else {
            return Err(Failure::usage("one brick can be followed at a time"));
        };
        return follow(arguments, &asking, brick, output);
    }
    let answers = asking.ask(|client, brick| {
        let mut left = arguments.most_bytes();
        let mut brought = Vec::new();
        for run in runs(client, arguments)? {
            let one = match bring(client, &run, &arguments.out, left, &mut |_| {}) {
                // The other runs are fetched nevertheless.
                Err(error @ (ClientError::OtherRecording { .. } | ClientError::Taken { .. })) => {
                    Err(named(brick, failure(brick, &error)))
                }
                one => Ok(one?),
            };
            left = left.saturating_sub(one.as_ref().map_or(0, Brought::came));
            brought.push(one);
        }
        Ok(brought)
    });
    let mut refused = None;
    let concluded = conclude(answers, output, |output, brick, brought| {
        if brought.is_empty() {
            output.line(format!("{}: no run is there yet", brick.name));
        }
        let is_one_of_several = brought.len() > 1;
        for one in brought {
            match one {
                Ok(one) => show(brick, &one, output),
                Err(failure) => {
                    if is_one_of_several {
                        log::error!("{}", failure.message);
                    }
                    refused.get_or_insert(failure);
                }
            }
        }
    });
    concluded.and(refused.map_or(Ok(()), Err))
}

fn runs(client: &mut Client, arguments: &Arguments) -> Result<Vec<RunId>, ClientError> {
    Ok(chosen(&client.runs()?.runs, arguments))
}

/// The runs that are meant, of those on a brick.
fn chosen(there: &[RunInfo], arguments: &Arguments) -> Vec<RunId> {
    if let Some(run) = &arguments.run {
        return vec![run.clone()];
    }
    let most = if arguments.all { there.len() } else { 1 };
    there.iter().take(most).map(|info| info.run.clone()).collect()
}

fn bring(
    client: &mut Client,
    run: &RunId,
    out: &Path,
    most_bytes: u64,
    watch: &mut dyn FnMut(&FetchProgress),
) -> Result<Brought, ClientError> {
    let file = out.join(format!("{run}.mcap"));
    client.take_at_most(most_bytes);
    let progress = client.fetch(run, &file, watch)?;
    Ok(Brought { run: run.clone(), file: file.display().to_string(), progress })
}

fn show(brick: &KnownBrick, brought: &Brought, output: &mut Output) {
    let FetchProgress { bytes, was_there, .. } = brought.progress;
    let already = if was_there { " (was there already)" } else { "" };
    output.show(
        format!("{}: {}, {}{already}", brick.name, brought.file, counted(bytes, "byte")),
        &serde_json::json!({
            "brick": brick.name,
            "run": brought.run,
            "file": brought.file,
            "bytes": bytes,
            "was_there": was_there,
        }),
    );
}

/// One run with a page and a line.
fn follow(
    arguments: &Arguments,
    asking: &Asking,
    brick: &KnownBrick,
    output: &mut Output,
) -> Result<(), Failure> {
    let failed = |error: ClientError| named(brick, failure(brick, &error));
    let mut client = asking.client(brick).map_err(failed)?;
    let there = client.runs().map_err(failed)?.runs;
    let found = chosen(&there, arguments);
    let [run] = found.as_slice() else {
        return Err(Failure::refused(format!("{}: one run can be followed at a time", brick.name))
            .hint("onbrick runs, then --run RUN"));
    };
    let recording = Some(file_so_far(&arguments.out.join(format!("{run}.mcap"))));
    let title = format!("{}: {run}", brick.name);
    let board = Board::default();
    board.show(Sources { title, recording, ..Sources::default() });
    // The page lives no longer than the fetch, which for a run that is over is a moment.
    let is_over = there.iter().any(|info| info.run == *run && !info.going_on);
    let page = (!is_over).then(|| board.serve(arguments.page, &[], |_| ())).transpose()?;
    match &page {
        Some(page) => output.show(
            format!("the map is at {}", page.url()),
            &serde_json::json!({ "page": page.url() }),
        ),
        None => output.line(format!("{}: {run} is over; its map grows no more", brick.name)),
    }
    let watch = Watch::of(run);
    let brought = std::thread::scope(|scope| {
        scope.spawn(|| watch.look(asking, brick));
        let mut line = ProgressLine::new(output);
        let brought =
            bring(&mut client, run, &arguments.out, arguments.most_bytes(), &mut |progress| {
                line.show(progress, &watch.line(), output);
                if let Some(status) = watch.progress() {
                    board.hear_status(&status);
                }
            });
        line.finish();
        watch.end();
        brought
    });
    show(brick, &brought.map_err(failed)?, output);
    Ok(())
}

/// The line of progress: a bar for a person who watches, JSON for a program.
struct ProgressLine {
    bar: Option<indicatif::ProgressBar>,
}

impl ProgressLine {
    fn new(output: &Output) -> Self {
        let bar = output.is_watched().then(indicatif::ProgressBar::new_spinner);
        Self { bar: bar.map(|bar| bar.with_style(bar_style("{spinner} {msg}"))) }
    }

    fn show(&mut self, progress: &FetchProgress, how: &str, output: &mut Output) {
        let FetchProgress { bytes, total, .. } = progress;
        if let Some(bar) = &self.bar {
            bar.set_message(safe(&format!("{how}; {bytes} of {total} bytes")).into_owned());
            bar.tick();
        }
        output.value(&serde_json::json!({ "bytes": bytes, "total": total, "how": how }));
    }

    fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
