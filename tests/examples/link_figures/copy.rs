//! A file over plain TCP, with nothing around it: what a fetch is compared with.

use std::fs::File;
use std::io::{copy, sink};
use std::net::{TcpListener, TcpStream};
use std::time::Instant;

type Outcome = Result<(), Box<dyn std::error::Error>>;

/// Sends the file to the first who connects.
pub(crate) fn send(file: &str, address: &str) -> Outcome {
    let listener = TcpListener::bind(address)?;
    println!("listening");
    let (mut to, _) = listener.accept()?;
    copy(&mut File::open(file)?, &mut to)?;
    Ok(())
}

/// Takes all that comes.
pub(crate) fn receive(address: &str) -> Outcome {
    let begun = Instant::now();
    let bytes = copy(&mut TcpStream::connect(address)?, &mut sink())?;
    println!("{}", serde_json::json!({ "bytes": bytes, "seconds": begun.elapsed().as_secs_f64() }));
    Ok(())
}
