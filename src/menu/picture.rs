//! The menu's pictures of a run that no service runs: what the brick's screen shows of it.
//!
//! # Not here
//!
//! No menu: nothing is chosen on these pictures, and no button does anything to them.

use super::canvas::Canvas;
use super::pages::{ended, progress};
use super::sheet::{Sheet, View};
use crate::protocol::{LastStop, RunStatus};

/// A run in progress, as the menu shows one.
#[must_use]
pub fn running_picture(run: &RunStatus) -> Canvas {
    let title = if run.progress.is_some() { "Running" } else { "Preparing" };
    let sheet = progress(Sheet::new(title).strong(&run.mission), run);
    let volts = run.progress.as_ref().and_then(|progress| progress.battery_v);
    let corner = volts.map(|volts| format!("{volts:.1} V")).unwrap_or_default();
    drawn(&sheet.foot("STOP: Enter, Back"), &corner)
}

/// How a run ended, as the menu shows it.
#[must_use]
pub fn ended_picture(last: &LastStop) -> Canvas {
    let mut sheet = ended(last, false);
    // Nothing can be chosen.
    sheet.rows.retain(|row| !row.is_item);
    drawn(&sheet, "")
}

fn drawn(sheet: &Sheet, corner: &str) -> Canvas {
    let mut canvas = Canvas::default();
    sheet.draw(&mut canvas, View::default(), corner);
    canvas
}
