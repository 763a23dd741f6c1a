//! Commissioning: before there is a run, a robot is set up, measured and looked over.
//!
//! [`setup`](setup()) writes `robot.toml` by asking, [`calibrate`](calibrate()) measures the robot
//! by driving it, [`examine`] checks whether all is in order. They talk with a person through a
//! [`Dialogue`], on a terminal or on the brick.
//!
//! # Not here
//!
//! No run of a mission (`runtime`), no terminal (`cli`).

mod calibrate;
mod dialogue;
mod doctor;
mod setup;

pub use calibrate::{
    ApplyError, CalibrateError, CalibrateOptions, Calibration, Doubt, EditError, Kind, Measured,
    Straight, calibrate, set_values,
};
pub use dialogue::{Dialogue, NoAnswer};
pub use doctor::{Checked, Diagnosis, Patient, Verdict, examine};
pub use setup::{Draft, DraftHead, DraftMotor, SetupError, setup};
