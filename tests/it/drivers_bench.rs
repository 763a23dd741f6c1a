//! A bench for the simulated drivers: motors as simple as those of the kernel transcript, sensors
//! that read what they are told, and a rig that reaches their files through any [`Tree`], so that
//! another door can run the same tests.

use std::sync::Arc;

use nix::errno::Errno;
use onbrick::clock::{Clock, MILLISECOND_NS, VirtualClock};
use onbrick::ev3dev::{Access, AttributeFile, Tree};
use onbrick::sim::{
    Bridge, Entry, MotorKind, Options, Physics, Plug, Plugged, Port, STEP_NS, SensorKind, SimBrick,
    Simulation,
};

use crate::transcript::Control;

/// The transcript's motors: a first-order lag to the speed of the duty cycle, with friction.
///
/// Fitted to the transcript: 30 % runs at 290 counts/s and 60 % at 605, so 10.5 counts/s a percent
/// less 25 for friction; 118 counts in the first 200 ms at full duty make a lag of 0.1 s; from 400
/// counts/s it coasts 81 counts and brakes in 17.
#[derive(Debug, Default, Clone, Copy)]
pub(crate) struct LagMotor {
    pub(crate) edges: f64,
    /// Counts a second.
    pub(crate) speed: f64,
}

const SPEED_PER_PERCENT: f64 = 10.5;
const FRICTION: f64 = 250.0;
const LAG_S: f64 = 0.1;
const BRAKE_S: f64 = 0.05;
const COAST_S: f64 = 0.31;
const EDGES_PER_COUNT: f64 = 2.0;

impl LagMotor {
    fn step(&mut self, bridge: Bridge) {
        let step_s = STEP_NS as f64 / 1e9;
        let (target, lag_s) = match bridge {
            Bridge::Coast => (0.0, COAST_S),
            Bridge::Brake | Bridge::Duty(0) => (0.0, BRAKE_S),
            Bridge::Duty(duty) => (SPEED_PER_PERCENT * f64::from(duty), LAG_S),
        };
        let driven = self.speed + (target - self.speed) * (1.0 - libm::exp(-step_s / lag_s));
        let before = self.speed;
        // Friction slows down and never turns round.
        self.speed = if driven.abs() <= FRICTION * step_s {
            0.0
        } else {
            driven - FRICTION * step_s * driven.signum()
        };
        self.edges += (before + self.speed) / 2.0 * step_s * EDGES_PER_COUNT;
    }
}

/// Four such motors and sensors that always measure the same.
#[derive(Debug)]
pub(crate) struct Bench {
    pub(crate) motors: [LagMotor; 4],
    pub(crate) plug: Plug,
    pub(crate) blocked: [bool; 4],
    /// What the drivers did with the bridges in the last step.
    pub(crate) bridges: [Bridge; 4],
    pub(crate) readings: [[i32; 8]; 4],
    pub(crate) measured: [usize; 4],
}

impl Bench {
    /// What was plugged in when the transcript was taken.
    pub(crate) fn as_recorded() -> Self {
        let plug = Plug {
            motors: [Some(MotorKind::Medium), Some(MotorKind::Large), None, Some(MotorKind::Large)],
            sensors: [
                SensorKind::Ultrasonic,
                SensorKind::Touch,
                SensorKind::Colour,
                SensorKind::Gyro,
            ]
            .map(Some),
        };
        Self::with(plug)
    }

    fn with(plug: Plug) -> Self {
        Self {
            motors: [LagMotor::default(); 4],
            plug,
            blocked: [false; 4],
            bridges: [Bridge::Coast; 4],
            readings: [[0; 8]; 4],
            measured: [0; 4],
        }
    }
}

impl Physics for Bench {
    fn robots(&self) -> usize {
        1
    }

    fn plug(&self, _robot: usize) -> Plug {
        self.plug
    }

    fn step(&mut self, bridges: &[[Bridge; 4]]) {
        self.bridges = bridges[0];
        for ((motor, bridge), blocked) in self.motors.iter_mut().zip(bridges[0]).zip(self.blocked) {
            if blocked {
                motor.speed = 0.0;
            } else {
                motor.step(bridge);
            }
        }
    }

    #[expect(clippy::cast_possible_truncation, reason = "small numbers")]
    fn edges(&self, _robot: usize, out: usize) -> i64 {
        libm::floor(self.motors[out].edges) as i64
    }

    fn edge_position(&self, _robot: usize, out: usize) -> f64 {
        self.motors[out].edges
    }

    fn measure(&mut self, _robot: usize, input: usize, _mode: &str) -> [i32; 8] {
        self.measured[input] += 1;
        self.readings[input]
    }

    fn battery(&self, _robot: usize) -> (f64, f64) {
        (7.4, 0.18)
    }
}

/// The transcript's control over the simulation in this process.
pub(crate) struct InProcess {
    pub(crate) simulation: Simulation,
    pub(crate) brick: Arc<SimBrick>,
    pub(crate) clock: Arc<VirtualClock>,
}

impl InProcess {
    pub(crate) fn new(physics: impl Physics, options: Options) -> Self {
        let clock = Arc::new(VirtualClock::default());
        let simulation = Simulation::with_options(clock.clone(), Box::new(physics), 1, options);
        Self { brick: simulation.brick(0), simulation, clock }
    }

    pub(crate) fn pass_ms(&self, ms: i64) {
        self.clock.sleep_ns(ms * MILLISECOND_NS);
        self.simulation.catch_up();
    }
}

impl Control for InProcess {
    fn unplug(&self, port: Port) {
        self.simulation.unplug(0, port).unwrap();
        self.pass_ms(102);
    }

    fn plug(&self, port: Port) {
        self.simulation.plug(0, port, Plugged::Motor(MotorKind::Large)).unwrap();
        self.pass_ms(400);
    }

    fn raw(&self, port: Port, frame: &[u8]) {
        self.simulation.feed(0, port, Some(frame)).unwrap();
    }

    fn settle(&self) {
        self.pass_ms(400);
    }

    fn entries(&self, folder: &str) -> Vec<Entry> {
        self.brick.entries(folder).unwrap()
    }
}

/// A bench whose files are named by port: `outB speed_sp`, `in1 mode`, `port:outB mode`, or by
/// their whole path.
pub(crate) struct Rig {
    pub(crate) bench: InProcess,
    pub(crate) tree: Arc<dyn Tree>,
}

pub(crate) type Answer = Result<String, Errno>;

impl Rig {
    /// Over the door of this process.
    pub(crate) fn over(bench: InProcess) -> Self {
        Self { tree: bench.brick.clone(), bench }
    }

    pub(crate) fn new(physics: impl Physics) -> Self {
        Self::with_options(physics, Options::default())
    }

    pub(crate) fn with_options(physics: impl Physics, options: Options) -> Self {
        Self::over(InProcess::new(physics, options))
    }

    pub(crate) fn recorded() -> Self {
        Self::new(Bench::as_recorded())
    }

    pub(crate) fn folder(&self, device: &str) -> Option<String> {
        let (class, port) = match device.split_once(':') {
            Some(("port", port)) => ("lego-port", port),
            Some(("dc", port)) => ("dc-motor", port),
            _ if device.starts_with("out") => ("tacho-motor", device),
            _ => ("lego-sensor", device),
        };
        let class = format!("sys/class/{class}");
        let folders =
            self.tree.list(&class).unwrap().into_iter().map(|name| format!("{class}/{name}"));
        folders.into_iter().find(|folder| {
            self.read_path(&format!("{folder}/address")) == Ok(format!("ev3-ports:{port}\n"))
        })
    }

    pub(crate) fn read_path(&self, path: &str) -> Answer {
        let mut buffer = [0; 4096];
        let length = self.tree.open(path, Access::Read)?.read(&mut buffer)?;
        Ok(String::from_utf8_lossy(&buffer[..length]).into_owned())
    }

    pub(crate) fn write_path(&self, path: &str, value: &[u8]) -> Result<usize, Errno> {
        self.tree.open(path, Access::Write)?.write(value)
    }

    pub(crate) fn keep(
        &self,
        device: &str,
        attribute: &str,
        access: Access,
    ) -> Box<dyn AttributeFile> {
        let folder = self.folder(device).unwrap();
        self.tree.open(&format!("{folder}/{attribute}"), access).unwrap()
    }

    pub(crate) fn try_read(&self, device: &str, attribute: &str) -> Answer {
        self.read_path(&format!("{}/{attribute}", self.folder(device).ok_or(Errno::ENOENT)?))
    }

    pub(crate) fn try_write(
        &self,
        device: &str,
        attribute: &str,
        value: impl AsRef<[u8]>,
    ) -> Result<usize, Errno> {
        let folder = self.folder(device).ok_or(Errno::ENOENT)?;
        self.write_path(&format!("{folder}/{attribute}"), value.as_ref())
    }

    pub(crate) fn read(&self, device: &str, attribute: &str) -> String {
        self.try_read(device, attribute).unwrap().trim_end().to_owned()
    }

    pub(crate) fn number(&self, device: &str, attribute: &str) -> i64 {
        self.read(device, attribute).parse().unwrap()
    }

    pub(crate) fn write(&self, device: &str, attribute: &str, value: &str) {
        let taken = self.try_write(device, attribute, value);
        assert_eq!(taken, Ok(value.len()), "{device} {attribute} {value}");
    }

    /// `attribute=value` pairs for the large motor on outB, in order; a word alone is a command.
    pub(crate) fn drive(&self, script: &str) {
        for step in script.split_whitespace() {
            let (attribute, value) = step.split_once('=').unwrap_or(("command", step));
            self.write("outB", attribute, value);
        }
    }

    pub(crate) fn pass_ms(&self, ms: i64) {
        self.bench.pass_ms(ms);
    }

    pub(crate) fn world<R>(&self, change: impl FnOnce(&mut Bench) -> R) -> R {
        self.bench.simulation.inspect(change).unwrap()
    }
}
