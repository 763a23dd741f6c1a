//! The menu on the brick: missions chosen, started, watched and stopped with five buttons, on a
//! screen of 178 × 128 pixels.
//!
//! [`Menu`] is the whole of it, and it is pure: button events, the service's answers and the time
//! go in, requests to the service and a picture come out. It keeps no state of the robot's own:
//! what it shows is what the service said last, so that menu, link and log always tell the same
//! story. [`attend`] joins it to the brick's buttons and screen, or to a terminal.
//!
//! ```text
//!  buttons ──▶ press, release ─┐          ┌─▶ next_request ──▶ service (local socket)
//!  answers ──▶ learn ──────────┼─▶ Menu ──┼─▶ picture ───────▶ screen
//!  time ─────▶ tick ───────────┘          └─▶ next_effect ───▶ setting up (a thread that asks)
//! ```
//!
//! # Pages
//!
//! ```text
//!  level 1, Left and Right turn:   missions ─ runs ─ ports ─ set up ─ settings
//!  level 2, Enter opens:           mission    map    port    talk     pairing, time limit
//!  during a run, instead:          running ─ map                  Enter or Back stops
//!  after it:                       how it ended; a fault stays until it is acknowledged
//! ```
//!
//! Up and Down choose and scroll, with a repeat of our own while they are held; Enter opens or
//! does; Left or Back goes up again.
//!
//! # Started by brickman, or at boot
//!
//! Under brickman the button Back kills the menu (and all that it started) at once, and brickrun
//! resets every motor: Back cannot be a button of ours. So any end of a menu that was started this
//! way ends the run, with the reason "menu closed", and the screen says that Back stops; Left goes
//! up. A menu that our own unit starts at boot, in brickman's place, survives every run and owns
//! Back. [`StartedBy`] says which it is.
//!
//! # Stopping by hand
//!
//! The run's own process listens to the brick's buttons, whatever is on the screen; the menu shows
//! that it happened. Only if the run is still in progress a second after the press, or where the
//! keys are no brick's buttons, does the menu ask the service to stop it.
//!
//! # Not here
//!
//! No devices but the screen and the buttons that [`attend`] is given: motors are jogged, and
//! lights and sounds made, by the service.
//!
//! # Costs
//!
//! At most 20 frames a second; nothing is drawn while nothing changes, and nothing is written that
//! is as it was. The memory is a picture of 22 kB twice, the lists, and a map in cells of 2 cm.

mod asks;
mod canvas;
mod learn;
mod pages;
#[cfg(feature = "host")]
mod picture;
mod press;
mod sheet;
mod shell;
mod talk;
mod text;
mod track;

use std::collections::VecDeque;

use crate::clock::{MILLISECOND_NS, SECOND_NS};
use crate::protocol::{
    LastStop, Live, LocalOnly, LocalRequest, Missions, Pairing, Request, RunId, RunStatus, Runs,
    Settings, State, Status,
};

pub use asks::Lane;
pub use canvas::{Canvas, HEIGHT, WIDTH};
pub use learn::Trouble;
#[cfg(feature = "host")]
pub use picture::{ended_picture, running_picture};
pub use shell::{Display, Keys, MenuError, Parts, ServiceConnection, attend};
pub use talk::{Replies, ScreenDialogue, TalkKind, TalkReply, Talker, Told};

use crate::runtime::Stop;
use asks::{Asks, Look};
use press::Held;
use sheet::View;
use talk::Talk;
use track::Track;

/// Who started the menu: it decides what Back means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StartedBy {
    /// Brickman's file browser: Back kills the menu, and its end ends the run.
    Brickman,
    /// Our own unit, at boot: Back is ours.
    Boot,
    /// A person at a terminal: the keys are not the brick's buttons, so a stop goes through the
    /// service.
    Terminal,
}

/// What a menu is made for.
#[derive(Debug, Clone)]
pub struct MenuOptions {
    /// Who started it.
    pub started_by: StartedBy,
    /// Why setting up and calibrating cannot be done from here, where they cannot.
    pub no_talks: Option<String>,
    /// Makes the identifiers of runs unlike those of other menus, such as the wall clock's
    /// nanoseconds.
    pub seed: i64,
}

/// Something that the menu wants done beside requests.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Effect {
    /// Begin to talk.
    Talk(TalkKind),
    /// A question was answered.
    Reply(TalkReply),
    /// Enter was pressed while no question was open.
    Pressed,
    /// The person wants it to stop.
    StopTalk,
}

/// A page of level one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Tab {
    Missions,
    Runs,
    Ports,
    SetUp,
    Settings,
}

impl Tab {
    const ALL: [Self; 5] = [Self::Missions, Self::Runs, Self::Ports, Self::SetUp, Self::Settings];

    /// What it shows of the service.
    fn look(self) -> Look {
        match self {
            Self::Missions => Look::Missions,
            Self::Runs => Look::Runs,
            Self::Ports => Look::Live,
            Self::SetUp => Look::Status,
            Self::Settings => Look::Settings,
        }
    }
}

/// A page of level two.
#[derive(Debug, Clone, PartialEq)]
enum Page {
    Mission(String),
    Map(RunId),
    Port(String),
    TimeLimit(f64),
    Pairing,
}

/// What stands over the pages until it is answered.
#[derive(Debug, Clone, PartialEq)]
enum Notice {
    /// Something was refused, or failed.
    Refused { message: String, hint: Option<String> },
    /// Delete this run?
    Delete(RunId),
}

/// What the service said last.
#[derive(Debug, Default)]
struct Seen {
    status: Option<Status>,
    status_ns: i64,
    missions: Option<Missions>,
    runs: Option<Runs>,
    live: Option<Live>,
    settings: Option<Settings>,
    pairing: Option<Pairing>,
    /// The service does not answer, and why.
    gone: Option<String>,
    /// It answers, and does not want to show what the page is about.
    refused: Option<String>,
}

impl Seen {
    fn state(&self) -> Option<State> {
        self.status.as_ref().map(|status| status.state)
    }

    fn run(&self) -> Option<&RunStatus> {
        self.status.as_ref()?.run.as_ref()
    }

    fn is_running(&self) -> bool {
        matches!(self.state(), Some(State::Preparing | State::Running | State::Stopping))
    }
}

/// What is on the screen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Showing {
    Talk,
    NoService,
    Running,
    Notice,
    Ended,
    Page,
    Tab,
}

/// The menu.
#[derive(Debug)]
pub struct Menu {
    options: MenuOptions,
    now_ns: i64,
    seen: Seen,
    asks: Asks,
    effects: VecDeque<Effect>,
    tab: Tab,
    tab_views: [View; Tab::ALL.len()],
    /// Where a person is on what else is shown, but for a talk.
    views: [View; Showing::Tab as usize],
    page: Option<Page>,
    /// During a run: its map, or how it goes.
    shows_map: bool,
    /// How the last run ended, until a person has seen it.
    ended: Option<LastStop>,
    /// The run on the screen, or the last one, has driven: there is a map of it.
    has_driven: bool,
    /// The fault that was seen: it does not come back by itself.
    dismissed: Option<Stop>,
    notice: Option<Notice>,
    track: Option<Track>,
    talk: Option<Talk>,
    held: Option<Held>,
    /// When a stop that a button should have brought about is asked for.
    stop_due_ns: Option<i64>,
    started: u32,
    /// The service knows that its run ends with this menu, where it does.
    is_known: bool,
    changed: bool,
    /// What the head's right corner said last.
    corner: String,
    /// What the screen shows; nothing at first.
    shown: Option<Canvas>,
}

/// An older answer is marked as old.
const OLD_NS: i64 = 3 * SECOND_NS;

/// How long a run may go on after a button that the run's own process should have seen.
const STOP_PATIENCE_NS: i64 = SECOND_NS;

/// A battery below this will not last: `onbrick doctor` warns of it too, volts.
const LOW_V: f64 = 6.8;

impl Menu {
    /// A menu that knows nothing yet.
    #[must_use]
    pub fn new(options: MenuOptions) -> Self {
        let mut menu = Self {
            options,
            now_ns: 0,
            seen: Seen::default(),
            asks: Asks::default(),
            effects: VecDeque::new(),
            tab: Tab::Missions,
            tab_views: [View::default(); Tab::ALL.len()],
            views: [View::default(); Showing::Tab as usize],
            page: None,
            shows_map: false,
            ended: None,
            has_driven: false,
            dismissed: None,
            notice: None,
            track: None,
            talk: None,
            held: None,
            stop_due_ns: None,
            started: 0,
            is_known: false,
            changed: true,
            corner: String::new(),
            shown: None,
        };
        menu.announce();
        menu
    }

    /// A menu whose end ends the run announces itself at each new connection. It shows nothing
    /// before the service knows: what is seen and started on this screen ends with it.
    fn announce(&mut self) {
        self.is_known = self.options.started_by != StartedBy::Brickman;
        if !self.is_known {
            self.asks.order(LocalOnly::MenuHere);
        }
    }

    /// Time passes: buttons that are held repeat, jogs are renewed, what should have happened is
    /// seen to. `now_ns` is of a monotonic clock and does not go back; it is the time of everything
    /// until the next call.
    pub fn tick(&mut self, now_ns: i64) {
        self.now_ns = now_ns;
        self.repeat();
        if self.stop_due_ns.take_if(|due_ns| *due_ns <= now_ns).is_some() && self.seen.is_running()
        {
            self.asks.stop();
        }
        let corner = self.corner_text();
        if corner != self.corner {
            self.corner = corner;
            self.changed = true;
        }
    }

    /// The next request to send over a connection; `None` while one is on its way there, or nothing
    /// is wanted.
    pub fn next_request(&mut self, lane: Lane) -> Option<LocalRequest> {
        if lane == Lane::Order {
            return self.asks.next_order();
        }
        let look = self.asks.due(&self.looks(), self.now_ns)?;
        let request = self.look_request(look)?;
        self.asks.look(look, request.clone(), self.now_ns);
        Some(request)
    }

    /// The next thing that the menu wants done beside requests.
    pub fn next_effect(&mut self) -> Option<Effect> {
        self.effects.pop_front()
    }

    /// The picture, if it is another one than the last that was given.
    pub fn picture(&mut self) -> Option<&Canvas> {
        if !self.changed {
            return None;
        }
        self.changed = false;
        let mut canvas = Canvas::default();
        self.draw(&mut canvas);
        if self.shown.as_ref() == Some(&canvas) {
            return None;
        }
        Some(self.shown.insert(canvas))
    }

    /// Gives the picture once more, although it is the one that was given last.
    pub fn show_again(&mut self) {
        self.shown = None;
        self.changed = true;
    }

    fn showing(&self) -> Showing {
        if self.talk.is_some() {
            Showing::Talk
        } else if self.seen.status.is_none() || self.seen.gone.is_some() || !self.is_known {
            Showing::NoService
        } else if self.seen.is_running() {
            Showing::Running
        } else if self.notice.is_some() {
            Showing::Notice
        } else if self.ended.is_some() {
            Showing::Ended
        } else if self.page.is_some() {
            Showing::Page
        } else {
            Showing::Tab
        }
    }

    /// What has to be looked at for what is on the screen.
    fn looks(&self) -> Vec<Look> {
        let mut looks = vec![Look::Status];
        match (self.showing(), &self.page) {
            (Showing::Running, _) if self.shows_map && self.wants_part() => looks.push(Look::Map),
            (Showing::Page, Some(Page::Map(run))) => {
                looks.extend(self.wants_part().then_some(Look::Map));
                // Its number stands in the head.
                looks.extend(self.run_info(run).is_none().then_some(Look::Runs));
            }
            (Showing::Page, Some(Page::Port(_))) => looks.push(Look::Live),
            (Showing::Page, Some(Page::Mission(_))) => {
                looks.extend([Look::Missions, Look::Settings])
            }
            (Showing::Page, Some(Page::Pairing)) => looks.push(Look::Pairing),
            (Showing::Tab, _) => looks.push(self.tab.look()),
            _ => {}
        }
        looks
    }

    fn look_request(&mut self, look: Look) -> Option<LocalRequest> {
        Some(match look {
            Look::Status => LocalRequest::Shared(Request::Status),
            Look::Missions => LocalRequest::Shared(Request::Missions),
            Look::Runs => LocalRequest::Shared(Request::Runs),
            Look::Live => LocalRequest::Shared(Request::Live),
            Look::Settings => LocalRequest::Own(LocalOnly::Settings),
            Look::Pairing => LocalRequest::Own(LocalOnly::PairingState),
            Look::Map => LocalRequest::Shared(Request::Fetch(self.next_part()?)),
        })
    }

    /// The run whose map is on the screen.
    fn mapped_run(&self) -> Option<RunId> {
        match (self.showing(), &self.page) {
            (Showing::Running, _) => self.seen.run().map(|run| run.run.clone()),
            (_, Some(Page::Map(run))) => Some(run.clone()),
            _ => None,
        }
    }

    /// What stands at the head's right: the battery, or that what is shown is old.
    fn corner_text(&self) -> String {
        let Some(status) = &self.seen.status else { return String::new() };
        let age_ns = self.now_ns - self.seen.status_ns;
        if age_ns > OLD_NS {
            return format!("{} s old", age_ns / SECOND_NS);
        }
        let progress = self.seen.run().and_then(|run| run.progress.as_ref());
        match progress.and_then(|progress| progress.battery_v).or(status.battery_v) {
            Some(volts) if volts < LOW_V => format!("low {volts:.1} V"),
            Some(volts) => format!("{volts:.1} V"),
            None if status.simulated => "simulated".to_owned(),
            None => "no battery".to_owned(),
        }
    }
}

/// How long a frame lasts at least: 20 a second is what the panel shows.
pub(crate) const FRAME_NS: i64 = 50 * MILLISECOND_NS;
