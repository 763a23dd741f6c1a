//! Keys: who a machine is on the network.
//!
//! A machine has one pair of CURVE keys. The public half is written in Z85 (ZeroMQ's 40 signs,
//! rfc.zeromq.org/spec/32) and shown to people as a [`PublicKey::fingerprint`]; the secret half
//! never leaves its file.
//!
//! | in the folder of keys | what it is |
//! |---|---|
//! | `own.key` | this machine's pair, mode 0600 |
//! | `authorised/FINGERPRINT.toml` | one file for each key that may ask this machine ([`Authorised`]) |
//! | `known_bricks` | on a PC: each brick's name, address and key ([`KnownBricks`]) |
//! | `known_bricks.lock` | empty; held by who adds a brick |
//!
//! # Not here
//!
//! No waiting on any other thread: making a pair ([`KeyPair::generate`]) may wait for the kernel's
//! random numbers - minutes, on a brick that has just been switched on - so a brick does it on the
//! link's own thread, and nothing that drives calls it.
//!
//! # What we count on
//!
//! - A process that can read `own.key` can act as this machine. A file that others can read is
//!   refused, as ssh does.

use std::fmt;
use std::fs::{DirBuilder, File};
use std::io::{self, Read};
use std::os::unix::fs::{DirBuilderExt, PermissionsExt};
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use super::curve::{self, NoCurve};
use crate::document::save::{Readers, SaveError, create};
use crate::document::{Document, Findings, Item};
use crate::protocol::{Name, NoName};
use crate::service::digest::hex;

mod authorised;
mod known;
mod z85;

pub use authorised::{Authorised, AuthorisedKey};
pub(super) use known::ON_THE_BRICK;
pub use known::{KnownBrick, KnownBricks};

/// The public half of a pair: by it a machine is known.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct PublicKey([u8; 32]);

/// A text that is no key.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("this is no key: a key has {} signs of Z85", PublicKey::SIGNS)]
pub struct NoKey;

impl PublicKey {
    /// Signs of a written key.
    pub const SIGNS: usize = 40;

    /// A key as the network carries it.
    #[must_use]
    pub fn from_bytes(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// Reads a written key.
    ///
    /// # Errors
    ///
    /// [`NoKey`].
    pub fn parse(text: &str) -> Result<Self, NoKey> {
        z85::decode(text).map(Self).ok_or(NoKey)
    }

    /// The key that a file holds; a text that is none becomes a finding with this hint.
    pub(super) fn read(item: &Item<'_>, hint: &str) -> Option<Self> {
        let key = Self::parse(item.text()?);
        if let Err(error) = key {
            item.error(error.to_string()).hint(hint);
        }
        key.ok()
    }

    /// The key as the network carries it.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8; 32] {
        &self.0
    }

    /// The first 8 bytes of its SHA-256 in hexadecimal, for people to compare: `1f3a-09b2-…`.
    ///
    /// Another key with the same one is 2⁶⁴ tries away; where that matters, keys themselves are
    /// compared.
    #[must_use]
    pub fn fingerprint(&self) -> String {
        Sha256::digest(self.0).chunks(2).take(4).map(hex).collect::<Vec<_>>().join("-")
    }
}

impl fmt::Display for PublicKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&z85::encode(&self.0))
    }
}

impl fmt::Debug for PublicKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "PublicKey({self})")
    }
}

/// A machine's two keys.
#[derive(Clone)]
pub struct KeyPair {
    public: PublicKey,
    secret: [u8; 32],
}

crate::printable::debug_by!(KeyPair, public);

/// A file of keys cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum KeyError {
    /// Make one: `onbrick key new`.
    #[error("there is no key at {}", .0.display())]
    Missing(PathBuf),
    /// There is one already: the machines that know it would no longer know this one.
    #[error("{} is there already", .0.display())]
    Exists(PathBuf),
    /// Take the permissions away: `chmod 600`.
    #[error("others can read {}, so it is no secret", .0.display())]
    Readable(PathBuf),
    /// Mend the file.
    #[error(transparent)]
    Broken(#[from] Findings),
    /// The disk or its permissions.
    #[error("cannot use {}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What went wrong.
        source: io::Error,
    },
    /// Choose another name.
    #[error(transparent)]
    Name(#[from] NoName),
    /// A brick of this name is known with another key, the one that is named here: forget it first,
    /// if it was set up again.
    #[error("{name} is known already, with another key: {}", .known.fingerprint())]
    AnotherKey {
        /// The name.
        name: Name,
        /// The key of the brick that is known.
        known: PublicKey,
    },
    /// This program has no CURVE.
    #[error(transparent)]
    NoCurve(#[from] NoCurve),
    /// libsodium makes no keys.
    #[error("no keys can be made")]
    Generate(#[source] zmq::Error),
}

impl From<SaveError> for KeyError {
    fn from(error: SaveError) -> Self {
        match error {
            SaveError::Exists(path) => Self::Exists(path),
            SaveError::Io { path, source } => Self::Io { path, source },
        }
    }
}

impl KeyError {
    fn io(path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { path, source }
    }
}

/// The file of a machine's own pair, in its folder of keys.
const OWN: &str = "own.key";

impl KeyPair {
    /// Makes a pair. It waits for the kernel's random numbers where there are none yet.
    ///
    /// # Errors
    ///
    /// [`KeyError::NoCurve`], [`KeyError::Generate`].
    pub fn generate() -> Result<Self, KeyError> {
        curve::require()?;
        let pair = zmq::CurveKeyPair::new().map_err(KeyError::Generate)?;
        Ok(Self { public: PublicKey(pair.public_key), secret: pair.secret_key })
    }

    /// A pair from its halves.
    pub(super) fn from_halves(public: PublicKey, secret: [u8; 32]) -> Self {
        Self { public, secret }
    }

    /// The half that others may know.
    #[must_use]
    pub fn public(&self) -> PublicKey {
        self.public
    }

    /// The secret half, for a socket.
    pub(super) fn secret(&self) -> &[u8; 32] {
        &self.secret
    }

    /// Reads this machine's pair from its folder of keys.
    ///
    /// # Errors
    ///
    /// [`KeyError::Missing`] where there is none, [`KeyError::Readable`] where others could read
    /// it, [`KeyError::Broken`], [`KeyError::Io`].
    pub fn load(folder: &Path) -> Result<Self, KeyError> {
        let path = folder.join(OWN);
        let mut file = open(&path)?;
        let mode = file.metadata().map_err(KeyError::io(&path))?.permissions().mode();
        if mode & 0o077 != 0 {
            return Err(KeyError::Readable(path));
        }
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(KeyError::io(&path))?;
        let document = Document::new(&path.display().to_string(), &bytes)?;
        let halves = document.read(|root| {
            root.allow(&["public", "secret"]);
            let half = |name| {
                let item = root.require(name)?;
                let key = z85::decode(item.text()?);
                if key.is_none() {
                    item.error(NoKey.to_string());
                }
                key
            };
            Some((half("public")?, half("secret")?))
        });
        let ((public, secret), _) = halves?;
        Ok(Self { public: PublicKey(public), secret })
    }

    /// Writes the pair into a folder of keys, which is created if missing.
    ///
    /// # Errors
    ///
    /// [`KeyError::Exists`] where there is a pair already; it is not touched. [`KeyError::Io`].
    pub fn save(&self, folder: &Path) -> Result<PathBuf, KeyError> {
        let path = folder.join(OWN);
        let (public, secret) = (self.public, z85::encode(&self.secret));
        let text = format!(
            "# The secret proves to be this machine. It stays here; the public half is for others \
             (`onbrick key show`).\n\
             public = \"{public}\"\nsecret = \"{secret}\"\n"
        );
        make_folder(folder)?;
        create(&path, &text, Readers::Owner)?;
        Ok(path)
    }

    /// Reads this machine's pair, or makes and keeps one.
    ///
    /// # Errors
    ///
    /// As [`KeyPair::load`], [`KeyPair::generate`] and [`KeyPair::save`].
    pub fn load_or_make(folder: &Path) -> Result<Self, KeyError> {
        match Self::load(folder) {
            Err(KeyError::Missing(_)) => {}
            loaded => return loaded,
        }
        match Self::generate()?.save(folder) {
            // Another process may have been faster: either way the file has it.
            Ok(_) | Err(KeyError::Exists(_)) => Self::load(folder),
            Err(error) => Err(error),
        }
    }
}

/// Opens a file of keys.
fn open(path: &Path) -> Result<File, KeyError> {
    File::open(path).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => KeyError::Missing(path.to_owned()),
        _ => KeyError::io(path)(error),
    })
}

/// A folder that only its owner enters.
fn make_folder(folder: &Path) -> Result<(), KeyError> {
    DirBuilder::new().recursive(true).mode(0o700).create(folder).map_err(KeyError::io(folder))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn a_pair_comes_back_from_its_file_which_nobody_else_reads() {
        let folder = tempfile::tempdir().unwrap();
        let keys = folder.path().join("keys");
        assert!(matches!(KeyPair::load(&keys), Err(KeyError::Missing(_))));
        let made = KeyPair::load_or_make(&keys).unwrap();
        let path = keys.join(OWN);
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
        assert_eq!(fs::metadata(&keys).unwrap().permissions().mode() & 0o777, 0o700);
        let loaded = KeyPair::load_or_make(&keys).unwrap();
        assert_eq!((loaded.public(), loaded.secret()), (made.public(), made.secret()));
        assert!(
            matches!(made.save(&keys), Err(KeyError::Exists(_))),
            "a pair is never written over"
        );
        assert_eq!(fs::read_dir(&keys).unwrap().count(), 1, "nothing is left lying about");
        assert!(!format!("{made:?}").contains(&z85::encode(made.secret())));

        fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
        assert!(matches!(KeyPair::load(&keys), Err(KeyError::Readable(_))));
    }

    #[test]
    fn a_broken_file_of_keys_says_where() {
        let folder = tempfile::tempdir().unwrap();
        let write = |text: &str| {
            let path = folder.path().join(OWN);
            fs::write(&path, text).unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
            KeyPair::load(folder.path()).unwrap_err().to_string()
        };
        let short = write("public = \"abc\"\nsecret = 3\n");
        assert!(short.contains("own.key:1:10") && short.contains("this is no key"), "{short}");
        assert!(write("pulic = \"x\"").contains("unknown key `pulic`"));
        assert!(write("\u{0}").contains("own.key:1:"));
    }

    #[test]
    fn a_key_is_written_in_z85_and_shown_by_its_fingerprint() {
        // rfc.zeromq.org/spec/26, the server's key of the CURVE test vector.
        let text = "rq:rM>}U?@Lns47E1%kR.o@n%FcmmsL/@{H8]yf7";
        let key = PublicKey::parse(text).unwrap();
        assert_eq!(key.to_string(), text);
        assert_eq!(key.fingerprint().len(), 19, "{}", key.fingerprint());
        assert_eq!(PublicKey::parse(&text[1..]), Err(NoKey));
    }
}
