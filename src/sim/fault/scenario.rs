//! Scenarios, in files of their own or in a world's: which fault comes when, and which button is
//! pressed.
//!
//! ```toml
//! [[fault]]
//! at_s = 10              # after the scenario was begun
//! until_s = 15           # left out: until the end
//! robot = 1              # the default
//! port = "in1"
//! kind = "delayed 200"   # the text of a fault, see DeviceFault
//!
//! [[battery]]
//! at_s = 0
//! from_v = 8.0
//! to_v = 5.0             # left out: stays at from_v
//! over_s = 60
//!
//! [[press]]
//! at_s = 3
//! button = "enter"
//! for_s = 1              # left out: 0.2
//! ```

use super::text::{self, LONGEST_S, OrderError, VOLTS};
use super::{Act, DeviceFault, Order};
use crate::clock::nanoseconds;
use crate::document::{Document, Findings, Item, Section};

/// The most orders that a scenario may have of a kind.
const MOST: usize = 10_000;

/// Faults ordered by time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scenario {
    /// Nanoseconds after its beginning; in order of time, and of the file where two come at once.
    orders: Vec<(i64, Order)>,
}

impl Scenario {
    /// Reads a scenario from the bytes of a file; `file` is what findings call it. Warnings come
    /// back beside it.
    ///
    /// # Errors
    ///
    /// All mistakes with their places: what is not TOML, unknown keys, ports and faults, times out
    /// of range.
    pub fn parse(file: &str, bytes: &[u8]) -> Result<(Self, Findings), Findings> {
        Document::new(file, bytes)?.read(|root| {
            root.allow(&Self::KEYS);
            Self::read(root)
        })
    }

    /// Its keys in a file.
    pub(in crate::sim) const KEYS: [&str; 3] = ["fault", "battery", "press"];

    /// Reads a scenario from a file that may have more in it; `None` where it is wrong.
    pub(in crate::sim) fn read(root: &Section<'_>) -> Option<Self> {
        let faults: Vec<_> = root.tables("fault", MOST, "").iter().map(fault).collect();
        let batteries: Vec<_> = root.tables("battery", MOST, "").iter().map(battery).collect();
        let presses: Vec<_> = root.tables("press", MOST, "").iter().map(press).collect();
        let orders: Option<Vec<_>> = faults.into_iter().chain(batteries).chain(presses).collect();
        orders.map(Self::new)
    }

    /// A scenario of these orders, each with its time in nanoseconds.
    #[must_use]
    pub fn new(mut orders: Vec<(i64, Order)>) -> Self {
        orders.sort_by_key(|(at_ns, _)| *at_ns);
        Self { orders }
    }

    /// The orders by time, in nanoseconds after the beginning.
    #[must_use]
    pub fn orders(&self) -> &[(i64, Order)] {
        &self.orders
    }
}

fn fault(section: &Section<'_>) -> Option<(i64, Order)> {
    section.allow(&["at_s", "until_s", "robot", "port", "kind"]);
    let at_s = time(section, "at_s");
    let robot = robot(section);
    let port = section.require("port").and_then(|item| understood(&item, text::port(item.text()?)));
    let kind = section.require("kind").and_then(|item| {
        let words: Vec<&str> = item.text()?.split_whitespace().collect();
        understood(&item, DeviceFault::from_words(&words))
    });
    let for_ns = match section.get("until_s") {
        Some(item) => Some(lasts(&item, at_s?, kind.as_ref()?)?),
        None => None,
    };
    Some((nanoseconds(at_s?), Order { robot: robot?, act: Act::Inject(port?, kind?, for_ns) }))
}

/// For how long a fault lasts, nanoseconds.
fn lasts(item: &Item<'_>, at_s: f64, kind: &DeviceFault) -> Option<i64> {
    let until_s = item.number(0.0..=LONGEST_S)?;
    if kind.is_momentary() {
        item.error_at_key(format!("`{kind}` is done at once")).hint("leave out `until_s`");
        return None;
    }
    if until_s <= at_s {
        item.error(format!("`until_s` is {until_s}, which is not after `at_s`, {at_s}"));
        return None;
    }
    Some(nanoseconds(until_s) - nanoseconds(at_s))
}

fn battery(section: &Section<'_>) -> Option<(i64, Order)> {
    section.allow(&["at_s", "robot", "from_v", "to_v", "over_s"]);
    let at_s = time(section, "at_s");
    let robot = robot(section);
    let from_v = section.require("from_v").and_then(|item| item.number(VOLTS));
    let to_v = section.value_or("to_v", None, |item| item.number(VOLTS).map(Some));
    let over_s = section.value_or("over_s", None, |item| item.number(0.0..=LONGEST_S).map(Some));
    let act = Act::Battery {
        from_v: from_v?,
        to_v: to_v?.or(from_v)?,
        over_ns: nanoseconds(over_s?.unwrap_or(0.0)),
    };
    Some((nanoseconds(at_s?), Order { robot: robot?, act }))
}

fn press(section: &Section<'_>) -> Option<(i64, Order)> {
    section.allow(&["at_s", "robot", "button", "for_s"]);
    let at_s = time(section, "at_s");
    let robot = robot(section);
    let button =
        section.require("button").and_then(|item| understood(&item, text::button(item.text()?)));
    let for_s = section.value_or("for_s", None, |item| item.number(0.002..=LONGEST_S).map(Some));
    let act = Act::Press(button?, for_s?.map_or(text::PRESS_NS, nanoseconds));
    Some((nanoseconds(at_s?), Order { robot: robot?, act }))
}

fn time(section: &Section<'_>, key: &str) -> Option<f64> {
    section.require(key)?.number(0.0..=LONGEST_S)
}

fn robot(section: &Section<'_>) -> Option<usize> {
    let Some(item) = section.get("robot") else { return Some(0) };
    usize::try_from(item.integer(1..=1000)? - 1).ok()
}

/// A value, or a finding at its place.
fn understood<T>(item: &Item<'_>, read: Result<T, OrderError>) -> Option<T> {
    read.map_err(|error| item.error(error.message).hint(error.hint.unwrap_or_default())).ok()
}
