//! Starts without random numbers: two convex problems whose answers unfold the graph.

use epipole_geometry::camera::Real;

use super::block::{Block, held};
use super::gauge::{Positions, median};
use super::layout::{Layout, Rays};
use super::normal::{LinearSolver, Normal, Shape};
use super::vec3::{add, dot, scale, sub};
use crate::error::OptimizeError;
use crate::loss::Loss;
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
    /// Cost of the start's own objective before the last solve; not comparable with other costs.
    pub cost: f64,
    /// Products with the operator, if conjugate gradients were used.
    pub inner_iterations: usize,
}

/// All free scales equal: 1, or the median of the pinned ones. Huber by iteratively reweighted least squares; the graph
/// Laplacian `⊗ I₃`, so the three coordinates share one factor (`reference/solver.md` §3.3).
///
/// # Errors
/// [`OptimizeError::Singular`].
pub(crate) fn equal_scales<T: Real>(
    layout: &Layout,
    rays: &Rays<T>,
    solver: LinearSolver,
    max_solves: usize,
) -> Result<(Positions<T>, ConvexReport), OptimizeError> {
    let singular = || OptimizeError::Singular { stage: "equal-scale" };
    let mut normal = Normal::new(layout, Shape::Isotropic, solver).ok_or_else(singular)?;
    let mut positions = Positions::origin(layout);
    let mut report = ConvexReport::default();
    let free_scale = T::from_f64(1.0 / unit(rays));
    let loss = Loss::Huber(HUBER);
    let mut blocks = vec![Block::masked(); layout.observations()];
    let (mut first, mut previous) = (0.0, f64::INFINITY);
    loop {
        let cost = 0.5
            * linearize(layout, &positions, &mut blocks, |o, d| {
                let s = if rays.pin[o] > T::ZERO { rays.pin[o] } else { free_scale };
                held(rays.direction[o], rays.weight[o], s, d, loss)
            });
        report.cost = cost;
        // From the origin the first cost is the cost of nothing: only later ones tell of convergence.
        let converged = report.solves > 1 && previous - cost < TOLERANCE * cost;
        let exact = report.solves > 0 && cost <= NEGLIGIBLE * first;
        if converged || exact || report.solves == max_solves {
            return Ok((positions, report));
        }
        previous = cost;
        if report.solves == 0 {
            first = cost;
        }
        report.inner_iterations += solve(layout, &mut normal, &blocks, &mut positions).ok_or_else(singular)?;
        report.solves += 1;
    }
}

/// The start that is used first.
pub(crate) fn first_start<T: Real>(
    layout: &Layout,
    rays: &Rays<T>,
    solver: LinearSolver,
) -> Result<(Positions<T>, ConvexReport), OptimizeError> {
    equal_scales(layout, rays, solver, MAX_SOLVES)
}

/// LUD: minimises `Σ ω ‖(X − C) − ℓ v‖` over positions and ray lengths `ℓ ≥ 1`; the second start.
///
/// # Errors
/// [`OptimizeError::Singular`].
pub(crate) fn lud_start<T: Real>(
    layout: &Layout,
    rays: &Rays<T>,
    solver: LinearSolver,
) -> Result<(Positions<T>, ConvexReport), OptimizeError> {
    let (mut positions, mut report) = equal_scales(layout, rays, solver, LUD_START_SOLVES)?;
    let singular = || OptimizeError::Singular { stage: "LUD" };
    let mut normal = Normal::new(layout, Shape::Full, solver).ok_or_else(singular)?;
    let unit = unit(rays);
    let bound = T::from_f64(if rays.metric { LUD_METRIC_BOUND * unit } else { unit });
    let delta = T::from_f64(LUD_DELTA * unit);
    let mut blocks = vec![Block::masked(); layout.observations()];
    for _ in 0..LUD_MAX_SOLVES {
        report.cost = linearize(layout, &positions, &mut blocks, |o, d| {
            let ray = rays.direction[o];
            let along = dot(ray, d);
            let (length, free) = if rays.pin[o] > T::ZERO {
                (T::ONE / rays.pin[o], false)
            } else if along > bound {
                (along, true)
            } else {
                (bound, false)
            };
            let r = sub(d, scale(ray, length));
            let deviation = dot(r, r).sqrt();
            let w = rays.weight[o] / deviation.max(delta);
            let direction = if free { ray } else { [T::ZERO; 3] };
            (Block { direction, scale: w.sqrt(), gradient: scale(r, w) }, rays.weight[o] * deviation)
        });
        let before = positions.centers.clone();
        report.inner_iterations += solve(layout, &mut normal, &blocks, &mut positions).ok_or_else(singular)?;
        report.solves += 1;
        let largest = |values: &mut dyn Iterator<Item = T>| values.fold(0.0, |a: f64, v| a.max(v.abs().to_f64()));
        let moved = largest(&mut before.iter().zip(&positions.centers).flat_map(|(a, b)| sub(*a, *b)));
        let extent = largest(&mut positions.centers.iter().flatten().copied());
        if moved < LUD_TOLERANCE * extent {
            break;
        }
    }
    Ok((positions, report))
}

/// The length of a typical ray: the median of the pinned ones, or 1 where the scale of the world is free.
fn unit<T: Real>(rays: &Rays<T>) -> f64 {
    median(rays.pin.iter().filter(|pin| **pin > T::ZERO).map(|pin| 1.0 / pin.to_f64())).unwrap_or(1.0)
}

/// Fills the blocks in parallel and sums the costs in a fixed order.
pub(crate) fn linearize<T: Real>(
    layout: &Layout,
    positions: &Positions<T>,
    blocks: &mut [Block<T>],
    model: impl Fn(usize, super::vec3::Vec3<T>) -> (Block<T>, T) + Sync + Send,
) -> f64 {
    let offsets = layout.observation_offsets();
    let mut work: Vec<_> = parallel::split_mut(blocks, &offsets).into_iter().map(|piece| (piece, 0.0f64)).collect();
    parallel::for_each_mut(&mut work, |chunk, (piece, sum)| {
        for (k, block) in piece.iter_mut().enumerate() {
            let o = offsets[chunk] + k;
            let (linearized, cost) = model(o, positions.difference(layout, o));
            *block = linearized;
            *sum += cost.to_f64();
        }
    });
    work.iter().map(|(_, sum)| sum).sum()
}

fn solve<T: Real>(
    layout: &Layout,
    normal: &mut Normal<T>,
    blocks: &[Block<T>],
    positions: &mut Positions<T>,
) -> Option<usize> {
    normal.gather(layout, blocks);
    let step = normal.solve(layout, blocks, LAMBDA).or_else(|| normal.solve(layout, blocks, LAMBDA * STRONGER))?;
    for (center, delta) in positions.centers.iter_mut().zip(&step.centers) {
        *center = add(*center, *delta);
    }
    for (point, delta) in positions.points.iter_mut().zip(&step.points) {
        *point = add(*point, *delta);
    }
    Some(step.inner_iterations)
}
