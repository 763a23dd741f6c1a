//! The job of a run, as `onbrick run` hands it to the process that drives: `job MISSION BRICK
//! FILE`.
//!
//! For what starts that process by itself: a measurement from its first moment on, and an emulator
//! that cannot start another program.

use std::error::Error;
use std::path::Path;

use onbrick::ev3dev::LocalTree;
use onbrick::robot::DEFAULT_ROBOT;
use onbrick::runtime::{Brick, Job, Source, WhenAbandoned};
use onbrick::sim::World;

const WORLD: &str = "arena";

pub(crate) fn job(mission: &str, brick: &str, file: &str) -> Result<(), Box<dyn Error>> {
    let source = |name: &str, text: &str| Source { name: name.to_owned(), text: text.to_owned() };
    let world = World::text(WORLD).ok_or("no such world")?;
    let brick = match brick {
        "simulated" => Brick::Simulated { world: source(WORLD, world), seed: 7, realtime: false },
        root => Brick::Local(LocalTree::new(root)),
    };
    let mission = source(mission, &std::fs::read_to_string(mission)?);
    let job = Job {
        when_abandoned: WhenAbandoned::GoOn,
        ..Job::new(mission, source("robot.toml", DEFAULT_ROBOT), brick, Path::new(file).to_owned())
    };
    println!("{}", serde_json::to_string(&job)?);
    Ok(())
}
