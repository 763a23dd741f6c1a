//! Measuring a robot by driving it: how far a wheel rolls in a turn, how wide its track is, what
//! its range sensor reads too far, and where that sensor hears the robot itself.
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
//! - **Gyro scale**: what the gyro says for a whole turn, which the range sensor tells, as it hears
//!   the same again (`mapping::whole_turn`), or a person who marks turns.
//! - **Range**: before a wall whose distance a person has measured, `reading = bias + scale ·
//!   distance`, with the distance from the wheels' way.
//! - **Own echoes**: readings that stay at an angle of the head while the robot turns.
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
//! - The gyro's scale is off by 1 to 4 % from one sensor to the next. Where all around is far away
//!   or alike, no sensor can see that: a turn that a person marks can. It is measured with the
//!   track width, and written.
//! - The wall is plain. The robot turns square to it by what the range sensor hears to both sides;
//!   at 5 degrees off, the circumference comes out 0.4 % too small.

use std::sync::Arc;

use serde::Serialize;

use crate::clock::Clock;
use crate::document::Findings;
use crate::ev3dev::{Tree, UltrasonicSensor};
use crate::mapping::Geometry;
use crate::robot::{BindError, Robot, RobotConfig, equip};
use crate::senses::{Channel, Role};
use crate::units::rounded_to;

use super::{Dialogue, NoAnswer};
use crate::runtime::{NotReady, Source, StopFlags, prepare};

mod edit;
mod fit;
mod range;
mod stage;
mod straight;
mod turns;

pub use edit::{EditError, set_values};
pub use fit::{Doubt, Kind, Measured};

use stage::Stage;

/// What to measure, and how.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibrateOptions {
    /// How to measure the wheels' circumference; `None` leaves it as it is.
    pub straight: Option<Straight>,
    /// Measure the track width.
    pub track: bool,
    /// Measure bias and scale of the range sensor.
    pub range: bool,
    /// Look for the range sensor's echoes of the robot itself.
    pub own_echoes: bool,
    /// Whether a person marks whole turns although there is a gyro, which removes the gyro's own
    /// error; `None` asks where the range sensor cannot tell that error.
    pub mark: Option<bool>,
    /// How often each motion is driven in each direction; by default three times, and twice where a
    /// person measures.
    pub pairs: Option<u32>,
}

impl CalibrateOptions {
    /// Measures nothing.
    pub const NOTHING: Self = Self {
        straight: None,
        track: false,
        range: false,
        own_echoes: false,
        mark: None,
        pairs: None,
    };
}

impl Default for CalibrateOptions {
    fn default() -> Self {
        Self { straight: Some(Straight::Ask), track: true, ..Self::NOTHING }
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
#[non_exhaustive]
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
    /// The wall was there, and is not to be seen any more.
    #[error(
        "the wall is lost from sight: a plain, hard wall, square to the robot's way, and nothing \
         in between"
    )]
    WallLost,
    /// Turns are not to be marked, and nothing else measures them.
    #[error("without marks the gyro measures the turns, and the robot has no [gyro]")]
    NoGyro,
    /// Nothing hears echoes.
    #[error("own echoes are heard by the range sensor, and the robot has no [range]")]
    NoRange,
    /// Nothing turns the range sensor.
    #[error("own echoes are looked for with the head, and the robot has no [head]")]
    NoHead,
    /// Something is near the robot on all sides.
    #[error("something is near the robot all round: put it where nothing is within {at_m} m")]
    NoRoom {
        /// How much room it takes, metres.
        at_m: f64,
    },
    /// The robot does not move as its wheels were told to.
    #[error(
        "{0}: the left and right wheel's plugs may be exchanged, or a wheel's `inverted` wrong in \
         robot.toml"
    )]
    Exchanged(&'static str),
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
    /// What the gyro says for a degree that is turned: 1.02 for one that counts 2 % too much. Only
    /// where the range sensor or marks told whole turns.
    pub gyro_scale: Option<f64>,
    /// What the range sensor reads too far, metres.
    pub range_bias_m: Option<Measured>,
    /// What it says for each metre more, metres.
    pub range_scale: Option<Measured>,
    /// Where it hears the robot itself: angles of the head from and to, degrees, and metres.
    pub own_echoes: Option<Vec<[f64; 3]>>,
}

impl Calibration {
    /// All that was measured, with what `robot.toml` calls it.
    pub fn measured(&self) -> impl Iterator<Item = (&'static str, &Measured)> {
        [
            ("drive.wheel_circumference_m", self.wheel_circumference_m.as_ref()),
            ("drive.track_width_m", self.track_width_m.as_ref()),
            ("range.bias_m", self.range_bias_m.as_ref()),
            ("range.scale", self.range_scale.as_ref()),
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
        if let Some(scale) = self.gyro_scale.filter(|scale| !Geometry::GYRO_SCALE.contains(scale)) {
            return Err(ApplyError::Unsure { key: "gyro.scale", doubt: Doubt::Marks(scale) });
        }
        let numbers = self.measured().map(|(key, found)| (key, edit::rounded(found.after)));
        let list = self.own_echoes.iter().map(|own| ("range.own_echoes", list_of(own)));
        let scale = self.gyro_scale.map(|scale| ("gyro.scale", edit::rounded(scale)));
        let values: Vec<(&str, String)> = numbers.chain(scale).chain(list).collect();
        let text = set_values(robot, &values)?;
        RobotConfig::load(&robot.name, text.as_bytes())?;
        Ok(text)
    }
}

/// Why the numbers do not go into the file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
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
    #[error(transparent)]
    Findings(#[from] Findings),
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
    equip(tree, config, clock)?;
    let mut robot = Robot::bind(tree, config, &[])?;
    dialogue.say("Getting ready: leave the robot still.");
    clock.sleep_ns(robot.settle_ns());
    prepare(&mut robot, clock, flags, false, |why| dialogue.say(why))?;
    let mut stage = Stage::new(robot, tree, clock, flags, dialogue);
    let mut calibration = Calibration::default();
    let mut circumference_m = config.drive.wheel_circumference_m;
    let straight =
        options.straight.map(|how| how_straight(tree, config, stage.dialogue, how)).transpose()?;
    if let Some(straight) = straight {
        let measured = match straight {
            Straight::Wall => straight::by_wall(&mut stage, options.pairs)?,
            Straight::Ask | Straight::Metre => straight::by_metre(&mut stage, options.pairs)?,
        };
        if measured.doubt.is_none() {
            circumference_m = measured.after;
        }
        tell(stage.dialogue, "wheel circumference", &measured);
        calibration.wheel_circumference_m = Some(measured);
    }
    if options.track {
        let (measured, gyro_scale) = turns::track_width(&mut stage, options, circumference_m)?;
        tell(stage.dialogue, "track width", &measured);
        calibration.track_width_m = Some(measured);
        calibration.gyro_scale = gyro_scale;
    }
    if options.range {
        if !sees_metres(tree, config) {
            return Err(CalibrateError::NoWall(
                "bias and scale are those of an ultrasonic sensor in the role [range]".to_owned(),
            ));
        }
        let [bias, scale] = range::bias_and_scale(&mut stage, options.pairs)?;
        tell(stage.dialogue, "range bias", &bias);
        tell(stage.dialogue, "range scale", &scale);
        calibration.range_bias_m = Some(bias);
        calibration.range_scale = Some(scale);
    }
    if options.own_echoes {
        calibration.own_echoes = Some(range::own_echoes(&mut stage)?);
    }
    Ok(calibration)
}

/// A list of places as TOML.
fn list_of(own: &[[f64; 3]]) -> String {
    let place = |[from_deg, to_deg, range_m]: &[f64; 3]| {
        format!("[{from_deg:.0}, {to_deg:.0}, {}]", edit::rounded(rounded_to(*range_m, 1000.0)))
    };
    format!("[{}]", own.iter().map(place).collect::<Vec<_>>().join(", "))
}

/// The infrared sensor measures no metres.
fn sees_metres(tree: &Arc<dyn Tree>, config: &RobotConfig) -> bool {
    let port = config.sensors.get(&Role::Range);
    port.is_some_and(|port| UltrasonicSensor::find(tree, port.as_ref()).is_ok())
}

/// By wall only where there is an ultrasonic sensor.
fn how_straight(
    tree: &Arc<dyn Tree>,
    config: &RobotConfig,
    dialogue: &mut dyn Dialogue,
    how: Straight,
) -> Result<Straight, CalibrateError> {
    let sees_metres = sees_metres(tree, config);
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
