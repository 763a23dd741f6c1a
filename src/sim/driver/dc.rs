//! A motor without a position: class `dc-motor` (`dc_motor_class.c`).
//!
//! Everything goes through the ramp worker, also without a ramp, so `ramping` shows for up to about
//! 100 ms after each command, and a command that comes while it does waits for the worker (issue
//! 1392 of ev3dev is about the rest of it). A worker that is queued without a delay runs at once.

use nix::errno::Errno;

use super::jiffies::{due_ns, from_ms, jiffies};
use super::text::{int, known, scan_unsigned, within, word};
use super::{Attributes, Context, Driver, Took, line, list, wrap};
use crate::ev3dev::{self, DcCommand as Command, Polarity};
use crate::sim::physics::Bridge;

const STOP_ACTIONS: [&str; 2] = ["coast", "brake"];
const RAMP_PERIOD: i64 = 10;

#[derive(Debug, Clone, Copy, Default)]
struct SetPoints {
    duty: i32,
    inversed: bool,
    brake: bool,
    ramp_up_ms: u32,
    ramp_down_ms: u32,
    time_ms: i32,
}

/// One motor; the default is as after the port was put into its mode.
#[derive(Debug, Default)]
pub(crate) struct DcMotor {
    set: SetPoints,
    /// Latched at the command; its duty cycle has the polarity in it.
    active: SetPoints,
    command: Command,
    duty: i32,
    /// What the bridge does now.
    pub(crate) bridge: Bridge,
    ramp_delta: i32,
    ramp_time: i64,
    ramp_end: i64,
    last_step: i64,
    ramp_due_ns: Option<i64>,
    timed_ns: Option<i64>,
}

impl DcMotor {
    /// What happens in one step: its two timers.
    pub(crate) fn tick(&mut self, now_ns: i64) {
        if self.timed_ns.is_some_and(|due_ns| due_ns <= now_ns) {
            self.timed_ns = None;
            self.command = Command::Stop;
            self.active.duty = 0;
            self.start_ramp(now_ns);
        }
        self.work(now_ns);
    }

    /// Does the ramp's work that is due.
    fn work(&mut self, now_ns: i64) {
        while self.ramp_due_ns.is_some_and(|due_ns| due_ns <= now_ns) {
            self.ramp_due_ns = None;
            self.step_ramp(now_ns);
        }
    }

    fn command(&mut self, command: Command, now_ns: i64) {
        self.active = self.set;
        self.active.duty = if command == Command::Stop { 0 } else { self.signed(self.set.duty) };
        self.command = command;
        self.start_ramp(now_ns);
        self.timed_ns =
            (command == Command::RunTimed).then(|| due_ns(now_ns, from_ms(self.active.time_ms)));
    }

    fn start_ramp(&mut self, now_ns: i64) {
        self.ramp_delta = self.active.duty - self.duty;
        let full_ms =
            if self.ramp_delta > 0 { self.active.ramp_up_ms } else { self.active.ramp_down_ms };
        let full = from_ms(i32::try_from(full_ms).unwrap_or(i32::MAX));
        self.ramp_time = full * i64::from(self.ramp_delta.abs()) / 100;
        self.last_step = jiffies(now_ns);
        self.ramp_end = self.last_step + self.ramp_time;
        // Work that is pending stays where it is.
        self.ramp_due_ns.get_or_insert(now_ns);
        self.work(now_ns);
    }

    fn step_ramp(&mut self, now_ns: i64) {
        let runs = self.command != Command::Stop;
        if runs && self.active.duty == self.duty {
            return;
        }
        let now = jiffies(now_ns);
        let left = (self.ramp_end - now).max(0);
        let behind = if self.ramp_time == 0 {
            0
        } else {
            i64::from(self.ramp_delta) * left / self.ramp_time
        };
        self.duty = (self.active.duty - wrap(behind)).clamp(-100, 100);
        self.bridge = match (runs || self.duty != 0, self.active.brake) {
            (true, _) => Bridge::Duty(self.duty),
            (false, true) => Bridge::Brake,
            (false, false) => Bridge::Coast,
        };
        if runs || self.duty != 0 {
            // Without a delay it is done once more at once, and by then nothing has passed since
            // the last step.
            let delay = (RAMP_PERIOD - (now - self.last_step)).max(0);
            self.last_step = now;
            self.ramp_due_ns = Some(due_ns(now_ns, delay));
        }
    }

    fn signed(&self, duty: i32) -> i32 {
        if self.set.inversed { -duty } else { duty }
    }
}

impl Driver for DcMotor {
    fn attributes(&self) -> Attributes {
        [ev3dev::DcMotor::ATTRIBUTES, &[]]
    }

    fn read(&self, attribute: &str, out: &mut Vec<u8>) -> Result<(), Errno> {
        match attribute {
            "commands" => list(out, Command::WORDS.iter().copied()),
            "stop_actions" => list(out, STOP_ACTIONS),
            "polarity" => list(out, Polarity::WORDS.get(usize::from(self.set.inversed)).copied()),
            "duty_cycle" => line(out, if self.active.inversed { -self.duty } else { self.duty }),
            "duty_cycle_sp" => line(out, self.set.duty),
            "ramp_up_sp" => line(out, self.set.ramp_up_ms),
            "ramp_down_sp" => line(out, self.set.ramp_down_ms),
            "time_sp" => line(out, self.set.time_ms),
            "state" => {
                let running = matches!(self.bridge, Bridge::Duty(_)).then_some("running");
                let ramping = self.ramp_due_ns.is_some().then_some("ramping");
                list(out, running.into_iter().chain(ramping));
            }
            _ => return Err(Errno::ENODEV),
        }
        Ok(())
    }

    fn store(&mut self, attribute: &str, bytes: &[u8], context: &mut Context<'_>) -> Took {
        match attribute {
            "command" => self.command(known(bytes)?, context.now_ns),
            "duty_cycle_sp" => {
                self.set.duty = within(int(bytes)?, -100..=100)?;
                if self.command == Command::RunDirect {
                    let duty = self.set.duty;
                    self.active.duty = if self.active.inversed { -duty } else { duty };
                    self.start_ramp(context.now_ns);
                }
            }
            "polarity" => self.set.inversed = known::<Polarity>(bytes)? == Polarity::Inversed,
            "stop_action" => self.set.brake = word(bytes, STOP_ACTIONS)? == 1,
            "ramp_up_sp" => self.set.ramp_up_ms = within(scan_unsigned(bytes)?, 0..=10_000)?,
            "ramp_down_sp" => self.set.ramp_down_ms = within(scan_unsigned(bytes)?, 0..=10_000)?,
            "time_sp" => self.set.time_ms = within(int(bytes)?, 0..=60_000)?,
            _ => return Err(Errno::EIO),
        }
        Ok(None)
    }
}
