//! The network: a person at a PC starts and stops missions on bricks and brings their maps home.
//!
//! Nothing that drives waits for anything here.

pub mod curve;
