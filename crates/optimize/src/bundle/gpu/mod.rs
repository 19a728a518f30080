//! Bundle adjustment on a WebGPU device, in single precision (source: `solver.md` §1.3, §2).
//!
//! Jacobians are computed where they are needed and never stored; points are eliminated inside the operator; the
//! reduced system is solved by PCG with a two-level preconditioner (source: `scale.md` §3). Inside a solve scalars are
//! read back, once a step, and every second step the small matrix of the preconditioner's second level.
//! Every camera model, also several in one problem; observations with metric depth have a third row in kernels of their own
//! variant, so that a problem without depth pays nothing.

mod buffers;
mod checkpoint;
mod chunk;
mod coarse;
mod counters;
mod exact;
mod lattice;
mod layout;
pub mod measure;
mod membership;
mod priors;
mod records;
mod residency;
mod resident;
mod sizes;
mod system;
#[cfg(test)]
pub(crate) mod twin;
mod write;

pub use checkpoint::Checkpoint;
pub use counters::{Counters, ResidentBytes};
pub use residency::Residency;
pub use system::GpuSystem;

use super::options::Options;
use super::problem::Problem;
use crate::error::OptimizeError;
use crate::gpu::{Device, Guard, Halt, Pipelines, kernels};
use crate::lm::{LmOptions, LmReport, Observer, Termination, breath, minimize};

/// Solves on a GPU. The problem is left at the last accepted state, with its cost evaluated in `f64`.
///
/// # Errors
/// [`OptimizeError::Interrupted`] where the device fails on the way. The problem then holds a state that the solve
/// accepted, that of the iteration before or of a large problem a few before: solve it again on another device or on the
/// CPU, with the [`Checkpoint`]'s damping as first damping, and only those are lost. Any other error leaves the problem
/// as it was.
pub async fn solve(
    device: &Device,
    problem: &mut Problem,
    options: &Options,
    observer: &mut dyn Observer,
) -> Result<LmReport, OptimizeError> {
    solve_with(device, problem, options, &Residency::default(), observer).await
}

/// [`solve`] with a say in how the problem lies on the device.
pub async fn solve_with(
    device: &Device,
    problem: &mut Problem,
    options: &Options,
    residency: &Residency,
    observer: &mut dyn Observer,
) -> Result<LmReport, OptimizeError> {
    problem.validate()?;
    match Pipelines::prepare(device, kernels::BUNDLE, sizes::variant(problem), observer).await {
        Err(Halt::Stopped) => return unmoved(problem, options, observer).await,
        prepared => prepared?,
    }
    let mut system = GpuSystem::with_residency(device, problem, options, residency)?;
    breath(observer).await;
    let failure = system.failure();
    let mut guard = Guard { inner: observer, failure: failure.clone() };
    let mut report = minimize(&mut system, &options.lm, &mut guard).await;
    let written = match failure.get() {
        Some(error) => Err(error),
        None => system.write(problem).await,
    };
    match written {
        Ok(cost) => report.final_cost = cost,
        Err(error) => return Err(OptimizeError::Interrupted { error, kept: system.rescue(problem) }),
    }
    Ok(report)
}

/// The report of a solve that was stopped before it began.
async fn unmoved(
    problem: &mut Problem,
    options: &Options,
    observer: &mut dyn Observer,
) -> Result<LmReport, OptimizeError> {
    let lm = LmOptions { max_iterations: 0, ..options.lm };
    let report = super::solve_async::<f64>(problem, &Options { lm, ..*options }, observer).await?;
    Ok(LmReport { termination: Termination::Stopped, ..report })
}
