//! The motors there are: the constants of `ev3_motor_defs.c`.

use super::pid::Pid;
use crate::sim::driver::{Spec, readable, readwriteable, writeable};
use crate::sim::physics::MotorKind;

/// A type of motor.
#[derive(Debug)]
pub(crate) struct Model {
    pub(super) driver_name: &'static str,
    pub(super) attributes: &'static [Spec],
    pub(super) max_speed: i32,
    hold_kp: i32,
    pub(super) full_travel_count: i32,
}

pub(super) const COUNT_PER_ROT: i32 = 360;
pub(super) const COUNT_PER_M: i32 = 2000;

macro_rules! attributes {
    ($($first:expr),+) => {
        &[
            $($first,)+
            readable("address"),
            writeable("command"),
            readable("commands"),
            readable("driver_name"),
            readable("duty_cycle"),
            readwriteable("duty_cycle_sp"),
            readwriteable("hold_pid/Kd"),
            readwriteable("hold_pid/Ki"),
            readwriteable("hold_pid/Kp"),
            readable("max_speed"),
            readwriteable("polarity"),
            readwriteable("position"),
            readwriteable("position_sp"),
            readwriteable("ramp_down_sp"),
            readwriteable("ramp_up_sp"),
            readable("speed"),
            readwriteable("speed_pid/Kd"),
            readwriteable("speed_pid/Ki"),
            readwriteable("speed_pid/Kp"),
            readwriteable("speed_sp"),
            readable("state"),
            readwriteable("stop_action"),
            readable("stop_actions"),
            readwriteable("time_sp"),
        ]
    };
}

const ROTARY: &[Spec] = attributes!(readable("count_per_rot"));
const LINEAR: &[Spec] = attributes!(readable("count_per_m"), readable("full_travel_count"));

static LARGE: Model = Model {
    driver_name: "lego-ev3-l-motor",
    attributes: ROTARY,
    max_speed: 1050,
    hold_kp: 80_000,
    full_travel_count: 0,
};
static MEDIUM: Model = Model {
    driver_name: "lego-ev3-m-motor",
    attributes: ROTARY,
    max_speed: 1560,
    hold_kp: 160_000,
    full_travel_count: 0,
};
static NXT: Model = Model {
    driver_name: "lego-nxt-motor",
    attributes: ROTARY,
    max_speed: 1020,
    hold_kp: 80_000,
    full_travel_count: 0,
};
static LINEAR_50: Model = Model {
    driver_name: "act-l12-ev3-50",
    attributes: LINEAR,
    max_speed: 24,
    hold_kp: 40_000,
    full_travel_count: 100,
};
static LINEAR_100: Model = Model {
    driver_name: "act-l12-ev3-100",
    attributes: LINEAR,
    max_speed: 24,
    hold_kp: 40_000,
    full_travel_count: 200,
};

/// What `set_device` of an output port takes.
pub(crate) const DRIVER_NAMES: [&str; 5] =
    ["lego-nxt-motor", "lego-ev3-l-motor", "lego-ev3-m-motor", "act-l12-ev3-50", "act-l12-ev3-100"];

impl Model {
    /// The model of a motor; none for one without an encoder.
    pub(crate) fn of(kind: MotorKind) -> Option<&'static Self> {
        match kind {
            MotorKind::Large => Some(&LARGE),
            MotorKind::Medium => Some(&MEDIUM),
            MotorKind::Linear50 => Some(&LINEAR_50),
            MotorKind::Linear100 => Some(&LINEAR_100),
            MotorKind::Rcx => None,
        }
    }

    /// What a port in mode `tacho-motor` binds until `set_device` names something else.
    pub(crate) fn large() -> &'static Self {
        &LARGE
    }

    /// What a port binds that does not find out what is plugged in.
    pub(crate) fn nxt() -> &'static Self {
        &NXT
    }

    /// The model at a place in [`DRIVER_NAMES`].
    pub(crate) fn named(index: usize) -> Option<&'static Self> {
        [&NXT, &LARGE, &MEDIUM, &LINEAR_50, &LINEAR_100].get(index).copied()
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
