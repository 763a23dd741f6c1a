//! A run on a brick, watched beside its fetch: how it is going, and what the brick's clock says.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use super::remote::Asking;
use crate::clock::{Clock as _, MonotonicClock, SECOND_NS, nanoseconds, seconds, wall_ns};
use crate::link::KnownBrick;
use crate::protocol::{RunId, State, Status};
use crate::threads::lock;
use crate::units::counted;

/// How often the brick is asked, nanoseconds.
const PACE_NS: i64 = SECOND_NS;

/// A run cannot have driven for longer than the brick has been driving. If it has, by more than
/// this many seconds, the service was restarted meanwhile and counts from there.
const MOST_AHEAD_S: f64 = 0.1;

/// A run that is watched.
#[derive(Debug)]
pub(super) struct Watch {
    /// Which run.
    pub(super) run: RunId,
    seen: Mutex<Seen>,
    over: AtomicBool,
}

#[derive(Debug, Default)]
struct Seen {
    /// A status has arrived at all.
    looked: bool,
    status: Option<Status>,
    began: Option<Began>,
}

/// When a run began to drive, by this PC's calendar.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Began {
    /// Nanoseconds since 1970.
    pub(super) at_ns: i64,
    /// It was at most this much earlier or later, nanoseconds.
    pub(super) within_ns: i64,
}

impl Began {
    /// From an answer: the brick said at some moment between question and answer for how long it
    /// had been driving.
    fn of(status: &Status, run: &RunId, asked_ns: i64, answered_ns: i64) -> Option<Self> {
        let going = status.run.as_ref().filter(|going| going.run == *run)?;
        let driven_s = going.progress.as_ref().map_or(0.0, |progress| seconds(progress.elapsed_ns));
        if status.state != State::Running || driven_s > status.state_s + MOST_AHEAD_S {
            return None;
        }
        let within_ns = answered_ns.saturating_sub(asked_ns) / 2;
        let at_ns =
            answered_ns.saturating_sub(within_ns).saturating_sub(nanoseconds(status.state_s));
        Some(Self { at_ns, within_ns })
    }
}

impl Watch {
    /// This run is to be watched.
    pub(super) fn of(run: &RunId) -> Self {
        Self { run: run.clone(), seen: Mutex::default(), over: AtomicBool::new(false) }
    }

    /// Polls until [`Watch::end`] or an interrupt.
    pub(super) fn look(&self, asking: &Asking, brick: &KnownBrick) {
        let Ok(mut client) = asking.client(brick) else { return };
        let is_over =
            || self.over.load(Ordering::Relaxed) || asking.interrupted().load(Ordering::Relaxed);
        while !is_over() {
            let asked_ns = MonotonicClock.now_ns();
            let status = client.status().ok();
            let answered_ns = MonotonicClock.now_ns();
            // The calendar is read once, so that it cannot jump between question and answer.
            let wall_ns = wall_ns();
            self.note(
                status,
                wall_ns.saturating_sub(answered_ns.saturating_sub(asked_ns)),
                wall_ns,
            );
            MonotonicClock.wait_for(PACE_NS, PACE_NS / 10, &is_over);
        }
    }

    fn note(&self, status: Option<Status>, asked_ns: i64, answered_ns: i64) {
        let began =
            status.as_ref().and_then(|status| Began::of(status, &self.run, asked_ns, answered_ns));
        let mut seen = lock(&self.seen);
        (seen.status, seen.looked) = (status, true);
        // The quickest answer says it best.
        seen.began = [seen.began, began].into_iter().flatten().min_by_key(|began| began.within_ns);
    }

    /// The caller asks no more.
    pub(super) fn end(&self) {
        self.over.store(true, Ordering::Relaxed);
    }

    /// How the brick was last; nothing where it did not answer.
    pub(super) fn status(&self) -> Option<Status> {
        lock(&self.seen).status.clone()
    }

    /// How the run is going, where the brick tells that.
    pub(super) fn progress(&self) -> Option<crate::recording::Status> {
        self.status()?.run.filter(|going| going.run == self.run)?.progress
    }

    /// When the run began to drive, where that was seen.
    pub(super) fn began(&self) -> Option<Began> {
        lock(&self.seen).began
    }

    /// How much of the mission's time is over, in thousandths; all of it where the run is over.
    pub(super) fn thousandths(&self) -> u64 {
        let Some(status) = self.status() else { return 0 };
        let Some(going) = status.run.filter(|going| going.run == self.run) else { return 1000 };
        let elapsed_ns = going.progress.map_or(0, |progress| progress.elapsed_ns);
        let limit_ms = (nanoseconds(going.time_limit_s) / 1_000_000).max(1);
        u64::try_from(elapsed_ns / 1000 / limit_ms).unwrap_or(0).min(1000)
    }

    /// State, metres, points, battery.
    pub(super) fn line(&self) -> String {
        let Some(status) = self.status() else {
            let looked = lock(&self.seen).looked;
            return if looked { "the brick does not answer" } else { "asked to start" }.to_owned();
        };
        let battery = status.battery_v.map(|volts| format!(", {volts:.1} V")).unwrap_or_default();
        match status.run.as_ref().filter(|going| going.run == self.run) {
            Some(going) => {
                let progress = going.progress.as_ref();
                let (metres, points) = progress.map_or((0.0, 0), |at| (at.travelled_m, at.points));
                let points = counted(points, "point");
                format!("{}: {metres:.1} m, {points}{battery}", status.state)
            }
            None => format!("{}{battery}", status.state),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn running(state_s: f64, elapsed_s: Option<f64>) -> Status {
        let progress = elapsed_s.map(|elapsed_s| {
            serde_json::json!({
                "tick": 1, "time_ns": 0, "elapsed_ns": nanoseconds(elapsed_s), "travelled_m": 0.0,
                "points": 0, "states": [],
                "pose": { "x_m": 0.0, "y_m": 0.0, "heading_rad": 0.0 }, "battery_v": null,
                "overruns": 0, "latest_ns": 0, "dropped": 0,
            })
        });
        serde_json::from_value(serde_json::json!({
            "brick": "b", "version": "0", "protocol": 1, "state": "running", "state_s": state_s,
            "last": null, "battery_v": null,
            "run": { "run": "r", "mission": "map", "time_limit_s": 9.0, "by": "pc", "waits": null,
                "progress": progress },
            "token": "t", "link": "ready", "disk": { "used": 0, "quota": 0, "free": 0 },
            "robot": null,
        }))
        .unwrap()
    }

    #[test]
    fn the_quickest_answer_says_when_a_run_began() {
        let run = RunId::new("r").unwrap();
        let watch = Watch::of(&run);
        assert_eq!(watch.began(), None);
        watch.note(Some(running(1.0, Some(0.9))), 10 * SECOND_NS, 10 * SECOND_NS + 40);
        assert_eq!(watch.began(), Some(Began { at_ns: 9 * SECOND_NS + 20, within_ns: 20 }));
        watch.note(Some(running(2.0, Some(1.9))), 11 * SECOND_NS, 11 * SECOND_NS + 10);
        watch.note(None, 0, 0);
        let best = Some(Began { at_ns: 9 * SECOND_NS + 5, within_ns: 5 });
        assert_eq!(watch.began(), best);
        // A restarted service, another run, a run that does not drive yet: none of them says
        // anything about the clock.
        watch.note(Some(running(0.5, Some(3.0))), 12 * SECOND_NS, 12 * SECOND_NS + 2);
        watch.note(Some(Status { state: State::Preparing, ..running(0.5, None) }), 0, 2);
        assert_eq!(watch.began(), best);
        assert_eq!(Began::of(&running(1.0, None), &RunId::new("other").unwrap(), 0, 2), None);
    }
}
