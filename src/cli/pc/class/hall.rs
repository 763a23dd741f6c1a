//! What the page's threads share: the bricks, the missions, who is being introduced, what is tried.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, PoisonError, RwLock};

use serde_json::{Value, json};

use super::brick::{Brick, Order, Start};
use super::card::card;
use super::missions::{Missions, Trial};
use super::pairing::Pairing;
use super::together::Together;
use crate::clock::{Clock as _, MonotonicClock};
use crate::link::{KeyPair, KnownBrick};
use crate::printable;
use crate::protocol::MAX_MISSION_BYTES;
use crate::threads::spawn;

/// All of it.
#[derive(Debug)]
pub(super) struct Hall {
    pub(super) folder: PathBuf,
    /// The folder of keys.
    keys: PathBuf,
    pub(super) own: KeyPair,
    bricks: RwLock<Vec<Arc<Brick>>>,
    pub(super) missions: Missions,
    pub(super) pairing: Pairing,
    pub(super) trial: Trial,
    pub(super) together: Together,
    /// The page has ended.
    pub(super) over: Arc<AtomicBool>,
}

impl Hall {
    pub(super) fn new(folder: &Path, keys: &Path, own: KeyPair) -> Self {
        Self {
            folder: folder.to_owned(),
            keys: keys.to_owned(),
            own,
            bricks: RwLock::default(),
            missions: Missions::below(folder),
            pairing: Pairing::default(),
            trial: Trial::new(),
            together: Together::default(),
            over: Arc::default(),
        }
    }

    /// Puts a brick on the page, in the place of one of the same name or key.
    pub(super) fn admit(&self, known: &KnownBrick) {
        let brick = Brick::start(known, &self.own, &self.folder);
        let mut bricks = self.bricks.write().unwrap_or_else(PoisonError::into_inner);
        let same = |other: &&mut Arc<Brick>| {
            other.known.name == known.name || other.known.key == known.key
        };
        match bricks.iter_mut().find(same) {
            Some(place) => {
                place.over.store(true, Ordering::Relaxed);
                *place = brick;
            }
            None => bricks.push(brick),
        }
    }

    /// Listens for bricks that make themselves known.
    pub(super) fn listen(self: &Arc<Self>) -> std::io::Result<()> {
        let hall = Arc::clone(self);
        let listen = move || hall.pairing.listen(&hall.over);
        spawn("listen", listen).map(|_| ())
    }

    pub(super) fn end(&self) {
        self.over.store(true, Ordering::Relaxed);
        self.trial.stop();
        self.bricks().iter().for_each(|brick| brick.over.store(true, Ordering::Relaxed));
    }

    pub(super) fn bricks(&self) -> Vec<Arc<Brick>> {
        self.bricks.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// A brick by its number on the page.
    pub(super) fn brick(&self, number: usize) -> Result<Arc<Brick>, String> {
        let found = self.bricks().get(number).cloned();
        found.ok_or_else(|| "there is no such brick".to_owned())
    }

    /// All that the page has not got; `since` has a cursor for each brick's picture.
    pub(super) fn state(&self, since: &str) -> String {
        let now_ns = MonotonicClock.now_ns();
        let mut cursors = since.split('_');
        let bricks = self.bricks();
        let cards: Vec<Value> = bricks
            .iter()
            .map(|brick| {
                let mut card = card(brick, now_ns);
                let glimpse = brick.board.glimpse(cursors.next().unwrap_or_default());
                if let Some(fields) = card.as_object_mut() {
                    fields.insert("glimpse".to_owned(), glimpse);
                }
                card
            })
            .collect();
        let is_known = |part: &str| {
            bricks.iter().any(|brick| {
                brick.known.name == part
                    || brick.known.address == part
                    || brick.known.host() == part
            })
        };
        let state = json!({
            "version": env!("CARGO_PKG_VERSION"),
            "bricks": cards,
            "strangers": self.pairing.strangers(is_known),
            "pairing": self.pairing.state(),
            "together": self.together.state(),
        });
        printable::json(&state.to_string()).into_owned()
    }

    /// Starts a mission's text on a brick, and keeps it by brick and time.
    pub(super) fn start(
        &self,
        brick: &Brick,
        name: &str,
        text: &str,
        pose: Option<[f64; 3]>,
    ) -> Result<(), String> {
        let whole = self.whole(name, text)?;
        self.missions.keep_started(name, &brick.known.name, text)?;
        brick.order(Order::Start(Start { name: name.to_owned(), text: whole, pose }));
        Ok(())
    }

    /// A mission's text with its sub-machines, as a brick takes it.
    pub(super) fn whole(&self, name: &str, text: &str) -> Result<String, String> {
        let whole = self.missions.source(name, text).text;
        if whole.len() > MAX_MISSION_BYTES {
            return Err(format!("a brick takes at most {MAX_MISSION_BYTES} bytes of a mission"));
        }
        Ok(whole)
    }

    /// Stops every brick.
    pub(super) fn stop(&self) {
        self.bricks().iter().for_each(|brick| brick.stop());
    }

    /// Introduces this PC to a brick, on a thread of its own.
    pub(super) fn pair(self: &Arc<Self>, address: &str, port: u16) -> Result<(), String> {
        let (hall, address) = (Arc::clone(self), address.to_owned());
        let introduce = move || {
            let Hall { pairing, keys, own, over, .. } = &*hall;
            if let Some(brick) = pairing.introduce(&address, port, keys, own, over) {
                hall.admit(&brick);
            }
        };
        spawn("pair", introduce).map(|_| ()).map_err(|error| error.to_string())
    }
}
