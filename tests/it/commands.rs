//! The commands as their users use them: the real binary, its output, its exit codes, its files.
#![cfg(feature = "host")]

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::support::real_time::Pace;
use crate::support::tested_program;

mod brick;
mod files;
mod finished;
mod help;
mod hints;
mod outside;
mod paged;
mod processes;
mod simulated;
mod texts;

/// How a command ended, and what it said.
#[derive(Debug)]
pub struct Done {
    pub code: Option<i32>,
    pub out: String,
    pub err: String,
}

impl Done {
    /// The same, if it ended with this code.
    #[track_caller]
    pub fn expect(self, code: i32) -> Self {
        assert_eq!(self.code, Some(code), "out: {}\nerr: {}", self.out, self.err);
        assert!(!self.err.contains("panicked"), "{}", self.err);
        self
    }

    /// Each line of the output as JSON.
    #[track_caller]
    pub fn json(&self) -> Vec<Value> {
        let parsed = self
            .out
            .lines()
            .map(|line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{line}: {e}")));
        parsed.collect()
    }
}

/// The program, to be run in a folder.
pub fn onbrick(folder: &Path, arguments: &[&str]) -> Command {
    with_arguments(Command::new(tested_program()), folder, arguments)
}

/// The same for a run in real time.
pub fn onbrick_in_time(folder: &Path, arguments: &[&str]) -> Command {
    with_arguments(Pace::command(tested_program()), folder, arguments)
}

fn with_arguments(mut command: Command, folder: &Path, arguments: &[&str]) -> Command {
    command.args(arguments).current_dir(folder).stdin(Stdio::null()).env_remove("RUST_LOG");
    command
}

pub fn run(folder: &Path, arguments: &[&str]) -> Done {
    done(&onbrick(folder, arguments).output().unwrap())
}

pub fn done(output: &std::process::Output) -> Done {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    Done { code: output.status.code(), out: text(&output.stdout), err: text(&output.stderr) }
}

/// The names below a folder, sorted.
pub fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// The keys of a JSON object, sorted.
pub fn keys(value: &Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

pub fn text(path: PathBuf) -> String {
    path.to_str().unwrap().to_owned()
}
