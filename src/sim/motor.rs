//! Motors with their gears: voltage to torque, friction, brake and coast.
//!
//! A linear motor with everything referred to the output shaft: `i = (V − Ke·ω)/R`, torque `Kt·i`
//! less friction, `J·dω/dt` = torque. The off-phase of the bridge shorts the windings, so the mean
//! voltage of a duty counts, and brake is 0 V. Coast opens the circuit: only friction is left.
//!
//! # Not here
//!
//! No regulation, no positions in counts: `sim::driver`. What hangs on the shaft: `sim::body`.
//!
//! # What we count on
//!
//! A step of 2 ms against mechanical time constants of 80 ms and more; the electrical damping is
//! stepped implicitly, so that a step never overshoots.

use super::physics::{Bridge, MotorKind};

/// What a kind of motor is made of, at the output shaft.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotorConstants {
    /// Torque constant, newton metres an ampere.
    pub kt_nm_per_a: f64,
    /// Back-EMF, volt seconds a radian.
    pub ke_v_s: f64,
    /// Winding and bridge, ohms.
    pub r_ohm: f64,
    /// Inertia, kilogram square metres.
    pub j_kg_m2: f64,
    /// Friction while turning, newton metres.
    pub friction_nm: f64,
    /// Torque that it takes to break away from rest, newton metres.
    pub stiction_nm: f64,
}

impl MotorConstants {
    /// The constants of a kind of motor.
    ///
    /// # Source
    ///
    /// Large and medium: Pybricks' fit as recomputed in the interfaces' section 15.2, but for the
    /// large motor's friction and inertia, which are fitted to the `ev3-motor-steps` recordings
    /// (`tests/it/figures/motor_steps.rs`): those fix both as shares of the battery's voltage, and
    /// with Ke as given the fit finds 5.5 V at the motor. Stiction: 1.2 times friction, which
    /// leaves the first 5 % (large) to 17 % (medium) of duty dead. The linear actuators are the
    /// medium motor behind a screw, which adds friction; the RCX motor is a faster, weaker medium
    /// motor.
    #[must_use]
    pub const fn of(kind: MotorKind) -> Self {
        match kind {
            MotorKind::Large => Self::with(0.2746, 0.4731, 5.50, 0.002_62, 0.0149),
            MotorKind::Medium => Self::with(0.246, 0.291, 10.7, 0.000_52, 0.0246),
            MotorKind::Linear50 | MotorKind::Linear100 => {
                Self::with(0.246, 0.291, 10.7, 0.000_52, 0.05)
            }
            MotorKind::Rcx => Self::with(0.20, 0.235, 14.0, 0.0004, 0.02),
        }
    }

    const fn with(
        kt_nm_per_a: f64,
        ke_v_s: f64,
        r_ohm: f64,
        j_kg_m2: f64,
        friction_nm: f64,
    ) -> Self {
        Self { kt_nm_per_a, ke_v_s, r_ohm, j_kg_m2, friction_nm, stiction_nm: 1.2 * friction_nm }
    }
}

/// One motor that turns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motor {
    constants: MotorConstants,
    load_kg_m2: f64,
    /// Inertia of rotor, gears and what is fixed to the shaft.
    pub(in crate::sim) inertia_kg_m2: f64,
    /// Angle of the output shaft, radians, positive in the motor's own direction.
    pub angle_rad: f64,
    /// Speed of the output shaft, radians a second.
    pub speed_rad_s: f64,
    /// What the motor draws from the battery, amperes.
    pub current_a: f64,
}

impl Motor {
    /// A motor at rest, with a load's inertia and friction fixed to its shaft.
    #[must_use]
    pub fn new(mut constants: MotorConstants, load_kg_m2: f64, load_friction_nm: f64) -> Self {
        constants.friction_nm += load_friction_nm;
        constants.stiction_nm += load_friction_nm;
        let inertia_kg_m2 = constants.j_kg_m2 + load_kg_m2;
        Self {
            constants,
            load_kg_m2,
            inertia_kg_m2,
            angle_rad: 0.0,
            speed_rad_s: 0.0,
            current_a: 0.0,
        }
    }

    /// Changes the speed by what bridge and friction do in `step_s`; the angle is moved by
    /// [`Motor::turn`], after loads have acted.
    pub fn drive(&mut self, bridge: Bridge, battery_v: f64, step_s: f64) {
        let c = self.constants;
        let share = match bridge {
            Bridge::Coast => None,
            Bridge::Brake => Some(0.0),
            Bridge::Duty(duty) => Some(f64::from(duty.clamp(-100, 100)) / 100.0),
        };
        let at_rest = self.speed_rad_s.abs() < 1e-9;
        self.current_a = 0.0;
        if let Some(share) = share {
            let gain = step_s / self.inertia_kg_m2 * c.kt_nm_per_a / c.r_ohm;
            let volts = share * battery_v;
            self.speed_rad_s = (self.speed_rad_s + gain * volts) / (1.0 + gain * c.ke_v_s);
            // The bridge's on-time carries the winding's current from the battery; the rest of it
            // runs round inside.
            self.current_a = ((volts - c.ke_v_s * self.speed_rad_s) / c.r_ohm * share).max(0.0);
        }
        let friction_nm = if at_rest { c.stiction_nm } else { c.friction_nm };
        self.speed_rad_s = toward_zero(self.speed_rad_s, friction_nm * step_s / self.inertia_kg_m2);
    }

    /// Holds the shaft fast, or lets it go: a blocked shaft has the inertia of a mountain.
    pub fn block(&mut self, blocked: bool) {
        self.speed_rad_s = 0.0;
        self.inertia_kg_m2 = if blocked { 1e6 } else { self.constants.j_kg_m2 + self.load_kg_m2 };
    }

    /// Moves the shaft by its speed.
    pub fn turn(&mut self, step_s: f64) {
        self.angle_rad += self.speed_rad_s * step_s;
    }
}

/// A number brought nearer to 0 by at most `by`.
pub(in crate::sim) fn toward_zero(value: f64, by: f64) -> f64 {
    if value.abs() <= by { 0.0 } else { value - by * value.signum() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(bridge: Bridge, start_rad_s: f64, seconds: f64) -> Motor {
        let mut motor = Motor::new(MotorConstants::of(MotorKind::Large), 0.0, 0.0);
        motor.speed_rad_s = start_rad_s;
        let mut left_s = seconds;
        while left_s > 0.0 {
            motor.drive(bridge, 7.5, 0.002);
            motor.turn(0.002);
            left_s -= 0.002;
        }
        motor
    }

    #[test]
    fn a_large_motor_at_9_volts_turns_near_its_nominal_speed() {
        let mut motor = Motor::new(MotorConstants::of(MotorKind::Large), 0.0, 0.0);
        for _ in 0..1000 {
            motor.drive(Bridge::Duty(100), 9.0, 0.002);
        }
        let dps = crate::units::degrees(motor.speed_rad_s);
        assert!((dps - 1050.0).abs() < 40.0, "{dps} deg/s");
    }

    #[test]
    fn a_few_percent_of_duty_do_not_move_it() {
        assert_eq!(run(Bridge::Duty(4), 0.0, 1.0).angle_rad.to_bits(), 0.0_f64.to_bits());
        assert!(run(Bridge::Duty(7), 0.0, 1.0).angle_rad > 0.1);
        assert!(run(Bridge::Duty(-7), 0.0, 1.0).angle_rad < -0.1);
    }

    #[test]
    fn a_coasting_motor_slows_down_and_a_braking_one_sooner() {
        let coast = run(Bridge::Coast, 10.0, 0.5).speed_rad_s;
        let brake = run(Bridge::Brake, 10.0, 0.5).speed_rad_s;
        assert!(brake < coast && coast < 10.0 && brake >= 0.0, "coast {coast}, brake {brake}");
        assert!(run(Bridge::Coast, 10.0, 10.0).speed_rad_s.abs() < 1e-12);
    }
}
