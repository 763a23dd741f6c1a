//! Files that no person would write and answers that no driver should give: always a message with
//! its place and a way out, nothing moved, never a panic. Missions have theirs in `behavior`.

pub mod drivers;
#[cfg(feature = "sim")]
mod files;
