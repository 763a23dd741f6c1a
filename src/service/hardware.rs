//! The hardware between runs: what is plugged in, turning a motor while a button is held, beeps and
//! lights.
//!
//! A motor turns as a lease that the kernel itself ends, and under the hardware's lock, which is
//! let go right after: between runs other people's programs have the motors.
//!
//! A service on a simulated brick has one only during a run. For requests in between, it makes a
//! brick in the same world on demand and drops it after a while without requests.
//!
//! # Not here
//!
//! Whether a run is going on: the caller looks, and [`Hardware::let_go`] comes before each run.

use std::f64::consts::PI;
use std::path::Path;
use std::sync::{Arc, Mutex};

use nix::unistd::getpid;

use super::RobotSite;
use crate::clock::{MILLISECOND_NS, SECOND_NS};
use crate::ev3dev::{
    Battery, Entry, Inventory, LocalTree, NotAPort, Platform, PortAddress, StopAction, TachoMotor,
    Technology, Tree,
};
use crate::protocol::{Kind, Live, LiveDevice, Refusal};
use crate::robot::{LeasedMotor, RobotConfig};
use crate::runtime::{Brick, HardwareLock, LockError, Owner, halt_command};
use crate::threads::lock;

/// A jog that is not renewed is over after this, nanoseconds: its lease, and a little for a client
/// that lags.
const JOG_NS: i64 = 500 * MILLISECOND_NS;

/// A simulated brick without requests is dropped after this, nanoseconds; it would have to simulate
/// all the time since.
#[cfg(feature = "sim")]
const FORGET_NS: i64 = 5 * SECOND_NS;

/// The hardware between runs.
#[derive(Debug)]
pub(super) struct Hardware {
    place: RobotSite,
    jog: Mutex<Option<Jog>>,
    battery: Mutex<Option<(i64, Option<Charge>)>>,
    #[cfg(feature = "sim")]
    simulated: Mutex<Option<(i64, Arc<dyn Tree>)>>,
}

/// What the battery has, and what it is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Charge {
    pub(super) volts: f64,
    pub(super) cells: Technology,
    pub(super) platform: &'static Platform,
}

/// A motor that is being turned.
#[derive(Debug)]
struct Jog {
    port: String,
    motor: LeasedMotor,
    renewed_ns: i64,
    /// Nothing on a simulated brick, which no other program can have.
    _lock: Option<HardwareLock>,
}

impl Hardware {
    pub(super) fn new(place: RobotSite) -> Self {
        Self {
            place,
            jog: Mutex::new(None),
            battery: Mutex::new(None),
            #[cfg(feature = "sim")]
            simulated: Mutex::new(None),
        }
    }

    /// The brick's files; nothing where there is no brick now.
    pub(super) fn tree(&self, now_ns: i64) -> Option<Arc<dyn Tree>> {
        match &self.place.brick {
            Brick::Local(tree) => Some(Arc::new(tree.clone())),
            #[cfg(feature = "sim")]
            Brick::Simulated { world, seed, .. } => self.simulated(world, *seed, now_ns),
            #[cfg(not(feature = "sim"))]
            Brick::Simulated { .. } => {
                let _ = now_ns;
                None
            }
        }
    }

    /// The real brick's files.
    pub(super) fn machine(&self) -> Option<&LocalTree> {
        match &self.place.brick {
            Brick::Local(tree) => Some(tree),
            Brick::Simulated { .. } => None,
        }
    }

    /// Another program that has the motors and has not stopped them.
    pub(super) fn other_owner(&self) -> Option<Owner> {
        let owner = HardwareLock::owner(self.machine()?.root()).ok()??;
        (owner.pid != getpid().as_raw() && !owner.stopped).then_some(owner)
    }

    /// What is plugged in and what it reads.
    pub(super) fn live(&self, robot: Option<&RobotConfig>, now_ns: i64) -> Result<Live, Refusal> {
        let failed = |why: String| Refusal::failed(format!("cannot look at the devices: {why}"));
        let tree = self.tree(now_ns).ok_or_else(|| failed("there is no brick".to_owned()))?;
        let inventory = Inventory::read(&tree).map_err(|error| failed(error.to_string()))?;
        let plugged = inventory.devices.iter().filter(|entry| entry.class != "lego-port");
        let mut devices: Vec<LiveDevice> = plugged.map(|entry| live_device(entry, robot)).collect();
        devices.sort_by(|one, other| one.port.cmp(&other.port));
        Ok(Live { devices })
    }

    /// Turns a motor for one lease.
    ///
    /// - `percent`: of its full speed; 0 stops it and lets go.
    pub(super) fn jog(&self, port: &str, percent: i32, now_ns: i64) -> Result<(), Refusal> {
        if !(-100..=100).contains(&percent) {
            return Err(Refusal::bad_request(format!("{percent} percent; it can be -100 to 100")));
        }
        let address: PortAddress =
            port.parse().map_err(|error: NotAPort| Refusal::bad_request(error.to_string()))?;
        let mut held = lock(&self.jog);
        if held.as_ref().is_some_and(|jog| jog.port != port) {
            release(&mut held);
        }
        if percent == 0 {
            release(&mut held);
            return Ok(());
        }
        if held.is_none() {
            *held = Some(self.take(port, &address, now_ns)?);
        }
        let Some(jog) = held.as_mut() else { return Ok(()) };
        let motor = jog.motor.motor();
        let full_rad_s =
            f64::from(motor.max_speed()) * 2.0 * PI / f64::from(motor.count_per_rot().max(1));
        jog.renewed_ns = now_ns;
        jog.motor.turn(full_rad_s * f64::from(percent) / 100.0, now_ns).map_err(|error| {
            release(&mut held);
            Refusal::failed(format!("the motor at {port}: {error}"))
        })
    }

    /// Stops a jog whose button was let go without a word.
    pub(super) fn tend(&self, now_ns: i64) {
        let mut held = lock(&self.jog);
        if held.as_ref().is_some_and(|jog| now_ns.saturating_sub(jog.renewed_ns) > JOG_NS) {
            release(&mut held);
        }
        #[cfg(feature = "sim")]
        lock(&self.simulated).take_if(|(used_ns, _)| now_ns.saturating_sub(*used_ns) > FORGET_NS);
    }

    /// Stops a jog and lets go of the hardware: a run begins.
    pub(super) fn let_go(&self) {
        release(&mut lock(&self.jog));
    }

    /// The battery, read at most once a second; nothing where it cannot be read.
    pub(super) fn battery(&self, now_ns: i64) -> Option<Charge> {
        let tree = self.machine()?;
        let mut known = lock(&self.battery);
        if let Some((read_ns, charge)) = *known
            && now_ns.saturating_sub(read_ns) < SECOND_NS
        {
            return charge;
        }
        let tree: Arc<dyn Tree> = Arc::new(tree.clone());
        let platform = Platform::of(&tree);
        let read = |battery: Battery| {
            let cells = battery.technology().unwrap_or_default();
            battery.voltage_v().map(|volts| Charge { volts, cells, platform })
        };
        let charge = Battery::open(&tree, platform).and_then(read).ok();
        *known = Some((now_ns, charge));
        charge
    }

    fn take(&self, port: &str, address: &PortAddress, now_ns: i64) -> Result<Jog, Refusal> {
        let lock = |root: &Path| {
            let lock = HardwareLock::take(root, "turning a motor by hand");
            lock.map_err(|error| taken(error, root))
        };
        let lock = self.machine().map(Tree::root).map(lock).transpose()?;
        let failed =
            |error: String| Refusal::new(Kind::NotReady, format!("no motor to turn: {error}"));
        let tree = self.tree(now_ns).ok_or_else(|| failed("there is no brick".to_owned()))?;
        let motor = TachoMotor::find(&tree, Some(address), None)
            .map_err(|error| failed(error.to_string()))?;
        let motor = LeasedMotor::take(motor, 1.0, f64::INFINITY)
            .map_err(|error| failed(error.to_string()))?;
        Ok(Jog { port: port.to_owned(), motor, renewed_ns: now_ns, _lock: lock })
    }

    #[cfg(feature = "sim")]
    fn simulated(
        &self,
        world: &crate::runtime::Source,
        seed: u64,
        now_ns: i64,
    ) -> Option<Arc<dyn Tree>> {
        let mut simulated = lock(&self.simulated);
        if let Some((used_ns, tree)) = simulated.as_mut() {
            *used_ns = now_ns;
            return Some(Arc::clone(tree));
        }
        let clock = Arc::new(crate::clock::MonotonicClock);
        let near = crate::mapping::Pose::default();
        let (simulation, _) = crate::simulated::simulation(world, seed, near, clock).ok()?;
        simulation.give_up_behind_ns(crate::sim::MOST_BEHIND_NS);
        let tree: Arc<dyn Tree> = simulation.brick(0);
        *simulated = Some((now_ns, Arc::clone(&tree)));
        Some(tree)
    }
}

/// The hardware is taken.
pub(super) fn taken(error: LockError, root: &Path) -> Refusal {
    let kind = if matches!(error, LockError::Taken(_)) { Kind::Busy } else { Kind::Failed };
    Refusal::new(kind, crate::printable::with_causes(&error))
        .hint(format!("wait until it is over, or {}", halt_command(root)))
}

fn release(held: &mut Option<Jog>) {
    if let Some(mut jog) = held.take()
        && let Err(error) = jog.motor.stop(StopAction::Brake)
    {
        // Its lease ends by itself.
        log::warn!("the motor at {} did not take the command to stop: {error}", jog.port);
    }
}

fn live_device(entry: &Entry, robot: Option<&RobotConfig>) -> LiveDevice {
    let address: Option<PortAddress> = entry.address.parse().ok();
    let port = address.as_ref().map_or(entry.address.as_str(), PortAddress::short).to_owned();
    LiveDevice {
        role: address.zip(robot).and_then(|(address, robot)| role_at(&address, robot)),
        port,
        driver: entry.driver.clone(),
        reading: short_reading(entry),
        motor: entry.class == "tacho-motor",
    }
}

/// What a device reads, as short as the brick's screen wants it: a motor's angle, a sensor's
/// values; and what is amiss.
fn short_reading(entry: &Entry) -> String {
    let is_motor = entry.class.ends_with("-motor");
    let readings = entry.readings.iter().take(if is_motor { 1 } else { usize::MAX });
    let written = readings.map(|reading| match reading.unit.as_str() {
        "" => reading.value.clone(),
        // A count of every motor that turns is a degree: `count_per_rot` is 360.
        "counts" if entry.name.starts_with("motor") => format!("{}°", reading.value),
        unit => format!("{} {unit}", reading.value),
    });
    written.chain(entry.problem.clone()).collect::<Vec<_>>().join(", ")
}

/// What a robot's file uses a port for.
fn role_at(address: &PortAddress, robot: &RobotConfig) -> Option<String> {
    let mut ports = robot.ports();
    let (role, _) = ports.find(|(_, port)| port.is_some_and(|port| port.fits(address)))?;
    Some(match role.as_str() {
        "drive.left" => "left wheel".to_owned(),
        "drive.right" => "right wheel".to_owned(),
        role => role.trim_start_matches("motor.").to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ev3dev::LiveValue;

    fn reads(class: &'static str, name: &str, readings: &[(&str, &str, &str)]) -> String {
        let value = |(name, value, unit): &(&str, &str, &str)| LiveValue {
            name: (*name).to_owned(),
            value: (*value).to_owned(),
            unit: (*unit).to_owned(),
        };
        let readings = readings.iter().map(value).collect();
        let (address, driver) = (String::new(), String::new());
        short_reading(&Entry {
            class,
            name: name.to_owned(),
            address,
            driver,
            readings,
            problem: None,
        })
    }

    #[test]
    fn a_reading_fits_beside_its_port_on_the_bricks_screen() {
        let motor = [("position", "-120", "counts"), ("speed", "0", "counts/s"), ("state", "", "")];
        assert_eq!(reads("tacho-motor", "motor3", &motor), "-120°");
        assert_eq!(reads("tacho-motor", "linear0", &motor), "-120 counts");
        assert_eq!(reads("lego-sensor", "sensor0", &[("US-DIST-CM", "82.4", "cm")]), "82.4 cm");
        let colours = [("RGB-RAW", "12", ""), ("RGB-RAW", "30", ""), ("RGB-RAW", "4", "")];
        assert_eq!(reads("lego-sensor", "sensor1", &colours), "12, 30, 4");
    }
}
