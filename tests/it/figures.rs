//! Figures over other people's recordings of real robots: `cargo test --test it figures -- --nocapture`.

mod motor_steps;
