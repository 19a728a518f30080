//! Which observations count, and what the others cost: an objective that never rises when the set changes.
//!
//! `F(x, A) = ½ Σ_{o∈A} ρ_o + ½ τ |Aᶜ|` (source: `solver.md` §5.4). During a trial the set is frozen and an observation
//! that falls behind its camera is charged τ; after acceptance the set changes only in ways that lower F.

use crate::loss::Loss;

/// How observations come and go during a solve.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Activation {
    /// Observations with a valid projection at the start count, whatever their residual. One that falls behind its
    /// camera on the way leaves for good, charged with its last cost.
    #[default]
    ValidAtStart,
    /// Every observation counts, also behind its camera: it is projected through the centre, as the reference solvers of
    /// BAL problems do. For comparing with them; in a reconstruction it pulls points through cameras.
    All,
    /// The truncated objective: an observation beyond `residual_limit_px` leaves, and returns when it fits again. The
    /// limit must suit the state: with a start that is 100 px off, a limit of 16 px leaves nothing to solve.
    Truncated {
        /// `τ = ρ(residual_limit_px²)`.
        residual_limit_px: f64,
    },
}

/// Depths at or below this share of the image's median depth count as behind the camera (source: `solver.md` §5.4).
pub const MIN_RELATIVE_DEPTH: f64 = 0.05;
/// An inactive observation returns when its cost falls below this share of τ; the gap prevents flicker.
const RETURN_SHARE: f64 = 0.8;
/// A trial that would throw more than this share of the active observations behind cameras is refused.
const MAX_FLIPPED_SHARE: f64 = 0.01;

/// Sums go in blocks: a running sum of millions of terms loses digits (source: `solver.md` §1.4).
const SUM_BLOCK: usize = 1024;

/// The set and its charges.
#[derive(Clone, Debug)]
pub struct ActiveSet {
    activation: Activation,
    tau: f64,
    active: Vec<bool>,
    count: usize,
    /// `Σ ρ` of observations that left for good.
    retired: f64,
    started: bool,
}

impl ActiveSet {
    /// A set of observations, undecided until the first update.
    pub fn new(activation: Activation, loss: Loss, observations: usize) -> Self {
        let tau = match activation {
            Activation::ValidAtStart | Activation::All => 0.0,
            Activation::Truncated { residual_limit_px } => loss.value(residual_limit_px * residual_limit_px),
        };
        Self { activation, tau, active: vec![false; observations], count: 0, retired: 0.0, started: false }
    }

    /// Whether an observation counts.
    #[inline]
    pub fn is_active(&self, observation: usize) -> bool {
        self.active[observation]
    }

    /// How many count.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Whether inactive observations may return, so that their residuals must be kept up.
    pub fn may_return(&self) -> bool {
        matches!(self.activation, Activation::Truncated { .. })
    }

    /// The change of `Σ ρ` that a trial is charged for an active observation that falls behind its camera.
    #[inline]
    pub fn flip_charge(&self, rho_before: f64) -> f64 {
        if self.may_return() { self.tau - rho_before } else { 0.0 }
    }

    /// Whether so many observations falling behind cameras make a trial unacceptable.
    pub fn refuses(&self, flipped: usize) -> bool {
        flipped as f64 > MAX_FLIPPED_SHARE * self.count as f64
    }

    /// F at a state near the accepted one, with the set as it is.
    pub fn cost(&self, rho: impl Fn(usize) -> f64) -> f64 {
        let mut sum = 0.0;
        for (block, flags) in self.active.chunks(SUM_BLOCK).enumerate() {
            let terms = flags.iter().enumerate();
            sum += terms.map(|(k, &flag)| if flag { rho(block * SUM_BLOCK + k) } else { self.tau }).sum::<f64>();
        }
        0.5 * (sum + self.retired)
    }

    /// Decides the set at an accepted state and returns F. `rho(o)` is the observation's ρ, NaN where it has no valid
    /// projection; `rho_before(o)` its value at the state accepted before, used for those that just became invalid.
    pub fn update(&mut self, rho: impl Fn(usize) -> f64, rho_before: impl Fn(usize) -> f64) -> f64 {
        let mut sum = 0.0;
        self.count = 0;
        let may_return = self.may_return();
        for (block, flags) in self.active.chunks_mut(SUM_BLOCK).enumerate() {
            let mut part = 0.0;
            for (k, flag) in flags.iter_mut().enumerate() {
                let o = block * SUM_BLOCK + k;
                let value = rho(o);
                let valid = value.is_finite();
                let stays = if may_return {
                    valid && if *flag || !self.started { value < self.tau } else { value < RETURN_SHARE * self.tau }
                } else {
                    valid && (*flag || !self.started)
                };
                if *flag && !stays && !may_return {
                    self.retired += rho_before(o);
                }
                *flag = stays;
                if stays {
                    part += value;
                    self.count += 1;
                } else {
                    part += self.tau;
                }
            }
            sum += part;
        }
        self.started = true;
        0.5 * (sum + self.retired)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truncated_objective_never_rises_and_returns_with_hysteresis() {
        let mut set = ActiveSet::new(Activation::Truncated { residual_limit_px: 2.0 }, Loss::Squared, 3);
        let before = set.update(|o| [1.0, 9.0, f64::NAN][o], |_| f64::NAN);
        assert_eq!((before, set.count()), (0.5 * (1.0 + 4.0 + 4.0), 1));
        // 3.5 is under τ = 4 but not under 0.8 τ: it stays out; the charge for falling behind is τ.
        assert_eq!(set.flip_charge(1.0), 3.0);
        let after = set.update(|o| [f64::NAN, 3.5, 3.0][o], |_| f64::NAN);
        assert_eq!(set.count(), 1);
        assert!(set.is_active(2) && after == 0.5 * (4.0 + 4.0 + 3.0));
    }

    #[test]
    fn fixed_set_charges_the_last_cost_of_what_leaves() {
        let mut set = ActiveSet::new(Activation::ValidAtStart, Loss::Squared, 2);
        let before = set.update(|o| [1.0, 9.0][o], |_| f64::NAN);
        let after = set.update(|o| [1.0, f64::NAN][o], |o| [1.0, 9.0][o]);
        assert_eq!((before, after, set.count()), (5.0, 5.0, 1));
        assert_eq!(set.update(|o| [0.5, 1.0][o], |_| f64::NAN), 0.5 * 9.5);
    }
}
