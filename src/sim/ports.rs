//! The eight ports of a brick, by name and by number. They are called as on an EV3, whatever the
//! board calls them.
//!
//! # Not here
//!
//! What is plugged in and how it is found: `sim::brick`.

use std::fmt;

use crate::ev3dev::{EV3, PLATFORMS, Platform};

/// A port of the brick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Port {
    /// `in1`.
    In1,
    /// `in2`.
    In2,
    /// `in3`.
    In3,
    /// `in4`.
    In4,
    /// `outA`.
    OutA,
    /// `outB`.
    OutB,
    /// `outC`.
    OutC,
    /// `outD`.
    OutD,
}

impl Port {
    /// Every port, in the order of the brick's own list.
    pub const ALL: [Self; 8] = [
        Self::In1,
        Self::In2,
        Self::In3,
        Self::In4,
        Self::OutA,
        Self::OutB,
        Self::OutC,
        Self::OutD,
    ];

    /// The port's short name.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        EV3.ports().nth(self.index()).unwrap_or_default()
    }

    /// The port with a name, as any board has it, short or full (`outB`, `MB`, `spi0.1:MB`).
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        let short = Platform::short(name);
        let place = PLATFORMS
            .into_iter()
            .find_map(|platform| platform.ports().position(|port| port == short))?;
        Self::ALL.get(place).copied()
    }

    pub(crate) fn index(self) -> usize {
        self as usize
    }

    /// Its place among the four of its kind: 0 for in1 and outA.
    pub(crate) fn place(self) -> usize {
        self.index() % 4
    }

    /// True for a motor's port.
    pub(crate) fn is_output(self) -> bool {
        self.index() >= Self::OutA.index()
    }
}

impl fmt::Display for Port {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}
