//! `onbrick class`: all bricks of a class on one page.
//!
//! ```text
//! browser ── twice a second: state ──▶ answers ──▶ what is known of a brick ◀── its thread ◀─ link
//!         ── posts: stop, start … ──▶         ──▶ orders ──────────────────────▶    │
//!                                               recordings ◀── a fetch a run ◀──────┘
//! ```
//!
//! Everything that a brick is asked goes through the link's client ([`crate::link::client`]). The
//! server is that of the live page ([`crate::page`]), and one brick's picture is the live page's
//! ([`crate::report::live`]).

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;

use serde::{Deserialize, Serialize};

use crate::cli::common::make_folder;
use crate::cli::key::Folder;
use crate::cli::terminal::stop_flags;
use crate::cli::{Context, Exit, Failure, Hint, Output};
use crate::clock::{Clock as _, MILLISECOND_NS, MonotonicClock};
use crate::document::read_bounded;
use crate::document::save::{self, Readers};
use crate::link::KnownBricks;
use crate::link::pairing::token;
use crate::page::{LocalPage, Place};
use crate::printable::json_line;

mod answers;
mod brick;
mod bring;
mod card;
mod hall;
mod missions;
mod pairing;
mod together;

use hall::Hall;

/// Show all bricks of a class on one page, in a browser on this PC: how each is, one Stop for all,
/// missions to write, to try and to start, and the maps as they grow.
///
/// Every brick that this PC knows is on it; those that announce themselves can be paired there. The
/// recording of each run comes home into the folder while it is made.
///
/// Examples:
///   onbrick class
///   onbrick class --folder monday --page 8080
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(in crate::cli) struct Arguments {
    /// The folder for missions, each edit of them, and recordings.
    #[arg(short, long, value_name = "DIR", default_value = "onbrick-class")]
    folder: PathBuf,
    /// The page's port; 0 for the one that the folder had last, if it is free, else any.
    #[arg(long, value_name = "PORT", default_value_t = 0)]
    page: u16,
    #[command(flatten)]
    keys: Folder,
}

/// No post is longer, bytes: a mission's text in JSON's escapes.
const MOST_POSTED: u64 = 256 << 10;

/// How often it is looked whether the page is done with, nanoseconds.
const LOOK_NS: i64 = 50 * MILLISECOND_NS;

const WRITABLE: &str = "--folder with a folder that can be written to";

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let keys = arguments.keys.path()?;
    let own = arguments.keys.own()?;
    let known = KnownBricks::load(&keys)?;
    let flags = stop_flags()?;
    make_folder(Exit::Refused, &arguments.folder).hint(WRITABLE)?;
    let _held = hold(&arguments.folder)?;
    let hall = Arc::new(Hall::new(&arguments.folder, &keys, own));
    known.iter().for_each(|brick| hall.admit(brick));
    hall.listen().context(Exit::Failed, "no thread")?;
    let page = serve(arguments, &hall)?;
    output.show(
        format!(
            "the class is at {}\nthe address is a secret: with it one starts and stops bricks\n\
             Ctrl-C ends the page, and no run",
            page.url()
        ),
        &serde_json::json!({ "page": page.url() }),
    );
    while !flags.signal.load(Ordering::Relaxed) {
        MonotonicClock.sleep_ns(LOOK_NS);
    }
    hall.end();
    Ok(())
}

/// Serves the page where it was the last time, if it can: what is open in a browser then works
/// again, and saves what was written meanwhile.
fn serve(arguments: &Arguments, hall: &Arc<Hall>) -> Result<LocalPage, Failure> {
    let file = arguments.folder.join("class.address");
    let last = Address::read(&file);
    let last_port = last.as_ref().map_or(0, |last| last.port);
    let token = match last {
        Some(last) => last.token,
        None => token().context(Exit::Failed, "no random numbers for the page's address")?,
    };
    let at = |port| {
        let place = Place { port, token: Some(token.clone()), most_posted: MOST_POSTED };
        let answering = Arc::clone(hall);
        LocalPage::serve(&place, move |asked| answers::answer(&answering, asked))
    };
    let page = match arguments.page {
        0 => at(last_port).or_else(|_| at(0)),
        port => at(port),
    }?;
    let here = Address { port: page.port(), token };
    let line = json_line(&here).context(Exit::Failed, "the page's address")?;
    save::write(&file, &line, Readers::Owner)
        .context(Exit::Refused, "the page's address is not kept")
        .hint(WRITABLE)?;
    Ok(page)
}

/// Where the page is, as it is kept in the class's folder; for no other user of this PC.
#[derive(Serialize, Deserialize)]
struct Address {
    port: u16,
    token: String,
}

impl Address {
    /// Nothing where it is no address of ours.
    fn read(file: &Path) -> Option<Self> {
        let address: Self = serde_json::from_slice(&read_bounded(file).ok()?).ok()?;
        let is_token =
            address.token.len() == 32 && address.token.bytes().all(|c| c.is_ascii_hexdigit());
        is_token.then_some(address)
    }
}

/// Keeps the folder for this page until the process ends: two pages would fetch the same
/// recordings and save the same missions.
fn hold(folder: &Path) -> Result<File, Failure> {
    let path = folder.join("class.lock");
    let doing = format!("cannot lock {}", path.display());
    let file = File::options().create(true).append(true).open(&path);
    let file = file.context(Exit::Refused, &doing).hint(WRITABLE)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(Failure::refused(format!(
            "another onbrick class uses the folder {}",
            folder.display()
        ))
        .hint("its page; Ctrl-C in its terminal ends it; or --folder with another folder")),
        Err(TryLockError::Error(error)) => Err(error).context(Exit::Refused, &doing).hint(WRITABLE),
    }
}
