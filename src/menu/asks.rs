//! What is asked of the service, and when: two lanes, one request in flight in each.
//!
//! Looking (status, lists, live values, parts of a map) repeats by itself; orders (start, stop,
//! jog, delete, settings) are a person's. They go over two connections, so that a stop never waits
//! behind a list that comes late.

use std::collections::VecDeque;

use crate::clock::MILLISECOND_NS;
use crate::protocol::{LocalOnly, LocalRequest, Request};

/// Which connection a request goes over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lane {
    /// What is repeated to show how things are.
    Look,
    /// What a person wants done.
    Order,
}

impl Lane {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Look, Self::Order];
}

/// What is looked at again and again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Look {
    Status,
    Missions,
    Runs,
    Live,
    Settings,
    Pairing,
    Map,
}

impl Look {
    const COUNT: usize = 7;

    /// How often, nanoseconds.
    fn period_ns(self) -> i64 {
        MILLISECOND_NS
            * match self {
                // The control process reports about five times a second.
                Self::Status | Self::Live => 250,
                Self::Map | Self::Pairing => 500,
                Self::Missions | Self::Runs | Self::Settings => 3000,
            }
    }
}

/// Requests on their way and in waiting.
#[derive(Debug, Default)]
pub(super) struct Asks {
    orders: VecDeque<LocalRequest>,
    flying: [Option<LocalRequest>; 2],
    looked_ns: [Option<i64>; Look::COUNT],
}

impl Asks {
    /// Puts an order behind those that wait. A jog takes the place of one that waits for the same
    /// motor: only the newest counts.
    pub(super) fn order(&mut self, order: LocalOnly) {
        if let LocalOnly::Jog { port: new, .. } = &order {
            self.orders.retain(
                |waiting| !matches!(waiting, LocalRequest::Own(LocalOnly::Jog { port, .. }) if port == new),
            );
        }
        self.orders.push_back(LocalRequest::Own(order));
    }

    /// A stop goes before all that waits; one that waits already is enough.
    pub(super) fn stop(&mut self) {
        let stop = LocalRequest::Shared(Request::Stop { run: None });
        self.orders.retain(|waiting| *waiting != stop);
        self.orders.push_front(stop);
    }

    /// The next order, if none is on its way.
    pub(super) fn next_order(&mut self) -> Option<LocalRequest> {
        if self.flying[Lane::Order as usize].is_some() {
            return None;
        }
        let order = self.orders.pop_front()?;
        self.flying[Lane::Order as usize] = Some(order.clone());
        Some(order)
    }

    /// Of what is wanted, the one that has waited longest, if it is due and none is on its way.
    pub(super) fn due(&self, wanted: &[Look], now_ns: i64) -> Option<Look> {
        if self.flying[Lane::Look as usize].is_some() {
            return None;
        }
        let due_ns = |look: &Look| {
            self.looked_ns[*look as usize].map_or(i64::MIN, |last| last + look.period_ns())
        };
        wanted.iter().copied().filter(|look| due_ns(look) <= now_ns).min_by_key(due_ns)
    }

    /// Notes that a look is on its way.
    pub(super) fn look(&mut self, look: Look, request: LocalRequest, now_ns: i64) {
        self.looked_ns[look as usize] = Some(now_ns);
        self.flying[Lane::Look as usize] = Some(request);
    }

    /// What an answer is for.
    pub(super) fn landed(&mut self, lane: Lane) -> Option<LocalRequest> {
        self.flying[lane as usize].take()
    }

    /// Whether an order to start waits or is on its way.
    pub(super) fn is_starting(&self) -> bool {
        let mut orders = self.orders.iter().chain(&self.flying[Lane::Order as usize]);
        orders.any(|order| matches!(order, LocalRequest::Own(LocalOnly::StartHere(_))))
    }

    /// Looks again at once; what has been due for longer still comes first.
    pub(super) fn refresh(&mut self, look: Look, now_ns: i64) {
        self.looked_ns[look as usize] = Some(now_ns - look.period_ns());
    }
}
