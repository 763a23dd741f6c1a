//! What a recording says at its beginning about robot and mission, so that its numbers can be read
//! without them.

use crate::behavior::{MachinePlan, Mission, StatePlan, TransitionPlan};
use crate::robot::RobotConfig;

use super::about::{Info, MachineNames, RangeSensor, Start, StateNames};

/// The nearest that the ultrasonic sensor measures, metres (`ev3dev-interfaces`, 6.4).
const NEAREST_M: f64 = 0.03;

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
            range: range_sensor(robot),
            machines: machines(mission),
            variables: mission.variables().iter().map(|(name, _)| name.clone()).collect(),
        }
    }
}

/// How the range sensor sits and sees.
fn range_sensor(config: &RobotConfig) -> Option<RangeSensor> {
    config.range.as_ref().map(|range| RangeSensor {
        ahead_m: range.ahead_m,
        min_m: NEAREST_M,
        max_m: range.max_m,
        field_of_view_rad: 2.0 * range.half_cone_rad,
        infrared: false,
    })
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::DEFAULT_ROBOT;
    use crate::units::degrees;

    #[test]
    fn the_cone_that_is_recorded_is_the_one_that_the_map_is_made_with() {
        let wide = DEFAULT_ROBOT.replacen("half_cone_deg = 14", "half_cone_deg = 20", 1);
        for (text, half_deg) in [(DEFAULT_ROBOT, 14.0), (&wide, 20.0)] {
            let (config, _) = RobotConfig::load("robot.toml", text.as_bytes()).unwrap();
            let seen_rad = range_sensor(&config).unwrap().field_of_view_rad;
            assert!((degrees(seen_rad) - 2.0 * half_deg).abs() < 1e-9, "{seen_rad} rad");
            let mapped = config.geometry().unwrap();
            assert!((mapped.range().half_cone_rad * 2.0 - seen_rad).abs() < 1e-12);
        }
    }
}
