//! Random numbers whose bytes depend on the seed and on nothing else, in one stream per purpose.

use glam::DVec3;
use rand::Rng;
use rand_pcg::Pcg64;

/// Draws an independent stream of numbers for one purpose, so that asking for more noise does not move the cameras.
#[derive(Clone, Copy)]
pub(crate) enum Stream {
    Layout = 1,
    Cameras = 2,
    Keypoints = 3,
    Pairs = 4,
    Perturbation = 5,
    Depths = 6,
}

/// A seeded generator.
pub(crate) struct Random(Pcg64);

impl Random {
    pub(crate) fn new(seed: u64, stream: Stream) -> Self {
        Self(Pcg64::new(u128::from(seed), stream as u128))
    }

    /// Uniform in [0, 1), from the upper 53 bits.
    pub(crate) fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in [low, high).
    pub(crate) fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Uniform in 0..n; `n` must be positive.
    pub(crate) fn index(&mut self, n: usize) -> usize {
        // The bias of the modulo is below 2⁻³⁰ for any count of keypoints.
        (self.0.next_u64() % n as u64) as usize
    }

    pub(crate) fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// Standard normal, by Box and Muller (1958).
    pub(crate) fn gaussian(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.unit()).cos()
    }

    /// Three independent normals with standard deviation `sigma`.
    pub(crate) fn gaussian3(&mut self, sigma: f64) -> DVec3 {
        DVec3::new(self.gaussian(), self.gaussian(), self.gaussian()) * sigma
    }

    /// Uniform on the unit sphere.
    pub(crate) fn direction(&mut self) -> DVec3 {
        self.gaussian3(1.0).normalize_or(DVec3::X)
    }

    /// Pareto with minimum 1 and the given tail index.
    pub(crate) fn pareto(&mut self, tail_index: f64) -> f64 {
        (1.0 - self.unit()).powf(-1.0 / tail_index)
    }

    /// Fisher and Yates.
    pub(crate) fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in (1..items.len()).rev() {
            items.swap(i, self.index(i + 1));
        }
    }
}
