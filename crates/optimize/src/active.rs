//! Which observations count, and what the others cost: an objective that never rises when the set changes.
//!
//! `F(x, A) = ½ Σ_{o∈A} ρ_o + ½ τ |Aᶜ|` (source: `solver.md` §5.4). During a trial the set is frozen and an observation
//! that falls behind its camera is charged τ; after acceptance the set changes only in ways that lower F.

use crate::extraction::ResidualLimit;
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
    /// Dynamic parameter extraction (source: InstantSfM §3.4; `solver.md` §5.4): the truncated objective with a limit that
    /// suits the state, wide at a bad start and lowered as the residuals fall; observations enter only inside the
    /// frustum of their image; and points that lost most of their observations are triangulated again wherever that
    /// lowers the objective. Points and images without enough observations keep their values until they have.
    Dynamic {
        /// The limit never falls below this, px.
        residual_limit_px: f64,
    },
}

impl Activation {
    /// [`Self::Dynamic`] down to 4 px, what filters after bundle adjustment use (source: `solver.md` §5.4).
    pub const DYNAMIC: Self = Self::Dynamic { residual_limit_px: 4.0 };
}

/// Depths at or below this share of the image's median depth count as behind the camera (source: `solver.md` §5.4).
pub const MIN_RELATIVE_DEPTH: f64 = 0.05;
/// An inactive observation returns when its cost falls below this share of τ; the gap prevents flicker.
pub(crate) const RETURN_SHARE: f64 = 0.8;
/// A trial that would throw more than this share of the active observations behind cameras is refused.
pub(crate) const MAX_FLIPPED_SHARE: f64 = 0.01;
/// Squared residuals below this are as good as none, px².
pub(crate) const LEAST_SQUARE: f64 = 1e-12;

/// Sums go in blocks: a running sum of millions of terms loses digits (source: `solver.md` §1.4).
const SUM_BLOCK: usize = 1024;

/// The set and its charges.
#[derive(Clone, Debug)]
pub struct ActiveSet {
    activation: Activation,
    limit: ResidualLimit,
    active: Vec<bool>,
    count: usize,
    /// `Σ ρ` of observations that left for good.
    retired: f64,
    started: bool,
    /// Empty where nobody said what is occluded.
    hidden: Vec<bool>,
}

impl ActiveSet {
    /// A set of observations, undecided until the first update.
    pub fn new(activation: Activation, loss: Loss, observations: usize) -> Self {
        let (limit, active) = (ResidualLimit::new(activation, loss), vec![false; observations]);
        Self { activation, limit, active, count: 0, retired: 0.0, started: false, hidden: Vec::new() }
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
        matches!(self.activation, Activation::Truncated { .. } | Activation::Dynamic { .. })
    }

    /// Whether the limit follows the state, and points may be triangulated again.
    pub fn is_dynamic(&self) -> bool {
        matches!(self.activation, Activation::Dynamic { .. })
    }

    /// The residual at which an observation stops counting, px.
    pub fn limit_px(&self) -> f64 {
        self.limit.px
    }

    /// Whether the set was decided at least once.
    pub fn has_started(&self) -> bool {
        self.started
    }

    /// Says which observations are occluded, whatever the geometry says; decided at the next update. They are charged as
    /// any other outside the set: hiding one is the only thing that raises F, by what it cost less than τ.
    pub fn occlude(&mut self, hidden: Vec<bool>) {
        self.hidden = hidden;
    }

    /// Whether an observation is occluded.
    #[inline]
    pub fn is_occluded(&self, observation: usize) -> bool {
        self.hidden.get(observation).is_some_and(|&hidden| hidden)
    }

    /// The change of `Σ ρ` that a trial is charged for an active observation that falls behind its camera.
    #[inline]
    pub fn flip_charge(&self, rho_before: f64) -> f64 {
        if self.may_return() { self.limit.tau - rho_before } else { 0.0 }
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
            sum += terms.map(|(k, &flag)| if flag { rho(block * SUM_BLOCK + k) } else { self.limit.tau }).sum::<f64>();
        }
        0.5 * (sum + self.retired)
    }

    /// What an observation is charged at a state: its ρ if it counts there, τ otherwise. `enters` says whether it is
    /// inside its frustum, which one outside the set must be.
    #[inline]
    pub fn charge(&self, observation: usize, rho: f64, enters: bool) -> f64 {
        if self.counts_at(observation, rho, enters) { rho } else { self.limit.tau }
    }

    #[inline]
    fn counts_at(&self, observation: usize, rho: f64, enters: bool) -> bool {
        if self.is_occluded(observation) {
            return false;
        }
        // NaN is below nothing.
        match (self.active[observation], self.started) {
            (true, _) => rho < self.limit.tau,
            (false, false) => enters && rho < self.limit.tau,
            (false, true) => enters && rho < RETURN_SHARE * self.limit.tau,
        }
    }

    /// Lowers a dynamic limit to what suits the residuals of the set; before the first update, to those that may enter.
    /// F falls or stays. `square(o)` is the squared residual in px², NaN where there is no valid projection.
    pub fn lower_limit(&mut self, square: impl Fn(usize) -> f64, enters: impl Fn(usize) -> bool) {
        let (mut sum, mut count) = (0.0, 0usize);
        for (block, flags) in self.active.chunks(SUM_BLOCK).enumerate() {
            let mut part = 0.0;
            for (k, &flag) in flags.iter().enumerate() {
                let o = block * SUM_BLOCK + k;
                let value = square(o);
                if value.is_finite() && (flag || !self.started && enters(o)) {
                    part += value.max(LEAST_SQUARE).ln();
                    count += 1;
                }
            }
            sum += part;
        }
        self.limit.follow(sum, count);
    }

    /// Decides the set at an accepted state and returns F. `rho(o)` is the observation's ρ, NaN where it has no valid
    /// projection; `rho_before(o)` its value at the state accepted before, used for those that just became invalid;
    /// `enters(o)` whether it is inside its frustum.
    pub fn update(
        &mut self,
        rho: impl Fn(usize) -> f64,
        rho_before: impl Fn(usize) -> f64,
        enters: impl Fn(usize) -> bool,
    ) -> f64 {
        let may_return = self.may_return();
        let (mut sum, mut count) = (0.0, 0);
        for first in (0..self.active.len()).step_by(SUM_BLOCK) {
            let mut part = 0.0;
            for o in first..self.active.len().min(first + SUM_BLOCK) {
                let (was, value) = (self.active[o], rho(o));
                let stays = if may_return {
                    self.counts_at(o, value, enters(o))
                } else {
                    let hidden = self.is_occluded(o) && self.activation != Activation::All;
                    value.is_finite() && !hidden && (was || !self.started)
                };
                if was && !stays && !may_return {
                    self.retired += if value.is_finite() { value } else { rho_before(o) };
                }
                self.active[o] = stays;
                part += if stays { value } else { self.limit.tau };
                count += usize::from(stays);
            }
            sum += part;
        }
        self.count = count;
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
        let before = set.update(|o| [1.0, 9.0, f64::NAN][o], |_| f64::NAN, |_| true);
        assert_eq!((before, set.count()), (0.5 * (1.0 + 4.0 + 4.0), 1));
        // 3.5 is under τ = 4 but not under 0.8 τ: it stays out; the charge for falling behind is τ.
        assert_eq!(set.flip_charge(1.0), 3.0);
        let after = set.update(|o| [f64::NAN, 3.5, 3.0][o], |_| f64::NAN, |_| true);
        assert_eq!(set.count(), 1);
        assert!(set.is_active(2) && after == 0.5 * (4.0 + 4.0 + 3.0));
    }

    #[test]
    fn fixed_set_charges_the_last_cost_of_what_leaves() {
        let mut set = ActiveSet::new(Activation::ValidAtStart, Loss::Squared, 2);
        let before = set.update(|o| [1.0, 9.0][o], |_| f64::NAN, |_| true);
        let after = set.update(|o| [1.0, f64::NAN][o], |o| [1.0, 9.0][o], |_| true);
        assert_eq!((before, after, set.count()), (5.0, 5.0, 1));
        assert_eq!(set.update(|o| [0.5, 1.0][o], |_| f64::NAN, |_| true), 0.5 * 9.5);
    }

    #[test]
    fn a_dynamic_limit_suits_the_state_and_only_falls() {
        let mut set = ActiveSet::new(Activation::Dynamic { residual_limit_px: 2.0 }, Loss::Squared, 4);
        // Two of 10 px, one of 1000 px that may not enter, one without a projection: the limit is 8 times 10.
        let wide = |o: usize| [100.0, 100.0, 1e6, f64::NAN][o];
        set.lower_limit(wide, |o| o != 2);
        assert!((set.limit_px() - 80.0).abs() < 1e-9);
        set.update(wide, |_| f64::NAN, |o| o != 2);
        assert_eq!(set.count(), 2);
        // Residuals of 0.1 px would suit 2 px: half of the old limit at a time. Larger ones never raise it.
        for limit in [40.0, 20.0, 10.0, 5.0, 2.5, 2.0, 2.0] {
            set.lower_limit(|_| 0.01, |_| true);
            assert!((set.limit_px() - limit).abs() < 1e-9, "{} {limit}", set.limit_px());
        }
        set.lower_limit(|_| 1e4, |_| true);
        assert_eq!(set.limit_px(), 2.0);
    }

    #[test]
    fn what_is_occluded_costs_the_limit_and_returns_when_it_is_seen() {
        let mut set = ActiveSet::new(Activation::Truncated { residual_limit_px: 2.0 }, Loss::Squared, 2);
        let update = |set: &mut ActiveSet| set.update(|_| 1.0, |_| f64::NAN, |_| true);
        assert_eq!(update(&mut set), 0.5 * 2.0);
        set.occlude(vec![true, false]);
        assert_eq!((update(&mut set), set.count()), (0.5 * (4.0 + 1.0), 1));
        set.occlude(vec![false, false]);
        assert_eq!((update(&mut set), set.count()), (0.5 * 2.0, 2));
    }
}
