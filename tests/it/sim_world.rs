//! Tests of sim_world.
