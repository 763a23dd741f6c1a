//! `onbrick key`: this machine's key, and the keys that may ask it.

use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use nix::unistd::geteuid;

use super::{Failure, Output};
use crate::link::keys::{Authorised, AuthorisedKey, KeyError, PublicKey};
use crate::link::{KeyPair, key_folder};
#[cfg(feature = "host")]
use crate::link::{KnownBrick, KnownBricks};
use crate::protocol::Name;

/// Make and show this machine's key; on a brick, let other keys in or turn them away.
///
/// Examples:
///   onbrick key show
///   sudo -u onbrick onbrick key authorise 'w>il{Sx3&-W+P8nSMoe)b)!kpu3Q#g>4CE<ttSWd' \
///     --name anna --keys /etc/onbrick/keys
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Arguments {
    #[command(subcommand)]
    what: What,
    #[command(flatten)]
    folder: Folder,
}

/// The folder of keys, as several commands take it.
#[derive(Debug, Args)]
pub(super) struct Folder {
    /// The folder of keys: a brick's is /etc/onbrick/keys. Without it, $ONBRICK_KEYS or
    /// ~/.config/onbrick.
    #[arg(long, value_name = "DIR", global = true)]
    keys: Option<PathBuf>,
}

// Of 85 keys one begins with a hyphen: it is an argument like the others.
#[derive(Debug, Subcommand)]
enum What {
    /// Make this machine's key; an existing one is never replaced.
    New,
    /// Show this machine's public key and its fingerprint.
    Show,
    /// Let a key ask this machine from now on.
    Authorise {
        /// The key, or all that `key show` prints on the other machine.
        #[arg(allow_hyphen_values = true)]
        key: String,
        /// What its owner is called.
        #[arg(long)]
        name: Name,
    },
    /// Refuse a key from now on, also on open connections.
    Revoke {
        /// The name, the fingerprint or the key.
        #[arg(allow_hyphen_values = true)]
        which: String,
    },
    /// List the keys that may ask this machine.
    List,
    /// On a PC: forget a brick.
    #[cfg(feature = "host")]
    Forget {
        /// The brick's name or address.
        brick: String,
    },
    /// On a PC: trust a brick's key from now on, if it came over a trusted way such as ssh.
    #[cfg(feature = "host")]
    Know {
        /// What the brick is called.
        brick: Name,
        /// Where it is.
        address: String,
        /// The key, as `key show` prints it on the brick.
        #[arg(allow_hyphen_values = true)]
        key: String,
        /// Forget the brick that is known by this name with another key.
        #[arg(long)]
        replace: bool,
    },
}

impl Folder {
    /// The folder that is meant.
    pub(super) fn path(&self) -> Result<PathBuf, Failure> {
        self.keys.clone().or_else(key_folder).ok_or_else(|| {
            Failure::usage("there is no HOME to keep keys below").hint("--keys with a folder")
        })
    }

    /// This machine's pair, created if missing.
    #[cfg(feature = "host")]
    pub(super) fn own(&self) -> Result<KeyPair, Failure> {
        Ok(KeyPair::load_or_make(&self.path()?)?)
    }
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let folder = arguments.folder.path()?;
    let authorised = Authorised::below(&folder);
    if matches!(arguments.what, What::New | What::Authorise { .. } | What::Revoke { .. }) {
        refuse_for_another(&folder)?;
    }
    match &arguments.what {
        What::New => {
            let pair = KeyPair::generate()?;
            let path = pair.save(&folder)?;
            output.line(format!("made {}", path.display()));
            show(&pair.public(), output);
        }
        What::Show => {
            show(&KeyPair::load(&folder)?.public(), output);
        }
        What::Authorise { key, name } => {
            let key = parsed(key)?;
            // A file that cannot be read is written over.
            let before = authorised.find(&key).ok().flatten();
            let before = before.filter(|before| before != name.as_str());
            authorised.add(&key, name.as_str())?;
            let fingerprint = key.fingerprint();
            let renamed = before.as_ref().map(|before| format!(", which was {before} before"));
            output.show(
                format!("{name} may ask from now on: {fingerprint}{}", renamed.unwrap_or_default()),
                &serde_json::json!({
                    "authorised": name, "fingerprint": fingerprint, "before": before
                }),
            );
        }
        What::Revoke { which } => revoke(&authorised, which, output)?,
        What::List => {
            let found = authorised.list()?;
            let json: Vec<_> = found.iter().map(described).collect();
            for known in &found {
                output.line(format!("{}  {}", known.key.fingerprint(), known.name));
            }
            output.value(&serde_json::json!({ "keys": json }));
            if found.is_empty() {
                output.line("no key may ask this machine");
            }
        }
        #[cfg(feature = "host")]
        What::Forget { brick } => {
            let mut known = KnownBricks::load(&folder)?;
            let gone = known.forget(brick)?;
            let gone = gone.ok_or_else(|| {
                Failure::refused(format!("no brick {brick} is known")).hint("onbrick bricks")
            })?;
            let (name, fingerprint) = (gone.name, gone.key.fingerprint());
            output.show(
                format!("{name} is forgotten: {fingerprint}"),
                &serde_json::json!({ "forgotten": name, "fingerprint": fingerprint }),
            );
        }
        #[cfg(feature = "host")]
        What::Know { brick: name, address, key, replace } => {
            let brick =
                KnownBrick { name: name.to_string(), address: address.clone(), key: parsed(key)? };
            let mut known = KnownBricks::load(&folder)?;
            let replaced =
                known.another(name, &brick.key).filter(|_| *replace).map(|other| other.key);
            known.put(&brick, replaced)?;
            show_known("known", &brick, &known, output);
        }
    }
    Ok(())
}

/// A brick is known from now on; `word` is what programs are told that it is.
#[cfg(feature = "host")]
pub(super) fn show_known(word: &str, brick: &KnownBrick, known: &KnownBricks, output: &mut Output) {
    let (name, file, fingerprint) = (&brick.name, known.path().display(), brick.key.fingerprint());
    output.show(
        format!("{name} is known from now on: {file} ({fingerprint})"),
        &serde_json::json!({ word: name, "address": brick.address, "fingerprint": fingerprint }),
    );
}

/// What root puts into another user's folder is root's, and the service whose keys these are could
/// not read it.
fn refuse_for_another(folder: &Path) -> Result<(), Failure> {
    let is_anothers = std::fs::metadata(folder).is_ok_and(|folder| folder.uid() != 0);
    if geteuid().is_root() && is_anothers {
        let message = format!(
            "{} belongs to another user, who could not read what root puts there",
            folder.display()
        );
        return Err(Failure::refused(message).hint(AS_THE_SERVICE));
    }
    Ok(())
}

/// A key, alone or among the other words of `key show`.
fn parsed(key: &str) -> Result<PublicKey, Failure> {
    let shown = key.split_whitespace().find_map(|word| PublicKey::parse(word).ok());
    shown.map_or_else(|| PublicKey::parse(key), Ok).map_err(|error| {
        Failure::usage(error.to_string())
            .hint("onbrick key show on the other machine; the shell wants it in single quotes")
    })
}

fn revoke(authorised: &Authorised, which: &str, output: &mut Output) -> Result<(), Failure> {
    let removed = authorised.remove(which)?;
    if removed.is_empty() {
        return Err(Failure::refused(format!("no key is called {which}")).hint("onbrick key list"));
    }
    for gone in &removed {
        output.line(format!(
            "{} is turned away from now on: {}",
            gone.name,
            gone.key.fingerprint()
        ));
    }
    let json: Vec<_> = removed.iter().map(described).collect();
    output.value(&serde_json::json!({ "revoked": json }));
    Ok(())
}

fn described(known: &AuthorisedKey) -> serde_json::Value {
    serde_json::json!({
        "name": known.name,
        "key": known.key.to_string(),
        "fingerprint": known.key.fingerprint(),
    })
}

fn show(key: &PublicKey, output: &mut Output) {
    let (text, fingerprint) = (key.to_string(), key.fingerprint());
    output.show(
        format!("key          {text}\nfingerprint  {fingerprint}"),
        &serde_json::json!({ "key": text, "fingerprint": fingerprint }),
    );
}

/// A brick's keys are its service's alone.
const AS_THE_SERVICE: &str =
    "as the user whose folder it is; on a brick: sudo -u onbrick onbrick key …";

const ANOTHER_FOLDER: &str = "--keys or ONBRICK_KEYS with a folder that can be written to";

/// A folder of keys that cannot be used.
impl From<KeyError> for Failure {
    fn from(error: KeyError) -> Self {
        let message = crate::printable::with_causes(&error);
        let refused = Self::refused(message);
        match &error {
            KeyError::Missing(_) => refused.hint("onbrick key new"),
            KeyError::Exists(_) => refused.hint(
                "keep it: other machines know this one by this key; or delete the file and pair \
                 this machine again",
            ),
            KeyError::Io { source, .. } if source.kind() == ErrorKind::PermissionDenied => {
                refused.hint(format!("{AS_THE_SERVICE}; or {ANOTHER_FOLDER}"))
            }
            KeyError::Io { .. } => refused.hint(ANOTHER_FOLDER),
            KeyError::AnotherKey { .. } => refused.hint(
                "--replace, if it was set up again; or give one of the two another name: `name` in \
                 its onbrick.toml",
            ),
            KeyError::Readable(path) => refused.hint(format!("chmod 600 {}", path.display())),
            _ => refused,
        }
    }
}
