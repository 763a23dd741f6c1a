//! The kernel's words as enums: one table each, so that text and meaning cannot drift apart.

use std::fmt;

/// A word that the kernel does not know.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{word}` is none of {known}")]
pub struct UnknownWord {
    /// The word as it was read.
    pub word: String,
    /// The legal words, separated by spaces.
    pub known: String,
}

/// Makes an enum of a table of words, with `ALL`, `as_str`, `FromStr` and `Display`.
macro_rules! words {
    ($(#[$doc:meta])* $name:ident { $($(#[$word_doc:meta])* $variant:ident = $word:literal,)+ }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum $name { $($(#[$word_doc])* $variant,)+ }

        impl $name {
            /// Every word, in the kernel's order.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)+];

            /// The word as the kernel writes it.
            #[must_use]
            pub const fn as_str(self) -> &'static str {
                match self { $(Self::$variant => $word,)+ }
            }
        }

        impl std::str::FromStr for $name {
            type Err = UnknownWord;

            fn from_str(word: &str) -> Result<Self, UnknownWord> {
                match word {
                    $($word => Ok(Self::$variant),)+
                    _ => Err(UnknownWord { word: word.to_owned(), known: [$($word),+].join(" ") }),
                }
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.pad(self.as_str())
            }
        }
    };
}

words! {
    /// What a motor does when it stops.
    StopAction {
        /// Both bridge inputs low: the motor turns freely.
        Coast = "coast",
        /// Windings shorted: the motor slows itself down.
        Brake = "brake",
        /// The position is held by a regulator.
        Hold = "hold",
    }
}
