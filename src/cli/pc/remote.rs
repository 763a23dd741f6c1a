//! What the commands for bricks have in common: which bricks are meant, asking them all at once,
//! and how it ends.

use std::io::ErrorKind;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::Args;

use crate::cli::common::{number_within, read_bounded, warn};
use crate::cli::key::Folder;
use crate::cli::{Exit, Failure, Output};
use crate::document::nearest;
use crate::link::client::PATIENCE_S;
use crate::link::pairing::pair_command;
use crate::link::{Client, ClientError, KeyPair, KnownBrick, KnownBricks, Patience, Team};
use crate::printable::in_shell;
use crate::protocol::{Kind, Refusal};
use crate::units::counted;

/// Which bricks, and how long they may take.
#[derive(Debug, Args)]
pub(super) struct Bricks {
    /// Bricks, by the name or the address under which known_bricks has them. Without one, every
    /// brick that is known; start, fetch and identify want one named where several are known.
    #[arg(value_name = "HOST")]
    hosts: Vec<String>,
    /// The bricks of a team: its file.
    #[arg(long, value_name = "TEAM", conflicts_with = "hosts")]
    pub(super) team: Option<PathBuf>,
    #[command(flatten)]
    pub(super) how: How,
}

/// How bricks are asked.
#[derive(Debug, Args)]
pub(in crate::cli) struct How {
    /// Seconds to wait for an answer: 10 by default, 2 for a list of bricks or of their missions.
    #[arg(long, value_parser = number_within(PATIENCES_S), value_name = "SECONDS")]
    timeout: Option<f64>,
    #[command(flatten)]
    pub(in crate::cli) folder: Folder,
}

/// How long a person may have bricks waited for, seconds.
pub(super) const PATIENCES_S: RangeInclusive<f64> = 0.1..=86_400.0;

/// Which bricks are meant where none is named.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unnamed {
    /// Every one that is known.
    All,
    /// The one that is known, if there is only one.
    TheOnly,
}

/// Bricks that are about to be asked.
#[derive(Debug, Clone)]
pub(super) struct Asking {
    own: KeyPair,
    timeout_s: f64,
    /// The same for a brick to which there is no connection.
    absent_s: f64,
    interrupted: Arc<AtomicBool>,
    /// The bricks, in the order in which they were named.
    pub(super) bricks: Vec<KnownBrick>,
}

/// One brick's answer; a failure's message does not name the brick.
pub(super) type Answer<T> = (KnownBrick, Result<T, Failure>);

/// How long an absent brick may hold up a list, seconds.
const LISTING_S: f64 = 2.0;

impl Bricks {
    /// Finds out who is meant for a list, which an absent brick holds up little.
    pub(super) fn listing(&self, unnamed: Unnamed) -> Result<Asking, Failure> {
        let asking = self.asking(unnamed)?;
        Ok(Asking { absent_s: self.how.timeout.unwrap_or(LISTING_S), ..asking })
    }

    /// Finds out who is meant.
    pub(super) fn asking(&self, unnamed: Unnamed) -> Result<Asking, Failure> {
        if let Some(team) = &self.team {
            return Ok(self.how.team(team)?.1);
        }
        let folder = self.how.folder.path()?;
        let known = KnownBricks::load(&folder)?;
        self.how.asking(&folder, chosen(&known, &self.hosts, unnamed)?)
    }
}

impl How {
    /// A team and its bricks, in the order of the file; warnings go to the log.
    pub(super) fn team(&self, path: &Path) -> Result<(Team, Asking), Failure> {
        let folder = self.folder.path()?;
        let known = KnownBricks::load(&folder)?;
        let new = || format!("onbrick new team {}, which writes one", in_shell(path));
        let bytes = read_bounded(path).map_err(|failure| failure.hint(new()))?;
        let parsed = Team::parse(&path.display().to_string(), &bytes, &known);
        let (team, warnings) = parsed.map_err(|findings| {
            let failure = Failure::refused(findings.to_string());
            if findings.iter().all(|finding| finding.hint.is_some()) {
                return failure;
            }
            failure.hint("onbrick new team, which shows a whole file with comments")
        })?;
        warn(&warnings);
        let bricks = team.members.iter().map(|member| member.brick.clone()).collect();
        let asking = self.asking(&folder, bricks)?;
        Ok((team, asking))
    }

    fn asking(&self, folder: &Path, bricks: Vec<KnownBrick>) -> Result<Asking, Failure> {
        Ok(Asking {
            own: KeyPair::load(folder)?,
            timeout_s: self.timeout.unwrap_or(PATIENCE_S),
            absent_s: self.timeout.unwrap_or(PATIENCE_S),
            interrupted: crate::cli::terminal::stop_flags()?.signal,
            bricks,
        })
    }

    /// The patience that was asked for.
    pub(in crate::cli) fn patience(&self, interrupted: &Arc<AtomicBool>) -> Patience {
        Patience::new(self.timeout.unwrap_or(PATIENCE_S)).unless(Arc::clone(interrupted))
    }
}

fn chosen(
    known: &KnownBricks,
    hosts: &[String],
    unnamed: Unnamed,
) -> Result<Vec<KnownBrick>, Failure> {
    let all: Vec<KnownBrick> = known.iter().cloned().collect();
    if all.is_empty() {
        let message = format!("no brick is known yet in {}", known.path().display());
        return Err(Failure::refused(message).hint("onbrick pair HOST, with a person at the brick"));
    }
    let names = all.iter().map(|brick| brick.name.as_str()).collect::<Vec<_>>().join(", ");
    if hosts.is_empty() {
        return match unnamed {
            Unnamed::TheOnly if all.len() > 1 => {
                Err(Failure::usage(format!("which brick? {names} are known")))
            }
            _ => Ok(all),
        };
    }
    let find = |host: &String| {
        known.find(host).cloned().ok_or_else(|| {
            let hint = nearest(host, all.iter().map(|brick| brick.name.as_str()));
            let hint = hint.unwrap_or_else(|| format!("one of {names}, or onbrick pair {host}"));
            Failure::refused(format!("{host} is no brick that is known")).hint(hint)
        })
    };
    let mut found: Vec<KnownBrick> = Vec::new();
    for host in hosts {
        let brick = find(host)?;
        // One that is named twice is asked once: a second start would be refused as busy.
        if found.iter().all(|one| one.key != brick.key) {
            found.push(brick);
        }
    }
    Ok(found)
}

impl Asking {
    /// True once Ctrl-C was pressed.
    pub(super) fn interrupted(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.interrupted)
    }

    /// The same bricks, asked until another flag is raised, and with at least this patience,
    /// seconds.
    pub(super) fn until(&self, interrupted: &Arc<AtomicBool>, least_s: f64) -> Self {
        let (timeout_s, absent_s) = (self.timeout_s.max(least_s), self.absent_s.max(least_s));
        Self { timeout_s, absent_s, interrupted: Arc::clone(interrupted), ..self.clone() }
    }

    /// A client for one of the bricks.
    pub(super) fn client(&self, brick: &KnownBrick) -> Result<Client, ClientError> {
        let patience = Patience::new(self.timeout_s).if_absent(self.absent_s);
        let patience = patience.unless(Arc::clone(&self.interrupted));
        Ok(Client::new(&brick.address, brick.key, &self.own)?.with_patience(patience))
    }

    /// Asks all of them at the same time; the answers come in their order.
    pub(super) fn ask<T: Send>(
        &self,
        ask: impl Fn(&mut Client, &KnownBrick) -> Result<T, ClientError> + Sync,
    ) -> Vec<Answer<T>> {
        let mut answers: Vec<Option<Answer<T>>> = self.bricks.iter().map(|_| None).collect();
        self.ask_each(ask, |at, answer| answers[at] = Some(answer));
        answers.into_iter().flatten().collect()
    }

    /// Asks all of them at the same time; `hear` has each answer as it comes, with its brick's
    /// place.
    pub(super) fn ask_each<T: Send>(
        &self,
        ask: impl Fn(&mut Client, &KnownBrick) -> Result<T, ClientError> + Sync,
        mut hear: impl FnMut(usize, Answer<T>),
    ) {
        let one = |brick: &KnownBrick| -> Result<T, Failure> {
            let answered = self.client(brick).and_then(|mut client| ask(&mut client, brick));
            answered.map_err(|error| failure(brick, &error))
        };
        let one = &one;
        let (answers, coming) = std::sync::mpsc::channel();
        std::thread::scope(|scope| {
            let begin = |(at, brick)| {
                let answers = answers.clone();
                // The other end waits for all of them.
                (at, brick, scope.spawn(move || drop(answers.send((at, brick, one(brick))))))
            };
            let asked: Vec<_> = self.bricks.iter().enumerate().map(begin).collect();
            drop(answers);
            let mut tell = |at, brick: &KnownBrick, answer| hear(at, (brick.clone(), answer));
            coming.iter().for_each(|(at, brick, answer)| tell(at, brick, answer));
            for (at, brick, thread) in asked {
                if thread.join().is_err() {
                    tell(at, brick, Err(Failure::failed("the thread that asked has died")));
                }
            }
        });
    }
}

/// Shows what came of each brick: good answers by `show`, the others as a line and as JSON. With
/// one brick alone its failure is the command's.
pub(super) fn conclude<T>(
    answers: Vec<Answer<T>>,
    output: &mut Output,
    mut show: impl FnMut(&mut Output, &KnownBrick, T),
) -> Result<(), Failure> {
    let mut conclusion = Conclusion::of(answers.len());
    for answer in answers {
        conclusion.take(answer, output, &mut show);
    }
    conclusion.end()
}

/// The same, answer by answer.
pub(super) struct Conclusion {
    asked: usize,
    failures: Vec<Failure>,
}

impl Conclusion {
    /// Of this number of bricks.
    pub(super) fn of(asked: usize) -> Self {
        Self { asked, failures: Vec::new() }
    }

    pub(super) fn take<T>(
        &mut self,
        (brick, answer): Answer<T>,
        output: &mut Output,
        show: &mut impl FnMut(&mut Output, &KnownBrick, T),
    ) {
        match answer {
            Ok(answer) => show(output, &brick, answer),
            Err(failure) if self.asked == 1 => self.failures.push(named(&brick, failure)),
            Err(failure) => {
                let (error, exit) = (&failure.message, failure.exit as u8);
                output.show(
                    format!("{}: {error}", brick.name),
                    &serde_json::json!({ "brick": brick.name, "error": error, "exit": exit }),
                );
                self.failures.push(failure);
            }
        }
    }

    /// What the command comes to.
    pub(super) fn end(mut self) -> Result<(), Failure> {
        let Self { asked, failures } = &mut self;
        if *asked == 1 {
            return failures.pop().map_or(Ok(()), Err);
        }
        let Some(first) = failures.first() else { return Ok(()) };
        let silent = failures.iter().all(|failure| failure.exit == Exit::NoAnswer);
        let what = if silent { "did not answer" } else { "did not do it" };
        let message = format!("{} of {} {what}", failures.len(), counted(*asked, "brick"));
        let hint = first.hint.clone();
        let all_alike =
            failures.len() == *asked && failures.iter().all(|failure| failure.exit == first.exit);
        let exit = if all_alike { first.exit } else { Exit::SomeFailed };
        Err(Failure { hint, ..Failure::new(exit, message) })
    }
}

/// A brick's failure that is shown by itself: with the brick's name. Findings call themselves
/// errors, as the whole is called when it is shown.
pub(super) fn named(brick: &KnownBrick, failure: Failure) -> Failure {
    let message = failure.message.strip_prefix("error: ").unwrap_or(&failure.message);
    Failure { message: format!("{}: {message}", brick.name), ..failure }
}

/// A brick that did not do what it was asked, without its name.
pub(super) fn failure(brick: &KnownBrick, error: &ClientError) -> Failure {
    let message = crate::printable::with_causes(error);
    let refused = |hint: &str| Failure::refused(&message).hint(hint);
    match error {
        ClientError::NoAnswer { .. } => Failure::new(Exit::NoAnswer, message).hint(
            "is it switched on, in this network, and serving? onbrick bricks shows who is there",
        ),
        ClientError::NotAuthorised { .. } => refused(&pair_command(&brick.address)),
        ClientError::AnotherKey { .. } => {
            let pair = pair_command(&brick.address);
            refused(&format!("{pair} once more, if it was set up from scratch"))
        }
        ClientError::Refused(Refusal { hint: Some(hint), .. }) => refused(hint),
        ClientError::Refused(Refusal { kind: Kind::BrokenMission, .. }) => refused(
            "onbrick check, which says the same of a file here; with --robot, the brick's \
             robot.toml, also what the robot lacks",
        ),
        ClientError::Refused(_) => Failure::refused(message),
        ClientError::Taken { .. } => refused("wait for the other one, or -o with another folder"),
        ClientError::OtherRecording { .. } => {
            refused("-o with another folder, such as one for each brick; both are kept then")
        }
        ClientError::TooLong { .. } => refused(
            "onbrick runs, which tells how long its runs are; onbrick fetch --most-mb takes more",
        ),
        ClientError::File { source, .. }
            if matches!(
                source.kind(),
                ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem
            ) =>
        {
            refused("-o with a folder that can be written to")
        }
        _ => Failure::failed(message),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::KeyPair;

    #[test]
    fn a_line_of_a_brick_says_its_name_once() {
        let key = KeyPair::generate().unwrap().public();
        let brick = KnownBrick { name: "vm".to_owned(), address: "10.0.0.7".to_owned(), key };
        let fail = || failure(&brick, &ClientError::AnotherKey { address: "10.0.0.7".to_owned() });
        let failed = fail();
        assert!(failed.message.starts_with("what answers"), "{failed:?}");
        let mut output = Output::new(false);
        let alone = vec![(brick.clone(), Err::<(), _>(fail()))];
        let alone = conclude(alone, &mut output, |_, _, ()| {}).unwrap_err();
        assert!(alone.message.starts_with("vm: what answers"), "{alone:?}");
        let finding = Failure::refused("error: unknown key\n  --> mission.toml:1:1");
        assert!(named(&brick, finding).message.starts_with("vm: unknown key\n"));
        let answers = vec![(brick.clone(), Err::<(), _>(fail())), (brick.clone(), Ok(()))];
        let all = conclude(answers, &mut output, |_, _, ()| {}).unwrap_err();
        assert_eq!(all.message, "1 of 2 bricks did not do it");
        // The way out is not lost.
        assert_eq!(all.hint, failed.hint);
    }

    #[test]
    fn a_brick_that_is_named_twice_is_asked_once() {
        let folder = tempfile::tempdir().unwrap();
        let key = KeyPair::generate().unwrap().public();
        let brick = KnownBrick { name: "vm".to_owned(), address: "10.0.0.7".to_owned(), key };
        KnownBricks::load(folder.path()).unwrap().put(&brick, None).unwrap();
        let known = KnownBricks::load(folder.path()).unwrap();
        let hosts = ["vm", "10.0.0.7", "vm"].map(str::to_owned);
        assert_eq!(chosen(&known, &hosts, Unnamed::All).unwrap(), [brick]);
    }

    #[test]
    fn a_folder_that_cannot_be_written_to_is_refused_and_a_full_disk_is_a_failure() {
        let key = KeyPair::generate().unwrap().public();
        let brick = KnownBrick { name: "vm".to_owned(), address: "10.0.0.7".to_owned(), key };
        for (kind, exit) in [
            (ErrorKind::PermissionDenied, Exit::Refused),
            (ErrorKind::ReadOnlyFilesystem, Exit::Refused),
            (ErrorKind::StorageFull, Exit::Failed),
        ] {
            let error = ClientError::File { path: "r.mcap".into(), source: kind.into() };
            assert_eq!(failure(&brick, &error).exit, exit, "{kind}");
        }
    }
}
