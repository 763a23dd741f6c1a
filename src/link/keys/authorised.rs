//! Who may ask this machine: one small file for each key.
//!
//! A key's file is named after its fingerprint, so that one look answers whether it is there. Each
//! request looks, and a file that is taken away counts from the next request on. `onbrick key
//! authorise`, `key revoke` and `key list` write, delete and list them.
//!
//! # What we count on
//!
//! - Write access to the folder decides who may start this machine's motors: only its owner has it
//!   (0700, files 0600).

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::{KeyError, PublicKey, make_folder, open};
use crate::document::save::{Readers, write};
use crate::document::{Document, if_there, toml_files};
use crate::protocol::Name;

/// The folder of keys that may ask this machine.
#[derive(Debug, Clone)]
pub struct Authorised {
    folder: PathBuf,
}

/// A key that may ask this machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AuthorisedKey {
    /// What its owner is called.
    pub name: String,
    /// The key.
    pub key: PublicKey,
}

/// The longest file, bytes.
const LONGEST_FILE: u64 = 4096;

impl Authorised {
    /// The authorised keys in a folder of keys. Nothing is read or made yet.
    #[must_use]
    pub fn below(keys: &Path) -> Self {
        Self { folder: keys.join("authorised") }
    }

    /// The name under which a key may ask; `None` where it may not.
    ///
    /// # Errors
    ///
    /// [`KeyError::Broken`] and [`KeyError::Io`]: such a key may not ask either.
    pub fn find(&self, key: &PublicKey) -> Result<Option<String>, KeyError> {
        match read(&self.path(key)) {
            // Two keys with one fingerprint are not one key.
            Ok(found) => Ok((found.key == *key).then_some(found.name)),
            Err(KeyError::Missing(_)) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Lets a key ask from now on, under a name; one that could before gets the new name.
    ///
    /// # Errors
    ///
    /// [`KeyError::Name`], [`KeyError::Io`].
    pub fn add(&self, key: &PublicKey, name: &str) -> Result<PathBuf, KeyError> {
        let name = Name::new(name)?;
        make_folder(&self.folder)?;
        let path = self.path(key);
        let text = format!("name = \"{name}\"\nkey = \"{key}\"\n");
        write(&path, text.as_bytes(), Readers::Owner)?;
        Ok(path)
    }

    /// Takes the right to ask from whom a name, a fingerprint or a key means; returns who that was.
    ///
    /// # Errors
    ///
    /// [`KeyError`]; what could not be read is not deleted.
    pub fn remove(&self, which: &str) -> Result<Vec<AuthorisedKey>, KeyError> {
        let means = |found: &AuthorisedKey| {
            found.name == which
                || found.key.fingerprint() == which
                || found.key.to_string() == which
        };
        let removed: Vec<AuthorisedKey> = self.list()?.into_iter().filter(means).collect();
        for found in &removed {
            let path = self.path(&found.key);
            fs::remove_file(&path).map_err(KeyError::io(&path))?;
        }
        Ok(removed)
    }

    /// All of them, by name.
    ///
    /// # Errors
    ///
    /// [`KeyError`] at the first file that cannot be used.
    pub fn list(&self) -> Result<Vec<AuthorisedKey>, KeyError> {
        let files = if_there(toml_files(&self.folder)).map_err(KeyError::io(&self.folder))?;
        let found = files.into_iter().flatten().map(|path| read(&path));
        let mut found = found.collect::<Result<Vec<_>, _>>()?;
        found.sort_by(|one, other| (&one.name, one.key).cmp(&(&other.name, other.key)));
        Ok(found)
    }

    fn path(&self, key: &PublicKey) -> PathBuf {
        self.folder.join(format!("{}.toml", key.fingerprint()))
    }
}

fn read(path: &Path) -> Result<AuthorisedKey, KeyError> {
    let mut bytes = Vec::new();
    io::Read::read_to_end(&mut io::Read::take(open(path)?, LONGEST_FILE), &mut bytes)
        .map_err(KeyError::io(path))?;
    let document = Document::new(&path.display().to_string(), &bytes)?;
    let read = document.read(|root| {
        root.allow(&["name", "key"]);
        // A person may have written any text there.
        let name = Name::nearest(root.require("name")?.text()?).to_string();
        let key = PublicKey::read(&root.require("key")?, "")?;
        Some(AuthorisedKey { name, key })
    });
    Ok(read?.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(byte: u8) -> PublicKey {
        PublicKey::from_bytes([byte; 32])
    }

    #[test]
    fn a_key_may_ask_until_it_is_revoked() {
        let folder = tempfile::tempdir().unwrap();
        let authorised = Authorised::below(folder.path());
        assert_eq!(authorised.find(&key(1)).unwrap(), None);
        assert_eq!(authorised.list().unwrap(), []);
        authorised.add(&key(1), "anna").unwrap();
        authorised.add(&key(2), "board").unwrap();
        authorised.add(&key(3), "board").unwrap();
        assert_eq!(authorised.find(&key(1)).unwrap().as_deref(), Some("anna"));
        let names: Vec<String> =
            authorised.list().unwrap().into_iter().map(|found| found.name).collect();
        assert_eq!(names, ["anna", "board", "board"]);

        assert_eq!(authorised.remove("nobody").unwrap(), []);
        assert_eq!(authorised.remove(&key(1).fingerprint()).unwrap().len(), 1);
        assert_eq!(authorised.remove("board").unwrap().len(), 2);
        assert_eq!(authorised.find(&key(1)).unwrap(), None);
    }

    #[test]
    fn a_file_of_another_key_lets_nobody_in() {
        let folder = tempfile::tempdir().unwrap();
        let authorised = Authorised::below(folder.path());
        let path = authorised.add(&key(1), "a").unwrap();
        fs::rename(path, authorised.path(&key(2))).unwrap();
        assert_eq!(authorised.find(&key(2)).unwrap(), None);
        fs::write(authorised.path(&key(3)), "name = 3").unwrap();
        assert!(matches!(authorised.find(&key(3)), Err(KeyError::Broken(_))));
    }

    #[test]
    fn a_name_is_one_even_where_a_person_wrote_another_text() {
        let folder = tempfile::tempdir().unwrap();
        let authorised = Authorised::below(folder.path());
        for bad in ["", "anna's laptop", "a\nb", "a\u{1b}]0;x"] {
            assert!(matches!(authorised.add(&key(1), bad), Err(KeyError::Name(_))), "{bad:?}");
        }
        assert_eq!(authorised.list().unwrap(), []);
        let path = authorised.add(&key(1), "anna").unwrap();
        fs::write(&path, format!("name = \"anna's\\u001b]0;\"\nkey = \"{}\"\n", key(1))).unwrap();
        assert_eq!(authorised.find(&key(1)).unwrap().as_deref(), Some("anna-s--0"));
    }
}
