//! The motors there are: the constants of `ev3_motor_defs.c`.

use super::pid::Pid;
use crate::sim::physics::MotorKind;

/// A type of motor.
#[derive(Debug)]
pub(crate) struct Model {
    pub(crate) driver_name: &'static str,
    pub(super) max_speed: i32,
    hold_kp: i32,
    pub(super) full_travel_count: i32,
}

pub(super) const COUNT_PER_ROT: i32 = 360;
pub(super) const COUNT_PER_M: i32 = 2000;

/// All of them, in the order of the driver's own table: what `set_device` of an output port takes.
pub(crate) static MODELS: [Model; 5] = [
    rotary("lego-nxt-motor", 1020, 80_000),
    rotary("lego-ev3-l-motor", 1050, 80_000),
    rotary("lego-ev3-m-motor", 1560, 160_000),
    linear("act-l12-ev3-50", 100),
    linear("act-l12-ev3-100", 200),
];

const fn rotary(driver_name: &'static str, max_speed: i32, hold_kp: i32) -> Model {
    Model { driver_name, max_speed, hold_kp, full_travel_count: 0 }
}

const fn linear(driver_name: &'static str, full_travel_count: i32) -> Model {
    Model { driver_name, max_speed: 24, hold_kp: 40_000, full_travel_count }
}

impl Model {
    /// The model of a motor; none for one without an encoder.
    pub(crate) fn of(kind: MotorKind) -> Option<&'static Self> {
        let [_, large, medium, linear_50, linear_100] = &MODELS;
        match kind {
            MotorKind::Large => Some(large),
            MotorKind::Medium => Some(medium),
            MotorKind::Linear50 => Some(linear_50),
            MotorKind::Linear100 => Some(linear_100),
            MotorKind::Rcx => None,
        }
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
