//! Several bricks that run one mission as a team: checked before anything moves, started at the
//! same time, each from its own pose in a frame that all share.
//!
//! # Not here
//!
//! The recordings come home as those of any other run; the page draws what has come of them in one
//! picture. The team's own recording (`team.mcap`) is `onbrick team`'s.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use serde::Deserialize;
use serde_json::{Value, json};

use super::brick::Brick;
use super::hall::Hall;
use crate::cli::pc::team::check::unready;
use crate::link::team;
use crate::threads::lock;

/// A brick of the team, and where it starts: metres, metres, degrees.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct Member {
    brick: usize,
    pose: [f64; 3],
}

/// The team that was started last.
#[derive(Debug, Default)]
pub(super) struct Together(Mutex<Option<Team>>);

#[derive(Debug, Clone)]
struct Team {
    mission: String,
    members: Vec<Member>,
}

impl Together {
    /// Who runs what from where.
    pub(super) fn state(&self) -> Value {
        let team = lock(&self.0);
        let Some(Team { mission, members }) = &*team else { return Value::Null };
        let members: Vec<Value> =
            members.iter().map(|Member { brick, pose }| json!([brick, pose])).collect();
        json!({ "mission": mission, "members": members })
    }

    /// The bricks of the team.
    pub(super) fn members(&self) -> Vec<usize> {
        let team = lock(&self.0);
        team.iter().flat_map(|team| &team.members).map(|member| member.brick).collect()
    }
}

/// Starts a team; where anything is wrong, nothing moves, and all of it is said.
pub(super) fn start(
    hall: &Hall,
    members: Vec<Member>,
    name: &str,
    text: &str,
) -> Result<(), String> {
    let checked = hall.missions.check(name, text);
    if checked.get("good") != Some(&Value::Bool(true)) {
        return Err("the mission is not in order".to_owned());
    }
    let bricks: Vec<Arc<Brick>> =
        members.iter().map(|member| hall.brick(member.brick)).collect::<Result<_, _>>()?;
    let problems = problems(&bricks, &members);
    if !problems.is_empty() {
        return Err(problems.join("\n"));
    }
    hall.whole(name, text)?;
    *lock(&hall.together.0) = Some(Team { mission: name.to_owned(), members: members.clone() });
    for (brick, member) in bricks.iter().zip(&members) {
        hall.start(brick, name, text, Some(member.pose))?;
    }
    Ok(())
}

/// What keeps a team from starting.
fn problems(bricks: &[Arc<Brick>], members: &[Member]) -> Vec<String> {
    let mut problems = Vec::new();
    if bricks.len() < 2 {
        problems.push("a team has two bricks at least".to_owned());
    }
    let mut versions: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    for brick in bricks {
        let (seen, name) = (lock(&brick.seen), &brick.known.name);
        match &seen.status {
            Some(status) if seen.silent_ns.is_none() => {
                versions.entry(status.version.clone()).or_default().push(name);
                let texts = unready(status)
                    .into_iter()
                    .chain(status.battery.clone())
                    .chain(status.taken.clone());
                problems.extend(texts.map(|text| format!("{name}: {text}")));
            }
            _ => problems.push(format!("{name} does not answer")),
        }
    }
    if versions.len() > 1 {
        let each =
            versions.iter().map(|(version, names)| format!("{} {version}", names.join(", ")));
        problems.push(format!(
            "not all have the same onbrick: {}",
            each.collect::<Vec<_>>().join("; ")
        ));
    }
    let placed = |(brick, member): (&Arc<Brick>, &Member)| team::Member {
        brick: brick.known.clone(),
        pose: member.pose,
    };
    let team: Vec<team::Member> = bricks.iter().zip(members).map(placed).collect();
    for (at, member) in team.iter().enumerate() {
        let clashes = team.iter().take(at).flat_map(|other| member.clashes(other));
        problems.extend(clashes.map(|(message, _)| message));
    }
    problems
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::Ordering;

    use super::*;
    use crate::link::{KeyPair, KnownBrick};

    #[test]
    fn a_brick_is_in_a_team_once_and_no_two_stand_in_one_place() {
        let folder = tempfile::tempdir().unwrap();
        let own = KeyPair::generate().unwrap();
        let brick = |name: &str, key| {
            let known =
                KnownBrick { name: name.to_owned(), address: "127.0.0.1:1".to_owned(), key };
            Brick::start(&known, &own, folder.path())
        };
        let (blue, red) =
            (brick("blue", own.public()), brick("red", KeyPair::generate().unwrap().public()));
        let at = |x_m: f64| Member { brick: 0, pose: [x_m, 0.0, 0.0] };
        let twice = problems(&[Arc::clone(&blue), Arc::clone(&blue)], &[at(0.0), at(3.0)]);
        let near = problems(&[Arc::clone(&blue), Arc::clone(&red)], &[at(0.0), at(0.05)]);
        let apart = problems(&[Arc::clone(&blue), Arc::clone(&red)], &[at(0.0), at(3.0)]);
        [blue, red].iter().for_each(|brick| brick.over.store(true, Ordering::Relaxed));
        assert!(twice.iter().any(|text| text.contains("the same brick")), "{twice:?}");
        assert!(near.iter().any(|text| text.contains("in the same place")), "{near:?}");
        assert_eq!(apart.len(), 2, "neither answers, and no more: {apart:?}");
    }
}
