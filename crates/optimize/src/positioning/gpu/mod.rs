//! Global positioning on a WebGPU device, in single precision (source: `solver.md` §3).
//!
//! Stages, retries and checks are the CPU's ([`super::solve`]); what runs here are the linear solves of the convex starts
//! and the whole of variable projection. Weights and scales are kept once a linearisation, Jacobians never; points are
//! eliminated by Givens QR; the centres are solved by PCG with 3×3 Schur–Jacobi blocks. Inside a stage only scalars are
//! read back, once a step; between stages the positions are, for the quality.

mod backend;
mod chunks;
mod processor;
mod records;
mod resident;
mod system;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
#[cfg(test)]
mod twin;

use super::layout::{Layout, Rays};
use super::options::Options;
use super::problem::Problem;
use super::report::Report;
use super::solve::{finish, solve_on};
use crate::error::OptimizeError;
use crate::gpu::kernels::positioning::POSITIONING;
use crate::gpu::{Device, Pipelines, Variant};
use crate::lm::{Observer, breath};
use chunks::CHUNK_OBSERVATIONS;
use processor::Gpu;

/// Finds all camera centres and points on a GPU: [`super::solve`] in `f32`, whose documentation holds here too.
/// [`Options::linear_solver`] is not used: the device always solves by conjugate gradients. The same bytes on the same
/// device, every time.
///
/// # Errors
/// As [`super::solve`], and [`OptimizeError::Gpu`] where the device fails or cannot hold the problem. The problem is
/// unchanged then and can be solved on another device or on the CPU.
pub async fn solve(
    device: &Device,
    problem: &mut Problem,
    options: &Options,
    observer: &mut dyn Observer,
) -> Result<Report, OptimizeError> {
    solve_in_chunks(device, problem, options, observer, CHUNK_OBSERVATIONS).await
}

async fn solve_in_chunks(
    device: &Device,
    problem: &mut Problem,
    options: &Options,
    observer: &mut dyn Observer,
    chunk_observations: usize,
) -> Result<Report, OptimizeError> {
    problem.validate()?;
    Pipelines::prepare(device, POSITIONING, Variant::default(), observer).await?;
    let layout = Layout::new(problem, None)?;
    breath(observer).await;
    let rays = Rays::<f32>::new(problem, &layout);
    let mut gpu = Gpu::new(device, &layout, &rays, chunk_observations)?;
    let (outcome, positions) = solve_on(&mut gpu, &layout, &rays, options, observer).await?;
    Ok(finish(problem, &layout, outcome, &positions))
}
