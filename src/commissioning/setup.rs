//! Setting up a robot: from what is plugged in and what a person sees to a `robot.toml`.
//!
//! [`setup`] looks at what is plugged in, turns each motor a little and asks what moved, gives each
//! sensor the role that its kind has, asks for the measures, and returns the text of the file,
//! which the caller writes ([`crate::document::save`]).
//!
//! # Not here
//!
//! Measuring: `calibrate` does that by driving. The hardware lock: who calls holds it.
//!
//! # What we count on
//!
//! - A motor turns for half a second at a time, as a lease, only after it was announced, and never
//!   while a question is open.
//! - On every way out the motors are stopped: they stop when they are dropped, and their leases end
//!   after 0.3 s.

use std::sync::Arc;

use crate::clock::{Clock, MILLISECOND_NS};
use crate::document::Findings;
use crate::ev3dev::{
    Class, DeviceError, FindError, Identity, Platform, StopAction, TachoMotor, Tree, devices,
};
use crate::mapping::{Geometry, RangeMount};
use crate::robot::{LeasedMotor, NOT_TURNED, RobotConfig, is_name, is_own_name};

use super::dialogue::parsed;
use super::{Dialogue, NoAnswer};
use crate::runtime::StopFlags;
use crate::senses::Role;

mod sensors;
mod text;

pub use text::{Draft, DraftHead, DraftMotor};

/// How fast a motor is turned for the person to see, radians per second at its shaft: 120 degrees a
/// second.
const LOOK_RAD_S: f64 = 2.1;

/// For how long, nanoseconds: a wheel of 6 cm then rolls 3 cm.
const LOOK_NS: i64 = 500 * MILLISECOND_NS;

/// How often the lease is looked after meanwhile, nanoseconds.
const TICK_NS: i64 = 20 * MILLISECOND_NS;

/// A motor that turned less than this in its half second is blocked, or turns nothing, radians.
const TURNED_RAD: f64 = 0.2;

/// Why there is no file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SetupError {
    /// There are not enough motors: plug them in.
    #[error(
        "a robot needs two motors with a position for its wheels; {found} plugged in: plug the \
         wheels' motors in, wait a second, and look at onbrick devices"
    )]
    TooFewMotors {
        /// How many there are, in words.
        found: &'static str,
    },
    /// The person named no motor for a wheel.
    #[error("no motor was named as the {0} wheel's: a robot needs both; start again")]
    NoWheel(&'static str),
    /// There was no answer.
    #[error(transparent)]
    NoAnswer(#[from] NoAnswer),
    /// The person asked to stop.
    #[error("stopped; nothing was written")]
    Stopped,
    /// The devices cannot be listed, or not be bound.
    #[error("cannot look at the devices")]
    Find(#[from] FindError),
    /// A motor does not do what it is told.
    #[error("a motor does not do what it is told")]
    Device(#[from] DeviceError),
    /// The answers do not make a robot.
    #[error(transparent)]
    Findings(#[from] Findings),
}

/// What a person says a motor turns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum MotorUse {
    Left,
    Right,
    Head,
    Other,
    Again,
    Nothing,
}

/// All of them, as a person is asked.
const USES: [(MotorUse, &str); 6] = [
    (MotorUse::Left, "the left wheel"),
    (MotorUse::Right, "the right wheel"),
    (MotorUse::Head, "the head that carries the range sensor"),
    (MotorUse::Other, "something else"),
    (MotorUse::Again, "I did not see it: once more"),
    (MotorUse::Nothing, "nothing that matters: leave this motor out"),
];

/// Asks until a robot is described, and gives the text of its `robot.toml`, which loads without
/// findings.
///
/// # Errors
///
/// [`SetupError`]; whatever it is, every motor is stopped and nothing was written.
pub fn setup(
    tree: &Arc<dyn Tree>,
    clock: &dyn Clock,
    flags: &StopFlags,
    dialogue: &mut dyn Dialogue,
) -> Result<String, SetupError> {
    let platform = Platform::of(tree);
    let (linear, motors): (Vec<_>, Vec<_>) =
        motors(tree)?.into_iter().partition(Identity::is_linear);
    if !platform.detects {
        sensors::declare(tree, platform, clock, dialogue)?;
    }
    let sensors = devices(tree, Class::LegoSensor)?;
    introduce(dialogue, &motors, &sensors);
    for Identity { address, driver, .. } in linear {
        let short = address.short();
        dialogue.say(&format!("  {short:<6} {driver}, a linear actuator: {NOT_TURNED}"));
    }
    if motors.len() < 2 {
        let found = if motors.is_empty() { "none is" } else { "one is" };
        return Err(SetupError::TooFewMotors { found });
    }
    let mut draft = Draft { name: name(dialogue)?, ..Draft::default() };
    dialogue.agree(
        "Each motor will now turn for half a second. Put the robot on the floor with a hand's \
         width of space around it, or hold it up. Is it ready?",
    )?;
    for identity in motors {
        let mut look = Look { tree, clock, flags, dialogue: &mut *dialogue };
        look.motor(identity, &mut draft)?;
    }
    let [left, right] = [("left", draft.left.is_none()), ("right", draft.right.is_none())];
    if let Some((side, _)) = [left, right].into_iter().find(|(_, missing)| *missing) {
        return Err(SetupError::NoWheel(side));
    }
    sensors::assign(dialogue, &sensors, &mut draft)?;
    if platform.buttons.is_none() {
        sensors::stop_button(dialogue, platform, &mut draft)?;
    }
    measures(dialogue, &mut draft)?;
    let text = draft.to_toml();
    RobotConfig::load("robot.toml", text.as_bytes())?;
    Ok(text)
}

/// Motors that say how far they are, large ones first: they are mostly the wheels.
fn motors(tree: &Arc<dyn Tree>) -> Result<Vec<Identity>, SetupError> {
    let mut motors = devices(tree, Class::TachoMotor)?;
    motors.sort_by_key(|identity| (!is_large(identity), identity.address.clone()));
    Ok(motors)
}

fn is_large(identity: &Identity) -> bool {
    matches!(identity.driver.as_str(), "lego-ev3-l-motor" | "lego-nxt-motor")
}

fn introduce(dialogue: &mut dyn Dialogue, motors: &[Identity], sensors: &[Identity]) {
    dialogue.say("Plugged in:");
    for identity in motors.iter().chain(sensors) {
        dialogue.say(&format!("  {:<6} {}", identity.address.short(), identity.driver));
    }
    if motors.is_empty() && sensors.is_empty() {
        dialogue.say("  nothing");
    }
}

fn name(dialogue: &mut dyn Dialogue) -> Result<String, NoAnswer> {
    parsed(dialogue, "What is the robot called?", "mapper", |name| {
        if !is_name(name) {
            return Err("a name has 1 to 64 letters on one line".to_owned());
        }
        Ok(name.to_owned())
    })
}

fn measures(dialogue: &mut dyn Dialogue, draft: &mut Draft) -> Result<(), NoAnswer> {
    if let Some((shipped, config)) = draft.shipped() {
        dialogue
            .say(&format!("Plugged in like this is {}; its measures are proposed.", shipped.what));
        draft.wheel_circumference_m = config.drive.wheel_circumference_m;
        draft.track_width_m = config.drive.track_width_m;
        draft.range_ahead_m = config.range.map_or(draft.range_ahead_m, |range| range.ahead_m);
    }
    dialogue.say(
        "Now the measures. A guess within a tenth is enough: onbrick calibrate measures them by \
         driving.",
    );
    draft.wheel_circumference_m = dialogue.number(
        "How far does the robot roll in one turn of a wheel, in metres (3.14 times the wheel's \
         diameter)?",
        draft.wheel_circumference_m,
        Geometry::WHEEL_CIRCUMFERENCE_M,
    )?;
    draft.track_width_m = dialogue.number(
        "How far are the two wheels apart, from middle to middle, in metres?",
        draft.track_width_m,
        Geometry::TRACK_WIDTH_M,
    )?;
    if draft.sensors.contains_key(&Role::Range) {
        draft.range_ahead_m = dialogue.number(
            "How far ahead of the middle between the wheels is the range sensor, in metres \
             (behind: negative)?",
            draft.range_ahead_m,
            RangeMount::AHEAD_M,
        )?;
    }
    Ok(())
}

/// Turning a motor and asking what it was.
struct Look<'l> {
    tree: &'l Arc<dyn Tree>,
    clock: &'l dyn Clock,
    flags: &'l StopFlags,
    dialogue: &'l mut dyn Dialogue,
}

impl Look<'_> {
    /// Turns a motor until the person has seen what it moves, and notes it.
    fn motor(&mut self, identity: Identity, draft: &mut Draft) -> Result<(), SetupError> {
        let port = identity.address.short().to_owned();
        let guess = if is_large(&identity) { MotorUse::Left } else { MotorUse::Head };
        let motor = TachoMotor::bind(self.tree, identity)?;
        // Everything here is in the shaft's own direction; the answers say which way that is.
        let mut motor = LeasedMotor::take(motor, 1.0, LOOK_RAD_S)?;
        loop {
            self.dialogue.say(&format!("The motor on {port} turns now."));
            let turned_rad = self.turn(&mut motor)?;
            if turned_rad < TURNED_RAD {
                self.dialogue.say(&format!(
                    "The motor on {port} did not turn: is something in its way, or is the \
                     battery flat?"
                ));
            }
            match self.part(&port, guess, draft)? {
                MotorUse::Again => continue,
                MotorUse::Nothing => {}
                MotorUse::Left => draft.left = Some(self.wheel(port)?),
                MotorUse::Right => draft.right = Some(self.wheel(port)?),
                MotorUse::Head => draft.head = Some(self.head(port)?),
                MotorUse::Other => {
                    let name = self.motor_name(draft)?;
                    draft.motors.push((name, port));
                }
            }
            return Ok(());
        }
    }

    /// Half a second of motion; how far the shaft came, radians.
    fn turn(&mut self, motor: &mut LeasedMotor) -> Result<f64, SetupError> {
        let before_rad = motor.angle_rad()?;
        let end_ns = self.clock.now_ns() + LOOK_NS;
        let turned = loop {
            let now_ns = self.clock.now_ns();
            if self.flags.is_raised() {
                break Err(SetupError::Stopped);
            }
            if now_ns >= end_ns {
                break Ok(());
            }
            if let Err(error) = motor.turn(LOOK_RAD_S, now_ns) {
                break Err(error.into());
            }
            self.clock.sleep_until_ns(now_ns + TICK_NS);
        };
        let stopped = motor.stop(StopAction::Brake);
        turned?;
        stopped?;
        Ok(motor.angle_rad()? - before_rad)
    }

    fn part(&mut self, port: &str, guess: MotorUse, draft: &Draft) -> Result<MotorUse, NoAnswer> {
        let is_left = |part: MotorUse| match part {
            MotorUse::Left => draft.left.is_none(),
            MotorUse::Right => draft.right.is_none(),
            MotorUse::Head => draft.head.is_none(),
            MotorUse::Other => draft.motors.len() < RobotConfig::MAX_MOTORS,
            MotorUse::Again | MotorUse::Nothing => true,
        };
        let (parts, words): (Vec<_>, Vec<_>) =
            USES.into_iter().filter(|(part, _)| is_left(*part)).unzip();
        // Where the guess is taken, the first that is left is the next best: left, then right.
        let default = parts.iter().position(|part| *part == guess).unwrap_or(0);
        let question = format!("What did the motor on {port} move?");
        let answer = self.dialogue.choose(&question, &words, default)?;
        Ok(parts.get(answer).copied().unwrap_or(MotorUse::Again))
    }

    fn wheel(&mut self, port: String) -> Result<DraftMotor, NoAnswer> {
        let ways = ["forwards: it would drive the robot ahead", "backwards"];
        let inverted = self.dialogue.choose("Which way did this wheel turn?", &ways, 0)? == 1;
        Ok(DraftMotor { port, inverted })
    }

    /// The gear's sign is what was seen, so a person need not think about how many wheels turn it
    /// round.
    fn head(&mut self, port: String) -> Result<DraftHead, NoAnswer> {
        let ways = ["to the right (clockwise, seen from above)", "to the left (anticlockwise)"];
        let clockwise = self.dialogue.choose("Which way did the head turn?", &ways, 0)? == 0;
        let [motor, head] = parsed(
            self.dialogue,
            "How many teeth have the gears, on the motor and on the head (1 1 without gears)?",
            "12 36",
            teeth,
        )?;
        Ok(DraftHead { port, gear: [if clockwise { -motor } else { motor }, head] })
    }

    fn motor_name(&mut self, draft: &Draft) -> Result<String, NoAnswer> {
        let taken: Vec<&str> = draft.motors.iter().map(|(name, _)| name.as_str()).collect();
        parsed(self.dialogue, "What shall missions call this motor?", "arm", |name| {
            if !is_own_name(name) {
                Err(format!(
                    "`{name}` is no name for a motor: a letter, then letters, digits and _"
                ))
            } else if taken.contains(&name) {
                Err(format!("there is a motor called {name} already: another name"))
            } else {
                Ok(name.to_owned())
            }
        })
    }
}

/// Two numbers of teeth, however they are written: `12 36`, `12:36`, `[12, 36]`.
fn teeth(text: &str) -> Result<[i32; 2], String> {
    let numbers: Vec<i32> = text
        .split(|letter: char| !letter.is_ascii_digit())
        .filter(|part| !part.is_empty())
        .filter_map(|part| part.parse().ok())
        .collect();
    match numbers.as_slice() {
        [motor, head] if (1..=1000).contains(motor) && (1..=1000).contains(head) => {
            Ok([*motor, *head])
        }
        _ => Err(format!("`{text}` is not two numbers of teeth, each 1 to 1000, such as 12 36")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn teeth_may_be_written_in_several_ways() {
        for text in ["12 36", "12:36", "[12, 36]", "12/36", " 12  36 "] {
            assert_eq!(teeth(text), Ok([12, 36]), "`{text}`");
        }
        for text in ["", "12", "0 36", "12 36 48", "twelve 36", "12 99999999999"] {
            assert!(teeth(text).is_err(), "`{text}`");
        }
    }
}
