//! What a recording says at its beginning about robot and mission, so that its numbers can be read
//! without them.

use std::f64::consts::PI;

use crate::behavior::{MachinePlan, Mission, StatePlan, TransitionPlan};
use crate::robot::RobotConfig;

use super::about::{MachineNames, RangeSensor, StateNames};

/// The nearest that the ultrasonic sensor measures, metres (`ev3dev-interfaces`, 6.4).
const NEAREST_M: f64 = 0.03;

/// How wide it sees, radians (the paper, section 4.1: about 20 degrees).
const FIELD_OF_VIEW_RAD: f64 = 20.0 * (PI / 180.0);

/// How the range sensor sits and sees.
pub(crate) fn range_sensor(config: &RobotConfig) -> Option<RangeSensor> {
    config.range.as_ref().map(|range| RangeSensor {
        ahead_m: range.ahead_m,
        min_m: NEAREST_M,
        max_m: range.max_m,
        field_of_view_rad: FIELD_OF_VIEW_RAD,
        infrared: false,
    })
}

/// What machines, states and conditions are called.
pub(crate) fn machines(mission: &Mission) -> Vec<MachineNames> {
    mission.machines().iter().map(machine).collect()
}

/// What the mission's variables are called.
pub(crate) fn variables(mission: &Mission) -> Vec<String> {
    mission.variables().iter().map(|(name, _)| name.clone()).collect()
}

fn machine(machine: &MachinePlan) -> MachineNames {
    let condition = |next: &TransitionPlan| next.when().to_string();
    let always = machine.region().always();
    let state = |(at, state): (u16, &StatePlan)| StateNames {
        name: state.name().to_owned(),
        conditions: machine.transitions(at).skip(always.len()).map(condition).collect(),
    };
    MachineNames {
        name: machine.name().to_owned(),
        start: machine.first(),
        always: always.iter().map(condition).collect(),
        states: (0..).zip(machine.states()).map(state).collect(),
    }
}
