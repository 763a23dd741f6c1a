//! Faults of the simulated brick: each kind on each kind of device, read as files and through the
//! typed bindings; orders, scenarios, runs.
#![cfg(feature = "sim")]

mod matrix;
mod orders;
mod runs;
