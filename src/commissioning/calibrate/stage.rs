//! The robot while it is measured: motions that end by themselves, and standing still in between.

use std::sync::Arc;

use crate::behavior::{Demands, Drive};
use crate::clock::{Clock, MILLISECOND_NS, SECOND_NS, nanoseconds};
use crate::commissioning::Dialogue;
use crate::ev3dev::{Button, Buttons, Platform, StopAction, Tree};
use crate::robot::{Robot, RobotConfig};
use crate::runtime::StopFlags;
use crate::senses::{Channel, Role, Senses};

use super::CalibrateError;

/// How often the robot is looked at, nanoseconds: leases are renewed in time, and each echo is seen
/// once.
const LOOK_NS: i64 = 20 * MILLISECOND_NS;

/// For how long everything must have stood still before it is read, nanoseconds: the gyro's filter
/// has settled by then.
const STILL_NS: i64 = SECOND_NS / 2;

/// How long we wait for that, nanoseconds.
const PATIENCE_NS: i64 = 5 * SECOND_NS;

/// Wheels that were told to turn and have not for so long are blocked, nanoseconds.
const BLOCKED_NS: i64 = SECOND_NS;

/// What counts as having turned, radians: three counts of the motor.
const TURNED_RAD: f64 = 0.05;

/// No slip and no drift turns a robot so far where it was not told to, radians.
pub(super) const ASTRAY_RAD: f64 = std::f64::consts::FRAC_PI_4;

/// How near the head comes to where it is to look, radians.
const LOOK_RAD: f64 = 0.035;

/// The range sensor has a new reading after this, nanoseconds: two of its periods.
const READ_NS: i64 = 220 * MILLISECOND_NS;

/// The robot, ready to be measured, and the person beside it. Dropping it stops its motors.
pub(super) struct Stage<'s> {
    robot: Robot,
    pub(super) dialogue: &'s mut dyn Dialogue,
    /// Ours besides the robot's own, because only here Enter may mean something else than stop.
    buttons: Option<Buttons>,
    clock: &'s dyn Clock,
    flags: &'s StopFlags,
    start_ns: i64,
    senses: Senses,
    marking: bool,
    entered: bool,
}

/// The robot at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Standing {
    /// Angle of the left wheel, radians.
    pub(super) left_rad: f64,
    /// Angle of the right wheel, radians.
    pub(super) right_rad: f64,
    /// Heading of the gyro, radians; `None` where there is no gyro.
    pub(super) gyro_rad: Option<f64>,
}

/// How a motion ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ended {
    /// What it was to reach is reached.
    Reached,
    /// It went as far, or as long, as it may.
    Limit,
}

/// How far and how long a motion may go at most.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Limit {
    /// Radians of a wheel, the mean of both.
    pub(super) wheel_rad: f64,
    /// Seconds.
    pub(super) time_s: f64,
}

impl<'s> Stage<'s> {
    pub(super) fn new(
        robot: Robot,
        tree: &Arc<dyn Tree>,
        clock: &'s dyn Clock,
        flags: &'s StopFlags,
        dialogue: &'s mut dyn Dialogue,
    ) -> Self {
        let buttons = Buttons::open(tree, Platform::of(tree)).ok();
        let (start_ns, senses) = (clock.now_ns(), Senses::default());
        Self {
            robot,
            dialogue,
            buttons,
            clock,
            flags,
            start_ns,
            senses,
            marking: false,
            entered: false,
        }
    }

    pub(super) fn config(&self) -> &RobotConfig {
        self.robot.config()
    }

    pub(super) fn has_gyro(&self) -> bool {
        self.config().has(Role::Gyro)
    }

    /// Drives until `done`, or to the limit, and brakes. `done` sees every look at the robot: where
    /// wheels and gyro are, and all readings.
    ///
    /// # Errors
    ///
    /// Stopped by a person, lost a sensor, blocked wheels; the motors have been told to stop by
    /// then.
    pub(super) fn drive(
        &mut self,
        drive: Drive,
        limit: Limit,
        mut done: impl FnMut(&Standing, &Senses) -> bool,
    ) -> Result<Ended, CalibrateError> {
        self.forget_presses();
        let ended = self.motion(drive, limit, &mut |stage, now| done(now, &stage.senses));
        self.robot.stop(StopAction::Brake);
        ended
    }

    /// As [`Stage::drive`], until the person beside the robot says so: on the terminal, or with
    /// Enter on the brick, where only Back stops meanwhile.
    pub(super) fn drive_until_pressed(
        &mut self,
        drive: Drive,
        limit: Limit,
    ) -> Result<Ended, CalibrateError> {
        self.forget_presses();
        // What was pressed before the motion began was no answer to it.
        self.dialogue.is_pressed();
        self.marking = true;
        let ended =
            self.motion(drive, limit, &mut |stage, _| stage.dialogue.is_pressed() || stage.entered);
        self.marking = false;
        self.robot.stop(StopAction::Brake);
        ended
    }

    /// Brakes and waits until nothing has moved for half a second.
    pub(super) fn rest(&mut self) -> Result<Standing, CalibrateError> {
        self.robot.stop(StopAction::Brake);
        let begin_ns = self.clock.now_ns();
        let mut since_ns = begin_ns;
        let mut standing = self.look()?;
        loop {
            self.wait();
            let now = self.look()?;
            let now_ns = self.clock.now_ns();
            if now == standing {
                if now_ns - since_ns >= STILL_NS {
                    return Ok(now);
                }
            } else if now_ns - begin_ns > PATIENCE_NS {
                // A gyro that flickers between two degrees is at rest for all that matters.
                return Ok(now);
            } else {
                standing = now;
                since_ns = now_ns;
            }
        }
    }

    /// Readings of the range sensor for a second, at rest; one echo is read several times.
    pub(super) fn ranges(&mut self) -> Result<Vec<f64>, CalibrateError> {
        let end_ns = self.clock.now_ns() + SECOND_NS;
        let mut ranges = Vec::new();
        while self.clock.now_ns() < end_ns {
            self.look()?;
            ranges.extend(self.senses.get(Channel::Range).map(|reading| reading.value));
            self.wait();
        }
        Ok(ranges)
    }

    /// Turns the head to an angle, radians, waits for a new reading, and gives it: metres, none
    /// without an echo.
    pub(super) fn look_at(&mut self, head_rad: f64) -> Result<Option<f64>, CalibrateError> {
        let begin_ns = self.clock.now_ns();
        let mut there_ns = None;
        loop {
            self.look()?;
            let now_ns = self.clock.now_ns();
            let at_rad = self.fresh(Channel::Head)?;
            if (at_rad - head_rad).abs() < LOOK_RAD {
                there_ns = there_ns.or(Some(now_ns));
            } else if now_ns - begin_ns > PATIENCE_NS {
                return Err(CalibrateError::Blocked);
            }
            if there_ns.is_some_and(|there_ns| now_ns - there_ns >= READ_NS) {
                let reading_m = self.fresh(Channel::Range)?;
                return Ok(reading_m.is_finite().then_some(reading_m));
            }
            let demands = Demands { head_rad: Some(head_rad), ..Demands::default() };
            self.robot.act(&demands, now_ns);
            self.wait();
        }
    }

    /// Measures so often, each time one way and then the other; what was measured of each way.
    pub(super) fn both_ways<T>(
        &mut self,
        ways: [f64; 2],
        times: u32,
        measure: impl Fn(&mut Self, f64) -> Result<T, CalibrateError>,
    ) -> Result<[Vec<T>; 2], CalibrateError> {
        let mut measured = [const { Vec::new() }; 2];
        for _ in 0..times {
            for (measured, way) in measured.iter_mut().zip(ways) {
                measured.push(measure(self, way)?);
            }
        }
        Ok(measured)
    }

    fn motion(
        &mut self,
        drive: Drive,
        limit: Limit,
        done: &mut dyn FnMut(&mut Self, &Standing) -> bool,
    ) -> Result<Ended, CalibrateError> {
        let from = self.look()?;
        let begin_ns = self.clock.now_ns();
        let mut progress = [Progress { turned_rad: 0.0, at_ns: begin_ns }; 2];
        loop {
            let now = self.look()?;
            let now_ns = self.clock.now_ns();
            if done(self, &now) {
                return Ok(Ended::Reached);
            }
            let wheels_rad = [now.left_rad - from.left_rad, now.right_rad - from.right_rad];
            let [left_rad, right_rad] = wheels_rad.map(f64::abs);
            if f64::midpoint(left_rad, right_rad) > limit.wheel_rad
                || now_ns - begin_ns > nanoseconds(limit.time_s)
            {
                return Ok(Ended::Limit);
            }
            for (wheel, turned_rad) in progress.iter_mut().zip([left_rad, right_rad]) {
                wheel.check(turned_rad, now_ns)?;
            }
            // The head stays where a hand has put it.
            let demands = Demands { drive: Some(drive), ..Demands::default() };
            self.robot.act(&demands, now_ns);
            self.wait();
        }
    }

    /// Reads everything once.
    fn look(&mut self) -> Result<Standing, CalibrateError> {
        self.senses.time_ns = self.clock.now_ns() - self.start_ns;
        let pressed = self.robot.sense(&mut self.senses);
        self.presses(pressed)?;
        if self.flags.is_raised() {
            return Err(CalibrateError::Stopped);
        }
        let gyro_rad = if self.has_gyro() { Some(self.fresh(Channel::Gyro)?) } else { None };
        Ok(Standing {
            left_rad: self.fresh(Channel::Left)?,
            right_rad: self.fresh(Channel::Right)?,
            gyro_rad,
        })
    }

    fn fresh(&self, channel: Channel) -> Result<f64, CalibrateError> {
        self.senses.fresh(channel, self.config().max_age_ns).ok_or_else(|| CalibrateError::Lost {
            channel,
            trouble: self
                .robot
                .trouble_with(channel)
                .map_or_else(|| "no reading".to_owned(), ToString::to_string),
        })
    }

    /// A button stops, except that Enter is an answer while turns are marked.
    fn presses(&mut self, stop_pressed: bool) -> Result<(), CalibrateError> {
        // Buttons that cannot be read were said by `doctor`; Ctrl-C is left.
        let pressed = self
            .buttons
            .as_mut()
            .and_then(|buttons| buttons.changes().ok())
            .unwrap_or_default()
            .pressed;
        let stops = if self.marking { pressed.contains(Button::Back) } else { stop_pressed };
        self.entered = self.entered || pressed.contains(Button::Enter);
        if stops { Err(CalibrateError::Stopped) } else { Ok(()) }
    }

    /// A button that answered a question must not stop the motion after it.
    fn forget_presses(&mut self) {
        self.senses.time_ns = self.clock.now_ns() - self.start_ns;
        self.robot.sense(&mut self.senses);
        if let Some(buttons) = &mut self.buttons {
            // What cannot be read is read again at the next look.
            let _ = buttons.changes();
        }
        self.entered = false;
    }

    fn wait(&self) {
        self.clock.sleep_ns(LOOK_NS);
    }
}

/// How far a wheel has come, and when it last did.
#[derive(Debug, Clone, Copy)]
struct Progress {
    turned_rad: f64,
    at_ns: i64,
}

impl Progress {
    /// Every motion here turns both wheels all the time, so one that stands is blocked.
    fn check(&mut self, turned_rad: f64, now_ns: i64) -> Result<(), CalibrateError> {
        if turned_rad > self.turned_rad + TURNED_RAD {
            *self = Self { turned_rad, at_ns: now_ns };
        } else if now_ns - self.at_ns > BLOCKED_NS {
            return Err(CalibrateError::Blocked);
        }
        Ok(())
    }
}

impl Standing {
    /// How far the wheels have turned since, radians, the mean of both; forwards is positive.
    pub(super) fn rolled_rad(&self, now: &Self) -> f64 {
        f64::midpoint(now.left_rad - self.left_rad, now.right_rad - self.right_rad)
    }

    /// How far the gyro has turned since, radians, anticlockwise; not a number without a gyro.
    pub(super) fn turned_rad(&self, now: &Self) -> f64 {
        match (self.gyro_rad, now.gyro_rad) {
            (Some(from_rad), Some(to_rad)) => to_rad - from_rad,
            _ => f64::NAN,
        }
    }

    /// How much farther the right wheel has turned since than the left one, radians.
    pub(super) fn apart_rad(&self, now: &Self) -> f64 {
        (now.right_rad - self.right_rad) - (now.left_rad - self.left_rad)
    }
}
