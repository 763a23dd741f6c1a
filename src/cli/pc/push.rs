//! `onbrick push`: missions onto a brick, over the system's own ssh.
//!
//! The network link writes no files, by design; a person who may log in to the brick may. So this
//! is ssh, with its keys, its passwords and its configuration, and the brick needs nothing but a
//! shell. A file is either the old one or the whole new one, whatever happens on the way.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use crate::behavior::Capabilities;
use crate::cli::common::{load_mission, read_own, warn};
use crate::cli::key::Folder;
use crate::cli::{Context, Exit, Failure, Hint, Output};
use crate::link::{KnownBrick, KnownBricks};

/// Put missions onto a brick, over ssh.
///
/// Each is checked first; nothing is sent if one is broken. They go into the folder `missions` of
/// the user robot, where the menu and `onbrick missions` find them. The host is a brick's known
/// name, or anything else that ssh takes: user@host, ssh://user@host:port.
///
/// Example: onbrick push red.local my-mission.toml
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(in crate::cli) struct Arguments {
    /// The brick: the name under which it is known here, or as ssh knows it; without a user it is
    /// robot.
    #[arg(value_parser = host)]
    host: String,
    /// Mission files.
    #[arg(required = true)]
    missions: Vec<PathBuf>,
    #[command(flatten)]
    keys: Folder,
}

/// A mission as it goes over.
struct Parcel {
    /// The file's name on the brick.
    name: String,
    text: String,
}

/// What ssh ends with when it did not get as far as the other side's shell (ssh(1)).
const NO_CONNECTION: i32 = 255;

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let host =
        known_host(&arguments.host, &arguments.keys)?.unwrap_or_else(|| arguments.host.clone());
    let host = as_robot(&host);
    let parcels =
        arguments.missions.iter().map(|path| parcel(path)).collect::<Result<Vec<_>, _>>()?;
    differ(&parcels)?;
    const OPENSSH: &str = "the package openssh-client has the program ssh";
    // One connection for all, so that a password is asked for once.
    let mut ssh = Command::new("ssh")
        .arg("--")
        .arg(&host)
        .arg(script(&parcels))
        .stdin(Stdio::piped())
        .spawn()
        .context(Exit::Failed, "cannot start ssh")
        .hint(OPENSSH)?;
    if let Some(mut pipe) = ssh.stdin.take() {
        // Where it breaks off, ssh's own exit code says why.
        let _ = parcels.iter().try_for_each(|parcel| pipe.write_all(parcel.text.as_bytes()));
    }
    let status = ssh.wait().context(Exit::Failed, "cannot wait for ssh").hint(OPENSSH)?;
    match status.code() {
        Some(0) => {}
        Some(NO_CONNECTION) => {
            return Err(Failure::new(Exit::NoAnswer, format!("ssh did not get through to {host}"))
                .hint(format!("ssh {host}")));
        }
        _ => {
            return Err(Failure::failed(format!("{host} did not take the missions"))
                .hint("look at what the brick said above; its disk may be full"));
        }
    }
    let names: Vec<&str> = parcels.iter().map(|parcel| parcel.name.as_str()).collect();
    let text = format!("{host} has {}", names.join(", "));
    output.show(text, &serde_json::json!({ "host": host, "missions": names }));
    Ok(())
}

/// Reads and checks one mission. What devices the brick has, only the brick knows; it checks again
/// when the mission is started.
fn parcel(path: &std::path::Path) -> Result<Parcel, Failure> {
    let source = read_own(path, "a mission's file; onbrick new mission FILE writes one")?;
    let source = source.with_submachines(path.parent());
    let (_, warnings) = load_mission(&source, &Capabilities::all())?;
    warn(&warnings);
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let plain = |sign: char| sign.is_ascii_alphanumeric() || matches!(sign, '-' | '_' | '.');
    if !name.ends_with(".toml") || name.starts_with(['.', '-']) || !name.chars().all(plain) {
        return Err(Failure::refused(format!(
            "{} cannot be a mission's name on a brick",
            path.display()
        ))
        .hint("letters, digits, - and _, and .toml at the end: my-mission.toml"));
    }
    Ok(Parcel { name: name.to_owned(), text: source.text })
}

/// Refuses two files of one name, of which the brick would keep the second.
fn differ(parcels: &[Parcel]) -> Result<(), Failure> {
    let mut names = BTreeSet::new();
    match parcels.iter().find(|parcel| !names.insert(parcel.name.as_str())) {
        Some(twice) => Err(Failure::refused(format!("two of the files are called {}", twice.name))
            .hint("another name for one of them")),
        None => Ok(()),
    }
}

/// What the brick's shell does with the texts that follow one another on its input. Names are
/// plain, so they need no quotes.
fn script(parcels: &[Parcel]) -> String {
    let mut script = "set -e; umask 022; mkdir -p missions; cd missions".to_owned();
    for Parcel { name, text } in parcels {
        let bytes = text.len();
        // A connection that broke leaves a short file behind, which never becomes the mission.
        script += &format!(
            "; head -c {bytes} >.{name}.new; test $(wc -c <.{name}.new) -eq {bytes}; sync \
             .{name}.new; mv .{name}.new {name}"
        );
    }
    script
}

/// A host for ssh; it must not look like one of ssh's options.
fn host(text: &str) -> Result<String, String> {
    if text.is_empty() || text.starts_with('-') || text.contains(char::is_whitespace) {
        return Err("a brick's name or address, like red.local".to_owned());
    }
    Ok(text.to_owned())
}

/// A host without a user means the brick's own.
fn as_robot(host: &str) -> String {
    if host.contains('@') || host.starts_with("ssh://") {
        host.to_owned()
    } else {
        format!("robot@{host}")
    }
}

/// Where a brick is that is known by this name.
fn known_host(name: &str, keys: &Folder) -> Result<Option<String>, Failure> {
    // Without a HOME no brick is known, and ssh may know the host nevertheless.
    let Ok(folder) = keys.path() else { return Ok(None) };
    let known = KnownBricks::load(&folder)?;
    // Its port is the link's, and not that of ssh.
    Ok(known.iter().find(|brick| brick.name == name).map(KnownBrick::host))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_host_without_a_user_is_the_bricks_own_and_none_is_an_option() {
        for (text, expected) in [
            ("red.local", "robot@red.local"),
            ("me@red", "me@red"),
            ("ssh://robot@127.0.0.1:2222", "ssh://robot@127.0.0.1:2222"),
        ] {
            assert_eq!(host(text).map(|host| as_robot(&host)), Ok(expected.to_owned()));
        }
        for bad in ["-oProxyCommand=x", "", "a b"] {
            assert!(host(bad).is_err(), "{bad:?}");
        }
    }

    #[test]
    fn two_files_of_one_name_are_refused() {
        let parcel = || Parcel { name: "one.toml".to_owned(), text: String::new() };
        let refused = differ(&[parcel(), parcel()]).unwrap_err();
        assert_eq!(refused.message, "two of the files are called one.toml");
    }

    #[test]
    fn the_script_puts_each_file_whole_into_place_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let parcels = ["one.toml", "two.toml"]
            .map(|name| Parcel { name: name.to_owned(), text: format!("name = \"{name}\"\n") });
        let send = |bytes: &[u8]| {
            let mut shell = Command::new("sh")
                .args(["-c", &script(&parcels)])
                .current_dir(folder.path())
                .stdin(Stdio::piped())
                .spawn()
                .unwrap();
            shell.stdin.take().unwrap().write_all(bytes).unwrap();
            shell.wait().unwrap().success()
        };
        let all = parcels.iter().map(|parcel| parcel.text.as_str()).collect::<String>();
        let cut = all.len() - 3;
        assert!(!send(&all.as_bytes()[..cut]), "a broken connection is a failure");
        let mission =
            |name: &str| std::fs::read_to_string(folder.path().join("missions").join(name));
        assert_eq!(mission("one.toml").unwrap(), parcels[0].text);
        assert!(mission("two.toml").is_err(), "half a file never has its name");
        assert!(send(all.as_bytes()));
        assert_eq!(mission("two.toml").unwrap(), parcels[1].text);
    }
}
