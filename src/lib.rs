//! onbrick
pub mod behavior;
#[cfg(feature = "cli")]
pub mod cli;
pub mod clock;
pub mod document;
pub mod ev3dev;
pub mod mapping;
#[cfg(feature = "host")]
pub mod report;
pub mod robot;
pub mod runtime;
#[cfg(feature = "sim")]
pub mod sim;
pub mod units;
