//! The missions and sub-machines that come with the program, and the template that a new mission
//! starts from.

use super::mission::can_be_name;
use super::submachines;

/// A mission or a sub-machine that comes with the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shipped {
    /// Its name, which is its file's name too.
    pub name: &'static str,
    /// Its TOML.
    pub text: &'static str,
}

impl Shipped {
    /// Its TOML with the sub-machines that it uses.
    #[must_use]
    pub fn whole(&self) -> String {
        submachines::joined(self.text, |_| None)
    }
}

/// Every mission that comes with the program.
pub const MISSIONS: [Shipped; 11] = [
    Shipped { name: "map", text: include_str!("../../brick-image/missions/map.toml") },
    Shipped { name: "explore", text: include_str!("../../brick-image/missions/explore.toml") },
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

/// Every sub-machine that comes with the program.
pub const SUBMACHINES: [Shipped; 4] = [
    Shipped { name: "wander", text: include_str!("shipped/wander.toml") },
    Shipped { name: "look-round", text: include_str!("shipped/look-round.toml") },
    Shipped { name: "follow-wall", text: include_str!("shipped/follow-wall.toml") },
    Shipped { name: "come-home", text: include_str!("shipped/come-home.toml") },
];

/// A mission with every key explained, for a person to change.
pub const TEMPLATE: &str = include_str!("shipped/template.toml");

/// A mission's text under another name, by which its runs are called; as it is where that cannot be
/// a name.
#[must_use]
pub fn called(text: &str, name: &str) -> String {
    let own = text.lines().find_map(|line| line.strip_prefix("name = \"")?.split('"').next());
    match own {
        Some(own) if can_be_name(name) && !name.contains(['"', '\\']) => {
            text.replacen(&format!("name = \"{own}\""), &format!("name = \"{name}\""), 1)
        }
        _ => text.to_owned(),
    }
}

/// The shipped mission of this name.
#[must_use]
pub fn find(name: &str) -> Option<&'static Shipped> {
    MISSIONS.iter().find(|mission| mission.name == name)
}

/// The shipped sub-machine of this name.
#[must_use]
pub fn submachine(name: &str) -> Option<&'static Shipped> {
    SUBMACHINES.iter().find(|submachine| submachine.name == name)
}
