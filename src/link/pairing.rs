//! Introducing a PC to a brick, with a person who looks at both.
//!
//! Neither side knows the other's key yet, so a third machine could stand between them. Both commit
//! to a random number, then show their keys and the numbers; from all four each computes the same
//! short code and shows it to the person. A machine in between would have to show two different
//! keys, and gets one guess at a code of six digits: one exchange for each time that the window is
//! opened.
//!
//! ```text
//!  PC                                                       brick (its window is open)
//!   │── commit: name, H(key of the PC, number of the PC) ──▶│
//!   │◀─ commit: H(key of the brick, number of the brick) ───│
//!   │── reveal: number of the PC ──────────────────────────▶│   the PC's key is its connection's
//!   │◀─ reveal: key, number and name of the brick ──────────│
//!   │       both show the code; a person says on both sides whether it is the same
//!   │── answer: same ──────────────────────────────────────▶│
//!   │◀─ waits | paired | failed ────────────────────────────│   asked again while it waits
//! ```
//!
//! This is the usual commitment before a short authentication string (as in ZRTP, RFC 6189, section
//! 4.5).
//!
//! # The messages
//!
//! Written so that a client in another language needs nothing else; `tests/python/link_pair.py` is
//! one.
//!
//! **Socket.** While the window is open, the brick binds a second ROUTER socket at TCP port 5671,
//! with CURVE as the other one. Its public key is the same for every brick:
//! `w>il{Sx3&-W+P8nSMoe)b)!kpu3Q#g>4CE<ttSWd` (Z85; the secret half is the SHA-256 of the text
//! `onbrick pairing, version 1`, so nothing that crosses the socket is secret). The PC sets it as
//! the server key, and its own pair as the client's: the handshake proves that key, and it is the
//! one that is let in at the end. Any client's key may connect here.
//!
//! **Requests and replies** have the envelope of [the protocol](super): `version` 1, an `id`, and
//! `op`, which is always `pair`; `step` says which message it is, and its fields stand beside it. A
//! number, a key's hash and a commitment are 32 bytes, written as 64 lower-case digits of
//! hexadecimal. A reply's `ok` has a `step` too.
//!
//! | `step` asked | fields | `step` answered | fields |
//! |---|---|---|---|
//! | `commit` | `name` of the PC, `commit` | `commit` | `commit` |
//! | `reveal` | `number` of the PC | `reveal` | `key` of the brick (Z85), `number` and `name` of the brick |
//! | `answer` | `same`: true or false | `waits`, `paired`, or `failed` with `why` | |
//! | `how` | | as to `answer` | |
//!
//! ```json
//! {"version": 1, "id": 1, "op": "pair", "step": "commit", "name": "anna", "commit": "77b0…01bc"}
//! {"id": 1, "ok": {"step": "commit", "commit": "5f0c…9d3e"}}
//! {"version": 1, "id": 2, "op": "pair", "step": "reveal", "number": "0303…0303"}
//! {"id": 2, "ok": {"step": "reveal", "key": "0S&A8…0S&A8", "number": "0404…0404",
//!  "name": "ev3-blue"}}
//! {"version": 1, "id": 3, "op": "pair", "step": "answer", "same": true}
//! {"id": 3, "ok": {"step": "waits"}}
//! {"version": 1, "id": 4, "op": "pair", "step": "how"}
//! {"id": 4, "ok": {"step": "paired"}}
//! ```
//!
//! **What is computed.** `commit` is SHA-256 over [`COMMIT`] (`onbrick pairing 1 commit`), one byte
//! for the side (`P` or `B`), the 32 bytes of that side's public key and the 32 bytes of its
//! number, which is fresh and random. The code is the first eight bytes of SHA-256 over [`CODE`]
//! (`onbrick pairing 1 code`), the PC's key, the brick's key, the PC's number and the brick's
//! number, as one number, the most significant byte first, modulo a million, written as six digits
//! with a space in the middle. With keys of 32 bytes 01 (the PC's) and 02, and numbers of 32 bytes
//! 03 and 04, the PC's `commit` is
//! `77b0990d7eb3527f49e9bfad49c642417f68701abeef5ea1e64ac487a1ac01bc`, and the code `330 706`.
//!
//! **What each side checks.** That the other's `commit` is that of the key and the number that it
//! has shown, before the code is shown; and that its name is one: 1 to 64 letters of ASCII, digits,
//! `-`, `_` and `.`, a letter or a digit first ([`Name`]). The code
//! is shown in a line of its own, before any word of the other's. A PC keeps the brick's key only
//! when its person has said that the codes are the same and the answer is `paired`; where it knows
//! another key by that name, it asks.
//!
//! **Refusals** are those of the protocol. `busy`: the window is closed, another PC is being
//! introduced, or the window's one exchange is over, and a person has to open it again.
//! `not_authorised`: the number is not the one that was committed to, which ends the exchange.
//! `bad_request`: no step, or a name that is none; nothing has happened. Each step may be repeated
//! where its reply was lost, except with other contents. After `reveal` both persons have 120
//! seconds; a PC asks `how` about twice a second.
//!
//! # What we count on
//!
//! - The person compares. A person who confirms without looking lets in any PC that asked.

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::keys::{KeyPair, PublicKey};
use crate::protocol::Name;
use crate::service::digest::hex;

mod pc;
mod window;

pub use pc::{Introduced, names_a_port, pair, pair_command};
pub use window::PairingWindow;

/// The port of the pairing window, where nothing else is said.
pub const PAIRING_PORT: u16 = 5671;

/// What a commitment's hash begins with.
pub const COMMIT: &[u8] = b"onbrick pairing 1 commit";

/// What the code's hash begins with.
pub const CODE: &[u8] = b"onbrick pairing 1 code";

/// The well-known pair's halves; the secret one is the SHA-256 of `onbrick pairing, version 1`.
const PUBLIC: &str = "w>il{Sx3&-W+P8nSMoe)b)!kpu3Q#g>4CE<ttSWd";
const SECRET_OF: &[u8] = b"onbrick pairing, version 1";

/// The pair of keys of every pairing window, which is no secret.
pub(super) fn well_known() -> KeyPair {
    KeyPair::from_halves(well_known_key(), Sha256::digest(SECRET_OF).into())
}

/// The key under which every pairing window answers.
#[must_use]
pub fn well_known_key() -> PublicKey {
    // The text is a key: a test reads it.
    PublicKey::parse(PUBLIC).unwrap_or(PublicKey::from_bytes([0; 32]))
}

/// 32 random bytes of one side.
type Number = [u8; 32];

#[derive(Debug, Clone, Copy)]
enum Side {
    Pc,
    Brick,
}

fn commitment(side: Side, key: &PublicKey, number: &Number) -> [u8; 32] {
    let side = match side {
        Side::Pc => b"P",
        Side::Brick => b"B",
    };
    Sha256::new()
        .chain_update(COMMIT)
        .chain_update(side)
        .chain_update(key.as_bytes())
        .chain_update(number)
        .finalize()
        .into()
}

fn code(pc: (&PublicKey, &Number), brick: (&PublicKey, &Number)) -> String {
    let hash = Sha256::new()
        .chain_update(CODE)
        .chain_update(pc.0.as_bytes())
        .chain_update(brick.0.as_bytes())
        .chain_update(pc.1)
        .chain_update(brick.1)
        .finalize();
    let number =
        hash.iter().take(8).fold(0_u64, |number, byte| number << 8 | u64::from(*byte)) % 1_000_000;
    format!("{:03} {:03}", number / 1000, number % 1000)
}

/// From the kernel; it waits where there is no chance yet.
pub(super) fn random() -> std::io::Result<Number> {
    let mut number = [0; 32];
    // Up to 256 bytes come whole (getrandom(2)).
    let flags = rustix::rand::GetRandomFlags::empty();
    let filled = rustix::io::retry_on_intr(|| rustix::rand::getrandom(&mut number, flags))?;
    debug_assert_eq!(filled, number.len());
    Ok(number)
}

/// A text that cannot be guessed: 32 digits of hexadecimal.
///
/// # Errors
///
/// The kernel has no random numbers.
#[cfg(feature = "host")]
pub(crate) fn token() -> std::io::Result<String> {
    Ok(hex(&random()?[..16]))
}

/// 32 bytes in hexadecimal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
struct Hex([u8; 32]);

impl From<Hex> for String {
    fn from(number: Hex) -> Self {
        hex(&number.0)
    }
}

impl TryFrom<String> for Hex {
    type Error = &'static str;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        if text.len() != 64 || !text.bytes().all(|sign| sign.is_ascii_hexdigit()) {
            return Err("64 digits of hexadecimal are expected");
        }
        let byte = |at: usize| u8::from_str_radix(&text[2 * at..2 * at + 2], 16).unwrap_or(0);
        Ok(Self(std::array::from_fn(byte)))
    }
}

/// What a PC says at the window; `op` is `pair`, and `id` and `version` are as in any request.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "step", rename_all = "snake_case")]
enum Step {
    Commit { name: Name, commit: Hex },
    Reveal { number: Hex },
    Answer { same: bool },
    How,
}

/// What the brick says to it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "step", rename_all = "snake_case")]
enum Said {
    Commit { commit: Hex },
    Reveal { key: String, number: Hex, name: Name },
    Waits,
    Paired,
    Failed { why: String },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_for_pairing_has_the_links_port_as_an_option() {
        for (address, command) in [
            ("ev3-blue.local", "onbrick pair ev3-blue.local"),
            ("10.0.0.7:5670", "onbrick pair 10.0.0.7"),
            ("10.0.0.7:6000", "onbrick pair 10.0.0.7 --port 6000"),
            ("[::1]:6000", "onbrick pair ::1 --port 6000"),
        ] {
            assert_eq!(pair_command(address), command);
        }
    }

    #[test]
    fn the_well_known_pair_is_one() {
        assert_eq!(PublicKey::parse(PUBLIC), Ok(well_known_key()));
        // The vector that another implementation is checked with.
        let key = |byte| PublicKey::from_bytes([byte; 32]);
        assert_eq!(code((&key(1), &[3; 32]), (&key(2), &[4; 32])), VECTOR_CODE);
        assert_eq!(String::from(Hex(commitment(Side::Pc, &key(1), &[3; 32]))), VECTOR_COMMIT);
    }

    /// Computed with Python's hashlib.
    const VECTOR_CODE: &str = "330 706";
    const VECTOR_COMMIT: &str = "77b0990d7eb3527f49e9bfad49c642417f68701abeef5ea1e64ac487a1ac01bc";

    #[test]
    fn numbers_are_written_in_hexadecimal_and_nothing_else_is_one() {
        let hex = Hex(random().unwrap());
        assert_eq!(Hex::try_from(String::from(hex)), Ok(hex));
        assert_ne!(random().unwrap(), random().unwrap());
        for bad in ["", "00", &"0".repeat(63), &"g".repeat(64), &"+1".repeat(32), &"ü".repeat(32)]
        {
            assert!(Hex::try_from(bad.to_owned()).is_err(), "{bad}");
        }
    }
}
