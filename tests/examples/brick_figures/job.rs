//! The job of a run, as `onbrick run` hands it to the process that drives: `job MISSION BRICK
//! FILE`.
//!
//! For what starts that process by itself: a measurement from its first moment on, and an emulator
//! that cannot start another program.

use std::error::Error;
use std::path::Path;

use onbrick::clock::SECOND_NS;
use onbrick::ev3dev::LocalTree;
use onbrick::mapping::Pose;
use onbrick::robot::DEFAULT_ROBOT;
use onbrick::runtime::{Brick, Job, Lock, Source, WhenAbandoned};
use onbrick::sim::World;

const WORLD: &str = "arena";

pub(crate) fn job(mission: &str, brick: &str, file: &str) -> Result<(), Box<dyn Error>> {
    let source = |name: &str, text: &str| Source { name: name.to_owned(), text: text.to_owned() };
    let world = World::text(WORLD).ok_or("no such world")?;
    let job = Job {
        mission: source(mission, &std::fs::read_to_string(mission)?),
        robot: source("robot.toml", DEFAULT_ROBOT),
        brick: match brick {
            "simulated" => {
                Brick::Simulated { world: source(WORLD, world), seed: 7, realtime: false }
            }
            root => Brick::Local(LocalTree::new(root)),
        },
        start: Pose::default(),
        set: Vec::new(),
        file: Path::new(file).to_owned(),
        sync_ns: SECOND_NS,
        stamps_ns: 0,
        run: None,
        name: None,
        no_button: false,
        method: onbrick::mapping::Method::Default,
        when_abandoned: WhenAbandoned::GoOn,
        lock: Lock::Take,
    };
    println!("{}", serde_json::to_string(&job)?);
    Ok(())
}
