//! What guard and control know of each other: when the other counts as hung, and what is to be said
//! in its place.
//!
//! The leases stop the motors by themselves 0.3 s after the last renewal; the guard does not trust
//! that. It listens to control's heartbeat. When a beat is missed while the robot drives, or
//! control's pipe closes, it kills control, so that control cannot renew a lease, and stops the
//! run's motors itself ([`still`](crate::robot::still)).
//!
//! ```text
//! preparing ─driving─▶ starting ─beat─▶ driving ─stopped─▶ finishing ─last word─▶ over
//!  no beats             5 s              200 ms             a minute               10 s to be gone
//! ```
//!
//! Control beats for the first time before it commands a motor for the first time: as long as it
//! starts, nothing turns, and a machine that is busy may take its time.
//!
//! Control counts the guard's beats ([`Pulse`]) and ends the run when none comes: a robot without a
//! guard does not drive.
//!
//! # Not here
//!
//! No processes, no pipes and no time: the commands `guard` and `control` have them.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use crate::clock::{MILLISECOND_NS, SECOND_NS, seconds};
use crate::ev3dev::PortAddress;

use super::{Ended, Event, Job, StopReason};
use crate::recording::Status;

/// How long after its last heartbeat guard or control counts as hung, nanoseconds.
pub const MISSED_NS: i64 = 200 * MILLISECOND_NS;

/// How long control may take from the word that it drives to its first beat, nanoseconds: it senses
/// and decides for the first time, and has not commanded a motor yet.
const STARTING_NS: i64 = 5 * SECOND_NS;

/// How long the recording may take to finish after the motors were stopped, nanoseconds: a slow
/// card syncs in seconds.
const FINISHING_NS: i64 = 60 * SECOND_NS;

/// How long a process that has said its last word may take to be gone, nanoseconds.
const LEAVING_NS: i64 = 10 * SECOND_NS;

/// A guard that was woken so late was away, nanoseconds.
const AWAY_NS: i64 = 50 * MILLISECOND_NS;

/// For how long at the most a silence is put down to the machine, nanoseconds.
const MOST_EXCUSED_NS: i64 = 2 * SECOND_NS;

/// How long an absence of the guard may explain a late tick of control, nanoseconds.
const EXPLAINS_NS: i64 = SECOND_NS;

/// No line of control's is longer, bytes; the longest is a refusal with all findings of a file.
const LONGEST_LINE: usize = 4 << 20;

/// How far the run has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// Nothing moves yet, and nothing beats.
    Preparing,
    /// It is about to drive: its first beat comes before anything moves.
    Starting,
    /// It drives and beats.
    Driving,
    /// The motors were stopped.
    Finishing,
    /// The last word is said.
    Over,
}

/// The guard's picture of a run.
#[derive(Debug)]
pub struct Watch {
    phase: Phase,
    /// When control was last heard, where it matters.
    heard_ns: i64,
    motors: Vec<PortAddress>,
    status: Option<Status>,
    file: PathBuf,
    /// When the guard was last away itself, and for how long.
    away: Option<(i64, i64)>,
    /// How much of control's silence was put down to the machine.
    excused_ns: i64,
}

impl Watch {
    /// Nothing was heard yet of this job's run.
    #[must_use]
    pub fn new(job: &Job) -> Self {
        Self {
            phase: Phase::Preparing,
            heard_ns: 0,
            motors: Vec::new(),
            status: None,
            file: job.file.clone(),
            away: None,
            excused_ns: 0,
        }
    }

    /// The guard itself was woken late, by `away_ns`: for so long it could not hear control, nor
    /// could control speak, as on a PC that is busy. Never called on a brick, where nothing may
    /// excuse a silence.
    pub fn excuse(&mut self, away_ns: i64, now_ns: i64) {
        if away_ns < AWAY_NS || self.phase != Phase::Driving {
            return;
        }
        self.away = Some((now_ns, away_ns));
        let excused_ns = away_ns.min(MOST_EXCUSED_NS - self.excused_ns);
        self.excused_ns += excused_ns;
        self.heard_ns += excused_ns;
    }

    /// What to tell people where the machine was too busy for guard and control alike.
    fn too_busy(&self, now_ns: i64) -> Option<String> {
        let (_, away_ns) = self.away.filter(|(at_ns, _)| now_ns - at_ns < EXPLAINS_NS)?;
        Some(format!(
            "this machine was too busy: the guard did not get a processor for {:.2} s either; \
             close other programs, or run onbrick as root, which gives it real-time priority",
            seconds(away_ns)
        ))
    }

    /// Takes in a line of control's, without its end; the event that was in it, which is to be
    /// passed on. An empty line is a heartbeat.
    pub fn hear(&mut self, line: &[u8], now_ns: i64) -> Option<Event> {
        if matches!(self.phase, Phase::Starting | Phase::Driving) {
            self.phase = Phase::Driving;
            self.heard_ns = now_ns;
            self.excused_ns = 0;
        }
        let mut event = serde_json::from_slice::<Event>(line).ok()?;
        if let Event::Stopped { stop, .. } | Event::Ended(Ended { stop, .. }) = &mut event
            && stop.reason == StopReason::Late
            && let Some(busy) = self.too_busy(now_ns)
        {
            stop.add(&busy);
        }
        let phase = match &event {
            Event::Driving { motors, .. } => {
                // An invalid address fits no motor.
                self.motors = motors.iter().filter_map(|motor| motor.parse().ok()).collect();
                Phase::Starting
            }
            Event::Status(status) => {
                self.status = Some(status.clone());
                self.phase
            }
            Event::Preparing { .. } => self.phase,
            Event::Stopped { .. } => Phase::Finishing,
            Event::Refused { .. } | Event::Ended(_) => Phase::Over,
        };
        if phase != self.phase {
            self.phase = phase;
            self.heard_ns = now_ns;
        }
        Some(event)
    }

    /// When control counts as hung unless something is heard before.
    #[must_use]
    pub fn deadline_ns(&self) -> Option<i64> {
        let patience_ns = match self.phase {
            Phase::Preparing => return None,
            Phase::Starting => STARTING_NS,
            Phase::Driving => MISSED_NS,
            Phase::Finishing => FINISHING_NS,
            Phase::Over => LEAVING_NS,
        };
        Some(self.heard_ns + patience_ns)
    }

    /// True where the run has said how it ended.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.phase == Phase::Over
    }

    /// The motors that the run has taken over, by their ports; none before it drives.
    #[must_use]
    pub fn motors(&self) -> &[PortAddress] {
        &self.motors
    }

    /// The message on behalf of a process that ended without a last one.
    ///
    /// - `how`: how it ended, for people.
    /// - `stopped`: every motor of the run is still.
    #[must_use]
    pub fn last_word(&self, how: &str, stopped: bool, now_ns: i64) -> Event {
        if self.phase == Phase::Preparing {
            let hint =
                Some("onbrick doctor, which checks everything and drives nothing".to_owned());
            let message = format!("the process that drives {how} before it drove");
            return Event::Refused { stop: StopReason::Refused.with(message), hint };
        }
        let status = self.status.as_ref();
        let mut stop = StopReason::Guard.with(format!("the process that drives {how}"));
        if let Some(busy) = self.too_busy(now_ns) {
            stop.add(&busy);
        }
        Event::Ended(Ended {
            stop,
            stopped,
            ticks: status.map_or(0, |status| status.tick + 1),
            time_s: status.map_or(0.0, |status| seconds(status.elapsed_ns)),
            travelled_m: status.map_or(0.0, |status| status.travelled_m),
            points: status.map_or(0, |status| status.points),
            overruns: status.map_or(0, |status| status.overruns),
            latest_s: status.map_or(0.0, |status| seconds(status.latest_ns)),
            file: self.file.clone(),
            recording: Some("it was not finished".to_owned()),
        })
    }
}

/// Control's picture of its guard.
#[derive(Debug)]
pub struct Pulse {
    beats: Arc<AtomicU32>,
    heard: u32,
    looked_ns: Option<i64>,
    silent_ns: i64,
}

impl Pulse {
    /// - `beats`: counted by the thread that hears the guard ([`obey`](super::obey)).
    #[must_use]
    pub fn new(beats: Arc<AtomicU32>) -> Self {
        Self { beats, heard: 0, looked_ns: None, silent_ns: 0 }
    }

    /// Looks once in a tick; true where the guard has been silent for [`MISSED_NS`].
    ///
    /// A tick counts for two periods at most: while control itself was suspended it could not hear
    /// the guard.
    pub fn is_silent(&mut self, now_ns: i64, period_ns: i64) -> bool {
        let beats = self.beats.load(Ordering::Relaxed);
        let passed_ns = now_ns - self.looked_ns.replace(now_ns).unwrap_or(now_ns);
        if beats == self.heard {
            self.silent_ns += passed_ns.min(2 * period_ns);
        } else {
            (self.heard, self.silent_ns) = (beats, 0);
        }
        self.silent_ns > MISSED_NS
    }
}

/// Bytes of a pipe, cut into lines.
#[derive(Debug, Default)]
pub struct Lines {
    bytes: Vec<u8>,
}

impl Lines {
    /// Takes in what was read. A line longer than any of ours is dropped.
    pub fn push(&mut self, bytes: &[u8]) {
        if self.bytes.len() > LONGEST_LINE {
            self.bytes.clear();
        }
        self.bytes.extend_from_slice(bytes);
    }

    /// The next whole line, without its end.
    pub fn next_line(&mut self) -> Option<Vec<u8>> {
        let end = self.bytes.iter().position(|&byte| byte == b'\n')?;
        let mut line: Vec<u8> = self.bytes.drain(..=end).collect();
        line.pop();
        Some(line)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::Pose;
    use crate::runtime::{Brick, Lock, Source, WhenAbandoned};

    fn watch() -> Watch {
        let source = |name: &str| Source { name: name.to_owned(), text: String::new() };
        Watch::new(&Job {
            mission: source("mission.toml"),
            robot: source("robot.toml"),
            brick: Brick::Local(crate::ev3dev::LocalTree::new("/")),
            start: Pose::default(),
            set: Vec::new(),
            file: "run.mcap".into(),
            sync_ns: SECOND_NS,
            stamps_ns: 0,
            run: None,
            name: None,
            no_button: false,
            method: crate::mapping::Method::Default,
            when_abandoned: WhenAbandoned::Stop,
            lock: Lock::Take,
        })
    }

    fn line(event: &Event) -> Vec<u8> {
        serde_json::to_vec(event).unwrap()
    }

    fn driving() -> Event {
        let motors = ["ev3-ports:outB", "ev3-ports:outD", ""].map(str::to_owned).to_vec();
        Event::Driving { file: "run.mcap".into(), motors }
    }

    fn stopped() -> Event {
        Event::Stopped { stop: StopReason::Button.into(), stopped: true }
    }

    #[test]
    fn only_a_run_that_drives_must_beat() {
        let mut watch = watch();
        assert_eq!(watch.deadline_ns(), None, "preparing waits for people");
        assert_eq!(watch.hear(b"", 1), None);
        assert_eq!(watch.deadline_ns(), None);
        assert_eq!(watch.hear(&line(&driving()), 10), Some(driving()));
        assert_eq!(watch.deadline_ns(), Some(10 + STARTING_NS), "nothing was commanded yet");
        watch.hear(b"", 20);
        assert_eq!(watch.deadline_ns(), Some(20 + MISSED_NS), "from the first beat on");
        watch.hear(b"", 30);
        assert_eq!(watch.deadline_ns(), Some(30 + MISSED_NS), "a beat");
        watch.hear(b"garbage", 40);
        assert_eq!(watch.deadline_ns(), Some(40 + MISSED_NS), "any message counts as alive");
        watch.hear(&line(&stopped()), 50);
        assert_eq!(watch.deadline_ns(), Some(50 + FINISHING_NS));
        watch.hear(b"", 60);
        assert_eq!(watch.deadline_ns(), Some(50 + FINISHING_NS), "finishing is not made longer");
        assert!(!watch.is_over());
        watch.hear(&line(&watch.last_word("was killed", true, 70)), 70);
        assert!(watch.is_over());
        assert_eq!(watch.deadline_ns(), Some(70 + LEAVING_NS));
    }

    #[test]
    fn what_the_guard_missed_itself_is_the_machines_doing_and_is_said_to_be() {
        let mut watch = watch();
        watch.hear(&line(&driving()), 0);
        watch.excuse(SECOND_NS, 0);
        assert_eq!(watch.deadline_ns(), Some(STARTING_NS), "which is not made longer");
        watch.hear(b"", 0);
        watch.excuse(AWAY_NS - 1, 10);
        assert_eq!(watch.deadline_ns(), Some(MISSED_NS), "every sleeper is woken a little late");
        watch.excuse(SECOND_NS, SECOND_NS);
        assert_eq!(watch.deadline_ns(), Some(SECOND_NS + MISSED_NS));
        watch.excuse(3 * SECOND_NS, 4 * SECOND_NS);
        assert_eq!(watch.deadline_ns(), Some(MOST_EXCUSED_NS + MISSED_NS), "but not for ever");
        let Event::Ended(ended) = watch.last_word("was killed", true, 4 * SECOND_NS) else {
            panic!("it drove")
        };
        assert!(
            ended
                .stop
                .to_string()
                .contains("too busy: the guard did not get a processor for 3.00 s"),
            "{}",
            ended.stop
        );
        let late = Event::Stopped { stop: StopReason::Late.into(), stopped: true };
        for (now_ns, busy) in [(4 * SECOND_NS, true), (5 * SECOND_NS, false)] {
            let Some(Event::Stopped { stop, .. }) = watch.hear(&line(&late), now_ns) else {
                panic!("passed on")
            };
            assert_eq!(stop.to_string().contains("too busy"), busy, "{stop}");
        }
    }

    #[test]
    fn the_motors_are_the_ones_that_the_run_has_named() {
        let mut watch = watch();
        assert_eq!(watch.motors(), []);
        watch.hear(&line(&driving()), 10);
        let motors: Vec<String> = watch.motors().iter().map(ToString::to_string).collect();
        assert_eq!(motors, ["outB", "outD"]);
    }

    #[test]
    fn what_ended_before_it_drove_is_refused_and_afterwards_it_is_the_guards_end() {
        let mut watch = watch();
        let Event::Refused { stop, .. } = watch.last_word("ended (signal: 9)", true, 0) else {
            panic!("nothing moved")
        };
        assert_eq!(stop.to_string(), "the process that drives ended (signal: 9) before it drove");
        watch.hear(&line(&driving()), 10);
        let Event::Ended(ended) = watch.last_word("ended (signal: 9)", false, 20) else {
            panic!("it drove")
        };
        assert_eq!((ended.stop.reason, ended.stopped), (StopReason::Guard, false));
        assert!(ended.stop.to_string().contains("signal: 9"), "{}", ended.stop);
    }

    #[test]
    fn a_guard_is_silent_after_200_ms_in_which_control_could_have_heard_it() {
        const PERIOD_NS: i64 = 20 * MILLISECOND_NS;
        let beats = Arc::new(AtomicU32::new(0));
        let mut pulse = Pulse::new(Arc::clone(&beats));
        let mut now_ns = 0;
        let mut silent_after = |beating: bool, step_ns: i64, looks: u32| {
            (1..=looks).find(|_| {
                now_ns += step_ns;
                beats.fetch_add(u32::from(beating), Ordering::Relaxed);
                pulse.is_silent(now_ns, PERIOD_NS)
            })
        };
        assert_eq!(silent_after(true, PERIOD_NS, 100), None);
        assert_eq!(silent_after(false, PERIOD_NS, 100), Some(11), "11 x 20 ms");
        assert_eq!(silent_after(true, PERIOD_NS, 1), None, "it is back");
        assert_eq!(
            silent_after(false, SECOND_NS, 100),
            Some(6),
            "a look counts for 40 ms at the most"
        );
    }

    #[test]
    fn lines_are_cut_wherever_the_pipe_was_read() {
        let mut lines = Lines::default();
        let mut cut = Vec::new();
        for part in ["\n{\"a\"", ":1}", "\n\n\nb", "\nc"] {
            lines.push(part.as_bytes());
            cut.extend(std::iter::from_fn(|| lines.next_line()));
        }
        assert_eq!(cut, [&b""[..], b"{\"a\":1}", b"", b"", b"b"]);
        (0..3).for_each(|_| lines.push(&vec![b'x'; LONGEST_LINE]));
        lines.push(b"\n");
        assert!(
            lines.next_line().unwrap().len() <= 2 * LONGEST_LINE,
            "what has no end is forgotten"
        );
    }
}
