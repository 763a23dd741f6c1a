//! The PC's side of an introduction.

use serde::Serialize;

use super::{Hex, PAIRING_PORT, Said, Side, Step, code, commitment, random, well_known_key};
use crate::clock::{Clock as _, MILLISECOND_NS, MonotonicClock};
use crate::link::client::{Address, ClientError, PORT, Patience, Session};
use crate::link::keys::{KeyError, KeyPair, KnownBrick, KnownBricks, PublicKey};
use crate::protocol::{Kind, Name, Refusal};

/// How often the brick is asked whether its person has answered, nanoseconds.
const ASKED_NS: i64 = 500 * MILLISECOND_NS;

/// A brick that was introduced.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Introduced {
    /// What it calls itself.
    pub name: Name,
    /// Its key, which is to be kept in `known_bricks`.
    pub key: PublicKey,
}

impl Introduced {
    /// Keeps it among the bricks that this PC knows, in place of one of its name that has another
    /// key: a person has confirmed it. It is known by the host that it was introduced at, and by
    /// the port of its requests, where that is not 5670.
    ///
    /// # Errors
    ///
    /// As [`KnownBricks::put`].
    pub fn keep(
        self,
        known: &mut KnownBricks,
        host: &str,
        port: Option<u16>,
    ) -> Result<KnownBrick, KeyError> {
        let replaced = known.another(&self.name, &self.key).map(|other| other.key);
        let address = Address::parse(host, PAIRING_PORT).at(port);
        let brick = KnownBrick { name: self.name.to_string(), address, key: self.key };
        known.put(&brick, replaced)?;
        Ok(brick)
    }
}

/// True where an address, as [`pair`] takes it, names a port.
#[must_use]
pub fn names_a_port(host: &str) -> bool {
    Address::parse(host, PAIRING_PORT) == Address::parse(host, 0)
}

/// The command that introduces a PC to a brick whose link listens at this address. The port of its
/// pairing is known to the brick alone.
#[must_use]
pub fn pair_command(address: &str) -> String {
    let place = Address::parse(address, PORT);
    match place.port {
        PORT => format!("onbrick pair {}", place.host),
        port => format!("onbrick pair {} --port {port}", place.host),
    }
}

#[derive(Serialize)]
struct Pair {
    op: &'static str,
    #[serde(flatten)]
    step: Step,
}

/// Introduces this PC, which calls itself `name`, to the brick whose pairing window is open at an
/// address (with `:port` where that is not 5671).
///
/// `is_same` is given the brick and the code, and says whether the brick shows the same code and is
/// the one that is meant. Nothing that the brick has said may stand before the code where a person
/// reads it.
///
/// # Errors
///
/// [`ClientError::Refused`] where either person says that the codes differ, the window is closed
/// again, or the brick does not keep to what it committed to; otherwise as any request.
pub fn pair(
    address: &str,
    own: &KeyPair,
    name: &Name,
    patience: Patience,
    is_same: &mut dyn FnMut(&Introduced, &str) -> bool,
) -> Result<Introduced, ClientError> {
    let mut line = Session::new(address, PAIRING_PORT, well_known_key(), own, patience)?;
    let failed = |kind, message: &str| ClientError::Refused(Refusal::new(kind, message));
    let number = random().map_err(|error| failed(Kind::Failed, &error.to_string()))?;
    let commit = Hex(commitment(Side::Pc, &own.public(), &number));
    let Said::Commit { commit } = ask(&mut line, Step::Commit { name: name.clone(), commit })?
    else {
        return Err(out_of_turn());
    };
    let Said::Reveal { key, number: theirs, name } =
        ask(&mut line, Step::Reveal { number: Hex(number) })?
    else {
        return Err(out_of_turn());
    };
    let key =
        PublicKey::parse(&key).map_err(|error| failed(Kind::NotAuthorised, &error.to_string()))?;
    if commitment(Side::Brick, &key, &theirs.0) != commit.0 {
        return Err(failed(
            Kind::NotAuthorised,
            "the brick showed another number than it had committed to",
        ));
    }
    let brick = Introduced { name, key };
    let same = is_same(&brick, &code((&own.public(), &number), (&key, &theirs.0)));
    let mut said = ask(&mut line, Step::Answer { same })?;
    if !same {
        // Whatever the other side makes of it.
        return Err(failed(Kind::NotAuthorised, "you said no, and nothing was kept"));
    }
    loop {
        match said {
            Said::Paired => return Ok(brick),
            Said::Failed { why } => return Err(failed(Kind::NotAuthorised, &why)),
            Said::Waits => {
                MonotonicClock.sleep_ns(ASKED_NS);
                said = ask(&mut line, Step::How)?;
            }
            Said::Commit { .. } | Said::Reveal { .. } => return Err(out_of_turn()),
        }
    }
}

fn ask(line: &mut Session, step: Step) -> Result<Said, ClientError> {
    line.ask(&Pair { op: "pair", step })
}

fn out_of_turn() -> ClientError {
    ClientError::Refused(Refusal::new(Kind::Other, "the brick answered out of turn"))
}
