//! A brick of plain files, as a program meets it below `--brick`: made of the bindings' own tables, with wheels that turn as they are
//! told.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use onbrick::ev3dev::Battery;
use onbrick::runtime::{HardwareLock, Owner};

use crate::ev3dev::fake::{plain_files, rotary_tables, sensor_tables};

/// The shipped robot's motors, by port, and what the kernel may call them.
pub const MOTORS: [(&str, &str, &str); 3] = [
    ("outA", "motor0", "lego-ev3-m-motor\n"),
    ("outB", "motor1", "lego-ev3-l-motor\n"),
    ("outD", "motor2", "lego-ev3-l-motor\n"),
];

/// The folder, and the thread that turns the motors; both end when this is dropped.
pub struct TurningBrick {
    folder: tempfile::TempDir,
    ended: Arc<AtomicBool>,
    turning: Option<JoinHandle<()>>,
}

impl TurningBrick {
    /// The shipped robot: three motors, an ultrasonic sensor that sees a wall at 1 m, a gyro at rest, a battery of 7.5 V.
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        for (port, name, driver) in MOTORS {
            let address = format!("ev3-ports:{port}\n");
            let texts = [
                ("address", address.as_str()),
                ("driver_name", driver),
                ("max_speed", "1050\n"),
                ("count_per_rot", "360\n"),
                ("command", "reset\n"),
                // Nobody keeps it here, and one that stands still would contradict each command.
                ("state", "unknown\n"),
            ];
            plain_files(folder.path(), &format!("sys/class/tacho-motor/{name}"), &rotary_tables(), &texts);
        }
        for (port, name, driver, modes, value) in [
            ("in1", "sensor0", "lego-ev3-us\n", "US-DIST-CM US-DIST-IN US-LISTEN\n", "1000\n"),
            ("in4", "sensor1", "lego-ev3-gyro\n", "GYRO-ANG GYRO-RATE\n", "0\n"),
        ] {
            let address = format!("ev3-ports:{port}\n");
            let first = format!("{}\n", modes.split(' ').next().unwrap());
            let texts = [
                ("address", address.as_str()),
                ("driver_name", driver),
                ("modes", modes),
                ("mode", &first),
                ("num_values", "1\n"),
                ("value0", value),
            ];
            plain_files(folder.path(), &format!("sys/class/lego-sensor/{name}"), &sensor_tables(), &texts);
        }
        let battery = "sys/class/power_supply/lego-ev3-battery";
        plain_files(folder.path(), battery, &[Battery::ATTRIBUTES], &[("voltage_now", "7500000\n")]);
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
        MOTORS.map(|(_, name, _)| self.read(&format!("tacho-motor/{name}"), "command")).to_vec()
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

/// Waits for something that other processes do; a run on a real clock takes five seconds to get going.
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
        for ((_, name, _), counts) in MOTORS.iter().zip(&mut counts) {
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

/// One write at offset 0 and no cutting short, so that a reader never meets an empty file; it looks at the first line only.
fn write_whole(path: &Path, text: &str) {
    use std::os::unix::fs::FileExt;
    if let Ok(file) = std::fs::OpenOptions::new().write(true).open(path) {
        let _ = file.write_at(text.as_bytes(), 0);
    }
}
