//! Setting a robot up on the simulated brick: `setup`, `calibrate` and `doctor`, with a person who
//! answers from the truth.

use std::f64::consts::PI;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use onbrick::clock::{Clock, SECOND_NS, VirtualClock};
use onbrick::commissioning::{Dialogue, NoAnswer};
use onbrick::ev3dev::{EV3, Platform, Tree};
use onbrick::robot::{DEFAULT_ROBOT, RobotConfig};
use onbrick::runtime::{Source, StopFlags};
use onbrick::sim::{Options, RobotModel, Simulation, Truth, World, WorldPhysics};

mod boards;
pub(crate) mod calibrate;
mod commands;
mod doctor;
mod messages;
mod range;
mod teach;

/// A brick in a world, and the handles that a test needs.
pub(crate) struct Bench {
    pub(crate) clock: Arc<VirtualClock>,
    simulation: Simulation,
    pub(crate) tree: Arc<dyn Tree>,
    flags: StopFlags,
    model: RobotModel,
}

impl Bench {
    /// A plain wall ahead, half a metre before the sensor, and room all around; `robot` is what
    /// else the world's file says of it.
    pub(crate) fn new(robot: &str, seed: u64) -> Self {
        Self::on(&EV3, robot, seed)
    }

    /// The same on another board.
    fn on(platform: &'static Platform, robot: &str, seed: u64) -> Self {
        let text = format!(
            "name = \"bench\"\n[[start]]\nat = [0.0, 0.0]\n[[wall]]\n\
             points = [[0.6, -2.0], [0.6, 2.0]]\n{robot}"
        );
        let (world, _) =
            World::parse("bench", text.as_bytes()).unwrap_or_else(|findings| panic!("{findings}"));
        let model = world.robot().clone();
        let clock = Arc::new(VirtualClock::default());
        let physics = WorldPhysics::new(world, 1, seed).unwrap();
        let shared: Arc<dyn Clock> = clock.clone();
        let options = Options { platform, ..Options::default() };
        let simulation = Simulation::with_options(shared, Box::new(physics), seed, options);
        let tree: Arc<dyn Tree> = simulation.brick(0);
        let bench = Self { clock, simulation, tree, flags: StopFlags::default(), model };
        bench.pass(3.0);
        bench
    }

    /// Lets time pass: devices appear, and so on.
    fn pass(&self, time_s: f64) {
        let deadline_ns = self.clock.now_ns() + onbrick::clock::nanoseconds(time_s);
        self.clock.sleep_until_ns(deadline_ns);
        self.simulation.catch_up();
    }

    fn truth(&self) -> Truth {
        truth(&self.simulation)
    }

    /// Nothing turns, and nothing turns a second later.
    pub(crate) fn assert_still(&self) {
        self.pass(0.5);
        let before = self.truth();
        self.pass(1.0);
        let after = self.truth();
        let turned = |after: f64, before: f64| (after - before).abs();
        let most_rad = turned(after.wheels_rad[0], before.wheels_rad[0])
            .max(turned(after.wheels_rad[1], before.wheels_rad[1]))
            .max(turned(after.head_rad, before.head_rad));
        // A body that was shoved settles by less than a thousandth of a degree.
        assert!(most_rad < 1e-5, "something still turned by {most_rad} rad");
    }
}

fn truth(simulation: &Simulation) -> Truth {
    simulation.inspect(|world: &mut WorldPhysics| world.truth(0)).flatten().unwrap()
}

/// The shipped robot's file with one piece of text replaced.
fn robot_with(from: &str, to: &str) -> Source {
    assert!(DEFAULT_ROBOT.contains(from), "the shipped robot.toml has no `{from}`");
    Source { name: "robot.toml".to_owned(), text: DEFAULT_ROBOT.replacen(from, to, 1) }
}

pub(crate) fn load(source: &Source) -> RobotConfig {
    let (config, findings) = RobotConfig::load(&source.name, source.text.as_bytes())
        .unwrap_or_else(|findings| panic!("{findings}\n{}", source.text));
    assert!(findings.is_empty(), "{findings}");
    config
}
