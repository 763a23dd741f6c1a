//! The track width: by spinning on the spot.

use std::f64::consts::PI;

use crate::behavior::Drive;
use crate::mapping::whole_turn::WholeTurns;
use crate::senses::{Channel, Senses};
use crate::units::{degrees, radians};

use super::fit::Measured;
use super::stage::{ASTRAY_RAD, Ended, Limit, Stage, Standing};
use super::{CalibrateError, CalibrateOptions, NoAnswer};

/// How fast the robot spins, radians per second: far below the 440 degrees a second at which a gyro
/// loses count.
pub(super) const SPIN_RAD_S: f64 = PI / 3.0;

/// How fast it creeps towards the mark: a person who is late by a fifth of a second is then 3
/// degrees off, which the last step corrects.
const CREEP_RAD_S: f64 = PI / 15.0;

/// Whole turns of a spin against the gyro.
const GYRO_TURNS: f64 = 3.0;

/// Whole turns of a spin that a person marks: a degree of the eye is then 0.14 %.
const MARKED_TURNS: f64 = 2.0;

/// After this share of the marked turns, by the file's numbers, the robot creeps: they may be off
/// by a fourth.
const FAST_SHARE: f64 = 0.75;

/// How much farther a spin may go than the file's numbers say.
const SLACK: f64 = 1.5;

/// What a gyro may be off by without anything on the robot showing it, as a share: people find 1 to
/// 4 % (`lego-sensor-tables`).
const GYRO_UNSEEN: f64 = 0.02;

/// So unsure may the gyro's scale be that the range sensor tells, as a share: less than a person's
/// eye is of two turns.
const CLEAR: f64 = 0.004;

/// A step of the last correction, radians.
const STEP_RAD: f64 = 2.0 * PI / 360.0;

/// How many such steps at most.
const STEPS: u32 = 60;

/// Spins in both directions; the track width, and the gyro's scale where turns were marked.
pub(super) fn track_width(
    stage: &mut Stage<'_>,
    options: &CalibrateOptions,
    circumference_m: f64,
) -> Result<(Measured, Option<f64>), CalibrateError> {
    let before_m = stage.config().drive.track_width_m;
    if !stage.has_gyro() {
        if options.mark == Some(false) {
            return Err(CalibrateError::NoGyro);
        }
        let spins = stage.both_ways([1.0, -1.0], options.pairs.unwrap_or(2), marked_spin)?;
        let [left, right] = spins.map(|spins| {
            spins
                .iter()
                .map(|spin| width_m(spin, circumference_m, marked_rad(spin)))
                .collect::<Vec<_>>()
        });
        return Ok((Measured::of(before_m, [&left, &right]), None));
    }
    stage.dialogue.agree(
        "The robot will now spin on the spot, to the left and to the right. Does it have a hand's \
         width of space all around?",
    )?;
    let (mut widths, mut scales) = ([const { Vec::new() }; 2], [const { Vec::new() }; 2]);
    for _ in 0..options.pairs.unwrap_or(3) {
        for (side, way) in [1.0, -1.0].into_iter().enumerate() {
            let (spin, heard) = spin_by_gyro(stage, way)?;
            widths[side].push(width_m(&spin, circumference_m, spin.gyro_rad()));
            scales[side].extend(heard.gyro_scale());
        }
    }
    let [measured, scale] = [(before_m, &widths), (1.0, &scales)]
        .map(|(before, [left, right])| Measured::of(before, [left, right]));
    let is_clear = scale.doubt.is_none() && scale.standard_error < CLEAR;
    if is_clear && options.mark != Some(true) {
        say_scale(stage, scale.after, "by what the range sensor hears again");
        return Ok((measured.scaled(scale.after, scale.standard_error), Some(scale.after)));
    }
    if !is_marked(stage, options)? {
        let measured = measured.scaled(stage.config().gyro_scale, 0.0);
        return Ok((Measured { unseen: GYRO_UNSEEN, ..measured }, None));
    }
    let [left, right] = stage.both_ways([1.0, -1.0], 1, marked_spin)?;
    let scales: Vec<f64> =
        left.iter().chain(&right).map(|spin| spin.gyro_rad() / marked_rad(spin)).collect();
    let [a, b] = [scales.first(), scales.last()].map(|scale| scale.copied().unwrap_or(f64::NAN));
    let scale = f64::midpoint(a, b);
    say_scale(stage, scale, "by your marks");
    // Of two values, half their distance is the mean's standard error.
    Ok((measured.scaled(scale, ((a - b) / 2.0 / scale).abs()), Some(scale)))
}

fn say_scale(stage: &mut Stage<'_>, scale: f64, by: &str) {
    stage
        .dialogue
        .say(&format!("The gyro says {:.1} degrees for a whole turn, {by}.", 360.0 * scale));
}

fn is_marked(stage: &mut Stage<'_>, options: &CalibrateOptions) -> Result<bool, NoAnswer> {
    match options.mark {
        Some(mark) => Ok(mark),
        None => stage.dialogue.confirm(
            "A gyro counts 1 to 4 % too much or too little, and only your eyes can tell. Mark two \
             spins by a line on the floor?",
        ),
    }
}

/// A spin: at rest before and after.
#[derive(Debug, Clone, Copy)]
struct Spin {
    from: Standing,
    to: Standing,
    /// 1 anticlockwise, -1 clockwise.
    way: f64,
}

impl Spin {
    /// What the gyro says was turned, radians, anticlockwise; not a number without a gyro.
    fn gyro_rad(&self) -> f64 {
        self.from.turned_rad(&self.to)
    }
}

/// What the person says was turned.
fn marked_rad(spin: &Spin) -> f64 {
    spin.way * MARKED_TURNS * 2.0 * PI
}

/// The track width for which the wheels' angles make this turn, metres: `b = c (φr - φl) / (2π θ)`.
fn width_m(spin: &Spin, circumference_m: f64, turned_rad: f64) -> f64 {
    circumference_m * spin.from.apart_rad(&spin.to) / (2.0 * PI * turned_rad)
}

/// A spin, and what was heard meanwhile.
fn spin_by_gyro(stage: &mut Stage<'_>, way: f64) -> Result<(Spin, WholeTurns), CalibrateError> {
    let from = stage.rest()?;
    let wanted_rad = GYRO_TURNS * 2.0 * PI;
    let limit = limit(stage, wanted_rad, SPIN_RAD_S);
    let (track_m, circumference_m) =
        (stage.config().drive.track_width_m, stage.config().drive.wheel_circumference_m);
    let mut heard = WholeTurns::default();
    let mut is_astray = false;
    let ended = stage.drive(spinning(way * SPIN_RAD_S), limit, |now, senses| {
        let spin = Spin { from, to: *now, way };
        let turned_rad = way * spin.gyro_rad();
        if let Some(reading) = senses.get(Channel::Range) {
            heard.hear(turned_rad, reading.value);
        }
        // For this turn the wheels would be as far apart as the file says.
        is_astray = width_m(&spin, circumference_m, way * PI) >= track_m && turned_rad < ASTRAY_RAD;
        is_astray || turned_rad >= wanted_rad
    })?;
    let to = stage.rest()?;
    let spin = Spin { from, to, way };
    if ended == Ended::Limit || is_astray {
        if way * spin.gyro_rad() < -ASTRAY_RAD {
            return Err(CalibrateError::Exchanged(
                "the gyro turns the other way than the wheels, or is upside down",
            ));
        }
        let wheels_rad = width_m(&spin, circumference_m, track_m);
        return Err(CalibrateError::TooFar(format!(
            "the wheels say {:.0} degrees, the gyro {:.0}: are the wheels on the floor, is the \
             gyro fixed to the robot, flat, and are its port and the wheels' `inverted` right in \
             robot.toml?",
            degrees(wheels_rad),
            degrees(spin.gyro_rad())
        )));
    }
    Ok((spin, heard))
}

/// A spin that a person marks.
fn marked_spin(stage: &mut Stage<'_>, way: f64) -> Result<Spin, CalibrateError> {
    let side = if way > 0.0 { "left" } else { "right" };
    stage.dialogue.agree(&format!(
        "Put the robot exactly along a line on the floor. It will spin {MARKED_TURNS} whole turns \
         to the {side}, slowly at the end: press Enter when it stands along the line again. Ready?"
    ))?;
    let from = stage.rest()?;
    let marked_rad = MARKED_TURNS * 2.0 * PI;
    turn(stage, way * SPIN_RAD_S, FAST_SHARE * marked_rad)?;
    stage.dialogue.say("Now slowly: press Enter when it stands along the line.");
    // Both parts together are one and a half times the way, and no more.
    let slow = limit(stage, (SLACK - FAST_SHARE) * marked_rad / SLACK, CREEP_RAD_S);
    if stage.drive_until_pressed(spinning(way * CREEP_RAD_S), slow)? == Ended::Limit {
        return Err(CalibrateError::TooFar(
            "Enter was not pressed within one and a half times the way: start again and watch \
             the line"
                .to_owned(),
        ));
    }
    align(stage, way)?;
    Ok(Spin { from, to: stage.rest()?, way })
}

/// Step by step to the line, because no person presses a button at the exact moment.
fn align(stage: &mut Stage<'_>, way: f64) -> Result<(), CalibrateError> {
    for _ in 0..STEPS {
        let answers =
            ["yes, exactly", "it must turn a little further", "it must turn back a little"];
        match stage.dialogue.choose("Does it stand along the line?", &answers, 0)? {
            0 => return Ok(()),
            1 => turn(stage, way * CREEP_RAD_S, STEP_RAD)?,
            _ => turn(stage, -way * CREEP_RAD_S, STEP_RAD)?,
        };
    }
    Err(NoAnswer::Unclear.into())
}

/// Turns by an angle, by the wheels and the file's numbers.
pub(super) fn turn(
    stage: &mut Stage<'_>,
    turn_rad_s: f64,
    angle_rad: f64,
) -> Result<Ended, CalibrateError> {
    turn_to(stage, None, turn_rad_s.abs(), angle_rad * turn_rad_s.signum(), |_, _| ())
}

/// Turns to an angle from where the robot stood, or stands, radians, anticlockwise. `hear` has the
/// angle at each look, and what the robot senses there.
pub(super) fn turn_to(
    stage: &mut Stage<'_>,
    from: Option<&Standing>,
    speed_rad_s: f64,
    to_rad: f64,
    mut hear: impl FnMut(f64, &Senses),
) -> Result<Ended, CalibrateError> {
    let here = stage.rest()?;
    let from = from.unwrap_or(&here);
    let per_rad = 1.0 / (2.0 * wheel_rad_per_rad(stage));
    let angle_rad = to_rad - from.apart_rad(&here) * per_rad;
    let way = angle_rad.signum();
    let limit = limit(stage, angle_rad.abs(), speed_rad_s);
    stage.drive(spinning(way * speed_rad_s), limit, |now, senses| {
        let at_rad = from.apart_rad(now) * per_rad;
        hear(at_rad, senses);
        way * (at_rad - to_rad) >= 0.0
    })
}

fn spinning(turn_rad_s: f64) -> Drive {
    Drive::Twist { forward_m_s: 0.0, turn_rad_s }
}

/// By the file's numbers, what a wheel turns while the robot turns on the spot.
fn wheel_rad_per_rad(stage: &Stage<'_>) -> f64 {
    PI * stage.config().drive.track_width_m / stage.config().drive.wheel_circumference_m
}

fn limit(stage: &Stage<'_>, angle_rad: f64, speed_rad_s: f64) -> Limit {
    let wheel_rad_per_rad = wheel_rad_per_rad(stage);
    // A low limit of max_dps makes it slower than asked.
    let speed_rad_s = speed_rad_s.min(stage.config().drive.max_wheel_rad_s / wheel_rad_per_rad);
    let angle_rad = angle_rad * SLACK + radians(5.0);
    Limit { wheel_rad: angle_rad * wheel_rad_per_rad, time_s: 2.0 + 2.0 * angle_rad / speed_rad_s }
}
