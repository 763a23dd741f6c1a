//! What the emulated brick has beside the brick's own file, in one program, because each takes
//! minutes to link: `onbrick` with the simulated brick, and, called `brick-figures`, what its
//! scenarios measure with the library itself on the brick's processor.
//!
//! ```text
//! brick-figures reading BRICK COUNT     nanoseconds a typed reading, and one by ev3dev-lang-rust
//! brick-figures stages BRICK SECONDS map|large   nanoseconds of each stage of a tick at 100 Hz
//! brick-figures run FILE                what a recording says of itself, as JSON
//! brick-figures job MISSION BRICK FILE  the job of a run into FILE, for `onbrick control`;
//!                                       BRICK is a folder, or `simulated`
//! brick-figures status SOCKET           what the service says of itself at its local door, as JSON
//! brick-figures menu RUN FRAMEBUFFER    nanoseconds of each kind of the menu's pictures
//! brick-figures screen FRAMEBUFFER COPY [PICTURE]
//!                                       what a person reads on a screen; and whether it is one of
//!                                       the golden pictures
//! ```

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "what it prints is its result")]

use std::error::Error;
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use onbrick::protocol::{Request, Status};
use onbrick::service::client::Client;

mod job;
mod menu;
mod reading;
mod run;
mod screen;
mod stages;

const USAGE: &str = "usage: brick-figures reading BRICK COUNT | stages BRICK SECONDS MISSION | run \
                     FILE | job MISSION BRICK FILE | status SOCKET | menu RUN FRAMEBUFFER | screen \
                     FRAMEBUFFER COPY [PICTURE]";

fn main() -> ExitCode {
    let called = std::env::args_os().next().unwrap_or_default();
    if Path::new(&called).file_name().is_none_or(|name| name != "brick-figures") {
        return onbrick::cli::main(std::env::args_os());
    }
    match figures() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn figures() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words.as_slice() {
        ["reading", brick, count] => reading::reading(brick, count),
        ["stages", brick, seconds, which] => stages::stages(brick, seconds, which),
        ["run", file] => run::run(file),
        ["job", mission, brick, file] => job::job(mission, brick, file),
        ["status", socket] => status(socket),
        ["menu", run, framebuffer] => menu::menu(run, framebuffer),
        ["screen", framebuffer, copy] => screen::screen(framebuffer, copy, None),
        ["screen", framebuffer, copy, golden] => screen::screen(framebuffer, copy, Some(golden)),
        _ => Err(USAGE.into()),
    }
}

fn status(socket: &str) -> Result<(), Box<dyn Error>> {
    let status: Status = Client::at(socket).ask(&Request::Status, Duration::from_secs(5))?;
    println!("{}", serde_json::to_string(&status)?);
    Ok(())
}
