//! The promises of "nothing keeps driving", each with tests that count. A test's name begins with
//! its promise's number, `promise_5_…`; tests of a promise may stand anywhere in this binary.
//! [`table`] prints them all with what they counted:
//!
//! ```text
//! ONBRICK_PROMISES=1 cargo test --test it table_of_promises -- --nocapture
//! ```
//!
//! With `ONBRICK_LONG=1` besides (and `--release` behind `cargo test`) it takes the long forms.
#![cfg(feature = "host")]

mod attributes;
mod battery;
mod commands;
mod disk;
mod flips;
mod kills;
mod matrix;
mod plugs;
mod roll;
mod soak;
mod table;
mod wall_clock;
mod witness;
