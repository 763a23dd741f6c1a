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

/// Each name's file in a folder.
macro_rules! shipped {
    ($folder:literal: $($name:literal),*) => {
        [$(Shipped { name: $name, text: include_str!(concat!($folder, $name, ".toml")) }),*]
    };
}

/// Every mission that comes with the program.
#[rustfmt::skip]
pub const MISSIONS: [Shipped; 11] = shipped!(
    "../../brick-image/missions/":
    "map", "explore", "bump", "wall", "line", "edge", "remote", "square", "count-colours",
    "there-and-back", "dance"
);

/// Every sub-machine that comes with the program.
pub const SUBMACHINES: [Shipped; 4] =
    shipped!("shipped/": "wander", "look-round", "follow-wall", "come-home");

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

/// A file of sub-machines with the one of this name under another, by which missions use it; as it
/// is where that cannot be a name.
#[must_use]
pub fn called_submachine(text: &str, own: &str, name: &str) -> String {
    let is_bare = |letter: char| letter.is_ascii_alphanumeric() || "_-".contains(letter);
    if !can_be_name(name) || !name.chars().all(is_bare) {
        return text.to_owned();
    }
    let header = |own: &str| format!("[submachine.{own}");
    text.replace(&header(own), &header(name))
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
