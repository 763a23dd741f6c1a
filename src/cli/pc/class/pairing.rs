//! Bricks that are not known yet: those that make themselves known in this network, and the
//! introduction of one, whose code is compared on the page.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use serde::Serialize;
use serde_json::{Value, json};

use crate::clock::{Clock as _, MILLISECOND_NS, MonotonicClock, SECOND_NS};
use crate::link::client::PORT;
use crate::link::discover::{Announced, discover};
use crate::link::pairing::{Introduced, pair};
use crate::link::{KeyPair, KnownBrick, KnownBricks, Patience};
use crate::printable::with_causes;
use crate::protocol::Name;
use crate::threads::lock;

/// How long one listens, seconds, and how long after it one listens again, nanoseconds.
const LISTEN_S: f64 = 4.0;
const REST_NS: i64 = 6 * SECOND_NS;

/// How long a brick may take over an introduction: two persons take part in it, seconds.
const PATIENCE_S: f64 = 120.0;

/// How long one waits for the person at the page before one looks whether the page has ended.
const NAP: Duration = Duration::from_millis(200);

/// How far an introduction is.
#[derive(Debug, Serialize)]
#[serde(tag = "stage", rename_all = "snake_case")]
enum Stage {
    /// The brick is being asked.
    Asking,
    /// Both show a code.
    Compare {
        code: String,
        name: String,
        fingerprint: String,
        another: Option<String>,
    },
    /// The person at the page has said yes; the one at the brick has not answered yet.
    Waits {
        code: String,
        name: String,
    },
    Done {
        name: String,
    },
    Failed {
        why: String,
    },
}

/// One introduction.
#[derive(Debug, Serialize)]
struct Talk {
    address: String,
    #[serde(flatten)]
    stage: Stage,
    #[serde(skip)]
    answers: Sender<bool>,
}

/// Who is heard, and who is being introduced.
#[derive(Debug, Default)]
pub(super) struct Pairing {
    heard: Mutex<Vec<Announced>>,
    talk: Mutex<Option<Talk>>,
}

impl Pairing {
    /// Listens for announcements until the page ends.
    pub(super) fn listen(&self, over: &AtomicBool) {
        let mut has_said = false;
        let is_over = || over.load(Ordering::Relaxed);
        while !is_over() {
            match discover(LISTEN_S, over) {
                Ok(heard) => *lock(&self.heard) = heard,
                Err(error) if !has_said => {
                    has_said = true;
                    log::warn!("{}: a brick's address still finds it", with_causes(&error));
                }
                Err(_) => {}
            }
            MonotonicClock.wait_for(REST_NS, 100 * MILLISECOND_NS, &is_over);
        }
    }

    /// Who makes itself known and is not known here.
    pub(super) fn strangers(&self, is_known: impl Fn(&str) -> bool) -> Value {
        let heard = lock(&self.heard);
        let strangers = heard.iter().filter_map(|brick| {
            let numbers: Vec<String> = brick.addresses.iter().map(ToString::to_string).collect();
            let known = [&brick.name, &brick.host].into_iter().chain(&numbers);
            let at = numbers.first().unwrap_or(&brick.host);
            (!known.into_iter().any(|part| is_known(part))).then(
                || json!({ "name": brick.name, "host": brick.host, "at": at, "port": brick.port }),
            )
        });
        strangers.collect()
    }

    /// How far the introduction is.
    pub(super) fn state(&self) -> Value {
        json!(&*lock(&self.talk))
    }

    /// What the person at the page says of the code.
    pub(super) fn answer(&self, same: bool) -> Result<(), String> {
        let talk = lock(&self.talk);
        let talk = talk.as_ref().filter(|talk| matches!(talk.stage, Stage::Compare { .. }));
        let talk = talk.ok_or("there is no code to compare")?;
        talk.answers.send(same).map_err(|_| "the introduction is over".to_owned())
    }

    /// Takes what came of an introduction off the page.
    pub(super) fn close(&self) -> Result<(), String> {
        let mut talk = lock(&self.talk);
        match talk.as_ref().map(|talk| &talk.stage) {
            None | Some(Stage::Done { .. } | Stage::Failed { .. }) => {
                *talk = None;
                Ok(())
            }
            Some(_) => Err("the introduction is not over".to_owned()),
        }
    }

    fn enter(&self, stage: Stage) {
        if let Some(talk) = &mut *lock(&self.talk) {
            talk.stage = stage;
        }
    }

    /// Introduces this PC to the brick whose pairing window is open at an address, and whose link
    /// is at a port; it is known from then on.
    pub(super) fn introduce(
        &self,
        address: &str,
        port: u16,
        folder: &Path,
        own: &KeyPair,
        over: &Arc<AtomicBool>,
    ) -> Option<KnownBrick> {
        let (answers, answered) = channel();
        {
            let mut talk = lock(&self.talk);
            let is_under_way = talk.as_ref().is_some_and(|talk| {
                !matches!(talk.stage, Stage::Done { .. } | Stage::Failed { .. })
            });
            if is_under_way {
                return None;
            }
            *talk = Some(Talk { address: address.to_owned(), stage: Stage::Asking, answers });
        }
        match self.converse(address, port, folder, own, over, &answered) {
            Ok(brick) => {
                self.enter(Stage::Done { name: brick.name.clone() });
                Some(brick)
            }
            Err(why) => {
                self.enter(Stage::Failed { why });
                None
            }
        }
    }

    fn converse(
        &self,
        address: &str,
        port: u16,
        folder: &Path,
        own: &KeyPair,
        over: &Arc<AtomicBool>,
        answered: &Receiver<bool>,
    ) -> Result<KnownBrick, String> {
        let mut known = KnownBricks::load(folder).map_err(|error| with_causes(&error))?;
        let name = Name::of_this_machine();
        let patience = Patience::new(PATIENCE_S).if_absent(10.0).unless(Arc::clone(over));
        let mut is_same = |brick: &Introduced, code: &str| {
            let another = known.another(&brick.name, &brick.key);
            let (code, name) = (code.to_owned(), brick.name.to_string());
            self.enter(Stage::Compare {
                code: code.clone(),
                name: name.clone(),
                fingerprint: brick.key.fingerprint(),
                another: another.map(|other| other.key.fingerprint()),
            });
            let same = waited(answered, over);
            if same {
                self.enter(Stage::Waits { code, name });
            }
            same
        };
        let introduced = pair(address, own, &name, patience.quietly(), &mut is_same)
            .map_err(|error| with_causes(&error))?;
        // The person has seen both fingerprints, and said yes.
        introduced
            .keep(&mut known, address, (port != PORT).then_some(port))
            .map_err(|error| with_causes(&error))
    }
}

/// What the person says; no, where the page ends first.
fn waited(answered: &Receiver<bool>, over: &AtomicBool) -> bool {
    loop {
        match answered.recv_timeout(NAP) {
            Ok(same) => return same,
            Err(RecvTimeoutError::Timeout) if !over.load(Ordering::Relaxed) => {}
            Err(_) => return false,
        }
    }
}
