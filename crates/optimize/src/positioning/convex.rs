//! Starts without random numbers: two convex problems whose answers unfold the graph.

use epipole_geometry::camera::Real;

use super::backend::{Backend, Objective};
use super::block::Block;
use super::gauge::{Positions, median};
use super::layout::{Layout, Rays};
use super::vec3::Vec3;
use crate::error::OptimizeError;
use crate::lm::{Observer, breath};
use crate::parallel;

/// Damping of the convex solves: enough to hold the gauge, too little to move the answer (`global-positioning.md` §5).
const LAMBDA: f64 = 1e-9;
/// Without factor at [`LAMBDA`] (a graph that hangs together by rounding), this much more is tried.
const STRONGER: f64 = 1e4;
/// Huber threshold of the start on the unit ray, rad for small angles; wide, because lengths of 1 are wrong for all.
const HUBER: f64 = 0.1;
/// At most so many reweighted solves, and the relative decrease that ends them earlier (`global-positioning.md` §5.1).
const MAX_SOLVES: usize = 8;
const TOLERANCE: f64 = 1e-4;
/// A cost below this part of the first one is rounding: exact pins need one solve.
const NEGLIGIBLE: f64 = 1e-12;

/// LUD (least unsquared deviations, Özyeşil and Singer, CVPR 2015): solves of the start, then at most so many of its own.
const LUD_START_SOLVES: usize = 5;
const LUD_MAX_SOLVES: usize = 20;
/// Deviations below this part of the unit are treated as equal, so that weights stay bounded.
const LUD_DELTA: f64 = 0.01;
/// Ends when no centre moves by more than this part of the farthest one.
const LUD_TOLERANCE: f64 = 1e-3;
/// Least ray length in units of the median pinned length. Without pins the bound *is* the unit, 1. With pins the scale
/// is known and the bound only has to keep points in front; a tenth of the median leaves near points free.
const LUD_METRIC_BOUND: f64 = 0.1;

/// What a convex start took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ConvexReport {
    /// Linear solves.
    pub solves: usize,
    /// Cost of the start's own objective at its end; not comparable with other costs.
    pub cost: f64,
    /// Products with the operator, if conjugate gradients were used.
    pub inner_iterations: usize,
}

/// All free scales equal: 1, or the median of the pinned ones. Huber by iteratively reweighted least squares; the graph
/// Laplacian `⊗ I₃`, so the three coordinates share one factor (`reference/solver.md` §3.3).
///
/// # Errors
/// [`OptimizeError::Singular`], or what the backend meets.
pub(crate) async fn equal_scales<B: Backend>(
    backend: &mut B,
    unit: f64,
    observer: &mut dyn Observer,
) -> Result<ConvexReport, OptimizeError> {
    unfold(backend, unit, MAX_SOLVES, observer).await
}

async fn unfold<B: Backend>(
    backend: &mut B,
    unit: f64,
    max_solves: usize,
    observer: &mut dyn Observer,
) -> Result<ConvexReport, OptimizeError> {
    let first = backend.begin(Objective::EqualScales { free_scale: 1.0 / unit, huber: HUBER }, observer).await?;
    let mut report = ConvexReport { cost: first, ..ConvexReport::default() };
    breath(observer).await;
    while report.solves < max_solves {
        let previous = report.cost;
        solve(backend, &mut report, "equal-scale", observer).await?;
        breath(observer).await;
        // From the origin the first cost is the cost of nothing: only later ones tell of convergence.
        let converged = report.solves > 1 && previous - report.cost < TOLERANCE * report.cost;
        if converged || report.cost <= NEGLIGIBLE * first || observer.should_stop() {
            break;
        }
    }
    Ok(report)
}

/// LUD: minimises `Σ ω ‖(X − C) − ℓ v‖` over positions and ray lengths `ℓ ≥ 1`; the second start.
///
/// # Errors
/// [`OptimizeError::Singular`], or what the backend meets.
pub(crate) async fn lud<B: Backend>(
    backend: &mut B,
    unit: f64,
    metric: bool,
    observer: &mut dyn Observer,
) -> Result<ConvexReport, OptimizeError> {
    let mut report = unfold(backend, unit, LUD_START_SOLVES, observer).await?;
    let bound = if metric { LUD_METRIC_BOUND * unit } else { unit };
    report.cost = backend.begin(Objective::Lud { bound, delta: LUD_DELTA * unit }, observer).await?;
    for _ in 0..LUD_MAX_SOLVES {
        let (moved, extent) = solve(backend, &mut report, "LUD", observer).await?;
        breath(observer).await;
        if moved < LUD_TOLERANCE * extent || observer.should_stop() {
            break;
        }
    }
    Ok(report)
}

/// One solve; returns how far centres moved, and how far out they are. Where it is stopped on the way they stay where they are.
async fn solve<B: Backend>(
    backend: &mut B,
    report: &mut ConvexReport,
    stage: &'static str,
    observer: &mut dyn Observer,
) -> Result<(f64, f64), OptimizeError> {
    let mut step = backend.solve(LAMBDA, observer).await?;
    if step.is_none() && !observer.should_stop() {
        step = backend.solve(LAMBDA * STRONGER, observer).await?;
    }
    if step.is_none() && observer.should_stop() {
        // Before the first solve everything is in one place: no answer at all.
        return if report.solves == 0 { Err(OptimizeError::Stopped) } else { Ok((0.0, 0.0)) };
    }
    let step = step.ok_or(OptimizeError::Singular { stage })?;
    report.solves += 1;
    report.cost = step.cost;
    report.inner_iterations += step.inner_iterations;
    Ok((step.moved, step.extent))
}

/// The length of a typical ray: the median of the pinned ones, or 1 where the scale of the world is free.
pub(crate) fn unit<T: Real>(rays: &Rays<T>) -> f64 {
    median(rays.pin.iter().filter(|pin| **pin > T::ZERO).map(|pin| 1.0 / pin.to_f64())).unwrap_or(1.0)
}

/// Fills the blocks in parallel and sums the costs in a fixed order.
pub(crate) async fn linearize<T: Real>(
    layout: &Layout,
    positions: &Positions<T>,
    blocks: &mut [Block<T>],
    observer: &mut dyn Observer,
    model: impl Fn(usize, Vec3<T>) -> (Block<T>, T) + Sync + Send,
) -> f64 {
    let offsets = layout.observation_offsets();
    let mut work: Vec<_> = parallel::split_mut(blocks, &offsets).into_iter().map(|piece| (piece, 0.0f64)).collect();
    parallel::for_each_mut_breathing(&mut work, observer, |chunk, (piece, sum)| {
        for (k, block) in piece.iter_mut().enumerate() {
            let o = offsets[chunk] + k;
            let (linearized, cost) = model(o, positions.difference(layout, o));
            *block = linearized;
            *sum += cost.to_f64();
        }
    })
    .await;
    work.iter().map(|(_, sum)| sum).sum()
}
