//! The one state of a brick, as a pure machine: what happens goes in with its time, the state comes
//! out.
//!
//! ```text
//!  ready ──start──▶ preparing ──driving──▶ running ──told to stop──▶ stopping ──ended──▶ stopped
//!    ▲                  └───────────── ended, refused ─────────────────────────────────▶ or fault
//!    └── acknowledge ── fault                             start is taken in ready, stopped, fault
//! ```
//!
//! Beside the runs there is *trouble*: something that keeps any run from starting (a robot file
//! that is broken, a disk that cannot be written to). While it lasts, a brick on which nothing runs
//! is in fault.
//!
//! # Not here
//!
//! No processes, no files, no clock: what happens is told by those who see it.

use crate::clock::seconds;
use crate::protocol::{LastStop, RunId, RunStatus, State};
use crate::recording;

/// What happens to a brick.
#[derive(Debug, Clone, PartialEq)]
pub enum Happening {
    /// Its run waits for something before it starts.
    Waits(String),
    /// Its run drives, or drives on: one that a service before this one had started.
    Driving,
    /// How its run is going.
    Progress(recording::Status),
    /// Its run was asked to stop.
    StopAsked,
    /// Its run has told the motors to stop.
    MotorsTold {
        /// Every motor took the command.
        stopped: bool,
    },
    /// Its run is over, or did not even start.
    Ended(LastStop),
    /// A person has seen the fault.
    Acknowledged,
    /// Something keeps any run from starting, or does so no longer.
    Trouble(Option<LastStop>),
}

/// The state, what led to it, and since when.
#[derive(Debug, Clone, PartialEq)]
pub struct Machine {
    state: State,
    since_ns: i64,
    run: Option<RunStatus>,
    motors_told: Option<bool>,
    last: Option<LastStop>,
    trouble: Option<LastStop>,
}

impl Machine {
    /// A brick whose service starts now.
    #[must_use]
    pub fn new(now_ns: i64) -> Self {
        Self {
            state: State::Ready,
            since_ns: now_ns,
            run: None,
            motors_told: None,
            last: None,
            trouble: None,
        }
    }

    /// How the last run before this service ended.
    pub fn recall(&mut self, last: LastStop) {
        self.last = Some(last);
    }

    /// A run begins.
    ///
    /// # Errors
    ///
    /// The run that is going on.
    pub fn start(&mut self, now_ns: i64, run: RunStatus) -> Result<(), RunId> {
        if let Some(running) = &self.run {
            return Err(running.run.clone());
        }
        self.run = Some(run);
        self.motors_told = None;
        self.enter(now_ns, State::Preparing);
        Ok(())
    }

    /// Something happens. What does not fit the state, such as a late word of a run that is over,
    /// changes nothing.
    pub fn happen(&mut self, now_ns: i64, happening: Happening) {
        match happening {
            Happening::Waits(what) => {
                if self.state == State::Preparing
                    && let Some(run) = &mut self.run
                {
                    run.waits = Some(what);
                }
            }
            Happening::Driving => {
                if self.state == State::Preparing {
                    self.run.iter_mut().for_each(|run| run.waits = None);
                    self.enter(now_ns, State::Running);
                }
            }
            Happening::Progress(progress) => {
                self.run.iter_mut().for_each(|run| run.progress = Some(progress.clone()));
            }
            Happening::StopAsked => self.stopping(now_ns),
            Happening::MotorsTold { stopped } => {
                if self.run.is_some() {
                    self.motors_told = Some(stopped);
                    self.stopping(now_ns);
                }
            }
            Happening::Ended(last) => {
                if self.run.take().is_some() {
                    let state = if last.is_wanted() { State::Stopped } else { State::Fault };
                    self.last = Some(last);
                    self.enter(now_ns, state);
                }
            }
            Happening::Acknowledged => {
                if self.run.is_none() && self.state == State::Fault {
                    self.enter(now_ns, State::Ready);
                }
            }
            Happening::Trouble(trouble) => self.note_trouble(now_ns, trouble),
        }
    }

    /// The state.
    #[must_use]
    pub fn state(&self) -> State {
        if self.run.is_none() && self.trouble.is_some() { State::Fault } else { self.state }
    }

    /// How long it has been in this state, seconds.
    #[must_use]
    pub fn state_s(&self, now_ns: i64) -> f64 {
        seconds(now_ns.saturating_sub(self.since_ns).max(0))
    }

    /// The run that is going on.
    #[must_use]
    pub fn run(&self) -> Option<&RunStatus> {
        self.run.as_ref()
    }

    /// Whether the motors of the run that is going on, or of the last, were told to stop; and
    /// whether each took it.
    #[must_use]
    pub fn motors_told(&self) -> Option<bool> {
        self.motors_told
    }

    /// What else keeps the brick from being ready; otherwise how the last run ended.
    #[must_use]
    pub fn last(&self) -> Option<&LastStop> {
        self.trouble.as_ref().filter(|_| self.run.is_none()).or(self.last.as_ref())
    }

    fn stopping(&mut self, now_ns: i64) {
        if matches!(self.state, State::Preparing | State::Running) {
            self.enter(now_ns, State::Stopping);
        }
    }

    fn note_trouble(&mut self, now_ns: i64, trouble: Option<LastStop>) {
        let before = self.state();
        self.trouble = trouble;
        if self.state() != before {
            self.since_ns = now_ns;
        }
    }

    fn enter(&mut self, now_ns: i64, state: State) {
        self.state = state;
        self.since_ns = now_ns;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::SECOND_NS;
    use crate::runtime::StopReason;

    fn run(name: &str) -> RunStatus {
        RunStatus {
            run: RunId::new(name).unwrap(),
            mission: "map".to_owned(),
            time_limit_s: 120.0,
            by: "pc".to_owned(),
            waits: None,
            progress: None,
        }
    }

    fn last(reason: StopReason) -> LastStop {
        LastStop::new(None, "map", reason.into())
    }

    /// What happens second by second, and the state and the last word that follow.
    fn transcript(happenings: Vec<(Option<Happening>, State, &str)>) -> Machine {
        let mut machine = Machine::new(0);
        for (second, (happening, state, word)) in (1..).zip(happenings) {
            let now_ns = second * SECOND_NS;
            let told = format!("{happening:?}");
            match happening {
                Some(happening) => machine.happen(now_ns, happening),
                None => machine.start(now_ns, run("r")).unwrap(),
            }
            let last = machine.last().map(|last| last.stop.reason.word()).unwrap_or_default();
            assert_eq!(
                (machine.state(), last.as_str()),
                (state, word),
                "after {told} at {second} s"
            );
        }
        machine
    }

    #[test]
    fn a_run_goes_from_ready_to_stopped_and_another_can_start() {
        use State::{Preparing, Ready, Running, Stopped, Stopping};
        assert_eq!(Machine::new(0).state(), Ready);
        transcript(vec![
            (None, Preparing, ""),
            (Some(Happening::Waits("hands off".to_owned())), Preparing, ""),
            (Some(Happening::Driving), Running, ""),
            (Some(Happening::StopAsked), Stopping, ""),
            (Some(Happening::MotorsTold { stopped: true }), Stopping, ""),
            (Some(Happening::Ended(last(StopReason::Remote))), Stopped, "remote"),
            (None, Preparing, "remote"),
            (Some(Happening::Driving), Running, "remote"),
            (Some(Happening::MotorsTold { stopped: true }), Stopping, "remote"),
            (Some(Happening::Ended(last(StopReason::Finished))), Stopped, "finished"),
        ]);
    }

    #[test]
    fn a_run_that_ended_unwanted_is_a_fault_until_seen_or_started_anew() {
        use State::{Fault, Preparing, Ready, Running};
        transcript(vec![
            (None, Preparing, ""),
            (Some(Happening::Ended(last(StopReason::Refused))), Fault, "refused"),
            (Some(Happening::Acknowledged), Ready, "refused"),
            (None, Preparing, "refused"),
            (Some(Happening::Driving), Running, "refused"),
            (Some(Happening::Ended(last(StopReason::Guard))), Fault, "guard"),
            (None, Preparing, "guard"),
        ]);
    }

    #[test]
    fn what_comes_late_or_twice_changes_nothing() {
        use State::{Ready, Stopped};
        let mut machine = transcript(vec![
            (Some(Happening::Driving), Ready, ""),
            (Some(Happening::MotorsTold { stopped: true }), Ready, ""),
            (Some(Happening::Ended(last(StopReason::Finished))), Ready, ""),
            (Some(Happening::StopAsked), Ready, ""),
            (Some(Happening::Acknowledged), Ready, ""),
        ]);
        assert_eq!(machine.motors_told(), None);
        machine.start(0, run("a")).unwrap();
        assert_eq!(machine.start(0, run("b")), Err(RunId::new("a").unwrap()));
        machine.happen(0, Happening::Ended(last(StopReason::Button)));
        machine.happen(0, Happening::Driving);
        assert_eq!(machine.state(), Stopped);
    }

    #[test]
    fn trouble_is_a_fault_while_it_lasts_and_nothing_runs() {
        use State::{Fault, Preparing, Ready, Stopped};
        let mut machine = transcript(vec![
            (Some(Happening::Trouble(Some(last(StopReason::Disk)))), Fault, "disk"),
            (Some(Happening::Acknowledged), Fault, "disk"),
            (None, Preparing, ""),
            (Some(Happening::Ended(last(StopReason::Button))), Fault, "disk"),
            (Some(Happening::Trouble(None)), Stopped, "button"),
        ]);
        assert!(
            machine.state_s(6 * SECOND_NS) < 1.5,
            "the state's time starts when the trouble ends"
        );
        machine.happen(0, Happening::Acknowledged);
        assert_ne!(machine.state(), Ready, "only a fault is acknowledged");
    }
}
