//! Before anything moves: is the robot there, does it stand still, is the battery good?
//!
//! Roles and sensor modes have been seen to when the robot was bound. What is left is to watch for
//! a moment: every reading has come, wheels and gyro stand still, and the gyro does not drift. A
//! gyro that was moved while it started drifts for the whole session (`ev3dev-interfaces`, 6.4),
//! and only unplugging it helps. It says whole degrees, so a drift is seen once it has made one:
//! always where that takes less than `watch_s` of `robot.toml`, and not always where it takes
//! longer. On a brick the last three seconds are those in which it beeps.

use crate::clock::{Clock, MILLISECOND_NS, SECOND_NS, seconds};
use crate::ev3dev::DeviceError;
use crate::robot::Robot;
use crate::senses::{Channel, Senses};

use super::{StopFlags, StopReason};
use crate::units::degrees;

/// How long everything must have stood still, nanoseconds.
const STILL_NS: i64 = SECOND_NS;

/// How long people near are told that the robot is about to move, nanoseconds.
const ANNOUNCING_NS: i64 = 3 * SECOND_NS;

/// How long we wait for it, nanoseconds.
const PATIENCE_NS: i64 = 10 * SECOND_NS;

/// How often we look, nanoseconds.
const LOOK_NS: i64 = 20 * MILLISECOND_NS;

/// A gyro at rest may flicker between two neighbouring degrees.
pub const GYRO_STILL_RAD: f64 = 0.0175 * 1.5;

/// No hand turns a robot more slowly, degrees a second.
const SLOWEST_HAND_DPS: f64 = 1.0;

/// A wheel at rest may stand on the edge between two counts.
const WHEEL_STILL_RAD: f64 = 0.0175 * 1.5;

/// What a person is told before the gyro itself is blamed.
const KEEP_STILL: &str = "the gyro turns although the wheels stand: keep the robot still";

/// Why a run did not start; each says what to do.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NotReady {
    /// A sensor or motor gave no reading.
    #[error(
        "no reading from the {0}{because}: unplug it, plug it in again, and wait three seconds",
        because = because(.1.as_ref())
    )]
    NoReading(Channel, Option<DeviceError>),
    /// The battery's voltage cannot be read.
    #[error(
        "no reading from the battery{because}: wait ten seconds after switching on, and try again",
        because = because(.0.as_ref())
    )]
    NoVoltage(Option<DeviceError>),
    /// The robot did not stand still.
    #[error(
        "the robot does not stand still (the {0} moves): put it down and keep your hands off until \
         it starts"
    )]
    Moving(Channel),
    /// The gyro turns although the wheels stand.
    #[error(
        "the gyro drifts ({0:.2} degrees a second): unplug it, hold the robot still, and plug it \
         in again"
    )]
    GyroDrifts(f64),
    /// The battery is flat, or its reading is nonsense.
    #[error(
        "the battery has {volts:.1} V: charge it, or put in fresh cells (it takes {least_v:.1} \
         to {most_v} V)"
    )]
    Battery {
        /// What was read, volts.
        volts: f64,
        /// The robot's [`slow_v`](crate::robot::BatteryLimits): a run that began below it would not
        /// get far.
        least_v: f64,
        /// The most that the board takes.
        most_v: f64,
    },
    /// It was asked to stop, or a button was pressed.
    #[error("{0}, before it started")]
    Stopped(StopReason),
}

fn because(error: Option<&DeviceError>) -> String {
    error.map(|error| format!(" ({error})")).unwrap_or_default()
}

/// A robot that stands.
struct Standing {
    since_ns: i64,
    /// What was read then.
    senses: Senses,
    /// The smallest and the greatest angle of the gyro since, radians, and when it last was
    /// another.
    gyro_rad: Option<[f64; 2]>,
    gyro_ns: i64,
}

impl Standing {
    fn new(senses: Senses) -> Self {
        Self { since_ns: senses.time_ns, senses, gyro_rad: None, gyro_ns: senses.time_ns }
    }

    fn look(&mut self, senses: &Senses) {
        let Some(gyro) = senses.get(Channel::Gyro) else { return };
        let [least, most] = self.gyro_rad.unwrap_or([gyro.value; 2]);
        if gyro.value < least || gyro.value > most {
            self.gyro_ns = senses.time_ns;
        }
        self.gyro_rad = Some([least.min(gyro.value), most.max(gyro.value)]);
    }

    /// When it has stood for long enough, if nothing happens until then.
    ///
    /// - `watch_ns`: how long the gyro must have said no new degree.
    fn enough_ns(&self, watch_ns: i64, announce: bool) -> i64 {
        let announcing_ns = if announce { ANNOUNCING_NS } else { 0 };
        let still_ns = self.since_ns + STILL_NS + announcing_ns;
        if self.gyro_rad.is_some() { still_ns.max(self.gyro_ns + watch_ns) } else { still_ns }
    }
}

/// Waits until what the sensors say is no longer of their former mode, then watches until the robot
/// has stood still for a second, and its gyro for longer. `say` is told what is being waited for,
/// once each.
///
/// - `announce`: people are near, who are told by light and sound that the robot is about to move.
///
/// # Errors
///
/// The first thing that is not in order, after ten seconds of patience where a person can still do
/// something about it.
pub fn prepare(
    robot: &mut Robot,
    clock: &dyn Clock,
    flags: &StopFlags,
    announce: bool,
    say: impl FnMut(&str),
) -> Result<(), NotReady> {
    let ready = stand(robot, clock, flags, announce, say);
    robot.tone(None);
    // A run has a time of its own.
    robot.restart_time();
    ready
}

fn stand(
    robot: &mut Robot,
    clock: &dyn Clock,
    flags: &StopFlags,
    announce: bool,
    mut say: impl FnMut(&str),
) -> Result<(), NotReady> {
    let start_ns = clock.now_ns();
    let mut senses = Senses::default();
    let mut standing: Option<Standing> = None;
    let mut drifting = 0;
    let mut said: Option<String> = None;
    loop {
        let now_ns = clock.now_ns();
        if let Some(reason) = flags.reason() {
            return Err(NotReady::Stopped(reason));
        }
        senses.time_ns = now_ns - start_ns;
        if robot.sense(&mut senses) {
            return Err(NotReady::Stopped(StopReason::Button));
        }
        if senses.time_ns < robot.settle_ns() {
            clock.sleep_until_ns(now_ns + LOOK_NS);
            continue;
        }
        let patient = senses.time_ns < PATIENCE_NS + robot.settle_ns();
        match unready(robot, &senses, standing.as_ref()) {
            None => {
                let standing = standing.get_or_insert_with(|| Standing::new(senses));
                standing.look(&senses);
                let enough_ns = standing.enough_ns(robot.config().gyro_watch_ns, announce);
                if announce && senses.time_ns >= enough_ns - ANNOUNCING_NS {
                    robot.announce(senses.time_ns - (enough_ns - ANNOUNCING_NS));
                }
                if senses.time_ns >= enough_ns {
                    return Ok(());
                }
            }
            Some(why @ NotReady::Battery { .. }) => return Err(why),
            Some(why) => {
                robot.tone(None);
                drifting = if matches!(why, NotReady::GyroDrifts(_)) { drifting + 1 } else { 0 };
                let is_slow = matches!(why, NotReady::GyroDrifts(dps) if dps < SLOWEST_HAND_DPS);
                // A hand may have turned the robot once; a gyro that does it three times in a row
                // drifts, and one that creeps.
                if !patient || drifting > 2 || is_slow {
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
                standing = None;
            }
        }
        clock.sleep_until_ns(now_ns + LOOK_NS);
    }
}

/// What is not in order, compared with the moment from which on everything stood still.
fn unready(robot: &Robot, senses: &Senses, standing: Option<&Standing>) -> Option<NotReady> {
    let missing = |channel: &Channel| senses.get(*channel).is_none();
    // Of several that are missing, one whose trouble is known tells more.
    let troubled =
        robot.channels().filter(missing).find(|&channel| robot.trouble_with(channel).is_some());
    if let Some(missing) = troubled.or_else(|| robot.channels().find(missing)) {
        let error = robot.trouble_with(missing).cloned();
        return Some(match missing {
            Channel::Battery => NotReady::NoVoltage(error),
            missing => NotReady::NoReading(missing, error),
        });
    }
    let least_v = robot.config().battery.limits().slow_v;
    let most_v = robot.platform().most_v;
    if let Some(battery) = senses.get(Channel::Battery)
        && !(least_v..=most_v).contains(&battery.value)
    {
        return Some(NotReady::Battery { volts: battery.value, least_v, most_v });
    }
    let standing = standing?;
    let moved =
        |channel| Some((senses.get(channel)?.value - standing.senses.get(channel)?.value).abs());
    for wheel in Channel::WHEELS {
        if moved(wheel).is_some_and(|moved_rad| moved_rad > WHEEL_STILL_RAD) {
            return Some(NotReady::Moving(wheel));
        }
    }
    let turned_rad = moved(Channel::Gyro).filter(|&turned_rad| turned_rad > GYRO_STILL_RAD)?;
    let stood_s = seconds((senses.time_ns - standing.since_ns).max(LOOK_NS));
    Some(NotReady::GyroDrifts(degrees(turned_rad) / stood_s))
}
