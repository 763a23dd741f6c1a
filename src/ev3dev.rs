//! Typed devices over the attribute files of ev3dev.

mod tree;
mod words;

pub use tree::{Access, AttributeFile, LocalTree, Tree};
pub use words::{StopAction, UnknownWord};
