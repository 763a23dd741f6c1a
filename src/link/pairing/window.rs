//! The brick's side of an introduction: the window, the one exchange that it takes, and what the
//! person at the brick says.

use std::sync::Mutex;

use serde::Deserialize;

use super::{Hex, Number, Said, Side, Step, code, commitment, random};
use crate::clock::{Clock as _, MonotonicClock, SECOND_NS};
use crate::link::keys::{Authorised, PublicKey};
use crate::protocol::{Id, Kind, Name, NotUnderstood, Pairing, Refusal, VERSION};
use crate::threads::lock;

/// The longest time that the window is open, seconds.
const LONGEST_S: u32 = 600;

/// How long a person has to compare the codes, nanoseconds.
const COMPARING_NS: i64 = 120 * SECOND_NS;

/// The pairing window of a brick: for the person at the brick, and for the PC that comes to it.
#[derive(Debug)]
pub struct PairingWindow {
    authorised: Authorised,
    name: Name,
    inner: Mutex<Inner>,
}

#[derive(Debug)]
struct Inner {
    /// The link's own key, or why there is no link.
    link: Result<PublicKey, String>,
    stage: Stage,
    /// Until when the window is open, on the monotonic clock.
    until_ns: i64,
}

#[derive(Debug, Clone, PartialEq)]
enum Stage {
    /// Pairing is closed.
    Closed,
    /// It waits for a PC.
    Open,
    /// A PC has come; its number is not yet known.
    Committed { pc: PublicKey, name: Name, commit: [u8; 32], number: Number },
    /// Both codes are shown; who has said that they are the same?
    Compare { pc: PublicKey, name: Name, code: String, here: bool, there: bool },
    /// The PC's key is authorised.
    Paired { pc: PublicKey, name: Name },
    /// It did not work out, because of this.
    Failed { why: String },
}

/// A request at the window.
#[derive(Deserialize)]
struct Asked {
    id: Id,
    version: u32,
    op: String,
    #[serde(flatten)]
    step: Step,
}

impl PairingWindow {
    /// A window that is closed, and stays so until the link has its keys.
    pub(in crate::link) fn new(authorised: Authorised, name: Name) -> Self {
        let link = Err("the link is not ready yet".to_owned());
        let inner = Inner { link, stage: Stage::Closed, until_ns: 0 };
        Self { authorised, name, inner: Mutex::new(inner) }
    }

    /// The link has its keys.
    pub(in crate::link) fn ready(&self, own: PublicKey) {
        self.with(|inner, _| (inner.link, inner.stage) = (Ok(own), Stage::Closed));
    }

    /// There is no link any more, because of this.
    pub(in crate::link) fn close(&self, why: &str) {
        self.with(|inner, _| (inner.link, inner.stage) = (Err(why.to_owned()), Stage::Closed));
    }

    /// True while a PC may come, or is being introduced.
    pub(in crate::link) fn is_open(&self) -> bool {
        self.with(|inner, _| inner.stage != Stage::Closed)
    }

    /// Opens the window for some time, at most ten minutes; 0 closes it. An exchange that was going
    /// on is over.
    pub fn open(&self, seconds: u32) -> Pairing {
        self.with(|inner, now_ns| {
            if inner.link.is_ok() {
                inner.until_ns =
                    now_ns.saturating_add(i64::from(seconds.min(LONGEST_S)) * SECOND_NS);
                inner.stage = if seconds == 0 { Stage::Closed } else { Stage::Open };
            }
            inner.shown(now_ns)
        })
    }

    /// What the window shows.
    #[must_use]
    pub fn state(&self) -> Pairing {
        self.with(|inner, now_ns| inner.shown(now_ns))
    }

    /// A person at the brick has compared the codes.
    pub fn answer(&self, same: bool) -> Pairing {
        self.with(|inner, now_ns| {
            if let Stage::Compare { here, .. } = &mut inner.stage {
                *here = same;
                if !same {
                    let why = "the codes are not the same, says the person at the brick".to_owned();
                    inner.stage = Stage::Failed { why };
                }
                self.conclude(inner);
            }
            inner.shown(now_ns)
        })
    }

    /// Answers a request that came to the window's socket from this key.
    pub(in crate::link) fn answer_request(
        &self,
        key: Option<PublicKey>,
        bytes: &[u8],
    ) -> Result<(Id, serde_json::Value), NotUnderstood> {
        let asked: Asked = serde_json::from_slice(bytes)
            .map_err(|error| Refusal::bad_request(format!("not a step of pairing: {error}")))?;
        let refuse = |refusal| NotUnderstood { id: Some(asked.id.clone()), refusal };
        if asked.version != VERSION {
            return Err(refuse(Refusal::of_version(asked.version)));
        }
        if asked.op != "pair" {
            return Err(refuse(Refusal::new(
                Kind::UnknownOperation,
                "the pairing window knows only `pair`",
            )));
        }
        let key = key.ok_or_else(|| {
            refuse(Refusal::new(Kind::NotAuthorised, "the connection has no key"))
        })?;
        let said = self.step(key, asked.step).map_err(refuse)?;
        let value = serde_json::to_value(said)
            .map_err(|error| Refusal::failed(format!("the answer is no JSON: {error}")))?;
        Ok((asked.id, value))
    }

    fn step(&self, pc: PublicKey, step: Step) -> Result<Said, Refusal> {
        self.with(|inner, now_ns| match step {
            Step::Commit { name, commit } => inner.commit(pc, name, commit),
            Step::Reveal { number } => inner.reveal(pc, &number.0, &self.name, now_ns),
            Step::Answer { same } => {
                inner.answered_there(pc, same)?;
                self.conclude(inner);
                inner.said(pc)
            }
            Step::How => inner.said(pc),
        })
    }

    /// Lets the PC in once both sides have said that the codes are the same.
    fn conclude(&self, inner: &mut Inner) {
        let Stage::Compare { pc, name, here: true, there: true, .. } = &inner.stage else {
            return;
        };
        inner.stage = match self.authorised.add(pc, name.as_str()) {
            Ok(_) => {
                log::info!("{name} may ask from now on ({})", pc.fingerprint());
                Stage::Paired { pc: *pc, name: name.clone() }
            }
            Err(error) => Stage::Failed { why: error.to_string() },
        };
    }

    fn with<T>(&self, act: impl FnOnce(&mut Inner, i64) -> T) -> T {
        let mut inner = lock(&self.inner);
        let now_ns = MonotonicClock.now_ns();
        inner.look_at_the_time(now_ns);
        act(&mut inner, now_ns)
    }
}

/// The refusal of a request out of turn.
fn not_now(what: &str) -> Refusal {
    Refusal::new(Kind::Busy, what)
        .hint("open the pairing window at the brick, then `onbrick pair` again")
}

impl Inner {
    fn look_at_the_time(&mut self, now_ns: i64) {
        if now_ns >= self.until_ns {
            self.stage = Stage::Closed;
        }
    }

    fn own(&self) -> Result<PublicKey, Refusal> {
        self.link.clone().map_err(|why| Refusal::new(Kind::Busy, why))
    }

    fn commit(&mut self, pc: PublicKey, name: Name, commit: Hex) -> Result<Said, Refusal> {
        let own = self.own()?;
        let number = match &self.stage {
            Stage::Open => random().map_err(|error| Refusal::failed(error.to_string()))?,
            // The same again: its answer was lost.
            Stage::Committed { pc: known, commit: before, number, .. }
                if *known == pc && *before == commit.0 =>
            {
                *number
            }
            _ => return Err(not_now("another introduction is going on, or the last one is over")),
        };
        let said = Said::Commit { commit: Hex(commitment(Side::Brick, &own, &number)) };
        self.stage = Stage::Committed { pc, name, commit: commit.0, number };
        Ok(said)
    }

    fn reveal(
        &mut self,
        pc: PublicKey,
        theirs: &Number,
        brick: &Name,
        now_ns: i64,
    ) -> Result<Said, Refusal> {
        let own = self.own()?;
        let Stage::Committed { pc: known, name, commit, number } = &self.stage else {
            return Err(not_now("nothing was committed to"));
        };
        if *known != pc {
            return Err(not_now("another introduction is going on"));
        }
        if commitment(Side::Pc, &pc, theirs) != *commit {
            let why = "the PC showed another number than it had committed to".to_owned();
            self.stage = Stage::Failed { why: why.clone() };
            return Err(Refusal::new(Kind::NotAuthorised, why));
        }
        let said = Said::Reveal { key: own.to_string(), number: Hex(*number), name: brick.clone() };
        let code = code((&pc, theirs), (&own, number));
        self.stage = Stage::Compare { pc, name: name.clone(), code, here: false, there: false };
        self.until_ns = self.until_ns.max(now_ns.saturating_add(COMPARING_NS));
        Ok(said)
    }

    fn answered_there(&mut self, pc: PublicKey, same: bool) -> Result<(), Refusal> {
        match &mut self.stage {
            Stage::Compare { pc: known, there, .. } if *known == pc && same => *there = true,
            Stage::Compare { pc: known, .. } if *known == pc => {
                let why =
                    "the person at the PC said no: another code, or another brick than was meant"
                        .to_owned();
                self.stage = Stage::Failed { why };
            }
            // The same again: its answer was lost.
            Stage::Paired { pc: known, .. } if *known == pc => {}
            Stage::Failed { .. } => {}
            _ => return Err(not_now("there is nothing to compare")),
        }
        Ok(())
    }

    /// What the PC is told.
    fn said(&self, pc: PublicKey) -> Result<Said, Refusal> {
        match &self.stage {
            Stage::Compare { pc: known, .. } if *known == pc => Ok(Said::Waits),
            Stage::Paired { pc: known, .. } if *known == pc => Ok(Said::Paired),
            Stage::Failed { why, .. } => Ok(Said::Failed { why: why.clone() }),
            _ => Err(not_now("this introduction is over")),
        }
    }

    /// What the person at the brick is shown.
    fn shown(&self, now_ns: i64) -> Pairing {
        if let Err(why) = &self.link {
            return Pairing::NoLink { why: why.clone() };
        }
        match &self.stage {
            Stage::Closed => Pairing::Closed,
            Stage::Open | Stage::Committed { .. } => {
                let left_s = self.until_ns.saturating_sub(now_ns) / SECOND_NS;
                Pairing::Open { seconds: u32::try_from(left_s).unwrap_or(0) }
            }
            Stage::Compare { name, code, .. } => {
                Pairing::Compare { code: code.clone(), name: name.to_string() }
            }
            Stage::Paired { name, .. } => Pairing::Paired { name: name.to_string() },
            Stage::Failed { why, .. } => Pairing::Failed { why: why.clone() },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Bench {
        _folder: tempfile::TempDir,
        window: PairingWindow,
        authorised: Authorised,
    }

    fn key(byte: u8) -> PublicKey {
        PublicKey::from_bytes([byte; 32])
    }

    fn name_of(text: &str) -> Name {
        Name::new(text).unwrap()
    }

    fn bench() -> Bench {
        let folder = tempfile::tempdir().unwrap();
        let authorised = Authorised::below(folder.path());
        let window = PairingWindow::new(authorised.clone(), name_of("blue"));
        window.ready(key(9));
        Bench { _folder: folder, window, authorised }
    }

    /// Both steps of a PC that tells the truth; its code.
    fn exchange(window: &PairingWindow, pc: PublicKey) -> String {
        let number = [5; 32];
        let commit = Hex(commitment(Side::Pc, &pc, &number));
        let Said::Commit { commit: theirs } =
            window.step(pc, Step::Commit { name: name_of("anna"), commit }).unwrap()
        else {
            panic!("no commitment")
        };
        let Said::Reveal { key: brick, number: revealed, name } =
            window.step(pc, Step::Reveal { number: Hex(number) }).unwrap()
        else {
            panic!("nothing is revealed")
        };
        let brick = PublicKey::parse(&brick).unwrap();
        assert_eq!(
            (theirs.0, name.as_str()),
            (commitment(Side::Brick, &brick, &revealed.0), "blue")
        );
        code((&pc, &number), (&brick, &revealed.0))
    }

    #[test]
    fn both_show_the_same_code_and_both_must_say_so() {
        for brick_first in [true, false] {
            let Bench { window, authorised, _folder } = bench();
            assert!(matches!(window.open(60), Pairing::Open { .. }));
            let code = exchange(&window, key(1));
            assert_eq!(window.state(), Pairing::Compare { code, name: "anna".to_owned() });
            let here = || window.answer(true);
            let there = || window.step(key(1), Step::Answer { same: true }).unwrap();
            if brick_first {
                assert!(matches!(here(), Pairing::Compare { .. }));
                assert_eq!(authorised.find(&key(1)).unwrap(), None);
                assert_eq!(there(), Said::Paired);
            } else {
                assert_eq!(there(), Said::Waits);
                assert_eq!(authorised.find(&key(1)).unwrap(), None);
                here();
            }
            assert_eq!(window.state(), Pairing::Paired { name: "anna".to_owned() });
            assert_eq!(window.step(key(1), Step::How), Ok(Said::Paired));
            assert_eq!(authorised.find(&key(1)).unwrap().as_deref(), Some("anna"));
        }
    }

    #[test]
    fn nobody_pairs_while_the_window_is_closed() {
        let Bench { window, .. } = bench();
        let step =
            || window.step(key(1), Step::Commit { name: name_of("anna"), commit: Hex([0; 32]) });
        assert_eq!(step().unwrap_err().kind, Kind::Busy);
        window.open(60);
        assert!(step().is_ok());
        window.open(0);
        assert_eq!((window.state(), window.is_open()), (Pairing::Closed, false));
        assert_eq!(step().unwrap_err().kind, Kind::Busy);
        window.close("no keys");
        assert_eq!(window.open(60), Pairing::NoLink { why: "no keys".to_owned() });
    }

    #[test]
    fn one_exchange_is_all_that_a_window_takes() {
        let Bench { window, authorised, _folder } = bench();
        window.open(60);
        exchange(&window, key(1));
        // Another PC, another number, another try of the same one.
        let commit = Step::Commit { name: name_of("eve"), commit: Hex([7; 32]) };
        assert_eq!(window.step(key(2), commit.clone()).unwrap_err().kind, Kind::Busy);
        assert_eq!(window.step(key(1), commit).unwrap_err().kind, Kind::Busy);
        assert_eq!(window.step(key(2), Step::Answer { same: true }).unwrap_err().kind, Kind::Busy);
        assert!(matches!(window.answer(false), Pairing::Failed { .. }));
        assert!(matches!(
            window.step(key(1), Step::Answer { same: true }),
            Ok(Said::Failed { .. })
        ));
        assert!(matches!(window.answer(true), Pairing::Failed { .. }), "a failure stays one");
        assert_eq!(authorised.list().unwrap(), []);
    }

    #[test]
    fn a_number_that_was_not_committed_to_ends_it() {
        let Bench { window, .. } = bench();
        window.open(60);
        let commit = Hex(commitment(Side::Pc, &key(1), &[5; 32]));
        window.step(key(1), Step::Commit { name: name_of("anna"), commit }).unwrap();
        assert_eq!(
            window.step(key(1), Step::Reveal { number: Hex([6; 32]) }).unwrap_err().kind,
            Kind::NotAuthorised
        );
        assert!(matches!(window.state(), Pairing::Failed { .. }));
        assert!(window.step(key(1), Step::Reveal { number: Hex([5; 32]) }).is_err());
    }

    #[test]
    fn whatever_arrives_at_the_window_is_answered_or_refused() {
        let Bench { window, .. } = bench();
        window.open(60);
        let ask = |text: &str| {
            window.answer_request(Some(key(1)), text.as_bytes()).map_err(|error| error.refusal.kind)
        };
        assert_eq!(ask("{}"), Err(Kind::BadRequest));
        assert_eq!(ask("\u{0}[[["), Err(Kind::BadRequest));
        assert_eq!(ask(r#"{"id":1,"version":2,"op":"pair","step":"how"}"#), Err(Kind::Version));
        assert_eq!(
            ask(r#"{"id":1,"version":1,"op":"start","step":"how"}"#),
            Err(Kind::UnknownOperation)
        );
        assert_eq!(ask(r#"{"id":1,"version":1,"op":"pair","step":"how"}"#), Err(Kind::Busy));
        let commit = format!(
            r#"{{"id":1,"version":1,"op":"pair","step":"commit","name":"x","commit":"{}"}}"#,
            "0".repeat(64)
        );
        for bad in ["", "a b", "\\u001b]0;", "a\\nb", "\\u202e", "-v", "ü"] {
            let commit = commit.replace("\"x\"", &format!("\"{bad}\""));
            assert_eq!(ask(&commit), Err(Kind::BadRequest), "{bad}");
        }
        assert!(
            matches!(window.state(), Pairing::Open { .. }),
            "and the window waits for another PC"
        );
        assert!(ask(&commit).is_ok());
        assert!(window.answer_request(None, commit.as_bytes()).is_err());
    }
}
