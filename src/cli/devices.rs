//! `onbrick devices`: what is plugged in, where, and what it reads.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::Arc;

use super::brick::no_brick;
use super::{Context, Exit, Failure, Output};
use crate::clock::{Clock, MonotonicClock, SECOND_NS};
use crate::ev3dev::{Inventory, LocalTree, Platform, Tree};

/// Show what is plugged in, where, and what it reads.
///
/// Example: onbrick devices --watch
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Arguments {
    /// The folder under which sys/class is found.
    #[arg(long, default_value = "/")]
    brick: PathBuf,
    /// Look again every second, until interrupted.
    #[arg(long)]
    watch: bool,
    /// Leave out the ports themselves.
    #[arg(long)]
    plugged: bool,
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    let tree: Arc<dyn Tree> = Arc::new(LocalTree::new(&arguments.brick));
    loop {
        let inventory = Inventory::read(&tree);
        let mut inventory = inventory.context(Exit::Failed, "cannot look at the devices")?;
        if arguments.plugged {
            inventory.devices.retain(|entry| entry.class != "lego-port");
        }
        if inventory.is_empty() {
            return Err(no_brick(&arguments.brick));
        }
        output.show(table(&inventory), &inventory);
        // A watch whose reader has gone ends.
        if !arguments.watch || output.is_closed() {
            return Ok(());
        }
        output.line("");
        MonotonicClock.sleep_ns(SECOND_NS);
    }
}

/// One line a device: port, driver, what it reads.
fn table(inventory: &Inventory) -> String {
    let mut text = String::new();
    for entry in inventory.devices.iter().chain(&inventory.battery) {
        let port = Platform::short(&entry.address);
        let name = if entry.driver.is_empty() { entry.class } else { &entry.driver };
        let mut readings = String::new();
        // The state of a motor at rest is empty.
        for reading in entry.readings.iter().filter(|reading| !reading.value.is_empty()) {
            let _ = write!(readings, "  {} {}{}", reading.name, reading.value, unit(&reading.unit));
        }
        let problem =
            entry.problem.as_ref().map(|problem| format!("  ({problem})")).unwrap_or_default();
        let _ = writeln!(text, "{port:<6} {name:<18} {:<9}{readings}{problem}", entry.name);
    }
    text.trim_end().to_owned()
}

fn unit(unit: &str) -> String {
    if unit.is_empty() { String::new() } else { format!(" {unit}") }
}
