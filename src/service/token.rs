//! Tokens: a proof that a start was asked for a moment ago, by this service's own clock.
//!
//! A command that was stuck in an outage must not drive a robot off later. Each status carries a
//! token, the time it was made; a start returns it. The signing key is drawn at random at each
//! start of the service, so an old service's token is invalid, and a token's time cannot be forged.
//!
//! # Not here
//!
//! No authorisation: who may start is a matter of keys.
//!
//! # What we count on
//!
//! - `RandomState` takes what randomness there is without waiting for more (std: `getrandom` that
//!   does not block, `/dev/urandom`); the time of the start, to the nanosecond, is mixed in for a
//!   machine that has none yet.

use std::hash::{BuildHasher, Hasher, RandomState};

use sha2::{Digest, Sha256};

use crate::clock::seconds;
use crate::protocol::TOKEN_LIFE_NS;

/// Makes tokens and knows them again.
#[derive(Clone)]
pub(super) struct Tokens {
    secret: [u8; 32],
}

impl std::fmt::Debug for Tokens {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Tokens").finish_non_exhaustive()
    }
}

/// Why a token is not taken.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(super) enum NotFresh {
    /// Not made by this service since it started.
    #[error("the token is not this brick's, or from before its service restarted")]
    Foreign,
    /// Made too long ago.
    #[error(
        "the token is {0:.1} s old, and {life:.0} s is the most",
        life = seconds(TOKEN_LIFE_NS)
    )]
    Old(f64),
}

impl Tokens {
    /// Draws a new secret; `now_ns` and `wall_ns` are mixed in.
    pub(super) fn new(now_ns: i64, wall_ns: i64) -> Self {
        let mut hash = Sha256::new();
        for _ in 0..2 {
            hash.update(RandomState::new().build_hasher().finish().to_le_bytes());
        }
        hash.update(now_ns.to_le_bytes());
        hash.update(wall_ns.to_le_bytes());
        hash.update(std::process::id().to_le_bytes());
        Self { secret: hash.finalize().into() }
    }

    /// A token of this moment.
    pub(super) fn make(&self, now_ns: i64) -> String {
        format!("{now_ns:x}-{:016x}", self.sign(now_ns))
    }

    /// When a token was made, which is within the last [`TOKEN_LIFE_NS`].
    pub(super) fn check(&self, token: &str, now_ns: i64) -> Result<i64, NotFresh> {
        let (time, sign) = token.split_once('-').ok_or(NotFresh::Foreign)?;
        let made_ns = i64::from_str_radix(time, 16).map_err(|_| NotFresh::Foreign)?;
        let sign = u64::from_str_radix(sign, 16).map_err(|_| NotFresh::Foreign)?;
        if sign != self.sign(made_ns) || made_ns > now_ns {
            return Err(NotFresh::Foreign);
        }
        let age_ns = now_ns.saturating_sub(made_ns);
        if age_ns > TOKEN_LIFE_NS { Err(NotFresh::Old(seconds(age_ns))) } else { Ok(made_ns) }
    }

    fn sign(&self, time_ns: i64) -> u64 {
        let digest =
            Sha256::new().chain_update(self.secret).chain_update(time_ns.to_le_bytes()).finalize();
        digest.iter().take(8).fold(0, |sign, byte| (sign << 8) | u64::from(*byte))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::SECOND_NS;

    #[test]
    fn a_token_is_taken_for_five_seconds_and_not_before_it_was_made() {
        let tokens = Tokens::new(1, 2);
        let token = tokens.make(10 * SECOND_NS);
        assert_eq!(tokens.check(&token, 10 * SECOND_NS), Ok(10 * SECOND_NS));
        assert_eq!(tokens.check(&token, 15 * SECOND_NS), Ok(10 * SECOND_NS));
        assert_eq!(tokens.check(&token, 15 * SECOND_NS + 300_000_000), Err(NotFresh::Old(5.3)));
        assert_eq!(tokens.check(&token, 9 * SECOND_NS), Err(NotFresh::Foreign));
    }

    #[test]
    fn a_token_of_another_start_or_with_another_time_is_none() {
        let token = Tokens::new(1, 2).make(SECOND_NS);
        assert_eq!(
            Tokens::new(1, 2).check(&token, SECOND_NS),
            Err(NotFresh::Foreign),
            "drawn again"
        );
        let tokens = Tokens::new(1, 2);
        let token = tokens.make(SECOND_NS);
        let later = format!("{:x}-{}", 9 * SECOND_NS, token.split_once('-').unwrap().1);
        for bad in
            [later.as_str(), "", "-", "7", "k2-81734", "ffffffffffffffffff-0", &"f".repeat(100)]
        {
            assert_eq!(tokens.check(bad, 9 * SECOND_NS), Err(NotFresh::Foreign), "{bad}");
        }
    }
}
