//! A world that notes at each of its steps, to 2 ms, which bridges drive and which shafts turn: the
//! figures include no polling.

use std::sync::{Arc, Mutex};

use onbrick::sim::{Bridge, Fault, Physics, Plug, STEP_NS, WorldPhysics};

/// What was seen of a brick, in nanoseconds of the simulation's time.
#[derive(Debug, Clone, Copy, Default)]
pub struct Seen {
    /// When a bridge was last under a command.
    pub driven_ns: i64,
    /// When a shaft last turned.
    pub turned_ns: i64,
}

/// Slower than this a shaft is at rest, edges a step: a degree a second, which is half a millimetre
/// a second at the wheel.
const REST_EDGES: f64 = 1.0 * 2.0 * 0.002;

/// The world, and what it notes of its only robot.
#[derive(Debug)]
pub struct Witness {
    world: WorldPhysics,
    steps: i64,
    edges: [f64; 4],
    seen: Arc<Mutex<Seen>>,
}

impl Witness {
    pub fn new(world: WorldPhysics) -> (Self, Arc<Mutex<Seen>>) {
        let seen = Arc::default();
        (Self { world, steps: 0, edges: [0.0; 4], seen: Arc::clone(&seen) }, seen)
    }
}

impl Physics for Witness {
    fn robots(&self) -> usize {
        self.world.robots()
    }

    fn plug(&self, robot: usize) -> Plug {
        self.world.plug(robot)
    }

    fn step(&mut self, bridges: &[[Bridge; 4]]) {
        self.world.step(bridges);
        self.steps += 1;
        let now_ns = self.steps * STEP_NS;
        let mut seen = self.seen.lock().unwrap();
        if bridges[0].iter().any(|bridge| matches!(bridge, Bridge::Duty(_))) {
            seen.driven_ns = now_ns;
        }
        for (out, before) in self.edges.iter_mut().enumerate() {
            let edges = self.world.edge_position(0, out);
            if (edges - *before).abs() > REST_EDGES {
                seen.turned_ns = now_ns;
            }
            *before = edges;
        }
    }

    fn edges(&self, robot: usize, out: usize) -> i64 {
        self.world.edges(robot, out)
    }

    fn edge_position(&self, robot: usize, out: usize) -> f64 {
        self.world.edge_position(robot, out)
    }

    fn measure(&mut self, robot: usize, input: usize, mode: &str) -> [i32; 8] {
        self.world.measure(robot, input, mode)
    }

    fn fail(&mut self, robot: usize, fault: Fault) {
        Physics::fail(&mut self.world, robot, fault);
    }

    fn battery(&self, robot: usize) -> (f64, f64) {
        self.world.battery(robot)
    }
}
