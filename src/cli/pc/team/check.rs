//! Before anything moves: is every brick of the team there and ready, and would all do the same?

use std::collections::BTreeMap;

use serde::Serialize;

use super::super::remote::Asking;
use super::super::status::battery;
use super::Wanted;
use crate::cli::{Exit, Failure, Output};
use crate::document::nearest;
use crate::link::{ClientError, KnownBrick};
use crate::protocol::{Chosen, LastStop, MissionInfo, Missions, State, Status, whose};
use crate::units::counted;

/// What was found about one brick.
#[derive(Debug)]
pub(super) struct Checked {
    brick: KnownBrick,
    status: Option<Status>,
    /// The mission as the brick has it, where it was named.
    mission: Option<MissionInfo>,
    /// What the mission is called, where there is one.
    called: Option<String>,
    /// What keeps it from starting.
    problems: Vec<String>,
    /// It did not answer, which says nothing about the brick itself.
    silent: bool,
}

/// Asks all of them at the same time.
pub(super) fn all(asking: &Asking, wanted: Option<&Wanted>) -> Vec<Checked> {
    let answers = asking.ask(|client, _| {
        let status = client.status()?;
        let missions = match wanted.map(|wanted| &wanted.chosen) {
            Some(Chosen::Name(_)) => Some(client.missions()?),
            _ => None,
        };
        Ok::<_, ClientError>((status, missions))
    });
    let called = wanted.map(|wanted| wanted.name.clone());
    let mut checked: Vec<Checked> = answers
        .into_iter()
        .map(|(brick, answer)| {
            let mut checked = Checked {
                brick,
                status: None,
                mission: None,
                called: called.clone(),
                problems: Vec::new(),
                silent: false,
            };
            match answer {
                Ok((status, missions)) => checked.note(status, missions),
                Err(failure) => checked.unheard(failure),
            }
            checked
        })
        .collect();
    compare(&mut checked, "onbrick", |checked| Some(checked.status.as_ref()?.version.clone()));
    compare(&mut checked, "mission", |checked| Some(short(checked.mission.as_ref()?).to_owned()));
    checked
}

impl Checked {
    fn unheard(&mut self, failure: Failure) {
        self.silent = failure.exit == Exit::NoAnswer;
        let hint = failure.hint.filter(|_| !self.silent).map(|hint| format!("; {hint}"));
        self.problems.push(failure.message + &hint.unwrap_or_default());
    }

    fn note(&mut self, status: Status, missions: Option<Missions>) {
        self.problems.extend(unready(&status));
        self.problems.extend(status.battery.clone());
        self.problems.extend(status.taken.clone());
        if let Some(missions) = missions {
            let name = self.called.clone().unwrap_or_default();
            match missions.missions.iter().find(|mission| mission.name == name) {
                Some(mission) => {
                    if let Some(findings) = &mission.findings {
                        let first = first_line(findings);
                        self.problems
                            .push(format!("mission {name}: {first}; onbrick missions shows all"));
                    }
                    self.mission = Some(mission.clone());
                }
                None => {
                    let known = missions.missions.iter().map(|mission| mission.name.as_str());
                    let near =
                        nearest(&name, known).map(|hint| format!("; {hint}")).unwrap_or_default();
                    self.problems.push(format!("it has no mission {name}{near}"));
                }
            }
        }
        self.status = Some(status);
    }
}

/// What keeps a brick from starting a run.
pub(in crate::cli::pc) fn unready(status: &Status) -> Option<String> {
    let last = status.last.as_ref().map(LastStop::to_string).unwrap_or_default();
    let last = first_line(&last);
    match status.state {
        State::Ready | State::Stopped => {
            status.robot.as_ref().map(|finding| format!("robot: {}", first_line(finding)))
        }
        State::Fault => Some(format!(
            "fault: {last}; press Enter on the brick once it is fixed, or onbrick stop"
        )),
        State::Preparing | State::Running | State::Stopping => Some(match &status.run {
            Some(run) => format!("busy: {} ({}), started {}", run.mission, run.run, whose(&run.by)),
            None => status.state.to_string(),
        }),
    }
}

fn first_line(text: &str) -> &str {
    text.lines().next().unwrap_or_default().trim_start_matches("error: ")
}

/// What one brick has and most have otherwise; where two are as many, the one that comes first in
/// the file is taken for most.
fn compare(checked: &mut [Checked], what: &str, of: impl Fn(&Checked) -> Option<String>) {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    let found: Vec<Option<String>> = checked.iter().map(of).collect();
    for value in found.iter().flatten() {
        *counts.entry(value.clone()).or_default() += 1;
    }
    let Some(most) = counts.values().max() else { return };
    let Some(usual) = found.iter().flatten().find(|value| counts.get(*value) == Some(most)) else {
        return;
    };
    for (one, value) in checked.iter_mut().zip(&found) {
        if let Some(value) = value.as_ref().filter(|value| *value != usual) {
            one.problems.push(format!("another {what}: {value}, and the others have {usual}"));
        }
    }
}

/// A mission's hash, as much of it as a person compares.
fn short(mission: &MissionInfo) -> &str {
    mission.sha256.get(..8).unwrap_or("unread")
}

/// The table.
pub(super) fn show(checked: &[Checked], output: &mut Output) {
    #[derive(Serialize)]
    struct Row<'c> {
        brick: &'c str,
        ready: bool,
        problems: &'c [String],
        version: Option<&'c str>,
        battery_v: Option<f64>,
        mission: Option<&'c str>,
        sha256: Option<&'c str>,
    }
    for one in checked {
        output.value(&Row {
            brick: &one.brick.name,
            ready: one.problems.is_empty(),
            problems: &one.problems,
            version: one.status.as_ref().map(|status| status.version.as_str()),
            battery_v: one.status.as_ref().and_then(|status| status.battery_v),
            mission: one.called.as_deref(),
            sha256: one.mission.as_ref().map(|mission| mission.sha256.as_str()),
        });
    }
    output.line(table(checked));
}

fn table(checked: &[Checked]) -> String {
    let head = ["brick", "battery", "onbrick", "mission", ""].map(str::to_owned);
    let rows: Vec<[String; 5]> = std::iter::once(head).chain(checked.iter().map(row)).collect();
    let widths = [0, 1, 2, 3].map(|column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column));
        cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
    });
    let line = |row: &[String; 5]| {
        let [brick, battery, version, mission, ready] = row;
        let [a, b, c, d] = widths;
        format!("{brick:a$}  {battery:>b$}  {version:c$}  {mission:d$}  {ready}")
            .trim_end()
            .to_owned()
    };
    rows.iter().map(line).collect::<Vec<_>>().join("\n")
}

fn row(checked: &Checked) -> [String; 5] {
    let status = checked.status.as_ref();
    let unknown = || "?".to_owned();
    let mission = match (&checked.called, &checked.mission) {
        (Some(called), Some(mission)) => format!("{called} {}", short(mission)),
        (Some(called), None) if status.is_some() => called.clone(),
        (None, _) => String::new(),
        _ => unknown(),
    };
    [
        checked.brick.name.clone(),
        status.map_or_else(unknown, battery),
        status.map_or_else(unknown, |status| status.version.clone()),
        mission,
        if checked.problems.is_empty() { "ready".to_owned() } else { checked.problems.join("; ") },
    ]
}

/// Whether all may start; `so` says what comes of it where not.
pub(super) fn verdict(checked: &[Checked], so: &str) -> Result<(), Failure> {
    let unready: Vec<&Checked> = checked.iter().filter(|one| !one.problems.is_empty()).collect();
    if unready.is_empty() {
        return Ok(());
    }
    let names = unready.iter().map(|one| one.brick.name.as_str()).collect::<Vec<_>>().join(", ");
    let (few, all) = (unready.len(), counted(checked.len(), "brick"));
    let exit = if unready.iter().all(|one| one.silent) { Exit::NoAnswer } else { Exit::Refused };
    let are = if few == 1 { "is" } else { "are" };
    Err(Failure::new(exit, format!("{few} of {all} {are} not ready{so}: {names}")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::PublicKey;
    use crate::protocol::Disk;
    use crate::runtime::StopReason;

    fn status(version: &str) -> Status {
        Status {
            brick: "b".to_owned(),
            version: version.to_owned(),
            protocol: 1,
            state: State::Ready,
            state_s: 0.0,
            run: None,
            last: None,
            battery_v: Some(7.64),
            simulated: false,
            battery: None,
            taken: None,
            token: String::new(),
            link: "ready".to_owned(),
            disk: Disk { used: 0, quota: 0, free: 0 },
            robot: None,
            clock: None,
        }
    }

    fn mission(sha256: &str, findings: Option<&str>) -> Missions {
        let info = MissionInfo {
            name: "map".to_owned(),
            sha256: sha256.repeat(8),
            time_limit_s: Some(120.0),
            findings: findings.map(str::to_owned),
        };
        Missions { missions: vec![info] }
    }

    fn checked(name: &str, called: &str) -> Checked {
        Checked {
            brick: KnownBrick {
                name: name.to_owned(),
                address: name.to_owned(),
                key: PublicKey::from_bytes([1; 32]),
            },
            status: None,
            mission: None,
            called: Some(called.to_owned()),
            problems: Vec::new(),
            silent: false,
        }
    }

    fn team() -> Vec<Checked> {
        let mut team: Vec<Checked> =
            ["blue", "red", "green", "grey"].map(|name| checked(name, "map")).into();
        team[0].note(status("1.0.0"), Some(mission("a", None)));
        team[1].note(
            status("0.9.0"),
            Some(mission("b", Some("error: unknown key `x`\n  --> map.toml:1"))),
        );
        team[2].note(status("1.0.0"), Some(mission("a", None)));
        team[3].unheard(Failure::new(Exit::NoAnswer, "no answer from grey").hint("is it on?"));
        compare(&mut team, "onbrick", |checked| Some(checked.status.as_ref()?.version.clone()));
        compare(&mut team, "mission", |checked| Some(short(checked.mission.as_ref()?).to_owned()));
        team
    }

    #[test]
    fn the_table_says_who_is_ready_and_why_the_others_are_not() {
        let expected = "\
brick  battery  onbrick  mission
blue     7.6 V  1.0.0    map aaaaaaaa  ready
red      7.6 V  0.9.0    map bbbbbbbb  mission map: unknown key `x`; onbrick missions shows all; \
another onbrick: 0.9.0, and the others have 1.0.0; \
another mission: bbbbbbbb, and the others have aaaaaaaa
green    7.6 V  1.0.0    map aaaaaaaa  ready
grey         ?  ?        ?             no answer from grey";
        assert_eq!(table(&team()), expected);
    }

    #[test]
    fn one_that_is_not_ready_keeps_all_from_starting() {
        let team = team();
        let failure = verdict(&team, "").unwrap_err();
        assert_eq!(
            (failure.exit, failure.message.contains("red, grey")),
            (Exit::Refused, true),
            "{failure:?}"
        );
        let words = |team: &[Checked]| verdict(team, ", so none starts").unwrap_err().message;
        assert_eq!(words(&team[3..]), "1 of 1 brick is not ready, so none starts: grey");
        assert_eq!(words(&team[2..]), "1 of 2 bricks is not ready, so none starts: grey");
        assert!(words(&team).starts_with("2 of 4 bricks are not ready"));
        assert_eq!(verdict(&team[3..], "").unwrap_err().exit, Exit::NoAnswer);
        assert!(verdict(&team[..1], "").is_ok());
    }

    #[test]
    fn a_brick_is_not_ready_for_what_its_status_says() {
        let last = |reason: StopReason| LastStop::new(None, "", reason.into());
        let fault =
            Status { state: State::Fault, last: Some(last(StopReason::Stalled)), ..status("1") };
        assert!(unready(&fault).unwrap().starts_with("fault: a wheel is blocked; press Enter"));
        let robot = Status {
            robot: Some("error: unknown port\n --> robot.toml".to_owned()),
            ..status("1")
        };
        assert_eq!(unready(&robot).as_deref(), Some("robot: unknown port"));
        let running = Status { state: State::Running, ..status("1") };
        assert_eq!(unready(&running).as_deref(), Some("running"));
        assert_eq!(
            unready(&Status {
                state: State::Stopped,
                last: Some(last(StopReason::Finished)),
                ..status("1")
            }),
            None
        );
        let mut low = checked("low", "mapp");
        low.note(
            Status { battery: Some("charge it".to_owned()), ..status("1") },
            Some(mission("a", None)),
        );
        assert_eq!(low.problems, ["charge it", "it has no mission mapp; did you mean `map`?"]);
    }
}
