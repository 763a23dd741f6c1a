//! Recordings that come home: that of the run in progress, as it grows, and others on demand. Each
//! has a thread and a connection of its own, so that it holds up no question and no stop.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use serde::Serialize;

use super::brick::Brick;
use crate::clock::{Clock as _, MILLISECOND_NS, MonotonicClock, SECOND_NS};
use crate::link::client::file_so_far;
use crate::link::{ClientError, FetchProgress, Patience};
use crate::protocol::{Kind, RunId};
use crate::report::live::Sources;
use crate::threads::{lock, spawn};

/// How long a brick may be away before a fetch is tried from scratch, seconds.
const PATIENCE_S: f64 = 30.0;

/// How long after one that broke off, nanoseconds.
const AGAIN_NS: i64 = SECOND_NS;

/// A run that does not record yet, or was never begun: how often that is asked before it is
/// believed.
const UNBEGUN: u32 = 20;

/// How far a run has come home.
#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct Arrival {
    pub(super) bytes: u64,
    pub(super) total: u64,
    #[serde(rename = "whole")]
    pub(super) is_whole: bool,
    pub(super) failed: Option<String>,
}

/// What has come, by run.
pub(super) type Brought = BTreeMap<RunId, Arrival>;

/// A run that is to come home.
pub(super) struct Bringing {
    brick: Arc<Brick>,
    run: RunId,
    file: PathBuf,
}

impl Bringing {
    pub(super) fn of(brick: &Arc<Brick>, run: RunId) -> Self {
        let file = brick.folder.join(format!("{run}.mcap"));
        Self { brick: Arc::clone(brick), run, file }
    }

    /// Has a thread bring it, unless one does already; with the name of its mission it is what the
    /// brick's picture shows from now on.
    pub(super) fn begin(self, mission: Option<&str>) {
        if let Some(mission) = mission {
            let title = format!("{}: {mission}", self.brick.known.name);
            let recording = Some(file_so_far(&self.file));
            self.brick.board.show(Sources { title, recording, ..Sources::default() });
        }
        {
            let mut seen = lock(&self.brick.seen);
            let is_gone = |arrival: &Arrival| {
                arrival.failed.is_some() || arrival.is_whole && !self.file.exists()
            };
            if seen.brought.get(&self.run).is_some_and(|arrival| !is_gone(arrival)) {
                return;
            }
            seen.brought.insert(self.run.clone(), Arrival::default());
        }
        let (brick, run) = (Arc::clone(&self.brick), self.run.clone());
        if let Err(error) = spawn("fetch", move || self.bring()) {
            let failed = Some(format!("no thread for it: {error}"));
            lock(&brick.seen).brought.insert(run, Arrival { failed, ..Arrival::default() });
        }
    }

    fn note(&self, change: impl FnOnce(&mut Arrival)) {
        change(lock(&self.brick.seen).brought.entry(self.run.clone()).or_default());
    }

    fn bring(self) {
        let came = self.come();
        self.note(|arrival| match came {
            Ok(()) => arrival.is_whole = true,
            Err(why) => arrival.failed = Some(why),
        });
    }

    /// Follows it to its end, over connections that break.
    fn come(&self) -> Result<(), String> {
        std::fs::create_dir_all(&self.brick.folder)
            .map_err(|error| format!("cannot make {}: {error}", self.brick.folder.display()))?;
        let told = |error: &ClientError| self.brick.told(error);
        let mut client = self.brick.client().map_err(|error| told(&error))?;
        let patience = Patience::new(PATIENCE_S).unless(Arc::clone(&self.brick.over));
        client.set_patience(patience.quietly());
        let mut watch = |FetchProgress { bytes, total, .. }: &FetchProgress| {
            self.note(|arrival| (arrival.bytes, arrival.total) = (*bytes, *total));
        };
        let mut unbegun = 0;
        loop {
            match client.fetch(&self.run, &self.file, &mut watch) {
                Ok(_) => return Ok(()),
                Err(ClientError::NoAnswer { .. }) => {}
                Err(ClientError::Refused(refusal))
                    if refusal.kind == Kind::UnknownRun && unbegun < UNBEGUN =>
                {
                    unbegun += 1;
                }
                Err(error) => return Err(told(&error)),
            }
            let is_over = || self.brick.over.load(Ordering::Relaxed);
            if MonotonicClock.wait_for(AGAIN_NS, 100 * MILLISECOND_NS, &is_over) {
                return Err("the page has ended".to_owned());
            }
        }
    }
}
