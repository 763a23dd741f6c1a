//! Where a part is plugged in.
//!
//! # Not here
//!
//! Nothing is looked up on a brick.

use super::RobotConfig;
use crate::document::{Item, Section, Severity, one_of};
use crate::ev3dev::{EV3, NotAPort, Platform, PortAddress};

/// The port of a section, if it has one; `None` where it is wrong.
#[expect(clippy::option_option, reason = "absent and wrong are different")]
pub(super) fn port(section: &Section<'_>) -> Option<Option<PortAddress>> {
    section.get("port").map_or(Some(None), |item| address(&item).map(Some))
}

/// A port; `None` where it is none.
pub(super) fn address(item: &Item<'_>) -> Option<PortAddress> {
    let refused = |error: NotAPort| {
        item.error(format!("{error}")).hint("such as \"outA\", \"in1\" or \"spi0.1:MB\"");
    };
    let port: PortAddress = item.text()?.parse().map_err(refused).ok()?;
    if !port.as_str().contains(':') && !Platform::may_have(port.as_str()) {
        item.error(format!("no board has a port `{port}`"))
            .hint(one_of(port.as_str(), EV3.ports()));
        return None;
    }
    Some(port)
}

/// Two roles cannot share a port, but range and remote may both be named for the one infrared
/// sensor only to be told why not.
pub(super) fn taken_once(root: &Section<'_>, config: &RobotConfig) {
    let taken: Vec<_> = config.ports().collect();
    for (index, (role, port)) in taken.iter().enumerate() {
        let Some(port) = port else { continue };
        let is_same = |other: &PortAddress| other.fits(port) || port.fits(other);
        if let Some((other, _)) =
            taken[..index].iter().find(|(_, other)| other.is_some_and(is_same))
        {
            root.note(
                place_of_port(root, role),
                Severity::Error,
                format!("`{role}` and `{other}` are both on {port}"),
            )
            .hint("one device has one role; a sensor gives one kind of value at a time");
        }
    }
}

fn place_of_port(root: &Section<'_>, role: &str) -> std::ops::Range<usize> {
    let mut section = root.clone();
    for key in role.split('.') {
        let Some(next) = section.section(key) else { return section.place() };
        section = next;
    }
    section.get("port").map_or_else(|| section.place(), |port| port.place())
}
