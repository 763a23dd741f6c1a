//! Typed devices against fakes that are made of their own tables, and the tables against what the
//! kernel's drivers said.

mod find;
mod motors;
mod others;
mod sensors;
mod tables;
