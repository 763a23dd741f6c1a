//! Wheel slip, noticed by the gyro against the encoders.
//!
//! Both turns are summed with a memory of half a second. They disagree when their difference is
//! more than whole degrees and an imperfect track width explain: 4° and a fifth of the turn; slip
//! is over below 2° and a fifth, so that it does not flicker.
//!
//! # Not here
//!
//! Both wheels slipping alike on a straight way: neither sensor knows of it.

use serde::{Deserialize, Serialize};

use super::gyro::DEGREE_RAD;

/// What a gyro in whole degrees (1°) and the play of two LEGO wheels (10° of a wheel between them
/// are 2.4° of the seed's robot) can differ by, and a little more.
const ALLOWED_RAD: f64 = 4.0 * DEGREE_RAD;
/// What a track width that is not quite right, and the gyro's scale (3° in 90° by LEGO's word), can
/// differ by.
const ALLOWED_SHARE: f64 = 0.2;
/// How long a turn is remembered.
const MEMORY_S: f64 = 0.5;

/// Whether the two turns, in radians, are further apart than both sensors' errors explain.
///
/// For the turn of a whole manoeuvre; in a run the estimator applies it to the last half second.
#[must_use]
pub fn turns_disagree(encoder_rad: f64, gyro_rad: f64) -> bool {
    let turn_rad = (encoder_rad.abs() + gyro_rad.abs()) / 2.0;
    (encoder_rad - gyro_rad).abs() > ALLOWED_RAD + ALLOWED_SHARE * turn_rad
}

/// What is carried from tick to tick.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct SlipState {
    /// Recent turn by the encoders and by the gyro, fading.
    encoder_rad: f64,
    gyro_rad: f64,
    slipping: bool,
}

impl SlipState {
    /// Takes one tick's turns; returns whether the wheels slip.
    pub(super) fn update(&mut self, passed_s: f64, encoder_rad: f64, gyro_rad: f64) -> bool {
        // The exponential's first order: neither exp nor a division in a tick.
        let keep = 1.0 - passed_s * (1.0 / MEMORY_S);
        let keep = if keep > 0.0 { keep } else { 0.0 };
        self.encoder_rad = self.encoder_rad * keep + encoder_rad;
        self.gyro_rad = self.gyro_rad * keep + gyro_rad;
        self.slipping = if self.slipping {
            turns_disagree(2.0 * self.encoder_rad, 2.0 * self.gyro_rad)
        } else {
            turns_disagree(self.encoder_rad, self.gyro_rad)
        };
        self.slipping
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_track_width_ten_percent_off_is_no_slip_and_a_blocked_robot_is() {
        assert!(!turns_disagree(90.0 * DEGREE_RAD, 81.0 * DEGREE_RAD));
        assert!(!turns_disagree(2.0 * DEGREE_RAD, 0.0));
        assert!(turns_disagree(30.0 * DEGREE_RAD, 0.0));
        assert!(turns_disagree(-30.0 * DEGREE_RAD, 30.0 * DEGREE_RAD));
    }

    #[test]
    fn slip_begins_within_a_fifth_of_a_second_and_ends_once_without_flicker() {
        let mut slip = SlipState::default();
        let turn_rad = 60.0 * DEGREE_RAD / 100.0;
        let begun =
            (0..100).position(|_| slip.update(0.01, turn_rad, 0.0)).expect("slip is noticed");
        assert!(begun < 20, "noticed after {begun} ticks of 10 ms");
        let after: Vec<bool> = (0..400).map(|_| slip.update(0.01, turn_rad, turn_rad)).collect();
        let ended = after.iter().position(|slipping| !slipping).expect("slip ends");
        assert!(after.iter().skip(ended).all(|slipping| !slipping), "it flickers");
    }
}
