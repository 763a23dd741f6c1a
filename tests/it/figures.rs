//! Figures from recordings of real LEGO robots: how good the mapper is on them.
//!
//! `cargo test --test it figures -- --nocapture` prints them all. Each test also holds its figures
//! within bounds, so that they cannot rot. The recordings were made by other people and are not in
//! this repository.

mod brenner;
mod calibrated;
mod drift;
mod encoder_gyro;
mod explore;
mod maps;
mod motor_steps;
mod rooms;
mod sonar;
mod sonar_model;
mod team;
mod together;
mod walls;
