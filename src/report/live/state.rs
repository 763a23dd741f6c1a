//! What the live page is sent: one form, each part of which is there where its source is.

use std::collections::VecDeque;

use serde::Serialize;
use serde_json::{Map, Value, json};

use super::{Sources, Wish};
use crate::clock::{PacedClock, seconds};
use crate::mapping::Pose;
use crate::printable;
use crate::recording::{Followed, Grid, Run, Status, StopReason};
use crate::report::thinned;
use crate::runtime::Event;
use crate::senses::{QUANTITIES, Senses};
use crate::sim::{Room, Simulation};
use crate::units::{degrees, rounded_to, wrap_rad};

/// A map's cell counts as occupied from here on, percent: as map servers of ROS have it.
const OCCUPIED_PCT: i8 = 65;

/// The most places of the path ahead of the recording that are kept: more than come in a sync.
const MOST_AHEAD: usize = 64;

/// The paces that a person can choose: the word that is posted, and how many times faster than on
/// the wall.
const PACES: [(&str, Option<f64>); 3] = [("1", Some(1.0)), ("4", Some(4.0)), ("max", None)];

/// How far a run is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Phase {
    /// The robot is made ready.
    Preparing,
    /// It drives.
    Driving,
    /// The run ended as the mission or a person wanted it.
    Ended,
    /// It ended for another reason.
    Failed,
    /// It did not start.
    Refused,
}

impl Phase {
    fn of_end(reason: StopReason) -> Self {
        if reason.is_wanted() { Self::Ended } else { Self::Failed }
    }

    fn is_over(self) -> bool {
        !matches!(self, Self::Preparing | Self::Driving)
    }
}

/// One thing after another that the page shows: with each run that is started, the next.
#[derive(Debug, Default)]
pub(super) struct Session {
    number: u64,
    sources: Sources,
    followed: Option<Followed>,
    /// What the run itself said last, which is newer than its recording.
    told: Option<Status>,
    /// Where the robot was by what the run said, while its recording has not come so far.
    ahead: VecDeque<(i64, Pose)>,
    /// What the run itself said of how far it is; none where only its recording is known.
    phase: Option<Phase>,
    note: String,
    pub(super) granted: Vec<Wish>,
}

/// How much of a session a page has got.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Cursor {
    session: u64,
    room: u64,
    marks: u64,
    poses: u64,
    points: u64,
    transitions: u64,
    map_ns: u64,
}

impl Cursor {
    /// `since=1.1.20.0.0.0.0`; what is none is the beginning.
    pub(super) fn of(query: &str) -> Self {
        Self::parse(query.strip_prefix("since=").unwrap_or_default())
    }

    pub(super) fn parse(text: &str) -> Self {
        let numbers = text.split('.');
        let numbers: Vec<u64> = numbers.filter_map(|number| number.parse().ok()).collect();
        match numbers.as_slice() {
            &[session, room, marks, poses, points, transitions, map_ns] => {
                Self { session, room, marks, poses, points, transitions, map_ns }
            }
            _ => Self::default(),
        }
    }

    fn text(self) -> String {
        let Self { session, room, marks, poses, points, transitions, map_ns } = self;
        let numbers = [session, room, marks, poses, points, transitions, map_ns];
        numbers.map(|number| number.to_string()).join(".")
    }
}

/// What of a list a page has not got; notes how much it has then.
fn fresh<'l, T>(list: &'l [T], has: &mut u64) -> &'l [T] {
    let from = usize::try_from(*has).unwrap_or(usize::MAX);
    *has = list.len() as u64;
    list.get(from..).unwrap_or_default()
}

impl Session {
    /// The session after this one.
    pub(super) fn next(&self, sources: Sources) -> Self {
        Self {
            number: self.number + 1,
            followed: sources.recording.clone().map(Followed::of),
            sources,
            granted: self.granted.clone(),
            ..Self::default()
        }
    }

    pub(super) fn clock(&self) -> Option<&PacedClock> {
        self.sources.clock.as_deref()
    }

    pub(super) fn simulation(&self) -> Option<&Simulation> {
        self.sources.simulation.as_ref()
    }

    pub(super) fn enter(&mut self, phase: Phase, note: &str) {
        (self.phase, self.note) = (Some(phase), note.to_owned());
    }

    pub(super) fn hear(&mut self, event: &Event) {
        match event {
            Event::Preparing { what } => self.enter(Phase::Preparing, what),
            Event::Driving { .. } => self.enter(Phase::Driving, ""),
            Event::Status(status) => self.hear_status(status),
            Event::Stopped { stop, .. } => {
                self.enter(Phase::of_end(stop.reason), &stop.to_string());
            }
            Event::Refused { stop, .. } => self.enter(Phase::Refused, &stop.to_string()),
            Event::Ended(ended) => {
                let note = format!(
                    "{}, after {:.1} s and {:.2} m\nrecorded in {}",
                    ended.stop,
                    ended.time_s,
                    ended.travelled_m,
                    ended.file.display()
                );
                let not_whole = ended.recording.as_ref();
                let not_whole = not_whole.map(|why| format!("\nthe recording is not whole: {why}"));
                let phase = Phase::of_end(ended.stop.reason);
                self.enter(phase, &(note + &not_whole.unwrap_or_default()));
            }
        }
    }

    pub(super) fn hear_status(&mut self, status: &Status) {
        if self.ahead.len() == MOST_AHEAD {
            self.ahead.pop_front();
        }
        self.ahead.push_back((status.time_ns, status.pose));
        self.told = Some(status.clone());
    }

    /// The simulation, where it takes orders now.
    pub(super) fn ordered(&self) -> Result<&Simulation, String> {
        match self.simulation() {
            None => Err("there is no simulation here".to_owned()),
            Some(_) if self.phase().is_some_and(Phase::is_over) => {
                Err("the run is over; start it again".to_owned())
            }
            Some(simulation) => Ok(simulation),
        }
    }

    /// The wishes that can be granted now.
    pub(super) fn wishes(&self) -> impl Iterator<Item = Wish> {
        let is_over = self.phase().is_some_and(Phase::is_over);
        self.granted.iter().copied().filter(move |wish| *wish != Wish::Stop || !is_over)
    }

    /// Sets the pace by its word.
    pub(super) fn set_pace(&self, word: &str) -> Result<(), String> {
        let clock = self.clock().ok_or("time here has no pace of its own")?;
        let named = PACES.iter().find(|(name, _)| *name == word);
        let (_, pace) = named.ok_or_else(|| {
            let words: Vec<&str> = PACES.iter().map(|(name, _)| *name).collect();
            format!("a pace is one of {}", words.join(", "))
        })?;
        clock.set_pace(*pace);
        Ok(())
    }

    fn phase(&self) -> Option<Phase> {
        let by_recording = || {
            let followed = self.followed.as_ref()?;
            let ending = followed.run().ending.as_ref();
            ending
                .map(|ending| Phase::of_end(ending.stop.reason))
                .or(followed.status().map(|_| Phase::Driving))
        };
        self.phase.or_else(by_recording)
    }

    /// Reads on in the recording; what a page that says so has got of this session.
    fn look(&mut self, since: Cursor) -> Cursor {
        if let Some(followed) = &mut self.followed {
            // What cannot be read is not shown; the run's own process says what is wrong with it.
            let _ = followed.look();
        }
        let known = if since.session == self.number { since } else { Cursor::default() };
        Cursor { session: self.number, ..known }
    }

    /// Everything that a page has not got, as JSON.
    pub(super) fn state(&mut self, since: Cursor) -> String {
        let known = self.look(since);
        let mut next = known;
        let mut state = Map::new();
        let mut put = |name: &str, value: Value| state.insert(name.to_owned(), value);
        put("session", json!(self.number));
        put("title", json!(self.sources.title));
        put("can", json!(self.can()));
        if known.room == 0
            && let Some(room) = self.room()
        {
            next.room = 1;
            put("room", json!(room));
        }
        if let Some(view) = self.simulation().and_then(|simulation| simulation.view(known.marks)) {
            next.marks = view.next;
            put("sim", json!(view));
        }
        if let Some(clock) = self.clock() {
            let pace = PACES.iter().find(|(_, pace)| *pace == clock.pace());
            put("pace", json!(pace.map(|(name, _)| name)));
            put("paces", json!(PACES.map(|(name, _)| name)));
        }
        if self.followed.is_some() || self.phase.is_some() {
            put("run", self.run(&mut next));
        }
        put("next", json!(next.text()));
        printable::json(&Value::Object(state).to_string()).into_owned()
    }

    /// What a small picture of the run has not got: the path and the points, and where the robot is
    /// by now.
    pub(super) fn glimpse(&mut self, since: Cursor) -> Value {
        let mut next = self.look(since);
        let (path, points, ahead) = match &self.followed {
            Some(followed) => {
                let run = followed.run();
                (path(run, &mut next.poses), points(run, &mut next.points), self.ahead(run))
            }
            None => Default::default(),
        };
        json!({
            "session": self.number, "path": path, "points": points, "ahead": ahead,
            "next": next.text(),
        })
    }

    /// Where the robot was by what the run said, as far as the recording has not come yet: x and y
    /// in turn.
    fn ahead(&self, run: &Run) -> Vec<f64> {
        let recorded_ns = run.poses.last().map_or(i64::MIN, |pose| pose.time_ns);
        let is_ahead = |(time_ns, pose): &&(i64, Pose)| *time_ns > recorded_ns && pose.is_finite();
        let ahead = self.ahead.iter().filter(is_ahead);
        ahead.flat_map(|(_, pose)| [pose.x_m, pose.y_m]).map(|m| rounded_to(m, 1e3)).collect()
    }

    /// What may be done at the page now.
    fn can(&self) -> Vec<&'static str> {
        let orders = self.ordered().map(|_| "order");
        let pace = self.clock().map(|_| "pace");
        orders.into_iter().chain(pace).chain(self.wishes().map(Wish::word)).collect()
    }

    /// The simulation's room, or that of the world in the recording.
    fn room(&self) -> Option<Room> {
        let recorded = || Some(Room::of(&self.followed.as_ref()?.run().world()?));
        self.simulation().and_then(Simulation::room).or_else(recorded)
    }

    /// How the run is going: by what it said last, or by its recording.
    fn run(&self, next: &mut Cursor) -> Value {
        let recorded = self.followed.as_ref().and_then(Followed::status);
        let newest = [self.told.as_ref(), recorded].into_iter().flatten();
        let status = newest.max_by_key(|status| status.time_ns);
        let mut run = json!({
            "phase": self.phase(),
            "note": self.note,
            "status": status.map(shown),
        });
        if let (Some(followed), Value::Object(fields)) = (&self.followed, &mut run) {
            let mut put = |name: &str, value: Value| fields.insert(name.to_owned(), value);
            let run = followed.run();
            let since_start_s = |time_ns: i64| {
                let start_ns = run.info.as_ref().map_or(0, |info| info.start_ns);
                rounded_to(seconds(time_ns.saturating_sub(start_ns)), 1e3)
            };
            put("mission", json!(run.info.as_ref().map(|info| &info.mission)));
            put("brick", json!(run.info.as_ref().map(|info| &info.brick)));
            put("path", json!(path(run, &mut next.poses)));
            put("ahead", json!(self.ahead(run)));
            put("points", json!(points(run, &mut next.points)));
            put("senses", run.senses.last().map_or(Value::Null, sensed));
            let entered = fresh(&run.transitions, &mut next.transitions).iter().map(|taken| {
                json!({
                    "time_s": since_start_s(taken.time_ns), "machine": taken.machine,
                    "from": taken.from, "to": taken.to, "why": taken.condition,
                })
            });
            put("entered", entered.collect());
            if let Some((stamp_ns, map)) = followed.map()
                && next.map_ns != stamp_ns.cast_unsigned()
            {
                next.map_ns = stamp_ns.cast_unsigned();
                put("map", occupied(map));
            }
            if let Some(ending) = &run.ending
                && self.note.is_empty()
            {
                put("note", json!(ending.stop.to_string()));
            }
        }
        run
    }
}

/// A status with the units of its names.
fn shown(status: &Status) -> Value {
    json!({
        "elapsed_s": seconds(status.elapsed_ns),
        "x_m": status.pose.x_m,
        "y_m": status.pose.y_m,
        "heading_deg": degrees(wrap_rad(status.pose.heading_rad)),
        "travelled_m": status.travelled_m,
        "points": status.points,
        "states": status.states,
        "said": status.said,
        "variables": status.variables,
        "battery_v": status.battery_v,
        "warning": status.warning,
    })
}

/// What the robot has read last, by what people call it, and as conditions see it: what can be a
/// number in JSON.
fn sensed(senses: &Senses) -> Value {
    let known = QUANTITIES.iter().filter(|quantity| !quantity.name.is_empty());
    let read = known.filter_map(|quantity| {
        let value = quantity.unit.in_conditions(senses.get(quantity.channel)?.value);
        value.is_finite().then(|| json!([quantity.what, quantity.name, rounded_to(value, 1e3)]))
    });
    read.collect()
}

/// The points of the map that a page has not got, x and y in turn.
fn points(run: &Run, has: &mut u64) -> Vec<f64> {
    let points = fresh(&run.points, has).iter();
    let finite = points.filter(|point| point.x_m.is_finite() && point.y_m.is_finite());
    finite.flat_map(|point| [point.x_m, point.y_m]).map(|m| rounded_to(m, 1e3)).collect()
}

/// The places of the path that a page has not got, x and y in turn.
fn path(run: &Run, has: &mut u64) -> Vec<f64> {
    let poses = fresh(&run.poses, has).iter().map(|recorded| recorded.pose);
    let places = poses.filter(Pose::is_finite).map(|pose| [pose.x_m, pose.y_m]);
    let thinned = thinned(places, |place| *place).into_iter();
    thinned.flatten().map(|metres| rounded_to(metres, 1e3)).collect()
}

/// The cells of a map that are occupied: the middle of each, x and y in turn, and a cell's edge.
fn occupied(map: &Grid) -> Value {
    let width = usize::try_from(map.width).unwrap_or(0).max(1);
    let [x_m, y_m] = map.origin_m;
    let middle = |from_m: f64, cells: usize| {
        let cells = u32::try_from(cells).map_or(0.0, f64::from);
        rounded_to(from_m + (cells + 0.5) * map.resolution_m, 1e3)
    };
    let full = (0..).zip(&map.cells).filter(|(_, cell)| **cell >= OCCUPIED_PCT);
    let places =
        full.flat_map(|(at, _): (usize, _)| [middle(x_m, at % width), middle(y_m, at / width)]);
    json!({ "cell_m": map.resolution_m, "places": places.collect::<Vec<f64>>() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cursor_is_read_back_and_what_is_none_is_the_beginning() {
        let cursor = Cursor {
            session: 1,
            room: 1,
            marks: 20,
            poses: 3,
            points: 4,
            transitions: 5,
            map_ns: 6,
        };
        assert_eq!(Cursor::of(&format!("since={}", cursor.text())), cursor);
        for query in ["", "since=", "since=banana", "since=1.2", "since=1.1.1.1.1.1.-1"] {
            assert_eq!(Cursor::of(query), Cursor::default(), "{query}");
        }
    }

    #[test]
    fn a_page_gets_each_part_once_and_after_a_new_session_all_of_it() {
        let mut has = 0;
        assert_eq!(fresh(&[1, 2], &mut has), [1, 2]);
        assert_eq!(fresh(&[1, 2, 3], &mut has), [3]);
        assert!(fresh(&[1], &mut has).is_empty());
        let mut session = Session::default().next(Sources::default());
        session.enter(Phase::Driving, "");
        let state: Value = serde_json::from_str(&session.state(Cursor::default())).unwrap();
        assert_eq!((&state["session"], &state["run"]["phase"]), (&json!(1), &json!("driving")));
        assert_eq!((state.get("room"), state.get("sim"), state.get("pace")), (None, None, None));
    }

    #[test]
    fn a_path_is_as_new_as_what_the_run_says_where_its_recording_lags() {
        let recording = Some("/nowhere/run.mcap".into());
        let mut session = Session::default().next(Sources { recording, ..Sources::default() });
        for at in 1..=100 {
            let x_m = 0.01 * f64::from(at);
            let pose = Pose { x_m, y_m: -x_m, heading_rad: 0.0 };
            let status = Status { time_ns: i64::from(at), pose, ..Status::default() };
            session.hear_status(&status);
        }
        let mut ahead = || {
            let state: Value = serde_json::from_str(&session.state(Cursor::default())).unwrap();
            let ahead = state["run"]["ahead"].as_array().unwrap().clone();
            (ahead.len(), ahead.last().cloned())
        };
        assert_eq!(ahead(), (2 * MOST_AHEAD, Some(json!(-1.0))));
        // It is sent again until the recording has it: the path that came before stays.
        assert_eq!(ahead(), (2 * MOST_AHEAD, Some(json!(-1.0))));
    }

    #[test]
    fn occupied_cells_stand_where_they_are() {
        let map = Grid {
            width: 2,
            height: 2,
            resolution_m: 0.1,
            origin_m: [1.0, -1.0],
            cells: vec![-1, 100, 64, 65],
        };
        let shown = occupied(&map);
        assert_eq!(shown["places"], json!([1.15, -0.95, 1.15, -0.85]));
    }
}
