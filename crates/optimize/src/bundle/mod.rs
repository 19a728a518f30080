//! Bundle adjustment: poses, intrinsics and points from pixels (source: `solver.md`, `scale.md`).
//!
//! Points are eliminated by Schur complement with QR blocks; the cameras' reduced system is formed and factorised
//! in `f64`, or solved by PCG without forming it, whichever is estimated to be faster. The gauge is free.

pub mod cpu;
mod depth;
mod frustum;
#[cfg(feature = "gpu")]
pub mod gpu;
mod options;
mod problem;
mod validate;

use epipole_geometry::camera::Real;

pub use depth::{DEPTH_LOSS_SIGMAS, Depth};
pub use options::{Options, Preconditioner, Solver};
pub use problem::{ParamPrior, PoseFreedom, Problem};

use crate::error::OptimizeError;
use crate::executor::block_on;
use crate::lm::{Blocking, LmReport, Observer, breath, minimize};

/// Solves on the CPU in `f64`. The problem is left at the last accepted state.
pub fn solve(problem: &mut Problem, options: &Options, observer: &mut dyn Observer) -> Result<LmReport, OptimizeError> {
    solve_with::<f64>(problem, options, observer)
}

/// Solves on the CPU with residuals and derivatives in the given scalar; the reduced system is in `f64` in any case.
/// Costs are reported in `f64`, from the state that is written back.
pub fn solve_with<T: Real>(
    problem: &mut Problem,
    options: &Options,
    observer: &mut dyn Observer,
) -> Result<LmReport, OptimizeError> {
    block_on(solve_async::<T>(problem, options, &mut Blocking(observer)))
}

/// As [`solve_with`], for a host that may not block: waits where the observer asks for a breath.
pub async fn solve_async<T: Real>(
    problem: &mut Problem,
    options: &Options,
    observer: &mut dyn Observer,
) -> Result<LmReport, OptimizeError> {
    problem.validate()?;
    if problem.only_points_move() {
        return Ok(cpu::solve_points(problem, options, observer));
    }
    match &problem.depth {
        Some(depth) if depth.is_any() => solve_rows::<T, { cpu::WITH_DEPTH }>(problem, options, observer).await,
        _ => solve_rows::<T, { cpu::PIXELS }>(problem, options, observer).await,
    }
}

async fn solve_rows<T: Real, const ROWS: usize>(
    problem: &mut Problem,
    options: &Options,
    observer: &mut dyn Observer,
) -> Result<LmReport, OptimizeError> {
    let mut system = cpu::CpuSystem::<T, ROWS>::prepare(problem, options, observer).await?;
    breath(observer).await;
    let mut report = minimize(&mut system, &options.lm, observer).await;
    breath(observer).await;
    report.final_cost = system.write(problem);
    Ok(report)
}
