//! What one typed reading costs, beside the same reading by crates.io's `ev3dev-lang-rust`:
//! nanoseconds each, on two lines.
//!
//! `reading BRICK COUNT`: below the folder BRICK, the motor on outB has a `position` that leads to
//! a file of the kernel's own sysfs, `/sys/class/net/lo/mtu`. The scenario `reading` makes that
//! folder on the emulated brick and compares with a bare C loop.

use std::error::Error;
use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;

use onbrick::clock::{Clock, MonotonicClock};
use onbrick::ev3dev::{LocalTree, TachoMotor, Tree};

pub(crate) fn reading(brick: &str, count: &str) -> Result<(), Box<dyn Error>> {
    let count: u32 = count.parse()?;
    let position = Path::new(brick).join("sys/class/tacho-motor/motor0/position");

    let tree: Arc<dyn Tree> = Arc::new(LocalTree::new(brick));
    let motor = TachoMotor::at(&tree, &"outB".parse()?)?;
    motor.position()?;
    println!(
        "ours {}",
        nanoseconds_each(count, || Ok(motor.position().map(|value| _ = black_box(value))?))?
    );

    let theirs =
        ev3dev_lang_rust::Attribute::from_path(&position).map_err(|error| format!("{error:?}"))?;
    let read = || {
        theirs
            .get::<i32>()
            .map(|value| _ = black_box(value))
            .map_err(|error| format!("{error:?}").into())
    };
    println!("ev3dev-lang-rust {}", nanoseconds_each(count, read)?);
    Ok(())
}

fn nanoseconds_each(
    count: u32,
    mut read: impl FnMut() -> Result<(), Box<dyn Error>>,
) -> Result<i64, Box<dyn Error>> {
    let started_ns = MonotonicClock.now_ns();
    for _ in 0..count {
        read()?;
    }
    Ok((MonotonicClock.now_ns() - started_ns) / i64::from(count))
}
