//! `team.toml`: bricks that run one mission at the same time, and where each of them starts.
//!
//! ```toml
//! mission = "map"
//!
//! [brick.ev3-blue]                 # by the name that known_bricks has
//! x_m = 0.0
//! y_m = 0.0
//!
//! [brick.ev3-red]
//! x_m = 3.0
//! y_m = 0.0
//! heading_deg = 90
//! ```
//!
//! # Not here
//!
//! No file is opened, and no brick is asked: what a team does is `cli`'s.

use super::keys::ON_THE_BRICK;
use super::{KnownBrick, KnownBricks, PublicKey};
use crate::document::{Document, Findings, Item, Section, Severity, nearest};

/// The commented file to start from.
pub const TEMPLATE: &str = include_str!("team.toml");

/// Start poses nearer to each other than this are warned of, metres: the ultrasonic sensor measures
/// up to 2.55 m and takes another one's chirps for its own echoes.
pub const CLOSE_M: f64 = 2.55;

/// Start poses nearer to each other than this are a mistake, metres: a robot is longer, so one
/// would stand in the other.
const SAME_PLACE_M: f64 = 0.1;

/// Farther away than this is a slip of the pen, metres.
const FARTHEST_M: f64 = 1e4;

/// The most bricks in a team.
const MOST_BRICKS: usize = 100;

/// A team.
#[derive(Debug, Clone, PartialEq)]
pub struct Team {
    /// What it is called.
    pub name: String,
    /// The mission: a name that bricks know, or a file's path below the folder of `team.toml`.
    pub mission: Option<String>,
    /// Its bricks, in the order of the file.
    pub members: Vec<Member>,
}

/// A brick of a team.
#[derive(Debug, Clone, PartialEq)]
pub struct Member {
    /// The brick.
    pub brick: KnownBrick,
    /// Where it starts in the frame that all share: x and y in metres, heading in degrees
    /// anticlockwise from x.
    pub pose: [f64; 3],
}

impl Team {
    /// Reads a team; `name` is what findings call the file, `known` tells addresses and keys where
    /// the file does not.
    ///
    /// # Errors
    ///
    /// Everything that is wrong in it, each with its place.
    pub fn parse(
        name: &str,
        bytes: &[u8],
        known: &KnownBricks,
    ) -> Result<(Self, Findings), Findings> {
        Document::new(name, bytes)?.read(|root| team(root, known))
    }
}

fn team(root: &Section<'_>, known: &KnownBricks) -> Option<Team> {
    root.allow(&["name", "mission", "brick"]);
    let text = |key: &str| root.get(key).map(|item| filled(&item));
    let (name, mission) = (text("name"), text("mission"));
    let bricks = root.require("brick")?;
    let items = bricks.section()?.items();
    if items.is_empty() || items.len() > MOST_BRICKS {
        bricks.error(format!("a team has 1 to {MOST_BRICKS} bricks, and this one {}", items.len()));
    }
    let members: Vec<Option<Member>> = items.iter().map(|item| member(item, known)).collect();
    for (at, (item, member)) in items.iter().zip(&members).enumerate() {
        let before = members.iter().take(at).flatten();
        if let Some(member) = member {
            before.for_each(|other| compare(root, item, member, other));
        }
    }
    // What is there must be right, and every brick.
    let name = name.unwrap_or_else(|| Some("team".to_owned()))?;
    let mission = mission.map_or(Some(None), |mission| mission.map(Some))?;
    Some(Team { name, mission, members: members.into_iter().collect::<Option<_>>()? })
}

/// A text that is not empty.
fn filled(item: &Item<'_>) -> Option<String> {
    let text = item.text()?;
    if text.trim().is_empty() {
        item.error(format!("`{}` is empty", item.path()));
        return None;
    }
    Some(text.to_owned())
}

fn member(item: &Item<'_>, known: &KnownBricks) -> Option<Member> {
    let section = item.section()?;
    section.allow(&["x_m", "y_m", "heading_deg", "address", "key"]);
    let metres = |key: &str| section.require(key)?.number(-FARTHEST_M..=FARTHEST_M);
    let (x_m, y_m) = (metres("x_m"), metres("y_m"));
    let heading_deg = match section.get("heading_deg") {
        Some(item) => item.number(-360.0..=360.0),
        None => Some(0.0),
    };
    let brick = brick(item, &section, known);
    Some(Member { brick: brick?, pose: [x_m?, y_m?, heading_deg?] })
}

/// Who it is: as it is known, as the file says, or both.
fn brick(item: &Item<'_>, section: &Section<'_>, known: &KnownBricks) -> Option<KnownBrick> {
    let name = item.key();
    let address = section.get("address").map(|item| filled(&item));
    let key = section.get("key").map(|item| PublicKey::read(&item, ON_THE_BRICK));
    let known_as = known.find(name);
    if known_as.is_none() && (address.is_none() || key.is_none()) {
        let names: Vec<&str> = known.iter().map(|brick| brick.name.as_str()).collect();
        let hint = nearest(name, names.iter().copied());
        let pair = || format!("onbrick pair {name}, or its `address` and `key` here");
        item.error_at_key(format!("no brick `{name}` is known on this PC"))
            .hint(hint.map_or_else(pair, |hint| format!("{hint} If not: {}", pair())));
        return None;
    }
    let address = address.unwrap_or_else(|| known_as.map(|known| known.address.clone()));
    let key = key.unwrap_or_else(|| known_as.map(|known| known.key));
    Some(KnownBrick { name: name.to_owned(), address: address?, key: key? })
}

impl Member {
    /// How far from another one it starts, metres.
    fn apart_m(&self, other: &Self) -> f64 {
        libm::hypot(self.pose[0] - other.pose[0], self.pose[1] - other.pose[1])
    }

    /// What keeps it from starting together with another one, each with a way out, which may be
    /// empty: the two are one, or stand in each other.
    pub(crate) fn clashes(&self, other: &Self) -> Vec<(String, &'static str)> {
        let (name, before) = (&self.brick.name, &other.brick.name);
        let mut clashes = Vec::new();
        if self.brick.key == other.brick.key {
            let message = format!("{name} and {before} are the same brick: they have the same key");
            clashes.push((message, ""));
        }
        if self.apart_m(other) < SAME_PLACE_M {
            let way_out = "measure where each robot stands: the maps are put together by it";
            clashes.push((format!("{name} and {before} start in the same place"), way_out));
        }
        clashes
    }
}

/// Two bricks that cannot start together, or that hear each other.
fn compare(root: &Section<'_>, item: &Item<'_>, member: &Member, other: &Member) {
    let (name, before) = (&member.brick.name, &other.brick.name);
    for (message, way_out) in member.clashes(other) {
        item.error_at_key(message).hint(way_out);
    }
    let apart_m = member.apart_m(other);
    if (SAME_PLACE_M..CLOSE_M).contains(&apart_m) {
        let message = format!(
            "{name} and {before} start {apart_m:.2} m apart: their ultrasonic sensors disturb each \
             other within {CLOSE_M} m"
        );
        root.note(item.key_place(), Severity::Warning, message)
            .hint("walls between them, more room, or one after the other");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn known() -> (tempfile::TempDir, KnownBricks) {
        let folder = tempfile::tempdir().unwrap();
        let mut known = KnownBricks::load(folder.path()).unwrap();
        for (name, byte) in [("ev3-blue", 1), ("ev3-red", 2)] {
            let key = PublicKey::from_bytes([byte; 32]);
            known
                .put(
                    &KnownBrick { name: name.to_owned(), address: format!("{name}.local"), key },
                    None,
                )
                .unwrap();
        }
        (folder, known)
    }

    fn parse(text: &str) -> Result<(Team, String), String> {
        let (_folder, known) = known();
        let parsed = Team::parse("team.toml", text.as_bytes(), &known);
        parsed
            .map(|(team, notes)| (team, notes.to_string()))
            .map_err(|findings| findings.to_string())
    }

    #[test]
    fn the_template_is_the_seeds_case_and_in_order() {
        let (team, notes) = parse(TEMPLATE).unwrap();
        assert_eq!(notes, "");
        let members: Vec<(&str, [f64; 3])> =
            team.members.iter().map(|member| (member.brick.name.as_str(), member.pose)).collect();
        assert_eq!(members, [("ev3-blue", [0.0; 3]), ("ev3-red", [3.0, 0.0, 90.0])]);
        assert_eq!((team.name.as_str(), team.mission.as_deref()), ("team", Some("map")));
        assert_eq!(team.members[1].brick.address, "ev3-red.local");
        let uncommented = TEMPLATE.replace("#: ", "");
        assert_eq!(parse(&uncommented).unwrap().0.members[1].brick.address, "192.168.1.7");
    }

    #[test]
    fn a_brick_that_is_not_known_needs_both_address_and_key() {
        let place = "x_m = 9\ny_m = 0\n";
        let key = PublicKey::from_bytes([9; 32]);
        let (team, _) =
            parse(&format!("[brick.new]\n{place}address = \"10.0.0.9\"\nkey = '{key}'\n")).unwrap();
        assert_eq!((team.members[0].brick.key, team.members[0].pose[2]), (key, 0.0));
        let error = parse(&format!("[brick.new]\n{place}address = \"10.0.0.9\"\n")).unwrap_err();
        assert!(error.contains("team.toml:1:8") && error.contains("onbrick pair new"), "{error}");
    }

    #[test]
    fn every_mistake_has_its_place_and_a_way_out() {
        let text = "misson = \"map\"\nmission = \"\"\n[brick.ev3-bleu]\nx_m = 0\ny_m = 0\n\
                    [brick.ev3-red]\nx_m = \"here\"\nheading = 5\nheading_deg = 400\n";
        let error = parse(text).unwrap_err();
        for part in [
            "team.toml:1:1",
            "did you mean `mission`?",
            "`mission` is empty",
            "no brick `ev3-bleu` is known",
            "did you mean `ev3-blue`?",
            "`brick.ev3-red.x_m` must be a number",
            "`y_m` is missing in [brick.ev3-red]",
            "did you mean `heading_deg`?",
            "it can be -360 to 360",
        ] {
            assert!(error.contains(part), "{part}:\n{error}");
        }
        assert!(parse("").unwrap_err().contains("`brick` is missing"));
        assert!(parse("[brick]\n").unwrap_err().contains("1 to 100 bricks"));
    }

    #[test]
    fn bricks_that_start_close_to_each_other_are_warned_of_and_those_in_one_place_refused() {
        let at = |x_m: f64| {
            format!("[brick.ev3-blue]\nx_m = 0\ny_m = 0\n[brick.ev3-red]\nx_m = {x_m}\ny_m = 0\n")
        };
        assert_eq!(parse(&at(2.6)).unwrap().1, "");
        let notes = parse(&at(1.5)).unwrap().1;
        assert!(notes.contains("1.50 m apart") && notes.contains("warning:"), "{notes}");
        assert!(notes.contains("team.toml:4:8"), "{notes}");
        assert!(parse(&at(0.05)).unwrap_err().contains("in the same place"));
        let twice =
            format!("{}address = \"x\"\nkey = '{}'\n", at(3.0), PublicKey::from_bytes([1; 32]));
        assert!(parse(&twice).unwrap_err().contains("the same brick"));
    }
}
