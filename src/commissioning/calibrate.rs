//! Measuring a robot by driving it: how far a wheel rolls in a turn, and how wide its track is.
//!
//! In the manner of UMBmark (Borenstein and Feng, "Measurement and Correction of Systematic
//! Odometry Errors in Mobile Robots", IEEE Transactions on Robotics and Automation 12(6), 1996):
//! each motion is driven in both directions and several times, what differs between the directions
//! is told from what scatters, and the mean is taken of all.
//!
//! - **Wheel circumference**: driving at a wall, the range falls by what the wheels roll, `range =
//!   a - c φ / 2π`; each way between two ranges gives a slope by least squares. Or the robot drives
//!   about a metre and a person measures how far it came.
//! - **Track width**: spinning on the spot, the wheels roll `b θ / 2` each, one ahead and one back,
//!   so `b = c (φ_right - φ_left) / (2π θ)`, with θ from the gyro, or from a person who says when
//!   the robot stands along a line again.
//!
//! The track width goes by the circumference: what the heading needs is their ratio, and that is
//! what spinning measures.
//!
//! # Not here
//!
//! Wheels of unequal size (UMBmark's E_d): `robot.toml` has one circumference for both. Writing the
//! file: [`crate::document::save`]. The hardware lock: the caller holds it.
//!
//! # What we count on
//!
//! - Every motion is a lease, bounded in angle and in time; Ctrl-C and the brick's buttons stop it
//!   at once.
//! - The gyro's scale is off by 1 to 4 % from one sensor to the next, and nothing on the robot can
//!   see that: a turn that a person marks can.
//! - The wall is plain and square to the way; at 5 degrees off, the circumference comes out 0.4 %
//!   too small.

use std::sync::Arc;

use serde::Serialize;

use crate::clock::Clock;
use crate::document::Findings;
use crate::ev3dev::{Tree, UltrasonicSensor};
use crate::robot::{BindError, Robot, RobotConfig};
use crate::senses::{Channel, Role};

use super::{Dialogue, NoAnswer};
use crate::runtime::{NotReady, Source, StopFlags, prepare};

mod edit;
mod fit;
mod stage;
mod straight;
mod turns;

pub use edit::{EditError, set_numbers};
pub use fit::{Doubt, Measured};

use stage::Stage;

/// What to measure, and how.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibrateOptions {
    /// How to measure the wheels' circumference; `None` leaves it as it is.
    pub straight: Option<Straight>,
    /// Measure the track width.
    pub track: bool,
    /// Whether a person marks whole turns although there is a gyro, which removes the gyro's own
    /// error; `None` asks.
    pub mark: Option<bool>,
    /// How often each motion is driven in each direction; by default three times, and twice where a
    /// person measures.
    pub pairs: Option<u32>,
    /// Whole turns of a spin against the gyro.
    pub turns: f64,
}

impl Default for CalibrateOptions {
    fn default() -> Self {
        Self { straight: Some(Straight::Ask), track: true, mark: None, pairs: None, turns: 3.0 }
    }
}

/// How the circumference is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Straight {
    /// The person says which, where there is an ultrasonic sensor; otherwise by a measured metre.
    Ask,
    /// By driving at a wall.
    Wall,
    /// By driving about a metre that a person measures.
    Metre,
}

/// Why nothing was measured. Every motor is stopped.
#[derive(Debug, thiserror::Error)]
pub enum CalibrateError {
    /// A role has no device.
    #[error("the robot is not as its file says")]
    Bind(#[from] BindError),
    /// The robot is not ready.
    #[error("not ready")]
    NotReady(#[from] NotReady),
    /// There was no answer.
    #[error(transparent)]
    NoAnswer(#[from] NoAnswer),
    /// Ctrl-C, a signal, or a button on the brick.
    #[error("stopped; nothing was written")]
    Stopped,
    /// A device cannot be read any more.
    #[error("lost: {channel} ({trouble}); a plug may be loose")]
    Lost {
        /// Which.
        channel: Channel,
        /// What it answered last.
        trouble: String,
    },
    /// The wheels were told to turn and did not.
    #[error("a wheel does not turn: something is in its way, or the battery is flat")]
    Blocked,
    /// There is no wall, or no sensor to see it.
    #[error("{0}")]
    NoWall(String),
    /// A motion went on for longer than it should have.
    #[error("{0}")]
    TooFar(String),
}

/// What came out.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Calibration {
    /// Metres driven in one turn of a wheel.
    pub wheel_circumference_m: Option<Measured>,
    /// Metres between the wheels.
    pub track_width_m: Option<Measured>,
    /// What the gyro says for what was truly turned: 1.02 for one that counts 2 % too much. Only
    /// where turns were marked.
    pub gyro_scale: Option<f64>,
}

impl Calibration {
    /// All that was measured, with what `robot.toml` calls it.
    pub fn measured(&self) -> impl Iterator<Item = (&'static str, &Measured)> {
        [
            ("drive.wheel_circumference_m", self.wheel_circumference_m.as_ref()),
            ("drive.track_width_m", self.track_width_m.as_ref()),
        ]
        .into_iter()
        .filter_map(|(key, measured)| Some((key, measured?)))
    }

    /// The robot's file with the new numbers in their places; everything else in it stays as it is.
    ///
    /// # Errors
    ///
    /// [`ApplyError::Unsure`] where one of the numbers is in doubt: nothing is written then, not
    /// even the other.
    pub fn apply(&self, robot: &Source) -> Result<String, ApplyError> {
        if let Some((key, doubt)) =
            self.measured().find_map(|(key, found)| Some((key, found.doubt?)))
        {
            return Err(ApplyError::Unsure { key, doubt });
        }
        let numbers: Vec<(&str, f64)> =
            self.measured().map(|(key, found)| (key, found.after)).collect();
        let text = set_numbers(robot, &numbers)?;
        RobotConfig::load(&robot.name, text.as_bytes()).map_err(ApplyError::Findings)?;
        Ok(text)
    }
}

/// Why the numbers do not go into the file.
#[derive(Debug, thiserror::Error)]
pub enum ApplyError {
    /// The measurement is not good enough.
    #[error("{key} is not written: {doubt}")]
    Unsure {
        /// Which number.
        key: &'static str,
        /// Why.
        doubt: Doubt,
    },
    /// The file has no place for a number.
    #[error(transparent)]
    Edit(#[from] EditError),
    /// The file would not be in order with them.
    #[error("{0}")]
    Findings(Findings),
}

/// Drives and measures. The circumference comes first, because the track width goes by it.
///
/// # Errors
///
/// [`CalibrateError`]; on every way out the motors are stopped.
pub fn calibrate(
    tree: &Arc<dyn Tree>,
    clock: &dyn Clock,
    flags: &StopFlags,
    dialogue: &mut dyn Dialogue,
    config: &RobotConfig,
    options: &CalibrateOptions,
) -> Result<Calibration, CalibrateError> {
    let mut robot = Robot::bind(tree, config, &[])?;
    clock.sleep_until_ns(clock.now_ns() + robot.settle_ns());
    prepare(&mut robot, clock, flags, false, |why| dialogue.say(why))?;
    let mut stage = Stage::new(robot, tree, clock, flags);
    let mut calibration = Calibration::default();
    let mut circumference_m = config.wheel_circumference_m;
    let straight =
        options.straight.map(|how| how_straight(tree, config, dialogue, how)).transpose()?;
    if let Some(straight) = straight {
        let measured = match straight {
            Straight::Wall => straight::by_wall(&mut stage, dialogue, options.pairs)?,
            Straight::Ask | Straight::Metre => {
                straight::by_metre(&mut stage, dialogue, options.pairs)?
            }
        };
        if measured.doubt.is_none() {
            circumference_m = measured.after;
        }
        tell(dialogue, "wheel circumference", &measured);
        calibration.wheel_circumference_m = Some(measured);
    }
    if options.track {
        let (measured, gyro_scale) =
            turns::track_width(&mut stage, dialogue, options, circumference_m)?;
        tell(dialogue, "track width", &measured);
        calibration.track_width_m = Some(measured);
        calibration.gyro_scale = gyro_scale;
    }
    Ok(calibration)
}

/// By wall only where there is an ultrasonic sensor: the infrared one measures no metres.
fn how_straight(
    tree: &Arc<dyn Tree>,
    config: &RobotConfig,
    dialogue: &mut dyn Dialogue,
    how: Straight,
) -> Result<Straight, CalibrateError> {
    let sees_metres = config
        .sensors
        .get(&Role::Range)
        .is_some_and(|port| UltrasonicSensor::find(tree, port.as_ref()).is_ok());
    match how {
        Straight::Wall if !sees_metres => Err(CalibrateError::NoWall(
            "driving at a wall needs an ultrasonic sensor in the role [range]: measure a \
             metre instead"
                .to_owned(),
        )),
        Straight::Ask if sees_metres => {
            let ways = ["by driving at a plain wall", "by driving a metre that I measure"];
            let answer =
                dialogue.choose("How shall the wheel circumference be measured?", &ways, 0)?;
            Ok(if answer == 0 { Straight::Wall } else { Straight::Metre })
        }
        Straight::Ask => Ok(Straight::Metre),
        how => Ok(how),
    }
}

fn tell(dialogue: &mut dyn Dialogue, what: &str, measured: &Measured) {
    dialogue.say(&format!("{what}: {measured}"));
    if let Some(doubt) = measured.doubt {
        dialogue.say(&format!("  this is not sure enough: {doubt}"));
    }
}
