//! Bricks that make themselves known in this network, by mDNS and DNS-SD (RFC 6762, RFC 6763).
//!
//! On ev3dev avahi does that: the package puts a file beside avahi's own, and nothing of ours runs
//! for it. Many networks carry no multicast, or not between PC and brick; so this only ever adds to
//! what a person can type, and nothing depends on it. What is announced proves nothing either: a
//! brick is known by its key.
//!
//! # Not here
//!
//! Nothing is sent to a brick. Names ending in `.local` are resolved by the system, not here.

use std::net::IpAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use mdns_sd::{ResolvedService, ServiceDaemon, ServiceEvent};

use crate::clock::{Clock as _, MILLISECOND_NS, MonotonicClock, nanoseconds};
use crate::printable::line;

/// What bricks are announced as: `brick-image/package/onbrick.avahi` says the same.
pub const SERVICE: &str = "_onbrick._tcp.local.";

/// An interrupt is noticed within this time, milliseconds.
const NAP_MS: i64 = 100;

/// No more are listed: a network that answers more is not one of bricks.
const MOST: usize = 1000;

/// A brick that made itself known.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Announced {
    /// What it calls itself: its host's name, as a rule.
    pub name: String,
    /// Its host's name in this network, such as `ev3-blue.local`.
    pub host: String,
    /// The port of its link.
    pub port: u16,
    /// Its numbers, those of IPv4 first.
    pub addresses: Vec<IpAddr>,
}

/// This machine cannot listen to announcements.
#[derive(Debug, thiserror::Error)]
#[error("cannot listen to what is announced in this network")]
pub struct NoDiscovery(#[from] mdns_sd::Error);

/// Listens for this many seconds, or until it is interrupted; returns what was heard, by name.
///
/// # Errors
///
/// [`NoDiscovery`]. A network without announcements is none.
pub fn discover(seconds: f64, interrupted: &AtomicBool) -> Result<Vec<Announced>, NoDiscovery> {
    let daemon = ServiceDaemon::new()?;
    let events = daemon.browse(SERVICE)?;
    let until_ns = MonotonicClock.now_ns().saturating_add(nanoseconds(seconds));
    let mut heard: Vec<Announced> = Vec::new();
    while !interrupted.load(Ordering::Relaxed) && heard.len() < MOST {
        let left_ms = until_ns.saturating_sub(MonotonicClock.now_ns()) / MILLISECOND_NS;
        let Ok(nap_ms @ 1..) = u64::try_from(left_ms.min(NAP_MS)) else { break };
        match events.recv_timeout(Duration::from_millis(nap_ms)) {
            Ok(ServiceEvent::ServiceResolved(service)) => {
                let found = announced(&service);
                // Told again, with more addresses mostly.
                heard.retain(|known| known.name != found.name);
                heard.push(found);
            }
            Ok(ServiceEvent::ServiceRemoved(_, full)) => {
                heard.retain(|known| known.name != name_of(&full))
            }
            Ok(_) => {}
            Err(_) if events.is_disconnected() => break,
            Err(_) => {}
        }
    }
    // It answers when its sockets are closed; this program ends soon anyway.
    let _ = daemon.shutdown();
    heard.sort();
    Ok(heard)
}

fn announced(service: &ResolvedService) -> Announced {
    let mut addresses: Vec<IpAddr> =
        service.addresses.iter().map(mdns_sd::ScopedIp::to_ip_addr).collect();
    addresses.sort_by_key(|address| (address.is_ipv6(), *address));
    Announced {
        name: name_of(&service.fullname),
        host: line(service.host.trim_end_matches('.')).into_owned(),
        port: service.port,
        addresses,
    }
}

/// `ev3-blue._onbrick._tcp.local.` is the brick `ev3-blue`.
fn name_of(full: &str) -> String {
    line(full.strip_suffix(SERVICE).unwrap_or(full).trim_end_matches('.')).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bricks_name_is_what_stands_before_the_service() {
        assert_eq!(name_of("ev3-blue._onbrick._tcp.local."), "ev3-blue");
        assert_eq!(name_of("Room 12.blue._onbrick._tcp.local."), "Room 12.blue");
        assert_eq!(name_of("od\u{1b}d"), r"od\u{1b}d");
    }
}
