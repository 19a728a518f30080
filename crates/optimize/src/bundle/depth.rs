//! Metric depth as data of a bundle problem: one inverse depth and one weight per observation.

use crate::loss::Loss;

/// Depths count as wrong, not as noisy, from this many of their standard deviations (source: `solver.md` §5.3).
pub const DEPTH_LOSS_SIGMAS: f64 = 3.0;

/// What is known of the observations' depths: adds `½ Σ ρ((w (1/z − ρ̂))²)` to the cost, `z` being the third coordinate of
/// the point in the camera's frame (source: `solver.md` §1.1; the paper's stacked residual, §3.1, with a weight that
/// follows the uncertainty). The scale of the answer is then no longer free.
///
/// One entry per observation, of every observation: where nothing is known the weight is 0 and the row is zero.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Depth {
    /// ρ̂, the reference inverse depth, 1 / world unit; 0 says infinitely far.
    pub inverse: Vec<f64>,
    /// `w = 1/σ(1/z)`, world units: chosen so that one standard deviation weighs as much as one pixel. 0 without depth.
    pub weight: Vec<f64>,
    /// Loss of the depth row alone: a wrong depth must not take its pixel with it.
    pub loss: Loss,
}

impl Depth {
    /// Nothing known yet about `observations` observations, with the loss that suits whitened depths: bounded, so that a
    /// wrong depth costs the same however wrong it is.
    pub fn unknown(observations: usize) -> Self {
        let loss = Loss::GemanMcClure(DEPTH_LOSS_SIGMAS);
        Self { inverse: vec![0.0; observations], weight: vec![0.0; observations], loss }
    }

    /// Sets the depth of one observation with its relative standard deviation: `w = ẑ/ε`, as `σ(1/z) ≈ ε/ẑ`.
    pub fn set(&mut self, observation: usize, depth: f64, relative_sigma: f64) {
        self.inverse[observation] = 1.0 / depth;
        self.weight[observation] = depth / relative_sigma;
    }

    /// Whether any observation has a depth.
    pub fn is_any(&self) -> bool {
        self.weight.iter().any(|&w| w > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_sigma_is_one_pixel() {
        let mut depth = Depth::unknown(2);
        assert!(!depth.is_any());
        depth.set(1, 4.0, 0.1);
        assert!(depth.is_any() && depth.weight[0] == 0.0);
        // 10 % off at 4 m, to first order.
        let residual = depth.weight[1] * (1.0 / 4.4 - depth.inverse[1]);
        assert!((residual + 1.0 / 1.1).abs() < 1e-12, "{residual}");
    }
}
