//! `onbrick.toml`: the service's folders, limits and transports.
//!
//! # Not here
//!
//! Nothing is opened or made: whether a folder can be written to shows when the service starts.

use std::net::IpAddr;
use std::path::{Path, PathBuf};

use crate::clock::nanoseconds;
use crate::document::{Document, Findings, Item, Section};
use crate::protocol::{Name, NoName};
use crate::runtime::WhenAbandoned;

/// The shipped `onbrick.toml`, which explains every key.
pub const DEFAULT_CONFIG: &str = include_str!("../../brick-image/onbrick.toml");

/// The file's name in the folder of the configuration.
pub const CONFIG_FILE: &str = "onbrick.toml";

/// Where the configuration is on a brick.
pub const BRICK_FOLDER: &str = "/etc/onbrick";

/// `onbrick` in a user's own folder of configurations (`$XDG_CONFIG_HOME`, `~/.config`); `None`
/// where there is no home.
pub(crate) fn own_folder() -> Option<PathBuf> {
    let home = || Some(path_in("HOME")?.join(".config"));
    path_in("XDG_CONFIG_HOME").or_else(home).map(|config| config.join("onbrick"))
}

/// The path in a variable of the environment.
pub(crate) fn path_in(variable: &str) -> Option<PathBuf> {
    std::env::var_os(variable).filter(|value| !value.is_empty()).map(PathBuf::from)
}

/// How a service is set up.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// What this brick is called; `None` for the machine's host name.
    pub name: Option<Name>,
    /// The folder of missions; where there is none, the shipped missions are offered.
    pub missions: PathBuf,
    /// The robot's file; where there is none, the shipped one is used.
    pub robot: PathBuf,
    /// The folder of runs.
    pub runs: PathBuf,
    /// The folder of keys.
    pub keys: PathBuf,
    /// Recordings may take this much, bytes.
    pub quota_bytes: u64,
    /// How often a recording is brought to the disk, nanoseconds.
    pub sync_ns: i64,
    /// What a run does when the service dies or hangs.
    pub when_service_dies: WhenAbandoned,
    /// What a run does when the menu closes.
    pub when_menu_closes: WhenAbandoned,
    /// The local socket.
    pub socket: SocketConfig,
    /// The network link.
    pub link: LinkConfig,
}

/// The local socket.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SocketConfig {
    /// The socket's file.
    pub path: PathBuf,
    /// Whose members may use it; without one, only the user that the service runs as, and that
    /// user's group.
    pub group: Option<String>,
}

/// The network link.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LinkConfig {
    /// The address that it listens at: `*`, or one of the brick's in numbers.
    pub address: String,
    /// Its port.
    pub port: u16,
    /// The port of the pairing window.
    pub pairing_port: u16,
}

impl Config {
    /// What holds where the file says nothing; everything is below `folder`.
    #[must_use]
    pub fn below(folder: &Path) -> Self {
        Self {
            name: None,
            missions: folder.join("missions"),
            robot: folder.join("robot.toml"),
            runs: folder.join("runs"),
            keys: folder.join("keys"),
            quota_bytes: 512 << 20,
            sync_ns: crate::clock::SECOND_NS,
            when_service_dies: WhenAbandoned::Stop,
            when_menu_closes: WhenAbandoned::Stop,
            socket: SocketConfig { path: folder.join("socket"), group: None },
            link: LinkConfig { address: "*".to_owned(), port: 5670, pairing_port: 5671 },
        }
    }

    /// Reads a configuration; `name` is what findings call it, and paths in it are below `folder`.
    ///
    /// # Errors
    ///
    /// Everything that is wrong in it, each with its place.
    pub fn load(name: &str, bytes: &[u8], folder: &Path) -> Result<(Self, Findings), Findings> {
        Document::new(name, bytes)?.read(|root| Some(read(root, Self::below(folder), folder)))
    }
}

/// The longest name of a group, bytes.
const LONGEST_NAME: usize = 64;

/// The kernel takes no longer name of a socket (`unix(7)`: 108 with the final 0).
const LONGEST_SOCKET: usize = 107;

/// Starts from what holds without the file, and takes over what it says; what is wrong is a finding
/// and ends the reading.
fn read(root: &Section<'_>, mut config: Config, folder: &Path) -> Config {
    root.allow(&[
        "name",
        "missions",
        "robot",
        "runs",
        "keys",
        "quota_mb",
        "sync_s",
        "when_service_dies",
        "when_menu_closes",
        "socket",
        "link",
    ]);
    set(&mut config.name, root.get("name").and_then(|item| name(&item)).map(Some));
    let path = |key| root.get(key).and_then(|item| path(&item, folder));
    set(&mut config.missions, path("missions"));
    set(&mut config.robot, path("robot"));
    set(&mut config.runs, path("runs"));
    set(&mut config.keys, path("keys"));
    let quota_mb = root.get("quota_mb").and_then(|item| item.integer(16..=1 << 20));
    set(&mut config.quota_bytes, quota_mb.and_then(|mb| u64::try_from(mb).ok()).map(|mb| mb << 20));
    set(
        &mut config.sync_ns,
        root.get("sync_s").and_then(|item| item.number(0.1..=60.0)).map(nanoseconds),
    );
    let fate =
        |key| root.get(key)?.word(&[("stop", WhenAbandoned::Stop), ("go on", WhenAbandoned::GoOn)]);
    set(&mut config.when_service_dies, fate("when_service_dies"));
    set(&mut config.when_menu_closes, fate("when_menu_closes"));
    if let Some(section) = root.section("socket") {
        socket(&section, &mut config.socket, folder);
    }
    if let Some(section) = root.section("link") {
        link(&section, &mut config.link);
    }
    config
}

fn socket(section: &Section<'_>, config: &mut SocketConfig, folder: &Path) {
    section.allow(&["path", "group"]);
    if let Some(item) = section.get("path")
        && let Some(named) = path(&item, folder)
    {
        if named.as_os_str().len() > LONGEST_SOCKET {
            item.error(format!(
                "`{}` is longer than the {LONGEST_SOCKET} bytes that a socket's name may have",
                item.path()
            ));
        }
        config.path = named;
    }
    set(&mut config.group, section.get("group").and_then(|item| short(&item)).map(Some));
}

fn link(section: &Section<'_>, config: &mut LinkConfig) {
    section.allow(&["address", "port", "pairing_port"]);
    set(&mut config.address, section.get("address").and_then(|item| address(&item)));
    let port = |key| u16::try_from(section.get(key)?.integer(1..=65_535)?).ok();
    set(&mut config.port, port("port"));
    set(&mut config.pairing_port, port("pairing_port"));
    if config.port == config.pairing_port {
        section.error("`port` and `pairing_port` are the same").hint("two different ports");
    }
}

fn set<T>(place: &mut T, value: Option<T>) {
    if let Some(value) = value {
        *place = value;
    }
}

fn name(item: &Item<'_>) -> Option<Name> {
    let text = item.text()?;
    let name = Name::new(text);
    if name.is_err() {
        item.error(format!("`{}`: {NoName}", item.path()))
            .hint(format!("\"{}\"", Name::nearest(text)));
    }
    name.ok()
}

fn short(item: &Item<'_>) -> Option<String> {
    let text = item.text()?;
    if (1..=LONGEST_NAME).contains(&text.len()) && !text.contains(char::is_control) {
        return Some(text.to_owned());
    }
    item.error(format!("`{}` must have 1 to {LONGEST_NAME} bytes on one line", item.path()));
    None
}

/// `*`, or an address in numbers, of IPv6 perhaps with its interface behind a `%`. A host name
/// would be looked up by glibc, which in a static program loads the brick's modules of another
/// glibc.
fn address(item: &Item<'_>) -> Option<String> {
    let text = item.text()?;
    let number = text.split_once('%').map_or(text, |(number, _)| number);
    if text == "*" || number.parse::<IpAddr>().is_ok() {
        return Some(text.to_owned());
    }
    item.error(format!("`{}` is `{text}`, and names are not looked up", item.path()))
        .hint("`*` for all networks, or one address of this brick in numbers");
    None
}

fn path(item: &Item<'_>, folder: &Path) -> Option<PathBuf> {
    let text = item.text()?;
    if text.is_empty() || text.contains('\0') {
        item.error(format!("`{}` names no file", item.path()));
        return None;
    }
    Some(folder.join(text))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_configuration_is_in_order_and_names_the_bricks_own_folders() {
        let (config, warnings) =
            Config::load("onbrick.toml", DEFAULT_CONFIG.as_bytes(), Path::new(BRICK_FOLDER))
                .unwrap();
        assert!(warnings.iter().next().is_none(), "{warnings}");
        assert_eq!(config.runs, Path::new("/var/lib/onbrick/runs"));
        assert_eq!(config.socket.group.as_deref(), Some("robot"));
        assert_eq!((config.link.port, config.quota_bytes), (5670, 512 << 20));
    }

    #[test]
    fn an_empty_file_is_a_configuration_and_paths_are_below_its_folder() {
        let folder = Path::new("/some/where");
        let (config, _) = Config::load("onbrick.toml", b"", folder).unwrap();
        assert_eq!(config, Config::below(folder));
        let (config, _) = Config::load("onbrick.toml", b"runs = \"kept\"", folder).unwrap();
        assert_eq!(config.runs, folder.join("kept"));
    }

    #[test]
    fn the_link_listens_at_numbers_and_names_are_refused() {
        let load = |address: &str| {
            let text = format!("[link]\naddress = \"{address}\"\n");
            let loaded = Config::load("onbrick.toml", text.as_bytes(), Path::new("/x"));
            loaded.map(|(config, _)| config.link.address).map_err(|findings| findings.to_string())
        };
        for address in ["*", "0.0.0.0", "127.0.0.2", "::1", "fe80::1%wlan0"] {
            assert_eq!(load(address).as_deref(), Ok(address));
        }
        for name in ["localhost", "ev3.local", "wlan0", "", "1.2.3", "[::1]", "127.0.0.1:5670"] {
            let refused = load(name).unwrap_err();
            assert!(
                refused.contains("onbrick.toml:2:11") && refused.contains("not looked up"),
                "{refused}"
            );
        }
    }

    #[test]
    fn every_mistake_has_its_place() {
        let text = "qouta_mb = 5\nname = \"anna's brick\"\nquota_mb = 0\n\
                    when_menu_closes = \"stopp\"\nmissions = 3\n[link]\nport = 70000\n\
                    pairing_port = 5670\n[socket]\ngroup = \"\"\n";
        let findings =
            Config::load("onbrick.toml", text.as_bytes(), Path::new("/x")).unwrap_err().to_string();
        for part in [
            "onbrick.toml:1:1",
            "quota_mb",
            "onbrick.toml:2:8",
            "\"anna-s-brick\"",
            "onbrick.toml:3",
            "\"stop\"",
            "onbrick.toml:5",
            "70000",
            "`port` and `pairing_port`",
            "group",
        ] {
            assert!(findings.contains(part), "{part}: {findings}");
        }
    }
}
