//! What may never happen (issue 6), each promise with its number in the tests' names: `cargo test promise_` prints them all.
#![cfg(all(feature = "cli", feature = "sim"))]

mod kills;
mod matrix;
mod plugs;
mod witness;
