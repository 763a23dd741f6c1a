//! `onbrick run --page`: the run in a browser on this machine, and a person's hands on a simulated
//! brick.
//!
//! A simulated run is done in this process, in virtual time with a pace, so that the page can look
//! into the simulation and steer it; what is recorded is the same as without the page until a
//! person does something there. A brick's run is a process of its own, as ever: the page shows its
//! recording, and can ask it to stop as Ctrl-C does.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, mpsc};

use super::super::common::Progress;
use super::super::folder::next_to;
use super::super::terminal::stop_flags;
use super::super::{Exit, Failure, Output};
use super::{Arguments, Happenings, Prepared, conclude, follow, prepare, start};
use crate::behavior::Mission;
use crate::clock::{Clock, MILLISECOND_NS, MonotonicClock, PacedClock};
use crate::ev3dev::{Access, Tree};
use crate::menu::{Canvas, ended_picture, running_picture};
use crate::protocol::{LastStop, RunId, RunStatus};
use crate::report::live::{Board, Sources, Wish};
use crate::runtime::{
    Brick, Ended, Event, Job, NoHeartbeat, StopBy, StopFlags, StopReason, Stopper, execute,
};
use crate::sim::Simulation;
use crate::simulated::{Simulated, simulated_at};
use crate::threads::lock;

/// How often it is looked whether the page is done with, nanoseconds.
const LOOK_NS: i64 = 50 * MILLISECOND_NS;

/// Runs the mission with a page, again and again where a person wants it, until Ctrl-C.
pub(super) fn run(port: u16, arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let hand = Hand::new()?;
    let board = Board::default();
    let next = prepare(arguments, arguments.out.as_deref(), output)?;
    let granted: &[Wish] = match next.job.brick {
        Brick::Simulated { .. } => &[Wish::Stop, Wish::Again],
        Brick::Local(_) => &[Wish::Stop],
    };
    let grant = hand.clone();
    let page = board.serve(port, granted, move |wish| grant.grant(wish)).map_err(|error| {
        next.folder.take_back();
        Failure::from(error)
    })?;
    let url = page.url();
    output.show(
        format!("the run is at {url}; Ctrl-C ends run and page"),
        &serde_json::json!({ "page": url }),
    );
    let mut result = shown(next, arguments, &board, &hand, output);
    if matches!(&result, Err(failure) if failure.exit == Exit::Refused) {
        // One that was stopped at the page while it got ready can be started again there.
        if !hand.was_used() {
            return result;
        }
        tell(&result, &board);
    }
    if !hand.is_over() && !hand.is_wanted() {
        output.line(format!("the page stays at {url} until Ctrl-C"));
    }
    while hand.wait() {
        // The files are read again: they may have been changed since.
        let out = arguments.out.as_deref().map(next_to);
        result = prepare(arguments, out.as_deref(), output)
            .and_then(|next| shown(next, arguments, &board, &hand, output));
        tell(&result, &board);
    }
    result
}

/// Says why a run did not come to its end.
fn tell(result: &Result<(), Failure>, board: &Board) {
    if let Err(failure) = result {
        log::error!("{}", failure.message);
        if failure.exit == Exit::Refused {
            board.refuse(&failure.to_text());
        }
    }
}

/// Does one run, and shows it.
fn shown(
    prepared: Prepared,
    arguments: &Arguments,
    board: &Board,
    hand: &Hand,
    output: &mut Output,
) -> Result<(), Failure> {
    let Prepared { job, mission, folder } = prepared;
    let place = match &arguments.brick.sim {
        Some(world) => format!("in {}", named(world)),
        None => format!("on {}", arguments.brick.files.root().display()),
    };
    let sources = Sources {
        title: format!("{} {place}", mission.name()),
        recording: Some(job.file.clone()),
        ..Sources::default()
    };
    let ended = match job.brick {
        Brick::Simulated { .. } => simulate(&job, &mission, sources, board, hand, output),
        Brick::Local(_) => {
            board.show(sources);
            start(&job).and_then(|run| {
                hand.hold(run.stopper());
                follow(run, &job, &mission, output, |event| board.hear(event))
            })
        }
    };
    conclude(&ended.inspect_err(|_| folder.take_back())?, output)
}

/// A world's name: its own, or its file's.
fn named(world: &Path) -> String {
    world.file_stem().unwrap_or(world.as_os_str()).to_string_lossy().into_owned()
}

fn simulate(
    job: &Job,
    mission: &Mission,
    sources: Sources,
    board: &Board,
    hand: &Hand,
    output: &mut Output,
) -> Result<Ended, Failure> {
    let progress = Progress::new(mission, output);
    let mut happenings = Happenings::of(job.file.clone(), Some(progress));
    let mut tell = |event: &Event| happenings.hear(event, output);
    let ended = watched(job, mission, sources, board, &hand.flags, &mut tell);
    happenings.finish(output);
    let ended = ended?;
    output.value(&Event::Ended(ended.clone()));
    Ok(ended)
}

/// Does a simulated run in this process, in real time or as a person at the board's page wants it,
/// until it ends or a flag is raised. `tell` is called for each event but the end.
pub(in crate::cli) fn watched(
    job: &Job,
    mission: &Mission,
    sources: Sources,
    board: &Board,
    flags: &StopFlags,
    tell: &mut (dyn FnMut(&Event) + Send),
) -> Result<Ended, Failure> {
    let clock = Arc::new(PacedClock::new(board.pace().unwrap_or(Some(1.0))));
    let Simulated { environment, simulation, .. } =
        simulated_at(job, Arc::<PacedClock>::clone(&clock))?;
    let screen = Screen { simulation: simulation.clone(), mission };
    board.show(Sources { simulation: Some(simulation), clock: Some(clock), ..sources });
    let preparing = Event::Preparing { what: "getting ready".to_owned() };
    screen.show(&preparing);
    board.hear(&preparing);
    let (say, events) = mpsc::channel();
    let hears = board.clone();
    let report = move |event: &Event| {
        // A reader of the output that lags does not hold up the page.
        hears.hear(event);
        // A listener that is gone has no need of it.
        let _ = say.send(event.clone());
    };
    let ended = std::thread::scope(|scope| {
        scope.spawn(|| {
            for event in events {
                screen.show(&event);
                tell(&event);
            }
        });
        execute(job, environment, flags, &mut NoHeartbeat, report).inspect_err(|refused| {
            let stop = StopReason::Refused.with(refused.to_string());
            screen.show(&Event::Refused { stop, hint: None });
        })
    })?;
    board.hear(&Event::Ended(ended.clone()));
    Ok(ended)
}

/// The simulated brick's screen, with what the menu shows there of a run.
struct Screen<'m> {
    simulation: Simulation,
    mission: &'m Mission,
}

impl Screen<'_> {
    fn show(&self, event: &Event) {
        let running = |waits: Option<&String>, progress| {
            let (run, limit_s) = (RunId::new("here").ok()?, self.mission.time_limit_s());
            let begun = RunStatus::new(run, self.mission.name(), limit_s, "here");
            Some(running_picture(&RunStatus { waits: waits.cloned(), progress, ..begun }))
        };
        let picture = match event {
            Event::Preparing { what } => running(Some(what), None),
            Event::Status(status) => running(None, Some(status.clone())),
            Event::Stopped { stop, .. } | Event::Refused { stop, .. } => {
                Some(ended_picture(&LastStop::new(None, self.mission.name(), stop.clone())))
            }
            Event::Driving { .. } | Event::Ended(_) => None,
        };
        if let Some(picture) = picture {
            self.draw(&picture);
        }
    }

    /// As a program of the brick draws: 32 bits a pixel.
    fn draw(&self, picture: &Canvas) {
        let bytes: Vec<u8> =
            picture.pixels().iter().flat_map(|grey| [*grey, *grey, *grey, 0]).collect();
        let screen = self.simulation.brick(0).open("dev/fb0", Access::Write);
        // A screen is always there; without one there would be nothing to see, and no more.
        let _ = screen.and_then(|screen| screen.write(&bytes));
    }
}

/// What a person at the page, or at the keyboard, wants. Clones are handles on the same one.
#[derive(Clone)]
struct Hand {
    /// For a run in this process.
    flags: StopFlags,
    /// For a run in a process of its own.
    stopper: Arc<Mutex<Option<Stopper>>>,
    again: Arc<AtomicBool>,
}

impl Hand {
    fn new() -> Result<Self, Failure> {
        Ok(Self { flags: stop_flags()?, stopper: Arc::default(), again: Arc::default() })
    }

    fn grant(&self, wish: Wish) {
        self.again.store(wish == Wish::Again, Ordering::Relaxed);
        self.flags.raise(StopBy::Page);
        if let Some(stopper) = &*lock(&self.stopper) {
            // A run that is gone needs no telling.
            let _ = stopper.stop(StopBy::Page);
        }
    }

    fn hold(&self, stopper: Stopper) {
        *lock(&self.stopper) = Some(stopper);
    }

    /// Ctrl-C.
    fn is_over(&self) -> bool {
        self.flags.signal.load(Ordering::Relaxed)
    }

    /// The page has asked for the end of this run.
    fn was_used(&self) -> bool {
        self.flags.page.load(Ordering::Relaxed)
    }

    /// Another run is wanted.
    fn is_wanted(&self) -> bool {
        self.again.load(Ordering::Relaxed)
    }

    /// Waits until another run is wanted, of which nothing has been wanted then; false on Ctrl-C.
    fn wait(&self) -> bool {
        while !self.is_over() && !self.is_wanted() {
            MonotonicClock.sleep_ns(LOOK_NS);
        }
        self.again.store(false, Ordering::Relaxed);
        self.flags.page.store(false, Ordering::Relaxed);
        !self.is_over()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_wish_is_one_run_even_where_that_is_refused() {
        let flags = StopFlags::default();
        let hand = Hand { flags, stopper: Arc::default(), again: Arc::default() };
        hand.grant(Wish::Again);
        assert!(hand.wait());
        assert!(!hand.is_wanted() && !hand.flags.page.load(Ordering::Relaxed));
        hand.flags.raise(StopBy::Terminal);
        assert!(!hand.wait());
    }
}
