//! What the link's figures are measured with, inside the network namespaces of the test
//! `link::figures`. One program, because each takes long to link.
//!
//! ```text
//! link-figures seed-server BRICK ADDRESS   the seed's server: any file of a brick to any client
//! link-figures seed-loop ADDRESS SECONDS   the seed's mapping robot: loop here, brick there
//! link-figures send FILE ADDRESS           a file over plain TCP, once
//! link-figures receive ADDRESS             takes it, and says how long that took
//! link-figures flood ADDRESS KEY SECONDS   handshakes of strangers, as fast as they go
//! ```

#![allow(clippy::print_stdout, reason = "what it prints is its result")]

mod copy;
mod flood;
mod seed;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words.as_slice() {
        ["seed-server", brick, address] => seed::serve(brick, address),
        ["seed-loop", address, seconds] => seed::drive(address, seconds.parse()?),
        ["send", file, address] => copy::send(file, address),
        ["receive", address] => copy::receive(address),
        ["flood", address, key, seconds] => flood::flood(address, key, seconds.parse()?),
        _ => Err("usage: see the beginning of its source".into()),
    }
}
