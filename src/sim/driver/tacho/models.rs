//! The motors there are: the constants of `ev3_motor_defs.c`.

use super::pid::Pid;
use crate::sim::physics::MotorKind;

/// A type of motor.
#[derive(Debug)]
pub(crate) struct Model {
    /// None for one that a port only has when it is told so.
    kind: Option<MotorKind>,
    pub(crate) driver_name: &'static str,
    pub(super) max_speed: i32,
    hold_kp: i32,
    /// Counts from one end to the other; 0 for one that turns.
    pub(super) full_travel_count: i32,
}

pub(super) const COUNT_PER_ROT: i32 = 360;
pub(super) const COUNT_PER_M: i32 = 2000;

/// All of them, in the order of the driver's own table: what `set_device` of an output port takes.
pub(crate) static MODELS: [Model; 5] = [
    rotary(None, "lego-nxt-motor", 1020, 80_000),
    rotary(Some(MotorKind::Large), "lego-ev3-l-motor", 1050, 80_000),
    rotary(Some(MotorKind::Medium), "lego-ev3-m-motor", 1560, 160_000),
    linear(MotorKind::Linear50, "act-l12-ev3-50", 100),
    linear(MotorKind::Linear100, "act-l12-ev3-100", 200),
];

const fn rotary(
    kind: Option<MotorKind>,
    driver_name: &'static str,
    max_speed: i32,
    hold_kp: i32,
) -> Model {
    Model { kind, driver_name, max_speed, hold_kp, full_travel_count: 0 }
}

const fn linear(kind: MotorKind, driver_name: &'static str, full_travel_count: i32) -> Model {
    Model { kind: Some(kind), driver_name, max_speed: 24, hold_kp: 40_000, full_travel_count }
}

impl Model {
    /// The model of a motor; none for one without an encoder.
    pub(crate) fn of(kind: MotorKind) -> Option<&'static Self> {
        MODELS.iter().find(|model| model.kind == Some(kind))
    }

    /// What a port in mode `tacho-motor` binds until `set_device` names something else.
    ///
    /// - `detects`: whether the port finds out what is plugged in.
    pub(crate) fn usual(detects: bool) -> &'static Self {
        let [nxt, large, ..] = &MODELS;
        if detects { large } else { nxt }
    }

    /// The regulator of speed, the same for all.
    pub(super) fn speed_pid() -> Pid {
        Pid::new(1000, 60, 0)
    }

    /// The regulator of position.
    pub(super) fn hold_pid(&self) -> Pid {
        Pid::new(self.hold_kp, 0, 0)
    }
}
