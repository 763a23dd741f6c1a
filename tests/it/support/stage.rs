//! A whole run in this process, in virtual time, with every layer open to faults: the brick's devices (scenario), its files and the
//! recording's (plans).

use std::sync::{Arc, Mutex};

use onbrick::behavior::Mission;
use onbrick::clock::{Clock, SECOND_NS, VirtualClock};
use onbrick::ev3dev::{Access, StopAction, Technology, Tree};
use onbrick::mapping::{Method, Pose};
use onbrick::robot::{DEFAULT_ROBOT, Robot, RobotConfig};
use onbrick::runtime::recording::{
    End, MachineNames, Options, Pace, RecordError, Recorder, Run, Start, StateNames,
};
use onbrick::runtime::{Control, Heartbeat, Pilot, StopFlags, StopReason, Tally, prepare};
use onbrick::sim::{Observer, Pack, Scenario, Simulation, Truth, World, WorldPhysics, Written};

use super::faulty::{FaultySink, FaultyTree, Plan};
use super::memory::MemoryDisk;

/// What is played.
#[derive(Debug)]
pub struct Play {
    pub world: String,
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
    pub pack: Pack,
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
            seed,
            mission_toml: onbrick::behavior::shipped::find(mission).unwrap().text.to_owned(),
            robot_toml: DEFAULT_ROBOT.to_owned(),
            settings: Vec::new(),
            scenario: Scenario::default(),
            attributes: Plan::counting(&[]),
            records: Plan::counting(&[]),
            sync_ns: SECOND_NS,
            wall_offset_ns: 0,
            journal: false,
            pack: Pack::Aa,
            clock: Arc::default(),
            seen_clock: |clock| clock,
        }
    }

    /// At most so many seconds of the run's time.
    pub fn seconds(mut self, seconds: f64) -> Self {
        self.settings.push(("time_limit_s".to_owned(), seconds));
        self
    }

    pub fn scenario(self, text: &str) -> Self {
        let (scenario, _) = Scenario::parse("scenario.toml", text.as_bytes()).unwrap();
        Self { scenario, ..self }
    }

    /// Plays to the end, and one second more so that leases run out.
    pub fn play(self) -> Result<Played, RecordError> {
        self.play_on(MemoryDisk::default())
    }

    /// As [`play`](Self::play), on a disk that somebody else sees as well.
    pub fn play_on(self, disk: MemoryDisk) -> Result<Played, RecordError> {
        let clock = (self.seen_clock)(Arc::clone(&self.clock));
        let physics = WorldPhysics::new(World::named(&self.world).unwrap(), 1, self.seed).unwrap();
        let observer = physics.observer();
        let simulation = Simulation::with_options(
            self.clock.clone(),
            Box::new(physics),
            self.seed,
            onbrick::sim::Options { pack: self.pack, ..Default::default() },
        );
        self.attributes.rest();
        let tree: Arc<dyn Tree> =
            Arc::new(FaultyTree { tree: simulation.brick(0), plan: self.attributes.clone() });
        let (config, _) = RobotConfig::load("robot.toml", self.robot_toml.as_bytes()).unwrap();
        let text = self.mission_toml.as_bytes();
        let (mut mission, _) = Mission::parse("mission.toml", text, &config.capabilities()).unwrap();
        for (name, value) in &self.settings {
            mission.set(name, *value).unwrap();
        }
        let mut robot = Robot::bind(&tree, &config, mission.roles()).unwrap();
        let config = robot.config().clone();
        let flags = StopFlags::default();
        prepare(&mut robot, &*clock, &flags, false, |_| {}).unwrap();
        let start = observer.truth(0).unwrap();
        let start = Pose { x_m: start.x_m, y_m: start.y_m, heading_rad: start.heading_rad };
        let mut pilot = Pilot::new(&config, &mission, Method::Default, start).unwrap();
        let sink = FaultySink { sink: disk.clone(), plan: self.records.clone() };
        let options = Options { sync_period_ns: self.sync_ns, ..Options::default() };
        let known = self.known(&mission, start, config.battery.cells);
        let (recorder, mut tick_side) = Recorder::start(Box::new(sink), known, options, Box::new(|_| {}))?;
        simulation.play(&self.scenario);
        simulation.record_writes(self.journal);
        self.attributes.wake();
        let began_ns = clock.now_ns();
        let truths = Arc::default();
        let mut control = Control {
            robot: &mut robot,
            pilot: &mut pilot,
            recorder: &mut tick_side,
            clock: &*clock,
            flags: &flags,
            heartbeat: &mut Witness { observer, truths: Arc::clone(&truths) },
            guard: None,
            period_ns: SECOND_NS / i64::from(mission.rate_hz()),
            tally: Tally::default(),
        };
        let reason = control.drive();
        let tally = control.tally;
        robot.stop(StopAction::Brake);
        let drove_ns = clock.now_ns() - began_ns;
        let end = End {
            reason: reason.to_string(),
            time_ns: tally.time_ns,
            truth: None,
            map: Some(pilot.map().grid().into()),
        };
        let recorded = recorder.finish(tick_side, end).map(|_| ());
        drop(robot);
        clock.sleep_until_ns(clock.now_ns() + SECOND_NS);
        simulation.catch_up();
        let truth = simulation.inspect(|world: &mut WorldPhysics| world.truth(0)).unwrap().unwrap();
        Ok(Played {
            reason,
            tally,
            drove_s: onbrick::clock::seconds(drove_ns),
            recorded,
            truths: std::mem::take(&mut *truths.lock().unwrap()),
            truth,
            states: ["outA", "outB", "outD"].map(|port| state_of(&*simulation.brick(0), port)),
            writes: simulation.take_writes(),
            faults: simulation.faults_done().into_iter().map(|record| record.what).collect(),
            disk,
        })
    }

    fn known(&self, mission: &Mission, start_pose: Pose, cells: Technology) -> Start {
        let state = |name: &str| StateNames { name: name.to_owned(), conditions: Vec::new() };
        let machines = mission.machines().iter().map(|machine| MachineNames {
            name: machine.name().to_owned(),
            start: machine.start(),
            states: machine.states().iter().map(|plan| state(plan.name())).collect(),
        });
        Start {
            run: None,
            brick: "mapper".to_owned(),
            mission: mission.name().to_owned(),
            robot_toml: self.robot_toml.clone(),
            mission_toml: self.mission_toml.clone(),
            world_toml: None,
            start_pose,
            start_ns: 0,
            wall_offset_ns: self.wall_offset_ns,
            period_ns: SECOND_NS / i64::from(mission.rate_hz()),
            pace: Pace::Virtual,
            seed: Some(self.seed),
            cells,
            settings: self.settings.clone(),
            range: None,
            machines: machines.collect(),
        }
    }
}

/// What came of it.
#[derive(Debug)]
pub struct Played {
    pub reason: StopReason,
    pub tally: Tally,
    pub drove_s: f64,
    pub recorded: Result<(), RecordError>,
    /// At each tick.
    pub truths: Vec<Truth>,
    /// A second after the end.
    pub truth: Truth,
    /// What the motors' drivers say of the head, the left and the right wheel then; nothing for one that is not there.
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
struct Witness {
    observer: Observer,
    truths: Arc<Mutex<Vec<Truth>>>,
}

impl Heartbeat for Witness {
    fn beat(&mut self) {
        self.truths.lock().unwrap().push(self.observer.truth(0).unwrap());
    }
}

/// A fault ten seconds after a run's beginning, as a scenario.
pub fn fault(port: &str, kind: &str) -> String {
    format!("[[fault]]\nat_s = 10\nport = \"{port}\"\nkind = \"{kind}\"\n")
}

/// What a motor's driver says that it does; nothing for one that is not there.
fn state_of(tree: &dyn Tree, port: &str) -> String {
    let read = |path: &str| {
        let mut buffer = [0; 256];
        let length = tree.open(path, Access::Read).and_then(|file| file.read(&mut buffer)).ok()?;
        Some(String::from_utf8_lossy(&buffer[..length]).trim().to_owned())
    };
    let names = tree.list("sys/class/tacho-motor").unwrap();
    let address = Some(format!("ev3-ports:{port}"));
    let found = names.iter().find(|name| read(&format!("sys/class/tacho-motor/{name}/address")) == address);
    found.and_then(|name| read(&format!("sys/class/tacho-motor/{name}/state"))).unwrap_or_default()
}
