//! What dynamic extraction decides from scalars alone, the same on every device: the limit on residuals, and when points
//! are worth a closer look.

use crate::active::Activation;
use crate::loss::Loss;

/// The dynamic limit in units of the geometric mean of the residuals in the set. Of Gaussian noise that mean is 1.06 σ, so
/// that nothing good is lost; and it forgives a large share of wild residuals, which a mean does not.
const LIMIT_FACTOR: f64 = 8.0;
/// The limit falls by at most this factor an accepted step: residuals that are slow to fall stay in the set longer.
const LIMIT_FALL: f64 = 0.5;
/// A step that gained less than this share of the cost is near the optimum.
pub(crate) const NEAR: f64 = 0.05;

/// The limit of a set, and τ = ρ(limit²).
#[derive(Clone, Copy, Debug)]
pub(crate) struct ResidualLimit {
    loss: Loss,
    /// Where a dynamic limit ends, px.
    least_px: Option<f64>,
    pub(crate) px: f64,
    pub(crate) tau: f64,
}

impl ResidualLimit {
    pub(crate) fn new(activation: Activation, loss: Loss) -> Self {
        let (px, least_px) = match activation {
            Activation::ValidAtStart | Activation::All => (0.0, None),
            Activation::Truncated { residual_limit_px } => (residual_limit_px, None),
            Activation::Dynamic { residual_limit_px } => (f64::INFINITY, Some(residual_limit_px)),
        };
        Self { loss, least_px, px, tau: loss.value(px * px) }
    }

    /// Lowers a dynamic limit to what suits a sum of `ln s` over so many observations, s the squared residual in px².
    pub(crate) fn follow(&mut self, sum_of_logs: f64, count: usize) {
        let Some(least_px) = self.least_px else { return };
        if count == 0 && self.px.is_finite() {
            return;
        }
        // At a start without any valid observation there is nothing to go by, and the end is as good as anything.
        let suits = if count > 0 { LIMIT_FACTOR * (0.5 * sum_of_logs / count as f64).exp() } else { least_px };
        let fallen = if self.px.is_finite() { LIMIT_FALL * self.px } else { 0.0 };
        self.px = self.px.min(suits.max(fallen).max(least_px));
        self.tau = self.loss.value(self.px * self.px);
    }
}

/// Steps in a row that gained little.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Progress {
    last_cost: f64,
    near_steps: usize,
}

impl Progress {
    pub(crate) const START: Self = Self { last_cost: f64::INFINITY, near_steps: 0 };

    /// Takes note of an accepted state's cost; says whether it is near the last one's.
    pub(crate) fn note(&mut self, cost: f64) -> bool {
        let near = self.last_cost - cost < NEAR * cost;
        self.near_steps = if near { self.near_steps + 1 } else { 0 };
        self.last_cost = cost;
        near
    }

    /// Far from the optimum a missing observation is nothing to worry about; near it, each look at all points that miss
    /// one costs as much as a step, so it is done after 1, 2, 4, 8, … steps.
    pub(crate) fn is_time_for_all(&self) -> bool {
        self.near_steps.is_power_of_two()
    }
}
