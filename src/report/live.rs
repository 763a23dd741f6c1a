//! The live page: a simulation, a run in progress, or both at once, in a browser on this machine.
//!
//! There is one page (`live/page.html`, its style and its script beside it) and one form of state
//! (`live/state`), whose parts are filled in by the sources that have them:
//!
//! | source | gives | takes |
//! |---|---|---|
//! | a [`Simulation`] | room, true poses and paths, sensors, screen, lights, tones, faults | its [`Order`](crate::sim::Order)s: buttons, faults, a hand that carries the robot |
//! | a recording that grows | estimated path, points, map, machines and their history, variables | |
//! | a run's [`Event`]s | the newest status, the path that the recording has not yet, how the run ended | |
//! | a [`PacedClock`] | how fast time passes | another pace |
//!
//! What a source cannot give is left out of the page. A [`Wish`], to stop or to start again, goes
//! to the one who serves the page, where it can be granted.
//!
//! The page asks for `/state?since=CURSOR` seven times a second and gets what is new. It draws on a
//! canvas and says at it what it draws, as `data-` attributes: `time`, `x`, `y` and `heading` of
//! the first robot, `moved` since the page was opened, `walls`, `robots`, `echoes`, `faults`; of a
//! run `phase`, `points`, `path`, `believed-x`, `believed-y`, and `grown`: how often more of its
//! recording has come.
//!
//! # Not here
//!
//! No control of anything real: of a brick's run the page shows the recording, and may wish that it
//! stops. The page loads nothing from elsewhere; its own policy forbids it. Who may look and post
//! is the server's matter (`page`).

mod state;

use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use self::state::{Cursor, Phase, Session};
use super::png_file;
use crate::clock::PacedClock;
use crate::page::{Asked, Kind, Place, Shown};
pub use crate::page::{LocalPage, PageError};
use crate::recording::Status;
use crate::runtime::Event;
use crate::sim::Simulation;
use crate::threads::lock;

/// What the page is made of.
const PARTS: [(&str, Kind, &str); 3] = [
    ("/", Kind::Html, include_str!("live/page.html")),
    ("/live.css", Kind::Style, include_str!("live/live.css")),
    ("/live.js", Kind::Script, include_str!("live/live.js")),
];

/// No order is longer, bytes.
const MOST_POSTED: u64 = 4096;

/// Where what the page shows comes from.
#[derive(Debug, Clone, Default)]
pub struct Sources {
    /// What stands above the page.
    pub title: String,
    /// The simulated bricks, which take orders.
    pub simulation: Option<Simulation>,
    /// What the simulation's time is kept by, where its pace can be changed.
    pub clock: Option<Arc<PacedClock>>,
    /// A recording that grows; it need not be there yet.
    pub recording: Option<PathBuf>,
}

/// What a person wants of the one who serves the page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wish {
    /// That the run stops.
    Stop,
    /// That the same mission starts again, from its beginning.
    Again,
}

impl Wish {
    fn word(self) -> &'static str {
        match self {
            Self::Stop => "stop",
            Self::Again => "again",
        }
    }
}

/// What the page shows. Clones are handles on the same one.
#[derive(Debug, Clone, Default)]
pub struct Board(Arc<Mutex<Session>>);

impl Board {
    /// Shows other sources from now on: a new run, or another simulation. A simulation is watched
    /// from here on; the pace that a person has set stays.
    pub fn show(&self, sources: Sources) {
        if let Some(simulation) = &sources.simulation {
            simulation.watch();
        }
        let mut session = lock(&self.0);
        let next = session.next(sources);
        *session = next;
    }

    /// Shows how the run is going.
    pub fn hear(&self, event: &Event) {
        lock(&self.0).hear(event);
    }

    /// Shows a status that is newer than the recording's.
    pub fn hear_status(&self, status: &Status) {
        lock(&self.0).hear_status(status);
    }

    /// Says that no run is in progress, and why.
    pub fn refuse(&self, why: &str) {
        let session = &mut *lock(&self.0);
        session.enter(Phase::Refused, why);
    }

    /// Serves its page at a port of 127.0.0.1, 0 for any that is free.
    ///
    /// - `granted`: the wishes that `grant` can do something about.
    ///
    /// # Errors
    ///
    /// [`PageError`]; nothing is served then.
    pub fn serve(
        &self,
        port: u16,
        granted: &[Wish],
        grant: impl Fn(Wish) + Send + Sync + 'static,
    ) -> Result<LocalPage, PageError> {
        self.grants(granted);
        let board = self.clone();
        let place = Place { port, token: None, most_posted: MOST_POSTED };
        LocalPage::serve(&place, move |asked| board.answer(asked, &grant))
    }

    /// The pace that a person has set last, if the simulation has one.
    #[must_use]
    pub fn pace(&self) -> Option<Option<f64>> {
        lock(&self.0).clock().map(PacedClock::pace)
    }

    /// The wishes that can be granted.
    pub(crate) fn grants(&self, granted: &[Wish]) {
        lock(&self.0).granted = granted.to_vec();
    }

    /// What the page's server answers; `grant` is told what a person wants.
    pub(crate) fn answer(&self, asked: Asked<'_>, grant: &impl Fn(Wish)) -> Shown {
        let done = match (asked.path, asked.posted) {
            ("/state", None) => {
                return Shown::json(lock(&self.0).state(Cursor::of(asked.query)));
            }
            ("/screen", None) => {
                return self.screen(asked.query).map_or(Shown::Nothing, Shown::Png);
            }
            (path, None) => return Shown::part(&PARTS, path),
            ("/order", Some(text)) => self.order(text),
            ("/pace", Some(word)) => lock(&self.0).set_pace(word),
            ("/wish", Some(word)) => self.wish(word).map(grant),
            _ => return Shown::Fixed,
        };
        done.map_or_else(Shown::Refused, |()| Shown::Done)
    }

    /// What a small picture of the run has not got since `cursor`, which the last answer brought as
    /// `next`; all of it for any other text.
    pub(crate) fn glimpse(&self, cursor: &str) -> serde_json::Value {
        lock(&self.0).glimpse(Cursor::parse(cursor))
    }

    /// Does what a person orders of the simulation.
    fn order(&self, text: &str) -> Result<(), String> {
        let simulation = lock(&self.0).ordered()?.clone();
        simulation.control(0, text).map_err(|error| error.to_string())
    }

    /// What a person wants, if that can be granted now.
    fn wish(&self, word: &str) -> Result<Wish, String> {
        let session = lock(&self.0);
        let wished = session.wishes().find(|wish| wish.word() == word);
        wished.ok_or_else(|| format!("this page cannot do that now: {word}"))
    }

    /// A robot's screen as a picture.
    fn screen(&self, query: &str) -> Option<Vec<u8>> {
        let robot = query.split('&').find_map(|part| part.strip_prefix("robot="))?;
        let simulation = lock(&self.0).simulation()?.clone();
        let (width, height, greys) = simulation.screen(robot.parse().ok()?)?;
        png_file([width, height], png::ColorType::Grayscale, &greys).ok()
    }
}
