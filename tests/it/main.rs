//! Tests of the parts together, as their users use them: one binary, so that it links once.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    clippy::print_stderr,
    clippy::float_cmp,
    unreachable_pub,
    reason = "tests stop by panicking, print what they measured, compare bits, and share helpers \
              between modules"
)]

mod arm;
mod bad_input;
mod behavior;
mod boards;
mod commands;
mod drivers_bench;
mod ev3dev;
mod faults;
mod figures;
mod foreign;
mod image;
mod link;
mod mapping;
mod menu;
mod messages;
mod missions;
mod mount;
mod pages;
mod promises;
mod recording;
mod report;
mod scenarios;
mod service;
mod setup;
mod sim_drivers;
mod sim_page;
mod sim_time;
mod sim_world;
mod support;
mod tick;
mod tidy;
mod transcript;
