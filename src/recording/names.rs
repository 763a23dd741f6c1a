//! What a recording says at its beginning about robot and mission, so that its numbers can be read
//! without them.

use crate::behavior::{MachinePlan, Mission, StatePlan, TransitionPlan};
use crate::ev3dev::Driver;
use crate::robot::RobotConfig;
use crate::senses::Role;

use super::about::{Info, MachineNames, Start, StateNames};

impl Start {
    /// A run of this robot and this mission, each with its file's text.
    pub(crate) fn of(
        info: Info,
        (robot, robot_toml): (&RobotConfig, &str),
        (mission, mission_toml): (&Mission, &str),
        world_toml: Option<String>,
    ) -> Self {
        Self {
            info,
            robot_toml: robot_toml.to_owned(),
            mission_toml: mission_toml.to_owned(),
            world_toml,
            range: robot.range,
            infrared: robot.driver_of(Role::Range) == Some(Driver::Infrared),
            machines: machines(mission),
            variables: mission.variables().iter().map(|(name, _)| name.clone()).collect(),
        }
    }
}

/// What machines, states and conditions are called.
pub(super) fn machines(mission: &Mission) -> Vec<MachineNames> {
    mission.machines().iter().map(machine).collect()
}

fn machine(machine: &MachinePlan) -> MachineNames {
    let condition = |next: &TransitionPlan| next.when.to_string();
    let always = &machine.region.always;
    let state = |(at, state): (u16, &StatePlan)| StateNames {
        name: state.name.clone(),
        conditions: machine.transitions(at).skip(always.len()).map(condition).collect(),
    };
    MachineNames {
        name: machine.name.clone(),
        start: machine.first(),
        always: always.iter().map(condition).collect(),
        states: (0..).zip(&machine.states).map(state).collect(),
    }
}
