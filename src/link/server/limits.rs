//! How many may connect, and how fast: libzmq has no such options, so connections are counted as
//! its monitor tells of them.
//!
//! A connection costs memory and a descriptor, and a handshake some ten milliseconds of a brick's
//! processor. Both are bounded, for all together and for each address, so that one machine that
//! floods a brick leaves room for the others. What is too much is shut at once.
//!
//! libzmq bounds a frame, and not how many frames a message has, and it keeps them all until the
//! last one has come. So what has come of an address is compared with the requests that were taken
//! from there.
//!
//! # Not here
//!
//! No sockets and no clock: what to shut is only decided here.

use std::collections::BTreeMap;
use std::net::IpAddr;

use crate::clock::{SECOND_NS, seconds};

/// Connections at the same time: of all, and of one address.
pub(super) const MOST_OPEN: usize = 48;
const MOST_OPEN_OF_ONE: usize = 16;

/// New connections: a burst, and how many a second after it; of all, and of one address.
const ALL: Rate = Rate { burst: 60.0, per_s: 20.0 };
const ONE: Rate = Rate { burst: 30.0, per_s: 8.0 };

/// Addresses that are remembered although nothing of theirs is open.
const MOST_REMEMBERED: usize = 256;

/// What may have come of an address without being a request yet, bytes: more than all requests
/// together that may wait.
const MOST_UNFINISHED: u64 = 2 << 20;

/// What libzmq puts around each frame, bytes, generously: its length, and what CURVE needs.
const AROUND_A_FRAME: u64 = 64;

/// What a connection brings besides requests, bytes a second and once: heartbeats, and the
/// handshake.
const BESIDES_PER_S: u64 = 512;
const BESIDES: u64 = 4096;

#[derive(Debug, Clone, Copy)]
struct Rate {
    burst: f64,
    per_s: f64,
}

/// A bucket that fills with time and from which each new connection takes one.
#[derive(Debug, Clone, Copy)]
struct Bucket {
    level: f64,
    at_ns: i64,
}

impl Bucket {
    fn full(rate: Rate, now_ns: i64) -> Self {
        Self { level: rate.burst, at_ns: now_ns }
    }

    /// Fills up; true where there is one to take.
    fn refill(&mut self, rate: Rate, now_ns: i64) -> bool {
        let passed_s = seconds(now_ns.saturating_sub(self.at_ns)).max(0.0);
        self.level = (self.level + passed_s * rate.per_s).min(rate.burst);
        self.at_ns = now_ns;
        self.level >= 1.0
    }
}

/// The connections that there are.
#[derive(Debug)]
pub(super) struct Limits {
    open: BTreeMap<i32, Open>,
    all: Bucket,
    each: BTreeMap<IpAddr, Bucket>,
    /// Bytes of requests that were taken, by the address that they came from.
    taken: BTreeMap<IpAddr, u64>,
}

/// One connection.
#[derive(Debug, Clone, Copy)]
struct Open {
    peer: IpAddr,
    since_ns: i64,
    /// Bytes that have come over it.
    received: u64,
}

impl Open {
    /// What has come over it and is explained by its being there.
    fn besides(&self, now_ns: i64) -> u64 {
        let lasted_s = now_ns.saturating_sub(self.since_ns).max(0) / SECOND_NS;
        BESIDES.saturating_add(BESIDES_PER_S.saturating_mul(lasted_s.unsigned_abs()))
    }
}

/// Why a connection is shut.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TooMuch {
    /// Too many are open.
    Open,
    /// Too many came in a short time.
    Rate,
}

impl Limits {
    pub(super) fn new(now_ns: i64) -> Self {
        Self {
            open: BTreeMap::new(),
            all: Bucket::full(ALL, now_ns),
            each: BTreeMap::new(),
            taken: BTreeMap::new(),
        }
    }

    /// Counts a new connection and says whether it may stay. One that may not is counted until it
    /// is gone, too.
    pub(super) fn accepted(
        &mut self,
        descriptor: i32,
        peer: IpAddr,
        now_ns: i64,
    ) -> Result<(), TooMuch> {
        let of_one = self.open.values().filter(|open| open.peer == peer).count();
        let has_room = self.open.len() < MOST_OPEN && of_one < MOST_OPEN_OF_ONE;
        self.open.insert(descriptor, Open { peer, since_ns: now_ns, received: 0 });
        self.forget(now_ns);
        let own = self.each.entry(peer).or_insert_with(|| Bucket::full(ONE, now_ns));
        let (own_has, all_has) = (own.refill(ONE, now_ns), self.all.refill(ALL, now_ns));
        if !has_room {
            return Err(TooMuch::Open);
        }
        // A peer over its own rate takes nothing from the others.
        if !(own_has && all_has) {
            return Err(TooMuch::Rate);
        }
        own.level -= 1.0;
        self.all.level -= 1.0;
        Ok(())
    }

    /// A connection is gone.
    pub(super) fn closed(&mut self, descriptor: i32) {
        let Some(gone) = self.open.remove(&descriptor) else { return };
        let is_last = !self.open.values().any(|open| open.peer == gone.peer);
        match self.taken.get_mut(&gone.peer) {
            Some(_) if is_last => drop(self.taken.remove(&gone.peer)),
            // What was taken over it must not speak for what comes over others.
            Some(taken) => *taken = taken.saturating_sub(gone.received),
            None => {}
        }
    }

    /// A request of this many frames and bytes was taken from an address.
    pub(super) fn took(&mut self, peer: IpAddr, frames: u64, bytes: u64) {
        // An address that has no connection any more is not remembered.
        if self.open.values().any(|open| open.peer == peer) {
            let taken = self.taken.entry(peer).or_insert(0);
            *taken =
                taken.saturating_add(bytes).saturating_add(frames.saturating_mul(AROUND_A_FRAME));
        }
    }

    /// The connections that there are.
    pub(super) fn descriptors(&self) -> Vec<i32> {
        self.open.keys().copied().collect()
    }

    /// The number of bytes that have come over a connection by now.
    pub(super) fn received(&mut self, descriptor: i32, bytes: u64) {
        if let Some(open) = self.open.get_mut(&descriptor) {
            open.received = bytes;
        }
    }

    /// The connections of addresses of which too much has come that is no request.
    pub(super) fn hoarders(&self, now_ns: i64) -> Vec<i32> {
        let mut unfinished: BTreeMap<IpAddr, u64> = BTreeMap::new();
        for open in self.open.values() {
            let sum = unfinished.entry(open.peer).or_insert(0);
            *sum = sum.saturating_add(open.received.saturating_sub(open.besides(now_ns)));
        }
        let is_too_much = |peer: &IpAddr| {
            let taken = self.taken.get(peer).copied().unwrap_or(0);
            unfinished.get(peer).is_some_and(|sum| sum.saturating_sub(taken) > MOST_UNFINISHED)
        };
        let of_them = self.open.iter().filter(|(_, open)| is_too_much(&open.peer));
        of_them.map(|(descriptor, _)| *descriptor).collect()
    }

    /// Addresses whose bucket is full again are as good as never seen.
    fn forget(&mut self, now_ns: i64) {
        if self.each.len() >= MOST_REMEMBERED {
            self.each.retain(|_, bucket| {
                bucket.refill(ONE, now_ns);
                bucket.level < ONE.burst
            });
        }
        // A flood from more addresses than that: the bucket of all together is what holds.
        while self.each.len() >= MOST_REMEMBERED {
            self.each.pop_first();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::SECOND_NS;

    /// A bucket is full again after that.
    const REFILLED_NS: i64 = 5 * SECOND_NS;

    fn address(last: u8) -> IpAddr {
        IpAddr::from([10, 0, 0, last])
    }

    #[test]
    fn one_address_takes_only_its_share_of_connections() {
        let mut limits = Limits::new(0);
        let most = i32::try_from(MOST_OPEN_OF_ONE).unwrap();
        for fd in 0..most {
            assert_eq!(limits.accepted(fd, address(1), 0), Ok(()), "{fd}");
        }
        assert_eq!(limits.accepted(100, address(1), 0), Err(TooMuch::Open));
        assert_eq!(limits.accepted(101, address(2), 0), Ok(()));
        limits.closed(100);
        limits.closed(0);
        assert_eq!(limits.accepted(102, address(1), 0), Ok(()));
        assert_eq!(limits.open.len(), MOST_OPEN_OF_ONE + 1);
    }

    #[test]
    fn all_together_have_a_limit_too() {
        let mut limits = Limits::new(0);
        let mut kept = 0;
        for fd in 0..200 {
            let peer = address(u8::try_from(fd % 100).unwrap());
            let now_ns = i64::from(fd) * SECOND_NS;
            kept += usize::from(limits.accepted(fd, peer, now_ns).is_ok());
        }
        assert_eq!(kept, MOST_OPEN);
    }

    #[test]
    fn a_flood_of_one_address_is_slowed_down_and_the_others_are_not() {
        let mut limits = Limits::new(0);
        let mut kept = 0;
        for fd in 0..1000 {
            kept += i32::from(limits.accepted(fd, address(1), 0).is_ok());
            limits.closed(fd);
        }
        assert!((f64::from(kept) - ONE.burst).abs() < 0.5, "{kept} were kept");
        assert_eq!(limits.accepted(0, address(2), 0), Ok(()));
        assert_eq!(limits.accepted(1, address(1), 0), Err(TooMuch::Rate));
        limits.closed(1);
        assert_eq!(limits.accepted(1, address(1), REFILLED_NS), Ok(()));
    }

    #[test]
    fn an_address_of_which_much_comes_and_no_request_is_told_from_one_that_asks_much() {
        let mut limits = Limits::new(0);
        for (descriptor, last) in [(1, 1), (2, 1), (3, 2), (4, 3)] {
            limits.accepted(descriptor, address(last), 0).unwrap();
        }
        let hour_ns = 3600 * SECOND_NS;
        // A friend that has asked for an hour, one that was only there, and one whose request never
        // ends.
        for _ in 0..10_000 {
            limits.took(address(1), 2, 300);
        }
        limits.received(1, 10_000 * (300 + 2 * 42));
        limits.received(3, 1_000_000);
        limits.received(4, MOST_UNFINISHED * 3 / 2);
        assert_eq!(limits.hoarders(hour_ns), [4; 0], "heartbeats of an hour are more than that");
        limits.received(4, 3 * MOST_UNFINISHED);
        assert_eq!(limits.hoarders(hour_ns), [4]);
        // What came over a connection speaks only for that one.
        limits.closed(1);
        limits.received(2, 2 * MOST_UNFINISHED);
        assert_eq!(limits.hoarders(0), [2, 4]);
        [2, 3, 4].iter().for_each(|descriptor| limits.closed(*descriptor));
        limits.took(address(1), 1, 1);
        assert!(limits.taken.is_empty() && limits.hoarders(0).is_empty());
    }

    #[test]
    fn what_is_remembered_has_a_bound() {
        let mut limits = Limits::new(0);
        for number in 0..5000_u32 {
            let _ = limits.accepted(0, IpAddr::from(number.to_be_bytes()), 0);
            limits.closed(0);
        }
        assert!(limits.each.len() <= MOST_REMEMBERED, "{}", limits.each.len());
    }
}
