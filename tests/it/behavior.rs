//! Tests of behavior.
