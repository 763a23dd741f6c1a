//! The range sensor: what it reads too far, and where it hears the robot itself.
//!
//! # Not here
//!
//! The cone: a wall says little about it, and 14° fits the sensors of nine robots
//! (`lego-rotating-sonar`).
//!
//! # What we count on
//!
//! - The wheels' circumference is right: a way that is too long by one percent is a scale that is
//!   too small by one percent. At a wall the one cannot be told from the other, so a circumference
//!   that was measured at a wall goes by the scale that the file has.
//! - A distance is about 50 ms old when it is read. Driving at the wall it is therefore too large
//!   by 4 mm, driving back too small, and the mean of both is right.
//! - After a third of a turn no wall is at the same distance in the same direction of the head, if
//!   nothing is within [`ROOM_M`] of the robot.

use std::f64::consts::PI;

use crate::mapping::OwnEchoes;
use crate::senses::Role;
use crate::units::{degrees, radians, rounded_to};

use super::CalibrateError;
use super::fit::{Kind, Measured, median, slope};
use super::stage::{Ended, Stage};
use super::straight::{self, FEWEST_ECHOES, NEAR_M, RANGE_NOISE_M};
use super::turns::{SPIN_RAD_S, turn};

/// How far off anything else must be while own echoes are looked for, metres.
const ROOM_M: f64 = 0.4;
/// The farthest that a part of the robot is off, metres: 22 cm in `lego-rotating-sonar`.
const OWN_M: f64 = 0.3;
/// Readings of the same part are as near to each other as this, metres.
const SAME_M: f64 = 0.015;
/// A robot that hears itself in more of all directions than this has something near it.
const MOST_SHARE: f64 = 1.0 / 3.0;
/// The head looks into directions as far apart as this, degrees.
const STEP_DEG: f64 = 4.0;
/// How often it looks round, a third of a turn from each other.
const ROUNDS: usize = 3;

/// Drives back and forth before a wall whose distance a person has measured: bias and scale.
pub(super) fn bias_and_scale(
    stage: &mut Stage<'_>,
    pairs: Option<u32>,
) -> Result<[Measured; 2], CalibrateError> {
    stage.dialogue.agree(
        "Put the robot half a metre before a plain wall, square to it, its head straight ahead, \
         with a metre of floor behind it; have a measuring tape at hand. It will turn square by \
         itself, drive to the wall and wait there. Is it ready?",
    )?;
    let config = stage.config();
    let metres_per_rad = config.metres_per_rad();
    let (ahead_m, bias_m, scale) = config
        .range
        .as_ref()
        .map_or((0.0, 0.0, 1.0), |range| (range.ahead_m, range.bias_m, range.scale));
    let range_m = straight::to_the_wall(stage)?;
    let from = stage.rest()?;
    let axle_m = stage.dialogue.number(
        "How far is the wall from the middle between the wheels, in metres, to the millimetre \
         (such as 0.254)?",
        rounded_to(range_m.min(NEAR_M) + ahead_m, 1000.0),
        0.05..=2.0,
    )?;
    let from_rad = f64::midpoint(from.left_rad, from.right_rad);
    let distances = |points: Vec<[f64; 2]>| -> Vec<[f64; 2]> {
        let of = |[wheel_rad, reading_m]: [f64; 2]| {
            [axle_m - ahead_m - (wheel_rad - from_rad) * metres_per_rad, reading_m]
        };
        points.into_iter().map(of).collect()
    };
    let legs = stage.both_ways([-1.0, 1.0], pairs.unwrap_or(3), |stage, way| {
        Ok(distances(straight::leg(stage, way)?))
    })?;
    let slope = |leg: &Vec<[f64; 2]>| slope(leg, RANGE_NOISE_M, FEWEST_ECHOES).unwrap_or(f64::NAN);
    let [back, ahead] = legs.each_ref().map(|legs| legs.iter().map(slope).collect::<Vec<_>>());
    let scale = Measured::new(Kind::Ratio, scale, [&ahead, &back]);
    // By the mean scale: each leg's own would turn its line about the middle of the way.
    let offset = |leg: &Vec<[f64; 2]>| {
        let off = leg.iter().map(|[distance_m, reading_m]| reading_m - scale.after * distance_m);
        median(off.collect()).unwrap_or(f64::NAN)
    };
    let [back, ahead] = legs.each_ref().map(|legs| legs.iter().map(offset).collect::<Vec<_>>());
    Ok([Measured::new(Kind::Offset, bias_m, [&ahead, &back]), scale])
}

/// Looks round three times, a third of a turn apart: what stays where it is belongs to the robot.
/// Angles of the head from and to, degrees, and the reading there, metres.
pub(super) fn own_echoes(stage: &mut Stage<'_>) -> Result<Vec<[f64; 3]>, CalibrateError> {
    let Some(limit_rad) = stage.config().head.as_ref().map(|head| head.limit_rad) else {
        return Err(CalibrateError::NoHead);
    };
    if !stage.config().has(Role::Range) {
        return Err(CalibrateError::NoRange);
    }
    stage.dialogue.agree(
        "The head will look round three times, and the robot will turn on the spot between. Is \
         nothing within 40 cm of it?",
    )?;
    let mut rounds = Vec::new();
    for round in 0..ROUNDS {
        if round > 0 {
            third_of_a_turn(stage)?;
        }
        rounds.push(look_round(stage, limit_rad.min(PI))?);
    }
    stage.look_at(0.0)?;
    let own = constant(&rounds);
    let wide_deg: f64 = own.iter().map(|[from_deg, to_deg, _]| to_deg - from_deg).sum();
    let seen_deg = 2.0 * degrees(limit_rad.min(PI));
    if own.len() > OwnEchoes::MAX || wide_deg > MOST_SHARE * seen_deg {
        return Err(CalibrateError::NoRoom { at_m: ROOM_M });
    }
    for [from_deg, to_deg, range_m] in &own {
        stage.dialogue.say(&format!(
            "the sensor hears the robot itself from {from_deg:.0} to {to_deg:.0} degrees of the \
             head, at {range_m:.3} m"
        ));
    }
    if own.is_empty() {
        stage.dialogue.say("the sensor does not hear the robot itself");
    }
    Ok(own)
}

/// What the sensor says in each direction of the head, degrees and metres.
fn look_round(stage: &mut Stage<'_>, limit_rad: f64) -> Result<Vec<[f64; 2]>, CalibrateError> {
    let mut round = Vec::new();
    let mut at_deg = -degrees(limit_rad);
    while at_deg <= degrees(limit_rad) {
        round.push([at_deg, stage.look_at(radians(at_deg))?.unwrap_or(f64::INFINITY)]);
        at_deg += STEP_DEG;
    }
    Ok(round)
}

fn third_of_a_turn(stage: &mut Stage<'_>) -> Result<(), CalibrateError> {
    let ended = turn(stage, SPIN_RAD_S, 2.0 * PI / 3.0)?;
    stage.rest()?;
    if ended == Ended::Limit {
        return Err(CalibrateError::TooFar(
            "the robot did not come round by a third of a turn".to_owned(),
        ));
    }
    Ok(())
}

/// Where all rounds, or all but one that heard nothing, have the same near reading; neighbours with
/// the same reading are one place.
fn constant(rounds: &[Vec<[f64; 2]>]) -> Vec<[f64; 3]> {
    let directions = rounds.iter().map(Vec::len).min().unwrap_or(0);
    let mut own: Vec<[f64; 3]> = Vec::new();
    for direction in 0..directions {
        let here = rounds.iter().filter_map(|round| round.get(direction));
        let at_deg = here.clone().map(|[at_deg, _]| *at_deg).next().unwrap_or(0.0);
        let echoes: Vec<f64> =
            here.map(|[_, range_m]| *range_m).filter(|m| m.is_finite()).collect();
        let least_m = echoes.iter().copied().fold(f64::INFINITY, f64::min);
        let most_m = echoes.iter().copied().fold(0.0, f64::max);
        if echoes.len() + 1 < rounds.len().max(3) || most_m > OWN_M || most_m - least_m > SAME_M {
            continue;
        }
        let range_m = median(echoes).unwrap_or(least_m);
        let (from_deg, to_deg) = (at_deg - STEP_DEG / 2.0, at_deg + STEP_DEG / 2.0);
        match own.last_mut() {
            Some([_, end_deg, before_m])
                if (*end_deg - from_deg).abs() < STEP_DEG
                    && (*before_m - range_m).abs() < SAME_M =>
            {
                *end_deg = to_deg;
            }
            _ => own.push([from_deg, to_deg, range_m]),
        }
    }
    own
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stays_at_an_angle_of_the_head_is_the_robot() {
        const NONE: f64 = f64::INFINITY;
        #[rustfmt::skip]
        let readings = [
            // degrees, three rounds
            (-8.0, [0.21, 0.21, 1.20]),
            (-4.0, [0.20, 0.21, 0.205]),
            ( 0.0, [0.20, NONE, 0.20]),
            ( 4.0, [0.21, 0.20, 0.20]),
            ( 8.0, [0.28, 0.12, 0.20]),
            (12.0, [0.25, NONE, NONE]),
            (16.0, [0.80, 0.80, 0.80]),
            (20.0, [0.15, 0.15, 0.15]),
        ];
        let rounds: Vec<Vec<[f64; 2]>> = (0..3)
            .map(|round| readings.iter().map(|(deg, ranges)| [*deg, ranges[round]]).collect())
            .collect();
        assert_eq!(constant(&rounds), [[-6.0, 6.0, 0.205], [18.0, 22.0, 0.15]]);
        assert!(constant(&[]).is_empty());
    }
}
