//! What the simulated drivers ask of the world around them.
//!
//! The drivers (`sim::driver`) know files, commands and regulators; the world (`sim::world`) knows
//! walls, bodies and motors. This trait is all that they share, so that a driver test can put a
//! motor model of its own under the drivers.

use std::any::Any;
use std::fmt::Debug;

/// What a motor's bridge does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Bridge {
    /// Both inputs low: no current.
    #[default]
    Coast,
    /// Both inputs high: windings shorted.
    Brake,
    /// Pulse width in percent, −100 to 100; the off-phase shorts the windings.
    Duty(i32),
}

/// The motors there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum MotorKind {
    /// `lego-ev3-l-motor`.
    Large,
    /// `lego-ev3-m-motor`.
    Medium,
    /// `act-l12-ev3-50`.
    Linear50,
    /// `act-l12-ev3-100`.
    Linear100,
    /// `rcx-motor`: no encoder, on a port in mode `dc-motor`.
    Rcx,
}

/// The sensors there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum SensorKind {
    /// `lego-ev3-touch`.
    Touch,
    /// `lego-ev3-color`.
    Colour,
    /// `lego-ev3-us`.
    Ultrasonic,
    /// `lego-ev3-gyro`.
    Gyro,
    /// `lego-ev3-ir`.
    Infrared,
}

/// What is plugged into a robot's ports: outA to outD, in1 to in4.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Plug {
    /// By output port.
    pub motors: [Option<MotorKind>; 4],
    /// By input port.
    pub sensors: [Option<SensorKind>; 4],
}

/// What goes wrong on purpose where the drivers do not see it.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Fault {
    /// The shaft of the motor on an output port (0 for outA) does not turn.
    BlockedMotor(usize),
    /// The motor on an output port turns again.
    FreedMotor(usize),
    /// The battery's voltage at rest from now on.
    BatteryV(f64),
    /// The battery is again as the world has it.
    OwnBattery,
}

/// Motors, bodies and what sensors see, for every robot in one world.
pub trait Physics: Any + Debug + Send {
    /// How many robots there are.
    fn robots(&self) -> usize;

    /// What is plugged into a robot at the start.
    fn plug(&self, robot: usize) -> Plug;

    /// Lets [`STEP_NS`] pass; `bridges` has one row a robot, one entry an output port.
    fn step(&mut self, bridges: &[[Bridge; 4]]);

    /// The co-processor's count of quadrature edges on an output port: 720 a turn of a rotary
    /// motor, positive is the motor's own positive direction.
    fn edges(&self, robot: usize, out: usize) -> i64;

    /// Where the motor is between two edges: [`Physics::edges`] is this, rounded down. The drivers
    /// take the time of each edge from it; without it, edges are spread evenly over a step, and
    /// slow speeds read a few percent off.
    #[expect(clippy::cast_precision_loss, reason = "counts stay far below 2^53")]
    fn edge_position(&self, robot: usize, out: usize) -> f64 {
        self.edges(robot, out) as f64
    }

    /// What the sensor on an input port measures now in a mode, as the integers of its data frame
    /// (`value0`, `value1`, …).
    ///
    /// `mode` is one of the sensor's modes as the kernel spells it. A touch sensor gives 0 or 1. A
    /// gyro's angle counts from when it was switched on: zeroing it is the driver's part.
    ///
    /// Called once for each frame the sensor sends, which is how often there is a new value; noise
    /// is drawn here.
    fn measure(&mut self, robot: usize, input: usize, mode: &str) -> [i32; 8];

    /// Makes something go wrong with a robot from the next step on. A world without such faults
    /// takes no notice.
    fn fail(&mut self, _robot: usize, _fault: Fault) {}

    /// Puts a robot elsewhere as a hand would, standing still: x and y in metres and the heading in
    /// radians, or where it started. False where there is no room for it; physics without places
    /// has none.
    fn place(&mut self, _robot: usize, _pose: Option<[f64; 3]>) -> bool {
        false
    }

    /// Battery voltage and current, volts and amperes.
    fn battery(&self, robot: usize) -> (f64, f64);
}

/// The time that one step takes, in nanoseconds: the period of the motor drivers' regulation.
pub const STEP_NS: i64 = 2_000_000;
