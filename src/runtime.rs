//! A run: control loop, recorder, replay.

pub mod recording;
