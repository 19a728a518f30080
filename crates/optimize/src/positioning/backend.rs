//! Where positioning runs: what its stages ask of a processor, whichever it is.

use epipole_geometry::camera::Real;

use super::gauge::Positions;
use super::layout::Rays;
use super::options::Options;
use crate::error::OptimizeError;
use crate::lm::{LmReport, Observer};

/// A convex problem that a start minimises by iteratively reweighted least squares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Objective {
    /// `½ Σ ω ρ(‖v − s d‖²)` with every scale held: pinned ones where they are, free ones at one value.
    EqualScales {
        /// Scale of the free observations, 1 / world unit.
        free_scale: f64,
        /// Huber threshold of all observations.
        huber: f64,
    },
    /// `Σ ω ‖d − ℓ v‖` over ray lengths `ℓ ≥ bound`.
    Lud {
        /// Least length of a free ray.
        bound: f64,
        /// Deviations below this length weigh alike.
        delta: f64,
    },
}

/// What one reweighted solve did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ConvexStep {
    /// The objective at the new positions.
    pub(crate) cost: f64,
    /// Products with the operator; 0 for a factorisation.
    pub(crate) inner_iterations: usize,
    /// Largest |coordinate| of a centre's step.
    pub(crate) moved: f64,
    /// Largest |coordinate| of a centre.
    pub(crate) extent: f64,
}

/// A processor with a problem and its positions on it. Only scalars cross within a stage, positions between stages.
#[allow(async_fn_in_trait)]
pub(crate) trait Backend {
    /// What it computes with.
    type Scalar: Real;

    /// Linearises an objective at the present positions, and returns its cost there. [`Objective::EqualScales`] begins
    /// with everything in the origin.
    async fn begin(&mut self, objective: Objective, observer: &mut dyn Observer) -> Result<f64, OptimizeError>;

    /// Solves the linearised objective with damping relative to its diagonal, moves there and linearises again; `None`
    /// where the system has no solution, or the observer asked to stop before there was one.
    async fn solve(&mut self, lambda: f64, observer: &mut dyn Observer) -> Result<Option<ConvexStep>, OptimizeError>;

    /// Variable projection of the given rays from the present positions.
    async fn project(
        &mut self,
        rays: &Rays<Self::Scalar>,
        options: &Options,
        observer: &mut dyn Observer,
    ) -> Result<LmReport, OptimizeError>;

    /// The present positions.
    async fn positions(&mut self) -> Result<Positions<Self::Scalar>, OptimizeError>;

    /// Replaces the present positions.
    fn place(&mut self, positions: &Positions<Self::Scalar>);
}
