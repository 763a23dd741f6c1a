//! Before anything moves: is the robot there, does it stand still, is the battery good?
//!
//! Roles and sensor modes have been seen to when the robot was bound. What is left is to watch for a moment: every reading has come,
//! wheels and gyro stand still, and the gyro does not drift. A gyro that was moved while it started drifts for the whole session
//! (`ev3dev-interfaces`, 6.4), and only unplugging it helps.

use crate::clock::{Clock, MILLISECOND_NS, SECOND_NS};
use crate::ev3dev::DeviceError;
use crate::robot::{Channel, Robot, Senses};

use super::StopFlags;

/// How long everything must have stood still, nanoseconds.
const STILL_NS: i64 = SECOND_NS;

/// How long we wait for it, nanoseconds.
const PATIENCE_NS: i64 = 10 * SECOND_NS;

/// How often we look, nanoseconds.
const LOOK_NS: i64 = 20 * MILLISECOND_NS;

/// A gyro at rest may flicker between two neighbouring degrees.
pub(super) const GYRO_STILL_RAD: f64 = 0.0175 * 1.5;

/// A wheel at rest may stand on the edge between two counts.
const WHEEL_STILL_RAD: f64 = 0.0175 * 1.5;

/// No cells that fit into a brick give more, volts: above, the reading is wrong.
pub(super) const MOST_V: f64 = 10.0;

/// What a person is told before the gyro itself is blamed.
const KEEP_STILL: &str = "the gyro turns although the wheels stand: keep the robot still";

/// Why a run did not start; each says what to do.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NotReady {
    /// A sensor or motor gave no reading.
    #[error("no reading from the {0}{because}: unplug it, plug it in again, and wait three seconds", because = because(.1.as_ref()))]
    NoReading(Channel, Option<DeviceError>),
    /// The battery's voltage cannot be read.
    #[error("no reading from the battery{because}: wait ten seconds after switching on, and try again", because = because(.0.as_ref()))]
    NoVoltage(Option<DeviceError>),
    /// The robot did not stand still.
    #[error(
        "the robot does not stand still (the {0} moves): put it down and keep your hands off until it starts"
    )]
    Moving(Channel),
    /// The gyro turns although the wheels stand.
    #[error(
        "the gyro drifts ({0:.0} degrees in a second): unplug it, hold the robot still, and plug it in again"
    )]
    GyroDrifts(f64),
    /// The battery is flat, or its reading is nonsense.
    #[error(
        "the battery has {volts:.1} V: charge it, or put in fresh cells (it takes {least_v} to {MOST_V} V)"
    )]
    Battery {
        /// What was read, volts.
        volts: f64,
        /// The robot's [`slow_v`](crate::robot::BatteryLimits): a run that began below it would not get far.
        least_v: f64,
    },
    /// Somebody asked to stop.
    #[error("stopped before it started")]
    Stopped,
}

fn because(error: Option<&DeviceError>) -> String {
    error.map(|error| format!(" ({error})")).unwrap_or_default()
}

/// Waits until what the sensors say is no longer of their former mode, then watches until the robot has stood still for a second.
/// `say` is told what is being waited for, once each.
///
/// # Errors
///
/// The first thing that is not in order, after ten seconds of patience where a person can still do something about it.
pub fn prepare(
    robot: &mut Robot,
    clock: &dyn Clock,
    flags: &StopFlags,
    mut say: impl FnMut(&str),
) -> Result<(), NotReady> {
    let start_ns = clock.now_ns();
    let mut senses = Senses::default();
    let mut still_since: Option<(i64, Senses)> = None;
    let mut drifting = 0;
    let mut said: Option<String> = None;
    loop {
        let now_ns = clock.now_ns();
        if flags.is_raised() {
            return Err(NotReady::Stopped);
        }
        senses.time_ns = now_ns - start_ns;
        if robot.sense(&mut senses) {
            return Err(NotReady::Stopped);
        }
        if senses.time_ns < robot.settle_ns() {
            clock.sleep_until_ns(now_ns + LOOK_NS);
            continue;
        }
        let patient = senses.time_ns < PATIENCE_NS + robot.settle_ns();
        match unready(robot, &senses, still_since.as_ref().map(|(_, senses)| senses)) {
            None => match still_since {
                Some((since_ns, _)) if senses.time_ns - since_ns >= STILL_NS => return Ok(()),
                Some(_) => {}
                None => still_since = Some((senses.time_ns, senses)),
            },
            Some(why @ NotReady::Battery { .. }) => return Err(why),
            Some(why) => {
                drifting = if matches!(why, NotReady::GyroDrifts(_)) { drifting + 1 } else { 0 };
                // A hand may have turned the robot once; a gyro that does it three times in a row drifts.
                if !patient || drifting > 2 {
                    return Err(why);
                }
                let now = match why {
                    NotReady::GyroDrifts(_) => KEEP_STILL.to_owned(),
                    why => why.to_string(),
                };
                if said.as_ref() != Some(&now) {
                    say(&now);
                }
                said = Some(now);
                still_since = None;
            }
        }
        clock.sleep_until_ns(now_ns + LOOK_NS);
    }
}

/// What is not in order, compared with the moment from which on everything stood still.
fn unready(robot: &Robot, senses: &Senses, since: Option<&Senses>) -> Option<NotReady> {
    let missing = |channel: &Channel| senses.get(*channel).is_none();
    // Of several that are missing, one whose trouble is known tells more.
    let troubled = robot.channels().filter(missing).find(|&channel| robot.trouble_with(channel).is_some());
    if let Some(missing) = troubled.or_else(|| robot.channels().find(missing)) {
        let error = robot.trouble_with(missing).cloned();
        return Some(match missing {
            Channel::Battery => NotReady::NoVoltage(error),
            missing => NotReady::NoReading(missing, error),
        });
    }
    let least_v = robot.config().battery.limits().slow_v;
    if let Some(battery) = senses.get(Channel::Battery)
        && !(least_v..=MOST_V).contains(&battery.value)
    {
        return Some(NotReady::Battery { volts: battery.value, least_v });
    }
    let since = since?;
    let moved = |channel| Some((senses.get(channel)?.value - since.get(channel)?.value).abs());
    for wheel in [Channel::Left, Channel::Right] {
        if moved(wheel).is_some_and(|moved_rad| moved_rad > WHEEL_STILL_RAD) {
            return Some(NotReady::Moving(wheel));
        }
    }
    let turned_rad = moved(Channel::Gyro).filter(|&turned_rad| turned_rad > GYRO_STILL_RAD)?;
    Some(NotReady::GyroDrifts(crate::units::degrees(turned_rad)))
}
