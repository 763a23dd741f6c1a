//! Motion as a lease: a motor turns for 300 ms at most unless it is told so again.
//!
//! Every motion is a `run-timed` of [`LEASE_MS`], renewed about every [`RENEW_NS`] while the loop
//! is healthy. Without a renewal the kernel itself brakes the motor, or on a BrickPi, which cannot
//! brake, has it hold its position. Renewing leaves the speed
//! steady (kernel transcript, scenario 21). Ramps stay 0, because a ramp would outlast the lease
//! (`ev3dev-interfaces`, 2.4).
//!
//! Nothing keeps another program from commanding the same motor, but its driver's attributes show
//! it: a motor under a lease of ours runs, one that we stopped does not, and the settings are as we
//! left them. Settings are checked because each of them can undo a lease: a `time_sp` makes the
//! next one longer, a ramp outlasts it, a stop action lets the motor coast, a polarity reverses it.
//! A motor that two looks in a row find otherwise is another program's, and is left alone from then
//! on.

use std::f64::consts::PI;

use crate::ev3dev::{DeviceError, Polarity, StopAction, TachoCommand, TachoMotor};
use crate::units::rounded;

/// How long a motion lasts unless it is renewed, milliseconds.
pub const LEASE_MS: i32 = 300;

/// How old a lease is when it is renewed, nanoseconds: two renewals may fail before the third comes
/// too late.
pub const RENEW_NS: i64 = 100_000_000;

/// For so long after a lease was given its motor certainly runs, nanoseconds: a look may come late.
const RUNS_NS: i64 = 200_000_000;

/// What can be looked at to see whether a motor does what we told it, one system call each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Aspect {
    /// `state`: it runs under a lease, and else it does not.
    State,
    /// `speed_sp`: what we wrote last.
    Speed,
    /// `duty_cycle_sp`: 0 since `reset`.
    Duty,
    /// `time_sp`: [`LEASE_MS`].
    Time,
    /// `stop_action`: what we wrote last.
    StopAction,
    /// `ramp_up_sp`: 0 since `reset`.
    RampUp,
    /// `ramp_down_sp`: 0 since `reset`.
    RampDown,
    /// `polarity`: normal since `reset`.
    Polarity,
}

impl Aspect {
    /// What another program's command changes. Looked at all the time; the settings only before
    /// each command of ours.
    pub const OF_COMMANDS: [Self; 3] = [Self::State, Self::Speed, Self::Duty];

    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::State,
        Self::Speed,
        Self::Duty,
        Self::Time,
        Self::StopAction,
        Self::RampUp,
        Self::RampDown,
        Self::Polarity,
    ];

    /// The attribute's file.
    #[must_use]
    pub const fn file(self) -> &'static str {
        match self {
            Self::State => "state",
            Self::Speed => "speed_sp",
            Self::Duty => "duty_cycle_sp",
            Self::Time => "time_sp",
            Self::StopAction => "stop_action",
            Self::RampUp => "ramp_up_sp",
            Self::RampDown => "ramp_down_sp",
            Self::Polarity => "polarity",
        }
    }

    /// True for what only changes what a command of ours does: the last command is still ours then.
    fn is_setting(self) -> bool {
        !Self::OF_COMMANDS.contains(&self)
    }
}

/// Who commands a motor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Hand {
    Ours,
    /// One look found it otherwise than we left it.
    InDoubt,
    /// Two looks did, at this.
    Theirs(Aspect),
}

/// A motor that only ever moves by leases.
#[derive(Debug)]
pub struct LeasedMotor {
    motor: TachoMotor,
    /// Radians of the axle for one count of the motor.
    axle_rad_per_count: f64,
    /// Its inverse: the brick's processor divides slowly.
    counts_per_axle_rad: f64,
    /// The axle's angle where the motor counts 0, radians.
    zero_rad: f64,
    max_rad_s: f64,
    /// What was asked for last, and what it is for the motor.
    asked: (f64, i32),
    lease: Option<Lease>,
    /// A motion was begun, and no stop has got through since.
    moving: bool,
    stop_action: StopAction,
    /// What braking comes to with this driver.
    brake: StopAction,
    /// What was written last, or what `reset` left.
    speed_sp: Option<i32>,
    hand: Hand,
}

/// A motion that was given and is not yet over.
#[derive(Debug, Clone, Copy)]
struct Lease {
    speed_counts_s: i32,
    given_ns: i64,
}

impl LeasedMotor {
    /// Takes a motor over: `reset`, so that nothing of an earlier program is left, then the
    /// settings of a lease.
    ///
    /// - `ratio`: turns of the axle for one turn of the motor.
    /// - `max_rad_s`: the fastest that the axle may turn.
    ///
    /// # Errors
    ///
    /// What the driver answers.
    pub fn take(motor: TachoMotor, ratio: f64, max_rad_s: f64) -> Result<Self, DeviceError> {
        motor.reset()?;
        let brake = motor.nearest_action(StopAction::Brake);
        motor.set_stop_action(brake)?;
        motor.set_time_sp(LEASE_MS)?;
        let speed_sp = motor.speed_sp().ok();
        let axle_rad_per_count = 2.0 * PI * ratio / f64::from(motor.count_per_rot());
        let leased = Self {
            motor,
            axle_rad_per_count,
            counts_per_axle_rad: 1.0 / axle_rad_per_count,
            zero_rad: 0.0,
            max_rad_s,
            asked: (0.0, 0),
            lease: None,
            moving: false,
            stop_action: brake,
            brake,
            speed_sp,
            hand: Hand::Ours,
        };
        // Each file is read once here, so that the tick need not open it; what it says matters from
        // then on.
        let _ = Aspect::ALL.map(|aspect| leased.contradicts(aspect, 0));
        Ok(leased)
    }

    /// The axle's angle, radians; one system call.
    ///
    /// # Errors
    ///
    /// What the driver answers.
    pub fn angle_rad(&self) -> Result<f64, DeviceError> {
        Ok(f64::from(self.motor.position()?) * self.axle_rad_per_count + self.zero_rad)
    }

    /// Sets another angle, radians, for the place where the motor counts 0: a replugged motor
    /// continues where it was.
    pub fn set_zero_rad(&mut self, zero_rad: f64) {
        self.zero_rad = zero_rad;
    }

    /// Turns the axle at a speed, radians per second, for one lease: writes the speed where it
    /// changes, and the command where the speed changes or the lease is due. A speed that is not a
    /// number, or rounds to nothing, stops the motor. A motor that may be another program's is not
    /// written to.
    ///
    /// # Errors
    ///
    /// What the driver answers; the lease then counts as not given.
    pub fn turn(&mut self, rad_s: f64, now_ns: i64) -> Result<(), DeviceError> {
        if self.hand != Hand::Ours {
            return Ok(());
        }
        // Most ticks ask for what the one before did.
        if self.asked.0.to_bits() != rad_s.to_bits() {
            self.asked = (rad_s, self.counts_s(rad_s));
        }
        let (_, speed_counts_s) = self.asked;
        if speed_counts_s == 0 {
            return self.stop(StopAction::Brake);
        }
        let same = self.lease.filter(|lease| lease.speed_counts_s == speed_counts_s);
        if same.is_some_and(|lease| now_ns - lease.given_ns < RENEW_NS) {
            return Ok(());
        }
        // What we write next would hide, and undo, what another program has done meanwhile, or be
        // changed by it.
        if self.look_closely(now_ns) {
            return Ok(());
        }
        // Until the command is through, the next call must count on nothing.
        self.lease = None;
        self.moving = true;
        self.set_stop_action(self.brake)?;
        if same.is_none() {
            self.motor.set_speed_sp(speed_counts_s)?;
            self.speed_sp = Some(speed_counts_s);
        }
        self.motor.command(TachoCommand::RunTimed)?;
        self.lease = Some(Lease { speed_counts_s, given_ns: now_ns });
        Ok(())
    }

    /// Ends a motion now; writes nothing if the motor was stopped like this before, or is another
    /// program's.
    ///
    /// # Errors
    ///
    /// What the driver answers; the motor then still counts as moving, and the next call tries
    /// again.
    pub fn stop(&mut self, action: StopAction) -> Result<(), DeviceError> {
        let action = if action == StopAction::Brake { self.brake } else { action };
        if matches!(self.hand, Hand::Theirs(_)) || (!self.moving && self.stop_action == action) {
            return Ok(());
        }
        self.lease = None;
        self.moving = true;
        self.set_stop_action(action)?;
        self.motor.stop()?;
        self.moving = false;
        Ok(())
    }

    /// Checks whether the motor is as we left it: true from the second look in a row that finds it
    /// otherwise. From then on it is another program's, and is never written again, even on drop. A
    /// failed read proves nothing.
    pub fn is_taken(&mut self, aspect: Aspect, now_ns: i64) -> bool {
        let contradicts = self.contradicts(aspect, now_ns);
        match self.hand {
            Hand::Theirs(_) => return true,
            Hand::Ours | Hand::InDoubt if !contradicts => self.hand = Hand::Ours,
            Hand::Ours => self.hand = Hand::InDoubt,
            Hand::InDoubt => {
                if aspect.is_setting() && self.lease.is_some() {
                    // Should it have come between our last look and our last command, that may not
                    // end by itself.
                    self.end_own_motion();
                }
                self.hand = Hand::Theirs(aspect);
                self.motor.set_stops_on_drop(false);
                return true;
            }
        }
        false
    }

    /// Brakes at once, whatever the settings are. What the driver refuses is left: the motor is
    /// another program's from now on.
    fn end_own_motion(&mut self) {
        let _ = self.motor.set_ramp_down_sp(0);
        let _ = self.motor.set_stop_action(self.brake);
        let _ = self.motor.stop();
        self.lease = None;
    }

    /// What of the motor showed another program's hand, if anything did.
    #[must_use]
    pub fn taken_at(&self) -> Option<Aspect> {
        match self.hand {
            Hand::Theirs(aspect) => Some(aspect),
            Hand::Ours | Hand::InDoubt => None,
        }
    }

    /// As [`LeasedMotor::is_taken`], by all aspects, each at once again where it raises a doubt.
    pub fn look_closely(&mut self, now_ns: i64) -> bool {
        Aspect::ALL.into_iter().any(|aspect| {
            self.is_taken(aspect, now_ns) || (self.is_in_doubt() && self.is_taken(aspect, now_ns))
        })
    }

    /// True where the last look found it otherwise than we left it.
    #[must_use]
    pub fn is_in_doubt(&self) -> bool {
        self.hand == Hand::InDoubt
    }

    fn contradicts(&self, aspect: Aspect, now_ns: i64) -> bool {
        match aspect {
            Aspect::State => self.motor.state().is_ok_and(|state| match self.lease {
                Some(lease) => !state.is_driven() && now_ns - lease.given_ns < RUNS_NS,
                None => state.is_driven() && !self.moving,
            }),
            Aspect::Speed => self
                .speed_sp
                .is_some_and(|ours| self.motor.speed_sp().is_ok_and(|speed| speed != ours)),
            Aspect::Duty => self.motor.duty_cycle_sp().is_ok_and(|duty| duty.percent() != 0),
            Aspect::Time => self.motor.time_sp().is_ok_and(|time_ms| time_ms != LEASE_MS),
            Aspect::StopAction => {
                self.motor.stop_action().is_ok_and(|action| action != self.stop_action)
            }
            Aspect::RampUp => self.motor.ramp_up_sp().is_ok_and(|ramp_ms| ramp_ms != 0),
            Aspect::RampDown => self.motor.ramp_down_sp().is_ok_and(|ramp_ms| ramp_ms != 0),
            Aspect::Polarity => {
                self.motor.polarity().is_ok_and(|polarity| polarity != Polarity::Normal)
            }
        }
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
    fn counts_s(&self, rad_s: f64) -> i32 {
        let top = f64::from(self.motor.max_speed());
        let counts_s = rad_s.clamp(-self.max_rad_s, self.max_rad_s) * self.counts_per_axle_rad;
        rounded(counts_s.clamp(-top, top))
    }
}
