//! Port addresses: where a device is plugged in.
//!
//! People write `outB`; the kernel writes `ev3-ports:outB`, `ev3-ports:in1:i2c1` for an I²C device,
//! and on other platforms of ev3dev `spi0.1:MA`. An address is a list of segments between colons,
//! and a wanted address fits where its segments stand together in the device's, from the first or
//! the second on: so the name of the board may be left out, and the I²C part too. The EV3's names
//! mean the same place on every board: `outB` is `MB` on a BrickPi3.

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use super::platform::Platform;
use super::value::{AttributeText, Legal, Value};

/// Where a device is plugged in, as a person or the kernel writes it.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PortAddress(Arc<str>);

/// A text that cannot be a port's address.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{text}` is no port; ports are written like outB, in1, ev3-ports:outB or spi0.1:MA")]
pub struct NotAPort {
    /// The text.
    pub text: String,
}

impl PortAddress {
    /// The address as it was written.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// The address without the name of the board's port driver: `outB` for `ev3-ports:outB`.
    #[must_use]
    pub fn short(&self) -> &str {
        Platform::short(&self.0)
    }

    /// Whether a device at the address `device` is meant by this one.
    #[must_use]
    pub fn fits(&self, device: &Self) -> bool {
        let from_second = device.0.split_once(':').map_or("", |(_, rest)| rest);
        starts_with_segments(&device.0, &self.0)
            || starts_with_segments(from_second, &self.0)
            || Platform::is_port(&self.0, &device.0)
    }
}

fn starts_with_segments(address: &str, wanted: &str) -> bool {
    address.strip_prefix(wanted).is_some_and(|rest| rest.is_empty() || rest.starts_with(':'))
}

impl FromStr for PortAddress {
    type Err = NotAPort;

    fn from_str(text: &str) -> Result<Self, NotAPort> {
        let is_segment = |segment: &str| {
            !segment.is_empty()
                && segment.chars().all(|c| c.is_ascii_graphic() && c != '/' && c != '\\')
        };
        if text.split(':').all(is_segment) {
            Ok(Self(text.into()))
        } else {
            Err(NotAPort { text: text.chars().take(80).collect() })
        }
    }
}

impl fmt::Display for PortAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.short())
    }
}

impl Value for PortAddress {
    const LEGAL: Legal = Legal::Text;

    fn parse(text: &[u8]) -> Option<Self> {
        std::str::from_utf8(text).ok()?.parse().ok()
    }

    fn render(&self, line: &mut AttributeText) -> fmt::Result {
        line.try_push_str(&self.0).map_err(|_| fmt::Error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn port(text: &str) -> PortAddress {
        text.parse().unwrap()
    }

    #[test]
    fn a_port_may_be_short_or_full_and_without_its_i2c_part() {
        #[rustfmt::skip]
        let cases = [
            // wanted             device                  fits
            ("outB",              "ev3-ports:outB",       true),
            ("ev3-ports:outB",    "ev3-ports:outB",       true),
            ("outB",              "ev3-ports:outA",       false),
            ("out",               "ev3-ports:outA",       false),
            ("in1",               "ev3-ports:in1:i2c1",   true),
            ("in1:i2c1",          "ev3-ports:in1:i2c1",   true),
            ("ev3-ports:in1",     "ev3-ports:in1:i2c1",   true),
            ("in1:i2c2",          "ev3-ports:in1:i2c1",   false),
            ("in1",               "ev3-ports:in10",       false),
            ("spi0.1:MA",         "spi0.1:MA",            true),
            ("MA",                "spi0.1:MA",            true),
            ("spi0.0:MA",         "spi0.1:MA",            false),
            ("outA",              "spi0.1:MA",            true),
            ("outB",              "spi0.1:MA",            false),
            ("outB",              "outB",                 true),
            ("ev3-ports:outB",    "outB",                 false),
        ];
        for (wanted, device, fits) in cases {
            assert_eq!(port(wanted).fits(&port(device)), fits, "{wanted} at {device}");
        }
    }

    #[test]
    fn what_cannot_be_a_port_is_refused() {
        for text in ["", " ", "out B", "a//b", "../outB", ":outB", "outB:", "out\nB", "ou\u{e4}B"] {
            assert!(text.parse::<PortAddress>().is_err(), "`{text}`");
        }
    }

    proptest! {
        #[test]
        fn any_text_is_a_port_that_fits_itself_or_refused(text in ".{0,60}") {
            if let Ok(port) = text.parse::<PortAddress>() {
                prop_assert!(port.fits(&port));
                prop_assert_eq!(port.as_str(), text);
            }
        }
    }
}
