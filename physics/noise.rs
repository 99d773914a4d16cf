//! Random numbers that are the same on every run.

use rand_pcg::Pcg64;
use rand_pcg::rand_core::{Rng, SeedableRng};

/// One stream of random numbers.
///
/// Each user has its own stream, named by what it is for, so that one more user does not
/// shift what the others draw. The generator (PCG XSL RR 128/64) has a documented sequence.
#[derive(Debug, Clone)]
pub struct Noise(Pcg64);

impl Noise {
    /// The stream that the run's `seed` and the user's `name` give.
    #[must_use]
    pub fn new(seed: u64, name: &str) -> Self {
        // FNV-1a tells the names apart; the generator's own seeding does the mixing.
        let stream = name.bytes().fold(0xCBF2_9CE4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3)
        });
        let mut bytes = [0; 32];
        bytes[..8].copy_from_slice(&seed.to_le_bytes());
        bytes[8..16].copy_from_slice(&stream.to_le_bytes());
        bytes[16..24].copy_from_slice(&stream.to_le_bytes());
        Self(Pcg64::from_seed(bytes))
    }

    /// Evenly spread over 0 ≤ x < 1.
    pub fn uniform(&mut self) -> f64 {
        #[expect(clippy::cast_precision_loss, reason = "53 bits fit")]
        let mantissa = (self.0.next_u64() >> 11) as f64;
        mantissa / 9_007_199_254_740_992.0
    }

    /// Evenly spread over 0..`end`; 0 if that is empty.
    pub fn below(&mut self, end: u32) -> u32 {
        // The high half of a product keeps the bias under one in four thousand million.
        let product = (self.0.next_u64() >> 32) * u64::from(end);
        u32::try_from(product >> 32).unwrap_or(0)
    }

    /// Any byte.
    pub fn byte(&mut self) -> u8 {
        u8::try_from(self.below(256)).unwrap_or(u8::MAX)
    }

    /// About normally distributed with mean 0 and standard deviation 1, never beyond ±6.
    ///
    /// The sum of twelve uniform numbers needs no transcendental function, which could differ
    /// between platforms.
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

#[cfg(test)]
mod tests;
