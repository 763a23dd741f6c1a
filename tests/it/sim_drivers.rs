//! Tests of sim_drivers.
