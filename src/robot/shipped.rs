//! The robots that come with the program.

/// A robot that comes with the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ShippedRobot {
    /// Its name, as in `--robot educator`.
    pub name: &'static str,
    /// What people call it.
    pub what: &'static str,
    /// Its `robot.toml`.
    pub text: &'static str,
}

/// The `robot.toml` of the seed's robot, which is used where there is no other.
pub const DEFAULT_ROBOT: &str = include_str!("../../brick-image/robot.toml");

/// Every robot that comes with the program, the usual one first.
pub const ROBOTS: [ShippedRobot; 3] = [
    ShippedRobot {
        name: "mapper",
        what: "the mapping robot of \"Internet of Toys\"",
        text: DEFAULT_ROBOT,
    },
    ShippedRobot {
        name: "educator",
        what: "LEGO's Driving Base of the education set (45544)",
        text: include_str!("shipped/educator.toml"),
    },
    ShippedRobot {
        name: "retail",
        what: "a robot with two wheels from the retail set (31313)",
        text: include_str!("shipped/retail.toml"),
    },
];

impl ShippedRobot {
    /// The text of the shipped robot of this name.
    #[must_use]
    pub fn text(name: &str) -> Option<&'static str> {
        ROBOTS.iter().find(|robot| robot.name == name).map(|robot| robot.text)
    }
}
