//! The commands of a PC: pictures and exports of runs, the demo, and bricks in the network.

use super::{Failure, Output, commands};

mod bricks;
mod class;
mod demo;
mod explain;
mod export;
mod fetch;
mod identify;
mod manual;
mod missions;
mod plot;
mod push;
pub(super) mod remote;
mod repair;
mod runs;
mod scene;
mod start;
mod status;
mod stop;
mod team;
mod watch;

commands! {
    pub(super) enum Arguments {
        Demo(demo),
        Bricks(bricks),
        Missions(missions),
        Status(status),
        Start(start),
        Stop(stop),
        Runs(runs),
        Fetch(fetch),
        Identify(identify),
        Team(team),
        Class(class),
        Plot(plot),
        Export(export),
        Repair(repair),
        Push(push),
        Explain(explain),
        Manual(manual),
    }
}

pub(super) fn run(command: &Arguments, output: &mut Output) -> Result<(), Failure> {
    command.run(output)
}
