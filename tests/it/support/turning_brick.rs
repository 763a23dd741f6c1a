//! The tests' own brick ([`brick`](super::brick)) as plain files below `--brick`, with wheels that
//! turn as they are told.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use onbrick::runtime::{HardwareLock, Owner};

use super::brick::shipped_brick;

/// The shipped robot's motors, on outA, outB and outD.
pub const MOTORS: [&str; 3] = ["motor0", "motor1", "motor2"];

/// The folder, and the thread that turns the motors; both end when this is dropped.
pub struct TurningBrick {
    folder: tempfile::TempDir,
    ended: Arc<AtomicBool>,
    turning: Option<JoinHandle<()>>,
}

impl TurningBrick {
    /// The shipped robot: three motors, an ultrasonic sensor that sees a wall at 1 m, a gyro at
    /// rest, a battery of 7.5 V.
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        shipped_brick().write(folder.path());
        let ended = Arc::new(AtomicBool::new(false));
        let turning = {
            let (root, ended) = (folder.path().to_owned(), Arc::clone(&ended));
            std::thread::spawn(move || turn(&root, &ended))
        };
        Self { folder, ended, turning: Some(turning) }
    }

    pub fn root(&self) -> &Path {
        self.folder.path()
    }

    /// What a file of a device says, its first line.
    pub fn read(&self, device: &str, attribute: &str) -> String {
        first_line(&self.path(device, attribute))
    }

    /// Puts text into a file as a driver would answer it.
    pub fn put(&self, device: &str, attribute: &str, text: &[u8]) {
        std::fs::write(self.path(device, attribute), text).unwrap();
    }

    pub fn path(&self, device: &str, attribute: &str) -> PathBuf {
        self.root().join("sys/class").join(device).join(attribute)
    }

    /// The last command of each motor.
    pub fn commands(&self) -> Vec<String> {
        MOTORS.map(|name| self.read(&format!("tacho-motor/{name}"), "command")).to_vec()
    }

    /// True where no motor is under a command that turns it.
    pub fn is_still(&self) -> bool {
        self.commands().iter().all(|command| ["stop", "reset"].contains(&command.as_str()))
    }

    /// Waits until both wheels turn under a lease.
    pub fn await_driving(&self) {
        await_that("the wheels turn", || {
            self.commands().iter().skip(1).all(|command| command == "run-timed")
        });
    }

    pub fn owner(&self) -> Option<Owner> {
        HardwareLock::owner(self.root()).unwrap()
    }
}

impl Drop for TurningBrick {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Relaxed);
        if let Some(turning) = self.turning.take() {
            let _ = turning.join();
        }
    }
}

/// Waits for something that other processes do; a run on a real clock takes five seconds to get
/// going.
pub fn await_that(what: &str, mut is: impl FnMut() -> bool) {
    let started = Instant::now();
    while !is() {
        assert!(started.elapsed() < Duration::from_secs(30), "waited half a minute until {what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

fn first_line(path: &Path) -> String {
    let bytes = std::fs::read(path).unwrap_or_default();
    String::from_utf8_lossy(&bytes).lines().next().unwrap_or_default().to_owned()
}

/// Moves each motor's position by what it was told, while it is told to turn.
fn turn(root: &Path, ended: &AtomicBool) {
    let mut counts = [0.0; MOTORS.len()];
    let mut last = Instant::now();
    while !ended.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(5));
        let seconds = last.elapsed().as_secs_f64();
        last = Instant::now();
        for (name, counts) in MOTORS.iter().zip(&mut counts) {
            let motor = root.join("sys/class/tacho-motor").join(name);
            let speed: f64 = first_line(&motor.join("speed_sp")).parse().unwrap_or(0.0);
            if first_line(&motor.join("command")) != "run-timed" || speed == 0.0 {
                continue;
            }
            *counts += speed * seconds;
            write_whole(&motor.join("position"), &format!("{counts:.0}\n"));
        }
    }
}

/// One write at offset 0 and no cutting short, so that a reader never meets an empty file; it looks
/// at the first line only.
fn write_whole(path: &Path, text: &str) {
    use std::os::unix::fs::FileExt;
    if let Ok(file) = std::fs::OpenOptions::new().write(true).open(path) {
        let _ = file.write_at(text.as_bytes(), 0);
    }
}
