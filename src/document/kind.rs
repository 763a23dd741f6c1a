//! Files that are taken for one another: a world that is given as a mission.

use super::{Section, Severity};

/// What a file is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// What the robot does.
    Mission,
    /// What is plugged in where.
    Robot,
    /// A simulated room.
    World,
    /// Several bricks.
    Team,
    /// A part of missions.
    Submachine,
}

/// Each kind, what it is called, the keys that no other kind has, and how it is used.
const KINDS: [(Kind, &str, &[&str], &str); 5] = [
    (Kind::Mission, "a mission", &["machine"], "`onbrick run FILE`"),
    (
        Kind::Robot,
        "a robot",
        &["drive", "head", "gyro", "range"],
        "`onbrick run MISSION --robot FILE`",
    ),
    (
        Kind::World,
        "a world",
        &["floor", "wall", "block", "circle", "start"],
        "`onbrick run MISSION --sim FILE`",
    ),
    (
        Kind::Team,
        "a team",
        &["brick"],
        "`onbrick team FILE MISSION`, or `onbrick status --team FILE`,",
    ),
    (
        Kind::Submachine,
        "a sub-machine",
        &["submachine"],
        "`use = \"NAME\"` in a state of a mission beside it",
    ),
];

impl Section<'_> {
    /// Whether a whole file is of another kind than is wanted: then that is the one finding.
    pub fn is_of_another_kind(&self, wanted: Kind) -> bool {
        let has = |keys: &[&str]| keys.iter().any(|key| self.get(key).is_some());
        let Some((_, what, own, _)) = KINDS.iter().find(|row| row.0 == wanted) else {
            return false;
        };
        if has(own) {
            return false;
        }
        let Some((_, is, _, how)) = KINDS.iter().find(|row| has(row.2)) else { return false };
        self.note(0..0, Severity::Error, format!("this file is {is}, not {what}"))
            .hint(format!("{how} takes it"));
        true
    }
}
