//! The bricks that this PC knows: one file for people, `known_bricks`, with each brick's name,
//! address and key.
//!
//! ```toml
//! [ev3-blue]
//! address = "ev3-blue.local"       # a name or a number, with :port where it is not 5670
//! key = "rq:rM>}U?@Lns47E1%kR.o@n%FcmmsL/@{H8]yf7"
//! ```
//!
//! `onbrick pair` adds bricks to it; a person may edit it, and what else stands in it is kept.

use std::fs::{self, OpenOptions};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use super::{KeyError, PublicKey, make_folder};
use crate::document::save::{Readers, quoted, write};
use crate::document::{Document, Item, Section, if_there};
use crate::link::client::Address;
use crate::printable::line;
use crate::protocol::Name;

/// A brick that this PC knows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KnownBrick {
    /// What it calls itself.
    pub name: String,
    /// Where it is: a host's name or number, with `:port` where that is not the usual one.
    pub address: String,
    /// Its key: whatever answers there with another one is not this brick.
    pub key: PublicKey,
}

impl KnownBrick {
    /// Its address without the link's port: for other programs that go there.
    #[must_use]
    pub fn host(&self) -> String {
        Address::parse(&self.address, 0).host
    }
}

/// The file of bricks that this PC knows.
#[derive(Debug, Clone)]
pub struct KnownBricks {
    path: PathBuf,
    text: String,
    bricks: Vec<(KnownBrick, usize)>,
}

/// Where a brick's key is found.
pub(in crate::link) const ON_THE_BRICK: &str = "`onbrick key show` on the brick prints it";

const HEADER: &str =
    "# Bricks that this PC knows. `onbrick pair` adds one, `onbrick key forget` takes it out.\n";

impl KnownBricks {
    /// Reads the file in a folder of keys; where there is none, no brick is known.
    ///
    /// # Errors
    ///
    /// [`KeyError::Broken`], [`KeyError::Io`].
    pub fn load(folder: &Path) -> Result<Self, KeyError> {
        let path = folder.join("known_bricks");
        match if_there(fs::read(&path)).map_err(KeyError::io(&path))? {
            Some(bytes) => Self::parse(path, &bytes),
            None => Ok(Self { path, text: HEADER.to_owned(), bricks: Vec::new() }),
        }
    }

    fn parse(path: PathBuf, bytes: &[u8]) -> Result<Self, KeyError> {
        let document = Document::new(&path.display().to_string(), bytes)?;
        let read = document.read(|root| Some(root.items().iter().filter_map(brick).collect()));
        let (bricks, _) = read?;
        Ok(Self { path, text: document.text().to_owned(), bricks })
    }

    /// All of them, in the order of the file.
    pub fn iter(&self) -> impl Iterator<Item = &KnownBrick> {
        self.bricks.iter().map(|(brick, _)| brick)
    }

    /// The brick of this name, or, where none is called so, at this address.
    #[must_use]
    pub fn find(&self, name_or_address: &str) -> Option<&KnownBrick> {
        let by_name = self.iter().find(|brick| brick.name == name_or_address);
        by_name.or_else(|| self.iter().find(|brick| brick.address == name_or_address))
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The brick that is known by this name with another key.
    #[must_use]
    pub fn another(&self, name: &Name, key: &PublicKey) -> Option<&KnownBrick> {
        self.iter().find(|known| known.name == name.as_str() && known.key != *key)
    }

    /// Adds a brick to what the file holds by now, in place of one with the same key, and writes
    /// it. An entry of the same name with another key is replaced only if that key is `replaced`: a
    /// person has confirmed it.
    ///
    /// Other writers wait meanwhile, so no entry is lost.
    ///
    /// # Errors
    ///
    /// [`KeyError::Name`], [`KeyError::AnotherKey`], [`KeyError::Broken`] where the file has been
    /// broken meanwhile, [`KeyError::Io`]; it is then as it was.
    pub fn put(&mut self, brick: &KnownBrick, replaced: Option<PublicKey>) -> Result<(), KeyError> {
        let name = Name::new(&brick.name)?;
        self.rewrite(|now| {
            if let Some(other) =
                now.another(&name, &brick.key).filter(|other| replaced != Some(other.key))
            {
                return Err(KeyError::AnotherKey { name, known: other.key });
            }
            let mut text = now.without(|known| known.name == brick.name || known.key == brick.key);
            if !text.is_empty() && !text.ends_with('\n') {
                text.push('\n');
            }
            let (name, address, key) = (quoted(&brick.name), quoted(&brick.address), brick.key);
            text.push_str(&format!("\n[{name}]\naddress = {address}\nkey = \"{key}\"\n"));
            Ok(text)
        })
    }

    /// Forgets the brick of this name or at this address, if the file has it by now.
    ///
    /// # Errors
    ///
    /// As [`KnownBricks::put`].
    pub fn forget(&mut self, name_or_address: &str) -> Result<Option<KnownBrick>, KeyError> {
        let mut gone = None;
        self.rewrite(|now| {
            gone = now.find(name_or_address).cloned();
            Ok(now.without(|known| gone.as_ref().is_some_and(|gone| gone.key == known.key)))
        })?;
        Ok(gone)
    }

    /// Writes the file as a change makes it of what it holds by now.
    fn rewrite(
        &mut self,
        change: impl FnOnce(&Self) -> Result<String, KeyError>,
    ) -> Result<(), KeyError> {
        let folder = self.path.parent().unwrap_or(Path::new("")).to_owned();
        make_folder(&folder)?;
        // The file itself is replaced, and a lock on it would go with the old one.
        let beside = self.path.with_extension("lock");
        let lock = OpenOptions::new().create(true).append(true).mode(0o600).open(&beside);
        let _held = lock
            .and_then(|lock| lock.lock().map(|()| lock))
            .map_err(|error| KeyError::io(&beside)(error))?;
        let now = Self::load(&folder)?;
        let text = change(&now)?;
        let fresh = Self::parse(now.path, text.as_bytes())?;
        write(&fresh.path, text.as_bytes(), Readers::Owner)?;
        *self = fresh;
        Ok(())
    }

    /// The text without the tables of some bricks: from a table's first line to the next table's,
    /// or the end.
    fn without(&self, gone: impl Fn(&KnownBrick) -> bool) -> String {
        let mut kept = String::new();
        let mut from = 0;
        let starts: Vec<usize> =
            self.bricks.iter().map(|(_, place)| line_start(&self.text, *place)).collect();
        for (at, (brick, _)) in self.bricks.iter().enumerate() {
            let start = starts.get(at).copied().unwrap_or(self.text.len());
            let end = starts.get(at + 1).copied().unwrap_or(self.text.len());
            kept.push_str(self.text.get(from..start).unwrap_or_default());
            from = if gone(brick) { end } else { start };
        }
        kept.push_str(self.text.get(from..).unwrap_or_default());
        kept
    }
}

fn line_start(text: &str, place: usize) -> usize {
    text.get(..place).and_then(|before| before.rfind('\n')).map_or(0, |end| end + 1)
}

fn brick(item: &Item<'_>) -> Option<(KnownBrick, usize)> {
    let section: Section<'_> = item.section()?;
    section.allow(&["address", "key"]);
    let address = line(section.require("address")?.text()?).into_owned();
    let key = PublicKey::read(&section.require("key")?, ON_THE_BRICK);
    // A person may have written any text there.
    let name = line(item.key()).into_owned();
    Some((KnownBrick { name, address, key: key? }, item.key_place().start))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn brick(name: &str, byte: u8) -> KnownBrick {
        KnownBrick {
            name: name.to_owned(),
            address: format!("{name}.local"),
            key: PublicKey::from_bytes([byte; 32]),
        }
    }

    #[test]
    fn bricks_are_added_and_replaced_and_the_rest_of_the_file_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let mut known = KnownBricks::load(folder.path()).unwrap();
        assert_eq!(known.iter().count(), 0);
        for (name, byte) in [("blue", 1), ("my-red-one", 2), ("green", 3)] {
            known.put(&brick(name, byte), None).unwrap();
        }
        let path = known.path().to_owned();
        // As a person writes it.
        let text = fs::read_to_string(&path).unwrap();
        let text = text.replace("[\"my-red-one\"]", "# the fast one\n[\"my \\\"red\\\" one\"]");
        fs::write(&path, text).unwrap();

        let mut known = KnownBricks::load(folder.path()).unwrap();
        // The same brick under another name, and another brick under the same one.
        known.put(&brick("sea", 1), None).unwrap();
        known.put(&brick("green", 4), Some(PublicKey::from_bytes([3; 32]))).unwrap();
        let known = KnownBricks::load(folder.path()).unwrap();
        let names: Vec<&str> = known.iter().map(|known| known.name.as_str()).collect();
        assert_eq!(names, ["my \"red\" one", "sea", "green"]);
        assert_eq!(known.find("green").unwrap().key, PublicKey::from_bytes([4; 32]));
        assert_eq!(known.find("sea.local").unwrap().name, "sea");
        assert_eq!(known.find("blue"), None);
        let mut known = known;
        assert_eq!(known.forget("sea.local").unwrap().unwrap().name, "sea");
        assert_eq!(known.forget("sea").unwrap(), None);
        let names: Vec<&str> = known.iter().map(|known| known.name.as_str()).collect();
        assert_eq!(names, ["my \"red\" one", "green"]);
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.starts_with(HEADER), "{text}");
    }

    #[test]
    fn a_file_that_is_kept_elsewhere_stays_there_and_only_its_owner_reads_it() {
        use std::os::unix::fs::PermissionsExt as _;
        let (folder, elsewhere) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let (link, kept) =
            (folder.path().join("known_bricks"), elsewhere.path().join("my_known_bricks"));
        fs::write(&kept, HEADER).unwrap();
        std::os::unix::fs::symlink(&kept, &link).unwrap();
        let mut known = KnownBricks::load(folder.path()).unwrap();
        known.put(&brick("green", 3), None).unwrap();
        assert!(link.symlink_metadata().unwrap().is_symlink());
        assert!(fs::read_to_string(&kept).unwrap().contains("[\"green\"]"));
        assert_eq!(fs::metadata(&kept).unwrap().permissions().mode() & 0o777, 0o600);
    }

    #[test]
    fn a_brick_of_a_known_name_with_another_key_never_takes_its_place_unasked() {
        let folder = tempfile::tempdir().unwrap();
        let mut known = KnownBricks::load(folder.path()).unwrap();
        known.put(&brick("green", 3), None).unwrap();
        let text = fs::read_to_string(known.path()).unwrap();
        let key = |byte| PublicKey::from_bytes([byte; 32]);
        for replaced in [None, Some(key(4)), Some(key(5))] {
            let refused = known.put(&brick("green", 4), replaced).unwrap_err();
            assert!(
                matches!(&refused, KeyError::AnotherKey { known, .. } if *known == key(3)),
                "{refused}"
            );
        }
        for bad in ["", "a b", "a\u{1b}]0;", "-a"] {
            assert!(matches!(known.put(&brick(bad, 5), None), Err(KeyError::Name(_))), "{bad:?}");
        }
        assert_eq!(fs::read_to_string(known.path()).unwrap(), text);
        assert_eq!(known.another(&Name::nearest("green"), &key(3)), None);
        assert_eq!(known.another(&Name::nearest("green"), &key(4)), Some(&brick("green", 3)));
    }

    #[test]
    fn none_is_lost_that_others_add_meanwhile() {
        let folder = tempfile::tempdir().unwrap();
        // As `onbrick pair` does: the file is read, and then people compare codes.
        let several: Vec<KnownBricks> =
            (0..8).map(|_| KnownBricks::load(folder.path()).unwrap()).collect();
        std::thread::scope(|scope| {
            for (mut known, byte) in several.into_iter().zip(1..) {
                scope.spawn(move || {
                    known.put(&brick(&format!("brick-{byte}"), byte), None).unwrap()
                });
            }
        });
        let known = KnownBricks::load(folder.path()).unwrap();
        assert_eq!(known.iter().count(), 8, "{}", known.text);
    }

    #[test]
    fn a_bricks_host_is_its_address_without_a_port() {
        for (address, host) in
            [("red.local", "red.local"), ("10.0.0.1:81", "10.0.0.1"), ("[::1]:81", "::1")]
        {
            let brick = KnownBrick { address: address.to_owned(), ..brick("red", 1) };
            assert_eq!(brick.host(), host);
        }
    }

    #[test]
    fn a_mistake_in_the_file_has_a_place() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("known_bricks"), "[blue]\nadress = \"x\"\nkey = \"y\"\n")
            .unwrap();
        let message = KnownBricks::load(folder.path()).unwrap_err().to_string();
        assert!(
            message.contains("known_bricks:2:1") && message.contains("did you mean"),
            "{message}"
        );
    }
}
