//! Motion as a lease: a motor turns for 300 ms at most unless it is told so again.
//!
//! Every motion is a `run-timed` of [`LEASE_MS`], renewed about every [`RENEW_NS`] while the loop is healthy; when nobody renews it, the
//! kernel itself brakes the motor. Renewing leaves the speed steady (kernel transcript, scenario 21). Ramps stay 0, because a
//! ramp would go on after the lease (`ev3dev-interfaces`, 2.4).

use std::f64::consts::PI;

use crate::ev3dev::{DeviceError, StopAction, TachoCommand, TachoMotor};

/// How long a motion lasts unless it is renewed, milliseconds.
pub const LEASE_MS: i32 = 300;

/// How old a lease is when it is renewed, nanoseconds: two renewals may fail before the third comes too late.
pub const RENEW_NS: i64 = 100_000_000;

/// A motor that only ever moves by leases.
#[derive(Debug)]
pub struct LeasedMotor {
    motor: TachoMotor,
    /// Radians of the axle for one count of the motor.
    axle_rad_per_count: f64,
    max_rad_s: f64,
    lease: Option<Lease>,
    /// A motion was begun, and no stop has got through since.
    moving: bool,
    stop_action: StopAction,
}

/// A motion that was given and is not yet over.
#[derive(Debug, Clone, Copy)]
struct Lease {
    speed_counts_s: i32,
    given_ns: i64,
}

impl LeasedMotor {
    /// Takes a motor over: `reset`, so that nothing of an earlier program is left, then the settings of a lease.
    ///
    /// - `ratio`: turns of the axle for one turn of the motor.
    /// - `max_rad_s`: the fastest that the axle may turn.
    ///
    /// # Errors
    ///
    /// What the driver answers.
    pub fn take(motor: TachoMotor, ratio: f64, max_rad_s: f64) -> Result<Self, DeviceError> {
        motor.reset()?;
        motor.set_stop_action(StopAction::Brake)?;
        motor.set_time_sp(LEASE_MS)?;
        let axle_rad_per_count = 2.0 * PI * ratio / f64::from(motor.count_per_rot());
        Ok(Self {
            motor,
            axle_rad_per_count,
            max_rad_s,
            lease: None,
            moving: false,
            stop_action: StopAction::Brake,
        })
    }

    /// The axle's angle, radians; one system call.
    ///
    /// # Errors
    ///
    /// What the driver answers.
    pub fn angle_rad(&self) -> Result<f64, DeviceError> {
        Ok(f64::from(self.motor.position()?) * self.axle_rad_per_count)
    }

    /// Turns the axle at a speed, radians per second, for one lease: writes the speed where it changes, and the command where the
    /// speed changes or the lease is due. A speed that is not a number, or rounds to nothing, stops the motor.
    ///
    /// # Errors
    ///
    /// What the driver answers; the lease then counts as not given.
    pub fn turn(&mut self, rad_s: f64, now_ns: i64) -> Result<(), DeviceError> {
        let speed_counts_s = self.counts_s(rad_s);
        if speed_counts_s == 0 {
            return self.stop(StopAction::Brake);
        }
        let same = self.lease.filter(|lease| lease.speed_counts_s == speed_counts_s);
        if same.is_some_and(|lease| now_ns - lease.given_ns < RENEW_NS) {
            return Ok(());
        }
        // Until the command is through, the next call must count on nothing.
        self.lease = None;
        self.moving = true;
        self.set_stop_action(StopAction::Brake)?;
        if same.is_none() {
            self.motor.set_speed_sp(speed_counts_s)?;
        }
        self.motor.command(TachoCommand::RunTimed)?;
        self.lease = Some(Lease { speed_counts_s, given_ns: now_ns });
        Ok(())
    }

    /// Ends a motion now; writes nothing where the motor was stopped like this before.
    ///
    /// # Errors
    ///
    /// What the driver answers; the motor then still counts as moving, and the next call tries again.
    pub fn stop(&mut self, action: StopAction) -> Result<(), DeviceError> {
        if !self.moving && self.stop_action == action {
            return Ok(());
        }
        self.lease = None;
        self.moving = true;
        self.set_stop_action(action)?;
        self.motor.stop()?;
        self.moving = false;
        Ok(())
    }

    /// The motor itself: for what is asked once, not at every tick.
    #[must_use]
    pub fn motor(&self) -> &TachoMotor {
        &self.motor
    }

    fn set_stop_action(&mut self, action: StopAction) -> Result<(), DeviceError> {
        if self.stop_action != action {
            self.motor.set_stop_action(action)?;
            self.stop_action = action;
        }
        Ok(())
    }

    /// The motor's speed for a speed of the axle, within both limits; 0 for what is not a number.
    #[expect(clippy::cast_possible_truncation, reason = "limited to the motor's own top speed just before")]
    fn counts_s(&self, rad_s: f64) -> i32 {
        if rad_s.is_nan() {
            return 0;
        }
        let top = f64::from(self.motor.max_speed());
        let counts_s = rad_s.clamp(-self.max_rad_s, self.max_rad_s) / self.axle_rad_per_count;
        libm::round(counts_s.clamp(-top, top)) as i32
    }
}
