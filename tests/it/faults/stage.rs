//! A mission on a simulated robot in virtual time, with a scenario of faults that begins with it, and all that can be known of it afterwards.

use std::sync::{Arc, Mutex};

use onbrick::behavior::Mission;
use onbrick::clock::{Clock, SECOND_NS, VirtualClock, seconds};
use onbrick::ev3dev::Tree;
use onbrick::mapping::{Method, Pose};
use onbrick::robot::{DEFAULT_ROBOT, Robot, RobotConfig};
use onbrick::runtime::recording::{self, End, MachineNames, Options, Recorder, Run};
use onbrick::runtime::{Control, Heartbeat, Pilot, StopFlags, StopReason, Tally, prepare};
use onbrick::sim::{Observer, Scenario, Simulation, Truth, World, WorldPhysics};

use crate::tick::start;

/// What a run is made of.
pub(crate) struct Stage<'s> {
    pub(crate) world: &'s str,
    pub(crate) seed: u64,
    /// The mission's text.
    pub(crate) mission: String,
    /// Its time limit, seconds.
    pub(crate) limit_s: f64,
    pub(crate) scenario: &'s str,
    /// The clock that the loop sees; the simulation's is the other one.
    pub(crate) clock: fn(Arc<VirtualClock>) -> Arc<dyn Clock>,
}

impl Default for Stage<'_> {
    /// The shipped mapping mission in the arena for a minute, and nothing goes wrong.
    fn default() -> Self {
        let mission = onbrick::behavior::shipped::find("map").unwrap().text.to_owned();
        Self { world: "arena", seed: 3, mission, limit_s: 60.0, scenario: "", clock: |clock| clock }
    }
}

/// How a run with a scenario ended.
pub(crate) struct Ended {
    pub(crate) reason: StopReason,
    pub(crate) tally: Tally,
    /// When, seconds after the scenario began with the run.
    pub(crate) time_s: f64,
    /// A second later.
    pub(crate) truth: Truth,
    /// At each tick.
    pub(crate) truths: Vec<Truth>,
    /// What the motors' drivers say a second later.
    pub(crate) states: Vec<String>,
    /// The faults as they happened.
    pub(crate) done: Vec<String>,
    pub(crate) recorded: Run,
}

impl Ended {
    /// How far the robot is from where it believes to be, metres.
    pub(crate) fn pose_error_m(&self) -> f64 {
        let (Some(pose), Some(truth)) = (self.recorded.poses.last(), self.truths.last()) else {
            return f64::NAN;
        };
        libm::hypot(pose.pose.x_m - truth.x_m, pose.pose.y_m - truth.y_m)
    }
}

impl Stage<'_> {
    pub(crate) fn play(self) -> Ended {
        let (scenario, _) = Scenario::parse("scenario.toml", self.scenario.as_bytes()).unwrap();
        let simulated = Arc::new(VirtualClock::default());
        let world = World::named(self.world).unwrap();
        let pose = world.starts()[0];
        let physics = WorldPhysics::new(world, 1, self.seed).unwrap();
        let observer = physics.observer();
        let simulation = Simulation::new(simulated.clone(), Box::new(physics), self.seed);
        let clock = (self.clock)(simulated);
        let tree: Arc<dyn Tree> = simulation.brick(0);
        let (config, _) = RobotConfig::load("robot.toml", DEFAULT_ROBOT.as_bytes()).unwrap();
        let (mut mission, _) =
            Mission::parse("mission.toml", self.mission.as_bytes(), &config.capabilities()).unwrap();
        mission.set("time_limit_s", self.limit_s).unwrap();
        let mut robot = Robot::bind(&tree, &config, mission.roles()).unwrap();
        let flags = StopFlags::default();
        prepare(&mut robot, &*clock, &flags, |_| {}).unwrap();
        let pose = Pose { x_m: pose.x_m, y_m: pose.y_m, heading_rad: pose.heading_rad };
        let mut pilot = Pilot::new(&config, &mission, Method::Default, pose).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("run.mcap");
        let began = recording::Start {
            mission_toml: self.mission.clone(),
            robot_toml: DEFAULT_ROBOT.to_owned(),
            machines: mission.machines().iter().map(|machine| machine_names(machine.name())).collect(),
            ..start(&mission)
        };
        let sink = Box::new(recording::create(&file).unwrap());
        let (recorder, mut tick_side) =
            Recorder::start(sink, began, Options::default(), Box::new(|_| {})).unwrap();
        simulation.play(&scenario);
        let seen = Arc::new(Mutex::new(Vec::new()));
        let mut control = Control {
            robot: &mut robot,
            pilot: &mut pilot,
            recorder: &mut tick_side,
            clock: &*clock,
            flags: &flags,
            heartbeat: &mut Witness { observer, seen: Arc::clone(&seen) },
            period_ns: 20_000_000,
            tally: Tally::default(),
        };
        let began_ns = clock.now_ns();
        let reason = control.drive();
        let tally = control.tally;
        let time_s = seconds(clock.now_ns() - began_ns);
        drop(robot);
        clock.sleep_until_ns(clock.now_ns() + SECOND_NS);
        let end = End { reason: reason.to_string(), time_ns: tally.time_ns, truth: None, map: None };
        recorder.finish(tick_side, end).unwrap();
        let truths = std::mem::take(&mut *seen.lock().unwrap());
        Ended {
            reason,
            tally,
            time_s,
            truth: simulation.inspect(|world: &mut WorldPhysics| world.truth(0)).unwrap().unwrap(),
            truths,
            states: ["outA", "outB", "outD"].map(|port| state_of(&*tree, port)).to_vec(),
            done: simulation.faults_done().into_iter().map(|record| record.what).collect(),
            recorded: Run::open(&file).unwrap(),
        }
    }
}

fn machine_names(name: &str) -> MachineNames {
    MachineNames { name: name.to_owned(), ..MachineNames::default() }
}

/// Notes the truth at each beat.
#[derive(Debug)]
struct Witness {
    observer: Observer,
    seen: Arc<Mutex<Vec<Truth>>>,
}

impl Heartbeat for Witness {
    fn beat(&mut self) {
        self.seen.lock().unwrap().push(self.observer.truth(0).unwrap());
    }
}

/// What a motor's driver says that it does; nothing for one that is not there.
fn state_of(tree: &dyn Tree, port: &str) -> String {
    let read = |path: &str| {
        let mut buffer = [0; 256];
        let length =
            tree.open(path, onbrick::ev3dev::Access::Read).and_then(|file| file.read(&mut buffer)).ok()?;
        Some(String::from_utf8_lossy(&buffer[..length]).trim().to_owned())
    };
    let names = tree.list("sys/class/tacho-motor").unwrap();
    let address = Some(format!("ev3-ports:{port}"));
    let found = names.iter().find(|name| read(&format!("sys/class/tacho-motor/{name}/address")) == address);
    found.and_then(|name| read(&format!("sys/class/tacho-motor/{name}/state"))).unwrap_or_default()
}

/// A fault ten seconds after the beginning.
pub(crate) fn fault(port: &str, kind: &str) -> String {
    format!("[[fault]]\nat_s = 10\nport = \"{port}\"\nkind = \"{kind}\"\n")
}

pub(crate) fn assert_at_rest(ended: &Ended, what: &str) {
    assert!(ended.states.iter().all(String::is_empty), "{what}: motors are {:?}", ended.states);
    assert!(ended.truth.speed_mps.abs() < 1e-3, "{what}: {} m/s", ended.truth.speed_mps);
}
