//! What the emulated brick's scenarios measure with the library itself, on the brick's processor. One program, because
//! each takes long to link.
//!
//! ```text
//! brick-figures reading BRICK COUNT     nanoseconds a typed reading, and one by ev3dev-lang-rust
//! brick-figures stages BRICK SECONDS    nanoseconds of each stage of a tick at 100 Hz
//! brick-figures run FILE                what a recording says of itself, as JSON
//! brick-figures menu RUN FRAMEBUFFER    nanoseconds of each kind of the menu's pictures
//! brick-figures screen FRAMEBUFFER COPY [PICTURE]
//!                                       what a person reads on a screen; and whether it is one of the golden pictures
//! ```

#![allow(clippy::print_stdout, reason = "what it prints is its result")]

mod menu;
mod reading;
mod run;
mod screen;
mod stages;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words.as_slice() {
        ["reading", brick, count] => reading::reading(brick, count),
        ["stages", brick, seconds] => stages::stages(brick, seconds),
        ["run", file] => run::run(file),
        ["menu", run, framebuffer] => menu::menu(run, framebuffer),
        ["screen", framebuffer, copy] => screen::screen(framebuffer, copy, None),
        ["screen", framebuffer, copy, golden] => screen::screen(framebuffer, copy, Some(golden)),
        _ => Err("usage: brick-figures reading BRICK COUNT | stages BRICK SECONDS | run FILE | menu RUN FRAMEBUFFER | screen FRAMEBUFFER COPY [PICTURE]".into()),
    }
}
