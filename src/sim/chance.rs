//! Chance that repeats bit for bit: one ChaCha8 stream for each thing that draws.
//!
//! # What we count on
//!
//! A stream belongs to one sensor or one motor, so that reading one sensor more often does not
//! change what another reads.

use std::f64::consts::PI;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// What any 64 bits are as a number from 0 up to, and without, 1; 53 bits count.
#[expect(clippy::cast_precision_loss, reason = "53 bits fit a double")]
pub(in crate::sim) fn even(bits: u64) -> f64 {
    (bits >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
}

/// One stream of chance.
#[derive(Debug, Clone)]
pub(in crate::sim) struct Chance(ChaCha8Rng);

impl Chance {
    /// The stream of a number under a seed.
    pub(in crate::sim) fn new(seed: u64, stream: u64) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(stream);
        Self(generator)
    }

    /// Evenly from 0 up to, and without, 1.
    pub(in crate::sim) fn even(&mut self) -> f64 {
        even(self.0.next_u64())
    }

    /// Normal with mean 0 and deviation 1, by Box and Muller.
    pub(in crate::sim) fn normal(&mut self) -> f64 {
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.even()));
        radius * libm::cos(2.0 * PI * self.even())
    }

    /// A whole number from 0 up to, and without, `limit`; 0 for 0. Its unevenness, 1 in 2^32, does
    /// not matter here.
    pub(in crate::sim) fn below(&mut self, limit: u16) -> u16 {
        u16::try_from(self.0.next_u32() % u32::from(limit).max(1)).unwrap_or(0)
    }

    /// Any number of 32 bits.
    pub(in crate::sim) fn any(&mut self) -> i32 {
        self.0.next_u32().cast_signed()
    }

    /// Any byte.
    pub(in crate::sim) fn byte(&mut self) -> u8 {
        let [byte, ..] = self.0.next_u32().to_le_bytes();
        byte
    }

    /// True with a probability.
    pub(in crate::sim) fn happens(&mut self, probability: f64) -> bool {
        self.even() < probability
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_repeat_and_differ() {
        let draw = |seed, stream| {
            let mut chance = Chance::new(seed, stream);
            (0..8).map(|_| chance.normal().to_bits()).collect::<Vec<_>>()
        };
        assert_eq!(draw(1, 2), draw(1, 2));
        assert_ne!(draw(1, 2), draw(1, 3));
        assert_ne!(draw(1, 2), draw(2, 2));
    }

    #[test]
    fn the_normal_has_mean_0_and_deviation_1() {
        let mut chance = Chance::new(7, 0);
        let draws: Vec<f64> = (0..20_000).map(|_| chance.normal()).collect();
        let mean = draws.iter().sum::<f64>() / 20_000.0;
        let square = draws.iter().map(|x| x * x).sum::<f64>() / 20_000.0;
        assert!(mean.abs() < 0.03 && (square - 1.0).abs() < 0.04, "mean {mean}, square {square}");
    }
}
