//! Tests of ev3dev.
