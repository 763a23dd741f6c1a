//! The regulator of speed and position, in the driver's 32-bit arithmetic.

/// Gains, integral and last error. Gains are in ten-thousandths of a percent of duty cycle.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Pid {
    pub(crate) kp: i32,
    pub(crate) ki: i32,
    pub(crate) kd: i32,
    pub(crate) setpoint: i32,
    integral: i32,
    last_error: i32,
    /// The last output was beyond ±100 % before it was clamped.
    pub(crate) overloaded: bool,
}

impl Pid {
    /// A regulator at rest, with these gains.
    pub(crate) fn new(kp: i32, ki: i32, kd: i32) -> Self {
        Self { kp, ki, kd, ..Self::default() }
    }

    /// Forgets everything but the gains.
    pub(crate) fn clear(&mut self) {
        *self = Self::new(self.kp, self.ki, self.kd);
    }

    /// One tick: the duty cycle for what was measured, in percent.
    ///
    /// The difference has the sign of the driver, which is turned round against textbooks. An
    /// integral that would saturate the output is rolled back. All terms wrap at 32 bits: a hold
    /// error of more than 26 843 counts turns the large motor's output round.
    pub(crate) fn update(&mut self, value: i32) -> i32 {
        let error = self.setpoint.wrapping_sub(value);
        self.integral = self.integral.wrapping_add(error);
        let difference = self.last_error.wrapping_sub(error);
        self.last_error = error;
        let output = self
            .kp
            .wrapping_mul(error)
            .wrapping_add(self.ki.wrapping_mul(self.integral))
            .wrapping_add(self.kd.wrapping_mul(difference))
            / 10_000;
        self.overloaded = !(-100..=100).contains(&output);
        if self.overloaded {
            self.integral = self.integral.wrapping_sub(error);
        }
        output.clamp(-100, 100)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_large_motors_hold_saturates_from_13_counts_and_turns_round_by_overflow() {
        for (error, output, overloaded) in [
            (1, 8, false),
            (12, 96, false),
            (13, 100, true),
            (-13, -100, true),
            (26_843, 100, true),
            (26_844, -100, true),
        ] {
            let mut pid = Pid::new(80_000, 0, 0);
            pid.setpoint = error;
            assert_eq!((pid.update(0), pid.overloaded), (output, overloaded), "at {error} counts");
        }
    }

    #[test]
    fn a_saturated_output_leaves_the_integral_alone() {
        let mut pid = Pid::new(1000, 60, 0);
        pid.setpoint = 1050;
        for _ in 0..100 {
            assert_eq!(pid.update(0), 100);
        }
        pid.setpoint = 100;
        assert_eq!(pid.update(0), 10, "0.1 % a count and nothing of the hundred ticks before");
    }
}
