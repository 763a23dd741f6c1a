//! The runs of a team: started at the same time, followed and brought home, each in a thread of its
//! own.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use super::super::remote::failure;
use super::super::watch::{Began, Watch};
use super::Plan;
use crate::cli::common::bar_style;
use crate::cli::output::safe;
use crate::cli::{Failure, Output};
use crate::clock::{Clock as _, MILLISECOND_NS, MonotonicClock, SECOND_NS, wall_ns};
use crate::link::client::{new_run_id, part_of};
use crate::link::team::Member;
use crate::link::{Client, ClientError, KnownBrick};
use crate::protocol::{Kind, LastStop, Refusal, RunId};

/// How often bars and signals are looked at, and how often a program is told how it goes,
/// nanoseconds.
const LOOK_NS: i64 = 100 * MILLISECOND_NS;
const TOLD_NS: i64 = SECOND_NS;

/// What came of one brick.
#[derive(Debug)]
pub(super) struct Came {
    pub(super) brick: KnownBrick,
    pub(super) run: RunId,
    /// The recording, or what has come of it.
    pub(super) file: Option<PathBuf>,
    /// All of it is here, byte for byte.
    pub(super) whole: bool,
    /// How the run ended, where the brick could say it.
    pub(super) end: Option<LastStop>,
    /// When it began to drive, by this PC's calendar; otherwise when it was started.
    pub(super) began: Option<Began>,
    /// Why it did not come to its end.
    pub(super) failure: Option<Failure>,
    /// The brick did not take the start.
    pub(super) refused: bool,
    /// It was not told to stop though all were to: it may still be driving.
    pub(super) adrift: bool,
}

/// Who wants it to end.
#[derive(Debug, Default)]
struct Halt {
    /// All are to be stopped, and what they have is to be brought home.
    stop: Arc<AtomicBool>,
    /// Raised at the second Ctrl-C: stop waiting for that, too.
    enough: Arc<AtomicBool>,
    /// How many bricks are still followed.
    followed: AtomicUsize,
}

impl Halt {
    /// Ctrl-C: the first stops the bricks, the second ends the waiting.
    fn hear(&self) {
        let was_raised = self.stop.swap(true, Ordering::Relaxed);
        self.enough.fetch_or(was_raised, Ordering::Relaxed);
        log::warn!(
            "{}",
            if was_raised { "not waiting any longer" } else { "stopping every brick" }
        );
    }
}

/// One brick's share of the work.
#[derive(Debug)]
struct Share<'p> {
    plan: &'p Plan<'p>,
    halt: &'p Halt,
    member: &'p Member,
    watch: Watch,
}

/// Starts all, follows them to their ends, and says what came of each, in the order of the file.
pub(super) fn all(plan: &Plan<'_>, output: &mut Output) -> Result<Vec<Came>, Failure> {
    let followed = AtomicUsize::new(plan.team.members.len());
    let halt = &Halt { followed, ..Halt::default() };
    // The bricks' recordings come to lie in one folder.
    let id =
        |member: &Member| new_run_id(&format!("{:.9}-{}", plan.wanted.name, member.brick.name));
    let runs: Result<Vec<RunId>, Refusal> = plan.team.members.iter().map(id).collect();
    let runs = runs.map_err(|error| Failure::failed(error.to_string()))?;
    let members = plan.team.members.iter().zip(&runs);
    let shares: Vec<Share<'_>> =
        members.map(|(member, run)| Share { plan, halt, member, watch: Watch::of(run) }).collect();
    std::thread::scope(|scope| {
        let threads: Vec<_> = shares.iter().map(|share| scope.spawn(|| share.play())).collect();
        let mut shown = Shown::new(&shares, output);
        while !threads.iter().all(|thread| thread.is_finished()) {
            if plan.asking.interrupted().swap(false, Ordering::Relaxed) {
                halt.hear();
            }
            shown.show(&shares, output);
            MonotonicClock.sleep_ns(LOOK_NS);
        }
        shown.finish();
        let lost = |_| Failure::failed("the thread that followed a brick has died");
        let came = threads.into_iter().map(|thread| thread.join().map_err(lost));
        let mut came = came.collect::<Result<Vec<Came>, Failure>>()?;
        let are_to_stop = halt.stop.load(Ordering::Relaxed);
        came.iter_mut().for_each(|one| one.note_stop(are_to_stop));
        Ok(came)
    })
}

impl Came {
    /// Says where a brick was not told to stop though all were to: also one that was given up
    /// before that.
    fn note_stop(&mut self, are_to_stop: bool) {
        self.adrift &= are_to_stop;
        match &mut self.failure {
            Some(failure) if self.adrift => {
                failure.message.push_str("; it was not stopped, and may still be driving");
            }
            _ => self.adrift = false,
        }
    }
}

impl Share<'_> {
    fn play(&self) -> Came {
        let mut came = self.follow();
        self.halt.followed.fetch_sub(1, Ordering::Relaxed);
        if came.adrift && came.failure.is_some() {
            self.stop_with_the_others(&mut came);
        }
        came
    }

    fn follow(&self) -> Came {
        let Self { plan, halt, member, .. } = self;
        let brick = &member.brick;
        let mut came = Came {
            brick: brick.clone(),
            run: self.watch.run.clone(),
            file: None,
            whole: false,
            end: None,
            began: None,
            failure: None,
            refused: false,
            adrift: false,
        };
        match self.start() {
            Ok(()) => came.began = Some(Began { at_ns: wall_ns(), within_ns: i64::MAX }),
            // The run may have started nevertheless.
            Err(ClientError::Interrupted | ClientError::NoAnswer { .. }) => {}
            Err(error) => {
                came.failure = Some(failure(brick, &error));
                came.refused = true;
                // One that does not take what was checked: none of them is to drive off without it.
                halt.stop.store(true, Ordering::Relaxed);
                return came;
            }
        }
        came.adrift = true;
        // Who only looks says soon that a brick does not answer; who fetches does not give it up so
        // soon.
        let asking = plan.asking.until(&halt.stop, 0.0);
        let following = plan.asking.until(&halt.stop, plan.lost_s);
        let brought = std::thread::scope(|scope| {
            scope.spawn(|| self.watch.look(&asking, brick));
            let brought = following
                .client(brick)
                .and_then(|mut client| self.bring(&mut client, &mut came.adrift));
            self.watch.end();
            brought
        });
        came.began = self.watch.began().or(came.began);
        self.note(&mut came, brought);
        came
    }

    fn start(&self) -> Result<(), ClientError> {
        let Self { plan, halt, member, watch } = self;
        let mut client = plan.asking.until(&halt.stop, 0.0).client(&member.brick)?;
        let (run, chosen) = (watch.run.clone(), plan.wanted.chosen.clone());
        client.start_as(run, chosen, Some(member.pose), plan.set).map(|_| ())
    }

    fn file(&self) -> PathBuf {
        self.plan.out.join(format!("{}.mcap", self.watch.run))
    }

    /// A brick that was given up may be in reach again by the time that all are to stop.
    fn stop_with_the_others(&self, came: &mut Came) {
        let Self { halt, .. } = self;
        let was_told = halt.stop.load(Ordering::Relaxed);
        while !halt.stop.load(Ordering::Relaxed) && halt.followed.load(Ordering::Relaxed) > 0 {
            MonotonicClock.sleep_ns(LOOK_NS);
        }
        if !was_told && halt.stop.load(Ordering::Relaxed) {
            // That it was given up has been said; a stop that does not reach it is said at the end.
            let _ = self.last().and_then(|mut client| self.stop(&mut client, &mut came.adrift));
        }
    }

    /// Follows the recording to its end; where all are to stop, stops the run and brings home what
    /// there is. `adrift` is false once the brick has taken the stop.
    fn bring(&self, client: &mut Client, adrift: &mut bool) -> Result<(), ClientError> {
        let (run, file) = (&self.watch.run, self.file());
        let fetched = client.fetch(run, &file, &mut |_| {});
        if !matches!(fetched, Err(ClientError::Interrupted)) {
            return fetched.map(|_| ());
        }
        let mut client = self.last()?;
        self.stop(&mut client, adrift)?;
        client.fetch(run, &file, &mut |_| {}).map(|_| ())
    }

    fn stop(&self, client: &mut Client, adrift: &mut bool) -> Result<(), ClientError> {
        match client.stop(Some(&self.watch.run)) {
            Ok(stopped) if stopped.stopped => *adrift = false,
            Ok(_) => log::warn!("{}: not every motor was told to stop", self.member.brick.name),
            Err(ClientError::Refused(refusal)) if refusal.kind != Kind::UnknownRun => {
                log::warn!("{}: {refusal}", self.member.brick.name);
            }
            Err(error) => return Err(error),
        }
        Ok(())
    }

    /// A client for the end, which only a second Ctrl-C interrupts.
    fn last(&self) -> Result<Client, ClientError> {
        self.plan.asking.until(&self.halt.enough, 0.0).client(&self.member.brick)
    }

    /// What came of it, and what the brick says of its end.
    fn note(&self, came: &mut Came, brought: Result<(), ClientError>) {
        let run = &self.watch.run;
        let there = |file: PathBuf| Some(file).filter(|file| file.exists());
        match brought {
            Ok(()) => {
                (came.file, came.whole) = (there(self.file()), true);
                let runs = self.last().and_then(|mut client| client.runs());
                let info =
                    runs.ok().and_then(|runs| runs.runs.into_iter().find(|info| info.run == *run));
                came.end = info.and_then(|info| info.end);
            }
            Err(ClientError::Refused(refusal)) if refusal.kind == Kind::UnknownRun => {
                // It was not started, or did not get as far as driving.
                let status = self.last().and_then(|mut client| client.status());
                let last = status.ok().and_then(|status| status.last);
                came.end = last.filter(|last| last.run.as_ref() == Some(run));
                let why = came
                    .end
                    .as_ref()
                    .map_or_else(|| "it was not started".to_owned(), LastStop::to_string);
                (came.failure, came.adrift) = (Some(Failure::failed(why)), false);
            }
            Err(error) => {
                came.file = there(part_of(&self.file()));
                came.failure = Some(failure(&self.member.brick, &error));
            }
        }
    }
}

/// How it goes: a bar a brick for a person who watches, JSON for a program.
struct Shown {
    bars: Vec<indicatif::ProgressBar>,
    told_ns: i64,
}

impl Shown {
    fn new(shares: &[Share<'_>], output: &Output) -> Self {
        let names = shares.iter().map(|share| share.member.brick.name.chars().count());
        let width = names.max().unwrap_or(0);
        let style = bar_style(&format!("{{prefix:{width}}} {{bar:24}} {{msg}}"));
        let all = indicatif::MultiProgress::new();
        let bar = |share: &Share<'_>| {
            let bar = all.add(indicatif::ProgressBar::new(1000)).with_style(style.clone());
            bar.with_prefix(safe(&share.member.brick.name).into_owned())
        };
        let bars = if output.is_watched() { shares.iter().map(bar).collect() } else { Vec::new() };
        Self { bars, told_ns: MonotonicClock.now_ns() }
    }

    fn show(&mut self, shares: &[Share<'_>], output: &mut Output) {
        for (bar, share) in self.bars.iter().zip(shares) {
            bar.set_position(share.watch.thousandths());
            bar.set_message(safe(&share.watch.line()).into_owned());
        }
        if !output.is_json() || MonotonicClock.now_ns() < self.told_ns {
            return;
        }
        self.told_ns = MonotonicClock.now_ns() + TOLD_NS;
        for share in shares {
            output.value(&serde_json::json!({
                "brick": share.member.brick.name,
                "run": share.watch.run,
                "how": share.watch.line(),
            }));
        }
    }

    fn finish(&self) {
        self.bars.iter().for_each(indicatif::ProgressBar::finish_and_clear);
    }
}
