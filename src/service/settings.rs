//! What a person sets on the brick: kept in a file beside the runs.

use std::io;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::store::replace_file;
use crate::behavior::Mission;
use crate::document::read_bounded;
use crate::protocol::{Refusal, SettingsChange};

/// The file's name; no run can have it, because of its dot.
const FILE: &str = "settings.json";

/// What is kept.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(super) struct Kept {
    /// Lights follow the state.
    pub(super) lights: bool,
    /// Sounds are made.
    pub(super) sounds: bool,
    /// A run ends at this time at the latest, seconds.
    pub(super) time_limit_s: Option<f64>,
}

impl Default for Kept {
    fn default() -> Self {
        Self { lights: true, sounds: true, time_limit_s: None }
    }
}

impl Kept {
    /// Reads them; what is not there or cannot be read is as at first.
    pub(super) fn read(folder: &Path) -> Self {
        match read_bounded(&folder.join(FILE)) {
            Ok(bytes) => serde_json::from_slice(&bytes).unwrap_or_else(|error| {
                log::warn!(
                    "the settings in {} are not to be understood ({error}): they are as at first",
                    folder.display()
                );
                Self::default()
            }),
            Err(_) => Self::default(),
        }
    }

    /// Writes them.
    pub(super) fn write(&self, folder: &Path) -> io::Result<()> {
        replace_file(&folder.join(FILE), &serde_json::to_vec(self)?, false)
    }

    /// With some of them changed.
    ///
    /// # Errors
    ///
    /// A bad request, for a time that no mission may have.
    pub(super) fn changed(&self, change: &SettingsChange) -> Result<Self, Refusal> {
        let (low, high) = Mission::TIME_LIMITS_S;
        let time_limit_s = match change.time_limit_s {
            None => self.time_limit_s,
            Some(0.0) => None,
            Some(limit_s) if (low..=high).contains(&limit_s) => Some(limit_s),
            Some(limit_s) => {
                let message = format!(
                    "a time limit of {limit_s} s; it can be {low} to {high}, and 0 for none"
                );
                return Err(Refusal::bad_request(message));
            }
        };
        Ok(Self {
            lights: change.lights.unwrap_or(self.lights),
            sounds: change.sounds.unwrap_or(self.sounds),
            time_limit_s,
        })
    }
}

/// Where PCs reach the link: the address that it listens at, or for `*` all of the brick's on the
/// network, without its own loop.
pub(super) fn addresses(listens_at: &str) -> Vec<String> {
    if !["*", "0.0.0.0", "::"].contains(&listens_at) {
        return vec![listens_at.to_owned()];
    }
    let Ok(interfaces) = nix::ifaddrs::getifaddrs() else { return Vec::new() };
    let mut addresses: Vec<String> = interfaces
        .filter_map(|interface| interface.address)
        .filter_map(|address| {
            let four =
                address.as_sockaddr_in().map(|address| address.ip()).filter(|ip| !ip.is_loopback());
            let six = address.as_sockaddr_in6().map(|address| address.ip());
            // A link-local address needs a zone that another machine does not know.
            let six = six.filter(|ip| !ip.is_loopback() && !ip.is_unicast_link_local());
            four.map(|ip| ip.to_string()).or(six.map(|ip| ip.to_string()))
        })
        .collect();
    addresses.dedup();
    addresses
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::Kind;

    #[test]
    fn a_link_that_listens_at_one_address_is_reached_at_no_other() {
        assert_eq!(addresses("10.0.0.7"), ["10.0.0.7"]);
        assert_eq!(addresses("*"), addresses("0.0.0.0"));
        assert!(!addresses("*").contains(&"*".to_owned()));
    }

    #[test]
    fn settings_are_kept_and_a_file_that_is_spoilt_is_as_at_first() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(Kept::read(folder.path()), Kept::default());
        let change = SettingsChange {
            sounds: Some(false),
            time_limit_s: Some(30.0),
            ..SettingsChange::default()
        };
        let kept = Kept::default().changed(&change).unwrap();
        kept.write(folder.path()).unwrap();
        assert_eq!(Kept::read(folder.path()), kept);
        assert_eq!((kept.lights, kept.sounds, kept.time_limit_s), (true, false, Some(30.0)));
        let none = SettingsChange { time_limit_s: Some(0.0), ..SettingsChange::default() };
        assert_eq!(kept.changed(&none).unwrap().time_limit_s, None);
        for bad in [-1.0, f64::NAN, f64::INFINITY, 1e12] {
            let change = SettingsChange { time_limit_s: Some(bad), ..SettingsChange::default() };
            assert_eq!(kept.changed(&change).unwrap_err().kind, Kind::BadRequest, "{bad}");
        }
        std::fs::write(folder.path().join(FILE), b"{").unwrap();
        assert_eq!(Kept::read(folder.path()), Kept::default());
    }
}
