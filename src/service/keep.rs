//! What runs in the background: lights and sounds, room for the growing run, the check of disk and
//! robot, the hash of each run, the watchdog.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use super::core::{Inner, Service, clock_finding};
use super::machine::Happening;
use super::missions;
use super::signs::{self, Shown, Signs};
use crate::clock::{Clock, MILLISECOND_NS, MonotonicClock, SECOND_NS};
use crate::ev3dev::Tree;
use crate::protocol::LastStop;
use crate::runtime::StopReason;
use crate::threads::{lock, spawn};

/// The pace, nanoseconds: half a pulse of the lights is twice as long.
const PACE_NS: i64 = 250 * MILLISECOND_NS;

/// How often disk and robot are looked at, nanoseconds.
const LOOK_NS: i64 = 2 * SECOND_NS;

/// How long the hasher sleeps at most; it is woken when a run ends.
const HASHER_PATIENCE: Duration = Duration::from_secs(2);

impl Service {
    /// Begins to keep, in threads of its own that last as long as the process.
    pub(super) fn keep(&self) -> io::Result<()> {
        let mut keeper = Keeper {
            inner: Arc::clone(&self.inner),
            signs: Signs::default(),
            looked_ns: MonotonicClock.now_ns(),
            robot: None,
            found: None,
            clock: None,
        };
        // Once before the first request.
        keeper.look();
        spawn("keeper", move || keeper.keep())?;
        let inner = Arc::clone(&self.inner);
        spawn("hasher", move || hash(&inner))?;
        Ok(())
    }
}

struct Keeper {
    inner: Arc<Inner>,
    signs: Signs,
    looked_ns: i64,
    /// The robot's file as it was read last, and what is wrong with it.
    robot: Option<Vec<u8>>,
    /// What keeps runs from starting, as it was said last.
    found: Option<LastStop>,
    /// What the wall clock was found to say when it stood wrong.
    clock: Option<String>,
}

impl Keeper {
    fn keep(mut self) {
        loop {
            let now_ns = MonotonicClock.now_ns();
            self.show(now_ns);
            self.inner.hardware.tend(now_ns);
            if now_ns.saturating_sub(self.looked_ns) >= LOOK_NS {
                self.looked_ns = now_ns;
                self.inner.store.grow();
                self.inner.store.save();
                self.look();
            }
            watched();
            MonotonicClock.sleep_until_ns(now_ns + PACE_NS);
        }
    }

    /// Lights and sounds of the state; on a real brick only.
    fn show(&mut self, now_ns: i64) {
        let shown = {
            // A service whose state cannot be had any more stops here, and with it the watchdog's
            // signs of life.
            let now = lock(&self.inner.now);
            Shown {
                state: now.machine.state(),
                lights: now.kept.lights,
                sounds: now.kept.sounds,
                missions_own: now.missions_lights,
            }
        };
        let Some(tree) = self.inner.hardware.machine() else { return };
        let tree: Arc<dyn Tree> = Arc::new(tree.clone());
        let (colour, tone_hz) = self.signs.follow(shown, now_ns);
        if let Some(colour) = colour {
            signs::light(&tree, colour);
        }
        if let Some(tone_hz) = tone_hz {
            signs::tone(&tree, tone_hz);
        }
    }

    /// What keeps any run from starting.
    fn look(&mut self) {
        let inner = Arc::clone(&self.inner);
        let robot = self.robot_trouble();
        let disk = inner.store.trouble().map(|error| trouble(StopReason::Disk, error.to_string()));
        let found = disk.or_else(|| robot.clone().map(|why| trouble(StopReason::Robot, why)));
        if let Some(found) = found.as_ref().filter(|_| found != self.found) {
            log::warn!("{}", found);
        }
        self.found.clone_from(&found);
        let clock = clock_finding();
        if let Some(finding) = clock.as_ref().filter(|_| self.clock.is_none()) {
            log::warn!("{finding}");
        }
        self.clock = clock;
        let mut now = lock(&inner.now);
        now.robot = robot;
        now.machine.happen(MonotonicClock.now_ns(), Happening::Trouble(found));
    }

    /// What is wrong with the robot's file; it is read each time and understood when it has
    /// changed.
    fn robot_trouble(&mut self) -> Option<String> {
        let path: &Path = &self.inner.config.robot;
        let bytes = missions::read(path).ok();
        if self.robot == bytes && bytes.is_some() {
            return lock(&self.inner.now).robot.clone();
        }
        self.robot = bytes;
        let robot = missions::robot(path);
        if let Ok((_, robot)) = &robot {
            lock(&self.inner.now).battery = robot.battery;
        }
        robot.err()
    }
}

fn trouble(reason: StopReason, detail: String) -> LastStop {
    LastStop::new(None, "", reason.with(detail))
}

/// A sign of life for systemd, where it asks for one.
fn watched() {
    if sd_notify::watchdog_enabled().is_some() {
        // If this is not heard, systemd restarts us.
        let _ = sd_notify::notify(&[sd_notify::NotifyState::Watchdog]);
    }
}

/// Hashes what is complete, then sleeps until something changes.
fn hash(inner: &Inner) {
    loop {
        while inner.store.hash_one() {}
        let now = lock(&inner.now);
        // Woken or not: it looks again. A poisoned lock is no reason to stop.
        drop(inner.changed.wait_timeout(now, HASHER_PATIENCE));
    }
}
