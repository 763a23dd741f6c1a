//! What bricks and PCs are called, by people and in front of people.

use serde::{Deserialize, Serialize};

/// A brick's or a PC's name: 1 to 64 letters and digits of ASCII, `-`, `_` and `.`, a letter or a
/// digit first.
///
/// People compare names, and type them: so there is nothing in one that looks like something else,
/// that a terminal obeys, or that a shell takes for more than a word. Both sides of a pairing check
/// it.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String")]
pub struct Name(String);

/// A text that is no name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "a name has 1 to {} letters (a-z, A-Z), digits, - _ and ., and begins with a letter or a digit",
    Name::MAX_BYTES
)]
pub struct NoName;

impl Name {
    /// The longest name.
    pub const MAX_BYTES: usize = 64;

    /// Takes a text as a name.
    ///
    /// # Errors
    ///
    /// The text is empty, too long, or has other signs in it.
    pub fn new(text: &str) -> Result<Self, NoName> {
        let fits = (1..=Self::MAX_BYTES).contains(&text.len())
            && text.chars().all(may_be_in_one)
            && text.starts_with(|first: char| first.is_ascii_alphanumeric());
        if fits { Ok(Self(text.to_owned())) } else { Err(NoName) }
    }

    /// The name that is nearest to a text: `-` in place of each sign that no name has; `nameless`
    /// where nothing is left.
    #[must_use]
    pub fn nearest(text: &str) -> Self {
        let plain = |sign: char| if may_be_in_one(sign) { sign } else { '-' };
        let text: String = text.trim().chars().map(plain).collect();
        let text = text.trim_matches(['-', '_', '.']);
        let text = text.get(..text.len().min(Self::MAX_BYTES)).unwrap_or_default();
        Self(if text.is_empty() { "nameless" } else { text }.to_owned())
    }

    /// The one nearest to this machine's own.
    #[must_use]
    pub fn of_this_machine() -> Self {
        Self::nearest(&nix::unistd::gethostname().unwrap_or_default().to_string_lossy())
    }

    /// The text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

fn may_be_in_one(sign: char) -> bool {
    sign.is_ascii_alphanumeric() || matches!(sign, '-' | '_' | '.')
}

impl TryFrom<String> for Name {
    type Error = NoName;

    fn try_from(text: String) -> Result<Self, NoName> {
        Self::new(&text)
    }
}

impl std::str::FromStr for Name {
    type Err = NoName;

    fn from_str(text: &str) -> Result<Self, NoName> {
        Self::new(text)
    }
}

impl std::fmt::Display for Name {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_a_word_that_looks_like_nothing_else() {
        for good in ["ev3-blue", "a", "EV3.local", "3", "a_b"] {
            assert_eq!(Name::new(good).unwrap().as_str(), good);
        }
        let long = "x".repeat(65);
        for bad in
            ["", " ", "a b", "-a", ".a", "ä", "a\u{1b}]0;", "a\nb", "а", "a\u{202e}", "a'", &long]
        {
            assert_eq!(Name::new(bad), Err(NoName), "{bad:?}");
        }
    }

    #[test]
    fn the_nearest_name_of_a_text_is_one() {
        let nearest = |text: &str| Name::nearest(text).to_string();
        assert_eq!(nearest("anna's laptop"), "anna-s-laptop");
        assert_eq!(nearest("  a\nb\u{1b}[31m "), "a-b--31m");
        assert_eq!(nearest("-ev3-"), "ev3");
        assert_eq!(nearest("ü"), "nameless");
        assert_eq!(nearest(&"x".repeat(99)).len(), Name::MAX_BYTES);
    }

    proptest::proptest! {
        #[test]
        fn what_is_nearest_to_any_text_is_a_name(text: String) {
            let name = Name::nearest(&text);
            proptest::prop_assert_eq!(Name::new(name.as_str()), Ok(name));
        }
    }
}
