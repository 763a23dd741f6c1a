//! The driver of one motor on an output port: the loop that runs every 2 ms (`legoev3_motor.c`).
//!
//! All arithmetic is 32-bit and wraps, as the driver's does.

use super::encoder::Encoder;
use super::pid::Pid;
use crate::ev3dev::StopAction;
use crate::sim::driver::wrap;
use crate::sim::physics::{Bridge, STEP_NS};

/// A motor that should turn and has not for longer than this is stalled.
const STALLED_NS: i64 = 101_000_000;

/// Regulation, in the hardware's frame: no polarity here.
#[derive(Debug)]
pub(crate) struct Motor {
    encoder: Encoder,
    pub(crate) speed_pid: Pid,
    pub(crate) hold_pid: Pid,
    /// What the bridge does now.
    pub(crate) bridge: Bridge,
    /// What was last put to the bridge, in percent; 0 after a stop, whatever the bridge does.
    pub(crate) duty: i32,
    raw_position: i32,
    offset: i32,
    /// Counts a second.
    pub(crate) speed: i32,
    target: i32,
    to_position: Option<StopAction>,
    hold_at_target: bool,
    regulated: bool,
    /// The position is being held.
    pub(crate) holding: bool,
    /// A run command is in effect.
    pub(crate) running: bool,
    ramping_down: bool,
    still_since_ns: Option<i64>,
    stalled: bool,
}

/// What a tick came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ticked {
    /// Nothing that the class must know.
    Nothing,
    /// A move has reached its target and done its stop action.
    Arrived,
}

impl Motor {
    /// As after plugging in: the position is whatever the co-processor has counted for the port.
    pub(crate) fn new(encoder: Encoder, speed_pid: Pid, hold_pid: Pid) -> Self {
        let raw_position = wrap(encoder.edges) / 2;
        Self {
            encoder,
            speed_pid,
            hold_pid,
            bridge: Bridge::Coast,
            duty: 0,
            raw_position,
            offset: 0,
            speed: 0,
            target: 0,
            to_position: None,
            hold_at_target: false,
            regulated: false,
            holding: false,
            running: false,
            ramping_down: false,
            still_since_ns: None,
            stalled: false,
        }
    }

    /// Counts.
    pub(crate) fn position(&self) -> i32 {
        self.raw_position.wrapping_add(self.offset)
    }

    /// The active regulator's last output was beyond ±100 %.
    pub(crate) fn is_overloaded(&self) -> bool {
        (self.running && self.regulated && self.speed_pid.overloaded)
            || (self.holding && self.hold_pid.overloaded)
    }

    /// Running, and not turning for more than 100 ms.
    pub(crate) fn is_stalled(&self) -> bool {
        self.running && self.stalled
    }

    /// Running, and slowing down before a target.
    pub(crate) fn is_ramping_down(&self) -> bool {
        self.running && self.ramping_down
    }

    /// Gives the present position a new number. Never refused: the driver's check for a running
    /// motor is wrong.
    pub(crate) fn set_position(&mut self, position: i32) {
        self.offset = position.wrapping_sub(self.raw_position);
        self.target = position;
    }

    /// Runs at a duty cycle, unregulated.
    pub(crate) fn run_direct(&mut self, duty: i32) {
        self.to_position = None;
        self.regulated = false;
        self.holding = false;
        self.set_duty(duty);
        self.running = true;
    }

    /// Runs at a regulated speed. The integral stays, so that there is no bump.
    pub(crate) fn run_regulated(&mut self, speed: i32) {
        self.to_position = None;
        self.regulated = true;
        self.holding = false;
        self.speed_pid.setpoint = speed;
        self.running = true;
    }

    /// Runs to a position; the sign of the speed does not matter.
    pub(crate) fn run_to(&mut self, target: i32, speed: i32, then: StopAction) {
        let speed = speed.wrapping_abs();
        self.to_position = Some(then);
        self.regulated = true;
        self.holding = false;
        self.target = target;
        self.speed_pid.setpoint =
            if self.position() > target { speed.wrapping_neg() } else { speed };
        self.running = true;
    }

    /// Stops. A hold starts with the bridge as it was, until the regulator says something else.
    pub(crate) fn stop(&mut self, action: StopAction) {
        let hold_at = if self.hold_at_target { self.target } else { self.position() };
        self.to_position = None;
        self.hold_at_target = false;
        self.regulated = false;
        self.holding = false;
        self.running = false;
        self.duty = 0;
        self.speed_pid.clear();
        self.hold_pid.clear();
        match action {
            StopAction::Coast => self.bridge = Bridge::Coast,
            StopAction::Brake => self.bridge = Bridge::Brake,
            StopAction::Hold => {
                self.hold_pid.setpoint = hold_at;
                self.holding = true;
            }
        }
    }

    /// Coasts, takes the present position as 0, and goes back to these gains.
    pub(crate) fn reset(&mut self, speed_pid: Pid, hold_pid: Pid) {
        self.stop(StopAction::Coast);
        self.target = 0;
        self.offset = self.raw_position.wrapping_neg();
        self.speed = 0;
        self.stalled = false;
        self.still_since_ns = None;
        self.speed_pid = speed_pid;
        self.hold_pid = hold_pid;
    }

    /// One turn of the loop. `edges` and `exact` are the co-processor's count; `ramp_down_ms` and
    /// `max_speed` make the ramp before a target.
    pub(crate) fn tick(
        &mut self,
        (edges, exact): (i64, f64),
        now_ns: i64,
        ramp_down_ms: i32,
        max_speed: i32,
    ) -> Ticked {
        self.encoder.observe(edges, exact, now_ns, STEP_NS);
        self.raw_position = wrap(edges) / 2;
        self.speed = wrap(self.encoder.speed) / 2;
        self.watch_stall(now_ns);
        let duty = self.regulate();
        self.set_duty(duty);
        match self.to_position {
            Some(then) => self.approach(then, ramp_down_ms, max_speed),
            None => Ticked::Nothing,
        }
    }

    fn watch_stall(&mut self, now_ns: i64) {
        if self.running && self.speed == 0 {
            let since_ns = *self.still_since_ns.get_or_insert(now_ns);
            self.stalled = self.stalled || now_ns - since_ns >= STALLED_NS;
        } else {
            self.still_since_ns = None;
            self.stalled = false;
        }
    }

    fn regulate(&mut self) -> i32 {
        if self.regulated && self.speed_pid.setpoint == 0 {
            self.speed_pid.clear();
            0
        } else if self.regulated {
            self.speed_pid.update(self.speed)
        } else if self.holding {
            self.hold_pid.update(self.raw_position.wrapping_add(self.offset))
        } else {
            self.duty
        }
    }

    /// Writes the bridge only if the duty cycle differs from the last one: a regulated 0 on a
    /// coasting motor leaves it coasting.
    fn set_duty(&mut self, duty: i32) {
        let duty = duty.clamp(-100, 100);
        if duty != self.duty {
            self.duty = duty;
            self.bridge = Bridge::Duty(duty);
        }
    }

    fn approach(&mut self, then: StopAction, ramp_down_ms: i32, max_speed: i32) -> Ticked {
        let position = self.position();
        let left = self.target.wrapping_sub(position);
        let ramp_ms = self
            .speed
            .wrapping_abs()
            .wrapping_mul(ramp_down_ms)
            .wrapping_div(max_speed.wrapping_add(1));
        let stops_at = position.wrapping_add(self.speed.wrapping_mul(ramp_ms) / 2000);
        let setpoint = self.speed_pid.setpoint;
        let (passes, there) = match setpoint {
            1.. => (stops_at > self.target, position >= self.target),
            0 => (false, position == self.target),
            ..0 => (stops_at < self.target, position <= self.target),
        };
        if passes {
            let divisor = ramp_ms.wrapping_add(1);
            self.speed_pid.setpoint = left.wrapping_mul(2000).checked_div(divisor).unwrap_or(0);
            self.ramping_down = true;
        }
        if !there {
            return Ticked::Nothing;
        }
        self.hold_at_target = true;
        self.stop(then);
        self.ramping_down = false;
        Ticked::Arrived
    }
}
