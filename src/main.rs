//! The program: parse arguments, call one command, set the exit code.

use std::process::ExitCode;

fn main() -> ExitCode {
    onbrick::cli::main(std::env::args_os())
}
