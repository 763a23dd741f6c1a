//! Why a run ended, as it travels: in events, in answers over the network, in recordings. The text
//! is made where it is shown.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::senses::Channel;

/// A tick this late ends the run, nanoseconds.
pub const STALL_NS: i64 = 200_000_000;

/// Why a run ended, or why none can start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, thiserror::Error)]
#[serde(tag = "word", content = "channel", rename_all = "snake_case")]
#[non_exhaustive]
pub enum StopReason {
    /// The mission came to its end.
    #[error("the mission is finished")]
    Finished,
    /// The mission's time is over.
    #[serde(rename = "time limit")]
    #[error("the mission's time limit")]
    TimeLimit,
    /// Enter or Back was pressed on the brick.
    #[error("stopped by a button on the brick")]
    Button,
    /// A PC asked for it over the network.
    #[error("stopped over the network")]
    Remote,
    /// A person in the brick's menu, or a program on the brick, asked for it.
    #[error("stopped on the brick")]
    Here,
    /// A person at a run's page in a browser.
    #[error("stopped on the page")]
    Page,
    /// The menu on the brick is gone, and runs were to end with it.
    #[serde(rename = "menu closed")]
    #[error("the brick's menu is gone")]
    MenuClosed,
    /// A signal that ends or suspends a program, at one of the run's processes.
    #[error("stopped by a signal")]
    Signal,
    /// The process that started the run is gone, or hangs.
    #[error("the process that started the run is gone, or hangs")]
    Abandoned,
    /// Another program has commanded or reset a motor of ours.
    #[error("stopped from outside: another program commands the {0}")]
    Outside(Channel),
    /// A device is gone, or cannot be read any more.
    #[error("lost: {0} (a plug may be loose)")]
    Lost(Channel),
    /// The brick's files are gone, all of them.
    #[error("the brick's files are gone: onbrick sim, or what else had mounted them, has ended")]
    Unmounted,
    /// A reading cannot be true: it stands still although what it measures moves (a gyro while the
    /// wheels turn the robot by 60°, a range while the robot drives 0.2 m along its beam, a head's
    /// angle for a second while it is told to turn), or leaps about.
    #[error("implausible: {0} ({how})", how = how_implausible(*.0))]
    Implausible(Channel),
    /// A wheel that was told to turn did not.
    #[error("a wheel is blocked")]
    Stalled,
    /// The battery is too low to go on.
    #[error("the battery is empty: charge it, or put in fresh cells")]
    Battery,
    /// The loop was away for longer than [`STALL_NS`].
    #[error("the loop stood still for more than {} ms", STALL_NS / 1_000_000)]
    Late,
    /// The recording cannot be written.
    #[error("the recording cannot be written")]
    Recording,
    /// The process that drives was gone or hung, and the guard stopped the motors.
    #[error("the guard stopped the motors")]
    Guard,
    /// The guard was gone or hung, and the process that drives stopped the motors.
    #[error("the run's guard is gone, or has given no sign of life for 0.2 s")]
    Unguarded,
    /// A simulated robot drove over the floor's edge. A real one's program does not learn of it.
    #[error("the simulated robot fell over the edge of the floor")]
    Fallen,
    /// The program itself failed.
    #[error("the program failed; please report it")]
    Panicked,
    /// It is no run on a robot: recorded senses were replayed to their end.
    #[error("replayed")]
    Replayed,
    /// It did not start.
    #[error("it did not start")]
    Refused,
    /// Its first process ended without a last word.
    #[error("its process ended without a word")]
    Died,
    /// Its recording has no end.
    #[default]
    #[error("its recording was cut: the power, the disk or the program failed")]
    Cut,
    /// No run can start: the robot's file is not in order.
    #[error("the robot's file is not in order")]
    Robot,
    /// No run can start: the disk does not take recordings.
    #[error("the disk does not take recordings")]
    Disk,
    /// A word of another version of this program.
    #[serde(other)]
    #[error("it ended for a reason that this version does not know")]
    Unknown,
}

impl StopReason {
    /// A word for lists and programs: the one that it is serialized by.
    #[must_use]
    pub fn word(self) -> String {
        let fields = serde_json::to_value(self).unwrap_or_default();
        fields["word"].as_str().unwrap_or_default().to_owned()
    }

    /// True where the run ended as the mission or a person wanted it.
    #[must_use]
    pub const fn is_wanted(self) -> bool {
        matches!(
            self,
            Self::Finished
                | Self::TimeLimit
                | Self::Button
                | Self::Remote
                | Self::Here
                | Self::Page
                | Self::MenuClosed
                | Self::Signal
        )
    }

    /// True where nothing stopped the run before its end.
    #[must_use]
    pub const fn is_complete(self) -> bool {
        matches!(self, Self::Finished | Self::TimeLimit)
    }

    /// True where something happened to the robot: the mission's state and the place say more.
    #[must_use]
    pub const fn has_a_place(self) -> bool {
        matches!(self, Self::Stalled | Self::Lost(_) | Self::Implausible(_) | Self::Fallen)
    }

    /// The same, with what else is known of it.
    #[must_use]
    pub fn with(self, detail: impl Into<Option<String>>) -> Stop {
        Stop { reason: self, detail: detail.into() }
    }
}

/// What a person should look at.
fn how_implausible(channel: Channel) -> &'static str {
    match channel {
        Channel::Gyro => {
            "it does not turn with the wheels, or leaps about: a plug may be loose, \
             the left and right wheel's plugs exchanged, or the wheels turn in vain"
        }
        Channel::Range => {
            "it says the same while the robot drives: a plug may be loose, \
             or the wheels turn in vain"
        }
        _ => {
            "it does not turn as it is told, or its angle leaps about: a plug may be loose, \
             or something blocks it"
        }
    }
}

/// A reason, and what else is known: the device's error, which program, what to do.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Stop {
    /// Why.
    #[serde(flatten)]
    pub reason: StopReason,
    /// For people. It may have lines of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detail: Option<String>,
}

impl Stop {
    /// Adds to what is known.
    pub fn add(&mut self, detail: &str) {
        self.detail = Some(match self.detail.take() {
            Some(known) => format!("{known}; {detail}"),
            None => detail.to_owned(),
        });
    }
}

impl From<StopReason> for Stop {
    fn from(reason: StopReason) -> Self {
        reason.with(None)
    }
}

impl fmt::Display for Stop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.reason, &self.detail) {
            (reason, None) => reason.fmt(f),
            // The detail is all that a person needs.
            (
                StopReason::Refused | StopReason::Died | StopReason::Robot | StopReason::Disk,
                Some(detail),
            ) => f.write_str(detail),
            (reason, Some(detail)) => write!(f, "{reason}: {detail}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reason_travels_with_its_channel_and_detail() {
        let lost = StopReason::Lost(Channel::Gyro).with("ENODEV".to_owned());
        let text = serde_json::to_string(&lost).unwrap();
        assert_eq!(text, r#"{"word":"lost","channel":"gyro","detail":"ENODEV"}"#);
        assert_eq!(serde_json::from_str::<Stop>(&text).unwrap(), lost);
        assert_eq!(lost.to_string(), "lost: gyro (a plug may be loose): ENODEV");
        let plain = serde_json::to_string(&Stop::from(StopReason::TimeLimit)).unwrap();
        assert_eq!(plain, r#"{"word":"time limit"}"#);
        assert_eq!(StopReason::TimeLimit.word(), "time limit");
    }

    #[test]
    fn a_word_of_another_version_is_read_as_unknown() {
        for text in [r#"{"word":"abducted"}"#, r#"{"word":"abducted","detail":"x"}"#] {
            let stop = serde_json::from_str::<Stop>(text).unwrap();
            assert_eq!(
                (stop.reason, stop.reason.is_wanted()),
                (StopReason::Unknown, false),
                "{text}"
            );
        }
    }

    #[test]
    fn a_detail_that_says_all_stands_alone() {
        let mut refused = StopReason::Refused.with("the robot is taken".to_owned());
        refused.add("onbrick halt");
        assert_eq!(refused.to_string(), "the robot is taken; onbrick halt");
    }
}
