//! A whole run in this process, in virtual time, with every layer open to faults: the brick's
//! devices (scenario), its files and the recording's (plans).

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use onbrick::clock::{Clock, SECOND_NS, VirtualClock};
use onbrick::ev3dev::{Access, EV3, Platform, Technology, Tree};
use onbrick::mapping::Pose;
use onbrick::recording::{Pace, Run};
use onbrick::robot::DEFAULT_ROBOT;
use onbrick::runtime::{
    Brick, Ended, Environment, Event, Heartbeat, Job, Refused, Source, StopFlags, StopReason,
    execute,
};
use onbrick::sim::{Observer, Scenario, Simulation, Truth, World, WorldPhysics, Written};

use super::faulty::{FaultySink, FaultyTree, Plan};
use super::memory::MemoryDisk;

/// What is played.
#[derive(Debug)]
pub struct Play {
    pub world: String,
    pub world_toml: String,
    pub seed: u64,
    pub mission_toml: String,
    pub robot_toml: String,
    pub settings: Vec<(String, f64)>,
    /// Begins with the run.
    pub scenario: Scenario,
    /// Under the attributes, from the moment the run begins.
    pub attributes: Plan,
    /// Under the recording.
    pub records: Plan,
    pub sync_ns: i64,
    pub wall_offset_ns: i64,
    /// Keep what is written to the brick from the run's beginning on.
    pub journal: bool,
    pub cells: Technology,
    pub platform: &'static Platform,
    /// As `--no-button` says.
    pub no_button: bool,
    /// Stands at 0.
    pub clock: Arc<VirtualClock>,
    /// The clock that the run sees, made of that one.
    pub seen_clock: fn(Arc<VirtualClock>) -> Arc<dyn Clock>,
}

impl Play {
    /// A shipped mission in a built-in world, with nothing going wrong.
    pub fn of(mission: &str, world: &str, seed: u64) -> Self {
        Self {
            world: world.to_owned(),
            world_toml: World::text(world).unwrap().to_owned(),
            seed,
            mission_toml: onbrick::behavior::shipped::find(mission).unwrap().whole(),
            robot_toml: DEFAULT_ROBOT.to_owned(),
            settings: Vec::new(),
            scenario: Scenario::default(),
            attributes: Plan::counting(&[]),
            records: Plan::counting(&[]),
            sync_ns: SECOND_NS,
            wall_offset_ns: 0,
            journal: false,
            cells: Technology::Unknown,
            platform: &EV3,
            no_button: false,
            clock: Arc::default(),
            seen_clock: |clock| clock,
        }
    }

    /// At most this many seconds of the run's time.
    pub fn seconds(mut self, seconds: f64) -> Self {
        self.settings.push(("time_limit_s".to_owned(), seconds));
        self
    }

    pub fn scenario(self, text: &str) -> Self {
        let (scenario, _) = Scenario::parse("scenario.toml", text.as_bytes()).unwrap();
        Self { scenario, ..self }
    }

    /// Plays to the end, and one second more so that leases run out.
    pub fn play(self) -> Result<Played, Refused> {
        self.play_on(MemoryDisk::default())
    }

    /// As [`play`](Self::play), on a disk that the test sees as well.
    pub fn play_on(self, disk: MemoryDisk) -> Result<Played, Refused> {
        let clock = (self.seen_clock)(Arc::clone(&self.clock));
        let world = World::parse(&self.world, self.world_toml.as_bytes()).unwrap().0;
        let physics = WorldPhysics::new(world, 1, self.seed).unwrap();
        let observer = physics.observer();
        let simulation = Simulation::with_options(
            self.clock.clone(),
            Box::new(physics),
            self.seed,
            onbrick::sim::Options {
                platform: self.platform,
                cells: self.cells,
                ..Default::default()
            },
        );
        self.attributes.rest();
        let tree: Arc<dyn Tree> =
            Arc::new(FaultyTree { tree: simulation.brick(0), plan: self.attributes.clone() });
        let start = observer.truth(0).unwrap();
        let (sink, plan) = (disk.clone(), self.records.clone());
        let environment = Environment {
            pace: Pace::Virtual,
            wall_offset_ns: Some(self.wall_offset_ns),
            seed: Some(self.seed),
            create: Box::new(move |_| {
                Ok(Box::new(FaultySink { sink: sink.clone(), plan: plan.clone() }))
            }),
            ..Environment::new(tree, Arc::clone(&clock))
        };
        let job = self.job(Pose { x_m: start.x_m, y_m: start.y_m, heading_rad: start.heading_rad });
        let mut witness = Witness::of(observer);
        let began_ns = Arc::new(AtomicI64::new(0));
        let ended = {
            let (simulation, clock, began_ns) =
                (simulation.clone(), clock.clone(), Arc::clone(&began_ns));
            let (scenario, journal, attributes) =
                (self.scenario.clone(), self.journal, self.attributes.clone());
            let report = move |event: &Event| {
                if matches!(event, Event::Driving { .. }) {
                    simulation.play(&scenario);
                    simulation.record_writes(journal);
                    attributes.wake();
                    began_ns.store(clock.now_ns(), Ordering::Relaxed);
                }
            };
            execute(&job, environment, &StopFlags::default(), &mut witness, report)?
        };
        let drove_ns = clock.now_ns() - began_ns.load(Ordering::Relaxed);
        clock.sleep_ns(SECOND_NS);
        simulation.catch_up();
        let truth = simulation.inspect(|world: &mut WorldPhysics| world.truth(0)).unwrap().unwrap();
        Ok(Played {
            reason: ended.stop.reason,
            ended,
            drove_s: onbrick::clock::seconds(drove_ns),
            truths: witness.truths,
            truth,
            states: ["outA", "outB", "outD"].map(|port| state_of(&*simulation.brick(0), port)),
            writes: simulation.take_writes(),
            faults: simulation.faults_done().into_iter().map(|record| record.what).collect(),
            disk,
        })
    }

    fn job(&self, start: Pose) -> Job {
        let source =
            |name: &str, text: &str| Source { name: name.to_owned(), text: text.to_owned() };
        let world = source(&self.world, &self.world_toml);
        Job {
            start,
            set: self.settings.clone(),
            sync_ns: self.sync_ns,
            no_button: self.no_button,
            ..Job::new(
                source("mission.toml", &self.mission_toml),
                source("robot.toml", &self.robot_toml),
                Brick::Simulated { world, seed: self.seed, realtime: false },
                // It goes to the disk in memory.
                PathBuf::new(),
            )
        }
    }
}

/// What came of it.
#[derive(Debug)]
pub struct Played {
    pub reason: StopReason,
    pub ended: Ended,
    pub drove_s: f64,
    /// At each tick.
    pub truths: Vec<Truth>,
    /// A second after the end.
    pub truth: Truth,
    /// What the motors' drivers then report for the head, the left and the right wheel; empty for
    /// an unplugged one.
    pub states: [String; 3],
    pub writes: Vec<Written>,
    pub faults: Vec<String>,
    pub disk: MemoryDisk,
}

impl Played {
    pub fn run(&self) -> Run {
        Run::read(&self.disk.bytes()).unwrap()
    }

    /// How far the robot was in the last tick from where it believed to be, metres.
    pub fn pose_error_m(&self) -> f64 {
        let (run, truth) = (self.run(), self.truths.last().unwrap());
        let believed = run.poses.last().unwrap().pose;
        libm::hypot(believed.x_m - truth.x_m, believed.y_m - truth.y_m)
    }

    /// The robot stands, a second after the end, and no motor is under a command.
    pub fn assert_at_rest(&self, what: &str) {
        assert!(self.states.iter().all(String::is_empty), "{what}: motors are {:?}", self.states);
        let speed_mps = self.truth.speed_mps;
        assert!(speed_mps.abs() < 1e-3, "{what}: {speed_mps} m/s a second after the end");
    }
}

/// Notes the truth at each beat.
#[derive(Debug)]
pub struct Witness {
    observer: Observer,
    pub truths: Vec<Truth>,
}

impl Witness {
    pub fn of(observer: Observer) -> Self {
        Self { observer, truths: Vec::new() }
    }
}

impl Heartbeat for Witness {
    fn beat(&mut self, _now_ns: i64) {
        self.truths.push(self.observer.truth(0).unwrap());
    }
}

/// A fault ten seconds after a run's beginning, as a scenario.
pub fn fault(port: &str, kind: &str) -> String {
    format!("[[fault]]\nat_s = 10\nport = \"{port}\"\nkind = \"{kind}\"\n")
}

/// What a motor's driver says that it does; empty for an unplugged one.
fn state_of(tree: &dyn Tree, port: &str) -> String {
    let read = |path: &str| {
        let mut buffer = [0; 256];
        let length = tree.open(path, Access::Read).and_then(|file| file.read(&mut buffer)).ok()?;
        Some(String::from_utf8_lossy(&buffer[..length]).trim().to_owned())
    };
    let names = tree.list("sys/class/tacho-motor").unwrap();
    let is_there = |name: &&String| {
        read(&format!("sys/class/tacho-motor/{name}/address"))
            .is_some_and(|address| Platform::is_port(port, &address))
    };
    let found = names.iter().find(is_there);
    found.and_then(|name| read(&format!("sys/class/tacho-motor/{name}/state"))).unwrap_or_default()
}
