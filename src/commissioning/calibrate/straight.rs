//! The wheels' circumference: at a wall, or over a measured metre.

use std::f64::consts::PI;

use crate::behavior::Drive;
use crate::senses::{Channel, Senses};
use crate::units;

use super::CalibrateError;
use super::fit::{Measured, median, slope};
use super::stage::{ASTRAY_RAD, Ended, Limit, Stage, Standing};
use super::turns::turn_to;

/// Between these ranges the robot drives back and forth, metres from the sensor: near enough for a
/// loud echo, far enough not to touch.
pub(super) const NEAR_M: f64 = 0.2;
const FAR_M: f64 = 0.7;

/// How far off the wall may be to begin with, metres.
const START_M: std::ops::RangeInclusive<f64> = 0.1..=1.5;

/// How fast, metres per second: some sixty echoes on the way.
const SPEED_M_S: f64 = 0.08;

/// The first of each leg is left out, radians of the wheel: gears and caster settle.
const SETTLE_RAD: f64 = 0.7;

/// So far off the line an echo is as good as any, metres (the sensor's own noise:
/// `lego-sensor-tables`).
pub(super) const RANGE_NOISE_M: f64 = 0.01;

/// A leg with fewer echoes says nothing.
pub(super) const FEWEST_ECHOES: usize = 20;

/// After so long without an echo the wall is lost, nanoseconds.
const LOST_NS: i64 = 1_000_000_000;

/// The file's circumference may be off by a third; a motion may go so much farther than it thinks.
const SLACK: f64 = 1.5;

/// An echo that is so much farther off, metres, is no noise.
const RECEDED_M: f64 = 0.1;

/// How far the robot drives where a person measures, metres.
const METRE_M: f64 = 1.0;

/// How far the robot turns to either side to find where it stands square to the wall, radians: the
/// sonar hears a wall up to some 30 degrees from its normal.
const SWING_RAD: f64 = PI / 5.0;

/// How fast, radians per second.
const SWING_RAD_S: f64 = PI / 6.0;

/// The wall is as near as it gets up to so much more, metres: more than the sensor's noise.
const NEAREST_M: f64 = 0.015;

/// A robot that turned by less than this stands square, radians.
const SQUARE_RAD: f64 = PI / 36.0;

/// What that leaves of the circumference unseen, as a share: the cosine of 5 degrees.
const SQUARE_UNSEEN: f64 = 0.004;

/// How often the robot swings at most: more than a person's eye leaves aslant.
const SWINGS: u32 = 4;

/// Drives back and forth before a wall; each leg is a measurement.
pub(super) fn by_wall(
    stage: &mut Stage<'_>,
    pairs: Option<u32>,
) -> Result<Measured, CalibrateError> {
    stage.dialogue.agree(
        "Put the robot half a metre before a plain wall, square to it, its head straight ahead, \
         with a metre of floor behind it. It will turn square by itself, and drive back and forth. \
         Is it ready?",
    )?;
    let before_m = stage.config().drive.wheel_circumference_m;
    // What the sensor says for a metre, by the file.
    let scale = stage.config().range.as_ref().map_or(1.0, |range| range.scale);
    to_the_wall(stage)?;
    let legs = stage.both_ways([-1.0, 1.0], pairs.unwrap_or(3), leg)?;
    let rolled = |points: Vec<[f64; 2]>| {
        slope(&points, RANGE_NOISE_M, FEWEST_ECHOES).map(|per_rad| -2.0 * PI * per_rad / scale)
    };
    let [back, ahead] = legs.map(|legs| legs.into_iter().filter_map(rolled).collect::<Vec<_>>());
    Ok(Measured { unseen: SQUARE_UNSEEN, ..Measured::of(before_m, [&ahead, &back]) })
}

/// Turns square to the wall and drives up to it; returns what the sensor said before that way.
pub(super) fn to_the_wall(stage: &mut Stage<'_>) -> Result<f64, CalibrateError> {
    wall_ahead(stage)?;
    square_up(stage)?;
    let range_m = wall_ahead(stage)?;
    if range_m > NEAR_M {
        way(stage, 1.0, range_m - NEAR_M)?;
    }
    Ok(range_m)
}

/// Turns the robot until the wall is as near to its left as to its right. On a way that is aslant
/// the range falls by the cosine, which no scatter shows: a sonar hears the wall's nearest place
/// wherever that is in its cone.
fn square_up(stage: &mut Stage<'_>) -> Result<(), CalibrateError> {
    for _ in 0..SWINGS {
        if swing(stage)?.abs() < SQUARE_RAD {
            return Ok(());
        }
    }
    Err(CalibrateError::NoWall(
        "the robot does not find where it stands square to the wall: put it half a metre before \
         a plain wall, with nothing else near; if it does not turn on the spot, look at the \
         wheels' ports and `inverted` in robot.toml"
            .to_owned(),
    ))
}

/// Looks to both sides and turns to the middle of where the wall is nearest; how far that was off,
/// radians.
fn swing(stage: &mut Stage<'_>) -> Result<f64, CalibrateError> {
    let from = stage.rest()?;
    let mut heard = Vec::new();
    turn_to(stage, Some(&from), SWING_RAD_S, SWING_RAD, |_, _| ())?;
    // There and back: a reading is of where the robot was a little earlier.
    for side in [-1.0, 1.0] {
        turn_to(stage, Some(&from), SWING_RAD_S, side * SWING_RAD, |at_rad, senses| {
            heard.extend(senses.get(Channel::Range).map(|range| (at_rad, range.value)));
        })?;
    }
    // It stands at the end of the last way.
    if from.turned_rad(&stage.rest()?).abs() < SWING_RAD / 3.0 {
        return Err(CalibrateError::Exchanged("the robot does not turn where it is to turn"));
    }
    let middle_rad = middle_of_nearest(&heard).ok_or(CalibrateError::WallLost)?;
    turn_to(stage, Some(&from), SWING_RAD_S, middle_rad, |_, _| ())?;
    Ok(middle_rad)
}

/// The mean angle of the nearest ranges: angles, radians, each with its range, metres.
fn middle_of_nearest(heard: &[(f64, f64)]) -> Option<f64> {
    let mut ranges: Vec<f64> =
        heard.iter().map(|(_, range_m)| *range_m).filter(|range_m| range_m.is_finite()).collect();
    ranges.sort_by(f64::total_cmp);
    // A few may be wrong.
    let nearest_m = *ranges.get(ranges.len() / 20)?;
    let near = heard.iter().filter(|(_, range_m)| (range_m - nearest_m).abs() <= NEAREST_M);
    let count = near.clone().count();
    Some(near.map(|(at_rad, _)| at_rad).sum::<f64>() / units::count(count))
}

/// One way between the two ranges; see [`way`].
pub(super) fn leg(stage: &mut Stage<'_>, way: f64) -> Result<Vec<[f64; 2]>, CalibrateError> {
    self::way(stage, way, FAR_M - NEAR_M)
}

/// How far off the wall is: the middle of a second's echoes.
fn wall_ahead(stage: &mut Stage<'_>) -> Result<f64, CalibrateError> {
    let range_m = median(stage.ranges()?).unwrap_or(f64::INFINITY);
    if START_M.contains(&range_m) {
        return Ok(range_m);
    }
    let found = if range_m.is_finite() {
        format!("the wall is {range_m:.2} m off")
    } else {
        format!("no wall within {:.1} m ahead", START_M.end())
    };
    Err(CalibrateError::NoWall(format!(
        "{found}: put the robot half a metre before a plain wall, its head straight ahead"
    )))
}

/// Drives ahead to the near range or back to the far one; the wheels' angle, radians, and the
/// reading of each echo on the way, metres.
fn way(stage: &mut Stage<'_>, way: f64, length_m: f64) -> Result<Vec<[f64; 2]>, CalibrateError> {
    let from = stage.rest()?;
    let mut echoes = Echoes::new(way);
    let limit = limit(stage, length_m);
    let ended = stage.drive(forward(way), limit, |now, senses| {
        echoes.look(now, senses) || echoes.recede() || is_astray(&from, now)
    })?;
    is_straight(&from, &stage.rest()?)?;
    if echoes.recede() {
        return Err(CalibrateError::Exchanged("the robot drives the other way than it is told"));
    }
    if echoes.lost {
        return Err(CalibrateError::WallLost);
    }
    if ended == Ended::Limit {
        return Err(CalibrateError::TooFar(format!(
            "the range did not come to {:.1} m within {SLACK} times the way: does the head look \
             straight ahead, are ports and gears as robot.toml says?",
            if way > 0.0 { NEAR_M } else { FAR_M }
        )));
    }
    Ok(echoes.points)
}

fn is_astray(from: &Standing, to: &Standing) -> bool {
    from.turned_rad(to).abs() > ASTRAY_RAD
}

/// Refuses a way on which the robot turned.
fn is_straight(from: &Standing, to: &Standing) -> Result<(), CalibrateError> {
    if is_astray(from, to) {
        return Err(CalibrateError::Exchanged("the robot turns where it is to drive straight"));
    }
    Ok(())
}

fn forward(way: f64) -> Drive {
    Drive::Twist { forward_m_s: way * SPEED_M_S, turn_rad_s: 0.0 }
}

fn limit(stage: &Stage<'_>, length_m: f64) -> Limit {
    let metres_per_rad = stage.config().metres_per_rad();
    // A low limit of max_dps makes it slower than asked.
    let speed_m_s = SPEED_M_S.min(stage.config().drive.max_wheel_rad_s * metres_per_rad);
    Limit {
        wheel_rad: (length_m + 0.05) * SLACK / metres_per_rad,
        time_s: 2.0 + (length_m + 0.05) * 2.0 * SLACK / speed_m_s,
    }
}

/// The echoes of one leg, each once.
struct Echoes {
    way: f64,
    from_rad: Option<f64>,
    points: Vec<[f64; 2]>,
    /// Echoes in a row beyond the leg's end: a single one may be wrong.
    beyond: u32,
    heard_ns: Option<i64>,
    lost: bool,
}

impl Echoes {
    fn new(way: f64) -> Self {
        Self { way, from_rad: None, points: Vec::new(), beyond: 0, heard_ns: None, lost: false }
    }

    /// Takes what is new; true at the leg's end.
    fn look(&mut self, now: &Standing, senses: &Senses) -> bool {
        let wheel_rad = f64::midpoint(now.left_rad, now.right_rad);
        let from_rad = *self.from_rad.get_or_insert(wheel_rad);
        let heard_ns = *self.heard_ns.get_or_insert(senses.time_ns);
        // While the robot moves, an echo that is new has a new value: one that stands still is an
        // old one read again.
        let echo = senses
            .get(Channel::Range)
            .filter(|reading| reading.changed_ns == senses.time_ns && reading.value.is_finite());
        let Some(echo) = echo else {
            self.lost = senses.time_ns - heard_ns > LOST_NS;
            return self.lost;
        };
        self.heard_ns = Some(senses.time_ns);
        if (wheel_rad - from_rad).abs() > SETTLE_RAD {
            self.points.push([wheel_rad, echo.value]);
        }
        let is_beyond = if self.way > 0.0 { echo.value <= NEAR_M } else { echo.value >= FAR_M };
        self.beyond = if is_beyond { self.beyond + 1 } else { 0 };
        self.beyond >= 2
    }

    /// Whether the wall moves the other way than it should: each of the last echoes is farther off
    /// than each of the first, as one may be wrong, or nearer on the way back.
    fn recede(&self) -> bool {
        const SOME: usize = 3;
        let along = |[_, range_m]: &[f64; 2]| self.way * range_m;
        let Some((first, rest)) = self.points.split_first_chunk::<SOME>() else { return false };
        let Some(last) = rest.last_chunk::<SOME>() else { return false };
        let most = first.iter().map(along).fold(f64::NEG_INFINITY, f64::max);
        last.iter().map(along).fold(f64::INFINITY, f64::min) - most > RECEDED_M
    }
}

/// Drives about a metre, ahead and back; the person measures each time.
pub(super) fn by_metre(
    stage: &mut Stage<'_>,
    pairs: Option<u32>,
) -> Result<Measured, CalibrateError> {
    stage.dialogue.agree(
        "The robot will drive about a metre, ahead and back, several times; have a measuring tape \
         at hand. Does it have a metre and a half of floor ahead?",
    )?;
    let before_m = stage.config().drive.wheel_circumference_m;
    let [ahead, back] = stage.both_ways([1.0, -1.0], pairs.unwrap_or(2), metre)?;
    Ok(Measured::of(before_m, [&ahead, &back]))
}

fn metre(stage: &mut Stage<'_>, way: f64) -> Result<f64, CalibrateError> {
    let direction = if way > 0.0 { "ahead" } else { "back" };
    stage.dialogue.agree(&format!(
        "Mark on the floor where one of the wheels stands. Drive about a metre {direction} now?"
    ))?;
    let metres_per_rad = stage.config().metres_per_rad();
    let from = stage.rest()?;
    stage.drive(forward(way), limit(stage, METRE_M), |now, _| {
        from.rolled_rad(now).abs() * metres_per_rad >= METRE_M || is_astray(&from, now)
    })?;
    let to = stage.rest()?;
    is_straight(&from, &to)?;
    let wheel_rad = from.rolled_rad(&to).abs();
    let came_m = stage.dialogue.number(
        "How far did that wheel come from its mark, in metres, to the millimetre (such as 0.987)?",
        METRE_M,
        0.05..=5.0,
    )?;
    Ok(came_m * 2.0 * PI / wheel_rad)
}
