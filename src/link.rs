//! The network: a person at a PC starts and stops missions on bricks and brings their maps home.
//!
//! The robot drives on by itself, whatever the network does: what drives is another process, and
//! nothing in it waits for, or is fed by, the link. libzmq and libsodium live only in `onbrick
//! serve` and on the PC.
//!
//! | part | what it is |
//! |---|---|
//! | [`keys`] | who a machine is, who may ask it, which bricks it knows |
//! | [`server`] | a brick's end |
//! | [`client`] | a brick as a program on a PC sees it: [`Client`] |
//! | [`pairing`] | introducing a PC to a brick |
//! | [`team`] | several bricks with start poses: `team.toml` |
//! | `discover` | bricks that make themselves known (feature `host`) |
//! | `node` | a simulated brick's files for programs of the seed (feature `sim`) |
//! | [`curve`] | that the libzmq that is linked can encrypt |
//!
//! # Not here
//!
//! What the operations do (`service`): this carries them. No way to move a single motor, to delete
//! or to write a file: the operations of the network are another type than those of the brick's own
//! socket.
//!
//! # The protocol, version 1
//!
//! This section is all that a client in another language needs, and the one of [`pairing`] what it
//! needs to be let in: `tests/python/link_client.py` and `link_pair.py` are clients with pyzmq, and
//! use nothing else.
//!
//! **Transport.** A brick binds one ROUTER socket at TCP port 5670 (ZMTP 3, [rfc
//! 23](https://rfc.zeromq.org/spec/23/)) with the mechanism CURVE ([rfc
//! 25](https://rfc.zeromq.org/spec/25/)). There is no plaintext mode. A client sets the brick's
//! public key as the server key, and its own pair; the brick must have its public key among the
//! authorised ones, or the handshake ends with the ZAP status 400
//! (`ZMQ_EVENT_HANDSHAKE_FAILED_AUTH` at the client's monitor). A wrong server key just ends the
//! connection during the handshake. Keys are written in Z85, 40 signs.
//!
//! **Requests** are one frame of JSON, at most 512 KiB: an object with `version` (1), `id` (a
//! number from 0 to 2⁶⁴ − 1, or a text of at most 64 bytes; the client's own), `op`, and the
//! operation's fields beside them. Fields that are not known are ignored. A key that stands there
//! twice is refused. A longer frame ends the connection. So does a message of frames without end:
//! ten times a second it is counted what has come of an address, and at more than 2 MiB that are no
//! request yet all connections of that address are shut.
//!
//! **Replies** are one frame of JSON, and for `fetch` a second one of bytes. The object has the
//! request's `id`, or `null` where that could not be read, and either `ok` with the operation's
//! answer, or `error` with `kind` (for programs), `message` (for people) and `hint` (the way out,
//! or `null`). Fields that a client does not know are to be ignored, and a kind that it does not
//! know is a refusal like any other.
//!
//! ```json
//! {"version": 1, "id": 7, "op": "status"}
//! {"id": 7, "ok": {"brick": "ev3-blue", "state": "ready", "token": "k2-81734", "battery_v": 7.8}}
//! {"version": 1, "id": 8, "op": "start", "run": "map-1", "mission": {"name": "map"},
//!  "token": "k2-81734", "pose": [0.5, 0, 90], "set": [["speed_mps", 0.2], ["time_limit_s", 60]]}
//! {"id": 8, "error": {"kind": "stale_token", "message": "the token is 8.2 s old",
//!  "hint": "ask for the status again"}}
//! ```
//!
//! Words are in snake case: the [`State`] of a brick is `ready`, `preparing`, `running`,
//! `stopping`, `stopped` or `fault`; after a run it is one of the last two, not `ready` again. A
//! run's identifier ([`RunId`]) is the client's choice: 1 to 40 letters of ASCII, digits, `-` and
//! `_`.
//!
//! **Sockets.** A REQ socket is the simplest client: it sends the empty delimiter frame before the
//! request by itself, the brick sends it back before the reply, and REQ takes it off again. One
//! request is under way at a time, and after a reply that never came the socket is of no use any
//! more: close it, with linger 0, and open another. A DEALER may have several requests under way,
//! at most 16 on a connection; it may send the delimiter or leave it out, and gets it back as it
//! sent it. Requests are worked on in the order in which they came, but for `stop`, which waits
//! behind nothing, and refusals, which come at once: replies are told apart by their `id`.
//!
//! **Repeating** a request is harmless, and the only way to deal with a reply that does not come: a
//! start carries its run's identifier, `stop` stops what has stopped already, and the rest only
//! reads. A client sets `ZMQ_LINGER` to 0 and `ZMQ_IMMEDIATE` to 1, so that nothing waits in a
//! queue to be sent later.
//!
//! | `op` | fields | answer |
//! |---|---|---|
//! | `status` | | [`Status`]: state, run, battery, and a `token` for a start |
//! | `missions` | | [`Missions`]: names, hashes, what keeps one from being started |
//! | `start` | [`Start`]: `run`, `mission` (`{"name": …}` or `{"text": …}` of at most 64 KiB), `token`; `pose`, `set` | [`Started`]; the token must be of a status less than 5 s ago by the brick's clock |
//! | `stop` | `run`, or nothing for whatever drives, be it a calibration | [`Stopped`], when the motors have been told; without `run`, a start with a token from before it is refused (`stopped`), be it under way already |
//! | `runs` | | [`Runs`], the newest first |
//! | `fetch` | [`Fetch`]: `run`, `offset`, `length`; `sha256` | [`Fetched`] and a frame of `length` bytes, at most 64 KiB ([`MAX_FETCH_BYTES`]); `sha256` of the whole where `complete` and the end is reached, once it is computed |
//! | `identify` | | [`Done`]: it beeps and blinks |
//! | `live` | | [`Live`]: what is plugged in and what it reads; `busy` during a run |
//!
//! The kinds of refusals are those of [`Kind`], in snake case. The key that a connection has shown
//! is looked up for each request, so `not_authorised` may come at any time. A second socket at port
//! 5671 is bound while the pairing window is open; what is said there is in [`pairing`].
//!
//! **Fetching.** A recording only grows: ask from the offset that you have, keep what comes, and go
//! on until `complete` and `total` bytes are there; then the SHA-256 of all must be the one that
//! the brick names (64 lower-case digits of hexadecimal). A last `fetch` from `total` on, of
//! `length` 0, with the `sha256` of what lies on your disk tells the brick that it is there: a run
//! that is fetched goes first where the brick needs room. Runs are named freely, so a run's name
//! does not tell whose it is: its hash does.
//!
//! # In a program of your own
//!
//! With the feature `link` in its dependencies, this crate builds libzmq with CURVE and libsodium
//! (a C++ compiler and make), and the program links them: nothing is to be configured. zmq-sys
//! builds a libzmq without CURVE as well then, which is not linked, because [`curve`] comes before
//! it; to save its minute, put into your `.cargo/config.toml`
//!
//! ```toml
//! [target.x86_64-unknown-linux-gnu.zmq]
//! rustc-link-lib = []
//! ```

pub mod client;
pub mod curve;
#[cfg(feature = "host")]
pub mod discover;
mod held;
pub mod keys;
mod monitor;
#[cfg(feature = "host")]
mod node;
pub mod pairing;
pub mod server;
pub mod team;

use std::path::PathBuf;

#[cfg(doc)]
use crate::protocol::{
    Done, Fetch, Fetched, Kind, Live, MAX_FETCH_BYTES, Missions, RunId, Runs, Start, Started,
    State, Status, Stopped,
};
use crate::service::config::{own_folder, path_in};

pub use client::{Client, ClientError, FetchProgress, Patience};
pub use keys::{KeyPair, KnownBrick, KnownBricks, PublicKey};
#[cfg(feature = "host")]
pub use node::{Node, NodeError};
pub use server::{LinkState, Server, ServerConfig};
pub use team::Team;

/// A PC's folder of keys: `$ONBRICK_KEYS`, or `onbrick` in the folder of configurations
/// (`$XDG_CONFIG_HOME`, `~/.config`); `None` where there is no home.
#[must_use]
pub fn key_folder() -> Option<PathBuf> {
    path_in("ONBRICK_KEYS").or_else(own_folder)
}

/// `None` where nothing is there yet, or a signal came in between: the caller looks again.
fn if_ready<T>(done: zmq::Result<T>) -> zmq::Result<Option<T>> {
    match done {
        Ok(done) => Ok(Some(done)),
        Err(zmq::Error::EAGAIN | zmq::Error::EINTR) => Ok(None),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Deserializer, Value};

    use crate::protocol::{Request, parse};

    #[test]
    fn the_requests_in_the_documentation_are_requests() {
        let page = include_str!("link.rs");
        let example =
            page.split("//! ```json").nth(1).and_then(|rest| rest.split("//! ```").next());
        let json = example.unwrap().replace("//!", "");
        let said: Vec<Value> =
            Deserializer::from_str(&json).into_iter().collect::<Result<_, _>>().unwrap();
        let requests: Vec<Request> = said
            .iter()
            .filter(|value| value.get("op").is_some())
            .map(|value| parse(value.to_string().as_bytes()).unwrap().request)
            .collect();
        let [Request::Status, Request::Start(start)] = requests.as_slice() else {
            panic!("{requests:?}");
        };
        assert_eq!(start.pose, Some([0.5, 0.0, 90.0]));
        assert_eq!(start.set[1], ("time_limit_s".to_owned(), 60.0));
    }
}
