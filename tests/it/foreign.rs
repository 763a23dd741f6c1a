//! Programs on libraries that nobody here wrote, over a mounted brick: PyPI's `python-ev3dev2` and crates.io's `ev3dev-lang-rust`, both unmodified.
//!
//! Each runs in a mount namespace of its own, in which the brick's tree lies over `/sys` and its input devices in `/dev/input`, so that it takes
//! this machine for an EV3. What it says it did is compared with where the robot truly is.
//!
//! # Not here
//!
//! - `ev3dev2.sound` starts `/usr/bin/beep` and `aplay`, which this machine lacks or which would sound here.
//! - `ev3dev2.display` asks the frame buffer by ioctls that do not cross FUSE.
//! - `Button.wait_for_pressed` looks for a character device, which a file of FUSE cannot be. `buttons_pressed` and `process` do not.

mod brick;
mod bench;

use std::f64::consts::PI;

use onbrick::clock::{Clock, MonotonicClock, SECOND_NS};
use onbrick::sim::{Button, MountOptions};
use serde_json::Value;

use self::bench::{Foreign, Simulator, Truth, example, number, numbers, python};
use crate::support::pass_over;
