//! What the service knows of a run: `run.json`.

use serde::{Deserialize, Serialize};

use crate::protocol::{LastStop, RunId, RunInfo};

/// What the service knows of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(in crate::service) struct Record {
    /// Which.
    pub(in crate::service) run: RunId,
    /// Counts up on this brick.
    pub(in crate::service) number: u64,
    /// Its mission's name.
    pub(in crate::service) mission: String,
    /// Its time limit, seconds.
    pub(in crate::service) time_limit_s: f64,
    /// Who started it.
    pub(in crate::service) by: String,
    /// How it ended; nothing while it is going on and where it was cut.
    pub(in crate::service) end: Option<LastStop>,
    /// Metres driven.
    pub(in crate::service) travelled_m: Option<f64>,
    /// Points of its map.
    pub(in crate::service) points: Option<u64>,
    /// All of it lies on another machine's disk, which has named its hash.
    pub(in crate::service) fetched: bool,
    /// Over the whole recording, once it is complete.
    pub(in crate::service) sha256: Option<String>,
}

impl Record {
    /// A run that begins; the store numbers it.
    pub(in crate::service) fn new(run: RunId, mission: &str, time_limit_s: f64, by: &str) -> Self {
        Self {
            run,
            number: 0,
            mission: mission.to_owned(),
            time_limit_s,
            by: by.to_owned(),
            end: None,
            travelled_m: None,
            points: None,
            fetched: false,
            sha256: None,
        }
    }

    pub(super) fn info(&self, bytes: u64, going_on: bool) -> RunInfo {
        RunInfo {
            run: self.run.clone(),
            mission: self.mission.clone(),
            number: self.number,
            bytes,
            going_on,
            fetched: self.fetched,
            end: self.end.clone(),
            travelled_m: self.travelled_m,
            points: self.points,
        }
    }
}
