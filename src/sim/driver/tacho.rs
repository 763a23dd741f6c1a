//! A motor with a position: class `tacho-motor` (`tacho_motor_class.c`).
//!
//! The class keeps the set points, latches them at each command, and ramps the speed in steps;
//! [`motor`] below it regulates.
//!
//! # Quirks that are kept
//!
//! - A relative move that follows a relative move starts from that move's target.
//! - `ramping` sticks if a move arrives before its ramp was through, or a command that does not
//!   ramp interrupts a ramp.
//! - The ramp counts from 50 ms before the command, and its steps come 50 to 60 ms apart.
//! - `speed_sp` takes −2147483648.

mod encoder;
mod models;
mod motor;
mod pid;

use nix::errno::Errno;

use self::encoder::Encoder;
use self::models::{COUNT_PER_M, COUNT_PER_ROT};
pub(crate) use self::models::{MODELS, Model};
use self::motor::{Motor, Ticked};
use super::jiffies::{JIFFY_NS, due_ns, from_ms, jiffies};
use super::text::{int, known, within, word};
use super::{Attributes, Context, Driver, Took, line, list, wrap};
use crate::ev3dev::{
    self, Linear, MotorKind as _, Polarity, Rotary, StopAction, TachoCommand as Command,
};
use crate::sim::board::MotorDriver;
use crate::sim::physics::Bridge;

/// How often the worker looks for a changed state, to wake those who poll it.
const NOTIFY_NS: i64 = 50_000_000;

/// The ramp aims at a step each 100 ms.
const RAMP_PERIOD: i64 = 10;

/// Set points, in the hardware's frame.
#[derive(Debug, Clone, Copy, Default)]
struct SetPoints {
    inversed: bool,
    duty: i32,
    speed: i32,
    position: i32,
    time_ms: i32,
    ramp_up_ms: i32,
    ramp_down_ms: i32,
    stop_action: StopAction,
}

/// The speed on its way to a set point. Times are in kernel ticks.
#[derive(Debug, Clone, Copy, Default)]
struct Ramp {
    flagged: bool,
    end: i32,
    delta: i32,
    delta_time: i64,
    end_time: i64,
    last_step: i64,
    last_speed: i32,
    due_ns: Option<i64>,
}

/// One motor.
#[derive(Debug)]
pub(crate) struct TachoMotor {
    /// What its driver is.
    pub(crate) model: &'static Model,
    driver: &'static MotorDriver,
    set: SetPoints,
    active: SetPoints,
    active_command: Command,
    last_command: Command,
    timed_ns: Option<i64>,
    ramp: Ramp,
    motor: Motor,
    next_notice_ns: i64,
    noticed: [bool; 5],
    /// How often the worker has found the state changed: what wakes those who poll it.
    pub(crate) notices: u32,
}

impl TachoMotor {
    /// As after plugging in, on a board whose driver it has, and on a port whose counter stands at
    /// `edges`.
    pub(crate) fn new(
        model: &'static Model,
        driver: &'static MotorDriver,
        (edges, exact): (i64, f64),
        now_ns: i64,
    ) -> Self {
        let motor =
            Motor::new(Encoder::new(edges, exact, now_ns), Model::speed_pid(), model.hold_pid());
        Self {
            model,
            driver,
            set: SetPoints::default(),
            active: SetPoints::default(),
            active_command: Command::Stop,
            last_command: Command::Stop,
            timed_ns: None,
            ramp: Ramp::default(),
            motor,
            next_notice_ns: now_ns + NOTIFY_NS,
            noticed: [false; 5],
            notices: 0,
        }
    }

    /// A linear motor is called `linearN` instead of `motorN`.
    pub(crate) fn is_linear(&self) -> bool {
        self.model.full_travel_count > 0
    }

    /// What the bridge does now.
    pub(crate) fn bridge(&self) -> Bridge {
        self.motor.bridge
    }

    /// The timer of `run-timed`.
    pub(crate) fn end_when_due(&mut self, now_ns: i64) {
        if self.timed_ns.is_some_and(|due_ns| due_ns <= now_ns) {
            self.end_run_timed(now_ns);
        }
    }

    /// What happens in one step besides: the ramp's timer, the loop, the worker that wakes pollers.
    pub(crate) fn tick(&mut self, count: (i64, f64), now_ns: i64) {
        if self.ramp.due_ns.is_some_and(|due_ns| due_ns <= now_ns) {
            self.ramp.due_ns = None;
            self.step_ramp(now_ns);
        }
        let ticked = self.motor.tick(count, now_ns, self.active.ramp_down_ms, self.model.max_speed);
        if ticked == Ticked::Arrived {
            self.timed_ns = None;
            self.ramp.due_ns = None;
            self.active.speed = 0;
            self.ramp.last_speed = 0;
        }
        if now_ns >= self.next_notice_ns {
            self.next_notice_ns = now_ns + NOTIFY_NS;
            let state = self.state();
            if state != self.noticed {
                self.noticed = state;
                self.notices = self.notices.wrapping_add(1);
            }
        }
    }

    fn state(&self) -> [bool; 5] {
        [
            self.motor.running || (self.driver.holding_runs && self.motor.holding),
            self.ramp.flagged || self.motor.is_ramping_down(),
            self.motor.holding,
            self.motor.is_overloaded(),
            self.driver.stalls && self.motor.is_stalled(),
        ]
    }

    fn command(&mut self, command: Command, now_ns: i64) {
        self.timed_ns = None;
        self.ramp.due_ns = None;
        if command == Command::Reset {
            self.set = SetPoints::default();
        }
        let previous_target = self.active.position;
        self.active = self.set;
        self.active_command = command;
        if matches!(command, Command::Stop | Command::Reset) {
            self.active.speed = 0;
            self.active.duty = 0;
        }
        if command == Command::RunToRelPos {
            let chained = self.last_command == Command::RunToRelPos;
            let base = if chained { previous_target } else { self.motor.position() };
            self.active.position = base.wrapping_add(self.set.position);
            if self.set.position == 0 {
                self.active.speed = 0;
            }
        }
        self.perform(command, now_ns);
        self.last_command = command;
        if command == Command::RunTimed {
            self.timed_ns = Some(due_ns(now_ns, from_ms(self.active.time_ms)));
            if self.active.time_ms == 0 {
                self.end_run_timed(now_ns);
            }
        }
    }

    fn perform(&mut self, command: Command, now_ns: i64) {
        let active = self.active;
        let ramps = active.ramp_up_ms != 0 || active.ramp_down_ms != 0;
        match command {
            Command::Reset => self.motor.reset(Model::speed_pid(), self.model.hold_pid()),
            Command::RunDirect => self.motor.run_direct(active.duty),
            _ if ramps => self.start_ramp(now_ns),
            Command::RunForever | Command::RunTimed => self.run_regulated(active.speed),
            Command::RunToRelPos if self.set.position == 0 => self.motor.stop(active.stop_action),
            Command::RunToAbsPos | Command::RunToRelPos => self.run_to(active.speed),
            Command::Stop => self.motor.stop(active.stop_action),
        }
    }

    fn run_regulated(&mut self, speed: i32) {
        self.motor.run_regulated((self.driver.speed)(speed));
    }

    fn run_to(&mut self, speed: i32) {
        let active = self.active;
        self.motor.run_to(active.position, (self.driver.speed)(speed), active.stop_action);
    }

    fn end_run_timed(&mut self, now_ns: i64) {
        self.timed_ns = None;
        self.active_command = Command::Stop;
        if self.active.ramp_down_ms == 0 {
            self.motor.stop(self.active.stop_action);
        } else {
            self.ramp.due_ns = None;
            self.active.speed = 0;
            self.start_ramp(now_ns);
        }
    }

    /// One leg: to 0 if the set point has the other sign, else to the set point.
    fn start_ramp(&mut self, now_ns: i64) {
        if !self.ramp.flagged {
            self.ramp.last_speed = self.motor.speed;
        }
        let start = self.ramp.last_speed;
        let target = self.active.speed;
        let end = if i64::from(start) * i64::from(target) < 0 { 0 } else { target };
        let delta = end.wrapping_sub(start);
        let faster = i64::from(start) * i64::from(delta) >= 0;
        let full_ms = if faster { self.active.ramp_up_ms } else { self.active.ramp_down_ms };
        let delta_time =
            from_ms(full_ms) * i64::from(delta.unsigned_abs()) / i64::from(self.model.max_speed);
        let start_time = jiffies(now_ns) - RAMP_PERIOD / 2;
        let end_time = start_time + delta_time;
        self.ramp = Ramp {
            flagged: true,
            end,
            delta,
            delta_time,
            end_time,
            last_step: start_time,
            ..self.ramp
        };
        self.step_ramp(now_ns);
    }

    fn step_ramp(&mut self, now_ns: i64) {
        let active = self.active;
        if active.speed == self.ramp.last_speed {
            self.ramp.flagged = false;
            if self.active_command == Command::Stop {
                self.motor.stop(active.stop_action);
            }
            return;
        }
        if self.ramp.end == self.ramp.last_speed {
            self.start_ramp(now_ns);
            return;
        }
        let now = jiffies(now_ns);
        let left = (self.ramp.end_time - now).max(0);
        if self.ramp.delta_time == 0 {
            self.ramp.last_speed = self.ramp.end;
            self.ramp.flagged = false;
        } else {
            let behind = wrap(i64::from(self.ramp.delta).wrapping_mul(left) / self.ramp.delta_time);
            self.ramp.last_speed = self.ramp.end.wrapping_sub(behind);
        }
        if matches!(self.active_command, Command::RunToAbsPos | Command::RunToRelPos) {
            self.run_to(self.ramp.last_speed);
        } else {
            self.run_regulated(self.ramp.last_speed);
        }
        let delay = (RAMP_PERIOD - (now - self.ramp.last_step)).max(0);
        self.ramp.last_step = now;
        // Work without a delay still waits for its worker.
        self.ramp.due_ns =
            Some(due_ns(now_ns, delay).max(now_ns.div_euclid(JIFFY_NS) * JIFFY_NS + JIFFY_NS));
    }

    /// Turns a number between the file's frame and the hardware's.
    fn signed(&self, value: i32) -> i32 {
        if self.set.inversed { value.wrapping_neg() } else { value }
    }

    fn commands(&self) -> impl Iterator<Item = &'static str> {
        let direct = self.driver.direct;
        Command::WORDS.iter().copied().filter(move |command| direct || *command != "run-direct")
    }

    fn stop_actions(&self) -> impl Iterator<Item = &'static str> + use<> {
        self.driver.stop_actions.iter().map(|action| action.as_str())
    }

    /// What the board's driver has no function for.
    fn is_unsupported(&self, attribute: &str) -> bool {
        match attribute {
            "speed" | "duty_cycle" => !self.driver.rates,
            _ => !self.driver.gains && attribute.contains("_pid/"),
        }
    }

    fn gain(&mut self, attribute: &str) -> Option<&mut i32> {
        let motor = &mut self.motor;
        Some(match attribute {
            "speed_pid/Kp" => &mut motor.speed_pid.kp,
            "speed_pid/Ki" => &mut motor.speed_pid.ki,
            "speed_pid/Kd" => &mut motor.speed_pid.kd,
            "hold_pid/Kp" => &mut motor.hold_pid.kp,
            "hold_pid/Ki" => &mut motor.hold_pid.ki,
            "hold_pid/Kd" => &mut motor.hold_pid.kd,
            _ => return None,
        })
    }

    fn number(&self, attribute: &str) -> Option<i32> {
        Some(match attribute {
            "position" => self.signed(self.motor.position()),
            "speed" => self.signed(self.motor.speed),
            "duty_cycle" if self.driver.odd_duty => {
                self.signed(self.motor.duty * 255 / 100 * 255 / 100)
            }
            "duty_cycle" => self.signed(self.motor.duty),
            "duty_cycle_sp" => self.signed(self.set.duty),
            "speed_sp" => self.signed(self.set.speed),
            "position_sp" => self.signed(self.set.position),
            "time_sp" => self.set.time_ms,
            "ramp_up_sp" => self.set.ramp_up_ms,
            "ramp_down_sp" => self.set.ramp_down_ms,
            "max_speed" => self.model.max_speed,
            "count_per_rot" => COUNT_PER_ROT,
            "count_per_m" => COUNT_PER_M,
            "full_travel_count" => self.model.full_travel_count,
            "speed_pid/Kp" => self.motor.speed_pid.kp,
            "speed_pid/Ki" => self.motor.speed_pid.ki,
            "speed_pid/Kd" => self.motor.speed_pid.kd,
            "hold_pid/Kp" => self.motor.hold_pid.kp,
            "hold_pid/Ki" => self.motor.hold_pid.ki,
            "hold_pid/Kd" => self.motor.hold_pid.kd,
            _ => return None,
        })
    }
}

impl Driver for TachoMotor {
    fn attributes(&self) -> Attributes {
        let own = if self.is_linear() { Linear::OWN_ATTRIBUTES } else { Rotary::OWN_ATTRIBUTES };
        [ev3dev::TachoMotor::ATTRIBUTES, own]
    }

    fn read(&self, attribute: &str, out: &mut Vec<u8>) -> Result<(), Errno> {
        match attribute {
            "commands" => list(out, self.commands()),
            "stop_actions" => list(out, self.stop_actions()),
            "stop_action" => line(out, self.set.stop_action),
            "polarity" => list(out, Polarity::WORDS.get(usize::from(self.set.inversed)).copied()),
            "state" => {
                let words = ["running", "ramping", "holding", "overloaded", "stalled"];
                list(
                    out,
                    words
                        .into_iter()
                        .zip(self.state())
                        .filter_map(|(word, set)| set.then_some(word)),
                );
            }
            _ if self.is_unsupported(attribute) => return Err(Errno::EOPNOTSUPP),
            _ => line(out, self.number(attribute).ok_or(Errno::ENODEV)?),
        }
        Ok(())
    }

    fn store(&mut self, attribute: &str, bytes: &[u8], context: &mut Context<'_>) -> Took {
        match attribute {
            "command" => {
                let command = known(bytes)?;
                if command == Command::RunDirect && !self.driver.direct {
                    return Err(Errno::EINVAL);
                }
                self.command(command, context.now_ns);
            }
            "stop_action" => {
                let index = word(bytes, self.stop_actions())?;
                self.set.stop_action = *self.driver.stop_actions.get(index).ok_or(Errno::EINVAL)?;
            }
            "polarity" => self.set.inversed = known::<Polarity>(bytes)? == Polarity::Inversed,
            "position" => {
                let position = int(bytes)?;
                if self.driver.zero_only && position != 0 {
                    return Err(Errno::EINVAL);
                }
                let driven = self.motor.running || self.motor.holding;
                if self.driver.still_for_position && driven {
                    return Err(Errno::EBUSY);
                }
                self.motor.set_position(self.signed(position));
            }
            "position_sp" => self.set.position = self.signed(int(bytes)?),
            "speed_sp" => {
                let speed = int(bytes)?;
                // As the driver checks it: the one number whose magnitude does not fit slips
                // through.
                if speed.wrapping_abs() > self.model.max_speed {
                    return Err(Errno::EINVAL);
                }
                self.set.speed = self.signed(speed);
            }
            "duty_cycle_sp" => {
                self.set.duty = self.signed(within(int(bytes)?, -100..=100)?);
                if self.active_command == Command::RunDirect {
                    self.motor.run_direct(self.set.duty);
                }
            }
            "time_sp" => self.set.time_ms = within(int(bytes)?, 0..=i32::MAX)?,
            "ramp_up_sp" => self.set.ramp_up_ms = within(int(bytes)?, 0..=60_000)?,
            "ramp_down_sp" => self.set.ramp_down_ms = within(int(bytes)?, 0..=60_000)?,
            _ if self.is_unsupported(attribute) => return Err(Errno::EOPNOTSUPP),
            _ => {
                let value = within(int(bytes)?, 0..=i32::MAX)?;
                *self.gain(attribute).ok_or(Errno::EIO)? = value;
            }
        }
        Ok(None)
    }
}
