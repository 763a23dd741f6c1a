//! Roles: which port is the left wheel, the head, the range sensor.

mod senses;

pub use senses::{Channel, Reading, Senses};
