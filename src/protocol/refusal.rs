//! Why a brick does not do what it was asked.

use serde::{Deserialize, Serialize};

use super::VERSION;

/// Why something was not done.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[error("{message}")]
pub struct Refusal {
    /// For programs.
    pub kind: Kind,
    /// For people: what, and where.
    pub message: String,
    /// The way out, where the message does not say it.
    pub hint: Option<String>,
}

impl Refusal {
    /// A refusal without a hint.
    pub fn new(kind: Kind, message: impl Into<String>) -> Self {
        Self { kind, message: message.into(), hint: None }
    }

    /// It was tried, and failed.
    pub fn failed(message: impl Into<String>) -> Self {
        Self::new(Kind::Failed, message)
    }

    /// The request makes no sense.
    pub fn bad_request(message: impl Into<String>) -> Self {
        Self::new(Kind::BadRequest, message)
    }

    /// Of a request in another version of the protocol: who is older, and what to do.
    pub fn of_version(asked: u32) -> Self {
        let (this, program) = (VERSION, env!("CARGO_PKG_VERSION"));
        let (older, way_out) = if asked > this {
            (
                "was asked is older than what asks it",
                "the newer package on the brick: \
             brick-image/install.sh; on a PC, start its service again",
            )
        } else {
            ("was asked is newer than what asks it", "the newer onbrick where this was asked")
        };
        let message = format!(
            "the onbrick that {older}: {program} understands version {this} of the protocol, \
             and was asked in version {asked}"
        );
        Self::new(Kind::Version, message).hint(way_out)
    }

    /// With a way out.
    #[must_use]
    pub fn hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = Some(hint.into());
        self
    }
}

/// Why something was not done, for programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Not JSON, not an object, a field that is missing or wrong.
    BadRequest,
    /// Another version of the protocol.
    Version,
    /// No such operation here; the message lists those that there are.
    UnknownOperation,
    /// The key is not, or no longer, authorised.
    NotAuthorised,
    /// The token is too old, or not of this brick.
    StaleToken,
    /// A stop has come since it was asked for.
    Stopped,
    /// Something runs already, started here or by another program.
    Busy,
    /// The robot is not in order.
    NotReady,
    /// No such mission.
    UnknownMission,
    /// A mission with findings; the message is their text.
    BrokenMission,
    /// No such run.
    UnknownRun,
    /// The offset is beyond the end.
    BeyondEnd,
    /// Too much at once.
    TooMany,
    /// The disk or the quota has no room for a run.
    NoRoom,
    /// It went wrong on the brick.
    Failed,
    /// A kind that this version does not know.
    #[serde(other)]
    Other,
}
