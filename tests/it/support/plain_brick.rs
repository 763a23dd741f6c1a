//! A brick of plain files: what a simulated brick's attributes read, as a folder.
//!
//! Nothing moves in it and every write is kept, so it shows what a program asks of the files and how often.

use std::path::Path;
use std::sync::Arc;

use onbrick::clock::{Clock, VirtualClock};
use onbrick::ev3dev::{Access, Tree};
use onbrick::sim::{EntryKind, Simulation, World, WorldPhysics};

/// Writes the brick of a built-in world's first robot, at rest, below `folder`.
pub(crate) fn write(world: &str, folder: &Path) {
    let clock: Arc<dyn Clock> = Arc::new(VirtualClock::default());
    let world = World::named(world).unwrap().without_errors();
    let physics = WorldPhysics::new(world, 1, 1).unwrap();
    let simulation = Simulation::new(Arc::clone(&clock), Box::new(physics), 1);
    clock.sleep_until_ns(5 * onbrick::clock::SECOND_NS);
    let brick = simulation.brick(0);
    for class in brick.list("sys/class").unwrap() {
        for device in brick.list(&format!("sys/class/{class}")).unwrap() {
            copy(&brick, &format!("sys/class/{class}/{device}"), folder);
        }
    }
}

/// Copies a device's folder, and the folders of its regulators.
fn copy(brick: &onbrick::sim::SimBrick, path: &str, folder: &Path) {
    std::fs::create_dir_all(folder.join(path)).unwrap();
    // `power` is a name in the listing, with nothing behind it.
    for entry in brick.entries(path).unwrap_or_default() {
        let file = format!("{path}/{}", entry.name);
        match entry.kind {
            EntryKind::Folder => copy(brick, &file, folder),
            EntryKind::Link => {}
            EntryKind::File => {
                let mut text = [0; 4096];
                let open = brick.open(&file, Access::Read);
                let length = open.and_then(|file| file.read(&mut text)).unwrap_or(0);
                // Here nobody keeps a motor's state, and one that stands still would contradict each command.
                let text = if entry.name == "state" { &b"unknown\n"[..] } else { &text[..length] };
                std::fs::write(folder.join(&file), text).unwrap();
            }
        }
    }
}
