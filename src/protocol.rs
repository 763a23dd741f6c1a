//! What is asked of a brick and what it answers: one JSON for the network and for the local socket.
//!
//! A request is one JSON object. `op` names the operation, `id` (a number or a short text, the
//! client's own) comes back with the reply, `version` is [`VERSION`]; the operation's fields stand
//! beside them. Fields that are not known are ignored, so that a newer client can talk to an older
//! brick; operations that are not known are refused with the list of known ones.
//!
//! ```json
//! {"version": 1, "id": 7, "op": "start", "run": "a3f1", "mission": {"name": "map"},
//!  "token": "k2-81734"}
//! {"id": 7, "ok": {"run": "a3f1"}}
//! {"id": 7, "error": {"kind": "stale_token", "message": "the token is 8.2 s old",
//!  "hint": "ask for the status again"}}
//! ```
//!
//! The network offers the operations of [`Request`] and no others; the local socket those of
//! [`LocalRequest`] besides. That they are two types is what keeps a jog or a deletion off the
//! network.
//!
//! # Not here
//!
//! No sockets, no frames: how a request arrives is its transport's matter. What an operation does
//! is the service's.
//!
//! # What we count on
//!
//! - A transport hands over at most [`MAX_REQUEST_BYTES`].

use serde::{Deserialize, Serialize};

mod answers;
mod name;
mod parse;
mod refusal;
mod told;

pub use answers::{
    Disk, Done, Fetched, LastStop, Live, LiveDevice, MissionInfo, Missions, Pairing, RunInfo,
    RunStatus, Runs, Settings, SettingsChange, Started, State, Status, Stopped, whose,
};
pub use name::{Name, NoName};
pub use parse::{NotUnderstood, parse, parse_local};
pub use refusal::{Kind, Refusal};

/// The protocol's version; a request of another one is refused.
pub const VERSION: u32 = 1;

/// The longest request, bytes: a mission's text of the largest size that is taken over the network,
/// in JSON's escapes, and room to spare.
pub const MAX_REQUEST_BYTES: usize = 512 << 10;

/// The longest text of a mission that a `start` may carry, bytes.
pub const MAX_MISSION_BYTES: usize = 64 << 10;

/// The most bytes that one `fetch` brings, through either transport: replies wait in memory for
/// slow clients.
pub const MAX_FETCH_BYTES: u32 = 64 << 10;

/// A token is taken for this long after the status that brought it, nanoseconds of the brick's
/// monotonic clock.
pub const TOKEN_LIFE_NS: i64 = 5_000_000_000;

/// A client's own name for a request; the reply repeats it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Id {
    /// A number.
    Number(u64),
    /// A text, at most 64 bytes.
    Text(String),
}

/// A run's identifier: 1 to 40 letters, digits, `-` and `_`, chosen by the client that starts it.
/// It is a folder's name, so nothing else is taken.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String")]
pub struct RunId(String);

/// A text that is no run's identifier.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("a run's identifier has 1 to {} letters, digits, - and _", RunId::MAX_BYTES)]
pub struct NoRunId;

impl RunId {
    /// The longest identifier.
    pub const MAX_BYTES: usize = 40;

    /// Takes a text as an identifier.
    ///
    /// # Errors
    ///
    /// The text is empty, too long, or has other signs in it.
    pub fn new(text: &str) -> Result<Self, NoRunId> {
        let plain = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_';
        let fits = (1..=Self::MAX_BYTES).contains(&text.len()) && text.bytes().all(plain);
        if fits { Ok(Self(text.to_owned())) } else { Err(NoRunId) }
    }

    /// The identifier of a mission's run: the mission's name, in the letters that an identifier has
    /// and cut where that is needed, and what no other run has.
    ///
    /// # Errors
    ///
    /// `unique` is too long, or has other signs in it.
    pub fn of_mission(mission: &str, unique: &str) -> Result<Self, NoRunId> {
        let room = Self::MAX_BYTES.saturating_sub(unique.len() + 1);
        let plain = |sign: char| if sign.is_ascii_alphanumeric() { sign } else { '-' };
        let name: String = mission.trim().chars().take(room).map(plain).collect();
        Self::new(&format!("{name}-{unique}"))
    }

    /// The text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl TryFrom<String> for RunId {
    type Error = NoRunId;

    fn try_from(text: String) -> Result<Self, NoRunId> {
        Self::new(&text)
    }
}

impl std::fmt::Display for RunId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

/// What may be asked over the network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "op", rename_all = "snake_case")]
pub enum Request {
    /// How the brick is; answered with a [`Status`].
    Status,
    /// Which missions it has; answered with [`Missions`].
    Missions,
    /// Start a run; answered with [`Started`]. A repeat with the same identifier does nothing and
    /// is answered alike.
    Start(Start),
    /// Stop the named run, or whatever runs; answered with [`Stopped`] when the motors have been
    /// told.
    Stop {
        /// Which run; without it whatever runs.
        #[serde(default)]
        run: Option<RunId>,
    },
    /// Which runs are on its disk; answered with [`Runs`].
    Runs,
    /// A part of a run's recording; answered with [`Fetched`] and the bytes.
    Fetch(Fetch),
    /// Beep and blink, so that a person sees which brick this is; answered with [`Done`].
    Identify,
    /// What is plugged in and what it reads, between runs; answered with [`Live`].
    Live,
}

/// What may be asked at the brick's own socket besides.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "op", rename_all = "snake_case")]
pub enum LocalOnly {
    /// Turn a motor while a button is held: a lease of 0.3 s, to be renewed; answered with
    /// [`Done`].
    Jog {
        /// The motor's port, such as `outB`.
        port: String,
        /// Percent of the motor's full speed, −100 to 100; 0 stops it.
        percent: i32,
    },
    /// Delete a run's files; answered with [`Done`]. The identifier is remembered, so that a late
    /// `start` does nothing.
    Delete {
        /// Which.
        run: RunId,
    },
    /// Hand a job over to be run; as `start`, but for a person at the brick: no token. Answered
    /// with [`Started`].
    StartHere(Start),
    /// This connection is the menu's: when it closes, however that happens, it is as if
    /// `menu_closed` had been asked. Answered with [`Done`].
    MenuHere,
    /// This connection is that of a run's starter: when it closes, however that happens, it is as
    /// if `stop` had been asked for this run. Answered with [`Done`].
    StarterHere {
        /// Which.
        run: RunId,
    },
    /// Stop because the menu was closed, where the configuration says that a run ends with it;
    /// otherwise as `stop`.
    MenuClosed,
    /// The fault was seen; answered with [`Done`].
    Acknowledge,
    /// Open the pairing window for some time, or close it (0); answered with [`Pairing`].
    PairingWindow {
        /// How long, seconds.
        seconds: u32,
    },
    /// What the pairing window shows; answered with [`Pairing`].
    PairingState,
    /// A person has compared the codes; answered with [`Pairing`].
    PairingAnswer {
        /// They are the same.
        same: bool,
    },
    /// The settings; answered with [`Settings`].
    Settings,
    /// Change settings; those that are left out stay. Answered with [`Settings`].
    SetSettings(SettingsChange),
}

/// What may be asked at the local socket.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum LocalRequest {
    /// What the network may ask as well.
    Shared(Request),
    /// What only the brick's own socket offers.
    Own(LocalOnly),
}

/// A request in its envelope, as a client sends it.
#[cfg(feature = "cli")]
#[derive(Debug, Serialize)]
pub(crate) struct Envelope<'r, R> {
    pub(crate) version: u32,
    pub(crate) id: u64,
    #[serde(flatten)]
    pub(crate) request: &'r R,
}

/// A request and the name that its client has for it, as they arrive.
#[derive(Debug, Clone, PartialEq)]
pub struct Asked<R> {
    /// The client's name for it.
    pub id: Id,
    /// What is asked.
    pub request: R,
}

/// A run to be started.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Start {
    /// Chosen by the client; remembered after the run is deleted.
    pub run: RunId,
    /// Which mission.
    pub mission: Chosen,
    /// From a status reply less than [`TOKEN_LIFE_NS`] old, since which no stop has come; at the
    /// local socket it may be left out.
    #[serde(default)]
    pub token: Option<String>,
    /// The robot's pose at the start: metres, metres, degrees.
    #[serde(default)]
    pub pose: Option<[f64; 3]>,
    /// The mission's own numbers that are set otherwise for this run.
    #[serde(default)]
    pub set: Vec<(String, f64)>,
    /// It may be run where no button beside the robot stops it.
    #[serde(default)]
    pub no_button: bool,
}

/// A mission, by name or as text.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Chosen {
    /// One that the brick has.
    Name(String),
    /// A mission's file, at most [`MAX_MISSION_BYTES`]; kept in the run's record and nowhere else.
    Text(String),
}

/// A part of a run's recording.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fetch {
    /// Which run.
    pub run: RunId,
    /// Where the part begins, bytes.
    pub offset: u64,
    /// How long it may be, bytes; the brick brings at most [`MAX_FETCH_BYTES`].
    pub length: u32,
    /// SHA-256, in hexadecimal, of the whole recording as it lies on the client's disk: with the
    /// brick's own hash, the run counts as fetched from now on. It is optional.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
}

impl Fetch {
    /// A part of a recording.
    #[must_use]
    pub fn part(run: &RunId, offset: u64, length: u32) -> Self {
        Self { run: run.clone(), offset, length, sha256: None }
    }
}

/// What a transport gives back.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Answer {
    /// The reply's `ok`.
    pub value: serde_json::Value,
    /// The bytes beside it, for `fetch`.
    pub bytes: Option<Vec<u8>>,
}

/// A reply's JSON. What is read has texts that may be shown ([`printable`](crate::printable)).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Reply {
    /// The request's, where it could be read.
    pub id: Option<Id>,
    /// What is answered.
    #[serde(flatten, deserialize_with = "told::outcome")]
    pub outcome: Outcome,
}

#[cfg(feature = "cli")]
impl Reply {
    /// What is sent for a request: the reply, and the bytes behind it.
    pub(crate) fn to(id: Option<Id>, answered: Result<Answer, Refusal>) -> (Self, Option<Vec<u8>>) {
        match answered {
            Ok(Answer { value, bytes }) => (Self { id, outcome: Outcome::Ok(value) }, bytes),
            Err(refusal) => (Self { id, outcome: Outcome::Error(refusal) }, None),
        }
    }
}

/// What came of a request.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The operation's own answer.
    Ok(serde_json::Value),
    /// Nothing was done.
    Error(Refusal),
}

/// Who asks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Caller {
    /// Over the network: the name under which its key is authorised.
    Key(String),
    /// At the local socket.
    Here,
    /// The same, where the process has said that it is the menu ([`LocalOnly::MenuHere`]).
    Menu,
}

/// What both transports ask the service for. It is shared between their threads.
///
/// `stop` waits for the motors to be told, at most about a second; all others answer at once, so a
/// slow client never delays another for long.
pub trait Operations: Send + Sync {
    /// Does what the network may ask.
    ///
    /// # Errors
    ///
    /// [`Refusal`]: nothing was done.
    fn shared(&self, request: &Request, caller: &Caller) -> Result<Answer, Refusal>;

    /// Does what only the local socket may ask.
    ///
    /// # Errors
    ///
    /// [`Refusal`]: nothing was done.
    fn own(&self, request: &LocalOnly, caller: &Caller) -> Result<Answer, Refusal>;
}
