//! A new run from another one's senses: what another robot, or another method, would have made of
//! them.

use std::fmt;
use std::path::Path;

use serde::Serialize;

use super::{Cast, ReplayError};
use crate::behavior::Demands;
use crate::mapping::{Method, Pose};
use crate::recording::{
    self, End, Grid, Info, Options, Pace, RecordError, Recorder, Run, Start, StopReason,
};
use crate::robot::RobotConfig;
use crate::runtime::Source;
use crate::runtime::pilot::{ChangedVariables, PilotState};
use crate::senses::{Channel, QUANTITIES, Quantity, Role, Senses};
use crate::units::counted;

/// A run that was made from another one's senses.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Remade {
    /// Ticks.
    pub ticks: u64,
    /// Points of its map.
    pub points: u64,
    /// Metres driven.
    pub travelled_m: f64,
    /// The pose at its end.
    pub end: Pose,
}

impl fmt::Display for Remade {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}: {:.2} m driven, {}, ending at {:.3}, {:.3} m, {:.1} degrees",
            counted(self.ticks, "tick"),
            self.travelled_m,
            counted(self.points, "point"),
            self.end.x_m,
            self.end.y_m,
            crate::units::degrees(self.end.heading_rad)
        )
    }
}

/// Replays a run's senses with another robot, or by another method, and records the result to
/// `file`.
///
/// The machines may decide otherwise than they did; the senses stay what they were.
///
/// # Errors
///
/// [`ReplayError`].
pub fn replay_with(
    run: &Run,
    robot: Option<&Source>,
    method: Option<Method>,
    file: &Path,
) -> Result<Remade, ReplayError> {
    let other = robot.map(Source::robot).transpose()?.map(|(config, _)| config);
    let mut cast = Cast::with(run, other.as_ref(), method)?;
    let config = other.unwrap_or_else(|| cast.robot.clone());
    let text = robot.map_or(run.robot_toml.as_deref().unwrap_or_default(), |robot| &robot.text);
    let info = Info {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        brick: config.name.clone(),
        mission: cast.mission.name().to_owned(),
        pace: Pace::Virtual,
        ..cast.info.clone()
    };
    let mission = (&cast.mission, run.mission_toml.as_deref().unwrap_or_default());
    let start = Start::of(info, (&config, text), mission, run.world_toml.clone());
    let sink = recording::create(file)
        .map_err(|source| RecordError { doing: "create the file", source })?;
    let (recorder, mut tick_side) =
        Recorder::start::<PilotState>(Box::new(sink), start, Options::default(), Box::new(|_| {}))?;
    let mut remade = Remade { ticks: 0, points: 0, travelled_m: 0.0, end: cast.info.start_pose };
    let mut demands = Demands::default();
    let mut time_ns = cast.info.start_ns;
    let mut variables = ChangedVariables::default();
    for senses in &run.senses {
        let senses = regeared(senses, &cast.robot, &config);
        let mut taken = Vec::new();
        let step = cast.pilot.step(&senses, &mut demands, |transition| taken.push(transition));
        time_ns = senses.time_ns;
        tick_side.tick(&step.record(&senses, 0));
        for transition in taken {
            tick_side.transition(senses.tick, time_ns, transition);
        }
        if let Some(values) = variables.next(cast.pilot.program().variables()) {
            tick_side.variables(senses.tick, time_ns, values);
        }
        remade.ticks += 1;
        remade.points += step.placed.len() as u64;
        remade.travelled_m = step.estimate.travelled_m;
        remade.end = step.estimate.pose;
    }
    let stop = StopReason::Replayed.with(format!("with {}", config.name));
    let truth = run.ending.as_ref().and_then(|ending| ending.truth);
    let points = cast.pilot.finish();
    remade.points += points.len() as u64;
    tick_side.keyframes(time_ns, cast.pilot.keyframes());
    let end = End { stop, time_ns, truth, points, map: Some(Grid::from(cast.pilot.map().grid())) };
    recorder.finish(tick_side, end)?;
    Ok(remade)
}

/// The same senses as another robot would have given them: where its gears differ, the angles of
/// its axles do, and what it does not have says nothing.
fn regeared(senses: &Senses, from: &RobotConfig, to: &RobotConfig) -> Senses {
    let mut senses = *senses;
    let mut scale = |channel: Channel, from: f64, to: f64| {
        if let Some(reading) = &mut senses.readings[channel as usize]
            && from.to_bits() != to.to_bits()
        {
            reading.value *= to / from;
        }
    };
    scale(Channel::Left, from.drive.left.ratio, to.drive.left.ratio);
    scale(Channel::Right, from.drive.right.ratio, to.drive.right.ratio);
    if let (Some(from), Some(to)) = (&from.head, &to.head) {
        scale(Channel::Head, from.motor.ratio, to.motor.ratio);
    }
    for (channel, (from, to)) in Channel::MOTORS.into_iter().zip(from.motors.iter().zip(&to.motors))
    {
        scale(channel, from.motor.ratio, to.motor.ratio);
    }
    let lacks = |quantity: &Quantity| match quantity.role {
        // One that measures something else says nothing, either.
        Role::Sensor(at) => {
            let at = usize::from(at);
            to.named_sensors.get(at).is_none()
                || to.named_sensors.get(at) != from.named_sensors.get(at)
        }
        role => !to.has(role),
    };
    for quantity in QUANTITIES.iter().filter(|quantity| lacks(quantity)) {
        senses.readings[quantity.channel as usize] = None;
    }
    senses
}
