//! What the buttons do.

use super::asks::Look;
use super::sheet::View;
use super::talk::TalkKind;
use super::{Effect, Menu, Notice, Page, STOP_PATIENCE_NS, Seen, Showing, StartedBy, Tab};
use crate::clock::MILLISECOND_NS;
use crate::ev3dev::Button;
use crate::protocol::{Chosen, LocalOnly, Pairing, RunId, SettingsChange, Start, State};

/// How long Up or Down is held before it repeats.
const REPEAT_AFTER_NS: i64 = 500 * MILLISECOND_NS;

/// How often it repeats then.
const REPEAT_NS: i64 = 120 * MILLISECOND_NS;

/// How often the lease of a motor that is jogged is renewed; it lasts 300 ms.
const JOG_NS: i64 = 100 * MILLISECOND_NS;

/// How fast a motor is jogged: fast enough to see which it is, slow enough to be held by hand.
const JOG_PERCENT: i32 = 30;

/// For how long the pairing window is opened: long enough to walk to the PC and back.
const PAIRING_S: u32 = 120;

/// What a press changes the time limit by, seconds, and how long it may be.
const LIMIT_STEP_S: f64 = 10.0;
const LIMIT_MOST_S: f64 = 3600.0;

/// A button that is held and means something as long as it is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Held {
    button: Button,
    next_ns: i64,
    /// The motor that turns as long as it is held.
    pub(super) jogs: Option<String>,
}

impl Menu {
    /// A button was pressed.
    pub fn press(&mut self, button: Button) {
        self.changed = true;
        self.let_go();
        if matches!(button, Button::Up | Button::Down) {
            let jogs = self.jogged_port();
            let is_jogging = jogs.is_some();
            self.held = Some(Held {
                button,
                next_ns: self.now_ns + if is_jogging { 0 } else { REPEAT_AFTER_NS },
                jogs,
            });
            if is_jogging {
                return self.repeat();
            }
        }
        self.act(button);
    }

    /// A button was let go.
    pub fn release(&mut self, button: Button) {
        if self.held.as_ref().is_some_and(|held| held.button == button) {
            self.let_go();
            self.changed = true;
        }
    }

    /// The motor that Up and Down turn on this page.
    fn jogged_port(&self) -> Option<String> {
        match &self.page {
            Some(Page::Port(port))
                if self.showing() == Showing::Page
                    && self.device(port).is_some_and(|device| device.motor) =>
            {
                Some(port.clone())
            }
            _ => None,
        }
    }

    /// Acts again for a button that is still held.
    pub(super) fn repeat(&mut self) {
        let now_ns = self.now_ns;
        let Some(held) = self.held.as_mut().filter(|held| held.next_ns <= now_ns) else { return };
        let button = held.button;
        if let Some(port) = held.jogs.clone() {
            held.next_ns = now_ns + JOG_NS;
            let percent = if button == Button::Up { JOG_PERCENT } else { -JOG_PERCENT };
            self.asks.order(LocalOnly::Jog { port, percent });
        } else {
            held.next_ns = now_ns + REPEAT_NS;
            self.changed = true;
            self.act(button);
        }
    }

    fn act(&mut self, button: Button) {
        match self.showing() {
            Showing::Talk => self.act_talking(button),
            // There is nothing to choose until the service is back.
            Showing::NoService => {}
            Showing::Running => self.act_running(button),
            Showing::Notice => self.act_notice(button),
            Showing::Ended => self.act_ended(button),
            Showing::Page => self.act_page(button),
            Showing::Tab => self.act_tab(button),
        }
    }

    /// Where the view of what is on the screen is kept.
    fn view_mut(&mut self) -> Option<&mut View> {
        Some(match self.showing() {
            Showing::Talk => &mut self.talk.as_mut()?.view,
            Showing::Tab => &mut self.tab_views[self.tab as usize],
            other => &mut self.views[other as usize],
        })
    }

    /// Up and Down on a page of rows; true where the button was one of them.
    fn moves(&mut self, button: Button) -> bool {
        let sheet = self.sheet();
        let view = match button {
            Button::Up => sheet.up(self.view()),
            Button::Down => sheet.down(self.view()),
            _ => return false,
        };
        if let Some(place) = self.view_mut() {
            *place = view;
        }
        true
    }

    /// Which row Enter takes; none while it is out of sight: the page scrolls there instead.
    fn taken(&mut self) -> Option<usize> {
        let sheet = self.sheet();
        if sheet.choices() == 0 {
            return None;
        }
        let view = sheet.fit(self.view());
        if sheet.sees_chosen(view) {
            return Some(view.chosen);
        }
        self.moves(Button::Down);
        None
    }

    fn act_running(&mut self, button: Button) {
        match button {
            Button::Enter | Button::Back => {
                self.notice = None;
                self.stop();
            }
            Button::Left | Button::Right => {
                self.shows_map = !self.shows_map;
                self.views[Showing::Running as usize] = View::default();
            }
            Button::Up | Button::Down => {
                self.moves(button);
            }
        }
    }

    fn stop(&mut self) {
        if self.options.started_by == StartedBy::Terminal {
            self.asks.stop();
        } else if self.stop_due_ns.is_none() && self.seen.state() != Some(State::Stopping) {
            self.stop_due_ns = Some(self.now_ns + STOP_PATIENCE_NS);
        }
    }

    fn act_notice(&mut self, button: Button) {
        if self.moves(button) {
            return;
        }
        let taken = if button == Button::Enter { self.taken() } else { Some(0) };
        let Some(taken) = taken else { return };
        if let Some(Notice::Delete(run)) = self.notice.take()
            && taken == 1
        {
            self.asks.order(LocalOnly::Delete { run });
            self.page = None;
        }
    }

    /// How a run ended goes away with any button; a fault only with Enter, which acknowledges it.
    fn act_ended(&mut self, button: Button) {
        if self.moves(button) {
            return;
        }
        let is_fault = self.ended.as_ref().is_some_and(|ended| !ended.is_wanted());
        let taken = if button == Button::Enter { self.taken() } else { None };
        if taken.is_none() && (is_fault || button == Button::Enter) {
            return;
        }
        let map = self.ended_map().cloned();
        let Some(ended) = self.ended.take() else { return };
        self.dismissed = Some(ended.stop);
        if is_fault {
            self.asks.order(LocalOnly::Acknowledge);
        } else if let (Some(0), Some(run)) = (taken, map) {
            self.tab = Tab::Runs;
            self.asks.refresh(Look::Runs, self.now_ns);
            self.open(Page::Map(run));
        }
    }

    fn open(&mut self, page: Page) {
        if matches!(page, Page::Map(_)) {
            self.track = None;
        }
        self.page = Some(page);
        self.views[Showing::Page as usize] = View::default();
    }

    fn act_tab(&mut self, button: Button) {
        if self.moves(button) {
            return;
        }
        let place = self.tab as usize;
        let count = Tab::ALL.len();
        match button {
            Button::Left => self.turn_to((place + count - 1) % count),
            Button::Right => self.turn_to((place + 1) % count),
            Button::Back => self.turn_to(0),
            _ => {
                if let Some(chosen) = self.taken() {
                    self.enter_tab(chosen);
                }
            }
        }
    }

    fn turn_to(&mut self, place: usize) {
        self.tab = Tab::ALL.get(place).copied().unwrap_or(Tab::Missions);
        self.seen.live = None;
        self.asks.refresh(self.tab.look(), self.now_ns);
    }

    fn enter_tab(&mut self, chosen: usize) {
        match self.tab {
            Tab::SetUp => self.begin_talk(chosen),
            Tab::Settings => self.enter_settings(chosen),
            Tab::Missions | Tab::Runs | Tab::Ports => {
                if let Some(page) = self.listed(chosen) {
                    self.open(page);
                }
            }
        }
    }

    /// The page of one that a tab lists.
    fn listed(&self, chosen: usize) -> Option<Page> {
        let Seen { missions, runs, live, .. } = &self.seen;
        Some(match self.tab {
            Tab::Missions => Page::Mission(missions.as_ref()?.missions.get(chosen)?.name.clone()),
            Tab::Runs => Page::Map(runs.as_ref()?.runs.get(chosen)?.run.clone()),
            Tab::Ports => Page::Port(live.as_ref()?.devices.get(chosen)?.port.clone()),
            Tab::SetUp | Tab::Settings => return None,
        })
    }

    fn begin_talk(&mut self, chosen: usize) {
        if let Some(kind) = TalkKind::ALL.get(chosen).filter(|_| self.options.no_talks.is_none()) {
            self.talk = Some(super::Talk::new(*kind));
            self.effects.push_back(Effect::Talk(*kind));
        }
    }

    fn enter_settings(&mut self, chosen: usize) {
        let Some(settings) = &self.seen.settings else { return };
        let change = match chosen {
            0 => SettingsChange { lights: Some(!settings.lights), ..SettingsChange::default() },
            1 => SettingsChange { sounds: Some(!settings.sounds), ..SettingsChange::default() },
            2 => return self.open(Page::TimeLimit(settings.time_limit_s.unwrap_or(0.0))),
            _ => {
                self.seen.pairing = None;
                self.asks.refresh(Look::Pairing, self.now_ns);
                return self.open(Page::Pairing);
            }
        };
        self.asks.order(LocalOnly::SetSettings(change));
    }

    fn act_page(&mut self, button: Button) {
        let Some(page) = self.page.clone() else { return };
        match (page, button) {
            (Page::Map(run), Button::Enter) => {
                self.notice = Some(Notice::Delete(run));
                self.views[Showing::Notice as usize] = View::default();
            }
            (page, Button::Left | Button::Back) => {
                self.page = None;
                // A window that is out of sight lets in who is not expected.
                let is_open = matches!(
                    self.seen.pairing,
                    Some(Pairing::Open { .. } | Pairing::Compare { .. })
                );
                if page == Page::Pairing && is_open {
                    self.asks.order(LocalOnly::PairingWindow { seconds: 0 });
                }
            }
            (Page::Map(_), Button::Right) => self.page = None,
            (Page::TimeLimit(limit_s), _) => self.act_time_limit(button, limit_s),
            (Page::Mission(name), Button::Enter) => {
                if self.taken().is_some() {
                    self.start(name);
                }
            }
            (Page::Pairing, Button::Enter) => {
                if let Some(chosen) = self.taken() {
                    self.act_pairing(chosen);
                }
            }
            _ => {
                self.moves(button);
            }
        }
    }

    fn act_time_limit(&mut self, button: Button, limit_s: f64) {
        let changed_s = match button {
            Button::Up => limit_s + LIMIT_STEP_S,
            Button::Down => limit_s - LIMIT_STEP_S,
            Button::Enter => {
                let time_limit_s = Some(limit_s);
                let change = SettingsChange { time_limit_s, ..SettingsChange::default() };
                self.asks.order(LocalOnly::SetSettings(change));
                self.page = None;
                return;
            }
            _ => return,
        };
        self.page = Some(Page::TimeLimit(changed_s.clamp(0.0, LIMIT_MOST_S)));
    }

    /// Starts a mission; a second press while the first is on its way does nothing.
    fn start(&mut self, mission: String) {
        if self.asks.is_starting() {
            return;
        }
        self.started += 1;
        let unique = format!("{:x}-{}", self.options.seed, self.started);
        let Ok(run) = RunId::of_mission(&mission, &unique) else { return };
        let start = Start {
            run,
            mission: Chosen::Name(mission),
            token: None,
            pose: None,
            set: Vec::new(),
            no_button: false,
        };
        self.asks.order(LocalOnly::StartHere(start));
    }

    fn act_pairing(&mut self, chosen: usize) {
        let order = match self.seen.pairing {
            Some(Pairing::Closed | Pairing::Failed { .. }) => {
                LocalOnly::PairingWindow { seconds: PAIRING_S }
            }
            Some(Pairing::Open { .. }) => LocalOnly::PairingWindow { seconds: 0 },
            Some(Pairing::Compare { .. }) => LocalOnly::PairingAnswer { same: chosen == 1 },
            Some(Pairing::Paired { .. }) => {
                self.page = None;
                return;
            }
            Some(Pairing::NoLink { .. }) | None => return,
        };
        self.asks.order(order);
    }

    fn act_talking(&mut self, button: Button) {
        let Some(talk) = &mut self.talk else { return };
        if talk.edits(button) || self.moves(button) {
            return;
        }
        let sees = self.sheet().sees_chosen(self.view());
        let Some(talk) = &mut self.talk else { return };
        match (button, talk.is_asking(), talk.is_over()) {
            (_, _, true) => {
                if button != Button::Enter || sees {
                    self.talk = None;
                    self.asks.refresh(Look::Status, self.now_ns);
                } else {
                    self.moves(Button::Down);
                }
            }
            (Button::Enter, true, _) if !sees => {
                self.moves(Button::Down);
            }
            (Button::Enter, true, _) => {
                if let Some(reply) = talk.answer() {
                    self.effects.push_back(Effect::Reply(reply));
                }
            }
            (Button::Enter, false, _) => self.effects.push_back(Effect::Pressed),
            (Button::Back, ..) => self.effects.push_back(Effect::StopTalk),
            _ => {}
        }
    }
}
