//! A brick, as a program on a PC sees it.
//!
//! ```no_run
//! use onbrick::link::{Client, KeyPair, KnownBricks, key_folder};
//! use onbrick::protocol::Chosen;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let folder = key_folder().ok_or("no home folder")?;
//! let known = KnownBricks::load(&folder)?;
//! let known = known.find("ev3-blue").ok_or("onbrick pair ev3-blue")?;
//! let mut brick = Client::new(&known.address, known.key, &KeyPair::load(&folder)?)?;
//! let run = brick.start(Chosen::Name("map".to_owned()), None, &[])?.run;
//! println!("{} V", brick.status()?.battery_v.unwrap_or(f64::NAN));
//! brick.fetch(&run, "map.mcap".as_ref(), &mut |fetched| println!("{fetched:?}"))?;
//! # Ok(())
//! # }
//! ```
//!
//! A client keeps one connection and reconnects whenever it breaks. Each request is repeated until
//! it is answered or the patience is over. Repeating is harmless: a start carries its run's
//! identifier, stopping a stopped run does nothing, and the other requests only read. A request
//! sent into an outage has no late effect: nothing is queued without a connection, a socket's queue
//! is thrown away with it, and the brick refuses a start that was delayed for more than five
//! seconds.
//!
//! # Not here
//!
//! No threads: a client waits where it is called. Several bricks at once are several clients on
//! several threads ([`Client`] is [`Send`]).

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::curve::NoCurve;
use super::keys::{KeyPair, PublicKey};
use crate::behavior::{Capabilities, Mission};
use crate::clock::{Clock as _, MonotonicClock, SECOND_NS, nanoseconds, wall_ns};
use crate::protocol::{
    Chosen, Done, Kind, Live, Missions, Refusal, Request, RunId, Runs, Start, Started, Status,
    Stopped,
};
use crate::service::digest::hex;

mod address;
mod connection;
mod fetch;
mod session;

pub(super) use address::Address;
pub use fetch::{FetchProgress, file_so_far, part_of};
pub(super) use session::Session;

/// The port that bricks listen at.
pub const PORT: u16 = 5670;

/// The longest recording that is taken from a brick unless it is said otherwise: twice what a brick
/// keeps as it is shipped, and about half a day of a run.
pub const MOST_BYTES: u64 = 1 << 30;

/// How long a request is repeated unless it is said otherwise, seconds.
pub const PATIENCE_S: f64 = 10.0;

/// Why a brick did not do what it was asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ClientError {
    /// No answer in time: check the brick, its address and the network, and try again.
    #[error("no answer from {address} in {waited_s:.0} s: {silence}")]
    NoAnswer {
        /// Who was asked.
        address: String,
        /// For how long.
        waited_s: f64,
        /// What was seen meanwhile.
        silence: Silence,
    },
    /// The brick does not know this PC's key, or no longer: `onbrick pair`, or `onbrick key
    /// authorise` on the brick.
    #[error("{address} does not let this PC's key in: it is not, or no longer, authorised there")]
    NotAuthorised {
        /// Who was asked.
        address: String,
    },
    /// The key there is not the brick's known key: the brick was set up from scratch (pair again),
    /// or another machine answers.
    #[error(
        "what answers at {address} does not have the key that is known for it: the brick was set \
         up from scratch, another one has its address, or it is no brick"
    )]
    AnotherKey {
        /// Who was asked.
        address: String,
    },
    /// The brick understood, and refuses: its message says why.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// The brick's answer makes no sense here: another version of onbrick, mostly.
    #[error("{address} answered something that is not understood: {message}")]
    NotUnderstood {
        /// Who was asked.
        address: String,
        /// What is wrong with it.
        message: String,
    },
    /// The caller does not want to wait any longer.
    #[error("interrupted")]
    Interrupted,
    /// The file that a run is fetched into.
    #[error("cannot write {path}")]
    File {
        /// The file.
        path: std::path::PathBuf,
        /// What went wrong.
        source: std::io::Error,
    },
    /// Another fetch of the same run writes the same file just now: wait for it, or use another
    /// folder.
    #[error("another fetch is bringing a recording into {} just now", path.display())]
    Taken {
        /// The file that both would write.
        path: std::path::PathBuf,
    },
    /// There is a file of this name, and it is not this recording: keep both, by fetching into
    /// another folder.
    #[error(
        "{} is there already, and it is not this recording: its hash is another",
        path.display()
    )]
    OtherRecording {
        /// The file.
        path: std::path::PathBuf,
    },
    /// The brick sends more than is wanted: raise the limit, if a recording can be that long.
    #[error("the recording has {bytes} bytes by now, and at most {most} are taken")]
    TooLong {
        /// Its length, as far as the brick says.
        bytes: u64,
        /// The limit.
        most: u64,
    },
    /// This program cannot encrypt.
    #[error(transparent)]
    NoCurve(#[from] NoCurve),
    /// libzmq has no socket or no memory left.
    #[error("sockets cannot be used")]
    Socket(#[from] zmq::Error),
}

/// What was observed while no answer came.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Silence {
    /// No machine has the name.
    #[error("no machine has this name")]
    NoSuchName,
    /// No connection was made: it is switched off, elsewhere, or does not serve.
    #[error("no connection")]
    NoConnection,
    /// A connection was made, but no handshake followed.
    #[error("connected, but no handshake")]
    NoHandshake,
    /// It was there, and then it answered no more.
    #[error("it was there, and then said no more")]
    NoReply,
}

/// How long a client tries, and who may end that.
#[derive(Debug, Clone, Default)]
pub struct Patience {
    /// Nanoseconds without a sign of life from the brick.
    pub(super) most_ns: i64,
    /// The same as long as there is no connection.
    pub(super) absent_ns: i64,
    /// Raised by a caller that does not want to wait any longer.
    pub(super) cancelled: Option<Arc<AtomicBool>>,
    /// The caller says itself what is wrong.
    pub(super) is_quiet: bool,
}

impl Patience {
    /// For this long, seconds.
    #[must_use]
    pub fn new(seconds: f64) -> Self {
        let most_ns = nanoseconds(seconds).max(0);
        Self { most_ns, absent_ns: most_ns, ..Self::default() }
    }

    /// For this long only, seconds, where no connection comes about: an absent brick holds up
    /// little, and a slow one has its time.
    #[must_use]
    pub fn if_absent(mut self, seconds: f64) -> Self {
        self.absent_ns = nanoseconds(seconds).clamp(0, self.most_ns);
        self
    }

    /// Without a word in the log about a silence.
    #[must_use]
    pub fn quietly(mut self) -> Self {
        self.is_quiet = true;
        self
    }

    /// Until this flag is raised, too.
    #[must_use]
    pub fn unless(mut self, cancelled: Arc<AtomicBool>) -> Self {
        self.cancelled = Some(cancelled);
        self
    }
}

/// One brick.
#[derive(Debug)]
pub struct Client {
    line: Session,
    most_bytes: u64,
}

impl Client {
    /// A brick at an address (a name or a number, with `:port` where that is not 5670), with this
    /// key. Nothing is sent yet.
    ///
    /// # Errors
    ///
    /// [`ClientError::NoCurve`].
    pub fn new(address: &str, key: PublicKey, own: &KeyPair) -> Result<Self, ClientError> {
        Ok(Self {
            line: Session::new(address, PORT, key, own, Patience::new(PATIENCE_S))?,
            most_bytes: MOST_BYTES,
        })
    }

    /// The same with another patience.
    #[must_use]
    pub fn with_patience(mut self, patience: Patience) -> Self {
        self.line.patience = patience;
        self
    }

    /// As [`Client::with_patience`], from the next request on.
    pub fn set_patience(&mut self, patience: Patience) {
        self.line.patience = patience;
    }

    /// Takes recordings of at most this many bytes from now on; [`MOST_BYTES`] unless it is said
    /// otherwise.
    pub fn take_at_most(&mut self, bytes: u64) {
        self.most_bytes = bytes;
    }

    /// How the brick is.
    ///
    /// # Errors
    ///
    /// [`ClientError`], as for every request here.
    pub fn status(&mut self) -> Result<Status, ClientError> {
        self.line.ask(&Request::Status)
    }

    /// Which missions it has.
    ///
    /// # Errors
    ///
    /// [`ClientError`].
    pub fn missions(&mut self) -> Result<Missions, ClientError> {
        self.line.ask(&Request::Missions)
    }

    /// Starts a mission, at a pose (metres, metres, degrees) and with numbers of its own set
    /// otherwise, as a run with a new identifier.
    ///
    /// # Errors
    ///
    /// [`ClientError`]. After [`ClientError::NoAnswer`] the run may still have been started, or may
    /// start within the next five seconds: ask for the status.
    pub fn start(
        &mut self,
        mission: Chosen,
        pose: Option<[f64; 3]>,
        set: &[(String, f64)],
    ) -> Result<Started, ClientError> {
        let name = match &mission {
            Chosen::Name(name) => name.clone(),
            Chosen::Text(text) => name_in(text),
        };
        self.start_as(new_run_id(&name)?, mission, pose, set)
    }

    /// As [`Client::start`], as a run with an identifier of the caller's: a repeat does nothing.
    ///
    /// # Errors
    ///
    /// [`ClientError`].
    pub fn start_as(
        &mut self,
        run: RunId,
        mission: Chosen,
        pose: Option<[f64; 3]>,
        set: &[(String, f64)],
    ) -> Result<Started, ClientError> {
        let mut start =
            Start { run, mission, token: None, pose, set: set.to_vec(), no_button: false };
        let until_ns = self.line.deadline_ns();
        loop {
            start.token = Some(self.status()?.token);
            match self.line.ask(&Request::Start(start.clone())) {
                // It was under way for too long; the next one has a fresh token.
                Err(ClientError::Refused(refusal))
                    if refusal.kind == Kind::StaleToken && MonotonicClock.now_ns() < until_ns => {}
                answered => return answered,
            }
        }
    }

    /// Stops a run, or whatever runs; answered when the motors have been told.
    ///
    /// # Errors
    ///
    /// [`ClientError`].
    pub fn stop(&mut self, run: Option<&RunId>) -> Result<Stopped, ClientError> {
        self.line.ask(&Request::Stop { run: run.cloned() })
    }

    /// Which runs are on its disk.
    ///
    /// # Errors
    ///
    /// [`ClientError`].
    pub fn runs(&mut self) -> Result<Runs, ClientError> {
        self.line.ask(&Request::Runs)
    }

    /// Makes it beep and blink.
    ///
    /// # Errors
    ///
    /// [`ClientError`].
    pub fn identify(&mut self) -> Result<Done, ClientError> {
        self.line.ask(&Request::Identify)
    }

    /// What is plugged in and what it reads, between runs.
    ///
    /// # Errors
    ///
    /// [`ClientError`].
    pub fn live(&mut self) -> Result<Live, ClientError> {
        self.line.ask(&Request::Live)
    }

    /// Brings a run's recording home into a file, and follows it to its end where it is going on.
    ///
    /// What has come lies in `FILE.part`, which this call alone writes, until it is whole and its
    /// hash, of the file as it lies on the disk, is the brick's; then it gets its name, and the
    /// brick is told. What a broken connection, a brick that was switched off, or an earlier call
    /// has left there is gone on from. A `FILE` that is there already is compared with the brick's
    /// hash, and nothing is fetched. `watch` is told how far it is, about twice a second.
    ///
    /// # Errors
    ///
    /// [`ClientError`]; what has come so far stays in `FILE.part`, which is deleted if it is empty,
    /// and a `FILE` that was there as it was.
    pub fn fetch(
        &mut self,
        run: &RunId,
        file: &Path,
        watch: &mut dyn FnMut(&FetchProgress),
    ) -> Result<FetchProgress, ClientError> {
        fetch::fetch(&mut self.line, run, file, self.most_bytes, watch)
    }
}

/// The name of a mission. What is wrong with its text is for the brick to say, which knows its
/// robot.
fn name_in(text: &str) -> String {
    let mission = Mission::parse("mission.toml", text.as_bytes(), &Capabilities::all());
    mission.map_or_else(|_| "mission".to_owned(), |(mission, _)| mission.name().to_owned())
}

/// A unique identifier for a mission's run, which sorts by time: the mission's name, the seconds of
/// this PC's calendar, and random digits.
///
/// # Errors
///
/// None, unless the calendar is in a distant future.
pub fn new_run_id(mission: &str) -> Result<RunId, Refusal> {
    let chance = hex(&super::pairing::random().unwrap_or_default()[..4]);
    let unique = format!("{}-{chance}", wall_ns() / SECOND_NS);
    RunId::of_mission(mission, &unique).map_err(|error| Refusal::bad_request(error.to_string()))
}
