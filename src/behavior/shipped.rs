//! The missions that come with the program, and the template that a new one starts from.

/// A mission that comes with the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shipped {
    /// Its name, which is its file's name too.
    pub name: &'static str,
    /// Its TOML.
    pub text: &'static str,
}

/// Every mission that comes with the program.
pub const MISSIONS: [Shipped; 10] = [
    Shipped { name: "map", text: include_str!("../../brick-image/missions/map.toml") },
    Shipped { name: "bump", text: include_str!("../../brick-image/missions/bump.toml") },
    Shipped { name: "wall", text: include_str!("../../brick-image/missions/wall.toml") },
    Shipped { name: "line", text: include_str!("../../brick-image/missions/line.toml") },
    Shipped { name: "edge", text: include_str!("../../brick-image/missions/edge.toml") },
    Shipped { name: "remote", text: include_str!("../../brick-image/missions/remote.toml") },
    Shipped { name: "square", text: include_str!("../../brick-image/missions/square.toml") },
    Shipped {
        name: "count-colours",
        text: include_str!("../../brick-image/missions/count-colours.toml"),
    },
    Shipped {
        name: "there-and-back",
        text: include_str!("../../brick-image/missions/there-and-back.toml"),
    },
    Shipped { name: "dance", text: include_str!("../../brick-image/missions/dance.toml") },
];

/// A mission with every key explained, for a person to change.
pub const TEMPLATE: &str = include_str!("shipped/template.toml");

/// The shipped mission of this name.
#[must_use]
pub fn find(name: &str) -> Option<&'static Shipped> {
    MISSIONS.iter().find(|mission| mission.name == name)
}
