//! What the service's answers change.

use serde::de::DeserializeOwned;

use super::asks::{Lane, Look};
use super::track::Track;
use super::{Menu, Notice, Showing};
use crate::clock::SECOND_NS;
use crate::protocol::{
    Answer, Fetch, Fetched, LastStop, LocalOnly, LocalRequest, MAX_FETCH_BYTES, Pairing, Refusal,
    Request, State, Status,
};
use crate::runtime::StopReason;

/// How much of a recording is fetched at once: two seconds of a run, so that a long one comes in
/// steps that leave the brick's processor to the run.
const PART_BYTES: u32 = MAX_FETCH_BYTES;

/// Why a request was not answered as asked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Trouble {
    /// The service does not want to.
    Refused(Refusal),
    /// The service is not there, or did not answer in time.
    Gone(String),
}

impl Menu {
    /// Takes what came of the request that went over a connection last.
    pub fn learn(&mut self, lane: Lane, outcome: Result<Answer, Trouble>) {
        let Some(request) = self.asks.landed(lane) else { return };
        match outcome {
            Ok(answer) => {
                if self.answered(&request, answer).is_none() {
                    self.refuse(
                        "the service's answer was not understood".to_owned(),
                        Some("the same onbrick for menu and service".to_owned()),
                    );
                }
            }
            Err(Trouble::Refused(refusal)) => self.refused(lane, &request, refusal),
            Err(Trouble::Gone(why)) => self.gone(lane, &request, why),
        }
    }

    fn gone(&mut self, lane: Lane, request: &LocalRequest, why: String) {
        // A query is repeated by itself; an order is not, and whether it was carried out is
        // unknown.
        if lane == Lane::Order && *request != LocalRequest::Own(LocalOnly::MenuHere) {
            self.refuse(
                "the service did not answer".to_owned(),
                Some("look whether it was done".to_owned()),
            );
        }
        if self.seen.gone.as_ref() != Some(&why) {
            self.seen.gone = Some(why);
            self.seen.live = None;
            self.let_go();
            self.changed = true;
        }
    }

    fn refused(&mut self, lane: Lane, request: &LocalRequest, refusal: Refusal) {
        match request {
            // A service of another version: there is nothing to show.
            LocalRequest::Shared(Request::Status) | LocalRequest::Own(LocalOnly::MenuHere) => {
                self.gone(lane, request, refusal.message);
            }
            LocalRequest::Shared(Request::Fetch(fetch)) => {
                if let Some(track) = self.track.as_mut().filter(|track| track.run == fetch.run) {
                    track.trouble = Some(refusal.message);
                    self.changed = true;
                }
            }
            // It is asked again and again: said on the page, and not in the way.
            _ if lane == Lane::Look => {
                // What was read before is not what is.
                self.seen.live = None;
                note(&mut self.seen.refused, refusal.message, &mut self.changed);
            }
            _ => {
                // A button that is still held would be refused again.
                self.let_go();
                self.refuse(refusal.message, refusal.hint);
            }
        }
    }

    pub(super) fn refuse(&mut self, message: String, hint: Option<String>) {
        self.notice = Some(Notice::Refused { message, hint });
        self.views[Showing::Notice as usize] = super::View::default();
        self.changed = true;
    }

    /// `None` where the answer is not what such a request is answered with.
    fn answered(&mut self, request: &LocalRequest, answer: Answer) -> Option<()> {
        if self.seen.gone.take().is_some() {
            self.changed = true;
            self.announce();
        }
        if *request != LocalRequest::Shared(Request::Status) && self.seen.refused.take().is_some() {
            self.changed = true;
        }
        match request {
            LocalRequest::Shared(Request::Status) => self.status(read(answer)?),
            LocalRequest::Shared(Request::Missions) => {
                note(&mut self.seen.missions, read(answer)?, &mut self.changed)
            }
            LocalRequest::Shared(Request::Runs) => {
                note(&mut self.seen.runs, read(answer)?, &mut self.changed)
            }
            LocalRequest::Shared(Request::Fetch(fetch)) => self.fetched(fetch, answer)?,
            LocalRequest::Shared(Request::Live) => {
                note(&mut self.seen.live, read(answer)?, &mut self.changed)
            }
            LocalRequest::Own(LocalOnly::Settings | LocalOnly::SetSettings(_)) => {
                note(&mut self.seen.settings, read(answer)?, &mut self.changed);
            }
            LocalRequest::Own(
                LocalOnly::PairingWindow { .. }
                | LocalOnly::PairingState
                | LocalOnly::PairingAnswer { .. },
            ) => note(&mut self.seen.pairing, read::<Pairing>(answer)?, &mut self.changed),
            LocalRequest::Own(LocalOnly::Delete { .. }) => {
                self.asks.refresh(Look::Runs, self.now_ns)
            }
            LocalRequest::Own(LocalOnly::MenuHere) => {
                self.is_known = true;
                self.changed = true;
            }
            LocalRequest::Own(_) | LocalRequest::Shared(_) => {
                self.asks.refresh(Look::Status, self.now_ns)
            }
        }
        Some(())
    }

    fn status(&mut self, status: Status) {
        self.seen.status_ns = self.now_ns;
        let was_running = self.seen.is_running();
        let looks_alike = self.seen.status.as_ref().is_some_and(|before| alike(before, &status));
        self.seen.status = Some(status);
        let is_running = self.seen.is_running();
        if is_running && !was_running {
            self.run_began();
        }
        self.has_driven |= self.seen.run().is_some_and(|run| run.progress.is_some());
        if !is_running {
            self.stop_due_ns = None;
            self.run_is_over(was_running);
        }
        self.changed |= !looks_alike;
    }

    /// A run takes the screen, whatever started it and whatever was on the screen.
    fn run_began(&mut self) {
        self.let_go();
        self.shows_map = false;
        self.views[Showing::Running as usize] = super::View::default();
        self.ended = None;
        self.has_driven = false;
        self.page = None;
        self.notice = None;
        self.dismissed = None;
    }

    /// How a run ended is shown once, and a fault until a person has acknowledged it.
    fn run_is_over(&mut self, was_running: bool) {
        let Some(status) = &self.seen.status else { return };
        let is_fault = status.state == State::Fault;
        let ended = match (&status.last, &status.robot) {
            (Some(last), _) if is_fault || was_running => last.clone(),
            // Why a brick cannot start a run is shown in the same form as how one ended.
            (_, Some(finding)) if is_fault => {
                LastStop::new(None, "", StopReason::Robot.with(finding.clone()))
            }
            _ => {
                // A fault that was acknowledged elsewhere.
                if !is_fault && self.ended.as_ref().is_some_and(|ended| !ended.is_wanted()) {
                    self.ended = None;
                    self.changed = true;
                }
                return;
            }
        };
        if self.dismissed.as_ref() != Some(&ended.stop) && self.ended.as_ref() != Some(&ended) {
            self.ended = Some(ended);
            self.views[Showing::Ended as usize] = super::View::default();
            self.changed = true;
        }
    }

    /// The part of the recording that is wanted next for the map on the screen.
    pub(super) fn next_part(&mut self) -> Option<Fetch> {
        let run = self.mapped_run()?;
        if self.track.as_ref().is_none_or(|track| track.run != run) {
            self.track = Some(Track::of(run.clone()));
        }
        let offset = self.track.as_ref()?.wanted();
        Some(Fetch::part(&run, offset, PART_BYTES))
    }

    /// Whether more of the map on the screen can come.
    pub(super) fn wants_part(&self) -> bool {
        let run = self.mapped_run();
        let is_done = |track: &Track| {
            Some(&track.run) == run.as_ref() && (track.complete || track.trouble.is_some())
        };
        run.is_some() && !self.track.as_ref().is_some_and(is_done)
    }

    fn fetched(&mut self, asked: &Fetch, answer: Answer) -> Option<()> {
        let bytes = answer.bytes.unwrap_or_default();
        let fetched: Fetched = serde_json::from_value(answer.value).ok()?;
        let shows_it = self.mapped_run().is_some_and(|run| run == asked.run);
        // A map that is no longer on the screen: its part came late.
        let track = self
            .track
            .as_mut()
            .filter(|track| track.run == asked.run && track.wanted() == asked.offset);
        let Some(track) = track else { return Some(()) };
        let end = asked.offset + bytes.len() as u64;
        let changed = track.take(&bytes);
        if end < fetched.total {
            // There is more already.
            self.asks.refresh(Look::Map, self.now_ns);
        } else if fetched.complete && !track.complete {
            track.complete = true;
            self.changed |= shows_it;
        }
        self.changed |= changed && shows_it;
        Some(())
    }

    /// Nothing is pending of what was on the screen: motors that were jogged stop.
    pub(super) fn let_go(&mut self) {
        let jogged = self.held.take().and_then(|held| held.jogs);
        if let Some(port) = jogged {
            self.asks.order(LocalOnly::Jog { port, percent: 0 });
        }
    }
}

fn read<T: DeserializeOwned>(answer: Answer) -> Option<T> {
    serde_json::from_value(answer.value).ok()
}

fn note<T: PartialEq>(place: &mut Option<T>, value: T, changed: &mut bool) {
    if place.as_ref() != Some(&value) {
        *place = Some(value);
        *changed = true;
    }
}

/// Whether two answers look the same on every page: token and age are on none, and the clock of a
/// run counts whole seconds.
fn alike(before: &Status, now: &Status) -> bool {
    let mut before = before.clone();
    before.token.clone_from(&now.token);
    before.state_s = now.state_s;
    before.disk = now.disk;
    if let (Some(before), Some(now)) = (
        before.run.as_mut().and_then(|run| run.progress.as_mut()),
        now.run.as_ref().and_then(|run| run.progress.as_ref()),
    ) {
        before.tick = now.tick;
        before.overruns = now.overruns;
        before.latest_ns = now.latest_ns;
        before.time_ns = now.time_ns;
        if before.elapsed_ns / SECOND_NS == now.elapsed_ns / SECOND_NS {
            before.elapsed_ns = now.elapsed_ns;
        }
    }
    before == *now
}
